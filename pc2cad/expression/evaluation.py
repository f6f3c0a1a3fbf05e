"""Vectorised evaluation of expression trees with NumPy.

A tuple of trees becomes a straight-line program in which every common sub-tree occurs once. Each
operation works on arrays of the shape that its own parameters need: on an open grid, with u of
shape (n,1,1), v of (1,m,1) and w of (1,1,k), whatever depends on u alone is evaluated n times and
not n·m·k times. This factoring by parameter is what makes channels fast.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from pc2cad.expression.functions import FUNCTIONS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, operands, walk
from pc2cad.expression.wave_values import values

Value = Any  # a float or an array of any broadcastable shape

_BINARY: dict[str, Callable[[Value, Value], Value]] = {
    "add": np.add,
    "mul": np.multiply,
    "div": np.divide,
}


class Program:
    """Straight-line program of some trees; call it with one array (or float) per symbol."""

    def __init__(self, roots: tuple[Expr, ...]) -> None:
        nodes = list(walk(roots, _operands))
        index = {node: i for i, node in enumerate(nodes)}
        before = [tuple(index[arg] for arg in _operands(node)) for node in nodes]
        last = list(range(len(nodes)))
        for i, row in enumerate(before):
            for k in row:
                last[k] = i
        self._outputs = tuple(index[root] for root in roots)
        kept = set(self._outputs)
        frees: list[list[int]] = [[] for _ in nodes]
        #: values of the nodes that hold no symbol, worked out once
        self._constants: list[Value] = [None] * len(nodes)
        self._symbols: list[tuple[int, str]] = []
        self._steps: list[tuple[int, _Run, tuple[int, ...], list[int]]] = []
        with np.errstate(all="ignore"):
            for i, node in enumerate(nodes):
                if node.symbols and i not in kept:
                    frees[last[i]].append(i)
                if node.op == "symbol":
                    self._symbols.append((i, node.payload))
                elif node.symbols:
                    self._steps.append((i, _step(node), before[i], frees[i]))
                else:
                    self._constants[i] = _step(node)(*(self._constants[k] for k in before[i]))

    def __call__(self, values: Mapping[str, Value]) -> tuple[Value, ...]:
        """Evaluate all trees; the results have the broadcast shape of what each one depends on.

        Values outside a function's domain come out as nan or inf, without a warning: the caller
        decides whether a place is a fault.
        """
        store = self._constants.copy()
        for i, name in self._symbols:
            store[i] = values[name]
        with np.errstate(all="ignore"):
            for i, run, before, frees in self._steps:
                if len(before) == 2:
                    store[i] = run(store[before[0]], store[before[1]])
                elif len(before) == 1:
                    store[i] = run(store[before[0]])
                else:
                    store[i] = run(*(store[k] for k in before))
                for k in frees:
                    store[k] = None
        return tuple(store[k] for k in self._outputs)


_Run = Callable[..., Value]


def _operands(node: Expr) -> tuple[Expr, ...]:
    """Return what has to be worked out before a node: a difference is one operation, not two."""
    if node.op == "add":
        a, b = node.args
        if b.op == "neg":
            return a, b.args[0]
        if a.op == "neg":
            return b, a.args[0]
    return operands(node)


def _step(node: Expr) -> _Run:
    """Return the operation of a node on the values of its operands."""
    op, payload = node.op, node.payload
    if op == "add" and _operands(node) != node.args:
        return np.subtract
    if op == "number":
        constant = np.float64(float(payload))
        return lambda: constant
    if op == "constant":
        value = np.float64(np.pi if payload == "pi" else np.e)
        return lambda: value
    if op in _BINARY:
        return _BINARY[op]
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
    function: _Run = getattr(np, FUNCTIONS[op].numpy_name)
    return function


def _where(condition: Value, a: Value, b: Value) -> Value:
    chosen = np.where(condition >= 0, a, b)
    return np.where(np.isnan(condition), np.nan, chosen) if np.isnan(condition).any() else chosen


def _within(t: Value, low: Value, high: Value) -> Value:
    return np.where((t >= low) & (t <= high), t, np.nan)


_CHOICES: dict[str, _Run] = {"where": _where, "within": _within}


def _power_step(exponent: Expr) -> _Run:
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


def _pieces_step(node: Expr) -> _Run:
    breaks, width, _, closed = node.payload
    knots = np.array([float(b) for b in breaks])
    period = knots[-1] - knots[0]
    table = None
    if len(operands(node)) == 1:
        table = np.array(
            [float(c.payload) if c.op == "number" else evaluate(c, {}) for c in node.args[1:]]
        ).reshape(-1, width)

    def run(t: Value, *flat: Value) -> Value:
        if closed:
            # the closing break belongs to the last piece of its own turn, so that one-sided
            # derivatives at the end of a domain are those from inside
            inside = (t >= knots[0]) & (t <= knots[-1])
            t = np.where(inside, t, (t - knots[0]) % period + knots[0])
        index = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
        local = t - knots[index]
        value: Value = 0.0
        for k in reversed(range(width)):
            if table is not None:
                value = value * local + table[index, k]
                continue
            column = flat[k::width]
            if all(np.ndim(c) == 0 for c in column):
                coefficient = np.asarray(column)[index]
            else:
                coefficient = column[0]
                for i in range(1, len(column)):
                    coefficient = np.where(index == i, column[i], coefficient)
            value = value * local + coefficient
        return value

    return run
