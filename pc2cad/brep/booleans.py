"""Booleans of solids by the kernel, with the names of faces carried through."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from OCP.BOPAlgo import BOPAlgo_Operation, BOPAlgo_PaveFiller
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepAlgoAPI import BRepAlgoAPI_BooleanOperation, BRepAlgoAPI_BuilderAlgo
from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
from OCP.Geom import Geom_BSplineCurve, Geom_Curve
from OCP.gp import gp_Trsf
from OCP.Message import Message_ProgressRange
from OCP.Standard import Standard_Failure
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_SOLID
from OCP.TopExp import TopExp, TopExp_Explorer
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Shape, TopoDS_Solid

from pc2cad.arrays import Array
from pc2cad.brep.from_kernel import conic_terms, curve_function, path_function, surface_function
from pc2cad.brep.kernel import (
    IndexedDataMapOfShapeListOfShape,
    IndexedMapOfShape,
    ListOfShape,
    as_edge,
    as_face,
    as_solid,
    compound,
    shapes_in,
)
from pc2cad.errors import KernelError
from pc2cad.geometry.jets import EdgeFunction, SurfaceFunction, Trace
from pc2cad.topology.cells import SideKey

Kind = Literal["union", "cut", "intersect"]
_OPERATIONS = {
    "union": BOPAlgo_Operation.BOPAlgo_FUSE,
    "cut": BOPAlgo_Operation.BOPAlgo_CUT,
    "intersect": BOPAlgo_Operation.BOPAlgo_COMMON,
}
_CURVES = {
    "Geom_Line": "line",
    "Geom_Circle": "circle",
    "Geom_Ellipse": "ellipse",
    "Geom_Hyperbola": "hyperbola",
    "Geom_Parabola": "parabola",
    "Geom_BezierCurve": "Bézier curve",
    "Geom_BSplineCurve": "B-spline curve",
}
#: points on an edge
PLACES = 65


def label(names: tuple[SideKey, ...]) -> str:
    """Return what a face is called: parts of faces that coincide carry both names."""
    return " = ".join(name.label for name in names)


@dataclass(frozen=True, eq=False)
class NamedShape:
    """Solids, and the sides that their faces are parts of: several where two solids coincide."""

    shape: TopoDS_Shape
    faces: tuple[tuple[TopoDS_Face, tuple[SideKey, ...]], ...]

    @property
    def solids(self) -> tuple[TopoDS_Solid, ...]:
        """The solids of the shape."""
        explorer, found = TopExp_Explorer(self.shape, TopAbs_SOLID), []
        while explorer.More():
            found.append(as_solid(explorer.Current()))
            explorer.Next()
        return tuple(found)


def combine(
    kinds: Sequence[Kind], first: NamedShape, second: NamedShape, one: float = 0.0
) -> tuple[NamedShape, ...]:
    """Return unions, differences or common parts of two shapes, of no solid where they are empty.

    What is nearer than the length `one` is taken for one place. Every face of a result is a part of
    a face of theirs. Where they meet is found once. Raises KernelError where the kernel fails, or
    loses track of a face.
    """
    if not first.faces or not second.faces:
        kept = {"union": (first, second), "cut": (first,), "intersect": ()}
        nothing = NamedShape(compound(()), ())
        return tuple(next((s for s in kept[kind] if s.faces), nothing) for kind in kinds)
    return _carried_out(kinds, first, [second], one)


def fuse(shapes: Sequence[NamedShape], one: float = 0.0) -> NamedShape:
    """Return the union of shapes, two or more, in one operation; see `combine`."""
    return _carried_out(["union"], shapes[0], shapes[1:], one)[0]


def moved(shape: NamedShape, turn: Array, offset: Array, mark: str) -> NamedShape:
    """Return a copy of a shape, x going to `turn` x + `offset`, `mark` behind its bodies' names."""
    change = gp_Trsf()
    rows = zip(turn.tolist(), offset.tolist(), strict=True)
    change.SetValues(*(float(x) for row, step in rows for x in (*row, step)))
    copy = BRepBuilderAPI_Transform(shape.shape, change, True)
    faces = tuple(
        (
            as_face(copy.ModifiedShape(face)),
            tuple(replace(name, body=f"{name.body}{mark}") for name in names),
        )
        for face, names in shape.faces
    )
    return NamedShape(copy.Shape(), faces)


def original(name: str) -> str:
    """Return the body that a copy is of: `moved` calls copies ``tooth[3]``."""
    return name.partition("[")[0]


def unplaced(key: SideKey) -> SideKey:
    """Return the side of the body that a side of a copy is."""
    return replace(key, body=original(key.body))


def _carried_out(
    kinds: Sequence[Kind], first: NamedShape, others: Sequence[NamedShape], one: float
) -> tuple[NamedShape, ...]:
    shapes = (first, *others)
    filler = BOPAlgo_PaveFiller()  # all operations use it: it has to outlive them
    filler.SetArguments(listed([shape.shape for shape in shapes]))
    filler.SetRunParallel(False)
    filler.SetNonDestructive(True)
    filler.SetFuzzyValue(one)  # the kernel's own tolerance where that is more
    what = " and ".join(kinds)
    try:
        filler.Perform(Message_ProgressRange())
        if filler.HasErrors():
            raise KernelError(f"the CAD kernel could not {what} the bodies")
        return tuple(_result(kind, filler, shapes) for kind in kinds)
    except Standard_Failure as failure:
        raise KernelError(f"the CAD kernel refused to {what} the bodies: {failure}") from failure


def _result(kind: Kind, filler: BOPAlgo_PaveFiller, shapes: Sequence[NamedShape]) -> NamedShape:
    algorithm = BRepAlgoAPI_BooleanOperation(filler)
    algorithm.SetArguments(listed([shapes[0].shape]))
    algorithm.SetTools(listed([shape.shape for shape in shapes[1:]]))
    algorithm.SetOperation(_OPERATIONS[kind])
    algorithm.SetRunParallel(False)
    algorithm.Build()
    if not algorithm.IsDone():
        raise KernelError(f"the CAD kernel could not {kind} the bodies")
    return NamedShape(algorithm.Shape(), tuple(named_faces(algorithm, shapes)))


def named_faces(
    algorithm: BRepAlgoAPI_BuilderAlgo, shapes: Sequence[NamedShape]
) -> Iterator[tuple[TopoDS_Face, tuple[SideKey, ...]]]:
    """Yield the faces of the result with the names of the faces that they are parts of."""
    faces = IndexedMapOfShape()
    TopExp.MapShapes_s(algorithm.Shape(), TopAbs_FACE, faces)
    names: dict[int, list[SideKey]] = {i: [] for i in range(1, faces.Extent() + 1)}
    for face, known in (row for shape in shapes for row in shape.faces):
        for index in images(algorithm, face, faces):
            names[index] += [name for name in known if name not in names[index]]
    for index, found in names.items():
        if not found:
            raise KernelError("the CAD kernel made a face that belongs to no body")
        yield as_face(faces.FindKey(index)), tuple(found)


def images(
    algorithm: BRepAlgoAPI_BuilderAlgo, shape: TopoDS_Shape, found: IndexedMapOfShape
) -> list[int]:
    """Return the numbers, among the shapes found in a result, of what became of a shape."""
    made = shapes_in(algorithm.Modified(shape)) or [shape]
    return [index for part in made if (index := found.FindIndex(part))]


@dataclass(frozen=True, eq=False)
class NamedEdge:
    """An edge between two differently named faces."""

    edge: TopoDS_Edge
    names: tuple[tuple[SideKey, ...], tuple[SideKey, ...]]
    #: numbers of those faces in the shape, and of its vertices
    faces: tuple[int, int]
    ends: frozenset[int]
    #: what a report calls its curve
    curve: str

    @property
    def label(self) -> str:
        """What a report calls it: both faces."""
        return " / ".join(label(names) for names in self.names)

    @cached_property
    def points(self) -> Array:
        """Points along it, (PLACES, 3)."""
        first, last = self.range
        curve, places = self._curve, np.linspace(first, last, PLACES)
        return np.array([curve.Value(t).Coord() for t in places.tolist()])

    @property
    def length(self) -> float:
        """That of the polyline through its points."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    @property
    def conic(self) -> tuple[Array, dict[str, Array]] | None:
        """A line's or a conic's place and terms (`from_kernel.conic_terms`), None for others."""
        curve = self._curve
        return None if isinstance(curve, Geom_BSplineCurve) else conic_terms(curve)

    @property
    def range(self) -> tuple[float, float]:
        """The parameters of its curve at which it begins and ends."""
        first, last = BRep_Tool.Range_s(self.edge)
        return first, last

    @property
    def spline(self) -> tuple[int, int]:
        """A B-spline's degree and number of poles, zeros for others."""
        curve = self._curve
        return (curve.Degree(), curve.NbPoles()) if isinstance(curve, Geom_BSplineCurve) else (0, 0)

    def place(self, t: float) -> tuple[float, float, float]:
        """Return the place at a parameter of its curve."""
        x, y, z = self._curve.Value(t).Coord()
        return x, y, z

    def loosen(self, tolerance: float) -> None:
        """Raise the kernel's tolerance of the edge and its ends to a length, where it is less."""
        builder = BRep_Builder()
        if BRep_Tool.Tolerance_s(self.edge) < tolerance:
            builder.UpdateEdge(self.edge, tolerance)
        for vertex in (TopExp.FirstVertex_s(self.edge), TopExp.LastVertex_s(self.edge)):
            if BRep_Tool.Tolerance_s(vertex) < tolerance:
                builder.UpdateVertex(vertex, tolerance)

    @property
    def _curve(self) -> Geom_Curve:
        return BRep_Tool.Curve_s(self.edge, 0.0, 1.0)


def edges_between(shape: NamedShape) -> Iterator[NamedEdge]:
    """Yield the edges between differently named faces."""
    parents = IndexedDataMapOfShapeListOfShape()
    TopExp.MapShapesAndUniqueAncestors_s(shape.shape, TopAbs_EDGE, TopAbs_FACE, parents)
    faces, vertices = IndexedMapOfShape(), IndexedMapOfShape()
    for face, _ in shape.faces:
        faces.Add(face)
    for index in range(1, parents.Extent() + 1):
        edge = as_edge(parents.FindKey(index))
        owners = [faces.FindIndex(face) - 1 for face in shapes_in(parents.FindFromIndex(index))]
        if len(owners) == 2 and not BRep_Tool.Degenerated_s(edge):
            one, other = (shape.faces[owner] for owner in owners)
            if one[1] != other[1]:
                ends = (TopExp.FirstVertex_s(edge), TopExp.LastVertex_s(edge))
                kind = type(BRep_Tool.Curve_s(edge, 0.0, 1.0)).__name__
                yield NamedEdge(
                    edge, (one[1], other[1]), (owners[0], owners[1]),
                    frozenset(map(vertices.Add, ends)),
                    _CURVES.get(kind, kind),
                )  # fmt: skip


def edge_functions(
    shape: NamedShape, edges: Sequence[NamedEdge], origin: Array | None = None
) -> Iterator[EdgeFunction]:
    """Yield what edges hold, with the surfaces of their faces, relative to a place.

    It is `origin`, (3,), or the first edge's first point.
    """
    surfaces: dict[int, SurfaceFunction] = {}
    if origin is None:
        origin = edges[0].points[0] if edges else np.zeros(3)
    for named in edges:
        first, last = BRep_Tool.Range_s(named.edge)
        traces = []
        for index in named.faces:
            face = shape.faces[index][0]
            if index not in surfaces:
                surfaces[index] = surface_function(BRep_Tool.Surface_s(face), origin)
            path = BRep_Tool.CurveOnSurface_s(named.edge, face, first, last)
            traces.append(Trace(path_function(path), surfaces[index]))
        curve = curve_function(BRep_Tool.Curve_s(named.edge, first, last), origin)
        yield EdgeFunction(curve, (first, last), (traces[0], traces[1]))


def listed(given: Sequence[TopoDS_Shape]) -> ListOfShape:
    """Return shapes as a list of the kernel's."""
    shapes = ListOfShape()
    for shape in given:
        shapes.Append(shape)
    return shapes
