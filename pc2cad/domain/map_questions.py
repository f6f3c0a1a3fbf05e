"""Answers about the map: from samples of the sides first, then from the trees.

A sample refutes at once; what the samples leave standing is proved from the trees where that is
possible, and stays undecided where it is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.boxes import Near
from pc2cad.domain.map import Mapping3, open_grid
from pc2cad.domain.pieces import having_a_value, piece_at, span_at
from pc2cad.errors import NotASolidError
from pc2cad.expression.identity import Verdict
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.plain_constants import are_identical
from pc2cad.expression.polynomials import polynomials
from pc2cad.expression.tree import Expr, number, substitute, symbol
from pc2cad.geometry.scale import Scale
from pc2cad.topology.cells import Cell, Labels, Symmetry, cell_name, directions_of

#: symmetric under reversal, with the ends, and at no simple fraction of the period of anything
NODES = np.concatenate(([0.0], (np.polynomial.legendre.leggauss(11)[0] + 1) / 2, [1.0]))
NODES = (NODES + 1 - NODES[::-1]) / 2
#: pieces of a direction whose samples are taken together
_TOGETHER = 16


class MapNotFiniteError(NotASolidError):
    """The point equation has no finite value somewhere in its box."""


class TooCloseToDecideError(NotASolidError):
    """Two places are neither clearly one nor clearly two."""


class MapQuestions:
    """Answers the topology room's questions from samples of the sides and from the trees."""

    def __init__(
        self, mapping: Mapping3, bounds: tuple[tuple[float, ...], ...], labels: Labels
    ) -> None:
        self.labels = labels
        self._map = mapping
        self._bounds = bounds
        self._samples: dict[Cell, Array] = {}
        sides = self._side_samples()
        extent = sides.max(axis=0) - sides.min(axis=0)
        self.scale = Scale(float(np.linalg.norm(extent)), float(np.abs(sides).max()))
        self._one = self.scale.same_point

    def _side_samples(self) -> Array:
        """Return samples of all six sides, (n, 3), after a check that every one is finite."""
        cells = list[Cell]()
        single = self._map.is_alike_together and all([len(row) == 2 for row in self._bounds])
        if single:  # one call takes less than three, though the inside is met as well
            points, keep = self._map.points(*open_grid(NODES, NODES, NODES)), (0, slice(None), -1)
            for i, j, k in product(range(3), repeat=3):
                self._samples[i, j, k] = points[keep[i], keep[j], keep[k]]
        for d in range(3):
            ranges: list[Sequence[int]] = [range(1, 2 * len(b) - 1, 2) for b in self._bounds]
            limits = ranges[d] = 0, 2 * (len(self._bounds[d]) - 1)
            if not single:
                self._look(ranges)
            for limit in limits:
                ranges[d] = (limit,)
                cells += product(ranges[0], ranges[1], ranges[2])
        samples = np.concatenate([self._at(cell).reshape(-1, 3) for cell in cells])
        if not np.isfinite(samples).all():
            for cell in cells:
                self._check_finite(cell, self._at(cell))
        return samples

    def _look(self, ranges: Sequence[Sequence[int]]) -> None:
        """Evaluate the patches of two sides, some of them together."""
        step = _TOGETHER if self._map.is_alike_together else 1
        parts = [[row[k : k + step] for k in range(0, len(row), step)] for row in ranges]
        for block in product(*parts):
            places = [[self._positions(d, p) for p in row] for d, row in enumerate(block)]
            points = self._map.points(*open_grid(*(np.concatenate(row) for row in places)))
            within = [
                [slice(k * len(own), (k + 1) * len(own)) if p % 2 else k for k, p in enumerate(row)]
                for row, (own, *_) in zip(block, places, strict=True)
            ]
            for (i, j, k), keep in zip(product(*block), product(*within), strict=True):
                self._samples[i, j, k] = points[keep]

    def _at(self, cell: Cell) -> Array:
        """Return samples of a cell: one axis of nodes per direction in which it extends."""
        if cell not in self._samples:
            points = self._limit_of_known(cell)
            if points is None:
                grid = open_grid(*(self._positions(d, cell[d]) for d in range(3)))
                keep = tuple(slice(None) if cell[d] % 2 else 0 for d in range(3))
                points = self._map.points(*grid)[keep]
            self._samples[cell] = points
        return self._samples[cell]

    def _limit_of_known(self, cell: Cell) -> Array | None:
        """Return samples of an edge from those of a known patch, of a corner from an edge's."""
        fixed = [d for d in range(3) if cell[d] % 2 == 0]
        for d in fixed if len(fixed) > 1 else ():
            for step, end in ((1, 0), (-1, -1)):
                i, j, k = (p + step if axis == d else p for axis, p in enumerate(cell))
                wider = i, j, k
                inside = 0 < wider[d] < 2 * len(self._bounds[d]) - 2
                if inside and (len(fixed) == 3 or wider in self._samples):
                    return self._at(wider)[(slice(None),) * directions_of(wider).index(d) + (end,)]
        return None

    def _positions(self, direction: int, position: int) -> Array:
        low, high = span_at(self._bounds[direction], position)
        return low + (high - low) * NODES if position % 2 else np.array([low])

    def _check_finite(self, cell: Cell, points: Array) -> None:
        bad = np.argwhere(~np.isfinite(points).all(axis=-1))
        if len(bad) == 0:
            return
        places = zip(directions_of(cell), bad[0], strict=True)
        where = [(PARAMETERS[d], float(self._positions(d, cell[d])[k])) for d, k in places]
        shown = ", ".join(f"{name} = {value:.3g}" for name, value in where)
        raise MapNotFiniteError(
            f"M has no finite value on the side {cell_name(cell, self.labels)}, first at local "
            f"{shown}: a division by zero, a root or logarithm of a negative number, or a normal "
            "that is undefined there; another reference point or a shorter domain may help"
        )

    def _equal(self, first: Array, second: Array, what: str, *cells: Cell) -> bool:
        # one sample refutes most; what is asked about is only named where it is undecided
        last = (-1,) * (first.ndim - 1)
        if max(map(abs, (first[last] - second[last]).tolist())) >= 1000 * self._one:
            return False
        away = (first - second) ** 2
        gap = float(np.sqrt((away[..., 0] + away[..., 1] + away[..., 2]).max()))
        if gap <= self._one:
            return True
        if gap < 1000 * self._one:
            named = what.format(*(cell_name(cell, self.labels) for cell in cells))
            raise TooCloseToDecideError(
                f"{named} are {gap:.3g} apart on a part of size {self.scale.size:.3g}: too far for "
                "one place and too near for two in double precision; separate or join them"
            )
        return False

    def ignores(self, patch: Cell, direction: int) -> Verdict:
        """See Questions.ignores."""
        points = self._at(patch)
        axis = directions_of(patch).index(direction)
        what = f"the two ends of {PARAMETERS[direction]} on {{}}"
        if not self._equal(points, points[:, :1] if axis else points[:1], what, patch):
            return Verdict.REFUTED
        name, known = PARAMETERS[direction], polynomials(self._map.coordinates)
        if known is not None and all(len(row) == 2 for row in self._bounds):
            return Verdict.UNDECIDED if any(p[axis] for p in known.on(patch)) else Verdict.PROVED
        trees = self._restrict(patch)
        if all(name not in tree.symbols for tree in trees):
            return Verdict.PROVED
        return _prove(trees, substitute(trees, {name: number(0)}))

    def coincide(self, first: Cell, second: Cell, symmetry: Symmetry) -> Verdict:
        """See Questions.coincide."""
        image = symmetry.read(self._at(second))
        if not self._equal(self._at(first), image, "the sides {} and {}", first, second):
            return Verdict.REFUTED
        # in the first one's own parameters, most of its trees are as they are
        own = [symbol(PARAMETERS[d]) for d in directions_of(first)]
        s, t = reversed(own) if symmetry.swap else own
        there = 1 - s if symmetry.reverse_s else s, 1 - t if symmetry.reverse_t else t
        return _prove(self._restrict(first), self._restrict(second, there))

    def is_point(self, edge: Cell) -> bool:
        """See Questions.is_point."""
        return self._equal(self._at(edge), self._at(edge)[:1], "the points of the edge {}", edge)

    def same_edge(self, first: Cell, second: Cell, reverse: bool) -> bool:
        """See Questions.same_edge."""
        there = self._at(second)[:: -1 if reverse else 1]
        return self._equal(self._at(first), there, "the edges {} and {}", first, second)

    def places(self, corners: Sequence[Cell]) -> list[list[Cell]]:
        """See Questions.places."""
        points = np.array([self._at(corner) for corner in corners]).reshape(-1, 3)
        near, first, groups = Near(1000 * self._one), list[Array](), list[list[Cell]]()
        for corner, point in zip(corners, points, strict=True):
            for k in near.of(point.tolist()):
                of = groups[k][0]
                if self._equal(first[k][None], point[None], "the corners {} and {}", of, corner):
                    groups[k].append(corner)
                    break
            else:
                near.add(point.tolist())
                first.append(point)
                groups.append([corner])
        return groups

    def _restrict(self, patch: Cell, local: tuple[Expr, ...] | None = None) -> tuple[Expr, ...]:
        """Return the trees on a patch in its own [0,1]² (`local`: what to put for s and t)."""
        spans, values = piece_at(patch, self._bounds)
        names = [PARAMETERS[d] for d in directions_of(patch)]
        values |= zip(names, local or map(symbol, names), strict=True)
        with having_a_value(patch, self.labels):
            return substitute(self._map.pieces.trees(spans)[0], values)


def _prove(first: tuple[Expr, ...], second: tuple[Expr, ...]) -> Verdict:
    return Verdict.PROVED if are_identical(first, second) else Verdict.UNDECIDED
