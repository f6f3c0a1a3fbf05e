"""Kinks along curves of the box, which no line of the solid follows: where they run; refused."""

from __future__ import annotations

from itertools import product
from typing import NoReturn

import numpy as np

from pc2cad.expression.breaks import BreaksNotAlignedError
from pc2cad.expression.evaluation import Program
from pc2cad.expression.normal_form import normal_form, tree_of
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, symbol

#: lines of the box per other parameter along which a curve is looked for, and places on each
_LINES, _PLACES = {1: 17, 2: 7}, 64
#: longest expressions that a message repeats
_LONGEST = 60


def refuse_curve(tree: Expr, shown: tuple[Expr, ...]) -> NoReturn:
    """Raise BreaksNotAlignedError: a tree changes its sign along no line of the box.

    The symbols of the tree run from 0 to 1; `shown` are u, v and w of the equation as trees of
    them. The message has the course of the curve, and what could be written instead.
    """
    names = sorted(tree.symbols)
    own = [(p, shown[PARAMETERS.index(p)]) for p in names]
    course = "; ".join(
        ", ".join(f"{name} = {evaluate(parameter, place):.4g}" for name, parameter in own)
        for place in _course(tree, names)
    )
    plain = all(parameter.op == "symbol" for parameter in shown) and len(repr(tree)) < _LONGEST
    what = repr(tree) if plain else f"a function of {' and '.join(names)}"
    raise BreaksNotAlignedError(
        f"{what} changes its sign in abs, max or a condition: a kink along a curve through "
        f"{course}; kinks are lines of the solid only where they lie at values of one parameter: "
        f"take parameters in which they do, or two bodies{_instead(tree, names) if plain else ''}"
    )


def _course(tree: Expr, names: list[str]) -> list[dict[str, float]]:
    """Return up to three places along the zeros of a tree: the first, a middle and the last one."""
    found: list[tuple[float, ...]] = []
    program = Program((tree,))
    along = np.linspace(0.0, 1.0, _PLACES)
    lines = np.linspace(0.0, 1.0, _LINES[len(names) - 1])
    for name in names:
        others = [other for other in names if other != name]
        for fixed in product(lines.tolist(), repeat=len(others)):
            place = dict(zip(others, fixed, strict=True))
            (values,) = program({name: along, **place})
            values = np.broadcast_to(values, along.shape)
            for k in np.flatnonzero((values[:-1] > 0) != (values[1:] > 0)):
                place[name] = _zero(tree, place, name, along[k], along[k + 1])
                found.append(tuple(place[n] for n in names))
    found.sort()
    chosen = dict.fromkeys(found[k] for k in (0, len(found) // 2, -1)) if found else {}
    return [dict(zip(names, place, strict=True)) for place in chosen]


def _zero(tree: Expr, place: dict[str, float], name: str, low: float, high: float) -> float:
    positive = evaluate(tree, {**place, name: low}) > 0
    for _ in range(40):
        middle = (low + high) / 2
        if (evaluate(tree, {**place, name: middle}) > 0) == positive:
            low = middle
        else:
            high = middle
    return float(low + high) / 2


def _instead(tree: Expr, names: list[str]) -> str:
    """Return a hint for a curve that is the graph of a function with values in [0, 1]."""
    for name in names:
        at = _solved(tree, name)
        if at is None or at.symbols != frozenset(names) - {name}:
            continue
        grid = np.meshgrid(*[np.linspace(0.0, 1.0, 33)] * len(at.symbols), indexing="ij")
        (values,) = Program((at,))(dict(zip(sorted(at.symbols), grid, strict=True)))
        if values.min() >= 0 and values.max() <= 1:
            p = symbol(name)
            return f", one with {at * p!r} for {name} and one with {at + (1 - at) * p!r}"
    return ""


def _solved(tree: Expr, name: str) -> Expr | None:
    """Return what a parameter is where a tree that is linear in it, with a number, vanishes."""
    form = normal_form(tree, largest=50)
    if form is None:
        return None
    slope = form.pop(((symbol(name), 1),), None)
    rest = tree_of(form)
    return None if slope is None or name in rest.symbols else rest / -slope
