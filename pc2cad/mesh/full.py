"""Hexahedra of order 2 with 27 nodes: those in the middles of faces and cells are M's own, too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.errors import InputError

if TYPE_CHECKING:
    from pc2cad.mesh.volume_mesh import VolumeMesh

#: corners of the faces in the order of the nodes 20 to 25, across the first, second, third axis
FACES = np.array([
    [0, 4, 7, 3], [1, 2, 6, 5], [0, 1, 5, 4], [3, 7, 6, 2], [0, 3, 2, 1], [4, 5, 6, 7],
])  # fmt: skip


@dataclass(frozen=True, eq=False)
class FullMesh:
    """The nodes of a mesh and those beside them, (n, 3), and elements, (m, 27), as VTK has them.

    `middles` gives the node in the middle of a face by its four corners, ascending.
    """

    points: Array
    elements: Integers
    middles: dict[tuple[int, ...], int]

    def facets(self, eight: Integers) -> Integers:
        """Return facets of eight nodes with their ninth, (n, 9)."""
        corners = np.sort(eight[:, :4], axis=1).tolist()
        ninth = [self.middles[tuple(row)] for row in corners]
        return np.column_stack((eight, np.array(ninth, dtype=eight.dtype)))


def full(mesh: VolumeMesh) -> FullMesh:
    """Return a mesh with the nodes that hexahedra of 27 have; raise InputError for another mesh."""
    columns, alone = mesh.columns, mesh.order == 2 and {*mesh.blocks} == {"hexahedron"}
    local = columns.places.corners("hexahedron") if columns is not None and alone else None
    if columns is None or local is None:
        raise InputError(
            "elements of 27 nodes are hexahedra of order 2 of a (u,v,w) grid, and nothing beside "
            f"them: the mesh has {', '.join(mesh.blocks)} of order {mesh.order}"
        )
    block = mesh.blocks["hexahedron"]
    faces = np.sort(block[:, FACES], axis=2).reshape(-1, 4)
    own, first, number = np.unique(faces, axis=0, return_index=True, return_inverse=True)
    count = len(mesh.points)
    on_faces = local[:, FACES].mean(axis=2).reshape(-1, 3)[first]
    within = local.mean(axis=1)
    added = columns.checked.map.points(*np.concatenate((on_faces, within)).T)
    elements = np.column_stack((
        block, count + number.reshape(-1, 6), count + len(own) + np.arange(len(block)),
    ))  # fmt: skip
    middles = {tuple(row): count + k for k, row in enumerate(own.tolist())}
    return FullMesh(np.concatenate((mesh.points, added)), elements, middles)
