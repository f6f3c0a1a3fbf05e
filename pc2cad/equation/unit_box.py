"""Maps over the unit box, and the 48 ways in which its parameters may be exchanged and turned."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, permutations, product
from math import hypot

from pc2cad.equation import point_equation
from pc2cad.equation.point_equation import PointEquation
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import ONE, ZERO, Expr, substitute, symbol

#: the coordinates of a point, as trees
Trees = tuple[Expr, Expr, Expr]
#: which parameter stands for each, and which of them are turned round
Turn = tuple[tuple[int, ...], tuple[bool, ...]]
_ENDS = (ZERO, ONE)
#: places of the box at which maps are compared before algebra is asked, and of their size what is
#: none
_SEEN = ((0.21, 0.37, 0.74), (0.83, 0.59, 0.31), (0.47, 0.91, 0.13))
_NEAR = 1e-9


def over_unit_box(equation: PointEquation, trees: Trees | None = None) -> Trees:
    """Return an equation's coordinates, or others over its box, over the unit box."""
    return replaced(trees or equation.coordinates, point_equation.over_unit_box(equation.domain))


def over_own_box(equation: PointEquation, trees: Trees) -> Trees:
    """Return coordinates over the unit box over the box of an equation."""
    return replaced(trees, point_equation.over_own_box(equation.domain))


def replaced(trees: Trees, values: dict[str, Expr]) -> Trees:
    """Return coordinates with symbols replaced."""
    x, y, z = substitute(trees, values)
    return x, y, z


def at_end(trees: Trees, direction: int, end: int) -> Trees:
    """Return a map on one side of the unit box."""
    return replaced(trees, {PARAMETERS[direction]: _ENDS[end]})


def minus(a: Trees, b: Trees) -> Trees:
    """Return the difference of two maps."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def turned(trees: Trees, turn: Turn) -> Trees:
    """Return a map over the unit box with its parameters exchanged, and some turned round."""
    values = {}
    for own, other, flip in zip(PARAMETERS, *turn, strict=True):
        there = symbol(PARAMETERS[other])
        values[own] = ONE - there if flip else there
    return replaced(trees, values)


def parity(turn: Turn) -> int:
    """Return the sign of the volume element of a turn."""
    exchanged = sum(a > b for a, b in combinations(turn[0], 2))
    return -1 if (exchanged + sum(turn[1])) % 2 else 1


def size_of(trees: Trees) -> float:
    """Return about how large the image of the unit box is."""
    seen = [_values(trees, at) for at in product((0.1, 0.6, 0.9), repeat=3)]
    return max(_apart(seen[0], place) for place in seen[1:])


def seem_one(a: Trees, b: Trees, size: float) -> bool:
    """Say whether two maps have the same points at a few places, to rounding of a size."""
    return all(_apart(_values(a, at), _values(b, at)) <= _NEAR * size for at in _SEEN)


def common_sides(
    first: Trees, second: Trees, p: int, end: int, opposite: bool
) -> Iterator[tuple[Turn, int]]:
    """Give the turns of the second with which one of its sides seems to be one with a side.

    With each comes the end of p at which it is: the other one, or if not `opposite` either. What
    holds at a few places is for algebra to prove.
    """
    near = _NEAR * size_of(first)
    places = [_put(place, p, end) for place in _SEEN]
    wanted = [_values(first, place) for place in places]
    for names, flips in product(permutations(range(3)), product((False, True), repeat=3)):
        for other in (1 - end,) if opposite else (0, 1):
            there = (_through(_put(place, p, other), names, flips) for place in places)
            gaps = (_apart(a, _values(second, x)) for a, x in zip(wanted, there, strict=True))
            if all(gap <= near for gap in gaps):
                yield (names, flips), other


def _put(place: Sequence[float], p: int, end: int) -> list[float]:
    return [float(end) if k == p else x for k, x in enumerate(place)]


def _through(place: Sequence[float], names: Sequence[int], flips: Sequence[bool]) -> list[float]:
    """Return the parameters that a map has at a place before they are exchanged (`turned`)."""
    return [1.0 - place[k] if flip else place[k] for k, flip in zip(names, flips, strict=True)]


def _apart(a: Sequence[float], b: Sequence[float]) -> float:
    return hypot(*(x - y for x, y in zip(a, b, strict=True)))


def _values(trees: Trees, at: Sequence[float]) -> list[float]:
    names = dict(zip(PARAMETERS, at, strict=True))
    return [evaluate(tree, names) for tree in trees]
