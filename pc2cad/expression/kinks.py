"""Kinks: absolute values and choices become pieces that change where their arguments change sign.

|g| of one parameter is g or -g on each piece, so that its kinks are breaks of that parameter like
those of polygons: grid lines of meshes, edges between faces, knots. So are those of the root of a
square, and of arcs of waves, such as acos(cos(g)). Where an argument of abs depends on several
parameters its zeros are a curve, along which nothing can be joined; that is refused.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from functools import partial
from itertools import pairwise, product
from math import floor, pi

from pc2cad.expression.choices import CHOICES, in_formulas, is_bent_table, vanishes_at_breaks
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.intervals import interval
from pc2cad.expression.kink_curves import refuse_curve
from pc2cad.expression.magnitudes import largest_seen
from pc2cad.expression.normal_form import NormalForm, normal_form, ordered, tree_of
from pc2cad.expression.rewriting import among, nodes_of
from pc2cad.expression.rounded_identity import is_zero_to_rounding
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.sign_changes import in_pieces, sign_changes
from pc2cad.expression.tree import (  # fmt: skip
    ONE,
    PI,
    Expr,
    call,
    number,
    ops_of,
    power,
    rebuild,
    substitute,
)

#: the functions that may hold kinks: a root of a square and the arc of a wave are absolute values
_KINKED = frozenset(("abs", "sign", "sqrt", "acos", "asin")) | CHOICES
_BENT = _KINKED | {"pieces"}
_ROOTS = frozenset(("sqrt",))
#: where a wave is looked at between two kinks
_SHARES = (0.21, 0.5, 0.68)
#: places per parameter at which an argument of two, or three, parameters is looked at
_PLACES = {2: 33, 3: 13}
#: a place at which few functions vanish
_AT = (0.371, 0.613, 0.847)


def take_kinks_apart(roots: tuple[Expr, ...], shown: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return equal trees with the absolute values of one parameter in pieces.

    Every symbol is a local parameter and runs from 0 to 1; `shown` are u, v and w of the equation
    as trees of them, for messages. An argument that keeps its sign is taken as it is, or negative.
    Even powers lose the absolute value, odd ones become pieces that are as smooth as they are. A
    function whose zeros are too many to be found stays. Raises BreaksNotAlignedError where an
    argument of several parameters changes its sign.
    """
    held = _BENT & ops_of(roots)
    if not held or (held == _ROOTS and not any(map(_is_absolute, nodes_of(roots, "sqrt")))):
        return roots
    nodes = among(roots, lambda n: not _BENT.isdisjoint(n.ops))
    if not any(node.op in _KINKED or is_bent_table(node) for node in nodes):
        return roots
    # what is only used in a power of 2 or more has no kink
    bare = {arg for node in nodes if not _is_smooth_power(node) for arg in node.args}
    bare.update(roots)
    kept = _below_roots(nodes)
    done: dict[Expr, Expr] = {}
    for node in nodes:
        args = tuple([done.get(arg, arg) for arg in node.args])
        moved = node if args == node.args else rebuild(node, args)
        if moved.op in CHOICES or is_bent_table(moved):
            formulas = in_formulas(moved, partial(by_sign, shown=shown))
            if node not in kept or not vanishes_at_breaks(formulas):
                moved = formulas
        elif node not in kept and moved.op == node.op:
            if node.op == "abs" and node in bare:
                moved = _absolute(args[0], 1, shown)
            elif node.op == "sign":
                moved = by_sign(args[0], ONE, -ONE, shown) or moved
            elif node.op == "sqrt":
                moved = _root(moved)
            elif node.op in ("acos", "asin"):
                moved = _arc(moved)
            elif _is_smooth_power(node) and node.args[0].op == "abs":
                exponent = node.args[1].payload
                if exponent.denominator == 1:
                    inner = node.args[0].args[0]
                    moved = _absolute(done.get(inner, inner), int(exponent), shown)
        done[node] = moved
    return tuple([done.get(root, root) for root in roots])


def _below_roots(nodes: Iterable[Expr]) -> set[Expr]:
    """Return what roots, logarithms or quotients among nodes are taken of, factor by factor.

    Where it vanishes they end: beside it, in pieces, they would be asked for roots of -1e-17.
    """
    found: set[Expr] = set()
    for node in nodes:
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


def _is_absolute(node: Expr) -> bool:
    """Say whether a root is that of a square of one parameter."""
    return len(node.symbols) == 1 and _half(node.args[0]) is not None


def _root(node: Expr) -> Expr:
    """Return the root of a square of one parameter without the root."""
    half = _half(node.args[0])
    if half is None or len(node.symbols) != 1:
        return node
    inner, exponent = half
    return _absolute(inner, exponent, ()) if exponent % 2 else power(inner, number(exponent))


def _arc(node: Expr) -> Expr:
    """Return the arc of a wave of one parameter in pieces: there and back with the wave's angle."""
    wave, turned = node.args[0], False
    if wave.op == "neg":
        wave, turned = wave.args[0], True
    if wave.op not in ("sin", "cos") or len(wave.symbols) != 1:
        return node
    (angle,), cosine = wave.args, wave.op == "cos"
    changes = sign_changes(call("sin" if cosine else "cos", angle))
    if changes is None:
        return node
    name, places = changes.name, changes.places
    rows = []
    for low, high in pairwise((Fraction(0), *places, Fraction(1))):
        at = (float(low + (high - low) * share) for share in _SHARES)
        found_there = [evaluate(angle, {name: x}) / pi for x in at]
        # the angle may touch the end of its half turn inside, and turn back
        half_turns = max(found_there, key=lambda x: abs(x - round(x)) * (1 if cosine else -1))
        # the arc is the distance from whole turns (cos), or what is left of the nearest half (sin)
        whole = floor(half_turns) if cosine else round(half_turns)
        even = whole % 2 == 0
        end = whole + 1 if cosine and not even else whole
        rows.append(angle - end * PI if even else end * PI - angle)
    arc = in_pieces(name, places, tuple(rows))
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
        return _of_one_sign(argument, exponent, shown)
    result = ONE
    for factor, times in _factors(argument):
        if times * exponent % 2 == 0:
            result = result * power(factor, number(times * exponent))
        else:
            result = result * _of_one_sign(factor, times * exponent, shown)
    return result


def _factors(tree: Expr) -> list[tuple[Expr, int]]:
    """Return factors of a tree and their exponents."""
    if tree.op == "neg":
        return [(-ONE, 1), *_factors(tree.args[0])]
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


def _of_one_sign(factor: Expr, exponent: int, shown: tuple[Expr, ...]) -> Expr:
    """Return |factor|^exponent, the exponent odd, without the absolute value where it can be."""
    if factor.symbols:
        smooth = abs(exponent) > 1
        whole = power(factor, number(exponent))
        found = _by_sign_of(factor, whole, -whole, None if smooth else shown)
        if found is not None:
            return found
    return power(call("abs", factor), number(exponent))


def by_sign(
    condition: Expr, positive: Expr, negative: Expr, shown: tuple[Expr, ...] | None
) -> Expr | None:
    """Return one tree where a condition is positive, and the other where it is negative.

    The places where it changes its sign are breaks of the parameter along which it does; one that
    keeps its sign leaves one tree. A condition that is zero along a whole piece of a parameter is
    positive there. `shown` are u, v and w of the equation as trees of the symbols, each of which
    runs from 0 to 1. None where the changes are too many to be found. Raises
    BreaksNotAlignedError where they lie along a curve; without `shown` that is None as well.
    """
    for factor, times in _factors(condition):
        if times % 2 == 0:
            continue
        if not factor.symbols:
            if evaluate(factor, {}) < 0:
                positive, negative = negative, positive
            continue
        chosen = _by_sign_of(factor, positive, negative, shown)
        other = _by_sign_of(factor, negative, positive, shown)
        if chosen is None or other is None:
            return None
        positive, negative = chosen, other
    return positive


def _by_sign_of(
    factor: Expr, positive: Expr, negative: Expr, shown: tuple[Expr, ...] | None
) -> Expr | None:
    """Return `by_sign` of what is no product; curves are refused where `shown` is given."""
    names = sorted(factor.symbols)
    seen = _signs_seen(factor, names) if len(names) > 1 else {}
    if len(seen) == 1 and _keeps_sign(factor, names):
        return positive if 1 in seen else negative
    parts = _parted(factor, names) if len(names) > 1 else None
    if parts is not None:
        return by_sign(parts[0] * parts[1] * parts[2], positive, negative, shown)
    for name in names:
        changes = sign_changes(factor, name)
        if changes is not None:
            return changes.choose(positive, negative)
    if len(seen) > 1 and shown is not None:
        refuse_curve(factor, shown)
    return None


def _parted(tree: Expr, names: list[str]) -> tuple[Expr, Expr, Expr] | None:
    """Return a tree as a product of a constant and functions of one parameter and of the others.

    None where it is no such product. That it is one is proved to rounding.
    """
    here = {name: number(_AT[k]) for k, name in enumerate(names)}
    (middle,) = substitute((tree,), here)
    if abs(evaluate(middle, {})) < 1e-6 * largest_seen(tree):
        return None
    for name in names:
        (along,) = substitute((tree,), {n: x for n, x in here.items() if n != name})
        (across,) = substitute((tree,), {name: here[name]})
        if is_zero_to_rounding(tree * middle - along * across, tree * middle):
            return middle, along, across
    return None


def _signs_seen(factor: Expr, names: list[str]) -> dict[int, dict[str, float]]:
    """Return a place for each sign that samples show."""
    count = _PLACES.get(len(names), 5)
    steps = [(k + 0.5) / count for k in range(count)]
    signs: dict[int, dict[str, float]] = {}
    for place in product(steps, repeat=len(names)):
        values = dict(zip(names, place, strict=True))
        value = evaluate(factor, values)
        if value:
            signs.setdefault(1 if value > 0 else -1, values)
    return signs


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
