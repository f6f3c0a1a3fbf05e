"""Where the faces of two boundaries meet: proved to be along known curves, and nowhere else.

Pairs of cells of both are halved until each is done: the cells are apart, by more than the faces
may be off their equations', or what meets in them is one known curve (`bounds.one_curve`). Cells
lie apart where their boxes do, or what they reach along one of a few directions: their normals, the
sum and the difference of these, and the line between their middles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.bounds.one_curve import FLAT, Boxes, KnownCurves, crossing_in, follow_one
from pc2cad.bounds.surface_cells import Cells, Region, halved, whole

#: halvings at most, and pairs of cells that are looked at, in all and left of two faces
MOST_LEVELS, MOST_PAIRS, MOST_LEFT = 40, 100_000, 3_000
#: of the two normals and the line between the middles: directions along which cells may be apart
_DIRECTIONS = ((1, 0, 0), (0, 1, 0), (1, 1, 0), (1, -1, 0), (0, 0, 1))
#: places of an edge, at first and at most
LEAST_PLACES, MOST_PLACES = 64, 8192
#: sine of the angle of two faces from which on they cross
TANGENT = 1e-3
#: share of the size, or of the distance from the origin, that rounding may cost a place
ROUNDING = 1e-12

#: curves of two faces, with so many places between the ends of an edge
Known = Callable[[int], KnownCurves]


@dataclass(frozen=True)
class Open:
    """Two faces of which it is not known where they meet."""

    #: their numbers
    faces: tuple[int, int]
    #: a place there
    point: tuple[float, float, float]
    why: str
    #: whether they are proved to cross there, inside both, away from what is known of the two
    missed: bool = False


@dataclass
class Crossings:
    """What is known of where the faces of two boundaries meet."""

    #: None where it is proved
    open: Open | None = None
    #: pairs of cells that were looked at
    pairs: int = 0
    #: how far from a known curve the equations' faces may meet, at most
    within: float = 0.0


@dataclass
class _Search:
    """Pairs of cells that are left, on the way down."""

    faces: Sequence[Region]
    owner: Integers
    known: Mapping[tuple[int, int], Known]
    size: float
    found: Crossings = field(default_factory=Crossings)
    #: curves that have been asked for, and with how many places an edge
    _curves: dict[tuple[int, int], tuple[int, KnownCurves]] = field(default_factory=dict)
    #: what rounding may cost a place
    _noise: float = 0.0

    def run(self) -> Crossings:
        """Return what is known in the end."""
        if not self.faces:
            return self.found
        cells = (whole(self.faces),) * 2
        self._noise = ROUNDING * max(self.size, float(np.abs(cells[0].point).max()))
        first, second = np.nonzero(self.owner[:, None] < self.owner)
        i, k = self._apart(cells, (first, second))
        # faces in one plane are seldom told apart: then no other has to be asked
        flat = (cells[0].error[i] == 0) & (cells[1].error[k] == 0)
        crossed = np.cross(cells[0].normal[i], cells[1].normal[k])
        flat &= np.linalg.norm(crossed, axis=1) <= FLAT
        for some in (flat, ~flat):
            if self.found.open is None:
                self._down(cells, (i[some], k[some]))
        return self.found

    def _down(self, cells: tuple[Cells, Cells], pairs: tuple[Integers, Integers]) -> None:
        """Halve the cells of pairs until none is left, or too many."""
        longest = self.size
        for _ in range(MOST_LEVELS):
            if not len(pairs[0]) or self._spent(cells, pairs):
                return
            longest /= 2
            cells, pairs = self._halved(cells, pairs, longest)
            pairs = self._followed(cells, self._apart(cells, pairs), longest)
        if len(pairs[0]):
            keys = self._keys(cells, pairs)
            self._leave(cells, pairs, np.flatnonzero(keys == keys[0]))

    def _halved(
        self, cells: tuple[Cells, Cells], pairs: tuple[Integers, Integers], longest: float
    ) -> tuple[tuple[Cells, Cells], tuple[Integers, Integers]]:
        """Return shorter cells, and the pairs of them that came of pairs."""
        made, firsts, counts = [], [], []
        for own, index in zip(cells, pairs, strict=True):
            used = np.zeros(len(own), dtype=bool)
            used[index] = True
            shorter, first, count = halved(self.faces, own, used, longest)
            made.append(shorter)
            firsts.append(first[index])
            counts.append(count[index])
        each = counts[0] * counts[1]
        parent = np.repeat(np.arange(len(each)), each)
        place = np.arange(len(parent)) - np.repeat(np.cumsum(each) - each, each)
        i, k = np.divmod(place, counts[1][parent])
        return (made[0], made[1]), (firsts[0][parent] + i, firsts[1][parent] + k)

    def _apart(
        self, cells: tuple[Cells, Cells], pairs: tuple[Integers, Integers]
    ) -> tuple[Integers, Integers]:
        """Return the pairs of cells that are not known to be apart."""
        one, other = cells
        i, k = pairs
        self.found.pairs += len(i)
        slack = self._slack(one.region[i], other.region[k])
        (low, high), (least, most) = one.box, other.box
        gap = np.maximum(low[i] - most[k], least[k] - high[i]).max(axis=1)
        near = ~(gap > slack)
        i, k, slack = i[near], k[near], slack[near]
        off = other.point[k] - one.point[i]
        n, m = one.normal[i], other.normal[k]
        for shares in _DIRECTIONS:
            direction = shares[0] * n + shares[1] * m + shares[2] * off
            length = np.linalg.norm(direction, axis=1)[:, None]
            unit = np.divide(direction, length, out=np.zeros_like(direction), where=length > 0)
            along = np.abs(np.einsum("ki,ki->k", off, unit)) * (1 - 1e-14)
            left = ~(along - one.within(unit, i) - other.within(unit, k) > slack)
            if not left.all():
                i, k, slack, off, n, m = (x[left] for x in (i, k, slack, off, n, m))
        return i, k

    def _slack(self, one: Integers, other: Integers) -> Array:
        """Return by how much faces with these numbers have to be apart."""
        known = np.array([face.deviation for face in self.faces])
        return np.asarray(known[one] + known[other] + self._noise)

    def _followed(
        self, cells: tuple[Cells, Cells], pairs: tuple[Integers, Integers], longest: float
    ) -> tuple[Integers, Integers]:
        """Return the pairs in which more may meet than one known curve."""
        i, k = pairs
        keys = self._keys(cells, pairs)
        left = np.ones(len(i), dtype=bool)
        for key in distinct(keys).tolist():
            faces = divmod(key, len(self.faces))
            if faces not in self.known:
                continue
            (some,) = np.nonzero(keys == key)
            boxes = self._boxes(cells, (i[some], k[some]), faces)
            done, within = follow_one(boxes, self._places(faces, longest))
            left[some] = ~done
            self.found.within = max(self.found.within, within)
        return i[left], k[left]

    def _boxes(
        self,
        cells: tuple[Cells, Cells],
        chosen: tuple[Integers, Integers],
        faces: tuple[int, int],
    ) -> Boxes:
        one, other = (self.faces[k] for k in faces)
        apart = one.deviation + other.deviation + self._noise
        return Boxes((one, other), cells, chosen, apart)

    def _places(self, faces: tuple[int, int], longest: float) -> KnownCurves:
        """Return the curves of two faces with places that follow one another as cells do."""
        count, found = self._curves.get(faces, (0, None))
        while found is None or (found.spacing > longest / 2 and count < MOST_PLACES):
            count = 2 * count or LEAST_PLACES
            found = self.known[faces](count)
        self._curves[faces] = count, found
        return found

    def _keys(self, cells: tuple[Cells, Cells], pairs: tuple[Integers, Integers]) -> Integers:
        one, other = (c.region[index] for c, index in zip(cells, pairs, strict=True))
        return np.asarray(one * len(self.faces) + other)

    def _spent(self, cells: tuple[Cells, Cells], pairs: tuple[Integers, Integers]) -> bool:
        """Say whether there is no more work to be done, and note where pairs are left."""
        keys = self._keys(cells, pairs)
        numbers, counts = np.unique(keys, return_counts=True)
        if counts.max() <= MOST_LEFT and self.found.pairs <= MOST_PAIRS:
            return False
        self._leave(cells, pairs, np.flatnonzero(keys == numbers[counts.argmax()]))
        return True

    def _leave(
        self, cells: tuple[Cells, Cells], pairs: tuple[Integers, Integers], some: Integers
    ) -> None:
        """Note a place of pairs that are left: where the faces are nearest to being parallel."""
        i, k = pairs[0][some], pairs[1][some]
        one, other = cells
        faces = int(one.region[i[0]]), int(other.region[k[0]])
        boxes = self._boxes(cells, (i, k), faces)
        curves = self._curves.get(faces)
        missed = crossing_in(boxes, None if curves is None else curves[1])
        if missed is not None:
            x, y, z = missed.tolist()
            self.found.open = Open(faces, (x, y, z), "are not told apart", missed=True)
            return
        n = int(boxes.along[1].argmin())
        x, y, z = ((one.point[i[n]] + other.point[k[n]]) / 2).tolist()
        flat = boxes.along[1][n] < TANGENT
        why = "touch or coincide, or nearly so" if flat else "are not told apart"
        self.found.open = Open(faces, (x, y, z), why)


def prove_crossings(
    faces: Sequence[Region],
    owner: Integers,
    known: Mapping[tuple[int, int], Known],
    size: float,
) -> Crossings:
    """Ask whether the faces of different boundaries meet along known curves only.

    `owner` (n,) says which boundary each face is of, and `known` gives the curves of faces with
    these numbers, the first of the lower boundary; `size` is that of the part.
    """
    return _Search(faces, owner, known, size).run()
