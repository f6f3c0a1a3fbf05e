"""How faces hang together at the edges and vertices of a shape that the kernel has made.

At an edge of a solid's boundary two faces meet, and round a vertex they make one disc. Where bodies
touch, and the kernel has seen it, an edge has four faces, or the faces at a vertex fall apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from OCP.BRep import BRep_Tool
from OCP.TopAbs import TopAbs_EDGE, TopAbs_VERTEX, TopAbs_WIRE
from OCP.TopExp import TopExp, TopExp_Explorer
from OCP.TopoDS import TopoDS_Shape

from pc2cad.brep.booleans import NamedShape
from pc2cad.brep.kernel import IndexedMapOfShape, as_edge, as_vertex


@dataclass(frozen=True)
class Branching:
    """An edge or a vertex at which a boundary branches."""

    #: numbers of the faces that meet there in the shape
    faces: tuple[int, ...]
    #: the vertex, or the middle of the edge
    point: tuple[float, float, float]
    is_edge: bool


def branchings(shape: NamedShape) -> Iterator[Branching]:
    """Yield the edges that more than two faces use, then the vertices round which sheets part."""
    edges, vertices = IndexedMapOfShape(), IndexedMapOfShape()
    TopExp.MapShapes_s(shape.shape, TopAbs_EDGE, edges)
    TopExp.MapShapes_s(shape.shape, TopAbs_VERTEX, vertices)
    uses: dict[int, list[int]] = {}
    #: of each vertex: a face, and the edges of one of its wires that end there
    corners: dict[int, list[tuple[int, set[int]]]] = {}
    for number, (face, _) in enumerate(shape.faces):
        own = IndexedMapOfShape()
        TopExp.MapShapes_s(face, TopAbs_VERTEX, own)
        bare = {vertices.FindIndex(own.FindKey(i)) for i in range(1, own.Extent() + 1)}
        for wire in _explored(face, TopAbs_WIRE):
            ends: dict[int, set[int]] = {}
            for part in _explored(wire, TopAbs_EDGE):
                edge = as_edge(part)
                index, real = edges.FindIndex(edge), not BRep_Tool.Degenerated_s(edge)
                if real:
                    uses.setdefault(index, []).append(number)
                for vertex in (TopExp.FirstVertex_s(edge), TopExp.LastVertex_s(edge)):
                    ends.setdefault(vertices.FindIndex(vertex), set()).update(
                        {index} if real else ()
                    )
            for vertex_number, found in ends.items():
                corners.setdefault(vertex_number, []).append((number, found))
                bare.discard(vertex_number)
        for vertex_number in bare:  # inside the face
            corners.setdefault(vertex_number, []).append((number, set()))
    for index, at in uses.items():
        if len(at) > 2:
            edge = as_edge(edges.FindKey(index))
            first, last = BRep_Tool.Range_s(edge)
            middle = BRep_Tool.Curve_s(edge, first, last).Value((first + last) / 2).Coord()
            yield Branching(tuple(sorted(set(at))), middle, is_edge=True)
    for index, here in corners.items():
        if _sheets(here) > 1:
            point = BRep_Tool.Pnt_s(as_vertex(vertices.FindKey(index))).Coord()
            yield Branching(tuple(sorted({face for face, _ in here})), point, is_edge=False)


def _sheets(corners: list[tuple[int, set[int]]]) -> int:
    """Return into how many parts the corners at a vertex fall that edges join."""
    parts: list[set[int]] = []
    for _, edges in corners:
        joined = [part for part in parts if part & edges]
        parts = [part for part in parts if not part & edges]
        parts.append(edges.union(*joined))
    return len(parts)


def _explored(shape: TopoDS_Shape, kind: object) -> Iterator[TopoDS_Shape]:
    explorer = TopExp_Explorer(shape, kind)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()
