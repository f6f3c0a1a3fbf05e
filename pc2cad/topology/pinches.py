"""Where a closed boundary touches itself in a vertex: no neighbourhood of it is a disc."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from pc2cad.topology.complex import BoundaryComplex, EdgeUse

#: an edge class, and which end of it
_End = tuple[int, bool]


@dataclass(frozen=True)
class Pinch:
    """A vertex where several sheets of the boundary meet: for each, the faces round it."""

    vertex: int
    sheets: tuple[tuple[int, ...], ...]


def pinches(complex_: BoundaryComplex, faces: Iterable[int]) -> list[Pinch]:
    """Return the vertices round which a closed surface of some faces goes more than once.

    Every edge is used twice by the faces, so the corners at a vertex, each of which leads from one
    edge to another, make closed walks: one where the surface is a disc there.
    """
    corners: dict[int, list[tuple[int, set[_End]]]] = {}
    for face in faces:
        for vertex, ends in _corners(complex_.faces[face].uses):
            corners.setdefault(vertex, []).append((face, ends))
    found = []
    for vertex, here in corners.items():
        walks: list[tuple[set[int], set[_End]]] = []
        for face, ends in here:
            joined = [walk for walk in walks if walk[1] & ends]
            walks = [walk for walk in walks if not walk[1] & ends]
            together = set().union({face}, *(walk[0] for walk in joined))
            walks.append((together, set().union(ends, *(walk[1] for walk in joined))))
        if len(walks) > 1:
            found.append(Pinch(vertex, tuple(tuple(sorted(walk[0])) for walk in walks)))
    return found


def _corners(uses: tuple[EdgeUse, ...]) -> list[tuple[int, set[_End]]]:
    """Return the corners of a face: the vertex, and the ends of the edges on both sides of it.

    Sides that are a point are passed over; a face of nothing else has no corners.
    """
    walk = [use for use in uses if use.edge is not None]
    found = []
    for before, after in zip(walk[-1:] + walk[:-1], walk, strict=True):
        assert before.edge is not None
        assert after.edge is not None
        ends = {(before.edge, before.forward), (after.edge, not after.forward)}
        found.append((after.vertex, ends))
    return found
