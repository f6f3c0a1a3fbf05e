"""Triangles of faces on grids of their own parameters, put upon the kernel's shape.

The kernel's mesher takes half a minute where a face has a thousand poles, and loses its way where
one winds round its surface more than once (it takes places a period apart for one). Grids know
neither trouble. Nodes on an edge lie at the same parameters of the edge for both its faces; what
the kernel meshes beside such a face (planes, trimmed faces) takes the nodes that are there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from OCP.BRep import BRep_Builder
from OCP.gp import gp_Pnt, gp_Pnt2d
from OCP.Poly import Poly_PolygonOnTriangulation, Poly_Triangle, Poly_Triangulation

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.brep.face_patches import Patch, patches_of
from pc2cad.brep.grid_lines import MOST_NODES, ROUNDS, Lines, ask_for
from pc2cad.brep.kernel import Array1OfInteger, Array1OfReal


@dataclass(frozen=True, eq=False)
class FaceGrid:
    """The triangles of one face."""

    patch: Patch
    #: shares of the lines along both directions
    lines: tuple[Array, Array]
    #: of its nodes: parameters (n, 2), points and normals of any length (n, 3)
    parameters: Array
    points: Array
    normals: Array
    #: rows of these, (m, 3), anti-clockwise in the parameters; sides that are points make fans
    triangles: Integers
    #: largest distance along the normal between triangles and surface that was measured
    deflection: float


def grids(
    shape: Any, deflection: float, angle: float, most: int = MOST_NODES
) -> dict[int, FaceGrid]:
    """Return triangles of the curved faces with four sides, by the face's number in the shape.

    Args:
        shape: TopoDS_Shape.
        deflection: largest distance of triangles from their surface, model units.
        angle: largest angle between normals of neighbouring lines, radians.
        most: nodes of all of them; with more, there are none.

    """
    patches = patches_of(shape)
    lines = Lines(list(patches.values()))
    for patch in patches.values():
        ask_for(lines, patch, deflection, angle)
    for _ in range(ROUNDS):
        sizes = [len(lines.along(p, 0)) * len(lines.along(p, 1)) for p in patches.values()]
        if sum(sizes) > most:
            return {}
        found = {number: _measured(lines, patch) for number, patch in patches.items()}
        if not any([_denser(lines, *one, deflection) for one in found.values()]):
            break
    else:
        return {}
    return {number: one[0] for number, one in found.items() if one[0] is not None}


def attach(
    shape: Any, deflection: float, angle: float, most: int = 2 * MOST_NODES
) -> dict[int, FaceGrid]:
    """Put `grids` upon a shape without triangulations: its faces and edges get them.

    Nothing is put, and returned, where they have more than `most` triangles together.
    """
    found = grids(shape, deflection, angle, most // 2)
    for grid in found.values():
        _put(grid, deflection)
    return found


# -- a grid and what it is off by ------------------------------------------------------------------


def _measured(lines: Lines, patch: Patch) -> tuple[FaceGrid | None, Patch, Array]:
    """Return the triangles between the lines, None where they fold, and each cell's distance."""
    own = lines.along(patch, 0), lines.along(patch, 1)
    parameters = patch.parameters(*(_with_middles(x) for x in own))
    points, normals = patch.places(parameters)
    nodes, places = points[::2, ::2], parameters[::2, ::2].reshape(-1, 2)
    rising = (((nodes[:-1, :-1] - nodes[1:, 1:]) ** 2).sum(-1)
              <= ((nodes[1:, :-1] - nodes[:-1, 1:]) ** 2).sum(-1))  # fmt: skip
    distances = _distances(points, normals, rising)
    triangles = _oriented(places, _triangles(rising))
    if triangles is None or not np.isfinite(points).all():
        return None, patch, distances
    flat, across = (x[::2, ::2].reshape(-1, 3) for x in (points, normals))
    triangles = triangles[~_collapsed(patch, nodes.shape[:2], triangles)]
    grid = FaceGrid(patch, own, places, flat, across, triangles, float(distances.max()))
    return grid, patch, distances


def _denser(
    lines: Lines, grid: FaceGrid | None, patch: Patch, distances: Array, deflection: float
) -> bool:
    """Ask for more lines where triangles are too far away; return whether any are."""
    with np.errstate(invalid="ignore"):
        factors = np.sqrt(np.nan_to_num(distances) / deflection)
    if factors.max() <= 1 or grid is None:
        return False
    for k in (0, 1):
        shares = grid.lines[k]
        needed = factors.max(axis=1 - k)
        density = np.where(needed > 1, 1.03 * needed / np.diff(shares), 0.0)
        middles = (shares[1:] + shares[:-1]) / 2
        ends = np.concatenate(([0.0], middles, [1.0]))
        lines.ask(patch, k, ends, np.concatenate((density[:1], density, density[-1:])))
    return True


def _with_middles(places: Array) -> Array:
    result = np.empty(2 * len(places) - 1)
    result[::2], result[1::2] = places, (places[1:] + places[:-1]) / 2
    return result


def _distances(points: Array, normals: Array, rising: Booleans) -> Array:
    """Return how far the triangles of each cell are from the surface along its normal, (n, m).

    A surface is off a triangle like a quadratic: measured in the middles of its three edges, that
    says what it is in between.
    """
    lengths = np.sqrt((normals * normals).sum(axis=-1, keepdims=True))
    known = lengths > 1e-9 * lengths.max(initial=0.0)
    units = np.where(known, normals / np.where(known, lengths, 1.0), 0.0)

    def off(place: tuple[slice, slice], start: Array, end: Array) -> Array:
        return np.asarray(((points[place] - (start + end) / 2) * units[place]).sum(axis=-1))

    odd, even = slice(1, None, 2), slice(None, None, 2)
    nodes = points[even, even]
    s = off((odd, even), nodes[:-1], nodes[1:])
    t = off((even, odd), nodes[:, :-1], nodes[:, 1:])
    place = (odd, odd)
    diagonal = np.where(
        rising,
        off(place, nodes[:-1, :-1], nodes[1:, 1:]), off(place, nodes[1:, :-1], nodes[:-1, 1:]),
    )  # fmt: skip
    largest = np.abs(diagonal)
    # the edges of both triangles: beside the diagonal each has one along s and one along t
    lower, upper = s[:, :-1], s[:, 1:]
    left, right = t[:-1], t[1:]
    for one in (lower, upper, left, right):
        largest = np.maximum(largest, np.abs(one))
    first = lower + np.where(rising, right, left)
    second = upper + np.where(rising, left, right)
    for pair in (first, second):
        largest = np.maximum(largest, 4 / 9 * np.abs(pair + diagonal))
    return np.asarray(largest)


def _triangles(rising: Booleans) -> Integers:
    """Return two triangles per cell, cut along the rising or the falling diagonal."""
    n, m = rising.shape
    rows = np.arange((n + 1) * (m + 1), dtype=np.int64).reshape(n + 1, m + 1)
    a, b, c, d = rows[:-1, :-1], rows[1:, :-1], rows[1:, 1:], rows[:-1, 1:]
    first = np.where(rising[..., None], np.stack((a, b, c), -1), np.stack((a, b, d), -1))
    second = np.where(rising[..., None], np.stack((a, c, d), -1), np.stack((b, c, d), -1))
    return np.concatenate((first.reshape(-1, 3), second.reshape(-1, 3)))


def parameter_areas(places: Array, triangles: Integers) -> Array:
    """Return the signed areas of triangles in the parameter plane; places (n, 2)."""
    a, b, c = (places[triangles[:, k]] for k in range(3))
    x, y = b - a, c - a
    return np.asarray((x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]) / 2)


def _oriented(places: Array, triangles: Integers) -> Integers | None:
    """Return the triangles anti-clockwise in the parameters; None where senses differ."""
    areas = parameter_areas(places, triangles)
    if (areas > 0).all():
        return triangles
    return triangles[:, ::-1] if (areas < 0).all() else None


def _collapsed(patch: Patch, shape: tuple[int, ...], triangles: Integers) -> Booleans:
    """Say which triangles have two corners on a side that is a point."""
    rows = np.arange(shape[0] * shape[1]).reshape(shape)
    result = np.zeros(len(triangles), dtype=bool)
    for side, nodes in zip(patch.sides, _walk(rows), strict=True):
        if side.degenerate:
            here = np.zeros(rows.size, dtype=np.int64)
            here[nodes] = 1
            result |= here[triangles].sum(axis=1) > 1
    return result


def _walk(rows: Integers) -> tuple[Integers, ...]:
    """Return the nodes of the four sides, as the walk round the face goes."""
    return rows[:, 0], rows[-1], rows[::-1, -1], rows[0, ::-1]


# -- onto the kernel's shape -----------------------------------------------------------------------


def _put(grid: FaceGrid, deflection: float) -> None:
    count = len(grid.points)
    mesh = Poly_Triangulation(count, len(grid.triangles), True)
    node, place, triangle = mesh.SetNode, mesh.SetUVNode, mesh.SetTriangle
    # lists of numbers, column by column: rows would be as many objects to collect
    x, y, z, a, b = (column.tolist() for column in (*grid.points.T, *grid.parameters.T))
    for i in range(count):
        node(i + 1, gp_Pnt(x[i], y[i], z[i]))
        place(i + 1, gp_Pnt2d(a[i], b[i]))
    first, second, third = (column.tolist() for column in (grid.triangles + 1).T)
    for i in range(len(first)):
        triangle(i + 1, Poly_Triangle(first[i], second[i], third[i]))
    mesh.Deflection(deflection)
    builder = BRep_Builder()
    builder.UpdateFace(grid.patch.face, mesh)
    s, t = grid.lines
    rows = np.arange(1, count + 1).reshape(len(s), len(t))
    polygons: dict[int, dict[bool, Any]] = {}
    shares = (s, t, 1 - s[::-1], 1 - t[::-1])
    for side, nodes, along in zip(grid.patch.sides, _walk(rows), shares, strict=True):
        order = slice(None) if side.forward else slice(None, None, -1)
        own = polygons.setdefault(side.index, {})
        own[side.forward] = _polygon(nodes[order], side.along(along)[order])
    for side in grid.patch.sides:
        own = polygons.pop(side.index, {})
        if len(own) == 2:
            builder.UpdateEdge(side.edge, own[True], own[False], mesh)
        elif own:
            builder.UpdateEdge(side.edge, *own.values(), mesh)


def _polygon(nodes: Integers, parameters: Array) -> Any:
    indices = Array1OfInteger(1, len(nodes))
    places = Array1OfReal(1, len(nodes))
    for i, (node, parameter) in enumerate(
        zip(nodes.tolist(), parameters.tolist(), strict=True), start=1
    ):
        indices.SetValue(i, node)
        places.SetValue(i, parameter)
    result = Poly_PolygonOnTriangulation(indices, places)
    result.Deflection(0.0)
    return result
