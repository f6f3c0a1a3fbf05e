"""Plane faces: which patches make up one, and the wires that bound it.

A side whose direction has creases comes in several patches. Those that lie in one plane are one
face: the edges between them are dropped, as seams are.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from pc2cad.domain.analysis import Analysis
from pc2cad.geometry.carriers import Arc, Evidence, Line, Plane
from pc2cad.representation.boundary_model import ModelEdge, ModelFace, Wire
from pc2cad.topology.cells import DIRECTIONS, Cell, SideKey, directions_of, normal_direction
from pc2cad.topology.complex import BoundaryComplex, EdgeUse

#: planes that differ by less (as an angle) are one: what a least-squares fit of samples leaves
SAME_PLANE = 1e-10
#: places by which a face's length is measured
_PLACES = 257


def coplanar_groups(
    analysis: Analysis, planes: Sequence[Plane | None], across: bool = False
) -> list[tuple[int, ...]]:
    """Return the faces in groups: patches of one side that meet in an edge and share a plane.

    Those of different layers stay apart, and those that the analysis has cut there, if groups do
    not go `across`.
    """
    boundary = analysis.complex
    group = list(range(len(planes)))

    def find(i: int) -> int:
        while group[i] != i:
            i = group[i]
        return i

    pairs = (
        pair
        for uses in boundary.edge_uses().values()
        for pair in combinations([face for face, _ in uses], 2)
    )
    for first, second in pairs:
        a, b = planes[first], planes[second]
        if a is None or b is None:
            continue
        one, other = boundary.faces[first].patch, boundary.faces[second].patch
        if _side(one) != _side(other):
            continue
        if not across and _parted(analysis, one, other):
            continue
        if a.normal @ b.normal > 0 and np.abs(np.cross(a.normal, b.normal)).max() < SAME_PLANE:
            group[find(second)] = find(first)
    members: dict[int, list[int]] = {}
    for i in range(len(planes)):
        members.setdefault(find(i), []).append(i)
    return [tuple(members[root]) for root in sorted(members)]


def _parted(analysis: Analysis, first: Cell, second: Cell) -> bool:
    """Say whether a limit at which faces or layers end lies between two patches."""
    if analysis.complex.layers and first[2] != second[2]:
        return True
    for row, apart, a, b in zip(analysis.bounds, analysis.apart, first, second, strict=True):
        low, high = sorted((a // 2, b // 2))
        if not set(apart).isdisjoint(row[low + 1 : high + 1]):
            return True
    return False


def _side(patch: Cell) -> tuple[int, int]:
    d = normal_direction(patch)
    return d, patch[d]


def longer_direction(analysis: Analysis, cells: Sequence[int]) -> int:
    """Return the direction of the box along which a face of patches of one side is longer."""
    patches = [analysis.complex.faces[i].patch for i in cells]
    lengths = {}
    for along in directions_of(patches[0]):
        spans = [[analysis.span(d, patch[d]) for patch in patches] for d in DIRECTIONS]
        places = [np.array([sum(map(sum, rows)) / (2 * len(rows))]) for rows in spans]
        places[along] = np.linspace(min(spans[along])[0], max(spans[along])[1], _PLACES)
        steps = np.diff(analysis.map.points(*places), axis=0)
        lengths[along] = float(np.linalg.norm(steps, axis=-1).sum())
    return max(lengths, key=lambda d: lengths[d])


def plane_face(
    group: tuple[int, ...],
    plane: tuple[Plane, Evidence],
    boundary: BoundaryComplex,
    inward: bool,
    edges: list[ModelEdge],
) -> ModelFace:
    """Return the face that covers a group of patches in one plane.

    `inward`: M_s × M_t points into the solid there, so that the patches' walks turn round.
    """
    uses = tuple(use for index in group for use in boundary.faces[index].uses)
    key = _key(group, boundary)
    counts = Counter(use.edge for use in uses)
    walk = [
        (use.edge, use.forward != inward)
        for use in uses
        if use.edge is not None and counts[use.edge] == 1
    ]
    carrier, evidence = plane
    against = _against(carrier, walk, edges)
    if against:
        carrier = Plane(carrier.origin, -carrier.normal)
        walk = [(edge, not forward) for edge, forward in walk]
    wires = _chains(walk, boundary, edges)
    return ModelFace(key, group, carrier, uses, wires, (), False, against, evidence, 0.0, 0)


def _key(group: tuple[int, ...], boundary: BoundaryComplex) -> SideKey:
    """Return the key of a face of several patches: what they share tells them from others."""
    patches = [boundary.faces[i].patch for i in group]
    shared = [d for d in DIRECTIONS if len({patch[d] for patch in patches}) == 1]
    if boundary.faces_beside(patches[0], shared) > len(group):
        return boundary.key(patches[0])
    d = normal_direction(patches[0])
    every = boundary.faces_beside(patches[0], [d])
    alone = [k for k in shared if k != d and boundary.faces_beside(patches[0], [d, k]) < every]
    return SideKey.of(patches[0], boundary.labels, [d, *alone])


def join_straight_edges(
    boundary: BoundaryComplex, edges: list[ModelEdge], faces: list[ModelFace]
) -> tuple[list[ModelEdge], list[ModelFace]]:
    """Return edges and faces with straight edges joined that go on between the same two planes.

    A vertex at which two collinear edges end, and nothing else, is none of the solid's: the axis of
    a ball's wedge is one edge, though two sides of the box collapse to its halves. The second edge
    of a pair is left unused.
    """
    edges, faces = list(edges), list(faces)
    owners: dict[int, set[int]] = {}
    busy: set[int] = set()
    for index, face in enumerate(faces):
        for edge in {edge for wire in face.wires for edge, _ in wire}:
            owners.setdefault(edge, set()).add(index)
        if not face.wires:
            busy |= {use.vertex for use in face.uses}
            busy |= {v for use in face.uses if use.edge is not None for v in _limits(edges, use)}
    ending: dict[int, set[int]] = {}
    for edge in owners:
        for end in (edges[edge].start, edges[edge].end):
            ending.setdefault(end, set()).add(edge)
    for vertex in range(len(boundary.vertices)):
        ends = sorted(ending.get(vertex, ()))
        if vertex in busy or len(ends) != 2 or owners[ends[0]] != owners[ends[1]]:
            continue
        kept, dropped = ends
        joined = _joined(edges[kept], edges[dropped], vertex)
        if joined is None:
            continue
        edges[kept] = joined
        for end in {edges[dropped].start, edges[dropped].end} - {vertex}:
            ending[end] = ending[end] - {dropped} | {kept}
        for index in owners.pop(dropped):
            face = faces[index]
            wires = tuple(tuple(step for step in w if step[0] != dropped) for w in face.wires)
            faces[index] = replace(face, wires=wires)
    return edges, faces


def _limits(edges: list[ModelEdge], use: EdgeUse) -> tuple[int, ...]:
    return () if use.edge is None else (edges[use.edge].start, edges[use.edge].end)


def _joined(first: ModelEdge, second: ModelEdge, vertex: int) -> ModelEdge | None:
    """Return the straight edge through a vertex, in the direction of the first, or None."""
    a, b = first.carrier, second.carrier
    loop = first.start == first.end or second.start == second.end
    if not (isinstance(a, Line) and isinstance(b, Line)) or loop:
        return None
    far = second.end if second.start == vertex else second.start
    end = b.end if second.start == vertex else b.start
    low, high = (a.start, end) if first.end == vertex else (end, a.end)
    start, stop = (first.start, far) if first.end == vertex else (far, first.end)
    along, middle = high - low, (a.end if first.end == vertex else a.start) - low
    if start == stop or not 0 < middle @ along < along @ along:
        return None
    if np.linalg.norm(np.cross(middle, along)) > SAME_PLANE * float(along @ along):
        return None
    deviation = max(first.deviation, second.deviation)
    evidence = first.evidence if first.evidence == second.evidence else "sampled"
    return replace(
        first, carrier=Line(low, high), start=start, end=stop, evidence=evidence,
        deviation=deviation,
    )  # fmt: skip


def _against(plane: Plane, walk: list[tuple[int, bool]], edges: list[ModelEdge]) -> bool:
    """Say whether the outward normal goes against the circles: they would run clockwise about it.

    Files know circles that run anti-clockwise only; the plane is then taken from its other side.
    """
    carriers = [edges[edge].carrier for edge, _ in walk]
    senses = [plane.normal @ c.frame.axes[2] for c in carriers if isinstance(c, Arc)]
    return float(np.sum(np.sign(senses))) < 0


def _chains(
    walk: list[tuple[int, bool]], boundary: BoundaryComplex, edges: list[ModelEdge]
) -> tuple[Wire, ...]:
    """Chain directed edges into closed walks, the outer one first."""
    wires: list[Wire] = []
    left = dict.fromkeys(walk)
    leaving: dict[int, deque[tuple[int, bool]]] = {}
    for item in left:
        leaving.setdefault(_ends(boundary, item)[0], deque()).append(item)
    while left:
        chain: list[tuple[int, bool]] = []
        first = here = _ends(boundary, next(iter(left)))[0]
        while not chain or here != first:
            chain.append(leaving[here].popleft())
            del left[chain[-1]]
            here = _ends(boundary, chain[-1])[1]
        wires.append(tuple(chain))
    if len(wires) == 1:
        return tuple(wires)
    return tuple(sorted(wires, key=lambda wire: -_extent(wire, edges)))


def _ends(boundary: BoundaryComplex, item: tuple[int, bool]) -> tuple[int, int]:
    edge, forward = boundary.edges[item[0]], item[1]
    return (edge.start, edge.end) if forward else (edge.end, edge.start)


def _extent(wire: Wire, edges: list[ModelEdge]) -> float:
    parts = []
    for edge, _ in wire:
        carrier = edges[edge].carrier
        if isinstance(carrier, Line):
            parts += [carrier.start[None], carrier.end[None]]
        elif isinstance(carrier, Arc):
            parts.append(carrier.points(np.linspace(carrier.start, carrier.end, 33)))
        else:
            parts.append(carrier.poles)
    points = np.concatenate(parts)
    return float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
