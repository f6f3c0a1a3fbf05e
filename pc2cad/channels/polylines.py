"""Polylines in space as guides, their corners rounded by arcs or cut at a mitre."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import atan2, hypot, tan
from typing import Final

from pc2cad.channels.guides import Guide, GuideError, Part, U, Vector, spatial
from pc2cad.equation.points import point, vector
from pc2cad.expression.tree import Expr, call, number

#: each is a part with a frame of its own, which takes milliseconds
MOST_FILLETS: Final = 400

# -- vectors of floats -----------------------------------------------------------------------------


def _less(a: Sequence[float], b: Sequence[float]) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _plus(a: Vector, b: Vector, factor: float = 1.0) -> Vector:
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


def _scaled(a: Vector, factor: float) -> Vector:
    return a[0] * factor, a[1] * factor, a[2] * factor


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _unit(a: Vector) -> Vector:
    return _scaled(a, 1 / hypot(*a))


# -- polylines -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Stretch:
    """A line or an arc: its length, and its part as a function of the share run, in [0, 1]."""

    length: float
    part: Callable[[Expr], Part]


def line(
    start: Vector, end: Vector, mitres: tuple[Vector | None, Vector | None] = (None, None)
) -> Stretch:
    """Return the straight stretch between two points."""
    step = _less(end, start)
    direction = vector(*_unit(step))
    return Stretch(
        hypot(*step),
        lambda t: Part(point(*start) + vector(*step) * t, direction, mitres),
    )


def arc(centre: Vector, first: Vector, second: Vector, radius: float, angle: float) -> Stretch:
    """Return the arc centre + radius (first cos + second sin) over an angle (radians)."""

    def part(t: Expr) -> Part:
        a = number(angle) * t
        c, s = call("cos", a), call("sin", a)
        N = point(*centre) + (vector(*first) * c + vector(*second) * s) * radius
        return Part(N, vector(*second) * c - vector(*first) * s)

    return Stretch(radius * angle, part)


def polyline(
    points: Sequence[Sequence[float]],
    radius: float | Sequence[float] = 0.0,
    closed: bool = False,
    corners: str = "round",
) -> Guide:
    """Return the polyline through points in space, its corners rounded by arcs.

    `radius` is one fillet radius, or one per corner; u advances with the length. A corner without
    radius is refused, unless `corners` is ``mitre``: then the section is cut in the plane that
    halves the corner. Raises GuideError, also where two fillets need more than their common side.
    """
    if corners not in ("round", "mitre"):
        raise GuideError(f"the corners are round or mitre, not '{corners}'")
    places = spatial(points, 3 if closed else 2, "polyline")
    count = len(places)
    inner = list(range(count)) if closed else list(range(1, count - 1))
    radii = _radii(radius, len(inner))
    cuts = {
        i: _corner(places[i - 1], places[i], places[(i + 1) % count], r, corners, i)
        for i, r in zip(inner, radii, strict=True)
    }
    stretches: list[Stretch] = []
    for i in range(count if closed else count - 1):
        j = (i + 1) % count
        here, there = cuts.get(i), cuts.get(j)
        start = here.end if here else places[i]
        end = there.start if there else places[j]
        step, side = _less(end, start), _less(places[j], places[i])
        left = _dot(step, _unit(side))
        if left < -1e-9 * hypot(*side):
            needed = hypot(*side) - left
            raise GuideError(
                f"the side from point {i + 1} to point {j + 1} is {hypot(*side):.6g} long, and its "
                f"fillets need {needed:.6g}"
            )
        if left > 1e-9 * hypot(*side):
            ends = (here.mitre if here else None, there.mitre if there else None)
            stretches.append(line(start, end, ends))
        if there is not None and there.arc is not None:
            stretches.append(there.arc)
    kind = "closed polyline" if closed else "polyline"
    fillets = sum(cut is not None and cut.arc is not None for cut in cuts.values())
    words = f"a {kind} through {count} points with {fillets} fillets"
    return in_turn(stretches, closed, words)


def _radii(radius: float | Sequence[float], count: int) -> list[float]:
    radii = (
        [float(radius)] * count if isinstance(radius, (int, float)) else [float(r) for r in radius]
    )
    if len(radii) != count:
        raise GuideError(f"the polyline has {count} corners, and {len(radii)} radii were given")
    if not all(0 <= r < float("inf") for r in radii):
        raise GuideError("a fillet radius is 0 or more")
    fillets = sum(r > 0 for r in radii)
    if fillets > MOST_FILLETS:
        raise GuideError(f"a polyline has at most {MOST_FILLETS} fillets, here are {fillets}")
    return radii


@dataclass(frozen=True)
class _Corner:
    """Where a fillet begins and ends, and its arc; or the plane of a mitre."""

    start: Vector
    end: Vector
    arc: Stretch | None = None
    mitre: Vector | None = None


def _corner(
    before: Vector, here: Vector, after: Vector, radius: float, corners: str, index: int
) -> _Corner | None:
    incoming, outgoing = _unit(_less(here, before)), _unit(_less(after, here))
    cosine = max(-1.0, min(1.0, _dot(incoming, outgoing)))
    across = _plus(outgoing, incoming, -cosine)
    if hypot(*across) < 1e-12 and cosine > 0:
        return None  # straight on
    # exact near 0 and pi too
    angle = 2 * atan2(hypot(*_less(incoming, outgoing)), hypot(*_plus(incoming, outgoing)))
    if cosine < 0 and hypot(*across) < 1e-6:
        raise GuideError(f"the polyline turns back on itself at point {index + 1}")
    if radius == 0:
        if corners == "round":
            raise GuideError(
                f"the polyline has a corner at point {index + 1} and no radius there; give one, or "
                "let the section be cut there with corners = mitre"
            )
        return _Corner(here, here, mitre=_unit(_plus(incoming, outgoing)))
    inward = _unit(across)
    reach = radius * tan(angle / 2)
    start = _plus(here, incoming, -reach)
    centre = _plus(start, inward, radius)
    return _Corner(
        start, _plus(here, outgoing, reach),
        arc(centre, _scaled(inward, -1.0), incoming, radius, angle),
    )  # fmt: skip


def in_turn(stretches: Sequence[Stretch], closed: bool, words: str) -> Guide:
    """Return stretches one after another, u going with their length."""
    total = sum(s.length for s in stretches)
    run, breaks = 0.0, [Fraction(0)]
    for stretch in stretches:
        run += stretch.length
        breaks.append(Fraction(run / total))
    breaks[-1] = Fraction(1)
    parts = tuple(
        stretch.part((U - number(low)) / number(high - low))
        for stretch, (low, high) in zip(stretches, pairwise(breaks), strict=True)
    )
    return Guide(parts, tuple(breaks), closed, words)
