"""Tips: where a face is drawn together to a point and M comes to it with no speed.

Near such a tip M - P goes with a power s^k of the parameter. A fit would come to the point with a
small speed in any direction, and might turn inside out there; with its first k rows of poles at the
point it goes with s^k as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import squares
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.domain.sections import SECTIONS

#: distances from the tip at which M is compared, and how near to whole their power has to be
_FAR, _NEAR, _WHOLE = 1e-3, 1e-4, 0.1


def rest_at(function: RestrictedMap, axis: int, end: int) -> int:
    """Return the power k with which M leaves one of its limits along an axis, at least 1.

    `end` is 0 or 1. Of a face the limit is one point; the least power along the side counts.
    """
    places = [SECTIONS] * len(function.pieces)
    places[axis] = places_near(end)
    values = np.moveaxis(function(*places), axis, 0).reshape(3, -1, 3)
    far, near = np.sqrt(squares(values[1:] - values[:1]))
    known = near > 8 * function.analysis.scale.evaluation_noise
    if not known.any():
        return 1
    power = float(np.log(far[known] / near[known]).min() / np.log(_FAR / _NEAR))
    return max(1, round(power)) if abs(power - round(power)) < _WHOLE else 1


def rest_at_ends(edges: Sequence[RestrictedMap]) -> list[tuple[int, int]]:
    """Return the powers with which M leaves both ends of edges, as `rest_at` does of one."""
    if not edges:
        return []
    near = [places_near(end) for end in (0, 1)]
    values = np.array([[edge(places) for places in near] for edge in edges])
    away = values[:, :, 1:] - values[:, :, :1]
    far, close = np.moveaxis(np.sqrt(squares(away)), -1, 0)
    known = close > 8 * edges[0].analysis.scale.evaluation_noise
    far, close = np.where(known, far, _FAR), np.where(known, close, _NEAR)
    powers = np.log(far / close) / np.log(_FAR / _NEAR)
    whole = np.round(powers)
    rests = np.where(np.abs(powers - whole) < _WHOLE, np.maximum(whole, 1), 1).astype(int)
    return [(int(first), int(last)) for first, last in rests]


def places_near(end: int) -> Array:
    """Return the places along an axis that `rest_at` looks at."""
    return np.asarray(np.abs(end - np.array([0.0, _FAR, _NEAR])))


def hold(poles: Array, rows: int) -> None:
    """Put the first rows of poles (n, …, 3) where the first one is."""
    poles[1 : min(rows, len(poles) - 1)] = poles[0]
