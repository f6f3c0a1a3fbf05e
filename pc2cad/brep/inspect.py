"""What the kernel says of a solid: validity, counts and tolerances."""

from __future__ import annotations

from dataclasses import dataclass

from OCP.BRep import BRep_Tool
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.TopAbs import (
    TopAbs_EDGE,
    TopAbs_FACE,
    TopAbs_SHELL,
    TopAbs_VERTEX,
    TopAbs_WIRE,
)
from OCP.TopExp import TopExp, TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Shape
from OCP.TopTools import TopTools_IndexedDataMapOfShapeListOfShape, TopTools_IndexedMapOfShape


@dataclass(frozen=True)
class KernelFindings:
    """Counts without degenerated edges; lengths in model units."""

    valid: bool
    shells: int
    faces: int
    edges: int
    vertices: int
    #: edges that do not bound exactly two face sides
    free_edges: int
    #: V - E + F - (inner wires), which is the Euler number of the surface
    euler: int
    largest_tolerance: float


def inspect(solid: TopoDS_Shape) -> KernelFindings:
    """Return what the kernel's own checker and maps say of a solid."""
    counts = {}
    for kind in (TopAbs_SHELL, TopAbs_FACE, TopAbs_EDGE, TopAbs_VERTEX, TopAbs_WIRE):
        shapes = TopTools_IndexedMapOfShape()
        TopExp.MapShapes_s(solid, kind, shapes)
        counts[kind] = shapes
    edges, free = _edges(solid)
    faces, wires = counts[TopAbs_FACE].Size(), counts[TopAbs_WIRE].Size()
    vertices = counts[TopAbs_VERTEX].Size()
    return KernelFindings(
        bool(BRepCheck_Analyzer(solid).IsValid()), counts[TopAbs_SHELL].Size(), faces, edges,
        vertices, free, vertices - edges + faces - (wires - faces), _largest_tolerance(counts),
    )  # fmt: skip


def _edges(solid: TopoDS_Shape) -> tuple[int, int]:
    """Return the number of edges, and of those not used twice; degenerated ones do not count."""
    parents = TopTools_IndexedDataMapOfShapeListOfShape()
    TopExp.MapShapesAndAncestors_s(solid, TopAbs_EDGE, TopAbs_FACE, parents)
    uses: dict[int, int] = {}
    explorer = TopExp_Explorer(solid, TopAbs_EDGE)
    while explorer.More():
        index = parents.FindIndex(explorer.Current())
        uses[index] = uses.get(index, 0) + 1
        explorer.Next()
    real = [i for i in uses if not BRep_Tool.Degenerated_s(TopoDS.Edge_s(parents.FindKey(i)))]
    return len(real), sum(uses[i] != 2 for i in real)


def _largest_tolerance(counts: dict[object, TopTools_IndexedMapOfShape]) -> float:
    casts = {
        TopAbs_FACE: TopoDS.Face_s,
        TopAbs_EDGE: TopoDS.Edge_s,
        TopAbs_VERTEX: TopoDS.Vertex_s,
    }
    largest: float = max(
        BRep_Tool.Tolerance_s(cast(counts[kind].FindKey(i)))
        for kind, cast in casts.items()
        for i in range(1, counts[kind].Size() + 1)
    )
    return largest
