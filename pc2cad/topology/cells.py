"""The cells of a parameter box and their incidence: pure tables.

A direction with n pieces (n - 1 breaks) has 2n + 1 positions: even ones are limits or breaks, odd
ones the open pieces between them. A cell is one position per direction; its dimension is the
number of odd positions. Without breaks there are 27 cells: 8 corners, 12 edges, 6 sides and the
interior.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import product
from typing import Any, Final, Protocol, TypeVar

#: one position per direction u, v, w
Cell = tuple[int, int, int]
#: printed limits and breaks per direction
Labels = tuple[tuple[str, ...], ...]
DIRECTIONS: Final = (0, 1, 2)
#: tables of the same cells are asked for again and again, of those of some thousand faces, too
_kept = lru_cache(maxsize=1 << 15)
#: directions in which a cell extends, by which of its positions are odd
_EXTENDS: Final = {odd: tuple(d for d in DIRECTIONS if odd[d]) for odd in product((0, 1), repeat=3)}


def dimension(cell: Cell) -> int:
    """Return the number of directions in which the cell extends."""
    return sum(position % 2 for position in cell)


def directions_of(cell: Cell) -> tuple[int, ...]:
    """Return the directions in which the cell extends, ascending."""
    return _EXTENDS[cell[0] % 2, cell[1] % 2, cell[2] % 2]


def neighbour(cell: Cell, direction: int, step: int) -> Cell:
    """Return the cell moved by `step` positions along one direction."""
    moved = list(cell)
    moved[direction] += step
    return moved[0], moved[1], moved[2]


@_kept
def boundary_patches(pieces: tuple[int, int, int]) -> tuple[Cell, ...]:
    """Return the 2-cells on the six sides of a box with this many pieces per direction."""
    ranges = [range(2 * n + 1) for n in pieces]
    cells = [(i, j, k) for i in ranges[0] for j in ranges[1] for k in ranges[2]]

    def bounds(cell: Cell) -> bool:
        return all(p % 2 or p in (0, 2 * n) for p, n in zip(cell, pieces, strict=True))

    return tuple(cell for cell in cells if dimension(cell) == 2 and bounds(cell))


def inner_patches(pieces: tuple[int, int, int]) -> tuple[Cell, ...]:
    """Return the 2-cells inside the box at the breaks of w, in ascending order of w."""
    along_u, along_v = (range(1, 2 * n + 1, 2) for n in pieces[:2])
    return tuple((i, j, k) for k in range(2, 2 * pieces[2], 2) for i in along_u for j in along_v)


@dataclass(frozen=True)
class PatchEdge:
    """One of the four sides of a patch, walked anti-clockwise in its local (s, t)."""

    cell: Cell
    direction: int
    #: False where the walk goes against the direction of the parameter
    forward: bool


@_kept
def patch_edges(patch: Cell) -> tuple[PatchEdge, PatchEdge, PatchEdge, PatchEdge]:
    """Return the edges of a patch in the order t=0, s=1, t=1, s=0 (anti-clockwise).

    (s, t) are the patch's two directions in ascending order.
    """
    s, t = directions_of(patch)
    return (
        PatchEdge(neighbour(patch, t, -1), s, True),
        PatchEdge(neighbour(patch, s, +1), t, True),
        PatchEdge(neighbour(patch, t, +1), s, False),
        PatchEdge(neighbour(patch, s, -1), t, False),
    )


@_kept
def edge_ends(edge: Cell) -> tuple[Cell, Cell]:
    """Return the corner cells at the start and the end of an edge."""
    (d,) = directions_of(edge)
    return neighbour(edge, d, -1), neighbour(edge, d, +1)


@_kept
def normal_direction(patch: Cell) -> int:
    """Return the direction in which a patch does not extend."""
    (d,) = (d for d in DIRECTIONS if patch[d] % 2 == 0)
    return d


@_kept
def outward_sign(patch: Cell) -> int:
    """Return +1 where M_s × M_t points out of a box mapped with det J > 0, else -1.

    (s, t) ascend, so (v,w) and (u,v) are right-handed with u and w, and (u,w) is left-handed.
    """
    d = normal_direction(patch)
    handed = -1 if d == 1 else 1
    return handed if patch[d] > 0 else -handed


@dataclass(frozen=True)
class SideKey:
    """A cell of the boundary as what it is told by: a side, a piece of one, or an edge of sides.

    Faces and edges carry it through the kernel and into files; what is printed is its `label`.
    """

    #: positions per direction; None where the whole direction is covered
    cell: tuple[int | None, int | None, int | None]
    #: what the limits and breaks are called, which tells no cells apart
    labels: Labels = field(compare=False, repr=False)
    #: the body whose side it is, where a part has several
    body: str = ""

    @classmethod
    def of(cls, cell: Cell, labels: Labels, shown: Iterable[int] = DIRECTIONS) -> SideKey:
        """Return the key of a cell, or of all cells that agree with it in the `shown` directions.

        ``labels[d]`` holds the printed limits and breaks of direction d, in ascending order.
        """
        told = set(shown)
        u, v, w = (
            p if d in told and (p % 2 == 0 or len(labels[d]) > 2) else None
            for d, p in enumerate(cell)
        )
        return cls((u, v, w), labels)

    @property
    def is_piece(self) -> bool:
        """Whether it is one of several pieces between breaks."""
        return any(p is not None and p % 2 for p in self.cell)

    @property
    def whole(self) -> SideKey:
        """The whole side that it is a piece of, or itself."""
        u, v, w = (None if p is None or p % 2 else p for p in self.cell)
        return replace(self, cell=(u, v, w))

    @cached_property
    def label(self) -> str:
        """A name such as ``u=0``, ``v=1, w=0`` or, with breaks, ``w=1 (piece 2 of v)``.

        With a body it is ``body:u=0``.
        """
        fixed, piece = [], []
        for name, labels, position in zip("uvw", self.labels, self.cell, strict=True):
            if position is not None and position % 2:
                piece.append(f"piece {position // 2 + 1} of {name}")
            elif position is not None:
                fixed.append(f"{name}={labels[position // 2]}")
        side = ", ".join(fixed) + (f" ({', '.join(piece)})" if piece else "")
        return f"{self.body}:{side}" if self.body else side


@_kept
def side_key(cell: Cell, labels: Labels) -> SideKey:
    """Return what tells a cell from others, whatever it is called."""
    return SideKey.of(cell, labels)


def cell_name(cell: Cell, labels: Labels) -> str:
    """Return the printed name of a cell; see `SideKey.label`."""
    return side_key(cell, labels).label


class _Table(Protocol):
    """An array of two axes or more."""

    def __getitem__(self, key: Any, /) -> Any:
        """Return a part of it."""

    def swapaxes(self, first: int, second: int, /) -> Any:
        """Return it with two axes exchanged."""


Table = TypeVar("Table", bound=_Table)
Corner = TypeVar("Corner")


@dataclass(frozen=True)
class Symmetry:
    """One of the 8 symmetries of the unit square: swap s and t first, then reverse s, t."""

    swap: bool
    reverse_s: bool
    reverse_t: bool

    @property
    def determinant(self) -> int:
        """+1 for a rotation, -1 for a reflection."""
        return -1 if (self.swap + self.reverse_s + self.reverse_t) % 2 else 1

    @property
    def inverse(self) -> Symmetry:
        """The symmetry that undoes this one."""
        if self.swap:
            return Symmetry(True, self.reverse_t, self.reverse_s)
        return self

    def read(self, values: Table) -> Table:
        """Return values on a grid of the square, (m, n, …), as they are met before the symmetry.

        The grid's lines lie alike from both ends.
        """
        met: Table = values[:: -1 if self.reverse_s else 1, :: -1 if self.reverse_t else 1]
        if self.swap:
            met = met.swapaxes(0, 1)
        return met

    def corners(self, values: Sequence[Corner]) -> tuple[Corner, ...]:
        """Return what is at (0, 0), (1, 0), (0, 1) and (1, 1), as it is met before the symmetry."""
        return tuple([values[k] for k in self._met])

    @cached_property
    def _met(self) -> tuple[int, ...]:
        """Which of the four corners is met at each."""
        met = []
        for t, s in product((0, 1), repeat=2):
            i, j = (t, s) if self.swap else (s, t)
            met.append((i ^ self.reverse_s) + 2 * (j ^ self.reverse_t))
        return tuple(met)

    def __str__(self) -> str:
        """Show where (s, t) goes, for example ``(t, 1-s)``."""
        names = ("t", "s") if self.swap else ("s", "t")
        flags = (self.reverse_s, self.reverse_t)
        shown = (f"1-{n}" if r else n for n, r in zip(names, flags, strict=True))
        return f"({', '.join(shown)})"


SYMMETRIES: Final = tuple(Symmetry(*flags) for flags in product((False, True), repeat=3))
IDENTITY: Final = SYMMETRIES[0]
