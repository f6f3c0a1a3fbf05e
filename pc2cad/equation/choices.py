"""Choices between scalars, points and vectors, as Python writes them."""

from __future__ import annotations

from functools import partial, reduce

from pc2cad.equation.points import Combination, Value, chosen
from pc2cad.expression.conditions import Condition, as_condition
from pc2cad.expression.tree import Expr, Number, as_expr, call


def minimum(a: Expr | Number, *others: Expr | Number) -> Expr:
    """Return the smallest of some numbers."""
    return reduce(partial(call, "min"), map(as_expr, others), as_expr(a))


def maximum(a: Expr | Number, *others: Expr | Number) -> Expr:
    """Return the largest of some numbers."""
    return reduce(partial(call, "max"), map(as_expr, others), as_expr(a))


def clamp(x: Expr | Number, low: Expr | Number, high: Expr | Number) -> Expr:
    """Return x, or the limit that it passes."""
    return minimum(maximum(x, low), high)


def sign(x: Expr | Number) -> Expr:
    """Return 1, 0 or -1: the sign of x."""
    return call("sign", as_expr(x))


def floor(x: Expr | Number) -> Expr:
    """Return the largest whole number that is not larger than x."""
    return call("floor", as_expr(x))


def mod(x: Expr | Number, m: Expr | Number) -> Expr:
    """Return x - m floor(x/m), which lies in [0, m); m is positive."""
    return call("mod", as_expr(x), as_expr(m))


def hypot(x: Expr | Number, y: Expr | Number) -> Expr:
    """Return the square root of x² + y²."""
    return call("sqrt", as_expr(x) ** 2 + as_expr(y) ** 2)


def where(condition: Condition | bool, a: Value | Number, b: Value | Number) -> Value:
    """Return a where a condition such as ``u < 0.5`` holds, else b.

    Both are scalars, both points or both free vectors. Conditions are joined by ``&``, ``|`` and
    ``~``, with brackets round comparisons. Raises InputError for values of two kinds.
    """
    first, second = (x if isinstance(x, Combination) else as_expr(x) for x in (a, b))
    return chosen(as_condition(condition), first, second)
