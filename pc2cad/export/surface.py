"""What the triangle formats share: the checked mesh of a part, single precision, names of faces."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopTools import TopTools_ShapeMapHasher

from pc2cad.arrays import Array, Integers
from pc2cad.brep.triangles import Triangles, edge_defects, enclosed_volume, tessellate, weld
from pc2cad.errors import KernelError
from pc2cad.export.kernel import subshapes
from pc2cad.export.model import Exportable, ExportOptions, NamedFace

#: Share of the volume that rounding to single precision may change.
ROUNDING_LIMIT = 1e-3


def surface(exportable: Exportable, options: ExportOptions) -> Triangles:
    """Return the closed triangles of a part in its own unit.

    Raises:
        InputError: the deflection is too fine for the size of the part.
        KernelError: the solid could not be meshed.

    """
    return tessellate(
        exportable.solid,
        deflection=options.deflection,
        angular_deflection=options.angular_deflection,
        volume=exportable.properties.volume,
        area=exportable.properties.area,
        tolerance=exportable.tolerance,
    )


def single_precision(mesh: Triangles, what: str, scale: float = 1.0) -> Triangles:
    """Return the mesh scaled and rounded to single precision, closed as before.

    Corners that rounding makes equal are one corner, and triangles that lose a corner by that are
    left out. `vertices` are doubles that single precision holds exactly. `what` names the format.

    Raises:
        KernelError: the rounded surface is not closed or has another volume.

    """
    with np.errstate(over="ignore"):
        rounded = (scale * mesh.vertices).astype(np.float32)
    vertices, triangles, remaining = weld(rounded, mesh.triangles)
    defects = edge_defects(triangles, len(vertices))
    finite = bool(np.isfinite(vertices).all())
    volume = scale**3 * mesh.volume
    change = enclosed_volume(vertices, triangles) - volume if finite else np.inf
    if not defects.closed or not abs(change) <= ROUNDING_LIMIT * volume:
        size = float(np.ptp(mesh.vertices, axis=0).max())
        distance = float(np.abs(mesh.vertices).max())
        raise KernelError(
            f"{what}'s single precision (7 digits) is too coarse for this part: it is "
            f"{size:.3g} large and lies up to {distance:.3g} from the origin; "
            "move it nearer to the origin or write STEP"
        )
    return dataclasses.replace(
        mesh,
        vertices=vertices.astype(np.float64),
        triangles=triangles,
        faces=mesh.faces[remaining],
        volume=volume + change,
    )


def faces_in_order(exportable: Exportable) -> tuple[NamedFace, ...]:
    """Return the named faces in the kernel's order, that of `Triangles.faces`; unnamed ones too."""
    named: dict[int, list[NamedFace]] = {}
    hasher: Any = TopTools_ShapeMapHasher()
    for face in exportable.faces:
        named.setdefault(hasher(face.face), []).append(face)
    result: list[NamedFace] = []
    for shape in subshapes(exportable.solid, TopAbs_ShapeEnum.TopAbs_FACE):
        found = [face for face in named.get(hasher(shape), []) if face.face.IsSame(shape)]
        result.append(found[0] if found else NamedFace(f"face {len(result) + 1}", shape))
    return tuple(result)


def smooth_normals(vertices: Array, triangles: Integers) -> Array:
    """Return unit normals, (n, 3), at the vertices of one smooth face, weighted by area."""
    corners = vertices[triangles]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    np.add.at(normals, triangles.ravel(), np.repeat(flat, 3, axis=0))
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    # a vertex with normals that cancel (the tip of a cusp) may point anywhere
    return np.where(lengths > 0.0, normals / np.where(lengths > 0.0, lengths, 1.0), (0.0, 0.0, 1.0))
