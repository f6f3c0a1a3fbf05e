"""Taylor series of programs with balls for coefficients: NumPy and the standard library alone.

A program is a list of rows, each an operation on earlier ones: what a side of an equation is in a
certificate. Radii are rounded outwards; what is not known anywhere is infinite or no number.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import lru_cache
from math import pi
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: unit of rounding; what every step adds to a radius, relative to it; library functions' error
UNIT, OUT, LIBRARY = 2.0**-53, 1.0 + 1e-12, 8 * 2.0**-53
#: rows of a program; numbers in it are whole ones and fractions, of no more digits than these
LONGEST: Final = 20_000
_NUMBER: Final = re.compile(r"-?\d{1,1300}(?:/\d{1,1300})?")


class ReplayError(Exception):
    """The certificate does not hold; the sentence says what of it."""


class Jet:
    """Taylor coefficients along one parameter, as balls over a grid of cells.

    Centres and radii have the shape (order + 1, cells along s, cells along t). What does not depend
    on the parameter has the order 0, and what is the same in all cells of a direction has one. One
    radius may be that of all cells.
    """

    def __init__(self, c: Any, r: Any) -> None:
        """Take centres and radii."""
        self.c, self.r = np.asarray(c, dtype=float), np.asarray(r, dtype=float)

    @property
    def size(self) -> Array:
        """The largest absolute values."""
        return np.asarray(np.abs(self.c) + self.r)

    @property
    def most(self) -> float:
        """The largest absolute centre."""
        return max(float(self.c.max()), -float(self.c.min()))

    @property
    def coarse(self) -> Jet:
        """The same with one radius for all cells."""
        return self if self.r.size == 1 else Jet(self.c, [[[self.r.max()]]])

    def __getitem__(self, part: slice) -> Jet:
        """Return some of the coefficients."""
        return Jet(self.c[part], self.r[part])

    def __add__(self, other: Jet) -> Jet:
        """Return the sum."""
        c, r = _sum(self.c, other.c), _sum(self.r, other.r)
        size = self.most + other.most if r.size == 1 else np.abs(c)
        return Jet(c, (r + UNIT * size) * OUT)

    def __neg__(self) -> Jet:
        """Return the negative."""
        return Jet(-self.c, self.r)

    def __sub__(self, other: Jet) -> Jet:
        """Return the difference."""
        return self + -other

    def __mul__(self, other: Jet) -> Jet:
        """Return the product, cut off behind the longer series."""
        a, b = (self, other) if len(self.c) <= len(other.c) else (other, self)
        if a.r.size == b.r.size == 1:
            (x, r), (y, s) = (a.most, a.r), (b.most, b.r)
            return Jet(a.c * b.c, (x * s + r * (y + s) + UNIT * x * y) * OUT + 1e-300)
        # |a| r_b + r_a |b|, each with what rounding adds
        size, rounding = b.size, (len(b.c) + 3) * UNIT
        rest = _product(np.abs(a.c), b.r + rounding * size)
        if a.r.any():
            rest += _product(a.r, (1.0 + rounding) * size)
        return Jet(_product(a.c, b.c), rest * OUT + 1e-300)


def _sum(a: Array, b: Array) -> Array:
    if len(a) == len(b):
        return np.asarray(a + b)
    if len(a) > len(b):
        a, b = b, a
    shape = np.broadcast_shapes(a.shape[1:], b.shape[1:])
    found = np.array(np.broadcast_to(b, (len(b), *shape)))
    found[: len(a)] += a
    return found


def _product(a: Array, b: Array) -> Array:
    found = np.asarray(a[:1] * b)
    for k in range(1, len(a)):
        found[k:] += a[k] * b[: len(b) - k]
    return found


def constant(value: float, rounding: float = UNIT) -> Jet:
    """Return a number that is off by a relative rounding."""
    return Jet([[[value]]], [[[abs(value) * rounding]]])


def _summed(shares: Array, a: Jet, b: Jet) -> Jet:
    """Return Σ shares_i a_i b_i as one coefficient."""
    w = shares[:, None, None]
    rest = np.abs(w) * (np.abs(a.c) * b.r + a.r * b.size + (len(w) + 4) * UNIT * a.size * b.size)
    return Jet((w * a.c * b.c).sum(0, keepdims=True), rest.sum(0, keepdims=True) * OUT + 1e-300)


def _joined(parts: Sequence[Jet]) -> Jet:
    c, r = [part.c for part in parts], [part.r for part in parts]
    if len({part.shape for part in (*c, *r)}) > 1:
        shape = np.broadcast_shapes(*(part.shape for part in c))
        c, r = ([np.broadcast_to(part, shape) for part in row] for row in (c, r))
    return Jet(np.concatenate(c), np.concatenate(r))


def _monotone(function: Callable[[Array], Array], a: Jet) -> Jet:
    """Return a function that rises or falls, of the first coefficient."""
    low, high = function(a.c[:1] - a.r[:1]), function(a.c[:1] + a.r[:1])
    c = 0.5 * (low + high)
    r = 0.5 * np.abs(high - low) + LIBRARY * (np.abs(low) + np.abs(high))
    return Jet(c, r * OUT + 1e-300)


def _positive(a: Jet) -> Jet:
    """Return what is positive; nothing is known where it may not be."""
    return Jet(np.where(a.c[:1] - a.r[:1] > 0.0, a.c, np.nan), a.r)


def power(a: Jet, e: float) -> Jet:
    """Return a real power of what is positive: k a_0 b_k = Σ (e i - (k - i)) a_i b_(k-i)."""
    a = _positive(a)
    parts = [_monotone(lambda x: np.asarray(x**e), a)]
    inverse = _monotone(lambda x: np.asarray(1.0 / x), a) if len(a.c) > 1 else parts[0]
    for k in range(1, len(a.c)):
        i = np.arange(1.0, k + 1.0)
        found = _summed(e * i - (k - i), a[1 : k + 1], _joined(parts)[::-1])
        parts.append(found * inverse * constant(1.0 / k))
    return _joined(parts)


def _inverse(a: Jet) -> Jet:
    # of what has one sign in a cell, which may be another one in the next
    sign = Jet(np.where(a.c[:1] < 0.0, -1.0, 1.0), np.zeros_like(a.c[:1]))
    return sign * power(sign * a, -1.0)


def _quotient(a: Jet, b: Jet) -> Jet:
    return a * _inverse(b)


def _whole_power(a: Jet, n: int) -> Jet:
    found, square = constant(1.0, 0.0), a if n > 0 else _inverse(a)
    n = abs(n)
    while n:
        found, square, n = found * square if n % 2 else found, square * square, n // 2
    return found


def _waves(a: Jet) -> tuple[Jet, Jet]:
    """Return sine and cosine."""
    c, r = a.c[:1], a.r[:1]
    s, o = np.sin(c), np.cos(c)
    sines = [Jet(s, np.minimum(np.abs(o) * r + r * r, 2.0) + LIBRARY)]
    cosines = [Jet(o, np.minimum(np.abs(s) * r + r * r, 2.0) + LIBRARY)]
    for k in range(1, len(a.c)):
        i, own = np.arange(1.0, k + 1.0), a[1 : k + 1]
        new = [_summed(shares, own, _joined(row)[::-1]) * constant(1.0 / k)
               for shares, row in ((i, cosines), (-i, sines))]  # fmt: skip
        sines.append(new[0])
        cosines.append(new[1])
    return _joined(sines), _joined(cosines)


def _hyperbola(a: Jet) -> tuple[Jet, Jet]:
    up, down, half = _exp(a), _exp(-a), constant(0.5, 0.0)
    return (up - down) * half, (up + down) * half


def _integrated(head: Jet, a: Jet, slope: Jet) -> Jet:
    """Return a function of its value and its derivative, both at a."""
    parts, slope = [head], slope + Jet(0 * a.c, 0 * a.r)
    for k in range(1, len(a.c)):
        found = _summed(np.arange(1.0, k + 1.0), a[1 : k + 1], slope[:k][::-1])
        parts.append(found * constant(1.0 / k))
    return _joined(parts)


def _exp(a: Jet) -> Jet:
    parts = [_monotone(np.exp, a)]
    for k in range(1, len(a.c)):
        found = _summed(np.arange(1.0, k + 1.0), a[1 : k + 1], _joined(parts)[::-1])
        parts.append(found * constant(1.0 / k))
    return _joined(parts)


ONE: Final = constant(1.0, 0.0)
FUNCTIONS: Final[dict[str, Callable[[Jet], Jet]]] = {
    "neg": lambda a: -a,
    "sin": lambda a: _waves(a)[0],
    "cos": lambda a: _waves(a)[1],
    "tan": lambda a: _quotient(*_waves(a)),
    "sinh": lambda a: _hyperbola(a)[0],
    "cosh": lambda a: _hyperbola(a)[1],
    "tanh": lambda a: _quotient(*_hyperbola(a)),
    "exp": _exp,
    "sqrt": lambda a: power(a, 0.5),
    "log": lambda a: _integrated(_monotone(np.log, _positive(a)), a, _inverse(a)),
    "atan": lambda a: _integrated(_monotone(np.arctan, a), a, _inverse(ONE + a * a)),
    "asin": lambda a: _integrated(_monotone(np.arcsin, a), a, power(ONE - a * a, -0.5)),
    "acos": lambda a: _integrated(_monotone(np.arccos, a), a, -power(ONE - a * a, -0.5)),
    "asinh": lambda a: _integrated(_monotone(np.arcsinh, a), a, power(ONE + a * a, -0.5)),
}  # fmt: skip
OPERATIONS: Final[dict[str, Callable[[Jet, Jet], Jet]]] = {
    "add": lambda a, b: a + b,
    "mul": lambda a, b: a * b,
    "div": _quotient,
}


@lru_cache(maxsize=LONGEST)
def _exact(text: str) -> Fraction:
    if not _NUMBER.fullmatch(text):
        raise ReplayError(f"{text[:40]!r} is read where a fraction is needed")
    return Fraction(text)


def run(program: Sequence[Sequence[Any]], s: Jet, t: Jet) -> list[Jet]:
    """Return the values of all rows of a program at two parameters.

    Where these have one radius for all places, so have the values.
    """
    values: list[Jet] = []
    coarse = s.r.size == t.r.size == 1 == len(s.c) == len(t.c)
    if len(program) > LONGEST:
        raise ReplayError(f"a program of more than {LONGEST} rows")
    for op, *rest in program:
        if op == "number":
            exact = _exact(rest[0])
            values.append(constant(float(exact), 0.0 if float(exact) == exact else UNIT))
        elif op == "constant":
            values.append(constant({"pi": pi, "e": float(np.e)}[rest[0]]))
        elif op == "symbol":
            values.append((s, t)[rest[0]])
        elif op == "power":
            base, exponent = values[rest[0]], _exact(rest[1])
            if float(exponent) != exponent or abs(exponent) > 1000:
                raise ReplayError(f"the exponent {exponent}: no binary fraction, or too large")
            whole = exponent.denominator == 1
            found = _whole_power(base, int(exponent)) if whole else power(base, float(exponent))
            values.append(found)
        elif op in FUNCTIONS:
            values.append(FUNCTIONS[op](values[rest[0]]))
        elif op in OPERATIONS:
            values.append(OPERATIONS[op](values[rest[0]], values[rest[1]]))
        else:
            raise ReplayError(f"the operation {op!r}, which is not known here")
        if coarse:
            values[-1] = values[-1].coarse
    return values
