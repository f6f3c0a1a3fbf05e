"""Kinks: absolute values become pieces that change where their arguments change their sign.

|g| of one parameter is g or -g on each piece, so that its kinks are breaks of that parameter like
those of polygons: grid lines of meshes, edges between faces, knots. So are those of the root of a
square, and of arcs of waves, such as acos(cos(g)). Where an argument of abs depends on several
parameters its zeros are a curve, along which nothing can be joined; that is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, product
from math import floor, pi

from pc2cad.expression.breaks import SAME_POSITION, BreaksNotAlignedError
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.intervals import Interval, interval
from pc2cad.expression.normal_form import NormalForm, normal_form, ordered, tree_of
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import (
    ONE,
    PI,
    Expr,
    call,
    number,
    pieces,
    power,
    rebuild,
    symbol,
    walk,
)  # fmt: skip

#: the functions that may hold kinks: a root of a square and the arc of a wave are absolute values
_KINKED = frozenset(("abs", "sqrt", "acos", "asin"))
#: intervals that the search for zeros begins with, that it takes at once, and how narrow they get
_FIRST, _MOST, _NARROW = 16, 2048, 2.0**-44
#: where a wave is looked at between two kinks
_SHARES = (0.21, 0.5, 0.68)
#: places per parameter at which an argument of two, or three, parameters is looked at
_PLACES = {2: 33, 3: 13}


def take_kinks_apart(roots: tuple[Expr, ...], shown: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return equal trees with the absolute values of one parameter in pieces.

    Every symbol is a local parameter and runs from 0 to 1; `shown` are u, v and w of the equation
    as trees of them, for messages. An argument that keeps its sign is taken as it is, or negative.
    Even powers lose the absolute value, odd ones become pieces that are as smooth as they are. A
    function whose zeros are too many to be found stays. Raises BreaksNotAlignedError where an
    argument of several parameters changes its sign.
    """
    if _KINKED.isdisjoint(node.op for node in walk(roots)):
        return roots
    # what is only used in a power of 2 or more has no kink
    bare = {arg for node in walk(roots) if not _is_smooth_power(node) for arg in node.args}
    bare.update(roots)
    kept = _below_roots(roots)
    done: dict[Expr, Expr] = {}
    for node in walk(roots):
        args = tuple(done[arg] for arg in node.args)
        moved = node if args == node.args else rebuild(node, args)
        if node not in kept and moved.op == node.op:
            if node.op == "abs" and node in bare:
                moved = _absolute(args[0], 1, shown)
            elif node.op == "sqrt":
                moved = _root(moved)
            elif node.op in ("acos", "asin"):
                moved = _arc(moved)
            elif _is_smooth_power(node) and node.args[0].op == "abs":
                exponent = node.args[1].payload
                if exponent.denominator == 1:
                    moved = _absolute(done[node.args[0].args[0]], int(exponent), shown)
        done[node] = moved
    return tuple(done[root] for root in roots)


def _below_roots(roots: tuple[Expr, ...]) -> set[Expr]:
    """Return what roots, logarithms or quotients are taken of, factor by factor.

    Where it vanishes they end: beside it, in pieces, they would be asked for roots of -1e-17.
    """
    found: set[Expr] = set()
    for node in walk(roots):
        below: list[Expr] = []
        if node.op in ("sqrt", "log"):
            # the root of a square is what is asked for here
            below = [] if node.op == "sqrt" and _half(node.args[0]) else [node.args[0]]
        elif node.op == "div":
            below = [node.args[1]]
        elif node.op == "pow":
            exponent = node.args[1].payload if node.args[1].op == "number" else Fraction(1, 2)
            if exponent.denominator != 1 or exponent < 0:
                below = [node.args[0]]
        while below:
            inner = below.pop()
            found.add(inner)
            if inner.op in ("mul", "div", "neg", "pow"):
                below += inner.args
    return found


def _half(square: Expr) -> tuple[Expr, int] | None:
    """Return what a tree is an even power of, and half the exponent."""
    if square.op == "mul" and square.args[0] is square.args[1]:
        return square.args[0], 1
    if square.op == "pow" and square.args[1].op == "number":
        half = square.args[1].payload / 2
        if half.denominator == 1 and half > 0:
            return square.args[0], int(half)
    return None


def _root(node: Expr) -> Expr:
    """Return the root of a square of one parameter without the root."""
    half = _half(node.args[0])
    if half is None or len(node.symbols) != 1:
        return node
    inner, exponent = half
    return _in_pieces(inner, exponent) if exponent % 2 else power(inner, number(exponent))


def _arc(node: Expr) -> Expr:
    """Return the arc of a wave of one parameter in pieces: there and back with the wave's angle."""
    wave, turned = node.args[0], False
    if wave.op == "neg":
        wave, turned = wave.args[0], True
    if wave.op not in ("sin", "cos") or len(wave.symbols) != 1:
        return node
    (angle,), cosine = wave.args, wave.op == "cos"
    found = _changes(call("sin" if cosine else "cos", angle))
    if found is None:
        return node
    (name,) = wave.symbols
    _, changes = found
    breaks = (Fraction(0), *(change.place for change in changes), Fraction(1))
    rows = []
    for low, high in pairwise(breaks):
        at = (float(low + (high - low) * share) for share in _SHARES)
        found_there = [evaluate(angle, {name: x}) / pi for x in at]
        # the angle may touch the end of its half turn inside, and turn back
        half_turns = max(found_there, key=lambda x: abs(x - round(x)) * (1 if cosine else -1))
        # the arc is the distance from whole turns (cos), or what is left of the nearest half (sin)
        whole = floor(half_turns) if cosine else round(half_turns)
        even = whole % 2 == 0
        end = whole + 1 if cosine and not even else whole
        rows.append(angle - end * PI if even else end * PI - angle)
    arc = rows[0]
    if len(rows) > 1:
        arc = pieces(symbol(name), breaks, tuple((row,) for row in rows), 0, closed=False)
    if cosine != (node.op == "acos"):
        arc = PI / 2 - arc
    # acos(-x) = pi - acos(x), asin(-x) = -asin(x)
    return (PI - arc if node.op == "acos" else -arc) if turned else arc


def _is_smooth_power(node: Expr) -> bool:
    return node.op == "pow" and node.args[1].op == "number" and node.args[1].payload >= 2


def _absolute(argument: Expr, exponent: int, shown: tuple[Expr, ...]) -> Expr:
    """Return |argument|^exponent without the absolute value, as far as that is known."""
    if argument.op == "pow" and argument.args[1].op == "number":
        times = argument.args[1].payload
        if times.denominator == 1 and times > 0:
            return _absolute(argument.args[0], int(times) * exponent, shown)
    if exponent % 2 == 0:
        return power(argument, number(exponent))
    if len(argument.symbols) == 1:
        return _in_pieces(argument, exponent)
    result = ONE
    for factor, times in _factors(argument):
        if times * exponent % 2 == 0:
            result = result * power(factor, number(times * exponent))
        elif len(factor.symbols) < 2:
            result = result * _in_pieces(factor, times * exponent)
        else:
            result = result * _of_several(factor, times * exponent, shown)
    return result


def _factors(tree: Expr) -> list[tuple[Expr, int]]:
    """Return factors of a tree and their exponents."""
    if tree.op == "neg":
        return _factors(tree.args[0])
    if tree.op == "mul":
        return [*_factors(tree.args[0]), *_factors(tree.args[1])]
    if tree.op == "div":
        return [*_factors(tree.args[0]), *((f, -n) for f, n in _factors(tree.args[1]))]
    if tree.op == "pow" and tree.args[1].op == "number":
        exponent = tree.args[1].payload
        if exponent.denominator == 1:
            return [(f, n * int(exponent)) for f, n in _factors(tree.args[0])]
    form = normal_form(tree, largest=200) if tree.op == "add" and len(tree.symbols) > 1 else None
    return _common(form) if form else [(tree, 1)]


def _common(form: NormalForm) -> list[tuple[Expr, int]]:
    """Return the atoms that all terms of a sum share, and what is left."""
    rows = [dict(monomial) for monomial in form]
    shared = {
        atom: least
        for atom in rows[0]
        if (least := min(row.get(atom, 0) for row in rows)) > 0 and atom.symbols
    }
    rest = {
        ordered({a: n - shared.get(a, 0) for a, n in row.items() if n != shared.get(a, 0)}): c
        for row, c in zip(rows, form.values(), strict=True)
    }
    return [*shared.items(), (tree_of(rest), 1)]


def _of_several(factor: Expr, exponent: int, shown: tuple[Expr, ...]) -> Expr:
    """Return the absolute value of what depends on several parameters, if it keeps its sign."""
    names = sorted(factor.symbols)
    count = _PLACES.get(len(names), 5)
    steps = [(k + 0.5) / count for k in range(count)]
    signs: dict[int, dict[str, float]] = {}
    for place in product(steps, repeat=len(names)):
        values = dict(zip(names, place, strict=True))
        value = evaluate(factor, values)
        if value:
            signs.setdefault(1 if value > 0 else -1, values)
    if len(signs) > 1 and abs(exponent) == 1:
        _refuse(factor, signs[1], signs[-1], shown)
    if len(signs) == 1 and _keeps_sign(factor, names):
        return power(factor if 1 in signs else -factor, number(exponent))
    return power(call("abs", factor), number(exponent))


def _keeps_sign(tree: Expr, names: list[str]) -> bool:
    """Say whether a tree is proved to have one sign over the whole box."""
    count = 8 if len(names) < 3 else 4
    cells = list(product(range(count), repeat=len(names)))
    boxes = {
        name: interval([c[k] / count for c in cells], [(c[k] + 1) / count for c in cells])
        for k, name in enumerate(names)
    }
    (value,) = IntervalProgram((tree,))(boxes)
    return bool((value.lower >= 0).all() or (value.upper <= 0).all())


def _refuse(
    tree: Expr, first: dict[str, float], second: dict[str, float], shown: tuple[Expr, ...]
) -> None:
    """Raise BreaksNotAlignedError with a place between two of opposite signs."""
    low, high = 0.0, 1.0
    at = first
    for _ in range(60):
        middle = (low + high) / 2
        at = {name: first[name] + middle * (second[name] - first[name]) for name in first}
        if evaluate(tree, at) > 0:
            low = middle
        else:
            high = middle
    own = {name: evaluate(parameter, at) for name, parameter in zip("uvw", shown, strict=True)
           if name in at and parameter.symbols <= set(at)}  # fmt: skip
    place = ", ".join(f"{name} = {value:.4g}" for name, value in own.items())
    plain = all(parameter.op == "symbol" for parameter in shown)
    what = f"abs({tree!r})" if plain else f"the abs of a function of {' and '.join(own)}"
    raise BreaksNotAlignedError(
        f"{what} has a kink along a curve through {place}; kinks are lines of the solid only where "
        "they lie at values of one parameter: take parameters in which they do, or two bodies"
    )


# -- one parameter ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Change:
    """A place at which a function may change its sign, and the sign after it."""

    place: Fraction
    after: int


def _in_pieces(tree: Expr, exponent: int) -> Expr:
    """Return |g|^n, n odd, of one parameter: ±g^n in pieces; unchanged where zeros are unknown."""
    found = None if not tree.symbols else _changes(tree)
    if found is None:
        return power(call("abs", tree), number(exponent))
    whole = power(tree, number(exponent))
    first, changes = found
    rows = [(whole if sign > 0 else -whole,) for sign in (first, *(c.after for c in changes))]
    if len(rows) == 1:
        return rows[0][0]
    (name,) = tree.symbols
    breaks = (Fraction(0), *(c.place for c in changes), Fraction(1))
    return pieces(symbol(name), breaks, tuple(rows), max(exponent - 1, 0), closed=False)


def _changes(tree: Expr) -> tuple[int, list[_Change]] | None:
    """Return a function's sign at 0 and where it changes on ]0, 1[; None where that is not known.

    Complete: an interval is done with where the enclosure of the values has one sign, or that of
    the slopes, so that there is one zero at most. What is left is halved, down to `_NARROW`: there,
    as at ends where rounding hides the sign, the next signs that are known decide.
    """
    (name,) = tree.symbols
    ask = IntervalProgram((tree, *derivatives((tree,), name)))
    ends = [(k / _FIRST, (k + 1) / _FIRST) for k in range(_FIRST)]
    #: begin, end, sign at the begin, sign at the end; 0 where it is not known
    rows: list[tuple[float, float, int, int]] = []
    while ends:
        if len(ends) > _MOST:
            return None
        starts, stops = [a for a, _ in ends], [b for _, b in ends]
        value, slope = ask({name: interval(starts, stops)})
        points = [ask({name: interval(row)})[0] for row in (starts, stops)]
        columns = (_signs(value, ends), _strict_signs(slope, ends),
                   *(_strict_signs(point, ends) for point in points))  # fmt: skip
        left = []
        for (a, b), sign, monotone, begin, end in zip(ends, *columns, strict=True):
            if sign:
                rows.append((a, b, sign, sign))
            elif monotone:
                rows.append((a, b, begin, end))
            elif b - a < _NARROW:
                rows.append((a, b, 0, 0))
            else:
                left += [(a, (a + b) / 2), ((a + b) / 2, b)]
        ends = left
    return _told(tree, name, sorted(rows))


def _signs(value: Interval, rows: list[tuple[float, float]]) -> list[int]:
    """Return the signs of enclosures: 1 where none is negative, -1 where none is positive."""
    return [1 if a >= 0 else -1 if b <= 0 else 0 for a, b in _listed(value, rows)]


def _strict_signs(value: Interval, rows: list[tuple[float, float]]) -> list[int]:
    return [(a > 0) - (b < 0) for a, b in _listed(value, rows)]


def _listed(value: Interval, rows: list[tuple[float, float]]) -> list[tuple[float, float]]:
    zeros = [0.0] * len(rows)
    return list(zip((value.lower + zeros).tolist(), (value.upper + zeros).tolist(), strict=True))


def _told(
    tree: Expr, name: str, rows: list[tuple[float, float, int, int]]
) -> tuple[int, list[_Change]]:
    """Return the changes of sign along intervals that follow one another."""
    first = sign = next((s for _, _, *ends in rows for s in ends if s), 1)
    changes: list[_Change] = []
    known = 0.0
    for place, here in ((x, s) for a, b, *ends in rows for x, s in zip((a, b), ends, strict=True)):
        if not here:
            continue
        if here != sign:
            zero = _zero(tree, name, known, place)
            if zero < SAME_POSITION:
                first = here
            elif zero < 1 - SAME_POSITION:
                changes.append(_Change(zero, here))
        known, sign = place, here
    return first, changes


def _zero(tree: Expr, name: str, a: float, b: float) -> Fraction:
    """Return where a function changes its sign between two places; exactly where it is linear."""
    if a < b:
        exact = _linear_zero(tree, name)
        if exact is not None and a <= exact <= b:
            return exact
    low = evaluate(tree, {name: a}) > 0
    for _ in range(64):
        middle = (a + b) / 2
        if not a < middle < b:
            break
        value = evaluate(tree, {name: middle})
        if value == 0:
            return Fraction(middle)
        a, b = (middle, b) if (value > 0) == low else (a, middle)
    return Fraction((a + b) / 2)


def _linear_zero(tree: Expr, name: str) -> Fraction | None:
    form = normal_form(tree, largest=50)
    if form is None or not set(form) <= {(), ((symbol(name), 1),)}:
        return None
    slope = form.get(((symbol(name), 1),), Fraction(0))
    return -form.get((), Fraction(0)) / slope if slope else None
