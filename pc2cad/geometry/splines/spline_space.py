"""Univariate spline spaces on [0, 1] and projection into them.

A fit is a linear operator per direction that meets the limits exactly, so a tensor-product fit
restricted to a boundary line is the fit of that line: faces that use one space along a common edge
agree on it pole for pole.

Between the limits it is the least-squares fit to two places per interval, the zeros of the
Bernoulli polynomial that the error of the best spline follows. Interpolation at the knots would
leave twice the error, and on one side of the function; the projection's error oscillates about
zero, and integrals over the fit (volume, area) are right to far more digits than its poles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from itertools import pairwise
from math import comb, factorial
from typing import NamedTuple

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.geometry.splines.spline_basis import SparseRows, basis_matrix, local_basis_of_two
from pc2cad.geometry.splines.spline_projection import NORMAL_EQUATIONS, projector

#: fractions of a simple interval where a fit is compared with its function: best splines deviate
#: most at knots and half-way (even degrees: at the quarters)
CHECKS = np.array([0.0, 0.27, 0.5, 0.73])


class SplineSpace:
    """Splines of one degree over strictly ascending points with multiplicities.

    ``points`` run from 0 to 1; ``multiplicities`` belong to the interior points. A periodic space
    has in addition the multiplicity of the seam, ``seam`` (1 for the smoothest).
    """

    def __init__(
        self,
        degree: int,
        points: Sequence[float] | Array,
        multiplicities: Sequence[int] | None = None,
        seam: int | None = None,
    ) -> None:
        self.degree = degree
        self.points = np.asarray(points, dtype=float)
        self.multiplicities = np.asarray(
            np.ones(len(self.points) - 2, dtype=int) if multiplicities is None else multiplicities,
            dtype=int,
        )
        self.seam = seam
        inner = np.repeat(self.points[1:-1], self.multiplicities)
        ends = degree + 1
        self.knots: Array = np.concatenate((np.zeros(ends), inner, np.ones(ends)))

    def reversed(self) -> SplineSpace:
        """Return the space of the same functions of 1 - t."""
        return SplineSpace(self.degree, 1 - self.points[::-1], self.multiplicities[::-1].tolist())

    @property
    def periodic(self) -> bool:
        """True where value and derivatives agree at the two ends."""
        return self.seam is not None

    @property
    def size(self) -> int:
        """Number of poles (of the clamped form)."""
        return len(self.knots) - self.degree - 1

    @property
    def sites(self) -> Array:
        """Places (ascending) whose values a fit needs; the limits are among them."""
        return self._rule[0]

    @cached_property
    def _pattern(self) -> _Pattern:
        return _pattern(self.degree, self.multiplicities.tobytes(), self.seam)

    @cached_property
    def _lengths(self) -> Array:
        return np.asarray(self.points[1:] - self.points[:-1])

    @cached_property
    def _rule(self) -> tuple[Array, Array]:
        """Sites, and their weights in the fit: 0 at the limits, which are met exactly."""
        interval, places, shares = self._pattern.rule
        length = self._lengths[interval]
        sites = self.points[interval] + length * places
        if not self.periodic:
            sites[-1] = 1.0
        return sites, length * shares

    # -- where fits are compared ---------------------------------------------------------------

    @cached_property
    def checks(self) -> tuple[Array, Integers]:
        """Ascending parameters at which a fit is compared, and where each interval's begin.

        They are the knots and several between.
        """
        interval, shares, starts = self._pattern.checks
        places = self.points[interval] + self._lengths[interval] * shares
        places[-1] = 1.0
        return places, starts

    @property
    def check_places(self) -> Array:
        """The first of these."""
        return self.checks[0]

    @cached_property
    def check_basis(self) -> SparseRows:
        """The values of the clamped basis there."""
        first, values = self._bases[1]
        return SparseRows(first[:, None] + np.arange(self.degree + 1), values, self.size)

    @cached_property
    def _bases(self) -> tuple[tuple[Integers, Array], tuple[Integers, Array]]:
        """The basis that is fitted with at the sites, and the clamped one at the checks."""
        fitted = self.knots if self.seam is None else self._unclamped[0]
        return local_basis_of_two(
            self.degree, (fitted, self._rule[0]), (self.knots, self.check_places)
        )

    # -- the periodic basis --------------------------------------------------------------------

    @cached_property
    def _cycle(self) -> Array:
        """Knots of one period from the seam on."""
        inner = np.repeat(self.points[1:-1], self.multiplicities)
        return np.concatenate((np.zeros(self.seam or 0), inner))

    def _cyclic_knots(self, index: Integers) -> Array:
        n = len(self._cycle)
        return self._cycle[index % n] + index // n

    @cached_property
    def _unclamped(self) -> tuple[Array, Integers]:
        """Knots of the periodic basis over [0, 1], and the coefficient each function belongs to."""
        n, p, seam = len(self._cycle), self.degree, self.seam or 0
        functions = np.arange(seam - p - 1, n)
        return self._cyclic_knots(np.arange(seam - p - 1, n + p + 1)), functions % n

    # -- fits ----------------------------------------------------------------------------------

    def basis(self, t: Array) -> SparseRows:
        """Return the values of the clamped basis at t, (len(t), size)."""
        return basis_matrix(self.knots, self.degree, t)

    @cached_property
    def _projector(self) -> Callable[[Array], Array]:
        first, values = self._bases[0]
        index = first[:, None] + np.arange(self.degree + 1)
        size = self.size
        if self.seam is not None:
            index, size = self._unclamped[1][index], len(self._cycle)
        return projector(index, values, self._rule[1], size, self.degree, self.periodic)

    def fit(self, values: Array) -> Array:
        """Return clamped poles of the projection: values (sites, …) to poles (size, …)."""
        flat = np.ascontiguousarray(values.reshape(len(self.sites), -1))
        poles = self._projector(flat)
        if self.seam is not None:
            poles = self._clamp(poles)
            poles[0] = poles[-1] = flat[0]
        else:
            poles[0], poles[-1] = flat[0], flat[-1]
        return poles.reshape(self.size, *values.shape[1:])

    def fit_each(self, curves: Array) -> Array:
        """Return what `fit` does of each of several curves, (k, sites, 3) to (k, size, 3)."""
        flat = np.ascontiguousarray(curves)
        poles = self._projector(flat)
        if self.seam is not None:
            columns = self._clamp(np.concatenate(list(poles), axis=1))
            poles = np.stack(np.split(columns, len(flat), axis=1))
            poles[:, 0] = poles[:, -1] = flat[:, 0]
        else:
            poles[:, 0], poles[:, -1] = flat[:, 0], flat[:, -1]
        return poles

    def _clamp(self, cyclic: Array) -> Array:
        """Insert knots at both ends until they have full multiplicity."""
        (knots, owner), p = self._unclamped, self.degree
        poles, backwards = cyclic[owner], 1.0 - knots[::-1]
        if len(poles) > 2 * p + 1:
            ends = np.array((poles[: p + 1], poles[: -p - 2 : -1]))
            _clamp_start(np.array((knots, backwards)), ends, p)
            poles[: p + 1], poles[: -p - 2 : -1] = ends
            return poles
        # the ends of a short cycle reach into one another
        _clamp_start(knots[None], poles[None], p)
        backwards[-p - 1 :] = 1.0
        _clamp_start(backwards[None], poles[None, ::-1], p)
        return poles


def bezier_space(degree: int) -> SplineSpace:
    """Return the space of polynomials of a degree."""
    return SplineSpace(max(degree, 1), (0.0, 1.0))


@lru_cache
def smallest_error(degree: int) -> float:
    """Return the constant c of the error c |f^(p+1)| h^(p+1) of the best spline on equal knots."""
    t = np.linspace(0.0, 0.5, 101)
    return float(np.abs(_bernoulli(degree + 1)(t)).max()) / factorial(degree + 1)


@lru_cache
def _bernoulli(order: int) -> np.polynomial.Polynomial:
    numbers = [1.0]
    for m in range(1, order + 1):
        numbers.append(-sum(comb(m + 1, k) * numbers[k] for k in range(m)) / (m + 1))
    return np.polynomial.Polynomial([comb(order, k) * numbers[order - k] for k in range(order + 1)])


@lru_cache
def _rule_on_interval(count: int, degree: int) -> tuple[Array, Array]:
    """Return places in [0, 1] and weights: the zeros of the error for two, else Gauss nodes."""
    if count > 2:
        nodes, weights = np.polynomial.legendre.leggauss(count)
        return (nodes + 1) / 2, weights / 2
    if degree % 2 == 0:
        # zeros at the knots and between them: the later knot is the next interval's
        return np.array([0.0, 0.5]), np.array([0.5, 0.5])
    polynomial, low, high = _bernoulli(degree + 1), 0.0, 0.5
    sign = np.sign(polynomial(low))
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if np.sign(polynomial(middle)) == sign else (low, middle)
    return np.array([low, 1 - low]), np.array([0.5, 0.5])


def _clamp_start(knots: Array, poles: Array, degree: int) -> None:
    """Change poles (k, n, …) to those over the same knots (k, …), but for the first p + 1, now 0.

    They belong to functions over knots[0:p+2], knots[1:p+3], …; knots[p] is 0 already. Pole j
    becomes the blossom of p - j times 0 and the j knots after it, taken from poles that know these
    j knots: every step is a mean.
    """
    p = degree
    low, high, rounds = _triangle(p)
    left = knots[:, low]
    ratio = (-left / (knots[:, high] - left))[..., None]
    rest = 1 - ratio
    # one triangle of means serves all: pole j is the last of what p - j rounds leave
    work = poles[:, : p + 1]
    for r, these in enumerate(rounds, 1):
        work = rest[:, these] * work[:, :-1] + ratio[:, these] * work[:, 1:]
        poles[:, p - r] = work[:, -1]


@lru_cache
def _triangle(degree: int) -> tuple[Integers, Integers, tuple[slice, ...]]:
    """Return the knots left and right of 0 that means are taken between, and those of each round.

    Of p + 1 poles the first round leaves p, the next one p - 1.
    """
    p = degree
    counts = range(p, 0, -1)
    low = np.concatenate([np.arange(p + 1 - n, p + 1) for n in counts])
    high = np.concatenate([np.arange(p + 1, p + 1 + n) for n in counts])
    ends = np.cumsum([0, *counts]).tolist()
    return low, high, tuple(slice(a, b) for a, b in pairwise(ends))


class _Pattern(NamedTuple):
    """Where a space's sites and checks are in its intervals, however long these are."""

    #: of each site its interval, its place there and its share of the interval's weight
    rule: tuple[Integers, Array, Array]
    #: of each check its interval and its place there, and of each interval its first check
    checks: tuple[Integers, Array, Integers]


@lru_cache(maxsize=64)
def _pattern(degree: int, multiplicities: bytes, seam: int | None) -> _Pattern:
    """Return the pattern of a space with these multiplicities (of its inner points, 64 bits)."""
    end = degree + 1 if seam is None else seam
    counts = np.concatenate(([end], np.frombuffer(multiplicities, dtype=int), [end]))
    # as many places in each interval as it has poles of its own, and one more
    own = (counts[:-1] + counts[1:] + 1) // 2 + 1
    # high degrees want a few in each interval
    sites = own + (0 if degree <= NORMAL_EQUATIONS else degree // 2)
    rules = [_rule_on_interval(int(count), degree) for count in sites]
    zero, each = np.zeros(1), np.arange(len(own))
    # a periodic space has its second limit in the first
    close = [zero] if seam is None else []
    rule = (
        np.concatenate((each[:1], np.repeat(each, sites), each[-1:][: len(close)])),
        np.concatenate((zero, *(places for places, _ in rules), *close)),
        np.concatenate((zero, *(shares for _, shares in rules), *close)),
    )
    checks = 2 * own
    shares = [CHECKS if n == len(CHECKS) else np.arange(n) / n for n in checks.tolist()]
    return _Pattern(
        rule,
        (
            np.concatenate((np.repeat(each, checks), each[-1:])),
            np.concatenate((*shares, zero)),
            np.cumsum(checks) - checks,
        ),
    )
