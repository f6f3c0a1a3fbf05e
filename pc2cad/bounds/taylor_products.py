"""Products of the polynomials of Taylor models: terms (i, j, …) of s^i t^j, for many boxes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import prod

import numpy as np

from pc2cad.arrays import Array, Integers, linear

#: products of two terms each, all boxes together, that are held at once
MOST_GATHERED = 1 << 15
#: entries of a matrix that adds up products of pairs
MOST_SUMMED = 1 << 14


def product(x: Array, y: Array, order: int) -> Array:
    """Return the products of terms, up to a total degree of `order`."""
    (a, b), (c, d) = x.shape[:2], y.shape[:2]
    if (a == 1 and d == 1) or (b == 1 and c == 1) or a * b == 1 or c * d == 1:
        # a factor does not vary, or one varies along s, the other along t: one product per term
        return _up_to(order, x * y)
    if b == d == 1 or a == c == 1:
        return _along_one(x, y, order)
    boxes = np.broadcast_shapes(x.shape[2:], y.shape[2:])
    pairs = _pairs((a, b), (c, d), order)
    if len(pairs.first) * prod(boxes) <= MOST_GATHERED:
        return _gathered(x, y, pairs, boxes)
    if a * b > c * d:
        x, y, a, b, c, d = y, x, c, d, a, b
    total = np.zeros((a + c - 1, b + d - 1, *boxes))
    for i, j in np.ndindex(a, b):
        if i + j <= order:
            rows, columns = min(c, order + 1 - i - j), min(d, order + 1 - i - j)
            total[i : i + rows, j : j + columns] += x[i, j] * y[:rows, :columns]
    return _up_to(order, total[: order + 1, : order + 1])


@dataclass(frozen=True, eq=False)
class _Pairs:
    """The pairs of terms of two factors whose products are of a degree that is kept.

    Terms are numbered row by row; pairs with one product lie together.
    """

    first: Integers
    second: Integers
    #: where the pairs of each product begin, the product's term, and the shape (i, j) of all terms
    starts: Integers
    term: Integers
    shape: tuple[int, int]

    @cached_property
    def sums(self) -> Array:
        """The matrix that adds up the products of the pairs, (products, pairs)."""
        which = np.repeat(np.arange(len(self.starts)), np.diff(self.starts, append=len(self.first)))
        return np.asarray(np.arange(len(self.starts))[:, None] == which, dtype=float)


@lru_cache(maxsize=256)
def _pairs(first: tuple[int, int], second: tuple[int, int], order: int) -> _Pairs:
    """Return the pairs of terms of two factors, of shapes (i, j) each."""
    shape = tuple(min(p + q - 1, order + 1) for p, q in zip(first, second, strict=True))
    i, j, k, m = (axis.ravel() for axis in np.indices((*first, *second)))
    term = (i + k) * shape[1] + j + m
    kept = np.flatnonzero(i + j + k + m <= order)
    kept = kept[np.argsort(term[kept], kind="stable")]
    starts = np.flatnonzero(np.diff(term[kept], prepend=-1))
    rows = i * first[1] + j, k * second[1] + m
    return _Pairs(rows[0][kept], rows[1][kept], starts, term[kept][starts], (shape[0], shape[1]))


def _gathered(x: Array, y: Array, pairs: _Pairs, boxes: tuple[int, ...]) -> Array:
    """Return the products of terms from all pairs side by side: few calls where boxes are few."""
    # each factor has as many boxes as it varies over
    first = x.reshape(-1, *x.shape[2:]).take(pairs.first, axis=0)
    second = y.reshape(-1, *y.shape[2:]).take(pairs.second, axis=0)
    whole = next((f for f in (first, second) if f.shape[1:] == boxes), None)
    rows = np.multiply(first, second, out=whole).reshape(len(first), -1)
    size = len(pairs.starts) * len(rows)
    if size <= MOST_SUMMED and size * rows.shape[1] <= linear.ONE_THREAD:
        sums = linear.product(pairs.sums, rows)
    else:
        sums = np.add.reduceat(rows, pairs.starts, axis=0)
    total = np.zeros((prod(pairs.shape), rows.shape[1]))
    total[pairs.term] = sums
    return total.reshape(*pairs.shape, *boxes)


def _along_one(x: Array, y: Array, order: int) -> Array:
    """Return the product where both factors vary along the same axis, or none does."""
    along_t = x.shape[1] > 1 or y.shape[1] > 1
    outer = x.swapaxes(0, 1) * y if along_t else x * y.swapaxes(0, 1)
    a, c, *boxes = outer.shape
    total = linear.product(collect(a, c, order), outer.reshape(a * c, -1))
    return total.reshape(1, -1, *boxes) if along_t else total.reshape(-1, 1, *boxes)


@lru_cache(maxsize=256)
def collect(a: int, c: int, order: int) -> Array:
    """Return the matrix that adds up products of terms (i, k) by their degree i + k."""
    degree = np.add.outer(np.arange(a), np.arange(c)).ravel()
    return np.asarray(np.arange(min(a + c - 1, order + 1))[:, None] == degree, dtype=float)


def _up_to(order: int, terms: Array) -> Array:
    """Return terms, those of a total degree above the order made 0 (in place)."""
    a, b = terms.shape[:2]
    if a + b - 2 > order:
        terms *= _within(a, b, order)
    return terms


@lru_cache(maxsize=256)
def _within(a: int, b: int, order: int) -> Array:
    """Return 1 where the total degree is at most `order`, else 0."""
    degree = np.add.outer(np.arange(a), np.arange(b))
    return np.asarray(degree <= order, dtype=float)[:, :, None, None]


def by_degree(sizes: Array) -> Array:
    """Return the sums of |terms| by total degree, (degrees, n, m)."""
    a, b = sizes.shape[:2]
    if b == 1:
        return sizes[:, 0]
    if a == 1:
        return np.asarray(sizes[0])
    total = linear.product(collect(a, b, a + b), sizes.reshape(a * b, -1))
    return total.reshape(-1, *sizes.shape[2:])
