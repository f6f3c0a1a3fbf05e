"""The boundary complex: faces, edges, vertices and shells of the solid, as plain data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from pc2cad.expression.identity import Verdict
from pc2cad.topology.cells import Cell, Labels, SideKey, Symmetry, side_key

Fate = Literal["face", "curve", "point", "interface"]


@dataclass(frozen=True)
class SideFate:
    """What became of one side (or, with breaks, one patch of a side) of the box."""

    patch: Cell
    fate: Fate
    verdict: Verdict
    #: for a curve: the direction along which it runs
    along: int | None = None
    #: for an interface: the patch it is glued to, and how (s, t) go over
    partner: Cell | None = None
    symmetry: Symmetry | None = None


@dataclass(frozen=True)
class VertexClass:
    """Corners of the box that are one point."""

    corners: tuple[Cell, ...]


@dataclass(frozen=True)
class EdgeMember:
    """One edge of the box in a class; reversed against the class's own direction or not."""

    cell: Cell
    reverse: bool


@dataclass(frozen=True)
class EdgeClass:
    """Edges of the box that are one curve, from the vertex `start` to the vertex `end`."""

    members: tuple[EdgeMember, ...]
    start: int
    end: int

    @property
    def cell(self) -> Cell:
        """The representative, whose parameter the class takes."""
        return self.members[0].cell


@dataclass(frozen=True)
class EdgeUse:
    """One of the four sides of a face, in anti-clockwise order in its (s, t)."""

    cell: Cell
    #: None where the side collapses to `vertex`
    edge: int | None
    #: True where the anti-clockwise walk goes along the class's direction
    forward: bool
    #: the vertex where the walk along this side begins
    vertex: int


@dataclass(frozen=True)
class FaceCell:
    """A patch that bounds the solid."""

    patch: Cell
    uses: tuple[EdgeUse, EdgeUse, EdgeUse, EdgeUse]


@dataclass(frozen=True)
class Shell:
    """A closed, connected set of faces and its Euler number V - E + F."""

    faces: tuple[int, ...]
    euler: int

    @property
    def genus(self) -> int:
        """Number of handles."""
        return (2 - self.euler) // 2


@dataclass(frozen=True)
class BoundaryComplex:
    """The derived boundary of a map of the box; every index points into the tuples here."""

    labels: Labels
    sides: tuple[SideFate, ...]
    vertices: tuple[VertexClass, ...]
    edges: tuple[EdgeClass, ...]
    faces: tuple[FaceCell, ...]
    shells: tuple[Shell, ...]
    #: the shells of each layer, where the box is cut along w: the faces between two layers belong
    #: to both, and come after those of the outer boundary
    layers: tuple[tuple[Shell, ...], ...] = ()

    def name(self, cell: Cell) -> str:
        """Return the printed name of a cell."""
        return self.key(cell).label

    def key(self, cell: Cell) -> SideKey:
        """Return what tells a cell from others, whatever it is called."""
        return side_key(cell, self.labels)

    def faces_beside(self, patch: Cell, directions: Iterable[int]) -> int:
        """Return how many faces have the positions of a patch in some directions."""
        along = tuple(sorted(directions))
        if along not in self._positions:
            rows = (tuple([face.patch[d] for d in along]) for face in self.faces)
            self._positions[along] = Counter(rows)
        return self._positions[along][tuple([patch[d] for d in along])]

    @cached_property
    def _positions(self) -> dict[tuple[int, ...], Counter[tuple[int, ...]]]:
        """Faces by their positions in the directions that were asked for."""
        return {}

    @property
    def euler(self) -> int:
        """Euler number of the whole boundary."""
        return sum(shell.euler for shell in self.shells)

    @property
    def enclosed(self) -> tuple[int, ...]:
        """The faces between two layers, which are no part of the outer boundary."""
        outer = {face for shell in self.shells for face in shell.faces}
        return tuple(i for i in range(len(self.faces)) if i not in outer)

    def edge_uses(self) -> dict[int, list[tuple[int, EdgeUse]]]:
        """Return, per edge class, the (face, use) pairs that use it."""
        return self._edge_uses

    @cached_property
    def _edge_uses(self) -> dict[int, list[tuple[int, EdgeUse]]]:
        uses: dict[int, list[tuple[int, EdgeUse]]] = {i: [] for i in range(len(self.edges))}
        for index, face in enumerate(self.faces):
            for use in face.uses:
                if use.edge is not None:
                    uses[use.edge].append((index, use))
        return uses
