"""What holds the patches of a spline, and their tangents, before any patch is made.

In its own coordinates from 0 to 1 a patch F is within (|F_ss| + |F_tt|)/8 of the bilinear patch of
its corners, and its tangents along s are within (|F_ss| + |F_st|)/2 of one of the two chords
along s: second derivatives at their largest, which no pole of theirs exceeds. Of a fit with many
spans these are small, and the corners are one point per span.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.linear import lengths
from pc2cad.geometry.sheets import Patches
from pc2cad.solidity.embedding.separation import boxes
from pc2cad.solidity.embedding.windows import Cones, around, joint


@dataclass(frozen=True, eq=False)
class Hold:
    """Corners of a grid of patches, and how much these bend: without weights."""

    #: (n+1, m+1, 3)
    corners: Array
    #: largest |F_ss|, |F_st| and |F_tt| of each patch in its own coordinates, (n, m) each
    bends: tuple[Array, Array, Array]

    @property
    def _bow(self) -> Array:
        return np.asarray((self.bends[0] + self.bends[2]) / 8)

    def limits(self) -> tuple[Array, Array]:
        """Return limits of the patches in seven directions, (n·m, 7) each."""
        low, high = (
            reduce(least, (values[:-1, :-1], values[1:, :-1], values[:-1, 1:], values[1:, 1:]))
            for values, least in zip(
                boxes(self.corners[..., None, :]), (np.minimum, np.maximum), strict=True
            )
        )
        bow = self._bow[..., None]
        return (low - bow).reshape(-1, 7), (high + bow).reshape(-1, 7)

    def tangents(self, axis: int, noise: float) -> Cones:
        """Return cones of the tangents along s or t."""
        chords = np.diff(self.corners, axis=axis)
        reach = (self.bends[2 * axis] + self.bends[1]) / 2
        sides = (chords[:, :-1], chords[:, 1:]) if axis == 0 else (chords[:-1], chords[1:])
        return joint([around(side, reach, noise) for side in sides]).flat()

    def ways(self, noise: float) -> Cones:
        """Return cones of all values themselves."""
        c, bow = self.corners, self._bow
        corners = (c[:-1, :-1], c[1:, :-1], c[:-1, 1:], c[1:, 1:])
        return joint([around(corner, bow, noise) for corner in corners]).flat()


def hold(patches: Patches, poles: Array) -> Hold:
    """Return what holds patches of a spline with these poles (N, M, 3) and the patches' knots."""
    assert patches.knots is not None
    bends = []
    for orders in ((2, 0), (1, 1), (0, 2)):
        values = poles
        for axis, order in enumerate(orders):
            values = np.swapaxes(values, 0, axis)
            values = np.swapaxes(_derived(values, patches.knots[axis], order), 0, axis)
        largest = lengths(values)
        for axis, order in enumerate(orders):
            largest = np.swapaxes(largest, 0, axis)
            largest = _largest(largest, patches.knots[axis], patches.index[axis], order)
            largest = np.swapaxes(largest, 0, axis)
        bends.append(largest)
    return Hold(_corners(patches, poles), (bends[0], bends[1], bends[2]))


def _corners(patches: Patches, poles: Array) -> Array:
    assert patches.matrices is not None
    for axis in (0, 1):
        index, matrices = patches.index[axis], patches.matrices[axis]
        ends = np.concatenate((matrices[:, 0], matrices[-1:, -1]))
        rows = np.swapaxes(poles, 0, axis)[np.concatenate((index, index[-1:]))]
        poles = np.swapaxes(np.einsum("kj,kj...->k...", ends, rows), 0, axis)
    return poles


def _largest(values: Array, knots: Array, index: Integers, order: int) -> Array:
    """Return the largest of a derivative's poles for each patch, in the patch's own coordinate."""
    if index.shape[1] <= order:  # of a straight line's second derivative there are no poles
        return np.zeros((len(index), *values.shape[1:]))
    span = index[:, -1]
    length = (knots[span + 1] - knots[span]) ** order
    most = reduce(np.maximum, (values[k] for k in index[:, : index.shape[1] - order].T))
    return np.asarray(most * length[:, None])


def _derived(poles: Array, knots: Array, order: int) -> Array:
    """Return the poles of a derivative; zero between knots that coincide, where no span is."""
    degree = len(knots) - len(poles) - 1
    for k in range(order):
        p = degree - k
        step = knots[1 + degree : len(poles) + degree] - knots[1 + k : len(poles) + k]
        share = np.where(step > 0, p / np.where(step > 0, step, 1.0), 0.0)
        poles = np.diff(poles, axis=0) * share.reshape(-1, *[1] * (poles.ndim - 1))
    return poles
