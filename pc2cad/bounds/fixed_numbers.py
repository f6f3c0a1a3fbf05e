"""Trees without symbols: their values in double precision, and how far these may be off.

As models they would cost what functions cost, for one number.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from math import cos, e, inf, isfinite, nan, pi, prod, sin, sqrt
from typing import Final

from pc2cad.bounds.taylor_models import LIBRARY, TINY, UNIT
from pc2cad.expression.recent import Recent
from pc2cad.expression.tree import Expr

#: a value, and a bound of how far it, or what a program computes in its place, is off
Fixed = tuple[float, float]
#: what is known of a tree that is not worked out here
UNKNOWN: Final[Fixed] = (nan, inf)
#: whole powers that are worked out here, and those up to which they are products
_MOST_POWER: Final = 64
_LARGEST_PRODUCT: Final = 8

_known: Final[Recent[Fixed]] = Recent()


def fixed(root: Expr) -> Fixed:
    """Return the value of a tree without symbols, and how far it may be off; or `UNKNOWN`."""
    found = _known.get(root)
    if found is None:
        found = _known.of((root,), _found, lambda _: None, worst=UNKNOWN).get(root, UNKNOWN)
    return found


def rounded(exact: Fraction) -> Fixed:
    """Return a number in double precision, and how far it may be off."""
    value = float(exact)
    return value, 0.0 if value == exact else UNIT * abs(value)


def _found(node: Expr, known: dict[Expr, Fixed]) -> Fixed:
    if node.op == "number":
        return rounded(node.payload)
    if node.op == "constant":
        value = pi if node.payload == "pi" else e
        return value, UNIT * value
    work = _power if node.op == "pow" else _WORK.get(node.op)
    if work is None:
        return UNKNOWN
    try:
        value, off = work(*(known[arg] for arg in node.args))
    except (ValueError, OverflowError, ZeroDivisionError):
        return UNKNOWN
    # the bound's own few operations round, too
    off = off * (1 + 1e-12) + TINY
    return (value, off) if isfinite(value) and isfinite(off) else UNKNOWN


def _add(x: Fixed, y: Fixed) -> Fixed:
    value, off = x[0] + y[0], x[1] + y[1]
    return value, off + UNIT * (abs(value) + off)


def _neg(x: Fixed) -> Fixed:
    return -x[0], x[1]


def _mul(x: Fixed, y: Fixed) -> Fixed:
    (a, p), (b, q) = x, y
    value, off = a * b, abs(a) * q + (abs(b) + q) * p
    return value, off + UNIT * (abs(value) + off)


def _div(x: Fixed, y: Fixed) -> Fixed:
    (a, p), (b, q) = x, y
    value, least = a / b, abs(b) - q
    if least <= 0:
        return UNKNOWN
    off = (p + abs(value) * q) / least
    return value, off + UNIT * (abs(value) + off)


def _root(x: Fixed) -> Fixed:
    a, p = x
    value = sqrt(a)
    off = p / sqrt(a - p)
    return value, off + UNIT * (value + off)


def _power(x: Fixed, y: Fixed) -> Fixed:
    (a, p), (n, inexact) = x, y
    if inexact or not n.is_integer() or not 0 < abs(n) <= _MOST_POWER:
        return UNKNOWN
    # small powers are products, each of which rounds; others are the library's
    is_product = 0 < n <= _LARGEST_PRODUCT
    value = prod([a] * int(n)) if is_product else a**n
    # the slope is steepest at the largest values, or at the smallest
    most = abs(a) + p if n > 0 else abs(a) - p
    if most <= 0:
        return UNKNOWN
    off = p * abs(n) * most ** (n - 1)
    return value, off + (n * UNIT if is_product else LIBRARY) * (abs(value) + off)


def _wave(value: float, off: float) -> Fixed:
    return value, off + LIBRARY * (abs(value) + off)


def _sine(x: Fixed) -> Fixed:
    return _wave(sin(x[0]), x[1])


def _cosine(x: Fixed) -> Fixed:
    return _wave(cos(x[0]), x[1])


_WORK: Final[dict[str, Callable[..., Fixed]]] = {
    "add": _add, "neg": _neg, "mul": _mul, "div": _div, "sqrt": _root, "sin": _sine, "cos": _cosine,
}  # fmt: skip
