"""The rotation-minimising frame of a guide.

A base frame (constant on a line, plain in a plane, else from a fixed direction) is turned back by
an angle that is integrated and kept as a spline: that spline defines the frame. On a closed guide
the rest is spread evenly over the length.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, pi, sin
from typing import Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.channels import guide_functions
from pc2cad.channels.guides import Guide, Part
from pc2cad.channels.normals import (
    LEAST_SINE,
    FrameError,
    Pair,
    ReferenceAlongTangentError,
    across,
    from_reference,
    turned,
)
from pc2cad.equation.points import (
    Combination,
    Kind,
    Value,
    cross,
    derivative,
    kind_of,
    length,
    vector,
)

#: what rounding leaves of a sine
FLAT: Final = 1e-13
SAMPLES: Final = 400


@dataclass(frozen=True, eq=False)
class _Leg:
    """A part of the guide with a base frame, and what that has to be turned by."""

    base: Pair
    angle: guide_functions.Antiderivative | None


def minimising(
    guide: Guide, reference: Value | None, symmetry: int
) -> tuple[list[Pair], str, float]:
    """Return the frame of each part, the frame's name, and its shift at the end in turns.

    Raises ReferenceAlongTangentError or FrameError.
    """
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
            normal = across(normal, guide, index)
    if not guide.closed:
        return [_pair(guide, leg, first, None) for leg, first in legs], _words(legs), 0.0
    return _closed(guide, legs, start, normal, symmetry)


def _closed(
    guide: Guide, legs: list[tuple[_Leg, float]], start: Array, end: Array, symmetry: int
) -> tuple[list[Pair], str, float]:
    """Spread what the end is ahead of the beginning over the length."""
    (tangent,) = (guide_functions.at(guide.parts[0].tangent.coordinates, guide.limits(0)[0]),)
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


def _pair(guide: Guide, leg: _Leg, first: float, extra: tuple[int, float] | None) -> Pair:
    """Return the base turned by its angle from `first` on, and by a rate per length in addition."""
    if extra is None:
        angle = guide_functions.tidy(first) if leg.angle is None else leg.angle.tree(first)
        return turned(leg.base, angle)
    index, rate = extra
    part = guide.parts[index]
    speed = guide_functions.function(length(part.speed))
    base = _turning(leg)

    def total(u: Array) -> Array:
        return np.asarray(base(u) + rate * speed(u))

    whole = guide_functions.antiderivative(
        total, guide_functions.knots(part.speed.coordinates, *guide.limits(index))
    )
    return turned(leg.base, whole.tree(first))


def _run(guide: Guide, index: int) -> guide_functions.Antiderivative:
    speed = guide.parts[index].speed
    limits = guide_functions.knots(speed.coordinates, *guide.limits(index))
    return guide_functions.antiderivative(guide_functions.function(length(speed)), limits)


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
    tangent = guide_functions.at(part.tangent.coordinates, low)
    if reference is None:
        wanted = [np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])]
        towards = wanted[0] if abs(tangent[2]) < 0.9 else wanted[1]
    else:
        assert isinstance(reference, Combination)
        away = reference - part.point if kind_of(reference) is Kind.POINT else reference
        towards = guide_functions.at(away.coordinates, low)
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
    tangents = guide_functions.values(part.tangent.coordinates, u)
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
    limits = guide_functions.knots(part.speed.coordinates, low, high)
    return _Leg(from_reference(part, towards), guide_functions.antiderivative(turning, limits))


def _turning(leg: _Leg) -> guide_functions.Function:
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


def _turning_about(part: Part, d: Array) -> guide_functions.Function:
    """Return θ' = (d·N')(N''·(N'×d)) / (|N'||N'×d|²), which undoes the turning of the base."""
    roots = (*part.speed.coordinates, *_derivative(part.speed).coordinates)

    def rate(u: Array) -> Array:
        found = guide_functions.values(roots, u)
        first, second = found[:3].T, found[3:].T
        side = np.cross(first, d)
        square = np.einsum("ij,ij->i", side, side)
        speed = np.linalg.norm(first, axis=1)
        # at a cusp there is no value: the limits of the channel say so
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((first @ d) * np.einsum("ij,ij->i", second, side) / (speed * square))

    return rate


def _derivative(value: Combination) -> Combination:
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


def _angle(base: Pair, normal: Array, place: float) -> float:
    e1, e2 = (guide_functions.at(e.coordinates, place) for e in base)
    return atan2(float(normal @ e2), float(normal @ e1))


def _direction(base: Pair, angle: float, place: float) -> Array:
    e1, e2 = (guide_functions.at(e.coordinates, place) for e in base)
    return np.asarray(e1 * cos(angle) + e2 * sin(angle))
