"""The nearest places of a boundary, over all of it.

Each side that is a face is cut into cells on a grid of its parameters. A cell lies within its bow
of a parallelogram about its middle, so it is no nearer to a target than that parallelogram less
the bow. All cells that may be nearer than the nearest place found so far are looked at: they are
given to the caller as starts, the nearest first, and what may be left is stated. The bow of a cell
comes from nine places of it, so it is sampled, not proved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.topology.cells import normal_direction

#: cells of the whole boundary, about, and at most along one direction of a face
_CELLS, _LONGEST = 40_000, 4000
#: share by which a cell may leave its parallelogram by more than its nine places do
_MARGIN = 1.5
#: rounds of starts for one target, and pairs of a target and a cell that are worked on at once
_ROUNDS, _PAIRS = 8, 1_000_000

#: from targets (n, 3) and starts (n, 3) to local places (n, 3) and squares of distances (n,)
Descent = Callable[[Array, Array], tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class _Cells:
    """Cells of all faces: middles, half sides, and how far each may be off them."""

    #: (n, 3) in space
    middles: Array
    #: (n, 2, 3) in space, and (n, 2, 3) in the local parameters
    sides: Array
    steps: Array
    #: (n, 3) local parameters of the middles
    places: Array
    bows: Array
    #: of the largest sphere about a middle that a cell needs
    radius: float


class Boundary:
    """Cells of a solid's boundary, to find what is nearest of it."""

    def __init__(self, analysis: Analysis) -> None:
        self._analysis = analysis
        sides = {
            (normal_direction(side.patch), float(side.patch[normal_direction(side.patch)] > 0))
            for side in analysis.boundary.sides
            if side.fate == "face"
        }
        lengths = {side: self._lengths(*side) for side in sorted(sides)}
        area = sum(float(np.prod(pair)) for pair in lengths.values())
        step = max(float(np.sqrt(area / _CELLS)), 1e-300)
        parts = [self._face(*side, pair, step) for side, pair in lengths.items()]
        columns = [np.concatenate(rows) for rows in zip(*parts, strict=True)]
        middles, along, steps, places, bows = columns
        reach = np.sqrt((along**2).sum(axis=-1)).sum(axis=1) + bows
        self._cells = _Cells(middles, along, steps, places, bows, float(reach.max()))
        self._tree = cKDTree(middles)

    def _lengths(self, direction: int, limit: float) -> tuple[float, float]:
        """Return the lengths of a face along its two directions, the longest of a few lines."""
        found = []
        for d in (k for k in range(3) if k != direction):
            nodes = [np.array([0.0, 0.31, 0.62, 1.0])] * 3
            nodes[direction], nodes[d] = np.array([limit]), np.linspace(0, 1, 401)
            grid = np.moveaxis(self._analysis.map.points(*open_grid(*nodes)), d, 0)
            pieces = np.sqrt((np.diff(grid.reshape(401, -1, 3), axis=0) ** 2).sum(axis=-1))
            found.append(float(pieces.sum(axis=0).max()))
        return found[0], found[1]

    def _face(
        self, direction: int, limit: float, lengths: tuple[float, float], step: float
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Return middles, half sides in space and parameters, places and bows of a face's cells."""
        s, t = (k for k in range(3) if k != direction)
        nodes = [np.array([limit])] * 3
        for d, length in zip((s, t), lengths, strict=True):
            nodes[d] = self._nodes(d, int(np.clip(np.ceil(length / step), 6, _LONGEST)))
        grid = self._analysis.map.points(*open_grid(*nodes))
        points = np.moveaxis(grid, (s, t, direction), (0, 1, 2))[:, :, 0]
        middles = points[1::2, 1::2]
        a = (points[2::2, 1::2] - points[:-2:2, 1::2]) / 2
        b = (points[1::2, 2::2] - points[1::2, :-2:2]) / 2
        bows = np.zeros(middles.shape[:2])
        for i, j in np.ndindex(3, 3):
            there = points[i : i + 2 * len(a) : 2, j : j + 2 * a.shape[1] : 2]
            off = there - (middles + (i - 1) * a + (j - 1) * b)
            bows = np.maximum(bows, np.sqrt((off * off).sum(axis=-1)))
        steps = np.zeros((*middles.shape[:2], 2, 3))
        steps[..., 0, s] = ((nodes[s][2::2] - nodes[s][:-2:2]) / 2)[:, None]
        steps[..., 1, t] = ((nodes[t][2::2] - nodes[t][:-2:2]) / 2)[None, :]
        places = np.full((*middles.shape[:2], 3), limit)
        places[..., s], places[..., t] = nodes[s][1::2, None], nodes[t][None, 1::2]
        return (middles.reshape(-1, 3), np.stack((a, b), axis=-2).reshape(-1, 2, 3),
                steps.reshape(-1, 2, 3), places.reshape(-1, 3), _MARGIN * bows.ravel())  # fmt: skip

    def _nodes(self, direction: int, cells: int) -> Array:
        """Return the ends and middles of cells, none of them across a break."""
        inner = [b.position for b in self._analysis.breaks[direction] if 0 < b.position < 1]
        ends = distinct(np.concatenate((np.linspace(0, 1, cells + 1), inner)))
        nodes = np.empty(2 * len(ends) - 1)
        nodes[::2], nodes[1::2] = ends, (ends[1:] + ends[:-1]) / 2
        return nodes

    def improve(
        self, targets: Array, local: Array, squares: Array, descend: Descent, rounding: float
    ) -> tuple[Array, Array, Array]:
        """Return the nearest places, squares of distances, and by how much another may be nearer.

        Args:
            targets: (n, 3), outside the solid.
            local: the best places so far, (n, 3).
            squares: of their distances, (n,).
            descend: to a local minimum.
            rounding: distance that counts as none.

        """
        local, squares, gaps = local.copy(), squares.copy(), np.zeros(len(targets))
        # the middle of a cell is a place of the solid: none farther away is asked
        near, cell = self._tree.query(targets)
        better = near**2 < squares
        if better.any():
            found = descend(targets[better], self._cells.places[cell[better]])
            lower = found[1] < squares[better]
            index = np.flatnonzero(better)[lower]
            local[index], squares[index] = found[0][lower], found[1][lower]
        within = np.minimum(near, np.sqrt(squares)) + self._cells.radius
        counts = self._tree.query_ball_point(targets, within, return_length=True)
        start = 0
        while start < len(targets):
            total = np.cumsum(counts[start:])
            part = slice(start, start + max(1, int(np.searchsorted(total, _PAIRS))))
            local[part], squares[part], gaps[part] = self._among(
                targets[part], local[part], squares[part], within[part], descend, rounding
            )
            start = part.stop
        return local, squares, gaps

    def _among(
        self, targets: Array, local: Array, squares: Array, within: Array,
        descend: Descent, rounding: float,
    ) -> tuple[Array, Array, Array]:  # fmt: skip
        lists = self._tree.query_ball_point(targets, within)
        owner = np.repeat(np.arange(len(targets)), [len(row) for row in lists])
        cell = np.concatenate([np.asarray(row, dtype=int) for row in lists])
        shares, least = self._least(targets[owner], cell)
        floor = np.full(len(targets), np.inf)
        np.minimum.at(floor, owner, least)
        for _ in range(_ROUNDS):
            open_ = least < np.sqrt(squares)[owner] - rounding
            owner, cell, least, shares = owner[open_], cell[open_], least[open_], shares[open_]
            if not len(owner):
                break
            order = np.lexsort((least, owner))
            first = order[np.unique(owner[order], return_index=True)[1]]
            who, start = owner[first], self._start(cell[first], shares[first])
            found, square = descend(targets[who], start)
            lower = square < squares[who]
            local[who[lower]], squares[who[lower]] = found[lower], square[lower]
            # a start among the neighbours of this one would end there as well
            middles = self._cells.middles
            here = np.zeros((len(targets), 3))
            here[who] = middles[cell[first]]
            gap = middles[cell] - here[owner]
            far = (gap * gap).sum(axis=1) > (2 * self._cells.radius) ** 2
            owner, cell, least, shares = owner[far], cell[far], least[far], shares[far]
        return local, squares, np.maximum(np.sqrt(squares) - floor, 0.0)

    def _start(self, cell: Integers, shares: Array) -> Array:
        off = np.einsum("ni,nij->nj", shares, self._cells.steps[cell])
        return np.asarray(np.clip(self._cells.places[cell] + off, 0.0, 1.0))

    def _least(self, targets: Array, cell: Integers) -> tuple[Array, Array]:
        """Return the nearest shares (n, 2) of parallelograms, and the least distance of cells."""
        away = targets - self._cells.middles[cell]
        a, b = self._cells.sides[cell, 0], self._cells.sides[cell, 1]
        aa, bb, ab, ga, gb = ((x * y).sum(axis=1) for x, y in
                              ((a, a), (b, b), (a, b), (a, away), (b, away)))  # fmt: skip
        determinant = np.maximum(aa * bb - ab * ab, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            free = np.stack(((ga * bb - gb * ab), (gb * aa - ga * ab)), axis=1)
            free = free / determinant[:, None]
        inside = (np.abs(free) <= 1).all(axis=1) & (determinant > 1e-12 * aa * bb)
        best, least = np.zeros((len(cell), 2)), np.full(len(cell), np.inf)
        choices = [np.where(inside[:, None], free, 0.0)]
        small = 1e-300
        for side in (-1.0, 1.0):
            fixed = np.full(len(cell), side)
            choices.append(np.stack((fixed, np.clip((gb - side * ab) / (bb + small), -1, 1)), 1))
            choices.append(np.stack((np.clip((ga - side * ab) / (aa + small), -1, 1), fixed), 1))
        for shares in choices:
            off = away - shares[:, :1] * a - shares[:, 1:] * b
            square = (off * off).sum(axis=1)
            lower = square < least
            best[lower], least[lower] = shares[lower], square[lower]
        return best, np.maximum(np.sqrt(least) - self._cells.bows[cell], 0.0)
