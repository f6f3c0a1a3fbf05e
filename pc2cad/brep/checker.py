"""The kernel's checker asked of a solid, without its slow search for plane wires that cross.

The checker holds the edges of a plane face against one another as pairs, and splines as polygons
of hundreds of points: for two wires of thousands of edges, or of long splines, that is nearly all
that it does. Where it is proved (`geometry.plane_chains`) that the wires of such a face are simple,
apart by more than those polygons are off, one around all others, and turned as they should be, the
kernel is asked of the wires by themselves, without searches (``BRepCheck_Analyzer`` without
geometric controls). How edges join the faces is counted here: the kernel looks for each among all
of a face. What is not proved, or refused by any of these, the kernel answers as a whole.
"""

from __future__ import annotations

from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp, TopExp_Explorer
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape

from pc2cad.brep.closed_shells import is_closed
from pc2cad.brep.convex_faces import is_convex
from pc2cad.brep.kernel import (
    IndexedMapOfShape,
    as_edge,
    as_face,
    children,
    compound,
)
from pc2cad.brep.plane_solids import PlaneSolid
from pc2cad.brep.plane_wires import TURNS, WORTH_WHILE, is_in_order, samples

#: edges of a solid from which on its faces are looked at one by one, whatever curves they are
FEW = 40


def is_valid(solid: TopoDS_Shape, plain: PlaneSolid | None = None) -> bool:
    """Return whether the kernel's checker finds a solid valid.

    `plain` are its numbers where all faces are plane and all edges straight: they may prove it, and
    a few edges are worth no other proof.
    """
    if plain is not None and is_convex(plain):
        return True
    known = (plain is None or len(plain.lines) >= FEW) and _known_valid(solid)
    return known or bool(BRepCheck_Analyzer(solid).IsValid())


def _known_valid(solid: TopoDS_Shape) -> bool:
    """Return whether a solid is found valid with a proof for some of its plane faces.

    False where there is nothing to prove, and where anything is not as it should be.
    """
    edges = IndexedMapOfShape()
    TopExp.MapShapes_s(solid, TopAbs_ShapeEnum.TopAbs_EDGE, edges)
    every = (as_edge(edges.FindKey(i)) for i in range(1, edges.Extent() + 1))
    if edges.Extent() < FEW and sum(map(samples, every)) < WORTH_WHILE:
        return False
    shells = children(solid)
    if len(shells) != 1 or shells[0].ShapeType() != TopAbs_ShapeEnum.TopAbs_SHELL:
        return False
    faces = [as_face(face) for face in children(shells[0])]
    if not all(face.Orientation() in TURNS for face in faces):
        return False
    proved, others = list[TopoDS_Shape](), list[TopoDS_Shape]()
    for face in faces:
        wires = children(face.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
        if is_in_order(face, wires):
            proved += wires
        else:
            others.append(face)
    if not proved:
        return False
    if others and not BRepCheck_Analyzer(compound(others)).IsValid():
        return False
    alone = BRepCheck_Analyzer(compound(proved), False)
    return bool(alone.IsValid()) and is_closed(len(faces), _uses(faces))


def _uses(faces: list[TopoDS_Face]) -> list[list[tuple[int, int]]]:
    """Return of each edge the faces that it bounds, and how it is walked, as `is_closed` asks.

    The kernel goes through one edge of a face after another for each edge.
    """
    edges, uses = IndexedMapOfShape(), list[list[tuple[int, int]]]()
    for number, face in enumerate(faces):
        walk = TopExp_Explorer(face, TopAbs_ShapeEnum.TopAbs_EDGE)
        while walk.More():
            edge = walk.Current()
            index = edges.Add(edge)
            if index > len(uses):
                uses.append([])
            uses[index - 1].append((number, TURNS.get(edge.Orientation(), 0)))
            walk.Next()
    return uses
