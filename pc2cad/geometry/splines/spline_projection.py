"""Least-squares projection into a spline space, with equations that hold exactly.

Small spaces get one full matrix, others a banded factorisation: of the normal equations where the
degree leaves them all digits, of the design matrix itself where it does not.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.linear import inverse, product, solve
from pc2cad.geometry.splines.spline_basis import SparseRows

#: up to this degree normal equations and one step of refinement hold all digits
NORMAL_EQUATIONS = 9
#: up to this size full matrices cost less than banded ones, and hold all digits where no interval
#: is shorter than this share of another
_SMALL, _SHORTEST = 64, 1e-4
#: rows of a block of a banded matrix
_BLOCK = 32


def projector(
    index: Integers, values: Array, weights: Array, size: int, degree: int, cyclic: bool
) -> Callable[[Array], Array]:
    """Return the map from values at sites to coefficients, (sites, n) or of each of a stack.

    Row i of the design matrix has `values[i]` in the columns `index[i]`. Rows of weight 0 are
    equations that hold exactly (by multipliers), the others are met in the least-squares sense.
    """
    inner = weights[weights > 0]
    is_even = inner.min() >= _SHORTEST * inner.max()
    if size <= _SMALL and is_even and degree <= NORMAL_EQUATIONS:
        return _by_matrix(index, values, weights, size)
    design = SparseRows(index, values, size)
    limits = np.flatnonzero(weights == 0)
    exact = SparseRows(index[limits], values[limits], size).toarray()
    if degree <= NORMAL_EQUATIONS:
        by, multiply = _by_cholesky(index, values, weights, size, cyclic)
    else:
        by, multiply = _by_triangle(index, values, weights, size, cyclic)
    correction = multiply(exact.T)
    correction = solve(product(exact, correction).T, correction.T).T

    def project(flat: Array) -> Array:
        if flat.ndim > 2:
            return np.stack([project(curve) for curve in flat])
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
    """Return the map of `projector` as one full matrix, from the equations with multipliers."""
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
    index: Integers, values: Array, weights: Array, size: int, cyclic: bool
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
    solved_by = _band_solver(np.asarray(band, dtype=float))
    back = np.argsort(order)
    design = SparseRows(index, values * weights[:, None], size)

    def multiply(right: Array) -> Array:
        return solved_by(right[back])[order]

    return (lambda rest: multiply(design.transposed(rest))), multiply


def _band_solver(band: Array) -> _Solve:
    """Return b ↦ A⁻¹b of a positive definite matrix with the lower diagonals `band`, (width, n).

    Blocks no smaller than the band are beside the diagonal at most: Cholesky's factorisation of
    such a matrix is one of small full matrices. SciPy's of a band goes column by column, and takes
    a quarter of a second to load.
    """
    width, n = band.shape
    side = max(_BLOCK, width - 1)
    count = -(-n // side)
    # what is on the diagonal, rows added to the last block included, and what is below it
    blocks = np.stack((np.tile(np.eye(side), (count, 1, 1)), np.zeros((count, side, side))))
    for k, diagonal in enumerate(band):
        column = np.arange(n - k)
        block, row = column // side, (column + k) % side
        lower = (column + k) // side - block
        blocks[lower, block, row, column % side] = diagonal[: n - k]
    inverses, below = [], []
    rest = np.zeros((side, side))
    for square, beside in zip(*blocks, strict=True):
        # of which the lower half is read
        inverses.append(inverse(np.linalg.cholesky(square - rest)))
        below.append(product(beside, inverses[-1].T))
        rest = product(below[-1], below[-1].T)

    def solved(right: Array) -> Array:
        result = np.zeros((count + 1, side, right.shape[1]))
        result[:count].reshape(-1, right.shape[1])[:n] = right
        for i, (own, lower) in enumerate(zip(inverses, below, strict=True)):
            result[i] = product(own, result[i])
            result[i + 1] -= product(lower, result[i])
        for i in range(count - 1, -1, -1):
            after = result[i] - product(below[i].T, result[i + 1]) if i + 1 < count else result[i]
            result[i] = product(inverses[i].T, after)
        return np.asarray(result[:count].reshape(-1, right.shape[1])[:n])

    return solved


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
    from scipy.linalg.lapack import dtbtrs

    solved, singular = dtbtrs(band, right, uplo="U", trans="T" if trans else "N")
    if singular:
        raise np.linalg.LinAlgError("singular matrix")
    return np.asarray(solved)
