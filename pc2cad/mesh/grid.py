"""The parameter grid of a structured mesh: where the lines of u, v and w lie.

Breaks of the equation become grid lines, and directions that a gluing of sides joins get the same
lines (mirrored ones where it reverses), so that nodes can be identified by their index.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from pc2cad.arrays import Array
from pc2cad.checked import CheckedMap
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.errors import InputError
from pc2cad.topology.cells import Cell, directions_of

#: a direction (0, 1, 2) and the position of one of its pieces (odd)
Piece = tuple[int, int]

#: fewest cells between two sides that are collapsed along the same direction
FEWEST_BETWEEN = 2
#: fewest cells round a closed direction: with fewer, two elements share two faces
FEWEST_ROUND = 3
#: and as many are chosen at least where nobody said otherwise
GOOD_ROUND = 12
MOST_CELLS = 400_000_000
_SAME = 1e-12


class UnsuitableGridError(InputError):
    """The cells asked for do not fit the solid's breaks, gluings or closed directions."""


@dataclass(frozen=True)
class Grading:
    """How cell lengths change along a direction: at its end over at its start, or middle over ends.

    They change steadily and however many cells there are: n cells have ratio^((n - 1)/n), last over
    first.
    """

    ratio: float = 1.0
    #: True: the cells grow towards the middle and shrink again
    both_ends: bool = False

    def __post_init__(self) -> None:
        if not 1e-6 <= self.ratio <= 1e6:
            raise InputError(f"cells grow by a ratio between 1e-6 and 1e6, not {self.ratio}")

    def position(self, share: Array) -> Array:
        """Return the parameter at a share of the cells."""
        if self.both_ends:
            half = self._one(1 - np.abs(2 * share - 1)) / 2
            return np.where(share <= 0.5, half, 1 - half)
        return self._one(share)

    def share(self, position: Array) -> Array:
        """Return the share of the cells below a parameter: the inverse of `position`."""
        if self.both_ends:
            half = self._inverse(1 - np.abs(2 * position - 1)) / 2
            return np.where(position <= 0.5, half, 1 - half)
        return self._inverse(position)

    def _one(self, s: Array) -> Array:
        growth = np.log(self.ratio)
        return s if growth == 0 else np.asarray(np.expm1(growth * s) / (self.ratio - 1))

    def _inverse(self, t: Array) -> Array:
        growth = np.log(self.ratio)
        return t if growth == 0 else np.asarray(np.log1p(t * (self.ratio - 1)) / growth)


#: length of cells at the end over that at the start, or with "both" in the middle over both ends
Growth = float | tuple[float, Literal["both"]]


def gradings(wanted: Mapping[str, Growth]) -> tuple[Grading, Grading, Grading]:
    """Return the grading along u, v and w: ``{"w": 4}`` or ``{"w": (4, "both")}``.

    Raises InputError for another direction, or a ratio that is none.
    """
    found = {name: Grading() for name in "uvw"}
    for name, growth in wanted.items():
        match growth:
            case int() | float() as ratio if name in found:
                found[name] = Grading(ratio)
            case (int() | float() as ratio, "both") if name in found:
                found[name] = Grading(ratio, True)
            case _:
                raise InputError(
                    f"grading {name!r}: {growth!r}: write u, v or w and a ratio, last cell over "
                    "first ('w': 4), or middle over both ends ('w': (4, 'both'))"
                )
    u, v, w = found.values()
    return u, v, w


@dataclass(frozen=True)
class Grid:
    """Grid lines per direction in local coordinates, and which of them limit crease pieces."""

    lines: tuple[Array, Array, Array]
    #: index of the line at each even position of a direction: 0, creases, last
    limits: tuple[tuple[int, ...], ...]

    @property
    def cells(self) -> tuple[int, int, int]:
        """Number of cells per direction."""
        u, v, w = (len(lines) - 1 for lines in self.lines)
        return u, v, w

    def span(self, direction: int, position: int) -> range:
        """Return the indices of the lines of a cell position, both ends included."""
        limits = self.limits[direction]
        return range(limits[position // 2], limits[(position + 1) // 2] + 1)

    def halved(self) -> Grid:
        """Return the grid with a line in the middle of every cell."""
        lines = []
        for line in self.lines:
            fine = np.empty(2 * len(line) - 1)
            fine[::2] = line
            fine[1::2] = (line[1:] + line[:-1]) / 2
            lines.append(fine)
        limits = tuple(tuple(2 * i for i in row) for row in self.limits)
        return Grid((lines[0], lines[1], lines[2]), limits)


def make_grid(
    checked: CheckedMap,
    cells: tuple[int, int, int] | None = None,
    size: float | None = None,
    grading: tuple[Grading, Grading, Grading] = (Grading(), Grading(), Grading()),
) -> Grid:
    """Return a grid of `cells` per direction, or of cells at most about `size` long.

    With neither, the size is a tenth of the cube root of the volume that the samples span. Where a
    direction has breaks, each piece takes its share of the cells, at least one, and their number
    is what comes out. Raises UnsuitableGridError.
    """
    analysis = checked.analysis
    wanted = _wanted(analysis, cells, size)
    classes = _Classes(analysis)
    lines: list[Array] = []
    limits: list[tuple[int, ...]] = []
    closed = closed_directions(analysis)
    for d in range(3):
        row, marks = [np.zeros(1)], [0]
        pieces = list(classes.pieces(d))
        # shares of few cells are rounded, and what closes has enough of them all the same
        between = sum(len(breaks) + 1 for *_, breaks in pieces)
        least = -(-FEWEST_ROUND // between) if d in closed else 1
        for low, high, breaks in pieces:
            inside = _piece_lines(low, high, breaks, wanted[d], least, grading[d])
            row.append(inside[1:])
            marks.append(marks[-1] + len(inside) - 1)
        lines.append(np.concatenate(row))
        limits.append(tuple(marks))
    grid = Grid((lines[0], lines[1], lines[2]), tuple(limits))
    return classes.shared(grid)


def _wanted(
    analysis: Analysis, cells: tuple[int, int, int] | None, size: float | None
) -> tuple[int, int, int]:
    closed, tapered = closed_directions(analysis), _tapered_directions(analysis)
    reasons = {
        FEWEST_ROUND: ", because the solid closes in that direction",
        FEWEST_BETWEEN: ", because sides at both its ends are collapsed",
        1: "",
    }
    fewest = [FEWEST_ROUND if d in closed else FEWEST_BETWEEN if d in tapered else 1
              for d in range(3)]  # fmt: skip
    if cells is not None:
        for name, count, least in zip("uvw", cells, fewest, strict=True):
            if count < least:
                raise UnsuitableGridError(
                    f"{count} cell{'' if count == 1 else 's'} along {name}: at least {least} are "
                    f"needed{reasons[least]}"
                )
        counts = list(cells)
    else:
        lengths = _lengths(analysis)
        step = _default_size(analysis) if size is None else size
        with np.errstate(over="ignore"):
            counts = [int(min(np.ceil(length / step - 1e-9), 1e9)) for length in lengths]
        if size is None:
            fewest = [GOOD_ROUND if d in closed else n for d, n in enumerate(fewest)]
        counts = [max(pair) for pair in zip(counts, fewest, strict=True)]
        counts = _joined(analysis, counts)
    if np.prod(counts, dtype=float) > MOST_CELLS:
        raise UnsuitableGridError(
            f"{' x '.join(map(str, counts))} cells are more than {MOST_CELLS:.0e}; make them larger"
        )
    return counts[0], counts[1], counts[2]


def closed_directions(analysis: Analysis) -> set[int]:
    """Return the directions in which the solid closes: their two limits are glued."""
    return {
        d
        for side in analysis.boundary.sides
        if side.partner is not None
        for d in range(3)
        if side.patch[d] % 2 == 0 and side.partner[d] % 2 == 0 and side.patch[d] != side.partner[d]
    }


def _tapered_directions(analysis: Analysis) -> set[int]:
    """Return the directions of one piece both ends of which are collapsed along another one.

    A single cell between them would have no inside.
    """
    lost: dict[tuple[int, int], set[tuple[int, int]]] = {}
    for side in analysis.boundary.sides:
        if side.fate in ("curve", "point"):
            (d,) = (d for d in range(3) if side.patch[d] % 2 == 0)
            for e in set(directions_of(side.patch)) - {side.along}:
                lost.setdefault((d, side.patch[d]), set()).add((e, side.patch[e]))
    return {
        d for d in range(3)
        if len(analysis.bounds[d]) == 2 and lost.get((d, 0), set()) & lost.get((d, 2), set())
    }  # fmt: skip


def _joined(analysis: Analysis, counts: list[int]) -> list[int]:
    """Give directions that a gluing exchanges the larger count of both."""
    for side in analysis.boundary.sides:
        if side.symmetry is not None and side.symmetry.swap and side.partner is not None:
            joined = {*directions_of(side.patch), *directions_of(side.partner)}
            most = max(counts[d] for d in joined)
            counts = [most if d in joined else n for d, n in enumerate(counts)]
    return counts


def _lengths(analysis: Analysis) -> list[float]:
    """Return the length of the longest of some parameter lines per direction."""
    across = np.linspace(0, 1, 7)
    lengths = []
    for d in range(3):
        grid = [across] * 3
        grid[d] = np.linspace(0, 1, 401)
        points = np.moveaxis(analysis.map.points(*open_grid(*grid)), d, 0)
        steps = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=-1))
        lengths.append(float(steps.sum(axis=0).max()))
    return lengths


def _default_size(analysis: Analysis) -> float:
    """Return a tenth of the cube root of the volume (by a coarse rule)."""
    x, weight = np.polynomial.legendre.leggauss(12)
    nodes, weight = (x + 1) / 2, weight / 2
    a, b, c = analysis.map.tangents((0, 1, 2), *open_grid(nodes, nodes, nodes))
    determinant = np.abs((np.cross(a, b) * c).sum(axis=-1))
    volume = np.einsum("ijk,i,j,k", determinant, weight, weight, weight)
    return float(np.cbrt(volume)) / 10


def _piece_lines(
    low: float, high: float, breaks: Array, count: int, least: int, grading: Grading
) -> Array:
    """Return the lines of one crease piece of a direction, the smoother breaks among them.

    `count` is the number of cells of the direction, `least` that between two breaks.
    """
    ends = np.concatenate(([low], breaks, [high]))
    shares = grading.share(ends)
    row = [ends[:1]]
    for (a, b), (sa, sb) in zip(pairwise(ends), pairwise(shares), strict=True):
        # the small shift rounds equal pieces alike
        inside = max(least, round(count * float(sb - sa) - 1e-9))
        places = grading.position(np.linspace(sa, sb, inside + 1))
        places[0], places[-1] = a, b
        row.append(places[1:])
    return np.concatenate(row)


def joins(analysis: Analysis) -> list[tuple[Piece, Piece, bool]]:
    """Return the pieces of directions that gluings join, and whether one runs in reverse."""
    found: list[tuple[Piece, Piece, bool]] = []

    def join(a: Cell, b: Cell, axis: int, other: int, reverse: bool) -> None:
        d, e = directions_of(a)[axis], directions_of(b)[other]
        pair = ((d, a[d]), (e, b[e]), reverse)
        if pair[0] != pair[1] or reverse:
            found.append(pair)

    for edge in analysis.boundary.edges:
        first, *others = edge.members
        for member in others:
            join(first.cell, member.cell, 0, 0, member.reverse != first.reverse)
    for side in analysis.boundary.sides:
        if side.partner is None or side.symmetry is None:
            continue
        flags = (side.symmetry.reverse_s, side.symmetry.reverse_t)
        for axis in range(2):
            other = 1 - axis if side.symmetry.swap else axis
            join(side.patch, side.partner, axis, other, flags[other])
    return found


class _Classes:
    """Pieces of directions that the gluings join: they have to have the same lines."""

    def __init__(self, analysis: Analysis) -> None:
        self._analysis = analysis
        self._joins = joins(analysis)

    def pieces(self, direction: int) -> list[tuple[float, float, Array]]:
        """Return the limits of each crease piece and the smoother breaks that it has to have."""
        found = []
        bounds = self._analysis.bounds[direction]
        for k, (low, high) in enumerate(pairwise(bounds)):
            places = self._breaks((direction, 2 * k + 1))
            found.append((low, high, low + (high - low) * places))
        return found

    def _breaks(self, piece: Piece) -> Array:
        """Return the inner breaks of a piece and of all that is joined to it, on [0, 1]."""
        reached: set[tuple[Piece, bool]] = {(piece, False)}
        stack = list(reached)
        while stack:
            here, turned = stack.pop()
            for a, b, reverse in self._joins:
                for x, y in ((a, b), (b, a)):
                    step = (y, turned != reverse)
                    if x == here and step not in reached:
                        reached.add(step)
                        stack.append(step)
        places: list[float] = []
        for other, turned in sorted(reached):
            low, high = self._analysis.span(*other)
            for kink in self._analysis.breaks[other[0]]:
                at = (kink.position - low) / (high - low)
                at = 1 - at if turned else at
                if _SAME < at < 1 - _SAME and all(abs(at - p) > _SAME for p in places):
                    places.append(at)
        return np.array(sorted(places))

    def shared(self, grid: Grid) -> Grid:
        """Check that joined pieces have the same lines (reversed ones mirrored)."""
        local: Callable[[Piece], Array] = lambda piece: _normalised(grid, piece)  # noqa: E731
        for a, b, reverse in self._joins:
            first, second = local(a), local(b)
            second = 1 - second[::-1] if reverse else second
            if len(first) != len(second) or np.abs(first - second).max() > 1e-9:
                names = sorted({"uvw"[a[0]], "uvw"[b[0]]})
                what = " and ".join(names)
                raise UnsuitableGridError(
                    f"{what}: sides are glued so that these grid lines meet"
                    f"{' in reverse' if reverse else ''}; give them the same number of cells"
                    + (" and a grading that is the same from both ends" if reverse else "")
                )
        return grid


def _normalised(grid: Grid, piece: Piece) -> Array:
    span = grid.span(*piece)
    lines = grid.lines[piece[0]][span.start : span.stop]
    return np.asarray((lines - lines[0]) / (lines[-1] - lines[0]))
