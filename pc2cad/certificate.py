"""Proof that det J keeps one sign, from Bernstein coefficients (spec 4.3).

A polynomial lies in the convex hull of its Bernstein coefficients: when those of det J are all of
one sign, and not all zero, det J cannot vanish inside the box. Where they are not, the box is
halved a few times; what is then still open is left to samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pc2cad.analysis import Analysis
from pc2cad.equation.identity import Verdict
from pc2cad.equation.point_equation import PARAMETERS
from pc2cad.geometry.bernstein import bernstein

Array = NDArray[np.float64]

#: halvings of the box, and boxes looked at, before the proof is given up
DEEPEST = 5
MOST_BOXES = 2000


def determinant_sign(analysis: Analysis) -> Verdict:
    """Say whether det J is proved to have one sign inside the box (PROVED or UNDECIDED)."""
    columns = analysis.map.derivatives
    trees = [tree for column in columns for tree in column]
    tables = bernstein(trees, PARAMETERS)
    if tables is None:
        return Verdict.UNDECIDED
    coefficients = _determinant(tables.reshape(*tables.shape[:3], 3, 3))
    scale = float(np.abs(coefficients).max())
    sign = 1.0 if coefficients.sum() > 0 else -1.0
    boxes = [sign * coefficients / (scale or 1.0)]
    for _ in range(DEEPEST + 1):
        boxes = [box for box in boxes if box.min() < -1e-13]
        if not boxes:
            return Verdict.PROVED if scale else Verdict.UNDECIDED
        if len(boxes) * 8 > MOST_BOXES:
            break
        boxes = [part for box in boxes for part in _halve(box)]
    return Verdict.UNDECIDED


def _determinant(columns: Array) -> Array:
    """Return Bernstein coefficients of the determinant: (l, m, n, 3 vectors, 3 axes) to a box."""
    a, b, c = (columns[..., k, :] for k in range(3))

    total: Array | float = 0.0
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        minor = _product(b[..., j], c[..., k]) - _product(b[..., k], c[..., j])
        total = total + _product(a[..., i], minor)
    return np.asarray(total)


def _product(p: Array, q: Array) -> Array:
    """Return the Bernstein coefficients of a product, of the sum of the degrees."""
    left, right = _scaled(p, 1), _scaled(q, 1)
    shape = tuple(a + b - 1 for a, b in zip(p.shape, q.shape, strict=True))
    result = np.zeros(shape)
    for index in np.ndindex(*p.shape):
        window = tuple(slice(i, i + n) for i, n in zip(index, q.shape, strict=True))
        result[window] += left[index] * right
    return _scaled(result, -1)


def _scaled(coefficients: Array, power: int) -> Array:
    """Multiply (power 1) or divide (-1) by the binomials, per axis."""
    result = coefficients
    for axis, n in enumerate(coefficients.shape):
        row = np.ones(n)
        for k in range(1, n):
            row[k] = row[k - 1] * (n - k) / k
        shape = [1] * coefficients.ndim
        shape[axis] = n
        result = result * row.reshape(shape) ** power
    return result


def _halve(box: Array) -> list[Array]:
    """Return the coefficients on the eight halves (de Casteljau at 1/2 along each axis)."""
    parts = [box]
    for axis in range(3):
        parts = [half for part in parts for half in _halve_along(part, axis)]
    return parts


def _halve_along(box: Array, axis: int) -> tuple[Array, Array]:
    work = np.moveaxis(box, axis, 0)
    low, high = [work[0]], [work[-1]]
    while len(work) > 1:
        work = (work[:-1] + work[1:]) / 2
        low.append(work[0])
        high.append(work[-1])
    return (
        np.moveaxis(np.array(low), 0, axis),
        np.moveaxis(np.array(high[::-1]), 0, axis),
    )
