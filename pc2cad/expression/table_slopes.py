"""Slopes of cubic tables at their places, for any number of columns of values at once.

Steps `h` (n,) and rises per step (n, columns) give slopes (n + 1, columns); of a closed table the
last slope is the first.
"""

from __future__ import annotations

import numpy as np

from pc2cad.arrays import Array

#: weights of Akima's below this share of the largest are no differences of slopes
_SAME = 1e-9


def cubic_slopes(h: Array, rise: Array, closed: bool, ends: Array | None) -> Array:
    """Return the slopes of continuous second derivatives; natural ends, or `ends` (2, columns)."""
    if closed:
        return _closed_cubic(h, rise)
    inverse = 1 / h
    zero = np.zeros(1)
    # h_i (s_i + 2 s_{i+1} ...) in the usual order: below, on and above the diagonal
    diagonal = 2 * (np.append(inverse, zero) + np.append(zero, inverse))
    right = 3 * (
        np.vstack((rise * inverse[:, None], zero * rise[:1]))
        + np.vstack((zero * rise[:1], rise * inverse[:, None]))
    )
    below, above = inverse.copy(), inverse.copy()
    if ends is not None:
        diagonal[0] = diagonal[-1] = 1.0
        above[0] = below[-1] = 0.0
        right[0], right[-1] = ends
    return _tridiagonal(below, diagonal, above, right)


def _tridiagonal(below: Array, diagonal: Array, above: Array, right: Array) -> Array:
    """Return the solution of a system with three diagonals that needs no pivots."""
    d, r = diagonal.copy(), right.copy()
    for i in range(1, len(d)):
        share = below[i - 1] / d[i - 1]
        d[i] -= share * above[i - 1]
        r[i] -= share * r[i - 1]
    r[-1] /= d[-1]
    for i in reversed(range(len(d) - 1)):
        r[i] = (r[i] - above[i] * r[i + 1]) / d[i]
    return r


def _closed_cubic(h: Array, rise: Array) -> Array:
    """Return the slopes of the periodic cubic: a system with two corners (Sherman, Morrison)."""
    inverse, n = 1 / h, len(h)
    before = np.roll(inverse, 1)
    diagonal = 2 * (before + inverse)
    right = 3 * (np.roll(rise, 1, axis=0) * before[:, None] + rise * inverse[:, None])
    corner = inverse[-1]
    if n == 2:  # both neighbours are the same place
        side = inverse.sum()
        matrix = np.array([[diagonal[0], side], [side, diagonal[1]]])
        det = diagonal[0] * diagonal[1] - side * side
        swapped = np.array([[matrix[1, 1], -side], [-side, matrix[0, 0]]]) / det
        found = swapped[:, :1] * right[:1] + swapped[:, 1:] * right[1:]
        return np.concatenate((found, found[:1]))
    gamma = -diagonal[0]
    changed = diagonal.copy()
    changed[0] -= gamma
    changed[-1] -= corner * corner / gamma
    along = inverse[:-1]
    bent = np.zeros((n, 1))
    bent[0], bent[-1] = gamma, corner
    both = _tridiagonal(along, changed, along, np.hstack((right, bent)))
    x, z = both[:, :-1], both[:, -1:]
    factor = (x[:1] + x[-1:] * corner / gamma) / (1 + z[0] + z[-1] * corner / gamma)
    found = x - factor * z
    return np.concatenate((found, found[:1]))


def pchip_slopes(h: Array, rise: Array, closed: bool) -> Array:
    """Return the slopes of the cubic that is monotone where the values are."""
    if closed:
        wide, steps = np.concatenate((rise[-1:], rise)), np.concatenate((h[-1:], h))
        inner = _harmonic(steps, wide)
        return np.concatenate((inner, inner[:1]))
    if len(h) == 1:
        return np.repeat(rise, 2, axis=0)
    first = _one_sided(h[0], h[1], rise[0], rise[1])
    last = _one_sided(h[-1], h[-2], rise[-1], rise[-2])
    return np.vstack((first, _harmonic(h, rise), last))


def _harmonic(h: Array, rise: Array) -> Array:
    """Return weighted harmonic means of neighbouring rises, 0 where they turn."""
    a, b = rise[:-1], rise[1:]
    one, two = (2 * h[1:] + h[:-1])[:, None], (h[1:] + 2 * h[:-1])[:, None]
    with np.errstate(all="ignore"):
        mean = (one + two) / (one / a + two / b)
    return np.where(a * b > 0, mean, 0.0)


def _one_sided(h: float, beside: float, rise: Array, next_rise: Array) -> Array:
    """Return the slope at an end, of the shape of the values there."""
    slope = ((2 * h + beside) * rise - h * next_rise) / (h + beside)
    slope = np.where(np.sign(slope) != np.sign(rise), 0.0, slope)
    turns = (np.sign(rise) != np.sign(next_rise)) & (np.abs(slope) > 3 * np.abs(rise))
    return np.asarray(np.where(turns, 3 * rise, slope))


def akima_slopes(h: Array, rise: Array, closed: bool) -> Array:
    """Return Akima's slopes: means of the rises beside a place, weighted by how others turn."""
    if len(rise) == 1:
        return np.repeat(rise, 2, axis=0)
    if closed:
        wide = np.concatenate((rise[[-2, -1]], rise, rise[[0, 1]]))
    else:
        first = 2 * rise[0] - rise[1]
        last = 2 * rise[-1] - rise[-2]
        wide = np.vstack((2 * first - rise[0], first, rise, last, 2 * last - rise[-1]))
    turn = np.abs(np.diff(wide, axis=0))
    left, right = turn[2:], turn[:-2]
    total = left + right
    scale = total.max(axis=0, initial=0.0)
    with np.errstate(all="ignore"):
        mean = (left * wide[1:-2] + right * wide[2:-1]) / total
    found = np.where(total > _SAME * scale, mean, (wide[1:-2] + wide[2:-1]) / 2)
    return np.concatenate((found[:-1], found[:1])) if closed else found
