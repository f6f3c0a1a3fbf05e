"""The cells of all faces in one table: which of them rays may meet, and these cut into parts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import groupby, pairwise
from typing import Final

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.solidity.face_mesh import FaceMesh, corners_of, halves
from pc2cad.solidity.winding_number import ray_frame
from pc2cad.topology.cells import directions_of, outward_sign

#: places that are evaluated together: more are of many pieces of functions
TOGETHER: Final = 4096


class CellTable:
    """The cells of faces, numbered face by face."""

    def __init__(self, face_meshes: Sequence[FaceMesh], sign: int) -> None:
        """Take faces of one solid; `sign` is that of det J."""
        self._meshes = face_meshes
        functions = [mesh.function for mesh in face_meshes]
        self._map = functions[0].analysis.map
        self._shapes = np.array([mesh.shape for mesh in face_meshes])
        self._directions = np.array([directions_of(f.cell) for f in functions])
        spans = np.array(
            [[f.analysis.span(d, position) for d, position in enumerate(f.cell)] for f in functions]
        )
        self._low, self._extent = spans[..., 0], spans[..., 1] - spans[..., 0]
        self._turned = np.array([outward_sign(f.cell) * sign < 0 for f in functions])
        self._starts = np.append(0, np.cumsum(self._shapes.prod(axis=1)))

    @cached_property
    def error(self) -> float:
        """Largest distance seen between the mesh and the faces."""
        return max(mesh.error for mesh in self._meshes)

    @property
    def cells(self) -> Array:
        """Return the corners of all cells, (cells, 2, 2, 3)."""
        rows = [list(same) for _, same in groupby(self._meshes, lambda mesh: mesh.shape)]
        return np.concatenate([corners_of(np.array([m.samples for m in row])) for row in rows])

    @cached_property
    def triangles(self) -> Array:
        """Two outward triangles of each cell, (2·cells, 3, 3)."""
        triangles = halves(self.cells).reshape(2, -1, 3, 3)
        turned = np.repeat(self._turned, np.diff(self._starts))
        triangles[:, turned] = triangles[:, turned, ::-1]
        return triangles.reshape(-1, 3, 3)

    def near(self, points: Array, places: Array, seed: int) -> Integers:
        """Return the cells near the rays of points (n, 3).

        An image outside the mesh is the sign of a needle or a ridge that no cell's corners show:
        all cells are taken that have a parameter of such a point's place (n, 3), if that is known.
        """
        low, high = self._first_boxes if seed == 0 else self._boxes(seed)
        met = np.zeros(len(low), dtype=bool)
        for x, y in (points @ ray_frame(seed))[:, :2]:
            met |= (low[:, 0] <= x) & (x <= high[:, 0]) & (low[:, 1] <= y) & (y <= high[:, 1])
        for axis in (0, 1):
            met |= self._rows_of(places, axis)[self._rows[axis]]
        return np.flatnonzero(met)

    @cached_property
    def _first_boxes(self) -> tuple[Array, Array]:
        return self._boxes(0)

    def _boxes(self, seed: int) -> tuple[Array, Array]:
        """Return limits of each cell across the rays of a direction, (cells, 2) each."""
        corners = (self.cells.reshape(-1, 4, 3) @ ray_frame(seed))[..., :2]
        low, high = corners.min(axis=1), corners.max(axis=1)
        # a face may leave the box of its corners: by the mesh's error, or within itself
        pad = 2 * self.error + 0.25 * (high - low)
        return low - pad, high + pad

    @cached_property
    def _rows(self) -> tuple[Integers, Integers]:
        """Of each cell: its row along s and along t, numbered through all faces."""
        every = np.arange(self._starts[-1])
        face, i, j = self._place_of(every)
        firsts = np.cumsum(self._shapes, axis=0) - self._shapes
        return firsts[face, 0] + i, firsts[face, 1] + j

    def _place_of(self, cells: Integers) -> tuple[Integers, Integers, Integers]:
        """Return the faces of cells, and their numbers along s and t."""
        face = np.searchsorted(self._starts, cells, side="right") - 1
        i, j = np.divmod(cells - self._starts[face], self._shapes[face, 1])
        return face, i, j

    def _rows_of(self, places: Array, axis: int) -> Booleans:
        """Say which rows along an axis of all faces hold a parameter of some places."""
        every, counts = np.arange(len(self._shapes)), self._shapes[:, axis]
        d = self._directions[:, axis]
        found = np.zeros(counts.sum(), dtype=bool)
        share = (places[:, d] - self._low[every, d]) / self._extent[every, d]
        place, face = np.nonzero((share >= 0) & (share <= 1))
        rows = np.minimum((share[place, face] * counts[face]).astype(int), counts[face] - 1)
        found[(np.cumsum(counts) - counts)[face] + rows] = True
        return found

    def refined(self, chosen: Integers, count: int) -> Array:
        """Return outward triangles of the count² parts of some cells, (2·cells·count², 3, 3)."""
        face, i, j = self._place_of(chosen)
        inner = np.linspace(0.0, 1.0, count + 1)
        most = max(1, TOGETHER // len(inner) ** 2)
        result = []
        # cells of faces that extend along the same directions follow one another
        changes = np.flatnonzero((np.diff(self._directions[face], axis=0) != 0).any(axis=1)) + 1
        for first, last in pairwise((0, *changes.tolist(), len(chosen))):
            for start in range(first, last, most):
                part = slice(start, min(start + most, last))
                cells = self._parts(face[part], i[part], j[part], inner)
                triangles = halves(cells).reshape(2, -1, count**2, 3, 3)
                turned = self._turned[face[part]]
                triangles[:, turned] = triangles[:, turned, :, ::-1]
                result.append(triangles.reshape(-1, 3, 3))
        return np.concatenate(result) if result else np.empty((0, 3, 3))

    def _parts(self, face: Integers, i: Integers, j: Integers, inner: Array) -> Array:
        """Return the corners of the parts of cells of faces that extend along two directions."""
        (n, m), (s, t) = self._shapes[face].T, self._directions[face[0]]
        places = list(self._low[face].T[:, :, None, None])
        for d, k, total, shares in ((s, i, n, inner[:, None]), (t, j, m, inner)):
            share = (k[:, None, None] + shares) / total[:, None, None]
            places[d] = places[d] + self._extent[face, d][:, None, None] * share
        g = self._map.points(*places)
        pairs = np.stack((np.stack((g[:, :-1, :-1], g[:, :-1, 1:]), 3),
                          np.stack((g[:, 1:, :-1], g[:, 1:, 1:]), 3)), 3)  # fmt: skip
        return pairs.reshape(-1, 2, 2, 3)
