"""VTK legacy files (.vtk), version 4.2, binary: the cells and sides of a .vtu in one old format."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from pc2cad.arrays import AnyArray
from pc2cad.export.mesh_files import cell_blocks, cell_values, column_names
from pc2cad.export.vtk_cells import VTK_TYPES, nodes_for_vtk
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.trust.names import percent

_CHUNK = 1 << 18


def write(mesh: VolumeMesh, path: Path) -> None:
    """Write the mesh; the cell data ``side`` is k on the k-th side, ``layer`` in the k-th layer."""
    blocks = cell_blocks(mesh)
    cells = sum(len(block.nodes) for block in blocks)
    numbers = sum(block.nodes.size for block in blocks) + cells
    title = percent(mesh.name, "", limit=200)
    with open(path, "wb") as stream:
        stream.write(
            f"# vtk DataFile Version 4.2\n{title} ({mesh.units})\nBINARY\n"
            f"DATASET UNSTRUCTURED_GRID\nPOINTS {len(mesh.points)} double\n".encode()
        )
        _put(stream, mesh.points, ">f8")
        stream.write(f"\nCELLS {cells} {numbers}\n".encode())
        for block in blocks:
            nodes = nodes_for_vtk(block, mesh.order)
            for start in range(0, len(nodes), _CHUNK):
                part = nodes[start : start + _CHUNK]
                rows = np.empty((len(part), part.shape[1] + 1), dtype=">i4")
                rows[:, 0] = part.shape[1]
                rows[:, 1:] = part
                _put(stream, rows, ">i4")
        stream.write(f"\nCELL_TYPES {cells}\n".encode())
        for block in blocks:
            _put(stream, np.full(len(block.nodes), VTK_TYPES[block.kind, mesh.order]), ">i4")
        stream.write(f"\nCELL_DATA {cells}".encode())
        for name in ("side", "layer") if mesh.layers else ("side",):
            stream.write(f"\nSCALARS {name} int 1\nLOOKUP_TABLE default\n".encode())
            for block in blocks:
                _put(stream, np.full(len(block.nodes), getattr(block, name)), ">i4")
        for name, size in column_names(mesh).items():
            stream.write(_heading(name, size))
            for values in cell_values(mesh, name):
                _put(stream, values, ">f8")
        if mesh.columns is not None:
            stream.write(f"\nPOINT_DATA {len(mesh.points)}".encode())
            for name, size in mesh.columns.sizes.items():
                stream.write(_heading(name, size))
                _put(stream, mesh.columns.at_nodes(name), ">f8")
        stream.write(b"\n")


def _heading(name: str, size: int) -> bytes:
    table = "\nLOOKUP_TABLE default" if size == 1 else ""
    kind = f"SCALARS {name} double 1" if size == 1 else f"VECTORS {name} double"
    return f"\n{kind}{table}\n".encode()


def _put(stream: BinaryIO, values: AnyArray, kind: str) -> None:
    for start in range(0, len(values), _CHUNK):
        stream.write(np.ascontiguousarray(values[start : start + _CHUNK], dtype=kind).tobytes())
