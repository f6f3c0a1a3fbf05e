"""Edges that the kernel has made, put in place of by better ones, and vertices moved with them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.gp import gp_Pnt
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FORWARD, TopAbs_VERTEX
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Edge, TopoDS_Vertex

from pc2cad.arrays import Array
from pc2cad.brep import to_kernel
from pc2cad.brep.booleans import NamedEdge, NamedShape
from pc2cad.brep.from_kernel import curve_function, path_function, surface_function
from pc2cad.brep.kernel import (
    IndexedDataMapOfShapeListOfShape,
    IndexedMapOfShape,
    as_edge,
    as_face,
    as_vertex,
    shapes_in,
)
from pc2cad.brep.pieces import PieceJet
from pc2cad.brep.tolerance import KERNEL_TOLERANCE
from pc2cad.geometry.carriers import SplineCurve, SplinePath
from pc2cad.geometry.jets import SurfaceFunction


@dataclass(frozen=True, eq=False)
class Corner:
    """A vertex at ends of edges that are to be replaced, and what it has to lie on."""

    vertex: TopoDS_Vertex
    point: Array
    tolerance: float
    #: surfaces and edges that stay as they are, each with where on it the vertex is, (k,)
    pieces: tuple[tuple[PieceJet, Array], ...]
    #: of each piece that is an edge, the edge, and whether the vertex is its last one
    kept: tuple[tuple[TopoDS_Edge, bool] | None, ...]


def copied(shape: NamedShape) -> NamedShape:
    """Return a shape with edges and vertices of its own, on the same surfaces and curves.

    What a Boolean has left alone it shares with its operands.
    """
    copy = BRepBuilderAPI_Copy(shape.shape, False, False)
    faces = tuple((as_face(copy.ModifiedShape(face)), names) for face, names in shape.faces)
    return NamedShape(copy.Shape(), faces)


def corners_of(shape: NamedShape, edges: Sequence[NamedEdge], origin: Array) -> list[Corner]:
    """Return the vertices at the ends of edges, relative to `origin`.

    Lines and conics among the edges stay as they are in space.
    """
    around = IndexedDataMapOfShapeListOfShape()
    TopExp.MapShapesAndUniqueAncestors_s(shape.shape, TopAbs_VERTEX, TopAbs_EDGE, around)
    replaced, ends = IndexedMapOfShape(), IndexedMapOfShape()
    for named in edges:
        if named.conic is None:
            replaced.Add(named.edge)
        for vertex in ends_of(named.edge):
            ends.Add(vertex)
    found = []
    for number in range(1, ends.Extent() + 1):
        vertex = as_vertex(ends.FindKey(number))
        pieces: list[tuple[PieceJet, Array]] = []
        kept: list[tuple[TopoDS_Edge, bool] | None] = []
        for named in edges:
            for last, end in enumerate(ends_of(named.edge)):
                if end.IsSame(vertex):
                    pieces += _surfaces(shape, named, last, origin)
                    kept += [None, None]
        for shape_ in shapes_in(around.FindFromKey(vertex)):
            edge = as_edge(shape_)
            if replaced.Contains(edge) or BRep_Tool.Degenerated_s(edge):
                continue
            for last, end in enumerate(ends_of(edge)):
                if end.IsSame(vertex):
                    pieces.append(_curve(edge, last, origin))
                    kept.append((edge, bool(last)))
        point = np.array(BRep_Tool.Pnt_s(vertex).Coord()) - origin
        tolerance = BRep_Tool.Tolerance_s(vertex)
        found.append(Corner(vertex, point, tolerance, tuple(pieces), tuple(kept)))
    return found


def ends_of(edge: TopoDS_Edge) -> tuple[TopoDS_Vertex, TopoDS_Vertex]:
    """Return the vertices at which the curve of an edge begins and ends."""
    forward = as_edge(edge.Oriented(TopAbs_FORWARD))
    return TopExp.FirstVertex_s(forward), TopExp.LastVertex_s(forward)


def _surfaces(
    shape: NamedShape, named: NamedEdge, last: int, origin: Array
) -> Iterator[tuple[PieceJet, Array]]:
    """Yield the surfaces of both faces, with where on them an edge begins or ends."""
    span = named.range
    for index in named.faces:
        face = shape.faces[index][0]
        surface = surface_function(BRep_Tool.Surface_s(face), origin)
        path = path_function(BRep_Tool.CurveOnSurface_s(named.edge, face, *span))

        def jet(at: Array, surface: SurfaceFunction = surface) -> tuple[Array, tuple[Array, ...]]:
            point, along_a, along_b = surface.jet(at[:, 0], at[:, 1])
            return point, (along_a, along_b)

        yield jet, path.jet(np.array([span[last]]))[0][0]


def _curve(edge: TopoDS_Edge, last: int, origin: Array) -> tuple[PieceJet, Array]:
    span = BRep_Tool.Range_s(edge)
    curve = curve_function(BRep_Tool.Curve_s(edge, *span), origin)

    def jet(at: Array) -> tuple[Array, tuple[Array, ...]]:
        point, along = curve.jet(at[:, 0])
        return point, (along,)

    return jet, np.array([span[last]])


def move(corner: Corner, point: Array, places: Sequence[Array], origin: Array) -> None:
    """Move a vertex, `point` being relative, and trim the edges there that stay, at `places`."""
    builder = BRep_Builder()
    builder.UpdateVertex(corner.vertex, gp_Pnt(*map(float, point + origin)), KERNEL_TOLERANCE)
    corner.vertex.TShape().Tolerance(KERNEL_TOLERANCE)
    for kept, place in zip(corner.kept, places, strict=True):
        if kept is not None:
            edge, last = kept
            span = list(BRep_Tool.Range_s(edge))
            span[last] = float(place[0])
            builder.Range(edge, *span)


def put(
    shape: NamedShape, named: NamedEdge, curve: SplineCurve, paths: tuple[SplinePath, SplinePath]
) -> None:
    """Give an edge of a shape another curve over [0, 1], in space and on both of its faces."""
    builder, content = BRep_Builder(), named.edge.TShape()
    content.ChangeCurves().Clear()
    content.Tolerance(KERNEL_TOLERANCE)
    builder.UpdateEdge(named.edge, to_kernel.curve(curve)[0], KERNEL_TOLERANCE)
    for index, path in zip(named.faces, paths, strict=True):
        face = shape.faces[index][0]
        builder.UpdateEdge(named.edge, to_kernel.pcurve(path, 0.0, 1.0), face, KERNEL_TOLERANCE)
    builder.Range(named.edge, 0.0, 1.0)
    builder.SameRange(named.edge, True)
    builder.SameParameter(named.edge, True)


def retrace(
    shape: NamedShape, named: NamedEdge, paths: Mapping[int, SplinePath], off: float
) -> None:
    """Give an edge other curves, over [0, 1], in the parameters of its first or second face.

    It is then `off` its faces.
    """
    builder, span, tolerance = BRep_Builder(), named.range, max(off, KERNEL_TOLERANCE)
    for side, path in paths.items():
        face = shape.faces[named.faces[side]][0]
        builder.UpdateEdge(named.edge, to_kernel.pcurve(path, *span), face, tolerance)
    named.edge.TShape().Tolerance(tolerance)
    builder.Range(named.edge, *span)
    builder.SameRange(named.edge, True)
    builder.SameParameter(named.edge, True)
