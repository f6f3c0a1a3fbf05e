"""Power series of expression trees at one end of a parameter, with a bound of what is left.

The coefficients are worked out by the recurrences of automatic differentiation, in intervals: at
the end itself they are the series', over an interval from there on the last one is Lagrange's
remainder.

Source: R. E. Moore, Methods and Applications of Interval Analysis (1979), chapter 3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.enclosures import enclose
from pc2cad.expression.intervals import Interval, enclosed_number, interval
from pc2cad.expression.tree import Expr, call, number, symbol, walk

#: coefficients, all over the same intervals; None where one is 0
Series = list[Interval | None]


@dataclass(frozen=True, eq=False)
class SeriesAt:
    """Coefficients at 0, and over [0, reach] for each reach: (n,) and (n, len(reaches))."""

    #: enclosures at 0 itself
    lower: Array
    upper: Array
    #: bounds of the size of the coefficients over the intervals
    largest: Array


def series_at_zero(
    tree: Expr, name: str, count: int, reaches: tuple[float, ...]
) -> SeriesAt | None:
    """Return coefficients of a function of one parameter at 0; None where it has no such series."""
    base = interval(np.zeros(len(reaches) + 1), np.array([0.0, *reaches]))
    done: dict[Expr, Series] = {}
    with np.errstate(all="ignore"):
        for node in walk((tree,)):
            found = _of(node, name, [done[arg] for arg in node.args], base, count)
            if found is None:
                return None
            done[node] = found
    zeros = np.zeros(len(reaches) + 1)
    rows = [zeros if c is None else c.lower + zeros for c in done[tree]]
    tops = [zeros if c is None else c.upper + zeros for c in done[tree]]
    lower, upper = np.array(rows), np.array(tops)
    sizes = np.maximum(np.abs(lower), np.abs(upper))[:, 1:]
    return SeriesAt(lower[:, 0], upper[:, 0], np.where(np.isfinite(sizes), sizes, np.inf))


def _of(node: Expr, name: str, args: list[Series], base: Interval, n: int) -> Series | None:
    op = node.op
    if name not in node.symbols:
        value = enclose(node, tuple(a[0] or interval(0.0) for a in args))
        return [None if node.op == "number" and not node.payload else value, *[None] * (n - 1)]
    if op == "symbol":
        return [base, interval(1.0), *[None] * (n - 2)]
    if op == "add":
        return [_plus(a, b) for a, b in zip(*args, strict=True)]
    if op == "neg":
        return [None if a is None else -a for a in args[0]]
    if op == "mul":
        return _product(args[0], args[1])
    if op == "div":
        return _quotient(args[0], args[1])
    if op == "pow":
        return _power(args[0], node.args[1])
    rule = _RULES.get(op)
    return None if rule is None else rule(node, args[0])


def _plus(a: Interval | None, b: Interval | None) -> Interval | None:
    if a is None or b is None:
        return a or b
    return a + b


def _times(a: Interval | None, b: Interval | None) -> Interval | None:
    return None if a is None or b is None else a * b


def _sum(a: Series, b: Series, k: int, first: int, last: int) -> Interval | None:
    """Return the sum of a_j b_(k-j) for j from `first` to `last`."""
    total = None
    for j in range(first, last + 1):
        total = _plus(total, _times(a[j], b[k - j]))
    return total


def _product(a: Series, b: Series) -> Series:
    return [_sum(a, b, k, 0, k) for k in range(len(a))]


def _quotient(a: Series, b: Series) -> Series | None:
    if b[0] is None:
        return None
    found: Series = []
    for k in range(len(a)):
        rest = _sum(found, b, k, 0, k - 1)
        top = _plus(a[k], None if rest is None else -rest)
        found.append(None if top is None else top / b[0])
    return found


def _scaled(a: Interval | None, factor: Fraction) -> Interval | None:
    return None if a is None or factor == 0 else a * enclosed_number(factor)


def _power(a: Series, exponent: Expr) -> Series | None:
    """Return a constant power."""
    if exponent.op != "number":
        return None
    p: Fraction = exponent.payload
    if p.denominator == 1 and p > 0:
        result = a
        for _ in range(int(p) - 1):
            result = _product(result, a)
        return result
    if a[0] is None or not (a[0].lower > 0).all():
        return None
    found: Series = [enclose(symbol("x") ** exponent, (a[0], enclosed_number(p)))]
    for k in range(1, len(a)):
        total = None
        for j in range(1, k + 1):
            term = _times(a[j], found[k - j])
            total = _plus(total, _scaled(term, p * j - (k - j)))
        found.append(None if total is None else total / (a[0] * enclosed_number(Fraction(k))))
    return found


def _derived(a: Series) -> Series:
    return [*(_scaled(c, Fraction(k)) for k, c in enumerate(a) if k), None]


def _pair(node: Expr, a: Series) -> tuple[Series, Series]:
    """Return sine and cosine, or hyperbolic ones, of a series."""
    turning = node.op in ("sin", "cos", "tan")
    names = ("sin", "cos") if turning else ("sinh", "cosh")
    base, slope = a[0] or interval(0.0), _derived(a)
    sine: Series = [enclose(call(names[0], symbol("x")), (base,))]
    cosine: Series = [enclose(call(names[1], symbol("x")), (base,))]
    for k in range(len(a) - 1):
        share = Fraction(1, k + 1)
        rising, falling = _sum(cosine, slope, k, 0, k), _sum(sine, slope, k, 0, k)
        sine.append(_scaled(rising, share))
        cosine.append(_scaled(falling, -share if turning else share))
    return sine, cosine


def _exponential(node: Expr, a: Series) -> Series:
    slope, found = _derived(a), [*_start(node, a)]
    for k in range(len(a) - 1):
        found.append(_scaled(_sum(found, slope, k, 0, k), Fraction(1, k + 1)))
    return found


def _tangent(node: Expr, a: Series) -> Series | None:
    return _quotient(*_pair(node, a))


def _start(node: Expr, a: Series) -> Series:
    return [enclose(node, (a[0] or interval(0.0),))]


def _arc(node: Expr, a: Series) -> Series | None:
    """Return the logarithm, or an inverse function, from its derivative."""
    if node.op == "log":
        slope = _quotient(_derived(a), a)
    else:
        square = _product(a, a)
        sign = -1 if node.op in ("asin", "acos", "atanh", "acosh") else 1
        one = interval(-1.0 if node.op == "acosh" else 1.0)
        below = [_scaled(c, Fraction(-sign if node.op == "acosh" else sign)) for c in square]
        below[0] = _plus(one, below[0])
        if node.op in ("atan", "atanh"):
            slope = _quotient(_derived(a), below)
        else:
            root = _power(below, number(Fraction(-1, 2)))
            slope = None if root is None else _product(_derived(a), root)
    if slope is None:
        return None
    rest = [_scaled(c, Fraction(-1 if node.op == "acos" else 1, k + 1))
            for k, c in enumerate(slope[:-1])]  # fmt: skip
    return [*_start(node, a), *rest]


_Rule = Callable[[Expr, Series], Series | None]
_RULES: Final[dict[str, _Rule]] = {
    "sin": lambda node, a: _pair(node, a)[0],
    "cos": lambda node, a: _pair(node, a)[1],
    "sinh": lambda node, a: _pair(node, a)[0],
    "cosh": lambda node, a: _pair(node, a)[1],
    "tan": _tangent,
    "tanh": _tangent,
    "exp": _exponential,
    "sqrt": lambda _, a: _power(a, number(Fraction(1, 2))),
    **dict.fromkeys(("log", "atan", "asin", "acos", "asinh", "acosh", "atanh"), _arc),
}
