"""Adaptive Gauss-Legendre rules along one direction: panels where the integrand asks for them.

The integrand is looked at on several lines at once. A panel's order is doubled while that helps;
where it does not, the panel is halved. Where the integrand's antiderivative is known (points and
their tangent), each panel is held against it, so that a step between two nodes is not missed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil

import numpy as np

from pc2cad.arrays import Array, Integers

#: orders of the rule in one panel, each twice the one before; after the last it is halved
ORDERS = (2, 4, 8, 16, 32)
#: order with which halves begin
HALF_ORDER = 8
#: relative change of an integral at which refinement ends
CONVERGED = 1e-13
#: a relative change that rounding may explain where it does not shrink any more
ROUNDING = 1e-10
#: nodes of one direction, and length of a panel, at which it gives up
MOST_NODES, SHORTEST = 60_000, 1e-13
#: length of a panel below which it is left without a value: a single place without one is avoided
WITHOUT_VALUE = 1 / 64
#: how much less the integral along a line through a feature counts than one along a common line:
#: it stands for a small share of the box
LENIENT = 1e4
#: length of a panel below which a step in it is left alone: rounding of a root makes such steps
STEEPEST = 1e-6
#: nodes along which the accepted panels are looked at once more
LOOK = 192
#: nodes up to which a panel is taken with all orders at once
FEW_NODES = 1000
EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Samples:
    """What a line sampler returns at n places on each of L lines."""

    #: the integrands (n, L, k)
    values: Array
    #: size of the terms that the first integrand is a sum of (n, L): its rounding goes with it
    terms: Array
    #: a point that moves along the line, and its derivatives along u, v and w, or along the line
    #: alone: (n, L, 3) each, or None
    points: Array | None = None
    tangents: Sequence[Array] | None = None


Sampler = Callable[[Array], Samples]
#: of a panel: integrals, those of absolute values, of the terms, and what is missed
_Part = tuple[Array, Array, float, float]


@dataclass(frozen=True, eq=False)
class Panels:
    """A composite rule: `limits` (n + 1) of its panels and the order (n) in each."""

    limits: Array
    orders: Integers
    #: what is left unresolved, relative to the integral on the worst line
    unresolved: float = 0.0

    @property
    def count(self) -> int:
        """Number of nodes."""
        return int(self.orders.sum())

    def rule(self, grow: float = 1.0, even: bool = False) -> tuple[Array, Array]:
        """Return nodes and weights, with so many times the nodes; a panel of no length has one.

        With an `even` number in each panel none is in its middle.
        """
        if self.limits[0] == self.limits[-1]:
            return self.limits[:1].copy(), np.ones(1)
        orders = np.maximum(1, np.ceil(grow * self.orders - 1e-9)).astype(int)
        if even:
            orders += orders % 2
        return _nodes(self.limits[:-1], self.limits[1:], orders)


def single(place: float) -> Panels:
    """Return the rule of one place with weight 1."""
    return Panels(np.array([place, place]), np.ones(1, dtype=int))


@lru_cache(maxsize=64)
def gauss(count: int) -> tuple[Array, Array]:
    """Return Gauss-Legendre nodes and weights on [-1, 1]."""
    x, weight = np.polynomial.legendre.leggauss(count)
    x.flags.writeable = weight.flags.writeable = False
    return x, weight


def _nodes(low: Array, high: Array, orders: Integers) -> tuple[Array, Array]:
    rules = [gauss(int(n)) for n in orders]
    x = np.concatenate([rule[0] for rule in rules])
    weight = np.concatenate([rule[1] for rule in rules])
    middle, half = np.repeat((low + high) / 2, orders), np.repeat((high - low) / 2, orders)
    return middle + half * x, half * weight


def resolve(
    sample: Sampler, limits: Sequence[float], look: bool = False, features: int = 0
) -> Panels:
    """Return panels between the limits (breaks stay limits) that integrate the samples.

    With `look`, accepted panels are seen at other places as well before they are believed. The
    last `features` lines run through features (see `features.find_features`): an error there counts
    `LENIENT` times less.
    """
    work = _Work(sample, np.asarray(limits, dtype=float), features)
    with np.errstate(all="ignore"):  # what is not finite is refined, and shows in the error
        while work.step():
            pass
        while look and work.look_again():
            while work.step():
                pass
    return work.result()


class _Work:
    """The panels under way: open ones are refined, accepted ones are kept."""

    def __init__(self, sample: Sampler, limits: Array, features: int) -> None:
        self._sample = sample
        self._features = features
        n = len(limits) - 1
        self.low, self.high = limits[:-1].copy(), limits[1:].copy()
        self.order = np.full(n, ORDERS[0])
        self.open = np.ones(n, dtype=bool)
        #: last integrals (n, L, k), those of absolute values, of the terms; nan: not known
        self._known: list[Array | None] = [None] * n
        self._size: list[Array | None] = [None] * n
        self._terms = np.zeros(n)
        #: last and last but one relative change
        self._change, self._before = np.full(n, np.nan), np.full(n, np.nan)
        self._left = np.zeros(n)

    def step(self) -> bool:
        """Refine the open panels once; return whether some are still open."""
        index = [int(i) for i in np.flatnonzero(self.open)]
        if not index:
            return False
        ladders = self._ladders(index)
        rungs = np.array([len(ladder) for ladder in ladders])
        low, high = (np.repeat(limits[index], rungs) for limits in (self.low, self.high))
        parts = iter(self._integrate(low, high, np.concatenate(ladders)))
        found = [[next(parts) for _ in ladder] for ladder in ladders]
        for i, rows in zip(index, found, strict=True):
            _, self._size[i], self._terms[i], _ = rows[-1]
        scale, noise = self._scale()
        halve = [i for i, rows in zip(index, found, strict=True)
                 if not self._climb(i, rows, scale, noise)]  # fmt: skip
        spent = int(self.order.sum()) + ORDERS[-1] * len(halve)
        if halve and spent > MOST_NODES:
            for i in halve:
                self.open[i], self._left[i] = False, self._expected(i)
            halve.clear()
        self._halve(halve)
        return bool(self.open.any())

    def _ladders(self, index: Sequence[int]) -> list[list[int]]:
        """Return the orders that are taken at once in each open panel, ascending.

        A call of the sampler costs about as much for few nodes as for `FEW_NODES`. The first order
        is too low to be believed without all others.
        """
        ladders = [[n for n in ORDERS if n >= self.order[i]] for i in index]
        if sum(map(sum, ladders)) <= FEW_NODES:
            return ladders
        self.order[index] = np.maximum(self.order[index], ORDERS[1])
        return [[int(self.order[i])] for i in index]

    def _climb(self, i: int, rows: Sequence[_Part], scale: Array, noise: float) -> bool:
        """Take the integrals of ascending orders in; return whether the panel may stay whole."""
        for (value, _, _, miss), change in zip(rows, self._changes(i, rows, scale), strict=True):
            old, self._known[i] = self._known[i], value
            self._before[i], self._change[i] = self._change[i], change
            if old is not None and self._accept(i, change, noise, miss):
                self.open[i] = False
                return True
            if self.order[i] == ORDERS[-1]:
                return False
            self.order[i] *= 2
        return True

    def _changes(self, i: int, rows: Sequence[_Part], scale: Array) -> list[float]:
        """Return how much integrals of ascending orders change, each from the one before."""
        values, known = np.stack([row[0] for row in rows]), self._known[i]
        first = np.full_like(values[:1], np.nan) if known is None else known[None]
        before = np.concatenate((first, values[:-1]))
        # what all orders that are known say of each
        gaps = np.maximum(np.abs(values - before), np.abs(values[-1] - before)) / scale
        changes = gaps.max(axis=(1, 2))
        return [float(change) for change in np.where(np.isfinite(changes), changes, np.inf)]

    def _accept(self, i: int, change: float, noise: float, miss: float) -> bool:
        target = max(CONVERGED, noise)
        if miss > max(10 * target, ROUNDING / 100) and self.high[i] - self.low[i] > STEEPEST:
            return False
        if change <= target:
            # the rule before this one was right already
            self.order[i] //= 2
            return True
        if self._expected(i) <= target:
            return True
        if change < ROUNDING and change > self._before[i] / 4:
            self._left[i] = change
            return True
        if self.high[i] - self.low[i] <= (SHORTEST if np.isfinite(change) else WITHOUT_VALUE):
            self._left[i] = change
            return True
        return False

    def _expected(self, i: int) -> float:
        """Return the next change: it shrinks at least as much as the last one did."""
        change, before = float(self._change[i]), float(self._before[i])
        return change * min(1.0, change / before) if np.isfinite(before) else change

    def _halve(self, index: Sequence[int]) -> None:
        if not index:
            return
        keep = np.ones(len(self.low), dtype=bool)
        keep[index] = False
        middle = (self.low[index] + self.high[index]) / 2
        low = np.concatenate((self.low[keep], self.low[index], middle))
        high = np.concatenate((self.high[keep], middle, self.high[index]))
        order = np.argsort(low)
        new = 2 * len(index)

        def joined(values: Array, fill: float) -> Array:
            return np.concatenate((values[keep], np.full(new, fill)))[order]

        shares = np.concatenate((self._terms[keep], np.tile(self._terms[index] / 2, 2)))
        known = [self._known[i] for i in np.flatnonzero(keep)] + [None] * new
        size = [self._size[i] for i in np.flatnonzero(keep)]
        size += [None if s is None else s / 2 for s in [self._size[i] for i in index] * 2]
        self._known, self._size = [known[i] for i in order], [size[i] for i in order]
        self._terms = shares[order]
        self._change = joined(self._change, np.nan)
        self._before = joined(self._before, np.nan)
        self._left = joined(self._left, 0.0)
        self.order = joined(self.order.astype(float), HALF_ORDER).astype(int)
        self.open = joined(self.open.astype(float), 1.0).astype(bool)
        self.low, self.high = low[order], high[order]

    def _scale(self) -> tuple[Array, float]:
        """Return per line (L, 1) what an error is relative to, and the relative rounding.

        That is the largest integral of absolute values.
        """
        sizes = [s for s in self._size if s is not None]
        # a panel without a value is no measure for the others
        total = np.sum([np.where(np.isfinite(s), s, 0.0) for s in sizes], axis=0)
        common = len(total) - self._features
        scale = np.full((len(total), 1), max(float(np.nanmax(total[:common])), 1e-300))
        own = np.nanmax(total[common:], axis=1, initial=0.0)[:, None]
        scale[common:] = LENIENT * np.maximum(scale[common:], own)
        first = max(float(np.nanmax(total[..., 0])), 1e-300)
        return scale, 64 * EPSILON * float(np.nansum(self._terms)) / first

    def _integrate(self, low: Array, high: Array, orders: Integers) -> list[_Part]:
        """Return per panel: integrals, those of absolute values, of the terms, and what is missed.

        The last is the gap between a point's way through the panel and the integral of its tangent,
        relative to the whole way.
        """
        nodes, weights = _nodes(low, high, orders)
        seen = self._sample(np.concatenate((nodes, low, high)))
        n = len(nodes)
        weighted = seen.values[:n] * weights[:, None, None]
        terms = seen.terms[:n] * weights[:, None]
        starts = np.concatenate(([0], np.cumsum(orders)[:-1]))
        values = np.add.reduceat(weighted, starts, axis=0)
        sizes = np.add.reduceat(np.abs(weighted), starts, axis=0)
        scales = np.add.reduceat(terms, starts, axis=0).max(axis=1)
        miss = np.zeros(len(low))
        if seen.points is not None and seen.tangents is not None:
            (along,) = seen.tangents
            way = np.add.reduceat(along[:n] * weights[:, None, None], starts, axis=0)
            at = seen.points[n:]
            gone = at[len(low) :] - at[: len(low)]
            reach = 64 * EPSILON * float(np.abs(seen.points).max())
            whole = max(float(np.ptp(seen.points, axis=0).max()), reach, 1e-300)
            gap = np.abs(way - gone).max(axis=(1, 2))
            miss = np.maximum(gap - reach, 0.0) / whole
            miss = np.where(np.isfinite(miss), miss, np.inf)
        return [(values[i], sizes[i], float(scales[i]), float(miss[i])) for i in range(len(low))]

    def look_again(self) -> bool:
        """Hold accepted panels against finer ones of another rule; open those that differ."""
        parts = max(1, ceil(LOOK / (7 * len(self.low))))
        if parts == 1:
            return False
        share = np.linspace(0.0, 1.0, parts + 1)
        length = (self.high - self.low)[:, None]
        low = (self.low[:, None] + length * share[:-1]).ravel()
        high = (self.low[:, None] + length * share[1:]).ravel()
        found = self._integrate(low, high, np.full(len(low), 7))
        scale, noise = self._scale()
        different = []
        for i in range(len(self.low)):
            finer = np.sum([found[k][0] for k in range(i * parts, (i + 1) * parts)], axis=0)
            known = self._known[i]
            gap = np.inf if known is None else float((np.abs(finer - known) / scale).max())
            if gap > max(ROUNDING / 10, 10 * noise, 2 * self._left[i]):
                different.append(i)
        self._halve(different)
        return bool(different)

    def result(self) -> Panels:
        return Panels(np.append(self.low, self.high[-1]), self.order, float(self._left.sum()))
