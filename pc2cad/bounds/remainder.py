"""How far a function can be from its interpolants on cells, from Taylor models on discs.

Here it has two parameters; `discs` is about one.

On a cell of half length h, whose points are the middles of discs of radius r in which F is analytic
and within B of a polynomial of degree m at most, the interpolant at m + 1 Chebyshev-Lobatto nodes
is off by at most 2^(1-m) h^(m+1) B/r^(m+1): the node polynomial is at most 2^(1-m) h^(m+1), and
Cauchy bounds the divided difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import prod

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.bounds.cells import Cells, Direction, Groups
from pc2cad.bounds.known import Known
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import UNIT, Model, Place
from pc2cad.bounds.values import length, ranges
from pc2cad.expression.tree import Expr

#: order of the Taylor models, where the degrees of the cells allow it
ORDER = 6
#: lengths of boxes as shares of that over which the function is expected to be analytic; the disc
#: round a box is four times as wide
SHARE_ALONG = 0.1
SHARE_ACROSS = 0.2
#: cells beyond which no more are halved, in one parameter and in two; and how many times the first
MOST_CELLS, MORE = (8_000, 500_000), 8
#: boxes of two parameters whose models are held at once
MOST_BOXES = 4096
#: cells along each of two parameters in the boxes that are looked at first where cells are many
COARSE = 8
#: halvings of cells
DEEPEST = 16
#: degrees by which all cells may be raised at a time until no more than this share is bad: each
#: leaves a sixth of the error, which is cheaper than halving
RAISED = 4
MOST_BAD = 0.2


@dataclass(frozen=True, eq=False)
class Remainders:
    """Per cell (n, m): the interpolation error that each direction causes, and the rounding."""

    along: tuple[Array, Array]
    #: bound of the error of values sampled in the cell
    rounding: Array
    #: bounds of the vectors' sizes in the cell, (vectors, n, m)
    sizes: Array
    #: another bound of all of that, with the rounding times the Lebesgue constants, from the ranges
    #: of values alone; inf where it was not asked for
    by_values: Array

    @property
    def interpolation(self) -> Array:
        """The whole interpolation error per cell."""
        return (self.along[0] + self.along[1]) * (1 + 1e-12)

    @classmethod
    def unknown(cls, counts: Sequence[int], vectors: int) -> Remainders:
        """Return what is known in the beginning: nothing."""
        shape = (*counts, 1)[:2]
        s, t, rounding = (np.full(shape, np.inf) for _ in range(3))
        return cls((s, t), rounding, np.full((vectors, *shape), np.inf), np.full(shape, np.inf))

    def bad(self, axis: int, allowed: float) -> Booleans:
        """Say in which cells a direction causes a larger error than is allowed."""
        return np.asarray(~((self.along[axis] <= allowed) | (self.by_values <= allowed)))

    def to_split(self, axis: int, allowed: float, blame: bool) -> list[Booleans]:
        """Return the cells of each direction that have to become smaller for one direction's sake.

        With `blame`, a line across, most of which is bad, is taken to be hard in the other
        direction.
        """
        bad = self.bad(axis, allowed)
        lines = bad.mean(axis=axis, keepdims=True) > 0.5
        if not blame or lines.all():
            lines = np.zeros_like(lines)
        masks = [np.asarray((bad & ~lines).any(axis=1 - axis)), lines.ravel()]
        return masks if axis == 0 else masks[::-1]

    def after(self, axis: int, split: Booleans) -> Remainders:
        """Return what is known when some cells of one direction have been halved.

        A disc round a cell is one round its halves, which interpolation is off by less on.
        """
        known = (*self.along, self.rounding, self.by_values)
        s, t, rounding, by_values = (np.repeat(x, 1 + split, axis=axis) for x in known)
        sizes = np.repeat(self.sizes, 1 + split, axis=1 + axis)
        return Remainders((s, t), rounding, sizes, by_values)


@dataclass(frozen=True, eq=False)
class Vectors:
    """Vectors of trees; what is bounded is the sum of their lengths, times a weight each."""

    trees: tuple[tuple[Expr, ...], ...]
    weights: tuple[float, ...]
    #: models that are known already, and those that become so
    known: Known

    def weighted(self, weights: Array) -> Vectors:
        """Return the same with other weights."""
        return replace(self, weights=tuple(weights.tolist()))

    def models(
        self, names: Sequence[str], places: Sequence[Place], order: int
    ) -> list[list[Model]]:
        """Return the models of all trees on boxes; with them come those that are expected."""
        every = [t for row in self.trees for t in row]
        if len(names) == 1:
            every += self.known.expected.get(names[0], {})
        flat = iter(enclose(every, names, places, order, self.known))
        return [[next(flat) for _ in row] for row in self.trees]


def remainders(
    vectors: Vectors,
    directions: Sequence[Direction],
    reach: Sequence[float],
    allowed: float,
) -> tuple[list[Direction], Remainders]:
    """Return cells, and the remainders of the weighted vectors on them.

    Each direction in turn is taken as complex, the other as real, on boxes of several cells:
    `reach` says over how many cells the function can be expected to be analytic. Where that gives
    more than `allowed`, boxes are made smaller, degrees raised, and cells halved, `DEEPEST` times
    at most. What then remains may be inf.
    """
    directions = list(directions)
    rest = Remainders.unknown([d.cells.count for d in directions], len(vectors.trees))
    axes = [axis for axis, d in enumerate(directions) if not d.exact]
    for axis in range(2):
        if axis not in axes:
            rest.along[axis][...] = 0.0
    everywhere = np.ones(rest.rounding.shape, dtype=bool)
    if not axes:
        _evaluate(vectors, directions, 0, _boxes(everywhere, directions, (1, 1)), rest, everywhere)
    part = allowed / max(1, len(axes))
    if len(axes) == 2 and rest.rounding.size > 4 * MOST_BOXES:
        # beside a narrow feature cells are smaller than they need be
        boxes = _boxes(everywhere, directions, (COARSE, COARSE))
        for axis in axes:
            _evaluate(vectors, directions, axis, boxes, rest, everywhere)
    most = max(MOST_CELLS[len(axes) > 1], MORE * rest.rounding.size)
    for depth in range(DEEPEST + 1):
        hard = False
        if rest.rounding.size > most:
            break  # what rounding leaves is not mended by smaller cells
        for axis in axes:
            bad = rest.bad(axis, part)
            if not bad.any():
                continue
            rest, harder = _refine(vectors, directions, axis, bad, rest, part, reach, depth)
            hard = hard or harder
            if depth == DEEPEST:
                break
        if not hard:
            break
    return directions, rest


def _refine(
    vectors: Vectors,
    directions: list[Direction],
    axis: int,
    bad: Booleans,
    rest: Remainders,
    part: float,
    reach: Sequence[float],
    depth: int,
) -> tuple[Remainders, bool]:
    """Evaluate bad cells along one axis, and halve those that stay bad on the smallest boxes.

    `directions` change in place. Return what is known, and whether any cell is still bad.
    """
    share = [SHARE_ALONG if d == axis else SHARE_ACROSS for d in range(2)]
    counts = [
        _cells_per_box(part_of * r / 4**depth) for part_of, r in zip(share, reach, strict=True)
    ]
    boxes = _boxes(bad, directions, counts)
    before = directions[0].cells.lebesgue
    directions[axis] = _evaluate(vectors, directions, axis, boxes, rest, bad, part)
    rest.along[1][...] *= directions[0].cells.lebesgue / before
    if max(counts) == 1:
        _look_at_values(vectors, directions, axis, rest)
    split = rest.to_split(axis, part, depth % 2 == 0)
    hard = any(mask.any() for mask in split)
    if depth == DEEPEST:
        return rest, hard
    for d, mask in enumerate(split):
        # smaller boxes come first
        mask[:] &= counts[d] == 1
    for d, mask in enumerate(split):
        if mask.any():
            directions[d] = directions[d].halved(mask)
            rest = rest.after(d, mask)
    return rest, hard


def _look_at_values(
    vectors: Vectors, directions: Sequence[Direction], axis: int, rest: Remainders
) -> None:
    """Note what ranges of values say of the cells in which no disc says anything."""
    unknown = ~np.isfinite(rest.along[axis])
    if not unknown.any():
        return
    cells = [d.cells for d in directions]
    off, sizes = ranges(vectors.trees, [d.name for d in directions], cells, unknown)
    lebesgue = prod(row.lebesgue for row in cells)
    found = (1 + lebesgue) * np.tensordot(vectors.weights, off, 1) * (1 + 1e-9)
    np.minimum(rest.by_values, found, out=rest.by_values)
    np.minimum(rest.sizes, sizes, out=rest.sizes)


def _cells_per_box(most: float) -> int:
    """Return a whole power of 2, so that functions alike get the same boxes."""
    return 1 << (int(max(most, 1.0)).bit_length() - 1)


def _boxes(
    wanted: Booleans, directions: Sequence[Direction], size: Sequence[int]
) -> tuple[Groups, Groups]:
    """Return groups of the wanted rows and columns."""
    return (
        directions[0].groups(np.asarray(wanted.any(axis=1)), size[0]),
        directions[1].groups(np.asarray(wanted.any(axis=0)), size[1]),
    )


def _evaluate(
    vectors: Vectors,
    directions: Sequence[Direction],
    axis: int,
    groups: tuple[Groups, Groups],
    found: Remainders,
    wanted: Booleans,
    goal: float = np.inf,
) -> Direction:
    """Evaluate the product of two lists of groups, complex along one axis; note what got better.

    Where there are many boxes, those without a `wanted` cell are left out. Return the direction of
    that axis, its degree raised if that leaves less than the goal.
    """
    places = [_place(d, g, i == axis) for i, (d, g) in enumerate(zip(directions, groups,
              strict=True))]  # fmt: skip
    order = min([ORDER, *(d.cells.degree for d in directions if not d.exact)])
    names = [d.name for d in directions]
    sizes, distance, rounding = _measured(vectors, names, places, order, _any(wanted, groups))
    # boxes that hold each cell
    row, column = (np.repeat(np.arange(len(g)), g[:, 1] - g[:, 0]) for g in groups)
    box = np.ix_(row, column)
    cells = np.ix_(*(np.concatenate([np.arange(a, b) for a, b in g]) for g in groups))
    # an error along the second direction passes through the interpolation along the first
    disc = distance[box] * (directions[0].cells.lebesgue if axis else 1.0)
    direction, known_here = directions[axis], found.along[axis][cells]
    gap = np.zeros_like(disc)
    if not direction.exact:
        left = _left_per_degree(direction, groups[axis], places[axis])
        left = left[:, None] if axis == 0 else left
        most = MOST_BAD * found.rounding.size
        most -= _bad(found.along[axis], goal) - _bad(known_here, goal)
        direction = _raised(direction, known_here, disc, left, goal, most)
        gap = _interpolated(disc, left, direction.cells.degree)
    found.along[axis][cells] = np.minimum(known_here, gap)
    found.rounding[cells] = np.minimum(found.rounding[cells], rounding[box])
    for known, size in zip(found.sizes, sizes, strict=True):
        known[cells] = np.minimum(known[cells], size[box])
    return direction


def _measured(
    vectors: Vectors, names: Sequence[str], places: Sequence[Place], order: int, wanted: Booleans
) -> tuple[Array, Array, Array]:
    """Return the sizes of the vectors (k, n, m) on boxes, weighted radii and errors (n, m).

    Many boxes are taken in blocks: models of all at once do not fit into a processor's own memory,
    nor those of a hundred thousand into the machine's.
    """
    shape = len(places[0].centre), len(places[1].centre)
    if shape[0] > 1 and shape[0] * shape[1] > MOST_BOXES:
        step = max(1, MOST_BOXES // shape[1])
        found = np.full((len(vectors.trees) + 2, *shape), np.inf)
        for start in range(0, shape[0], step):
            rows = slice(start, min(start + step, shape[0]))
            chosen = np.flatnonzero(wanted[rows].any(axis=0))
            part = [places[0].part(rows), places[1].part(chosen)]
            sizes, *rest = _measured(vectors, names, part, order, wanted[rows][:, chosen])
            found[:, rows, chosen] = np.concatenate((sizes, rest))
        return found[:-2], found[-2], found[-1]
    models = vectors.models(names, places, order)
    found = np.stack([
        np.broadcast_to(length([m.largest for m in row]), shape) for row in models
    ])  # fmt: skip
    radius, error = np.zeros(shape), np.zeros(shape)
    for weight, coordinates in zip(vectors.weights, models, strict=True):
        radius += weight * length([m.radius for m in coordinates])
        error += weight * length([m.error for m in coordinates])
    return found, radius, error


def _any(wanted: Booleans, groups: tuple[Groups, Groups]) -> Booleans:
    """Say which boxes (n, m) hold a wanted cell."""
    rows = np.stack([wanted[a:b].any(axis=0) for a, b in groups[0]])
    return np.stack([rows[:, a:b].any(axis=1) for a, b in groups[1]], axis=1)


def _bad(off: Array, goal: float) -> int:
    return int(np.count_nonzero(~(off <= goal)))


def _raised(
    direction: Direction, before: Array, disc: Array, left: Array, goal: float, most: float
) -> Direction:
    """Return the direction in the lowest degree that leaves so many cells above the goal at most.

    Where none does, its own degree. What was known `before` holds for higher degrees as well.
    """
    cells = direction.cells
    for degree in range(cells.degree, cells.degree + RAISED + 1):
        if _bad(np.minimum(before, _interpolated(disc, left, degree)), goal) <= most:
            return direction.on(Cells(cells.points, degree))
    return direction


def _interpolated(disc: Array, left: Array, degree: int) -> Array:
    """Return how far interpolation is off, cell by cell, from what is so on discs."""
    return np.where(np.isfinite(disc), 4 * disc * left ** (degree + 1), np.inf)


def _place(direction: Direction, groups: Groups, wide: bool) -> Place:
    points = direction.cells.points
    low, high = points[groups[:, 0]], points[groups[:, 1]]
    centre = (low + high) / 2
    half = (high - low) / 2 * (1 + 1e-12) + 2 * UNIT
    if direction.exact or not wide:
        return Place(centre, half, half)
    lengths = direction.cells.half
    longest = np.array([lengths[a:b].max() for a, b in groups])
    return Place(centre, half, half + 3 * np.maximum(half, longest))


def _left_per_degree(direction: Direction, groups: Groups, place: Place) -> Array:
    """Return, cell by cell, what each degree of interpolation leaves of a deviation on the disc."""
    cells = np.concatenate([np.arange(a, b) for a, b in groups])
    box = np.repeat(np.arange(len(groups)), groups[:, 1] - groups[:, 0])
    points, half = direction.cells.points, direction.cells.half[cells]
    middle = (points[cells] + points[cells + 1]) / 2
    room = place.radius[box] - np.abs(middle - place.centre[box]) - half - 8 * UNIT
    return np.asarray(half / (2 * room) * (1 + 1e-12))
