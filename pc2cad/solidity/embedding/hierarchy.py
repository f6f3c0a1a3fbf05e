"""Blocks of patches of all sheets and walls, what holds them, and larger ones of two by two."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.linear import lengths, unit
from pc2cad.solidity.embedding.windows import Cones, joint_of_rows


@dataclass(frozen=True, eq=False)
class Level:
    """Blocks of all sheets, and of all walls behind them, row by row.

    A wall is two sheets on one grid, and its blocks are those of either.
    """

    #: limits of the sheets' blocks in thirteen directions (B, 13)
    low: Array
    high: Array
    #: cones of the tangents along s (B), along t (B), and of the ways across the walls
    cones: Cones
    #: rows and columns of blocks of each sheet, and of each wall
    shapes: Integers
    #: smaller blocks by those that they are parts of, and the first of each one's
    parts: tuple[Integers, Integers] | None = None

    @cached_property
    def start(self) -> Integers:
        """First block of each sheet and wall."""
        sizes = self.shapes.prod(axis=1)
        return np.asarray(np.cumsum(sizes) - sizes)

    @cached_property
    def owner(self) -> Integers:
        """The sheet or wall of each block."""
        return np.repeat(np.arange(len(self.shapes)), self.shapes.prod(axis=1))

    @property
    def sheet(self) -> Integers:
        """The sheet of each of the sheets' blocks."""
        return self.owner[: len(self.low)]

    @cached_property
    def place(self) -> Integers:
        """Row and column of each block in its sheet."""
        index = np.arange(len(self.owner)) - self.start[self.owner]
        return np.stack(np.divmod(index, self.shapes[self.owner, 1]), axis=1)

    @cached_property
    def axes(self) -> Array:
        """The cones' axes coordinate by coordinate, (3, C): long rows, not three numbers."""
        return np.array(self.cones.axes.T, order="C")

    @cached_property
    def sines(self) -> Array:
        """The sines of half the angles at the tips of all cones."""
        return self.cones.slopes[0]

    @cached_property
    def narrow(self) -> Booleans:
        """Of which blocks the tangents turn so little that rectangles of some may be parted.

        Both half angles together are less than a right angle.
        """
        sines = self.sines[: 2 * len(self.low)]
        return np.asarray((sines * sines).reshape(2, -1).sum(axis=0) < 1)

    @cached_property
    def children(self) -> Integers:
        """The smaller blocks of each of the sheets' blocks, ascending, (B, 4); -1 for none."""
        assert self.parts is not None
        order, first = self.parts
        counts = np.diff(first, append=len(order))
        table = np.full((len(first), 4), -1)
        rank = np.arange(len(order)) - np.repeat(first, counts)
        table[np.repeat(np.arange(len(first)), counts), rank] = order
        return table[: len(self.low)]

    def tangents(self, corners: Integers) -> Cones:
        """Return cones of the tangents along s and t in rectangles of corners (k, n), (2, n)."""
        index = np.array((corners, len(self.low) + corners)).transpose(1, 0, 2)
        return joint_of_rows(self.axes.take(index, axis=1), self.cones.radii.take(index))

    def coarser(self) -> Level:
        """Return blocks of two by two."""
        shapes = (self.shapes + 1) // 2
        sizes = shapes.prod(axis=1)
        start, half = np.cumsum(sizes) - sizes, self.place // 2
        parent = start[self.owner] + half[:, 0] * shapes[self.owner, 1] + half[:, 1]
        order = np.argsort(parent, kind="stable")
        first = np.searchsorted(parent[order], np.arange(sizes.sum()))
        # sheets come before walls, with larger numbers
        count, blocks = len(self.low), int(np.searchsorted(first, len(self.low)))
        own, starts = order[:count], first[:blocks]
        # cones along t, and across, stand by their blocks behind those along s
        cones = _merged(
            self.cones,
            np.concatenate((own, count + order)),
            np.concatenate((starts, count + first)),
        )
        low = np.minimum.reduceat(self.low[own], starts)
        high = np.maximum.reduceat(self.high[own], starts)
        return Level(low, high, cones, shapes, (order, first))


def _merged(cones: Cones, order: Integers, first: Integers) -> Cones:
    axes, radii = cones.axes[order], cones.radii[order]
    mean = unit(np.add.reduceat(axes, first))
    own = np.repeat(mean, np.diff(first, append=len(order)), axis=0)
    return Cones(mean, np.maximum.reduceat(lengths(axes - own) + radii, first))
