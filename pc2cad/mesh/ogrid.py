"""O-grids: hexahedra alone, where sides of the box are collapsed to axes, points and rims.

The blocks (modules `polytopes` and `blocks`) get lattices of nodes, which are one wherever blocks
share a face. Every node is a value of the equation itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import along
from pc2cad.checked import CheckedMap
from pc2cad.domain.analysis import Analysis
from pc2cad.mesh.blocks import Block, blocks
from pc2cad.mesh.coarse_cells import large_cells, polytopes
from pc2cad.mesh.elements import HEXAHEDRON
from pc2cad.mesh.grid import Grid, UnsuitableGridError
from pc2cad.mesh.hexahedra import FACE_AT, hexahedra
from pc2cad.mesh.node_merging import joined
from pc2cad.mesh.volume_mesh import Facets, VolumeMesh, by_layer, by_whole_side, pieces_among
from pc2cad.topology.cells import Cell


def o_grid(checked: CheckedMap, grid: Grid, order: Literal[1, 2] = 1) -> VolumeMesh:
    """Return hexahedra of order 1 or 2 for a solid, about as many as a grid has cells.

    Half the cells across a sector of the round direction are the core's. Where no side is
    collapsed, it is the mesh of the grid. Raises UnsuitableGridError where only an edge of a side
    is collapsed.
    """
    large = large_cells(checked.analysis, grid)
    solids = polytopes(checked, large)
    if all(solid.kind is HEXAHEDRON for solid in solids):
        return hexahedra(checked, grid, order)
    lattices, count = _merged([_lattice(block, order) for block in blocks(solids)])
    return _Layout(checked.analysis, grid, large, order, lattices, count).mesh()


@dataclass(frozen=True)
class _Lattice:
    """A block with the numbers of its nodes."""

    block: Block
    nodes: Integers

    def at_end(self, axis: int, end: int) -> tuple[Integers, list[int]]:
        """Return the nodes and the four corners (positions in the block) of a face."""
        corners = np.moveaxis(np.arange(8).reshape(2, 2, 2), axis, 0)[-end]
        return np.moveaxis(self.nodes, axis, 0)[-end], corners.ravel().tolist()


def _lattice(block: Block, order: int) -> _Lattice:
    shape = tuple(order * n + 1 for n in block.counts)
    return _Lattice(block, np.arange(int(np.prod(shape))).reshape(shape))


def _merged(lattices: list[_Lattice]) -> tuple[list[_Lattice], int]:
    """Return the blocks with nodes that shared faces have in common, and how many there are."""
    first = 0
    numbered = []
    for lattice in lattices:
        numbered.append(replace(lattice, nodes=lattice.nodes + first))
        first += lattice.nodes.size
    numbers = {key: k for k, key in enumerate(
        dict.fromkeys(key for lattice in lattices for key in lattice.block.keys)
    )}  # fmt: skip
    shared: dict[tuple[int, ...], list[Integers]] = {}
    for lattice in numbered:
        for axis, end in product(range(3), (0, 1)):
            nodes, corners = lattice.at_end(axis, end)
            ends = np.array([numbers[lattice.block.keys[k]] for k in corners]).reshape(2, 2)
            key = tuple(sorted(ends.ravel().tolist()))
            shared.setdefault(key, []).append(_turned(nodes, ends))
    for faces in shared.values():
        if len(faces) > 2 or len({face.shape for face in faces}) > 1:
            raise UnsuitableGridError(
                "blocks of the O-grid do not meet face to face: a cell of the box that is "
                "collapsed to a pyramid lies on one that is not"
            )
    pairs = [(a.ravel(), b.ravel()) for a, b in (f for f in shared.values() if len(f) == 2)]
    moved, stands = joined(pairs)
    table = np.arange(first)
    table[moved] = stands
    _, numbers_of = np.unique(table, return_inverse=True)
    return (
        [replace(lattice, nodes=numbers_of[lattice.nodes]) for lattice in numbered],
        int(numbers_of.max()) + 1,
    )


def _turned(nodes: Integers, ends: Integers) -> Integers:
    """Return the nodes of a face from its smallest corner on, towards the smaller neighbour."""
    row, column = np.argwhere(ends == ends.min())[0]
    if row:
        nodes, ends = nodes[::-1], ends[::-1]
    if column:
        nodes, ends = nodes[:, ::-1], ends[:, ::-1]
    return nodes.T if ends[1, 0] > ends[0, 1] else nodes


class _Layout:
    """Works out one mesh; lives for one call of `o_grid`."""

    def __init__(
        self,
        analysis: Analysis,
        grid: Grid,
        large: Grid,
        order: int,
        lattices: list[_Lattice],
        count: int,
    ) -> None:
        self._analysis, self._grid, self._large = analysis, grid, large
        self._order, self._lattices, self._count = order, lattices, count

    def mesh(self) -> VolumeMesh:
        places = np.empty((self._count, 3))
        sets: dict[str, list[Integers]] = {}
        sides: dict[str, list[Facets]] = {}
        rows: list[Integers] = []
        layers: list[Integers] = []
        first = 0
        names = {side.patch: side.fate for side in self._analysis.boundary.sides}
        for lattice in self._lattices:
            shares = self._shares(lattice)
            nodes = lattice.nodes.ravel()
            places[nodes] = self._in_box(lattice.block, shares)
            row = _elements(lattice.nodes, self._order)
            for patch, d, end in self._patches(lattice.block):
                on_side = (shares[:, d] == end) | np.isnan(shares[:, d])
                for key in by_whole_side(self._analysis.boundary.key(patch)):
                    sets.setdefault(key, []).append(nodes[on_side])
                    if names[patch] == "face":
                        sides.setdefault(key, []).extend(self._facets(lattice, d, end, first))
            rows.append(row)
            layers.append(np.full(len(row), self._piece(lattice.block, 2)))
            first += len(row)
        block = np.concatenate(rows)
        used, numbers = np.unique(block, return_inverse=True)
        place_of = np.full(self._count, -1)
        place_of[used] = np.arange(len(used))
        node_sets = {
            name: found[found >= 0]
            for name, parts in sets.items()
            for found in (distinct(place_of[np.concatenate(parts)]),)
        }
        equation = self._analysis.equation
        of_layer = by_layer(equation.layers, {HEXAHEDRON.name: np.concatenate(layers)})
        return VolumeMesh(
            equation.name, equation.units, self._order, self._analysis.map.points(*places[used].T),
            {HEXAHEDRON.name: numbers.reshape(block.shape)},
            {name: tuple(parts) for name, parts in sides.items() if parts}, node_sets,
            of_layer, pieces_among(self._analysis.boundary),
        )  # fmt: skip

    def _shares(self, lattice: _Lattice) -> Array:
        """Return the shares of the large cell at the nodes of a block; nan where any will do."""
        steps = [np.linspace(0, 1, n) for n in lattice.nodes.shape]
        places = lattice.block.places
        for axis, t in enumerate(steps):
            places = along(np.stack((1 - t, t), axis=1), places, axis)
        return lattice.block.solid.chart.shares(places.reshape(-1, 3))

    def _in_box(self, block: Block, shares: Array) -> Array:
        """Return local coordinates of the box for shares of a block's large cell."""
        columns = []
        for d, cell in enumerate(block.solid.cell):
            low, high = self._large.lines[d][cell : cell + 2]
            lines = self._grid.lines[d]
            counted = low + (high - low) * np.nan_to_num(shares[:, d], nan=0.5)
            columns.append(np.interp(counted, np.arange(len(lines)), lines))
        return np.stack(columns, axis=1)

    def _piece(self, block: Block, direction: int) -> int:
        """Return the number of the crease piece of a direction that a block lies in."""
        limits = self._large.limits[direction]
        return int(np.searchsorted(limits, block.solid.cell[direction], side="right")) - 1

    def _patches(self, block: Block) -> Iterator[tuple[Cell, int, int]]:
        """Give the patches of the box that a block's large cell lies on, and which end they are."""
        pieces = [2 * self._piece(block, d) + 1 for d in range(3)]
        for d, cell in enumerate(block.solid.cell):
            for end in (0, 1):
                if cell == (0, self._large.cells[d] - 1)[end]:
                    patch = list(pieces)
                    patch[d] = (0, 2 * (len(self._large.limits[d]) - 1))[end]
                    yield (patch[0], patch[1], patch[2]), d, end

    def _facets(self, lattice: _Lattice, d: int, end: int, first: int) -> Iterator[Facets]:
        """Give the faces of a block that lie on one end of a direction of its large cell."""
        block = lattice.block
        shares = block.solid.chart.shares(block.places.reshape(-1, 3))[:, d]
        counts = block.counts
        for axis, upper in product(range(3), (0, 1)):
            corners = shares[lattice.at_end(axis, upper)[1]]
            if not ((corners == end) | np.isnan(corners)).all() or np.isnan(corners).all():
                continue
            numbers = np.arange(int(np.prod(counts))).reshape(counts)
            here = first + np.moveaxis(numbers, axis, 0)[-upper].ravel()
            face = np.full(len(here), FACE_AT[axis][upper], np.int8)
            yield Facets(HEXAHEDRON.name, here, face)


def _elements(nodes: Integers, order: int) -> Integers:
    """Return the elements of a lattice, (n, 8) or (n, 20), in numbers of its nodes."""
    corners = np.array(HEXAHEDRON.corners, dtype=int) * order
    middles = [(corners[a] + corners[b]) // 2 for a, b in HEXAHEDRON.edges] if order == 2 else []
    spans = [n - 1 for n in nodes.shape]
    columns = []
    for place in (*corners, *middles):
        step = tuple(slice(c, n - order + c + 1, order) for c, n in zip(place, spans, strict=True))
        columns.append(nodes[step].ravel())
    return np.stack(columns, axis=1)
