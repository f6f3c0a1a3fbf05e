"""All sheets of a boundary, as arrays over their patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.geometry.sheets import Patches, Sheet, SheetSide

#: coordinates of a sheet or along an edge that differ by less are one
SAME = 1e-11
#: and weights
SAME_WEIGHT = 1e-12
#: the edge of a side that is a point
POINT = -1


@dataclass(frozen=True, eq=False)
class Surfaces:
    """All sheets of a boundary as arrays over their patches, raised to one degree."""

    sheets: Sequence[Sheet]
    #: start and step of straight edges (E, 2, 3), NaN for others
    lines: Array
    _walls: dict[tuple[int, int], bool] = field(default_factory=dict, repr=False)
    _nets: list[Array] = field(default_factory=list, repr=False)

    @cached_property
    def degree(self) -> int:
        """The degree of all nets in both directions."""
        return max(n for sheet in self.sheets for n in sheet.patches.degrees)

    @cached_property
    def _slot(self) -> Integers:
        """Where the net of each patch is among those that were asked for, -1: it was not."""
        return np.full(len(self.sheet_of), -1)

    @cached_property
    def _raised(self) -> list[Patches]:
        return [sheet.patches.raised(self.degree) for sheet in self.sheets]

    def nets(self, patches: Integers) -> Array:
        """Return nets of patches (k, d+1, d+1, 4), raised to one degree.

        They are made when they are first asked for: most are never.
        """
        new = distinct(patches[self._slot[patches] < 0])
        sheets = self.sheet_of[new]
        known = sum(map(len, self._nets))
        self._slot[new] = known + np.arange(len(new))
        for index in distinct(sheets):
            part = self.place[new[sheets == index]]
            self._nets.append(self._raised[index].take(part[:, 0], part[:, 1]))
        if len(self._nets) > 1:
            self._nets[:] = [np.concatenate(self._nets)]
        return np.asarray(self._nets[0][self._slot[patches]])

    @cached_property
    def shapes(self) -> Integers:
        """Patches along s and t of each sheet."""
        return np.array([sheet.shape for sheet in self.sheets])

    @cached_property
    def start(self) -> Integers:
        """First patch of each sheet."""
        sizes = self.shapes.prod(axis=1)
        return np.asarray(np.cumsum(sizes) - sizes)

    @cached_property
    def sheet_of(self) -> Integers:
        """The sheet of each patch."""
        return np.repeat(np.arange(len(self.sheets)), self.shapes.prod(axis=1))

    @cached_property
    def place(self) -> Integers:
        """Row and column of each patch in its sheet."""
        return np.concatenate([np.indices(sheet.shape).reshape(2, -1).T for sheet in self.sheets])

    @cached_property
    def plane(self) -> Integers:
        """The face of each sheet that lies in a plane, -1 for others."""
        return np.array([-1 if s.plane is None else s.face for s in self.sheets])

    @cached_property
    def beside(self) -> Integers:
        """What is on the two sides of each sheet, (sheets, 2)."""
        return np.array([sheet.beside for sheet in self.sheets])

    @cached_property
    def planes(self) -> tuple[Array, Array]:
        """Origin and normal of each sheet's plane (zero where it lies in none)."""
        zero = np.zeros(3)
        rows = [(zero, zero) if s.plane is None else (s.plane.origin, s.plane.normal)
                for s in self.sheets]  # fmt: skip
        return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])

    def walls(self, one: Integers, other: Integers) -> Booleans:
        """Say which pairs of different sheets are on one grid, of curves of the same weights.

        They may be the two sides of a wall.
        """
        keys, back = np.unique(one * len(self.sheets) + other, return_inverse=True)
        pairs = [divmod(int(key), len(self.sheets)) for key in keys]
        return np.array([self._wall(i, j) for i, j in pairs], dtype=bool)[back]

    def _wall(self, i: int, j: int) -> bool:
        key = (min(i, j), max(i, j))
        if key not in self._walls:
            first, second = self.sheets[i], self.sheets[j]
            fit = i != j and first.separable and second.separable
            fit = fit and first.plane is None and second.plane is None
            self._walls[key] = fit and _on_one_grid(first.patches, second.patches)
        return self._walls[key]

    @cached_property
    def closed(self) -> Booleans:
        """Along which directions sheets go on where they end: (sheets, 2)."""
        found = []
        for sheet in self.sheets:
            ends = ((sheet.sides[3], sheet.sides[1]), (sheet.sides[0], sheet.sides[2]))
            found.append([_is_same(a, b) for a, b in ends])
        return np.array(found)

    @cached_property
    def separable(self) -> Booleans:
        """Whether tangents are sums of differences of control points, per sheet."""
        return np.array([sheet.separable for sheet in self.sheets])

    @cached_property
    def edges(self) -> Integers:
        """The edge of each side of each sheet, -1 where it is a point."""
        return np.array(
            [[POINT if s.edge is None else s.edge for s in sheet.sides] for sheet in self.sheets]
        )

    @cached_property
    def vertices(self) -> Integers:
        """The vertices at both ends of each side, (sheets, 4, 2)."""
        return np.array([[side.ends for side in sheet.sides] for sheet in self.sheets])

    @cached_property
    def joined(self) -> Booleans:
        """Which sheets have an edge or a vertex in common, (sheets, sheets)."""
        ends = self.vertices.reshape(len(self.sheets), -1)
        return np.asarray((ends[:, None, :, None] == ends[:, None]).any(axis=(2, 3)))

    @cached_property
    def along(self) -> Array:
        """Coordinates along the edges at the ends of patches, (sheets, 4, most + 1)."""
        most = int(self.shapes.max()) + 1
        table = np.zeros((len(self.sheets), 4, most))
        for i, sheet in enumerate(self.sheets):
            for k, side in enumerate(sheet.sides):
                table[i, k, : len(side.along)] = side.along
                table[i, k, len(side.along) :] = side.along[-1]
        return table

    @cached_property
    def borders(self) -> tuple[Booleans, Booleans]:
        """Which edges and which vertices each face in a plane has: (faces, E), (faces, V)."""
        faces = 1 + max(sheet.face for sheet in self.sheets)
        edges = np.zeros((faces, len(self.lines) + 1), dtype=bool)
        vertices = np.zeros((faces, int(self.vertices.max()) + 1), dtype=bool)
        for i, sheet in enumerate(self.sheets):
            edges[sheet.face, self.edges[i]] = True
            vertices[sheet.face, self.vertices[i].ravel()] = True
        edges[:, -1] = False
        return edges, vertices


def _on_one_grid(first: Patches, second: Patches) -> bool:
    """Say whether two grids of patches are made alike, with the same weights."""
    if first.poles.shape != second.poles.shape or first.shape != second.shape:
        return False
    if (first.matrices is None) != (second.matrices is None):
        return False
    parts = [
        (first.poles[..., 3], second.poles[..., 3]),
        *zip(first.index, second.index, strict=True),
    ]
    if first.matrices is not None and second.matrices is not None:
        parts += zip(first.matrices, second.matrices, strict=True)
    return all(
        a is b or (a.shape == b.shape and bool(np.abs(a - b).max() <= SAME_WEIGHT))
        for a, b in parts
    )


def _is_same(first: SheetSide, second: SheetSide) -> bool:
    """Say whether two opposite sides are one edge, met at equal places."""
    return (
        first.edge is not None
        and first.edge == second.edge
        and first.along.shape == second.along.shape
        and bool(np.abs(first.along - second.along).max() <= SAME)
    )
