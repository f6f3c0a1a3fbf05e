"""Vectorised evaluation of expression trees with NumPy.

A tuple of trees becomes a straight-line program in which every common sub-tree occurs once. Each
operation works on arrays of the shape that its own parameters need: on an open grid, with u of
shape (n,1,1), v of (1,m,1) and w of (1,1,k), whatever depends on u alone is evaluated n times and
not n·m·k times. This factoring by parameter is what makes channels fast.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache, partial
from typing import Final, NamedTuple

import numpy as np

from pc2cad.expression.alike import with_tables
from pc2cad.expression.carried import Carried, earlier_trees, meet
from pc2cad.expression.operations import Run, operands, operation, worked_from
from pc2cad.expression.piece_values import (
    Located,
    Rows,
    Value,
    locate,
    numbered,
    rows_of,
)
from pc2cad.expression.tree import Expr, walk

#: where a result goes, the operation, and where its operands are
_Step = tuple[int, Run, tuple[int, ...]]
#: the same, and what is not needed after it
_Timed = tuple[int, Run, tuple[int, ...], tuple[int, ...]]
#: the first and the last piece in which there are places
_Range = tuple[int, int]


class _Plan(NamedTuple):
    """How some trees are worked out."""

    steps: list[_Timed]
    #: where values of earlier builds go, and which these are
    taken: tuple[int, ...]
    rows: tuple[int, ...]


#: plans of one program that are remembered
MOST_PLANS = 2048
#: operations on trees of earlier builds from which on their values are carried from there
LEAST_CARRIED: Final = 16
#: bytes of such values
MOST_CARRIED: Final = 1 << 25


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
        #: where the values of the program below go, and which of its trees they are
        self._taken = {
            index[node]: k for k, node in enumerate(self._below.roots if self._below else ())
        }
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
                    self._steps.append((i, operation(node), (located[key], *before[1:])))
                elif node.symbols:
                    self._steps.append((i, operation(node), before))
                elif node.op == "number":
                    self._constants[i] = np.float64(float(node.payload))
                else:
                    self._constants[i] = operation(node)(*(self._constants[k] for k in before))
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
        if not needed:
            return []
        return [
            (i, partial(run, self._rows[i], 0) if i in self._rows else run, before, ())
            for i, run, before in self._steps
            if i in needed
        ]

    def _forget(self) -> None:
        """Begin without plans.

        What they have in common is kept once: there may be hundreds of them of a hundred steps.
        """
        self._plans: dict[tuple[tuple[int, ...], tuple[_Range, ...]], _Plan] = {}
        #: steps of functions in pieces, by where they go and the pieces in which places are
        self._among: dict[tuple[int, _Range], _Step] = {}
        #: the symbols of some trees, by their numbers
        self._names: dict[tuple[int, ...], list[str]] = {}
        #: steps by their identity and what is not needed after them
        self._timed: dict[tuple[int, ...], _Timed] = {}

    def _places(self) -> tuple[dict[int, int], set[int]]:
        """Return at which step each value is worked out, and the values that are constants."""
        position = {step[0]: k for k, step in enumerate(self._steps)}
        return position, {k for k, constant in enumerate(self._constants) if constant is not None}

    def __call__(
        self, values: Mapping[str, Value], which: tuple[int, ...] | None = None
    ) -> tuple[Value, ...]:
        """Evaluate all trees, or those of some numbers.

        The results have the broadcast shape of what each one depends on. Values outside a
        function's domain come out as nan or inf, without a warning: the caller decides whether a
        place is a fault.
        """
        store = self._constants.copy()
        for i, name in self._symbols:
            store[i] = values[name]
        outputs = self._outputs if which is None else tuple([self._outputs[k] for k in which])
        with np.errstate(all="ignore"):
            ranges: tuple[_Range, ...] = ()
            if self._located:
                _run(self._first, store)
                ranges = tuple(_range(store[k], count) for k, count in self._located.items())
            plan = self._plans.get((outputs, ranges)) or self._plan(outputs, ranges)
            if self._below is not None:
                known = self._below.carried(values, plan.rows)
                for i, value in zip(plan.taken, known, strict=True):
                    store[i] = value
            _run(plan.steps, store)
        # what is carried is nobody's to change
        return tuple([_copy(store[k]) if k in self._taken else store[k] for k in outputs])

    def carried(self, values: Mapping[str, Value], which: tuple[int, ...]) -> tuple[Value, ...]:
        """Return what calling it returns, not to be changed: from an earlier call if there was one.

        That was with arrays of the same bits, laid out alike.
        """
        key: list[object] = [self, which]
        if which not in self._names:
            self._names[which] = sorted(
                frozenset[str]().union(*(self.roots[k].symbols for k in which))
            )
        for name in self._names[which]:
            value = values[name]
            if type(value) is not np.ndarray or value.dtype != np.float64:
                return self(values, which)
            key += (value.shape, value.strides, value.tobytes())
        known = _carried.get(whole := tuple(key))
        if known is None:
            known = self(values, which)
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

    def _among_pieces(self, outputs: tuple[int, ...], among: Mapping[int, _Range]) -> list[_Step]:
        """Return the steps that some values need, with places in ranges of pieces, in order."""
        needed = self._needed(outputs, among) - {step[0] for step in self._first}
        positions = sorted([self._position[i] for i in needed])
        return [self._step(self._steps[k][0], among) for k in positions]

    def _plan(self, outputs: tuple[int, ...], ranges: tuple[_Range, ...]) -> _Plan:
        """Return how some values are worked out where places are in ranges of pieces."""
        if len(self._plans) >= MOST_PLANS:
            self._forget()
        among = dict(zip(self._located, ranges, strict=True))
        done = {step[0] for step in self._first}
        chosen = self._among_pieces(outputs, among) if among else self._steps
        #: what is not let go of, or has been: of what is worked out all that is needed
        kept = {*outputs, *done, *self._fixed}
        steps: list[_Timed] = []
        for step in reversed(chosen):
            slot, run, before = step
            if slot not in kept:
                continue
            last: tuple[int, ...] = ()
            for x in before:
                if x not in kept:
                    kept.add(x)
                    last += (x,)
            timed = slot, run, before, last
            # plans for pieces are many, and have most of their steps in common
            steps.append(self._timed.setdefault((id(step), *last), timed) if among else timed)
        steps.reverse()
        taken = tuple([i for i in self._taken if i in kept])
        plan = _Plan(steps, taken, tuple([self._taken[i] for i in taken]))
        self._plans[outputs, ranges] = plan
        return plan


_carried: Final[Carried[tuple[Value, ...]]] = Carried(MOST_CARRIED)
#: the nodes of a program, and what has to be worked out before each
_Below = dict[Expr, tuple[Expr, ...]]


def _all_below(roots: tuple[Expr, ...]) -> _Below:
    return {node: worked_from(node) for node in walk(roots, worked_from)}


def _parted(roots: tuple[Expr, ...]) -> tuple[_Below, Program | None]:
    """Return the nodes of a program down to those of earlier builds, and the program of these.

    None where these are few, or where they may be asked for piece by piece.
    """
    earlier = earlier_trees()
    found: _Below = {}
    last: list[Expr] = []

    def operands_of(node: Expr) -> tuple[Expr, ...]:
        row: tuple[Expr, ...] = ()
        if node in earlier and node.op != "symbol":
            last.append(node)
        else:
            row = worked_from(node)
        found[node] = row
        return row

    nodes = walk(roots, operands_of)
    meet([node for node in nodes if node.symbols])
    below = {node: found[node] for node in nodes}
    if not last:
        return below, None
    among, (program, inside) = set(last), _of_earlier(tuple(last))
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


def program(roots: tuple[Expr, ...]) -> list[Expr]:
    """Return the nodes below the roots, operands first, without those that make tables."""
    return walk(roots, operands)
