"""Evaluation of a tree at one place with plain floats.

Messages, `--help` and the weights of a combination need a few values, not arrays; this keeps NumPy
out of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from operator import add, attrgetter, mul, neg, truediv

from pc2cad.expression.recent import Recent
from pc2cad.expression.tree import Expr

_NAN = float("nan")
_PLAIN: dict[str, Callable[..., float]] = {
    "add": add,
    "mul": mul,
    "neg": neg,
    "div": truediv,
    "abs": abs,
    "sign": lambda a: float((a > 0) - (a < 0)),
    "mod": lambda a, m: a % m,
    "min": lambda a, b: _either(a, b, a <= b),
    "max": lambda a, b: _either(a, b, a >= b),
    "where": lambda g, a, b: g if g != g else a if g >= 0 else b,
    "within": lambda t, low, high: t if low <= t <= high else _NAN,
}


def _either(a: float, b: float, first: bool) -> float:
    return a + b if a != a or b != b else a if first else b


def evaluate(root: Expr, values: Mapping[str, float]) -> float:
    """Return the value of the tree; nan where a function leaves the reals or overflows."""
    if root.value is not None:
        return root.value
    if root.op == "number":
        return _taken(root, {}, values)
    return evaluate_all((root,), values)[root]


def evaluate_all(roots: tuple[Expr, ...], values: Mapping[str, float]) -> dict[Expr, float]:
    """Return the values of the trees and of nodes below them (see `evaluate`)."""
    # 0 and -0 are equal, and their reciprocals are not
    known = _known(tuple([(n, x, math.copysign(1, x)) for n, x in sorted(values.items())]))
    # constants keep their values: definitions that use one another are looked at one by one
    return known.of(roots, lambda node, store: _taken(node, store, values), attrgetter("value"))


@lru_cache(maxsize=64)
def _known(_: tuple[tuple[str, float, float], ...]) -> Recent[float]:
    """Return the values that are remembered of a place: the same few are asked for trees alike."""
    return Recent()


def values_of(nodes: Iterable[Expr], values: Mapping[str, float]) -> dict[Expr, float]:
    """Return the values of nodes, operands first (see `evaluate`)."""
    store: dict[Expr, float] = {}
    for node in nodes:
        store[node] = _taken(node, store, values) if node.value is None else node.value
    return store


def _taken(node: Expr, store: dict[Expr, float], values: Mapping[str, float]) -> float:
    """Return the value of a node from a store that has those of its operands."""
    op = node.op
    if op == "symbol":
        return values[node.payload]
    if op == "mul" or op == "add":  # most nodes
        a, b = node.args
        value = store[a] * store[b] if op == "mul" else store[a] + store[b]
    else:
        try:
            value = _value(node, [store[arg] for arg in node.args])
        except (ValueError, ZeroDivisionError, OverflowError):
            value = _NAN
    if not node.symbols:
        object.__setattr__(node, "value", value)
    return value


def _value(node: Expr, args: list[float]) -> float:
    op = node.op
    plain = _PLAIN.get(op)
    if plain is not None:
        return plain(*args)
    if op == "number":
        return float(node.payload)
    if op == "constant":
        return math.pi if node.payload == "pi" else math.e
    if op == "pow":
        result = args[0] ** args[1]
        return result if isinstance(result, float) else _NAN
    if op == "pieces":
        return _piece_value(node, args)
    if op == "fourier":
        return node.payload.value(*args)  # type: ignore[no-any-return]
    return getattr(math, op)(*args)  # type: ignore[no-any-return]


def _piece_value(node: Expr, args: list[float]) -> float:
    breaks, width, _, closed = node.payload
    t, flat = args[0], args[1:]
    first, last = float(breaks[0]), float(breaks[-1])
    if closed and not first <= t <= last:
        t = (t - first) % (last - first) + first
    index = max((i for i in range(len(breaks) - 1) if float(breaks[i]) <= t), default=0)
    value = 0.0
    for coefficient in reversed(flat[index * width : (index + 1) * width]):
        value = value * (t - float(breaks[index])) + coefficient
    return value
