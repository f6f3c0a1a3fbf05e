"""Cells with equal corners become elements of fewer nodes.

A hexahedron one face of which collapses to an edge is a wedge, to a point a pyramid; two such make
a tetrahedron. What else is left over has to be cut (module `cutting`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from pc2cad.mesh.elements import HEXAHEDRON, PYRAMID, TETRAHEDRON, WEDGE, ElementType

#: per corner of a hexahedron, the first corner that is the same node
Pattern = tuple[int, ...]
#: corners of a face in their order, each the first of those that are the same node
Ring = tuple[int, ...]


@dataclass(frozen=True)
class Piece:
    """One element made of a cell: its type and, per corner, the cell corners it stands for."""

    kind: ElementType
    corners: tuple[tuple[int, ...], ...]

    def middle(self, edge: int) -> tuple[int, int]:
        """Return two corners of the cell, as near as can be, whose middle is that of an edge."""
        a, b = self.kind.edges[edge]
        return nearest(self.corners[a], self.corners[b])

    def on_face(self, face: int) -> tuple[int, ...]:
        """Return which of the element's faces lie on a face of the cell."""
        allowed = set(HEXAHEDRON.faces[face])
        return tuple(
            number
            for number, ring in enumerate(self.kind.faces)
            if all(allowed & set(self.corners[corner]) for corner in ring)
        )


def nearest(first: tuple[int, ...], second: tuple[int, ...]) -> tuple[int, int]:
    """Return the corners of a cell, one of either group, with the fewest edges between them."""
    pairs = [(i, j) for i in first for j in second]
    return min(pairs, key=lambda pair: (_steps(*pair), pair))


def _steps(i: int, j: int) -> int:
    return sum(a != b for a, b in zip(HEXAHEDRON.corners[i], HEXAHEDRON.corners[j], strict=True))


def pattern_of(nodes: list[int]) -> Pattern:
    """Return which of the eight corners of a cell are the same node."""
    return tuple(nodes.index(node) for node in nodes)


def groups(pattern: Pattern) -> dict[int, tuple[int, ...]]:
    """Return the corners that are one node, by the first of them."""
    return {first: tuple(k for k in range(8) if pattern[k] == first) for first in set(pattern)}


def rings(pattern: Pattern) -> list[Ring]:
    """Return the faces that have three corners or four left; a corner that comes twice is one."""
    return [ring for face in HEXAHEDRON.faces if len(ring := ring_of(face, pattern)) > 2]


def ring_of(face: tuple[int, ...], pattern: Pattern) -> Ring:
    """Return what is left of a face."""
    nodes = [pattern[k] for k in face]
    return tuple(node for k, node in enumerate(nodes) if node != nodes[k - 1])


def is_flat(pattern: Pattern) -> bool:
    """Say whether the faces of a cell cover one another: it has no inside."""
    faces = [frozenset(ring) for ring in rings(pattern)]
    return all(faces.count(face) % 2 == 0 for face in faces)


@lru_cache(maxsize=256)
def single(pattern: Pattern) -> Piece | None:
    """Return the one element that a cell with these equal corners is, None where it is none."""
    if pattern == tuple(range(8)):
        return Piece(HEXAHEDRON, tuple((k,) for k in pattern))
    faces, classes = rings(pattern), groups(pattern)
    if is_flat(pattern) or any(len(set(ring)) < len(ring) for ring in faces):
        return None
    made = _wedge(faces) or _cone(faces, sorted(classes))
    return Piece(made[0], tuple(classes[k] for k in made[1])) if made else None


_Made = tuple[ElementType, tuple[int, ...]] | None


def _wedge(faces: list[Ring]) -> _Made:
    triangles = [ring for ring in faces if len(ring) == 3]
    if len(faces) != 5 or len(triangles) != 2 or set(triangles[0]) & set(triangles[1]):
        return None
    first, second = triangles
    quads = [ring for ring in faces if len(ring) == 4]
    linked = {frozenset((ring[k - 1], ring[k])) for ring in quads for k in range(4)}
    low = (first[0], first[2], first[1])
    top = tuple(next(b for b in second if frozenset((a, b)) in linked) for a in low)
    return WEDGE, low + top


def _cone(faces: list[Ring], corners: list[int]) -> _Made:
    """Return a pyramid or tetrahedron where all faces but one meet in a corner, uncut."""
    for apex in corners:
        away = [ring for ring in faces if apex not in ring]
        round_it = [ring for ring in faces if apex in ring]
        if len(away) == 1 and all(len(ring) == 3 for ring in round_it):
            return over(away[0], apex)
    return None


def over(ring: Ring, apex: int) -> tuple[ElementType, tuple[int, ...]]:
    """Return the element over a face that is seen from outside, up to an apex inside."""
    return PYRAMID if len(ring) == 4 else TETRAHEDRON, (ring[0], *ring[:0:-1], apex)
