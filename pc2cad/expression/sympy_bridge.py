"""Expressions to and from SymPy, tree by tree.

No text is handed to SymPy, which would evaluate it: symbols are made here, and a SymPy expression
is read node by node.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import reduce
from typing import Any

import sympy
from sympy.core.function import AppliedUndef

from pc2cad.errors import InputError
from pc2cad.expression.functions import FUNCTIONS, PUBLIC_FUNCTIONS
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
_NAMES = {"Abs": "abs"}


def from_sympy(expression: Any) -> Expr:
    """Return the tree of a SymPy expression; raise NotTranslatableError for what has no tree.

    Floats stand for the decimals they print as.
    """
    if not isinstance(expression, sympy.Basic):
        raise NotTranslatableError(f"{type(expression).__name__} is no scalar expression of SymPy")
    done: dict[Any, Expr] = {}
    for node in sympy.postorder_traversal(expression):
        if node not in done:
            done[node] = _tree(node, [done[arg] for arg in node.args])
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
    if isinstance(node, AppliedUndef):
        raise NotTranslatableError(
            f"{type(node).__name__} is a function without a definition; put an expression in its "
            "place"
        )
    name = _NAMES.get(type(node).__name__, type(node).__name__)
    if name in PUBLIC_FUNCTIONS and FUNCTIONS[name].arity == len(args):
        return call(name, *args)
    raise NotTranslatableError(f"SymPy's {type(node).__name__} has no counterpart in the language")


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
    return getattr(sympy, node.op)(*args)


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
