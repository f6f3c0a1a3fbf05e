"""Whether a solid of convex polygons is what the kernel's checker wants, proved from its numbers.

What the checker (``BRepCheck_Analyzer``, OCCT 7.9 and 8.0) asks of a solid whose faces are planes
with one wire of straight edges without curves on them, and what answers it here:

- edges run forward along their line, and end at their vertices: their numbers;
- edges lie on the planes, as far as their projections: both ends do, and lines lean by nothing;
- wires are closed, each edge once: topology, each vertex of a face begins one edge and ends one;
- no edges of a face cross or touch but at their common vertex, and the face is to their left: all
  other vertices of the face are to the left of each edge, and away from its line. Each edge is then
  one of the convex hull's, and these make one wire, run through counterclockwise;
- neighbours meet at their vertex: where they are off by little, and turn by enough;
- the shell is closed and oriented: each edge is used twice, once either way, and faces hang
  together.

What is not proved is left to the kernel.

Readers that mend (``ShapeFix_Solid``, ``ShapeFix_Shell``, ``_Face`` and ``_Wire``) have nothing to
do here. Wires are in order, joined by their vertices, run through counterclockwise and the only
ones of their faces; edges do not cross, do not turn back, and are longer than 100 tolerances, as a
corner is that far from the edge after its own; vertices cover the ends of edges; faces are turned
as their neighbours want them; planes have no seams, periods or singular places, and need no curves
on them. What is left is whether the shell is inside out: `is_convex_body`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from operator import itemgetter

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.brep.closed_shells import is_closed
from pc2cad.brep.plane_solids import USE, WIRE, PlaneSolid, Topology, is_one_shell
from pc2cad.brep.tolerance import WELL_WITHIN

#: corners of a face beyond which pairs of them are too many
MOST_CORNERS = 12
#: to which the kernel finds where edges meet (``BRepCheck_Wire::SelfIntersect``)
_MEETING = 1e-10
#: how many of its tolerances a vertex must be away from the edges that are not its own
_AWAY = 100.0


@lru_cache(maxsize=4)
def is_convex(solid: PlaneSolid) -> bool:
    """Return whether a solid is proved to be what the kernel's checker finds valid.

    The same numbers are asked again where they are written.
    """
    found = _corners(solid.topology)
    if found is None:
        return False
    ends = solid.lines[:, None, :3] + solid.ranges[..., None] * solid.lines[:, None, 3:]
    frames, begin = solid.planes[found.face], solid.points[found.first]
    ways = solid.lines[found.edge, 3:] * found.turn
    leans, along, up = np.matmul(frames[:, 3:].reshape(-1, 3, 3), ways[..., None])[..., 0].T
    left = along[:, None] * frames[:, 9:] - up[:, None] * frames[:, 6:9]
    height = ((begin - frames[:, :3]) * frames[:, 3:6]).sum(axis=1)
    turns = (left * ways[found.after]).sum(axis=1)
    away = (left[found.side] * (solid.points[found.other] - begin[found.side])).sum(axis=1)
    gap = 2 * float(np.abs(ends - solid.points[found.ends]).max())
    lean, turn = float(np.abs(leans).max()), float(turns.min())
    return bool(
        (solid.ranges[:, 0] < solid.ranges[:, 1]).all()
        and gap + float(np.abs(height).max()) <= WELL_WITHIN
        # a projection is as much shorter, from where the line's numbers begin
        and lean * lean * float(np.abs(solid.ranges).max()) <= WELL_WITHIN
        and gap + _MEETING <= WELL_WITHIN * turn
        and away.min() >= _AWAY * solid.tolerance
    )


def is_convex_body(solid: PlaneSolid) -> bool:
    """Return whether a solid that `is_convex` is proved to lie on the inner side of each face.

    Then it is not inside out: a line from outside enters where it first meets a face.
    """
    found = _corners(solid.topology)
    if found is None:
        return False
    outwards = solid.planes[:, 3:6] * found.outward
    height = solid.points @ outwards.T - (solid.planes[:, :3] * outwards).sum(axis=1)
    return bool(height.max() <= WELL_WITHIN)


@dataclass(frozen=True, eq=False)
class _Corners:
    """How the sides of faces follow each other, each walked around its plane's normal."""

    #: the vertices at which each edge begins and ends (m, 2)
    ends: Integers
    #: of each side its edge and its face, 1 or -1 as it is walked (n, 1), the vertex where it
    #: begins, and the side that follows
    edge: Integers
    face: Integers
    turn: Array
    first: Integers
    after: Integers
    #: sides, each with a vertex of its face that is none of its ends
    side: Integers
    other: Integers
    #: of each face 1 or -1: how its plane's normal is turned to point out of the solid (k, 1)
    outward: Array


#: a part and how it is turned, 1 where it is reversed
_Part = tuple[int, int]


@lru_cache(maxsize=16)
def _corners(topology: Topology) -> _Corners | None:
    """Return how faces are bounded; None where they are not one closed shell of simple polygons.

    The topology of a solid that is read back is the same, and so are those of most variants.
    """
    edges, faces, kinds, _, _ = topology
    parts = _parts(topology)
    sides = None if parts is None else _sides(parts, topology)
    if parts is None or sides is None or not is_closed(len(sides), _uses(parts[-2], sides)):
        return None
    numbers = [dict(zip(of, range(len(of)), strict=True)) for of in map(_where, (edges, faces))]
    vertices = [not (e or f or k) for e, f, k in zip(edges, faces, kinds, strict=True)]
    number = dict(zip(_where(vertices), range(len(vertices)), strict=False))
    rows, pairs = list[tuple[int, ...]](), list[tuple[int, int]]()
    for (face, _), polygon in zip(parts[-2], sides, strict=True):
        first, count = len(rows), len(polygon)
        corners = [number[parts[edge][back][0]] for edge, back in polygon]
        for i, (edge, back) in enumerate(polygon):
            after = first + (i + 1) % count
            rows.append((numbers[0][edge], numbers[1][face], 1 - 2 * back, corners[i], after))
            pairs += [(first + i, corners[(i + k) % count]) for k in range(2, count)]
    ends = [[number[vertex] for vertex, _ in parts[edge]] for edge in numbers[0]]
    edge_, face_, turn, begin, after_ = np.array(rows).T
    # as the faces are turned in the shell, this in the solid, and it in its place
    about = parts[-1][0][1] ^ topology[-1][0]
    turned = {numbers[1][face]: 1.0 - 2.0 * (turn ^ about) for face, turn in parts[-2]}
    outward = np.array([[turned[face]] for face in range(len(turned))])
    side, other = np.array(pairs).T
    return _Corners(
        np.array(ends), edge_, face_, turn[:, None].astype(float), begin, after_, side, other,
        outward,
    )  # fmt: skip


def _where(flags: Sequence[object]) -> list[int]:
    return [i for i, flag in enumerate(flags) if flag]


def _parts(topology: Topology) -> list[list[_Part]] | None:
    """Return what each shape is made of, edges from where they begin.

    None unless it is one solid of one shell, and nothing is internal.
    """
    if not is_one_shell(topology):
        return None
    *lists, _ = topology
    count, result = len(lists[2]), []
    for edge, face, _, other in zip(*lists, strict=True):
        uses = np.frombuffer(edge or face or other, USE)
        # the kernel counts from the last
        found = list(zip((count - uses["part"]).tolist(), uses["turn"].tolist(), strict=True))
        if any(turn > 1 for _, turn in found):
            return None
        result.append(sorted(found, key=itemgetter(1)) if edge else found)
    return result if [part for part, _ in result[-1]] == [count - 2] else None


def _sides(parts: list[list[_Part]], topology: Topology) -> list[list[_Part]] | None:
    """Return the edges of each face as they are walked around its plane's normal.

    None unless there are faces, each once and with one wire, of edges that end at the vertex that
    the next one begins at, and comes by no vertex twice.
    """
    edges, faces, kinds, _, _ = topology
    if not parts[-2] or len({face for face, _ in parts[-2]}) < len(parts[-2]):
        return None
    result = []
    for face, _ in parts[-2]:
        if not faces[face] or len(parts[face]) != 1 or kinds[parts[face][0][0]] != WIRE:
            return None
        wire, about = parts[face][0]
        sides = [(edge, back ^ about) for edge, back in parts[wire]]
        if about:
            sides.reverse()
        if not 3 <= len(sides) <= MOST_CORNERS or not all(edges[edge] for edge, _ in sides):
            return None
        if any([turn for _, turn in parts[edge]] != [0, 1] for edge, _ in sides):
            return None
        begins = [parts[edge][back][0] for edge, back in sides]
        ends = [parts[edge][1 - back][0] for edge, back in sides]
        if ends != begins[1:] + begins[:1] or len(set(begins)) < len(begins):
            return None
        result.append(sides)
    return result


def _uses(faces: list[_Part], sides: list[list[_Part]]) -> list[list[tuple[int, int]]]:
    """Return of each edge the faces that it bounds, and how it is walked, as `is_closed` asks."""
    uses = dict[int, list[tuple[int, int]]]()
    for number, ((_, turn), polygon) in enumerate(zip(faces, sides, strict=True)):
        for edge, back in polygon:
            uses.setdefault(edge, []).append((number, 1 - 2 * (turn ^ back)))
    return [*uses.values()]
