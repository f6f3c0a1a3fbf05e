"""3MF, core specification with triangle sets and the materials extension for colours.

Specification: https://3mf.io/spec/

Written by the 3MF Consortium's own library, lib3mf, and read back by it in strict mode. Each side
of the box is a triangle set of its name. Fields are properties of the volumetric extension:
functions, node by node, or stacks of pictures, 16 bits each, which the library does not read back
in strict mode (see `_INVALID_ELEMENT`).
"""

from __future__ import annotations

import ctypes
import decimal
import math
import uuid
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pc2cad.arrays import AnyArray
from pc2cad.brep.triangles import Triangles
from pc2cad.errors import KernelError, require
from pc2cad.export.model import Exportable, ExportOptions, NamedFace
from pc2cad.export.slices import limits, png, sheets
from pc2cad.export.surface import faces_in_order, single_precision, surface
from pc2cad.export.threemf_functions import DIGITS, VALUE, add_functions
from pc2cad.export.version import __version__
from pc2cad.trust.names import clean

if TYPE_CHECKING:
    from pc2cad.sampling.voxels import Voxels

_UNITS = {"mm": "MilliMeter", "cm": "CentiMeter", "m": "Meter", "in": "Inch"}
#: digits of the largest coordinate: one more than single precision holds
_DIGITS = 9
#: what the library's reader (2.4.1, 2.5.0) warns of at each ``image3d`` and
#: ``functionfromimage3d``, having read it: in its NMR_ModelReaderNode100_Resources.cpp an ``else``
#: is missing before the ``if`` that asks for ``volumedata``, and the warning behind that is for
#: these two as well
_INVALID_ELEMENT = 32934
#: distance in units of single precision's rounding that the library's reader may be off
_READER_ROUNDING = 4.0


def encode(exportable: Exportable, options: ExportOptions) -> bytes:
    """Return the 3MF file of `exportable`.

    Raises:
        PackageMissingError: lib3mf is not installed.
        InputError: the deflection is too fine for the size of the part.
        KernelError: the solid could not be meshed, single precision is too coarse for it, or
            lib3mf refuses the file.

    """
    require("lib3mf", ".3mf files", "lib3mf")
    import lib3mf

    mesh = single_precision(surface(exportable, options), "3MF")
    wrapper = lib3mf.get_wrapper()
    try:
        data = _written(lib3mf, wrapper, exportable, mesh)
        _check(wrapper, data, mesh, exportable)
    except lib3mf.ELib3MFException as error:
        raise KernelError(f"lib3mf refused the part: {error}") from None
    return data


def _written(library: Any, wrapper: Any, exportable: Exportable, mesh: Triangles) -> bytes:
    model = wrapper.CreateModel()
    model.SetUnit(getattr(library.ModelUnit, _UNITS[exportable.units]))
    texts = {
        "Title": clean(exportable.name) or "unnamed",
        "Description": _description(exportable),
        "Application": f"pc2cad {__version__}",
    }
    for key, value in texts.items():
        if value:
            model.GetMetaDataGroup().AddMetaData("", key, value, "xs:string", True)
    thing = model.AddMeshObject()
    thing.SetName(texts["Title"])
    thing.SetGeometry(
        _records(library.Position, mesh.vertices.astype(np.float32)),
        _records(library.Triangle, mesh.triangles.astype(np.uint32)),
    )
    faces = faces_in_order(exportable)
    for i, face in enumerate(faces):
        members = thing.AddTriangleSet(f"side{i}", clean(face.name))
        members.SetTriangleList(np.flatnonzero(mesh.faces == i).tolist())
    if any(face.colour for face in faces):
        _colour(library, wrapper, model, thing, faces, mesh)
    if exportable.voxels is not None or exportable.formulas:
        _fields(library, model, thing, exportable)
    item = model.AddBuildItem(thing, wrapper.GetIdentityTransform())
    # the library's identifiers are random; these depend on the part
    content = f"{texts['Title']} {mesh.vertices.tobytes().hex()}"
    for number, identified in enumerate((thing.SetUUID, item.SetUUID, model.SetBuildUUID)):
        identified(str(uuid.uuid5(uuid.NAMESPACE_URL, f"{number} {content}")))
    writer = model.QueryWriter("3mf")
    writer.SetStrictModeActive(True)
    # fixed decimals: the library would overflow with more than 18 digits in all
    magnitude = math.floor(math.log10(np.abs(mesh.vertices).max()))
    writer.SetDecimalPrecision(min(max(_DIGITS - 1 - magnitude, 1), 16))
    return bytes(writer.WriteToBuffer())


def _description(exportable: Exportable) -> str:
    """Return what is said of the part, and how far fields are off that are found by steps."""
    said = (clean(exportable.description, 1000), *exportable.fields_said)
    return "; ".join(filter(None, said))


def _fields(library: Any, model: Any, thing: Any, exportable: Exportable) -> None:
    """Give the solid its fields: functions of the place, and stacks of pictures."""
    data = model.AddVolumeData()
    formulas = {name: known.formula for name, known in exportable.formulas.items()}
    for name, function in add_functions(library, model, formulas).items():
        held = data.AddPropertyFromFunction(name, function)
        held.SetChannelName(VALUE)
    if exportable.voxels is not None:
        _stacks(library, model, data, exportable.voxels)
    thing.SetVolumeData(data)


def _stacks(library: Any, model: Any, data: Any, voxels: Voxels) -> None:
    """Add fields as stacks of pictures, and where they lie in space."""
    sizes, lows = voxels.extent, voxels.low
    for name, values in voxels.values.items():
        offset, scale = _span(*limits(values))
        pictures = sheets(values, offset, offset + scale)
        count, rows, columns = pictures.shape
        # the library writes its first argument, which it calls columns, as the number of rows
        stack = model.AddImageStack(rows, columns, count)
        stack.SetName(name)
        for k, picture in enumerate(pictures):
            stack.CreateSheetFromBuffer(k, f"/3D/volumetric/{name}/{k:04}.png", list(png(picture)))
        function = model.AddFunctionFromImage3D(stack)
        function.SetDisplayName(name)
        function.SetFilter(library.TextureFilter.Linear)
        function.SetTileStyles(*[library.TextureTileStyle.Clamp] * 3)
        function.SetOffset(offset)
        function.SetScale(scale)
        held = data.AddPropertyFromFunction(name, function)
        held.SetChannelName("red")
        held.SetTransform(_onto_unit_box(library, lows, sizes))


def _span(low: float, high: float) -> tuple[float, float]:
    """Return an offset and a scale that hold all values, of as many digits as the library writes.

    A span that is far shorter than its distance from 0 is held with fewer steps.
    """
    context = decimal.Context(prec=DIGITS, rounding=decimal.ROUND_FLOOR)
    offset = context.create_decimal_from_float(low)
    scale = decimal.Context(prec=DIGITS, rounding=decimal.ROUND_CEILING).subtract(
        decimal.Decimal(high), offset
    )
    return float(offset), float(scale)


def _onto_unit_box(library: Any, lows: Sequence[float], sizes: Sequence[float]) -> Any:
    rows = [[1 / size if i == j else 0.0 for j in range(3)] for i, size in enumerate(sizes)]
    rows.append([-low / size for low, size in zip(lows, sizes, strict=True)])
    transform = library.Transform()
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            transform.Fields[i][j] = value
    return transform


def _colour(
    library: Any,
    wrapper: Any,
    model: Any,
    thing: Any,
    faces: tuple[NamedFace, ...],
    mesh: Triangles,
) -> None:
    """Give each triangle the colour of its side; grey where there is none."""
    group = model.AddColorGroup()
    numbers = [
        group.AddColor(wrapper.FloatRGBAToColor(*(face.colour or (0.7, 0.7, 0.7)), 1.0))
        for face in faces
    ]
    thing.SetObjectLevelProperty(group.GetResourceID(), numbers[0])
    rows = np.empty((len(mesh.triangles), 4), dtype=np.uint32)
    rows[:, 0] = group.GetResourceID()
    rows[:, 1:] = np.array(numbers, dtype=np.uint32)[mesh.faces][:, None]
    thing.SetAllTriangleProperties(_records(library.TriangleProperties, rows))


def _records(kind: Any, rows: AnyArray) -> Any:
    """Return rows as an array of one of the library's structures."""
    assert ctypes.sizeof(kind) == rows.itemsize * rows.shape[1]
    return (kind * len(rows)).from_buffer_copy(np.ascontiguousarray(rows).tobytes())


def _check(wrapper: Any, data: bytes, mesh: Triangles, exportable: Exportable) -> None:
    """Read the file strictly, as a slicer would, and compare it with mesh and fields."""
    pictures = [] if exportable.voxels is None else list(exportable.voxels.values)
    names = [*exportable.formulas, *pictures]
    model = wrapper.CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(not pictures)
    reader.ReadFromBuffer(data)
    things = model.GetMeshObjects()
    warnings = [reader.GetWarning(k)[0] for k in range(reader.GetWarningCount())]
    if warnings != [_INVALID_ELEMENT] * 2 * len(pictures) or not things.MoveNext():
        raise KernelError("the 3MF file reads back with warnings, or without its mesh")
    thing = things.GetCurrentMeshObject()
    counts = (thing.GetVertexCount(), thing.GetTriangleCount())
    if counts != (len(mesh.vertices), len(mesh.triangles)) or not thing.IsManifoldAndOriented():
        raise KernelError(
            f"the 3MF file reads back with {counts[0]} corners and {counts[1]} triangles instead "
            f"of {len(mesh.vertices)} and {len(mesh.triangles)}, or not closed"
        )
    volume = thing.GetVolumeData() if names else None
    if volume is not None:
        held = [volume.GetProperty(k).GetName() for k in range(volume.GetPropertyCount())]
        if sorted(held) != sorted(names):  # the library has them in any order
            raise KernelError(f"the 3MF file reads back with the fields {', '.join(held)}")
    found = np.frombuffer(_vertices(thing), dtype=np.float32).reshape(-1, 3)
    off = float(np.abs(found - mesh.vertices).max())
    if not off <= _READER_ROUNDING * np.finfo(np.float32).eps * np.abs(mesh.vertices).max():
        raise KernelError(f"the 3MF file reads back with coordinates that are {off:.3g} off")


def _vertices(thing: Any) -> bytes:
    return b"".join(bytes(position) for position in thing.GetVertices())
