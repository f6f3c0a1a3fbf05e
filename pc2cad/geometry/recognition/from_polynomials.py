"""Planes and lines of polynomial maps, told in whole numbers without any rounding.

A cell is a sum of vectors times powers of its parameters: it lies in a plane where all vectors but
the constant one are at right angles to one normal, and on a line where they are parallel.
"""

from __future__ import annotations

from math import sqrt
from typing import TypeAlias

import numpy as np

from pc2cad.expression.magnitudes import rounding
from pc2cad.expression.polynomials import Vectors
from pc2cad.geometry.carriers import Plane
from pc2cad.geometry.recognition.from_separable_form import SAME

_Whole: TypeAlias = tuple[int, int, int]
_Real: TypeAlias = tuple[float, float, float]


def exact_plane(vectors: Vectors, scale: int) -> Plane | None:
    """Return the plane that holds a face, whose vectors are given times `scale`.

    It is that of `from_separable_form.plane`, with the same bits. None where there is none, and
    where the normal may be rounding.
    """
    moving = [vector for powers, vector in vectors.items() if any(powers)]
    steps = [(x / scale, y / scale, z / scale) for x, y, z in moving]
    if len(steps) < 2:
        return None
    sizes = [_square(step) for step in steps]
    first = sizes.index(max(sizes))
    normals = [_cross(steps[first], step) for step in steps]
    squares = [_square(normal) for normal in normals]
    second = squares.index(max(squares))
    a, b, c = _across(moving[first], moving[second])
    if not (a or b or c) or any([a * x + b * y + c * z for x, y, z in moving]):
        return None
    normal = np.array(normals[second])
    size, extent = sqrt(normal.dot(normal)), sum(map(sqrt, sizes))
    # no two points of the face are farther apart than twice the lengths of all steps
    if not SAME * rounding(2 * extent, extent) * sqrt(sizes[first]) < size < np.inf:
        return None
    return Plane(np.array([x / scale for x in vectors.get((0, 0), (0, 0, 0))]), normal / size)


def is_exactly_straight(vectors: Vectors) -> bool:
    """Say whether the points of an edge lie on one line."""
    moving = [vector for powers, vector in vectors.items() if any(powers)]
    return bool(moving) and not any(any(_across(moving[0], vector)) for vector in moving[1:])


def normal_at(vectors: Vectors, s: float, t: float) -> _Real:
    """Return M_s × M_t of a face at a place, times some positive number."""
    along_s, along_t = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    for (i, j), vector in vectors.items():
        of_s = i * s ** (i - 1) * t**j if i else 0.0
        of_t = j * s**i * t ** (j - 1) if j else 0.0
        for axis, x in enumerate(vector):
            along_s[axis] += of_s * x
            along_t[axis] += of_t * x
    (a, b, c), (d, e, f) = along_s, along_t
    return _cross((a, b, c), (d, e, f))


def _square(a: _Real) -> float:
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]


def _cross(a: _Real, b: _Real) -> _Real:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def _across(a: _Whole, b: _Whole) -> _Whole:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )
