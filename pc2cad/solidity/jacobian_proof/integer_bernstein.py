"""The sign of a polynomial over the unit box, from coefficients in whole numbers, none rounded.

Coefficients are those of t^k (1-t)^(n-k) along every axis: the Bernstein coefficients times
positive binomials. Common positive factors do not matter.
"""

from __future__ import annotations

from math import comb

import numpy as np

from pc2cad.arrays import BigIntegers

#: whole numbers of any size, one axis per variable


def sign_inside(
    coefficients: BigIntegers,
    clear: tuple[int, ...],
    deepest: int,
    most_boxes: int,
    most_numbers: int,
) -> int:
    """Return the sign of a polynomial inside the box where it is proved to be one, else 0.

    Variables of the axes `clear` stay clear of their limits, others may be at theirs. The box is
    halved `deepest` times at most, while boxes and their coefficients are no more than stated.
    """
    if not np.any(coefficients):
        return 0
    sign = 1 if coefficients.sum() > 0 else -1
    boxes = [np.asarray(sign * coefficients, dtype=object)]
    parts = 2**coefficients.ndim
    for _ in range(deepest + 1):
        boxes = [box for box in boxes if not _positive(box, clear)]
        if not boxes:
            return sign
        count = len(boxes) * parts
        if parts == 1 or count > most_boxes or count * boxes[0].size > most_numbers:
            return 0
        boxes = [part for box in boxes for part in _halves(box)]
    return 0


def _positive(box: BigIntegers, clear: tuple[int, ...]) -> bool:
    sums = np.asarray(box.sum(axis=clear) if clear else box, dtype=object)
    return bool(box.min() >= 0 and sums.min() > 0)


def along(matrix: BigIntegers, coefficients: BigIntegers, axis: int) -> BigIntegers:
    """Return coefficients multiplied by a matrix along one axis."""
    return np.moveaxis(np.tensordot(matrix, coefficients, axes=(1, axis)), 0, axis)


def _halves(box: BigIntegers) -> list[BigIntegers]:
    """Return the coefficients on the halves along every axis, times powers of 2."""
    parts = [box]
    for axis, count in enumerate(box.shape):
        n = count - 1
        # on t = s/2 the polynomial t^k (1-t)^(n-k) is s^k (s + 2(1-s))^(n-k) / 2^n
        left = np.array([
            [comb(n - k, i - k) * 2 ** (n - i) if i >= k else 0 for k in range(n + 1)]
            for i in range(n + 1)
        ], dtype=object)  # fmt: skip
        parts = [along(half, part, axis) for part in parts for half in (left, left[::-1, ::-1])]
    return parts
