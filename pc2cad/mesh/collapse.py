"""Cells with equal corners become elements of fewer nodes.

A hexahedron one face of which collapses to an edge is a wedge, to a point a pyramid; two such make
a tetrahedron. What is left over is cut into pyramids and tetrahedra with a common apex, so that
neighbours that share the apex agree on every cut.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from pc2cad.mesh.elements import HEXAHEDRON, PYRAMID, TETRAHEDRON, WEDGE, ElementType

#: per corner of a hexahedron, the first corner that is the same node
Pattern = tuple[int, ...]


@dataclass(frozen=True)
class Piece:
    """One element made of a cell: its type and, per corner, the cell corners it stands for."""

    kind: ElementType
    corners: tuple[tuple[int, ...], ...]

    def middle(self, edge: int) -> tuple[int, int]:
        """Return two corners of the cell, as near as can be, whose middle is that of an edge."""
        a, b = self.kind.edges[edge]
        pairs = [(i, j) for i in self.corners[a] for j in self.corners[b]]
        return min(pairs, key=lambda pair: (_steps(*pair), pair))

    def on_face(self, face: int) -> int | None:
        """Return which of the element's faces lies on a face of the cell, if one does."""
        allowed = set(HEXAHEDRON.faces[face])
        for number, ring in enumerate(self.kind.faces):
            if all(allowed & set(self.corners[corner]) for corner in ring):
                return number
        return None


def _steps(i: int, j: int) -> int:
    return sum(a != b for a, b in zip(HEXAHEDRON.corners[i], HEXAHEDRON.corners[j], strict=True))


@lru_cache(maxsize=256)
def pieces(pattern: Pattern) -> tuple[Piece, ...]:
    """Return the elements of a cell with these equal corners; none where nothing is left of it."""
    if pattern == tuple(range(8)):
        return (Piece(HEXAHEDRON, tuple((k,) for k in pattern)),)
    classes = {first: tuple(k for k in range(8) if pattern[k] == first) for first in set(pattern)}
    faces = [ring for face in HEXAHEDRON.faces if len(ring := _ring(face, pattern)) > 2]
    if any(len(set(ring)) < len(ring) for ring in faces):
        return ()
    made = _wedge(faces) or _apex_pieces(faces, classes)
    return tuple(Piece(kind, tuple(classes[k] for k in corners)) for kind, corners in made)


def _ring(face: tuple[int, ...], pattern: Pattern) -> tuple[int, ...]:
    nodes = [pattern[k] for k in face]
    return tuple(node for k, node in enumerate(nodes) if node != nodes[k - 1])


_Made = list[tuple[ElementType, tuple[int, ...]]]


def _wedge(faces: list[tuple[int, ...]]) -> _Made:
    triangles = [ring for ring in faces if len(ring) == 3]
    if len(faces) != 5 or len(triangles) != 2 or set(triangles[0]) & set(triangles[1]):
        return []
    first, second = triangles
    quads = [ring for ring in faces if len(ring) == 4]
    linked = {frozenset((ring[k - 1], ring[k])) for ring in quads for k in range(4)}
    low = (first[0], first[2], first[1])
    top = tuple(next(b for b in second if frozenset((a, b)) in linked) for a in low)
    return [(WEDGE, low + top)]


def _apex_pieces(faces: list[tuple[int, ...]], classes: dict[int, tuple[int, ...]]) -> _Made:
    """Cut into the pyramids over all faces that do not hold the apex."""

    def cuts(node: int) -> tuple[int, int, int]:
        return sum(node in ring and len(ring) == 4 for ring in faces), -len(classes[node]), node

    apex = min(classes, key=cuts)
    made: _Made = []
    for ring in faces:
        if apex in ring:
            continue
        base = (ring[0], *ring[:0:-1])
        made.append((PYRAMID if len(ring) == 4 else TETRAHEDRON, (*base, apex)))
    return made
