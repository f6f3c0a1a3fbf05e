"""Edges of our own where bodies meet, in place of the kernel's.

The kernel's curves come within 1e-7 to 1e-2 of their faces. Each that is no line and no conic, and
farther off than the target, is found anew from both surfaces (`csg.edge_curves`); the vertices at
its ends go to the one place that all surfaces and edges there have in common. Lines, conics and
curves that cannot be found anew stay, and get other curves in the parameters of their faces, where
these are nearer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.brep.booleans import NamedEdge, NamedShape, edge_functions, edges_between
from pc2cad.brep.replacing import Corner, copied, corners_of, ends_of, move, put, retrace
from pc2cad.csg.edge_curves import DEGREE, CommonCurve, common_curve, path_along
from pc2cad.geometry.carriers import SplineCurve, SplinePath
from pc2cad.geometry.jets import CurveFunction, EdgeFunction

#: places along an edge at which its distance from its faces is looked at
PLACES = 257
#: steps of Gauss's and Newton's method
STEPS = 20
#: a vertex may move by so many times what the kernel is off there
FAR = 10.0
#: singular values that are less than this share of the largest are none: a vertex may lie anywhere
#: along a closed edge
RANK = 1e-6


@dataclass(frozen=True, eq=False)
class _Coarse:
    """An edge that is to be replaced."""

    named: NamedEdge
    function: EdgeFunction
    off: float


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a vertex goes, and where that is on each piece there."""

    corner: Corner
    point: Array
    places: tuple[Array, ...]


def with_own_edges(shape: NamedShape, target: float) -> NamedShape:
    """Return a shape whose edges between bodies come within `target` (a length) of both faces.

    What cannot be had, because faces are tangent or nearly so, stays the kernel's in space.
    """
    if not _coarse(shape, target)[0]:
        return shape
    shape = copied(shape)
    coarse, origin = _coarse(shape, target)
    staying: list[_Coarse] = []
    while coarse:
        corners = corners_of(shape, [row.named for row in coarse], origin)
        off = max(row.off for row in coarse)
        places = [place for corner in corners if (place := _place(corner, off, target)) is not None]
        curves = [_curve(row, places, target) for row in coarse]
        if all(curve is not None for curve in curves):
            for place in places:
                move(place.corner, place.point, place.places, origin)
            for row, curve in zip(coarse, curves, strict=True):
                if isinstance(curve, CommonCurve):
                    _put(shape, row.named, curve, origin)
                else:
                    staying.append(row)
            break
        # vertices of an edge that stays stay as well
        staying += [row for row, curve in zip(coarse, curves, strict=True) if curve is None]
        coarse = [row for row, curve in zip(coarse, curves, strict=True) if curve is not None]
    for row in staying:
        _retrace(shape, row, target)
    return shape


def _coarse(shape: NamedShape, target: float) -> tuple[list[_Coarse], Array]:
    """Return the edges between bodies that are farther than `target` off a face.

    Their functions are relative to the place (3,) that comes with them.
    """
    edges = [
        edge for edge in edges_between(shape)
        if _bodies(edge, 0).isdisjoint(_bodies(edge, 1))
    ]  # fmt: skip
    origin = edges[0].points[0] if edges else np.zeros(3)
    functions = edge_functions(shape, edges, origin)
    found = [
        _Coarse(edge, function, float(np.max(_gaps(function)[1])))
        for edge, function in zip(edges, functions, strict=True)
    ]
    return [row for row in found if row.off > target], origin


def distances_between(shape: NamedShape) -> Iterator[tuple[NamedEdge, float, Array]]:
    """Yield each edge between bodies, how far off its faces it is at most, and where, (3,)."""
    for row in _coarse(shape, 0.0)[0]:
        yield row.named, row.off, farthest_place(shape, row.named)


def _bodies(edge: NamedEdge, side: int) -> set[str]:
    return {name.body for name in edge.names[side]}


def farthest_place(shape: NamedShape, edge: NamedEdge) -> Array:
    """Return where an edge is farthest off its faces, (3,)."""
    (function,) = edge_functions(shape, [edge], np.zeros(3))
    points, off = _gaps(function)
    return np.asarray(points[off.max(axis=0).argmax()])


def _gaps(edge: EdgeFunction) -> tuple[Array, Array]:
    """Return places along an edge, and how far each is from both faces, (2, n)."""
    t = np.linspace(*edge.span, PLACES)
    points = edge.curve.jet(t)[0]
    found = []
    for trace in edge.traces:
        at = trace.path.jet(t)[0]
        found.append(np.linalg.norm(points - trace.surface.jet(at[:, 0], at[:, 1])[0], axis=1))
    return points, np.stack(found)


def _place(corner: Corner, off: float, target: float) -> _Place | None:
    """Return the place that all pieces at a vertex have in common; None where there is none near.

    Of several the nearest one: steps are the shortest that lead there.
    """
    point, at = corner.point, [start for _, start in corner.pieces]
    widths = [len(start) for start in at]
    columns = 3 + np.cumsum([0, *widths])
    for _ in range(STEPS):
        rows, rest = np.zeros((3 * len(at), columns[-1])), np.zeros(3 * len(at))
        for k, ((jet, _), here) in enumerate(zip(corner.pieces, at, strict=True)):
            there, along = jet(here[None])
            rest[3 * k : 3 * k + 3] = there[0] - point
            rows[3 * k : 3 * k + 3, :3] = -np.eye(3)
            rows[3 * k : 3 * k + 3, columns[k] : columns[k + 1]] = np.stack(along, axis=2)[0]
        lengths = np.linalg.norm(rows, axis=0)
        if not (np.isfinite(rest).all() and lengths.min() > 0):
            return None
        step = np.linalg.lstsq(rows / lengths, -rest, rcond=RANK)[0] / lengths
        point = point + step[:3]
        at = [here + step[a:b] for here, a, b in zip(at, columns, columns[1:], strict=False)]
    gap = max(
        float(np.linalg.norm(jet(here[None])[0][0] - point))
        for (jet, _), here in zip(corner.pieces, at, strict=True)
    )
    moved = float(np.linalg.norm(point - corner.point))
    if not (gap <= target and moved <= FAR * max(off, corner.tolerance)):
        return None
    return _Place(corner, point, tuple(at))


def _curve(
    row: _Coarse, places: Sequence[_Place], target: float
) -> CommonCurve | CurveFunction | None:
    """Return a new curve, or the edge's own where it stays; None where there is none."""
    if row.named.conic is not None:
        return row.function.curve
    ends = []
    for end in ends_of(row.named.edge):
        ends += [place.point for place in places if place.corner.vertex.IsSame(end)]
    if len(ends) != 2:
        return None
    return common_curve(row.function, (ends[0], ends[1]), target)


def _put(shape: NamedShape, named: NamedEdge, curve: CommonCurve, origin: Array) -> None:
    first, second = (SplinePath(DEGREE, curve.knots, path) for path in curve.paths)
    poles = curve.poles + origin
    put(shape, named, SplineCurve(DEGREE, curve.knots, poles), (first, second))


def _retrace(shape: NamedShape, row: _Coarse, target: float) -> None:
    """Give an edge that stays in space, but for where vertices trim it, paths on its faces."""
    off = _gaps(row.function)[1].max(axis=1)
    paths = {}
    for side, trace in enumerate(row.function.traces):
        if off[side] > target:
            found = path_along(row.function.curve, row.named.range, trace, target)
            if found is not None:
                paths[side], off[side] = found
    if paths:
        retrace(shape, row.named, paths, float(off.max()))
