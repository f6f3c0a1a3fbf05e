"""Blocks of hexahedra: polytopes cut at their middles, and how many cells each edge gets.

A polytope whose corners have three edges each falls into one block per corner: four of a
tetrahedron, six of a wedge, eight of a hexahedron. About an axis that is the O-grid, on the
boundary as well as inside.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from pc2cad.arrays import Array
from pc2cad.mesh.coarse_cells import Polytope
from pc2cad.mesh.elements import ElementType

#: a corner of a polytope, an edge, a face or a polytope: the numbers of the corners that span it
Key = frozenset[int]
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
        # what is collapsed most often says how wide the core is
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
