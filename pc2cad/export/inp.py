"""Abaqus and CalculiX input (.inp): nodes, elements, node sets, element sets and surfaces.

Names hold letters, digits and underscores only (``u=0`` is ``u_0``); of the part's name, what
could be a keyword is ``%XX``. Neither program has pyramids for every element family: they are
written as bricks one face of which is a single node.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TextIO

import numpy as np

from pc2cad.arrays import Integers
from pc2cad.export.mesh_files import plain_names
from pc2cad.mesh.elements import COLLAPSED_PYRAMID
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.trust.names import percent

_TYPES = {
    "hexahedron": ("C3D8", "C3D20"), "wedge": ("C3D6", "C3D15"),
    "pyramid": ("C3D8", "C3D20"), "tetra": ("C3D4", "C3D10"),
}  # fmt: skip
#: face of a pyramid -> face of the brick that it is written as
_BRICK_FACE = np.array([0, 2, 3, 4, 5])
_CHUNK = 1 << 15


def write(mesh: VolumeMesh, path: Path) -> None:
    """Write the mesh; coordinates have the 20 characters that CalculiX reads (1e-13 of them)."""
    names = plain_names([*mesh.node_sets, *mesh.sides, *mesh.layers])
    title = percent(mesh.name, "*\"'\\", limit=200)
    with open(path, "w", encoding="ascii", newline="\n") as stream:
        stream.write(f"*HEADING\n{title} ({mesh.units})\n*NODE, NSET=solid\n")
        _nodes(stream, mesh)
        for kind, block in mesh.blocks.items():
            stream.write(f"*ELEMENT, TYPE={_TYPES[kind][mesh.order - 1]}, ELSET=solid\n")
            _elements(stream, mesh, kind, block)
        for name, nodes in mesh.node_sets.items():
            stream.write(f"*NSET, NSET={names[name]}\n")
            _numbers(stream, nodes + 1)
        for name, layer in mesh.layers.items():
            stream.write(f"*ELSET, ELSET={names[name]}\n")
            for kind, numbers in layer.items():
                _numbers(stream, numbers + mesh.first_element(kind) + 1)
        for name, facets in mesh.sides.items():
            first = {f.kind: mesh.first_element(f.kind) + 1 for f in facets}
            stream.write(f"*ELSET, ELSET={names[name]}\n")
            _numbers(
                stream, np.unique(np.concatenate([f.elements + first[f.kind] for f in facets]))
            )
            stream.write(f"*SURFACE, NAME={names[name]}, TYPE=ELEMENT\n")
            for f in facets:
                faces = _BRICK_FACE[f.faces] if f.kind == "pyramid" else f.faces
                rows = np.stack((f.elements + first[f.kind], faces + 1), axis=1)
                _rows(stream, "%d, S%d\n", rows)


def _nodes(stream: TextIO, mesh: VolumeMesh) -> None:
    for start in range(0, len(mesh.points), _CHUNK):
        rows = mesh.points[start : start + _CHUNK].tolist()
        stream.writelines(
            f"{start + k}, {_shown(x)}, {_shown(y)}, {_shown(z)}\n"
            for k, (x, y, z) in enumerate(rows, start=1)
        )


def _shown(x: float) -> str:
    text = repr(x)
    return text if len(text) <= 20 else f"{x:.13e}"


def _elements(stream: TextIO, mesh: VolumeMesh, kind: str, block: Integers) -> None:
    first = mesh.first_element(kind) + 1
    columns = COLLAPSED_PYRAMID[mesh.order] if kind == "pyramid" else range(block.shape[1])
    # a line of input holds at most 16 numbers
    width = len(columns)
    text = ", ".join(["%d"] * min(width + 1, 16))
    if width > 15:
        text += ",\n" + ", ".join(["%d"] * (width - 15))
    for start in range(0, len(block), _CHUNK):
        rows = block[start : start + _CHUNK][:, list(columns)] + 1
        numbers = np.arange(first + start, first + start + len(rows))
        _rows(stream, text + "\n", np.column_stack((numbers, rows)))


def _rows(stream: TextIO, text: str, rows: Integers) -> None:
    for start in range(0, len(rows), _CHUNK):
        part = rows[start : start + _CHUNK]
        stream.write(text * len(part) % tuple(part.ravel().tolist()))


def _numbers(stream: TextIO, numbers: Iterable[int] | Integers) -> None:
    values = np.asarray(numbers)
    full = len(values) // 12 * 12
    _rows(stream, ", ".join(["%d"] * 12) + "\n", values[:full].reshape(-1, 12))
    if full < len(values):
        stream.write(", ".join(map(str, values[full:].tolist())) + "\n")
