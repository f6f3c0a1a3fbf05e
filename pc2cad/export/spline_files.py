"""The table of formats for trivariate splines, and writing a volume model to any of them."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from pc2cad.export.files import by_ending, check_target, write_atomically
from pc2cad.geometry.splines.trivariate import SplineVolume
from pc2cad.representation.volume import VolumeModel


class SplineModule(Protocol):
    """What a module of a format of splines has."""

    def encode(self, model: VolumeModel, /) -> str:
        """Return the text of the file."""
        ...


class FieldModule(Protocol):
    """What a module of a format has that holds fields on the splines' spaces."""

    def encode_field(self, model: VolumeModel, name: str, /) -> str:
        """Return the text of the file of one field."""
        ...


@dataclass(frozen=True)
class SplineFormat:
    """One format of splines: how it is recognised and specified, and what it keeps."""

    extension: str
    title: str
    #: address of the format's specification
    specification: str
    #: how patches and the names of sides are found in the file
    keeps: str
    #: a `SplineModule`
    module: str
    #: of a `FieldModule`: the ending of the file of a field
    fields: str = ""


SPLINE_FORMATS: tuple[SplineFormat, ...] = (
    SplineFormat(
        ".xml",
        "G+Smo multi-patch",
        "https://gismo.github.io/",
        "interfaces between patches, glued sides too; labels of boundary sides",
        "pc2cad.export.gismo",
        fields=".xml",
    ),
    SplineFormat(
        ".mesh",
        "MFEM NURBS mesh 1.0",
        "https://mfem.org/mesh-formats/#nurbs-meshes",
        "boundary attributes 1 … 6 for the lower and upper limit of each axis; three patches round",
        "pc2cad.export.mfem",
        fields=".gf",
    ),
    SplineFormat(
        ".itd",
        "IRIT data",
        "https://gershonelber.org/irit/",
        "patches",
        "pc2cad.export.irit",
    ),
    SplineFormat(
        ".g2",
        "GoTools spline volumes",
        "https://github.com/SINTEF-Geometry/GoTools",
        "patches",
        "pc2cad.export.gotools",
    ),
)


def spline_format(path: str | os.PathLike[str]) -> SplineFormat:
    """Return the format of a file name's ending; raise InputError where there is none."""
    return by_ending(path, {entry.extension: entry for entry in SPLINE_FORMATS}, "spline file")


def check_splines_writable(path: str | os.PathLike[str]) -> None:
    """Find out before a computation whether splines can be written to `path`."""
    spline_format(path)
    check_target(path)


def check_field_writable(path: str | os.PathLike[str]) -> None:
    """Find out before a computation whether a field's spline can be written to `path`."""
    field_format(path)
    check_target(path)


def field_format(path: str | os.PathLike[str]) -> SplineFormat:
    """Return the format whose fields have the ending of a file; raise InputError."""
    endings = {entry.fields: entry for entry in SPLINE_FORMATS if entry.fields}
    return by_ending(path, endings, "file of a field's spline")


def write_splines(
    model: VolumeModel, path: str | os.PathLike[str], *, field: str | None = None
) -> None:
    """Write a volume model in the format of the name's ending, whole or not at all.

    With the name of a `field`, that field on the same spaces instead: G+Smo's .xml or MFEM's .gf.
    Raises InputError for an unknown ending or field, FileNotWrittenError.
    """
    if field is not None:
        check_field_writable(path)
        writer: FieldModule = importlib.import_module(field_format(path).module)
        write_atomically(path, writer.encode_field(model, field).encode())
        return
    module: SplineModule = importlib.import_module(spline_format(path).module)
    write_atomically(path, module.encode(model).encode())


def numbers(values: Iterable[float]) -> str:
    """Return numbers, each of which comes back as the same double."""
    return " ".join(map(repr, map(float, values)))


def rows(volume: SplineVolume, *, homogeneous: bool, weight: str = "last") -> list[str]:
    """Return the poles of a volume as lines, the first axis fastest.

    `weight` says where the weight of a rational spline stands: first, last, or nowhere.
    """
    poles = volume.poles.transpose(2, 1, 0, 3).reshape(-1, volume.poles.shape[-1])
    if volume.weights is None:
        return [numbers(row) for row in poles]
    weights = volume.weights.transpose(2, 1, 0).reshape(-1)
    lines = []
    for row, w in zip(poles, weights, strict=True):
        place = [*(row * w if homogeneous else row)]
        if weight != "nowhere":
            place = [w, *place] if weight == "first" else [*place, w]
        lines.append(numbers(place))
    return lines
