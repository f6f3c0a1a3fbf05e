"""What the kernel says of a solid: validity, counts and tolerances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepCheck import BRepCheck_Analyzer, BRepCheck_Result, BRepCheck_Status
from OCP.TopAbs import (
    TopAbs_EDGE,
    TopAbs_FACE,
    TopAbs_SHELL,
    TopAbs_VERTEX,
    TopAbs_WIRE,
)
from OCP.TopExp import TopExp, TopExp_Explorer
from OCP.TopoDS import TopoDS_Shape

from pc2cad.arrays import Array
from pc2cad.brep.checker import is_valid
from pc2cad.brep.kernel import (
    IndexedMapOfShape,
    as_edge,
)
from pc2cad.brep.plane_solids import WIRE, PlaneSolid


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


def inspect(solid: TopoDS_Shape, plain: PlaneSolid | None = None) -> KernelFindings:
    """Return what the kernel's own checker and maps say of a solid.

    `plain` are its numbers where they have been read: they tell all that the maps would.
    """
    found = _counted(solid, plain)
    if found is not None:
        return found
    counts = {}
    for kind in (TopAbs_SHELL, TopAbs_FACE, TopAbs_EDGE, TopAbs_VERTEX, TopAbs_WIRE):
        shapes = IndexedMapOfShape()
        TopExp.MapShapes_s(solid, kind, shapes)
        counts[kind] = shapes
    edges, free = _edges(solid, counts[TopAbs_EDGE])
    faces, wires = counts[TopAbs_FACE].Size(), counts[TopAbs_WIRE].Size()
    vertices = counts[TopAbs_VERTEX].Size()
    return KernelFindings(
        is_valid(solid), counts[TopAbs_SHELL].Size(), faces, edges,
        vertices, free, vertices - edges + faces - (wires - faces), _largest_tolerance(solid),
    )  # fmt: skip


def _counted(solid: TopoDS_Shape, plain: PlaneSolid | None) -> KernelFindings | None:
    """Return what is found of a solid with plane faces and straight edges in one shell."""
    if plain is None or plain.walks is None:
        return None
    uses = np.bincount(plain.walks[0], minlength=len(plain.lines)).tolist()
    vertices, edges, faces = len(plain.points), len(uses), len(plain.planes)
    wires = plain.count(WIRE)
    return KernelFindings(
        is_valid(solid, plain), 1, faces, edges, vertices, edges - uses.count(2),
        vertices - edges + faces - (wires - faces), plain.tolerance,
    )  # fmt: skip


def crossing_wires(solid: TopoDS_Shape) -> list[TopoDS_Shape]:
    """Return the faces whose wires the kernel's checker takes to cross themselves.

    Empty where it complains of anything else as well, or where the kernel does not tell of what:
    OCP 8 does not bind its lists of complaints.
    """
    checker, found = BRepCheck_Analyzer(solid), []
    fine = BRepCheck_Status.BRepCheck_NoError
    allowed = {
        TopAbs_WIRE: {fine, BRepCheck_Status.BRepCheck_SelfIntersectingWire},
        # what follows from it
        TopAbs_FACE: {fine, BRepCheck_Status.BRepCheck_UnorientableShape},
    }
    for kind in (TopAbs_SHELL, TopAbs_WIRE, TopAbs_EDGE, TopAbs_VERTEX, TopAbs_FACE):
        shapes = IndexedMapOfShape()
        TopExp.MapShapes_s(solid, kind, shapes)
        for index in range(1, shapes.Size() + 1):
            shape = shapes.FindKey(index)
            try:
                told = _told(checker.Result(shape))
            except TypeError:
                return []
            if not told <= allowed.get(kind, {fine}):
                return []
            if kind == TopAbs_FACE and told - {fine}:
                found.append(shape)
    return found


def _told(result: BRepCheck_Result) -> set[BRepCheck_Status]:
    """Return what the checker says of a shape, by itself and in all that it is part of."""
    told = set(result.Status())
    result.InitContextIterator()
    while result.MoreShapeInContext():
        told |= set(result.StatusOnShape())
        result.NextShapeInContext()
    return told


def bounding_box(solid: TopoDS_Shape) -> Array:
    """Return the least and the largest coordinates of a solid, (2, 3), of its geometry.

    No triangles are looked at; the kernel searches for them to about its own 1e-7.
    """
    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(solid, box, False, False)
    box.SetGap(0.0)
    found = np.array([box.CornerMin().Coord(), box.CornerMax().Coord()])
    # the kernel takes what is that near for the same, whatever the unit
    return np.where(np.abs(found) < 2e-7, 0.0, found)


def _edges(solid: TopoDS_Shape, edges: IndexedMapOfShape) -> tuple[int, int]:
    """Return the number of edges, and of those not used twice; degenerated ones do not count."""
    uses = [0] * (edges.Size() + 1)
    explorer = TopExp_Explorer(solid, TopAbs_EDGE)
    while explorer.More():
        uses[edges.FindIndex(explorer.Current())] += 1
        explorer.Next()
    real = [
        uses[i]
        for i in range(1, len(uses))
        if not BRep_Tool.Degenerated_s(as_edge(edges.FindKey(i)))
    ]
    return len(real), len(real) - real.count(2)


def _largest_tolerance(solid: TopoDS_Shape) -> float:
    kinds = TopAbs_FACE, TopAbs_EDGE, TopAbs_VERTEX
    return max([float(BRep_Tool.MaxTolerance_s(solid, kind)) for kind in kinds])
