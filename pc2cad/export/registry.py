"""The table of formats, and writing a file of any of them."""

from __future__ import annotations

import importlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from pc2cad.errors import InputError
from pc2cad.export.files import by_ending, check_target, write_atomically
from pc2cad.export.model import Exportable, ExportOptions


class Encoder(Protocol):
    """What makes the bytes of a file."""

    def __call__(self, exportable: Exportable, options: ExportOptions, /) -> bytes:
        """Return the file of a solid; raise KernelError where it cannot be encoded."""
        ...


class SolidModule(Protocol):
    """What a module of a format of solids has."""

    def encode(self, exportable: Exportable, options: ExportOptions, /) -> bytes:
        """Return the file of a solid; raise KernelError where it cannot be encoded."""
        ...


@dataclass(frozen=True)
class Format:
    """One file format: how it is recognised, where it is specified and what it keeps."""

    name: str
    #: lower-case endings, the usual one first
    extensions: tuple[str, ...]
    title: str
    #: address of the format's specification
    specification: str
    #: what a reader gets back, in words
    precision: str
    #: a `SolidModule`
    module: str
    #: whether it holds triangles instead of the boundary's surfaces
    triangles: bool = False
    #: whether it holds fields on voxels
    fields: bool = False

    def encoder(self) -> Encoder:
        """Import the format's module and return its ``encode``."""
        module: SolidModule = importlib.import_module(self.module)
        return module.encode


FORMATS: tuple[Format, ...] = (
    Format(
        name="step",
        extensions=(".step", ".stp"),
        title="STEP (ISO 10303-21, AP242 or AP214), boundary representation",
        specification="https://www.iso.org/standard/63141.html",
        precision="exact: every double comes back",
        module="pc2cad.export.step",
    ),
    Format(
        name="brep",
        extensions=(".brep",),
        title="BREP, the kernel's own text",
        specification="https://dev.opencascade.org/doc/overview/html/specification__brep_format.html",
        precision="exact: every double comes back; neither unit nor names",
        module="pc2cad.export.brep",
    ),
    Format(
        name="iges",
        extensions=(".igs", ".iges"),
        title="IGES 5.3, manifold solid B-rep (entity 186)",
        specification="https://web.archive.org/web/20180920102345/https://shop.iges5x.org/",
        precision="exact: every double comes back; names of eight characters",
        module="pc2cad.export.iges",
    ),
    Format(
        name="stl",
        extensions=(".stl",),
        title="STL (binary), triangles",
        specification="https://www.loc.gov/preservation/digital/formats/fdd/fdd000505.shtml",
        precision="chords within the deflection, single-precision coordinates (7 digits)",
        module="pc2cad.export.stl",
        triangles=True,
    ),
    Format(
        name="stl text",
        extensions=(".ast",),
        title="STL (ASCII), triangles",
        specification="https://www.loc.gov/preservation/digital/formats/fdd/fdd000506.shtml",
        precision="chords within the deflection, single-precision coordinates (7 digits)",
        module="pc2cad.export.stl_text",
        triangles=True,
    ),
    Format(
        name="3mf",
        extensions=(".3mf",),
        title="3MF, triangles for printing, with unit, names, colours and fields",
        specification="https://3mf.io/spec/",
        precision="chords within the deflection, single-precision coordinates (7 digits)",
        module="pc2cad.export.threemf",
        triangles=True,
        fields=True,
    ),
    Format(
        name="glb",
        extensions=(".glb",),
        title="GLB (glTF 2.0), triangles in metres, Y up, with names and colours",
        specification="https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html",
        precision="chords within the deflection, single-precision coordinates (7 digits)",
        module="pc2cad.export.glb",
        triangles=True,
    ),
    Format(
        name="vtp",
        extensions=(".vtp",),
        title="VTP (VTK XML), triangles with the side of each",
        specification="https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html",
        precision="chords within the deflection, every double comes back",
        module="pc2cad.export.vtp",
        triangles=True,
    ),
)


_BY_ENDING = {extension: entry for entry in FORMATS for extension in entry.extensions}


def format_for(path: str | os.PathLike[str]) -> Format:
    """Return the format that the ending of `path` stands for.

    Raises:
        InputError: no format has that ending.

    """
    return by_ending(path, _BY_ENDING, "file name")


def check_writable(path: str | os.PathLike[str]) -> None:
    """Find out before an expensive build whether a file can be written to `path`.

    Raises:
        InputError: no format has the ending of `path`.
        FileNotWrittenError: the file could not be written there.

    """
    if os.fspath(path):
        format_for(path)
    check_target(path)


def check_holds_fields(path: str | os.PathLike[str], fields: Sequence[str]) -> None:
    """Raise InputError where fields are asked of a format that holds none."""
    if fields and not format_for(path).fields:
        known = ", ".join(entry.extensions[0] for entry in FORMATS if entry.fields)
        raise InputError(f"{os.fspath(path)[-80:]}: fields are held by {known} alone")


def write(
    exportable: Exportable, path: str | os.PathLike[str], options: ExportOptions | None = None
) -> None:
    """Write `exportable` to `path` in the format of its ending, whole or not at all.

    Raises:
        InputError: no format has the ending of `path`.
        KernelError: the solid could not be encoded, or does not read back as it was.
        FileNotWrittenError: the file could not be written; an old file is untouched.

    """
    if not os.fspath(path):
        check_target(path)  # which complains
    encode = format_for(path).encoder()
    write_atomically(path, lambda: encode(exportable, options or ExportOptions()))
