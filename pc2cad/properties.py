"""Volume, area and centroid of the solid, integrated from the equation itself.

Gauss-Legendre rules per smooth piece of each direction, with as many nodes as the integrand asks
for; the difference of two rules is the error estimate. det J is watched at every node.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pc2cad.analysis import Analysis
from pc2cad.errors import NotASolidError
from pc2cad.folding import Signs
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
EPSILON = float(np.finfo(float).eps)
#: a cell position per direction, None for the whole of it
_CellOfBox = Cell | tuple[None, None, None]
WHOLE_BOX = (None, None, None)
#: nodes and weights per direction
_Rules = list[tuple[Array, Array]]
_Density = Callable[[_Rules], tuple[Array, Array]]


class NotIntegrableError(NotASolidError):
    """The volume of the equation is not finite."""


@dataclass(frozen=True)
class Properties:
    """Integrals of the solid in model units, with an estimate of their relative error."""

    volume: float
    area: float
    centroid: tuple[float, float, float]
    #: area of each face, in the order of the boundary complex
    face_areas: tuple[float, ...]
    relative_error: float


def integrate(analysis: Analysis) -> Properties:
    """Return the integrals; raise FoldedMapError where a quadrature node shows a fold."""
    centre = _centre(analysis)
    signs = Signs(analysis.map)
    densities = _Densities(analysis, centre, signs)
    moments, error = _refine(densities.volume, analysis, WHOLE_BOX)
    signs.check()
    if not (np.isfinite(moments).all() and np.isfinite(error)):
        raise NotIntegrableError(
            "the equation or a derivative has no finite value inside the box: look for a division "
            "by zero or the root of a square; abs(x) says what sqrt(x^2) does not"
        )
    volume = float(moments[0])
    first = moments[1:] / volume + centre
    areas, errors = [], [error]
    for face in analysis.boundary.faces:
        area, face_error = _refine(densities.area_of(face.patch), analysis, face.patch)
        areas.append(float(area[0]))
        errors.append(face_error)
    return Properties(
        abs(volume), sum(areas), (float(first[0]), float(first[1]), float(first[2])),
        tuple(areas), max(errors),
    )  # fmt: skip


def _centre(analysis: Analysis) -> Array:
    """Return a point amid the solid: moments about it lose no digits far from the origin."""
    inside = open_grid([0.21, 0.74], [0.23, 0.71], [0.26, 0.77])
    return np.asarray(analysis.map.points(*inside).mean(axis=(0, 1, 2)))


@dataclass(frozen=True)
class _Densities:
    """The integrands, as functions of three rules.

    Each returns values (nu, nv, nw, k) and, (nu, nv, nw), the size of the terms that the first of
    them is a sum of: its rounding is relative to those.
    """

    analysis: Analysis
    centre: Array
    signs: Signs

    def volume(self, rules: _Rules) -> tuple[Array, Array]:
        """Return det J and (M - centre) det J; the sign of det J is noted on the way."""
        nodes = tuple(rule[0] for rule in rules)
        grid = open_grid(*nodes)
        points, *tangents = self.analysis.map.frame(*grid)
        determinant, size, _ = self.signs.note(tangents, grid)
        offset = points - self.centre
        values = np.concatenate((determinant[..., None], offset * determinant[..., None]), axis=-1)
        return values, size

    def area_of(self, patch: Cell) -> _Density:
        """Return the function that gives |M_s × M_t| on a patch."""
        s, t = directions_of(patch)

        def area(rules: _Rules) -> tuple[Array, Array]:
            grid = open_grid(*(rule[0] for rule in rules))
            along_s, along_t = self.analysis.map.tangents((s, t), *grid)
            normal = np.cross(along_s, along_t)
            values = np.sqrt((normal * normal).sum(axis=-1))
            return values[..., None], np.sqrt(
                (along_s * along_s).sum(axis=-1) * (along_t * along_t).sum(axis=-1)
            )

        return area


def _refine(density: _Density, analysis: Analysis, cell: _CellOfBox) -> tuple[Array, float]:
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


def _count(density: _Density, analysis: Analysis, cell: _CellOfBox, direction: int) -> int:
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
        values, terms = density(rules)
        shape = [1, 1, 1]
        shape[direction] = -1
        weights = rules[direction][1].reshape(shape)
        lines = (values * weights[..., None]).sum(axis=direction)
        if known is not None:
            sums = np.abs(values * weights[..., None]).sum(axis=direction)
            size = max(float(sums.max()), 1e-300)
            noise = 64 * EPSILON * float((terms * weights).sum(axis=direction).max())
            noise /= max(float(sums[..., 0].max()), 1e-300)
            change = float(np.abs(lines - known).max()) / size
            # the next change shrinks at least as much as this one did; rounding stops shrinking
            expected = change * (min(1.0, change / previous) if previous else 1.0)
            stands = change < 1e-10 and previous and change > previous / 4
            if expected <= max(CONVERGED, noise) or stands:
                return count
            previous = change
        if count * (len(limits) - 1) * 2 > MOST_NODES:
            return count
        known, count = lines, count * 2


def _total(density: _Density, rules: _Rules) -> Array:
    """Return the integral over the product of three rules, in slabs of bounded memory."""
    (u, wu), (v, wv), (w, ww) = rules
    step = max(1, SLAB_POINTS // (len(v) * len(w)))
    total: Array | float = 0.0
    for i in range(0, len(u), step):
        part = slice(i, i + step)
        values, _ = density([(u[part], wu[part]), (v, wv), (w, ww)])
        planes = (values * ww[:, None]).sum(axis=2)
        lines = (planes * wv[:, None]).sum(axis=1)
        total = total + (lines * wu[part, None]).sum(axis=0)
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
