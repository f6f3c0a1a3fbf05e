"""Surfaces of a STEP file but planes: values, first derivatives and places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Protocol, TypeAlias

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product
from pc2cad.verify.curves import (
    TURN,
    Curve,
    check_knots,
    domain_of,
    homogeneous,
    plain_knots,
    read_curve,
    spline_kind,
)
from pc2cad.verify.defects import StepDefectError, StepUnknownError
from pc2cad.verify.inversion import Sampling, closest
from pc2cad.verify.records import DEEPEST, Record, Records, length, number, numbers, sequence, whole
from pc2cad.verify.searching import Jet, Span
from pc2cad.verify.splines import SplineSurface, make_surface

_INFINITE = (-np.inf, np.inf)


class Surface(Protocol):
    """A parametric surface; a direction with a period is closed after it."""

    @property
    def periods(self) -> tuple[float | None, float | None]:
        """The lengths of the ranges of closed directions."""
        ...

    @property
    def limits(self) -> tuple[Span, Span]:
        """The ends of both parameters."""
        ...

    @property
    def points(self) -> tuple[int, int]:
        """Gauss points per break."""
        ...

    def grid(self, u: Array, v: Array) -> Jet:
        """Return point, u and v derivative on the tensor grid, shape (len(u), len(v), 3)."""
        ...

    def at(self, u: Array, v: Array) -> Jet:
        """Return point, u and v derivative at pairs of parameters, shape (len(u), 3)."""
        ...

    def locate(self, points: Array) -> tuple[Array, Array]:
        """Return parameters of the nearest points, for points of one edge in order."""
        ...

    def breaks(self, axis: int, a: float, b: float) -> Array:
        """Return parameters from a to b between which the surface is smooth and short."""
        ...


def _turn_breaks(a: float, b: float) -> Array:
    return np.linspace(a, b, 1 + max(1, int(np.ceil((b - a) / (TURN / 8.0)))))


_Profile: TypeAlias = Callable[[Array], tuple[Array, ...]]


@dataclass(frozen=True, eq=False)
class Round:
    """Cylinder, cone, sphere or torus: radius and height over v, turned by u."""

    origin: Array
    axes: Array
    profile: _Profile
    inverse: Callable[[Array, Array], Array]
    periods: tuple[float | None, float | None]
    limits: tuple[Span, Span]
    #: the entity, and its radii or its radius and angle (in radians)
    kind: str
    lengths: tuple[float, ...]
    points: tuple[int, int] = (14, 14)

    def at(self, u: Array, v: Array) -> Jet:
        """Return points and first derivatives."""
        radius, height, radius_v, height_v = (part[..., None] for part in self.profile(v))
        x, y, z = self.axes
        cos, sin = np.cos(u)[..., None], np.sin(u)[..., None]
        out = cos * x + sin * y
        return (
            self.origin + radius * out + height * z,
            radius * (cos * y - sin * x) + 0.0 * height * z,
            radius_v * out + height_v * z,
        )

    def grid(self, u: Array, v: Array) -> Jet:
        """Return points and derivatives on the tensor grid."""
        return self.at(u[:, None], v[None, :])

    def locate(self, points: Array) -> tuple[Array, Array]:
        """Return the parameters of the nearest points."""
        x, y, z = product(points - self.origin, self.axes.T).T
        return np.arctan2(y, x), self.inverse(np.hypot(x, y), z)

    def breaks(self, axis: int, a: float, b: float) -> Array:
        """Return where it is smooth and short between."""
        straight = axis == 1 and self.limits[1][1] == np.inf
        return np.array([a, b]) if straight else _turn_breaks(a, b)


@dataclass(frozen=True, eq=False)
class Spun:
    """Surface of revolution: the curve over v, turned by u about an axis."""

    curve: Curve
    centre: Array
    axis: Array
    periods: tuple[float | None, float | None]
    limits: tuple[Span, Span]
    points: tuple[int, int]

    def _turned(self, u: Array, vector: Array) -> tuple[Array, Array]:
        cos, sin = np.cos(u)[..., None], np.sin(u)[..., None]
        along = (vector @ self.axis)[..., None] * self.axis
        out, side = vector - along, np.cross(self.axis, vector)
        return along + cos * out + sin * side, cos * side - sin * out

    def turn(self, u: float) -> Array:
        """Return the matrix of the turn by an angle."""
        return self._turned(np.full(3, u), np.eye(3))[0].T

    def at(self, u: Array, v: Array) -> Jet:
        """Return points and first derivatives."""
        point, slope = self.curve.at(v)
        place, swept = self._turned(u, point - self.centre)
        return self.centre + place, swept, self._turned(u, slope)[0]

    def grid(self, u: Array, v: Array) -> Jet:
        """Return points and derivatives on the tensor grid."""
        point, slope = self.curve.at(v)
        place, swept = self._turned(u[:, None], (point - self.centre)[None])
        return self.centre + place, swept, self._turned(u[:, None], slope[None])[0]

    def _meridian(self, points: Array) -> tuple[Array, Array]:
        height = product(points - self.centre, self.axis)
        out = points - self.centre - height[:, None] * self.axis
        return np.stack([np.linalg.norm(out, axis=1), height], axis=1), out

    def locate(self, points: Array) -> tuple[Array, Array]:
        """Return the parameters of the nearest points."""

        def profile(v: Array) -> tuple[Array, Array]:
            point, slope = self.curve.at(v)
            flat, out = self._meridian(point)
            radial = (out * slope).sum(axis=1) / np.maximum(flat[:, 0], 1e-300)
            return flat, np.stack([radial, slope @ self.axis], axis=1)

        flat, out = self._meridian(points)
        v = closest(profile, self._sampling(points), flat)
        start = self._meridian(self.curve.at(v)[0])[1]
        sine = (np.cross(start, out) * self.axis).sum(axis=1)
        return np.arctan2(sine, (start * out).sum(axis=1)), v

    def _sampling(self, points: Array) -> Sampling:
        samples, low, high = self.curve.sampling(points)
        if self.periods[1] is not None:
            return samples, low, high
        a, b = self.limits[1]
        if self.curve.period is None:
            a, b = max(a, low), min(b, high)
        else:  # a part of a closed curve: it may go over where the curve's parameter begins
            samples = np.append(samples, samples + self.curve.period)
        inside = samples[(samples >= a) & (samples <= b)]
        return distinct(np.append(inside, (a, b))), a, b

    def parts(self) -> list[Spun]:
        """Return what the axis cuts it into: itself where its curve stays on one side."""
        cuts, period = self._crossings(), self.curve.period
        if not len(cuts):
            return [self]
        low, high = self.limits[1]
        ends = [low, *cuts, high] if period is None else [*cuts, cuts[0] + period]
        return [
            replace(self, periods=(TURN, None), limits=(_INFINITE, (float(a), float(b))))
            for a, b in pairwise(ends)
        ]

    def _crossings(self) -> Array:
        """Return the parameters at which the curve passes to the other side of the axis."""
        t = self.curve.sampling(self.centre[None])[0]
        out = self._meridian(self.curve.at(t)[0])[1]
        far = out[np.linalg.norm(out, axis=1).argmax()]
        side = out @ far
        if side.min() >= -1e-9 * (far @ far):
            return np.empty(0)
        t = t[side != 0.0]
        beyond = np.sign(side[side != 0.0])
        at = np.flatnonzero(np.diff(beyond))
        low, high, before = t[at], t[at + 1], beyond[at]
        for _ in range(60):
            middle = 0.5 * (low + high)
            same = np.sign(self._meridian(self.curve.at(middle)[0])[1] @ far) == before
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return np.asarray(0.5 * (low + high))

    def breaks(self, axis: int, a: float, b: float) -> Array:
        """Return where it is smooth and short between."""
        return _turn_breaks(a, b) if axis == 0 else self.curve.breaks(a, b)


@dataclass(frozen=True, eq=False)
class Pushed:
    """Surface of linear extrusion: the curve over u, pushed along a vector by v."""

    curve: Curve
    vector: Array
    periods: tuple[float | None, float | None]
    limits: tuple[Span, Span]
    points: tuple[int, int]

    def at(self, u: Array, v: Array) -> Jet:
        """Return points and first derivatives."""
        point, slope = self.curve.at(u)
        return point + v[:, None] * self.vector, slope, np.broadcast_to(self.vector, slope.shape)

    def grid(self, u: Array, v: Array) -> Jet:
        """Return points and derivatives on the tensor grid."""
        point, slope = (part[:, None] for part in self.curve.at(u))
        place = point + v[None, :, None] * self.vector
        return place, np.broadcast_to(slope, place.shape), np.broadcast_to(self.vector, place.shape)

    def locate(self, points: Array) -> tuple[Array, Array]:
        """Return the parameters of the nearest points."""
        size = float(self.vector @ self.vector)

        def flat(vectors: Array) -> Array:
            return np.asarray(vectors - ((vectors @ self.vector) / size)[:, None] * self.vector)

        def profile(u: Array) -> tuple[Array, Array]:
            point, slope = self.curve.at(u)
            return flat(point), flat(slope)

        u = closest(profile, self.curve.sampling(points), flat(points))
        return u, product(points - self.curve.at(u)[0], self.vector) / size

    def breaks(self, axis: int, a: float, b: float) -> Array:
        """Return where it is smooth and short between."""
        return self.curve.breaks(a, b) if axis == 0 else np.array([a, b])


def read_surface(records: Records, ref: Any, radian: float, depth: int = 0) -> Surface:
    """Return the surface behind a reference, a PLANE apart; `radian` is the unit of angles."""
    record = records.get(ref)
    kind = spline_kind(record.parts, "SURFACE")
    if kind is not None:
        return _read_spline(records, record, kind)
    if record.keyword == "RECTANGULAR_TRIMMED_SURFACE" and depth < DEEPEST:
        # the edges bound a face; the rectangle bounds what they may be on, which is not used
        return read_surface(records, record.values(2)[1], radian, depth + 1)
    if record.keyword in ("SURFACE_OF_REVOLUTION", "SURFACE_OF_LINEAR_EXTRUSION"):
        return _read_swept(records, record)
    if record.keyword not in _ROUND:
        raise StepUnknownError(f"the surface {ref} is a {record.keyword}, which is not known")
    values = record.values(4 if record.keyword in _TWO else 3)
    origin, axes = records.frame(values[1])
    first = number(values[2])
    rest = [number(value) for value in values[3:4]] if record.keyword in _TWO else []
    if record.keyword == "CONICAL_SURFACE":
        rest[0] *= radian
        if not (first >= 0.0 and 0.0 < abs(rest[0]) < TURN / 4.0):
            raise StepDefectError(f"the cone {ref} has radius {first:.6g}, angle {rest[0]:.6g}")
    else:
        for value in (first, *rest):
            length(value, ref)
    if record.keyword == "TOROIDAL_SURFACE" and first <= rest[0]:
        raise StepUnknownError(f"the torus {ref} meets its own axis: which part is meant is open")
    profile, inverse, period, limits = _ROUND[record.keyword](first, *rest)
    return Round(
        origin, axes, profile, inverse, (TURN, period), (_INFINITE, limits), record.keyword,
        (first, *rest),
    )  # fmt: skip


_Meridian: TypeAlias = tuple[_Profile, Callable[[Array, Array], Array], float | None, Span]


def _cylinder(radius: float) -> _Meridian:
    def profile(v: Array) -> tuple[Array, ...]:
        return np.full_like(v, radius), v, np.zeros_like(v), np.ones_like(v)

    return profile, lambda r, z: z, None, _INFINITE


def _cone(radius: float, angle: float) -> _Meridian:
    slope = float(np.tan(angle))

    def profile(v: Array) -> tuple[Array, ...]:
        return radius + slope * v, v, np.full_like(v, slope), np.ones_like(v)

    apex = -radius / slope
    limits = (apex, np.inf) if slope > 0.0 else (-np.inf, apex)
    return profile, lambda r, z: z, None, limits


def _sphere(radius: float) -> _Meridian:
    def profile(v: Array) -> tuple[Array, ...]:
        cos, sin = radius * np.cos(v), radius * np.sin(v)
        return cos, sin, -sin, cos

    return profile, lambda r, z: np.arctan2(z, r), None, (-TURN / 4.0, TURN / 4.0)


def _torus(major: float, minor: float) -> _Meridian:
    def profile(v: Array) -> tuple[Array, ...]:
        cos, sin = minor * np.cos(v), minor * np.sin(v)
        return major + cos, sin, -sin, cos

    return profile, lambda r, z: np.arctan2(z, r - major), TURN, _INFINITE


_TWO = ("CONICAL_SURFACE", "TOROIDAL_SURFACE")
_ROUND: dict[str, Callable[..., _Meridian]] = {
    "CYLINDRICAL_SURFACE": _cylinder,
    "CONICAL_SURFACE": _cone,
    "SPHERICAL_SURFACE": _sphere,
    "TOROIDAL_SURFACE": _torus,
}


def _read_swept(records: Records, record: Record) -> Surface:
    values = record.values(3)
    curve = read_curve(records, values[1])
    domain = domain_of(curve)
    if record.keyword == "SURFACE_OF_LINEAR_EXTRUSION":
        vector = records.vector(values[2])
        return Pushed(curve, vector, (curve.period, None), (domain, _INFINITE), (curve.points, 4))
    centre, axis = records.axis(values[2])
    periods, limits = (TURN, curve.period), (_INFINITE, domain)
    return Spun(curve, centre, axis, periods, limits, (14, curve.points))


def _read_spline(records: Records, record: Record, kind: str) -> SplineSurface:
    """Return a simple or complex B-spline surface."""
    parts, ref = record.parts, record.ref
    if "B_SPLINE_SURFACE" in parts:
        head, tail = record.part("B_SPLINE_SURFACE", 3), record.part("B_SPLINE_SURFACE_WITH_KNOTS")
    else:
        simple = record.values(8)
        head, tail = simple[1:], simple[8:]
    if len(head) < 3 or (kind == "KNOTS" and len(tail) < 4):
        raise StepDefectError(f"the B-spline {ref} has too few parameters")
    degrees, rows = (whole(head[0]), whole(head[1])), [sequence(row) for row in sequence(head[2])]
    if len({len(row) for row in rows}) != 1 or not rows[0]:
        raise StepDefectError(f"the rows of poles of the B-spline {ref} differ in length")
    poles = records.points([pole for row in rows for pole in row])
    poles = poles.reshape(len(rows), -1, 3)
    knots = []
    for axis, degree in enumerate(degrees):
        count = poles.shape[axis]
        if kind == "KNOTS":
            values, often = numbers(tail[2 + axis], ref), [whole(n) for n in tail[axis]]
        else:
            values, often = plain_knots(kind, count, degree, ref)
        knots.append(check_knots(values, often, count, degree))
    rational = "RATIONAL_B_SPLINE_SURFACE" in parts
    if rational:
        poles = homogeneous(poles, record.part("RATIONAL_B_SPLINE_SURFACE", 1)[0], ref)
    return make_surface((knots[0], knots[1]), degrees, poles, rational)
