"""STL: the triangles of the solid's boundary, binary and as text.

Specification: https://www.loc.gov/preservation/digital/formats/fdd/fdd000505.shtml

Coordinates are single precision. Corners that rounding makes equal are one corner, triangles that
lose a corner by that are left out, and the rounded surface is checked again to be closed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pc2cad.arrays import Array
from pc2cad.export.model import Exportable, ExportOptions
from pc2cad.export.surface import single_precision, surface
from pc2cad.export.version import __version__
from pc2cad.trust.names import clean, percent

HEADER_SIZE = 80
#: words that readers look for wherever they stand: of the text variant, and of colours
WORDS = ("endsolid", "facet", "normal", "vertex", "color=", "material=")

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def encode(exportable: Exportable, options: ExportOptions) -> bytes:
    """Return the binary STL file of `exportable`, coordinates in its unit.

    Raises:
        InputError: the deflection is too fine for the size of the part.
        KernelError: the solid could not be meshed, or single precision is too coarse for it.

    """
    corners = facet_corners(exportable, options)
    facets = np.zeros(len(corners), dtype=_FACET)
    facets["corners"] = corners
    facets["normal"] = facet_normals(corners)
    count = len(corners).to_bytes(4, "little")
    return _header(exportable) + count + facets.tobytes()


def facet_corners(exportable: Exportable, options: ExportOptions) -> Array:
    """Return the corners of the facets, (m, 3, 3), as single precision holds them."""
    mesh = single_precision(surface(exportable, options), "STL")
    return mesh.vertices[mesh.triangles]


def facet_normals(corners: Array) -> Array:
    """Return unit normals, (m, 3), of triangles, (m, 3, 3); 0 where three corners are in line."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths: Any = np.linalg.norm(normals, axis=1, keepdims=True)
    unit: Array = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    return unit


def _header(exportable: Exportable) -> bytes:
    """Return 80 bytes of text; it must not start with "solid", the mark of the text variant.

    The last byte is NUL: admesh takes the header for a string of C, and prints what comes after it.
    """
    text = f"pc2cad {__version__} binary STL, unit {exportable.units}: "
    text += stl_name(exportable, HEADER_SIZE - 1 - len(text))
    return text.encode("ascii").ljust(HEADER_SIZE - 1) + b"\0"


def stl_name(exportable: Exportable, limit: int = 200) -> str:
    """Return the part's name in ASCII, other characters and the format's words as ``%XX``."""
    return percent(clean(exportable.name), "", limit=limit, words=WORDS)
