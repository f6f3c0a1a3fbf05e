"""Expression trees as Taylor models on polydiscs, all of them at once, with outward rounding.

A model is a polynomial in the local parameters, scaled so that each fills the complex unit disc,
and the radius of a disc round it that holds the tree's value for *complex* parameters as well. A
function that is analytic on a disc of radius R, and within B of a polynomial of degree d there, has
Taylor coefficients of at most B/R^k for every k > d: one evaluation bounds the derivatives of every
order, and the polynomial part keeps what cancels cancelling (as discs alone, d = 0, do not).

Each model also carries a bound of the error that the same operations make in double precision at
real places, so that values sampled by `Program` can stand for exact ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import prod

import numpy as np
from numpy.typing import ArrayLike

from pc2cad.arrays import Array, Integers, linear

#: unit of rounding of double precision
UNIT = 2.0**-53
#: what a few operations on bounds can lose, and what a library function of NumPy may err (4 ulp)
SLACK = 1 + 64 * UNIT
LIBRARY = 8 * UNIT
TINY = 1e-300
#: products of two terms each, all boxes together, that are held at once
MOST_GATHERED = 1 << 15
#: entries of a matrix that adds up products of pairs
MOST_SUMMED = 1 << 14


class _Once:
    """A property that is worked out once, without the lock of a `cached_property`."""

    def __init__(self, work: Callable[[Model], Array]) -> None:
        self._work, self._name = work, work.__name__

    def __get__(self, model: Model, owner: type[Model]) -> Array:
        found = model.__dict__[self._name] = self._work(model)
        return found


@dataclass(frozen=True, eq=False)
class Model:
    """A polynomial on the unit polydisc and how far the value may be from it.

    `terms` has shape (i, j, n, m): coefficients of s^i t^j, i + j <= the order, for n × m boxes;
    axes have length 1 where nothing varies along them. `radius` and `error` have shape (n, m); a
    radius of inf says that nothing is known.
    """

    terms: Array
    #: |value - polynomial| for complex parameters
    radius: Array
    #: |computed - exact| for real parameters in double precision
    error: Array

    @property
    def centre(self) -> Array:
        """The polynomial's value in the middle."""
        return np.asarray(self.terms[0, 0])

    @_Once
    def sizes(self) -> Array:
        """Return the sums of |terms| by total degree, (degrees, n, m)."""
        return by_degree(np.abs(self.terms))

    @_Once
    def size(self) -> Array:
        """Return the sum of all |terms|."""
        return _sum(self.sizes)

    @_Once
    def reach(self) -> Array:
        """Return how far values, computed ones too, may be from `centre`."""
        total = _sum(self.sizes[1:])
        return np.asarray((total * (1 + 1e-12) + self.radius + self.error) * SLACK)

    @_Once
    def largest(self) -> Array:
        """Return the largest modulus of any value, computed ones too."""
        return np.asarray((self.size + self.radius + self.error) * (1 + 1e-12))


@dataclass(frozen=True, eq=False)
class Place:
    """Where a parameter lies, one entry per box along its own axis, or (n, m) entries.

    `half` is half the length of the real cell, `radius` (larger) that of the complex disc round its
    middle; `error` bounds how far a computed parameter may be from the intended one.
    """

    centre: Array
    half: Array
    radius: Array
    error: float = 4 * UNIT

    def part(self, which: slice | Integers) -> Place:
        """Return some of the boxes."""
        return Place(self.centre[which], self.half[which], self.radius[which], self.error)

    def spread(self, axis: int) -> Place:
        """Return the same with (n, m) entries, those of one axis along it."""
        if self.centre.ndim == 2:
            return self
        shape = (-1, 1) if axis == 0 else (1, -1)
        centre, half, radius = (x.reshape(shape) for x in (self.centre, self.half, self.radius))
        return Place(centre, half, radius, self.error)


def constant(value: ArrayLike, error: ArrayLike = 0.0) -> Model:
    """Return the model of a number that is known to within `error`."""
    off = np.asarray(error, float).reshape(1, 1)
    return Model(np.asarray(value, float).reshape(1, 1, 1, 1), off, off)


def parameter(place: Place, axis: int) -> Model:
    """Return the model of a parameter itself."""
    place = place.spread(axis)
    terms = np.stack((place.centre, place.radius))
    zero = np.zeros_like(place.centre)
    return Model(terms[:, None] if axis == 0 else terms[None], zero, zero + place.error)


def pad(terms: Array, shape: tuple[int, ...]) -> Array:
    """Return terms (i, j, …) up to other degrees, those that are missing 0."""
    a, b = shape[:2]
    if terms.shape[:2] == (a, b):
        return terms
    wide = np.zeros((a, b, *terms.shape[2:]))
    wide[: terms.shape[0], : terms.shape[1]] = terms
    return wide


def add(x: Model, y: Model) -> Model:
    """Return x + y."""
    (a, b), (c, d) = x.terms.shape[:2], y.terms.shape[:2]
    shape = max(a, c), max(b, d)
    total = pad(x.terms, shape) + pad(y.terms, shape)
    size = _sum(np.abs(total).reshape(-1, *total.shape[2:]))
    lost = size * UNIT + TINY
    radius = (x.radius + y.radius + lost) * SLACK
    return Model(total, radius, (x.error + y.error + lost + UNIT * radius) * SLACK)


def neg(x: Model) -> Model:
    """Return -x."""
    return Model(-x.terms, x.radius, x.error)


def shift(x: Model, by: ArrayLike) -> Model:
    """Return x plus exact numbers, one per box, its error left as it is."""
    terms = x.terms.copy() if np.ndim(by) == 0 else x.terms + np.zeros((1, 1, *np.shape(by)))
    terms[0, 0] = terms[0, 0] + by
    return Model(terms, (x.radius + UNIT * np.abs(terms[0, 0])) * SLACK + TINY, x.error)


def mul(x: Model, y: Model, order: int) -> Model:
    """Return x·y; products of a degree above `order` go into the radius."""
    for one, other in ((x, y), (y, x)):
        if one.terms.size == one.radius.size == one.error.size == 1:
            return _scaled(other, one)
    total = product(x.terms, y.terms, order)
    by_x, by_y = x.sizes[: order + 1], y.sizes[: order + 1]
    radius = x.size * (y.radius + y.size * (4 * (order + 2) ** 2 * UNIT))
    radius = radius + (y.size + y.radius) * x.radius
    if len(by_x) + len(by_y) - 2 > order:
        # what the factors have from each degree on, the highest degree first
        rest = np.add.accumulate(by_y[::-1], axis=0)
        beyond = by_x[order + 2 - len(by_y) :]
        radius = radius + _sum(beyond * rest[: len(beyond)])
    error = x.largest * y.error + y.largest * (x.error + UNIT * x.largest)
    return Model(total, radius * (1 + 1e-14) + TINY, error * (1 + 1e-14) + TINY)


def _scaled(x: Model, factor: Model) -> Model:
    """Return x times what does not vary."""
    value, off, error = (row.item() for row in (factor.terms, factor.radius, factor.error))
    size = abs(value)
    most = (size + off + error) * (1 + 1e-12)
    radius = x.size * (off + 2 * UNIT * size) + x.radius * (size + off)
    errors = x.largest * (error + UNIT * most) + x.error * most
    return Model(x.terms * value, radius * (1 + 1e-14) + TINY, errors * (1 + 1e-14) + TINY)


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
    shape = x.shape[:2], y.shape[:2]
    a, c = (p * q for p, q in shape)
    outer = x.reshape(a, 1, *x.shape[2:]) * y.reshape(1, c, *y.shape[2:])
    boxes = outer.shape[2:]
    collect = _collect(a, c, order)
    total = linear.product(collect, outer.reshape(a * c, -1)).reshape(len(collect), *boxes)
    along_t = shape[0][1] > 1 or shape[1][1] > 1
    return np.asarray(total[None] if along_t else total[:, None])


@lru_cache(maxsize=256)
def _collect(a: int, c: int, order: int) -> Array:
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
        return np.asarray(sizes[:, 0])
    if a == 1:
        return np.asarray(sizes[0])
    total = linear.product(_collect(a, b, a + b), sizes.reshape(a * b, -1))
    return total.reshape(-1, *sizes.shape[2:])


def _sum(values: Array) -> Array:
    """Return the sum along the first axis."""
    return np.asarray(np.add.reduce(values, axis=0))


def compose(
    x: Model, series: Sequence[Array] | Array, tail: Array, slope: Array, order: int, own: float
) -> Model:
    """Return f(x) from the Taylor coefficients of f at the centre of x.

    `series` has `order` + 1 of them, `tail` bounds what the others add within x's reach (nan or inf
    where that is unknown), `slope` the derivative there, `own` the relative error of computing f.
    """
    coefficients = np.array(series)
    moduli, degrees = np.abs(coefficients), np.arange(order + 1).reshape(-1, 1, 1)
    reach = powers(x.reach, order)
    # sums of |f_k| r^k and, for the radius of the argument, of k |f_k| r^(k-1)
    whole = _sum(moduli * reach)
    spread = _sum((degrees * moduli)[1:] * reach[:-1])
    lost: Array | float = 0.0
    if x.terms.shape[0] * x.terms.shape[1] == 2:
        # an argument of degree 1: powers of one term, none of which is lost
        column = coefficients * powers(x.terms.reshape(2, *x.terms.shape[2:])[1], order)
        terms = column[:, None] if x.terms.shape[0] == 2 else column[None]
    else:
        terms, kept = _horner(x, coefficients, moduli)
        polynomial = _sum(moduli * powers(_sum(x.sizes[1:]), order))
        lost = np.maximum(polynomial - kept, 0.0)
    # coefficients come from a few library calls and products each
    rounding = ((order + 8) * LIBRARY + 8 * (order + 2) ** 2 * UNIT) * whole
    radius = (spread * x.radius + lost + tail + rounding) * (1 + 1e-12) + TINY
    value = np.abs(terms).sum(axis=(0, 1)) + radius
    error = (slope * x.error + own * value) * (1 + 1e-12) + TINY
    return Model(terms, radius, error)


def powers(x: Array, order: int) -> Array:
    """Return the powers of x up to the order, one behind the other."""
    result = np.empty((order + 1, *x.shape))
    result[0], result[1:] = 1.0, x
    return np.asarray(np.multiply.accumulate(result, axis=0, out=result))


def _horner(x: Model, coefficients: Array, moduli: Array) -> tuple[Array, Array]:
    """Return Σ f_k g^k, g being x without its centre, and what of Σ |f_k| |g|^k it keeps.

    What is of a degree above the order is left out.
    """
    order = len(coefficients) - 1
    g, sizes = x.terms[: order + 1, : order + 1].copy(), x.sizes[: order + 1].copy()
    g[0, 0] = sizes[0] = 0.0
    if g.shape[0] == 1 or g.shape[1] == 1:
        # both at once: those of the sizes beside those of the terms
        both = np.concatenate([c.reshape(len(sizes), -1) for c in (g, sizes)], axis=1)
        rows = np.concatenate([c.reshape(order + 1, -1) for c in (coefficients, moduli)], axis=1)
        terms = rows[-1:]
        for degree in range(1, order + 1):
            # g begins with degree 1: what is of a higher degree here ends beyond the order
            few = both[1 : degree + 1]
            pairs = terms[:, None] * few
            collect = _collect(len(terms), len(few), degree - 1)
            terms = np.empty((len(collect) + 1, rows.shape[1]))
            terms[0] = rows[order - degree]
            terms[1:] = linear.product(collect, pairs.reshape(-1, rows.shape[1]))
        half = rows.shape[1] // 2
        column = terms[:, :half].reshape(-1, *g.shape[2:])
        kept = _sum(terms[:, half:]).reshape(g.shape[2:])
        return column[:, None] if g.shape[1] == 1 else column[None], kept
    sizes = sizes[:, None]
    terms, kept = coefficients[-1][None, None], moduli[-1][None, None]
    for degree in range(1, order + 1):
        terms = product(terms, g[: degree + 1, : degree + 1], degree)
        kept = product(kept, sizes[: degree + 1], degree)
        terms[0, 0] += coefficients[order - degree]
        kept[0, 0] += moduli[order - degree]
    return terms, np.asarray(kept.sum(axis=(0, 1)))


def known(x: Model) -> Model:
    """Return the model with all that is not finite made 'nothing is known'.

    Radii grow with the sizes of all terms: where a term is not finite, no radius is.
    """
    fine = np.isfinite(x.radius + x.error)
    if fine.all():
        return x
    return Model(
        np.where(fine, x.terms, 0.0),
        np.where(fine, x.radius, np.inf),
        np.where(fine, x.error, np.inf),
    )
