"""Blocks for hexahedra where the box is drawn together, derived from its quotient.

The box is cut into a few large cells, each of which a collapse of its sides makes a hexahedron, a
wedge, a tetrahedron or a pyramid (which is two tetrahedra). Their midpoints cut each of these into
one block per corner, with three edges each: four blocks for a tetrahedron, six for a wedge, eight
for a hexahedron. About an axis that is the O-grid, on the boundary as well as inside; no block is
degenerate, because no corner of what is cut has more than three edges.

A large cell has coordinates of its own (`Chart`), in which it is a polytope with plane sides:
the shares of the box times the distances from the sides that are drawn together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import pi

import numpy as np
from numpy.typing import NDArray

from pc2cad.analysis import Analysis
from pc2cad.mapping import open_grid
from pc2cad.mesh.collapse import Pattern, Piece, pieces
from pc2cad.mesh.elements import HEXAHEDRON, PYRAMID, TETRAHEDRON, ElementType
from pc2cad.mesh.gluing import merged_nodes
from pc2cad.mesh.grid import FEWEST_ROUND, Grid, UnsuitableGridError, closed_directions, joins
from pc2cad.topology.cells import directions_of, normal_direction
from pc2cad.topology.complex import SideFate

Array = NDArray[np.float64]
#: directions from a collapsed side are chords of this share of the way across
_NEAR = 0.02
#: angle at an axis that one block takes best
_BEST = pi / 2
#: a corner of a polytope, an edge, a face or a polytope: the numbers of the corners that span it
Key = frozenset[int]


@dataclass(frozen=True)
class Chart:
    """Coordinates of a large cell: per direction, its share times the distances it depends on."""

    #: the share is counted from the upper end
    upper: tuple[bool, ...]
    #: directions whose collapsed side does not depend on this one
    parents: tuple[tuple[int, ...], ...]

    def place(self, shares: Array) -> Array:
        """Return coordinates of shares of the directions, (n, 3)."""
        counted = np.where(self.upper, 1 - shares, shares)
        return np.stack(
            [counted[:, d] * counted[:, list(self.parents[d])].prod(axis=1) for d in range(3)],
            axis=1,
        )

    def shares(self, places: Array) -> Array:
        """Return the shares of coordinates (n, 3); nan where a direction has no length."""
        counted = np.empty_like(places)
        for d in sorted(range(3), key=lambda d: len(self.parents[d])):
            width = counted[:, list(self.parents[d])].prod(axis=1)
            with np.errstate(invalid="ignore"):
                counted[:, d] = places[:, d] / np.where(width > 1e-9, width, np.nan)
        # a limit is a limit: roots and logarithms may end there
        nearest = np.round(counted)
        counted = np.where(np.abs(counted - nearest) < 1e-12, nearest, counted)
        return np.where(self.upper, 1 - counted, counted)


@dataclass(frozen=True)
class Polytope:
    """A hexahedron, wedge or tetrahedron in a large cell."""

    kind: ElementType
    #: numbers of its corners, the same wherever they are one point of the solid
    corners: tuple[int, ...]
    #: coordinates of the corners, (k, 3)
    places: Array
    chart: Chart
    #: the large cell
    cell: tuple[int, int, int]
    #: the direction and the cells of the fine grid along each edge; none along a cut
    edges: tuple[tuple[int, float] | None, ...]
    #: in how many ways each direction is drawn together in the large cell
    ignored: tuple[int, int, int]


def large_cells(analysis: Analysis, grid: Grid) -> Grid:
    """Return the limits of the large cells, counted in cells of a grid.

    About an axis or a point there are as many as its angle has right ones.
    """
    counts = [[1] * (len(bounds) - 1) for bounds in analysis.bounds]
    for side in analysis.boundary.sides:
        for direction, angle in _angles(analysis, side):
            piece = side.patch[direction] // 2
            wanted = int(angle / _BEST + 0.5 + 1e-6)
            counts[direction][piece] = max(counts[direction][piece], wanted)
    for d in range(3):
        collapsed = {
            side.patch[d]
            for side in analysis.boundary.sides
            if normal_direction(side.patch) == d and side.fate in ("curve", "point")
        }
        if len(counts[d]) == 1 and len(collapsed) == 2:
            counts[d][0] = max(counts[d][0], 2)
        if d in closed_directions(analysis):
            fewest = -(-FEWEST_ROUND // len(counts[d]))
            counts[d] = [max(n, fewest) for n in counts[d]]
    for _ in range(sum(map(len, counts))):
        for (d, here), (e, there), _reverse in joins(analysis):
            most = max(counts[d][here // 2], counts[e][there // 2])
            counts[d][here // 2] = counts[e][there // 2] = most
    lines, limits = [], []
    for d in range(3):
        row, marks = [np.zeros(1)], [0]
        for k, count in enumerate(counts[d]):
            low, high = grid.limits[d][k], grid.limits[d][k + 1]
            inner = np.linspace(low, high, count + 1)
            row.append((np.round(inner) if high - low >= count else inner)[1:])
            marks.append(marks[-1] + count)
        lines.append(np.concatenate(row))
        limits.append(tuple(marks))
    return Grid((lines[0], lines[1], lines[2]), tuple(limits))


def _angles(analysis: Analysis, side: SideFate) -> Iterator[tuple[int, float]]:
    """Give the directions that a side does not depend on, and how far the solid turns along."""
    if side.fate not in ("curve", "point"):
        return
    d = normal_direction(side.patch)
    for e in directions_of(side.patch):
        if e == side.along:
            continue
        third = 3 - d - e
        places = [np.empty(0)] * 3
        at = analysis.bounds[d][side.patch[d] // 2]
        inwards = 1 if side.patch[d] == 0 else -1
        places[d] = np.array([at, at + inwards * _NEAR])
        for axis, nodes in ((e, np.linspace(0, 1, 65)), (third, np.linspace(0.1, 0.9, 5))):
            low, high = analysis.span(axis, side.patch[axis])
            places[axis] = low + (high - low) * nodes
        points = np.transpose(analysis.map.points(*open_grid(*places)), (d, e, third, 3))
        chords = points[1] - points[0]
        chords /= np.sqrt((chords * chords).sum(axis=-1, keepdims=True))
        steps = np.sqrt((np.diff(chords, axis=0) ** 2).sum(axis=-1))
        yield e, float((2 * np.arcsin(np.minimum(steps / 2, 1))).sum(axis=0).max())


def polytopes(analysis: Analysis, large: Grid) -> list[Polytope]:
    """Return what the large cells become; raise UnsuitableGridError where none is known."""
    axes = (0, 1, 2) if analysis.orientation > 0 else (1, 0, 2)
    counts = [len(lines) for lines in large.lines]
    numbers = np.arange(int(np.prod(counts)))
    moved, stands = merged_nodes(large, analysis.boundary)
    numbers[moved] = stands
    table = numbers.reshape(counts)
    found = []
    for cell in product(*(range(n) for n in large.cells)):
        bits = _box_corners(axes)
        nodes = table[tuple((bits + np.array(cell)).T)].tolist()
        pattern = tuple(nodes.index(node) for node in nodes)
        chart = _chart(pattern, axes)
        places = chart.place(bits.astype(float))
        same = [tuple(np.flatnonzero((places == place).all(axis=1))) for place in places]
        if any(first != group[0] for first, group in zip(pattern, same, strict=True)):
            raise UnsuitableGridError(
                "an O-grid is known where whole sides are drawn together to a curve or a point; "
                f"here an edge of cell {cell} is, and the sides at it are not"
            )
        lengths = [float(large.lines[d][cell[d] + 1] - large.lines[d][cell[d]]) for d in range(3)]
        ignored = tuple(len(p) for p in chart.parents)
        for piece in _without_pyramids(pattern, nodes):
            firsts = [group[0] for group in piece.corners]
            edges = tuple(_along(piece, edge, axes, lengths) for edge in piece.kind.edges)
            found.append(Polytope(
                piece.kind, tuple(nodes[k] for k in firsts), places[firsts], chart,
                (cell[0], cell[1], cell[2]), edges, (ignored[0], ignored[1], ignored[2]),
            ))  # fmt: skip
    return found


def _box_corners(axes: tuple[int, int, int]) -> NDArray[np.int64]:
    """Return the corners of a hexahedron as steps along u, v and w, (8, 3)."""
    bits = np.array(HEXAHEDRON.corners)
    return bits[:, [axes.index(d) for d in range(3)]]


def _chart(pattern: Pattern, axes: tuple[int, int, int]) -> Chart:
    bits = _box_corners(axes)
    at = {tuple(row): k for k, row in enumerate(bits.tolist())}
    upper, parents = [False] * 3, [list[int]() for _ in range(3)]
    for d, end, e in product(range(3), (0, 1), range(3)):
        if d == e:
            continue
        side = [row for row in bits.tolist() if row[d] == end]
        across = [tuple(1 - x if k == e else x for k, x in enumerate(row)) for row in side]
        if all(pattern[at[tuple(a)]] == pattern[at[b]] for a, b in zip(side, across, strict=True)):
            upper[d] = bool(end)
            parents[e].append(d)
    return Chart(tuple(upper), tuple(map(tuple, parents)))


def _without_pyramids(pattern: Pattern, nodes: list[int]) -> Iterator[Piece]:
    """Give the elements of a cell, pyramids as two tetrahedra.

    An apex has four edges, one too many for a hexahedron. The base is cut from its smallest node,
    so that what lies on the other side of it is cut alike.
    """
    for piece in pieces(pattern):
        if piece.kind is not PYRAMID:
            yield piece
            continue
        *base, apex = piece.corners
        first = min(range(4), key=lambda k: nodes[base[k][0]])
        a, b, c, d = (*base[first:], *base[:first])
        yield Piece(TETRAHEDRON, (a, b, c, apex))
        yield Piece(TETRAHEDRON, (a, c, d, apex))


def _along(
    piece: Piece, edge: tuple[int, int], axes: tuple[int, int, int], lengths: list[float]
) -> tuple[int, float] | None:
    """Return the direction and the length of an edge, None for one that cuts through."""
    bits = _box_corners(axes)
    for i, j in product(piece.corners[edge[0]], piece.corners[edge[1]]):
        (steps,) = np.nonzero(bits[i] != bits[j])
        if len(steps) == 1:
            return int(steps[0]), lengths[int(steps[0])]
    return None


# -- how many cells each edge of a block has -------------------------------------------------------

#: the half of an edge at its first corner
Half = tuple[int, int]


class Counts:
    """Cells along halves of the polytopes' edges: the same where a face has two opposite."""

    def __init__(self, solids: list[Polytope]) -> None:
        self._above: dict[Half, Half] = {}
        self._counts: dict[Half, int] = {}
        coupled: set[Half] = set()
        for solid in solids:
            for face in solid.kind.faces:
                ring = [solid.corners[k] for k in face]
                for k, corner in enumerate(ring):
                    following, after = ring[(k + 1) % len(ring)], ring[(k + 2) % len(ring)]
                    self._join((corner, ring[k - 1]), (following, after))
                    if len(ring) == 3:
                        coupled.add((corner, ring[k - 1]))
                        coupled.add((corner, following))
        self._coupled = {self._top(half) for half in coupled}
        # what is drawn together most often says how wide the core is
        for rank in (2, 1, 0):
            self._choose(solids, rank)

    def __getitem__(self, half: Half) -> int:
        return self._counts.get(self._top(half), 1)

    def plain(self, half: Half) -> bool:
        """Say whether an edge is in no triangle, nor opposite to one that is."""
        back = (half[1], half[0])
        return self._top(half) not in self._coupled and self._top(back) not in self._coupled

    def middle(self, half: Half) -> float:
        """Return where an edge is cut, as a share of its length."""
        if not self.plain(half):
            return 0.5
        here, there = self[half], self[half[1], half[0]]
        return here / (here + there)

    def _top(self, half: Half) -> Half:
        while (above := self._above.get(half, half)) != half:
            half = above
        return half

    def _join(self, a: Half, b: Half) -> None:
        first, second = sorted((self._top(a), self._top(b)))
        if first != second:
            self._above[second] = first

    def _choose(self, solids: list[Polytope], rank: int) -> None:
        wishes: dict[Half, list[float]] = {}
        for solid in solids:
            for (a, b), along in zip(solid.kind.edges, solid.edges, strict=True):
                if along is None or solid.ignored[along[0]] != rank:
                    continue
                here, there = solid.corners[a], solid.corners[b]
                ends = self._top((here, there)), self._top((there, here))
                known = [self._counts.get(end) for end in ends]
                cells = along[1]
                shares = (cells / 2, cells / 2)
                if self.plain((here, there)) and ends[0] != ends[1]:
                    shares = (float(cells // 2), max(1.0, cells - cells // 2))
                for end, own, other, share in zip(ends, known, known[::-1], shares, strict=True):
                    if own is None:
                        wish = share if other is None else max(cells / 2, cells - other)
                        wishes.setdefault(end, []).append(wish)
        for end, wanted in wishes.items():
            self._counts[end] = max(int(end in self._coupled), int(max(wanted) + 0.5))


# -- blocks ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Block:
    """A part of a polytope at one corner; indices are 0 at the corner and 1 at the middles."""

    solid: Polytope
    #: the place of each of its corners, (2, 2, 2, 3), in the polytope's coordinates
    places: Array
    #: what each of its corners is the middle of
    keys: tuple[Key, ...]
    #: cells along its three edges
    counts: tuple[int, int, int]


def blocks(solids: list[Polytope]) -> Iterator[Block]:
    """Give the blocks of polytopes, right-handed in the solid."""
    counts = Counts(solids)
    for number, solid in enumerate(solids):
        for corner, *ends in solid.kind.corner_edges:
            halves = [(solid.corners[corner], solid.corners[end]) for end in ends]
            cells = [counts[half] for half in halves]
            if 0 in cells:
                continue
            keys, places = [], np.empty((2, 2, 2, 3))
            for step in product((0, 1), repeat=3):
                spanned = {corner, *(end for end, up in zip(ends, step, strict=True) if up)}
                weights = _weights(solid, _closure(solid.kind, spanned, sum(step)), counts)
                places[step] = weights @ solid.places
                key = {node for node, w in zip(solid.corners, weights, strict=True) if w}
                # a middle of all corners is in this polytope alone
                keys.append(frozenset(key | ({-1 - number} if weights.all() else set())))
            yield Block(solid, places, tuple(keys), (cells[0], cells[1], cells[2]))


def _closure(kind: ElementType, corners: set[int], dimension: int) -> list[int]:
    """Return the corners of the corner, edge, face or element that some corners span."""
    if dimension < 2:
        return sorted(corners)
    if dimension == 2:
        return list(next(ring for ring in kind.faces if corners <= set(ring)))
    return list(range(len(kind.corners)))


def _weights(solid: Polytope, spanned: list[int], counts: Counts) -> Array:
    """Return the weights of a polytope's corners in the middle of some of them."""
    reference = np.array(solid.kind.corners)[spanned]
    weights = np.zeros(len(solid.corners))
    rows = np.full(len(spanned), 1.0)
    for axis in range(3):
        low, high = reference[:, axis] == 0, reference[:, axis] == 1
        pair = next(
            ((spanned[i], spanned[j]) for i in np.flatnonzero(low) for j in np.flatnonzero(high)
             if ((reference[i] != reference[j]).nonzero()[0] == axis).all()),
            None,
        )  # fmt: skip
        if pair is None or low.sum() != high.sum():
            continue
        share = counts.middle((solid.corners[pair[0]], solid.corners[pair[1]]))
        rows *= np.where(low, 1 - share, share) * 2
    weights[spanned] = rows / rows.sum()
    return weights
