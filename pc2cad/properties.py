"""Volume, area and centroid of the solid, integrated from the equation itself.

Gauss-Legendre rules per smooth piece of each direction, refined direction by direction until the
integrals stand still; the last change is the error estimate. The same sweep sees det J inside the
box and refuses a map that turns over or is flat (spec 4.1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pc2cad.analysis import Analysis
from pc2cad.equation.point_equation import PARAMETERS
from pc2cad.errors import NotASolidError
from pc2cad.mapping import open_grid
from pc2cad.topology.cells import Cell, directions_of

Array = NDArray[np.float64]

#: relative change of an integral at which refinement ends
CONVERGED = 1e-13
#: nodes of one direction at which it gives up
MOST_NODES = 3000
#: points of one integral
MOST_POINTS = 3e7
#: points evaluated at once
SLAB_POINTS = 300_000
#: a cell position per direction, None for the whole of it
_CellOfBox = Cell | tuple[None, None, None]
WHOLE_BOX = (None, None, None)
#: det J is compared with |M_u||M_v||M_w|: below this it is rounding
DETERMINANT_ROUNDING = 1e-11


class FlatMapError(NotASolidError):
    """det J vanishes everywhere: the image has no volume."""


class FoldedMapError(NotASolidError):
    """det J changes its sign inside the box: the map folds the solid over itself."""


@dataclass(frozen=True)
class Properties:
    """Integrals of the solid in model units, with an estimate of their relative error."""

    volume: float
    area: float
    centroid: tuple[float, float, float]
    #: area of each face, in the order of the boundary complex
    face_areas: tuple[float, ...]
    relative_error: float
    #: +1 where (u, v, w) is right-handed in the solid, -1 where it is left-handed
    orientation: int


def integrate(analysis: Analysis) -> Properties:
    """Return the integrals; raise FlatMapError or FoldedMapError where there is no solid."""
    centre = _centre(analysis)
    signs = _Signs()
    densities = _Densities(analysis, centre, signs)
    densities.volume([_rule(analysis, d, None, 7) for d in range(3)])
    signs.check(analysis)
    moments, error = _refine(densities.volume, analysis, WHOLE_BOX)
    signs.check(analysis)
    volume = float(moments[0])
    first = moments[1:] / volume + centre
    areas, errors = [], [error]
    for face in analysis.boundary.faces:
        area, face_error = _refine(densities.area_of(face.patch), analysis, face.patch)
        areas.append(float(area[0]))
        errors.append(face_error)
    return Properties(
        abs(volume), sum(areas), (float(first[0]), float(first[1]), float(first[2])),
        tuple(areas), max(errors), 1 if volume > 0 else -1,
    )  # fmt: skip


def _centre(analysis: Analysis) -> Array:
    """Return a point amid the solid: moments about it lose no digits far from the origin."""
    inside = open_grid([0.21, 0.74], [0.23, 0.71], [0.26, 0.77])
    return np.asarray(analysis.map.points(*inside).mean(axis=(0, 1, 2)))


@dataclass(frozen=True)
class _Densities:
    """The integrands, as functions of three rules; values have shape (nu, nv, nw, k)."""

    analysis: Analysis
    centre: Array
    signs: _Signs

    def volume(self, rules: _Rules) -> Array:
        """Return det J and (M - centre) det J; the sign of det J is noted on the way."""
        nodes = tuple(rule[0] for rule in rules)
        grid = open_grid(*nodes)
        points, *tangents = self.analysis.map.frame(*grid)
        determinant = np.einsum("...i,...i->...", tangents[0], np.cross(tangents[1], tangents[2]))
        product = np.sqrt(np.prod([np.einsum("...i,...i->...", m, m) for m in tangents], axis=0))
        self.signs.see(determinant, product, nodes)
        offset = points - self.centre
        return np.concatenate((determinant[..., None], offset * determinant[..., None]), axis=-1)

    def area_of(self, patch: Cell) -> Callable[[_Rules], Array]:
        """Return the function that gives |M_s × M_t| on a patch."""
        s, t = directions_of(patch)

        def area(rules: _Rules) -> Array:
            grid = open_grid(*(rule[0] for rule in rules))
            along_s, along_t = self.analysis.map.tangents((s, t), *grid)
            normal = np.cross(along_s, along_t)
            return np.asarray(np.sqrt((normal * normal).sum(axis=-1))[..., None])

        return area


class _Signs:
    """Collects the sign of det J over all nodes of a sweep."""

    def __init__(self) -> None:
        self.positive = self.negative = 0.0
        self.places: dict[int, tuple[float, ...]] = {}

    def see(self, determinant: Array, product: Array, nodes: tuple[Array, ...]) -> None:
        with np.errstate(invalid="ignore", divide="ignore"):
            sine = np.where(product > 0, determinant / product, 0.0)
        if not np.isfinite(determinant).all():
            index = tuple(np.argwhere(~np.isfinite(determinant))[0])
            place = tuple(float(x[i]) for x, i in zip(nodes, index, strict=True))
            raise FoldedMapError(
                f"the equation or a derivative has no finite value at {_place(place)}"
            )
        for sign, extreme in ((1, sine.max()), (-1, -sine.min())):
            known = self.positive if sign > 0 else self.negative
            if extreme > known:
                index = np.unravel_index(np.argmax(sign * sine), sine.shape)
                self.places[sign] = tuple(float(x[i]) for x, i in zip(nodes, index, strict=True))
                if sign > 0:
                    self.positive = float(extreme)
                else:
                    self.negative = float(extreme)

    def check(self, analysis: Analysis) -> None:
        if max(self.positive, self.negative) <= DETERMINANT_ROUNDING:
            raise FlatMapError(
                "det J is zero everywhere: the image is flat and has no volume (for a simplex: "
                "the points lie in one plane, or two of them coincide; for a truncated body: "
                "nothing is left between its ends)"
            )
        if min(self.positive, self.negative) > DETERMINANT_ROUNDING:
            minor = 1 if self.positive < self.negative else -1
            where = [
                analysis.equation.limits[d][0]
                + x * (analysis.equation.limits[d][1] - analysis.equation.limits[d][0])
                for d, x in enumerate(self.places[minor])
            ]
            point = analysis.map.points(*self.places[minor])
            raise FoldedMapError(
                f"det J changes its sign: the map folds the solid over itself near "
                f"{_place(tuple(where))}, at ({', '.join(f'{x:.6g}' for x in point)}); a thinner "
                "wall, a smaller section or a shorter domain may be valid"
            )


def _place(values: tuple[float, ...]) -> str:
    return ", ".join(f"{n} = {x:.4g}" for n, x in zip(PARAMETERS, values, strict=True))


_Rules = list[tuple[Array, Array]]


def _refine(
    density: Callable[[_Rules], Array], analysis: Analysis, cell: _CellOfBox
) -> tuple[Array, float]:
    """Integrate a density (values, …) over a cell; return the integral and its relative error.

    The number of nodes per direction comes from line integrals through a few places of the other
    directions; the whole integral is then taken twice, with those and with half as many again.
    """
    counts = [_count(density, analysis, cell, d) for d in range(3)]
    while np.prod(counts, dtype=float) > MOST_POINTS:
        # what this costs in accuracy shows in the error estimate
        counts = [max(1, round(0.8 * count)) for count in counts]
    coarse, fine = (
        _total(density, [_rule(analysis, d, cell[d], round(grow * counts[d])) for d in range(3)])
        for grow in (1.0, 1.5)
    )
    return fine, float(np.abs(fine - coarse).max() / max(np.abs(fine).max(), 1e-300))


def _count(
    density: Callable[[_Rules], Array],
    analysis: Analysis,
    cell: _CellOfBox,
    direction: int,
) -> int:
    """Return how many Gauss nodes per smooth piece resolve the density along one direction."""
    limits = _limits(analysis, direction, cell[direction])
    if limits[0] == limits[-1]:
        return 1
    rules: _Rules = []
    for d in range(3):
        nodes, weights = _rule(analysis, d, cell[d], 3)
        rules.append((nodes, np.ones_like(weights)))
    known: Array | None = None
    previous = 0.0
    count = 4
    while True:
        rules[direction] = _rule(analysis, direction, cell[direction], count)
        values = density(rules)
        shape = [1, 1, 1, 1]
        shape[direction] = -1
        weighted = values * rules[direction][1].reshape(shape)
        lines = weighted.sum(axis=direction)
        if known is not None:
            size = max(float(np.abs(weighted).sum(axis=direction).max()), 1e-300)
            change = float(np.abs(lines - known).max()) / size
            # the next change shrinks at least as much as this one did; rounding stops shrinking
            expected = change * (min(1.0, change / previous) if previous else 1.0)
            if expected <= CONVERGED or (change < 1e-10 and previous and change > previous / 4):
                return count
            previous = change
        if count * (len(limits) - 1) * 2 > MOST_NODES:
            return count
        known, count = lines, count * 2


def _total(density: Callable[[_Rules], Array], rules: _Rules) -> Array:
    """Return the integral over the product of three rules, in slabs of bounded memory."""
    (u, wu), (v, wv), (w, ww) = rules
    step = max(1, SLAB_POINTS // (len(v) * len(w)))
    total: Array | float = 0.0
    for i in range(0, len(u), step):
        part = slice(i, i + step)
        values = density([(u[part], wu[part]), (v, wv), (w, ww)])
        total = total + np.einsum("a,b,c,abci->i", wu[part], wv, ww, values, optimize=True)
    return np.asarray(total)


def _limits(analysis: Analysis, direction: int, position: int | None) -> list[float]:
    """Return the limits of the smooth pieces in a cell position (None: the whole direction)."""
    low, high = (0.0, 1.0) if position is None else analysis.span(direction, position)
    inner = [b.position for b in analysis.breaks[direction] if low < b.position < high]
    return [low, *inner, high]


def _rule(
    analysis: Analysis, direction: int, position: int | None, count: int
) -> tuple[Array, Array]:
    """Return nodes and weights: Gauss per smooth piece, or a single limit with weight 1."""
    limits = _limits(analysis, direction, position)
    if limits[0] == limits[-1]:
        return np.array(limits[:1]), np.ones(1)
    # many nodes are spread over panels: high Gauss orders are slow to make and gain nothing
    panels = max(1, count // 24)
    spans = np.concatenate(
        [np.linspace(a, b, panels + 1)[:-1] for a, b in pairwise(limits)] + [limits[-1:]]
    )
    x, weight = _gauss(-(-count // panels))
    half = np.diff(spans)[:, None] / 2
    nodes = (spans[:-1, None] + spans[1:, None]) / 2 + half * x
    return nodes.ravel(), (half * weight).ravel()


@lru_cache(maxsize=64)
def _gauss(count: int) -> tuple[Array, Array]:
    x, weight = np.polynomial.legendre.leggauss(count)
    x.flags.writeable = weight.flags.writeable = False
    return x, weight
