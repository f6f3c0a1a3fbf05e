"""Triangles of a face on a grid of its own parameters, put upon the kernel's shape.

The kernel's mesher loses its way where a face winds round its surface more than once in a
parameter (a torus cut along a helix): it takes places a period apart for one. A face of four sides
has a grid without that: its sides' curves in the parameters, blended (Coons). Where every triangle
of the grid has the same sense in the parameter plane, the grid covers the face exactly once. Nodes
on an edge lie at the same parameters of the edge for both its faces, and what the kernel meshes
beside such a face takes the nodes that are there.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import Any

import numpy as np
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.gp import gp_Pnt, gp_Pnt2d
from OCP.Poly import Poly_PolygonOnTriangulation, Poly_Triangle, Poly_Triangulation
from OCP.TColStd import TColStd_Array1OfInteger, TColStd_Array1OfReal
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS
from OCP.TopTools import TopTools_IndexedMapOfShape

from pc2cad.arrays import Array, Integers
from pc2cad.brep.from_kernel import path_function, surface_function
from pc2cad.errors import KernelError
from pc2cad.geometry.jets import CurveFunction, SurfaceFunction

#: cells of a direction at first and at most, and the share of the deflection that its chords take
_FIRST, _MOST, _SHARE = 8, 4096, 0.6
#: cells in which a direction is looked at once
_LOOK = 512
#: nodes of one face at most
_MOST_NODES = 2_000_000


@dataclass(frozen=True, eq=False)
class _Side:
    """One side of a face, as the walk round it goes."""

    edge: Any
    #: number of the edge in the shape
    index: int
    path: CurveFunction
    span: tuple[float, float]
    forward: bool

    def at(self, count: int) -> Array:
        """Return the face's parameters at the ends of `count` equal cells, along the walk."""
        t = np.linspace(*self.span, count + 1)
        return self.path.jet(t if self.forward else t[::-1])[0]


@dataclass(frozen=True, eq=False)
class _Patch:
    """A face of four sides that a grid can cover."""

    face: Any
    sides: tuple[_Side, _Side, _Side, _Side]
    surface: SurfaceFunction

    def parameters(self, s: int, t: int) -> Array:
        """Return the parameters at a grid of s × t cells, (s + 1, t + 1, 2)."""
        bottom, right = self.sides[0].at(s), self.sides[1].at(t)
        top, left = self.sides[2].at(s)[::-1], self.sides[3].at(t)[::-1]
        x, y = np.linspace(0, 1, s + 1)[:, None, None], np.linspace(0, 1, t + 1)[None, :, None]
        corners = ((1 - x) * ((1 - y) * bottom[0] + y * top[0])
                   + x * ((1 - y) * bottom[-1] + y * top[-1]))  # fmt: skip
        grid = ((1 - y) * bottom[:, None] + y * top[:, None]
                + (1 - x) * left[None] + x * right[None] - corners)  # fmt: skip
        grid[:, 0], grid[:, -1], grid[0], grid[-1] = bottom, top, left, right
        return np.asarray(grid)

    def points(self, grid: Array) -> Array:
        """Return the places (n, m, 3) at parameters (n, m, 2)."""
        flat = grid.reshape(-1, 2)
        return self.surface.jet(flat[:, 0], flat[:, 1])[0].reshape(*grid.shape[:2], 3)


def attach(shape: Any, numbers: Container[int], deflection: float, angle: float) -> frozenset[int]:
    """Put grids upon the faces of these numbers (in the kernel's order) that can have one.

    Args:
        shape: TopoDS_Shape without triangulations; its faces and edges get them.
        numbers: which faces.
        deflection: largest distance of a chord from its surface, model units.
        angle: largest angle between neighbouring chords, radians.

    Returns:
        The numbers of the faces that have a grid now.

    """
    edges = TopTools_IndexedMapOfShape()
    patches = {}
    for number, face in enumerate(shapes_of(shape, TopAbs_ShapeEnum.TopAbs_FACE)):
        patch = _patch(TopoDS.Face_s(face), edges) if number in numbers else None
        if patch is not None:
            patches[number] = patch
    counts = _counts(list(patches.values()), deflection, angle)
    done = set()
    for number, patch in patches.items():
        s, t = (counts[patch.sides[k].index] for k in (0, 1))
        grid = patch.parameters(s, t)
        points = patch.points(grid)
        triangles = _triangles(points)
        if (s + 1) * (t + 1) <= _MOST_NODES and np.isfinite(points).all():
            oriented = _oriented(grid.reshape(-1, 2), triangles)
            if oriented is not None:
                _put(patch, grid, points, oriented)
                done.add(number)
    return frozenset(done)


def shapes_of(shape: Any, kind: Any) -> list[Any]:
    """Return the parts of a kind in the kernel's order, each as often as it is used."""
    explorer, found = TopExp_Explorer(shape, kind), []
    while explorer.More():
        found.append(explorer.Current())
        explorer.Next()
    return found


def _patch(face: Any, edges: Any) -> _Patch | None:
    """Return a face that is bounded by four sides in a row, else None."""
    forward = TopoDS.Face_s(face.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
    location = TopLoc_Location()
    surface = BRep_Tool.Surface_s(forward, location)
    shapes = shapes_of(forward, TopAbs_ShapeEnum.TopAbs_EDGE)
    wires = shapes_of(forward, TopAbs_ShapeEnum.TopAbs_WIRE)
    if not location.IsIdentity() or len(wires) != 1 or len(shapes) != 4:
        return None
    try:
        sides = [_side(TopoDS.Edge_s(edge), forward, edges) for edge in shapes]
        jets = surface_function(surface, np.zeros(3))
    except KernelError:
        return None
    ends = np.array([side.at(1) for side in sides])
    size = float(np.abs(ends - ends[0, 0]).max())
    order = [0]
    while len(order) < 4:
        here = ends[order[-1], 1]
        gaps = {k: float(np.abs(ends[k, 0] - here).max()) for k in range(4) if k not in order}
        order.append(min(gaps, key=gaps.__getitem__))
    walk = ends[order]
    if np.abs(walk[:, 1] - np.roll(walk[:, 0], -1, axis=0)).max() > 1e-5 * size:
        return None
    a, b, c, d = (sides[k] for k in order)
    return _Patch(forward, (a, b, c, d), jets)


def _side(edge: Any, face: Any, edges: Any) -> _Side:
    curve = BRep_Tool.CurveOnSurface_s(edge, face, 0.0, 1.0)
    first, last = BRep_Tool.Range_s(edge, face)
    if curve is None:
        raise KernelError("an edge has no curve in the parameters of its face")
    forward = edge.Orientation() != TopAbs_Orientation.TopAbs_REVERSED
    return _Side(edge, edges.Add(edge), path_function(curve), (first, last), forward)


# -- how many cells --------------------------------------------------------------------------------


def _counts(patches: list[_Patch], deflection: float, angle: float) -> dict[int, int]:
    """Return the cells of each edge: opposite sides of a face have as many."""
    group: dict[int, int] = {}

    def root(edge: int) -> int:
        while group.setdefault(edge, edge) != edge:
            edge = group[edge]
        return edge

    for patch in patches:
        for k in (0, 1):
            group[root(patch.sides[k].index)] = root(patch.sides[k + 2].index)
    counts = {root(edge): 1 for edge in list(group)}
    for patch in patches:
        for k, first in enumerate(_first(patch, angle)):
            key = root(patch.sides[k].index)
            counts[key] = max(counts[key], first)
    for _ in range(12):
        wanted = dict(counts)
        for patch in patches:
            keys = [root(patch.sides[k].index) for k in (0, 1)]
            for key, more in zip(keys, _wanted(patch, [counts[k] for k in keys], deflection, angle),
                                 strict=True):  # fmt: skip
                wanted[key] = max(wanted[key], more)
        if wanted == counts:
            break
        counts = wanted
    return {edge: counts[root(edge)] for edge in group}


def _first(patch: _Patch, angle: float) -> list[int]:
    """Return the cells that a few lines each way turn through; few cells may miss whole turns."""
    result = []
    for k in (0, 1):
        grid = patch.parameters(*((_LOOK, 2) if k == 0 else (2, _LOOK)))
        points = patch.points(grid)
        lines = points if k == 0 else points.transpose(1, 0, 2)
        turns = float(_turns(np.diff(lines, axis=0)).sum(axis=0).max())
        result.append(int(np.clip(np.ceil(turns / angle), _FIRST, _MOST)))
    return result


def _turns(steps: Array) -> Array:
    """Return the angles between steps (n, m, 3) that follow one another, (n - 1, m)."""
    lengths = np.sqrt((steps * steps).sum(axis=-1))
    # no direction is known of steps that vanish: at a pole
    large = lengths > 1e-9 * lengths.max(initial=0.0)
    sines = np.sqrt((np.cross(steps[:-1], steps[1:]) ** 2).sum(axis=-1))
    turns = np.arctan2(sines, (steps[:-1] * steps[1:]).sum(axis=-1))
    return np.where(large[:-1] & large[1:], turns, 0.0)


def _wanted(patch: _Patch, cells: list[int], deflection: float, angle: float) -> list[int]:
    """Return how many cells the two directions need, as seen from this many."""
    s, t = cells
    points = patch.points(patch.parameters(2 * s, 2 * t))
    result = []
    for count, along in ((s, points), (t, points.transpose(1, 0, 2))):
        start, middle, end = along[:-2:2], along[1::2], along[2::2]
        bow = float(np.sqrt((((start + end) / 2 - middle) ** 2).sum(axis=-1)).max())
        steps = np.diff(along[::2], axis=0)
        turns = float(_turns(steps).max(initial=0.0))
        factor = max(np.sqrt(bow / (_SHARE * deflection)), turns / angle)
        result.append(min(_MOST, max(count, int(np.ceil(1.05 * count * min(factor, 4.0))))
                          if factor > 1 else count))  # fmt: skip
    return result


# -- the grid --------------------------------------------------------------------------------------


def _triangles(points: Array) -> Integers:
    """Return two triangles per cell, cut along the shorter diagonal, as rows of the flat grid."""
    n, m = points.shape[:2]
    rows = np.arange(n * m, dtype=np.int64).reshape(n, m)
    a, b, c, d = rows[:-1, :-1], rows[1:, :-1], rows[1:, 1:], rows[:-1, 1:]
    flat = points.reshape(-1, 3)
    rising = ((flat[a] - flat[c]) ** 2).sum(axis=-1) <= ((flat[b] - flat[d]) ** 2).sum(axis=-1)
    first = np.where(rising[..., None], np.stack((a, b, c), -1), np.stack((a, b, d), -1))
    second = np.where(rising[..., None], np.stack((a, c, d), -1), np.stack((b, c, d), -1))
    return np.concatenate((first.reshape(-1, 3), second.reshape(-1, 3)))


def parameter_areas(grid: Array, triangles: Integers) -> Array:
    """Return the signed areas of triangles in the parameter plane; grid (n, 2)."""
    a, b, c = (grid[triangles[:, k]] for k in range(3))
    x, y = b - a, c - a
    return np.asarray((x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]) / 2)


def _oriented(grid: Array, triangles: Integers) -> Integers | None:
    """Return the triangles anti-clockwise in the parameters; None where senses differ."""
    areas = parameter_areas(grid, triangles)
    if (areas > 0).all():
        return triangles
    return triangles[:, ::-1] if (areas < 0).all() else None


def _put(patch: _Patch, grid: Array, points: Array, triangles: Integers) -> None:
    n, m = grid.shape[:2]
    mesh = Poly_Triangulation(n * m, len(triangles), True)
    for i, (place, pair) in enumerate(
        zip(points.reshape(-1, 3).tolist(), grid.reshape(-1, 2).tolist(), strict=True), start=1
    ):
        mesh.SetNode(i, gp_Pnt(*place))
        mesh.SetUVNode(i, gp_Pnt2d(*pair))
    for i, (a, b, c) in enumerate((triangles + 1).tolist(), start=1):
        mesh.SetTriangle(i, Poly_Triangle(a, b, c))
    mesh.Deflection(0.0)
    builder = BRep_Builder()
    builder.UpdateFace(patch.face, mesh)
    rows = np.arange(1, n * m + 1).reshape(n, m)
    nodes = (rows[:, 0], rows[-1], rows[::-1, -1], rows[0, ::-1])
    polygons: dict[int, dict[bool, Any]] = {}
    for side, walk in zip(patch.sides, nodes, strict=True):
        along = walk if side.forward else walk[::-1]
        own = polygons.setdefault(side.index, {})
        own[side.forward] = _polygon(along, np.linspace(*side.span, len(along)))
    for side in patch.sides:
        own = polygons.pop(side.index, {})
        if len(own) == 2:
            builder.UpdateEdge(side.edge, own[True], own[False], mesh)
        elif own:
            builder.UpdateEdge(side.edge, *own.values(), mesh)


def _polygon(nodes: Integers, parameters: Array) -> Any:
    indices = TColStd_Array1OfInteger(1, len(nodes))
    places = TColStd_Array1OfReal(1, len(nodes))
    for i, (node, parameter) in enumerate(
        zip(nodes.tolist(), parameters.tolist(), strict=True), start=1
    ):
        indices.SetValue(i, node)
        places.SetValue(i, parameter)
    return Poly_PolygonOnTriangulation(indices, places)
