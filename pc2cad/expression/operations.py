"""What a node of a tree does to arrays: its operation, and the nodes that it takes values of."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from pc2cad.expression.functions import FUNCTIONS
from pc2cad.expression.piece_values import Value, from_rows, from_table
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr
from pc2cad.expression.wave_values import values

#: values of the operands to that of a node
Run = Callable[..., Value]

_BINARY: Final[dict[str, Callable[[Value, Value], Value]]] = {
    "add": np.add,
    "mul": np.multiply,
    "div": np.divide,
}


def operands(node: Expr) -> tuple[Expr, ...]:
    """Return what a program works out before the node: no coefficients of pieces, if constant."""
    table = node.op == "pieces" and not any(c.symbols for c in node.args[1:])
    return node.args[:1] if table else node.args


def worked_from(node: Expr) -> tuple[Expr, ...]:
    """Return what has to be worked out before a node: a difference is one operation, not two."""
    if node.op == "add":
        a, b = node.args
        if b.op == "neg":
            return a, b.args[0]
        if a.op == "neg":
            return b, a.args[0]
        return node.args
    return operands(node) if node.op == "pieces" else node.args


def operation(node: Expr) -> Run:
    """Return the operation of a node on the values of its operands."""
    op, payload = node.op, node.payload
    if op == "add" and "neg" in (node.args[0].op, node.args[1].op):
        return np.subtract
    if op in _BINARY:
        return _BINARY[op]
    if op == "constant":
        value = np.float64(np.pi if payload == "pi" else np.e)
        return lambda: value
    if op == "neg":
        return np.negative
    if op == "pow":
        return _power_step(node.args[1])
    if op == "pieces":
        return _pieces_step(node)
    if op == "fourier":
        return partial(values, payload)
    if op in _CHOICES:
        return _CHOICES[op]
    function: Run = getattr(np, FUNCTIONS[op].numpy_name)
    return function


def _where(condition: Value, a: Value, b: Value) -> Value:
    chosen = np.where(condition >= 0, a, b)
    return np.where(np.isnan(condition), np.nan, chosen) if np.isnan(condition).any() else chosen


def _within(t: Value, low: Value, high: Value) -> Value:
    return np.where((t >= low) & (t <= high), t, np.nan)


_CHOICES: Final[dict[str, Run]] = {"where": _where, "within": _within}


def _power_step(exponent: Expr) -> Run:
    if exponent.op != "number" or exponent.payload.denominator != 1:
        return np.power
    n = int(exponent.payload)
    if 0 < n <= 8:
        return lambda a, _: _integer_power(a, n)
    return lambda a, _: np.power(a, float(n))


def _integer_power(a: Value, n: int) -> Value:
    """Multiply repeatedly: faster than np.power and right to an ulp or two."""
    result = None
    while n:
        if n & 1:
            result = a if result is None else result * a
        n >>= 1
        if n:
            a = a * a
    return result


def _pieces_step(node: Expr) -> Run:
    width = node.payload[1]
    if not node.symbols:
        constant = np.float64(evaluate(node, {}))
        return lambda *_: constant
    if len(operands(node)) > 1:
        return from_rows
    table = [float(c.payload) if c.op == "number" else evaluate(c, {}) for c in node.args[1:]]
    return partial(from_table, np.array(table).reshape(-1, width).T.copy())
