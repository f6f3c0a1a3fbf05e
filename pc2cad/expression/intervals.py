"""Interval arithmetic on NumPy arrays.

Each operation returns an interval that holds every value of its operands' intervals, rounded
outwards: the four operations and roots, which are correctly rounded, by a unit in the last place,
the other functions by `ULPS`, which is more than any mathematical library is off. No result is nan.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import nextafter
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pc2cad.arrays import Array, Booleans

#: one unit in the last place, relative
ULP: Final = float(np.finfo(float).eps)
#: units in the last place by which transcendental functions are widened
ULPS: Final = 8
TINIEST: Final = 5e-324
LARGEST: Final = float(np.finfo(float).max)
INFINITE: Final = float("inf")


@dataclass(frozen=True, eq=False, slots=True)
class Interval:
    """Arrays of intervals: `lower` and `upper` have one shape, infinite where nothing is known."""

    lower: Array
    upper: Array

    def __neg__(self) -> Interval:
        return Interval(-self.upper, -self.lower)

    def __add__(self, other: Interval) -> Interval:
        # sums that underflow are exact: no smallest number has to be added
        lower = np.minimum(self.lower + other.lower, LARGEST)
        upper = np.maximum(self.upper + other.upper, -LARGEST)
        return Interval(lower - np.abs(lower) * ULP, upper + np.abs(upper) * ULP)

    def __sub__(self, other: Interval) -> Interval:
        return self + -other

    def __mul__(self, other: Interval) -> Interval:
        a, b, c, d = self.lower, self.upper, other.lower, other.upper
        if a is b or c is d:
            # one of them is a number each: two products do
            ends = [a * c, b * d]
            lower, upper = np.minimum(*ends), np.maximum(*ends)
        else:
            ends = [a * c, a * d, b * c, b * d]
            lower = np.minimum(np.minimum(ends[0], ends[1]), np.minimum(ends[2], ends[3]))
            upper = np.maximum(np.maximum(ends[0], ends[1]), np.maximum(ends[2], ends[3]))
        if np.isnan(lower).any():
            # zero times an unbounded interval is zero
            ends = [np.where(np.isnan(end), 0.0, end) for end in ends]
            lower, upper = np.min(ends, axis=0), np.max(ends, axis=0)
        product = rounded(lower, upper, 1)
        # of what is not negative the rounding beyond 0 is cut off
        np.maximum(product.lower, 0.0, out=product.lower, where=(a >= 0) & (c >= 0))
        return product

    def __truediv__(self, other: Interval) -> Interval:
        return self * other.reciprocal()

    def reciprocal(self) -> Interval:
        """Return 1/x; the whole line where x can be 0 and has both signs."""
        if (self.lower > 0).all():  # as what is divided by mostly is
            result = rounded(1 / self.upper, 1 / self.lower, 1)
            return Interval(np.maximum(result.lower, 0.0), result.upper)
        with np.errstate(divide="ignore"):
            lower = np.where(self.upper == 0, -INFINITE, 1 / self.upper)
            upper = np.where(self.lower == 0, INFINITE, 1 / self.lower)
        result = rounded(lower, upper, 1)
        lower = np.where(self.lower >= 0, np.maximum(result.lower, 0.0), result.lower)
        upper = np.where(self.upper <= 0, np.minimum(result.upper, 0.0), result.upper)
        both = (self.lower <= 0) & (self.upper >= 0) & ((self.lower < 0) == (self.upper > 0))
        return Interval(np.where(both, -INFINITE, lower), np.where(both, INFINITE, upper))

    def power(self, n: int) -> Interval:
        """Return the n-th power, n > 0."""
        if n == 1:
            return self
        if n % 2:
            result = rounded(_raised(self.lower, n), _raised(self.upper, n), ULPS)
            return with_sign_of(self, result)
        size = self.magnitude()
        result = rounded(_raised(size.lower, n), _raised(size.upper, n), ULPS)
        return Interval(np.maximum(result.lower, 0.0), result.upper)

    def magnitude(self) -> Interval:
        """Return |x|."""
        least = np.maximum(np.maximum(self.lower, -self.upper), 0.0)
        return Interval(least, np.maximum(-self.lower, self.upper))

    def meet(self, other: Interval) -> Interval:
        """Return what two enclosures of one value have in common."""
        return Interval(np.maximum(self.lower, other.lower), np.minimum(self.upper, other.upper))

    def join(self, other: Interval) -> Interval:
        """Return the smallest interval that holds both."""
        return Interval(np.minimum(self.lower, other.lower), np.maximum(self.upper, other.upper))

    @property
    def middle(self) -> Array:
        """A number inside each bounded interval, near its middle."""
        return np.asarray(self.lower / 2 + self.upper / 2)


def interval(lower: ArrayLike, upper: ArrayLike | None = None) -> Interval:
    """Return intervals between arrays of limits; of one array, intervals of no length."""
    low = np.asarray(lower, dtype=float)
    return Interval(low, low if upper is None else np.asarray(upper, dtype=float))


def enclosed_number(value: Fraction) -> Interval:
    """Return the tightest interval round an exact number."""
    near = float(value)
    # as a fraction it is compared in whole numbers
    (n, d), (m, e) = near.as_integer_ratio(), value.as_integer_ratio()
    off = n * e - m * d
    if off == 0:
        return interval(near)
    lower = near if off < 0 else nextafter(near, -INFINITE)
    upper = near if off > 0 else nextafter(near, INFINITE)
    return Interval(np.array(lower), np.array(upper))


def enclosed_range(low: Fraction, high: Fraction) -> Interval:
    """Return the tightest interval that holds all from one exact number to another."""
    return Interval(enclosed_number(low).lower, enclosed_number(high).upper)


# -- rounding --------------------------------------------------------------------------------------


def rounded(lower: Array, upper: Array, ulps: int) -> Interval:
    """Return the interval widened by some units in the last place; nan is no knowledge."""
    lower, upper = np.minimum(lower, LARGEST), np.maximum(upper, -LARGEST)
    below, above = np.abs(lower), np.abs(upper)
    share, least = ulps * ULP, ulps * TINIEST
    below *= share
    below += least
    above *= share
    above += least
    lower -= below
    upper += above
    return Interval(np.asarray(lower), np.asarray(upper))


def whole_line_where(unknown: Booleans, value: Interval) -> Interval:
    """Return the whole line where nothing is known, or an end is nan, else the interval."""
    unknown = unknown | np.isnan(value.lower) | np.isnan(value.upper)
    if not unknown.any():
        return value
    return Interval(np.where(unknown, -INFINITE, value.lower),
                    np.where(unknown, INFINITE, value.upper))  # fmt: skip


def with_sign_of(x: Interval, value: Interval) -> Interval:
    """Return the values of an increasing odd function with rounding beyond 0 cut off."""
    return Interval(
        np.where(x.lower >= 0, np.maximum(value.lower, 0.0), value.lower),
        np.where(x.upper <= 0, np.minimum(value.upper, 0.0), value.upper),
    )


def _raised(x: Array, n: int) -> Array:
    """Return x**n; few factors are multiplied (n - 1 roundings), which is much faster."""
    if n > 8:
        return np.asarray(np.power(x, float(n)))
    result = x
    for _ in range(n - 1):
        result = result * x
    return np.asarray(result)
