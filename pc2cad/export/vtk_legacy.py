"""VTK legacy files (.vtk), version 4.2, binary: the cells and sides of a .vtu in one old format."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from pc2cad.export.mesh_files import cell_blocks
from pc2cad.export.vtu import VTK_TYPES
from pc2cad.mesh.volume_mesh import VolumeMesh

_CHUNK = 1 << 18


def write(mesh: VolumeMesh, path: Path) -> None:
    """Write the mesh; the cell data ``side`` is 0 inside and k on the k-th side."""
    blocks = cell_blocks(mesh)
    cells = sum(len(nodes) for _, nodes, _ in blocks)
    numbers = sum(nodes.size for _, nodes, _ in blocks) + cells
    title = mesh.name.encode("ascii", "replace").decode()[:200]
    with open(path, "wb") as stream:
        stream.write(
            f"# vtk DataFile Version 4.2\n{title} ({mesh.units})\nBINARY\n"
            f"DATASET UNSTRUCTURED_GRID\nPOINTS {len(mesh.points)} double\n".encode()
        )
        _put(stream, mesh.points, ">f8")
        stream.write(f"\nCELLS {cells} {numbers}\n".encode())
        for _, nodes, _ in blocks:
            for start in range(0, len(nodes), _CHUNK):
                part = nodes[start : start + _CHUNK]
                rows = np.empty((len(part), part.shape[1] + 1), dtype=">i4")
                rows[:, 0] = part.shape[1]
                rows[:, 1:] = part
                _put(stream, rows, ">i4")
        stream.write(f"\nCELL_TYPES {cells}\n".encode())
        for kind, nodes, _ in blocks:
            _put(stream, np.full(len(nodes), VTK_TYPES[kind, mesh.order]), ">i4")
        stream.write(f"\nCELL_DATA {cells}\nSCALARS side int 1\nLOOKUP_TABLE default\n".encode())
        for _, nodes, side in blocks:
            _put(stream, np.full(len(nodes), side), ">i4")
        stream.write(b"\n")


def _put(stream: BinaryIO, values: NDArray[np.generic], kind: str) -> None:
    for start in range(0, len(values), _CHUNK):
        stream.write(np.ascontiguousarray(values[start : start + _CHUNK], dtype=kind).tobytes())
