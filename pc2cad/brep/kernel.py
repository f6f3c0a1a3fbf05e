"""Names of the kernel that its versions 7.9 and 8 spell differently, and walks over its shapes.

Both spellings are known here only.

To import this module is to import OCP, and it may be done wherever that may.
"""

from __future__ import annotations

from collections.abc import Iterable

from OCP.BRep import BRep_Builder
from OCP.TopoDS import TopoDS, TopoDS_Compound, TopoDS_Iterator, TopoDS_Shape

try:
    from OCP.TColgp import TColgp_Array1OfPnt as Array1OfPnt
    from OCP.TColgp import TColgp_Array1OfPnt2d as Array1OfPnt2d
    from OCP.TColgp import TColgp_Array2OfPnt as Array2OfPnt
    from OCP.TColStd import TColStd_Array1OfInteger as Array1OfInteger
    from OCP.TColStd import TColStd_Array1OfReal as Array1OfReal
    from OCP.TDF import TDF_LabelSequence as LabelSequence
    from OCP.TopTools import (
        TopTools_IndexedDataMapOfShapeListOfShape as IndexedDataMapOfShapeListOfShape,
    )
    from OCP.TopTools import TopTools_IndexedMapOfShape as IndexedMapOfShape
    from OCP.TopTools import TopTools_ListOfShape as ListOfShape
except ImportError:  # 8
    from OCP import collections

    Array1OfInteger, Array1OfReal = collections.Array1_int, collections.Array1_double
    Array1OfPnt, Array1OfPnt2d = collections.Array1_gp_Pnt, collections.Array1_gp_Pnt2d
    Array2OfPnt = collections.Array2_gp_Pnt
    LabelSequence = collections.Sequence_TDF_Label
    ListOfShape = collections.List_TopoDS_Shape
    IndexedMapOfShape = collections.IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher
    IndexedDataMapOfShapeListOfShape = (
        collections.IndexedDataMap_TopoDS_Shape_List_TopoDS_Shape_TopTools_ShapeMapHasher
    )

if hasattr(TopoDS, "Edge_s"):
    as_vertex, as_edge, as_wire = TopoDS.Vertex_s, TopoDS.Edge_s, TopoDS.Wire_s
    as_face, as_shell, as_solid = TopoDS.Face_s, TopoDS.Shell_s, TopoDS.Solid_s
else:  # 8
    as_vertex, as_edge, as_wire = TopoDS.Vertex, TopoDS.Edge, TopoDS.Wire
    as_face, as_shell, as_solid = TopoDS.Face, TopoDS.Shell, TopoDS.Solid

__all__ = [
    "Array1OfInteger",
    "Array1OfPnt",
    "Array1OfPnt2d",
    "Array1OfReal",
    "Array2OfPnt",
    "IndexedDataMapOfShapeListOfShape",
    "IndexedMapOfShape",
    "LabelSequence",
    "ListOfShape",
    "as_edge",
    "as_face",
    "as_shell",
    "as_solid",
    "as_vertex",
    "as_wire",
    "children",
    "compound",
    "shapes_in",
]


def shapes_in(found: ListOfShape) -> list[TopoDS_Shape]:
    """Return the shapes of a list of the kernel's.

    Beginning to iterate over one costs as much as a hundred other calls, and most hold one or two.
    """
    size = found.Size()
    if size > 2:
        return [*found]
    return [found.First(), found.Last()][:size] if size else []


def children(shape: TopoDS_Shape) -> list[TopoDS_Shape]:
    """Return what a shape is made of, oriented and placed as it is there itself."""
    result, walk = [], TopoDS_Iterator(shape)
    while walk.More():
        result.append(walk.Value())
        walk.Next()
    return result


def compound(shapes: Iterable[TopoDS_Shape]) -> TopoDS_Compound:
    """Return shapes as one shape, in their order."""
    builder, result = BRep_Builder(), TopoDS_Compound()
    builder.MakeCompound(result)
    for shape in shapes:
        builder.Add(result, shape)
    return result
