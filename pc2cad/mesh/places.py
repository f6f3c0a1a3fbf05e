"""Where the nodes, elements and facets of a mesh lie in the box: the local u, v, w of each.

Of a (u,v,w) grid they are known; a node on a seam or a collapsed side has those of one of the
places of the box that are one there, while middles of elements and facets are never on the wrong
side of a seam. Of other meshes they are found from the points, within 1e-10 of the part's size.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.checked import CheckedMap
from pc2cad.mesh.elements import TYPES
from pc2cad.mesh.grid import Grid
from pc2cad.mesh.hexahedra import Assembly
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.sampling.inversion import Inverse

#: elements whose corners are looked up at once
_CHUNK = 1 << 18


class Places(Protocol):
    """Local parameters, (n, 3) each."""

    def nodes(self) -> Array:
        """Return those of the nodes."""

    def elements(self, kind: str) -> Array:
        """Return those of a place within each element of a type."""

    def facets(self, side: str) -> dict[str, Array]:
        """Return those of a place within each facet of a side, by shape as `facet_nodes`."""

    def corners(self, kind: str) -> Array | None:
        """Return those of the corners of each element, (n, corners, 3); None: not of a grid."""


@dataclass(frozen=True, eq=False)
class GridPlaces:
    """Of a mesh that `hexahedra` makes."""

    checked: CheckedMap
    grid: Grid
    order: int
    mesh: VolumeMesh

    @cached_property
    def _indices(self) -> tuple[Integers, dict[str, Integers]]:
        """The index in the fine grid of each node, and those of the corners of each element."""
        return Assembly(self.checked, self.grid, self.order).indices()

    def nodes(self) -> Array:
        """See Places.nodes."""
        return self._at(self._indices[0])

    def elements(self, kind: str) -> Array:
        """See Places.elements."""
        return self._middles(self._indices[1][kind])

    def facets(self, side: str) -> dict[str, Array]:
        """See Places.facets."""
        corners = self.mesh.facet_rows(side, self._indices[1], 1)
        return {shape: self._middles(rows) for shape, rows in corners.items()}

    def corners(self, kind: str) -> Array:
        """See Places.corners."""
        return self._at(self._indices[1][kind])

    def _at(self, indices: Integers) -> Array:
        lines = (self.grid.halved() if self.order == 2 else self.grid).lines
        steps = np.unravel_index(indices, tuple(map(len, lines)))
        return np.stack([row[k] for row, k in zip(lines, steps, strict=True)], axis=-1)

    def _middles(self, corners: Integers) -> Array:
        found = np.empty((len(corners), 3))
        for start in range(0, len(corners), _CHUNK):
            part = slice(start, start + _CHUNK)
            found[part] = self._at(corners[part]).mean(axis=1)
        return found


@dataclass(frozen=True, eq=False)
class FoundPlaces:
    """Of any mesh: M is inverted at nodes, and in the middle of corners."""

    checked: CheckedMap
    mesh: VolumeMesh

    @cached_property
    def _inverse(self) -> Inverse:
        return Inverse(self.checked.analysis)

    def nodes(self) -> Array:
        """See Places.nodes."""
        return self._inverse(self.mesh.points)[0]

    def elements(self, kind: str) -> Array:
        """See Places.elements."""
        corners = self.mesh.blocks[kind][:, : len(TYPES[kind].corners)]
        return self._inverse(self.mesh.points[corners].mean(axis=1))[0]

    def facets(self, side: str) -> dict[str, Array]:
        """See Places.facets."""
        corners = self.mesh.facet_rows(side, self.mesh.blocks, 1)
        return {
            shape: self._inverse(self.mesh.points[rows].mean(axis=1))[0]
            for shape, rows in corners.items()
        }

    def corners(self, kind: str) -> None:
        """See Places.corners."""
