"""BREP, the kernel's own text format: the boundary representation as it is in memory.

Specification: https://dev.opencascade.org/doc/overview/html/specification__brep_format.html

It holds neither a unit nor names.
"""

from __future__ import annotations

import io

from OCP.BRep import BRep_Builder
from OCP.BRepTools import BRepTools
from OCP.Standard import Standard_Failure
from OCP.TopoDS import TopoDS_Shape
from OCP.TopTools import TopTools_FormatVersion

from pc2cad.errors import KernelError
from pc2cad.export.kernel import body, census, check_read_back
from pc2cad.export.model import Exportable, ExportOptions


def encode(exportable: Exportable, _options: ExportOptions) -> bytes:
    """Return the BREP file of `exportable`, coordinates in its unit.

    Raises:
        KernelError: there is no solid, the kernel refused it, or it does not read back as it was.

    """
    shape = body(exportable)
    stream, found = io.BytesIO(), TopoDS_Shape()
    try:
        # without the triangles that a viewer may have put upon the solid
        BRepTools.Write_s(
            shape, stream, False, False, TopTools_FormatVersion.TopTools_FormatVersion_VERSION_1
        )
        BRepTools.Read_s(found, io.BytesIO(stream.getvalue()), BRep_Builder())
    except Standard_Failure as failure:
        raise KernelError(f"the kernel could not write the solid as BREP: {failure}") from None
    check_read_back(found, census(exportable), "BREP text")
    return stream.getvalue()
