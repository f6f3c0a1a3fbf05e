"""One spline space per direction, shared by all faces and edges that vary along it.

Directions whose edges are glued to one another take the same space; a gluing that reverses a
direction makes its knots symmetric.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pc2cad.domain.analysis import Analysis
from pc2cad.domain.periods import is_periodic
from pc2cad.domain.restrictions import Piece
from pc2cad.expression.breaks import Break
from pc2cad.topology.cells import Cell, directions_of

# `face_mesh` asks for classes alone
if TYPE_CHECKING:
    from pc2cad.geometry.splines.adaptive_knots import DirectionRules


class DirectionClasses:
    """Which direction pieces share one space, and the rules that space has to respect."""

    def __init__(self, analysis: Analysis, degrees: Sequence[int]) -> None:
        self._analysis = analysis
        self._degrees = degrees
        self._owner: dict[Piece, Piece] = {}
        self._symmetric: set[Piece] = set()
        self._rules: dict[Piece, DirectionRules] = {}
        self._breaks: dict[Piece, list[Break]] = {}
        for edge in analysis.complex.edges:
            first, *others = edge.members
            for member in others:
                self._join(_piece(first.cell), _piece(member.cell), member.reverse != first.reverse)

    def owner(self, piece: Piece) -> Piece:
        """Return the piece that stands for the class of this one."""
        while self._owner.get(piece, piece) != piece:
            piece = self._owner[piece]
        return piece

    def _join(self, a: Piece, b: Piece, reverse: bool) -> None:
        first, second = self.owner(a), self.owner(b)
        if first != second:
            self._owner[second] = first
        if reverse or first in self._symmetric or second in self._symmetric:
            # a symmetric space serves both directions of travel
            self._symmetric |= {first, second}

    def rules(self, piece: Piece) -> DirectionRules:
        """Return the rules of the class that a piece belongs to."""
        owner = self.owner(piece)
        if owner not in self._rules:
            self._rules[owner] = self._rules_of(owner)
        return self._rules[owner]

    def _rules_of(self, owner: Piece) -> DirectionRules:
        from pc2cad.geometry.splines.adaptive_knots import DirectionRules

        members = [p for p in self._pieces() if self.owner(p) == owner]
        breaks: dict[float, Break] = {}
        symmetric = owner in self._symmetric
        for member in members:
            for b in self.breaks(member):
                places = (b.position, 1 - b.position) if symmetric else (b.position,)
                for place in places:
                    breaks[place] = Break(place, b.smoothness)
        periodic = all(is_periodic(self._analysis, d) for d, _ in members)
        return DirectionRules(
            self._degrees, tuple(breaks[p] for p in sorted(breaks)), periodic, symmetric
        )

    def _pieces(self) -> list[Piece]:
        bounds = self._analysis.bounds
        return [(d, p) for d in range(3) for p in range(1, 2 * len(bounds[d]) - 1, 2)]

    def breaks(self, piece: Piece) -> list[Break]:
        """Return the breaks of a piece in its own coordinates, its ends included."""
        if piece not in self._breaks:
            low, high = self._analysis.span(*piece)
            self._breaks[piece] = [
                Break((b.position - low) / (high - low), b.smoothness)
                for b in self._analysis.breaks[piece[0]]
                if low <= b.position <= high
            ]
        return self._breaks[piece]


def _piece(edge: Cell) -> Piece:
    (d,) = directions_of(edge)
    return d, edge[d]
