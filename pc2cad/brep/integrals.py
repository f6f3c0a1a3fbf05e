"""Volume, area and centroid of a kernel solid, integrated over the geometry it really holds.

The kernel's own integrals are too coarse to judge a solid by (1e-3 by default, and wrong by more
where a wavy edge bounds a plane). Here the divergence theorem is applied to the surfaces, curves
and orientations read back from the kernel: Gauss per knot span on splines, Green's theorem along
the edges of planes and of analytic surfaces.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepTools import BRepTools_WireExplorer
from OCP.Geom import Geom_BSplineSurface, Geom_Plane
from OCP.TopAbs import TopAbs_FACE, TopAbs_REVERSED, TopAbs_VERTEX, TopAbs_WIRE
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.linear import cross, symmetric
from pc2cad.brep.forms import FLUX, PAIRS, SECOND, Form
from pc2cad.brep.kernel import IndexedMapOfShape, as_face, as_vertex, as_wire
from pc2cad.brep.plane_solids import PlaneSolid, plane_solid
from pc2cad.brep.spline_integrals import spline_flux
from pc2cad.brep.trimmed_integrals import PlaneEdge, is_whole, plane_moments, trimmed_flux


@dataclass(frozen=True)
class SolidIntegrals:
    """Integrals of a solid in model units."""

    volume: float
    area: float
    centroid: tuple[float, float, float]
    #: of each face, in the kernel's order
    face_areas: tuple[float, ...]


class KnownFaces:
    """Integrals over faces that several solids share: each is integrated once, about one origin."""

    def __init__(self) -> None:
        self.origin: Array | None = None
        self._faces = IndexedMapOfShape()
        self._rows: list[Array] = []

    def row(self, face: TopoDS_Face, origin: Array) -> Array:
        """Return flux, area and moments of a face as it is turned."""
        sign = -1.0 if face.Orientation() == TopAbs_REVERSED else 1.0
        # the map takes a face and its reverse for one
        place = self._faces.FindIndex(face)
        if not place:
            self._faces.Add(face)
            row = _face(face, sign, origin)
            self._rows.append(np.concatenate((sign * row[:1], row[1:2], sign * row[2:])))
            place = len(self._rows)
        row = self._rows[place - 1]
        return np.concatenate((sign * row[:1], row[1:2], sign * row[2:]))


def solid_integrals(solid: TopoDS_Shape, known: KnownFaces | None = None) -> SolidIntegrals:
    """Return the integrals of one solid or several: planes, analytic and spline surfaces.

    Faces that are `known` from other solids of the part are not integrated again, and new ones are
    integrated one by one.
    """
    rows, origin = _rows(solid, known)
    if not len(rows):
        return SolidIntegrals(0.0, 0.0, (0.0, 0.0, 0.0), ())
    total = np.sum(rows, axis=0)
    volume, area = total[0] / 3, total[1]
    centre = total[2:] / (2 * volume) + origin if volume else origin
    return SolidIntegrals(
        float(volume), float(area), (float(centre[0]), float(centre[1]), float(centre[2])),
        tuple(rows[:, 1].tolist()),
    )  # fmt: skip


def _rows(solid: TopoDS_Shape, known: KnownFaces | None) -> tuple[Array, Array]:
    """Return flux, area and moments of all faces, and the origin of these."""
    straight = plane_solid(solid) if known is None else None
    walks = None if straight is None else straight.walks()
    if straight is not None and walks is not None:
        origin = np.asarray(straight.points.mean(axis=0))
        return _polygons(straight, walks, origin), origin
    faces, known = faces_of(solid), known or KnownFaces()
    if not faces:
        return np.empty((0, 5)), np.zeros(3)
    origin = known.origin = _reference(faces) if known.origin is None else known.origin
    return np.array([known.row(face, origin) for face in faces]), origin


def _polygons(solid: PlaneSolid, walks: tuple[Integers, Integers, Array], origin: Array) -> Array:
    """Return flux, area and moments of all faces of a solid, each a sum of triangles.

    Those of an edge with a point of the plane, in the sense in which the edge is walked: the face
    is what they cover once more one way than the other.
    """
    edge, face, turn = walks
    place, direction = solid.lines[edge, None, :3], solid.lines[edge, None, 3:]
    ends = place - origin + solid.ranges[edge, :, None] * direction
    bases = solid.planes[:, :3] - origin
    normals = cross(solid.planes[:, 6:9], solid.planes[:, 9:])
    corners = np.concatenate((bases[face, None], ends), axis=1)
    spans = ends - bases[face, None]
    area = turn / 2 * (cross(spans[:, 0], spans[:, 1]) * normals[face]).sum(axis=1)
    squares = (corners * corners).sum(axis=1) + corners.sum(axis=1) ** 2
    sums = np.zeros((len(bases), 4))
    np.add.at(sums, face, np.column_stack((area, squares * (area / 12)[:, None])))
    flux = sums[:, 0] * (bases * normals).sum(axis=1)
    return np.column_stack((flux, np.abs(sums[:, 0]), sums[:, 1:] * normals))


def second_moments(solid: TopoDS_Shape, about: Array) -> Array:
    """Return ∫ (r - c)_i (r - c)_j dV about a place c, (3, 3)."""
    total = np.sum([face_integrals(face, about, SECOND) for face in faces_of(solid)], axis=0)
    return symmetric(PAIRS, total[5:])


def face_integrals(face: TopoDS_Face, origin: Array, form: Form) -> Array:
    """Return the integrals of a form over a face with its outward normal, from `origin`."""
    return _face(face, -1.0 if face.Orientation() == TopAbs_REVERSED else 1.0, origin, form)


def _face(face: TopoDS_Face, sign: float, origin: Array, form: Form = FLUX) -> Array:
    surface = BRep_Tool.Surface_s(face)
    if isinstance(surface, Geom_Plane) and form is FLUX:
        return _plane(surface, face, sign, origin)
    if isinstance(surface, Geom_BSplineSurface) and is_whole(surface, face):
        return spline_flux(surface, sign, origin, form)
    return trimmed_flux(surface, face, sign, origin, form)


def faces_of(solid: TopoDS_Shape) -> list[TopoDS_Face]:
    """Return the faces of a shape in the kernel's order."""
    explorer, faces = TopExp_Explorer(solid, TopAbs_FACE), []
    while explorer.More():
        faces.append(as_face(explorer.Current()))
        explorer.Next()
    return faces


def _reference(faces: list[TopoDS_Face]) -> Array:
    """Return a point amid the part, so that nothing cancels for a part far from the origin."""
    points = []
    for face in faces:
        explorer = TopExp_Explorer(face, TopAbs_VERTEX)
        p = BRep_Tool.Pnt_s(as_vertex(explorer.Current()))
        points.append((p.X(), p.Y(), p.Z()))
    return np.asarray(np.mean(points, axis=0))


def _plane(surface: Geom_Plane, face: TopoDS_Face, sign: float, origin: Array) -> Array:
    """Integrate over a plane region by Green's theorem along its edges."""
    place, frame = surface.Location(), surface.Position()
    base = np.array([place.X(), place.Y(), place.Z()]) - origin
    axes = np.array([[d.X(), d.Y(), d.Z()] for d in (frame.XDirection(), frame.YDirection())])
    normal = sign * cross(axes[0], axes[1])
    moments = plane_moments(_edges_of(face), origin + base, axes)
    # the walk runs round the face's own orientation: take it back to the plane's
    area, p, q, pp, pq, qq = sign * moments
    result = np.empty(5)
    result[0] = area * (base @ normal)
    result[1] = abs(area)
    x, y = axes
    second = (
        base * base * area + 2 * base * (x * p + y * q) + x * x * pp + 2 * x * y * pq + y * y * qq
    )
    result[2:] = second * normal
    return result


def _edges_of(face: TopoDS_Face) -> Iterator[PlaneEdge]:
    """Yield the edges of a face, wire by wire."""
    explorer = TopExp_Explorer(face, TopAbs_WIRE)
    while explorer.More():
        wire = BRepTools_WireExplorer(as_wire(explorer.Current()), face)
        while wire.More():
            edge = wire.Current()
            first, last = BRep_Tool.Range_s(edge)
            sign = -1.0 if edge.Orientation() == TopAbs_REVERSED else 1.0
            yield BRep_Tool.Curve_s(edge, first, last), first, last, sign
            wire.Next()
        explorer.Next()
