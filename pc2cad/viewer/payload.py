"""A part as bytes for the page: a JSON header that points into one block of arrays."""

from __future__ import annotations

import gzip
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pc2cad.part import Part, side_colour
from pc2cad.picture.colours import viridis
from pc2cad.picture.scene import Array
from pc2cad.picture.sides import Sides

#: angle in radians between neighbouring tangents of a page's grid
TURN = 0.09


def payload(part: Part, points: tuple[int, int, int] | None = None) -> bytes:
    """Return a part, and the points of a grid of its box if asked for, compressed.

    Four bytes give the length of the header, JSON in UTF-8; the arrays follow at the next multiple
    of four. The same part gives the same bytes.
    """
    block = _Block()
    sides = Sides(part, TURN)
    header = {
        "title": part.equation.title or part.equation.name,
        "units": part.report.units,
        "parameters": dict(part.report.parameters),
        "facts": _facts(part),
        "faces": _faces(part, sides, block),
        "others": _others(part, sides, block),
        "edges": [block.add(path, "<f4") for _, path in sides.creases(120)],
        "points": None if points is None else _points(sides, points, block),
    }
    return block.packed(header)


class _Block:
    """Collects arrays; each is told as offset, count of numbers and type."""

    def __init__(self) -> None:
        self._data = bytearray()

    def add(self, values: NDArray[Any], kind: str) -> dict[str, Any]:
        encoded = np.ascontiguousarray(values, dtype=kind).tobytes()
        place = {"at": len(self._data), "count": int(np.size(values)), "type": kind.lstrip("<|")}
        self._data += encoded + bytes(-len(encoded) % 4)
        return place

    def packed(self, header: dict[str, Any]) -> bytes:
        text = json.dumps(header, allow_nan=False, ensure_ascii=False).encode()
        text += b" " * (-len(text) % 4)
        raw = len(text).to_bytes(4, "little") + text + bytes(self._data)
        return gzip.compress(raw, compresslevel=6, mtime=0)


def _faces(part: Part, sides: Sides, block: _Block) -> list[dict[str, Any]]:
    """Return each face with its triangles and what the report says of it."""
    patches = list(sides.patches())
    result = []
    for index, known in enumerate(part.report.faces):
        own = [p for p in patches if p.index == index]
        offsets = np.cumsum([0, *(p.points.size // 3 for p in own)])
        triangles = [p.triangles + start for p, start in zip(own, offsets, strict=False)]
        normals = np.concatenate([p.normals.reshape(-1, 3) for p in own])
        bytes_ = np.zeros((len(normals), 4))
        bytes_[:, :3] = np.round(127 * normals)
        result.append({
            "name": known.name,
            "colour": side_colour(own[0].cell),
            "carrier": known.carrier,
            "evidence": known.evidence,
            "deviation": known.deviation,
            "area": known.area,
            "positions": block.add(np.concatenate([p.points.reshape(-1, 3) for p in own]), "<f4"),
            "normals": block.add(bytes_, "|i1"),
            "triangles": block.add(np.concatenate(triangles), "<u4"),
        })  # fmt: skip
    return result


def _others(part: Part, sides: Sides, block: _Block) -> list[dict[str, Any]]:
    """Return the sides that are no faces: collapsed ones with their image, and interfaces."""
    images = {name: (side, path) for name, side, path in sides.collapsed(120)}
    result: list[dict[str, Any]] = []
    for known in part.report.sides:
        if known.fate == "face":
            continue
        other: dict[str, Any] = {"name": known.name, "fate": known.fate, "detail": known.detail}
        other |= {"verdict": known.verdict, "path": None}
        if known.name in images:
            side, path = images[known.name]
            other |= {"path": block.add(path, "<f4"), "colour": side_colour(side.patch)}
        result.append(other)
    return result


def _points(sides: Sides, counts: tuple[int, int, int], block: _Block) -> dict[str, Any]:
    cloud = sides.inside(counts)
    colours = np.broadcast_to(viridis(np.linspace(0.0, 0.9, counts[2])), cloud.shape)
    return {
        "positions": block.add(cloud.reshape(-1, 3), "<f4"),
        "colours": block.add(np.round(255 * _padded(colours.reshape(-1, 3))), "|u1"),
    }


def _padded(rows: Array) -> Array:
    """Return rows of three with a fourth number: graphics cards read four bytes at a time."""
    return np.column_stack((rows, np.ones(len(rows))))


def _facts(part: Part) -> list[tuple[str, str]]:
    report, units = part.report, part.report.units
    off = "" if report.evidence == "exact" else f", within {report.deviation:.2g} {units}"
    return [
        ("volume", f"{report.equation.volume:.10g} {units}³"),
        ("area", f"{report.equation.area:.10g} {units}²"),
        ("evidence", f"{report.evidence}{off}"),
        ("shells", f"{report.shells}, of genus {', '.join(map(str, report.genus))}"),
    ]  # fmt: skip
