"""What holds the patches of a spline, and their tangents, before any patch is made.

In its own coordinates from 0 to 1 a patch F is within (|F_ss| + |F_tt|)/8 of the bilinear patch of
its corners, and its tangents along s are within (|F_ss| + |F_st|)/2 of one of the two chords
along s: second derivatives at their largest, which no pole of theirs exceeds. Of k × k pieces of it
these are a k²-th. Of a fit with many spans they are small, and the corners are one point per span;
patches that turn far are held in pieces, which have fewer corners than they have control points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce
from math import comb

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.linear import lengths, unit
from pc2cad.geometry.sheets import Patches
from pc2cad.solidity.embedding.separation import in_directions
from pc2cad.solidity.embedding.windows import Cones, joint, radii_round

#: most pieces along each parameter, and how far the tangents of one may turn (radians, about)
MOST_PIECES, TURN = 3, 0.33


@dataclass(frozen=True, eq=False)
class Hold:
    """Corners of a grid of patches in k × k pieces, and how much these bend: without weights.

    Several splines with the same knots are held together: their number stands behind the grid's.
    """

    #: (kn+1, km+1, …, 3)
    corners: Array
    #: largest |F_ss|, |F_st|, |F_tt| of patches' pieces in their own coordinates, (n, m, …) each
    bends: tuple[Array, Array, Array]

    def of(self, chosen: int | slice) -> Hold:
        """Return what holds one or some of several splines."""
        s, st, t = self.bends
        return Hold(
            self.corners[:, :, chosen], (s[:, :, chosen], st[:, :, chosen], t[:, :, chosen])
        )

    @property
    def _bow(self) -> Array:
        return np.asarray((self.bends[0] + self.bends[2]) / 8)

    @cached_property
    def _chords(self) -> tuple[Array, Array]:
        g = self.corners
        return g[1:] - g[:-1], g[:, 1:] - g[:, :-1]

    def limits(self) -> tuple[Array, Array]:
        """Return limits of the patches in thirteen directions, (…, n·m, 13) each."""
        values, bow = in_directions(self.corners), self._bow[..., None]
        return (_in_row(self._extreme(np.minimum, values) - bow, 1),
                _in_row(self._extreme(np.maximum, values) + bow, 1))  # fmt: skip

    def tangents(self, axis: int, noise: float) -> Cones:
        """Return cones of the tangents along s or t, (…, n·m)."""
        return self._around(self._chords[axis], self._reach(axis), noise)

    def ways(self, noise: float) -> Cones:
        """Return cones of all values themselves, (…, n·m)."""
        # where one is rounding nothing is known: it may be nought
        return self._around(self.corners, np.maximum(self._bow, 2 * noise), noise)

    def least(self) -> Array:
        """Return how short values are at least, (…, n·m)."""
        corners = self._within(lengths(self.corners)).min(axis=0)
        return _in_row(corners - self._bow, 0)

    @property
    def turn(self) -> float:
        """How far a patch's tangents turn on average, along both directions together, at most."""
        total = np.zeros(self._bow.shape[2:])
        for axis in (0, 1):
            chords = lengths(self._chords[axis])
            mean = chords.sum(axis=(0, 1)) / (chords.shape[0] * chords.shape[1])
            bend = self._reach(axis).sum(axis=(0, 1)) / (self._bow.shape[0] * self._bow.shape[1])
            total += np.where(mean > 0, bend / np.where(mean > 0, mean, 1.0), 0.0)
        return float(total.max())

    def _reach(self, axis: int) -> Array:
        return (self.bends[2 * axis] + self.bends[1]) / 2

    def _around(self, vectors: Array, reach: Array, noise: float) -> Cones:
        """Return the cones of all that is nearer than a reach to a patch's vectors."""
        size = lengths(vectors)
        ways = unit(np.where((size > noise)[..., None], vectors, 0.0))
        radii = radii_round(self._within(size), reach, noise)
        found = joint(Cones(self._within(ways), radii))
        return Cones(_in_row(found.axes, 1), _in_row(found.radii, 0))

    def _extreme(self, of: np.ufunc, values: Array) -> Array:
        """Return the least or the largest of the values (kn+1, km+1, …) at the patches' corners."""
        for axis, count in enumerate(self.bends[0].shape[:2]):
            rows = np.swapaxes(values, 0, axis)
            k, last = (len(rows) - 1) // count, len(rows) - 1
            parts = [rows[a : a + last - k + 1 : k] for a in range(k + 1)]
            values = np.swapaxes(reduce(of, parts), 0, axis)
        return values

    def _within(self, values: Array) -> Array:
        """Return the values (kn.., km.., …) that belong to the patches, one of each at a time."""
        n, m = self.bends[0].shape[:2]
        k = (len(self.corners) - 1) // n
        last = (n - 1) * k, (m - 1) * k
        return np.array([
            values[a : a + last[0] + 1 : k, b : b + last[1] + 1 : k]
            for a in range(values.shape[0] - last[0])
            for b in range(values.shape[1] - last[1])
        ])  # fmt: skip


def _in_row(values: Array, behind: int) -> Array:
    """Return values of patches (n, m, …) with the patches in one row, before so many last axes."""
    flat = values.reshape(-1, *values.shape[2:])
    return np.moveaxis(flat, 0, -1 - behind)


def hold(patches: Patches, poles: Array) -> Hold:
    """Return what holds patches of splines with these poles (N, M, …, 3) and the patches' knots."""
    assert patches.knots is not None
    along, across = (_derived(poles, patches.knots[k], k, 1) for k in (0, 1))
    bends = []
    for first, axis, orders in ((along, 0, (2, 0)), (along, 1, (1, 1)), (across, 1, (0, 2))):
        largest = lengths(_derived(first, patches.knots[axis], axis, orders[axis]))
        for k, order in enumerate(orders):
            largest = np.swapaxes(largest, 0, k)
            largest = _largest(largest, patches.knots[k], patches.index[k], order)
            largest = np.swapaxes(largest, 0, k)
        bends.append(largest)
    return Hold(_corners(patches, poles, 1), (bends[0], bends[1], bends[2]))


def hold_in_pieces(patches: Patches, poles: Array, whole: Hold | None = None) -> Hold:
    """Return what holds patches in as many pieces of each as they turn far.

    `whole` is what holds them as they are, where that is known.
    """
    whole = whole or hold(patches, poles)
    pieces = min(int(np.ceil(whole.turn / TURN)), MOST_PIECES)
    if pieces <= 1:
        return whole
    s, st, t = (bend / (pieces * pieces) for bend in whole.bends)
    return Hold(_corners(patches, poles, pieces), (s, st, t))


def _corners(patches: Patches, poles: Array, pieces: int) -> Array:
    """Return the corners of all pieces of the patches, so many along s and t each."""
    assert patches.matrices is not None
    for axis in (0, 1):
        index, matrices = patches.index[axis], patches.matrices[axis]
        degree = matrices.shape[1] - 1
        at, k = np.arange(pieces)[:, None] / pieces, np.arange(degree + 1)
        shares = np.array([comb(degree, i) for i in k.tolist()]) * at**k * (1 - at) ** (degree - k)
        rows = np.swapaxes(poles, 0, axis)
        inner = (shares @ matrices) @ rows[index].reshape(*index.shape, -1)
        end = matrices[-1:, -1:] @ rows[index[-1:]].reshape(1, degree + 1, -1)
        points = np.concatenate((inner.reshape(-1, inner.shape[-1]), end[0]))
        poles = np.swapaxes(points.reshape(-1, *rows.shape[1:]), 0, axis)
    return poles


def _largest(values: Array, knots: Array, index: Integers, order: int) -> Array:
    """Return the largest of a derivative's poles for each patch, in the patch's own coordinate."""
    if index.shape[1] <= order:  # of a straight line's second derivative there are no poles
        return np.zeros((len(index), *values.shape[1:]))
    span = index[:, -1]
    # patches of one span are equal parts of it
    length = ((knots[span + 1] - knots[span]) / np.bincount(span)[span]) ** order
    most = reduce(np.maximum, (values[k] for k in index[:, : index.shape[1] - order].T))
    return np.asarray(most * length.reshape(-1, *[1] * (most.ndim - 1)))


def _derived(poles: Array, knots: Array, axis: int, order: int) -> Array:
    """Return the poles of a derivative along an axis, from those of the order before.

    Zero between knots that coincide, where no span is.
    """
    poles = np.swapaxes(poles, 0, axis)
    count = len(poles)
    degree = len(knots) - count - order
    step = knots[1 + degree : count + degree] - knots[order : count + order - 1]
    share = np.where(step > 0, (degree - order + 1) / np.where(step > 0, step, 1.0), 0.0)
    steps = (poles[1:] - poles[:-1]) * share.reshape(-1, *[1] * (poles.ndim - 1))
    return np.swapaxes(steps, 0, axis)
