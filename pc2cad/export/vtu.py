"""VTK unstructured grids (.vtu): appended raw binary, written array by array.

Volume elements come first, then the facets of the sides as two-dimensional cells. The cell data
``side`` is 0 inside and the number of the side on its facets; field data of the side's name holds
that number. So does ``layer`` for the elements of a part in layers. Both nodes and cells have u, v,
w and the equation's fields.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from pc2cad.arrays import AnyArray
from pc2cad.export.mesh_files import CellBlock, cell_blocks, cell_values, column_names
from pc2cad.export.vtk_cells import VTK_TYPES, nodes_for_vtk
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.trust.names import clean

_NAMES = {"f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}
_CHUNK = 1 << 20
#: type, components, entries, and the data in parts
_Column = tuple[str, int, int, Callable[[], Iterable[AnyArray]]]


def write(mesh: VolumeMesh, path: Path) -> None:
    """Write the mesh; nothing is held in memory twice."""
    columns = _columns(mesh, cell_blocks(mesh))
    with open(path, "wb") as stream:
        stream.write(_head(mesh, columns).encode())
        for kind, components, count, parts in columns.values():
            stream.write(np.uint64(int(kind[1]) * components * count).tobytes())
            for part in parts():
                for start in range(0, len(part), _CHUNK):
                    piece = np.ascontiguousarray(part[start : start + _CHUNK], dtype=kind)
                    stream.write(piece.data)  # `tofile` does not tell why it fails
        stream.write(b"\n</AppendedData>\n</VTKFile>\n")


def _columns(mesh: VolumeMesh, blocks: list[CellBlock]) -> dict[str, _Column]:
    """Return the arrays of the file in its order."""
    cells = sum(len(block.nodes) for block in blocks)
    corners = sum(block.nodes.size for block in blocks)
    whole = "i8" if corners >= 2**31 else "i4"

    def constant(value: Callable[[CellBlock], int]) -> Callable[[], Iterable[AnyArray]]:
        return lambda: _constant([(len(block.nodes), value(block)) for block in blocks])

    def connectivity() -> Iterable[AnyArray]:
        return (nodes_for_vtk(block, mesh.order) for block in blocks)

    columns: dict[str, _Column] = {
        "points": ("f8", 3, len(mesh.points), lambda: iter((mesh.points,))),
        "connectivity": (whole, 1, corners, connectivity),
        "offsets": (whole, 1, cells, lambda: _offsets(blocks)),
        "types": ("u1", 1, cells, constant(lambda b: VTK_TYPES[b.kind, mesh.order])),
        "side": ("i4", 1, cells, constant(lambda b: b.side)),
    }
    if mesh.layers:
        columns["layer"] = ("i4", 1, cells, constant(lambda b: b.layer))
    for name, size in column_names(mesh).items():
        columns[f"{name} of nodes"] = "f8", size, len(mesh.points), partial(_at_nodes, mesh, name)
        columns[f"{name} of cells"] = "f8", size, cells, partial(cell_values, mesh, name)
    return columns


def _at_nodes(mesh: VolumeMesh, name: str) -> Iterator[AnyArray]:
    assert mesh.columns is not None
    yield mesh.columns.at_nodes(name)


def _head(mesh: VolumeMesh, columns: dict[str, _Column]) -> str:
    """Return the XML before the data, which says where each array begins."""
    position = 0
    offsets = {}
    for name, (kind, components, count, _) in columns.items():
        offsets[name] = position
        position += 8 + int(kind[1]) * components * count

    def tag(name: str, label: str) -> str:
        kind, components, _, _ = columns[name]
        return (
            f'<DataArray type="{_NAMES[kind]}" Name="{label}" NumberOfComponents="{components}" '
            f'format="appended" offset="{offsets[name]}"/>'
        )

    named = [*enumerate(mesh.whole_sides, start=1), *enumerate(mesh.layers, start=1)]
    field = "".join(
        f'<DataArray type="Int32" Name={quoteattr(clean(name))} NumberOfTuples="1" '
        f'format="ascii">{k}</DataArray>\n'
        for k, name in named
    )
    more = column_names(mesh)
    data = "\n".join(
        [tag(name, name) for name in ("side", "layer") if name in columns]
        + [tag(f"{name} of cells", name) for name in more]
    )
    of_nodes = "\n".join(tag(f"{name} of nodes", name) for name in more)
    order = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
    return f"""<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{order}" header_type="UInt64">
<UnstructuredGrid>
<FieldData>
{field}</FieldData>
<Piece NumberOfPoints="{len(mesh.points)}" NumberOfCells="{columns["types"][2]}">
<Points>{tag("points", "Points")}</Points>
<Cells>
{tag("connectivity", "connectivity")}
{tag("offsets", "offsets")}
{tag("types", "types")}
</Cells>
<PointData>{of_nodes}</PointData>
<CellData>{data}</CellData>
</Piece>
</UnstructuredGrid>
<AppendedData encoding="raw">
_"""


def _offsets(blocks: list[CellBlock]) -> Iterator[AnyArray]:
    total = 0
    for block in blocks:
        count, size = block.nodes.shape
        for start in range(0, count, _CHUNK):
            stop = min(start + _CHUNK, count)
            yield np.arange(start + 1, stop + 1, dtype=np.int64) * size + total
        total += block.nodes.size


def _constant(rows: list[tuple[int, int]]) -> Iterator[AnyArray]:
    for count, value in rows:
        for start in range(0, count, _CHUNK):
            yield np.full(min(_CHUNK, count - start), value)
