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
from math import comb, factorial

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.geometry.splines.spline_basis import SparseRows, basis_matrix, local_basis
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
    def own(self) -> Integers:
        """As many places in each interval as it has poles of its own, and one more."""
        end = self.degree + 1 if self.seam is None else self.seam
        counts = np.concatenate(([end], self.multiplicities, [end]))
        return (counts[:-1] + counts[1:] + 1) // 2 + 1

    @cached_property
    def _rule(self) -> tuple[Array, Array]:
        """Sites, and their weights in the fit: 0 at the limits, which are met exactly."""
        p = self.degree
        # high degrees want a few in each interval
        own = self.own + (0 if p <= NORMAL_EQUATIONS else p // 2)
        lengths = np.diff(self.points)
        sites = np.empty(own.sum())
        weights = np.empty_like(sites)
        first = np.cumsum(own) - own
        for count in distinct(own):
            which = np.flatnonzero(own == count)
            at = first[which, None] + np.arange(count)
            places, share = _rule_on_interval(int(count), p)
            sites[at] = self.points[which, None] + lengths[which, None] * places
            weights[at] = lengths[which, None] * share
        limits = (0.0,) if self.periodic else (0.0, 1.0)
        sites = np.concatenate((limits[:1], sites, limits[1:]))
        zeros = np.zeros(len(limits))
        return sites, np.concatenate((zeros[:1], weights, zeros[1:]))

    # -- where fits are compared ---------------------------------------------------------------

    @cached_property
    def checks(self) -> tuple[Array, Integers]:
        """Ascending parameters at which a fit is compared, and where each interval's begin.

        They are the knots and several between.
        """
        own = 2 * self.own
        starts = np.cumsum(own) - own
        places = np.empty(own.sum() + 1)
        places[-1] = 1.0
        lengths = np.diff(self.points)
        for count in distinct(own):
            which = np.flatnonzero(own == count)
            shares = CHECKS if count == len(CHECKS) else np.arange(count) / count
            places[starts[which, None] + np.arange(count)] = (
                self.points[which, None] + lengths[which, None] * shares
            )
        return places, starts

    @property
    def check_places(self) -> Array:
        """The first of these."""
        return self.checks[0]

    @cached_property
    def check_basis(self) -> SparseRows:
        """The values of the clamped basis there."""
        return self.basis(self.check_places)

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
        sites, weights = self._rule
        owner: Integers
        if self.seam is None:
            first, values = local_basis(self.knots, self.degree, sites)
            owner, size = np.arange(self.size), self.size
        else:
            knots, owner = self._unclamped
            first, values = local_basis(knots, self.degree, sites)
            size = len(self._cycle)
        index = owner[first[:, None] + np.arange(self.degree + 1)]
        return projector(index, values, weights, size, self.degree, self.periodic)

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

    def _clamp(self, cyclic: Array) -> Array:
        """Insert knots at both ends until they have full multiplicity."""
        (knots, owner), p = self._unclamped, self.degree
        poles, backwards = cyclic[owner], 1.0 - knots[::-1]
        if len(poles) > 2 * p + 1:
            ends = np.stack((poles[: p + 1], poles[: -p - 2 : -1]))
            _clamp_start(np.stack((knots, backwards)), ends, p)
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
    # one triangle of means serves all: pole j is the last of what p - j rounds leave
    work = poles[:, : p + 1]
    for r in range(1, p + 1):
        left, right = knots[:, r : p + 1], knots[:, p + 1 : 2 * p + 2 - r]
        ratio = (-left / (right - left))[..., None]
        work = (1 - ratio) * work[:, :-1] + ratio * work[:, 1:]
        poles[:, p - r] = work[:, -1]
