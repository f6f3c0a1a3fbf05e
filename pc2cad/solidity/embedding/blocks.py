"""Pairs of patches that are not parted as blocks: a hierarchy of these, from whole sheets down.

Most of a spline of many patches is done with before any patch of it is made (`holds`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.boxes import meeting
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import lengths, unit
from pc2cad.geometry.sheets import Patches, projected
from pc2cad.solidity.embedding.above_planes import PlaneSides, sides_of_planes
from pc2cad.solidity.embedding.holds import hold, hold_in_pieces
from pc2cad.solidity.embedding.levels import is_graph
from pc2cad.solidity.embedding.separation import boxes
from pc2cad.solidity.embedding.surfaces import SAME_WEIGHT, Surfaces
from pc2cad.solidity.embedding.windows import Cones, cones_of, is_alone, is_wall, joint

#: sheets of no more patches are held by the control points of each from the first
FEW = 128


def near_pairs(
    surfaces: Surfaces, noise: float, every: bool = False, near: float = 0.0
) -> tuple[Integers, int]:
    """Return pairs of patches, each with itself too, that nothing parts as blocks.

    What is no farther apart than `near` is not parted.

    With them comes the number of blocks that were looked at. Sheets with no solid in common, one of
    them between two, are compared where `every` pair is asked for.
    """
    search = _Search(surfaces, noise, max(near, 2 * noise))
    # the largest blocks are whole sheets
    pairs = meeting(search.levels[-1].low, search.levels[-1].high, search.room)
    if not every:
        one, other = (surfaces.beside[pairs[:, k]] for k in (0, 1))
        pairs = pairs[(one[:, :, None] == other[:, None]).any(axis=(1, 2))]
    # what lies in one plane does not meet itself where its edges do not
    for row in (surfaces.plane, np.array([sheet.region for sheet in surfaces.sheets])):
        pairs = pairs[(row[pairs[:, 0]] < 0) | (row[pairs[:, 0]] != row[pairs[:, 1]])]
    graphs = np.array([_is_graph(sheet.patches, noise) for sheet in surfaces.sheets])
    pairs = pairs[(pairs[:, 0] != pairs[:, 1]) | ~graphs[pairs[:, 0]]]
    search.look_at_planes(pairs)
    count = len(surfaces.sheets)
    for depth in range(len(search.levels) - 1, -1, -1):
        if depth + 1 < len(search.levels):
            pairs = _children(search.levels[depth + 1], search.levels[depth], pairs)
            count += len(_among(len(search.levels[depth].sheet), pairs))
        pairs = search.left(depth, pairs)
    return pairs, count


def _is_graph(patches: Patches, noise: float) -> bool:
    """Say whether a spline without weights meets itself nowhere as a whole (see `levels`)."""
    if patches.knots is None or np.abs(patches.poles[..., 3] - 1).max() > SAME_WEIGHT:
        return False
    return is_graph(patches.poles[..., :3], patches.index, noise)


@dataclass(frozen=True, eq=False)
class _Level:
    """Blocks of all sheets, row by row: what holds them and their tangents along s and t."""

    #: limits in thirteen directions (B, 13)
    low: Array
    high: Array
    cones: tuple[Cones, Cones]
    #: rows and columns of blocks of each sheet
    shapes: Integers
    #: smaller blocks by those that they are parts of, and the first of each one's
    parts: tuple[Integers, Integers] | None = None

    @cached_property
    def start(self) -> Integers:
        """First block of each sheet."""
        sizes = self.shapes.prod(axis=1)
        return np.asarray(np.cumsum(sizes) - sizes)

    @cached_property
    def sheet(self) -> Integers:
        """The sheet of each block."""
        return np.repeat(np.arange(len(self.shapes)), self.shapes.prod(axis=1))

    @cached_property
    def place(self) -> Integers:
        """Row and column of each block in its sheet."""
        index = np.arange(len(self.sheet)) - self.start[self.sheet]
        return np.stack(np.divmod(index, self.shapes[self.sheet, 1]), axis=1)

    @cached_property
    def narrow(self) -> Booleans:
        """Of which blocks the tangents turn so little that rectangles of some may be parted.

        Both half angles together are less than a right angle.
        """
        s, t = (cones.slopes[0] for cones in self.cones)
        return np.asarray(s * s + t * t < 1)

    def tangents(self, corners: Integers) -> tuple[Cones, Cones]:
        """Return cones of the tangents along s and t in rectangles of some corners (k, n)."""
        s, t = (joint([cones[rows] for rows in corners.T]) for cones in self.cones)
        return s, t

    def coarser(self) -> _Level:
        """Return blocks of two by two."""
        shapes, order, first = _parents(self.shapes, self.sheet, self.place)
        low, high = self.low[order], self.high[order]
        s, t = (_merged(cones, order, first) for cones in self.cones)
        return _Level(np.minimum.reduceat(low, first), np.maximum.reduceat(high, first), (s, t),
                      shapes, (order, first))  # fmt: skip


def _parents(
    shapes: Integers, sheet: Integers, place: Integers
) -> tuple[Integers, Integers, Integers]:
    """Return the shapes of blocks of two by two; blocks by their parents, each one's first."""
    coarser = (shapes + 1) // 2
    sizes = coarser.prod(axis=1)
    start = np.cumsum(sizes) - sizes
    parent = start[sheet] + place[:, 0] // 2 * coarser[sheet, 1] + place[:, 1] // 2
    order = np.argsort(parent, kind="stable")
    return coarser, order, np.searchsorted(parent[order], np.arange(sizes.sum()))


def _merged(cones: Cones, order: Integers, first: Integers) -> Cones:
    axes, radii = cones.axes[order], cones.radii[order]
    mean = unit(np.add.reduceat(axes, first))
    own = np.repeat(mean, np.diff(np.append(first, len(order))), axis=0)
    return Cones(mean, np.maximum.reduceat(lengths(axes - own) + radii, first))


def _children(coarse: _Level, fine: _Level, pairs: Integers) -> Integers:
    options = []
    for side in (0, 1):
        row = pairs[:, side]
        own = coarse.sheet[row]
        i, j = coarse.place[row].T
        found = []
        for di in (0, 1):
            for dj in (0, 1):
                x, y = 2 * i + di, 2 * j + dj
                inside = (x < fine.shapes[own, 0]) & (y < fine.shapes[own, 1])
                found.append(np.where(inside, fine.start[own] + x * fine.shapes[own, 1] + y, -1))
        options.append(found)
    alone = pairs[:, 0] == pairs[:, 1]
    blocks = []
    for p, first in enumerate(options[0]):
        for q, second in enumerate(options[1]):
            chosen = (first >= 0) & (second >= 0) & (~alone | (p <= q))
            blocks.append(np.stack((first[chosen], second[chosen]), axis=1))
    return np.concatenate(blocks)


def _among(count: int, *numbers: Integers) -> Integers:
    """Return which of so many numbers there are, ascending."""
    there = np.zeros(count, dtype=bool)
    for row in numbers:
        there[row] = True
    return np.flatnonzero(there)


@dataclass(eq=False)
class _Search:
    surfaces: Surfaces
    noise: float
    #: what is no farther apart is not parted
    room: float
    _across: dict[tuple[int, int], list[Cones]] = field(default_factory=dict)
    _planes: list[PlaneSides] = field(default_factory=list)

    @cached_property
    def levels(self) -> list[_Level]:
        """Patches, and ever larger blocks of them."""
        found = [self._first()]
        while found[-1].shapes.max() > 1:
            found.append(found[-1].coarser())
        return found

    @cached_property
    def _large(self) -> Booleans:
        """Which sheets are held by their corners: splines of many patches."""
        plain = [
            sheet.patches.knots is not None
            and bool(np.ptp(sheet.patches.poles[..., 3]) <= SAME_WEIGHT)
            for sheet in self.surfaces.sheets
        ]
        return np.asarray((self.surfaces.shapes.prod(axis=1) > FEW) & np.array(plain))

    def _first(self) -> _Level:
        surfaces = self.surfaces
        count = len(surfaces.sheet_of)
        level = _Level(
            np.empty((count, 13)), np.empty((count, 13)),
            (Cones(np.empty((count, 3)), np.empty(count)),
             Cones(np.empty((count, 3)), np.empty(count))), surfaces.shapes,
        )  # fmt: skip
        self._refine(level, np.flatnonzero(~self._large[surfaces.sheet_of]))
        for index in np.flatnonzero(self._large).tolist():
            part = slice(surfaces.start[index], surfaces.start[index] + level.shapes[index].prod())
            patches = surfaces.sheets[index].patches
            held = hold_in_pieces(patches, projected(patches.poles))
            level.low[part], level.high[part] = held.limits()
            for axis, cones in enumerate(level.cones):
                found = held.tangents(axis, self.noise)
                cones.axes[part], cones.radii[part] = found.axes, found.radii
        return level

    def _refine(self, level: _Level, patches: Integers) -> None:
        """Hold some patches by their own control points."""
        if len(patches) == 0:
            return
        points = projected(self.surfaces.nets(patches))
        flat = points.reshape(len(patches), -1, 3)
        level.low[patches], level.high[patches] = boxes(flat)
        for axis, cones in enumerate(level.cones):
            steps = np.diff(points, axis=1 + axis).reshape(len(patches), -1, 3)
            found = cones_of(steps, self.noise)
            cones.axes[patches], cones.radii[patches] = found.axes, found.radii

    def look_at_planes(self, pairs: Integers) -> None:
        """Find out on which sides of the planes blocks are of sheets, which are in pairs."""
        found = sides_of_planes(self.surfaces, pairs, self.room)
        for level in self.levels:
            if level.parts is not None:
                found = found.merged(*level.parts)
            self._planes.append(found)

    def left(self, depth: int, pairs: Integers) -> Integers:
        """Return the pairs of blocks that are not parted."""
        level = self.levels[depth]
        if depth + 1 < len(self.levels):
            pairs = pairs[self._meet(level, pairs)]
        pairs = pairs[~self._planes[depth].part(pairs, level.sheet)]
        pairs, corners = self._left_beside(depth, pairs)
        if depth == 0:
            # the others are held by their own control points
            looked = _among(len(level.sheet), pairs, *corners)
            self._refine(level, looked[self._large[level.sheet[looked]]])
            pairs, _ = self._left_beside(depth, pairs[self._meet(level, pairs)])
        return pairs

    def _left_beside(self, depth: int, pairs: Integers) -> tuple[Integers, list[Integers]]:
        """Return the pairs that are not parted as rectangles, and the corners of theirs."""
        rows, *corners = self._rectangles(self.levels[depth], pairs)
        parted = self._parted(depth, *corners)
        left = np.ones(len(pairs), dtype=bool)
        left[rows[parted]] = False
        return pairs[left], [corner[~parted] for corner in corners]

    def _meet(self, level: _Level, pairs: Integers) -> Booleans:
        low, high = (np.ascontiguousarray(x.T) for x in (level.low, level.high + self.room))
        a, b = np.ascontiguousarray(pairs.T)
        left = np.arange(len(pairs))
        # each direction parts many
        for lower, upper in zip(low, high, strict=True):
            keep = np.flatnonzero((lower[a] <= upper[b]) & (lower[b] <= upper[a]))
            a, b, left = a[keep], b[keep], left[keep]
        meet = np.zeros(len(pairs), dtype=bool)
        meet[left] = True
        return meet

    def _rectangles(self, level: _Level, pairs: Integers) -> tuple[Integers, Integers, Integers]:
        """Return pairs of blocks side by side on one grid.

        With them come the corners of the rectangle round both (k, 4), on both sheets.
        """
        surfaces = self.surfaces
        a, b = pairs[:, 0], pairs[:, 1]
        one, other = level.sheet[a], level.sheet[b]
        size = level.shapes[one]
        near = (size == level.shapes[other]).all(axis=1)
        step = level.place[b] - level.place[a]
        round_ = surfaces.closed[one] & surfaces.closed[other]
        step = np.where(round_, (step + size // 2) % size - size // 2, step)
        near &= (np.abs(step) <= 1).all(axis=1)
        near &= surfaces.separable[one] & (surfaces.plane[one] < 0)
        near &= level.narrow[a] & level.narrow[b]
        two = near & (one != other)
        near[two] = surfaces.walls(one[two], other[two])
        rows = np.flatnonzero(near)
        here, step, size = level.place[a[rows]], step[rows], size[rows]
        shifts = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
        corner = (here[:, None] + shifts * step[:, None]) % size[:, None]
        index = corner[..., 0] * size[:, None, 1] + corner[..., 1]
        first, second = (level.start[sheet[rows], None] + index for sheet in (one, other))
        return rows, first, second

    def _parted(self, depth: int, first: Integers, second: Integers) -> Booleans:
        """Say in which rectangles sheets do not meet themselves or one another."""
        level = self.levels[depth]
        one, other = level.sheet[first[:, 0]], level.sheet[second[:, 0]]
        result = np.zeros(len(one), dtype=bool)
        alone = np.flatnonzero(one == other)
        if len(alone):
            result[alone] = is_alone(*level.tangents(first[alone]))
        walls = np.flatnonzero(one != other)
        if len(walls) == 0:
            return result
        s, t = level.tangents(np.concatenate((first[walls], second[walls]), axis=1))
        # no ways across part what has tangents all round
        narrow = np.flatnonzero(s.slopes[0] ** 2 + t.slopes[0] ** 2 < 1)
        walls, s, t = walls[narrow], s[narrow], t[narrow]
        keys = one[walls] * len(self.surfaces.sheets) + other[walls]
        for key in distinct(keys):
            i, j = divmod(int(key), len(self.surfaces.sheets))
            rows = np.flatnonzero(keys == key)
            ways = self._ways(i, j)
            across = ways[min(depth, len(ways) - 1)]
            own = first[walls[rows]] - level.start[i]
            found = is_wall(s[rows], t[rows], joint([across[k] for k in own.T]))
            result[walls[rows]] = found
        return result

    def _ways(self, i: int, j: int) -> list[Cones]:
        """Return cones of the ways from one sheet to another, of patches and of larger blocks."""
        if (i, j) not in self._across:
            surfaces = self.surfaces
            shapes = surfaces.shapes[[i]]
            count = int(shapes.prod())
            if self._large[i]:
                first, second = (surfaces.sheets[k].patches for k in (i, j))
                gap = projected(second.poles) - projected(first.poles)
                found = [hold(first, gap).ways(self.noise)]
            else:
                nets = [projected(surfaces.nets(surfaces.start[k] + np.arange(count)))
                        for k in (i, j)]  # fmt: skip
                found = [cones_of((nets[1] - nets[0]).reshape(count, -1, 3), self.noise)]
            while shapes.max() > 1:
                place = np.indices(shapes[0]).reshape(2, -1).T
                shapes, order, rows = _parents(shapes, np.zeros(len(place), dtype=int), place)
                found.append(_merged(found[-1], order, rows))
            self._across[i, j] = found
        return self._across[i, j]
