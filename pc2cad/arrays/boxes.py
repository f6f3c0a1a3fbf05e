"""Which boxes meet and which places are near, in time and memory for those, not for all pairs."""

from __future__ import annotations

from itertools import product
from math import floor

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers

#: boxes that are few enough to be compared each with each, and pairs that are looked at at once
FEW = 1024
_SLAB = 1 << 16
#: of few boxes: how many pairs at once, and along how many directions all are compared
_TABLE, _FIRST = 1 << 15, 3


def meeting(low: Array, high: Array, gap: float = 0.0) -> Integers:
    """Return the pairs (k, 2) of boxes that meet or come as near as `gap` along every direction.

    `low` and `high` (N, d) are limits along directions that need not be at right angles. Each pair
    is there once, i <= j, row by row; a box that has any inside meets itself.
    """
    upper = high + gap
    if len(low) <= FEW:
        return _each_with_each(low, upper)
    order, ends = _sweep(low, upper)
    found = [np.empty((0, 2), dtype=np.int64)]
    last = np.cumsum(ends - np.arange(len(low)))
    start = 0
    while start < len(low):
        done = last[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(last, done + _SLAB, side="right")))
        counts = ends[start:stop] - np.arange(start, stop)
        first = np.repeat(np.arange(start, stop), counts)
        second = first + np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
        pairs = np.sort(order[np.stack((first, second), axis=1)], axis=1)
        found.append(pairs[_meet(low, upper, pairs)])
        start = stop
    pairs = np.concatenate(found)
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


def _each_with_each(low: Array, upper: Array) -> Integers:
    """Return the pairs: along a few directions all are compared, along the others what is left."""
    begins, ends = np.ascontiguousarray(low.T), np.ascontiguousarray(upper.T)
    none = np.empty(0, dtype=np.int64)
    count, start, parts = len(low), 0, [(none, none)]
    while start < count:
        # rows of a table that a processor's own memory holds, from the diagonal on
        stop = min(count, start + max(1, _TABLE // (count - start)))
        meet: Booleans = begins[0, start:stop, None] <= ends[0, start:]
        meet &= ends[0, start:stop, None] >= begins[0, start:]
        for begin, end in zip(begins[1:_FIRST], ends[1:_FIRST], strict=True):
            meet &= begin[start:stop, None] <= end[start:]
            meet &= end[start:stop, None] >= begin[start:]
        a, b = np.divmod(np.flatnonzero(meet), count - start)
        keep = np.flatnonzero(a <= b)
        parts.append((a[keep] + start, b[keep] + start))
        start = stop
    a, b = (np.concatenate(part) for part in zip(*parts, strict=True))
    for begin, end in zip(begins[_FIRST:], ends[_FIRST:], strict=True):
        keep = np.flatnonzero((begin[a] <= end[b]) & (begin[b] <= end[a]))
        a, b = a[keep], b[keep]
    return np.stack((a, b), axis=1)


def _meet(low: Array, upper: Array, pairs: Integers) -> Booleans:
    a, b = pairs[:, 0], pairs[:, 1]
    return np.asarray(((low[a] <= upper[b]) & (low[b] <= upper[a])).all(axis=1))


def _sweep(low: Array, upper: Array) -> tuple[Integers, Integers]:
    """Return boxes by where they begin, and past which of these each ends, itself at least.

    Along the direction in which fewest begin before others end.
    """
    ways = []
    for begin, end in zip(low.T, upper.T, strict=True):
        order = np.argsort(begin, kind="stable")
        ends = np.searchsorted(begin[order], end[order], side="right")
        ways.append((order, np.maximum(ends, np.arange(len(order)) + 1)))
    return min(ways, key=lambda way: int(way[1].sum()))


class Near:
    """Places that were added one by one, looked up by how near they are to others."""

    def __init__(self, distance: float) -> None:
        self._reach = 1.01 * distance
        # of places that are all one, any width will do
        self._width = 1000.0 * distance or 1.0
        self._kept: dict[tuple[int, ...], list[int]] = {}
        self._count = 0

    def add(self, place: list[float]) -> None:
        """Add a place; it is numbered in the order in which they come."""
        key = tuple(floor(x / self._width) for x in place)
        self._kept.setdefault(key, []).append(self._count)
        self._count += 1

    def of(self, place: list[float]) -> list[int]:
        """Return, ascending, numbers of all added places within the distance, and of others."""
        reach, width = self._reach, self._width
        spans = [{floor((x - reach) / width), floor((x + reach) / width)} for x in place]
        found = (self._kept.get(key, ()) for key in product(*spans))
        return sorted(number for numbers in found for number in numbers)
