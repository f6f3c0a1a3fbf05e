"""Volume, area and centroid of the solid, integrated from the equation itself.

Composite Gauss-Legendre rules per direction, their panels and orders chosen on lines along it (see
`quadrature`); the difference of two such rules is the error estimate. det J is watched at every
node.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import product
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.jacobian_watch import JacobianWatch
from pc2cad.domain.map import open_grid
from pc2cad.errors import NotASolidError
from pc2cad.expression.narrow import narrow_limits
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import walk
from pc2cad.geometry.splines.bernstein import degree_in
from pc2cad.integrals.exact import ExactIntegrals, exact_integrals
from pc2cad.integrals.features import find_features
from pc2cad.integrals.quadrature import Panels, Samples, resolve, single
from pc2cad.topology.cells import Cell, directions_of

#: points of one integral
MOST_POINTS = 3e6
#: relative error of a rule that is exact, and the highest degree that one is made for
EXACT, MOST_DEGREE = 1e-15, 16
#: points evaluated at once
SLAB_POINTS = 300_000
#: relative difference of two rules at which a third is tried
DOUBTFUL = 1e-12
#: relative difference of two rules at which there is no integral
UNSETTLED = 0.01
#: places of the lines in the other two directions: irrational, evenly spread (Roberts' sequence)
_LINES = (0.5 + np.outer(np.arange(1, 9), [0.7548776662466927, 0.5698402909980532])) % 1.0
#: nodes and weights per direction
_Rules = list[tuple[Array, Array]]
#: u, v and w (broadcastable) to integrands (…, k) and the size of the first one's terms (…)
_Density = Callable[[Array, Array, Array], Samples]


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


def integrate(analysis: Analysis) -> MassProperties:
    """Return the integrals; raise FoldedMapError where a quadrature node shows a fold."""
    centre = _centre(analysis)
    watch = JacobianWatch(analysis.map)
    densities = _Densities(analysis, centre, watch)
    exact = _exact_rules(analysis)
    layers: list[Array] = []
    if exact is not None:
        whole = exact
        moments, error = _total(densities.volume, [p.rule() for p in exact]), EXACT
    else:
        features = _features(densities.measure, _limits(analysis))
        limits = _narrowed(analysis, _limits(analysis))
        whole = [_panels(densities.volume, limits, d, features) for d in range(3)]
        found = [_integral(densities.volume, part) for part in _layers(analysis, whole)]
        layers, errors = [m for m, _ in found], [e for _, e in found]
        moments, error = np.sum(layers, axis=0), max(errors)
    watch.check()
    if not (np.isfinite(moments).all() and np.isfinite(error)):
        raise NotIntegrableError(
            "the equation or a derivative has no finite value inside the box: look for a division "
            "by zero or the root of a square; abs(x) says what sqrt(x^2) does not"
        )
    areas, errors = [], [error]
    for face in analysis.complex.faces:
        flat = exact and _flat_area(analysis, face.patch, exact)
        if flat:
            areas.append(flat)
            errors.append(EXACT)
            continue
        density = densities.area_of(face.patch)
        panels = _on_face(density, analysis, face.patch, whole)
        area, face_error = _integral(density, panels)
        areas.append(float(area[0]))
        errors.append(face_error)
    if not max(errors) < UNSETTLED:
        raise NotIntegrableError(
            f"the integrals of volume and area do not settle (still {max(errors):.2g} of them from "
            "one rule to the next): look for a division by zero inside the box"
        )
    outer = len(analysis.boundary.faces)
    volume, centroid = _mass(moments, centre)
    numeric = MassProperties(
        volume, sum(areas[:outer]), centroid, tuple(areas[:outer]), max(errors), QUADRATURE,
        tuple(_mass(part, centre) for part in layers) if analysis.equation.layers else (),
        tuple(areas[outer:]),
    )  # fmt: skip
    closed = exact_integrals(analysis)
    return numeric if closed is None else _in_closed_form(closed, numeric, errors[1:])


def inertia(analysis: Analysis, about: tuple[float, float, float]) -> Array:
    """Return the tensor of inertia (3, 3) about a place, for the density 1, in units^5.

    By the same quadrature as `integrate`; raises what that raises.
    """
    centre, watch = np.array(about), JacobianWatch(analysis.map)
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]

    def second(u: Array, v: Array, w: Array) -> Samples:
        points, *tangents = analysis.map.frame(u, v, w)
        determinant, size, _ = watch.note(tangents, (u, v, w))
        from_centre = points - centre
        with np.errstate(all="ignore"):
            values = [from_centre[..., i] * from_centre[..., j] * determinant for i, j in pairs]
            size = size * (from_centre * from_centre).sum(axis=-1)
        return Samples(np.stack(values, axis=-1), size, points, np.stack(tangents))

    limits = _limits(analysis)
    features = _features(second, limits)
    found, _ = _integral(second, [_panels(second, limits, d, features) for d in range(3)])
    moments = np.empty((3, 3))
    for (i, j), value in zip(pairs, found, strict=True):
        moments[i, j] = moments[j, i] = value
    # det J may be negative all over
    moments *= np.sign(np.trace(moments))
    return np.asarray(np.trace(moments) * np.eye(3) - moments)


def _mass(moments: Array, centre: Array) -> tuple[float, tuple[float, float, float]]:
    """Return volume and centroid."""
    x, y, z = (moments[1:] / moments[0] + centre).tolist()
    return abs(float(moments[0])), (x, y, z)


def _layers(analysis: Analysis, whole: list[Panels]) -> list[list[Panels]]:
    """Return the rules of the whole box, layer by layer."""
    if not analysis.equation.layers:
        return [whole]
    u, v, w = whole
    limits = analysis.bounds[2]
    cuts = np.searchsorted(w.limits, np.array(limits) - 1e-12).tolist()
    return [
        [u, v, Panels(w.limits[a : b + 1], w.orders[a:b], w.unresolved)] for a, b in pairwise(cuts)
    ]


def _in_closed_form(
    exact: ExactIntegrals, numeric: MassProperties, face_errors: list[float]
) -> MassProperties:
    """Return the properties with all that is known exactly in place of what was integrated."""
    x, y, z = (float(c) for c in exact.centroid)
    pairs = list(zip(exact.face_areas, numeric.face_areas, strict=True))
    areas = tuple(a if a is not None else b for a, b in pairs)
    curved = [e for (a, _), e in zip(pairs, face_errors, strict=True) if a is None]
    source = CLOSED_FORM if not curved else CLOSED_FORM_BUT_AREA
    return MassProperties(
        float(exact.volume), sum(areas), (x, y, z), areas, max(curved, default=0.0), source
    )


def _exact_rules(analysis: Analysis) -> list[Panels] | None:
    """Return the rules that integrate det J and its moments exactly where M is one polynomial.

    Of degree n in a direction, M·det J is of degree 4n - 1 there: 2n nodes.
    """
    trees = analysis.map.coordinates
    if any(node.op == "pieces" for node in walk(trees)):
        return None
    degrees = [degree_in(trees, name) for name in PARAMETERS]
    if any(n is None or n > MOST_DEGREE for n in degrees):
        return None
    return [
        Panels(np.array([0.0, 1.0]), np.array([max(1, 2 * n)])) for n in degrees if n is not None
    ]


def _flat_area(analysis: Analysis, patch: Cell, rules: list[Panels]) -> float:
    """Return the area of a polynomial face that lies in a plane, exactly; 0 where it does not.

    Its normals M_s × M_t are polynomials that the rule's nodes determine; where they all point one
    way, the length of their integral is the area.
    """
    s, t = directions_of(patch)
    nodes, weights = [], []
    for d, panels in enumerate(rules):
        low, high = analysis.span(d, patch[d])
        x, weight = panels.rule() if patch[d] % 2 else (np.zeros(1), np.ones(1))
        nodes.append(low + (high - low) * x)
        weights.append(weight * (high - low) if patch[d] % 2 else weight)
    along_s, along_t = analysis.map.tangents((s, t), *open_grid(*nodes))
    normals = np.cross(along_s, along_t).reshape(-1, 3)
    weight = (weights[0][:, None, None] * weights[1][:, None] * weights[2]).ravel()
    whole = product(weight, normals)
    area = float(np.sqrt(whole @ whole))
    if area == 0:
        return 0.0
    along = product(normals, whole / area)
    largest = float(np.abs(normals).max())
    across = np.abs(normals - along[:, None] * (whole / area)).max()
    flat = across <= 1e-13 * largest and along.min() >= -1e-13 * largest
    return area if flat else 0.0


def _centre(analysis: Analysis) -> Array:
    """Return a point amid the solid: moments about it lose no digits far from the origin."""
    inside = open_grid([0.21, 0.74], [0.23, 0.71], [0.26, 0.77])
    return np.asarray(analysis.map.points(*inside).mean(axis=(0, 1, 2)))


@dataclass(frozen=True)
class _Densities:
    """The integrands, as functions of places."""

    analysis: Analysis
    centre: Array
    watch: JacobianWatch

    def volume(self, u: Array, v: Array, w: Array) -> Samples:
        """Return det J and (M - centre) det J; the sign of det J is noted on the way."""
        points, *tangents = self.analysis.map.frame(u, v, w)
        determinant, size, _ = self.watch.note(tangents, (u, v, w))
        values = np.empty((4, *determinant.shape))
        values[0] = determinant
        with np.errstate(all="ignore"):
            for axis, centre in enumerate(self.centre):
                values[1 + axis] = (points[..., axis] - centre) * determinant
        return Samples(np.moveaxis(values, 0, -1), size, points, np.stack(tangents))

    def measure(self, u: Array, v: Array, w: Array) -> Samples:
        """Return det J alone, and note no sign."""
        a, b, c = self.analysis.map.tangents((0, 1, 2), u, v, w)
        values = np.einsum("...i,...i->...", a, np.cross(b, c))
        return Samples(values[..., None], np.abs(values))

    def area_of(self, patch: Cell) -> _Density:
        """Return the function that gives |M_s × M_t| on a patch."""
        s, t = directions_of(patch)

        def area(u: Array, v: Array, w: Array) -> Samples:
            tangents = self.analysis.map.tangents((s, t), u, v, w)
            # coordinate by coordinate: np.cross is slower
            (a, b, c), (x, y, z) = (np.moveaxis(m, -1, 0) for m in tangents)
            with np.errstate(all="ignore"):
                values = _length(b * z - c * y, c * x - a * z, a * y - b * x)
                terms = _length(a, b, c) * _length(x, y, z)
            return Samples(values[..., None], terms)

        return area


def _length(x: Array, y: Array, z: Array) -> Array:
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def _features(density: _Density, limits: list[list[float]]) -> Array:
    """Return places (m, 3) where a density stands out of its surroundings."""
    spans = np.array([(row[0], row[-1]) for row in limits])
    return find_features(lambda places: density(*places.T).values[:, 0], spans)


def _panels(
    density: _Density, limits: list[list[float]], direction: int, features: Array
) -> Panels:
    """Return panels that resolve a density along one direction of a cell with such limits."""
    others = [d for d in range(3) if d != direction]
    spans = [(limits[d][0], limits[d][-1]) for d in others]
    across = [
        np.append(low + (high - low) * _LINES[:, k], features[:, others[k]])
        for k, (low, high) in enumerate(spans)
    ]

    def sample(t: Array) -> Samples:
        places: list[Array] = [t[:, None]] * 3
        for d, x in zip(others, across, strict=True):
            places[d] = x[None, :]
        seen = density(*places)
        tangents = None if seen.tangents is None else seen.tangents[direction]
        return Samples(seen.values, seen.terms, seen.points, tangents)

    look = all(len(set(row)) > 1 for row in limits)
    return resolve(sample, limits[direction], look, len(features))


def _limits(analysis: Analysis, patch: Cell | None = None) -> list[list[float]]:
    """Return per direction the limits of the smooth pieces of a patch, or of the whole box."""
    found = []
    for d in range(3):
        low, high = (0.0, 1.0) if patch is None else analysis.span(d, patch[d])
        inner = [b.position for b in analysis.breaks[d] if low < b.position < high]
        found.append([low, *inner, high])
    return found


def _narrowed(analysis: Analysis, limits: list[list[float]]) -> list[list[float]]:
    """Return limits with those between which functions change at short length."""
    trees = analysis.map.coordinates
    return [
        sorted({*row, *narrow_limits(trees, name).tolist()})
        for name, row in zip(PARAMETERS, limits, strict=True)
    ]


def _on_face(
    density: _Density, analysis: Analysis, patch: Cell, whole: list[Panels]
) -> list[Panels]:
    """Return panels for a patch; where the volume needed panels, its area may well need them."""
    limits = _limits(analysis, patch)
    features = _features(density, limits)
    found = []
    for direction, (low, *_, high) in enumerate(limits):
        if low == high:
            found.append(single(low))
            continue
        inner = [float(x) for x in whole[direction].limits if low < x < high]
        refined = [*limits[:direction], [low, *inner, high], *limits[direction + 1 :]]
        found.append(_panels(density, refined, direction, features))
    return found


def _integral(density: _Density, panels: list[Panels]) -> tuple[Array, float]:
    """Return an integral over the product of three rules, and its relative error.

    It is taken with the rules and with half as many nodes again; their difference is the error.
    """
    grow = 1.0
    while grow > 0.05 and _points(panels, 1.5 * grow) > MOST_POINTS:
        # what this costs in accuracy shows in the error estimate
        grow *= 0.8
    value = _total(density, [p.rule(grow) for p in panels])
    error = np.inf
    for _ in range(2):
        grow *= 1.5
        coarse, value = value, _total(density, [p.rule(grow) for p in panels])
        error = float(np.abs(value - coarse).max() / max(np.abs(value).max(), 1e-300))
        if error < DOUBTFUL or _points(panels, 1.5 * grow) > MOST_POINTS:
            break
    # two rules may agree to the last bit by chance
    return value, max(error, EXACT, *(p.unresolved for p in panels))


def _points(panels: list[Panels], grow: float) -> float:
    return float(np.prod([len(p.rule(grow)[0]) for p in panels], dtype=float))


def _total(density: _Density, rules: _Rules) -> Array:
    """Return the integral over the product of three rules, in slabs of bounded memory."""
    (u, wu), (v, wv), (w, ww) = rules
    step = max(1, SLAB_POINTS // (len(v) * len(w)))
    total: Array | float = 0.0
    for i in range(0, len(u), step):
        part = slice(i, i + step)
        values = np.moveaxis(density(*open_grid(u[part], v, w)).values, -1, 0)
        total = total + product(product(product(values, ww), wv), wu[part])
    return np.asarray(total)
