"""Remainders of functions of one parameter, from discs of several radii round each box at once.

Models of a few boxes cost what their calls cost, and hardly more where boxes are some more. So
discs of several radii are taken at once. A cell takes those that leave it least, often the widest
that meet no singularity; its halves, and theirs, lie in the same discs: halving them costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.linear import product
from pc2cad.bounds.cells import Cells, Direction, Groups
from pc2cad.bounds.remainder import DEEPEST, MORE, MOST_BAD, MOST_CELLS, RAISED, Remainders, Vectors
from pc2cad.bounds.taylor_models import UNIT, Place
from pc2cad.bounds.values import ranges

#: order of the models, where the degree of the cells allows it
ORDER = 8
#: radii of discs round a box, as multiples of half its length
RADII = (4.0, 2.6, 1.7)
#: boxes that are not too many to begin with, and those whose models are held at once
FEW, MOST_BOXES = 64, 128
#: lengths of boxes as shares of that over which the function is expected to be analytic
SHARE = 0.1
#: a cell is halved within the discs of a box that is not this many times as long
BESIDE = 2.5


@dataclass(frozen=True, eq=False)
class Discs:
    """Some boxes, and what is known of k vectors on the discs round each; one column per box.

    Or one per cell, with the discs of the box that holds it.
    """

    #: middles of the boxes and half their lengths (n)
    centre: Array
    half: Array
    #: radii of the discs (j, n), and how far vectors are from polynomials on them (k, j, n)
    radius: Array
    deviation: Array
    #: bounds of the vectors' sizes at real places, and of the errors of their values (k, n)
    sizes: Array
    rounding: Array

    def of(self, which: Integers) -> Discs:
        """Return some of the columns."""
        return Discs(*(getattr(self, row.name)[..., which] for row in fields(self)))

    def changed(self, which: Integers, other: Discs) -> Discs:
        """Return the same with other discs in some of the columns."""
        found = []
        for row in fields(self):
            column = getattr(self, row.name).copy()
            column[..., which] = getattr(other, row.name)
            found.append(column)
        result = Discs(*found)
        for known, mine in ((result.sizes, self.sizes), (result.rounding, self.rounding)):
            np.minimum(known, mine, out=known)
        return result


def discs_round(vectors: Vectors, direction: Direction, groups: Groups) -> Discs:
    """Return the discs round groups of cells."""
    if len(groups) > MOST_BOXES:
        starts = range(0, len(groups), MOST_BOXES)
        parts = [discs_round(vectors, direction, groups[i : i + MOST_BOXES]) for i in starts]
        return Discs(*(np.concatenate([getattr(part, row.name) for part in parts], axis=-1)
                       for row in fields(Discs)))  # fmt: skip
    points = direction.cells.points
    low, high = points[groups[:, 0]], points[groups[:, 1]]
    centre, half = (low + high) / 2, (high - low) / 2 * (1 + 1e-12) + 2 * UNIT
    radii = np.array((1.0,) if direction.exact else RADII)[:, None] * half
    shape = radii.shape
    place = Place(np.tile(centre, len(radii)), np.tile(half, len(radii)), radii.ravel())
    order = min(ORDER, direction.boxes.degree)
    models = vectors.models([direction.name], [place], order)
    found = np.empty((3, len(models), len(models[0]), radii.size))
    for k, row in enumerate(models):
        for i, model in enumerate(row):
            columns = found[:, k, i]
            columns[0], columns[1], columns[2] = (
                x[:, 0] for x in (model.radius, model.largest, model.error)
            )
    lengths = np.sqrt((found * found).sum(axis=2)) * (1 + 1e-9)
    deviation, sizes, errors = lengths.reshape(3, -1, *shape)
    # what holds on a disc holds at its real places, which all discs have in common
    return Discs(centre, half, radii, deviation, sizes.min(axis=1), errors.min(axis=1))


def first_discs(vectors: Vectors, direction: Direction, reach: float) -> Discs:
    """Return the discs with which `remainders_along` begins, round boxes of the direction's.

    `reach` says over how many cells the function can be expected to be analytic.
    """
    whole = direction.on(direction.boxes)
    count = whole.cells.count
    size = max(1, int(min(SHARE * reach, count / FEW)))
    # a whole power of 2, so that functions alike get the same boxes
    size = 1 << (size.bit_length() - 1)
    known = vectors.known.discs
    key = vectors.trees, whole.key, whole.exact, whole.breaks, size
    if key not in known:
        groups = whole.groups(np.ones(count, dtype=bool), size)
        known[key] = discs_round(vectors, whole, groups)
    return known[key]


def _weighted(vectors: Vectors, rows: Array) -> Array:
    """Return the sum of what is known of each vector (k, …), times their weights."""
    total = product(np.array([vectors.weights]), rows.reshape(len(rows), -1))
    return total.reshape(rows.shape[1:])


def remainders_along(
    vectors: Vectors, direction: Direction, first: Discs, allowed: float
) -> tuple[Direction, Remainders]:
    """Return cells, and the remainders of the weighted vectors on them.

    Where the first discs leave more than `allowed`, degrees are raised and cells halved, and new
    discs taken round those for which the old ones are much too wide. What remains may be inf.
    """
    line = _Line(vectors, direction, first, allowed)
    most = max(MOST_CELLS[0], MORE * direction.cells.count)
    for depth in range(DEEPEST + 1):
        bad = line.bad
        # what rounding leaves is not mended by smaller cells
        if not bad.any() or depth == DEEPEST or line.direction.cells.count > most:
            break
        line.halve(bad & (line.ratio < BESIDE))
        # no smaller cell is better off in discs that say nothing
        hopeless = ~np.isfinite(line.off) & (line.ratio > 1.5)
        line.renew(line.bad & (hopeless | (line.ratio > BESIDE)))
    return line.direction, line.remainders()


class _Line:
    """Cells of one parameter, and what is known of each."""

    def __init__(
        self, vectors: Vectors, direction: Direction, first: Discs, allowed: float
    ) -> None:
        self.direction, self._vectors, self._allowed = direction, vectors, allowed
        points = direction.cells.points
        middles = (points[:-1] + points[1:]) / 2
        self._discs = first.of(np.searchsorted(first.centre + first.half, middles))
        self.off = np.full(len(middles), 0.0 if direction.exact else np.inf)
        self._by_values = np.full(len(middles), np.inf)
        self._look()

    @property
    def bad(self) -> Booleans:
        """The cells that are off by more than is allowed."""
        return np.asarray(~((self.off <= self._allowed) | (self._by_values <= self._allowed)))

    @property
    def ratio(self) -> Array:
        """How many times as long as each cell its box is."""
        return np.asarray(self._discs.half / self.direction.cells.half)

    def halve(self, which: Booleans) -> None:
        """Halve cells; what holds for a cell holds for its halves, which may be better off."""
        if not which.any():
            return
        self.direction = self.direction.halved(which)
        both = np.repeat(np.arange(len(which)), 1 + which)
        self._discs, self._by_values = self._discs.of(both), self._by_values[both]
        self.off = np.minimum(self.off[both], self._left()(self.direction.cells.degree))

    def renew(self, which: Booleans) -> None:
        """Take discs round cells themselves: all of them, where they are few, serve others too."""
        if not which.any():
            return
        cells = np.arange(len(which)) if len(which) <= FEW else np.flatnonzero(which)
        groups = np.column_stack((cells, cells + 1))
        self._discs = self._discs.changed(cells, discs_round(self._vectors, self.direction, groups))
        self._look()

    def _look(self) -> None:
        """Note what discs leave, in the lowest degree that leaves few cells bad, if any does."""
        if self.direction.exact:
            return
        cells, left = self.direction.cells, self._left()
        lowest, most = np.minimum(self.off, left(cells.degree)), MOST_BAD * cells.count
        for degree in range(cells.degree, cells.degree + RAISED + 1):
            off = lowest if degree == cells.degree else np.minimum(self.off, left(degree))
            if np.count_nonzero(~(off <= self._allowed)) <= most:
                break
        else:
            degree, off = cells.degree, lowest
        self.direction, self.off = self.direction.on(Cells(cells.points, degree)), off
        unknown = ~np.isfinite(self.off) & (self.ratio < BESIDE)
        if unknown.any():
            self._look_at_values(unknown)

    def _left(self) -> Callable[[int], Array]:
        """Return how far interpolation is off on the cells, by its degree."""
        discs, half = self._discs, self.direction.cells.half
        points = self.direction.cells.points
        middle = (points[:-1] + points[1:]) / 2
        room = discs.radius - np.abs(middle - discs.centre) - half - 8 * UNIT
        share = half / (2 * room) * (1 + 1e-12)
        deviation = _weighted(self._vectors, discs.deviation) * (4 * (1 + 1e-12))
        # nothing is known of a cell that its disc has no room for
        deviation = np.where(np.isfinite(deviation) & (room > 0), deviation, np.inf)
        share = np.where(room > 0, share, 1.0)
        return lambda degree: np.asarray((deviation * share ** (degree + 1)).min(axis=0))

    def _look_at_values(self, unknown: Booleans) -> None:
        """Note what ranges of values say of the cells in which no disc says anything."""
        direction, trees = self.direction, self._vectors.trees
        off, sizes = ranges(trees, [direction.name], [direction.cells], unknown[:, None])
        found = _weighted(self._vectors, off[..., 0])
        found = (1 + direction.cells.lebesgue) * found * (1 + 1e-9)
        self._by_values = np.minimum(self._by_values, found)
        sizes = np.minimum(self._discs.sizes, sizes[..., 0])
        self._discs = replace(self._discs, sizes=sizes)

    def remainders(self) -> Remainders:
        """Return what is known."""
        rounding = _weighted(self._vectors, self._discs.rounding) * (1 + 1e-12)
        along = self.off[:, None], np.zeros((len(self.off), 1))
        return Remainders(
            along, rounding[:, None], self._discs.sizes[..., None], self._by_values[:, None]
        )
