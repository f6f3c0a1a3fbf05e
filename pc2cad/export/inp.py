"""Abaqus and CalculiX input (.inp): nodes, elements, node sets, element sets and surfaces.

Names hold letters, digits and underscores only (``u=0`` is ``u_0``); of the part's name, what
could be a keyword is ``%XX``. Neither program has pyramids for every element family: they are
written as bricks one face of which is a single node.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TextIO

import numpy as np

from pc2cad.arrays import Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.export.mesh_files import plain_names
from pc2cad.mesh.elements import COLLAPSED_PYRAMID
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.trust.names import percent

#: element of VTK's name -> those of orders 1 and 2
TYPES = {
    "hexahedron": ("C3D8", "C3D20"), "wedge": ("C3D6", "C3D15"),
    "pyramid": ("C3D8", "C3D20"), "tetra": ("C3D4", "C3D10"),
}  # fmt: skip
#: face of a pyramid -> face of the brick that it is written as
_BRICK_FACE = np.array([0, 2, 3, 4, 5])
_CHUNK = 1 << 15


def write(mesh: VolumeMesh, path: Path) -> None:
    """Write the mesh; coordinates have the 20 characters that CalculiX reads (1e-13 of them)."""
    with open(path, "w", encoding="ascii", newline="\n") as stream:
        put(stream, mesh, {kind: pair[mesh.order - 1] for kind, pair in TYPES.items()})


def set_names(mesh: VolumeMesh) -> dict[str, str]:
    """Return what sides, layers and sets of nodes are called in the file."""
    return plain_names([*mesh.node_sets, *mesh.sides, *mesh.layers])


def put(stream: TextIO, mesh: VolumeMesh, types: Mapping[str, str]) -> None:
    """Write nodes, elements of these types, sets and surfaces."""
    names = set_names(mesh)
    title = percent(mesh.name, "*\"'\\", limit=200)
    stream.write(f"*HEADING\n{title} ({mesh.units})\n*NODE, NSET=solid\n")
    _nodes(stream, mesh)
    for kind, block in mesh.blocks.items():
        stream.write(f"*ELEMENT, TYPE={types[kind]}, ELSET=solid\n")
        _elements(stream, mesh, kind, block)
    for name, nodes in mesh.node_sets.items():
        stream.write(f"*NSET, NSET={names[name]}\n")
        _numbers(stream, nodes + 1)
    for name, layer in mesh.layers.items():
        stream.write(f"*ELSET, ELSET={names[name]}\n")
        for kind, numbers in layer.items():
            _numbers(stream, numbers + mesh.first_element(kind) + 1)
    for name in mesh.sides:
        rows = facets(mesh, name)
        stream.write(f"*ELSET, ELSET={names[name]}\n")
        _numbers(stream, distinct(rows[:, 0]))
        stream.write(f"*SURFACE, NAME={names[name]}, TYPE=ELEMENT\n")
        put_rows(stream, "%d, S%d\n", rows)


def facets(mesh: VolumeMesh, side: str) -> Integers:
    """Return numbers of elements and of their faces on a side, from 1 on, (n, 2)."""
    return np.concatenate([
        np.stack((
            f.elements + mesh.first_element(f.kind) + 1,
            (_BRICK_FACE[f.faces] if f.kind == "pyramid" else f.faces) + 1,
        ), axis=1)
        for f in mesh.sides[side]
    ])  # fmt: skip


def _nodes(stream: TextIO, mesh: VolumeMesh) -> None:
    for start in range(0, len(mesh.points), _CHUNK):
        rows = mesh.points[start : start + _CHUNK].tolist()
        stream.writelines(
            f"{start + k}, {digits(x)}, {digits(y)}, {digits(z)}\n"
            for k, (x, y, z) in enumerate(rows, start=1)
        )


def digits(x: float) -> str:
    """Return a number in the 20 characters that CalculiX reads of one."""
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
        put_rows(stream, text + "\n", np.column_stack((numbers, rows)))


def put_rows(stream: TextIO, text: str, rows: Integers) -> None:
    """Write a line of text for each row of numbers."""
    for start in range(0, len(rows), _CHUNK):
        part = rows[start : start + _CHUNK]
        stream.write(text * len(part) % tuple(part.ravel().tolist()))


def _numbers(stream: TextIO, numbers: Iterable[int] | Integers) -> None:
    values = np.asarray(numbers)
    full = len(values) // 12 * 12
    put_rows(stream, ", ".join(["%d"] * 12) + "\n", values[:full].reshape(-1, 12))
    if full < len(values):
        stream.write(", ".join(map(str, values[full:].tolist())) + "\n")
