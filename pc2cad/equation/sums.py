"""Sums of point equations that are Booleans: M1 + M2 - K, with the parameters in common.

K, the *core*, is where M1 begins and M2 ends: M1 at one end of a parameter p and M2 at the other
are K, point by point. Then the sum is M2 at the first end and M1 at the second. As an oriented
surface its boundary is the sum of both boundaries, if that holds of the other sides as well:

    closed      the two sides across a parameter coincide, in M1 and in M2
    collapsed   both are curves along p only
    on rays     M1 - K and M2 - K have one direction along each curve of p
    in a plane  both are in one plane, and so on lines at its ends (or its ends coincide)

How often a boundary winds about a place adds up. So where det J of M1 and of M2 have different
signs, each covers no place twice, and det J of the sum keeps the sign of M1's, the sum is what M1
has and M2 has not: that M2 lies in M1 follows. With one sign it is both together. Everything here
is algebra; `csg.arithmetic` asks for the rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import combinations, product
from math import hypot, isfinite

from pc2cad.equation.point_equation import Expectations, PointEquation, Written
from pc2cad.equation.unit_box import (
    Trees,
    Turn,
    at_end,
    common_sides,
    minus,
    over_own_box,
    over_unit_box,
    parity,
    replaced,
    seem_one,
    size_of,
    turned,
)
from pc2cad.equation.variation import Variation
from pc2cad.errors import InputError
from pc2cad.expression.identity import Verdict, is_zero
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, number, symbol

#: places along a parameter at which planes are looked for; rational, so that constants stay exact
_PLACES = tuple(number(Fraction(k, 7)) for k in (1, 4, 6))
#: of the size squared: a normal that is shorter is none
_FLAT = 1e-9


@dataclass(frozen=True)
class Sum:
    """M1 + M2 - K over the box of M1, and what algebra says of its boundary."""

    equation: PointEquation
    #: the side of M1 that is the core, and that of M2, in the parameters of M1
    core: tuple[str, str]
    #: +1 or -1, as the parameters of M2 were exchanged for those of M1
    turned: int
    #: how the other sides add up, as sentences
    sides: tuple[str, ...]
    #: the condition that fails, or nothing
    unmet: str = ""


def sums(first: PointEquation, second: PointEquation) -> Iterator[Sum]:
    """Give the sums of two equations that have a core in common, those without a flaw first.

    The parameters of the second may be exchanged and turned round.
    """
    one, other = over_unit_box(first), over_unit_box(second)
    flawed = []
    for p, end in product(range(3), range(2)):
        for turn, _ in common_sides(one, other, p, end, opposite=True):
            way = _Way(p, end, turn)
            found = way.sum(first, second)
            if found.unmet:
                flawed.append(found)
            elif first.freer is None or second.freer is None:
                yield found
            else:
                freer = partial(way.freed, first, second)
                yield replace(found, equation=replace(found.equation, freer=freer))
    yield from flawed


@dataclass(frozen=True)
class _Way:
    """How two equations are summed up: the side of the first that is the core, and the turn."""

    p: int
    end: int
    #: of the second's parameters into those of the first
    turn: Turn

    def sum(self, first: PointEquation, second: PointEquation) -> Sum:
        """Return the sum, examined."""
        maps = over_unit_box(first), turned(over_unit_box(second), self.turn)
        return _examined(first, maps, self.p, self.end, parity(self.turn))

    def freed(self, first: PointEquation, second: PointEquation, name: str) -> Variation:
        """Return how the sum changes with a parameter; InputError where it is none beside."""
        one, other = first.variation(name), second.variation(name)

        def at(value: Expr) -> PointEquation:
            found = self.sum(one.at(value), other.at(value))
            if found.unmet:
                raise InputError(
                    f"{first.name} less {second.name} is one equation at {name} = {one.value:.6g} "
                    f"and not beside it: {found.unmet}; write cut(a, b) in the place of "
                    "difference(a, b)"
                )
            return found.equation

        at(number(Fraction(one.value) * (1 + Fraction(1, 64)) or 1))
        trees: Trees | None = None
        if one.coordinates is not None and other.coordinates is not None:
            trees = _summed(one.coordinates, turned(other.coordinates, self.turn), self.p, self.end)
        return Variation(name, one.bound, trees, at, one.domain)


def _summed(one: Trees, other: Trees, p: int, end: int) -> Trees:
    core = at_end(one, p, end)
    x, y, z = (a + b - k for a, b, k in zip(one, other, core, strict=True))
    return x, y, z


def as_written(equation: PointEquation, form: Written) -> Sum:
    """Return what algebra says of a sum as it is written, with the parameters as they are."""
    one, other, core = (
        over_unit_box(equation, trees) for trees in (form.first, form.second, form.core)
    )
    size = size_of(one)
    for p, end in product(range(3), range(2)):
        ends = at_end(one, p, end), at_end(other, p, 1 - end)
        if all(seem_one(trees, core, size) for trees in ends):
            return _examined(equation, (one, other), p, end, 1)
    first, second = form.names
    text = (
        f"{first} begins nowhere, at an end of u, v or w, where {second} ends at the other, in "
        f"{form.core_name}, which is subtracted"
    )
    return Sum(equation, ("", ""), 1, (), text)


def _examined(
    equation: PointEquation, maps: tuple[Trees, Trees], p: int, end: int, sign: int
) -> Sum:
    """Return the sum of two maps over the unit box, the first of which begins in the core."""
    one, other = maps
    core = at_end(one, p, end)
    names = tuple(f"{PARAMETERS[p]}={(end, 1 - end)[k]}" for k in range(2))
    made = replace(
        equation, coordinates=over_own_box(equation, _summed(one, other, p, end)), layers=(),
        depth=None, guide=None, frame="", fields=(), written=tuple, mover=None, freer=None,
        expectations=Expectations(),
    )  # fmt: skip
    size = size_of(one)
    asked = _Asked(size)
    unmet, sides = "", []
    if not asked.zero(*(a - b for a, b in zip(core, at_end(other, p, 1 - end), strict=True))):
        unmet = f"the core of both is one {asked.last}"
    for q in (k for k in range(3) if k != p):
        if unmet:
            break
        words, unmet = _across(asked, maps, core, p, q)
        sides.append(words)
    return Sum(made, (names[0], names[1]), sign, tuple(sides), unmet)


def _across(
    asked: _Asked, maps: tuple[Trees, Trees], core: Trees, p: int, q: int
) -> tuple[str, str]:
    """Return how the sides across a parameter add up, and what fails."""
    r, name = 3 - p - q, PARAMETERS[q]
    if _closed(asked, maps, q):
        return f"{name} closes", ""
    found = []
    for end in range(2):
        one, other, middle = (at_end(trees, q, end) for trees in (*maps, core))
        if asked.zero(*_along(one, r), *_along(other, r)):
            found.append(f"{name}={end} collapses")
        elif _on_rays(asked, (one, other, middle), p, q):
            found.append(f"{name}={end} lies on common rays")
        elif _in_plane(asked, (one, other, middle), maps, (p, q, r)):
            found.append(f"{name}={end} lies in one plane")
        else:
            known = "" if asked.refuted else " (it seems so, and is not proved)"
            return "", (
                f"the sides {name}={end} of both lie neither in one plane, with straight edges, "
                f"nor on common rays from the core{known}"
            )
    return ", ".join(found), ""


def _closed(asked: _Asked, maps: tuple[Trees, Trees], q: int) -> bool:
    """Say whether the sides across a parameter coincide, in both maps."""
    return asked.zero(
        *(a - b for trees in maps
          for a, b in zip(at_end(trees, q, 0), at_end(trees, q, 1), strict=True))
    )  # fmt: skip


def _along(trees: Trees, r: int) -> Trees:
    """Return how points change along a parameter, from its beginning."""
    return minus(trees, at_end(trees, r, 0))


def _on_rays(asked: _Asked, sides: Sequence[Trees], p: int, free: int) -> bool:
    """Say whether both sides run from the core in one direction along each curve of p.

    `free` is a parameter that the sides do not have.
    """
    one, other, core = sides
    along = [minus(trees, core) for trees in (one, other)]
    beside = [replaced(trees, {PARAMETERS[p]: symbol(PARAMETERS[free])}) for trees in along]
    pairs = ((along[0], beside[0]), (along[1], beside[1]), (along[0], beside[1]))
    return all(asked.zero(*_cross(a, b), degree=2) for a, b in pairs)


def _in_plane(
    asked: _Asked, sides: Sequence[Trees], maps: tuple[Trees, Trees], of: tuple[int, int, int]
) -> bool:
    """Say whether both sides lie in one plane, and their ends on lines or on one another."""
    p, q, r = of
    one, other, _ = sides
    places = [{PARAMETERS[p]: a, PARAMETERS[r]: b} for a, b in product(_PLACES, repeat=2)]
    seen = [replaced(trees, at) for trees in (one, other) for at in places]
    origin = seen[0]
    spans = [minus(place, origin) for place in seen[1:]]
    normal = max((_cross(a, b) for a, b in combinations(spans, 2)), key=_length)
    if not _length(normal) > _FLAT * asked.size**2:
        return False
    for trees in (one, other):
        if not asked.zero(_dot(normal, minus(trees, origin)), degree=3):
            return False
    if _closed(asked, maps, r):
        return True
    return all(
        _on_rays(asked, [at_end(trees, r, end) for trees in sides], p, q) for end in range(2)
    )


class _Asked:
    """Asks whether trees are zero, by algebra, and remembers what samples said of the last."""

    def __init__(self, size: float) -> None:
        self.size = size
        self.refuted = False

    def zero(self, *trees: Expr, degree: int = 1) -> bool:
        """Say whether all trees, lengths to some power, are proved to be zero."""
        for tree in trees:
            verdict = is_zero(tree, self.size**degree)
            if verdict is not Verdict.PROVED:
                self.refuted = verdict is Verdict.REFUTED
                return False
        return True

    @property
    def last(self) -> str:
        """What is said of an identity that is not proved."""
        return "in no place but a few" if self.refuted else "wherever it was looked at: not proved"


def _cross(a: Trees, b: Trees) -> Trees:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def _dot(a: Trees, b: Trees) -> Expr:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _length(trees: Trees) -> float:
    """Return the length of a constant vector; nothing where it has none."""
    found = hypot(*(evaluate(tree, {}) for tree in trees))
    return found if isfinite(found) else 0.0
