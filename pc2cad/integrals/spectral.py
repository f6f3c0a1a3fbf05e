"""Rules and series over a whole direction: of polynomials between its ends, or of waves round it.

The nodes of Gauss-Lobatto rules hold both ends. Where a function comes round to itself, equal
weights at even places are as good as any rule.

*Source:* P. Davis, P. Rabinowitz, Methods of Numerical Integration (1984), 2.7 and 2.9;
J.-P. Berrut, L. Trefethen, Barycentric Lagrange interpolation (SIAM Review 46, 2004).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pc2cad.arrays import Array

#: steps between the places of a line from which its series are taken
STEPS = 256
#: the highest term of a series over a line that is taken for resolved
HIGHEST = 3 * STEPS // 4
#: the fewest nodes of a rule
LEAST = 8
#: steps of Newton's method towards the nodes: it begins near enough for five
_NEWTON = 8


@dataclass(frozen=True, eq=False)
class Rule:
    """Nodes and weights (n,) over [0, 1], the nodes ascending."""

    nodes: Array
    weights: Array
    #: whether functions come round to themselves, and the nodes leave out the ends
    round: bool

    def basis(self, places: Array) -> Array:
        """Return (m, n): what the function through values at the nodes makes of each, at places.

        That is a polynomial, or a sum of waves.
        """
        away = places[:, None] - self.nodes
        count = len(self.nodes)
        if self.round:
            sine = np.sin(np.pi * away)
            last = np.cos(np.pi * away) if count % 2 == 0 else 1.0
            there = np.abs(sine) < 1e-15
            values = np.sin(count * np.pi * away) * last / (count * np.where(there, 1.0, sine))
            return np.asarray(np.where(there, 1.0, values))
        there = away == 0.0
        share = np.sqrt(self.weights) * (1.0 - 2.0 * (np.arange(count) % 2))
        share = share / np.where(there, 1.0, away)
        share = np.where(there.any(axis=1, keepdims=True), there, share)
        return np.asarray(share / share.sum(axis=1, keepdims=True))

    def last_term(self, values: Array, least: float) -> int:
        """Return the last term above `least` of the series of values (…, n) at places of `spread`.

        That is the degree of a Chebyshev polynomial, or a number of waves.
        """
        rows = values.reshape(-1, values.shape[-1])
        if self.round:
            sizes = 2 * np.abs(np.fft.rfft(rows)) / STEPS
        else:
            there_and_back = np.concatenate((rows, rows[:, -2:0:-1]), axis=1)
            sizes = np.abs(np.fft.rfft(there_and_back).real) / STEPS
        above = np.flatnonzero(sizes.max(axis=0) > least)
        return int(above[-1]) if len(above) else 0


@lru_cache(maxsize=64)
def lobatto(count: int) -> Rule:
    """Return the rule of so many nodes (at least 2), both ends among them, exact to 2 count - 3."""
    degree = count - 1
    x = -np.cos(np.pi * np.arange(count) / degree)
    for _ in range(_NEWTON):
        before, last = _legendre(degree, x)
        x = x - (x * last - before) / (count * last)
    x = (x - x[::-1]) / 2
    _, last = _legendre(degree, x)
    return _kept((1 + x) / 2, 1 / (degree * count * last * last), False)


@lru_cache(maxsize=64)
def even(count: int) -> Rule:
    """Return so many even places with equal weights: exact for fewer waves than these."""
    return _kept((np.arange(count) + 0.5) / count, np.full(count, 1 / count), True)


@lru_cache(maxsize=2)
def spread(comes_round: bool) -> Rule:
    """Return the places of a line, from values at which series are taken, with weights.

    Round a direction they are even, between two ends those of Clenshaw and Curtis.
    """
    if comes_round:
        return even(STEPS)
    k = np.arange(STEPS + 1)
    moments = np.zeros(STEPS + 1)
    moments[::2] = 1 / (1.0 - k[::2] ** 2)
    weights = np.fft.irfft(moments, 2 * STEPS)[: STEPS + 1]
    weights[1:-1] *= 2
    return _kept((1 - np.cos(np.pi * k / STEPS)) / 2, weights, False)


def _legendre(degree: int, x: Array) -> tuple[Array, Array]:
    """Return Legendre's polynomials of one degree less and of a degree."""
    before, last = np.ones_like(x), x
    for n in range(2, degree + 1):
        before, last = last, ((2 * n - 1) * x * last - (n - 1) * before) / n
    return before, last


def _kept(nodes: Array, weights: Array, comes_round: bool) -> Rule:
    nodes.flags.writeable = weights.flags.writeable = False
    return Rule(nodes, weights, comes_round)
