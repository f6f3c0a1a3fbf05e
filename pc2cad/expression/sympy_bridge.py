"""Expressions to and from SymPy, tree by tree.

No text is handed to SymPy, which would evaluate it: symbols are made here, and a SymPy expression
is read node by node.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import partial, reduce
from typing import Any

import sympy
from sympy.core.function import AppliedUndef

from pc2cad.errors import InputError
from pc2cad.expression.conditions import Condition, both, compared, either
from pc2cad.expression.functions import FUNCTIONS, PUBLIC_FUNCTIONS, REPEATED
from pc2cad.expression.tree import (
    PI,
    E,
    Expr,
    add,
    call,
    mul,
    number,
    piece_rows,
    power,
    symbol,
    walk,
)


class NotTranslatableError(InputError):
    """An expression has a part that the other side does not have."""


#: SymPy's name of a function where it differs from ours
_NAMES = {"Abs": "abs", "Min": "min", "Max": "max", "Mod": "mod"}


def from_sympy(expression: Any) -> Expr:
    """Return the tree of a SymPy expression; raise NotTranslatableError for what has no tree.

    Floats stand for the decimals they print as.
    """
    if not isinstance(expression, sympy.Basic):
        raise NotTranslatableError(f"{type(expression).__name__} is no scalar expression of SymPy")
    done: dict[Any, Expr] = {}
    below = sympy.preorder_traversal(expression)
    nodes = []
    for node in below:
        nodes.append(node)
        if isinstance(node, sympy.Piecewise):
            below.skip()  # its conditions are no expressions
    for node in reversed(nodes):
        if node not in done:
            done[node] = _tree(node, [done[arg] for arg in node.args if arg in done])
    return done[expression]


def _tree(node: Any, args: list[Expr]) -> Expr:
    if node.is_Symbol:
        return symbol(str(node.name))
    if node.is_Rational:
        return number(Fraction(int(node.p), int(node.q)))
    if node.is_Float:
        return number(float(node))
    if node is sympy.pi or node is sympy.E:
        return PI if node is sympy.pi else E
    if node.is_Add or node.is_Mul:
        return reduce(add if node.is_Add else mul, args)
    if node.is_Pow:
        return call("exp", args[1]) if args[0] is E else power(args[0], args[1])
    if isinstance(node, sympy.Piecewise):
        return _choice(node)
    if isinstance(node, AppliedUndef):
        raise NotTranslatableError(
            f"{type(node).__name__} is a function without a definition; put an expression in its "
            "place"
        )
    name = _NAMES.get(type(node).__name__, type(node).__name__)
    if name in REPEATED:
        return reduce(partial(call, name), args)
    if name in PUBLIC_FUNCTIONS and FUNCTIONS[name].arity == len(args):
        return call(name, *args)
    raise NotTranslatableError(f"SymPy's {type(node).__name__} has no counterpart in the language")


def _choice(node: Any) -> Expr:
    """Return a Piecewise; beyond its branches it has no value, and the last one stands there."""
    *first, (value, _) = node.args
    result = from_sympy(value)
    for branch, condition in reversed(first):
        result = _condition(condition).choose(from_sympy(branch), result)
    return result


def _condition(node: Any) -> Condition:
    if isinstance(node, (sympy.And, sympy.Or)):
        joined = [_condition(arg) for arg in node.args]
        return reduce(both if isinstance(node, sympy.And) else either, joined)
    if isinstance(node, sympy.Not):
        return ~_condition(node.args[0])
    if isinstance(node, (sympy.Ge, sympy.Gt, sympy.Le, sympy.Lt)):
        left, right = (from_sympy(side) for side in node.args)
        return compared(left, node.rel_op, right)
    raise NotTranslatableError(f"SymPy's condition {type(node).__name__} has no counterpart here")


def to_sympy(tree: Expr) -> Any:
    """Return the SymPy expression of a tree; all symbols are real."""
    done: dict[Expr, Any] = {}
    for node in walk((tree,)):
        done[node] = _expression(node, [done[arg] for arg in node.args])
    return done[tree]


_OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "pow": lambda a, b: a**b,
    "neg": lambda a: -a,
    "abs": sympy.Abs,
    "min": sympy.Min,
    "max": sympy.Max,
    "mod": sympy.Mod,
    "where": lambda g, a, b: sympy.Piecewise((a, g >= 0), (b, True)),
    "within": lambda t, low, high: t,
}


def _expression(node: Expr, args: list[Any]) -> Any:
    if node.op == "number":
        return sympy.Rational(node.payload.numerator, node.payload.denominator)
    if node.op == "constant":
        return sympy.pi if node.payload == "pi" else sympy.E
    if node.op == "symbol":
        return sympy.Symbol(node.payload, real=True)
    if node.op in _OPERATIONS:
        return _OPERATIONS[node.op](*args)
    if node.op == "pieces":
        return _pieces(node, args)
    if node.op == "fourier":
        return _series(node, *args)
    return getattr(sympy, node.op)(*args)


def _series(node: Expr, theta: Any, phi: Any) -> Any:
    terms = []
    for m, k, c, s in node.payload.rows:
        angle = m * theta - k * phi
        cos, sin = (sympy.Rational(x.numerator, x.denominator) for x in (c, s))
        terms.append(cos * sympy.cos(angle) + sin * sympy.sin(angle))
    return sympy.Add(*terms)


def _pieces(node: Expr, args: list[Any]) -> Any:
    breaks, width, _, closed = node.payload
    first, period = breaks[0], breaks[-1] - breaks[0]
    start = sympy.Rational(first.numerator, first.denominator)
    turn = sympy.Rational(period.numerator, period.denominator)
    t = start + sympy.Mod(args[0] - start, turn) if closed else args[0]
    branches = []
    for i in range(len(piece_rows(node))):
        low = sympy.Rational(breaks[i].numerator, breaks[i].denominator)
        high = sympy.Rational(breaks[i + 1].numerator, breaks[i + 1].denominator)
        row = args[1 + i * width : 1 + (i + 1) * width]
        last = not closed and i == len(breaks) - 2
        branches.append((sum(c * (t - low) ** k for k, c in enumerate(row)), last or t < high))
    return sympy.Piecewise(*branches)
