"""Which nodes of a parameter grid are one: read from the boundary complex, by index.

No distance is measured: what collapses, coincides or is glued was decided (proved or sampled) by
the analysis, and a grid whose lines are shared accordingly turns that into pairs of indices.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pc2cad.arrays import Integers
from pc2cad.mesh.grid import Grid
from pc2cad.topology.cells import Cell, normal_direction
from pc2cad.topology.complex import BoundaryComplex, SideFate

#: elements whose nodes are numbered at once: the arrays stay in the cache
_CHUNK = 1 << 16


def cell_nodes(grid: Grid, cell: Cell) -> Integers:
    """Return the flat indices of the nodes of a cell of the box, one axis per direction of it."""
    counts = [len(lines) for lines in grid.lines]
    spans = [np.arange(s.start, s.stop) for s in (grid.span(d, cell[d]) for d in range(3))]
    u, v, w = np.ix_(*spans)
    index = (u * counts[1] + v) * counts[2] + w
    return np.asarray(index[tuple(slice(None) if p % 2 else 0 for p in cell)], dtype=np.int64)


def merged_nodes(grid: Grid, boundary: BoundaryComplex) -> tuple[Integers, Integers]:
    """Return the indices that stand for another one, ascending, and what each stands for.

    The representative of a set of equal nodes is the smallest index of it.
    """
    pairs: list[tuple[Integers, Integers]] = []

    def join(first: Integers, second: Integers) -> None:
        a, b = np.broadcast_arrays(first, second)
        differ = a != b
        if differ.any():
            pairs.append((a[differ], b[differ]))

    for side in boundary.sides:
        nodes = cell_nodes(grid, side.patch)
        if side.fate == "point":
            join(nodes, nodes[:1, :1])
        elif side.fate == "curve":
            along_first = side.along == min(d for d in range(3) if side.patch[d] % 2)
            join(nodes, nodes[:, :1] if along_first else nodes[:1])
        elif side.fate == "interface":
            join(nodes, partner_nodes(grid, side))
    for edge in boundary.edges:
        first = cell_nodes(grid, edge.members[0].cell)
        for member in edge.members[1:]:
            other = cell_nodes(grid, member.cell)
            join(first, other[::-1] if member.reverse != edge.members[0].reverse else other)
    for face in boundary.faces:
        for use in face.uses:
            if use.edge is None:
                nodes = cell_nodes(grid, use.cell)
                join(nodes, nodes[:1])
    for vertex in boundary.vertices:
        corners = [cell_nodes(grid, corner).reshape(1) for corner in vertex.corners]
        join(np.concatenate(corners), corners[0])
    return joined(pairs)


def partner_nodes(grid: Grid, side: SideFate) -> Integers:
    """Return the nodes of the side that a side is glued to, in the order of its own."""
    assert side.partner is not None
    assert side.symmetry is not None
    return side.symmetry.read(cell_nodes(grid, side.partner))


def side_cells(grid: Grid, patch: Cell) -> Integers:
    """Return the numbers of the cells on a patch of the box, one axis per direction of it."""
    d = normal_direction(patch)
    spans = []
    for k in range(3):
        span = grid.span(k, patch[k])
        edge = [grid.cells[k] - 1 if patch[d] > 0 else 0]
        spans.append(np.array(edge) if k == d else np.arange(span.start, span.stop - 1))
    u, v, w = np.ix_(*spans)
    _, nv, nw = grid.cells
    return np.asarray(np.squeeze((u * nv + v) * nw + w, axis=d), dtype=np.int64)


def glued_cells(grid: Grid, boundary: BoundaryComplex) -> dict[int, list[int]]:
    """Return the cells that lie on the other side of a gluing from each cell there."""
    found: dict[int, list[int]] = {}
    for side in boundary.sides:
        if side.fate == "interface" and side.partner is not None and side.symmetry is not None:
            here = side_cells(grid, side.patch)
            there = side.symmetry.read(side_cells(grid, side.partner))
            for a, b in zip(here.ravel().tolist(), there.ravel().tolist(), strict=True):
                found.setdefault(a, []).append(b)
                found.setdefault(b, []).append(a)
    return found


def joined(pairs: list[tuple[Integers, Integers]]) -> tuple[Integers, Integers]:
    """Return, of numbers that are one in pairs, those that stand for another, and for which."""
    if not pairs:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    first, second = (np.concatenate([p[k] for p in pairs]) for k in range(2))
    nodes, inverse = np.unique(np.concatenate((first, second)), return_inverse=True)
    a, b = inverse[: len(first)], inverse[len(first) :]
    graph = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(len(nodes),) * 2)
    _, labels = connected_components(graph, directed=False)
    # nodes ascend, so the first of each component is its smallest
    _, start = np.unique(labels, return_index=True)
    representative = nodes[start][labels]
    moved = representative != nodes
    return nodes[moved], representative[moved]


def replaced(indices: Integers, moved: Integers, stands: Integers) -> Integers:
    """Return indices with those moved (ascending) replaced by what they stand for."""
    place = np.minimum(np.searchsorted(moved, indices), len(moved) - 1)
    return np.where(moved[place] == indices, stands[place], indices)


def whole(parts: list[Integers]) -> Integers:
    """Return arrays as one; a single one is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def chunks(blocks: dict[str, Integers]) -> Iterator[Integers]:
    """Give the rows of all tables, as many at once as stay in the cache."""
    for block in blocks.values():
        for start in range(0, len(block), _CHUNK):
            yield block[start : start + _CHUNK]
