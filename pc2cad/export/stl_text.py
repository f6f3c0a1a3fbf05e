"""STL as text; the numbers are those of the binary variant, which is a fifth as large.

Specification: https://www.loc.gov/preservation/digital/formats/fdd/fdd000506.shtml
"""

from __future__ import annotations

from pc2cad.export.model import Exportable, ExportOptions
from pc2cad.export.stl import facet_corners, facet_normals, stl_name

#: nine digits give every single-precision number back
_FACET = (
    "facet normal {:.9g} {:.9g} {:.9g}\nouter loop\n"
    + 3 * "vertex {:.9g} {:.9g} {:.9g}\n"
    + "endloop\nendfacet\n"
)


def encode(exportable: Exportable, options: ExportOptions) -> bytes:
    """Return the STL text of `exportable`, coordinates in its unit.

    Raises:
        InputError: the deflection is too fine for the size of the part.
        KernelError: the solid could not be meshed, or single precision is too coarse for it.

    """
    corners = facet_corners(exportable, options)
    normals = (facet_normals(corners) + 0.0).tolist()  # without negative zeros
    title = f"{stl_name(exportable)} unit {exportable.units}"
    rows = corners.reshape(len(corners), 9).tolist()
    facets = (_FACET.format(*n, *c) for n, c in zip(normals, rows, strict=True))
    return f"solid {title}\n{''.join(facets)}endsolid {title}\n".encode("ascii")
