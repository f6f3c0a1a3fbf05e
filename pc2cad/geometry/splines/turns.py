"""Pieces of splines that are cut so that none turns far.

Between the knots of a fit a spline hardly turns. Where it has none, one piece may be a whole
circle, and its control points are far from it.
"""

from __future__ import annotations

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import cross


def turns_of(steps: Array) -> Array:
    """Return the angles by which chains of steps (…, n, 3) turn in all (radians), (…)."""
    before, after = steps[..., :-1, :], steps[..., 1:, :]
    across = np.sqrt((cross(before, after) ** 2).sum(axis=-1))
    angles = np.arctan2(across, (before * after).sum(axis=-1))
    return np.asarray(angles.sum(axis=-1))


def turning_limits(limits: Array, polygons: Array, longest: float) -> Array:
    """Return the ends of pieces, from those of a spline with control polygons (k, n, 3).

    A single piece is cut in equal parts, so many that they turn by `longest` (radians) each.
    """
    if len(limits) > 2:
        return limits
    turn = turns_of(np.diff(polygons, axis=1)).max(initial=0.0)
    parts = max(1, int(np.ceil(turn / longest - 1e-9)))
    return np.linspace(limits[0], limits[-1], parts + 1)
