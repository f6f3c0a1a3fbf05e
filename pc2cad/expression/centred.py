"""Centred enclosures of expression trees: intervals that forget little of what depends on what.

Plain interval arithmetic takes x - x for anything up to twice the width of x. Here each operation
carries, next to its interval, its value at the middle c of the box and slopes s with
f(x) - f(c) in s·(x - c) for all x of the box; centre and slopes give a second enclosure, whose
excess falls with the square of the box, and the two are intersected at every operation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pc2cad.arrays import Booleans, Integers
from pc2cad.expression.enclosures import enclose
from pc2cad.expression.evaluation import program
from pc2cad.expression.functions import FUNCTIONS
from pc2cad.expression.intervals import Interval, interval
from pc2cad.expression.operations import operands
from pc2cad.expression.tree import (
    ZERO,
    Expr,
    call,
    piece_rows,
    pieces,
    symbol,
    walk,
)
from pc2cad.expression.waves import partials

_Index = Integers


@dataclass(frozen=True, eq=False, slots=True)
class Centred:
    """Enclosures over n boxes: `value` (n,), `centre` at their middles, `slopes` per symbol."""

    value: Interval
    centre: Interval
    slopes: Mapping[str, Interval]

    def take(self, rows: _Index) -> Centred:
        """Return the enclosures of some boxes."""
        return Centred(
            _take(self.value, rows),
            _take(self.centre, rows),
            {name: _take(slope, rows) for name, slope in self.slopes.items()},
        )


class CentredProgram:
    """Straight-line program that encloses some trees, with slopes, over lists of boxes.

    What depends on some of the symbols only is worked out once for each of their intervals.
    """

    def __init__(self, roots: tuple[Expr, ...]) -> None:
        nodes = program(roots)
        index = {node: i for i, node in enumerate(nodes)}
        self._nodes = [(node, tuple(index[arg] for arg in operands(node))) for node in nodes]
        self._outputs = tuple(index[root] for root in roots)
        self._symbols = frozenset().union(*(root.symbols for root in roots))

    @property
    def size(self) -> int:
        """Number of operations on values and slopes."""
        return sum(2 + 2 * len(node.symbols) for node, _ in self._nodes)

    def __call__(self, boxes: Mapping[str, Interval]) -> tuple[Centred, ...]:
        """Enclose all trees over n boxes, given by one interval (n,) per symbol."""
        rows = _Rows({name: boxes[name] for name in self._symbols}, boxes)
        store: list[Centred] = []
        with np.errstate(all="ignore"):
            for node, before in self._nodes:
                args = tuple(
                    rows.spread(store[k], self._nodes[k][0].symbols, node.symbols) for k in before
                )
                store.append(_centred(node, args, rows))
            return tuple(rows.whole(store[k], self._nodes[k][0].symbols) for k in self._outputs)


class _Rows:
    """Which boxes agree in some of the symbols."""

    def __init__(self, used: Mapping[str, Interval], boxes: Mapping[str, Interval]) -> None:
        self.count = max((len(box.lower) for box in boxes.values()), default=1)
        self._boxes = used
        self._reaches: dict[tuple[frozenset[str], str], Interval] = {}
        self._links: dict[tuple[frozenset[str], frozenset[str]], _Index] = {}
        #: per set of symbols: the group of each box, and a box of each group
        self._groups: dict[frozenset[str], tuple[_Index, _Index]] = {
            frozenset(): (np.zeros(self.count, dtype=np.intp), np.zeros(1, dtype=np.intp))
        }

    def _group(self, names: frozenset[str]) -> tuple[_Index, _Index]:
        if names not in self._groups:
            *others, name = sorted(names)
            box = self._boxes[name]
            _, first, group = np.unique(
                box.lower + 1j * box.upper, return_index=True, return_inverse=True
            )
            group = group.ravel()
            if others:
                before = self._group(frozenset(others))[0]
                _, first, group = np.unique(
                    before * len(first) + group, return_index=True, return_inverse=True
                )
            self._groups[names] = group.ravel(), first
        return self._groups[names]

    def box(self, name: str) -> Interval:
        return _take(self._boxes[name], self._group(frozenset((name,)))[1])

    def reach(self, names: frozenset[str], name: str) -> Interval:
        """Return x - c for one symbol, on the groups of some."""
        key = names, name
        if key not in self._reaches:
            box = _take(self._boxes[name], self._group(names)[1])
            self._reaches[key] = box - interval(box.middle)
        return self._reaches[key]

    def spread(self, value: Centred, have: frozenset[str], want: frozenset[str]) -> Centred:
        if have == want or not have:
            return value
        key = have, want
        if key not in self._links:
            self._links[key] = self._group(have)[0][self._group(want)[1]]
        return value.take(self._links[key])

    def whole(self, value: Centred, have: frozenset[str]) -> Centred:
        return value.take(self._group(have)[0])


def _take(x: Interval, rows: _Index) -> Interval:
    return Interval(x.lower[rows], x.upper[rows])


def _centred(node: Expr, args: tuple[Centred, ...], rows: _Rows) -> Centred:
    if node.op == "symbol":
        box = rows.box(node.payload)
        one = interval(np.ones(len(box.lower)))
        return Centred(box, interval(box.middle), {node.payload: one})
    value = _row(enclose(node, tuple(a.value for a in args)))
    centre = _row(enclose(node, tuple(a.centre for a in args)))
    if not node.symbols:
        return Centred(value, centre, {})
    slopes = {name: _slope(node, args, name, centre) for name in node.symbols}
    torn = _torn(node, value)
    if torn.any():
        slopes = {name: _unknown_where(torn, slope) for name, slope in slopes.items()}
    near = centre
    for name, slope in slopes.items():
        near = near + slope * rows.reach(node.symbols, name)
    return Centred(_meet(value, near), centre, slopes)


def _torn(node: Expr, value: Interval) -> Booleans:
    """Say where an operation may have a pole or a jump in the box: no slope bounds its change."""
    if node.op == "atan2":
        # what does not meet the cut is seen under less than half a turn
        return np.asarray(value.upper - value.lower > 4)
    return np.asarray(~(np.isfinite(value.lower) & np.isfinite(value.upper)))


def _unknown_where(torn: Booleans, slope: Interval) -> Interval:
    return Interval(np.where(torn, -np.inf, slope.lower), np.where(torn, np.inf, slope.upper))


def _row(x: Interval) -> Interval:
    return Interval(np.atleast_1d(x.lower), np.atleast_1d(x.upper))


def _meet(a: Interval, b: Interval) -> Interval:
    lower, upper = np.fmax(a.lower, b.lower), np.fmin(a.upper, b.upper)
    # two enclosures of no value at all (outside the domain) need not meet
    apart = lower > upper
    if not apart.any():
        return Interval(lower, upper)
    return Interval(np.where(apart, a.lower, lower), np.where(apart, a.upper, upper))


def _slope(node: Expr, args: tuple[Centred, ...], name: str, centre: Interval) -> Interval:
    """Return s with f(x) - f(c) in the sum of s·(x - c) over the symbols."""
    op = node.op
    moved = [(a, a.slopes[name]) for a in args if name in a.slopes]
    if op in ("add", "neg"):
        first = moved[0][1] if len(moved) == 1 else moved[0][1] + moved[1][1]
        return -first if op == "neg" else first
    if op == "mul":
        # ab - a_c b_c = (a - a_c) b + a_c (b - b_c)
        a, b = args
        terms = [a.slopes[name] * b.value] if name in a.slopes else []
        terms += [a.centre * b.slopes[name]] if name in b.slopes else []
        return terms[0] + terms[1] if len(terms) == 2 else terms[0]
    if op == "div":
        # q - q_c = ((a - a_c) - q_c (b - b_c)) / b
        a, b = args
        if name not in b.slopes:
            return a.slopes[name] / b.value
        down = centre * b.slopes[name]
        return (a.slopes[name] - down if name in a.slopes else -down) / b.value
    if op == "sqrt":
        root = enclose(node, (args[0].value,))
        return args[0].slopes[name] / (root + centre)
    total: Interval | None = None
    for partial, a in zip(_partials(node, args), args, strict=True):
        if name in a.slopes:
            term = partial * a.slopes[name]
            total = term if total is None else total + term
    return interval(np.zeros(1)) if total is None else total


def _partials(node: Expr, args: tuple[Centred, ...]) -> list[Interval]:
    """Enclose the partial derivatives of one operation over the values of its operands."""
    values = tuple(a.value for a in args)
    if node.op in ("sign", "floor", "mod", "where", "within"):
        return _jumping_partials(node, values)
    if node.op == "pieces":
        return _piece_partials(node, values)
    if node.op == "pow" and node.args[1].op == "number" and node.args[1].payload == 2:
        # x² - c² = (x + c)(x - c)
        return [values[0] + args[0].centre, values[1]]
    places = tuple(symbol(str(i)) for i in range(len(args)))
    if node.op == "fourier":
        return [_evaluated(tree, values) for tree in partials(node.payload, *places)]
    fixed = node.args[1] if node.op == "pow" and node.args[1].op == "number" else None
    return [_evaluated(tree, values) for tree in _partial_trees(node.op, places, fixed)]


def _jumping_partials(node: Expr, values: tuple[Interval, ...]) -> list[Interval]:
    """Enclose the partial derivatives of an operation that jumps; a jump has no slope."""
    one, zero = interval(np.ones(1)), interval(np.zeros(1))
    x = values[0]
    if node.op == "within":
        return [one, zero, zero]
    if node.op in ("sign", "where"):
        jump = (x.lower <= 0) & (x.upper >= 0)
    else:
        turns = x if node.op == "floor" else x / values[1]
        jump = ~(np.floor(turns.lower) == np.floor(turns.upper))
    unknown = _unknown_where(jump, interval(np.zeros_like(x.lower)))
    if node.op == "mod":
        turns = Interval(np.floor(turns.lower), np.floor(turns.upper))
        return [_unknown_where(jump, interval(np.ones_like(x.lower))), -turns]
    if node.op == "where":
        first = Interval(np.where(x.upper < 0, 0.0, 1.0), np.where(x.lower >= 0, 1.0, 0.0))
        first = Interval(np.minimum(first.lower, first.upper), np.maximum(first.lower, first.upper))
        return [unknown, first, one - first]
    return [unknown]


@lru_cache(maxsize=256)
def _partial_trees(op: str, places: tuple[Expr, ...], exponent: Expr | None) -> tuple[Expr, ...]:
    if op != "pow":
        return FUNCTIONS[op].partials(places)
    base, power = places
    if exponent is not None:
        return (exponent * base ** (exponent - 1), ZERO)
    return (power * base ** (power - 1), base**power * call("log", base))


def _evaluated(tree: Expr, values: tuple[Interval, ...]) -> Interval:
    boxes = {str(i): value for i, value in enumerate(values)}
    store: dict[Expr, Interval] = {}
    for node in walk((tree,)):
        store[node] = enclose(node, tuple(store[a] for a in node.args), boxes)
    return store[tree]


def _piece_partials(node: Expr, values: tuple[Interval, ...]) -> list[Interval]:
    """Enclose the derivative of a piecewise polynomial; a jump has no slope."""
    unknown = Interval(np.full(1, -np.inf), np.full(1, np.inf))
    if len(values) > 1:
        # coefficients that move are not followed
        rest = [unknown if c.symbols else interval(np.zeros(1)) for c in node.args[1:]]
        return [unknown, *rest]
    if node.payload.smoothness < 0:
        return [unknown]
    slope = _piece_slope(node)
    return [enclose(slope, values) if slope.op == "pieces" else _evaluated(slope, values)]


@lru_cache(maxsize=256)
def _piece_slope(node: Expr) -> Expr:
    """Return the derivative of pieces with constant coefficients, a function of the symbol 0."""
    breaks, _, smoothness, closed = node.payload
    rows = tuple(tuple(c * k for k, c in enumerate(row))[1:] or (ZERO,) for row in piece_rows(node))
    return pieces(symbol("0"), breaks, rows, smoothness - 1, closed)
