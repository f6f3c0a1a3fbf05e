"""GLB, binary glTF 2.0: triangles with normals, in metres, with Y up as the format has it.

Specification: https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html

The part is a node with one child per side of the box, of the side's name and colour. The kernel's
own writer is not used: it writes to paths only and loses the names of faces.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from pc2cad.arrays import AnyArray, Array, Integers
from pc2cad.export.model import UNITS_IN_MM, Exportable, ExportOptions
from pc2cad.export.surface import faces_in_order, single_precision, smooth_normals, surface
from pc2cad.export.version import __version__
from pc2cad.trust.names import clean

_MAGIC, _VERSION = 0x46546C67, 2
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
#: component types and buffer targets of the specification
_FLOAT, _UNSIGNED = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_GREY = (0.7, 0.7, 0.7)
#: x, y, z with Z up -> with Y up
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def encode(exportable: Exportable, options: ExportOptions) -> bytes:
    """Return the GLB file of `exportable`.

    Raises:
        InputError: the deflection is too fine for the size of the part.
        KernelError: the solid could not be meshed, or single precision is too coarse for it.

    """
    metres = UNITS_IN_MM[exportable.units] / 1000.0
    mesh = single_precision(surface(exportable, options), "GLB", metres)
    scene = _Scene()
    for i, face in enumerate(faces_in_order(exportable)):
        used, numbers = np.unique(mesh.triangles[mesh.faces == i], return_inverse=True)
        triangles = numbers.reshape(-1, 3)
        vertices = mesh.vertices[used] @ _Y_UP.T
        scene.add(clean(face.name), face.colour or _GREY, vertices, triangles)
    return scene.encoded(clean(exportable.name) or "unnamed")


class _Scene:
    """Collects the sides; each is a node with a mesh of one primitive."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._meshes: list[dict[str, Any]] = []
        self._materials: list[dict[str, Any]] = []

    def add(
        self,
        name: str,
        colour: tuple[float, float, float],
        vertices: Array,
        triangles: Integers,
    ) -> None:
        positions = vertices.astype(np.float32)
        normals = smooth_normals(vertices, triangles).astype(np.float32)
        attributes = {
            "POSITION": self._accessor(
                positions, "VEC3", _FLOAT, _VERTICES,
                min=positions.min(axis=0).tolist(), max=positions.max(axis=0).tolist(),
            ),
            "NORMAL": self._accessor(normals, "VEC3", _FLOAT, _VERTICES),
        }  # fmt: skip
        indices = triangles.astype(np.uint32).ravel()
        primitive = {
            "attributes": attributes,
            "indices": self._accessor(indices, "SCALAR", _UNSIGNED, _INDICES),
            "material": len(self._materials),
        }
        self._meshes.append({"name": name, "primitives": [primitive]})
        linear = [_linear(part) for part in colour]
        surface = {"baseColorFactor": [*linear, 1.0], "metallicFactor": 0.1, "roughnessFactor": 0.6}
        self._materials.append({"name": name, "pbrMetallicRoughness": surface})

    def encoded(self, name: str) -> bytes:
        children = list(range(1, len(self._meshes) + 1))
        document = {
            "asset": {"version": "2.0", "generator": f"pc2cad {__version__}"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [
                {"name": name, "children": children},
                *({"name": m["name"], "mesh": i} for i, m in enumerate(self._meshes)),
            ],
            "meshes": self._meshes,
            "materials": self._materials,
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": len(self._data)}],
        }
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        body = _words(len(text), _JSON) + text + _words(len(self._data), _BINARY) + self._data
        return bytes(_words(_MAGIC, _VERSION, 12 + len(body)) + body)

    def _accessor(
        self, values: AnyArray, kind: str, component: int, target: int, **limits: Any
    ) -> int:
        view = {"buffer": 0, "byteOffset": len(self._data), "byteLength": values.nbytes}
        self._views.append({**view, "target": target})
        self._data += np.ascontiguousarray(values).tobytes()  # all have four bytes: no padding
        self._accessors.append(
            {"bufferView": len(self._views) - 1, "componentType": component, "type": kind,
             "count": len(values), **limits}
        )  # fmt: skip
        return len(self._accessors) - 1


def _words(*numbers: int) -> bytes:
    return b"".join(number.to_bytes(4, "little") for number in numbers)


def _linear(part: float) -> float:
    """Return a component of an sRGB colour as light, which is what the format asks for."""
    return part / 12.92 if part <= 0.04045 else float(((part + 0.055) / 1.055) ** 2.4)
