"""Volume, area and centroid of the solid, integrated from the equation itself.

One rule per direction where the map is smooth all over its box (see `together`), else composite
Gauss-Legendre rules, their panels and orders chosen on lines along it (see `quadrature`); the
difference of two such rules is the error estimate. det J is watched at every node, unless its sign
is proved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.jacobian_watch import JacobianWatch
from pc2cad.domain.map import open_grid
from pc2cad.errors import NotASolidError
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.polynomials import polynomials
from pc2cad.expression.tree import ops_of
from pc2cad.geometry.splines.bernstein import degree_in
from pc2cad.integrals.densities import Densities
from pc2cad.integrals.exact import ExactIntegrals, exact_integrals
from pc2cad.integrals.flat_faces import MOST_DEGREE, flat_areas
from pc2cad.integrals.quadrature import Panels
from pc2cad.integrals.rules import (
    EXACT,
    by_layer,
    limits_of,
    narrowed,
    total,
)
from pc2cad.integrals.settling import settle
from pc2cad.integrals.side_areas import areas_of_side, sides_in_pieces
from pc2cad.integrals.together import integrate_together
from pc2cad.topology.cells import Cell

#: relative difference of two rules at which there is no integral
UNSETTLED = 0.01
#: length of a panel that says where an integral does not settle
SHORT = 1 / 48

#: sources of integrals, as a report shows them
QUADRATURE = "equation (Gauss quadrature)"
CLOSED_FORM = "equation (closed form over the rationals)"
CLOSED_FORM_BUT_AREA = "equation (closed form; area of curved faces by Gauss quadrature)"


class NotIntegrableError(NotASolidError):
    """The volume or the area of the equation is not finite."""


@dataclass(frozen=True)
class MassProperties:
    """Integrals of the solid in model units, with an estimate of their relative error."""

    volume: float
    area: float
    centroid: tuple[float, float, float]
    #: area of each face, in the order of the boundary complex
    face_areas: tuple[float, ...]
    #: of what is integrated numerically; 0 where everything is in closed form
    relative_error: float
    #: how they were found
    source: str = QUADRATURE
    #: of each layer: volume, and centroid
    layers: tuple[tuple[float, tuple[float, float, float]], ...] = ()
    #: area of each face between two layers, in the order of the complex
    interface_areas: tuple[float, ...] = ()

    @property
    def thickness(self) -> float:
        """The mean thickness 2V/A, in model units."""
        return 2 * self.volume / self.area


def integrate(analysis: Analysis, proved: bool = False) -> MassProperties:
    """Return the integrals; raise FoldedMapError where a quadrature node shows a fold.

    Where it is `proved` that det J keeps its sign, none is looked at for that alone.
    """
    watch = JacobianWatch(analysis.map)
    exact, closed = _exact_rules(analysis), exact_integrals(analysis)
    if exact is not None and closed is not None:
        if not proved:
            watch.see(*open_grid(*(panels.rule()[0] for panels in exact)))
            watch.check()
        densities = Densities(analysis, np.zeros(3), watch)
        areas, errors = _areas(analysis, densities, exact, exact, closed, {})
        return _in_closed_form(closed, areas, _settled(errors))
    centre = _centre(analysis)
    # no node shows a fold where the sign is proved, and det J is nought on no more than a null set
    densities = Densities(analysis, centre, None if proved else watch)
    layers: list[Array] = []
    known: dict[Cell, tuple[float, float]] = {}
    if exact is not None:
        whole = exact
        moments, error = total(densities.volume, [p.rule() for p in exact]), EXACT
    else:
        limits = narrowed(analysis, limits_of(analysis))
        smooth = integrate_together(analysis, limits, densities.look, centre)
        if smooth is not None:
            whole = [Panels(np.array(row), np.ones(1, dtype=int)) for row in limits]
            moments, error, known = smooth.values, smooth.error, smooth.areas
        else:
            found = settle(densities.volume, limits, partial(by_layer, analysis), densities.measure)
            whole, layers, error = found.rules, found.values, found.error
            moments = np.sum(layers, axis=0)
    if not proved:
        watch.check()
    gathered = partial(_gathered, analysis, whole)
    _settled([error if np.isfinite(moments).all() else np.inf], gathered)
    areas, errors = _areas(analysis, densities, whole, exact, closed, known)
    errors = _settled([error, *errors], gathered)
    outer = len(analysis.boundary.faces)
    volume, centroid = _mass(moments, centre)
    numeric = MassProperties(
        volume, sum(areas[:outer]), centroid, tuple(areas[:outer]), max(errors), QUADRATURE,
        tuple(_mass(part, centre) for part in layers) if analysis.equation.layers else (),
        tuple(areas[outer:]),
    )  # fmt: skip
    return numeric if closed is None else _in_closed_form(closed, areas, errors[1:])


def _gathered(analysis: Analysis, rules: list[Panels]) -> str:
    """Return in words where the panels of rules are shortest: what is not resolved lies there."""
    found = []
    for direction, panels in enumerate(rules):
        lengths = np.diff(panels.limits)
        k = int(lengths.argmin())
        if 0 < lengths[k] < SHORT:
            place = analysis.map.value(direction, float(panels.limits[k : k + 2].mean()))
            found.append(f"{PARAMETERS[direction]} = {place:.4g}")
    return f" near {', '.join(found)}" if found else ""


def _settled(errors: list[float], where: Callable[[], str] = str) -> list[float]:
    """Return relative errors; raise NotIntegrableError for large ones, with words on the place."""
    if not np.isfinite(errors).all():
        raise NotIntegrableError(
            f"the equation or a derivative has no finite value inside the box{where()}: look for "
            "a division by zero or the root of a square; abs(x) says what sqrt(x^2) does not"
        )
    if not max(errors) < UNSETTLED:
        raise NotIntegrableError(
            f"the integrals of volume and area do not settle (still {max(errors):.2g} of them from "
            f"one rule to the next{where()}): look for a division by zero inside the box"
        )
    return errors


def _areas(
    analysis: Analysis,
    densities: Densities,
    whole: list[Panels],
    exact: list[Panels] | None,
    closed: ExactIntegrals | None,
    known: dict[Cell, tuple[float, float]],
) -> tuple[list[float], list[float]]:
    """Return the area of each face of the complex, and its relative error, if not `known`."""
    found = dict(known)
    patches = [face.patch for face in analysis.complex.faces]
    if closed is not None:
        outer = [face.patch for face in analysis.boundary.faces]
        pairs = zip(outer, closed.face_areas, strict=True)
        found |= {patch: (area, EXACT) for patch, area in pairs if area is not None}
    if exact is not None:
        left = [patch for patch in patches if patch not in found]
        found |= {patch: (area, EXACT) for patch, area in flat_areas(analysis, left).items()}
    for side in sides_in_pieces([patch for patch in patches if patch not in found]):
        found |= areas_of_side(densities.area_of(side[0]), analysis, side, whole)
    for patch in patches:
        if patch not in found:
            area = settle(densities.area_of(patch), _refined(analysis, patch, whole))
            found[patch] = float(area.values[0][0]), area.error
    return [found[patch][0] for patch in patches], [found[patch][1] for patch in patches]


def _mass(moments: Array, centre: Array) -> tuple[float, tuple[float, float, float]]:
    """Return volume and centroid."""
    x, y, z = (moments[1:] / moments[0] + centre).tolist()
    return abs(float(moments[0])), (x, y, z)


def _in_closed_form(
    exact: ExactIntegrals, numeric: list[float], face_errors: list[float]
) -> MassProperties:
    """Return the properties with all that is known exactly in place of areas as integrated."""
    x, y, z = (float(c) for c in exact.centroid)
    triples = list(zip(exact.face_areas, numeric, face_errors, strict=False))
    areas = tuple(a if a is not None else b for a, b, _ in triples)
    curved = [error for area, _, error in triples if area is None]
    source = CLOSED_FORM if not curved else CLOSED_FORM_BUT_AREA
    return MassProperties(
        float(exact.volume), sum(areas), (x, y, z), areas, max(curved, default=0.0), source
    )


def _exact_rules(analysis: Analysis) -> list[Panels] | None:
    """Return the rules that integrate det J and its moments exactly where M is one polynomial.

    Of degree n in a direction, M·det J is of degree 4n - 1 there: 2n nodes.
    """
    trees = analysis.map.coordinates
    known = polynomials(trees)
    if known is not None:
        every = [powers for f in known.map for powers in f]
        degrees: list[int | None] = [max(row, default=0) for row in zip(*every, strict=True)]
    elif "pieces" in ops_of(trees):
        return None
    else:
        degrees = [degree_in(trees, name) for name in PARAMETERS]
    if any(n is None or n > MOST_DEGREE for n in degrees):
        return None
    return [
        Panels(np.array([0.0, 1.0]), np.array([max(1, 2 * n)])) for n in degrees if n is not None
    ]


def _centre(analysis: Analysis) -> Array:
    """Return a point amid the solid: moments about it lose no digits far from the origin."""
    inside = open_grid([0.21, 0.74], [0.23, 0.71], [0.26, 0.77])
    return np.asarray(analysis.map.points(*inside).mean(axis=(0, 1, 2)))


def _refined(analysis: Analysis, patch: Cell, whole: list[Panels]) -> list[list[float]]:
    """Return limits on a patch: where the volume needed panels, its area may well need them."""
    return [
        [low, *(float(x) for x in panels.limits if low < x < high), high]
        for (low, *_, high), panels in zip(limits_of(analysis, patch), whole, strict=True)
    ]
