"""Boxes of two faces' parameters in which nothing meets but along a curve that is known by places.

With F and G the two surfaces, z their four parameters, d a unit vector and

    H(z) = (F - G, d·F),

let Y be the inverse of H' in the middle of a box, and |1 - Y H'| ≤ κ < 1 all over the hull of the
box and of some places z_j of the curve (in the norm of the largest coordinate, each by the hull's
width). As the hull is convex, H(z) - H(z') = J (z - z') with such a J between any two places of it:
for each x = d·F there is one place at most in which F = G, and two with |F - G| ≤ e, at x and x',
have

    z - z' = (1 - Y J + …)(Y (e - e', x - x')),     off (x - x') v by κ/(1-κ) of it, v = Y (0, 1).

So what meets in the box lies between two successive z_j, in the double cones of both, or beyond the
last of either end. Beyond it does not lie, if it leaves the box there, or the face's own rectangle,
by a coordinate that is sure to go on rising or falling; or if it leaves the face across pieces of
its border that all have the cone on their outer side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.bounds.surface_cells import Cells, Region

#: what |1 - Y H'| may be, sine of the angle of two faces that are not looked at any more, and how
#: many of its half widths a box may be from the nearest place of a curve
CONTRACTS, FLAT, NEAREST = 0.5, 1e-6, 4.0
#: sine of the angle from which on faces cross, half widths from known curves that a place has to be
#: away from these, steps of Newton's method (each halves what is left), and what the last may be
CROSSING, AWAY, NEWTON, ENOUGH = 1e-3, 8.0, 40, 1e-6
#: steps along a curve that lead out of a box, at most, and how far out, in half widths
STEPS, BEYOND = 48, 1.02


@dataclass(frozen=True, eq=False)
class KnownCurve:
    """A curve on two faces, as places (n, 4) in both's parameters that follow one another."""

    places: Array
    closed: bool


@dataclass(frozen=True, eq=False)
class KnownCurves:
    """All known curves of two faces."""

    curves: Sequence[KnownCurve]
    #: by how much the two faces are apart at their places, and their ends short of the faces'
    apart: float
    short: float
    #: what lies between two places that follow one another, at most
    spacing: float = 0.0

    @cached_property
    def places(self) -> Array:
        """All places, (n, 4)."""
        return np.concatenate([curve.places for curve in self.curves])

    @cached_property
    def _ranges(self) -> tuple[Integers, Integers, Booleans]:
        """Of each place its curve's first one and their number, and whether it is closed."""
        counts = np.array([len(curve.places) for curve in self.curves])
        first = np.cumsum(counts) - counts
        closed = np.array([curve.closed for curve in self.curves])
        return np.repeat(first, counts), np.repeat(counts, counts), np.repeat(closed, counts)

    def next(self, at: Integers, step: Integers) -> tuple[Integers, Booleans]:
        """Return the places after (or before) others, and which there are."""
        ranges = self._ranges
        first, count, closed = ranges[0][at], ranges[1][at], ranges[2][at]
        place = at - first + step
        there = closed | ((place >= 0) & (place < count))
        return first + np.mod(place, count), there

    def nearest(self, middle: Array, half: Array) -> tuple[Integers, Array]:
        """Return a place near each box, and how many half widths it is from its middle."""
        scale = np.median(half, axis=0)
        index = cKDTree(self.places / scale).query(middle / scale, p=np.inf)[1]
        return index, (np.abs(self.places[index] - middle) / half).max(axis=1)


@dataclass(frozen=True, eq=False)
class Boxes:
    """Pairs of cells of two faces, m of them."""

    faces: tuple[Region, Region]
    cells: tuple[Cells, Cells]
    #: which cell of either
    chosen: tuple[Integers, Integers]
    #: by how much the faces may be apart in a place in which their equations' are not
    apart: float

    def take(self, some: Integers) -> Boxes:
        """Return some of them."""
        i, k = self.chosen
        return Boxes(self.faces, self.cells, (i[some], k[some]), self.apart)

    def joined(self, name: str) -> Array:
        """Return what cells hold, first those of the first face."""
        one, other = (
            getattr(cells, name)[index]
            for cells, index in zip(self.cells, self.chosen, strict=True)
        )
        return np.concatenate((one, other), axis=1)

    @cached_property
    def corners(self) -> tuple[Array, Array]:
        """Corners of the boxes, (m, 4) each."""
        return self.joined("low"), self.joined("high")

    @cached_property
    def middle(self) -> Array:
        """Their middles, (m, 4)."""
        return np.asarray((self.corners[0] + self.corners[1]) / 2)

    @cached_property
    def half(self) -> Array:
        """Half their widths, (m, 4)."""
        return np.asarray((self.corners[1] - self.corners[0]) / 2)

    @cached_property
    def slopes(self) -> Array:
        """Derivatives of both surfaces in the middle, (m, 4, 3)."""
        return self.joined("slopes")

    @cached_property
    def along(self) -> tuple[Array, Array]:
        """Unit vectors along both tangent planes, and the sines of the angles between these."""
        n, m = (c.normal[i] for c, i in zip(self.cells, self.chosen, strict=True))
        crossed = np.cross(n, m)
        sine = np.linalg.norm(crossed, axis=1)
        return crossed / np.where(sine > 0, sine, 1.0)[:, None], np.asarray(sine)

    @cached_property
    def inverse(self) -> Array:
        """Y, (m, 4, 4), of the parameters in half widths; not to be asked where faces are flat."""
        matrix = np.empty((len(self.middle), 4, 4))
        matrix[:, :3] = np.swapaxes(self.slopes, 1, 2)
        matrix[:, :3, 2:] *= -1
        matrix[:, 3, :2] = np.einsum("mdi,mi->md", self.slopes[:, :2], self.along[0])
        matrix[:, 3, 2:] = 0.0
        return np.asarray(np.linalg.inv(matrix * self.half[:, None]))

    def contraction(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Return κ over hulls with these corners (m, 4), and the hulls' extents, in half widths."""
        extent = np.maximum(high - self.middle, self.middle - low)
        turned = np.concatenate([
            _turned(face, low[:, part], high[:, part], extent[:, part])
            for face, part in zip(self.faces, (slice(0, 2), slice(2, 4)), strict=True)
        ], axis=1)  # fmt: skip
        y, extent = self.inverse, extent / self.half
        rows = y[:, :, :3] + y[:, :, 3:] * self.along[0][:, None]
        by = np.stack([np.linalg.norm(r, axis=2) for r in (rows, y[:, :, :3])])
        moved = turned * self.half * extent
        one, other = moved[:, :2].sum(axis=1), moved[:, 2:].sum(axis=1)
        total = by[0] * one[:, None] + by[1] * other[:, None]
        return (total / extent).max(axis=1), extent


def _turned(face: Region, low: Array, high: Array, extent: Array) -> Array:
    """Return how far both derivatives may be from those in the middle, (m, 2)."""
    low, high = np.maximum(low, face.box[0]), np.minimum(high, face.box[1])
    aa, ab, bb = face.bends(low, high).T
    a, b = extent.T
    return np.stack((aa * a + ab * b, ab * a + bb * b), axis=1) + face.jump_over(low, high)


def follow_one(boxes: Boxes, known: KnownCurves) -> tuple[Booleans, float]:
    """Say in which boxes nothing meets but along known curves, and how far from these at most.

    That distance is in space, along the surface of either face.
    """
    whole, done = boxes, np.zeros(len(boxes.middle), dtype=bool)
    some = np.flatnonzero(boxes.along[1] > FLAT)
    boxes = boxes.take(some)
    some = some[boxes.contraction(*boxes.corners)[0] < CONTRACTS] if len(some) else some
    if not len(some):
        return done, 0.0
    boxes = whole.take(some)
    near, far = known.nearest(boxes.middle, boxes.half)
    (close,) = np.nonzero(far <= NEAREST)
    if not len(close):
        return done, 0.0
    found, within = _Runs(boxes.take(close), known, near[close]).proved()
    done[some[close]] = found
    return done, within


def crossing_in(boxes: Boxes, known: KnownCurves | None) -> Array | None:
    """Return a point (3,) where two faces cross, proved, inside both and away from known curves.

    Where H' turns by less than 1/2 all over a box, and Newton's method ends in it, a zero is within
    twice its last step of there. None where no such box is found.
    """
    some = np.flatnonzero(boxes.along[1] > CROSSING)
    boxes = boxes.take(some)
    if not len(some):
        return None
    fine = boxes.contraction(*boxes.corners)[0] < CONTRACTS
    if known is not None:
        at, far = known.nearest(boxes.middle, boxes.half)
        for way in (1, -1):
            after, _ = known.next(at, np.full_like(at, way))
            far -= 2 * (np.abs(known.places[after] - known.places[at]) / boxes.half).max(axis=1)
        fine &= far > AWAY
    for face, part in zip(boxes.faces, (slice(0, 2), slice(2, 4)), strict=True):
        low, high = (corner[:, part] for corner in boxes.corners)
        fine[fine] &= face.border.inside(low[fine], high[fine])
    if not fine.any():
        return None
    boxes = boxes.take(np.flatnonzero(fine))
    place, step = boxes.middle, np.full(len(boxes.middle), np.inf)
    one, other = boxes.faces
    point = np.zeros((len(place), 3))
    for _ in range(NEWTON):
        point = one.surface.jet(place[:, 0], place[:, 1])[0]
        off = point - other.surface.jet(place[:, 2], place[:, 3])[0]
        move = np.einsum("mij,mj->mi", boxes.inverse[:, :, :3], off)
        step = np.abs(move).max(axis=1)
        place = np.clip(place - move * boxes.half, *boxes.corners)
    inside = (np.abs(place - boxes.middle) / boxes.half).max(axis=1) + 2 * step + ENOUGH < 1
    found = np.flatnonzero(inside & (step < ENOUGH))
    return np.asarray(point[found[0]]) if len(found) else None


class _Runs:
    """Successive places of known curves that lead through boxes, from one side to the other."""

    def __init__(self, boxes: Boxes, known: KnownCurves, near: Integers) -> None:
        self.boxes, self.known = boxes, known
        #: in the half widths of a box
        self.v = boxes.inverse[:, :, 3]
        rows = np.arange(len(near))
        self.axis = np.abs(self.v).argmax(axis=1)
        self.sign = np.sign(self.v[rows, self.axis])
        self.low, self.high = (corner.copy() for corner in boxes.corners)
        after, there = known.next(near, np.ones_like(near))
        before, too = known.next(near, -np.ones_like(near))
        after, before = np.where(there, after, near), np.where(too, before, near)
        ahead = known.places[after] - known.places[before]
        #: whether a curve runs along d, or against it
        self.sense = np.where(ahead[rows, self.axis] * self.sign >= 0, 1, -1)
        self.ends = [self._walk(near, sense) for sense in (1, -1)]

    def _level(self, at: Integers) -> Array:
        """Return how far along the axis places are beyond the middle, in half widths."""
        rows = np.arange(len(at))
        off = (self.known.places[at] - self.boxes.middle)[rows, self.axis]
        return np.asarray(self.sign * off / self.boxes.half[rows, self.axis])

    def _walk(self, start: Integers, sense: int) -> tuple[Integers, Booleans]:
        """Return the first places beyond the boxes, or the last, and which are a curve's last."""
        at, last = start.copy(), np.zeros(len(start), dtype=bool)
        going = np.ones(len(start), dtype=bool)
        for _ in range(STEPS):
            (now,) = np.nonzero(going)
            if not len(now):
                break
            place = self.known.places[at[now]]
            self.low[now] = np.minimum(self.low[now], place)
            self.high[now] = np.maximum(self.high[now], place)
            going &= sense * self._level(at) < BEYOND
            after, there = self.known.next(at, sense * self.sense)
            last |= going & ~there
            going &= there
            at = np.where(going, after, at)
        place = self.known.places[at]
        self.low, self.high = np.minimum(self.low, place), np.maximum(self.high, place)
        return at, last

    def proved(self) -> tuple[Booleans, float]:
        """Say which boxes hold nothing else, and how far off known curves that may be at most."""
        boxes, known = self.boxes, self.known
        kappa, extent = boxes.contraction(self.low, self.high)
        fine = kappa < CONTRACTS
        share = np.where(fine, kappa, 0.0) / (1 - np.where(fine, kappa, 0.0))
        apart = boxes.apart + known.apart
        moved = np.linalg.norm(boxes.inverse[:, :, :3], axis=2) * apart
        #: what places at one x may differ by, and how far v may be off, in half widths
        slack = extent * ((moved / extent).max(axis=1) * (1 + share))[:, None]
        unsure = extent * (share * (np.abs(self.v) / extent).max(axis=1))[:, None]
        for (at, last), sense in zip(self.ends, (1, -1), strict=True):
            fine &= self._leaves(at, last, sense, slack, unsure)
        lengths = np.linalg.norm(boxes.slopes, axis=2) * boxes.half
        off = (slack * lengths)[fine]
        sums = np.maximum(off[:, 0] + off[:, 1], off[:, 2] + off[:, 3])
        return fine, float(sums.max(initial=0.0)) * (1 + CONTRACTS)

    def _leaves(
        self, at: Integers, last: Booleans, sense: int, slack: Array, unsure: Array
    ) -> Booleans:
        """Say where nothing that goes on from a place is in the box, and on both faces."""
        rows, boxes = np.arange(len(at)), self.boxes
        sure = np.abs(self.v) > unsure
        beyond = sense * self._level(at) >= 1 + slack[rows, self.axis]
        found: Booleans = np.asarray(beyond & sure[rows, self.axis])
        (ending,) = np.nonzero(last & ~found)
        if not len(ending):
            return found
        place, way = self.known.places[at[ending]], sense * self.v[ending]
        # the face's own rectangle ends there
        low, high = (
            np.concatenate([face.box[k] for face in boxes.faces]) for k in (0, 1)
        )  # fmt: skip
        lengths = np.linalg.norm(boxes.slopes[ending], axis=2)
        short = self.known.short / np.where(lengths > 0, lengths, np.inf)
        out = ((way > 0) & (place >= high - short)) | ((way < 0) & (place <= low + short))
        found[ending] = (out & sure[ending]).any(axis=1)
        for face, part in zip(boxes.faces, (slice(0, 2), slice(2, 4)), strict=True):
            left = ending[~found[ending]]
            if face.trimmed and len(left):
                scale = boxes.half[left, part]
                way = sense * self.v[left, part] * scale
                error = unsure[left, part] * scale
                hull = self.low[left, part], self.high[left, part]
                at_end = self.known.places[at[left], part]
                lengths = np.linalg.norm(boxes.slopes[left, part], axis=2)
                reach = self.known.short / np.where(lengths > 0, lengths, np.inf)
                found[left] = _across(face, at_end, hull, way, error, reach)
        return found


def _across(
    face: Region, place: Array, hull: tuple[Array, Array], way: Array, error: Array, reach: Array
) -> Booleans:
    """Say where all ways (k, 2), off by `error`, lead out of a face from places of its border."""
    border = face.border
    near = border.fine.holds(place, reach)
    there = border.touching(hull[0] - reach, hull[1] + reach)
    chord = border.ends - border.starts
    crossed = chord[None, :, 0] * way[:, None, 1] - chord[None, :, 1] * way[:, None, 0]
    # a tangent is within four bows of its chord
    longest = np.linalg.norm(np.abs(way) + error, axis=1)[:, None]
    off = (np.abs(chord[None]) * error[:, None, ::-1]).sum(axis=2) + 4 * border.bows * longest
    return np.asarray(near & (~there | (crossed + off < 0)).all(axis=1))
