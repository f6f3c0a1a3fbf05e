"""Point inversion on curves: the parameter of the place that is nearest to a point."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.linear import product

#: points and derivatives of a curve at parameters
Along: TypeAlias = Callable[[Array], tuple[Array, Array]]
#: parameters dense enough to start an inversion, and the bounds it must keep
Sampling: TypeAlias = tuple[Array, float, float]
MOST_STEPS = 24
#: a point is off a curve where it is further away than this share of the chords beside it; samples
#: lie this many times closer then
OFF, FINER = 1e-4, 8


def closest(at: Along, sampling: Sampling, points: Array, known: Array | None = None) -> Array:
    """Return parameters of points near a curve: nearest sample, then Gauss-Newton.

    Points that stay off the curve are looked for once more, from both ends (on a closed curve the
    nearest sample is both, and a step from the wrong one leads out of it) and from samples that lie
    closer: beside a steep place the nearest sample may be of another part of the curve. `known` are
    the points of the samples, for who asks more than once.
    """
    samples, low, high = sampling
    known = at(samples)[0] if known is None else known
    best, least, spacing = _descended(at, sampling, points, known)
    for k in (0, -1):
        off = least > OFF * spacing
        if off.any():
            at_end = samples[[k]], low, high
            again, nearer, _ = _descended(at, at_end, points[off], known[[k]])
            best[off] = np.where(nearer < least[off], again, best[off])
            least[off] = np.minimum(least[off], nearer)
    off = least > OFF * spacing
    if off.any():
        finer = divided(samples, FINER)
        again, nearer, _ = _descended(at, (finer, low, high), points[off], at(finer)[0])
        best[off] = np.where(nearer < least[off], again, best[off])
        least[off] = np.minimum(least[off], nearer)
    for k in (0, -1):
        end, distance = samples[k], np.linalg.norm(points - known[k], axis=1)
        snap = distance <= least + 1e-11 * (1e-3 + np.abs(points).max(initial=0.0))
        best = np.where(snap & (np.abs(best - end) < 1e-6 * (high - low)), end, best)
    return np.asarray(best)


def _descended(
    at: Along, sampling: Sampling, points: Array, known: Array
) -> tuple[Array, Array, Array]:
    """Return parameters, their distances and the chords beside the samples they come from."""
    samples, low, high = sampling
    start = nearest(known, points)
    chords = np.linalg.norm(np.diff(known, axis=0), axis=1)
    spacing = np.maximum(np.append(chords, 0.0), np.append(0.0, chords))[start]
    t = samples[start]
    best, least, moved = t, np.full(len(points), np.inf), np.inf
    for _ in range(MOST_STEPS):
        value, slope = at(t)
        distance = np.linalg.norm(points - value, axis=1)
        better = distance < least
        best, least = np.where(better, t, best), np.minimum(distance, least)
        if moved <= 1e-12 * (high - low):
            break
        speed = np.maximum((slope**2).sum(axis=1), 1e-300)
        step = ((points - value) * slope).sum(axis=1) / speed
        following = np.clip(t + step, low, high)
        moved = float(np.abs(following - t).max(initial=0.0))
        t = following
    return best, least, spacing


def divided(cuts: Array, parts: int) -> Array:
    """Return parameters with each step from one to the next in some equal parts."""
    shares = np.arange(parts) / parts
    inner = cuts[:-1, None] + np.diff(cuts)[:, None] * shares
    return np.append(inner.ravel(), cuts[-1])


def nearest(known: Array, points: Array) -> Integers:
    """Return for each point the number of the nearest of the known ones."""
    middle = known.mean(axis=0)
    shifted, size = known - middle, ((known - middle) ** 2).sum(axis=1)
    found = np.empty(len(points), dtype=np.intp)
    rows = max(1, 200_000 // max(1, len(known)))
    for begin in range(0, len(points), rows):
        part = points[begin : begin + rows] - middle
        found[begin : begin + rows] = (size - 2.0 * product(part, shifted.T)).argmin(axis=1)
    return found
