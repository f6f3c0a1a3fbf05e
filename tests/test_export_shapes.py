"""Small canonical solids for the tests of the writers, each with its exact figures."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeFace,
    BRepBuilderAPI_MakeSolid,
    BRepBuilderAPI_Sewing,
)
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.BRepPrimAPI import (
    BRepPrimAPI_MakeBox,
    BRepPrimAPI_MakeCylinder,
    BRepPrimAPI_MakeSphere,
    BRepPrimAPI_MakeTorus,
)
from OCP.Geom import Geom_BezierSurface, Geom_BSplineSurface
from OCP.GeomConvert import GeomConvert
from OCP.gp import gp_Pnt
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer

from pc2cad.brep.kernel import Array2OfPnt, as_face, as_shell, as_solid
from pc2cad.export.model import Exportable, GeometricProperties, NamedFace


def parts(shape, kind):
    found = []
    explorer = TopExp_Explorer(shape, kind)
    while explorer.More():
        found.append(explorer.Current())
        explorer.Next()
    return found


def faces_of(shape):
    return [as_face(face) for face in parts(shape, TopAbs_ShapeEnum.TopAbs_FACE)]


def spline_poles(shape) -> np.ndarray:
    """All poles of the B-spline faces of `shape`, sorted, (n, 3)."""
    poles = [
        surface.Pole(i, j).Coord()
        for surface in map(BRep_Tool.Surface_s, faces_of(shape))
        if isinstance(surface, Geom_BSplineSurface)
        for i in range(1, surface.NbUPoles() + 1)
        for j in range(1, surface.NbVPoles() + 1)
    ]
    assert poles
    return np.array(sorted(poles))


def _patch(corners) -> object:
    """B-spline face through a grid of Bézier points, (m, n, 3)."""
    points = np.asarray(corners, dtype=float)
    array = Array2OfPnt(1, points.shape[0], 1, points.shape[1])
    for (i, j), _ in np.ndenumerate(points[:, :, 0]):
        array.SetValue(i + 1, j + 1, gp_Pnt(*map(float, points[i, j])))
    surface = GeomConvert.SurfaceToBSplineSurface_s(Geom_BezierSurface(array))
    return BRepBuilderAPI_MakeFace(surface, 1e-7).Face()


def spline_box():
    """Unit cube whose top bulges: its middle Bézier point lies 1 higher (volume 1 + 4/9/4)."""
    low, high = np.array([0.0, 1.0]), np.array([0.0, 0.5, 1.0])

    def grid(u, v, place):
        return [[place(s, t) for t in v] for s in u]

    sides = [
        grid(low, low, lambda s, t: (s, t, 0.0)),
        grid(high, high, lambda s, t: (s, t, 2.0 if s == t == 0.5 else 1.0)),
        *(grid(low, low, lambda s, t, c=c: (s, c, t)) for c in (0.0, 1.0)),
        *(grid(low, low, lambda s, t, c=c: (c, s, t)) for c in (0.0, 1.0)),
    ]
    sewing = BRepBuilderAPI_Sewing(1e-6)
    for side in sides:
        sewing.Add(_patch(side))
    sewing.Perform()
    solid = BRepBuilderAPI_MakeSolid(as_shell(sewing.SewedShape())).Solid()
    found = GProp_GProps()
    BRepGProp.VolumeProperties_s(solid, found)
    return solid if found.Mass() > 0 else as_solid(solid.Reversed())


def hollow_sphere():
    outer, inner = (
        as_shell(parts(BRepPrimAPI_MakeSphere(r).Solid(), TopAbs_ShapeEnum.TopAbs_SHELL)[0])
        for r in (5.0, 3.0)
    )
    return BRepBuilderAPI_MakeSolid(outer, as_shell(inner.Reversed())).Solid()


#: name: (how it is built, exact volume)
SHAPES = {
    "box": (lambda: BRepPrimAPI_MakeBox(10.0, 20.0, 30.0).Solid(), 6000.0),
    "cylinder": (lambda: BRepPrimAPI_MakeCylinder(3.0, 8.0).Solid(), 72.0 * math.pi),
    "hollow sphere": (hollow_sphere, 4.0 / 3.0 * math.pi * (125.0 - 27.0)),
    "torus": (lambda: BRepPrimAPI_MakeTorus(10.0, 3.0).Solid(), 180.0 * math.pi**2),
    "spline box": (spline_box, 1.0 + 1.0 / 9.0),
}


@cache
def exportable(shape: str) -> Exportable:
    build, volume = SHAPES[shape]
    solid = build()
    found = GProp_GProps()
    BRepGProp.SurfaceProperties_s(solid, found)
    area = found.Mass()
    BRepGProp.VolumeProperties_s(solid, found)
    faces = tuple(NamedFace(f"side={i}", face) for i, face in enumerate(faces_of(solid)))
    figures = GeometricProperties(volume, area, found.CentreOfMass().Coord())
    return Exportable(solid, shape, f"a {shape}", "mm", faces, figures, 1e-7)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_canonical_solids_are_valid_and_have_their_exact_volume(shape):
    item = exportable(shape)
    found = GProp_GProps()
    BRepGProp.VolumeProperties_s(item.solid, found)
    assert BRepCheck_Analyzer(item.solid).IsValid()
    assert found.Mass() == pytest.approx(item.properties.volume, rel=1e-12)
