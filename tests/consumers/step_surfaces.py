"""Surfaces of a STEP file: values, first derivatives and inversion with numpy only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .step_bsplines import read_b_spline_surface
from .step_curves import TURN, Curve, closest, read_curve
from .step_parse import StepGraph, StepUnsupported, Vector

Range = tuple[float, float]
Jet = tuple[Vector, Vector, Vector]
_INFINITE = (-np.inf, np.inf)


class Surface(Protocol):
    """A parametric surface; a direction with a period is closed after it."""

    periods: tuple[float | None, float | None]
    limits: tuple[Range, Range]
    points: tuple[int, int]
    exact: bool

    def grid(self, u: Vector, v: Vector) -> Jet:
        """Point, u and v derivative on the tensor grid, shape (len(u), len(v), 3)."""
        ...

    def at(self, u: Vector, v: Vector) -> Jet:
        """Point, u and v derivative at pairs of parameters, shape (len(u), 3)."""
        ...

    def locate(self, points: Vector) -> tuple[Vector, Vector]:
        """Parameters of the nearest points, for points of one edge in order."""
        ...

    def breaks(self, axis: int, a: float, b: float) -> Vector:
        """Parameters from a to b between which the surface is smooth and short."""
        ...


def _turn_breaks(a: float, b: float) -> Vector:
    return np.linspace(a, b, 1 + max(1, int(np.ceil((b - a) / (TURN / 8.0)))))


Profile = Callable[[Vector], tuple[Vector, ...]]


@dataclass(frozen=True)
class Revolved:
    """Cylinder, cone, sphere or torus: radius and height over v, turned by u."""

    origin: Vector
    axes: Vector
    profile: Profile
    inverse: Callable[[Vector, Vector], Vector]
    periods: tuple[float | None, float | None]
    limits: tuple[Range, Range]
    points: tuple[int, int] = (14, 14)
    exact: bool = False

    def at(self, u: Vector, v: Vector) -> Jet:
        radius, height, radius_v, height_v = (part[..., None] for part in self.profile(v))
        x, y, z = self.axes
        cos, sin = np.cos(u)[..., None], np.sin(u)[..., None]
        out = cos * x + sin * y
        return (
            self.origin + radius * out + height * z,
            radius * (cos * y - sin * x) + 0.0 * height * z,
            radius_v * out + height_v * z,
        )

    def grid(self, u: Vector, v: Vector) -> Jet:
        return self.at(u[:, None], v[None, :])

    def locate(self, points: Vector) -> tuple[Vector, Vector]:
        x, y, z = ((points - self.origin) @ self.axes.T).T
        return np.arctan2(y, x), self.inverse(np.hypot(x, y), z)

    def breaks(self, axis: int, a: float, b: float) -> Vector:
        straight = axis == 1 and self.limits[1][1] == np.inf
        return np.array([a, b]) if straight else _turn_breaks(a, b)


@dataclass(frozen=True)
class Spun:
    """Surface of revolution: the curve over v, turned by u about an axis."""

    curve: Curve
    centre: Vector
    axis: Vector
    periods: tuple[float | None, float | None]
    limits: tuple[Range, Range]
    points: tuple[int, int]
    exact: bool = False

    def _turned(self, u: Vector, vector: Vector) -> tuple[Vector, Vector]:
        cos, sin = np.cos(u)[..., None], np.sin(u)[..., None]
        along = (vector @ self.axis)[..., None] * self.axis
        out, side = vector - along, np.cross(self.axis, vector)
        return along + cos * out + sin * side, cos * side - sin * out

    def at(self, u: Vector, v: Vector) -> Jet:
        point, slope = self.curve.at(v)
        place, swept = self._turned(u, point - self.centre)
        return self.centre + place, swept, self._turned(u, slope)[0]

    def grid(self, u: Vector, v: Vector) -> Jet:
        point, slope = self.curve.at(v)
        place, swept = self._turned(u[:, None], (point - self.centre)[None])
        return self.centre + place, swept, self._turned(u[:, None], slope[None])[0]

    def _meridian(self, points: Vector) -> tuple[Vector, Vector]:
        height = (points - self.centre) @ self.axis
        out = points - self.centre - height[:, None] * self.axis
        return np.stack([np.linalg.norm(out, axis=1), height], axis=1), out

    def locate(self, points: Vector) -> tuple[Vector, Vector]:
        def profile(v: Vector) -> tuple[Vector, Vector]:
            point, slope = self.curve.at(v)
            flat, out = self._meridian(point)
            radial = (out * slope).sum(axis=1) / np.maximum(flat[:, 0], 1e-300)
            return flat, np.stack([radial, slope @ self.axis], axis=1)

        flat, out = self._meridian(points)
        v = closest(profile, self.curve.sampling(points), flat)
        start = self._meridian(self.curve.at(v)[0])[1]
        sine = (np.cross(start, out) * self.axis).sum(axis=1)
        return np.arctan2(sine, (start * out).sum(axis=1)), v

    def crosses_axis(self) -> bool:
        """Whether the curve passes to the other side of the axis."""
        samples = self.curve.sampling(self.centre[None])[0]
        out = self._meridian(self.curve.at(samples)[0])[1]
        far = out[np.linalg.norm(out, axis=1).argmax()]
        return bool((out @ far).min() < -1e-9 * (far @ far))

    def breaks(self, axis: int, a: float, b: float) -> Vector:
        return _turn_breaks(a, b) if axis == 0 else self.curve.breaks(a, b)


@dataclass(frozen=True)
class Pushed:
    """Surface of linear extrusion: the curve over u, pushed along a vector by v."""

    curve: Curve
    vector: Vector
    periods: tuple[float | None, float | None]
    limits: tuple[Range, Range]
    points: tuple[int, int]
    exact: bool = False

    def at(self, u: Vector, v: Vector) -> Jet:
        point, slope = self.curve.at(u)
        return point + v[:, None] * self.vector, slope, np.broadcast_to(self.vector, slope.shape)

    def grid(self, u: Vector, v: Vector) -> Jet:
        point, slope = (part[:, None] for part in self.curve.at(u))
        place = point + v[None, :, None] * self.vector
        return place, np.broadcast_to(slope, place.shape), np.broadcast_to(self.vector, place.shape)

    def locate(self, points: Vector) -> tuple[Vector, Vector]:
        length = float(self.vector @ self.vector)

        def flat(vectors: Vector) -> Vector:
            return np.asarray(vectors - ((vectors @ self.vector) / length)[:, None] * self.vector)

        def profile(u: Vector) -> tuple[Vector, Vector]:
            point, slope = self.curve.at(u)
            return flat(point), flat(slope)

        u = closest(profile, self.curve.sampling(points), flat(points))
        return u, (points - self.curve.at(u)[0]) @ self.vector / length

    def breaks(self, axis: int, a: float, b: float) -> Vector:
        return self.curve.breaks(a, b) if axis == 0 else np.array([a, b])


def read_surface(graph: StepGraph, ref: Any, radian: float) -> Surface:
    """The surface behind a reference (PLANE is treated apart); radian is the angle unit."""
    record = graph.get(ref)
    if "B_SPLINE_SURFACE_WITH_KNOTS" in record.parts:
        return read_b_spline_surface(graph, record.parts, ref)
    if record.keyword in ("SURFACE_OF_REVOLUTION", "SURFACE_OF_LINEAR_EXTRUSION"):
        return _read_swept(graph, record.keyword, record.values)
    readers = {
        "CYLINDRICAL_SURFACE": _cylinder,
        "CONICAL_SURFACE": _cone,
        "SPHERICAL_SURFACE": _sphere,
        "TOROIDAL_SURFACE": _torus,
    }
    if record.keyword not in readers:
        raise StepUnsupported(f"Surface {ref} is {record.keyword}, which is not supported.")
    origin, axes = graph.frame(record.values[1])
    first, *rest = (float(value) for value in record.values[2:])
    if record.keyword == "CONICAL_SURFACE":
        rest[0] *= radian
    elif record.keyword == "TOROIDAL_SURFACE" and first <= rest[0]:
        raise StepUnsupported(f"Torus {ref} meets its own axis, which is not supported.")
    profile, inverse, period, limits = readers[record.keyword](first, *rest)
    return Revolved(origin, axes, profile, inverse, (TURN, period), (_INFINITE, limits))


_Meridian = tuple[Profile, Callable[[Vector, Vector], Vector], float | None, Range]


def _cylinder(radius: float) -> _Meridian:
    def profile(v: Vector) -> tuple[Vector, ...]:
        return np.full_like(v, radius), v, np.zeros_like(v), np.ones_like(v)

    return profile, lambda r, z: z, None, _INFINITE


def _cone(radius: float, angle: float) -> _Meridian:
    slope = float(np.tan(angle))

    def profile(v: Vector) -> tuple[Vector, ...]:
        return radius + slope * v, v, np.full_like(v, slope), np.ones_like(v)

    return profile, lambda r, z: z, None, (-radius / slope, np.inf)


def _sphere(radius: float) -> _Meridian:
    def profile(v: Vector) -> tuple[Vector, ...]:
        cos, sin = radius * np.cos(v), radius * np.sin(v)
        return cos, sin, -sin, cos

    return profile, lambda r, z: np.arctan2(z, r), None, (-TURN / 4.0, TURN / 4.0)


def _torus(major: float, minor: float) -> _Meridian:
    def profile(v: Vector) -> tuple[Vector, ...]:
        cos, sin = minor * np.cos(v), minor * np.sin(v)
        return major + cos, sin, -sin, cos

    return profile, lambda r, z: np.arctan2(z, r - major), TURN, _INFINITE


def _read_swept(graph: StepGraph, keyword: str, values: tuple[Any, ...]) -> Surface:
    curve = read_curve(graph, values[1])
    domain = getattr(curve, "domain", _INFINITE)
    if keyword == "SURFACE_OF_LINEAR_EXTRUSION":
        vector = graph.vector(values[2])
        return Pushed(curve, vector, (curve.period, None), (domain, _INFINITE), (curve.points, 4))
    centre, axis = graph.axis(values[2])
    periods, limits = (TURN, curve.period), (_INFINITE, domain)
    return Spun(curve, centre, axis, periods, limits, (14, curve.points))
