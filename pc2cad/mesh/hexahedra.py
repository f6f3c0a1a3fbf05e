"""Structured hexahedra: a (u,v,w) grid mapped by the equation, merged where the solid closes.

Every node is a value of the equation itself. Nodes of collapsed and glued sides are one by their
index; cells that lose corners by that become wedges, pyramids or tetrahedra.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.checked import CheckedMap
from pc2cad.domain.map import open_grid
from pc2cad.errors import NotASolidError
from pc2cad.mesh.cutting import Cuts
from pc2cad.mesh.degenerate_cells import Pattern, Piece, is_flat, ring_of, single
from pc2cad.mesh.elements import HEXAHEDRON, TYPES
from pc2cad.mesh.grid import Grid
from pc2cad.mesh.node_merging import (
    cell_nodes,
    chunks,
    glued_cells,
    joined,
    merged_nodes,
    replaced,
    side_cells,
    whole,
)
from pc2cad.mesh.volume_mesh import Facets, VolumeMesh, by_layer, by_whole_side, pieces_among
from pc2cad.topology.cells import Cell, SideKey, normal_direction

#: points evaluated, and cells numbered, at once: the arrays stay in the cache
_CHUNK = 1 << 16
#: face of a hexahedron on the lower and upper limit of its own first, second, third direction
FACE_AT = ((5, 3), (2, 4), (0, 1))


class CellCollapsesError(NotASolidError):
    """A cell of the grid loses so many corners that no element is left on a face of the solid."""


def hexahedra(checked: CheckedMap, grid: Grid, order: int = 1) -> VolumeMesh:
    """Return the mesh of a solid on a grid, with elements of order 1 or 2.

    Raises CellCollapsesError where a cell collapses altogether.
    """
    return Assembly(checked, grid, order).mesh()


@dataclass
class _Split:
    """Cells that became the same elements, ascending, and these."""

    cells: Integers
    #: type, number of the first element of it within the type, own faces on each of the cell's
    parts: list[tuple[str, int, tuple[tuple[int, ...], ...]]] = field(default_factory=list)


class Assembly:
    """Works out one mesh; lives for one call of `hexahedra`."""

    def __init__(self, checked: CheckedMap, grid: Grid, order: int) -> None:
        self._analysis = checked.analysis
        self._grid = grid
        self._order = order
        self._fine = grid.halved() if order == 2 else grid
        self._counts = [len(lines) for lines in self._fine.lines]
        total = int(np.prod(self._counts))
        self._integer: np.dtype[np.integer] = np.dtype("i4" if total < 2**31 else "i8")
        # a left-handed map: the element's first two directions are v and u
        self._axes = checked.orientation.axes
        self._splits: list[_Split] = []
        #: indices that stand for others, ascending, and for which
        self._merged = merged_nodes(self._fine, checked.analysis.boundary)

    def mesh(self) -> VolumeMesh:
        """Return the mesh."""
        blocks, irregular = self._elements()
        moved, stands = self._merged
        numbers, count = self._number(blocks, moved, stands)
        points = self._points(numbers, moved, count)
        if len(moved):
            numbers[moved] = numbers[stands]
        boundary = self._analysis.boundary
        sides = {boundary.key(f.patch): self._facets(f.patch, irregular) for f in boundary.faces}
        equation = self._analysis.equation
        return VolumeMesh(
            equation.name, equation.units, self._order, points, blocks,
            self._by_side(sides), self._node_sets(numbers, count),
            self._layers(irregular), pieces_among(boundary),
        )  # fmt: skip

    def indices(self) -> tuple[Integers, dict[str, Integers]]:
        """Return the grid index of each node, and those of each element's corners, unmerged."""
        blocks = self._elements()[0]
        corners = {k: rows[:, : len(TYPES[k].corners)].copy() for k, rows in blocks.items()}
        numbers, count = self._number(blocks, *self._merged)
        own = np.flatnonzero(numbers >= 0)
        nodes = np.empty(count, dtype=self._integer)
        nodes[numbers[own]] = own
        return nodes, corners

    # -- elements ------------------------------------------------------------------------------

    def _elements(self) -> tuple[dict[str, Integers], Integers]:
        """Return the elements in indices of the fine grid, and the cells that are none as such."""
        firsts = self._first_corners()
        irregular, patterns = self._irregular(firsts)
        self._join_middles(firsts[irregular], patterns)
        made = self._made(firsts, irregular, patterns)
        irregular = np.sort(np.concatenate([cells for _, cells in made])) if made else irregular
        kept = self._corners(np.delete(firsts, irregular) if len(irregular) else firsts)
        blocks: dict[str, list[Integers]] = {HEXAHEDRON.name: [self._with_middles(kept)]}
        counts = dict.fromkeys(TYPES, 0)
        counts[HEXAHEDRON.name] = len(kept)
        for pieces, cells in made:
            split = _Split(cells)
            corners = self._corners(firsts[cells])
            for piece in pieces:
                columns = [corners[:, group[0]] for group in piece.corners]
                if self._order == 2:
                    for edge in range(len(piece.kind.edges)):
                        a, b = piece.middle(edge)
                        columns.append((corners[:, a] + corners[:, b]) // 2)
                name = piece.kind.name
                split.parts.append((name, counts[name], tuple(map(piece.on_face, range(6)))))
                counts[name] += len(cells)
                blocks.setdefault(name, []).append(np.stack(columns, axis=1))
            self._splits.append(split)
        of_type = {name: whole(blocks[name]) for name in TYPES if name in blocks}
        return {name: block for name, block in of_type.items() if len(block)}, irregular

    def _made(
        self, firsts: Integers, irregular: Integers, patterns: Integers
    ) -> list[tuple[tuple[Piece, ...], Integers]]:
        """Return what cells become, and which; none where their faces cover one another."""
        made: list[tuple[tuple[Piece, ...], Integers]] = []
        left: list[Integers] = []
        kinds, which = np.unique(patterns, axis=0, return_inverse=True)
        for k, row in enumerate(kinds):
            cells = irregular[which.ravel() == k]
            pattern = tuple(int(p) for p in row)
            whole = single(pattern)
            if whole is not None:
                made.append(((whole,), cells))
            elif is_flat(pattern):
                self._check_flat(pattern, cells)
                made.append(((), cells))
            else:
                left.append(cells)
        if not left:
            return made
        cut = self._cut(firsts, np.concatenate(left))
        cells = np.fromiter(cut, dtype=np.int64)
        made = [(pieces, row[~np.isin(row, cells)]) for pieces, row in made]
        alike: dict[tuple[Piece, ...], list[int]] = {}
        for number, pieces in sorted(cut.items()):
            alike.setdefault(pieces, []).append(number)
        made += [(pieces, np.array(row)) for pieces, row in alike.items()]
        return [(pieces, row) for pieces, row in made if len(row)]

    def _cut(self, firsts: Integers, cells: Integers) -> dict[int, tuple[Piece, ...]]:
        """Return the elements of cells that have to be cut, and of those that the cuts reach."""
        glued = glued_cells(self._grid, self._analysis.boundary)
        counts = self._grid.cells

        def nodes(numbers: Integers) -> dict[int, list[int]]:
            corners = replaced(self._corners(firsts[numbers]), *self._merged)
            return dict(zip(numbers.tolist(), corners.tolist(), strict=True))

        def beside(number: int) -> dict[int, list[int]]:
            place = np.array(np.unravel_index(number, counts))
            near = place + np.concatenate((np.eye(3, dtype=int), -np.eye(3, dtype=int)))
            near = near[((near >= 0) & (near < counts)).all(axis=1)]
            numbers = [*np.ravel_multi_index(tuple(near.T), counts), *glued.get(number, [])]
            return nodes(np.array(numbers, dtype=np.int64))

        return Cuts().solve(nodes(cells), beside)

    def _join_middles(self, firsts: Integers, patterns: Integers) -> None:
        """Make the middles of edges one that a flat cell lies between."""
        if self._order == 1:
            return
        pairs = [self._merged]
        kinds, which = np.unique(patterns, axis=0, return_inverse=True)
        for k, row in enumerate(kinds):
            if not is_flat(tuple(int(p) for p in row)):
                continue
            corners = self._corners(firsts[which.ravel() == k])
            first: dict[frozenset[int], Integers] = {}
            for a, b in HEXAHEDRON.edges:
                middle = ((corners[:, a] + corners[:, b]) // 2).astype(np.int64)
                ends = frozenset((int(row[a]), int(row[b])))
                if len(ends) == 2:
                    pairs.append((middle, first.setdefault(ends, middle)))
        if len(pairs) > 1:
            self._merged = joined(pairs)

    def _check_flat(self, pattern: Pattern, cells: Integers) -> None:
        """Raise CellCollapsesError where nothing is left of a cell on a face of the solid."""
        for face in self._analysis.boundary.faces:
            d = normal_direction(face.patch)
            own = HEXAHEDRON.faces[self._face(face.patch)]
            if len(ring_of(own, pattern)) < 3:
                continue
            here = np.intersect1d(side_cells(self._grid, face.patch), cells)
            if len(here):
                place = ", ".join(map(str, np.unravel_index(here[0], self._grid.cells)))
                thin = [name for name, n in zip("uvw", self._grid.cells, strict=True) if n == 1]
                which = " or ".join(t for t in thin if t != "uvw"[d]) or "the other directions"
                raise CellCollapsesError(
                    f"the cell ({place}) of the grid has no inside, because sides at it are drawn "
                    f"together; more cells along {which} would help"
                )

    def _strides(self) -> tuple[int, int, int]:
        """Return the steps from a grid line to the next, in indices of the fine grid."""
        _, nv, nw = self._counts
        return self._order * nv * nw, self._order * nw, self._order

    def _first_corners(self) -> Integers:
        """Return the corner of every cell where u, v and w are least, as an index."""
        starts: list[Integers] = [
            np.arange(n, dtype=self._integer) * stride
            for n, stride in zip(self._grid.cells, self._strides(), strict=True)
        ]
        u, v, w = np.ix_(*starts)
        return np.asarray((u + v + w).ravel())

    def _corners(self, firsts: Integers) -> Integers:
        """Return the corners of cells as indices of the fine grid, (cells, 8)."""
        strides = self._strides()
        offsets = [
            sum(int(corner[k]) * strides[self._axes[k]] for k in range(3))
            for corner in HEXAHEDRON.corners
        ]
        return firsts[:, None] + np.array(offsets, dtype=self._integer)

    def _irregular(self, firsts: Integers) -> tuple[Integers, Integers]:
        """Return the cells with equal corners, ascending, and which corners those are."""
        none = np.empty(0, dtype=np.int64), np.empty((0, 8), dtype=np.int64)
        if not len(self._merged[0]):
            return none
        border = np.zeros(self._grid.cells, dtype=bool)
        for d in range(3):
            layer = np.moveaxis(border, d, 0)
            layer[0] = layer[-1] = True
        candidates = np.flatnonzero(border)
        found, rows = [none[0]], [none[1]]
        for start in range(0, len(candidates), _CHUNK):
            part = candidates[start : start + _CHUNK]
            corners = replaced(self._corners(firsts[part]), *self._merged)
            ordered = np.sort(corners, axis=1)
            equal = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
            found.append(part[equal])
            own = corners[equal]
            rows.append((own[:, :, None] == own[:, None, :]).argmax(axis=2))
        return np.concatenate(found), np.concatenate(rows)

    def _with_middles(self, cells: Integers) -> Integers:
        if self._order == 1:
            return cells
        full = np.empty((len(cells), HEXAHEDRON.size(2)), dtype=self._integer)
        full[:, :8] = cells
        for k, (a, b) in enumerate(HEXAHEDRON.edges):
            # the index is linear in the grid position
            full[:, 8 + k] = cells[:, a] // 2 + cells[:, b] // 2 + (cells[:, a] & cells[:, b] & 1)
        return full

    # -- nodes ---------------------------------------------------------------------------------

    def _number(
        self, blocks: dict[str, Integers], moved: Integers, stands: Integers
    ) -> tuple[Integers, int]:
        """Give the nodes that are used numbers, which replace the indices in the elements.

        Returns the number of every index of the fine grid that is its own representative.
        """
        total = int(np.prod(self._counts))
        if self._order == 1 and not len(moved):
            return np.arange(total, dtype=self._integer), total
        table: Integers = np.empty(total, dtype=self._integer)
        if self._order == 1:
            # every node is a corner of some element
            used = np.ones(total, dtype=bool)
        else:
            used = np.zeros(total, dtype=bool)
            for rows in chunks(blocks):
                used[rows] = True
            used[stands[used[moved]]] = True
        used[moved] = False
        np.cumsum(used, out=table)
        count = int(table[-1])
        np.subtract(table, 1, out=table)
        table[~used] = -1
        table[moved] = table[stands]
        for rows in chunks(blocks):
            np.take(table, rows, out=rows, mode="clip")
        table[moved] = -1
        return table, count

    def _points(self, numbers: Integers, moved: Integers, count: int) -> Array:
        """Evaluate the equation at every numbered node, slab by slab on open grids."""
        points = np.empty((count, 3))
        if self._order == 1 and not len(moved):
            flat = points.reshape(*self._counts, 3)
            for part, values in self._slabs(self._fine.lines):
                flat[part] = values
            return points
        table, position = numbers.reshape(self._counts), 0
        for parity in product(range(self._order), repeat=3):
            step = tuple(slice(p, None, self._order) for p in parity)
            wanted = table[step]
            if not (wanted >= 0).any():
                continue
            lines = [row[p :: self._order] for row, p in zip(self._fine.lines, parity, strict=True)]
            for part, values in self._slabs(lines):
                here = wanted[part]
                owned = here >= 0
                if self._order == 1:
                    # numbered in the order of the grid
                    first = points[position : position + int(owned.sum())]
                    np.compress(owned.ravel(), values.reshape(-1, 3), axis=0, out=first)
                    position += len(first)
                else:
                    points[here[owned]] = values[owned]
        return points

    def _slabs(self, lines: tuple[Array, ...] | list[Array]) -> Iterator[tuple[slice, Array]]:
        u, v, w = lines
        step = max(1, _CHUNK // (len(v) * len(w)))
        for start in range(0, len(u), step):
            part = slice(start, min(start + step, len(u)))
            yield part, self._analysis.map.points(*open_grid(u[part], v, w))

    # -- sets ----------------------------------------------------------------------------------

    def _face(self, patch: Cell) -> int:
        """Return which face of its cells lies on a patch of the box."""
        d = normal_direction(patch)
        return FACE_AT[self._axes.index(d)][int(patch[d] > 0)]

    def _facets(self, patch: Cell, irregular: Integers) -> tuple[Facets, ...]:
        """Return the faces of elements on a patch of the box."""
        face = self._face(patch)
        cells = np.sort(side_cells(self._grid, patch).ravel())
        regular = cells[~np.isin(cells, irregular)]
        position = regular - np.searchsorted(irregular, regular)
        rows = [(HEXAHEDRON.name, position, face)] if len(regular) else []
        for split in self._splits:
            here = np.flatnonzero(np.isin(split.cells, cells))
            rows += [(name, first + here, own) for name, first, faces in split.parts
                     for own in faces[face] if len(here)]  # fmt: skip
        return tuple(
            Facets(name, elements.astype(self._integer), np.full(len(elements), own, np.int8))
            for name, elements, own in rows
        )

    def _by_side(self, patches: dict[SideKey, tuple[Facets, ...]]) -> dict[str, tuple[Facets, ...]]:
        """Name whole sides, and also their patches where creases make several."""
        sides: dict[str, tuple[Facets, ...]] = {}
        for key, facets in patches.items():
            side = key.whole.label
            sides[side] = sides.get(side, ()) + facets
        return {**sides, **{key.label: facets for key, facets in patches.items()}}

    def _layers(self, irregular: Integers) -> dict[str, dict[str, Integers]]:
        """Return the elements of each layer; layers are the crease pieces of w."""
        names = self._analysis.equation.layers
        if not names:
            return {}
        lengths = np.diff(self._grid.limits[2])
        along = np.repeat(np.arange(len(lengths), dtype=np.int16), lengths)
        of_cell = np.tile(along, int(np.prod(self._grid.cells[:2])))
        numbers = {HEXAHEDRON.name: [np.delete(of_cell, irregular)]}
        for split in self._splits:
            for kind, _, _ in split.parts:
                numbers.setdefault(kind, []).append(of_cell[split.cells])
        return by_layer(names, {kind: np.concatenate(rows) for kind, rows in numbers.items()})

    def _node_sets(self, numbers: Integers, count: int) -> dict[str, Integers]:
        sets: dict[str, list[Integers]] = {}
        boundary = self._analysis.boundary
        for side in boundary.sides:
            nodes = numbers[cell_nodes(self._fine, side.patch).ravel()]
            for key in by_whole_side(boundary.key(side.patch)):
                sets.setdefault(key, []).append(nodes[nodes >= 0])
        member = np.zeros(count, dtype=bool)
        found: dict[str, Integers] = {}
        for name, parts in sets.items():
            nodes = whole(parts)
            member[nodes] = True
            found[name] = np.flatnonzero(member)
            member[nodes] = False
        return found
