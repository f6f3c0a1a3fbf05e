"""The least and the largest value of a tree over a box: seen at places, and proved by enclosures.

Branch and bound: boxes that may hold a value beyond the best one seen are halved where the slopes
of their centred enclosures say, until what is open is rounding, or an effort is spent. What is
proved holds in either case; it is only wider then.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.expression.centred import CentredProgram
from pc2cad.expression.evaluation import Program
from pc2cad.expression.intervals import Interval, interval
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import Expr, neg

#: operations on boxes at which the proof ends: some tenths of a second
MOST_OPERATIONS: Final = 1e6
#: boxes looked at together
MOST_BOXES: Final = 20_000
#: shares of the values' spread, and of their size, that may stay open
SETTLED, ROUNDING = 1e-6, 1e-13
#: parts per smooth piece of a direction at the start
FIRST: Final = 4


@dataclass(frozen=True)
class Extreme:
    """The least or the largest value of a tree over a box."""

    #: the best one seen, and the local u, v, w that have it
    seen: float
    place: tuple[float, float, float]
    #: no value is beyond this; infinite where nothing is proved
    bound: float


def least_value(tree: Expr, limits: list[list[float]]) -> Extreme:
    """Return the least value of a tree in u, v, w; `limits` end its smooth pieces, ascending."""
    return _Search(tree, limits).run()


def largest_value(tree: Expr, limits: list[list[float]]) -> Extreme:
    """Return the largest value, as `least_value`."""
    found = least_value(neg(tree), limits)
    return Extreme(-found.seen, found.place, -found.bound)


class _Search:
    """One branch and bound."""

    def __init__(self, tree: Expr, limits: list[list[float]]) -> None:
        self._used = [d for d, name in enumerate(PARAMETERS) if name in tree.symbols]
        self._enclose, self._evaluate = CentredProgram((tree,)), Program((tree,))
        self._limits = limits
        self._best, self._place = np.inf, (0.0, 0.0, 0.0)
        self._most = -np.inf

    def run(self) -> Extreme:
        low, high = self._first()
        self._look(low)
        self._look(high)
        spent, bound = 0.0, np.inf
        while len(low):
            spent += self._enclose.size * len(low)
            boxes = {n: interval(low[:, d], high[:, d]) for d, n in enumerate(PARAMETERS)}
            (found,) = self._enclose(boxes)
            self._look(_downhill(found.slopes, low, high))
            lower = np.broadcast_to(found.value.lower, len(low))
            lower = np.where(np.isnan(lower), -np.inf, lower)
            size = max(abs(self._best), abs(self._most))
            room = SETTLED * (self._most - self._best) + ROUNDING * size
            beyond = lower < self._best - room
            if spent > MOST_OPERATIONS or len(low) > MOST_BOXES or not self._used:
                return Extreme(self._best, self._place, min(bound, float(lower.min())))
            bound = min(bound, float(lower[~beyond].min(initial=np.inf)))
            low, high = self._halved(low, high, found.slopes, beyond)
        return Extreme(self._best, self._place, min(bound, self._best))

    def _first(self) -> tuple[Array, Array]:
        axes = []
        for d, row in enumerate(self._limits):
            parts = FIRST if d in self._used else 1
            ends = np.array(row if d in self._used else [row[0], row[-1]])
            shares = np.arange(parts) / parts
            inner = (ends[:-1, None] + np.diff(ends)[:, None] * shares).ravel()
            axes.append(np.append(inner, ends[-1]))
        low, high = (
            np.stack(np.meshgrid(*corners, indexing="ij"), axis=-1).reshape(-1, 3)
            for corners in ([a[:-1] for a in axes], [a[1:] for a in axes])
        )
        return low, high

    def _look(self, places: Array) -> None:
        """Note the values at places (n, 3)."""
        (values,) = self._evaluate({n: places[:, d] for d, n in enumerate(PARAMETERS)})
        values = np.broadcast_to(np.asarray(values, dtype=float), len(places))
        finite = np.flatnonzero(np.isfinite(values))
        if not len(finite):
            return
        self._most = max(self._most, float(values[finite].max()))
        best = finite[values[finite].argmin()]
        if values[best] < self._best:
            u, v, w = places[best].tolist()
            self._best, self._place = float(values[best]), (u, v, w)

    def _halved(
        self, low: Array, high: Array, slopes: Mapping[str, Interval], which: Booleans
    ) -> tuple[Array, Array]:
        """Return the halves of some boxes, each across the direction that changes most."""
        low, high = low[which], high[which]
        blame = np.zeros_like(low)
        for d in self._used:
            slope = slopes.get(PARAMETERS[d])
            steep = np.ones(len(which)) if slope is None else _largest(slope, len(which))
            blame[:, d] = (steep[which] + 1e-300) * (high[:, d] - low[:, d])
        unknown = ~np.isfinite(blame).all(axis=1)
        blame[unknown] = (high - low)[unknown]
        rows, across = np.arange(len(low)), blame.argmax(axis=1)
        middle = (low[rows, across] + high[rows, across]) / 2
        below, above = high.copy(), low.copy()
        below[rows, across] = above[rows, across] = middle
        return np.concatenate((low, above)), np.concatenate((below, high))


def _largest(slope: Interval, count: int) -> Array:
    size = np.maximum(np.abs(slope.lower), np.abs(slope.upper))
    return np.where(np.isnan(size), np.inf, np.broadcast_to(size, count))


def _downhill(slopes: Mapping[str, Interval], low: Array, high: Array) -> Array:
    """Return the corner of each box that its slopes lead down to, (n, 3)."""
    places = (low + high) / 2
    for d, name in enumerate(PARAMETERS):
        if name in slopes:
            with np.errstate(all="ignore"):
                middle = np.broadcast_to(slopes[name].middle, len(low))
            places[:, d] = np.where(middle > 0, low[:, d], high[:, d])
    return places
