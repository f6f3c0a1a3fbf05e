"""VTP, VTK's XML format for surfaces: triangles in double precision with the side of each.

Specification: https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html

Cell data ``side`` numbers the sides; field data ``sides`` has their names, ``unit`` the unit.
Written by VTK itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.errors import KernelError, require
from pc2cad.export.model import Exportable, ExportOptions
from pc2cad.export.surface import faces_in_order, surface
from pc2cad.trust.names import clean


def encode(exportable: Exportable, options: ExportOptions) -> bytes:
    """Return the VTP file of `exportable`, coordinates in its unit.

    Raises:
        PackageMissingError: VTK, which comes with CadQuery, is not installed.
        InputError: the deflection is too fine for the size of the part.
        KernelError: the solid could not be meshed, or the text does not read back as it was.

    """
    require("vtkmodules", ".vtp files", "vtk")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    mesh = surface(exportable, options)
    data = polydata(mesh.vertices, mesh.triangles)
    sides = numpy_to_vtk(mesh.faces.astype(np.int32), deep=True)
    sides.SetName("side")
    data.GetCellData().AddArray(sides)
    data.GetFieldData().AddArray(
        _texts("sides", [clean(f.name) for f in faces_in_order(exportable)])
    )
    data.GetFieldData().AddArray(_texts("unit", [exportable.units]))
    writer = vtkXMLPolyDataWriter()
    writer.SetInputData(data)
    writer.WriteToOutputStringOn()
    if not writer.Write():
        raise KernelError("VTK could not write the triangles")
    text = writer.GetOutputString()
    encoded = text.encode() if isinstance(text, str) else bytes(text)
    _check(encoded, mesh.vertices, mesh.triangles)
    return encoded


def polydata(vertices: Array, triangles: Integers) -> Any:
    """Return a vtkPolyData of points, (n, 3), and triangles, (m, 3)."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    points = vtkPoints()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(vertices), deep=True))
    cells = vtkCellArray()
    corners = np.ascontiguousarray(triangles, dtype=np.int64)
    cells.SetData(3, numpy_to_vtkIdTypeArray(corners.ravel(), deep=True))
    data = vtkPolyData()
    data.SetPoints(points)
    data.SetPolys(cells)
    return data


def _texts(name: str, values: list[str]) -> Any:
    from vtkmodules.vtkCommonCore import vtkStringArray

    array = vtkStringArray()
    array.SetName(name)
    for value in values:
        array.InsertNextValue(value)
    return array


def _check(text: bytes, vertices: Array, triangles: Integers) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    reader = vtkXMLPolyDataReader()
    reader.ReadFromInputStringOn()
    reader.SetInputString(text.decode())
    reader.Update()
    found = reader.GetOutput()
    same = found.GetNumberOfPoints() == len(vertices) and found.GetNumberOfCells() == len(triangles)
    if not same or not (
        np.array_equal(vtk_to_numpy(found.GetPoints().GetData()), vertices)
        and np.array_equal(vtk_to_numpy(found.GetPolys().GetConnectivityArray()), triangles.ravel())
    ):
        raise KernelError("the VTP text reads back with other triangles")
