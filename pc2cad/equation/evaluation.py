"""Vectorised evaluation of expression trees with NumPy.

A tuple of trees becomes a straight-line program in which every common sub-tree occurs once. Each
operation works on arrays of the shape that its own parameters need: on an open grid, with u of
shape (n,1,1), v of (1,m,1) and w of (1,1,k), whatever depends on u alone is evaluated n times and
not n·m·k times. This factoring by parameter is what makes channels fast.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pc2cad.equation.functions import FUNCTIONS
from pc2cad.equation.scalar import evaluate
from pc2cad.equation.tree import Expr, operands, program

Array = NDArray[np.float64]
Value = Any  # a float or an array of any broadcastable shape

_BINARY: dict[str, Callable[[Value, Value], Value]] = {
    "add": np.add,
    "mul": np.multiply,
    "div": np.divide,
}


class Program:
    """Straight-line program of some trees; call it with one array (or float) per symbol."""

    def __init__(self, roots: tuple[Expr, ...]) -> None:
        nodes = program(roots)
        index = {node: i for i, node in enumerate(nodes)}
        self._steps = [_step(node, tuple(index[arg] for arg in operands(node))) for node in nodes]
        self._outputs = tuple(index[root] for root in roots)
        last_use = {i: i for i in range(len(nodes))}
        for i, node in enumerate(nodes):
            for arg in operands(node):
                last_use[index[arg]] = i
        kept = set(self._outputs)
        self._frees: list[list[int]] = [[] for _ in nodes]
        for i, last in last_use.items():
            if i not in kept:
                self._frees[last].append(i)

    def __call__(self, values: Mapping[str, Value]) -> tuple[Value, ...]:
        """Evaluate all trees; the results have the broadcast shape of what each one depends on.

        Values outside a function's domain come out as nan or inf, without a warning: the caller
        decides whether a place is a fault.
        """
        store: list[Value] = [None] * len(self._steps)
        with np.errstate(all="ignore"):
            for i, (run, before) in enumerate(self._steps):
                store[i] = run(values, *(store[k] for k in before))
                for k in self._frees[i]:
                    store[k] = None
        return tuple(store[k] for k in self._outputs)


_Run = Callable[..., Value]


def _step(node: Expr, operands: tuple[int, ...]) -> tuple[_Run, tuple[int, ...]]:
    op, payload = node.op, node.payload
    if op == "number":
        constant = np.float64(float(payload))
        return (lambda values: constant), ()
    if op == "constant":
        value = np.float64(np.pi if payload == "pi" else np.e)
        return (lambda values: value), ()
    if op == "symbol":
        return (lambda values: values[payload]), ()
    if op in _BINARY:
        function = _BINARY[op]
        return (lambda values, a, b: function(a, b)), operands
    if op == "neg":
        return (lambda values, a: -a), operands
    if op == "pow":
        return _power_step(node, operands)
    if op == "pieces":
        return _pieces_step(node), operands
    ufunc = getattr(np, FUNCTIONS[op].numpy_name)
    return (lambda values, *args: ufunc(*args)), operands


def _power_step(node: Expr, operands: tuple[int, ...]) -> tuple[_Run, tuple[int, ...]]:
    exponent = node.args[1]
    if exponent.op == "number" and exponent.payload.denominator == 1:
        n = int(exponent.payload)
        if 0 < n <= 8:
            return (lambda values, a: _integer_power(a, n)), operands[:1]
        return (lambda values, a: np.power(a, float(n))), operands[:1]
    return (lambda values, a, b: np.power(a, b)), operands


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

    def run(values: Mapping[str, Value], t: Value, *flat: Value) -> Value:
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
