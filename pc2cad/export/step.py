"""STEP, ISO 10303-21 with application protocol AP242 or AP214.

Specification: https://www.iso.org/standard/63141.html (exchange structure) and, for volume, area
and centroid in the file, the CAx-IF Recommended Practices for Geometric and Assembly Validation
Properties, release 4.4.

The kernel translates the solid into a STEP model in memory. `part21` makes its text exact and
puts names and header in. Then the bytes are read back by the kernel and compared with the solid:
nothing leaves this module that does not read back as it was.
"""

from __future__ import annotations

import io
import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.gp import gp_Pnt
from OCP.GProp import GProp_GProps
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Interface import Interface_Static
from OCP.Message import Message
from OCP.Quantity import Quantity_Color, Quantity_TypeOfColor
from OCP.ShapeAnalysis import ShapeAnalysis_ShapeTolerance
from OCP.Standard import Standard_Failure
from OCP.STEPCAFControl import STEPCAFControl_Controller, STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_Reader, STEPControl_StepModelType
from OCP.StepData import StepData_StepWriter
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopTools import TopTools_IndexedMapOfShape
from OCP.XCAFDoc import (
    XCAFDoc_Area,
    XCAFDoc_Centroid,
    XCAFDoc_ColorType,
    XCAFDoc_DocumentTool,
    XCAFDoc_Volume,
)

from pc2cad import __version__
from pc2cad.errors import KernelError
from pc2cad.export import part21
from pc2cad.export.model import UNITS_IN_MM, Exportable, ExportOptions, StepSchema

#: Relative difference of volume that reading back may show.
VOLUME_AGREEMENT = 1e-9
#: How much a tolerance may grow by reading back: readers recompute them with a margin.
TOLERANCE_GROWTH = 2.0

_UNIT_NAMES = {"mm": "MM", "cm": "CM", "m": "M", "in": "INCH"}
_SCHEMA_NUMBERS: dict[StepSchema, int] = {"AP214": 4, "AP242": 5}

#: Parameters of the kernel's translators; they belong to the process, hence are put back.
_PARAMETERS: dict[str, int | str] = {
    # pcurves are written: without them readers project every edge again (8 times slower here)
    "write.surfacecurve.mode": 1,
    # the uncertainty in the file is the largest tolerance of the solid
    "write.precision.mode": 1,
    "write.stepcaf.subshapes.name": 1,
    "write.step.assembly": 0,
    "write.step.nonmanifold": 0,
    "write.step.tessellated": 0,
    "read.precision.mode": 0,
    "read.maxprecision.mode": 0,
    "read.stdsameparameter.mode": 0,
    "read.surfacecurve.mode": 0,
    "read.step.nonmanifold": 0,
    "read.step.tessellated": 0,
    # only the fallback for readers that are not told a unit; given here against other plugins
    "xstep.cascade.unit": "MM",
}


@dataclass(frozen=True)
class _Census:
    """What must be the same in the solid and in the solid that is read back."""

    faces: int
    shells: int
    volume: float
    #: largest tolerance of a face, edge or vertex; a reader that has to mend raises it
    tolerance: float
    #: what rounding alone may do to the computed volume
    rounding: float


def encode(exportable: Exportable, options: ExportOptions) -> bytes:
    """Return the STEP file of `exportable`.

    The same input, time stamp and library versions give the same bytes at every call.

    Raises:
        InputError: the time stamp cannot be read.
        KernelError: there is no solid, it has coordinates that are not finite, the kernel refused
            it, or it does not read back as it was.

    """
    _check_solid(exportable.solid)
    # Init also defines the parameters that are set below
    STEPCAFControl_Controller.Init_s()
    parameters = {
        **_PARAMETERS,
        "write.step.schema": _SCHEMA_NUMBERS[options.step_schema],
        "write.step.unit": _UNIT_NAMES[exportable.units],
    }
    header = part21.Header(
        name=_product_name(exportable),
        description=_description(exportable),
        time_stamp=options.time_stamp(),
        system=f"pc2cad {__version__}",
    )
    try:
        with quiet_kernel(), kernel_parameters(parameters):
            text = part21.finish(_kernel_text(exportable), _strings(exportable), header)
            original = _census(exportable.solid, _rounding(exportable))
            _check_text(text, original)
            _check_read_back(text, original, UNITS_IN_MM[exportable.units])
    except Standard_Failure as failure:
        raise KernelError(f"The kernel could not translate the solid to STEP: {failure}.") from None
    return text


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
    try:
        for name, value in parameters.items():
            if not _set_parameter(name, value):
                raise KernelError(f"The kernel refused the parameter {name} = {value}.")
        yield
    finally:
        for name, value in before.items():
            _set_parameter(name, value)


def _set_parameter(name: str, value: int | str) -> bool:
    if isinstance(value, int):
        return bool(Interface_Static.SetIVal_s(name, value))
    return bool(Interface_Static.SetCVal_s(name, value))


@contextmanager
def quiet_kernel() -> Iterator[None]:
    """Keep the kernel from printing its statistics to standard output meanwhile."""
    messenger = Message.DefaultMessenger_s()
    printers = list(messenger.Printers())
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        yield
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)


def _check_solid(solid: Any) -> None:
    # a null handle would end the process
    if solid is None or solid.IsNull():
        raise KernelError("There is no solid to write.")
    if solid.ShapeType() != TopAbs_ShapeEnum.TopAbs_SOLID:
        kind = solid.ShapeType().name.removeprefix("TopAbs_").lower()
        raise KernelError(f"A solid is needed, but the shape is a {kind}.")
    # the document would write such a solid as an assembly of one part
    if not solid.Location().IsIdentity():
        raise KernelError("The solid has a location; move its geometry instead.")


def _product_name(exportable: Exportable) -> str:
    return part21.one_line(exportable.name) or "unnamed"


def _description(exportable: Exportable) -> list[str]:
    text = part21.lines(exportable.description)
    if exportable.tolerance > 0.0:
        text.append(
            f"deviation from the equation at most {exportable.tolerance:.3g} {exportable.units}"
        )
    return text


def _strings(exportable: Exportable) -> dict[str, str]:
    """Return the text for each mark that `_document` puts in place of a name."""
    names = {f"F{i}": part21.one_line(face.name) for i, face in enumerate(exportable.faces)}
    return {"P": _product_name(exportable), **names}


def _kernel_text(exportable: Exportable) -> bytes:
    """Return the file as the kernel writes it, with marks for names and 17-digit numbers."""
    document = _document(exportable)
    writer = STEPCAFControl_Writer()
    writer.SetNameMode(True)
    writer.SetColorMode(True)
    writer.SetPropsMode(True)
    if not writer.Transfer(document, STEPControl_StepModelType.STEPControl_AsIs):
        raise KernelError("The kernel could not translate the solid to a STEP model.")
    model = writer.ChangeWriter().Model()
    text_writer = StepData_StepWriter(model)
    numbers = text_writer.FloatWriter()
    numbers.SetFormat(part21.SAFE_FORMAT, True)
    numbers.SetFormatForRange(part21.EXACT_FORMAT, *part21.EXACT_RANGE)
    text_writer.SendModel(model.Protocol())
    # only a real BytesIO: an exception in a stream of our own would end the process
    stream = io.BytesIO()
    if not text_writer.CheckList().IsEmpty(True) or not text_writer.Print(stream):
        raise KernelError("The kernel could not write its STEP model as text.")
    solid_names = part21.string(part21.mark("P"))
    text = stream.getvalue()
    for entity in (b"MANIFOLD_SOLID_BREP(", b"BREP_WITH_VOIDS("):
        text = text.replace(entity + b"''", entity + solid_names)
    return text


def _document(exportable: Exportable) -> Any:
    """Return a kernel document with the solid, marks for names, colours and properties."""
    in_mm = UNITS_IN_MM[exportable.units]
    document = TDocStd_Document(TCollection_ExtendedString("XmlOcaf"))
    XCAFDoc_DocumentTool.SetLengthUnit_s(document, in_mm / 1000.0)
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colours = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    label = shapes.AddShape(exportable.solid, False)
    _set_name(label, "P")
    for i, face in enumerate(exportable.faces):
        part = shapes.AddSubShape(label, face.face)
        if part.IsNull():
            raise KernelError(f"The face {face.name!r} is not a face of the solid, or named twice.")
        _set_name(part, f"F{i}")
        if face.colour is not None:
            colour = Quantity_Color(*face.colour, Quantity_TypeOfColor.Quantity_TOC_sRGB)
            colours.SetColor(part, colour, XCAFDoc_ColorType.XCAFDoc_ColorSurf)
    figures = exportable.properties
    # the kernel declares square and cubic millimetres whatever the file's unit is
    XCAFDoc_Volume.Set_s(label, figures.volume * in_mm**3)
    XCAFDoc_Area.Set_s(label, figures.area * in_mm**2)
    XCAFDoc_Centroid.Set_s(label, gp_Pnt(*figures.centroid))
    return document


def _set_name(label: Any, key: str) -> None:
    TDataStd_Name.Set_s(label, TCollection_ExtendedString(part21.mark(key)))


def _census(solid: Any, rounding: float = 0.0) -> _Census:
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(solid, properties)
    return _Census(
        faces=_count(solid, TopAbs_ShapeEnum.TopAbs_FACE),
        shells=_count(solid, TopAbs_ShapeEnum.TopAbs_SHELL),
        volume=properties.Mass(),
        tolerance=ShapeAnalysis_ShapeTolerance().Tolerance(solid, 1),
        rounding=rounding,
    )


def _count(shape: Any, kind: Any) -> int:
    found = TopTools_IndexedMapOfShape()
    TopExp.MapShapes_s(shape, kind, found)
    return int(found.Extent())


def _rounding(exportable: Exportable) -> float:
    """Return what rounding may do to the volume that the kernel integrates about the origin."""
    figures = exportable.properties
    reach = max(abs(part) for part in figures.centroid) + math.sqrt(figures.area)
    return 8.0 * sys.float_info.epsilon * reach * figures.area


def _check_text(text: bytes, original: _Census) -> None:
    """Refuse a text that does not hold one solid with every face of the original."""
    solids = text.count(b"MANIFOLD_SOLID_BREP(") + text.count(b"BREP_WITH_VOIDS(")
    if solids != 1:
        raise KernelError(f"The STEP text holds {solids} solids instead of one.")
    faces = text.count(b"ADVANCED_FACE(")
    if faces != original.faces:
        raise KernelError(f"The STEP text holds {faces} faces, the solid has {original.faces}.")


def _check_read_back(text: bytes, original: _Census, unit_in_mm: float) -> None:
    """Read the file as another program would and compare it with the solid."""
    reader = STEPControl_Reader()
    # after a failed read, the transfer would end the process
    if reader.ReadStream("check", io.BytesIO(text)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise KernelError("The kernel cannot read the STEP text that it wrote.")
    reader.SetSystemLengthUnit(unit_in_mm)
    reader.TransferRoots()
    if reader.NbShapes() != 1:
        raise KernelError(f"The STEP text reads back as {reader.NbShapes()} shapes, not as one.")
    solid = reader.OneShape()
    _check_solid(solid)
    if not BRepCheck_Analyzer(solid).IsValid():
        raise KernelError("The STEP text reads back as a solid that is not valid.")
    found = _census(solid)
    if (found.faces, found.shells) != (original.faces, original.shells):
        raise KernelError(
            f"The STEP text reads back with {found.faces} faces in {found.shells} shells instead "
            f"of {original.faces} in {original.shells}."
        )
    if not found.tolerance <= TOLERANCE_GROWTH * original.tolerance:
        raise KernelError(
            f"The STEP text reads back with gaps of up to {found.tolerance:.3g}; the solid's "
            f"tolerance is {original.tolerance:.3g}."
        )
    allowed = VOLUME_AGREEMENT * abs(original.volume) + original.rounding
    # the negated form also refuses a volume that is no number
    if not abs(found.volume - original.volume) <= allowed:
        raise KernelError(
            f"The STEP text reads back with the volume {found.volume:.15g} instead of "
            f"{original.volume:.15g}."
        )
