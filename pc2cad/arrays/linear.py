"""Products and solutions of matrices whose last bits do not depend on the number of threads.

A BLAS that shares a product among threads cuts it up by their number, and other cuts round
differently: 1e-16 of a matrix of fits becomes 1e-9 of its knots. Small products it gives to one
thread. So larger ones are taken here in blocks of a fixed size, each too small to be shared.
Nothing is set for the process; products of vectors, which need no BLAS, go without it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pc2cad.arrays import Array

#: multiplications of a product that OpenBLAS gives to one thread, whatever their number
#: (``SMP_THRESHOLD_MIN * GEMM_MULTITHREAD_THRESHOLD`` of its ``interface/gemm.c``)
ONE_THREAD = 2**18
#: largest side of a block
BLOCK = 64
#: size up to which a matrix is factorised by LAPACK, and entries of a right side that it is given:
#: from 10,000 on, that of OpenBLAS may share either
_SMALL, _ONE_THREAD_OF_LAPACK = 72, 2**13
#: columns that are eliminated before the rest of a matrix is brought up to date
_PANEL = 32


def symmetric(pairs: Iterable[tuple[int, int]], values: Iterable[float]) -> Array:
    """Return the matrix (3, 3) of which a value stands at each pair and at its mirror image."""
    result = np.empty((3, 3))
    for (i, j), value in zip(pairs, values, strict=True):
        result[i, j] = result[j, i] = value
    return result


def cross(a: Array, b: Array) -> Array:
    """Return a × b of vectors (…, 3), coordinate by coordinate: np.cross takes thrice as long."""
    # NumPy looks long for the shape that both have
    result = np.empty(a.shape if a.shape == b.shape else np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.subtract(a[..., j] * b[..., k], a[..., k] * b[..., j], out=result[..., i])
    return result


def dots(a: Array, b: Array) -> Array:
    """Return the products of vectors (…, 3), the same bits however they lie in memory.

    Where they are many, np.einsum takes thrice as long; its order of adding is kept.
    """
    shares = a * b
    total = shares[..., 0] + shares[..., 2]
    total += shares[..., 1]
    return np.asarray(total)


def squares(vectors: Array) -> Array:
    """Return the squares of the lengths of vectors (…, 3), added in the order of `np.sum`.

    That takes ten times as long where the last axis is so short.
    """
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    total = x * x
    total += y * y
    total += z * z
    return np.asarray(total)


def heights(vectors: Array, axes: Array) -> Array:
    """Return the products (n, k) of vectors (n, k, 3) with an axis (n, 3) for each row of them."""
    return np.asarray((vectors @ axes[..., None])[..., 0])


def lengths(vectors: Array) -> Array:
    """Return the lengths of vectors (…, 3)."""
    return np.asarray(np.sqrt(dots(vectors, vectors)))


def thickness(vectors: Array) -> tuple[float, float]:
    """Return a lower bound of the least singular value of vectors (n, 3), and their size.

    The size is the root of the sum of all squares, which no singular value exceeds. The bound is 0
    where rounding leaves none; else it spares the singular values, which take ten times as long.
    """
    (a, b, c), (_, d, e), (_, _, f) = product(vectors.T, vectors).tolist()
    trace = a + d + f
    # the three squares' product; two of them are at most (trace / 2)² together
    squared = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    squared -= 4e-15 * (len(vectors) + 8) * trace * trace * trace
    least = 2 * sqrt(squared) / trace if 0 < squared < inf else 0.0
    return least * (1 - 1e-9), sqrt(trace)


def areas(a: Array, b: Array) -> Array:
    """Return |a × b| of vectors (…, 3): what `lengths` of `cross` are, without these vectors."""
    (p, q, r), (x, y, z) = ((m[..., 0], m[..., 1], m[..., 2]) for m in (a, b))
    u, v, w = q * z - r * y, r * x - p * z, p * y - q * x
    u *= u
    v *= v
    w *= w
    u += w
    u += v
    return np.asarray(np.sqrt(u, out=u))


def unit(vectors: Array) -> Array:
    """Return vectors (…, 3) at length 1; those of no length stay."""
    length = lengths(vectors)
    return np.asarray(vectors / np.where(length > 0, length, 1.0)[..., None])


def product(a: NDArray[Any], b: NDArray[Any]) -> Array:
    """Return a @ b of vectors and matrices, or of one matrix with each of a stack."""
    if a.ndim == 1 or b.ndim == 1:
        return vectors(a, b)
    if b.ndim > 2:
        return along(a, b, b.ndim - 2) if len(a) * b[0].size > ONE_THREAD else np.asarray(a @ b)
    (m, k), n = a.shape, b.shape[1]
    if m * k * n <= ONE_THREAD:
        return np.asarray(a @ b)
    if k > 4 * BLOCK:
        parts = range(0, k, 4 * BLOCK)
        total = product(a[:, : 4 * BLOCK], b[: 4 * BLOCK])
        for start in parts[1:]:
            part = slice(start, start + 4 * BLOCK)
            total += product(a[:, part], b[part])
        return total
    if n < m and n * k <= ONE_THREAD // 8:
        return _by_rows(a, b)
    if m * k <= ONE_THREAD // 8:
        return _by_rows(b.T, a.T).T
    parts = range(0, n, BLOCK)
    return np.concatenate([_by_rows(a, b[:, i : i + BLOCK]) for i in parts], axis=1)


def _by_rows(a: NDArray[Any], b: NDArray[Any]) -> Array:
    """Return a @ b for a small b, in one call of a stack of blocks of rows."""
    rows = max(1, ONE_THREAD // b.size)
    whole = len(a) // rows * rows
    result = np.empty((len(a), b.shape[1]))
    if whole:
        stack = result[:whole].reshape(-1, rows, b.shape[1])
        np.matmul(a[:whole].reshape(-1, rows, a.shape[1]), b, out=stack)
    np.matmul(a[whole:], b, out=result[whole:])
    return result


def tensor(rows: int, values: Array, b: Array) -> Callable[[Any], Array]:
    """Return what takes matrices a to the sums Σ a_pi b_qj V_kij over i and j, (k, p, q).

    In the order that takes less where these have so many rows together.
    """
    (n, m), q = values.shape[1:], len(b)
    if rows * m * (n + q) < q * n * (m + rows):
        return lambda a: _times_columns(_times_rows(a, values), b)
    across = _times_columns(values, b)
    return lambda a: _times_rows(a, across)


def _times_rows(a: Array, values: Array) -> Array:
    """Return a (p, n) @ values (k, n, m) in blocks of rows."""
    (k, n, m), p = values.shape, len(a)
    if n * m > ONE_THREAD:
        return along(a, values, 1)
    result, step = np.empty((k, p, m)), ONE_THREAD // (n * m)
    for start in range(0, p, step):
        part = slice(start, start + step)
        np.matmul(a[part], values, out=result[:, part])
    return result


def _times_columns(values: Array, b: Array) -> Array:
    """Return values (k, n, m) @ b (q, m) turned over."""
    (k, n, m), q = values.shape, len(b)
    if m * q > ONE_THREAD:
        return along(b, values, 2)
    return _by_rows(values.reshape(-1, m), b.T).reshape(k, n, q)


def along(matrix: Array, values: Array, axis: int) -> Array:
    """Return the matrix times the values along one axis of theirs; that axis stays in its place."""
    first = np.moveaxis(values, axis, 0)
    result = product(matrix, first.reshape(len(first), -1))
    return np.moveaxis(result.reshape(-1, *first.shape[1:]), 0, axis)


def vectors(a: NDArray[Any], b: NDArray[Any]) -> Array:
    """Return the sums over the last axis of a and the first of b, one of which has no other."""
    if b.ndim == 1:
        return np.asarray(np.einsum("...i,i->...", a, b))
    return np.asarray(np.einsum("i,i...->...", a, b))


def solve(matrix: Array, right: Array) -> Array:
    """Return x (n, k) or (n,) with matrix @ x = right; numpy.linalg.LinAlgError where singular."""
    if right.ndim == 1:
        return solve(matrix, right[:, None])[:, 0]
    size = len(matrix)
    if size <= _SMALL:
        step = _ONE_THREAD_OF_LAPACK // size
        parts = range(0, right.shape[1], step)
        columns = [np.linalg.solve(matrix, right[:, i : i + step]) for i in parts]
        return np.concatenate(columns, axis=1) if columns else right.copy()
    table, result = np.array(matrix, dtype=float), np.array(right, dtype=float)
    for start in range(0, size, _PANEL):
        stop = min(start + _PANEL, size)
        _eliminate(table, result, start, stop)
        below, here = slice(stop, None), slice(start, stop)
        table[below, stop:] -= product(table[below, here], table[here, stop:])
        result[below] -= product(table[below, here], result[here])
    for start in reversed(range(0, size, _PANEL)):
        here = slice(start, min(start + _PANEL, size))
        result[here] = np.linalg.solve(np.triu(table[here, here]), result[here])
        result[:start] -= product(table[:start, here], result[here])
    return result


def inverse(matrix: Array) -> Array:
    """Return the inverse; numpy.linalg.LinAlgError where there is none."""
    if len(matrix) <= _SMALL:
        return np.asarray(np.linalg.inv(matrix))  # the same call of LAPACK, without the wrapping
    return solve(matrix, np.eye(len(matrix)))


def _eliminate(table: Array, result: Array, start: int, stop: int) -> None:
    """Factorise the columns of a panel, largest pivots first, and its rows right of it."""
    for k in range(start, stop):
        pivot = k + int(np.argmax(np.abs(table[k:, k])))
        if not table[pivot, k]:
            raise np.linalg.LinAlgError("singular matrix")
        if pivot != k:
            table[[k, pivot]], result[[k, pivot]] = table[[pivot, k]], result[[pivot, k]]
        table[k + 1 :, k] /= table[k, k]
        table[k + 1 :, k + 1 : stop] -= table[k + 1 :, k, None] * table[k, k + 1 : stop]
    for k in range(start, stop):
        share = table[k + 1 : stop, k, None]
        table[k + 1 : stop, stop:] -= share * table[k, stop:]
        result[k + 1 : stop] -= share * result[k]
