"""IGES 5.3 with a manifold solid B-rep object (entity 186).

Specification: https://web.archive.org/web/20180920102345/https://shop.iges5x.org/

The kernel translates the solid; its numbers are written with 17 digits, so that the same doubles
come back. Labels have eight characters at most.
"""

from __future__ import annotations

import io
import re
import tempfile
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert
from OCP.GeomAbs import GeomAbs_CurveType
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.IGESBasic import IGESBasic_Name
from OCP.IGESCAFControl import IGESCAFControl_Writer
from OCP.IGESControl import IGESControl_Controller, IGESControl_Reader
from OCP.IGESData import IGESData_IGESWriter
from OCP.Standard import Standard_Failure
from OCP.TCollection import TCollection_HAsciiString
from OCP.TopAbs import TopAbs_ShapeEnum

from pc2cad.brep.kernel import as_edge
from pc2cad.errors import KernelError
from pc2cad.export import part21
from pc2cad.export.kernel import (
    UNIT_NAMES,
    Census,
    census,
    check_read_back,
    check_solid,
    document,
    kernel_parameters,
    quiet_kernel,
    subshapes,
)
from pc2cad.export.model import Exportable, ExportOptions
from pc2cad.export.version import __version__
from pc2cad.trust.names import percent

#: Parameters of the kernel's translators; they belong to the process, hence are put back.
_PARAMETERS: dict[str, int | str] = {
    "write.iges.brep.mode": 1,
    "write.convertsurface.mode": 0,
    "write.precision.mode": 1,
    "read.precision.mode": 0,
    "read.maxprecision.mode": 0,
    "read.stdsameparameter.mode": 0,
    "read.surfacecurve.mode": 0,
    # knots of low continuity stay as they are
    "read.iges.bspline.continuity": 0,
}


def encode(exportable: Exportable, options: ExportOptions) -> bytes:
    """Return the IGES file of `exportable`.

    The same input, time stamp and library versions give the same bytes at every call.

    Raises:
        InputError: the time stamp cannot be read.
        KernelError: there is no solid, the kernel refused it, or it does not read back as it was.

    """
    exportable = exportable.whole()
    check_solid(exportable.solid)
    exportable = _without_ellipses(exportable)
    # Init also defines the parameters that are set below
    IGESControl_Controller.Init_s()
    unit = UNIT_NAMES[exportable.units]
    stamp = datetime.fromisoformat(options.time_stamp()).strftime("%Y%m%d.%H%M%S")
    try:
        # the unit of the file, and of the coordinates here, in writing and in reading
        units = {"write.iges.unit": unit, "xstep.cascade.unit": unit}
        with quiet_kernel(), kernel_parameters({**_PARAMETERS, **units}):
            text = _text(exportable, stamp)
            _check(text, census(exportable))
    except Standard_Failure as failure:
        raise KernelError(f"the kernel could not translate the solid to IGES: {failure}") from None
    return text


def _without_ellipses(exportable: Exportable) -> Exportable:
    """Return the same solid on rational splines where an edge is an ellipse.

    The kernel's translator gives ellipses another parameter than their faces, and a closed one
    another start.
    """
    edges = subshapes(exportable.solid, TopAbs_ShapeEnum.TopAbs_EDGE)
    kinds = {BRepAdaptor_Curve(as_edge(edge)).GetType() for edge in edges}
    if GeomAbs_CurveType.GeomAbs_Ellipse not in kinds:
        return exportable
    converted = BRepBuilderAPI_NurbsConvert(exportable.solid, True)
    faces = tuple(replace(f, face=converted.ModifiedShape(f.face)) for f in exportable.faces)
    return replace(exportable, solid=converted.Shape(), faces=faces)


def _text(exportable: Exportable, stamp: str) -> bytes:
    writer = IGESCAFControl_Writer()
    writer.SetNameMode(True)
    writer.SetColorMode(True)
    names = {f"F{i}": _ascii(face.name) for i, face in enumerate(exportable.faces)}
    names["P"] = _ascii(exportable.name) or "unnamed"
    if not writer.Transfer(document(exportable, lambda key: names[key])):
        raise KernelError("the kernel could not translate the solid to an IGES model")
    writer.ComputeModel()
    model = writer.Model()
    _order_names(model)
    _head(model, _ascii(exportable.name) or "unnamed", stamp)
    text_writer = IGESData_IGESWriter(model)
    numbers = text_writer.FloatWriter()
    numbers.SetFormat(part21.SAFE_FORMAT, True)
    numbers.SetFormatForRange(part21.EXACT_FORMAT, *part21.EXACT_RANGE)
    text_writer.SendModel(model.Protocol())
    stream = io.BytesIO()  # only a real BytesIO: an exception in ours would end the process
    if not text_writer.Print(stream):
        raise KernelError("the kernel could not write its IGES model as text")
    return stream.getvalue()


def _order_names(model: Any) -> None:
    """Give the entities of names to those that they name in the order of both in the file.

    The kernel appends them in the order of its addresses, which is another in every process.
    """
    entities = [model.Entity(i) for i in range(1, model.NbEntities() + 1)]
    names = [entity for entity in entities if isinstance(entity, IGESBasic_Name)]
    kind = IGESBasic_Name.get_type_descriptor_s()
    named = [(e, e.TypedProperty(kind)) for e in entities if e.NbTypedProperties(kind) == 1]
    texts = [name.Value().ToCString() for _, name in named]
    for entity, name in named:
        entity.RemoveProperty(name)
    for (entity, _), name, text in zip(named, names, texts, strict=True):
        name.Init(1, TCollection_HAsciiString(text))
        entity.AddProperty(name)


def _head(model: Any, name: str, stamp: str) -> None:
    """Fill the global section: what the kernel takes from the machine says nothing of the part."""

    def text(value: str) -> Any:
        return TCollection_HAsciiString(value)

    head = model.GlobalSection()
    head.SetSendName(text(name))
    head.SetReceiveName(text(name))
    head.SetFileName(text(name))
    head.SetAuthorName(text(""))
    head.SetCompanyName(text(""))
    head.SetSystemId(text(f"pc2cad {__version__}"))
    head.SetDate(text(stamp))
    head.SetLastChangeDate(text(stamp))
    model.SetGlobalSection(head)


def _ascii(text: str) -> str:
    """Return a name in ASCII, what else it holds as ``%XX``: strings here are counted in bytes."""
    # the kernel takes what begins like a counted string, 3Hole, for one, and its count away
    counted = re.match(r"\d+ *H", text)
    return percent(text, "", limit=60, words=[counted[0]] if counted else ())


def _check(text: bytes, originals: list[Census]) -> None:
    """Read the file as another program would and compare it with the solid."""
    reader = IGESControl_Reader()
    # the kernel reads IGES from files only
    with tempfile.TemporaryDirectory(prefix="pc2cad-") as folder:
        path = Path(folder) / "check.igs"
        path.write_bytes(text)
        if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise KernelError("the kernel cannot read the IGES text that it wrote")
    reader.TransferRoots()
    if reader.NbShapes() != 1:
        raise KernelError(f"the IGES text reads back as {reader.NbShapes()} shapes, not as one")
    check_read_back(reader.OneShape(), originals, "IGES text")
