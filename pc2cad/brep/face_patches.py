"""Faces of four sides, on grids of their own parameters.

The sides' curves in the parameters are blended (Coons). Where all triangles of a grid have the same
sense in the parameter plane, the grid covers the face exactly once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_Plane
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.brep.from_kernel import path_function, surface_function
from pc2cad.brep.kernel import IndexedMapOfShape, as_edge, as_face
from pc2cad.errors import KernelError
from pc2cad.geometry.jets import CurveFunction, SurfaceFunction

#: share of the parameters' range by which a side may leave a line of the parameters
_STRAIGHT = 1e-12


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a face, as the walk round it goes."""

    edge: Any
    #: number of the edge in the shape
    index: int
    path: CurveFunction
    span: tuple[float, float]
    forward: bool
    degenerate: bool

    def at(self, shares: Array) -> Array:
        """Return the face's parameters at shares (n,) of the walk along this side."""
        return self.path.jet(self.along(shares))[0]

    def along(self, shares: Array) -> Array:
        """Return the edge's own parameters there."""
        first, last = self.span if self.forward else self.span[::-1]
        return np.asarray(first * (1 - shares) + last * shares)


@dataclass(frozen=True, eq=False)
class Patch:
    """A face of four sides; its grids run along shares s of the first side and t of the second."""

    face: Any
    sides: tuple[Side, Side, Side, Side]
    surface: SurfaceFunction

    def parameters(self, s: Array, t: Array) -> Array:
        """Return the parameters (n, m, 2) at ascending shares (n,) and (m,) from 0 to 1."""
        bottom, right = self.sides[0].at(s), self.sides[1].at(t)
        top, left = self.sides[2].at(1 - s), self.sides[3].at(1 - t)
        x, y = s[:, None, None], t[None, :, None]
        corners = ((1 - x) * ((1 - y) * bottom[0] + y * top[0])
                   + x * ((1 - y) * bottom[-1] + y * top[-1]))  # fmt: skip
        grid = ((1 - y) * bottom[:, None] + y * top[:, None]
                + (1 - x) * left[None] + x * right[None] - corners)  # fmt: skip
        grid[:, 0], grid[:, -1], grid[0], grid[-1] = bottom, top, left, right
        return np.asarray(grid)

    def places(self, grid: Array) -> tuple[Array, Array]:
        """Return points and normals (of any length), (n, m, 3), at parameters (n, m, 2)."""
        a, b = grid[:, :1, 0], grid[:1, :, 1]
        size = np.ptp(grid, axis=(0, 1)).max() * _STRAIGHT
        for turned in (False, True):
            if turned:
                a, b = grid[:1, :, 0], grid[:, :1, 1]
            if np.abs(grid[..., 0] - a).max() <= size and np.abs(grid[..., 1] - b).max() <= size:
                found = self.surface.on_grid(a.ravel(), b.ravel())
                return (found[0].swapaxes(0, 1), found[1].swapaxes(0, 1)) if turned else found
        point, along_a, along_b = self.surface.jet(*grid.reshape(-1, 2).T)
        shape = (*grid.shape[:2], 3)
        return point.reshape(shape), np.cross(along_a, along_b).reshape(shape)

    def breaks(self, direction: int) -> Array:
        """Return the shares along a direction at which the surface is not smooth, with both ends.

        Empty where it is not known: along an angle, and where sides are no lines of the parameters.
        """
        ends = self.sides[direction].at(np.array([0.0, 0.5, 1.0]))
        for axis in (0, 1):
            known, first, last = self.surface.breaks[axis], *ends[[0, 2], axis]
            straight = np.ptp(ends[:, 1 - axis]) <= _STRAIGHT * abs(last - first)
            even = abs(ends[1, axis] - (first + last) / 2) <= 1e-9 * abs(last - first)
            if known is not None and straight and even:
                shares = (known - first) / (last - first)
                return distinct([0.0, *shares[(shares > 1e-9) & (shares < 1 - 1e-9)], 1.0])
        return np.empty(0)


def patches_of(shape: Any) -> dict[int, Patch]:
    """Return the curved faces of a shape that a grid can cover, by their number in it."""
    edges, found = IndexedMapOfShape(), {}
    for number, face in enumerate(shapes_of(shape, TopAbs_ShapeEnum.TopAbs_FACE)):
        patch = _patch(as_face(face), edges)
        if patch is not None:
            found[number] = patch
    return found


def shapes_of(shape: Any, kind: Any) -> list[Any]:
    """Return the parts of a kind in the kernel's order, each as often as it is used."""
    explorer, found = TopExp_Explorer(shape, kind), []
    while explorer.More():
        found.append(explorer.Current())
        explorer.Next()
    return found


def _patch(face: Any, edges: Any) -> Patch | None:
    """Return a curved face that is bounded by four sides in a row, else None."""
    forward = as_face(face.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
    location = TopLoc_Location()
    surface = BRep_Tool.Surface_s(forward, location)
    shapes = shapes_of(forward, TopAbs_ShapeEnum.TopAbs_EDGE)
    wires = shapes_of(forward, TopAbs_ShapeEnum.TopAbs_WIRE)
    if isinstance(surface, Geom_Plane):  # the kernel needs no nodes inside
        return None
    if not location.IsIdentity() or len(wires) != 1 or len(shapes) != 4:
        return None
    try:
        sides = [_side(as_edge(edge), forward, edges) for edge in shapes]
        jets = surface_function(surface, np.zeros(3))
    except KernelError:
        return None
    ends = np.array([side.at(np.array([0.0, 1.0])) for side in sides])
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
    return Patch(forward, (a, b, c, d), jets)


def _side(edge: Any, face: Any, edges: Any) -> Side:
    curve = BRep_Tool.CurveOnSurface_s(edge, face, 0.0, 1.0)
    first, last = BRep_Tool.Range_s(edge, face)
    if curve is None:
        raise KernelError("an edge has no curve in the parameters of its face")
    forward = edge.Orientation() != TopAbs_Orientation.TopAbs_REVERSED
    degenerate = bool(BRep_Tool.Degenerated_s(edge))
    return Side(edge, edges.Add(edge), path_function(curve), (first, last), forward, degenerate)
