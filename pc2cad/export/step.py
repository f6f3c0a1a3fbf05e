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
import threading
from typing import Any

from OCP.DE import DE_ShapeFixParameters
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Standard import Standard_Failure
from OCP.STEPCAFControl import STEPCAFControl_Controller, STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_Reader, STEPControl_StepModelType
from OCP.StepData import StepData_StepWriter
from OCP.TCollection import TCollection_AsciiString
from OCP.XSControl import XSControl_WorkSession

from pc2cad.brep.convex_faces import is_convex, is_convex_body
from pc2cad.brep.inside_out import inside_out
from pc2cad.brep.plane_solids import plane_solid
from pc2cad.errors import KernelError
from pc2cad.export import part21
from pc2cad.export.kernel import (
    UNIT_NAMES,
    Census,
    census,
    check_read_back,
    document,
    kernel_parameters,
    quiet_kernel,
)
from pc2cad.export.model import UNITS_IN_MM, Exportable, ExportOptions, StepSchema
from pc2cad.export.version import __version__

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

#: Steps of mending that are left to the checker, which looks at what was read, makes the same
#: searches on the same curves at the same tolerances, and refuses what would have been mended:
#: single edges that cross themselves (``BRepCheck_Wire::SelfIntersect``, ``ShapeAnalysis_Wire``'s
#: ``CheckSelfIntersectingEdge``), wires of a face that cross (``BRepCheck_Face``'s ``Intersect``,
#: ``ShapeFix_IntersectionTool::FixIntersectingWires``), and edges further from their curves on
#: faces than their tolerance (``BRepCheck_Edge::InContext``, ``ShapeFix_Edge::FixSameParameter``).
#: Whether a single shell is closed the checker tells as well, and whether it is inside out
#: `inside_out` asks with less effort; of several the reader makes solids in its own way.
SEARCHES = ("FixSelfIntersectingEdge", "FixIntersectingWires", "FixSameParameter")
#: Mending as a whole, of solids and what they are made of: for those of `brep.convex_faces`
ALL_MENDING = ("FixSolid", "FixSameParameter")


class _Sessions:
    """The kernel's sessions of a thread: they are emptied sooner than others are made.

    Nothing of a file is left for the next one: both begin with a new model, and with new maps.
    """

    _kept = threading.local()

    @classmethod
    def mine(cls) -> _Sessions:
        """Return those of this thread."""
        if not hasattr(cls._kept, "sessions"):
            cls._kept.sessions = cls()
        found: _Sessions = cls._kept.sessions
        return found

    def __init__(self) -> None:
        self.writing, self.reading = XSControl_WorkSession(), XSControl_WorkSession()
        self._writer = STEPCAFControl_Writer(self.writing, True)
        #: parameters of readers that leave some steps of mending out
        self.mending: dict[tuple[str, ...], Any] = {}

    def writer(self, exportable: Exportable) -> STEPCAFControl_Writer:
        """Return a writer without a model; what it knows of styles it would keep, so these not."""
        if exportable.layers or any(face.colour is not None for face in exportable.faces):
            return STEPCAFControl_Writer()
        self._writer.Init(self.writing, True)
        return self._writer

    def empty(self) -> None:
        """Let go of models and shapes."""
        self.writing.ClearData(1)
        self.reading.ClearData(1)


def encode(exportable: Exportable, options: ExportOptions) -> bytes:
    """Return the STEP file of `exportable`.

    The same input, time stamp and library versions give the same bytes at every call.

    Raises:
        InputError: the time stamp cannot be read.
        KernelError: there is no solid, it has coordinates that are not finite, the kernel refused
            it, or it does not read back as it was.

    """
    # Init also defines the parameters that are set below
    STEPCAFControl_Controller.Init_s()
    parameters = {
        **_PARAMETERS,
        "write.step.schema": _SCHEMA_NUMBERS[options.step_schema],
        "write.step.unit": UNIT_NAMES[exportable.units],
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
            originals = census(exportable)
            _check_text(text, originals)
            _check_read_back(text, originals, UNITS_IN_MM[exportable.units])
    except Standard_Failure as failure:
        raise KernelError(f"the kernel could not translate the solid to STEP: {failure}") from None
    finally:
        _Sessions.mine().empty()
    return text


def _product_name(exportable: Exportable) -> str:
    return part21.one_line(exportable.name) or "unnamed"


def _description(exportable: Exportable) -> list[str]:
    text = part21.lines(exportable.description)
    for sentence in exportable.evidence:
        text += part21.lines(sentence)
    if exportable.tolerance > 0.0 and not exportable.evidence:
        text.append(
            f"deviation from the equation at most {exportable.tolerance:.3g} {exportable.units}"
        )
    return text


def _strings(exportable: Exportable) -> dict[str, str]:
    """Return the text for each mark that `_document` puts in place of a name."""
    faces = (*exportable.faces, *exportable.interfaces)
    names = {f"F{i}": part21.one_line(face.name) for i, face in enumerate(faces)}
    names |= {f"S{i}": part21.one_line(layer.name) for i, layer in enumerate(exportable.layers)}
    return {"P": _product_name(exportable), **names}


def _kernel_text(exportable: Exportable) -> bytes:
    """Return the file as the kernel writes it, with marks for names and 17-digit numbers."""
    writer = _Sessions.mine().writer(exportable)
    writer.SetNameMode(True)
    writer.SetColorMode(True)
    writer.SetPropsMode(True)
    # of which there are none, and which take a while to be looked for
    writer.SetDimTolMode(False)
    if not writer.Transfer(
        document(exportable, part21.mark), STEPControl_StepModelType.STEPControl_AsIs
    ):
        raise KernelError("the kernel could not translate the solid to a STEP model")
    model = writer.ChangeWriter().Model()
    text_writer = StepData_StepWriter(model)
    numbers = text_writer.FloatWriter()
    numbers.SetFormat(part21.SAFE_FORMAT, True)
    numbers.SetFormatForRange(part21.EXACT_FORMAT, *part21.EXACT_RANGE)
    text_writer.SendModel(model.Protocol())
    # only a real BytesIO: an exception in a stream of our own would end the process
    stream = io.BytesIO()
    if not text_writer.CheckList().IsEmpty(True) or not text_writer.Print(stream):
        raise KernelError("the kernel could not write its STEP model as text")
    solid_names = part21.string(part21.mark("P"))
    text = stream.getvalue()
    for entity in (b"MANIFOLD_SOLID_BREP(", b"BREP_WITH_VOIDS("):
        text = text.replace(entity + b"''", entity + solid_names)
    if exportable.layers:
        # of several solids the kernel makes a representation of no kind
        text = text.replace(b"= SHAPE_REPRESENTATION(", b"= ADVANCED_BREP_SHAPE_REPRESENTATION(")
    return text


def _check_text(text: bytes, originals: list[Census]) -> None:
    """Refuse a text that does not hold the solids with every face of the originals."""
    solids = text.count(b"MANIFOLD_SOLID_BREP(") + text.count(b"BREP_WITH_VOIDS(")
    if solids != len(originals):
        raise KernelError(f"the STEP text holds {solids} solids instead of {len(originals)}")
    faces, there = text.count(b"ADVANCED_FACE("), sum(original.faces for original in originals)
    if faces != there:
        raise KernelError(f"the STEP text holds {faces} faces, the part has {there}")


def _check_read_back(text: bytes, originals: list[Census], unit_in_mm: float) -> None:
    """Read the file as another program would and compare it with the solid."""
    plain = originals[0].plain if len(originals) == 1 else None
    if plain is not None and is_convex(plain):
        # what reads back as such a solid is not mended by any reader
        shape = _read(text, unit_in_mm, ALL_MENDING)
        found = None if shape.IsNull() else plane_solid(shape)
        if found is not None and is_convex(found) and is_convex_body(found):
            check_read_back(shape, originals, "STEP text", found)
            return
    one_shell = [original.shells for original in originals] == [1]
    shape = _read(text, unit_in_mm, SEARCHES + ("FixShellOrientation",) * one_shell)
    check_read_back(shape, originals, "STEP text")
    if one_shell and inside_out(shape):
        raise KernelError("the STEP text reads back as a solid that readers turn inside out")


def _read(text: bytes, unit_in_mm: float, steps: tuple[str, ...]) -> Any:
    """Return the shape of a STEP text as the kernel reads it, without some steps of mending."""
    reader = STEPControl_Reader(_Sessions.mine().reading, True)
    # after a failed read, the transfer would end the process
    if reader.ReadStream("check", io.BytesIO(text)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise KernelError("the kernel cannot read the STEP text that it wrote")
    reader.SetSystemLengthUnit(unit_in_mm)
    _leave_out(reader, steps)
    reader.TransferRoots()
    if reader.NbShapes() != 1:
        raise KernelError(f"the STEP text reads back as {reader.NbShapes()} shapes, not as one")
    return reader.OneShape()


def _leave_out(reader: STEPControl_Reader, steps: tuple[str, ...]) -> None:
    """Have the reader mend everything but by some steps."""
    kept = _Sessions.mine().mending
    if steps not in kept:
        reader.SetShapeFixParameters(DE_ShapeFixParameters())
        parameters = reader.GetShapeFixParameters()
        off = TCollection_AsciiString("0")
        for step in steps:
            parameters.Bind(TCollection_AsciiString(f"FixShape.{step}Mode"), off)
        kept[steps] = type(parameters)(parameters)
    reader.SetShapeFixParameters(kept[steps])
