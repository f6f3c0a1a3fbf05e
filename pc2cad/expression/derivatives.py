"""Derivatives of expression trees."""

from __future__ import annotations

from functools import lru_cache

from pc2cad.expression.budget import is_counted
from pc2cad.expression.functions import FUNCTIONS
from pc2cad.expression.recent import Recent
from pc2cad.expression.tree import (
    ANALYTIC,
    ONE,
    ZERO,
    Expr,
    add,
    call,
    div,
    mul,
    neg,
    number,
    piece_rows,
    pieces,
)
from pc2cad.expression.waves import partials


def derivatives(roots: tuple[Expr, ...], name: str) -> tuple[Expr, ...]:
    """Return the partial derivatives of the trees with respect to the symbol `name`.

    The derivative of abs is the sign; at 0, where there is none, it evaluates to 0.
    """
    known = Recent[Expr]() if is_counted() else _known(name)
    done = known.of(roots, _derivative, lambda node: None if name in node.symbols else ZERO)
    return tuple([done[root] for root in roots])


@lru_cache(maxsize=8)
def _known(_: str) -> Recent[Expr]:
    """Return the derivatives that are remembered: variants have most of their trees in common."""
    return Recent()


def _derivative(node: Expr, done: dict[Expr, Expr]) -> Expr:
    op, args = node.op, node.args
    if op == "symbol":
        return ONE
    if op == "add":
        return add(done[args[0]], done[args[1]])
    if op == "neg":
        return neg(done[args[0]])
    if op == "mul":
        return add(mul(done[args[0]], args[1]), mul(args[0], done[args[1]]))
    if op == "div":
        return div(add(done[args[0]], neg(mul(node, done[args[1]]))), args[1])
    if op == "pow":
        return _power_derivative(node, done)
    if op == "pieces":
        return _pieces_derivative(node, done)
    if op == "within":
        return done[args[0]]
    if op in ("min", "max", "where"):
        # of the operand that is taken, and of no other: that may have none
        condition = {"min": args[-1] - args[0], "max": args[0] - args[-1]}.get(op, args[0])
        return call("where", condition, done[args[-2]], done[args[-1]])
    along = partials(node.payload, *args) if op == "fourier" else FUNCTIONS[op].partials(args)
    total = ZERO
    for partial, arg in zip(along, args, strict=True):
        total = total + partial * done[arg]
    return total


def _power_derivative(node: Expr, done: dict[Expr, Expr]) -> Expr:
    base, exponent = node.args
    result = exponent * base ** (exponent - 1) * done[base]
    if done[exponent] is not ZERO:
        result = result + node * call("log", base) * done[exponent]
    return result


def _pieces_derivative(node: Expr, done: dict[Expr, Expr]) -> Expr:
    breaks, width, smoothness, closed = node.payload
    rows = piece_rows(node)
    inner, place = done[node.args[0]], node.args[0]
    if place.op == "within":  # its name stands for the values
        place = place.payload.derivative.rebuilt(place.args)
    lower = smoothness if smoothness == ANALYTIC else smoothness - 1
    along = tuple(tuple(row[k] * number(k) for k in range(1, width)) or (ZERO,) for row in rows)
    result = pieces(place, breaks, along, lower, closed) * inner
    # the coefficients may depend on the parameters as well, and on that of the pieces
    across = tuple(tuple(done[c] for c in row) for row in rows)
    after = smoothness if inner is ZERO else lower
    return result + pieces(place, breaks, across, after, closed)
