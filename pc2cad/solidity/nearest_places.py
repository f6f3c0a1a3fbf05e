"""Places of faces that are nearest to a place of space, or to one another."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pc2cad.arrays import Array

#: steps of a search, and a step for differences
STEPS, _DIFFERENCE = 60, 1e-6


def descended(
    gap: Callable[[Array], Array], start: Array, reach: float, most: int = STEPS
) -> Array:
    """Return parameters where a vector is shortest, by Levenberg and Marquardt's steps.

    `gap` takes parameters (…, k) and returns vectors (…, 3). In `most` steps none runs further than
    `reach` from `start`, or out of [0, 1].
    """
    low, high = np.clip(start - reach, 0.0, 1.0), np.clip(start + reach, 0.0, 1.0)
    place, damping = start.copy(), 1e-3
    value = gap(place)
    for _ in range(most):
        steps = _DIFFERENCE * np.eye(len(place))
        steps = np.where(place + _DIFFERENCE > 1, -steps, steps)
        slopes = (gap(place + steps) - value) / steps.sum(axis=1)[:, None]
        matrix, side = slopes @ slopes.T, slopes @ value
        scale = np.diag(np.maximum(np.diag(matrix), 1e-30))
        step = np.linalg.lstsq(matrix + damping * scale, -side, rcond=None)[0]
        tried = np.clip(place + step, low, high)
        there = gap(tried)
        if there @ there < value @ value:
            if np.abs(tried - place).max() < 1e-14:
                break
            place, value, damping = tried, there, damping / 10
        else:
            damping *= 10
            if damping > 1e12:
                break
    return np.asarray(place)
