"""What the exact formats share: checks of a solid before and after, and the kernel's manners."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from OCP.BRep import BRep_Builder
from OCP.BRepGProp import BRepGProp
from OCP.gp import gp_Pnt
from OCP.GProp import GProp_GProps
from OCP.Interface import Interface_Static
from OCP.Message import Message
from OCP.Quantity import Quantity_Color, Quantity_TypeOfColor
from OCP.ShapeAnalysis import ShapeAnalysis_ShapeTolerance
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_CompSolid
from OCP.XCAFDoc import (
    XCAFDoc_Area,
    XCAFDoc_Centroid,
    XCAFDoc_ColorType,
    XCAFDoc_DocumentTool,
    XCAFDoc_Volume,
)

from pc2cad.brep.checker import is_valid
from pc2cad.brep.integrals import solid_integrals
from pc2cad.brep.kernel import IndexedMapOfShape
from pc2cad.brep.plane_solids import SHELL, PlaneSolid, plane_solid
from pc2cad.brep.same_numbers import same_numbers
from pc2cad.errors import KernelError
from pc2cad.export.model import UNITS_IN_MM, Exportable

#: Units as the translators name them.
UNIT_NAMES = {"mm": "MM", "cm": "CM", "m": "M", "in": "INCH"}
#: Relative difference of volume that reading back may show.
VOLUME_AGREEMENT = 1e-9
#: How much a tolerance may grow by reading back: readers recompute them with a margin.
TOLERANCE_GROWTH = 2.0


@dataclass(frozen=True)
class Census:
    """What must be the same in the solid and in the solid that is read back."""

    solid: Any
    faces: int
    shells: int
    #: largest tolerance of a face, edge or vertex; a reader that has to mend raises it
    tolerance: float
    #: what rounding alone may do to the computed volume
    rounding: float
    #: all numbers of a solid of plane faces and straight edges
    plain: PlaneSolid | None

    def volume(self) -> float:
        """Return the volume as the kernel integrates it, which takes long."""
        properties = GProp_GProps()
        BRepGProp.VolumeProperties_s(self.solid, properties)
        return float(properties.Mass())


@contextmanager
def kernel_parameters(parameters: Mapping[str, int | str]) -> Iterator[None]:
    """Set process-wide parameters of the kernel's translators and put the old ones back.

    Raises:
        KernelError: the kernel does not know a parameter or refuses its value.

    """
    before = {
        name: Interface_Static.IVal_s(name)
        if isinstance(value, int)
        else Interface_Static.CVal_s(name)
        for name, value in parameters.items()
    }
    others = {name: value for name, value in parameters.items() if value != before[name]}
    try:
        for name, value in others.items():
            if not _set_parameter(name, value):
                raise KernelError(f"the kernel refused the parameter {name} = {value}")
        yield
    finally:
        for name in others:
            _set_parameter(name, before[name])


def _set_parameter(name: str, value: int | str) -> bool:
    if isinstance(value, int):
        return bool(Interface_Static.SetIVal_s(name, value))
    return bool(Interface_Static.SetCVal_s(name, value))


@contextmanager
def quiet_kernel() -> Iterator[None]:
    """Keep the kernel from printing its statistics to standard output meanwhile."""
    messenger = Message.DefaultMessenger_s()
    known = messenger.Printers()
    # to the end of an iteration the kernel's bindings take longer than all else here
    printers = [known.Value(i) for i in range(1, known.Size() + 1)]
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        yield
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)


def body(exportable: Exportable) -> Any:
    """Return the shape to be written: the solid, or its layers as solids that share faces.

    Raises:
        KernelError: a solid is missing, or cannot be written.

    """
    for solid in exportable.bodies:
        check_solid(solid)
    if not exportable.layers:
        return exportable.solid
    result, builder = TopoDS_CompSolid(), BRep_Builder()
    builder.MakeCompSolid(result)
    for solid in exportable.bodies:
        builder.Add(result, solid)
    return result


def check_solid(solid: Any) -> None:
    """Raise KernelError unless the shape is one solid, in place, that can be written."""
    # a null handle would end the process
    if solid is None or solid.IsNull():
        raise KernelError("there is no solid to write")
    if solid.ShapeType() != TopAbs_ShapeEnum.TopAbs_SOLID:
        kind = solid.ShapeType().name.removeprefix("TopAbs_").lower()
        raise KernelError(f"a solid is needed, but the shape is a {kind}")
    # the document would write such a solid as an assembly of one part
    if not solid.Location().IsIdentity():
        raise KernelError("the solid has a location; move its geometry instead")


def document(exportable: Exportable, name_of: Callable[[str], str]) -> Any:
    """Return a kernel document with the solid, names, colours and validation properties.

    `name_of` gives the name of the product, key ``P``, of its faces, ``F0``, ``F1`` …, and of its
    layers, ``S0``, ``S1`` …

    Raises:
        KernelError: a named face is no face of the solid, or is named twice.

    """
    in_mm = UNITS_IN_MM[exportable.units]
    result = TDocStd_Document(TCollection_ExtendedString("XmlOcaf"))
    XCAFDoc_DocumentTool.SetLengthUnit_s(result, in_mm / 1000.0)
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(result.Main())
    colours = XCAFDoc_DocumentTool.ColorTool_s(result.Main())
    label = shapes.AddShape(body(exportable), False)
    _set_name(label, name_of("P"))
    for i, layer in enumerate(exportable.layers):
        _set_name(shapes.AddSubShape(label, layer.solid), name_of(f"S{i}"))
    for i, face in enumerate((*exportable.faces, *exportable.interfaces)):
        part = shapes.AddSubShape(label, face.face)
        if part.IsNull():
            raise KernelError(f"the face {face.name!r} is not a face of the solid, or named twice")
        _set_name(part, name_of(f"F{i}"))
        if face.colour is not None:
            colour = Quantity_Color(*face.colour, Quantity_TypeOfColor.Quantity_TOC_sRGB)
            colours.SetColor(part, colour, XCAFDoc_ColorType.XCAFDoc_ColorSurf)
    figures = exportable.properties
    # the kernel declares square and cubic millimetres whatever the file's unit is
    XCAFDoc_Volume.Set_s(label, figures.volume * in_mm**3)
    XCAFDoc_Area.Set_s(label, figures.area * in_mm**2)
    XCAFDoc_Centroid.Set_s(label, gp_Pnt(*figures.centroid))
    return result


def _set_name(label: Any, name: str) -> None:
    TDataStd_Name.Set_s(label, TCollection_ExtendedString(name))


def census(exportable: Exportable) -> list[Census]:
    """Return what must be the same of each solid after reading back."""
    return [_census(solid, _rounding(exportable)) for solid in exportable.bodies]


def check_read_back(
    shape: Any, originals: list[Census], what: str, plain: PlaneSolid | None = None
) -> None:
    """Compare what was read back with the original; `what` names the file in messages.

    `plain` are the numbers of a single solid with plane faces where they have been read.

    Raises:
        KernelError: it is no valid solid, or as many as there were layers, or their counts,
            tolerances or volumes differ.

    """
    solids = [shape] if len(originals) == 1 else subshapes(shape, TopAbs_ShapeEnum.TopAbs_SOLID)
    if len(solids) != len(originals):
        raise KernelError(
            f"the {what} reads back as {len(solids)} solids instead of {len(originals)}"
        )
    for solid, original in zip(solids, originals, strict=True):
        _check_solid_read_back(solid, original, what, plain)


def _check_solid_read_back(
    solid: Any, original: Census, what: str, plain: PlaneSolid | None
) -> None:
    check_solid(solid)
    found = _census(solid, plain=plain)
    if not is_valid(solid, found.plain):
        raise KernelError(f"the {what} reads back as a solid that is not valid")
    if (found.faces, found.shells) != (original.faces, original.shells):
        raise KernelError(
            f"the {what} reads back with {found.faces} faces in {found.shells} shells instead "
            f"of {original.faces} in {original.shells}"
        )
    if not found.tolerance <= TOLERANCE_GROWTH * original.tolerance:
        raise KernelError(
            f"the {what} reads back with gaps of up to {found.tolerance:.3g}; the solid's "
            f"tolerance is {original.tolerance:.3g}"
        )
    if same_numbers(solid, original.solid, (found.plain, original.plain)):
        return
    # a reader may write the same shape in other numbers: splines for quadrics, seams elsewhere
    volume, there = found.volume(), original.volume()
    # the negated form also refuses a volume that is no number
    if not abs(volume - there) <= VOLUME_AGREEMENT * abs(there) + original.rounding:
        # the kernel's rule depends on how trimmed faces are cut into strips: ours decides
        volume, there = (solid_integrals(one).volume for one in (solid, original.solid))
    if not abs(volume - there) <= VOLUME_AGREEMENT * abs(there) + original.rounding:
        raise KernelError(
            f"the {what} reads back with the volume {volume:.15g} instead of {there:.15g}"
        )


def _census(solid: Any, rounding: float = 0.0, plain: PlaneSolid | None = None) -> Census:
    plain = plain or plane_solid(solid)
    if plain is not None:
        counts = len(plain.planes), plain.count(SHELL)
        return Census(solid, *counts, plain.tolerance, rounding, plain)
    return Census(
        solid=solid,
        faces=len(subshapes(solid, TopAbs_ShapeEnum.TopAbs_FACE)),
        shells=len(subshapes(solid, TopAbs_ShapeEnum.TopAbs_SHELL)),
        tolerance=ShapeAnalysis_ShapeTolerance().Tolerance(solid, 1),
        rounding=rounding,
        plain=None,
    )


def subshapes(shape: Any, kind: Any) -> list[Any]:
    """Return the different subshapes of one kind, in the kernel's order."""
    found = IndexedMapOfShape()
    TopExp.MapShapes_s(shape, kind, found)
    return [found.FindKey(i) for i in range(1, found.Extent() + 1)]


def _rounding(exportable: Exportable) -> float:
    """Return what rounding may do to the volume that the kernel integrates about the origin."""
    figures = exportable.properties
    reach = max(abs(part) for part in figures.centroid) + math.sqrt(figures.area)
    return 8.0 * sys.float_info.epsilon * reach * figures.area
