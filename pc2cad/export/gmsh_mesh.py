"""gmsh meshes (.msh), format 2.2, binary: sides as physical surfaces, elements as a volume."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.export.mesh_files import cell_blocks, cell_values, column_names, reordered
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.trust.names import told_apart

#: element numbers of gmsh by type and order
_CODES = {
    ("hexahedron", 1): 5, ("hexahedron", 2): 17, ("wedge", 1): 6, ("wedge", 2): 18,
    ("pyramid", 1): 7, ("pyramid", 2): 19, ("tetra", 1): 4, ("tetra", 2): 11,
    ("quad", 1): 3, ("quad", 2): 16, ("triangle", 1): 2, ("triangle", 2): 9,
}  # fmt: skip
#: gmsh's order of edges, where it is not VTK's
_EDGES = {
    "hexahedron": ((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7),
                   (5, 6), (6, 7)),
    "wedge": ((0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5)),
    "pyramid": ((0, 1), (0, 3), (0, 4), (1, 2), (1, 4), (2, 3), (2, 4), (3, 4)),
    "tetra": ((0, 1), (1, 2), (2, 0), (3, 0), (3, 2), (3, 1)),
}  # fmt: skip
_CHUNK = 1 << 18


def write(mesh: VolumeMesh, path: Path) -> None:
    """Write the mesh; physical volumes are the layers, or one called ``solid``."""
    sides = mesh.whole_sides
    surfaces, volumes = _quotable(sides), _quotable(mesh.layers or ["solid"])
    names = [f'2 {k} "{name}"' for k, name in enumerate(surfaces, start=1)]
    names += [f'3 {k} "{name}"' for k, name in enumerate(volumes, start=len(sides) + 1)]
    blocks = cell_blocks(mesh)
    with open(path, "wb") as stream:
        stream.write(b"$MeshFormat\n2.2 1 8\n" + np.int32(1).tobytes() + b"\n$EndMeshFormat\n")
        listed = "\n".join([str(len(names)), *names])
        stream.write(f"$PhysicalNames\n{listed}\n$EndPhysicalNames\n".encode())
        stream.write(f"$Nodes\n{len(mesh.points)}\n".encode())
        for start in range(0, len(mesh.points), _CHUNK):
            places = mesh.points[start : start + _CHUNK]
            rows = np.empty(len(places), dtype=[("number", "i4"), ("place", "f8", 3)])
            rows["number"] = np.arange(start + 1, start + 1 + len(places))
            rows["place"] = places
            stream.write(rows.tobytes())
        cells = sum(len(block.nodes) for block in blocks)
        stream.write(f"\n$EndNodes\n$Elements\n{cells}\n".encode())
        first = 1
        for block in blocks:
            group = block.side or len(sides) + max(block.layer, 1)
            for start in range(0, len(block.nodes), _CHUNK):
                part = _ordered(block.kind, block.nodes[start : start + _CHUNK], mesh.order)
                head = np.array([_CODES[block.kind, mesh.order], len(part), 2], dtype=np.int32)
                numbers = np.empty((len(part), 3 + part.shape[1]), dtype=np.int32)
                numbers[:, 0] = np.arange(first, first + len(part))
                numbers[:, 1:3] = group
                numbers[:, 3:] = part + 1
                stream.write(head.tobytes() + numbers.tobytes())
                first += len(part)
        stream.write(b"\n$EndElements\n")
        for name, size in column_names(mesh).items():
            assert mesh.columns is not None
            _put_view(stream, "Node", name, size, [mesh.columns.at_nodes(name)])
            _put_view(stream, "Element", name, size, list(cell_values(mesh, name)))


def _put_view(stream: BinaryIO, of: str, name: str, size: int, parts: list[Array]) -> None:
    """Write a column at time 0; a vector has three components, as gmsh has them."""
    count = sum(map(len, parts))
    head = f'${of}Data\n1\n"{name}"\n1\n0.0\n3\n0\n{size}\n{count}\n'
    stream.write(head.encode())
    first = 1
    for part in parts:
        rows = np.empty(len(part), dtype=[("number", "i4"), ("value", "f8", (size,))])
        rows["number"] = np.arange(first, first + len(part))
        rows["value"] = part
        stream.write(rows.tobytes())
        first += len(part)
    stream.write(f"\n$End{of}Data\n".encode())


def _quotable(names: Iterable[str]) -> list[str]:
    """Return names that may stand between quotes: these, and control characters, as ``%XX``."""
    return list(told_apart(names, 120, '"\\', plain=False).values())


def _ordered(kind: str, nodes: Integers, order: int) -> Integers:
    return reordered(kind, nodes, order, _EDGES[kind]) if kind in _EDGES else nodes
