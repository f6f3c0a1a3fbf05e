"""Pairs of patches that are not parted as blocks: a hierarchy of these, from whole sheets down.

Most of a spline of many patches is done with before any patch of it is made (`held_patches`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pc2cad.arrays import Booleans, Integers
from pc2cad.arrays.boxes import meeting
from pc2cad.geometry.sheets import Patches
from pc2cad.solidity.embedding.above_planes import PlaneSides, sides_of_planes
from pc2cad.solidity.embedding.held_patches import HeldPatches
from pc2cad.solidity.embedding.hierarchy import Level
from pc2cad.solidity.embedding.levels import is_graph
from pc2cad.solidity.embedding.surfaces import SAME_WEIGHT, Surfaces
from pc2cad.solidity.embedding.windows import (
    Cones,
    are_ahead,
    is_alone,
    is_wall,
)

#: blocks of so many are few enough to be compared each with each
FEW_BLOCKS = 640
#: blocks on one line that are at most so many steps apart are looked at in one rectangle
_ON_LINE = 3
#: of two sheets: one alone, and none that are a wall
ALONE, NO_WALL = -1, -2


def near_pairs(
    surfaces: Surfaces, noise: float, every: bool = False, near: float = 0.0
) -> tuple[Integers, int, float]:
    """Return pairs of patches, each with itself too, that nothing parts as blocks.

    What is no farther apart than `near` is not parted, but for the two sides of a wall. With them
    come the number of blocks that were looked at and how thin walls may be between those that were
    parted. Sheets with no solid in common, one of them between two, are compared where
    `every` pair is asked for.
    """
    search = _Search(surfaces, noise, max(near, 2 * noise), every)
    pairs, count = search.coarsest(), len(surfaces.sheets)
    for depth in range(len(search.levels) - 1, -1, -1):
        level = search.levels[depth]
        further = depth + 1 < len(search.levels)
        if further:
            pairs = _children(search.levels[depth + 1].children, pairs)
        if len(level.low) > len(surfaces.sheets):
            count += int(np.count_nonzero(np.bincount(pairs.ravel())))
        if further:
            pairs = pairs[search.meet(level, pairs)]
        pairs = pairs[~search.planes[depth].part(pairs, level.sheet)]
        pairs = search.left(level, pairs)
    return pairs, count, search.thinnest


def _is_graph(patches: Patches, noise: float) -> bool:
    """Say whether a spline without weights meets itself nowhere as a whole (see `levels`)."""
    if patches.knots is None or np.abs(patches.poles[..., 3] - 1).max() > SAME_WEIGHT:
        return False
    return is_graph(patches.poles[..., :3], patches.index, noise)


def _children(table: Integers, pairs: Integers) -> Integers:
    """Return all pairs of parts of paired blocks, each pair once."""
    first, second = (table[row].T for row in pairs.T)
    chosen = (first >= 0)[:, None] & (second >= 0)
    alone = np.flatnonzero(pairs[:, 0] == pairs[:, 1])
    chosen[:, :, alone] &= np.triu(np.ones((4, 4), dtype=bool))[..., None]
    p, q, row = np.nonzero(chosen)
    return np.stack((first[p, row], second[q, row]), axis=1)


@dataclass(eq=False)
class _Search:
    surfaces: Surfaces
    noise: float
    #: what is no farther apart is not parted
    room: float
    every: bool

    @cached_property
    def _held(self) -> HeldPatches:
        return HeldPatches(self.surfaces, self.noise)

    @cached_property
    def levels(self) -> list[Level]:
        """Patches, and ever larger blocks of them, until they are few."""
        low, high, cones = self._held.patches
        # cones of the ways across walls stand behind those of the tangents
        ways = [self._held.ways(i, j) for i, j in self._walls]
        axes = np.concatenate([cones.axes, *(way.axes for way in ways)])
        radii = np.concatenate([cones.radii, *(way.radii for way in ways)])
        shapes = [*self.surfaces.shapes, *(self.surfaces.shapes[i] for i, _ in self._walls)]
        found = [Level(low, high, Cones(axes, radii), np.array(shapes))]
        while len(found[-1].low) > FEW_BLOCKS and found[-1].shapes.max() > 1:
            found.append(found[-1].coarser())
        return found

    @property
    def thinnest(self) -> float:
        """How thin a wall may be between blocks that are parted."""
        return self._held.least_way

    def coarsest(self) -> Integers:
        """Return the pairs of the largest blocks, of sheets to be compared."""
        level, start = self.levels[-1], self.surfaces.start
        whole = self.planes[0].merged(np.arange(len(self.surfaces.sheet_of)), start)
        sheets = self._sheets[~whole.part(self._sheets, np.arange(len(start)))]
        pairs = meeting(level.low, level.high, self.room)
        asked = np.zeros((len(start),) * 2, dtype=bool)
        asked[tuple(sheets.T)] = True
        return np.asarray(pairs[asked[tuple(level.sheet[pairs].T)]])

    @cached_property
    def planes(self) -> list[PlaneSides]:
        """On which sides of the planes blocks of each level are."""
        found = [sides_of_planes(self.surfaces, self._sheets, self.room)]
        for level in self.levels[1:]:
            assert level.parts is not None
            order, first = level.parts
            count = len(found[-1].bits)
            found.append(found[-1].merged(order[:count], first[: len(level.low)]))
        return found

    @cached_property
    def _sheets(self) -> Integers:
        """The pairs of sheets that are to be compared."""
        surfaces = self.surfaces
        low, high, _ = self._held.patches
        pairs = meeting(
            np.minimum.reduceat(low, surfaces.start), np.maximum.reduceat(high, surfaces.start),
            self.room,
        )  # fmt: skip
        if not self.every:
            one, other = (surfaces.beside[pairs[:, k]] for k in (0, 1))
            pairs = pairs[(one[:, :, None] == other[:, None]).any(axis=(1, 2))]
        # what lies in one plane does not meet itself where its edges do not
        for row in (surfaces.plane, np.array([sheet.region for sheet in surfaces.sheets])):
            pairs = pairs[(row[pairs[:, 0]] < 0) | (row[pairs[:, 0]] != row[pairs[:, 1]])]
        graphs = np.array([_is_graph(sheet.patches, self.noise) for sheet in surfaces.sheets])
        return np.asarray(pairs[(pairs[:, 0] != pairs[:, 1]) | ~graphs[pairs[:, 0]]])

    @cached_property
    def _walls(self) -> list[tuple[int, int]]:
        """The pairs of sheets that may be the two sides of a wall."""
        apart = self._sheets[self._sheets[:, 0] != self._sheets[:, 1]]
        fit = self.surfaces.walls(apart[:, 0], apart[:, 1])
        return [(i, j) for i, j in apart[fit].tolist()]

    @cached_property
    def _wall_of(self) -> Integers:
        """The wall that two sheets are, (sheets, sheets): one `ALONE` or `NO_WALL`."""
        table = np.full((len(self.surfaces.sheets),) * 2, NO_WALL)
        own = np.flatnonzero(self.surfaces.separable & (self.surfaces.plane < 0))
        table[own, own] = ALONE
        for k, (i, j) in enumerate(self._walls):
            table[i, j] = table[j, i] = k
        return table

    def left(self, level: Level, pairs: Integers) -> Integers:
        """Return the pairs of blocks that are not parted as rectangles."""
        rows, step, first, second = self._rectangles(level, pairs)
        parted = self._parted(level, first, second)
        rest = np.flatnonzero(~parted & step.any(axis=0))
        if len(rest):
            chosen = np.sign(step[:, rest]), first[:, rest], second[:, rest]
            parted[rest] = self._ahead_either_way(level, *chosen)
        left = np.ones(len(pairs), dtype=bool)
        left[rows[parted]] = False
        return pairs[left]

    def _ahead_either_way(
        self, level: Level, step: Integers, first: Integers, second: Integers
    ) -> Booleans:
        """Say which pairs of blocks do not meet as all ways from one to the other are ahead.

        Along a parameter without a step these lead one way or the other, and either is asked.
        """
        either = np.flatnonzero(~step.all(axis=0))
        rows = np.concatenate((np.arange(step.shape[1]), either))
        signs = np.concatenate((step + (step == 0), step[:, either]), axis=1)
        signs[signs == 0] = -1
        ahead = self._ahead(level, signs, first[:, rows], second[:, rows])
        result = ahead[: step.shape[1]]
        result[either] &= ahead[step.shape[1] :]
        return result

    def meet(self, level: Level, pairs: Integers) -> Booleans:
        """Say of which pairs the limits meet."""
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

    def _rectangles(
        self, level: Level, pairs: Integers
    ) -> tuple[Integers, Integers, Integers, Integers]:
        """Return pairs of blocks side by side on one grid, and the steps between them (2, k).

        With them come the corners of the rectangle round both (4, k), on both sheets.
        """
        a, b = np.ascontiguousarray(pairs.T)
        one, other = level.sheet[a], level.sheet[b]
        fit = level.narrow[a] & level.narrow[b] & (self._wall_of[one, other] > NO_WALL)
        rows = np.flatnonzero(fit)
        steps, places = [], []
        for axis in (0, 1):
            size, place = level.shapes[one[rows], axis], level.place[:, axis]
            start = place[a[rows]]
            step = place[b[rows]] - start
            closed = self.surfaces.closed[:, axis]
            round_ = closed[one[rows]] & closed[other[rows]]
            step = np.where(round_, (step + size // 2) % size - size // 2, step)
            # of blocks on one line, up to two that are between both
            between = np.sign(step) * (np.abs(step) > 1)
            places.append(np.array((start, start + between, start + step - between, start + step)))
            places[-1] %= size
            steps.append(step)
        far = np.abs(steps)
        most = np.where(far.min(axis=0) == 0, _ON_LINE, 1)
        near = np.flatnonzero(far.max(axis=0) <= most)
        rows = rows[near]
        s, t = (x[:, near] for x in places)
        s *= level.shapes[one[rows], 1]
        index = np.array((s[0] + t[0], s[2] + t[1], s[3] + t[3], s[1] + t[2]))
        first, second = (index + level.start[sheet[rows]] for sheet in (one, other))
        return rows, np.array(steps)[:, near], first, second

    def _parted(self, level: Level, first: Integers, second: Integers) -> Booleans:
        """Say in which rectangles sheets do not meet themselves or one another."""
        sheet = level.sheet[first[0]]
        wall = self._wall_of[sheet, level.sheet[second[0]]]
        result = np.zeros(len(wall), dtype=bool)
        alone, walls = np.flatnonzero(wall < 0), np.flatnonzero(wall >= 0)
        if len(alone):
            tangents = level.tangents(first[:, alone])
            result[alone] = is_alone(tangents[0], tangents[1])
        # along one side of a wall, whichever, and then across at the other block
        for corners, end in ((first, 2), (second, 0)):
            rows = walls[~result[walls]]
            if len(rows):
                tangents = level.tangents(corners[:, rows])
                across = level.cones[self._ways_at(level, first[end, rows], wall[rows])]
                result[rows] = is_wall(tangents[0], tangents[1], across)
        return result

    def _ways_at(self, level: Level, blocks: Integers, wall: Integers) -> Integers:
        """Return which are the cones of the ways across walls where blocks of theirs are."""
        start = level.start[len(self.surfaces.sheets) + wall]
        return len(level.low) + start + blocks - level.start[level.sheet[blocks]]

    def _ahead(self, level: Level, step: Integers, first: Integers, second: Integers) -> Booleans:
        """Say between which pairs of blocks no ways with these signs come back to where they began.

        All tangents are asked, not a cone of them: on two sides of a wall those along one side,
        whichever, and the ways across at the other block.
        """
        wall = self._wall_of[level.sheet[first[0]], level.sheet[second[0]]]
        result = np.zeros(step.shape[1], dtype=bool)
        rows = np.flatnonzero(wall < 0)
        if len(rows):
            result[rows] = _ahead_on(level, step[:, rows], first[:, rows])
        for corners, end in ((first, 2), (second, 0)):
            rows = np.flatnonzero((wall >= 0) & ~result)
            if len(rows):
                ways = self._ways_at(level, first[end, rows], wall[rows])
                # they lead to the sheet with the larger number
                over = np.where(first[0, rows] < second[0, rows], 1, -1)
                across = ways[None], over[None]
                result[rows] = _ahead_on(level, step[:, rows], corners[:, rows], across)
        return result


def _ahead_on(
    level: Level,
    step: Integers,
    corners: Integers,
    across: tuple[Integers, Integers] | None = None,
) -> Booleans:
    """Say of which rectangles, with corners (4, n), a plane has all tangents on one side.

    They count as the steps (2, n) say, and so do the ways `across` (1, n), by cones and signs.
    """
    blocks = np.concatenate((corners, len(level.low) + corners))
    signs = np.repeat(step, 4, axis=0)
    if across is not None:
        blocks, signs = (np.concatenate(x) for x in ((blocks, across[0]), (signs, across[1])))
    return are_ahead(level.axes.take(blocks, axis=1) * signs, level.sines.take(blocks))
