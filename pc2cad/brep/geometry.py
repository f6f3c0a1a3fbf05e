"""Carriers to kernel geometry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface, Geom_Line, Geom_Plane
from OCP.Geom2d import Geom2d_BSplineCurve, Geom2d_Curve, Geom2d_Line
from OCP.gp import gp_Ax3, gp_Dir, gp_Dir2d, gp_Pnt, gp_Pnt2d
from OCP.TColgp import TColgp_Array1OfPnt, TColgp_Array1OfPnt2d, TColgp_Array2OfPnt
from OCP.TColStd import TColStd_Array1OfInteger, TColStd_Array1OfReal

from pc2cad.errors import KernelError
from pc2cad.geometry.carriers import Array, CurveCarrier, Line, Plane, SplineCurve, SplineSurface


def check_finite(values: Array, what: str) -> None:
    """Raise KernelError for nan or inf: the kernel accepts both and writes them into files."""
    if not np.isfinite(values).all():
        raise KernelError(f"{what} has a coordinate that is not finite")


def curve(carrier: CurveCarrier) -> tuple[Geom_Line | Geom_BSplineCurve, float]:
    """Return the kernel's curve and the upper end of its parameter range, which begins at 0."""
    if isinstance(carrier, Line):
        check_finite(np.array([carrier.start, carrier.end]), "an edge")
        along = carrier.end - carrier.start
        length = float(np.linalg.norm(along))
        start = gp_Pnt(*map(float, carrier.start))
        return Geom_Line(start, gp_Dir(*map(float, along / length))), length
    return _spline_curve(carrier), 1.0


def _spline_curve(carrier: SplineCurve) -> Geom_BSplineCurve:
    check_finite(carrier.poles, "an edge's pole")
    poles = TColgp_Array1OfPnt(1, len(carrier.poles))
    for i, (x, y, z) in enumerate(carrier.poles.tolist(), start=1):
        poles.SetValue(i, gp_Pnt(x, y, z))
    knots, multiplicities = _knots(carrier.knots)
    return Geom_BSplineCurve(poles, knots, multiplicities, carrier.degree, False)


def _knots(flat: NDArray[np.float64]) -> tuple[TColStd_Array1OfReal, TColStd_Array1OfInteger]:
    check_finite(flat, "a knot vector")
    values, counts = np.unique(flat, return_counts=True)
    if len(values) > 1 and np.diff(values).min() < 1e-10:
        raise KernelError("two knots are nearer than 1e-10 of the parameter range")
    knots = TColStd_Array1OfReal(1, len(values))
    multiplicities = TColStd_Array1OfInteger(1, len(values))
    for i, (value, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True), start=1):
        knots.SetValue(i, value)
        multiplicities.SetValue(i, count)
    return knots, multiplicities


def surface(carrier: Plane | SplineSurface) -> Geom_Plane | Geom_BSplineSurface:
    """Return the kernel's surface."""
    if isinstance(carrier, Plane):
        check_finite(np.array([carrier.origin, carrier.normal]), "a plane")
        origin = gp_Pnt(*map(float, carrier.origin))
        return Geom_Plane(gp_Ax3(origin, gp_Dir(*map(float, carrier.normal))))
    check_finite(carrier.poles, "a face's pole")
    rows, columns, _ = carrier.poles.shape
    poles = TColgp_Array2OfPnt(1, rows, 1, columns)
    set_value = poles.SetValue
    for i, row in enumerate(carrier.poles.tolist(), start=1):
        for j, (x, y, z) in enumerate(row, start=1):
            set_value(i, j, gp_Pnt(x, y, z))
    (knots_s, counts_s), (knots_t, counts_t) = (_knots(k) for k in carrier.knots)
    return Geom_BSplineSurface(
        poles, knots_s, knots_t, counts_s, counts_t, *carrier.degrees, False, False
    )


#: the four sides of the unit square in anti-clockwise order, each from its start
_SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))


def boundary_pcurve(side: int, along_walk: bool, range_end: float) -> Geom2d_Curve:
    """Return the straight curve along one side of the parameter square.

    `side` counts anti-clockwise from t=0. The parameter runs from 0 to `range_end` at the edge's
    own speed, along the walk or against it.
    """
    start, end = _SQUARE[side], _SQUARE[(side + 1) % 4]
    if not along_walk:
        start, end = end, start
    if range_end == 1.0:
        direction = gp_Dir2d(end[0] - start[0], end[1] - start[1])
        return Geom2d_Line(gp_Pnt2d(*start), direction)
    poles = TColgp_Array1OfPnt2d(1, 2)
    poles.SetValue(1, gp_Pnt2d(*start))
    poles.SetValue(2, gp_Pnt2d(*end))
    knots, counts = TColStd_Array1OfReal(1, 2), TColStd_Array1OfInteger(1, 2)
    for i, knot in enumerate((0.0, range_end), start=1):
        knots.SetValue(i, knot)
        counts.SetValue(i, 2)
    return Geom2d_BSplineCurve(poles, knots, counts, 1, False)
