"""Vectorised evaluation of expression trees with NumPy.

A tuple of trees becomes a straight-line program in which every common sub-tree occurs once. Each
operation works on arrays of the shape that its own parameters need: on an open grid, with u of
shape (n,1,1), v of (1,m,1) and w of (1,1,k), whatever depends on u alone is evaluated n times and
not n·m·k times. This factoring by parameter is what makes channels fast.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache, partial
from typing import Final

import numpy as np

from pc2cad.expression.alike import with_tables
from pc2cad.expression.carried import Carried, earlier_trees, meet
from pc2cad.expression.functions import FUNCTIONS
from pc2cad.expression.piece_values import (
    Located,
    Rows,
    Value,
    from_rows,
    from_table,
    locate,
    numbered,
    rows_of,
)
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, walk
from pc2cad.expression.wave_values import values

_Run = Callable[..., Value]
#: where a result goes, the operation, and where its operands are
_Step = tuple[int, _Run, tuple[int, ...]]
#: the same, and what is not needed after it
_Timed = tuple[int, _Run, tuple[int, ...], tuple[int, ...]]
#: the first and the last piece in which there are places
_Range = tuple[int, int]


#: plans of one program that are remembered
MOST_PLANS = 2048
#: operations on trees of earlier builds from which on their values are carried from there
LEAST_CARRIED: Final = 16
#: bytes of such values
MOST_CARRIED: Final = 1 << 25

_BINARY: dict[str, Callable[[Value, Value], Value]] = {
    "add": np.add,
    "mul": np.multiply,
    "div": np.divide,
}


class Program:
    """Straight-line program of some trees; call it with one array (or float) per symbol.

    Of functions in pieces only the pieces are worked out in which there are places. What occurred
    in an earlier build is a program of its own, whose values are carried from there.
    """

    def __init__(self, roots: tuple[Expr, ...], carry: bool = True) -> None:
        self.roots: Final = with_tables(roots) if carry else roots
        below, self._below = _parted(self.roots) if carry else (_all_below(self.roots), None)
        nodes = list(below)
        index = {node: i for i, node in enumerate(nodes)}
        self._outputs = tuple(index[root] for root in self.roots)
        #: values of the nodes that hold no symbol, worked out once
        self._constants: list[Value] = [None] * len(nodes)
        self._symbols: list[tuple[int, str]] = []
        #: where the values of the program below go, in its order
        self._taken = tuple(index[node] for node in (self._below.roots if self._below else ()))
        self._steps: list[_Step] = []
        #: of functions in pieces that are functions: which operands the coefficients are
        self._rows: dict[int, Rows] = {}
        located: dict[object, int] = {}
        with np.errstate(all="ignore"):
            for i, node in enumerate(nodes):
                before = tuple([index[arg] for arg in below[node]])
                if node.op == "symbol":
                    self._symbols.append((i, node.payload))
                elif i in self._taken:
                    continue
                elif node.op == "pieces" and node.symbols:
                    # functions in pieces often have their breaks in common
                    breaks, width, _, closed = node.payload
                    key = before[0], breaks, closed
                    if key not in located:
                        located[key] = len(self._constants)
                        self._constants.append(None)
                        knots = np.array([float(b) for b in breaks])
                        run = partial(locate, knots, closed)
                        self._steps.append((located[key], run, before[:1]))
                    if len(before) > 1:
                        self._rows[i], before = rows_of(before, width)
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
        self._first = self._locating()
        self._forget()

    def _locating(self) -> list[_Timed]:
        """Return the steps by which places are located in pieces, whatever the places."""
        needed = self._needed(self._located, {})
        return [
            (i, partial(run, self._rows[i], 0) if i in self._rows else run, before, ())
            for i, run, before in self._steps
            if i in needed
        ]

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
        return self._worked_out(values)

    def _worked_out(self, values: Mapping[str, Value]) -> tuple[Value, ...]:
        store = self._constants.copy()
        for i, name in self._symbols:
            store[i] = values[name]
        if self._below is not None:
            for i, value in zip(self._taken, self._below.carried(values), strict=True):
                store[i] = value
        with np.errstate(all="ignore"):
            ranges: tuple[_Range, ...] = ()
            if self._located:
                _run(self._first, store)
                ranges = tuple(_range(store[k], count) for k, count in self._located.items())
            plan = self._plans.get(ranges)
            if plan is None:
                plan = self._plan(ranges)
            _run(plan, store)
        # what is carried is nobody's to change
        return tuple(_copy(store[k]) if k in self._taken else store[k] for k in self._outputs)

    def carried(self, values: Mapping[str, Value]) -> tuple[Value, ...]:
        """Return what calling it returns, not to be changed: from an earlier call if there was one.

        That was with arrays of the same bits, laid out alike.
        """
        key: list[object] = [self]
        for _, name in self._symbols:
            value = values[name]
            if type(value) is not np.ndarray or value.dtype != np.float64:
                return self._worked_out(values)
            key += (value.shape, value.strides, value.tobytes())
        known = _carried.get(whole := tuple(key))
        if known is None:
            known = self._worked_out(values)
            size = sum(part.nbytes for part in known)
            _carried.keep(whole, known, size + sum(len(x) for x in key if isinstance(x, bytes)))
        return known

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
            rows, kept = numbered(self._rows[slot][first : last + 1])
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


_carried: Final[Carried[tuple[Value, ...]]] = Carried(MOST_CARRIED)
#: the nodes of a program, and what has to be worked out before each
_Below = dict[Expr, tuple[Expr, ...]]


def _all_below(roots: tuple[Expr, ...]) -> _Below:
    return {node: _operands(node) for node in walk(roots, _operands)}


def _parted(roots: tuple[Expr, ...]) -> tuple[_Below, Program | None]:
    """Return the nodes of a program down to those of earlier builds, and the program of these.

    None where these are few, or where they may be asked for piece by piece.
    """
    earlier = earlier_trees()
    found: _Below = {}

    def operands_of(node: Expr) -> tuple[Expr, ...]:
        old = node in earlier and node.op != "symbol"
        found[node] = () if old else _operands(node)
        return found[node]

    nodes = list(walk(roots, operands_of))
    meet([node for node in nodes if node.symbols])
    below = {node: found[node] for node in nodes}
    old = tuple([node for node in nodes if node in earlier and node.op != "symbol"])
    if not old:
        return below, None
    among, (program, inside) = set(old), _of_earlier(old)
    if program is None or any(
        [node.op == "pieces" and len(row) > 1 and node not in among for node, row in below.items()]
    ):
        return inside | {n: row for n, row in below.items() if n not in among}, None
    return below, program


def _copy(value: Value) -> Value:
    return value.copy() if isinstance(value, np.ndarray) else value


@lru_cache(maxsize=256)
def _of_earlier(roots: tuple[Expr, ...]) -> tuple[Program | None, _Below]:
    """Return the program of trees of earlier builds, None of few operations, and its nodes."""
    inside = _all_below(roots)
    worth = sum([bool(row) for row in inside.values()]) >= LEAST_CARRIED
    return Program(roots, carry=False) if worth else None, inside


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


def _range(located: Located, count: int) -> _Range:
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


def _pieces_step(node: Expr) -> _Run:
    width = node.payload[1]
    if not node.symbols:
        constant = np.float64(evaluate(node, {}))
        return lambda *_: constant
    if len(operands(node)) > 1:
        return from_rows
    table = [float(c.payload) if c.op == "number" else evaluate(c, {}) for c in node.args[1:]]
    return partial(from_table, np.array(table).reshape(-1, width).T.copy())
