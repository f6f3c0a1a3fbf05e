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
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pc2cad.arrays import Array, Integers, linear
from pc2cad.bounds.taylor_products import by_degree, collect, product

#: unit of rounding of double precision
UNIT = 2.0**-53
#: what a few operations on bounds can lose, and what a library function of NumPy may err (4 ulp)
SLACK = 1 + 64 * UNIT
LIBRARY = 8 * UNIT
TINY = 1e-300


class _Once:
    """A property that is worked out once, with others or alone, without a `cached_property`'s lock.

    `work` puts it into a model's dictionary.
    """

    def __init__(self, work: Callable[[Model], None]) -> None:
        self._work = work

    def __set_name__(self, owner: type[Model], name: str) -> None:
        self._name = name

    def __get__(self, model: Model, owner: type[Model]) -> Array:
        self._work(model)
        found: Array = model.__dict__[self._name]
        return found


def _measure(model: Model) -> None:
    """Work out the sizes of a model, all of them: who asks for one asks for the others."""
    moduli, known = np.abs(model.terms), model.__dict__
    known["sizes"] = by_degree(moduli)
    known["size"] = size = np.add.reduce(known["sizes"], axis=0)
    known["largest"] = (size + model.radius + model.error) * (1 + 1e-12)


def _reach(model: Model) -> None:
    total = np.add.reduce(model.sizes[1:], axis=0)
    model.__dict__["reach"] = (total * (1 + 1e-12) + model.radius + model.error) * SLACK


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

    #: sums of |terms| by total degree, (degrees, n, m)
    sizes: ClassVar = _Once(_measure)
    #: the sum of all |terms|
    size: ClassVar = _Once(_measure)
    #: the largest modulus of any value, computed ones too
    largest: ClassVar = _Once(_measure)
    #: how far values, computed ones too, may be from `centre`
    reach: ClassVar = _Once(_reach)


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


def beside(models: Sequence[Model]) -> Model:
    """Return models of one shape as one, on the boxes of all: each model's after those before."""
    return Model(
        np.concatenate([model.terms for model in models], axis=2),
        np.concatenate([model.radius for model in models]),
        np.concatenate([model.error for model in models]),
    )


def parts(model: Model, count: int) -> list[Model]:
    """Return the models of which one was made by `beside`."""
    terms, radius, error = model.terms, model.radius, model.error
    size = len(radius) // count
    return [
        Model(terms[:, :, i : i + size], radius[i : i + size], error[i : i + size])
        for i in range(0, size * count, size)
    ]


def apart(model: Model) -> Model:
    """Return the model in memory of its own."""
    if model.terms.base is None:
        return model
    return Model(model.terms.copy(), model.radius.copy(), model.error.copy())


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
    one, other = x.terms, y.terms
    if one.shape[:2] != other.shape[:2]:
        (a, b), (c, d) = one.shape[:2], other.shape[:2]
        shape = max(a, c), max(b, d)
        one, other = pad(one, shape), pad(other, shape)
    total = one + other
    lost = np.add.reduce(np.abs(total), axis=(0, 1)) * UNIT + TINY
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
        radius = radius + np.add.reduce(beyond * rest[: len(beyond)], axis=0)
    error = x.largest * y.error + y.largest * (x.error + UNIT * x.largest)
    return Model(total, radius * (1 + 1e-14) + TINY, error * (1 + 1e-14) + TINY)


def _scaled(x: Model, factor: Model) -> Model:
    """Return x times what does not vary."""
    value, off, error = factor.terms.item(), factor.radius.item(), factor.error.item()
    size = abs(value)
    most = (size + off + error) * (1 + 1e-12)
    # rounded up here: what is left to do rounds a few times
    of_size, of_radius, of_largest, of_error = (
        share * (1 + 1e-14)
        for share in (off + 2 * UNIT * size, size + off, error + UNIT * most, most)
    )
    radius = x.size * of_size + x.radius * of_radius + TINY
    return Model(x.terms * value, radius, x.largest * of_largest + x.error * of_error + TINY)


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
    coefficients = np.asarray(series)
    moduli = np.abs(coefficients)
    reach = powers(x.reach, order)
    # sums of |f_k| r^k and, for the radius of the argument, of k |f_k| r^(k-1)
    whole = _sum(moduli * reach)
    spread = _sum(_degrees(order) * moduli[1:] * reach[:-1])
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
    value = np.add.reduce(np.abs(terms), axis=(0, 1)) + radius
    error = (slope * x.error + own * value) * (1 + 1e-12) + TINY
    return Model(terms, radius, error)


@lru_cache(maxsize=64)
def _degrees(order: int) -> Array:
    return np.arange(1.0, order + 1)[:, None, None]


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
            adding = collect(len(terms), len(few), degree - 1)
            terms = np.empty((len(adding) + 1, rows.shape[1]))
            terms[0] = rows[order - degree]
            terms[1:] = linear.product(adding, pairs.reshape(-1, rows.shape[1]))
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
    if np.count_nonzero(fine) == fine.size:
        return x
    return Model(
        np.where(fine, x.terms, 0.0),
        np.where(fine, x.radius, np.inf),
        np.where(fine, x.error, np.inf),
    )
