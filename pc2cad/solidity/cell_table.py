"""The cells of all faces in one table: which of them rays may meet, and these cut into parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, pairwise
from typing import Final

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.solidity.face_mesh import FaceMesh, cells_between, corners_of, halves
from pc2cad.solidity.winding_number import ray_frame
from pc2cad.topology.cells import directions_of, outward_sign

#: places that are evaluated together: more are of many pieces of functions
TOGETHER: Final = 4096


@dataclass(frozen=True, eq=False)
class Parts:
    """Equal parts of faces in both of their parameters."""

    #: (n,)
    face: Integers
    #: number of each part along s and along t, and of how many, (n, 2) each
    number: Integers
    total: Integers

    def chosen(self, which: slice | Booleans) -> Parts:
        """Return some of them."""
        return Parts(self.face[which], self.number[which], self.total[which])

    def divided(self, count: int) -> Parts:
        """Return the count² parts of each, s first."""
        i, j = np.divmod(np.arange(count**2), count)
        number = count * self.number[:, None] + np.column_stack((i, j))
        total = np.repeat(count * self.total, count**2, axis=0)
        return Parts(np.repeat(self.face, count**2), number.reshape(-1, 2), total)


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

    @cached_property
    def reach(self) -> float:
        """Largest coordinate of a corner of the mesh."""
        return max(float(np.abs(mesh.samples).max()) for mesh in self._meshes)

    @property
    def cells(self) -> Array:
        """Return the corners of all cells, (cells, 2, 2, 3)."""
        rows = [list(same) for _, same in groupby(self._meshes, lambda mesh: mesh.shape)]
        return np.concatenate([corners_of(np.array([m.samples for m in row])) for row in rows])

    @cached_property
    def triangles(self) -> Array:
        """Two outward triangles of each cell, (2·cells, 3, 3)."""
        return self.outward(
            self.cells, np.repeat(np.arange(len(self._meshes)), np.diff(self._starts))
        )

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

    def parts(self, cells: Integers) -> Parts:
        """Return cells as parts of themselves."""
        face, i, j = self._place_of(cells)
        return Parts(face, np.column_stack((i, j)), self._shapes[face])

    def refined(self, cells: Integers, count: int) -> Array:
        """Return outward triangles of the count² parts of some cells, (2·cells·count², 3, 3)."""
        result = []
        for few, g in self.grids(self.parts(cells), count):
            result.append(self.outward(cells_between(g), np.repeat(few.face, count**2)))
        return np.concatenate(result) if result else np.empty((0, 3, 3))

    def grids(self, parts: Parts, count: int) -> Iterator[tuple[Parts, Array]]:
        """Yield some parts at a time, and points of a grid on each.

        At count + 1 even places along both parameters, (parts, count+1, count+1, 3).
        """
        most = max(1, TOGETHER // (count + 1) ** 2)
        # parts of faces that extend along the same directions follow one another
        changed = (np.diff(self._directions[parts.face], axis=0) != 0).any(axis=1)
        for first, last in pairwise((0, *(np.flatnonzero(changed) + 1).tolist(), len(parts.face))):
            for start in range(first, last, most):
                few = parts.chosen(slice(start, min(start + most, last)))
                yield few, self._points(few, count)

    def _points(self, parts: Parts, count: int) -> Array:
        face, steps = parts.face, np.arange(count + 1)
        s, t = self._directions[face[0]]
        places = list(self._low[face].T[:, :, None, None])
        for axis, d, along in ((0, s, steps[:, None]), (1, t, steps)):
            at = (count * parts.number[:, axis])[:, None, None] + along
            share = at / (count * parts.total[:, axis])[:, None, None]
            places[d] = places[d] + self._extent[face, d][:, None, None] * share
        return self._map.points(*places)

    def outward(self, cells: Array, face: Integers) -> Array:
        """Return two outward triangles of each cell (n, 2, 2, 3) of a face, (2n, 3, 3)."""
        triangles = halves(cells).reshape(2, -1, 3, 3)
        turned = self._turned[face]
        triangles[:, turned] = triangles[:, turned, ::-1]
        return triangles.reshape(-1, 3, 3)
