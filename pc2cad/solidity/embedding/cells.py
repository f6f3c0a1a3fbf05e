"""Parts of sheets: their control points, and where two of them are joined."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.distinct import distinct, distinct_rows
from pc2cad.arrays.linear import cross, product, unit
from pc2cad.geometry.sheets import projected, restriction
from pc2cad.solidity.embedding.surfaces import POINT, SAME, Surfaces

#: the name of a vertex as the end of a line
_VERTEX = -2
#: corners 0 (s=0,t=0), 1 (1,0), 2 (1,1), 3 (0,1): the ends of the sides t=0, s=1, t=1, s=0
ENDS = np.array([[0, 1], [1, 2], [3, 2], [0, 3]])
_SIDES_AT = ((0, 3), (0, 1), (2, 1), (2, 3))


@dataclass(frozen=True, eq=False)
class Cells:
    """Parts of patches: rows of arrays."""

    surfaces: Surfaces
    patch: Integers
    #: limits within the patch, (N, 2) each
    low: Array
    high: Array
    #: control points (N, d+1, d+1, 3)
    points: Array

    def __len__(self) -> int:
        return len(self.patch)

    def take(self, rows: Integers) -> Cells:
        """Return some of the cells."""
        return Cells(self.surfaces, self.patch[rows], self.low[rows], self.high[rows],
                     self.points[rows])  # fmt: skip

    def of(self, pairs: Integers) -> tuple[Cells, Integers]:
        """Return the cells that are in pairs (k, 2), and the pairs of them by their new numbers."""
        rows = distinct(pairs)
        number = np.empty(len(self), dtype=np.int64)
        number[rows] = np.arange(len(rows))
        return self.take(rows), number[pairs]

    @cached_property
    def sheet(self) -> Integers:
        """The sheet of each cell."""
        return self.surfaces.sheet_of[self.patch]

    @cached_property
    def extent(self) -> Array:
        """Largest distance of a control point from the first one along an axis of space."""
        flat = self.points.reshape(len(self), -1, 3)
        return np.asarray((flat.max(axis=1) - flat.min(axis=1)).max(axis=1))

    @cached_property
    def lengths(self) -> Array:
        """How long the cells are along s and t (N, 2)."""
        p = self.points
        along = np.sqrt((np.diff(p, axis=1) ** 2).sum(axis=-1)).sum(axis=1).max(axis=1)
        across = np.sqrt((np.diff(p, axis=2) ** 2).sum(axis=-1)).sum(axis=2).max(axis=1)
        return np.stack((along, across), axis=1)

    @cached_property
    def bows(self) -> Array:
        """How far control points are from the middle between the ends along s and t (N, 2)."""
        p, d = self.points, self.surfaces.degree
        share = np.arange(d + 1)[:, None] / d
        across = p - (p[:, :, :1] + share * (p[:, :, -1:] - p[:, :, :1]))
        along = p - (p[:, :1] + share[:, None] * (p[:, -1:] - p[:, :1]))
        return np.stack(
            [np.sqrt((gap**2).sum(axis=-1).max(axis=(1, 2))) for gap in (along, across)], axis=1
        )

    @cached_property
    def frames(self) -> tuple[Array, Array, Array, Array]:
        """Mean directions along s and t, across both, and mean points, (N, 3) each."""
        flat = self.points.reshape(len(self), -1)
        found = product(flat, _means(self.surfaces.degree)).reshape(-1, 3, 3)
        s, t, centre = found.transpose(1, 0, 2)
        return unit(s), unit(t), unit(cross(s, t)), centre

    @cached_property
    def limits(self) -> tuple[Array, Array]:
        """Limits in the sheet's own coordinates, patches of length 1: (N, 2) each."""
        place = self.surfaces.place[self.patch]
        return place + self.low, place + self.high

    @cached_property
    def _on_border(self) -> Booleans:
        low, high = self.limits
        shape = self.surfaces.shapes[self.sheet]
        sides = (
            low[:, 1] <= 0,
            high[:, 0] >= shape[:, 0],
            high[:, 1] >= shape[:, 1],
            low[:, 0] <= 0,
        )
        return np.stack(sides, axis=1)

    @cached_property
    def on_border(self) -> Booleans:
        """Which cells have a side on the border of their sheet (N,)."""
        return np.asarray(self._on_border.any(axis=1))

    @cached_property
    def edge(self) -> Integers:
        """The edge on which each side lies, -1 where it is a point or inside the sheet, (N, 4)."""
        return np.where(self._on_border, self.surfaces.edges[self.sheet], -1)

    @cached_property
    def collapsed(self) -> Booleans:
        """Which sides are one point (N, 4)."""
        return self._on_border & (self.surfaces.edges[self.sheet] < 0)

    @cached_property
    def _coordinates(self) -> Array:
        """Coordinates along the edges at both ends of each side, (N, 4, 2); of a sheet inside."""
        low, high = self.limits
        s, t = (np.stack((low[:, k], high[:, k]), axis=1) for k in (0, 1))
        own = np.stack((s, t, s, t), axis=1)
        index = np.minimum(own.astype(np.int64), self.surfaces.along.shape[2] - 2)
        rows, sides = self.sheet[:, None, None], np.arange(4)[None, :, None]
        start, end = (
            self.surfaces.along[rows, sides, index],
            self.surfaces.along[rows, sides, index + 1],
        )
        along = start + (own - index) * (end - start)
        lines = self.surfaces.lines[np.maximum(self.edge, 0)]
        step = lines[:, :, 1]
        straight = np.isfinite(step[..., 0]) & (self.edge >= 0)
        if straight.any():
            gap = self.corners[:, ENDS] - lines[:, :, None, 0]
            share = (
                np.einsum("nkei,nki->nke", gap, step)
                / np.einsum("nki,nki->nk", step, step)[..., None]
            )
            along = np.where(straight[..., None], share, along)
        return np.where((self.edge >= 0)[..., None], along, own)

    @cached_property
    def corners(self) -> Array:
        """The corners' points (N, 4, 3)."""
        p = self.points
        return np.stack((p[:, 0, 0], p[:, -1, 0], p[:, -1, -1], p[:, 0, -1]), axis=1)

    @cached_property
    def sides(self) -> tuple[Integers, Array, Array, Array]:
        """The line of each side: name and level (N, 4), and ascending limits along it."""
        low, high = self.limits
        count = len(self.surfaces.lines)
        name = np.where(
            self.edge >= 0, self.edge, count + 2 * self.sheet[:, None] + np.array([0, 1, 0, 1])
        )
        name = np.where(self.collapsed, POINT, name)
        level = np.stack((low[:, 1], high[:, 0], high[:, 1], low[:, 0]), axis=1)
        level = np.where(self.edge >= 0, 0.0, level)
        along = np.sort(self._coordinates, axis=2)
        return name, level, along[..., 0], along[..., 1]

    @cached_property
    def nodes(self) -> tuple[Integers, Array]:
        """The place of each corner: name (N, 4) and coordinates (N, 4, 2)."""
        low, high = self.limits
        surfaces, sheet = self.surfaces, self.sheet
        inside = len(surfaces.lines) + 2 * len(surfaces.sheets) + sheet
        name = np.empty((len(self), 4), dtype=np.int64)
        where = np.zeros((len(self), 4, 2))
        s, t = (low[:, 0], high[:, 0]), (low[:, 1], high[:, 1])
        for c, (along_s, along_t) in enumerate(_SIDES_AT):
            upper = c in (1, 2), c in (2, 3)
            name[:, c] = inside
            where[:, c, 0], where[:, c, 1] = s[upper[0]], t[upper[1]]
            for k, end in ((along_s, upper[0]), (along_t, upper[1])):
                on, point = self._on_border[:, k], self.collapsed[:, k]
                edge = on & ~point
                name[edge, c] = self.edge[edge, k]
                where[edge, c, 0], where[edge, c, 1] = self._coordinates[edge, k, int(end)], 0.0
            for k in (along_s, along_t):
                point = self.collapsed[:, k]
                name[point, c] = _VERTEX
                where[point, c, 0] = surfaces.vertices[sheet[point], k, 0]
                where[point, c, 1] = 0.0
            both = self._on_border[:, along_s] & self._on_border[:, along_t]
            name[both, c] = _VERTEX
            where[both, c, 0] = surfaces.vertices[sheet[both], along_s, int(upper[0])]
            where[both, c, 1] = 0.0
        return name, where


@lru_cache(maxsize=16)
def _means(degree: int) -> Array:
    """Return what takes control points (d+1)²·3 to ways along s and t, and their mean, 3 each."""
    n = degree + 1
    weights = np.zeros((3, n, n))
    weights[0, (0, -1)] = weights[1, :, (0, -1)] = np.array([[-1.0], [1.0]]) / n
    weights[2] = 1 / (n * n)
    return np.asarray(np.kron(weights.reshape(3, -1).T, np.eye(3)))


def cells_of(surfaces: Surfaces, patch: Integers, low: Array, high: Array) -> Cells:
    """Return parts of patches."""
    d = surfaces.degree
    nets = surfaces.nets(patch)
    whole = (low <= 0).all(axis=1) & (high >= 1).all(axis=1)
    cut = np.flatnonzero(~whole)
    if len(cut):
        along_s, along_t = (_restrictions(d, low[cut, axis], high[cut, axis]) for axis in (0, 1))
        flat = (along_s @ nets[cut].reshape(len(cut), d + 1, -1)).reshape(nets[cut].shape)
        nets[cut] = along_t[:, None] @ flat
    return Cells(surfaces, patch, low, high, projected(nets))


def _restrictions(degree: int, low: Array, high: Array) -> Array:
    """Return the matrices of `restriction`, each made once: halvings leave few different limits."""
    rows, index = distinct_rows(low, high)
    return restriction(degree, low[rows], high[rows])[index]


@dataclass(frozen=True, eq=False)
class Joints:
    """Where pairs of different cells are joined."""

    #: which sides of the first lie on which of the second (n, 4, 4)
    sides: Booleans
    #: which corners of the first are which of the second (n, 4, 4)
    corners: Booleans

    @cached_property
    def along(self) -> Booleans:
        """Joined along a part of one edge, and nowhere else but in its ends."""
        return np.asarray((self.sides.sum(axis=(1, 2)) == 1) & (self._distinct_off == 0))

    @cached_property
    def at(self) -> Booleans:
        """Joined in one point only."""
        return np.asarray(~self.sides.any(axis=(1, 2)) & (self._distinct_off == 1))

    @cached_property
    def any(self) -> Booleans:
        """Joined somewhere."""
        return np.asarray(self.sides.any(axis=(1, 2)) | self.corners.any(axis=(1, 2)))

    @cached_property
    def _distinct_off(self) -> Integers:
        """Number of different common points off the common side."""
        on_side = np.zeros((len(self.sides), 4), dtype=bool)
        for k in range(4):
            has = np.asarray(self.sides[:, k].any(axis=1))
            on_side |= has[:, None] & np.isin(np.arange(4), ENDS[k])
        # corners of the second that meet an end of the common side are that end
        taken = np.asarray((self.corners & on_side[:, :, None]).any(axis=1))
        left = self.corners & ~on_side[:, :, None] & ~taken[:, None]
        # one point may be two corners of either
        shared = np.asarray(left.any(axis=2))
        count = shared.sum(axis=1)
        for c in range(4):
            for e in range(c):
                count = count - np.asarray((left[:, c] & left[:, e]).any(axis=1))
        return np.asarray(np.maximum(count, shared.any(axis=1)))


def joints(cells: Cells, pairs: Integers) -> Joints:
    """Return where pairs of different cells are joined."""
    sides, corners = np.zeros((2, len(pairs), 4, 4), dtype=bool)
    rows = np.flatnonzero(_may_be_joined(cells, pairs))
    if len(rows) == 0:
        return Joints(sides, corners)
    a, b = pairs[rows, 0], pairs[rows, 1]
    name, level, low, high = cells.sides
    same = (name[a][:, :, None] == name[b][:, None]) & (name[a] >= 0)[:, :, None]
    same &= np.abs(level[a][:, :, None] - level[b][:, None]) <= SAME
    over = np.minimum(high[a][:, :, None], high[b][:, None])
    over = over - np.maximum(low[a][:, :, None], low[b][:, None])
    node, where = cells.nodes
    corner = node[a][:, :, None] == node[b][:, None]
    corner &= (np.abs(where[a][:, :, None] - where[b][:, None]) <= SAME).all(axis=-1)
    sides[rows], corners[rows] = same & (over > SAME), corner
    return Joints(sides, corners)


def _may_be_joined(cells: Cells, pairs: Integers) -> Booleans:
    """Say which pairs adjoin on one sheet, or are both on borders of sheets that may be joined."""
    a, b = pairs[:, 0], pairs[:, 1]
    low, high = cells.limits
    gap = np.maximum(low[a] - high[b], low[b] - high[a])
    one, other, border = cells.sheet[a], cells.sheet[b], cells.on_border
    beside = (one == other) & (gap[:, 0] <= SAME) & (gap[:, 1] <= SAME)
    return np.asarray(beside | (cells.surfaces.joined[one, other] & border[a] & border[b]))
