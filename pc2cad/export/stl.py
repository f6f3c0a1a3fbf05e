"""STL, binary: the triangles of the solid's boundary.

Specification: https://www.loc.gov/preservation/digital/formats/fdd/fdd000505.shtml

Coordinates are single precision. Corners that rounding makes equal are one corner, triangles that
lose a corner by that are left out, and the rounded surface is checked again to be closed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pc2cad import __version__
from pc2cad.errors import KernelError
from pc2cad.export.model import Exportable, ExportOptions
from pc2cad.export.part21 import one_line
from pc2cad.mesh.triangles import (
    IntArray,
    Triangles,
    edge_defects,
    enclosed_volume,
    tessellate,
    weld,
)

#: Share of the volume that rounding to single precision may change.
ROUNDING_LIMIT = 1e-3

HEADER_SIZE = 80

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def encode(exportable: Exportable, options: ExportOptions) -> bytes:
    """Return the binary STL file of `exportable`, coordinates in its unit.

    Raises:
        InputError: the deflection is too fine for the size of the part.
        KernelError: the solid could not be meshed, or single precision is too coarse for it.

    """
    mesh = tessellate(
        exportable.solid,
        deflection=options.deflection,
        angular_deflection=options.angular_deflection,
        reference_volume=exportable.properties.volume,
    )
    vertices, triangles = _rounded(mesh)
    corners = vertices[triangles]
    facets = np.zeros(len(triangles), dtype=_FACET)
    facets["corners"] = corners
    facets["normal"] = _normals(corners.astype(np.float64))
    count = len(triangles).to_bytes(4, "little")
    return _header(exportable) + count + facets.tobytes()


def _rounded(mesh: Triangles) -> tuple[NDArray[np.float32], IntArray]:
    """Return vertices (n, 3) in single precision and the triangles that are left, still closed."""
    with np.errstate(over="ignore"):
        rounded = mesh.vertices.astype(np.float32)
    vertices, triangles, _ = weld(rounded, mesh.triangles)
    defects = edge_defects(triangles, len(vertices))
    finite = bool(np.isfinite(vertices).all())
    change = enclosed_volume(vertices, triangles) - mesh.volume if finite else np.inf
    if not defects.closed or not abs(change) <= ROUNDING_LIMIT * mesh.volume:
        size = float(np.ptp(mesh.vertices, axis=0).max())
        distance = float(np.abs(mesh.vertices).max())
        raise KernelError(
            "STL's single precision (7 digits) is too coarse for this part: it is "
            f"{size:.3g} large and lies up to {distance:.3g} from the origin; "
            "move it nearer to the origin or write STEP."
        )
    return vertices.astype(np.float32), triangles


def _normals(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit normals, (m, 3), of triangles, (m, 3, 3); 0 where three corners are in line."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths: Any = np.linalg.norm(normals, axis=1, keepdims=True)
    unit: NDArray[np.float64] = np.divide(
        normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0
    )
    return unit


def _header(exportable: Exportable) -> bytes:
    """Return 80 bytes of text; it must not start with "solid", the mark of the text variant."""
    text = f"pc2cad {__version__} binary STL, unit {exportable.units}: {one_line(exportable.name)}"
    return text.encode("ascii", "replace")[:HEADER_SIZE].ljust(HEADER_SIZE)
