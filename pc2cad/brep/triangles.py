"""Triangles of the solid's boundary: closed, oriented outwards, checked edge by edge.

Input: a TopoDS_Solid and how fine the chords must be. Output: `Triangles`, plain arrays.
The kernel meshes a copy, so the solid itself carries no triangulation afterwards and a later,
finer or coarser, mesh is not affected.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.Standard import Standard_Failure
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location

from pc2cad.arrays import AnyArray, Array, Booleans, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.brep.face_patches import shapes_of
from pc2cad.brep.kernel import as_face
from pc2cad.brep.tolerance import KERNEL_TOLERANCE
from pc2cad.brep.triangle_agreement import Reference, Slack, face_slack
from pc2cad.brep.triangle_borders import Borders
from pc2cad.brep.triangle_grids import attach
from pc2cad.brep.triangle_integrals import triangle_integrals
from pc2cad.errors import InputError, KernelError

#: Deflection that is tried first, as a share of the bounding box' diagonal.
FIRST_DEFLECTION = 1e-3
#: Finest deflection that is accepted; below it the kernel's mesher may not come to an end.
FINEST_DEFLECTION = 1e-5
#: Share of the diagonal that is tried where a coarser deflection comes to nothing.
TELLING_DEFLECTION = 0.05
#: Finest angle that refinement goes to, in radians.
FINEST_ANGLE = 0.01
#: Share of the volume that a mesh of unspecified deflection may differ by, and how often the
#: deflection is halved to get there.
VOLUME_AGREEMENT = 0.01
REFINEMENTS = 6


@dataclass(frozen=True)
class Triangles:
    """A closed triangulated surface, oriented outwards."""

    #: corner points, (n, 3), in the model's unit; no two are equal
    vertices: Array
    #: corners of each triangle as rows of `vertices`, (m, 3), counter-clockwise from outside
    triangles: Integers
    #: number of the solid's face (in the kernel's order, from 0) under each triangle, (m,)
    faces: Integers
    #: enclosed volume
    volume: float
    #: deflection with which the kernel made the mesh, in the model's unit
    deflection: float


@dataclass(frozen=True)
class EdgeDefects:
    """Directed edges that keep a triangulated surface from being closed; all 0 if it is."""

    #: directed edges without the same edge in the other direction
    open: int
    #: directed edges that occur more than once
    repeated: int

    @property
    def closed(self) -> bool:
        """Whether every edge has exactly one triangle on either side."""
        return self.open == 0 and self.repeated == 0


def tessellate(
    solid: Any,
    *,
    deflection: float | None = None,
    angular_deflection: float = 0.3,
    volume: float | None = None,
    area: float | None = None,
    tolerance: float = 0.0,
) -> Triangles:
    """Return closed triangles of the boundary of `solid`.

    Args:
        solid: TopoDS_Solid.
        deflection: largest distance between chord and surface, model units. Without it the mesh
            starts at 1/1000 of the bounding box' diagonal, and both deflections are halved
            until its volume is within 1 % of `volume`: so thin walls keep their thickness and
            long rods their section.
        angular_deflection: largest angle between neighbouring chords, radians.
        volume: of the part, model units; the triangles' may differ by what their chords can be off
            by, whatever the deflection.
        area: of the part, likewise.
        tolerance: how far the solid may be from the part with that volume and area.

    Raises:
        InputError: the deflection is too fine for the size of the part.
        KernelError: the triangles are not closed, inside out, do not cover a face, or have another
            volume or area than they can have.

    """
    diagonal = _diagonal(solid)
    reference = Reference(volume, area, tolerance) if volume is not None else None
    if deflection is not None:
        if not deflection >= FINEST_DEFLECTION * diagonal:
            raise InputError(
                f"the deflection {deflection:g} is too fine for a part of size {diagonal:g}; "
                f"give at least {FINEST_DEFLECTION * diagonal:.3g}"
            )
        return _agreeing(solid, deflection, angular_deflection, reference)
    return _refined(solid, FIRST_DEFLECTION * diagonal, angular_deflection, reference)


def _refined(solid: Any, length: float, angle: float, reference: Reference | None) -> Triangles:
    """Return triangles whose volume agrees with the part's: both deflections are halved till then.

    The first do where there is no volume to agree with.
    """
    deviation = math.inf
    for _ in range(1 + REFINEMENTS):
        result = _agreeing(solid, length, angle, reference)
        if reference is None:
            return result
        deviation = abs(result.volume - reference.volume) / abs(reference.volume)
        if deviation <= VOLUME_AGREEMENT:
            return result
        length, angle = length / 2.0, max(angle / 2.0, FINEST_ANGLE)
    raise KernelError(
        f"the volume of the triangle mesh is still {100.0 * deviation:.2g} % off after "
        f"{REFINEMENTS} refinements; give a deflection to accept that"
    )


def _agreeing(
    solid: Any, deflection: float, angle: float, reference: Reference | None
) -> Triangles:
    """Return triangles that cover every face and have the volume and area that they can have.

    First on grids of the faces that can have one, then as the kernel meshes all of the solid; and
    if all that is too coarse to be told, finer.
    """
    failure: KernelError | None = None
    telling = TELLING_DEFLECTION * _diagonal(solid)
    for length in (deflection, telling) if deflection > telling else (deflection,):
        for gridded in (True, False):
            try:
                mesh, slack = _mesh(solid, length, angle, gridded)
            except KernelError as error:
                complaint = error
            else:
                text = _complaint(mesh, slack, reference)
                if text is None:
                    return mesh
                complaint = KernelError(text)
            failure = failure or complaint
        if reference is None:
            break
    assert failure is not None
    raise failure


def _complaint(mesh: Triangles, slack: Slack, reference: Reference | None) -> str | None:
    """Return what the triangles lack, as a sentence; None where nothing is known of it."""
    lost = (
        f"the triangles of {len(slack.lost)} of the solid's faces do not cover them, at the "
        f"deflection {mesh.deflection:g}; give another deflection, or write STEP"
    )
    if reference is None:
        return lost if slack.lost else None
    found = triangle_integrals(mesh.vertices, mesh.triangles)
    size = float(np.abs(mesh.vertices).max())
    off = reference.tolerance + KERNEL_TOLERANCE + 1e3 * float(np.finfo(float).eps) * size
    pairs = [("volume", found.volume, reference.volume, slack.volume + off * found.area)]
    if reference.area is not None:
        # along an edge, a distance costs its length; and no edge is longer than a triangle's
        border = found.area * off / math.sqrt(found.area / len(mesh.triangles))
        pairs.append(("area", found.area, reference.area, slack.area + border))
    for name, own, true, bound in pairs:
        if not abs(own - true) <= bound:
            return (
                f"the {name} of the triangles is {own:.6g} at the deflection {mesh.deflection:g}, "
                f"and the part's is {true:.6g}: more than the {bound:.2g} that their chords can be "
                "off by; give a smaller deflection, or write STEP"
            )
    return lost if slack.lost else None


def edge_defects(triangles: Integers, vertex_count: int) -> EdgeDefects:
    """Count the directed edges of `triangles`, (m, 3), that keep the surface from being closed."""
    start = triangles.ravel()
    end = np.roll(triangles, -1, axis=1).ravel()
    ahead, back = np.sort(start * vertex_count + end), np.sort(end * vertex_count + start)
    if np.array_equal(ahead, back) and (np.diff(ahead) > 0).all():
        return EdgeDefects(0, 0)
    forward, counts = np.unique(ahead, return_counts=True)
    backward = distinct(back)
    lonely = np.setdiff1d(forward, backward, assume_unique=True)
    return EdgeDefects(open=int(lonely.size), repeated=int((counts - 1).sum()))


def weld(points: AnyArray, triangles: Integers) -> tuple[AnyArray, Integers, Booleans]:
    """Merge equal points and drop the triangles that lose a corner by that.

    Args:
        points: (n, 3), of any precision.
        triangles: (m, 3), rows of `points`.

    Returns:
        The distinct points, the remaining triangles, and which of the m triangles remain.

    """
    # adding 0 turns -0 into 0, which is the same place
    distinct, renumbering = np.unique(points + 0, axis=0, return_inverse=True)
    renumbered = renumbering.reshape(-1)[triangles]
    following = np.roll(renumbered, -1, axis=1)
    remaining = (renumbered != following).all(axis=1)
    return distinct, renumbered[remaining].astype(np.int64), remaining


def enclosed_volume(vertices: AnyArray, triangles: Integers) -> float:
    """Return the volume enclosed by closed `triangles`; negative if they face inwards."""
    if triangles.size == 0:
        return 0.0
    points = vertices.astype(np.float64)
    # about the middle, because far from the origin the terms would cancel
    points = points - points.mean(axis=0)
    first, second, third = (points[triangles[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", first, np.cross(second, third)) / 6.0)


def _mesh(
    solid: Any, deflection: float, angular_deflection: float, gridded: bool = True
) -> tuple[Triangles, Slack]:
    points, triangles, faces, slack = _kernel_mesh(solid, deflection, angular_deflection, gridded)
    vertices, triangles, remaining = weld(points, triangles)
    defects = edge_defects(triangles, len(vertices))
    if not defects.closed:
        raise KernelError(
            f"the kernel's triangle mesh is not closed: of {3 * len(triangles)} directed edges "
            f"{defects.open} are open and {defects.repeated} are repeated"
        )
    volume = enclosed_volume(vertices, triangles)
    if not volume > 0.0:
        raise KernelError(f"the triangle mesh encloses the volume {volume:g}; it must be positive")
    mesh = Triangles(
        vertices=vertices.astype(np.float64),
        triangles=triangles,
        faces=faces[remaining],
        volume=volume,
        deflection=deflection,
    )
    return mesh, slack


def _kernel_mesh(
    solid: Any, deflection: float, angular_deflection: float, gridded: bool
) -> tuple[Array, Integers, Integers, Slack]:
    """Return points (n, 3), triangles (m, 3), face numbers (m,), and what they may be off by."""
    try:
        # neither geometry nor triangulation is copied: only the topology that carries the mesh
        copy = BRepBuilderAPI_Copy(solid, False, False).Shape()
        grids = attach(copy, deflection, angular_deflection) if gridded else {}
        BRepMesh_IncrementalMesh(copy, deflection, False, angular_deflection, False)
    except Standard_Failure as failure:
        raise KernelError(f"the kernel could not mesh the solid: {failure}") from None
    points: list[Array] = []
    triangles: list[Integers] = []
    borders, slack = Borders(copy), Slack()
    offset = 0
    for number, shape in enumerate(shapes_of(copy, TopAbs_ShapeEnum.TopAbs_FACE)):
        face, location = as_face(shape), TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(face, location)
        if mesh is None:
            raise KernelError(f"the kernel could not mesh face {number} of the solid")
        grid = grids.get(number)
        if grid is not None and len(grid.triangles) == mesh.NbTriangles():
            nodes, corners, normals = grid.points, grid.triangles, grid.normals
        else:
            nodes, corners, normals = *_own_mesh(mesh), None
        borders.add(face, mesh, location, offset)
        slack += face_slack(number, face, mesh, nodes, corners, normals, deflection)
        nodes, corners = _placed(face, location, nodes, corners)
        points.append(nodes)
        triangles.append(corners + offset)
        offset += len(nodes)
    if not points:
        raise KernelError("the solid has no faces to mesh")
    all_points = np.concatenate(points)
    if not np.isfinite(all_points).all():
        raise KernelError("the kernel's triangle mesh has points that are not finite")
    numbers = np.repeat(np.arange(len(triangles), dtype=np.int64), [len(t) for t in triangles])
    return all_points[borders.representatives(offset)], np.concatenate(triangles), numbers, slack


def _own_mesh(mesh: Any) -> tuple[Array, Integers]:
    """Return the nodes, (n, 3), and triangles, (m, 3), of a triangulation as it stands."""
    nodes = np.array([mesh.Node(i).Coord() for i in range(1, mesh.NbNodes() + 1)])
    corners = np.array([mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)])
    return nodes, corners.reshape(-1, 3).astype(np.int64) - 1


def _placed(face: Any, location: Any, nodes: Array, corners: Integers) -> tuple[Array, Integers]:
    """Return nodes and triangles of one face where it is, seen from outside."""
    inwards = face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
    if not location.IsIdentity():
        transformation = location.Transformation()
        rows = [[transformation.Value(i, j) for j in range(1, 5)] for i in range(1, 4)]
        matrix = np.array(rows)
        nodes = nodes @ matrix[:, :3].T + matrix[:, 3]
        inwards ^= bool(transformation.IsNegative())
    return nodes, corners[:, ::-1] if inwards else corners


def _diagonal(solid: Any) -> float:
    box = Bnd_Box()
    BRepBndLib.Add_s(solid, box, False)
    if box.IsVoid():
        raise KernelError("the solid has no extent")
    diagonal = math.sqrt(box.SquareExtent())
    if not 0.0 < diagonal < math.inf:
        raise KernelError("the solid's size is not finite")
    return diagonal
