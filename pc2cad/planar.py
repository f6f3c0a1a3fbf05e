"""Plane faces: which patches make up one, and the wires that bound it.

A side whose direction has creases comes in several patches. Those that lie in one plane are one
face: the edges between them are dropped, as seams are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pc2cad.geometry.carriers import Arc, Evidence, Line, Plane
from pc2cad.model import ModelEdge, ModelFace, Wire
from pc2cad.topology.cells import Cell, normal_direction
from pc2cad.topology.complex import BoundaryComplex

#: planes that differ by less (as an angle) are one: what a least-squares fit of samples leaves
SAME_PLANE = 1e-10


def coplanar_groups(
    boundary: BoundaryComplex, planes: Sequence[Plane | None]
) -> list[tuple[int, ...]]:
    """Return the faces in groups: patches of one side that meet in an edge and share a plane."""
    group = list(range(len(planes)))

    def find(i: int) -> int:
        while group[i] != i:
            i = group[i]
        return i

    for uses in boundary.edge_uses().values():
        (first, _), (second, _) = uses
        a, b = planes[first], planes[second]
        if a is None or b is None or not _same_side(boundary, first, second):
            continue
        if a.normal @ b.normal > 0 and np.abs(np.cross(a.normal, b.normal)).max() < SAME_PLANE:
            group[find(second)] = find(first)
    roots = sorted({find(i) for i in range(len(planes))})
    return [tuple(i for i in range(len(planes)) if find(i) == root) for root in roots]


def _same_side(boundary: BoundaryComplex, first: int, second: int) -> bool:
    a, b = boundary.faces[first].patch, boundary.faces[second].patch
    return _side(a) == _side(b)


def _side(patch: Cell) -> tuple[int, int]:
    d = normal_direction(patch)
    return d, patch[d]


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
    name = boundary.name(boundary.faces[group[0]].patch)
    if len(group) > 1:
        name = name.partition(" (")[0]
    counts = [use.edge for use in uses]
    walk = [
        (use.edge, use.forward != inward)
        for use in uses
        if use.edge is not None and counts.count(use.edge) == 1
    ]
    carrier, evidence = plane
    against = _against(carrier, walk, edges)
    if against:
        carrier = Plane(carrier.origin, -carrier.normal)
        walk = [(edge, not forward) for edge, forward in walk]
    wires = _chains(walk, boundary, edges)
    return ModelFace(name, group, carrier, uses, wires, (), False, against, evidence, 0.0, 0)


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
    while walk:
        chain = [walk.pop(0)]
        first = _ends(boundary, chain[0])[0]
        while _ends(boundary, chain[-1])[1] != first:
            here = _ends(boundary, chain[-1])[1]
            step = next(item for item in walk if _ends(boundary, item)[0] == here)
            walk.remove(step)
            chain.append(step)
        wires.append(tuple(chain))
    return tuple(sorted(wires, key=lambda wire: -_extent(wire, edges)))


def _ends(boundary: BoundaryComplex, item: tuple[int, bool]) -> tuple[int, int]:
    edge, forward = boundary.edges[item[0]], item[1]
    return (edge.start, edge.end) if forward else (edge.end, edge.start)


def _extent(wire: Wire, edges: list[ModelEdge]) -> float:
    points = []
    for edge, _ in wire:
        carrier = edges[edge].carrier
        if isinstance(carrier, Line):
            points += [carrier.start, carrier.end]
        elif isinstance(carrier, Arc):
            points += list(carrier.points(np.linspace(carrier.start, carrier.end, 33)))
        else:
            points += list(carrier.poles)
    return float(np.linalg.norm(np.ptp(np.array(points), axis=0)))
