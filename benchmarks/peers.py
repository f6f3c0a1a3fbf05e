"""The routes that users take instead. Each makes faces from points, or a whole solid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeEdge,
    BRepBuilderAPI_MakeFace,
    BRepBuilderAPI_MakeWire,
    BRepBuilderAPI_Sewing,
)
from OCP.BRepOffsetAPI import BRepOffsetAPI_MakePipeShell
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface
from OCP.GeomAPI import GeomAPI_PointsToBSplineSurface
from OCP.gp import gp_Ax2, gp_Circ, gp_Dir, gp_Pln, gp_Pnt
from OCP.TopAbs import TopAbs_SHELL
from scipy.interpolate import make_interp_spline

from benchmarks.channels import Channel
from benchmarks.measure import children, faces_of
from pc2cad.brep.kernel import (
    Array1OfInteger,
    Array1OfPnt,
    Array1OfReal,
    Array2OfPnt,
    as_shell,
    as_wire,
)

#: what users try when the shells do not close, in this order
SEWING = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)


class RouteFailedError(Exception):
    """A route gives no shape."""


def parametric_surface(n: int, **options) -> Callable[[Channel, float], object]:
    """`Workplane.parametricSurface`, called back for every point."""

    def face(channel: Channel, w: float):
        import cadquery as cq

        return cq.Workplane().parametricSurface(channel.point(w), N=n, **options).val().wrapped

    return face


def spline_approx(n: int, **options) -> Callable[[Channel, float], object]:
    """`Face.makeSplineApprox` of a grid of points."""

    def face(channel: Channel, w: float):
        import cadquery as cq

        rows = [[cq.Vector(*p) for p in row] for row in channel.grid(w, n).tolist()]
        return cq.Face.makeSplineApprox(rows, **options).wrapped

    return face


def geomapi_interpolation(n: int) -> Callable[[Channel, float], object]:
    """`GeomAPI_PointsToBSplineSurface.Interpolate`, as FreeCAD's Python calls it."""

    def face(channel: Channel, w: float):
        points = Array2OfPnt(1, n + 1, 1, n + 1)
        for i, row in enumerate(channel.grid(w, n).tolist(), start=1):
            for j, p in enumerate(row, start=1):
                points.SetValue(i, j, gp_Pnt(*p))
        builder = GeomAPI_PointsToBSplineSurface()
        builder.Interpolate(points)
        return BRepBuilderAPI_MakeFace(builder.Surface(), 1e-7).Face()

    return face


def geomdl_interpolation(n: int, degree: int = 3) -> Callable[[Channel, float], object]:
    """geomdl's global interpolation; its result is handed to the kernel to be measured."""

    def face(channel: Channel, w: float):
        from geomdl import fitting

        points = channel.grid(w, n).reshape(-1, 3).tolist()
        return fitting.interpolate_surface(points, n + 1, n + 1, degree, degree)

    return face


def kernel_face_of_geomdl(surface) -> object:
    poles = np.array(surface.ctrlpts).reshape(surface.ctrlpts_size_u, surface.ctrlpts_size_v, 3)
    return BRepBuilderAPI_MakeFace(
        kernel_surface(poles, (surface.knotvector_u, surface.knotvector_v),
                       (surface.degree_u, surface.degree_v)), 1e-7
    ).Face()  # fmt: skip


def kernel_surface(poles, knots, degrees) -> Geom_BSplineSurface:
    rows, columns, _ = np.shape(poles)
    array = Array2OfPnt(1, rows, 1, columns)
    for i, row in enumerate(np.asarray(poles).tolist(), start=1):
        for j, p in enumerate(row, start=1):
            array.SetValue(i, j, gp_Pnt(*p))
    (ku, mu), (kv, mv) = (_knots(k) for k in knots)
    return Geom_BSplineSurface(array, ku, kv, mu, mv, *degrees, False, False)


def _knots(flat) -> tuple[Array1OfReal, Array1OfInteger]:
    values, counts = np.unique(np.asarray(flat, dtype=float), return_counts=True)
    knots = Array1OfReal(1, len(values))
    multiplicities = Array1OfInteger(1, len(values))
    for i, (value, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True), start=1):
        knots.SetValue(i, value)
        multiplicities.SetValue(i, count)
    return knots, multiplicities


# -- faces to solids -------------------------------------------------------------------------------


def sewn(
    channel: Channel, face: Callable[[Channel, float], object], along: int = 0
) -> tuple[object, float]:
    """Return the solid of both walls and two plane caps, and the tolerance that sewing took.

    `along` says which parameter of a wall runs along the guide.
    """
    import cadquery as cq

    walls = [face(channel, w) for w in (0.0, 1.0)]
    caps = [_cap(walls, along, end) for end in (0, 1)]
    for tolerance in SEWING:
        sewing = BRepBuilderAPI_Sewing(tolerance)
        for part in (*walls, *caps):
            sewing.Add(part)
        sewing.Perform()
        shape = sewing.SewedShape()
        shells = children(shape, TopAbs_SHELL) if not shape.IsNull() else []
        if len(shells) == 1 and sewing.NbFreeEdges() == 0:
            break
    else:
        raise RouteFailedError(f"not closed by sewing at {SEWING[-1]:g}")
    solid = cq.Solid.makeSolid(cq.Shell(as_shell(shells[0])))
    if not solid.isValid():
        solid = solid.fix()
    return solid.wrapped, tolerance


def _cap(walls: list, along: int, end: int):
    """Return the plane face between the walls' curves at one end of u."""
    import cadquery as cq

    wires, rim = [], []
    for wall in walls:
        surface = BRep_Tool.Surface_s(wall)
        place = surface.Bounds()[2 * along + end]
        curve = surface.UIso(place) if along == 0 else surface.VIso(place)
        first, last = curve.FirstParameter(), curve.LastParameter()
        edges = [BRepBuilderAPI_MakeEdge(curve, first, last).Edge()]
        start, stop = curve.Value(first), curve.Value(last)
        if start.Distance(stop) > 1e-7:
            edges.append(BRepBuilderAPI_MakeEdge(stop, start).Edge())
        wires.append(cq.Wire.assembleEdges([cq.Edge(edge) for edge in edges]))
        places = (curve.Value(t) for t in np.linspace(first, last, 40).tolist())
        rim += [(p.X(), p.Y(), p.Z()) for p in places]
    try:
        return cq.Face.makeFromWires(wires[1], [wires[0]]).wrapped
    except ValueError:
        # "wires not planar": take the plane that fits best
        centre = np.mean(rim, axis=0)
        normal = np.linalg.svd(np.array(rim) - centre)[2][2]
        plane = gp_Pln(gp_Pnt(*centre.tolist()), gp_Dir(*normal.tolist()))
        maker = BRepBuilderAPI_MakeFace(plane, wires[1].wrapped, True)
        maker.Add(as_wire(wires[0].wrapped.Reversed()))
        if not maker.IsDone():
            raise RouteFailedError("the ends are not plane enough for a cap") from None
        return maker.Face()


# -- sweeps ----------------------------------------------------------------------------------------


def _curve_edge(points: np.ndarray):
    spline = make_interp_spline(np.linspace(0, 1, len(points)), points, k=5)
    array = Array1OfPnt(1, len(points))
    for i, p in enumerate(spline.c.tolist(), start=1):
        array.SetValue(i, gp_Pnt(*p))
    return BRepBuilderAPI_MakeEdge(Geom_BSplineCurve(array, *_knots(spline.t), 5, False)).Edge()


def _section_edge(channel: Channel, w: float):
    """Return the closed curve of a wall at the start: a circle where it is one."""
    v = np.linspace(0, 1, 49)
    points = channel.points(w, np.zeros_like(v), v)
    if channel.a == channel.b:
        centre = channel.guide_points(np.zeros(1))[0]
        x, y = points[0] - centre, points[12] - centre
        axes = gp_Ax2(gp_Pnt(*centre.tolist()), gp_Dir(*np.cross(x, y).tolist()),
                      gp_Dir(*x.tolist()))  # fmt: skip
        circle = gp_Circ(axes, channel.a + channel.delta * (w - 0.5))
        return BRepBuilderAPI_MakeEdge(circle).Edge()
    points[-1] = points[0]
    return _curve_edge(points)


def _guide_edge(channel: Channel):
    return _curve_edge(channel.guide_points(np.linspace(0, 1, 240)))


def _pipe(channel: Channel, w: float, tolerance: float | None) -> BRepOffsetAPI_MakePipeShell:
    builder = BRepOffsetAPI_MakePipeShell(BRepBuilderAPI_MakeWire(_guide_edge(channel)).Wire())
    builder.SetMode(True)
    if tolerance is not None:
        builder.SetTolerance(tolerance, tolerance, 1e-2)
    builder.Add(BRepBuilderAPI_MakeWire(_section_edge(channel, w)).Wire())
    builder.Build()
    if not builder.IsDone():
        raise RouteFailedError("MakePipeShell fails")
    return builder


def pipe_and_cut(tolerance: float | None):
    """MakePipeShell of both walls in Frenet mode, the inner one cut out of the outer one."""

    def solid(channel: Channel):
        tubes = [_pipe(channel, w, tolerance) for w in (1.0, 0.0)]
        if not all(tube.MakeSolid() for tube in tubes):
            raise RouteFailedError("a pipe does not close")
        return BRepAlgoAPI_Cut(*(tube.Shape() for tube in tubes)).Shape()

    return solid


def pipe_face(tolerance: float | None):
    """The one face of MakePipeShell, to be sewn to caps: without the Boolean."""

    def face(channel: Channel, w: float):
        (only,) = faces_of(_pipe(channel, w, tolerance).Shape())
        return only

    return face


def cadquery_sweep(channel: Channel):
    """`Solid.sweep(isFrenet=True)` of a section with a hole."""
    import cadquery as cq

    path = cq.Wire.assembleEdges([cq.Edge(_guide_edge(channel))])
    outer, inner = (cq.Wire.assembleEdges([cq.Edge(_section_edge(channel, w))]) for w in (1.0, 0.0))
    return cq.Solid.sweep(outer, [inner], path, isFrenet=True).wrapped
