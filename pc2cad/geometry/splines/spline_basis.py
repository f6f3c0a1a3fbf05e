"""Values of B-splines over a knot vector."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.linear import product

#: rows that are multiplied at once
_BLOCK = 128


@dataclass(frozen=True, eq=False)
class SparseRows:
    """A matrix (rows, size) with the same few entries in every row, in NumPy alone.

    SciPy's matrices take a quarter of a second to load, which is much of a short command.

    Attributes:
        index: the columns of every row's entries, (rows, width); one that comes again is added
        values: the entries, (rows, width)
        size: number of columns

    """

    index: Integers
    values: Array
    size: int

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and of columns."""
        return len(self.index), self.size

    def __matmul__(self, dense: Array) -> Array:
        """Return the product with (size,), (size, k) or a stack of these: (rows,), (rows, k) ….

        Neighbours live in the same few columns: a block of rows is a small full matrix of those,
        and full matrices are multiplied fastest.
        """
        if len(self.index) == 0:
            return np.zeros((0, *dense.shape[1:]))
        axis = max(dense.ndim - 2, 0)
        found = [
            product(full, dense[..., low:high, :] if axis else dense[low:high])
            for _, low, high, full in self._blocks
        ]
        return found[0] if len(found) == 1 else np.concatenate(found, axis=axis)

    def transposed(self, dense: Array) -> Array:
        """Return the product of the matrix turned over with (rows, k): (size, k)."""
        result = np.zeros((self.size, dense.shape[1]))
        for rows, low, high, full in self._blocks:
            result[low:high] += product(full.T, dense[rows])
        return result

    @cached_property
    def _blocks(self) -> list[tuple[slice, int, int, Array]]:
        """Blocks of rows as full matrices of the columns from one to another."""
        found = []
        for start in range(0, len(self.index), _BLOCK):
            rows = slice(start, start + _BLOCK)
            index = self.index[rows]
            low = int(np.minimum.reduce(index, axis=None))
            size = int(np.maximum.reduce(index, axis=None)) + 1 - low
            full = _full(index - low, self.values[rows], size)
            found.append((rows, low, low + size, full))
        return found

    def toarray(self) -> Array:
        """Return the full matrix."""
        return _full(self.index, self.values, self.size)


def _full(index: Integers, values: Array, size: int) -> Array:
    flat = index + size * np.arange(len(index))[:, None]
    full = np.bincount(flat.ravel(), values.ravel(), minlength=len(flat) * size)
    return np.asarray(full.reshape(len(index), size), dtype=float)


def local_basis(knots: Array, degree: int, t: Array) -> tuple[Integers, Array]:
    """Return the first of the p+1 functions that live at each t, and their values (len(t), p+1).

    Values are sums of products of positive numbers.
    """
    first, values, _ = local_bases(knots, degree, t)
    return first, values


def local_bases(knots: Array, degree: int, t: Array) -> tuple[Integers, Array, Array]:
    """Return what `local_basis` does, and the values of one degree less, (len(t), p).

    Those belong to the knots without the first and the last, as the derivative does; their first
    function has the same number.
    """
    span = _spans(knots, degree, t)
    values, lower = _recursion(knots, degree, span, t)
    return span - degree, values, lower


def local_basis_of_two(
    degree: int, one: tuple[Array, Array], other: tuple[Array, Array]
) -> tuple[tuple[Integers, Array], tuple[Integers, Array]]:
    """Return `local_basis` of two knot vectors, each at places of its own, worked out together."""
    (knots, t), (more, x) = one, other
    span, beyond = _spans(knots, degree, t), _spans(more, degree, x)
    both = np.concatenate((knots, more)) if more is not knots else knots
    shift = len(knots) if more is not knots else 0
    places = np.concatenate((span, beyond + shift)), np.concatenate((t, x))
    values, _ = _recursion(both, degree, *places)
    return (span - degree, values[: len(t)]), (beyond - degree, values[len(t) :])


def _spans(knots: Array, degree: int, t: Array) -> Integers:
    """Return the number of the knot that each t follows."""
    span = knots.searchsorted(t, side="right") - 1
    return np.minimum(np.maximum(span, degree), len(knots) - degree - 2)


def _recursion(knots: Array, degree: int, span: Integers, t: Array) -> tuple[Array, Array]:
    """Return the values of a degree and of one less, of functions over the knots around `span`."""
    p = degree
    values, lower = np.ones((1, len(t))), np.empty((0, len(t)))
    steps = np.arange(1, p + 1)[:, None]
    # to the left of t the farthest knot comes first
    left, right = t - knots[span + 1 - steps[::-1]], knots[span + steps] - t
    for r in range(1, p + 1):
        lower, before, after = values, left[p - r :], right[:r]
        share = lower / (after + before)
        values = np.empty((r + 1, len(t)))
        np.multiply(after, share, out=values[:r])
        values[r] = 0.0
        values[1:] += before * share
    return values.T, lower.T


def spline_values(knots: Array, poles: Array, degree: int, t: Array) -> Array:
    """Return the values (len(t), k) of a spline with the poles (functions, k)."""
    return _summed(*local_basis(knots, degree, t), poles)


def spline_jets(
    knots: Array, poles: Array, net: Array, degree: int, t: Array
) -> tuple[Array, Array]:
    """Return the values of a spline, and of its derivative with the poles `net`, (len(t), k)."""
    first, values, lower = local_bases(knots, degree, t)
    return _summed(first, values, poles), _summed(first, lower, net)


def _summed(first: Integers, values: Array, poles: Array) -> Array:
    local = windows(poles, values.shape[1])[first]
    return np.asarray(np.einsum("ni,nik->nk", values, local))


def windows(poles: Array, *widths: int) -> Array:
    """Return a view of all runs of so many poles along the first axes: (…, *widths, k).

    Taking some of its rows is ten times faster than indexing every pole.
    """
    view = sliding_window_view(poles, widths, axis=tuple(range(len(widths))))
    return np.moveaxis(view, len(widths), -1)


def basis_matrix(knots: Array, degree: int, t: Array) -> SparseRows:
    """Return the values of all functions at t, (len(t), functions)."""
    return basis_matrices(knots, degree, t)[0]


def basis_matrices(knots: Array, degree: int, t: Array) -> tuple[SparseRows, SparseRows]:
    """Return what `basis_matrix` does, and the same of one degree less, of the inner knots."""
    first, values, lower = local_bases(knots, degree, t)
    index, size = first[:, None] + np.arange(degree + 1), len(knots) - degree - 1
    return SparseRows(index, values, size), SparseRows(index[:, :-1], lower, size - 1)
