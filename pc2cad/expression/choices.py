"""Choices between formulas, in pieces of one parameter: if, min, max, floor, mod, and tables.

Each becomes one formula after the other along the parameter in which it changes, so that the places
of the changes are breaks like those of polygons. A table that is taken at any function of a
parameter is a polynomial of that function between the places where it passes the table's own.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from math import floor
from typing import Final

from pc2cad.expression.breaks import SAME_POSITION, is_affine
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.sign_changes import in_pieces, sign_changes
from pc2cad.expression.tree import PI, ZERO, Expr, call, number, piece_rows

#: chooses by the sign of a tree, or refuses, or finds nothing (see `kinks.by_sign`)
BySign = Callable[[Expr, Expr, Expr], Expr | None]

CHOICES: Final = frozenset(("min", "max", "where", "floor", "mod"))
#: places of the other parameters at which a piece is told
_OTHERS = (0.371, 0.613)
#: a value at a break below this share of those beside it may be rounding
_VANISHING: Final = 1e-9


def is_bent_table(node: Expr) -> bool:
    """Say whether pieces are taken at what is no affine function of a parameter."""
    if node.op != "pieces" or node.args[0].op == "symbol":
        return False
    return len(node.args[0].symbols) != 1 or not is_affine(node.args[0])


def in_formulas(node: Expr, by_sign: BySign) -> Expr:
    """Return a choice as pieces of one parameter; as it is where the changes are too many."""
    if node.op == "where":
        return by_sign(*node.args) or node
    if node.op == "min":
        return by_sign(node.args[1] - node.args[0], *node.args) or node
    if node.op == "max":
        return by_sign(node.args[0] - node.args[1], *node.args) or node
    if node.op == "pieces":
        return _bent_table(node, by_sign) or node
    quotient = node.args[0] if node.op == "floor" else node.args[0] / node.args[1]
    whole = _whole_parts(quotient, by_sign)
    if whole is None:
        return node
    name, places, parts = whole
    rows = [number(part) for part in parts]
    if node.op == "mod":
        rows = [node.args[0] - node.args[1] * row for row in rows]
    return in_pieces(name, places, tuple(rows))


def vanishes_at_breaks(node: Expr) -> bool:
    """Say whether pieces may be zero where they change: roots of them would be asked for -1e-17."""
    if node.op != "pieces":
        return False
    (name,) = node.args[0].symbols
    rest = {n: _OTHERS[k % 2] for k, n in enumerate(sorted(node.symbols - {name}))}
    breaks = [float(b) for b in node.payload.breaks]
    inside = [evaluate(node, {**rest, name: (a + b) / 2}) for a, b in pairwise(breaks)]
    scale = max((abs(x) for x in inside if x == x), default=0.0)
    return any(abs(evaluate(node, {**rest, name: b})) <= _VANISHING * scale for b in breaks[1:-1])


def _whole_parts(
    quotient: Expr, by_sign: BySign
) -> tuple[str, tuple[Fraction, ...], list[int]] | None:
    """Return the parameter along which floor(q) changes, where, and its values between."""
    wave = call("sin", PI * quotient)
    for name in sorted(quotient.symbols):
        changes = sign_changes(wave, name) if name in wave.symbols else None
        if changes is not None:
            return name, changes.places, _middles(quotient, name, changes.places)
    by_sign(wave, wave, ZERO)  # refuses changes along a curve
    return None


def _middles(tree: Expr, name: str, places: tuple[Fraction, ...]) -> list[int]:
    """Return the whole part of a tree in the middle of each interval between places."""
    rest = {n: _OTHERS[k % 2] for k, n in enumerate(sorted(tree.symbols - {name}))}
    ends = (Fraction(0), *places, Fraction(1))
    return [floor(evaluate(tree, {**rest, name: float(a + b) / 2})) for a, b in pairwise(ends)]


def _bent_table(node: Expr, by_sign: BySign) -> Expr | None:
    """Return pieces of a function of a parameter as pieces of that parameter."""
    argument, breaks = node.args[0], node.payload.breaks
    rest = {n: 0.5 for n in argument.symbols}
    names = sorted(argument.symbols)
    found: dict[str, list[Fraction]] = {}
    for level in _levels(node, argument, names):
        for name in names:
            changes = sign_changes(argument - number(level), name)
            if changes is not None:
                if changes.places:
                    found.setdefault(name, []).extend(changes.places)
                break
        else:
            by_sign(argument - number(level), argument, ZERO)
            return None
    if len(found) > 1:
        return None
    name = next(iter(found), names[0])
    places = tuple(sorted(found.get(name, [])))
    places = tuple(p for k, p in enumerate(places) if not k or p - places[k - 1] > SAME_POSITION)
    period = breaks[-1] - breaks[0]
    rows = []
    for low, high in pairwise((Fraction(0), *places, Fraction(1))):
        at = Fraction(evaluate(argument, {**rest, name: float(low + high) / 2}))
        turn = (at - breaks[0]) // period if node.payload.closed else 0
        index = max((i for i, b in enumerate(breaks[:-1]) if b <= at - turn * period), default=0)
        local = argument - number(breaks[index] + turn * period)
        value: Expr = ZERO
        for coefficient in reversed(piece_rows(node)[index]):
            value = value * local + coefficient
        rows.append(value)
    return in_pieces(name, places, tuple(rows), node.payload.smoothness)


def _levels(node: Expr, argument: Expr, names: list[str]) -> list[Fraction]:
    """Return the places of a table that its argument passes at samples, and those beside them."""
    breaks, closed = node.payload.breaks, node.payload.closed
    if not closed:
        return list(breaks[1:-1])
    period = breaks[-1] - breaks[0]
    steps = [k / 32 for k in range(33)]
    seen = [evaluate(argument, dict.fromkeys(names, x)) for x in steps]
    first, last = (floor((x - float(breaks[0])) / float(period)) for x in (min(seen), max(seen)))
    return [b + k * period for k in range(first - 1, last + 2) for b in breaks[:-1]]
