"""A part as bytes for the page: a JSON header that points into one block of arrays."""

from __future__ import annotations

import gzip
import json
import os
import tempfile
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pc2cad.arrays import AnyArray, Array
from pc2cad.brep.triangles import Triangles
from pc2cad.errors import InputError
from pc2cad.export.colours import side_colour
from pc2cad.part import Part
from pc2cad.picture.bodies import shown_edges, shown_faces, shown_mesh
from pc2cad.picture.colours import limits_of, shares, viridis
from pc2cad.picture.fields import on_faces, scalar_fields
from pc2cad.picture.scene import Surface
from pc2cad.picture.sides import Sides
from pc2cad.report import FaceReport, Report
from pc2cad.viewer.page import Variant, page

#: colours of a scale
STEPS = 256
#: largest angle in radians between neighbouring chords of a page's triangles
TURN = 0.1


def payload(part: Part, points: tuple[int, int, int] | None = None) -> bytes:
    """Return a part, and the points of a grid of its box if asked for, compressed.

    Four bytes give the length of the header, JSON in UTF-8; the arrays follow at the next multiple
    of four. The same part gives the same bytes. Raises InputError for the points of several bodies.
    """
    block = _Block()
    mesh = shown_mesh(part, TURN)
    header: dict[str, Any] = {
        "title": part.title,
        "units": part.report.units,
        "parameters": dict(part.report.parameters),
        "facts": _facts(part.report),
        "deflection": mesh.deflection,
    }
    if part.several is not None:
        if points is not None:
            raise InputError("a point set belongs to one equation, and here are several bodies")
        header |= {"others": [], "points": None}
        edges = [points for _, points in shown_edges(part, mesh)]
    else:
        sides = Sides(part, TURN)
        header["others"] = _others(part, sides, block)
        header["points"] = None if points is None else _points(sides, points, block)
        edges = [path for _, path in sides.creases(120)]
    header |= _faces(part, mesh, block)
    header["edges"] = [block.add(path, "<f4") for path in edges]
    return block.packed(header)


def _faces(part: Part, mesh: Triangles, block: _Block) -> dict[str, Any]:
    """Return the outer faces with their triangles, and the scalar fields that colour them."""
    faces, names = list(shown_faces(part, mesh)), scalar_fields(part)
    valued = list(on_faces(part, faces, names)) if names else [(face, {}) for face in faces]
    limits = {
        name: limits_of(np.concatenate([values[name] for _, values in valued])) for name in names
    }
    known, wholes = part.report.faces, {}
    if part.several is None:
        # those between layers are within the solid, and not drawn
        known = tuple(known[i] for i in part.model.outer)
        wholes = {face.name: face.key.whole.label for face in part.model.faces}
    return {
        "fields": [{"name": name, "low": a, "high": b} for name, (a, b) in limits.items()],
        "scale": np.round(viridis(np.linspace(0.0, 1.0, STEPS)), 3).tolist() if names else [],
        "faces": [
            {
                **_face(told, shown, block),
                "side": wholes.get(told.name, told.name),
                "fields": _fields(values, limits, block),
            }
            for told, (shown, values) in zip(known, valued, strict=True)
        ],
    }


def page_of(part: Part) -> bytes:
    """Return the page of one part."""
    return page(part.title, (), (Variant(payload(part)),), live=False)


def open_page(part: Part) -> None:
    """Open the page of one part in the browser, from a temporary file."""
    handle, path = tempfile.mkstemp(suffix=".html", prefix="pc2cad-")
    with os.fdopen(handle, "wb") as stream:
        stream.write(page_of(part))
    webbrowser.open(Path(path).as_uri())


class _Block:
    """Collects arrays; each is told as offset, count of numbers and type."""

    def __init__(self) -> None:
        self._data = bytearray()

    def add(self, values: AnyArray, kind: str) -> dict[str, Any]:
        encoded = np.ascontiguousarray(values, dtype=kind).tobytes()
        place = {"at": len(self._data), "count": int(np.size(values)), "type": kind.lstrip("<|")}
        self._data += encoded + bytes(-len(encoded) % 4)
        return place

    def packed(self, header: dict[str, Any]) -> bytes:
        text = json.dumps(header, allow_nan=False, ensure_ascii=False).encode()
        text += b" " * (-len(text) % 4)
        raw = len(text).to_bytes(4, "little") + text + bytes(self._data)
        return gzip.compress(raw, compresslevel=6, mtime=0)


def _face(known: FaceReport, shown: Surface, block: _Block) -> dict[str, Any]:
    """Return a face with its triangles and what the report says of it."""
    return {
        "name": known.name,
        "colour": shown.colour,
        "carrier": known.carrier,
        "evidence": known.evidence,
        "deviation": known.deviation,
        "area": known.area,
        "positions": block.add(shown.points, "<f4"),
        "normals": block.add(np.round(127 * _padded(shown.normals, 0.0)), "|i1"),
        "triangles": block.add(shown.triangles, "<u4"),
    }


def _fields(
    values: Mapping[str, Array], limits: Mapping[str, tuple[float, float]], block: _Block
) -> dict[str, Any]:
    """Return for each field the steps of the scale at the points; None: the face has none."""
    return {
        name: None if np.isnan(row).any()
        else block.add(np.round((STEPS - 1) * shares(row, *limits[name])), "|u1")
        for name, row in values.items()
    }  # fmt: skip


def _others(part: Part, sides: Sides, block: _Block) -> list[dict[str, Any]]:
    """Return the sides that are no faces: collapsed ones with their image, and interfaces."""
    images = {side.patch: path for side, path in sides.collapsed(120)}
    result: list[dict[str, Any]] = []
    boundary = part.model.complex
    for side, known in zip(boundary.sides, part.report.sides, strict=True):
        if known.fate == "face":
            continue
        whole = boundary.key(side.patch).whole.label
        other: dict[str, Any] = {
            "name": known.name,
            "side": whole,
            "fate": known.fate,
            "detail": known.detail,
        }
        other |= {"verdict": known.verdict, "path": None}
        if side.patch in images:
            path = images[side.patch]
            other |= {"path": block.add(path, "<f4"), "colour": side_colour(side.patch)}
        result.append(other)
    return result


def _points(sides: Sides, counts: tuple[int, int, int], block: _Block) -> dict[str, Any]:
    cloud = sides.inside(counts)
    colours = np.broadcast_to(viridis(np.linspace(0.0, 0.9, counts[2])), cloud.shape)
    return {
        "positions": block.add(cloud.reshape(-1, 3), "<f4"),
        "colours": block.add(np.round(255 * _padded(colours.reshape(-1, 3), 1.0)), "|u1"),
    }


def _padded(rows: Array, value: float) -> Array:
    """Return rows of three with a fourth number: graphics cards read four bytes at a time."""
    return np.column_stack((rows, np.full(len(rows), value)))


def _facts(report: Report) -> list[tuple[str, str]]:
    units = report.units
    off = "" if report.evidence == "exact" else f", within {report.deviation:.2g} {units}"
    genus = "" if report.own is None else f", of genus {', '.join(map(str, report.own.genus))}"
    return [
        ("volume", f"{report.integrals.volume:.10g} {units}³"),
        ("area", f"{report.integrals.area:.10g} {units}²"),
        ("evidence", f"{report.evidence}{off}"),
        ("shells", f"{report.shells}{genus}"),
    ]
