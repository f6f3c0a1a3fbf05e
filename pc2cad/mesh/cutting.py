"""Cells that are no element as they are: cut from one of their corners, as their neighbours are.

A quadrilateral that is cut has its diagonal in one table for all cells, so that both cells at it
are cut alike. A hexahedron passes a cut on to its opposite face and becomes two wedges; other cells
are cut from a corner on all diagonals that they have. A corner of two edges, where two faces that
collapse to their common edges meet, is where both have to be cut: without it they would be one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from pc2cad.errors import NotASolidError
from pc2cad.mesh.degenerate_cells import Piece, Ring, groups, over, pattern_of, rings, single
from pc2cad.mesh.elements import HEXAHEDRON, WEDGE

#: the nodes of a quadrilateral, or of a diagonal
Nodes = frozenset[int]
_OPPOSITE = {0: 1, 1: 0, 2: 4, 4: 2, 3: 5, 5: 3}


class CellsNotCutAlikeError(NotASolidError):
    """Cells that lose corners need cuts that do not fit one another."""


class Cuts:
    """The quadrilaterals that are cut, over all cells of a grid."""

    def __init__(self) -> None:
        #: nodes of a quadrilateral -> the two that its diagonal joins
        self.diagonals: dict[Nodes, Nodes] = {}

    def pieces(self, nodes: Sequence[int]) -> tuple[Piece, ...]:
        """Return the elements of a cell with eight nodes, some of them equal, not flat.

        Raises CellsNotCutAlikeError where no corner suits the diagonals that it has.
        """
        return _Cell(list(nodes), self.diagonals).pieces()

    def solve(
        self,
        cells: Mapping[int, Sequence[int]],
        beside: Callable[[int], Mapping[int, Sequence[int]]],
    ) -> dict[int, tuple[Piece, ...]]:
        """Return the elements of cells, and of those that their cuts go on to, by number.

        `beside` gives the cells, with their nodes, that may have a face in common with one.
        """
        found: dict[int, tuple[Piece, ...]] = {}
        waiting = dict(cells)
        while waiting:
            number = next(iter(waiting))
            nodes = waiting.pop(number)
            before = len(self.diagonals)
            found[number] = self.pieces(nodes)
            new = set(list(self.diagonals)[before:])
            for other, corners in beside(number).items() if new else ():
                if other != number and not new.isdisjoint(quads(corners)):
                    waiting[other] = corners
        return found


def quads(nodes: Sequence[int]) -> list[Nodes]:
    """Return the faces of a cell that keep four different nodes."""
    faces = (frozenset(nodes[k] for k in face) for face in HEXAHEDRON.faces)
    return [face for face in faces if len(face) == 4]


class _Cell:
    """One cell on its own numbers of corners, 0 to 7, as far as they differ."""

    def __init__(self, nodes: list[int], diagonals: dict[Nodes, Nodes]) -> None:
        self._nodes = nodes
        self._diagonals = diagonals
        self._pattern = pattern_of(nodes)
        self._classes = groups(self._pattern)
        self._rings = rings(self._pattern)

    def pieces(self) -> tuple[Piece, ...]:
        whole = single(self._pattern)
        cut = [ring for ring in self._rings if self._diagonal(ring) is not None]
        if whole is not None and not cut:
            return (whole,)
        if any(len(set(ring)) < len(ring) for ring in self._rings):
            raise CellsNotCutAlikeError(
                "a cell of the grid is folded onto itself; more cells would help"
            )
        return (self._wedges(cut) if whole is not None else ()) or self._fan()

    def _diagonal(self, ring: Ring) -> set[int] | None:
        """Return the two corners that the diagonal of a face joins, None where it is not cut."""
        if len(ring) < 4:
            return None
        ends = self._diagonals.get(frozenset(self._nodes[k] for k in ring))
        return None if ends is None else {k for k in ring if self._nodes[k] in ends}

    def _cut(self, ring: Ring, corner: int) -> None:
        """Cut a face through one of its corners."""
        across = ring[(ring.index(corner) + 2) % 4]
        quad = frozenset(self._nodes[k] for k in ring)
        self._diagonals[quad] = frozenset((self._nodes[corner], self._nodes[across]))

    def _wedges(self, cut: list[Ring]) -> tuple[Piece, ...]:
        """Return the two wedges of a hexahedron that one cut, or two opposite ones, go through."""
        if len(self._rings) != 6 or any(len(ring) < 4 for ring in self._rings):
            return ()
        faces = [self._rings.index(ring) for ring in cut]
        low = self._rings[faces[0]]
        top = self._rings[_OPPOSITE[faces[0]]]
        ends = self._diagonal(low)
        assert ends is not None
        above = {a: next(b for b in top if _neighbours(a, b)) for a in low}
        if len(cut) > 1 and (
            set(faces[1:]) != {_OPPOSITE[faces[0]]}
            or self._diagonal(top) != {above[a] for a in ends}
        ):
            return ()
        self._cut(top, above[min(ends)])
        # a face runs anti-clockwise from outside, the low triangle of a wedge clockwise
        start = low.index(min(ends))
        a, b, c, d = (low[(start + k) % 4] for k in range(4))
        return tuple(
            Piece(WEDGE, tuple((k,) for k in (*corners, *(above[k] for k in corners))))
            for corners in ((a, c, b), (a, d, c))
        )

    def _fan(self) -> tuple[Piece, ...]:
        """Cut from a corner into the pyramids and tetrahedra over the faces that do not hold it."""
        pinched = self._pinched()
        for corner in pinched:
            for ring in self._rings:
                if corner in ring and len(ring) == 4 and self._diagonal(ring) is None:
                    self._cut(ring, corner)
        apex = self._apex(pinched)
        made = []
        for ring in self._rings:
            diagonal = self._diagonal(ring)
            if apex in ring:
                if diagonal is None and len(ring) == 4:
                    self._cut(ring, apex)
                continue
            if diagonal is None:
                made.append(over(ring, apex))
                continue
            start = ring.index(min(diagonal))
            a, b, c, d = (ring[(start + k) % 4] for k in range(4))
            made += [over((a, b, c), apex), over((a, c, d), apex)]
        return tuple(Piece(kind, tuple(self._classes[k] for k in row)) for kind, row in made)

    def _pinched(self) -> list[int]:
        """Return the corners of two edges."""
        ends: dict[int, set[int]] = {}
        for ring in self._rings:
            for k, corner in enumerate(ring):
                ends.setdefault(corner, set()).update((ring[k - 1], ring[(k + 1) % len(ring)]))
        return sorted(corner for corner, others in ends.items() if len(others) == 2)

    def _apex(self, pinched: list[int]) -> int:
        """Return the corner that all cuts at it go through and that needs the fewest new ones."""
        ranked = []
        for corner in self._classes:
            at = [self._diagonal(ring) for ring in self._rings if corner in ring and len(ring) == 4]
            if all(diagonal is None or corner in diagonal for diagonal in at):
                key = (corner not in pinched, at.count(None), -len(self._classes[corner]))
                ranked.append((*key, self._nodes[corner], corner))
        if not ranked:
            raise CellsNotCutAlikeError(
                "cells of the grid that lose corners would have to be cut in ways that do not fit; "
                "more cells would help"
            )
        return min(ranked)[-1]


def _neighbours(a: int, b: int) -> bool:
    return any({a, b} == set(edge) for edge in HEXAHEDRON.edges)
