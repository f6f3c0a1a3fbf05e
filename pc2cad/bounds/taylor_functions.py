"""The language's functions on Taylor models: series at the centre, and a bound of what is left.

For each function: its Taylor coefficients at the centre c, a bound of the sum of |f_k| r^k over all
k beyond the order, and one of |f'|, both for complex arguments within r of c. A bound is nan where
the function has a singularity that near.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from math import factorial

import numpy as np

from pc2cad.arrays import Array
from pc2cad.bounds.taylor_models import (
    LIBRARY,
    TINY,
    UNIT,
    Model,
    add,
    compose,
    mul,
    neg,
    powers,
    shift,
)


def divide(x: Model, y: Model, order: int) -> Model:
    """Return x/y; nothing is known where y may be 0."""
    return mul(x, inverse(y, order), order)


def inverse(x: Model, order: int) -> Model:
    """Return 1/x."""
    return _power_series(x, -1.0, order, 1 / x.centre, UNIT)


def square_root(x: Model, order: int) -> Model:
    """Return the root of values whose real part is positive."""
    c = np.where(x.centre > 0, x.centre, np.nan)
    return _power_series(x, 0.5, order, np.sqrt(c), UNIT)


def inverse_root(x: Model, order: int) -> Model:
    """Return 1/√x, rounded twice, of values whose real part is positive."""
    c = np.where(x.centre > 0, x.centre, np.nan)
    return _power_series(x, -0.5, order, 1 / np.sqrt(c), 2 * UNIT)


def real_power(x: Model, exponent: float, order: int) -> Model:
    """Return x**exponent for positive x."""
    c = np.where(x.centre > 0, x.centre, np.nan)
    return _power_series(x, exponent, order, np.power(c, exponent), LIBRARY)


def whole_power(x: Model, n: int, order: int) -> Model:
    """Return x**n, n > 0, by repeated products."""
    result: Model | None = None
    base, left = x, n
    while left:
        if left & 1:
            result = base if result is None else mul(result, base, order)
        left >>= 1
        if left:
            base = mul(base, base, order)
    assert result is not None
    if n <= 8:
        return result
    # larger powers are computed by the library, more exactly than by products
    return Model(result.terms, result.radius, result.error + LIBRARY * result.largest)


def _power_series(x: Model, a: float, order: int, first: Array, own: float) -> Model:
    """Return x**a, `first` being its value at the centre: binomial coefficients over c^k."""
    c, r = x.centre, x.reach
    q = _below_one(r / np.abs(c))
    binomials, binomial = _binomials(a, order)
    series = binomials * powers(1 / c, order) * first
    # the quotient of successive coefficients falls towards 1 from |a - k|/(k + 1) at k = order + 1
    growth = max(1.0, abs(a - order - 1) / (order + 2))
    room = _below_one(growth * q)
    tail = abs(binomial) * np.abs(first) * q ** (order + 1) / (1 - room)
    slope = abs(a) * np.abs(first / c) * np.where(a < 1, 1 - q, 1 + q) ** (a - 1)
    return compose(x, series, tail, slope * (1 + 1e-12), order, own)


@lru_cache(maxsize=64)
def _binomials(a: float, order: int) -> tuple[Array, float]:
    """Return the binomial coefficients of a up to an order, (order + 1, 1, 1), and the next."""
    ratios = [(a - k + 1) / k for k in range(1, order + 2)]
    *binomials, binomial = np.cumprod([1.0, *ratios]).tolist()
    return np.array(binomials)[:, None, None], binomial


@lru_cache(maxsize=64)
def _factorials(order: int) -> Array:
    return np.array([float(factorial(k)) for k in range(order + 1)])[:, None, None]


def _cyclic(cycle: tuple[Array, ...], order: int) -> Array:
    """Return the Taylor coefficients of a function whose derivatives come again and again."""
    turns = -(-(order + 1) // len(cycle))
    return np.asarray(np.array(cycle * turns)[: order + 1] / _factorials(order))


def _below_one(q: Array) -> Array:
    q = q * (1 + 16 * UNIT)
    return np.where(q < 1 - 1e-9, q, np.nan)


def exponential(x: Model, order: int) -> Model:
    """Return exp(x)."""
    first, r = np.exp(x.centre), x.reach
    series = first / _factorials(order)
    tail = _factorial_tail(first, r, order)
    model = compose(x, series, tail, first * np.exp(r), order, LIBRARY)
    # far below 0 it is 0 to within exp(Re x), on discs of any size
    highest = x.centre + r
    flat = np.exp(highest + 8 * UNIT * (np.abs(x.centre) + r)) * (1 + 1e-9) + TINY
    return _one_call(_level(model, np.zeros_like(flat), flat), x, flat)


def _factorial_tail(size: Array, r: Array, order: int) -> Array:
    """Return a bound of the sum of size·r^k/k! over k > order."""
    return np.asarray(size * r ** (order + 1) / factorial(order + 1) * np.exp(r))


def logarithm(x: Model, order: int) -> Model:
    """Return log(x) for positive x."""
    c = np.where(x.centre > 0, x.centre, np.nan)
    q = _below_one(x.reach / c)
    series = [np.log(c)] + [(-1.0) ** (k + 1) / (k * c**k) for k in range(1, order + 1)]
    tail = q ** (order + 1) / ((order + 1) * (1 - q))
    return compose(x, series, tail, 1 / (c * (1 - q)), order, LIBRARY)


def sine(x: Model, order: int) -> Model:
    """Return sin(x)."""
    s, c = np.sin(x.centre), np.cos(x.centre)
    return _turning(x, (s, c, -s, -c), order)


def cosine(x: Model, order: int) -> Model:
    """Return cos(x)."""
    s, c = np.sin(x.centre), np.cos(x.centre)
    return _turning(x, (c, -s, -c, s), order)


def _turning(x: Model, cycle: tuple[Array, ...], order: int) -> Model:
    series = _cyclic(cycle, order)
    one = np.ones_like(x.centre)
    # slope and value are 1 at most at real places
    model = compose(x, series, _factorial_tail(one, x.reach, order), one, order, 0.0)
    # an argument reduced by its whole turns is off by what rounding leaves of it in the library
    return Model(model.terms, model.radius + LIBRARY, x.error + LIBRARY)


def hyperbolic_sine(x: Model, order: int) -> Model:
    """Return sinh(x)."""
    s, c = np.sinh(x.centre), np.cosh(x.centre)
    return _growing(x, (s, c), c, order)


def hyperbolic_cosine(x: Model, order: int) -> Model:
    """Return cosh(x)."""
    s, c = np.sinh(x.centre), np.cosh(x.centre)
    return _growing(x, (c, s), c, order)


def _growing(x: Model, cycle: tuple[Array, Array], size: Array, order: int) -> Model:
    series = _cyclic(cycle, order)
    r = x.reach
    return compose(x, series, _factorial_tail(size, r, order), size * np.exp(r), order, LIBRARY)


def tangent(x: Model, order: int) -> Model:
    """Return tan(x)."""
    model = divide(sine(x, order), cosine(x, order), order)
    return _one_call(model, x, 1 + model.largest**2)


def hyperbolic_tangent(x: Model, order: int) -> Model:
    """Return tanh(x)."""
    # sinh and cosh over cosh of the centre, which alone would overflow
    t, one = np.tanh(x.centre), np.ones_like(x.centre)
    model = divide(_growing(x, (t, one), one, order), _growing(x, (one, t), one, order), order)
    # far from 0 it is 1 or -1 to within 2E/(1 - E), E = exp(-2 Re|x|), on discs of any size
    inner = np.abs(x.centre) - x.reach
    small = np.exp(-2 * np.where(inner > 0, inner, np.nan))
    flat = 2 * small / (1 - small) * (1 + 1e-9)
    model = _level(model, np.sign(x.centre), flat)
    return _one_call(model, x, 1 + model.largest**2)


def _level(model: Model, value: Array, flat: Array) -> Model:
    """Return a model with, where that is better, a value that a function is so near to."""
    level = flat < np.where(np.isfinite(model.radius), model.radius, np.inf)
    terms = np.where(level, 0.0, model.terms)
    terms[0, 0] = np.where(level, value, terms[0, 0])
    return Model(terms, np.where(level, flat, model.radius), np.where(level, 0.0, model.error))


def _one_call(model: Model, x: Model, slope: Array) -> Model:
    """Return a model made of several operations with the error of one library call."""
    return Model(model.terms, model.radius, slope * x.error + LIBRARY * (model.largest + 1e-300))


def arc(
    value: Callable[[Array], Array],
    square: tuple[float, float],
    root: bool,
    gap: Callable[[Array], Array],
    sign: float = 1.0,
) -> Callable[[Model, int], Model]:
    """Return a function whose derivative is sign/w or sign/√w, w = p + q x², `square` = (p, q).

    `gap` gives the distance of the centre from the nearest zero of w.
    """
    p, q = square

    def run(x: Model, order: int) -> Model:
        c, r = x.centre, x.reach
        room = gap(c)
        room = np.where(r < room * (1 - 1e-9), room, np.nan)
        wide = (r + room) / 2
        # w = q (x - z)(x - z'), each factor at least `room - wide` within `wide` of c, and their
        # product at least (room - wide)²
        least = (room - wide) ** 2
        steep = (1 / np.sqrt(least) if root else 1 / least) * (1 + 1e-9)
        derivative = _reciprocal_series(p + q * c * c, 2 * q * c, q, root, order)
        series = [value(c)] + [sign * d / (k + 1) for k, d in enumerate(derivative[:order])]
        share = r / wide
        # the recurrence loses some digits of what Cauchy's bound allows the coefficients to be
        tail = steep * wide * (share ** (order + 1) / ((order + 1) * (1 - share)) + 1e-13)
        return compose(x, series, tail * (1 + 1e-9), steep, order, LIBRARY)

    return run


def _reciprocal_series(w0: Array, w1: Array, w2: float, root: bool, count: int) -> list[Array]:
    """Return Taylor coefficients of w^a, a = -1 or -1/2, w = w0 + w1 h + w2 h²."""
    a = -0.5 if root else -1.0
    first = 1 / np.sqrt(np.where(w0 > 0, w0, np.nan)) if root else 1 / w0
    result = [first]
    for k in range(1, count + 1):
        total = (a - k + 1) * w1 * result[k - 1]
        if k > 1:
            total = total + (2 * a - k + 2) * w2 * result[k - 2]
        result.append(total / (k * w0))
    return result


def absolute(x: Model, order: int) -> Model:
    """Return |x| where x keeps its sign."""
    away = np.abs(x.centre) > x.reach
    sign = np.sign(x.centre)
    return Model(sign * x.terms, np.where(away, x.radius, np.inf), x.error)


def sign_of(x: Model, order: int) -> Model:
    """Return the sign of x where it keeps one."""
    away = np.abs(x.centre) > x.reach
    zero = np.zeros_like(x.centre)
    return Model(np.sign(x.centre)[None, None], np.where(away, zero, np.inf), zero)


def angle(y: Model, x: Model, order: int) -> Model:
    """Return atan2(y, x) off its cut, the negative x axis."""
    right = (x.centre > 0) & (x.reach < np.abs(x.centre))
    aside = np.abs(y.centre) > y.reach
    flat = _angle_from(divide(y, x, order), np.zeros(np.broadcast_shapes(x.centre.shape,
                       y.centre.shape)), order)  # fmt: skip
    upright = neg(_angle_from(divide(x, y, order), -np.sign(y.centre) * np.pi / 2, order))
    shape = tuple(max(a, b) for a, b in zip(flat.terms.shape, upright.terms.shape, strict=True))
    terms = np.where(right, _wide(flat, shape), _wide(upright, shape))
    radius = np.where(right, flat.radius, np.where(aside, upright.radius, np.inf))
    error = np.where(right, flat.error, np.where(aside, upright.error, np.inf))
    return Model(terms, radius + LIBRARY * 4, error + LIBRARY * 4)


def _angle_from(quotient: Model, turn: Array, order: int) -> Model:
    return shift(FUNCTIONS["atan"](quotient, order), turn)


def _wide(x: Model, shape: tuple[int, ...]) -> Array:
    wide = np.zeros((*shape[:2], *x.terms.shape[2:]))
    wide[: x.terms.shape[0], : x.terms.shape[1]] = x.terms
    return wide


def least(x: Model, y: Model, order: int) -> Model:
    """Return min(x, y) where one is known to be the smaller."""
    return chosen(shift_by(y, x), x, y, order)


def largest(x: Model, y: Model, order: int) -> Model:
    """Return max(x, y) where one is known to be the larger."""
    return chosen(shift_by(x, y), x, y, order)


def shift_by(x: Model, y: Model) -> Model:
    """Return x - y."""
    return add(x, neg(y))


def chosen(g: Model, x: Model, y: Model, order: int) -> Model:
    """Return x where g is known to be positive, y where it is known to be negative."""
    first, known = g.centre > 0, np.abs(g.centre) > g.reach
    shape = tuple(max(a, b) for a, b in zip(x.terms.shape, y.terms.shape, strict=True))
    terms = np.where(first, _wide(x, shape), _wide(y, shape))
    radius = np.where(known, np.where(first, x.radius, y.radius), np.inf)
    return Model(terms, radius, np.where(first, x.error, y.error))


def whole_part(x: Model, order: int) -> Model:
    """Return floor(x) where it keeps one value."""
    below = np.floor(x.centre)
    away = np.minimum(x.centre - below, below + 1 - x.centre) > x.reach
    return Model(below[None, None], np.where(away, 0.0, np.inf), np.zeros_like(x.centre))


def rest(x: Model, m: Model, order: int) -> Model:
    """Return mod(x, m) where the quotient keeps its whole part."""
    return shift_by(x, mul(m, whole_part(divide(x, m, order), order), order))


def power(x: Model, y: Model, order: int) -> Model:
    """Return x**y for positive x, both varying."""
    model = exponential(mul(y, logarithm(x, order), order), order)
    return Model(model.terms, model.radius, model.error + LIBRARY * model.largest)


def _off_imaginary(c: Array) -> Array:
    return np.asarray(np.sqrt(1 + c * c))


def _inside_ones(c: Array) -> Array:
    return 1 - np.abs(c)


def _above_one(c: Array) -> Array:
    return c - 1


FUNCTIONS: dict[str, Callable[[Model, int], Model]] = {
    "sin": sine, "cos": cosine, "tan": tangent, "exp": exponential, "log": logarithm,
    "sqrt": square_root, "sinh": hyperbolic_sine, "cosh": hyperbolic_cosine,
    "tanh": hyperbolic_tangent, "abs": absolute, "sign": sign_of, "floor": whole_part,
    "asin": arc(np.arcsin, (1.0, -1.0), True, _inside_ones),
    "acos": arc(np.arccos, (1.0, -1.0), True, _inside_ones, -1.0),
    "atan": arc(np.arctan, (1.0, 1.0), False, _off_imaginary),
    "asinh": arc(np.arcsinh, (1.0, 1.0), True, _off_imaginary),
    "acosh": arc(np.arccosh, (-1.0, 1.0), True, _above_one),
    "atanh": arc(np.arctanh, (1.0, -1.0), False, _inside_ones),
}  # fmt: skip
#: those of several operands
SEVERAL: dict[str, Callable[..., Model]] = {
    "mul": mul, "div": divide, "atan2": angle, "min": least, "max": largest, "where": chosen,
    "mod": rest,
}  # fmt: skip
