"""Frames along a guide: the points R and Q at distance 1 from N in its normal plane.

The normal NR comes from a reference by the metric operator, the binormal NQ by exit from the plane
(paper, Fig. 6; spec sections 2 and 3). The rotation-minimising frame turns such a frame back by an
angle that is integrated and kept as a spline: that spline defines the frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import atan2, cos, hypot, pi, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pc2cad.equation import along
from pc2cad.equation.guides import Guide, Part
from pc2cad.equation.points import (
    Combination,
    Kind,
    Value,
    cross,
    derivative,
    dot,
    kind_of,
    length,
    unit,
    vector,
)
from pc2cad.equation.tree import ONE, ZERO, Expr, Number, as_expr, call, number, pieces, symbol
from pc2cad.errors import InputError, NotASolidError

Array = NDArray[np.float64]

#: smallest sine of the angle between reference and tangent
LEAST_SINE: Final = 1e-3
#: from here on neighbouring normals are two: ten times what tangents may differ by
JUMP: Final = 1e-7
#: what rounding leaves of a sine
FLAT: Final = 1e-13
KINDS: Final = ("rotation-minimising", "point", "direction", "frenet")
SAMPLES: Final = 400

_REFERRED: Final = {
    "point": "normal towards a fixed point",
    "direction": "normal towards a fixed direction",
    "frenet": "Frenet",
}


class ReferenceAlongTangentError(NotASolidError):
    """The reference of a normal lies along the tangent: there is no normal plane direction."""


class FrameError(InputError):
    """A frame is asked for that does not exist."""


@dataclass(frozen=True, eq=False)
class Frame:
    """The normal plane of a guide, carried along it."""

    guide: Guide
    #: free vectors of length 1 (at a mitre: longer, in the cutting plane), functions of u
    normal: Combination
    binormal: Combination
    #: how it was found, for people
    words: str
    #: share of a turn by which the end of a closed guide is ahead of its beginning
    shift: float = 0.0

    @property
    def N(self) -> Combination:
        """The point of the guide."""
        return self.guide.N

    @property
    def R(self) -> Combination:
        """The point at distance 1 along the normal."""
        return self.N + self.normal

    @property
    def Q(self) -> Combination:
        """The point at distance 1 along the binormal."""
        return self.N + self.binormal

    def shifted(self, M: Combination) -> Combination:
        """Return M with breaks in v where the end of a closed guide is glued on one step ahead.

        Nothing changes but that the faces end there: they are glued whole.
        """
        if not self.shift:
            return M
        count = Fraction(self.shift).limit_denominator(1000).denominator
        breaks = tuple(Fraction(i, count) for i in range(count + 1))
        rows = tuple((number(b), ONE) for b in breaks[:-1])
        around = pieces(symbol("v"), breaks, rows, smoothness=0, closed=False)
        return M.substitute({"v": around})


def frame(
    guide: Guide,
    kind: str = "rotation-minimising",
    reference: Value | None = None,
    twist: Expr | Number = 0,
    symmetry: int = 1,
) -> Frame:
    """Return a frame along a guide.

    `reference`: for ``point`` the fixed point E, for ``direction`` a free vector; for
    ``rotation-minimising`` either says where the normal points at the beginning (default: as near
    to the z axis as can be, or to the x axis). `twist` is an angle in u by which the frame is
    turned in addition. On a closed guide the rotation-minimising frame is turned, evenly along the
    length, until its end fits its beginning, or one that looks the same for a section of this
    `symmetry`. Raises ReferenceAlongTangentError or FrameError.
    """
    if kind not in KINDS:
        raise FrameError(f"the kind of a frame is one of {', '.join(KINDS)}, not '{kind}'")
    _check_reference(kind, reference)
    if symmetry < 1:
        raise FrameError("the symmetry of a section is 1 or more")
    turn = as_expr(twist)
    if not turn.symbols <= {"u"}:
        raise FrameError("the twist of a frame depends on u alone")
    if kind == "rotation-minimising":
        own, words, shift = _minimising(guide, reference, symmetry)
    else:
        own = [_referred(guide, i, kind, reference) for i in range(len(guide.parts))]
        _check_joints(guide, own, kind)
        words, shift = _REFERRED[kind], 0.0
    if turn is not ZERO:
        own = [_turned(pair, turn) for pair in own]
        words += ", with a twist of its own"
    own = [
        _mitred(guide, i, pair) if any(guide.parts[i].mitres) else pair
        for i, pair in enumerate(own)
    ]
    normals, binormals = zip(*own, strict=True)
    return Frame(guide, guide.join(normals), guide.join(binormals), words, shift)


_Pair = tuple[Combination, Combination]


def _check_reference(kind: str, reference: Value | None) -> None:
    found = None if reference is None else kind_of(reference)
    wanted = {"point": (Kind.POINT,), "direction": (Kind.VECTOR,), "frenet": (None,)}.get(
        kind, (None, Kind.POINT, Kind.VECTOR)
    )
    if found not in wanted:
        names = {"point": "a fixed point", "direction": "a free vector", "frenet": "no reference"}
        raise FrameError(
            f"a frame of the kind {kind} takes {names.get(kind, 'a point or a free vector')}"
        )


def _turned(pair: _Pair, angle: Expr) -> _Pair:
    if angle is ZERO:
        return pair
    c, s = call("cos", angle), call("sin", angle)
    e1, e2 = pair
    return e1 * c + e2 * s, e2 * c - e1 * s


# -- frames with a reference -----------------------------------------------------------------------


def _referred(guide: Guide, index: int, kind: str, reference: Value | None) -> _Pair:
    part = guide.parts[index]
    if kind == "frenet":
        towards = derivative(part.point, "u", 2)
    else:
        assert isinstance(reference, Combination)
        towards = reference - part.point if kind == "point" else reference
    assert isinstance(towards, Combination)
    _check_sine(guide, index, towards, kind)
    return _from_reference(part, towards)


def _from_reference(part: Part, towards: Combination) -> _Pair:
    """Return normal and binormal: the metric operator takes the tangent out of the reference."""
    tangent = part.speed
    foot = towards - tangent * (dot(towards, tangent) / dot(tangent, tangent))
    normal = unit(foot)
    return normal, unit(cross(tangent, foot))


def _check_sine(guide: Guide, index: int, towards: Combination, kind: str) -> None:
    part = guide.parts[index]
    roots = (*towards.coordinates, *part.speed.coordinates)

    def sine(u: Array) -> Array:
        found = along.values(roots, u)
        q, t = found[:3], found[3:]
        size = np.linalg.norm(q, axis=0) * np.linalg.norm(t, axis=0)
        with np.errstate(all="ignore"):
            return np.asarray(np.linalg.norm(np.cross(q, t, axis=0), axis=0) / size)

    place, least = along.smallest(sine, *guide.limits(index))
    flip = _flip(roots, *guide.limits(index))
    if flip is not None:
        place, least = flip, 0.0
    if not least >= LEAST_SINE:
        what = {
            "point": "the fixed point lies on the tangent",
            "direction": "the fixed direction lies along the tangent",
            "frenet": "the guide is straight or has an inflection",
        }[kind]
        shown = "0" if not np.isfinite(least) else f"{least:.3g}"
        raise ReferenceAlongTangentError(
            f"the normal of the guide is undefined at u = {place:.6g}: {what} there (sine {shown}, "
            f"at least {LEAST_SINE:g} is needed); the rotation-minimising frame has no such place"
        )


def _check_joints(guide: Guide, own: list[_Pair], kind: str) -> None:
    """Raise FrameError where the normal jumps from one part of the guide to the next."""
    count = len(own)
    for index in range(count if guide.closed else count - 1):
        following = (index + 1) % count
        end = along.at(own[index][0].coordinates, guide.limits(index)[1])
        start = along.at(own[following][0].coordinates, guide.limits(following)[0])
        if guide.parts[index].mitres[1] is not None:
            end = _across(end, guide, index)
        if not np.linalg.norm(start - end) <= JUMP:
            raise FrameError(
                f"a frame of the kind {kind} does not go on from part {index + 1} of the guide to "
                f"part {following + 1}: its normal jumps there, at u = "
                f"{guide.limits(index)[1]:.6g}; the rotation-minimising frame goes on everywhere"
            )


def _flip(roots: tuple[Expr, ...], low: float, high: float) -> float | None:
    """Return where the normal jumps to its opposite, as Frenet's does at an inflection."""
    for _ in range(5):
        u = np.linspace(low, high, 129)
        found = along.values(roots, u)
        side = np.cross(found[:3], found[3:], axis=0)
        turns = (side[:, 1:] * side[:, :-1]).sum(axis=0)
        i = int(np.argmin(turns))
        if not turns[i] < 0:
            return None
        low, high = float(u[i]), float(u[i + 1])
    return (low + high) / 2


# -- the rotation-minimising frame -----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Leg:
    """A part of the guide with a base frame, and what that has to be turned by."""

    base: _Pair
    angle: along.Antiderivative | None


def _minimising(
    guide: Guide, reference: Value | None, symmetry: int
) -> tuple[list[_Pair], str, float]:
    start = _start(guide, reference)
    legs: list[tuple[_Leg, float]] = []
    normal = start
    for index, part in enumerate(guide.parts):
        low, high = guide.limits(index)
        leg = _leg(guide, index, normal)
        first = _angle(leg.base, normal, low)
        legs.append((leg, first))
        last = first + (leg.angle.total if leg.angle else 0.0)
        normal = _direction(leg.base, last, high)
        if part.mitres[1] is not None:
            normal = _across(normal, guide, index)
    if not guide.closed:
        return [_pair(guide, leg, first, None) for leg, first in legs], _words(legs), 0.0
    return _closed(guide, legs, start, normal, symmetry)


def _closed(
    guide: Guide, legs: list[tuple[_Leg, float]], start: Array, end: Array, symmetry: int
) -> tuple[list[_Pair], str, float]:
    """Spread what the end is ahead of the beginning over the length."""
    (tangent,) = (along.at(guide.parts[0].tangent.coordinates, guide.limits(0)[0]),)
    ahead = atan2(float(np.cross(start, end) @ tangent), float(start @ end))
    steps = round(ahead * symmetry / (2 * pi))
    left = ahead - steps * 2 * pi / symmetry
    words = _words(legs)
    shift = (steps % symmetry) / symmetry
    if abs(left) > FLAT:
        lengths = [_run(guide, i).total for i in range(len(guide.parts))]
        rate = -left / sum(lengths)
        words += f"; closed by {-left:.4g} rad, spread evenly over the length"
        pairs, before = [], 0.0
        for index, (leg, first) in enumerate(legs):
            pairs.append(_pair(guide, leg, first + rate * before, (index, rate)))
            before += lengths[index]
    else:
        pairs = [_pair(guide, leg, first, None) for leg, first in legs]
    if shift:
        words += f"; its end is {shift:.4g} of a turn ahead"
    return pairs, words, shift


def _pair(guide: Guide, leg: _Leg, first: float, extra: tuple[int, float] | None) -> _Pair:
    """Return the base turned by its angle from `first` on, and by a rate per length in addition."""
    if extra is None:
        angle = along.tidy(first) if leg.angle is None else leg.angle.tree(first)
        return _turned(leg.base, angle)
    index, rate = extra
    part = guide.parts[index]
    speed = along.function(length(part.speed))
    base = _turning(leg)

    def total(u: Array) -> Array:
        return np.asarray(base(u) + rate * speed(u))

    whole = along.antiderivative(total, along.knots(part.speed.coordinates, *guide.limits(index)))
    return _turned(leg.base, whole.tree(first))


def _run(guide: Guide, index: int) -> along.Antiderivative:
    speed = guide.parts[index].speed
    limits = along.knots(speed.coordinates, *guide.limits(index))
    return along.antiderivative(along.function(length(speed)), limits)


def _words(legs: list[tuple[_Leg, float]]) -> str:
    found = [leg.angle for leg, _ in legs if leg.angle is not None and len(leg.angle.rows) > 1]
    if not found:
        return "rotation-minimising"
    count = sum(len(a.rows) for a in found)
    worst = sum(a.deviation * len(a.rows) for a in found)
    return (
        f"rotation-minimising (its angle by a spline of {count} pieces, within {worst:.1g} rad of "
        "the quadrature, sampled)"
    )


def _start(guide: Guide, reference: Value | None) -> Array:
    """Return the normal at the beginning, (3,)."""
    part, low = guide.parts[0], guide.limits(0)[0]
    tangent = along.at(part.tangent.coordinates, low)
    if reference is None:
        wanted = [np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])]
        towards = wanted[0] if abs(tangent[2]) < 0.9 else wanted[1]
    else:
        assert isinstance(reference, Combination)
        away = reference - part.point if kind_of(reference) is Kind.POINT else reference
        towards = along.at(away.coordinates, low)
    foot = towards - tangent * (towards @ tangent)
    if not np.linalg.norm(foot) >= LEAST_SINE * np.linalg.norm(towards):
        raise ReferenceAlongTangentError(
            f"the reference of the normal lies along the tangent at the beginning, u = {low:g}"
        )
    return np.asarray(foot / np.linalg.norm(foot))


def _leg(guide: Guide, index: int, normal: Array) -> _Leg:
    """Return a base frame of a part: constant on a line, plain in a plane, else by a direction."""
    part = guide.parts[index]
    low, high = guide.limits(index)
    u = low + (high - low) * (np.arange(SAMPLES) + 0.5) / SAMPLES
    tangents = along.values(part.tangent.coordinates, u)
    if not np.isfinite(tangents).all():
        raise FrameError("the guide has no tangent somewhere in its interval")
    _, spread, axes = np.linalg.svd(tangents.T, full_matrices=False)
    spread = spread / np.sqrt(SAMPLES)
    if spread[1] < FLAT:
        e1 = normal - tangents[:, 0] * (normal @ tangents[:, 0])
        e1 = _snapped(e1 / np.linalg.norm(e1))
        e2 = _snapped(np.cross(tangents[:, 0], e1))
        return _Leg((vector(*e1.tolist()), vector(*e2.tolist())), None)
    if spread[2] < FLAT:
        axis = vector(*_snapped(axes[2]).tolist())
        return _Leg((axis, cross(part.tangent, axis)), None)
    direction = _clear_direction(tangents)
    towards = vector(*direction.tolist())
    turning = _turning_about(part, direction)
    limits = along.knots(part.speed.coordinates, low, high)
    return _Leg(_from_reference(part, towards), along.antiderivative(turning, limits))


def _turning(leg: _Leg) -> along.Function:
    """Return the rate at which the base has to be turned."""
    if leg.angle is None:
        return lambda u: np.zeros_like(u)
    angle = leg.angle

    def rate(u: Array) -> Array:
        breaks = np.array(angle.breaks)
        i = np.clip(np.searchsorted(breaks, u, side="right") - 1, 0, len(breaks) - 2)
        local, result = u - breaks[i], np.zeros_like(u)
        for k in range(angle.rows.shape[1] - 1, 0, -1):
            result = result * local + k * angle.rows[i, k]
        return np.asarray(result)

    return rate


def _turning_about(part: Part, d: Array) -> along.Function:
    """Return θ' = (d·N')(N''·(N'×d)) / (|N'||N'×d|²), which undoes the turning of the base."""
    roots = (*part.speed.coordinates, *derivative_of(part.speed).coordinates)

    def rate(u: Array) -> Array:
        found = along.values(roots, u)
        first, second = found[:3].T, found[3:].T
        side = np.cross(first, d)
        square = np.einsum("ij,ij->i", side, side)
        speed = np.linalg.norm(first, axis=1)
        return np.asarray((first @ d) * np.einsum("ij,ij->i", second, side) / (speed * square))

    return rate


def derivative_of(value: Combination) -> Combination:
    """Return the derivative in u."""
    found = derivative(value, "u")
    assert isinstance(found, Combination)
    return found


def _clear_direction(tangents: Array) -> Array:
    """Return the direction that keeps farthest from all tangents (3, n): axes, then a spiral."""
    k = np.arange(600) + 0.5
    z, turn = 1 - k / 600, np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - z**2)
    spiral = np.stack((ring * np.cos(turn), ring * np.sin(turn), z), axis=1)
    found = []
    for candidates in (np.eye(3)[::-1], spiral):
        sines = np.sqrt(np.maximum(0, 1 - (candidates @ tangents) ** 2)).min(axis=1)
        best = int(np.argmax(sines))
        found.append((float(sines[best]), candidates[best]))
    # an axis keeps the numbers of the equation short
    (axis, plain), (other, far) = found
    return np.asarray(plain if axis > 0.5 * other else np.round(far, 3))


def _snapped(v: Array) -> Array:
    """Return a unit vector with components that are 0 or ±1 but for rounding made so."""
    near = np.round(v)
    return np.asarray(np.where(np.abs(v - near) < 1e-15, near, v)) + 0.0


def _angle(base: _Pair, normal: Array, place: float) -> float:
    e1, e2 = (along.at(e.coordinates, place) for e in base)
    return atan2(float(normal @ e2), float(normal @ e1))


def _direction(base: _Pair, angle: float, place: float) -> Array:
    e1, e2 = (along.at(e.coordinates, place) for e in base)
    return np.asarray(e1 * cos(angle) + e2 * sin(angle))


# -- mitres ----------------------------------------------------------------------------------------


def _across(normal: Array, guide: Guide, index: int) -> Array:
    """Return the normal behind the mitre at the end of a part: mirrored and turned about."""
    plane = guide.parts[index].mitres[1]
    assert plane is not None
    following = guide.parts[(index + 1) % len(guide.parts)]
    before = along.at(guide.parts[index].tangent.coordinates, guide.limits(index)[1])
    after = along.at(following.tangent.coordinates, guide.limits((index + 1) % len(guide.parts))[0])
    axis = np.cross(before, after)
    sine = float(np.linalg.norm(axis))
    axis = axis / sine
    cosine = float(before @ after)
    turned = normal * cosine + np.cross(axis, normal) * sine + axis * (axis @ normal) * (1 - cosine)
    return np.asarray(turned / hypot(*turned))


def _mitred(guide: Guide, index: int, pair: _Pair) -> _Pair:
    """Return normal and binormal drawn along the tangent into the planes that cut the part."""
    part = guide.parts[index]
    low, high = guide.breaks[index], guide.breaks[index + 1]
    share = (along.U - number(low)) / number(high - low)
    ends = zip(part.mitres, guide.limits(index), (1 - share, share), strict=True)
    normal, binormal = pair
    for plane, place, weight in ends:
        if plane is None:
            continue
        # of the end alone: farther along a bent part the tangent may lie in the plane
        e1, e2, tangent = (
            float(along.at(e.coordinates, place) @ plane) for e in (*pair, part.tangent)
        )
        normal = normal - part.tangent * (weight * number(e1 / tangent))
        binormal = binormal - part.tangent * (weight * number(e2 / tangent))
    return normal, binormal
