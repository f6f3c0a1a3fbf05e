"""Interpolating C² cubic splines, as coefficients of piecewise polynomials."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import solve

#: ascending coefficients per piece
Rows = list[list[float]]


def cubic_rows(
    places: Sequence[Sequence[float]], shares: Sequence[Fraction], closed: bool
) -> tuple[tuple[Fraction, ...], list[Rows]]:
    """Return breaks and, per coordinate, the rows of the C² cubic through places at shares.

    A closed spline is periodic; `shares` then ends with the place where the first one is reached
    again. An open one has no knot at the second and at the last but one place (three places: the
    parabola; two: the line).
    """
    p = np.array([*places, places[0]] if closed else places, dtype=float)
    h = np.diff([float(s) for s in shares])
    rise = np.diff(p, axis=0) / h[:, None]
    slopes = _closed_slopes(h, rise) if closed else _open_slopes(h, rise)
    a, b = slopes[:-1], slopes[1:]
    square = (3 * rise - 2 * a - b) / h[:, None]
    cube = (a + b - 2 * rise) / h[:, None] ** 2
    table = np.stack((p[:-1], a, square, cube), axis=1)
    rows = [[[float(c) for c in piece[:, axis]] for piece in table] for axis in range(p.shape[1])]
    return tuple(shares), rows


def _closed_slopes(h: Array, rise: Array) -> Array:
    n = len(h)
    matrix, right = np.zeros((n, n)), np.zeros((n, rise.shape[1]))
    for i in range(n):
        before, after = 1 / h[i - 1], 1 / h[i]
        matrix[i, i] += 2 * (before + after)
        matrix[i, i - 1] += before
        matrix[i, (i + 1) % n] += after
        right[i] = 3 * (rise[i - 1] * before + rise[i] * after)
    slopes = solve(matrix, right)
    return np.concatenate((slopes, slopes[:1]))


def _open_slopes(h: Array, rise: Array) -> Array:
    n = len(h)
    if n == 1:
        return np.repeat(rise, 2, axis=0)
    matrix, right = np.zeros((n + 1, n + 1)), np.zeros((n + 1, rise.shape[1]))
    for i in range(1, n):
        before, after = 1 / h[i - 1], 1 / h[i]
        matrix[i, i - 1 : i + 2] = before, 2 * (before + after), after
        right[i] = 3 * (rise[i - 1] * before + rise[i] * after)
    if n == 2:
        # one parabola: the second derivative is the same at both ends
        matrix[0, :2], right[0] = 1, 2 * rise[0]
        matrix[2, 1:], right[2] = 1, 2 * rise[1]
        return solve(matrix, right)
    # the third derivative is continuous at the first and at the last inner knot
    for row, i in ((0, 0), (n, n - 2)):
        one, two = 1 / h[i] ** 2, 1 / h[i + 1] ** 2
        matrix[row, i : i + 3] = one, one - two, -two
        right[row] = 2 * (rise[i] * one - rise[i + 1] * two)
    return solve(matrix, right)
