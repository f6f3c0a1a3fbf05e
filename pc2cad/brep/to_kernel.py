"""Carriers to kernel geometry."""

from __future__ import annotations

from collections.abc import Iterable
from functools import singledispatch
from math import isfinite, sqrt

import numpy as np
from OCP.Geom import (
    Geom_BSplineCurve,
    Geom_Circle,
    Geom_ConicalSurface,
    Geom_Curve,
    Geom_CylindricalSurface,
    Geom_Ellipse,
    Geom_Line,
    Geom_Plane,
    Geom_SphericalSurface,
    Geom_Surface,
    Geom_SurfaceOfLinearExtrusion,
    Geom_SurfaceOfRevolution,
    Geom_ToroidalSurface,
)
from OCP.Geom2d import Geom2d_BSplineCurve, Geom2d_Curve, Geom2d_Line
from OCP.gp import gp_Ax1, gp_Ax3, gp_Dir, gp_Dir2d, gp_Pnt, gp_Pnt2d

from pc2cad.arrays import Array
from pc2cad.brep.kernel import (
    Array1OfInteger,
    Array1OfPnt2d,
    Array1OfReal,
)
from pc2cad.brep.spline_numbers import Knots, counted, spline_curve, spline_surface
from pc2cad.errors import KernelError
from pc2cad.geometry.carriers import (
    Arc,
    Cone,
    CurveCarrier,
    Cylinder,
    Extrusion,
    Frame,
    Line,
    PCurve,
    Plane,
    Revolution,
    Sphere,
    SplineCurve,
    SplinePath,
    SplineSurface,
    SurfaceCarrier,
    Torus,
    ends_of,
)


def check_finite(values: Array, what: str) -> None:
    """Raise KernelError for nan or inf: the kernel accepts both and writes them into files."""
    if not np.isfinite(values).all():
        raise KernelError(f"{what} is not finite")


def _check_numbers(values: Iterable[float], what: str) -> None:
    """Do the same for a few numbers, for which arrays take longer."""
    if not all(map(isfinite, values)):
        raise KernelError(f"{what} is not finite")


def point(p: Array) -> gp_Pnt:
    """Return the kernel's point."""
    return gp_Pnt(*p.tolist())


def _axes(frame: Frame) -> gp_Ax3:
    check_finite(np.array([frame.origin, *frame.axes]), "a frame")
    z, x = (gp_Dir(*map(float, frame.axes[i])) for i in (2, 0))
    return gp_Ax3(point(frame.origin), z, x)


# -- curves ----------------------------------------------------------------------------------------


def curve(carrier: CurveCarrier) -> tuple[Geom_Curve, float, float]:
    """Return the kernel's curve and the range of its parameter."""
    if isinstance(carrier, Line):
        along = carrier.end - carrier.start
        length = sqrt(along.dot(along))
        if not isfinite(length):
            check_finite(np.array([carrier.start, carrier.end]), "an edge")
        return Geom_Line(point(carrier.start), gp_Dir(*(along / length).tolist())), 0.0, length
    if isinstance(carrier, Arc):
        place = _axes(carrier.frame).Ax2()
        major, minor = carrier.radii
        conic = Geom_Circle(place, major) if major == minor else Geom_Ellipse(place, major, minor)
        return conic, carrier.start, carrier.end
    return _spline_curve(carrier), 0.0, 1.0


def _spline_curve(carrier: SplineCurve) -> Geom_BSplineCurve:
    poles = _weighted(carrier.poles, carrier.weights, "an edge's")
    _checked(carrier.knots)
    return spline_curve(poles, carrier.knots, carrier.degree)


def _weighted(poles: Array, weights: Array | None, whose: str) -> Array:
    """Return finite poles (…, 3), or (…, 4) with their weights."""
    check_finite(poles, f"{whose} pole")
    if weights is None:
        return poles
    check_finite(weights, f"{whose} weight")
    return np.concatenate((poles, weights[..., None]), axis=-1)


def _checked(flat: Array) -> Knots:
    """Return the knots of a flat knot vector, which the kernel can tell apart."""
    knots = counted(flat)
    if not knots.are_apart:
        check_finite(knots.values, "a knot vector")
        raise KernelError("two knots are nearer than 1e-10 of the parameter range")
    return knots


def _knots(flat: Array) -> tuple[Array1OfReal, Array1OfInteger]:
    found = _checked(flat)
    knots = Array1OfReal(1, len(found.values))
    multiplicities = Array1OfInteger(1, len(found.values))
    pairs = zip(found.values.tolist(), found.counts.tolist(), strict=True)
    for i, (value, count) in enumerate(pairs, start=1):
        knots.SetValue(i, value)
        multiplicities.SetValue(i, count)
    return knots, multiplicities


# -- surfaces --------------------------------------------------------------------------------------


@singledispatch
def surface(carrier: SurfaceCarrier) -> Geom_Surface:
    """Return the kernel's surface."""
    raise TypeError(f"no surface is known for a {type(carrier).__name__}")


@surface.register
def _(carrier: Plane) -> Geom_Surface:
    origin, normal = carrier.origin.tolist(), carrier.normal.tolist()
    _check_numbers(origin + normal, "a plane")
    return Geom_Plane(gp_Ax3(gp_Pnt(*origin), gp_Dir(*normal)))


@surface.register
def _(carrier: Cylinder) -> Geom_Surface:
    return Geom_CylindricalSurface(_axes(carrier.frame), carrier.radius)


@surface.register
def _(carrier: Cone) -> Geom_Surface:
    return Geom_ConicalSurface(_axes(carrier.frame), carrier.angle, carrier.radius)


@surface.register
def _(carrier: Sphere) -> Geom_Surface:
    return Geom_SphericalSurface(_axes(carrier.frame), carrier.radius)


@surface.register
def _(carrier: Torus) -> Geom_Surface:
    return Geom_ToroidalSurface(_axes(carrier.frame), carrier.major, carrier.minor)


@surface.register
def _(carrier: Extrusion) -> Geom_Surface:
    direction = gp_Dir(*map(float, carrier.direction))
    return Geom_SurfaceOfLinearExtrusion(curve(carrier.basis)[0], direction)


@surface.register
def _(carrier: Revolution) -> Geom_Surface:
    place = _axes(carrier.frame)
    axis = gp_Ax1(place.Location(), place.Direction())
    return Geom_SurfaceOfRevolution(curve(carrier.basis)[0], axis)


@surface.register
def _(carrier: SplineSurface) -> Geom_Surface:
    poles = _weighted(carrier.poles, carrier.weights, "a face's")
    for knots in carrier.knots:
        _checked(knots)
    return spline_surface(poles, carrier.knots, carrier.degrees)


# -- curves in parameter planes --------------------------------------------------------------------


def pcurve(data: PCurve, first: float, last: float) -> Geom2d_Curve:
    """Return the curve in a surface's parameters over the range of its edge."""
    if isinstance(data, SplinePath):
        return _path(data.degree, first + (last - first) * data.knots, data.poles)
    start, end = np.array(data.start), np.array(data.end)
    along = end - start
    length = float(np.hypot(*along))
    # speed 1 but for rounding: a line; the kernel has no other speed for one
    if abs(length - (last - first)) <= 1e-12 * max(length, 1.0):
        origin = start - first * along / length
        direction = gp_Dir2d(*map(float, along))
        return Geom2d_Line(gp_Pnt2d(*map(float, origin)), direction)
    return _path(1, np.array([first, first, last, last]), np.array([start, end]))


def length(data: PCurve) -> float:
    """Return the length of the chord in the parameter plane."""
    first, last = ends_of(data)
    return float(np.hypot(*(last - first)))


def _path(degree: int, flat: Array, points: Array) -> Geom2d_BSplineCurve:
    check_finite(points, "a curve in a face's parameters")
    poles = Array1OfPnt2d(1, len(points))
    for i, (x, y) in enumerate(points.tolist(), start=1):
        poles.SetValue(i, gp_Pnt2d(x, y))
    knots, counts = _knots(flat)
    return Geom2d_BSplineCurve(poles, knots, counts, degree, False)
