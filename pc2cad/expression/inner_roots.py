"""Roots of functions that vanish inside the box, at a value of one parameter.

sqrt(abs(u - 1/3)) moves infinitely fast at u = 1/3, sqrt(1 - cos(2 pi v)) has a kink where the
cosine is 1 and so does asin(1 - v^2) at 0. No spline in the parameter follows that, nor does a rule
of integration: the box is taken in parts there (`domain.parts`), at whose limits `end_roots` and
`end_zeros` take such zeros out. A root of several parameters may vanish on sides of the box only.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from itertools import pairwise, product

from pc2cad.expression.breaks import SAME_POSITION, find_breaks, resolve_pieces
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.end_roots import root_exponent
from pc2cad.expression.kinks import take_kinks_apart
from pc2cad.expression.normal_form import is_identically_zero
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.rewriting import nodes_of
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.sign_changes import keeps_sign, on_cells, sign_changes
from pc2cad.expression.tree import (
    ONE,
    ZERO,
    Expr,
    ValueDomainError,
    number,
    ops_of,
    substitute,
    symbol,
    walk,
)  # fmt: skip

#: values of the other parameters: their limits, and two between at which a line has one place
_LIMITS, _BETWEEN = (ZERO, ONE), (number(Fraction(371, 1000)), number(Fraction(613, 1000)))
#: largest denominator of the places at which double zeros are known, and how near they are found
_LARGEST, _FOUND = 1000, 1e-10
#: operations that may be roots
_ROOTS = frozenset(("asin", "acos", "sqrt", "pow"))
#: a step beside a kink, and what is left of the values there at a zero
_BESIDE, _LESS = Fraction(1, 2**16), 2.0**-12


def inner_roots(trees: tuple[Expr, ...]) -> tuple[tuple[Fraction, ...], ...]:
    """Return, per parameter, the places in ]0, 1[ at which something below a root vanishes.

    Every symbol is a local parameter and runs from 0 to 1. Kinks at which it vanishes are all found
    (see `sign_changes`), and so are double zeros at fractions.
    """
    found: tuple[list[Fraction], ...] = ([], [], [])
    rooted = [node for op in _ROOTS & ops_of(trees) for node in nodes_of(trees, op)]
    for below in {base for node in rooted if (base := _below(node)) is not None}:
        for name in below.symbols:
            found[PARAMETERS.index(name)].extend(_lines(below, name))
    return tuple(_apart(places) for places in found)


def _below(node: Expr) -> Expr | None:
    """Return what a root is taken of, that within an arc too; None for other nodes."""
    if node.op in ("asin", "acos") and node.symbols:
        return 1 - node.args[0] * node.args[0]
    if node.op in ("sqrt", "pow") and root_exponent(node) is not None:
        return node.args[0]
    return None


def _lines(tree: Expr, name: str) -> Iterable[Fraction]:
    """Yield the zeros of a tree along a parameter, where each of the others has a limit.

    Between their limits as well, if they do not move with the others.
    """
    others = sorted(tree.symbols - {name})
    for limits in product(_LIMITS, repeat=len(others)):
        yield from _zeros(_at(tree, dict(zip(others, limits, strict=True))), name)
    if others:
        first, second = (_zeros(_at(tree, dict.fromkeys(others, x)), name) for x in _BETWEEN)
        yield from (x for x in first if any(abs(x - y) < SAME_POSITION for y in second))


def _at(tree: Expr, values: dict[str, Expr]) -> Expr:
    try:
        return substitute((tree,), values)[0]
    except ValueDomainError:
        return ZERO


def _zeros(tree: Expr, name: str) -> list[Fraction]:
    """Return the places at which a function of one parameter vanishes and is not negative."""
    if tree.symbols != {name} or keeps_sign(on_cells(tree, name)):
        return []
    (tree,) = take_kinks_apart((tree,), tuple(symbol(p) for p in PARAMETERS))
    kinks = _kinks(tree, name)
    found = [x for x in kinks if _vanishes_at_kink(tree, name, x)]
    for low, high in pairwise((Fraction(0), *kinks, Fraction(1))):
        (row,) = resolve_pieces((tree,), (name, low, high))
        (part,) = substitute((row,), {name: low + (high - low) * symbol(name)})
        (slope,) = derivatives((part,), name)
        turns = sign_changes(slope) if slope.symbols else None
        for place in turns.places if turns else ():
            simple = (low + (high - low) * place).limit_denominator(_LARGEST)
            is_near = abs(float(simple - low) / float(high - low) - float(place)) < _FOUND
            if is_near and _is_zero_at(row, {name: number(simple)}):
                found.append(simple)
    return found


def _is_zero_at(tree: Expr, values: dict[str, Expr]) -> bool:
    """Say whether a tree vanishes at a place; where it has no value there, it does not."""
    try:
        return is_identically_zero(*substitute((tree,), values))
    except ValueDomainError:
        return False


def _kinks(tree: Expr, name: str) -> list[Fraction]:
    """Return the breaks of a function inside ]0, 1[, ascending; exact where they are known so."""
    exact = [
        x
        for node in walk((tree,))
        if node.op == "pieces" and node.args[0].op == "symbol"
        for x in node.payload.breaks
    ]
    rows = [b.position for b in find_breaks((tree,))[PARAMETERS.index(name)]]
    return [
        next((x for x in exact if abs(x - position) < SAME_POSITION), Fraction(position))
        for position in rows
        if 0 < position < 1
    ]


def _vanishes_at_kink(tree: Expr, name: str, place: Fraction) -> bool:
    """Say whether a function vanishes at a kink, next to its values beside it."""
    at, *beside = (evaluate(tree, {name: float(place + s * _BESIDE)}) for s in (0, -1, 1))
    return abs(at) <= _LESS * max(map(abs, beside)) and min(beside) >= 0


def _apart(places: Iterable[Fraction]) -> tuple[Fraction, ...]:
    """Return places inside ]0, 1[, ascending, each once: the simplest of those that are one."""
    found: list[Fraction] = []
    for place in sorted(places, key=lambda x: x.denominator):
        inside = SAME_POSITION < place < 1 - SAME_POSITION
        if inside and all(abs(place - other) > SAME_POSITION for other in found):
            found.append(place)
    return tuple(sorted(found))
