"""Solids made with the geometry kernel alone, of known volume, and their STEP files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cadquery as cq
import numpy as np
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeFace,
    BRepBuilderAPI_MakeSolid,
    BRepBuilderAPI_NurbsConvert,
    BRepBuilderAPI_Sewing,
)
from OCP.BRepLib import BRepLib
from OCP.Geom import Geom_BSplineSurface
from OCP.gp import gp_Pnt
from OCP.IFSelect import IFSelect_RetDone
from OCP.Interface import Interface_Static
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Controller, STEPControl_Writer
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDocStd import TDocStd_Document
from OCP.XCAFApp import XCAFApp_Application
from OCP.XCAFDoc import XCAFDoc_Area, XCAFDoc_Centroid, XCAFDoc_DocumentTool, XCAFDoc_Volume
from scipy.interpolate import BSpline

from pc2cad.brep.kernel import Array1OfInteger, Array1OfReal, Array2OfPnt, as_shell

AP214, AP242 = 4, 5


def write_step(shape: cq.Shape, path: Path, *, unit: str = "MM", schema: int = AP242) -> Path:
    """Write one shape; the kernel's process-wide settings are put back afterwards."""
    STEPControl_Controller.Init_s()
    before = (
        Interface_Static.IVal_s("write.step.schema"),
        Interface_Static.CVal_s("write.step.unit"),
    )
    Interface_Static.SetIVal_s("write.step.schema", schema)
    Interface_Static.SetCVal_s("write.step.unit", unit)
    try:
        writer = STEPControl_Writer()
        writer.Transfer(shape.wrapped, STEPControl_AsIs)
        assert writer.Write(str(path)) == IFSelect_RetDone
    finally:
        Interface_Static.SetIVal_s("write.step.schema", before[0])
        Interface_Static.SetCVal_s("write.step.unit", before[1])
    return path


def write_with_properties(shape: cq.Shape, path: Path, volume: float) -> Path:
    """Write one shape with a stated volume, and the kernel's own area and centroid."""
    application = XCAFApp_Application.GetApplication_s()
    document = TDocStd_Document(TCollection_ExtendedString("XmlOcaf"))
    application.InitDocument(document)
    label = XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).AddShape(shape.wrapped, False)
    XCAFDoc_Volume.Set_s(label, volume)
    XCAFDoc_Area.Set_s(label, shape.Area())
    XCAFDoc_Centroid.Set_s(label, shape.Center().toPnt())
    writer = STEPCAFControl_Writer()
    writer.SetPropsMode(True)
    writer.Transfer(document, STEPControl_AsIs)
    assert writer.Write(str(path)) == IFSelect_RetDone
    return path


def as_nurbs(shape: cq.Shape) -> cq.Shape:
    """The same shape on (rational) B-spline surfaces."""
    return cq.Shape.cast(BRepBuilderAPI_NurbsConvert(shape.wrapped).Shape())


class SplineSolid:
    """A cubic B-spline map of the unit cube up to w = top, its volume, and its six faces."""

    degree = 3

    def __init__(self, count: int = 6, top: float = 1.0) -> None:
        self.top = top
        inner = np.linspace(0.0, 1.0, count - self.degree + 1)
        self.knots = np.concatenate([np.zeros(self.degree), inner, np.ones(self.degree)])
        greville = np.array([self.knots[i + 1 : i + 4].mean() for i in range(count)])
        x, y, z = np.meshgrid(greville, greville, greville, indexing="ij")
        self.poles = np.stack(
            [
                10.0 * x + np.sin(3.0 * y) + np.cos(5.0 * z),
                20.0 * y + x**2 * z,
                30.0 * z + 2.0 * x * np.sin(4.0 * y),
            ],
            axis=-1,
        )

    def volume(self) -> float:
        """The integral of the Jacobian determinant over the cube, by exact Gauss quadrature."""
        (value, slope, weight), (value_w, slope_w, weight_w) = self._rule(1.0), self._rule(self.top)
        columns = [
            np.einsum("ai,bj,ck,ijkd->abcd", *bases, self.poles, optimize=True)
            for bases in (
                (slope, value, value_w),
                (value, slope, value_w),
                (value, value, slope_w),
            )
        ]
        determinant = np.linalg.det(np.stack(columns, axis=-1))
        return float(np.einsum("abc,a,b,c->", determinant, weight, weight, weight_w))

    def _rule(self, end: float) -> tuple[Any, Any, Any]:
        """Values and slopes of the B-splines at the Gauss nodes up to a parameter; weights."""
        inner = np.unique(self.knots)
        breaks = np.append(inner[inner < end], end)
        nodes, weights = np.polynomial.legendre.leggauss(2 * self.degree)
        half = 0.5 * np.diff(breaks)[:, None]
        t = (breaks[:-1, None] + half * (1.0 + nodes)).ravel()
        return self._splines()(t), self._splines()(t, 1), (half * weights).ravel()

    def _splines(self) -> BSpline:
        return BSpline(self.knots, np.eye(len(self.poles)), self.degree)

    def solid(self) -> cq.Shape:
        """The six faces, sewn; the four sides end at w = top on surfaces that go on to 1."""
        p = self.poles
        lid = np.tensordot(p, self._splines()(self.top), axes=(2, 0))
        sewing = BRepBuilderAPI_Sewing(1e-6)
        for net in (p[0], p[-1], p[:, 0], p[:, -1]):
            side = BRepBuilderAPI_MakeFace(self._surface(net), 0.0, 1.0, 0.0, self.top, 1e-7)
            sewing.Add(side.Face())
        for net in (p[:, :, 0], lid):
            sewing.Add(BRepBuilderAPI_MakeFace(self._surface(net), 1e-7).Face())
        sewing.Perform()
        solid = BRepBuilderAPI_MakeSolid(as_shell(sewing.SewedShape())).Solid()
        BRepLib.OrientClosedSolid_s(solid)
        return cq.Solid(solid)

    def _surface(self, net: Any) -> Geom_BSplineSurface:
        rows, columns = net.shape[:2]
        poles = Array2OfPnt(1, rows, 1, columns)
        for i, j in np.ndindex(rows, columns):
            poles.SetValue(i + 1, j + 1, gp_Pnt(*net[i, j].tolist()))
        values, counts = np.unique(self.knots, return_counts=True)
        knots = Array1OfReal(1, len(values))
        multiplicities = Array1OfInteger(1, len(values))
        for i, (value, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True)):
            knots.SetValue(i + 1, value)
            multiplicities.SetValue(i + 1, count)
        return Geom_BSplineSurface(
            poles, knots, knots, multiplicities, multiplicities, self.degree, self.degree
        )
