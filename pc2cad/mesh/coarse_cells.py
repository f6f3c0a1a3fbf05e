"""Large cells of a box whose sides are collapsed: hexahedra, wedges and tetrahedra.

The box is cut where M has creases, at least in three where it closes, and for every right angle
about an axis or a point. What a collapse of its sides makes of a large cell is a hexahedron, a
wedge, a tetrahedron or a pyramid, which is two tetrahedra: no corner has more than three edges.

A large cell has coordinates of its own (`Chart`), in which it is a polytope with plane sides: the
shares of the box times the distances from the sides that are collapsed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product
from math import pi

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.checked import CheckedMap
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.mesh.cutting import Cuts
from pc2cad.mesh.degenerate_cells import Pattern, Piece, is_flat, pattern_of
from pc2cad.mesh.elements import HEXAHEDRON, PYRAMID, ElementType
from pc2cad.mesh.grid import FEWEST_ROUND, Grid, UnsuitableGridError, closed_directions, joins
from pc2cad.mesh.node_merging import merged_nodes
from pc2cad.topology.cells import directions_of, normal_direction
from pc2cad.topology.complex import SideFate

#: directions from a collapsed side are chords of this share of the way across
_NEAR = 0.02
#: angle at an axis that one block takes best
_BEST = pi / 2
#: an arc of a smaller angle is taken as its chord
_STRAIGHT = 0.01


@dataclass(frozen=True)
class Chart:
    """Coordinates of a large cell: per direction, its share times the distance it depends on."""

    #: the share is counted from the upper end
    upper: tuple[bool, ...]
    #: directions whose collapsed side does not depend on this one
    parents: tuple[tuple[int, ...], ...]
    #: angle of the circle's part along each direction that goes round an axis, else 0
    arcs: tuple[float, float, float]

    def place(self, shares: Array) -> Array:
        """Return coordinates of shares of the directions, (n, 3)."""
        places = np.where(self.upper, 1 - shares, shares)
        for d in self._outer_first():
            places[:, d] *= self._width(places, d)
        return places

    @property
    def ends_on_two(self) -> bool:
        """Whether a direction ends on two collapsed sides that do not depend on one another."""
        return any(
            first not in self.parents[second] and second not in self.parents[first]
            for row in self.parents
            for first, second in combinations(row, 2)
        )

    def _outer_first(self) -> list[int]:
        return sorted(range(3), key=lambda d: len(self.parents[d]))

    def _width(self, places: Array, d: int) -> Array:
        """Return the length of a direction: the distance from the nearest of its collapsed sides.

        Not the product of these distances, which is no plane where two of them meet: there the
        cell is cut in two, along what is equally far from both.
        """
        parents = list(self.parents[d])
        return places[:, parents].min(axis=1) if parents else np.ones(len(places))

    def shares(self, places: Array) -> Array:
        """Return the shares of coordinates (n, 3); nan where a direction has no length."""
        counted = np.empty_like(places)
        for d in self._outer_first():
            width = self._width(places, d)
            with np.errstate(invalid="ignore"):
                counted[:, d] = places[:, d] / np.where(width > 1e-9, width, np.nan)
        for turn, angle in enumerate(self.arcs):
            if angle:
                self._round(counted, turn, angle)
        # a limit is a limit: roots and logarithms may end there
        nearest = np.round(counted)
        counted = np.where(np.abs(counted - nearest) < 1e-12, nearest, counted)
        return np.where(self.upper, 1 - counted, counted)

    def _round(self, counted: Array, turn: int, angle: float) -> None:
        """Make a sector's shares those of a circle near the axis, where it has to be smooth.

        The sector is a triangle of coordinates p, q; near the axis they are taken as oblique ones
        at the circle's angle, and p + q = 1 stays the rim, with even steps along it.
        """
        s = counted[:, turn]
        p, q = 1 - s + s * np.cos(angle), s * np.sin(angle)
        share, excess = np.arctan2(q, p) / angle, np.nan_to_num(np.hypot(p, q) - 1)
        rim = np.ones_like(s)
        for radial in sorted(self.parents[turn], key=lambda d: -len(self.parents[d])):
            square = counted[:, radial] ** 2
            counted[:, radial] *= 1 + np.nan_to_num(rim, nan=1.0) * excess * (1 - square)
            rim = rim * square
        counted[:, turn] = share + np.nan_to_num(rim) * (s - share)


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
    #: in how many ways each direction is collapsed in the large cell
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
    for e in directions_of(side.patch):
        if e != side.along:
            chords = _chords(analysis, side, e, 64)
            lengths = np.sqrt((chords * chords).sum(axis=-1, keepdims=True))
            # another side may be collapsed with this one, and nothing turns along it
            chords = np.divide(chords, lengths, out=np.zeros_like(chords), where=lengths > 0)
            steps = np.sqrt((np.diff(chords, axis=0) ** 2).sum(axis=-1))
            yield e, float((2 * np.arcsin(np.minimum(steps / 2, 1))).sum(axis=0).max())


def _chords(analysis: Analysis, side: SideFate, e: int, steps: int) -> Array:
    """Return chords from a collapsed side inwards, (steps + 1, 5, 3): along e, and across."""
    d = normal_direction(side.patch)
    third = 3 - d - e
    places = [np.empty(0)] * 3
    at = analysis.bounds[d][side.patch[d] // 2]
    places[d] = np.array([at, at + (_NEAR if side.patch[d] == 0 else -_NEAR)])
    for axis, nodes in ((e, np.linspace(0, 1, steps + 1)), (third, np.linspace(0.1, 0.9, 5))):
        low, high = analysis.span(axis, side.patch[axis])
        places[axis] = low + (high - low) * nodes
    points = np.transpose(analysis.map.points(*open_grid(*places)), (d, e, third, 3))
    return np.asarray(points[1] - points[0])


def _arcs(analysis: Analysis, large: Grid) -> tuple[float, float, float]:
    """Return the angle of a sector's circle along u, v and w, where they go round an axis.

    A circle's middle is 1/cos(angle/2) times as far as its chord's; affine images have the same
    ratio, and polygons none. One angle serves all sectors, so that they fit however they are glued.
    """
    found: tuple[list[float], ...] = ([], [], [])
    for side in analysis.boundary.sides:
        if side.fate != "curve" or side.along is None:
            continue
        d = normal_direction(side.patch)
        e = 3 - d - side.along
        piece = side.patch[e] // 2
        sectors = large.limits[e][piece + 1] - large.limits[e][piece]
        chords = _chords(analysis, side, e, 2 * sectors)
        for k in range(sectors):
            for first, middle, last in zip(*chords[2 * k : 2 * k + 3], strict=True):
                a, b = np.linalg.lstsq(np.stack((first, last), axis=1), middle, rcond=None)[0]
                angle = 2 * np.arccos(1 / max(a + b, 1.0))
                found[e].append(float(angle))
    u, v, w = (float(np.mean(angles)) if angles else 0.0 for angles in found)
    return u, v, w


def polytopes(checked: CheckedMap, large: Grid) -> list[Polytope]:
    """Return what the large cells become; raise UnsuitableGridError where none is known."""
    analysis, axes = checked.analysis, checked.orientation.axes
    counts = [len(lines) for lines in large.lines]
    numbers = np.arange(int(np.prod(counts)))
    arcs = _arcs(analysis, large)
    moved, stands = merged_nodes(large, analysis.boundary)
    numbers[moved] = stands
    table = numbers.reshape(counts)
    bits = _box_corners(axes)
    cells = list(product(*(range(n) for n in large.cells)))
    rows = [table[tuple((bits + np.array(cell)).T)].tolist() for cell in cells]
    made = _without_pyramids(rows)
    found = []
    for number, cell in enumerate(cells):
        pattern = pattern_of(rows[number])
        chart = _chart(pattern, axes, arcs)
        places = chart.place(bits.astype(float))
        same = [tuple(np.flatnonzero((places == place).all(axis=1))) for place in places]
        if any(first != group[0] for first, group in zip(pattern, same, strict=True)):
            raise UnsuitableGridError(
                "an O-grid is known where whole sides are collapsed to a curve or a point; "
                f"here an edge of cell {cell} is, and the sides at it are not"
            )
        lengths = [float(large.lines[d][cell[d] + 1] - large.lines[d][cell[d]]) for d in range(3)]
        u, v, w = (len(p) for p in chart.parents)
        if chart.ends_on_two:
            # all edges get the same number there: so many that blocks and grid have as many cells
            lengths, (u, v, w) = [float(np.cbrt(np.prod(lengths)))] * 3, (2, 2, 2)
        for piece in made[number]:
            firsts = [group[0] for group in piece.corners]
            edges = tuple(_along(piece, edge, axes, lengths) for edge in piece.kind.edges)
            found.append(Polytope(
                piece.kind, tuple(rows[number][k] for k in firsts), places[firsts], chart,
                (cell[0], cell[1], cell[2]), edges, (u, v, w),
            ))  # fmt: skip
    return found


def _box_corners(axes: tuple[int, int, int]) -> Integers:
    """Return the corners of a hexahedron as steps along u, v and w, (8, 3)."""
    bits = np.array(HEXAHEDRON.corners)
    return bits[:, [axes.index(d) for d in range(3)]]


def _chart(pattern: Pattern, axes: tuple[int, int, int], arcs: tuple[float, float, float]) -> Chart:
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
    u, v, w = (
        angle if row and angle > _STRAIGHT else 0.0
        for row, angle in zip(parents, arcs, strict=True)
    )
    return Chart(tuple(upper), tuple(map(tuple, parents)), (u, v, w))


def _without_pyramids(rows: list[list[int]]) -> list[tuple[Piece, ...]]:
    """Return the elements of the large cells, pyramids cut in two, and what lies beside them too.

    An apex has four edges, one too many for a hexahedron.
    """
    cells = dict(enumerate(rows))
    for nodes in rows:
        if is_flat(pattern_of(nodes)):
            raise UnsuitableGridError(
                "a large cell of the O-grid has no inside, because sides at it are collapsed"
            )
    cuts = Cuts()
    made = cuts.solve(cells, lambda number: cells)
    while True:
        bases = [
            [rows[number][group[0]] for group in piece.corners[:4]]
            for number, pieces in made.items()
            for piece in pieces
            if piece.kind is PYRAMID
        ]
        if not bases:
            return [made[number] for number in cells]
        for base in bases:
            first = base.index(min(base))
            cuts.diagonals.setdefault(frozenset(base), frozenset((base[first], base[first - 2])))
        made = cuts.solve(cells, lambda number: cells)


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
