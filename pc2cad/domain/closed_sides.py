"""Sides of the box that close along a direction: whether they do, and their points along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import squares
from pc2cad.domain.map import Mapping3, open_grid
from pc2cad.geometry.scale import Scale
from pc2cad.topology.cells import DIRECTIONS

#: uniform places along a closed direction, the two across it, and others at which a shift is tried
COUNT = 240
UNIFORM = (np.arange(COUNT) + 0.5) / COUNT
ACROSS = np.array([0.2137, 1 - 0.2137])
TRIED = np.array([0.0713, 0.1931, 0.3877, 0.6173, 0.7919, 0.9377])
_PLACES = np.concatenate((UNIFORM, TRIED))
#: distances of points from what may lie beside them, in steps from one place to the next
_BESIDE = 2
#: the uniform places next to each one, round the direction
NEXT, BEFORE = (np.arange(COUNT) + 1) % COUNT, (np.arange(COUNT) - 1) % COUNT


@dataclass(frozen=True)
class Side:
    """A whole side of the box along one direction in which it may close."""

    mapping: Mapping3
    #: the direction across the box, its limit (0 or 1), and the direction that is followed
    normal: int
    limit: float
    along: int

    def __call__(self, places: Array, across: Array = ACROSS) -> Array:
        """Return points (places, across, 3)."""
        return self.ordered(self.mapping.points(*self.grid(places, across)))

    def grid(self, places: Array, across: Array) -> list[Array]:
        """Return u, v and w of the product of places along the direction and across it."""
        grid = [np.array([self.limit])] * 3
        grid[self.along], grid[3 - self.along - self.normal] = places, across
        shapes = ((-1, 1, 1), (1, -1, 1), (1, 1, -1))
        return [axis.reshape(shape) for axis, shape in zip(grid, shapes, strict=True)]

    def ordered(self, values: Array) -> Array:
        """Return values (…, 3) over the box as (places, across, 3)."""
        other = 3 - self.along - self.normal
        return np.moveaxis(values, (self.along, other), (0, 1)).reshape(
            values.shape[self.along], values.shape[other], 3
        )


def few_points(mapping: Mapping3) -> list[dict[tuple[int, float], Array]]:
    """Return for each direction points (4, 2, 3) of the four sides along it, by normal and limit.

    All are of one grid, whose places along a direction serve as those across others.
    """
    ends, places, across = (0, -1), (0, 2, 3, 5), (1, 4)
    grid = np.array([0.0, ACROSS[0], 0.3, 0.7, ACROSS[1], 1.0])
    whole = mapping.points(*open_grid(grid, grid, grid))
    rows = []
    for along in DIRECTIONS:
        points = np.moveaxis(whole, along, 0)[places, :, :]
        first, second = (d for d in DIRECTIONS if d != along)
        rows.append(
            {(first, float(k < 0)): points[:, k, across] for k in ends}
            | {(second, float(k < 0)): points[:, across, k] for k in ends}
        )
    return rows


def _along_all(sides: Sequence[Side]) -> list[Array]:
    """Return points (246, 2, 3) of sides along one direction, those across one normal together."""
    found: list[Array] = []
    for _, group in groupby(sides, lambda side: side.normal):
        row = list(group)
        first = row[0]
        if len(row) == 1 or not first.mapping.is_alike_together:
            found += [side(_PLACES) for side in row]
            continue
        grid = first.grid(_PLACES, ACROSS)
        grid[first.normal] = open_grid(*[[side.limit for side in row]] * 3)[first.normal]
        both = first.mapping.points(*grid)
        found += [first.ordered(np.take(both, [k], axis=first.normal)) for k in range(len(row))]
    return found


def closes(points: Array, scale: Scale) -> bool:
    """Say whether a side is no curve, and ends along its direction where it began."""
    start, *between, end = points
    if not np.abs(end - start).max() <= scale.same_point:
        return False
    inner = points[:3]
    moves = np.abs(between - start).max(), np.abs(inner[:, 1] - inner[:, 0]).max()
    return bool(min(moves) > 1000 * scale.same_point)


@dataclass(frozen=True, eq=False)
class ClosedSide:
    """A side that closes along its direction, and its points at the uniform places."""

    side: Side
    #: (240, 2, 3)
    points: Array
    #: the points at the places at which a shift is tried, (6, 2, 3)
    tried: Array
    #: the means over the places, (2, 3)
    mean: Array
    #: the largest extent of all points along an axis
    extent: float
    #: how far from each place points may be that lie between it and the next ones, (240,)
    reach: Array

    def may_meet(self, points: Array, places: Array, turned: bool) -> bool:
        """Say whether samples leave it open that the side meets points (n, 2, 3) at places."""
        nearest = (places * COUNT).astype(int) % COUNT
        there = self.points[nearest, ::-1] if turned else self.points[nearest]
        return bool((farthest(there - points) <= self.reach[nearest]).all())


def all_closed(sides: Sequence[Side]) -> list[ClosedSide]:
    """Return sides that close along one direction with their points, of all at once."""
    both = np.stack(_along_all(sides))
    points, tried = both[:, :COUNT], both[:, COUNT:]
    means = np.add.reduce(points, axis=1) / COUNT
    flat = points.reshape(len(sides), -1, 3)
    extents = (flat.max(axis=1) - flat.min(axis=1)).max(axis=1)
    steps = farthest(points[:, NEXT] - points)
    reach = _BESIDE * np.maximum(steps, steps[:, BEFORE])
    # waves too short for the places to tell
    reach[steps.sum(axis=1) < extents] = np.inf
    rows = zip(sides, points, tried, means, extents.tolist(), reach, strict=True)
    return [ClosedSide(*row) for row in rows]


def farthest(away: Array) -> Array:
    """Return the greater length of two vectors, (…) of (…, 2, 3)."""
    both = squares(away)
    return np.asarray(np.sqrt(np.maximum(both[..., 0], both[..., 1])))
