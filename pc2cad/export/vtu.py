"""VTK unstructured grids (.vtu): appended raw binary, written array by array.

Volume elements come first, then the facets of the sides as two-dimensional cells. The cell data
``side`` is 0 inside and the number of the side on its facets; field data of the side's name holds
that number.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from pc2cad.export.mesh_files import Ints, cell_blocks, whole_sides
from pc2cad.mesh.volume_mesh import VolumeMesh

#: type numbers of VTK by element and order
VTK_TYPES = {
    ("hexahedron", 1): 12, ("hexahedron", 2): 25, ("wedge", 1): 13, ("wedge", 2): 26,
    ("pyramid", 1): 14, ("pyramid", 2): 27, ("tetra", 1): 10, ("tetra", 2): 24,
    ("quad", 1): 9, ("quad", 2): 23, ("triangle", 1): 5, ("triangle", 2): 22,
}  # fmt: skip
_NAMES = {"f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}
_CHUNK = 1 << 20
#: code, nodes and side number of each block of cells
_Blocks = list[tuple[int, Ints, int]]
#: type, components, entries, and the data in parts
_Column = tuple[str, int, int, Callable[[], Iterable[NDArray[Any]]]]


def write(mesh: VolumeMesh, path: Path) -> None:
    """Write the mesh; nothing is held in memory twice."""
    blocks = [(_code(kind, mesh), nodes, side) for kind, nodes, side in cell_blocks(mesh)]
    cells = sum(len(block) for _, block, _ in blocks)
    corners = sum(block.size for _, block, _ in blocks)
    whole = "i8" if corners >= 2**31 else "i4"
    sides = whole_sides(mesh.sides)
    # in the order of the file
    arrays: dict[str, _Column] = {
        "points": ("f8", 3, len(mesh.points), lambda: iter((mesh.points,))),
        "connectivity": (whole, 1, corners, lambda: (block for _, block, _ in blocks)),
        "offsets": (whole, 1, cells, lambda: _offsets(blocks)),
        "types": ("u1", 1, cells, lambda: _constant([(len(b), c) for c, b, _ in blocks])),
        "side": ("i4", 1, cells, lambda: _constant([(len(b), s) for _, b, s in blocks])),
    }
    position = 0
    offsets = {}
    for name, (kind, components, count, _) in arrays.items():
        offsets[name] = position
        position += 8 + int(kind[1]) * components * count

    def tag(name: str, label: str) -> str:
        kind, components, _, _ = arrays[name]
        return (
            f'<DataArray type="{_NAMES[kind]}" Name="{label}" NumberOfComponents="{components}" '
            f'format="appended" offset="{offsets[name]}"/>'
        )

    field = "".join(
        f'<DataArray type="Int32" Name={quoteattr(name)} NumberOfTuples="1" format="ascii">{k + 1}'
        "</DataArray>\n"
        for k, name in enumerate(sides)
    )
    order = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
    head = f"""<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{order}" header_type="UInt64">
<UnstructuredGrid>
<FieldData>
{field}</FieldData>
<Piece NumberOfPoints="{len(mesh.points)}" NumberOfCells="{cells}">
<Points>{tag("points", "Points")}</Points>
<Cells>
{tag("connectivity", "connectivity")}
{tag("offsets", "offsets")}
{tag("types", "types")}
</Cells>
<CellData>{tag("side", "side")}</CellData>
</Piece>
</UnstructuredGrid>
<AppendedData encoding="raw">
_"""
    with open(path, "wb") as stream:
        stream.write(head.encode())
        for kind, components, count, parts in arrays.values():
            stream.write(np.uint64(int(kind[1]) * components * count).tobytes())
            for part in parts():
                for start in range(0, len(part), _CHUNK):
                    piece = np.ascontiguousarray(part[start : start + _CHUNK], dtype=kind)
                    piece.tofile(stream)
        stream.write(b"\n</AppendedData>\n</VTKFile>\n")


def _code(kind: str, mesh: VolumeMesh) -> int:
    return VTK_TYPES[kind, mesh.order]


def _offsets(blocks: _Blocks) -> Iterator[NDArray[Any]]:
    total = 0
    for _, block, _ in blocks:
        size = block.shape[1]
        for start in range(0, len(block), _CHUNK):
            stop = min(start + _CHUNK, len(block))
            yield np.arange(start + 1, stop + 1, dtype=np.int64) * size + total
        total += block.size


def _constant(rows: list[tuple[int, int]]) -> Iterator[NDArray[Any]]:
    for count, value in rows:
        for start in range(0, count, _CHUNK):
            yield np.full(min(_CHUNK, count - start), value)
