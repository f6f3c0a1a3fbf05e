"""Enclosures of expression trees over boxes of parameters.

Where a function has values on a part of an interval only (the root of [-1, 1]), that part counts;
where it has none, the answer is the whole line.

Evaluation is factored by parameter as in `evaluation`: on an open grid of boxes, with u of shape
(n,1,1), v of (1,m,1) and w of (1,1,k), what depends on u alone is worked out n times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression import wave_values
from pc2cad.expression.evaluation import program
from pc2cad.expression.functions import FUNCTIONS
from pc2cad.expression.intervals import (
    INFINITE,
    ULP,
    ULPS,
    Interval,
    enclosed_number,
    rounded,
    whole_line_where,
    with_sign_of,
)
from pc2cad.expression.operations import operands
from pc2cad.expression.tree import Expr


class IntervalProgram:
    """Straight-line program that encloses some trees; every common sub-tree is worked out once."""

    def __init__(
        self, roots: tuple[Expr, ...], fixed: Mapping[str, Interval] = MappingProxyType({})
    ) -> None:
        """Take the trees; what depends on symbols that are `fixed` alone is worked out now."""
        nodes = program(roots)
        index = {node: i for i, node in enumerate(nodes)}
        self._outputs = tuple(index[root] for root in roots)
        self._fixed: list[Any] = [None] * len(nodes)
        #: where a result goes, its node, and where its operands are
        self._steps: list[tuple[int, Expr, tuple[int, ...]]] = []
        with np.errstate(all="ignore"):
            for i, node in enumerate(nodes):
                before = tuple([index[arg] for arg in operands(node)])
                if not node.symbols or node.symbols <= fixed.keys():
                    self._fixed[i] = enclose(node, tuple([self._fixed[k] for k in before]), fixed)
                else:
                    self._steps.append((i, node, before))
        last = {k: i for i, _, before in self._steps for k in before if self._fixed[k] is None}
        kept = set(self._outputs)
        self._frees: dict[int, list[int]] = {i: [] for i, _, _ in self._steps}
        for i, use in last.items():
            if i not in kept:
                self._frees[use].append(i)

    @property
    def size(self) -> int:
        """Number of operations."""
        return len(self._fixed)

    def __call__(self, boxes: Mapping[str, Interval]) -> tuple[Interval, ...]:
        """Enclose all trees over boxes given by one interval (of arrays) per symbol.

        Results have the broadcast shape of the symbols that each tree depends on.
        """
        store = self._fixed.copy()
        with np.errstate(all="ignore"):
            for i, node, before in self._steps:
                store[i] = enclose(node, tuple([store[k] for k in before]), boxes)
                for k in self._frees[i]:
                    store[k] = None
        return tuple(store[k] for k in self._outputs)


def enclose(
    node: Expr, args: tuple[Interval, ...], boxes: Mapping[str, Interval] | None = None
) -> Interval:
    """Return the enclosure of one operation, given those of its operands (or of the symbols)."""
    op = node.op
    if op == "number":
        return enclosed_number(node.payload)
    if op == "constant":
        value = np.pi if node.payload == "pi" else np.e
        return Interval(np.asarray(value), np.asarray(np.nextafter(value, 4.0)))
    if op == "symbol":
        if boxes is None:
            raise ValueError("a symbol needs its interval")
        return boxes[node.payload]
    if op == "add":
        return args[0] + args[1]
    if op == "neg":
        return -args[0]
    if op == "mul":
        return args[0].power(2) if node.args[0] is node.args[1] else args[0] * args[1]
    if op == "div":
        return args[0] / args[1]
    if op == "pow":
        return _power(node, args)
    if op == "pieces":
        return _pieces(node, args)
    if op == "fourier":
        return wave_values.enclose(node.payload, *args)
    if op in _SEVERAL:
        return _SEVERAL[op](*args)
    return ENCLOSURES[op](args[0])


# -- functions -------------------------------------------------------------------------------------

_One = Callable[[Interval], Interval]


def _monotone(
    name: str,
    domain: tuple[float, float] = (-INFINITE, INFINITE),
    image: tuple[float, float] = (-INFINITE, INFINITE),
    falling: bool = False,
) -> _One:
    """Return the enclosure of a monotone function; increasing ones with f(0) = 0 keep signs."""
    function = getattr(np, FUNCTIONS[name].numpy_name)
    odd = name in ("atan", "asin", "sinh", "tanh", "asinh", "atanh", "sqrt")

    def enclosure(x: Interval) -> Interval:
        outside = (x.upper < domain[0]) | (x.lower > domain[1])
        clipped = Interval(np.clip(x.lower, *domain), np.clip(x.upper, *domain))
        ends = function(clipped.lower), function(clipped.upper)
        low, high = reversed(ends) if falling else ends
        result = rounded(low, high, ULPS)
        result = Interval(np.maximum(result.lower, image[0]), np.minimum(result.upper, image[1]))
        return whole_line_where(outside, with_sign_of(clipped, result) if odd else result)

    return enclosure


def _cosine(x: Interval, shift: float = 0.0) -> Interval:
    """Enclose cos(x - shift·2π) for a shift of 0 (cos) or 1/4 (sin)."""
    function = np.sin if shift else np.cos
    turns = rounded(x.lower / (2 * np.pi) - shift, x.upper / (2 * np.pi) - shift, 4)
    # what a quarter turn takes away from the size of a number does not take its rounding away
    slack = (np.abs(x.lower) + np.abs(x.upper)) * ULP
    low, high = turns.lower - slack, turns.upper + slack
    at = function(x.lower), function(x.upper)
    result = rounded(np.minimum(*at), np.maximum(*at), ULPS)
    crest = np.ceil(low) <= high
    trough = np.ceil(low - 0.5) <= high - 0.5
    # near its zeros a sine may be off by more than its own last places
    lower = np.where(trough, -1.0, np.maximum(result.lower - ULP / 4, -1.0))
    upper = np.where(crest, 1.0, np.minimum(result.upper + ULP / 4, 1.0))
    unbounded = ~np.isfinite(x.lower) | ~np.isfinite(x.upper)
    return Interval(np.where(unbounded, -1.0, lower), np.where(unbounded, 1.0, upper))


def _sine(x: Interval) -> Interval:
    result = _cosine(x, 0.25)
    # np.pi is less than pi: on [0, np.pi] a sine has no negative value
    half_turn = (x.lower >= 0) & (x.upper <= np.pi)
    return Interval(np.where(half_turn, np.maximum(result.lower, 0.0), result.lower), result.upper)


def _tangent(x: Interval) -> Interval:
    turns = rounded(x.lower / np.pi + 0.5, x.upper / np.pi + 0.5, 8)
    slack = (np.abs(x.lower) + np.abs(x.upper)) * ULP
    same = np.floor(turns.lower - slack) == np.floor(turns.upper + slack)
    result = rounded(np.tan(x.lower), np.tan(x.upper), ULPS)
    return whole_line_where(~same, result)


def _hyperbolic_cosine(x: Interval) -> Interval:
    size = x.magnitude()
    result = rounded(np.cosh(size.lower), np.cosh(size.upper), ULPS)
    return Interval(np.maximum(result.lower, 1.0), result.upper)


def _root(x: Interval) -> Interval:
    clipped = Interval(np.maximum(x.lower, 0.0), np.maximum(x.upper, 0.0))
    result = rounded(np.sqrt(clipped.lower), np.sqrt(clipped.upper), 1)
    result = Interval(np.maximum(result.lower, 0.0), result.upper)
    return whole_line_where(np.asarray(x.upper < 0), result)


def _sign(x: Interval) -> Interval:
    return Interval(np.sign(x.lower), np.sign(x.upper))


def _atan2(y: Interval, x: Interval) -> Interval:
    """Enclose the angle of a rectangle: its corners, or all angles where it meets the cut."""
    ends = [np.arctan2(a, b) for a in (y.lower, y.upper) for b in (x.lower, x.upper)]
    low, high = np.minimum.reduce(ends), np.maximum.reduce(ends)
    result = rounded(low, high, ULPS)
    cut = (x.lower <= 0) & (y.lower <= 0) & (y.upper >= 0)
    cut = cut | np.isnan(low) | np.isnan(high)
    half_turn = np.nextafter(np.pi, 4.0)
    return Interval(np.where(cut, -half_turn, np.maximum(result.lower, -half_turn)),
                    np.where(cut, half_turn, np.minimum(result.upper, half_turn)))  # fmt: skip


def _floor(x: Interval) -> Interval:
    return Interval(np.floor(x.lower), np.floor(x.upper))


def _mod(x: Interval, m: Interval) -> Interval:
    """Enclose x - m floor(x/m), m > 0: between 0 and m, and closer where the quotient is known."""
    turns = _floor(x / m)
    rest = x - m * turns
    known = (turns.lower == turns.upper) & (m.lower > 0)
    lower = np.where(known, np.maximum(rest.lower, 0.0), 0.0)
    result = Interval(lower, np.where(known, np.minimum(rest.upper, m.upper), m.upper))
    return whole_line_where(~(m.lower > 0) | ~np.isfinite(rest.lower + rest.upper), result)


def _least(a: Interval, b: Interval) -> Interval:
    return Interval(np.minimum(a.lower, b.lower), np.minimum(a.upper, b.upper))


def _largest(a: Interval, b: Interval) -> Interval:
    return Interval(np.maximum(a.lower, b.lower), np.maximum(a.upper, b.upper))


def _where(g: Interval, a: Interval, b: Interval) -> Interval:
    """Enclose a where g >= 0, else b; the hull of both where the sign is not known."""
    both = a.join(b)
    first, second = g.lower >= 0, g.upper < 0
    return Interval(
        np.where(first, a.lower, np.where(second, b.lower, both.lower)),
        np.where(first, a.upper, np.where(second, b.upper, both.upper)),
    )


def _within(t: Interval, low: Interval, high: Interval) -> Interval:
    """Enclose what of an argument lies inside a range."""
    result = Interval(np.maximum(t.lower, low.lower), np.minimum(t.upper, high.upper))
    return whole_line_where(result.lower > result.upper, result)


_SEVERAL: Final[dict[str, Callable[..., Interval]]] = {
    "atan2": _atan2, "mod": _mod, "min": _least, "max": _largest, "where": _where,
    "within": _within,
}  # fmt: skip
ENCLOSURES: Final[dict[str, _One]] = {
    "sin": _sine,
    "cos": _cosine,
    "tan": _tangent,
    "asin": _monotone("asin", (-1.0, 1.0)),
    "acos": _monotone("acos", (-1.0, 1.0), (0.0, INFINITE), falling=True),
    "atan": _monotone("atan"),
    "sinh": _monotone("sinh"),
    "cosh": _hyperbolic_cosine,
    "tanh": _monotone("tanh", image=(-1.0, 1.0)),
    "asinh": _monotone("asinh"),
    "acosh": _monotone("acosh", (1.0, INFINITE), (0.0, INFINITE)),
    "atanh": _monotone("atanh", (-1.0, 1.0)),
    "exp": _monotone("exp", image=(0.0, INFINITE)),
    "log": _monotone("log", (0.0, INFINITE)),
    "sqrt": _root,
    "abs": Interval.magnitude,
    "sign": _sign,
    "floor": _floor,
}


# -- powers and pieces -----------------------------------------------------------------------------


def _power(node: Expr, args: tuple[Interval, ...]) -> Interval:
    base, exponent = args
    known = node.args[1].payload if node.args[1].op == "number" else None
    if known is not None and known.denominator == 1:
        whole = base.power(abs(int(known)))
        return whole if known > 0 else whole.reciprocal()
    low, high = np.maximum(base.lower, 0.0), np.maximum(base.upper, 0.0)
    ends = [np.power(a, b) for a in (low, high) for b in (exponent.lower, exponent.upper)]
    result = rounded(np.minimum.reduce(ends), np.maximum.reduce(ends), ULPS)
    result = Interval(np.maximum(result.lower, 0.0), result.upper)
    # an exponent that is whole without saying so takes negative bases as well
    unknown = base.upper < 0 if known is not None else base.lower < 0
    return whole_line_where(np.asarray(unknown), result)


@lru_cache(maxsize=256)
def _table(node: Expr) -> tuple[Interval, ...]:
    """Return the enclosures of coefficients that are all constant."""
    return IntervalProgram(node.args[1:])({})


def _pieces(node: Expr, args: tuple[Interval, ...]) -> Interval:
    """Enclose a piecewise polynomial: the hull over all pieces that the argument meets."""
    breaks, width, _, closed = node.payload
    t, flat = args[0], args[1:] or _table(node)
    knots = [float(b) for b in breaks]
    count = len(knots) - 1
    period = knots[-1] - knots[0]
    turn: Array = np.floor((t.lower - knots[0]) / period) * period if closed else np.asarray(0.0)
    slack = 4 * ULP * (np.abs(t.lower) + np.abs(t.upper) + abs(knots[0]) + abs(knots[-1]))
    low, high = t.lower - turn - slack, t.upper - turn + slack
    lower: Array = np.asarray(INFINITE)
    upper: Array = np.asarray(-INFINITE)
    whole = high - low >= period
    # rounding may leave the argument one turn too low; a whole turn meets every piece
    for lap in (-1, 0, 1) if closed else (0,):
        for i in range(count):
            start, end = knots[i] + lap * period, knots[i + 1] + lap * period
            first = -INFINITE if not closed and i == 0 else start
            last = INFINITE if not closed and i == count - 1 else end
            met = ((low <= last) & (high >= first)) | (whole & closed)
            if not np.any(met):
                continue
            local = Interval(
                np.where(whole & closed, 0.0, np.maximum(low, first) - start) - slack,
                np.where(whole & closed, end - start, np.minimum(high, last) - start) + slack,
            )
            value = _polynomial(flat[i * width : (i + 1) * width], local)
            lower = np.where(met, np.minimum(lower, value.lower), lower)
            upper = np.where(met, np.maximum(upper, value.upper), upper)
    return whole_line_where(~np.isfinite(t.lower) | ~np.isfinite(t.upper), Interval(lower, upper))


def _polynomial(row: tuple[Interval, ...], t: Interval) -> Interval:
    value = row[-1]
    for coefficient in reversed(row[:-1]):
        value = value * t + coefficient
    return value
