"""Vectorised evaluation of expression trees with NumPy.

A tuple of trees becomes a straight-line program in which every common sub-tree occurs once. Each
operation works on arrays of the shape that its own parameters need: on an open grid, with u of
shape (n,1,1), v of (1,m,1) and w of (1,1,k), whatever depends on u alone is evaluated n times and
not n·m·k times. This factoring by parameter is what makes channels fast.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.alike import with_tables
from pc2cad.expression.functions import FUNCTIONS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, walk
from pc2cad.expression.wave_values import values

Value = Any  # a float or an array of any broadcastable shape
_Run = Callable[..., Value]
#: where a result goes, the operation, and where its operands are
_Step = tuple[int, _Run, tuple[int, ...]]
#: the same, and what is not needed after it
_Timed = tuple[int, _Run, tuple[int, ...], tuple[int, ...]]
#: the piece in which each place is, the place from that piece's start, the first and the last piece
_Located = tuple[Value, Value, int, int]
#: the first and the last piece in which there are places
_Range = tuple[int, int]

#: of each piece: which of the operands its coefficients are
_Rows = list[tuple[int, ...]]

#: plans of one program that are remembered
MOST_PLANS = 2048
#: coefficients of functions in pieces that are looked up in one call
MOST_LOOKED_UP = 1 << 16

_BINARY: dict[str, Callable[[Value, Value], Value]] = {
    "add": np.add,
    "mul": np.multiply,
    "div": np.divide,
}


class Program:
    """Straight-line program of some trees; call it with one array (or float) per symbol.

    Of functions in pieces only the pieces are worked out in which there are places.
    """

    def __init__(self, roots: tuple[Expr, ...]) -> None:
        roots = with_tables(roots)
        below = {node: _operands(node) for node in walk(roots, _operands)}
        nodes = list(below)
        index = {node: i for i, node in enumerate(nodes)}
        self._outputs = tuple(index[root] for root in roots)
        #: values of the nodes that hold no symbol, worked out once
        self._constants: list[Value] = [None] * len(nodes)
        self._symbols: list[tuple[int, str]] = []
        self._steps: list[_Step] = []
        #: of functions in pieces that are functions: which operands the coefficients are
        self._rows: dict[int, _Rows] = {}
        located: dict[object, int] = {}
        with np.errstate(all="ignore"):
            for i, node in enumerate(nodes):
                before = tuple([index[arg] for arg in below[node]])
                if node.op == "symbol":
                    self._symbols.append((i, node.payload))
                elif node.op == "pieces" and node.symbols:
                    # functions in pieces often have their breaks in common
                    breaks, width, _, closed = node.payload
                    key = before[0], breaks, closed
                    if key not in located:
                        located[key] = len(self._constants)
                        self._constants.append(None)
                        knots = np.array([float(b) for b in breaks])
                        run = partial(_located, knots, closed)
                        self._steps.append((located[key], run, before[:1]))
                    if len(before) > 1:
                        self._rows[i], before = _rows(before, width)
                    self._steps.append((i, _step(node), (located[key], *before[1:])))
                elif node.symbols:
                    self._steps.append((i, _step(node), before))
                elif node.op == "number":
                    self._constants[i] = np.float64(float(node.payload))
                else:
                    self._constants[i] = _step(node)(*(self._constants[k] for k in before))
        #: where places are located, and in how many pieces
        self._located = {
            before[0]: len(self._rows[i]) for i, _, before in self._steps if i in self._rows
        }
        self._position, self._fixed = self._places()
        needed = self._needed(self._located, {})
        self._first: list[_Timed] = [
            (i, partial(run, self._rows[i], 0) if i in self._rows else run, before, ())
            for i, run, before in self._steps
            if i in needed
        ]
        self._forget()

    def _forget(self) -> None:
        """Begin without plans.

        What they have in common is kept once: there may be hundreds of them of a hundred steps.
        """
        self._plans: dict[tuple[_Range, ...], list[_Timed]] = {}
        #: steps of functions in pieces, by where they go and the pieces in which places are
        self._among: dict[tuple[int, _Range], _Step] = {}
        #: steps by their identity and what is not needed after them
        self._timed: dict[tuple[int, ...], _Timed] = {}

    def _places(self) -> tuple[dict[int, int], set[int]]:
        """Return at which step each value is worked out, and the values that are constants."""
        position = {step[0]: k for k, step in enumerate(self._steps)}
        return position, {k for k, constant in enumerate(self._constants) if constant is not None}

    def __call__(self, values: Mapping[str, Value]) -> tuple[Value, ...]:
        """Evaluate all trees; the results have the broadcast shape of what each one depends on.

        Values outside a function's domain come out as nan or inf, without a warning: the caller
        decides whether a place is a fault.
        """
        store = self._constants.copy()
        for i, name in self._symbols:
            store[i] = values[name]
        with np.errstate(all="ignore"):
            _run(self._first, store)
            ranges = tuple(_range(store[k], count) for k, count in self._located.items())
            plan = self._plans.get(ranges)
            if plan is None:
                plan = self._plan(ranges)
            _run(plan, store)
        return tuple(store[k] for k in self._outputs)

    def _needed(self, slots: Iterable[int], ranges: Mapping[int, _Range]) -> set[int]:
        """Return what has to be worked out for some values, with places in ranges of pieces.

        Of functions of many pieces it is few: only what is needed is looked at.
        """
        needed: set[int] = set()
        stack = list(slots)
        while stack:
            i = stack.pop()
            if i in needed or i not in self._position:
                continue
            needed.add(i)
            stack += self._step(i, ranges)[2]
        return needed

    def _step(self, slot: int, ranges: Mapping[int, _Range]) -> _Step:
        """Return the step of a value: of a function in pieces with the rows that are needed."""
        step = self._steps[self._position[slot]]
        if not ranges or slot not in self._rows:
            return step
        _, run, before = step
        among = slot, ranges[before[0]]
        if among not in self._among:
            first, last = among[1]
            rows, kept = _numbered(self._rows[slot][first : last + 1])
            chosen = (before[0], *(before[1 + k] for k in kept))
            self._among[among] = slot, partial(run, rows, first), chosen
        return self._among[among]

    def _plan(self, ranges: tuple[_Range, ...]) -> list[_Timed]:
        """Return the steps that are left where places are in ranges of pieces."""
        if len(self._plans) >= MOST_PLANS:
            self._forget()
        among = dict(zip(self._located, ranges, strict=True))
        done = {step[0] for step in self._first}
        needed = [self._position[i] for i in self._needed(self._outputs, among) - done]
        #: what is not let go of, or has been
        kept = {*self._outputs, *done, *self._fixed}
        plan: list[_Timed] = []
        for k in sorted(needed, reverse=True):
            step = self._step(self._steps[k][0], among)
            last = [x for x in step[2] if x not in kept]
            kept.update(last)
            key = (id(step), *last)
            timed = self._timed.get(key)
            if timed is None:
                timed = self._timed[key] = *step, key[1:]
            plan.append(timed)
        plan.reverse()
        self._plans[ranges] = plan
        return plan


def _run(steps: Iterable[_Timed], store: list[Value]) -> None:
    """Work steps out, and let go of what is not needed any more."""
    for i, run, before, frees in steps:
        if len(before) == 2:
            store[i] = run(store[before[0]], store[before[1]])
        elif len(before) == 1:
            store[i] = run(store[before[0]])
        else:
            store[i] = run(*(store[k] for k in before))
        for k in frees:
            store[k] = None


def _range(located: _Located, count: int) -> _Range:
    """Return the pieces in which there are places; all of them where these are most."""
    _, _, first, last = located
    return (first, last) if 2 * (last - first + 1) <= count else (0, count - 1)


def operands(node: Expr) -> tuple[Expr, ...]:
    """Return what a program works out before the node: no coefficients of pieces, if constant."""
    table = node.op == "pieces" and not any(c.symbols for c in node.args[1:])
    return node.args[:1] if table else node.args


def program(roots: tuple[Expr, ...]) -> list[Expr]:
    """Return the nodes below the roots, operands first, without those that make tables."""
    return list(walk(roots, operands))


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
    if op == "add" and "neg" in (node.args[0].op, node.args[1].op):
        return np.subtract
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


def _located(knots: Array, closed: bool, t: Value) -> _Located:
    """Return where places are among the pieces of a function."""
    if closed:
        # the closing break belongs to the last piece of its own turn, so that one-sided
        # derivatives at the end of a domain are those from inside
        inside = (t >= knots[0]) & (t <= knots[-1])
        t = np.where(inside, t, (t - knots[0]) % (knots[-1] - knots[0]) + knots[0])
    index = np.searchsorted(knots[1:-1], t, side="right")
    first, last = (int(index.min()), int(index.max())) if np.size(index) else (0, 0)
    return index, t - knots[index], first, last


def _pieces_step(node: Expr) -> _Run:
    width = node.payload[1]
    if not node.symbols:
        constant = np.float64(evaluate(node, {}))
        return lambda *_: constant
    if len(operands(node)) > 1:
        return _from_rows
    table = [float(c.payload) if c.op == "number" else evaluate(c, {}) for c in node.args[1:]]
    return partial(_from_table, np.array(table).reshape(-1, width).T.copy())


def _rows(before: tuple[int, ...], width: int) -> tuple[_Rows, tuple[int, ...]]:
    """Return the rows of a function in pieces, and its operands, each taken once."""
    flat = before[1:]
    rows, kept = _numbered([flat[i : i + width] for i in range(0, len(flat), width)])
    return rows, (before[0], *kept)


def _numbered(rows: _Rows) -> tuple[_Rows, tuple[int, ...]]:
    """Return rows of places in a list of what they hold, and that list."""
    kept = {k: i for i, k in enumerate(dict.fromkeys(k for row in rows for k in row))}
    return [tuple([kept[k] for k in row]) for row in rows], tuple(kept)


def _from_table(table: Array, located: _Located) -> Value:
    """Return the values from a table of coefficients, (width, pieces)."""
    index, local, first, last = located
    value: Value = None
    if first == last:
        for coefficient in table[::-1, first].tolist():
            value = coefficient if value is None else value * local + coefficient
        return value if len(table) > 1 else np.full(np.shape(local), value)
    together = index.size * table.shape[0] <= MOST_LOOKED_UP
    rows: Array = table.take(np.asarray(index), axis=1) if together else table
    for row in rows[::-1]:
        coefficient = row if together else row.take(index)
        value = coefficient if value is None else value * local + coefficient
    return value


def _from_rows(rows: _Rows, start: int, located: _Located, *values: Value) -> Value:
    """Return the values from coefficients of the pieces from `start` on."""
    index, local, first, last = located
    value: Value = None
    for k in reversed(range(len(rows[0]))):
        column = [row[k] for row in rows[first - start : last - start + 1]]
        coefficient = values[column[0]]
        if any(which != column[0] for which in column):
            here = np.array(column)[index - first]
            for which in dict.fromkeys(column):
                if which != column[0]:
                    coefficient = np.where(here == which, values[which], coefficient)
        value = coefficient if value is None else value * local + coefficient
    # what is constant in one piece has the shape of the place as well
    return value if len(rows[0]) > 1 else value + np.zeros(np.shape(local))
