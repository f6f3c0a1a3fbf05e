"""Functions of the equation's own parameter as trees in that of a spline that runs through arcs.

With y from -1 to 1 along an arc and s = τ y, an angle that grows by 4n atan τ over it is
θ = θ₀ + 2n atan s, and exp(ikθ) = exp(ikθ₀) (1 + is)^2nk / (1 + s²)^nk. So a trigonometric
polynomial is one of s over the denominator's power. Written so, it is interpolated by nothing: it
is its own polynomial.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache

from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import (
    Expr,
    call,
    number,
    pieces,
    polynomial,
    substitute,
    symbol,
    walk,
)
from pc2cad.geometry.splines.arcs import SAME_ANGLE, Arcs

#: a tree times a power of the denominator, and that power
_Form = tuple[Expr, int]


@lru_cache(maxsize=8)  # a face that is expected is asked for again
def along_arcs(
    trees: tuple[Expr, ...], name: str, arcs: Arcs, order: int
) -> tuple[tuple[Expr, ...], Expr]:
    """Return trees times the denominator to the power `order`, and that power, as trees.

    The named symbol is the equation's own parameter in what is given, and the spline's in what is
    returned. Trigonometric polynomials are polynomials then, if there is one arc.
    """
    weight = _weight(name, arcs, order)
    found = _numerators(trees, name, arcs, order) if arcs.count == 1 else None
    if found is None:
        found = substitute(tuple(trees), {name: _path(arcs, symbol(name))})
        found = tuple([weight * tree for tree in found])
    return found, weight


@lru_cache(maxsize=16)  # all faces along a direction have the same
def _weight(name: str, arcs: Arcs, order: int) -> Expr:
    """Return the denominator's power as a tree."""
    x = symbol(name)
    return _joined(arcs, x, [_denominator(arcs, y) for y in _within(arcs, x)]) ** order


def _numerators(
    trees: Sequence[Expr], name: str, arcs: Arcs, order: int
) -> tuple[Expr, ...] | None:
    """Return trees times the denominator's power over one arc, None where none is polynomial."""
    factor = _weight(name, arcs, 1)
    forms: dict[Expr, _Form] = {}
    for node in walk(tuple(trees), lambda n: () if _is_leaf(n, name) else n.args):
        args = [forms.get(arg, (arg, 0)) for arg in node.args]
        if node.op in ("sin", "cos") and name in node.symbols:
            form = _wave(node, name, arcs)
        else:
            form = _form(node, args, name, factor)
        if form is None:
            return None
        forms[node] = form
    found = [forms[tree] for tree in trees]
    if max(k for _, k in found) > order:
        return None
    return tuple([tree * factor ** (order - k) for tree, k in found])


def _is_leaf(node: Expr, name: str) -> bool:
    return name not in node.symbols or node.op in ("sin", "cos")


def _form(node: Expr, args: list[_Form], name: str, factor: Expr) -> _Form | None:
    """Return a node in terms of its operands' forms, None where it is no polynomial of those.

    `factor` is the denominator.
    """
    if name not in node.symbols:
        return node, 0
    if node.op == "neg":
        return -args[0][0], args[0][1]
    if node.op == "add":
        highest = max(k for _, k in args)
        a, b = [tree if k == highest else tree * factor ** (highest - k) for tree, k in args]
        return a + b, highest
    if node.op == "mul":
        return args[0][0] * args[1][0], args[0][1] + args[1][1]
    if node.op == "div" and name not in node.args[1].symbols:
        return args[0][0] / node.args[1], args[0][1]
    if node.op == "pow" and node.args[1].op == "number":
        exponent = node.args[1].payload
        if exponent.denominator == 1 and exponent > 0:
            return args[0][0] ** exponent, args[0][1] * int(exponent)
    return None


@lru_cache(maxsize=64)  # walls side by side have the same
def _wave(node: Expr, name: str, arcs: Arcs) -> _Form | None:
    """Return the sine or cosine of a whole multiple of the arc's angle, and that multiple."""
    (slope,) = derivatives(node.args, name)
    if slope.symbols:
        return None
    multiple = evaluate(slope, {}) / arcs.extent
    k = round(abs(multiple))
    if abs(abs(multiple) - k) > SAME_ANGLE * k:
        return None
    (middle,) = substitute(node.args, {name: number(Fraction(1, 2))})
    cosine, sine = _from_middle(name, arcs, k)
    if multiple < 0:
        sine = -sine
    c, s = call("cos", middle), call("sin", middle)
    return (c * cosine - s * sine if node.op == "cos" else s * cosine + c * sine), k


@lru_cache(maxsize=64)
def _from_middle(name: str, arcs: Arcs, k: int) -> tuple[Expr, Expr]:
    """Return cosine and sine of k times the angle from the middle of the one arc.

    Both are multiplied by the k-th power of the denominator.
    """
    (y,) = _within(arcs, symbol(name))
    tangent, degree = Fraction(arcs.tangent), 2 * k * arcs.parts
    row = [1 / (1 + tangent**2) ** (k * arcs.parts)]
    for j in range(degree):
        row.append(row[-1] * tangent * Fraction(degree - j, j + 1))
    # powers of i: real ones, and the others divided by i
    real = [number(c * (1, 0, -1, 0)[j % 4]) for j, c in enumerate(row)]
    other = [number(c * (0, 1, 0, -1)[j % 4]) for j, c in enumerate(row)]
    return polynomial(tuple(real), y), polynomial(tuple(other), y)


def _path(arcs: Arcs, x: Expr) -> Expr:
    """Return the equation's own parameter as a tree of the spline's, x (see `Arcs.places`)."""
    rows = [
        (
            k
            + Fraction(1, 2)
            + call("atan", number(arcs.tangent) * y) * number(1 / (2 * arcs.quarter))
        )
        / arcs.count
        for k, y in enumerate(_within(arcs, x))
    ]
    return _joined(arcs, x, rows)


def _denominator(arcs: Arcs, y: Expr) -> Expr:
    """Return the denominator of order 1 at a place of an arc as a tree (see `Arcs.weight`)."""
    square = number(arcs.tangent) ** 2
    return ((1 + square * y**2) / (1 + square)) ** arcs.parts


def _within(arcs: Arcs, x: Expr) -> list[Expr]:
    """Return the place on each arc, from -1 to 1."""
    return [2 * (x * arcs.count - k) - 1 for k in range(arcs.count)]


def _joined(arcs: Arcs, x: Expr, rows: list[Expr]) -> Expr:
    if arcs.count == 1:
        return rows[0]
    breaks = tuple(Fraction(k, arcs.count) for k in range(arcs.count + 1))
    return pieces(x, breaks, tuple((row,) for row in rows), 0, closed=False)
