"""Carriers of faces and edges as plain data.

Surfaces have parameters (a, b) of their own, the same as in the kernel and in STEP: on a surface of
revolution a is the angle about the axis z of its frame, from x towards y, in radians.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Literal

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import thickness

#: exact: same point set, coefficients rounded once; bounded: a proved upper bound of the deviation;
#: sampled: deviation measured, not proved
Evidence = Literal["exact", "bounded", "sampled"]


@dataclass(frozen=True, eq=False)
class Frame:
    """A right-handed orthonormal frame: `axes` are the rows x, y, z."""

    origin: Array
    axes: Array

    def round(self, angle: Array) -> Array:
        """Return the unit vectors at some angles from x towards y: shape angle + (3,)."""
        x, y = np.cos(angle)[..., None] * self.axes[0], np.sin(angle)[..., None] * self.axes[1]
        return np.asarray(x + y)


def frame_on(origin: Array, z: Array, x: Array) -> Frame:
    """Return the frame with this axis and with x as near to `x` as it can be."""
    z = z / np.linalg.norm(z)
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return Frame(origin, np.array([x, np.cross(z, x), z]) + 0.0)


# -- curves ----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Line:
    """A straight segment; its parameter is the distance from `start`."""

    start: Array
    end: Array


@dataclass(frozen=True, eq=False)
class Arc:
    """An arc of a circle or an ellipse from the angle `start` up to `end` (radians).

    The point at an angle a is origin + radii[0] cos a x + radii[1] sin a y, radii[0] ≥ radii[1].
    """

    frame: Frame
    radii: tuple[float, float]
    start: float
    end: float

    def points(self, angle: Array) -> Array:
        """Return the points at some angles: shape angle + (3,)."""
        x, y = self.frame.axes[0] * self.radii[0], self.frame.axes[1] * self.radii[1]
        return np.asarray(
            self.frame.origin + np.cos(angle)[..., None] * x + np.sin(angle)[..., None] * y
        )


@dataclass(frozen=True, eq=False)
class SplineCurve:
    """A clamped B-spline curve on [0, 1]: poles (n, 3), flat knots (n + degree + 1).

    It is rational where there are weights (n,), all positive.
    """

    degree: int
    knots: Array
    poles: Array
    weights: Array | None = None


CurveCarrier = Line | Arc | SplineCurve


# -- surfaces --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane through `origin`; `normal` has length 1."""

    origin: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A cylinder of revolution; b is the height along z."""

    frame: Frame
    radius: float


@dataclass(frozen=True, eq=False)
class Cone:
    """A cone of revolution that widens along z; b is the distance along its straight lines.

    `radius` belongs to b = 0, `angle` is half the opening, between 0 and π/2.
    """

    frame: Frame
    radius: float
    angle: float


@dataclass(frozen=True, eq=False)
class Sphere:
    """A sphere; b is the latitude, -π/2 to π/2."""

    frame: Frame
    radius: float


@dataclass(frozen=True, eq=False)
class Torus:
    """A torus of revolution; b is the angle in the meridian, from outside towards z."""

    frame: Frame
    major: float
    minor: float


@dataclass(frozen=True, eq=False)
class Extrusion:
    """A curve (parameter a) moved along a unit vector (b: the distance)."""

    basis: CurveCarrier
    direction: Array


@dataclass(frozen=True, eq=False)
class Revolution:
    """A meridian (parameter b) in the half plane of x and z, turned about z."""

    basis: CurveCarrier
    frame: Frame


@dataclass(frozen=True, eq=False)
class SplineSurface:
    """A clamped tensor-product B-spline on [0, 1]²: poles (n, m, 3), first index along s.

    It is rational where there are weights (n, m), all positive.
    """

    degrees: tuple[int, int]
    knots: tuple[Array, Array]
    poles: Array
    weights: Array | None = None


#: carriers with parameters of their own, on which a face is bounded by its pcurves
AnalyticSurface = Cylinder | Cone | Sphere | Torus | Extrusion | Revolution
SurfaceCarrier = Plane | AnalyticSurface | SplineSurface


# -- curves in a surface's parameters --------------------------------------------------------------


@dataclass(frozen=True)
class Segment:
    """A straight piece of a parameter plane, at constant speed along its edge."""

    start: tuple[float, float]
    end: tuple[float, float]

    def reversed(self) -> Segment:
        """Return the segment run the other way."""
        return Segment(self.end, self.start)


@dataclass(frozen=True, eq=False)
class SplinePath:
    """A clamped B-spline in a parameter plane over its edge's own range: poles (n, 2).

    The knots run from 0 at the start of the range to 1 at its end.
    """

    degree: int
    knots: Array
    poles: Array


PCurve = Segment | SplinePath


def ends_of(curve: PCurve) -> Array:
    """Return the first and the last place of a curve: shape (2, 2)."""
    return np.array(
        [curve.start, curve.end] if isinstance(curve, Segment) else curve.poles[[0, -1]]
    )


# -- names -----------------------------------------------------------------------------------------

_NAMES: dict[type, str] = {
    Plane: "plane",
    Cylinder: "cylinder",
    Cone: "cone",
    Sphere: "sphere",
    Torus: "torus",
    Extrusion: "extrusion",
    Revolution: "revolution",
}


def surface_kind(carrier: SurfaceCarrier) -> str:
    """Return what a report calls the carrier."""
    if not isinstance(carrier, SplineSurface):
        return _NAMES[type(carrier)]
    single = all(len(k) == 2 * (p + 1) for k, p in zip(carrier.knots, carrier.degrees, strict=True))
    kind = "Bézier surface" if single else "B-spline surface"
    return kind if carrier.weights is None else f"rational {kind}"


def curve_kind(carrier: CurveCarrier) -> str:
    """Return what a report calls the carrier of an edge."""
    if isinstance(carrier, Line):
        return "line"
    if isinstance(carrier, Arc):
        return "circle" if carrier.radii[0] == carrier.radii[1] else "ellipse"
    kind = "Bézier curve" if len(carrier.knots) == 2 * (carrier.degree + 1) else "B-spline curve"
    return kind if carrier.weights is None else f"rational {kind}"


def figures(carrier: SurfaceCarrier) -> Mapping[str, float]:
    """Return the lengths (model units) and angles (degrees) that a drawing would show."""
    if isinstance(carrier, (Cylinder, Sphere)):
        return {"radius": carrier.radius}
    if isinstance(carrier, Cone):
        return {"half angle": float(np.degrees(carrier.angle))}
    if isinstance(carrier, Torus):
        return {"major radius": carrier.major, "minor radius": carrier.minor}
    return {}


def spline_traits(carrier: CurveCarrier | SurfaceCarrier) -> tuple[int, bool]:
    """Return the largest degree of a carrier's splines, 0 for none, and whether one is rational."""
    if isinstance(carrier, Extrusion | Revolution):
        return spline_traits(carrier.basis)
    if isinstance(carrier, SplineCurve):
        return carrier.degree, carrier.weights is not None
    if isinstance(carrier, SplineSurface):
        return max(carrier.degrees), carrier.weights is not None
    return 0, False


def fit_plane(points: Array, rounding: float) -> Plane | None:
    """Return the plane that holds all points (n, 3) to `rounding` (a length), or None.

    Points on one line have no plane of their own: None.
    """
    centre = points.mean(axis=0)
    away = points - centre
    # most faces lie in no plane: no direction has all points so near
    if thickness(away)[0] > 2 * rounding * sqrt(len(points)):
        return None
    _, values, axes = np.linalg.svd(away, full_matrices=False)
    if values[1] <= rounding:
        return None
    if float(np.abs(away @ axes[2]).max()) > rounding:
        return None
    return Plane(centre, axes[2])
