"""Ranges of tables: where their arguments have to stay, and the places where they do not.

A table has no values beyond its places. Its argument stands in a node that has a value inside the
range only and knows the table's name; once the arguments are known to stay inside, the nodes go.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from pc2cad.errors import InputError
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.rewriting import rewrite
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import (
    LARGEST_CONSTANT,
    Expr,
    ValueDomainError,
    intern,
    number,
    ops_of,
    piece_rows,
    substitute,
    symbol,
    walk,
)

#: what rounding may leave of an argument beyond a limit, as a share of the range
ROOM: Final = Fraction(1, 10**9)
#: places per parameter at which arguments are looked at, by the number of parameters
_PLACES: Final = {0: 1, 1: 513, 2: 65, 3: 17}
#: boxes that the proof begins with per parameter, and that it takes at once, and their least size
_FIRST, _MOST, _SMALLEST = 4, 20_000, 1e-7
_WORDS: Final = "end the domain there, or give the table places that far"


#: parameters that are known to stay between two places
_Spans = frozenset[tuple[str, Fraction, Fraction]]


class BeyondTableError(InputError):
    """A table is asked for values beyond its places."""


class Table(NamedTuple):
    """The payload of a ``within`` node; its operands are the argument and the range."""

    name: str

    @property
    def derivative(self) -> Table:
        """The table's derivative, by its name."""
        return Table(f"{self.name}'")

    def rebuilt(self, args: tuple[Expr, ...]) -> Expr:
        """Return such a node of other operands; a constant inside the range stands for itself."""
        t, low, high = args
        if t.op != "number":
            return intern("within", args, self)
        if not low.payload <= t.payload <= high.payload:
            raise ValueDomainError(f"{_asked(self.name, low, high, float(t.payload))}; {_WORDS}")
        return t


def within(name: str, t: Expr, low: Fraction, high: Fraction) -> Expr:
    """Return the argument of a table over [low, high]; raise ValueDomainError outside it."""
    room = (high - low) * ROOM
    return Table(name).rebuilt((t, number(low - room), number(high + room)))


def anywhere(name: str, t: Expr) -> Expr:
    """Return the argument of a table that has values everywhere, to be printed with its name."""
    return Table(name).rebuilt((t, number(-LARGEST_CONSTANT), number(LARGEST_CONSTANT)))


def _asked(name: str, low: Expr, high: Expr, value: float) -> str:
    room = (high.payload - low.payload) * ROOM / (1 + 2 * ROOM)
    ends = f"{float(low.payload + room):.7g} to {float(high.payload - room):.7g}"
    return f"the table {name} runs from {ends}, and is asked for its value at {value:.7g}"


def take_ranges(roots: tuple[Expr, ...], shown: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return the trees without the nodes that hold tables' ranges, which are checked first.

    Every symbol is a local parameter and runs from 0 to 1; `shown` are u, v and w of the equation
    as trees of them, for messages. What only a branch of a choice needs stays until the choices
    are taken apart (see `take_chosen_ranges`). Raises BeyondTableError with the place.
    """
    if "within" not in ops_of(roots):
        return roots
    nodes = [node for node in walk(roots) if node.op == "within"]
    choices = [node for node in walk(roots) if node.op in ("where", "min", "max")]
    chosen = {inner for node in choices for inner in walk(node.args)}
    for node in nodes:
        if node not in chosen:
            _check(node, shown)
    return rewrite(roots, "within", lambda n: n if n in chosen else n.args[0])


def take_chosen_ranges(roots: tuple[Expr, ...], shown: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return the trees without the ranges that `take_ranges` has left.

    Of a piece, an argument has to stay inside only where the piece is taken.
    """
    if "within" not in ops_of(roots):
        return roots
    stack: list[tuple[Expr, _Spans]] = [(root, frozenset()) for root in roots]
    seen = set(stack)
    while stack:
        node, spans = stack.pop()
        if node.op == "within":
            change = {n: number(a) + number(b - a) * symbol(n) for n, a, b in spans}
            (moved,) = substitute((node,), change)
            if moved.op == "within":  # a constant has been looked at
                _check(moved, substitute(shown, change))
        for inner in _below(node, spans):
            if inner not in seen:
                seen.add(inner)
                stack.append(inner)
    return rewrite(roots, "within", lambda n: n.args[0])


def _below(node: Expr, spans: _Spans) -> Iterator[tuple[Expr, _Spans]]:
    """Yield the operands of a node, and where each is needed: rows of pieces on their own span."""
    if node.op != "pieces" or node.args[0].op != "symbol" or node.payload.closed:
        yield from ((arg, spans) for arg in node.args)
        return
    name, breaks = node.args[0].payload, node.payload.breaks
    known = {n: (a, b) for n, a, b in spans}
    first, last = known.get(name, (Fraction(0), Fraction(1)))
    for i, row in enumerate(piece_rows(node)):
        low = max(first, breaks[i]) if i else first
        high = min(last, breaks[i + 1]) if i + 2 < len(breaks) else last
        if low < high:
            known[name] = low, high
            yield from ((c, frozenset((n, a, b) for n, (a, b) in known.items())) for c in row)


def _check(node: Expr, shown: tuple[Expr, ...]) -> None:
    """Raise BeyondTableError where an argument leaves the range: at a sample, or in a small box."""
    from pc2cad.expression.enclosures import IntervalProgram
    from pc2cad.expression.evaluation import Program
    from pc2cad.expression.intervals import interval

    (argument,) = rewrite(node.args[:1], "within", lambda inner: inner.args[0])
    low, high = (float(limit.payload) for limit in node.args[1:])
    if high >= LARGEST_CONSTANT:
        return
    names = sorted(argument.symbols)
    count = _PLACES[len(names)]
    grid = np.meshgrid(*[np.linspace(0.0, 1.0, count)] * len(names), indexing="ij")
    (seen,) = Program((argument,))(dict(zip(names, grid, strict=True)))
    seen = np.broadcast_to(seen, grid[0].shape if grid else ())
    off = np.maximum(low - seen, seen - high)
    if np.nanmax(off, initial=-np.inf) > 0:
        worst = np.unravel_index(int(np.nanargmax(off)), off.shape)
        at = {name: float(axis[worst]) for name, axis in zip(names, grid, strict=True)}
        raise _beyond(node, at, shown)
    ask, size = IntervalProgram((argument,)), 1 / _FIRST
    corners = np.array(list(product(range(_FIRST), repeat=len(names)))) * size
    while 0 < len(corners) < _MOST and size > _SMALLEST and names:
        boxes = {n: interval(x, x + size) for n, x in zip(names, corners.T, strict=True)}
        (found,) = ask(boxes)
        still = corners[np.broadcast_to((found.lower < low) | (found.upper > high), len(corners))]
        size /= 2
        halves = np.array(list(product((0, 1), repeat=len(names)))) * size
        corners = (still[:, None] + halves).reshape(-1, len(names))
        for corner in still + size:
            at = dict(zip(names, corner.tolist(), strict=True))
            if not low <= evaluate(argument, at) <= high:
                raise _beyond(node, at, shown)


def _beyond(node: Expr, at: Mapping[str, float], shown: tuple[Expr, ...]) -> BeyondTableError:
    (argument,) = rewrite(node.args[:1], "within", lambda inner: inner.args[0])
    _, low, high = node.args
    named = _asked(node.payload.name.rstrip("'"), low, high, evaluate(argument, at))
    rows = zip(PARAMETERS, shown, strict=False)
    own = [f"{n} = {evaluate(p, at):.4g}" for n, p in rows if n in at and p.symbols <= set(at)]
    where = f", where {', '.join(own)}" if own else ""
    return BeyondTableError(f"{named}{where}; {_WORDS}")
