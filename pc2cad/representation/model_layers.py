"""Shells and layers of a boundary model: which of its faces each is made of."""

from __future__ import annotations

import numpy as np

from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.geometry.recognition.from_points import irrational
from pc2cad.representation.boundary_model import Layer, ModelFace
from pc2cad.representation.plan import Cells
from pc2cad.topology.complex import Shell


def faces_of(shell: Shell, faces: list[ModelFace]) -> tuple[int, ...]:
    """Return the faces of a shell."""
    return tuple(i for i, face in enumerate(faces) if face.cells[0] in shell.faces)


def layer(name: str, index: int, cells: Cells, faces: list[ModelFace]) -> Layer:
    """Return a layer: the widest of its shells is the outer one."""
    boundary = cells.boundary
    shells = sorted(
        boundary.layers[index], key=lambda shell: -max(_extent(cells.faces[f]) for f in shell.faces)
    )
    # a face between two layers is made as the upper side of the lower one
    upside_down = [
        face.cells[0] in boundary.enclosed and boundary.faces[face.cells[0]].patch[2] == 2 * index
        for face in faces
    ]
    members = tuple(tuple((i, upside_down[i]) for i in faces_of(shell, faces)) for shell in shells)
    return Layer(name, members, sum(shell.euler for shell in shells))


def _extent(face: RestrictedMap) -> float:
    """Return the diagonal of the box round samples of a face."""
    nodes = irrational(9)
    return float(np.linalg.norm(np.ptp(face(nodes, nodes), axis=(0, 1))))
