"""Values of B-splines over a knot vector."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from pc2cad.arrays import Array, Integers


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


def spline_values(knots: Array, poles: Array, degree: int, t: Array) -> Array:
    """Return the values (len(t), k) of a spline with the poles (functions, k)."""
    first, values = local_basis(knots, degree, t)
    local = poles[first[:, None] + np.arange(degree + 1)]
    return np.asarray(np.einsum("ni,nik->nk", values, local))


def basis_matrix(knots: Array, degree: int, t: Array) -> csr_array:
    """Return the values of all functions at t, (len(t), functions)."""
    first, values = local_basis(knots, degree, t)
    return sparse_rows(first[:, None] + np.arange(degree + 1), values, len(knots) - degree - 1)


def sparse_rows(index: Integers, values: Array, size: int) -> csr_array:
    """Return the matrix whose row i has `values[i]` in the columns `index[i]`."""
    count, width = index.shape
    starts = np.arange(0, count * width + 1, width)
    return csr_array((values.ravel(), index.ravel(), starts), shape=(count, size))
