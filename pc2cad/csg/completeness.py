"""Whether the edges of a Boolean's result are all curves in which the two boundaries meet.

The kernel says which curves there are, and volumes that add up say that it is right to rounding.
Here it is proved by enclosures of the built faces (`bounds.crossings`), or the two faces are named
that leave it open.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.bounds.crossings import Known, Open, prove_crossings
from pc2cad.bounds.one_curve import KnownCurve, KnownCurves
from pc2cad.bounds.surface_cells import Border, Region
from pc2cad.brep.booleans import NamedEdge, NamedShape, edge_functions, edges_between, label
from pc2cad.brep.borders import border_of, surface_of
from pc2cad.brep.tolerance import KERNEL_TOLERANCE
from pc2cad.csg.contacts import ZERO, MissedCrossingError
from pc2cad.geometry.jets import EdgeFunction
from pc2cad.report import TopologyReport
from pc2cad.topology.cells import SideKey

if TYPE_CHECKING:
    from OCP.TopoDS import TopoDS_Face

#: share of a face's rectangle within which the ends of two edges are one, and kernel tolerances
#: that an edge may be short of the end of its face
ONE_PLACE, SHORT = 1e-6, 10.0
#: pieces of an edge at the border of a face where another edge ends there
FINE = 4096
#: share of the size that a place has to be from every edge to belong to none
FAR = 1e-3


def completeness(
    shapes: Sequence[NamedShape],
    result: NamedShape,
    deviations: Mapping[SideKey, float],
    part: tuple[str, float, str],
) -> TopologyReport:
    """Ask whether shapes' boundaries meet in the edges of the result of their Boolean only.

    `deviations` bound how far faces are from their equations', and `part` is the Boolean in words,
    the part's size and its unit. Raises MissedCrossingError where they are proved to meet
    elsewhere.
    """
    title, size, _ = part
    faces = [row for shape in shapes for row in shape.faces]
    owner = np.repeat(np.arange(len(shapes)), [len(shape.faces) for shape in shapes])
    regions = [_region(face, max(deviations[name] for name in names)) for face, names in faces]
    edges = list(edges_between(result))
    known = _known(edges, edge_functions(result, edges, np.zeros(3)), [row[1] for row in faces],
                   regions, owner)  # fmt: skip
    found = prove_crossings(regions, owner, known, size)
    if found.open is None:
        return TopologyReport("proved", "", found.pairs, found.within)
    names = [label(faces[k][1]) for k in found.open.faces]
    place = ", ".join(f"{x if abs(x) > ZERO * size else 0:.6g}" for x in found.open.point)
    if found.open.missed and _far(edges, found.open, size):
        raise MissedCrossingError(
            f"{title}: the faces {names[0]} and {names[1]} cross at ({place}), proved by "
            "enclosures, and the CAD kernel has made no edge there; move one of the bodies a "
            "little, or turn its seam away"
        )
    what = f"{names[0]} and {names[1]} near ({place}) {found.open.why}"
    return TopologyReport("sampled", what, found.pairs, found.within)


def _far(edges: Sequence[NamedEdge], place: Open, size: float) -> bool:
    """Say whether a place is so far from all edges that it belongs to none of them."""
    for edge in edges:
        step = edge.length / (len(edge.points) - 1)
        if np.linalg.norm(edge.points - place.point, axis=1).min() <= FAR * size + 2 * step:
            return False
    return True


def _region(face: TopoDS_Face, deviation: float) -> Region:
    """Return a face as a surface over its border."""
    surface = surface_of(face)
    limits = np.array([
        (-np.inf, np.inf) if breaks is None or not len(breaks) else (breaks[0], breaks[-1])
        for breaks in surface.breaks
    ])  # fmt: skip
    border = Border(*border_of(face), finer=lambda: Border(*border_of(face, FINE)))
    return Region(surface, border, deviation, (limits[:, 0], limits[:, 1]))


#: an edge, and which of its two faces is the first shape's
_Trace = tuple[EdgeFunction, tuple[int, int]]


def _known(
    edges: Sequence[NamedEdge],
    functions: Iterable[EdgeFunction],
    names: Sequence[tuple[SideKey, ...]],
    regions: Sequence[Region],
    owner: Integers,
) -> dict[tuple[int, int], Known]:
    """Return edges as curves on pairs of faces of different shapes, by the faces' numbers.

    Where an edge ends at a border of both faces, other two of the faces there have the place alone.
    """
    by_name: dict[SideKey, list[int]] = {}
    for k, given in enumerate(names):
        for name in given:
            by_name.setdefault(name, []).append(k)
    traces: dict[tuple[int, int], list[_Trace]] = {}
    for edge, function in zip(edges, functions, strict=True):
        one, other = ({k for name in side for k in by_name[name]} for side in edge.names)
        for i, k in product(one, other):
            if owner[i] != owner[k]:
                pair, order = ((i, k), (0, 1)) if owner[i] < owner[k] else ((k, i), (1, 0))
                traces.setdefault(pair, []).append((function, order))
    ends: _Ends = {}
    for (i, k), rows in traces.items():
        faces = regions[i], regions[k]
        places = np.concatenate([_line(faces, trace, 1) for trace in rows])
        for n, (face, points) in enumerate(zip((i, k), _on(faces, places), strict=True)):
            ends.setdefault(face, []).append((places[:, 2 * n : 2 * n + 2], points))
    found: dict[tuple[int, int], Known] = {}
    for i, k in product(ends, repeat=2):
        if owner[i] < owner[k]:
            faces, rows = (regions[i], regions[k]), traces.get((i, k), [])
            alone = _alone(faces, rows, (ends[i], ends[k]))
            if rows or alone:
                found[i, k] = partial(_curves, faces, rows, alone)
    return found


#: where edges end on faces: in their parameters, (n, 2), and in space, (n, 3)
_Ends = dict[int, list[tuple[Array, Array]]]


def _alone(
    faces: tuple[Region, Region],
    traces: Sequence[_Trace],
    ends: tuple[Sequence[tuple[Array, Array]], Sequence[tuple[Array, Array]]],
) -> list[KnownCurve]:
    """Return the places of two faces at which edges end, and none of their own does."""
    (one, here), (other, there) = (
        tuple(np.concatenate(part) for part in zip(*rows, strict=True)) for rows in ends
    )
    apart = np.linalg.norm(here[:, None] - there, axis=2)
    widths, found = _widths(faces), []
    lines = [_line(faces, trace, 1) for trace in traces]
    known = [place for line in lines for place in line]
    for i, k in np.argwhere(apart <= SHORT * KERNEL_TOLERANCE).tolist():
        place = np.concatenate((one[i], other[k]))
        if not any(_meet(place, at, widths) for at in known):
            known.append(place)
            found.append(KnownCurve(place[None], False))
    return found


def _curves(
    faces: tuple[Region, Region], traces: Sequence[_Trace], alone: Sequence[KnownCurve], count: int
) -> KnownCurves:
    """Return edges on two faces as curves, with so many places between the ends of each."""
    lines = [_line(faces, trace, count) for trace in traces]
    points = [_on(faces, line) for line in (*lines, *(curve.places for curve in alone))]
    apart = max(float(np.linalg.norm(here - there, axis=1).max()) for here, there in points)
    steps = [np.linalg.norm(np.diff(x, axis=0), axis=1) for pair in points for x in pair]
    spacing = max(float(step.max(initial=0.0)) for step in steps)
    curves = [*_joined(lines, _widths(faces)), *alone]
    return KnownCurves(curves, apart, SHORT * KERNEL_TOLERANCE, spacing)


def _widths(faces: tuple[Region, Region]) -> Array:
    return np.concatenate([face.box[1] - face.box[0] for face in faces])


def _on(faces: tuple[Region, Region], places: Array) -> tuple[Array, Array]:
    """Return the points of both faces at places (n, 4)."""
    one, other = (
        face.surface.jet(places[:, 2 * n], places[:, 2 * n + 1])[0] for n, face in enumerate(faces)
    )
    return one, other


def _line(faces: tuple[Region, Region], trace: _Trace, count: int) -> Array:
    """Return places along an edge in the parameters of both of its faces, (count + 1, 4)."""
    function, order = trace
    t = np.linspace(*function.span, count + 1)
    paths = [function.traces[side].path for side in order]
    return _turned(np.concatenate([path.jet(t)[0] for path in paths], axis=1), faces)


def _turned(places: Array, faces: tuple[Region, Region]) -> Array:
    """Return places with angles turned into the rectangles of their faces."""
    middle = np.concatenate([(face.box[0] + face.box[1]) / 2 for face in faces])
    angles = np.array([breaks is None for face in faces for breaks in face.surface.breaks])
    turns = np.round((places[len(places) // 2] - middle) / (2 * np.pi))
    return np.asarray(places - np.where(angles, 2 * np.pi * turns, 0.0))


def _joined(lines: Sequence[Array], widths: Array) -> list[KnownCurve]:
    """Return lines of places as curves: one where one goes on where another ends."""
    left, found = list(lines), []
    while left:
        line, grown = left.pop(), True
        while grown and not _meet(line[0], line[-1], widths):
            grown = False
            for k, other in enumerate(left):
                way = _way(line, other, widths)
                if way is not None:
                    line, grown = way, True
                    del left[k]
                    break
        closed = _meet(line[0], line[-1], widths)
        found.append(KnownCurve(line[:-1] if closed else line, closed))
    return found


def _way(line: Array, other: Array, widths: Array) -> Array | None:
    for one in (line, line[::-1]):
        for next_one in (other, other[::-1]):
            if _meet(one[-1], next_one[0], widths):
                return np.concatenate((one, next_one[1:]))
    return None


def _meet(one: Array, other: Array, widths: Array) -> bool:
    return bool((np.abs(one - other) <= ONE_PLACE * widths).all())
