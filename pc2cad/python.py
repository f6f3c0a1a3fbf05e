"""The equation language in Python: points, parameters, functions and operators of the calculus."""

from __future__ import annotations

from collections.abc import Sequence

from pc2cad.equation import curves
from pc2cad.equation.point_equation import PARAMETERS
from pc2cad.equation.points import (
    Combination,
    Value,
    cross,
    derivative,
    det,
    distance,
    dot,
    exit_from_plane,
    length,
    metric,
    point,
    translate,
    unit,
    vector,
)
from pc2cad.equation.tree import PI, E, Expr, Number, as_expr, call, symbol
from pc2cad.errors import InputError

__all__ = [
    "abs", "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "contour", "cos", "cosh",
    "cross", "det", "diff", "distance", "dot", "e", "exit_from_plane", "exp", "length", "log",
    "metric", "parameters", "pi", "point", "points", "polygon", "sin", "sine_wave", "sinh",
    "sqrt", "tan", "tanh", "translate", "unit", "vector",
]  # fmt: skip

pi = PI
e = E
abs = abs  # the built-in function takes expressions


def parameters() -> tuple[Expr, Expr, Expr]:
    """Return the three current parameters of a point equation, u, v and w."""
    u, v, w = (symbol(name) for name in PARAMETERS)
    return u, v, w


def points(**coordinates: Sequence[Expr | Number]) -> tuple[Combination, ...]:
    """Return one point per keyword, in order.

    For example ``A, B = points(A=(4, 0, 0), B=(1, 5, 1))``.
    """
    for name, given in coordinates.items():
        if len(given) != 3:
            raise InputError(f"the point {name} has {len(given)} coordinates instead of 3")
    return tuple(point(*given) for given in coordinates.values())


def diff(value: Value, parameter: Expr, order: int = 1) -> Value:
    """Return the derivative in u, v or w; that of a point is a free vector."""
    if parameter.op != "symbol" or parameter.payload not in PARAMETERS:
        raise InputError("diff takes the derivative in one of the parameters u, v and w")
    return derivative(value, parameter.payload, order)


def sin(x: Expr | Number) -> Expr:
    """Return the sine of x (radians)."""
    return call("sin", as_expr(x))


def cos(x: Expr | Number) -> Expr:
    """Return the cosine of x (radians)."""
    return call("cos", as_expr(x))


def tan(x: Expr | Number) -> Expr:
    """Return the tangent of x (radians)."""
    return call("tan", as_expr(x))


def asin(x: Expr | Number) -> Expr:
    """Return the arc sine of x."""
    return call("asin", as_expr(x))


def acos(x: Expr | Number) -> Expr:
    """Return the arc cosine of x."""
    return call("acos", as_expr(x))


def atan(x: Expr | Number) -> Expr:
    """Return the arc tangent of x."""
    return call("atan", as_expr(x))


def atan2(y: Expr | Number, x: Expr | Number) -> Expr:
    """Return the angle of the point (x, y)."""
    return call("atan2", as_expr(y), as_expr(x))


def sinh(x: Expr | Number) -> Expr:
    """Return the hyperbolic sine of x."""
    return call("sinh", as_expr(x))


def cosh(x: Expr | Number) -> Expr:
    """Return the hyperbolic cosine of x."""
    return call("cosh", as_expr(x))


def tanh(x: Expr | Number) -> Expr:
    """Return the hyperbolic tangent of x."""
    return call("tanh", as_expr(x))


def asinh(x: Expr | Number) -> Expr:
    """Return the inverse hyperbolic sine of x."""
    return call("asinh", as_expr(x))


def acosh(x: Expr | Number) -> Expr:
    """Return the inverse hyperbolic cosine of x."""
    return call("acosh", as_expr(x))


def atanh(x: Expr | Number) -> Expr:
    """Return the inverse hyperbolic tangent of x."""
    return call("atanh", as_expr(x))


def exp(x: Expr | Number) -> Expr:
    """Return e to the power x."""
    return call("exp", as_expr(x))


def log(x: Expr | Number) -> Expr:
    """Return the natural logarithm of x."""
    return call("log", as_expr(x))


def sqrt(x: Expr | Number) -> Expr:
    """Return the square root of x."""
    return call("sqrt", as_expr(x))


def contour(
    nodes: Sequence[tuple[Expr | Number, Expr | Number]],
    t: Expr,
    handle: Expr | Number | None = None,
) -> tuple[Expr, Expr]:
    """Return (x, y) at t of the closed C¹ contour through plane points; once round for t in [0, 1].

    `handle` is the share λ of the neighbours' chord that each Bézier handle takes (default 1/6).
    """
    plane = [(as_expr(x), as_expr(y)) for x, y in nodes]
    x, y = curves.contour(plane, as_expr(1) / 6 if handle is None else as_expr(handle))
    return x(t), y(t)


def polygon(corners: Sequence[tuple[Expr | Number, Expr | Number]], t: Expr) -> tuple[Expr, Expr]:
    """Return (x, y) at t of the closed polygon through plane points; once round for t in [0, 1]."""
    x, y = curves.polygon([(as_expr(x), as_expr(y)) for x, y in corners])
    return x(t), y(t)


def sine_wave(
    radius: Expr | Number, amplitude: Expr | Number, waves: int, t: Expr
) -> tuple[Expr, Expr]:
    """Return (x, y) at t of the sine wave r = R + h sin(nφ) round a circle, φ = 2πt."""
    x, y = curves.sine_wave(as_expr(radius), as_expr(amplitude), as_expr(waves))
    return x(t), y(t)
