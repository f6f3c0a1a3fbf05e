"""Which places lie in several bodies as their Boolean joins them, by their equations inverted.

That a place lies in a body is a place of the equation found there; that it does not is *sampled*:
none was found by descents from many places of the box.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.domain.analysis import Analysis
from pc2cad.sampling.inversion import Inverse
from pc2cad.templates.bodies import Operation, Tree

#: places along each parameter from which a descent may begin, at least
_SEEDS = 12


class Membership:
    """Bodies, and how they are joined."""

    def __init__(self, bodies: Mapping[str, Analysis], tree: Tree) -> None:
        self._inverses = {name: Inverse(body, _SEEDS) for name, body in bodies.items()}
        self._tree = tree
        #: the least distance from a boundary at which inside and outside are told apart
        self.least = 100.0 * max(inverse.tolerance for inverse in self._inverses.values())
        #: how many places were asked
        self.places = 0

    def turns(self, points: Array, normals: Array, step: Array) -> Integers:
        """Say what is on both sides of places (n, 3) of a surface with unit normals (n, 3).

        +1: the solid is behind, within a step (n,), and not before; -1: the other way round; 0: the
        same is on both sides.
        """
        self.places += len(points)
        off = step[:, None] * normals
        behind, before = (self.holds(points + sign * off, 0.5 * step) for sign in (-1.0, 1.0))
        return np.asarray(behind.astype(np.intp) - before.astype(np.intp))

    def holds(self, points: Array, near: Array) -> Booleans:
        """Say which points (n, 3) lie in the solid, or nearer to a body's than `near` (n,)."""
        return self._in(self._tree, points, near)

    def _in(self, tree: Tree, points: Array, near: Array) -> Booleans:
        if isinstance(tree, str):
            return self._inverses[tree].holds(points, near)
        if not isinstance(tree, Operation):
            own = np.concatenate([(points - copy.offset) @ copy.turn for copy in tree.copies])
            found = self._in(tree.operand, own, np.tile(near, len(tree.copies)))
            return np.asarray(found.reshape(len(tree.copies), -1).any(axis=0))
        first, *others = tree.operands
        found = self._in(first, points, near)
        for other in others:
            # of a union those that are in none yet are asked, else those that are left
            rest = np.flatnonzero(~found if tree.kind == "union" else found)
            if len(rest):
                inside = self._in(other, points[rest], near[rest])
                found[rest] = ~inside if tree.kind in ("cut", "difference") else inside
        return found
