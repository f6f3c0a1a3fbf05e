"""Guide curves: what a channel's section is carried along (the paper, Fig. 6).

A guide is a point N(u), smooth or made of smooth parts that join with a common tangent. Parts keep
their own trees: an arc of a polyline stays an arc, exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from math import atan2, degrees, dist, hypot, isfinite
from typing import Final

from pc2cad.equation.points import Combination, Value, derivative, kind_of, length, point, vector
from pc2cad.equation.points import Kind as ValueKind
from pc2cad.errors import InputError
from pc2cad.expression.tree import PI, Expr, Number, as_expr, call, number, pieces, symbol

U: Final = symbol("u")
#: positions of parts that join agree to this, relative to the guide's size
JOINED: Final = 1e-9
#: sine of the angle from which tangents of parts that join make a corner
CORNER: Final = 1e-8
#: parts of a guide
MOST_PARTS: Final = 2000

Vector = tuple[float, float, float]


class GuideError(InputError):
    """A guide curve is not as a channel needs it."""


@dataclass(frozen=True, eq=False)
class Part:
    """A smooth part of a guide: its point, and its unit tangent where that has a plain form.

    Trees of u on the part's own share of the interval.
    """

    point: Combination
    unit_tangent: Combination | None = None
    #: planes that cut the ends of the part at a mitre: their normals (None: a square end)
    mitres: tuple[Vector | None, Vector | None] = (None, None)

    @property
    def speed(self) -> Combination:
        """N'(u)."""
        found = derivative(self.point, "u")
        assert isinstance(found, Combination)
        return found

    @property
    def tangent(self) -> Combination:
        """The unit tangent."""
        return self.speed / length(self.speed) if self.unit_tangent is None else self.unit_tangent

    def moved(self, argument: Expr) -> Part:
        """Return the part with another argument in the place of u."""
        there = {"u": argument}
        tangent = self.unit_tangent
        return replace(
            self,
            point=self.point.substitute(there),
            unit_tangent=None if tangent is None else tangent.substitute(there),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Guide:
    """A guide N(u) over an interval of u, in smooth parts."""

    parts: tuple[Part, ...]
    #: limits of the parts, ascending
    breaks: tuple[Fraction, ...]
    #: whether its end is its beginning, None where that is to be found out
    joined: bool | None
    #: what it is, for people
    words: str

    def __repr__(self) -> str:
        return f"<Guide: {self.words}>"

    @cached_property
    def closed(self) -> bool:
        """Whether the ends are one point with one tangent."""
        return _is_closed(self) if self.joined is None else self.joined

    @property
    def N(self) -> Combination:
        """The point of the guide as one tree of u."""
        return self.join([part.point for part in self.parts])

    def join(self, values: Sequence[Combination]) -> Combination:
        """Return one tree of what each part has its own of."""
        if len(values) == 1:
            return values[0]
        rows = zip(*(v.coordinates for v in values), strict=True)
        x, y, z = (
            pieces(U, self.breaks, tuple((tree,) for tree in row), smoothness=0, closed=False)
            for row in rows
        )
        return Combination(x, y, z, values[0].weight)

    def limits(self, index: int) -> tuple[float, float]:
        """Return where a part begins and ends."""
        return float(self.breaks[index]), float(self.breaks[index + 1])


def _limits(interval: Sequence[Number | Expr]) -> tuple[Fraction, Fraction]:
    from pc2cad.expression.scalar import evaluate

    low, high = (as_expr(x) for x in interval)
    ends = [
        x.payload if x.op == "number" else Fraction(evaluate(x, {}))
        for x in (low, high)
    ]  # fmt: skip
    if not ends[0] < ends[1]:
        raise GuideError("the interval of a guide has two ascending limits")
    return ends[0], ends[1]


def curve(N: Value, interval: Sequence[Number | Expr] = (0, 1), words: str = "") -> Guide:
    """Return the guide of any point N(u) with u over an interval; raise GuideError otherwise.

    It is closed where its ends are one point with one tangent.
    """
    if kind_of(N) is not ValueKind.POINT or not isinstance(N, Combination):
        raise GuideError(f"a guide is a point N(u), and {kind_of(N).value} was given")
    depends = frozenset[str]().union(*(c.symbols for c in N.coordinates))
    if "u" not in depends:
        raise GuideError("a guide depends on u, and this one does not")
    if not depends <= {"u"}:
        raise GuideError(f"a guide depends on u alone, not on {', '.join(sorted(depends - {'u'}))}")
    part = Part(N)
    low, high = _limits(interval)
    return Guide((part,), (low, high), None, words or "a curve")


def _is_closed(guide: Guide) -> bool:
    from pc2cad.channels import guide_functions

    first, last = guide.parts[0], guide.parts[-1]
    ends = []
    for part, place in ((first, guide.breaks[0]), (last, guide.breaks[-1])):
        ends.append(
            guide_functions.at((*part.point.coordinates, *part.tangent.coordinates), float(place))
        )
    size = _size(guide)
    gap = abs(ends[0] - ends[1])
    return bool(max(gap[:3]) <= JOINED * size and max(gap[3:]) <= CORNER)


def _size(guide: Guide) -> float:
    from pc2cad.channels import guide_functions

    size = guide_functions.extent(
        [(p.point.coordinates, guide.limits(i)) for i, p in enumerate(guide.parts)]
    )
    if not isfinite(size):
        raise GuideError("the guide has no finite point somewhere in its interval")
    return size


def helix(
    radius: Expr | Number,
    pitch: Expr | Number,
    turns: Expr | Number,
    end_radius: Expr | Number | None = None,
) -> Guide:
    """Return a helix about the z axis, from (radius, 0, 0) upwards; conic with an end radius."""
    radius, pitch, turns = as_expr(radius), as_expr(pitch), as_expr(turns)
    angle = 2 * PI * turns
    if end_radius is None:
        rise = pitch / (2 * PI)
        N, tangent = _helix(radius, rise, angle)
        return Guide((Part(N, tangent),), (Fraction(0), Fraction(1)), False, "a helix")
    r = radius + (as_expr(end_radius) - radius) * U
    t = angle * U
    N = point(r * call("cos", t), r * call("sin", t), pitch * turns * U)
    return Guide((Part(N),), (Fraction(0), Fraction(1)), False, "a conic helix")


def _helix(radius: Expr, rise: Expr, angle: Expr) -> tuple[Combination, Combination]:
    c, s = call("cos", angle * U), call("sin", angle * U)
    N = point(radius * c, radius * s, rise * angle * U)
    slant = call("sqrt", radius**2 + rise**2)
    return N, vector(-radius * s, radius * c, rise) / slant


def spline(
    points: Sequence[Sequence[float]], closed: bool = False, spacing: str = "chord"
) -> Guide:
    """Return the C² cubic spline through points in space.

    `spacing` says how u advances from point to point: with the chord length, with its square root
    (``centripetal``), or in equal steps (``uniform``). An open spline has no knot at its second and
    last but one point (four points give one cubic); a closed one is periodic, and its first point
    must not be repeated. Raises GuideError.
    """
    from pc2cad.expression.interpolation import cubic_rows

    places = spatial(points, 3 if closed else 2, "spline")
    shares = spaced(places, closed, spacing)
    breaks, axes = cubic_rows(places, shares, closed)
    x, y, z = (
        pieces(U, breaks, tuple(tuple(number(c) for c in row) for row in rows), 2, closed)
        for rows in axes
    )
    kind = "closed" if closed else "open"
    words = f"the {kind} C2 spline through {len(places)} points ({spacing} spacing)"
    return Guide((Part(point(x, y, z)),), (Fraction(0), Fraction(1)), closed, words)


def spaced(places: Sequence[Sequence[float]], closed: bool, spacing: str) -> list[Fraction]:
    """Return where in [0, 1] each point is reached, the closing one included."""
    powers = {"uniform": 0.0, "centripetal": 0.5, "chord": 1.0}
    if spacing not in powers:
        raise GuideError(f"the spacing is one of {', '.join(powers)}, not '{spacing}'")
    around = [*places, places[0]] if closed else list(places)
    steps = [Fraction(dist(p, q) ** powers[spacing]) for p, q in pairwise(around)]
    total = sum(steps)
    result = [Fraction(0)]
    for step in steps:
        # short fractions: the tree's own arithmetic stays fast
        result.append(Fraction(float(result[-1] + step / total)))
    result[-1] = Fraction(1)
    return result


def spatial(points: Sequence[Sequence[float]], least: int, what: str) -> list[Vector]:
    """Return points in space as floats; raise GuideError for too few, too many or equal ones."""
    places: list[Vector] = []
    for i, given in enumerate(points):
        numbers = tuple(float(x) for x in given)
        if len(numbers) != 3 or not all(isfinite(x) for x in numbers):
            raise GuideError(f"point {i + 1} of the {what} is not three finite coordinates")
        places.append((numbers[0], numbers[1], numbers[2]))
    if len(places) < least:
        raise GuideError(f"a {what} needs at least {least} points, here are {len(places)}")
    if len(places) > MOST_PARTS:
        raise GuideError(f"a {what} has at most {MOST_PARTS} points, here are {len(places)}")
    size = max(dist(p, places[0]) for p in places)
    for i, (p, q) in enumerate(zip(places, [*places[1:], places[0]], strict=True)):
        last = i == len(places) - 1
        if dist(q, p) <= 1e-9 * size and not (last and least == 2):
            follows = "the first one again" if last else f"point {i + 2}"
            raise GuideError(f"point {i + 1} of the {what} and {follows} are the same place")
    return places


def composite(guides: Sequence[Guide], corners: str = "refuse") -> Guide:
    """Return guides one after another; each must begin where the one before it ended.

    Their tangents have to agree (G1), or, where `corners` is ``mitre``, the section is cut in the
    plane that halves the corner; so at the end of a closed one. The parts become faces of their
    own. u goes with the length. Raises GuideError with the place that does not fit.
    """
    if corners not in ("refuse", "mitre"):
        raise GuideError(f"the corners are refuse or mitre, not '{corners}'")
    if not guides:
        raise GuideError("a composite guide needs at least one part")
    if len(guides) > 1 and any(g.closed for g in guides):
        raise GuideError("a closed guide cannot be a part of a composite one")
    many = sum(len(g.parts) for g in guides)
    if many > MOST_PARTS:
        raise GuideError(f"a guide has at most {MOST_PARTS} parts, here are {many}")
    lengths = [_length(g) for g in guides]
    ends = [_ends(g) for g in guides]
    count, size = len(guides), sum(lengths)
    closed = dist(ends[-1][1][0], ends[0][0][0]) <= JOINED * size
    planes: list[Vector | None] = [None] * count
    for i in range(count if closed else count - 1):
        (here, before), (there, after) = ends[i][1], ends[(i + 1) % count][0]
        if not dist(here, there) <= JOINED * size:
            raise GuideError(
                f"part {i + 2} of the guide begins {dist(here, there):.3g} from the end of part "
                f"{i + 1}"
            )
        planes[i] = _mitre(before, after, corners, i + 1, (i + 1) % count + 1)
    run, breaks, parts = 0.0, [Fraction(0)], []
    for i, (guide, own) in enumerate(zip(guides, lengths, strict=True)):
        low, high = float(breaks[-1]), (run + own) / size
        a, b = guide.breaks[0], guide.breaks[-1]
        argument = number(a) + (U - number(low)) * (number(b - a) / number(high - low))
        parts += [p.moved(argument) for p in _cut(guide.parts, planes[i - 1], planes[i])]
        breaks += [
            Fraction(low + (high - low) * float((x - a) / (b - a))) for x in guide.breaks[1:]
        ]
        run += own
    breaks[-1] = Fraction(1)
    mitred = sum(plane is not None for plane in planes)
    words = f"{count} guides joined ({f'G1, {mitred} corners mitred' if mitred else 'G1'})"
    return Guide(tuple(parts), tuple(breaks), closed, words)


def _ends(guide: Guide) -> tuple[tuple[Vector, Vector], tuple[Vector, Vector]]:
    """Return place and unit tangent at the beginning and at the end."""
    from pc2cad.channels import guide_functions

    found = []
    for part, place in ((guide.parts[0], guide.breaks[0]), (guide.parts[-1], guide.breaks[-1])):
        row = guide_functions.at(
            (*part.point.coordinates, *part.tangent.coordinates), float(place)
        ).tolist()
        found.append(((row[0], row[1], row[2]), (row[3], row[4], row[5])))
    return found[0], found[1]


def _mitre(before: Vector, after: Vector, corners: str, first: int, second: int) -> Vector | None:
    """Return the normal of the plane that halves a corner; None where there is none."""
    turn = dist(before, after)
    if turn <= CORNER:
        return None
    along = (before[0] + after[0], before[1] + after[1], before[2] + after[2])
    size = hypot(*along)
    if not size > 1e-6:
        raise GuideError(f"the guide turns back on itself between parts {first} and {second}")
    if corners == "refuse":
        raise GuideError(
            f"parts {first} and {second} of the guide meet in a corner of "
            f"{degrees(2 * atan2(turn, size)):.3g} degrees; put an arc between them, or let the "
            "section be cut there with corners = mitre"
        )
    return along[0] / size, along[1] / size, along[2] / size


def _cut(parts: tuple[Part, ...], start: Vector | None, end: Vector | None) -> tuple[Part, ...]:
    """Return the parts of a guide with its two ends cut at a mitre."""
    first = replace(parts[0], mitres=(start, parts[0].mitres[1]))
    parts = (first, *parts[1:])
    return (*parts[:-1], replace(parts[-1], mitres=(parts[-1].mitres[0], end)))


def _length(guide: Guide) -> float:
    from pc2cad.channels import guide_functions

    total = 0.0
    for i, part in enumerate(guide.parts):
        limits = guide_functions.knots(part.speed.coordinates, *guide.limits(i))
        total += guide_functions.antiderivative(
            guide_functions.function(length(part.speed)), limits
        ).total
    return total
