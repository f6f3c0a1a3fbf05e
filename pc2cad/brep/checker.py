"""The kernel's checker asked of a solid, without its slow search for plane wires that cross.

The checker holds the edges of a plane face against one another as pairs, and splines as polygons
of hundreds of points: for two wires of thousands of edges, or of long splines, that is nearly all
that it does. Where it is proved (`geometry.plane_chains`) that the wires of such a face are simple,
apart by more than those polygons are off, and one around all others, the kernel is asked all the
rest: each wire in a face of its own and without searches (``BRepCheck_Analyzer`` without geometric
controls), and shell and solid as they are. What is not proved, or refused by any of these, the
kernel answers as a whole.
"""

from __future__ import annotations

from OCP.BRep import BRep_Builder
from OCP.BRepCheck import BRepCheck_Analyzer, BRepCheck_Shell, BRepCheck_Status
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape

from pc2cad.brep.kernel import (
    IndexedMapOfShape,
    as_edge,
    as_face,
    as_shell,
    children,
    compound,
)
from pc2cad.brep.plane_wires import WORTH_WHILE, outer_wire, samples

#: edges of a solid from which on its faces are looked at one by one, whatever curves they are
FEW = 40
_ORIENTED = (TopAbs_Orientation.TopAbs_FORWARD, TopAbs_Orientation.TopAbs_REVERSED)


def is_valid(solid: TopoDS_Shape) -> bool:
    """Return whether the kernel's checker finds a solid valid."""
    return _known_valid(solid) or bool(BRepCheck_Analyzer(solid).IsValid())


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
    if not all(face.Orientation() in _ORIENTED for face in faces):
        return False
    alone, others = [], []
    for face in faces:
        wires = children(face.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
        outer = outer_wire(face, wires)
        if outer is None:
            others.append(face)
        else:
            alone += _alone(face, wires, outer)
    if not alone:
        return False
    if others and not BRepCheck_Analyzer(compound(others)).IsValid():
        return False
    return bool(BRepCheck_Analyzer(compound(alone), False).IsValid()) and _is_closed(shells[0])


def _is_closed(shape: TopoDS_Shape) -> bool:
    """Return what ``BRepCheck_Shell::InContext`` asks of a shell of a solid."""
    shell = BRepCheck_Shell(as_shell(shape))
    fine = BRepCheck_Status.BRepCheck_NoError
    return bool(shell.Closed() == fine and shell.Orientation() == fine)


def _alone(face: TopoDS_Face, wires: list[TopoDS_Shape], outer: int) -> list[TopoDS_Shape]:
    """Return faces of one wire each, holes turned to be the outer wires of theirs."""
    result, builder = [], BRep_Builder()
    for i, wire in enumerate(wires):
        one = face.EmptyCopied().Oriented(TopAbs_Orientation.TopAbs_FORWARD)
        builder.Add(one, wire if i == outer else wire.Reversed())
        result.append(one)
    return result
