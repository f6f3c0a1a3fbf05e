"""What triangles may be off by, from their own normals, edges and places in the parameters.

The chords of a triangle leave its surface by what the surface's normals at its corners say, and by
no more than the deflection; times the area of the triangle, summed, that bounds what the volume may
be off by. The angles between these normals and the triangle's own do the same for the area, and so
do the chords of the faces' edges. A face whose triangles do not cover what its edges enclose in the
parameter plane has lost a part of itself, whatever volume and area say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_Plane
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location

from pc2cad.arrays import Array, Integers
from pc2cad.brep.face_patches import shapes_of
from pc2cad.brep.from_kernel import curve_function, path_function, surface_function
from pc2cad.brep.kernel import as_edge, as_face
from pc2cad.brep.triangle_grids import parameter_areas
from pc2cad.errors import KernelError

#: share of the area in the parameters that rounding of nodes may take from a face
_COVERED = 1e-6
#: least cosine of an angle between a triangle and its surface that an area is bounded with
_STEEPEST = 0.1


@dataclass(frozen=True)
class Reference:
    """What a solid's triangles are compared with, in model units."""

    volume: float
    area: float | None = None
    #: how far the solid may be from what these figures belong to
    tolerance: float = 0.0


@dataclass(frozen=True)
class Slack:
    """What the triangles of a face, or of all, may differ from it by."""

    volume: float = 0.0
    area: float = 0.0
    #: numbers of the faces of which a part is not covered, or covered twice
    lost: frozenset[int] = frozenset()

    def __add__(self, other: Slack) -> Slack:
        return Slack(self.volume + other.volume, self.area + other.area, self.lost | other.lost)


def face_slack(
    number: int,
    face: Any,
    mesh: Any,
    nodes: Array,
    corners: Integers,
    normals: Array | None,
    deflection: float,
) -> Slack:
    """Return what one face's triangles may be off by.

    Args:
        number: of the face.
        face: TopoDS_Face with its triangulation.
        mesh: that Poly_Triangulation.
        nodes: its nodes, (n, 3), in the surface's own place.
        corners: its triangles, (m, 3), anti-clockwise in the parameters.
        normals: of the surface at the nodes, (n, 3), of triangles that are known to cover the face;
            None where neither is known.
        deflection: that the triangles were made with, model units.

    """
    location = TopLoc_Location()
    surface = BRep_Tool.Surface_s(face, location)
    areas = _flat(nodes, corners)[1]
    chords = _chords(face, mesh, location, deflection)
    if isinstance(surface, Geom_Plane):
        return Slack(0.0, chords)
    lost: frozenset[int] = frozenset()
    if normals is None:
        try:
            jets = surface_function(surface, np.zeros(3)).jet
        except KernelError:  # of a surface of another kind nothing but the deflection is known
            return Slack(float(areas.sum()) * deflection, float(areas.sum()))
        places = np.array([mesh.UVNode(i).Coord() for i in range(1, mesh.NbNodes() + 1)])
        normals = np.cross(*jets(places[:, 0], places[:, 1])[1:])
        if not _covers(face, mesh, location, parameter_areas(places, corners)):
            lost = frozenset({number})
    height, tilt = _bows(nodes, corners, normals)
    volume = float((areas * np.minimum(height, deflection)).sum())
    return Slack(volume, float((areas * tilt).sum()) + chords, lost)


def _flat(nodes: Array, corners: Integers) -> tuple[Array, Array]:
    """Return the unit normals (m, 3) and the areas (m,) of triangles."""
    a, b, c = (nodes[corners[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.sqrt((normals * normals).sum(axis=1))
    return normals / np.maximum(lengths, 1e-300)[:, None], lengths / 2


def _bows(nodes: Array, corners: Integers, normals: Array) -> tuple[Array, Array]:
    """Return how far the surface is from each triangle, and the share by which it is larger.

    Both from the surface's normals (n, 3) at the nodes; one without any, at a pole, says nothing.
    A chord e between normals a and b is off by (|a·e| + |b·e|)/8 in the middle, to third order in
    its length, and a triangle by 4/3 of the largest of its chords. What is above a triangle is
    larger by the tilt of the normals; beside it, over its edges, the surface leans out by the
    chord's bow times that tilt.
    """
    lengths = np.sqrt((normals * normals).sum(axis=1))
    known = lengths > 1e-9 * lengths.max(initial=0.0)
    units = np.where(known[:, None], normals / np.maximum(lengths, 1e-300)[:, None], 0.0)
    flat, areas = _flat(nodes, corners)
    height, cosine, beside = np.zeros(len(corners)), np.ones(len(corners)), np.zeros(len(corners))
    for k in range(3):
        i, j = corners[:, k], corners[:, (k + 1) % 3]
        edge = nodes[j] - nodes[i]
        slopes = sum(np.abs((units[end] * edge).sum(axis=1)) for end in (i, j))
        # the chord from a pole has one normal only, which counts for both
        bow = np.where(known[i] & known[j], slopes, 2 * slopes) / 8
        height = np.maximum(height, 4 * bow / 3)
        beside += 2 * bow / 3 * np.sqrt((edge * edge).sum(axis=1))
        own = np.where(known[i], np.abs((units[i] * flat).sum(axis=1)), 1.0)
        cosine = np.minimum(cosine, own)
    cosine = np.maximum(cosine, _STEEPEST)
    lean = beside * np.sqrt(1 - np.minimum(cosine, 1.0) ** 2) / cosine
    return height, 1 / cosine - 1 + lean / np.maximum(areas, 1e-300)


# -- the edges of a face ---------------------------------------------------------------------------


def _polygons(face: Any, mesh: Any, location: Any) -> list[tuple[Any, Array]]:
    """Return the edges of a face, and the parameters of their nodes."""
    found = []
    for shape in shapes_of(face, TopAbs_ShapeEnum.TopAbs_EDGE):
        edge = as_edge(shape)
        polygon = BRep_Tool.PolygonOnTriangulation_s(edge, mesh, location)
        if polygon is not None and polygon.HasParameters():
            places = [polygon.Parameter(i) for i in range(1, polygon.NbNodes() + 1)]
            found.append((edge, np.array(places)))
    return found


def _chords(face: Any, mesh: Any, location: Any, deflection: float) -> float:
    """Return the area between the edges of a face and their chords, at most."""
    total = 0.0
    for edge, places in _polygons(face, mesh, location):
        if BRep_Tool.Degenerated_s(edge) or BRep_Tool.IsClosed_s(edge, face):
            continue
        curve = BRep_Tool.Curve_s(edge, 0.0, 1.0)
        try:
            points = curve_function(curve, np.zeros(3)).jet(_with_middles(places))[0]
        except KernelError:
            points = np.array([curve.Value(t).Coord() for t in _with_middles(places)])
        start, middle, end = points[:-2:2], points[1::2], points[2::2]
        lengths, bows = (
            np.sqrt((x * x).sum(axis=1)) for x in (end - start, middle - (start + end) / 2)
        )
        total += float((lengths * np.minimum(bows, deflection)).sum())
    return total


def _with_middles(places: Array) -> Array:
    result = np.empty(2 * len(places) - 1)
    result[::2], result[1::2] = places, (places[1:] + places[:-1]) / 2
    return result


def _covers(face: Any, mesh: Any, location: Any, areas: Array) -> bool:
    """Say whether triangles of these areas cover once what the face's edges enclose."""
    forward = as_face(face.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
    enclosed = 0.0
    for edge, places in _polygons(forward, mesh, location):
        curve = BRep_Tool.CurveOnSurface_s(edge, forward, 0.0, 1.0)
        try:
            path = path_function(curve).jet(places)[0]
        except KernelError:  # nothing is known of this edge
            return True
        x, y = path.T
        part = float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) / 2
        enclosed += -part if edge.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else part
    whole = float(np.abs(areas).sum())
    return abs(whole - abs(enclosed)) <= _COVERED * max(whole, abs(enclosed))
