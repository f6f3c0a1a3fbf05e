"""The yes/no questions that the topology room asks about a map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from pc2cad.expression.identity import Verdict
from pc2cad.topology.cells import Cell, Symmetry


class Questions(Protocol):
    """Whoever can answer these about a map of the box can have its boundary derived.

    Every answer is three-valued: proved, refuted, or true wherever it was sampled. An answer that
    is neither clearly yes nor clearly no raises an error instead.
    """

    def ignores(self, patch: Cell, direction: int) -> Verdict:
        """Say whether M is constant along a direction on the whole patch."""
        ...

    def coincide(self, first: Cell, second: Cell, symmetry: Symmetry) -> Verdict:
        """Say whether first(s, t) = second(symmetry(s, t)) for all s, t."""
        ...

    def is_point(self, edge: Cell) -> bool:
        """Say whether the edge collapses to a point."""
        ...

    def same_edge(self, first: Cell, second: Cell, reverse: bool) -> bool:
        """Say whether two edges are one curve, equally (or oppositely) parametrised."""
        ...

    def places(self, corners: Sequence[Cell]) -> list[list[Cell]]:
        """Return corners in groups, each one point, in the order in which they come."""
        ...
