"""Volume, area and centroid of a kernel solid, integrated over the geometry it really holds.

The kernel's own integrals are too coarse to judge a solid by (1e-3 by default, and wrong by more
where a wavy edge bounds a plane). Here the divergence theorem is applied to the surfaces, curves
and orientations read back from the kernel: Gauss per knot span on splines, Green's theorem along
the edges of planes and of analytic surfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_BSplineSurface, Geom_Plane
from OCP.TopAbs import TopAbs_FACE, TopAbs_REVERSED, TopAbs_VERTEX
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.linear import cross, symmetric
from pc2cad.brep.forms import FLUX, PAIRS, SECOND, Form
from pc2cad.brep.kernel import IndexedMapOfShape, as_face, as_vertex
from pc2cad.brep.patch_integrals import patch_integrals
from pc2cad.brep.plane_integrals import plane_integrals
from pc2cad.brep.plane_solids import PlaneSolid, plane_solid
from pc2cad.brep.spline_integrals import Patch, read_patch
from pc2cad.brep.trimmed_integrals import is_whole, trimmed_flux

#: what a face's integrals of `FLUX` are multiplied by where it is turned as its surface, or not
_FORWARD, _REVERSED = (1.0,) * 5, (-1.0, 1.0, -1.0, -1.0, -1.0)


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

    def rows(self, faces: Sequence[TopoDS_Face], origin: Array) -> Array:
        """Return flux, area and moments of faces as they are turned, (n, 5)."""
        # the map takes a face and its reverse for one
        places, new = [], []
        for face in faces:
            if not self._faces.Contains(face):
                new.append(face)
            places.append(self._faces.Add(face) - 1)
        self._rows += _face_rows(new, origin)
        rows = np.array([self._rows[place] for place in places])
        return np.asarray(rows * np.array([_turn(face) for face in faces]))


def _turn(face: TopoDS_Face) -> tuple[float, ...]:
    """Return what turns integrals of `FLUX` over a surface's normal to those over a face's."""
    return _REVERSED if face.Orientation() == TopAbs_REVERSED else _FORWARD


def solid_integrals(
    solid: TopoDS_Shape, known: KnownFaces | None = None, plain: PlaneSolid | None = None
) -> SolidIntegrals:
    """Return the integrals of one solid or several: planes, analytic and spline surfaces.

    Faces that are `known` from other solids of the part are not integrated again. `plain` are the
    numbers of the solid where they have been read.
    """
    rows, origin = _rows(solid, known, plain)
    if not len(rows):
        return SolidIntegrals(0.0, 0.0, (0.0, 0.0, 0.0), ())
    total = np.sum(rows, axis=0)
    volume, area = total[0] / 3, total[1]
    centre = total[2:] / (2 * volume) + origin if volume else origin
    return SolidIntegrals(
        float(volume), float(area), (float(centre[0]), float(centre[1]), float(centre[2])),
        tuple(rows[:, 1].tolist()),
    )  # fmt: skip


def _rows(
    solid: TopoDS_Shape, known: KnownFaces | None, plain: PlaneSolid | None
) -> tuple[Array, Array]:
    """Return flux, area and moments of all faces, and the origin of these."""
    straight = plain or plane_solid(solid) if known is None else None
    walks = None if straight is None else straight.walks
    if straight is not None and walks is not None:
        origin = np.asarray(straight.points.mean(axis=0))
        return _polygons(straight, walks, origin), origin
    faces, known = faces_of(solid), known or KnownFaces()
    if not faces:
        return np.empty((0, 5)), np.zeros(3)
    origin = known.origin = _reference(faces) if known.origin is None else known.origin
    return known.rows(faces, origin), origin


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
    turn = _turn(face)
    row = _face_rows([face], origin, form if turn is _FORWARD else form.turned())[0]
    return np.concatenate((turn * row[:5], row[5:]))


def _face_rows(faces: Sequence[TopoDS_Face], origin: Array, form: Form = FLUX) -> list[Array]:
    """Return the integrals of a form over faces with the normals of their surfaces, one by one.

    Those that are planes together, and those that are all of a spline.
    """
    rows: list[Array] = [np.empty(0)] * len(faces)
    planes, patches = dict[int, Geom_Plane](), dict[int, Patch]()
    for i, face in enumerate(faces):
        surface = BRep_Tool.Surface_s(face)
        if isinstance(surface, Geom_Plane) and form is FLUX:
            planes[i] = surface
        elif isinstance(surface, Geom_BSplineSurface) and is_whole(surface, face):
            patches[i] = read_patch(surface, origin)
        else:
            rows[i] = trimmed_flux(surface, face, 1.0, origin, form)
    found = plane_integrals([(planes[i], faces[i]) for i in planes], origin)
    for i, row in zip(planes, found, strict=True):
        rows[i] = row
    for i, row in zip(patches, patch_integrals(list(patches.values()), form), strict=True):
        rows[i] = row
    return rows


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
