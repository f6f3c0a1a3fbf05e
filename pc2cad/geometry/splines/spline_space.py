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
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.linalg.lapack import dtbtrs
from scipy.sparse import csr_array

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.linear import inverse, product, solve

#: up to this degree normal equations and one step of refinement hold all digits
_NORMAL_EQUATIONS = 9
#: up to this size full matrices cost less than banded ones, and hold all digits where no interval
#: is shorter than this share of another
_SMALL, _SHORTEST = 64, 1e-4


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
        own = self.own + (0 if p <= _NORMAL_EQUATIONS else p // 2)
        lengths = np.diff(self.points)
        sites = np.empty(own.sum())
        weights = np.empty_like(sites)
        first = np.cumsum(own) - own
        for count in np.unique(own):
            which = np.flatnonzero(own == count)
            at = first[which, None] + np.arange(count)
            places, share = _rule_on_interval(int(count), p)
            sites[at] = self.points[which, None] + lengths[which, None] * places
            weights[at] = lengths[which, None] * share
        limits = (0.0,) if self.periodic else (0.0, 1.0)
        sites = np.concatenate((limits[:1], sites, limits[1:]))
        zeros = np.zeros(len(limits))
        return sites, np.concatenate((zeros[:1], weights, zeros[1:]))

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

    def basis(self, t: Array) -> csr_array:
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
        return _projector(index, values, weights, size, self.degree, self.periodic)

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
        knots, owner = self._unclamped
        poles = _clamp_start(knots, cyclic[owner], self.degree)
        backwards = 1.0 - knots[::-1]
        backwards[-self.degree - 1 :] = 1.0
        return _clamp_start(backwards, poles[::-1], self.degree)[::-1].copy()


def bezier_space(degree: int) -> SplineSpace:
    """Return the space of polynomials of a degree."""
    return SplineSpace(max(degree, 1), (0.0, 1.0))


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


def local_basis(knots: Array, degree: int, t: Array) -> tuple[Integers, Array]:
    """Return the first of the p+1 functions that live at each t, and their values (len(t), p+1).

    Values are sums of products of positive numbers.
    """
    p = degree
    span = np.clip(np.searchsorted(knots, t, side="right") - 1, p, len(knots) - p - 2)
    values = np.empty((p + 1, len(t)))
    values[0] = 1.0
    left = [t - knots[span + 1 - r] for r in range(1, p + 1)]
    right = [knots[span + r] - t for r in range(1, p + 1)]
    for r in range(1, p + 1):
        carried = np.zeros(len(t))
        for k in range(r):
            share = values[k] / (right[k] + left[r - 1 - k])
            values[k] = carried + right[k] * share
            carried = left[r - 1 - k] * share
        values[r] = carried
    return span - p, values.T


def basis_matrix(knots: Array, degree: int, t: Array) -> csr_array:
    """Return the values of all functions at t, (len(t), functions)."""
    first, values = local_basis(knots, degree, t)
    return _rows(first[:, None] + np.arange(degree + 1), values, len(knots) - degree - 1)


def _rows(index: Integers, values: Array, size: int) -> csr_array:
    count, width = index.shape
    starts = np.arange(0, count * width + 1, width)
    return csr_array((values.ravel(), index.ravel(), starts), shape=(count, size))


def _projector(
    index: Integers, values: Array, weights: Array, size: int, degree: int, cyclic: bool
) -> Callable[[Array], Array]:
    """Return the map from values at sites to coefficients.

    Row i of the design matrix has `values[i]` in the columns `index[i]`. Rows of weight 0 are
    equations that hold exactly (by multipliers), the others are met in the least-squares sense.
    """
    inner = weights[weights > 0]
    is_even = inner.min() >= _SHORTEST * inner.max()
    if size <= _SMALL and is_even and degree <= _NORMAL_EQUATIONS:
        return _by_matrix(index, values, weights, size)
    design = _rows(index, values, size)
    limits = np.flatnonzero(weights == 0)
    exact = design[limits].toarray()
    if degree <= _NORMAL_EQUATIONS:
        by, multiply = _by_cholesky(design, index, values, weights, size, cyclic)
    else:
        by, multiply = _by_triangle(index, values, weights, size, cyclic)
    correction = multiply(exact.T)
    correction = solve(product(exact, correction).T, correction.T).T

    def project(flat: Array) -> Array:
        result: Array = np.zeros((size, flat.shape[1]))
        for _ in range(2):
            rest = flat - design @ result
            step = by(rest)
            result += step - product(correction, product(exact, step) - rest[limits])
        return result

    return project


_Solve = Callable[[Array], Array]


def _by_matrix(
    index: Integers, values: Array, weights: Array, size: int
) -> Callable[[Array], Array]:
    """Return the map of `_projector` as one full matrix, from the equations with multipliers."""
    count = len(index)
    place = index + size * np.arange(count)[:, None]
    design = np.bincount(place.ravel(), values.ravel(), minlength=count * size)
    design = design.reshape(count, size)
    limits = np.flatnonzero(weights == 0)
    # functions over short intervals have small weights: they are made alike first
    scale = 1 / np.sqrt(product(weights, design * design))
    scaled = design * scale
    adjoint = scaled.T * weights
    full = np.zeros((size + len(limits),) * 2)
    full[:size, :size] = product(adjoint, scaled)
    full[size:, :size] = scaled[limits]
    full[:size, size:] = scaled[limits].T
    rows = inverse(full)[:size] * scale[:, None]
    matrix = product(rows[:, :size], adjoint)
    matrix[:, limits] = rows[:, size:]

    def project(flat: Array) -> Array:
        result = product(matrix, flat)
        return result + product(matrix, flat - product(design, result))

    return project


def _order(size: int, cyclic: bool) -> Integers:
    """Return the rows that unknowns get: those of a cycle are taken alternately from both ends."""
    order = np.arange(size)
    if cyclic:
        order = np.where(order < (size + 1) // 2, 2 * order, 2 * (size - order) - 1)
    return order


def _by_cholesky(
    design: csr_array, index: Integers, values: Array, weights: Array, size: int, cyclic: bool
) -> tuple[_Solve, _Solve]:
    """Return r ↦ (BᵀWB)⁻¹BᵀWr and b ↦ (BᵀWB)⁻¹b by a banded factorisation.

    A cyclic matrix is banded, twice as wide, when its rows are taken alternately from both ends.
    """
    order = _order(size, cyclic)
    place = order[index]
    row, column = place[:, :, None], place[:, None, :]
    product = values[:, :, None] * (values * weights[:, None])[:, None, :]
    lower = row >= column
    offsets = (row - column)[lower]
    width = int(offsets.max()) + 1
    flat = offsets * size + np.broadcast_to(column, lower.shape)[lower]
    band = np.bincount(flat, product[lower], minlength=width * size).reshape(width, size)
    factor = (cholesky_banded(band, lower=True, check_finite=False), True)
    back = np.argsort(order)
    adjoint = csr_array((design * weights[:, None]).T)

    def multiply(right: Array) -> Array:
        solved = cho_solve_banded(factor, right[back], check_finite=False)
        return np.asarray(solved[order])

    return (lambda rest: multiply(adjoint @ rest)), multiply


def _by_triangle(
    index: Integers, values: Array, weights: Array, size: int, cyclic: bool
) -> tuple[_Solve, _Solve]:
    """Return the same maps by an orthogonal factorisation, for high degrees.

    Householder's reflections of a banded matrix touch few rows and columns each: one after the
    other they cost less than those of a full matrix.
    """
    order = _order(size, cyclic)
    place, roots = order[index], np.sqrt(weights)[:, None]
    sorting = np.argsort(place.min(axis=1), kind="stable")
    place = place[sorting]
    table = np.zeros((len(index), size))
    # a short cycle has one function several times in an interval
    np.add.at(table, (np.arange(len(place))[:, None], place), (values * roots)[sorting])
    reflections = _reflect(table, place.min(axis=1), np.maximum.accumulate(place.max(axis=1)) + 1)
    width = max(int(np.flatnonzero(row)[-1]) - k for k, row in enumerate(table[:size])) + 1
    band = np.zeros((width, size))
    for k in range(width):
        band[width - 1 - k, k:] = np.diagonal(table[:size], k)
    back = np.argsort(order)

    def multiply(right: Array) -> Array:
        solved = _triangle(band, _triangle(band, right[back], trans=1))
        return np.asarray(solved[order])

    def solve(rest: Array) -> Array:
        turned = (roots * rest)[sorting]
        for k, end, vector in reflections:
            turned[k:end] -= vector[:, None] * product(2 * vector, turned[k:end])
        return np.asarray(_triangle(band, turned[:size])[order])

    return solve, multiply


def _reflect(table: Array, first: Integers, last: Integers) -> list[tuple[int, int, Array]]:
    """Make a matrix triangular, in place; return the rows and the unit normal of each mirror.

    Row i has entries from column first[i], ascending, and no row up to it any from last[i] on.
    """
    found = []
    for k in range(table.shape[1]):
        end = max(int(np.searchsorted(first, k, side="right")), k + 1)
        vector = table[k:end, k].copy()
        vector[0] += np.copysign(np.sqrt((vector * vector).sum()), vector[0])
        vector /= np.sqrt((vector * vector).sum())
        part = table[k:end, k : last[end - 1]]
        part -= vector[:, None] * product(2 * vector, part)
        table[k + 1 : end, k] = 0.0
        found.append((k, end, vector))
    return found


def _triangle(band: Array, right: Array, trans: int = 0) -> Array:
    """Return the solution of a banded upper triangle, or of its transpose, column by column."""
    solved, singular = dtbtrs(band, right, uplo="U", trans="T" if trans else "N")
    if singular:
        raise np.linalg.LinAlgError("Singular matrix")
    return np.asarray(solved)


def _clamp_start(knots: Array, poles: Array, degree: int) -> Array:
    """Return the poles over the same knots, but for the first p + 1, which become 0.

    `poles` belong to functions over knots[0:p+2], knots[1:p+3], …; knots[p] is 0 already. Pole j
    of the result is the blossom of p - j times 0 and the j knots after it, taken from poles that
    know these j knots: every step is a mean.
    """
    p = degree
    result = poles.copy()
    # one triangle of means serves all: pole j is the last of what p - j rounds leave
    work = poles[: p + 1]
    for r in range(1, p + 1):
        left, right = knots[r : p + 1], knots[p + 1 : 2 * p + 2 - r]
        ratio = (-left / (right - left))[:, None]
        work = (1 - ratio) * work[:-1] + ratio * work[1:]
        result[p - r] = work[-1]
    return result
