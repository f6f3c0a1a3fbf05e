"""The kernel's curves and surfaces as functions on arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from OCP.Geom import (
    Geom_BSplineCurve,
    Geom_BSplineSurface,
    Geom_Circle,
    Geom_Conic,
    Geom_ConicalSurface,
    Geom_Curve,
    Geom_CylindricalSurface,
    Geom_ElementarySurface,
    Geom_Ellipse,
    Geom_Hyperbola,
    Geom_Line,
    Geom_Parabola,
    Geom_Plane,
    Geom_SphericalSurface,
    Geom_Surface,
    Geom_SurfaceOfLinearExtrusion,
    Geom_SurfaceOfRevolution,
    Geom_ToroidalSurface,
    Geom_TrimmedCurve,
)
from OCP.Geom2d import (
    Geom2d_BSplineCurve,
    Geom2d_Circle,
    Geom2d_Conic,
    Geom2d_Curve,
    Geom2d_Ellipse,
    Geom2d_Hyperbola,
    Geom2d_Line,
    Geom2d_Parabola,
    Geom2d_TrimmedCurve,
)
from OCP.gp import gp_Ax2, gp_Ax3, gp_Dir, gp_Dir2d, gp_Pnt, gp_Pnt2d

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.brep.net_sizes import net_sizes
from pc2cad.brep.spline_integrals import (
    clamped,
    flat_knots,
    read_curve,
    read_patch,
    spline_jet,
)
from pc2cad.errors import KernelError
from pc2cad.geometry.jets import CurveFunction, Jet, Sizes, SurfaceFunction
from pc2cad.geometry.splines.bends import spline_bends

NOWHERE = np.empty(0)

#: a place, and vectors by the function of the parameter that they are multiplied by
Terms = tuple[Array, dict[str, Array]]


def vector(data: gp_Pnt | gp_Dir | gp_Pnt2d | gp_Dir2d) -> Array:
    """Return coordinates."""
    return np.array(data.Coord())


def frame(place: gp_Ax3 | gp_Ax2, origin: Array) -> tuple[Array, Array]:
    """Return the origin and the axes (rows) of a frame."""
    axes = np.array([vector(d) for d in (place.XDirection(), place.YDirection(),
                                         place.Direction())])  # fmt: skip
    return vector(place.Location()) - origin, axes


# -- curves ----------------------------------------------------------------------------------------


def curve_function(curve: Geom_Curve, origin: Array) -> CurveFunction:
    """Return a curve in space relative to `origin`; raise KernelError for one of another kind."""
    if isinstance(curve, Geom_TrimmedCurve):
        return curve_function(curve.BasisCurve(), origin)
    if isinstance(curve, Geom_BSplineCurve):
        data = read_curve(curve, origin)
        return _spline(data.knots, data.poles, data.degree, data.jet, 3)
    return _conic(*conic_terms(curve, origin))


def conic_terms(curve: Geom_Curve | Geom2d_Curve, origin: Array | float = 0.0) -> Terms:
    """Return a line or a conic relative to `origin`; raise KernelError for another curve.

    It is a place, and vectors times functions of the parameter: t, t**2, cos, sin, cosh, sinh.
    """
    if isinstance(curve, Geom_TrimmedCurve | Geom2d_TrimmedCurve):
        return conic_terms(curve.BasisCurve(), origin)
    if isinstance(curve, Geom_Line | Geom2d_Line):
        place = curve.Position()
        return vector(place.Location()) - origin, {"t": vector(place.Direction())}
    if isinstance(curve, Geom_Conic | Geom2d_Conic):
        centre = vector(curve.Location()) - origin
        x, y = vector(curve.XAxis().Direction()), vector(curve.YAxis().Direction())
        if isinstance(curve, Geom_Circle | Geom2d_Circle):
            return centre, {"cos": curve.Radius() * x, "sin": curve.Radius() * y}
        if isinstance(curve, Geom_Ellipse | Geom2d_Ellipse):
            return centre, {"cos": curve.MajorRadius() * x, "sin": curve.MinorRadius() * y}
        if isinstance(curve, Geom_Parabola | Geom2d_Parabola):
            return centre, {"t": y, "t**2": x / (4 * curve.Focal())}
        if isinstance(curve, Geom_Hyperbola | Geom2d_Hyperbola):
            return centre, {"cosh": curve.MajorRadius() * x, "sinh": curve.MinorRadius() * y}
    raise KernelError(f"no integral is known along a {type(curve).__name__}")


def path_function(curve: Geom2d_Curve) -> CurveFunction:
    """Return a curve in a parameter plane; raise KernelError for one of another kind."""
    if isinstance(curve, Geom2d_TrimmedCurve):
        return path_function(curve.BasisCurve())
    if isinstance(curve, Geom2d_Line | Geom2d_Conic):
        return _conic(*conic_terms(curve))
    if not isinstance(curve, Geom2d_BSplineCurve):
        raise KernelError(f"no integral is known along a {type(curve).__name__}")
    curve = clamped(curve)
    places = range(1, curve.NbPoles() + 1)
    poles = np.array([vector(p) for p in map(curve.Pole, places)])
    knots, degree = flat_knots(curve), curve.Degree()
    if not curve.IsRational():
        return _spline(knots, poles, degree, spline_jet(knots, poles, degree), 2)
    # the kernel projects a plane's edges into it, and they may be rational
    weights = np.array([[curve.Weight(i)] for i in places])
    poles = np.hstack((poles * weights, weights))
    homogeneous = spline_jet(knots, poles, degree)

    def jet(t: Array) -> tuple[Array, Array]:
        value, slope = homogeneous(t)
        weight = value[:, 2:]
        point = value[:, :2] / weight
        return point, (slope[:, :2] - point * slope[:, 2:]) / weight

    return _spline(knots, poles, degree, jet, 2)


#: functions and their derivatives
_FUNCTIONS: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array]]] = {
    "t": (lambda t: t, np.ones_like), "t**2": (np.square, lambda t: 2 * t),
    "cos": (np.cos, lambda t: -np.sin(t)), "sin": (np.sin, np.cos),
    "cosh": (np.cosh, np.sinh), "sinh": (np.sinh, np.cosh),
}  # fmt: skip


def _conic(start: Array, terms: dict[str, Array]) -> CurveFunction:
    shares = [(*_FUNCTIONS[name], along) for name, along in terms.items()]

    def jet(t: Array) -> tuple[Array, Array]:
        point, slope = start, np.zeros(len(start))
        for value, derivative, along in shares:
            point = point + value(t)[:, None] * along
            slope = slope + derivative(t)[:, None] * along
        return point, slope

    @cache
    def sizes() -> Sizes:
        size = max(float(np.linalg.norm(along)) for along in terms.values())
        # of each kind of curve by the term that only it has, but for the line, which has no other
        first, second = next(
            (bounds for term, bounds in (
                ("t**2", (np.inf, 2 * size)), ("sinh", (np.inf, np.inf)),
                ("sin", (size, size)), ("t", (1.0, 0.0)),
            ) if term in terms)
        )  # fmt: skip
        return Sizes((first,), (second,), np.abs(start) + (0.0 if powers else size))

    powers = "t" in terms
    return CurveFunction(jet, NOWHERE if powers else None, len(terms) if powers else 1, sizes)


def _spline(
    knots: Array,
    poles: Array,
    degree: int,
    jet: Callable[[Array], tuple[Array, Array]],
    dimension: int,
) -> CurveFunction:
    @cache
    def sizes() -> Sizes:
        found = net_sizes(poles[:, None], (knots, np.array([0.0, 1.0])), (degree, 0), dimension)
        return Sizes(found.first[:1], found.second[:1], found.poles, found.jumps[:1])

    weight = None
    if poles.shape[1] > dimension:
        weights = spline_jet(knots, poles[:, dimension:], degree)

        def weight(t: Array) -> Array:
            return weights(t)[0][:, 0]

    return CurveFunction(jet, distinct(knots), degree, sizes, weight)


# -- surfaces --------------------------------------------------------------------------------------


def surface_function(surface: Geom_Surface, origin: Array) -> SurfaceFunction:
    """Return a surface relative to `origin`; raise KernelError for one of another kind."""
    if isinstance(surface, Geom_SurfaceOfLinearExtrusion):
        return _extrusion(surface, origin)
    if isinstance(surface, Geom_SurfaceOfRevolution):
        return _revolution(surface, origin)
    if isinstance(surface, Geom_BSplineSurface):
        return _patch(surface, origin)
    if isinstance(surface, Geom_Plane):
        return _plane(surface, origin)
    if not isinstance(surface, Geom_ElementarySurface):
        raise KernelError(f"no integral is known for a {type(surface).__name__}")
    centre, axes = frame(surface.Position(), origin)
    profile, bend = _profile(surface)
    radius = float(np.abs(profile(np.zeros(1))[0]).max())

    def jet(a: Array, b: Array) -> Jet:
        radius, height, radius_b, height_b = (x[:, None] for x in profile(b))
        out = np.cos(a)[:, None] * axes[0] + np.sin(a)[:, None] * axes[1]
        round_ = np.cos(a)[:, None] * axes[1] - np.sin(a)[:, None] * axes[0]
        return (centre + radius * out + height * axes[2], radius * round_,
                radius_b * out + height_b * axes[2])  # fmt: skip

    breaks = (None, None if bend else NOWHERE)

    def bends(low: Array, high: Array) -> Array:
        # the radius changes by no more than its slope, which is at most the meridian's
        middle, half = (low[:, 1] + high[:, 1]) / 2, (high[:, 1] - low[:, 1]) / 2
        radius, _, slope, _ = profile(middle)
        steep = np.full_like(middle, bend) if bend else np.abs(slope)
        return np.stack((np.abs(radius) + steep * half, steep, np.full_like(middle, bend)), axis=1)

    sizes = Sizes((np.inf, bend or 1.0), (np.inf, np.inf, bend), np.abs(centre) + radius)
    return SurfaceFunction(jet, breaks, (1, 1), lambda: sizes, turns=True, bends=bends)


def _patch(surface: Geom_BSplineSurface, origin: Array) -> SurfaceFunction:
    patch = read_patch(surface, origin)
    bends = cache(lambda: spline_bends(patch.poles, patch.knots, patch.degrees))

    @cache
    def sizes() -> Sizes:
        found = net_sizes(patch.poles, patch.knots, patch.degrees)
        if patch.poles.shape[2] == 3:
            return found
        # the net of a whole turn in one piece is far from it, those of its parts are not
        aa, ab, bb = bends().pieces.max(axis=(0, 1)).tolist()
        return replace(found, second=(aa, ab, bb))

    return SurfaceFunction(
        patch.scattered, (distinct(patch.knots[0]), distinct(patch.knots[1])), patch.degrees, sizes,
        weight=patch.weight if patch.poles.shape[2] > 3 else None, product=patch.on_grid,
        bends=lambda low, high: bends().over(low, high),
    )  # fmt: skip


def _plane(surface: Geom_Plane, origin: Array) -> SurfaceFunction:
    start, (x, y, _) = frame(surface.Position(), origin)

    def jet(a: Array, b: Array) -> Jet:
        shape = (len(a), 3)
        point = start + a[:, None] * x + b[:, None] * y
        return point, np.broadcast_to(x, shape), np.broadcast_to(y, shape)

    sizes = Sizes((1.0, 1.0), (0.0, 0.0, 0.0), np.abs(start))
    return SurfaceFunction(
        jet, (NOWHERE, NOWHERE), (1, 1), lambda: sizes,
        bends=lambda low, high: np.zeros((len(low), 3)),
    )  # fmt: skip


_Profile = Callable[[Array], tuple[Array, Array, Array, Array]]


def _profile(surface: Geom_ElementarySurface) -> tuple[_Profile, float]:
    """Return radius and height along b with their derivatives, and the length of the second ones.

    Where that is 0, b is a length, else an angle.
    """
    if isinstance(surface, Geom_CylindricalSurface):
        r = surface.Radius()
        return lambda b: (np.full_like(b, r), b, np.zeros_like(b), np.ones_like(b)), 0.0
    if isinstance(surface, Geom_ConicalSurface):
        r, angle = surface.RefRadius(), surface.SemiAngle()
        s, c = np.sin(angle), np.cos(angle)
        return lambda b: (r + s * b, c * b, np.full_like(b, s), np.full_like(b, c)), 0.0
    if isinstance(surface, Geom_SphericalSurface):
        major, minor = 0.0, surface.Radius()
    elif isinstance(surface, Geom_ToroidalSurface):
        major, minor = surface.MajorRadius(), surface.MinorRadius()
    else:
        raise KernelError(f"no integral is known for a {type(surface).__name__}")

    def meridian(b: Array) -> tuple[Array, Array, Array, Array]:
        cos, sin = minor * np.cos(b), minor * np.sin(b)
        return major + cos, sin, -sin, cos

    return meridian, minor


def _extrusion(surface: Geom_SurfaceOfLinearExtrusion, origin: Array) -> SurfaceFunction:
    basis, along = curve_function(surface.BasisCurve(), origin), vector(surface.Direction())

    def jet(a: Array, b: Array) -> Jet:
        point, slope = basis.jet(a)
        return point + b[:, None] * along, slope, np.broadcast_to(along, point.shape)

    @cache
    def sizes() -> Sizes:
        own = basis.sizes()
        jumps = (own.jumps[0], 0.0)
        return Sizes((*own.first, 1.0), (*own.second, 0.0, 0.0), own.poles, jumps)

    weight = basis.weight
    return SurfaceFunction(
        jet, (basis.breaks, NOWHERE), (basis.degree, 1), sizes,
        weight=None if weight is None else lambda a, b: weight(a),
    )  # fmt: skip


def _revolution(surface: Geom_SurfaceOfRevolution, origin: Array) -> SurfaceFunction:
    basis = curve_function(surface.BasisCurve(), origin)
    centre, axis = vector(surface.Location()) - origin, vector(surface.Direction())
    quarter = np.cross(axis, np.eye(3))  # v @ quarter is axis × v

    def jet(a: Array, b: Array) -> Jet:
        cos, sin = np.cos(a)[:, None], np.sin(a)[:, None]

        def turned(vectors: Array) -> tuple[Array, Array]:
            height = (vectors @ axis)[:, None] * axis
            out, side = vectors - height, vectors @ quarter
            return height + cos * out + sin * side, cos * side - sin * out

        point, slope = basis.jet(b)
        place, swept = turned(point - centre)
        return centre + place, swept, turned(slope)[0]

    @cache
    def sizes() -> Sizes:
        own = basis.sizes()
        return Sizes((np.inf, *own.first), (np.inf, np.inf, *own.second),
                     own.poles + np.abs(centre), (0.0, own.jumps[0]))  # fmt: skip

    def bends(low: Array, high: Array) -> Array:
        own = basis.sizes()
        middle, half = (low[:, 1] + high[:, 1]) / 2, (high[:, 1] - low[:, 1]) / 2
        out = np.linalg.norm(jet(np.zeros_like(middle), middle)[1], axis=1)
        return np.stack((out + own.first[0] * half, *(np.full_like(half, x[0]) for x in
                         (own.first, own.second))), axis=1)  # fmt: skip

    weight = basis.weight
    return SurfaceFunction(
        jet, (None, basis.breaks), (1, basis.degree), sizes, turns=True,
        weight=None if weight is None else lambda a, b: weight(b), bends=bends,
    )  # fmt: skip
