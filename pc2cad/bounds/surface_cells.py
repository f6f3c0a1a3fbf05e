"""Faces in cells of their parameters: what a cell holds at most, from its middle and its bends.

    S(z) is within |S_aa| δa²/2 + |S_ab| δa δb + |S_bb| δb²/2 of S(c) + S_a δa + S_b δb,

and S_a, S_b within sums of the same bounds of theirs in the middle. That holds across the breaks of
a surface too; where its first derivatives jump there, the jumps are added.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.geometry.jets import SurfaceFunction

#: share of a face's rectangle within which a border is on its sides
ON_SIDE = 1e-9
#: share of a border's extent within which it closes
CLOSED = 1e-6
#: share of a surface's largest slope below which a jump of slopes is rounding
SMOOTH = 1e-9
#: values of (cell, piece of a border) that are looked at at a time
SLAB = 1_000_000


@dataclass(frozen=True, eq=False)
class Border:
    """What bounds a face in its parameters, in pieces that have the face on their left."""

    #: (n, 2) each
    starts: Array
    ends: Array
    #: how far a piece is from its chord at most, and its tangents from that, (n,)
    bows: Array
    #: the same in many more pieces
    finer: Callable[[], Border] | None = None

    @cached_property
    def fine(self) -> Border:
        """The same in so many pieces that chords are nearly as good as curves."""
        return self if self.finer is None else self.finer()

    @property
    def box(self) -> tuple[Array, Array]:
        """Corners of the rectangle that it fills, (2,) each."""
        bows = self.bows[:, None]
        low, high = np.minimum(self.starts, self.ends), np.maximum(self.starts, self.ends)
        return (low - bows).min(axis=0), (high + bows).max(axis=0)

    def touching(self, low: Array, high: Array) -> Booleans:
        """Say which pieces may be in boxes with these corners (k, 2), (k, n)."""
        bows = self.bows[:, None]
        least = np.minimum(self.starts, self.ends) - bows
        most = np.maximum(self.starts, self.ends) + bows
        near = ((least[None] <= high[:, None]) & (most[None] >= low[:, None])).all(axis=2)
        # and across a slanting piece
        across = (self.ends - self.starts)[:, ::-1] * np.array([1.0, -1.0])
        off = np.abs(((low + high) / 2) @ across.T - (self.starts * across).sum(axis=1))
        reach = ((high - low) / 2) @ np.abs(across).T
        wide = np.linalg.norm(across, axis=1) * self.bows + 1e-12 * np.abs(across).sum(axis=1)
        return np.asarray(near & (off <= reach + wide * (1 + np.abs(self.starts).max())))

    def holds(self, places: Array, reach: Array) -> Booleans:
        """Say which places (k, 2) are within lengths (k, 2) of it in both parameters."""
        steps = self.ends - self.starts
        off = places[:, None] - self.starts
        scale = 1 / np.maximum(reach, np.finfo(float).tiny)[:, None]
        square = ((steps * scale) ** 2).sum(axis=2)
        share = (off * steps * scale**2).sum(axis=2) / np.where(square > 0, square, 1.0)
        left = np.abs(off - np.clip(share, 0.0, 1.0)[..., None] * steps)
        return np.asarray((left <= reach[:, None] + self.bows[:, None]).all(axis=2).any(axis=1))

    def outside(self, low: Array, high: Array) -> Booleans:
        """Say which boxes with these corners (k, 2) hold nothing of the face.

        Of a border that does not close nothing is said.
        """
        found = np.zeros(len(low), dtype=bool)
        most = np.abs(self.box[1] - self.box[0]).max()
        if np.abs((self.ends - self.starts).sum(axis=0)).max() > CLOSED * most:
            return found
        step = max(1, SLAB // len(self.bows))
        for k in range(0, len(low), step):
            part = slice(k, k + step)
            clear = ~self.touching(low[part], high[part]).any(axis=1)
            middle = (low[part] + high[part])[clear] / 2
            found[k : k + step][clear] = np.abs(self._turns(middle)) < 0.5
        return found

    def inside(self, low: Array, high: Array) -> Booleans:
        """Say which boxes with these corners (k, 2) hold nothing but the face."""
        clear: Booleans = np.asarray(~self.touching(low, high).any(axis=1))
        clear[clear] = self._turns((low + high)[clear] / 2) > 0.5
        return clear

    def _turns(self, places: Array) -> Array:
        """Return how often the border goes round places (k, 2)."""
        x, y = np.moveaxis(self.starts[None] - places[:, None], 2, 0)
        u, v = np.moveaxis(self.ends[None] - places[:, None], 2, 0)
        return np.asarray(np.arctan2(x * v - y * u, x * u + y * v).sum(axis=1) / (2 * np.pi))


@dataclass(frozen=True, eq=False)
class Region:
    """A face: a surface over what a border holds of a rectangle of its parameters."""

    surface: SurfaceFunction
    border: Border
    #: how far it may be from its equation's
    deviation: float
    #: corners of the largest rectangle that it may fill, (2,) each
    limits: tuple[Array, Array]

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Corners of its rectangle, (2,) each."""
        low, high = self.border.box
        return np.maximum(low, self.limits[0]), np.minimum(high, self.limits[1])

    @cached_property
    def trimmed(self) -> bool:
        """Whether it does not fill its rectangle."""
        low, high = self.box
        near = ON_SIDE * (high - low)
        pieces = np.stack((self.border.starts, self.border.ends))
        on = (np.abs(pieces - low) <= near) | (np.abs(pieces - high) <= near)
        # both ends on one side, and straight
        sided = np.abs(pieces[0] - pieces[1]) <= near
        return not bool((on.all(axis=0) & sided).any(axis=1).all())

    @cached_property
    def jumps(self) -> tuple[float, float]:
        """By how much its first derivatives jump at breaks."""
        sizes = self.surface.sizes()
        a, b = (
            0.0 if jump <= SMOOTH * first else jump
            for jump, first in zip(sizes.jumps, sizes.first, strict=True)
        )
        return a, b

    def bends(self, low: Array, high: Array) -> Array:
        """Return bounds of |S_aa|, |S_ab| and |S_bb| over boxes with these corners, (n, 3)."""
        if self.surface.bends is None:
            return np.repeat([self.surface.sizes().second], len(low), axis=0)
        return self.surface.bends(low, high)

    def jump_over(self, low: Array, high: Array) -> Array:
        """Return by how much both derivatives may jump in all within boxes, (n, 2)."""
        found = np.zeros((len(low), 2))
        for d, jump in enumerate(self.jumps):
            breaks = self.surface.breaks[d]
            if jump and breaks is not None:
                inner = breaks[1:-1]
                first = np.searchsorted(inner, low[:, d], side="left")
                found[:, d] = jump * (np.searchsorted(inner, high[:, d], side="right") - first)
        return found


@dataclass(frozen=True, eq=False)
class Cells:
    """Boxes of the parameters of faces, n of them, with what they hold."""

    #: which face they are of
    region: Integers
    low: Array
    high: Array
    #: in the middle: the point (n, 3), and both derivatives (n, 2, 3)
    point: Array
    slopes: Array
    #: how far the face is from its tangent plane's cell, (n,)
    error: Array

    @cached_property
    def half(self) -> Array:
        """Half the widths, (n, 2)."""
        return np.asarray((self.high - self.low) / 2)

    @cached_property
    def spans(self) -> Array:
        """Half the sides of the tangent plane's cell, (n, 2, 3)."""
        return np.asarray(self.slopes * self.half[..., None])

    @cached_property
    def normal(self) -> Array:
        """Unit normals in the middle, 0 where there is none."""
        crossed = np.cross(self.slopes[:, 0], self.slopes[:, 1])
        size = np.linalg.norm(crossed, axis=1)[:, None]
        return np.asarray(np.divide(crossed, size, out=np.zeros_like(crossed), where=size > 0))

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Corners of boxes in space that hold the cells, (n, 3) each."""
        reach = np.abs(self.spans).sum(axis=1) + self.error[:, None]
        return self.point - reach, self.point + reach

    def within(self, direction: Array, chosen: Integers) -> Array:
        """Return how far chosen cells reach from their middles along unit vectors (k, 3)."""
        along = np.abs(np.einsum("kdi,ki->kd", self.spans[chosen], direction)).sum(axis=1)
        return np.asarray(along + self.error[chosen])

    def __len__(self) -> int:
        return len(self.region)


def cells_of(regions: Sequence[Region], region: Integers, low: Array, high: Array) -> Cells:
    """Return cells with these corners of faces with these numbers."""
    count = len(region)
    point, slopes, error = np.empty((count, 3)), np.empty((count, 2, 3)), np.empty(count)
    middle, half = (low + high) / 2, (high - low) / 2
    for k, face in enumerate(regions):
        (some,) = np.nonzero(region == k)
        if not len(some):
            continue
        at = middle[some]
        point[some], slopes[some, 0], slopes[some, 1] = face.surface.jet(at[:, 0], at[:, 1])
        bends = face.bends(low[some], high[some])
        a, b = half[some].T
        error[some] = (
            bends[:, 0] * a * a / 2 + bends[:, 1] * a * b + bends[:, 2] * b * b / 2
            + (face.jump_over(low[some], high[some]) * half[some]).sum(axis=1)
        )  # fmt: skip
    return Cells(region, low, high, point, slopes, error)


def whole(regions: Sequence[Region]) -> Cells:
    """Return a cell per face."""
    low, high = (np.array([face.box[k] for face in regions]).reshape(-1, 2) for k in (0, 1))
    return cells_of(regions, np.arange(len(regions)), low, high)


def halved(
    regions: Sequence[Region], cells: Cells, used: Booleans, longest: float
) -> tuple[Cells, Integers, Integers]:
    """Return cells of which none is longer than a length, by one halving, without what is outside.

    With them come the first one that each cell has become, and how many; none of those not `used`.
    """
    low, high, region = cells.low, cells.high, cells.region
    parent = np.flatnonzero(used)
    low, high, region = low[parent], high[parent], region[parent]
    bends = np.empty((len(parent), 3))
    for k, face in enumerate(regions):
        some = region == k
        if some.any():
            bends[some] = face.bends(low[some], high[some])
    lengths = 2 * np.linalg.norm(cells.spans[parent], axis=2)
    for axis in (0, 1):
        half = (high - low) / 2
        own, other = half[:, axis], half[:, 1 - axis]
        bow = bends[:, 2 * axis] * own**2 + bends[:, 1] * own * other
        (cut,) = np.nonzero(np.maximum(lengths[:, axis], 2 * bow) > longest)
        middle = (low[cut, axis] + high[cut, axis]) / 2
        upper, lower = low[cut].copy(), high.copy()
        upper[:, axis], lower[cut, axis] = middle, middle
        low, high = np.concatenate((low, upper)), np.concatenate((lower, high[cut]))
        region, parent = np.append(region, region[cut]), np.append(parent, parent[cut])
        bends = np.concatenate((bends, bends[cut]))
        lengths = np.concatenate((lengths, lengths[cut]))
    order = np.argsort(parent, kind="stable")
    keep = np.ones(len(order), dtype=bool)
    low, high, region, parent = low[order], high[order], region[order], parent[order]
    for k, face in enumerate(regions):
        (some,) = np.nonzero(region == k)
        if face.trimmed and len(some):
            keep[some] = ~face.border.outside(low[some], high[some])
    low, high, region, parent = low[keep], high[keep], region[keep], parent[keep]
    counts = np.bincount(parent, minlength=len(cells))
    return cells_of(regions, region, low, high), np.cumsum(counts) - counts, counts
