"""Curved faces: the parameter rectangle inside their edges, and integrals over it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product as pairs
from math import isqrt
from typing import TypeAlias

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import ranked
from pc2cad.arrays.linear import product
from pc2cad.verify.curves import gauss_rule
from pc2cad.verify.defects import StepDefectError, StepUnknownError
from pc2cad.verify.edges import Edge
from pc2cad.verify.inversion import divided
from pc2cad.verify.searching import Jet, Span
from pc2cad.verify.splines import SplineSurface
from pc2cad.verify.surfaces import Surface

#: of the length of a parameter: levels that differ by less are one
_LOOSE = 1e-7
#: places that are taken at a time: few enough for a processor's own memory
_CHUNK = 12_000
_MOST_POINTS, _MOST_EXACT = 3_000_000, 100_000
#: relative difference of two rules; of polynomials it is that of the area alone
_SETTLED, _ENOUGH = 1e-13, 1e-11
#: spans are halved where rules of more points differ by more than this share
_ROUGH = 1e-7

Rectangle: TypeAlias = tuple[Span, Span]


class AskewError(StepUnknownError):
    """An edge runs along neither parameter of its face's surface."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Integrals over a face with its normal n: `first` is n_i x_j about the face's own corner."""

    area: float
    vector: Array
    first: Array
    volume: float
    moment: Array
    #: relative difference of the last two rules (area), and whether the volume needs none
    error: float

    def times(self, sign: float) -> Moments:
        """Return them for the other sense of the normal, if the sign is negative."""
        return Moments(
            self.area, sign * self.vector, sign * self.first, sign * self.volume,
            sign * self.moment, self.error,
        )  # fmt: skip

    def plus(self, other: Moments) -> Moments:
        """Return the integrals over both of two faces with the same corner."""
        return Moments(
            self.area + other.area, self.vector + other.vector, self.first + other.first,
            self.volume + other.volume, self.moment + other.moment, max(self.error, other.error),
        )  # fmt: skip


@dataclass(frozen=True)
class Trace:
    """An edge in the parameter plane: it runs along one axis at a level of the other."""

    axis: int
    level: float
    start: float
    length: float
    rising: bool


def trace_edge(surface: Surface, edge: Edge, limit: float, face: object) -> tuple[Trace, float]:
    """Return the edge in the parameter plane, and its largest distance from the surface."""
    parameters = [np.asarray(part) for part in surface.locate(edge.samples)]
    distance = float(np.linalg.norm(surface.at(*parameters)[0] - edge.samples, axis=1).max())
    if not distance <= limit:
        raise StepDefectError(
            f"the edge {edge.ref} leaves the surface of the face {face} by {distance:.2g}"
        )
    inner = slice(1, -1)
    widths = []
    for axis in (0, 1):
        period = surface.periods[axis]
        if period is not None:
            t = parameters[axis]
            t[inner] = np.unwrap(t[inner], period=period)
            for end, next_to in ((0, 1), (-1, -2)):
                t[end] += period * np.round((t[next_to] - t[end]) / period)
        widths.append(float(np.ptp(parameters[axis][inner])))
    for axis in np.argsort(widths)[::-1].tolist():
        other, t = 1 - axis, parameters[axis]
        steps = np.diff(t)
        scale = surface.periods[other] or max(1.0, float(np.abs(parameters[other][inner]).max()))
        if widths[other] <= _LOOSE * scale and (np.all(steps > 0.0) or np.all(steps < 0.0)):
            level = ranked(parameters[other][inner], 0.5)
            rising = bool(steps[0] > 0.0)
            return Trace(axis, level, float(t.min()), float(np.ptp(t)), rising), distance
    raise AskewError(f"the edge {edge.ref} trims the face {face} askew")


def winding(steps: list[tuple[Trace, bool]]) -> float:
    """Return the area a loop runs around in the parameters; 0 if a collapsed side opens it."""
    moves = np.zeros((len(steps), 2))
    for move, (trace, forward) in zip(moves, steps, strict=True):
        move[trace.axis] = trace.length if trace.rising == forward else -trace.length
    corners = np.cumsum(moves, axis=0)
    size = np.abs(moves).max(axis=0, initial=0.0)
    if np.any(np.abs(corners[-1:]) > _LOOSE * size):
        return 0.0
    following = np.roll(corners, -1, axis=0)
    cross = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
    return 0.5 * float(cross.sum())


def rectangles(surface: Surface, traces: list[Trace]) -> Iterator[Rectangle]:
    """Yield the parameter rectangles (from, to per axis) whose sides these edges can be."""
    choices = [list(_spans(surface, traces, axis)) for axis in (0, 1)]
    for u, v in pairs(*choices):
        if _bounds(surface, traces, (u, v)):
            yield u, v


def _modulo(value: float, period: float | None) -> float:
    if period is None:
        return value
    return value - period * float(np.round(value / period))


def _levels(surface: Surface, traces: list[Trace], axis: int) -> list[float]:
    """Return the distinct levels, along an axis, of the edges that run across it."""
    found: list[float] = []
    for trace in traces:
        scale = surface.periods[axis] or max(1.0, abs(trace.level))
        if trace.axis != axis and not any(
            abs(_modulo(trace.level - level, surface.periods[axis])) <= _LOOSE * scale
            for level in found
        ):
            found.append(trace.level)
    return sorted(found)


def _chain(pieces: list[Trace], period: float | None) -> Span:
    """Return where a row of edges on one level starts, and how long it is altogether."""
    length = sum(piece.length for piece in pieces)
    if period is not None and length >= period * (1.0 - _LOOSE):
        return pieces[0].start, period
    tight = _LOOSE * max(length, 1e-300)
    for piece in pieces:
        ends = (other.start + other.length for other in pieces if other is not piece)
        if all(abs(_modulo(piece.start - end, period)) > tight for end in ends):
            return piece.start, length
    return pieces[0].start, length


def _spans(surface: Surface, traces: list[Trace], axis: int) -> Iterator[Span]:
    """Yield candidates for the range of one parameter."""
    period, limits = surface.periods[axis], surface.limits[axis]
    along = [trace for trace in traces if trace.axis == axis]
    if along:
        row = [t for t in along if _same(surface, t, along[0])]
        start, length = _chain(row, period)
        yield start, start + length
        return
    levels = _levels(surface, traces, axis)
    if period is not None:
        yield from zip(levels, [*levels[1:], levels[0] + period] if levels else [], strict=True)
        if not levels:
            start = limits[0] if np.isfinite(limits[0]) else 0.0
            yield start, start + period
        return
    known = [limit for limit in limits if np.isfinite(limit)]
    ends = sorted([*levels, *known])
    if len(ends) <= 12:
        yield from ((a, b) for a, b in pairs(ends, ends) if b > a + _LOOSE * max(1.0, abs(a)))


def _same(surface: Surface, one: Trace, other: Trace) -> bool:
    across = 1 - other.axis
    scale = surface.periods[across] or max(1.0, abs(other.level))
    return abs(_modulo(one.level - other.level, surface.periods[across])) <= _LOOSE * scale


def _bounds(surface: Surface, traces: list[Trace], rectangle: Rectangle) -> bool:
    """Say whether each edge is on a side, and each side is covered, collapsed or a free seam."""
    for axis in (0, 1):
        low, high = rectangle[axis]
        period = surface.periods[axis]
        length = rectangle[1 - axis][1] - rectangle[1 - axis][0]
        across = [trace for trace in traces if trace.axis != axis]
        scale = _LOOSE * (period or max(1.0, abs(low), abs(high)))
        sides = [
            [t for t in across if abs(_modulo(t.level - level, period)) <= scale]
            for level in (low, high)
        ]
        if any(all(trace not in side for side in sides) for trace in across):
            return False
        full = period is not None and high - low >= period * (1.0 - _LOOSE)
        for level, side in zip((low, high), sides, strict=True):
            covered = abs(sum(t.length for t in side) - length) <= _LOOSE * length
            free = not side and (full or _collapsed(surface, rectangle, axis, level))
            if not covered and not free:
                return False
    return True


def on_border(surface: Surface, rectangle: Rectangle | None, trace: Trace) -> Trace:
    """Return an edge's trace at the level of the rectangle's side that it is."""
    assert rectangle is not None
    axis = 1 - trace.axis
    steps = [_modulo(level - trace.level, surface.periods[axis]) for level in rectangle[axis]]
    return replace(trace, level=trace.level + min(steps, key=abs))


def _collapsed(surface: Surface, rectangle: Rectangle, axis: int, level: float) -> bool:
    t = np.linspace(*rectangle[1 - axis], 7)
    middle = 0.5 * (rectangle[axis][0] + rectangle[axis][1])
    sizes = []
    for place in (level, middle):
        fixed = np.full_like(t, place)
        points = surface.at(*((fixed, t) if axis == 0 else (t, fixed)))[0]
        sizes.append(np.ptp(points, axis=0).max())
    return bool(sizes[0] <= 1e-9 * sizes[1])


def closed_moments(surface: Surface, origin: Array, corner: Array) -> Moments | None:
    """Return the integrals over all of a surface; None where it has a border, or no end."""
    rectangle = []
    for period, (low, high) in zip(surface.periods, surface.limits, strict=True):
        low = low if np.isfinite(low) or period is None else 0.0
        rectangle.append((low, high if period is None else low + period))
    whole = rectangle[0], rectangle[1]
    for axis, period in enumerate(surface.periods):
        ends = whole[axis]
        if not np.isfinite(ends).all():
            return None
        if period is None and not all(_collapsed(surface, whole, axis, end) for end in ends):
            return None
    return patch_moments(surface, whole, origin, corner)


def patch_moments(surface: Surface, rectangle: Rectangle, origin: Array, corner: Array) -> Moments:
    """Return integrals over the rectangle by Gauss quadrature, refined until they settle.

    Of polynomials the volume is exact at once; the area, which has a root, is estimated by a rule
    of fewer points.
    """
    breaks = [surface.breaks(axis, *rectangle[axis]) for axis in (0, 1)]
    polynomial = isinstance(surface, SplineSurface) and not surface.rational
    fewer = polynomial and min(surface.points) > 4
    most = _MOST_EXACT if polynomial else _MOST_POINTS
    first = [3 * n // 4 - 1 if fewer else n for n in surface.points]
    previous = _integrate(surface, breaks, first, origin, corner)
    for extra in range(0 if fewer else 6, 60, 6):
        counts = [points + extra for points in surface.points]
        if extra and _places(breaks, counts) > most:
            break
        moments = _integrate(surface, breaks, counts, origin, corner)
        moments = replace(moments, error=_difference(previous, moments))
        if moments.error <= (_ENOUGH if polynomial else _SETTLED):
            return moments
        previous = moments
    counts = [points + 6 for points in surface.points]
    while previous.error > _ROUGH:  # steep places between, which shorter spans resolve
        breaks = [divided(b, 2) for b in breaks]
        if _places(breaks, counts) > most:
            break
        moments = _integrate(surface, breaks, counts, origin, corner)
        previous = replace(moments, error=_difference(previous, moments))
    return previous


def _places(breaks: list[Array], counts: list[int]) -> int:
    return int(np.prod([(len(b) - 1) * n for b, n in zip(breaks, counts, strict=True)]))


def _difference(one: Moments, other: Moments) -> float:
    size = other.area**0.5
    return float(max(
        abs(one.area - other.area) / other.area,
        np.abs(one.vector - other.vector).max() / other.area,
        np.abs(one.first - other.first).max() / (other.area * size),
    ))  # fmt: skip


def _integrate(
    surface: Surface, breaks: list[Array], counts: list[int], origin: Array, corner: Array
) -> Moments:
    (u, u_weights), (v, v_weights) = (gauss_rule(b, n) for b, n in zip(breaks, counts, strict=True))
    total = np.zeros(17)
    # as wide as long, so that few poles count for each
    wide = min(len(v), isqrt(_CHUNK))
    rows = _CHUNK // wide
    starts = pairs(range(0, len(u), rows), range(0, len(v), wide))
    for part, own in ((slice(a, a + rows), slice(b, b + wide)) for a, b in starts):
        weight = u_weights[part, None] * v_weights[None, own]
        total += sums(surface.grid(u[part], v[own]), weight, origin, corner)
    return moments_of(total, np.inf)


def sums(jet: Jet, weight: Array, origin: Array, corner: Array) -> Array:
    """Return all integrals of `Moments` in one row, of points and derivatives (..., 3)."""
    place, (a, b, c), (x, y, z) = (np.moveaxis(part, -1, 0) for part in jet)
    normal = np.stack((b * z - c * y, c * x - a * z, a * y - b * x))
    area = float((np.sqrt((normal**2).sum(axis=0)) * weight).sum())
    normal = (normal * weight).reshape(3, -1)
    local = (place - corner.reshape(-1, *[1] * weight.ndim)).reshape(3, -1)
    vector, first, offset = normal.sum(axis=1), product(normal, local.T), corner - origin
    # sums in pairs round less than products of matrices
    flow = normal * local
    along, squares = flow.sum(axis=1), (flow * local).sum(axis=1)
    volume = float(along.sum() + offset @ vector) / 3.0
    moment = 0.5 * (squares + 2.0 * offset * along + offset**2 * vector)
    return np.concatenate(([area], vector, first.ravel(), [volume], moment))


def moments_of(total: Array, error: float) -> Moments:
    """Return the row of `sums` as moments."""
    return Moments(
        float(total[0]), total[1:4], total[4:13].reshape(3, 3), float(total[13]), total[14:], error
    )
