"""Tables of the basis functions of splines at places, and what poles are by these."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.linear import product, tensor
from pc2cad.geometry.splines.spline_basis import SparseRows, basis_matrices

#: basis functions up to which matrices are dense
DENSE = 48
#: a matrix of functions at places
Table = Array | SparseRows


def bases(t: Array, knots: Array, degree: int) -> list[Table]:
    """Return the values at t of all basis functions, and of those of the derivative's poles.

    Sparse where there are many.
    """
    return _known_bases(t.tobytes(), knots.tobytes(), degree)


@lru_cache(maxsize=16)  # both sides of a wall, and its ends, have their knots in common
def _known_bases(places: bytes, knots: bytes, degree: int) -> list[Table]:
    tables = basis_matrices(np.frombuffer(knots), degree, np.frombuffer(places))
    return [table.toarray() if table.shape[1] <= DENSE else table for table in tables]


def times(table: Table, flat: Array) -> Array:
    """Return the product with poles (functions, k)."""
    return product(table, flat) if isinstance(table, np.ndarray) else table @ flat


def part_of(table: Table, rows: slice | Integers) -> Table:
    """Return some of the rows."""
    if isinstance(table, np.ndarray):
        return table[rows]
    return SparseRows(table.index[rows], table.values[rows], table.size)


def summing(a: Table, poles: Array, b: Table) -> Callable[[Any], Array]:
    """Return what takes parts of a to the values (k, p, q) of Σ a_pi b_qj P_kij."""
    k, n, m = poles.shape
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return tensor(len(a), poles, b)
    across = times(b, poles.reshape(-1, m).T).T.reshape(k, n, -1).transpose(1, 0, 2).reshape(n, -1)

    def sums(part: Table) -> Array:
        values = times(part, across).reshape(part.shape[0], k, -1)
        return np.ascontiguousarray(values.transpose(1, 0, 2))

    return sums
