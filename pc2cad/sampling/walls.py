"""How thick a solid is between opposite faces, by shortest distances from one to the other."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from pc2cad.arrays import Array
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.sampling.inversion import Inverse
from pc2cad.topology.cells import normal_direction

#: pieces of a parameter on a side, about; distances are taken from every sixth place
_PIECES: Final = 96
_EVERY: Final = 6


def thickness(analysis: Analysis) -> Mapping[str, tuple[float, float]]:
    """Return the least and the largest distance from each face of the wall to the other one.

    ``{"w=0 to w=1": (1.43, 2.0), "w=1 to w=0": (1.43, 2.0)}`` in the equation's units. The wall is
    between two opposite sides of the box that are faces all over and do not meet, the nearest ones
    where there are more; nothing where there are none. From each of some hundred places of the one,
    corners included, the nearest place of the other is searched from the nearest of its samples:
    sampled. Where a wall is laid along the normal all are its thickness, but a corner that points
    outwards is farther from the inside.
    """
    found = [_Wall(analysis, d) for d in range(3) if _fates(analysis, d) == {"face"}]
    walls = [wall for wall in found if wall.apart.min() > analysis.scale.search_noise]
    if not walls:
        return {}
    wall = min(walls, key=lambda wall: float(np.median(wall.apart)))
    names = [f"{'uvw'[wall.direction]}={x:g}" for x in wall.limits]
    inverse, result = Inverse(analysis), {}
    for here, there in ((0, 1), (1, 0)):
        away = wall.distances(inverse, here, there)
        result[f"{names[here]} to {names[there]}"] = (float(away.min()), float(away.max()))
    return result


def _fates(analysis: Analysis, direction: int) -> set[str]:
    sides = analysis.boundary.sides
    return {side.fate for side in sides if normal_direction(side.patch) == direction}


class _Wall:
    """Places of two opposite sides, and where they are."""

    def __init__(self, analysis: Analysis, direction: int) -> None:
        self.direction = direction
        self.limits = [analysis.map.value(direction, x) for x in (0.0, 1.0)]
        self._places = [_places(analysis, direction, x) for x in (0.0, 1.0)]
        self._points = [analysis.map.points(*np.moveaxis(x, -1, 0)) for x in self._places]
        across = self._points[1] - self._points[0]
        #: distances of places with the same other two parameters
        self.apart = np.sqrt((across * across).sum(axis=-1))

    def distances(self, inverse: Inverse, here: int, there: int) -> Array:
        """Return the least distances from places of one side to the other side."""
        targets = self._points[here][::_EVERY, ::_EVERY].reshape(-1, 3)
        _, nearest = cKDTree(self._points[there].reshape(-1, 3)).query(targets)
        start = self._places[there].reshape(-1, 3)[nearest]
        return np.asarray(np.sqrt(inverse.descend(targets, start, self.direction)[1]))


def _places(analysis: Analysis, direction: int, limit: float) -> Array:
    """Return local places (n, m, 3) of a side, breaks among those that distances are taken from."""
    lines = [np.array([limit])] * 3
    others = [d for d in range(3) if d != direction]
    for d in others:
        ends = [0.0, *(b.position for b in analysis.breaks[d] if 0 < b.position < 1), 1.0]
        counts = [_EVERY * max(1, round(_PIECES * (b - a) / _EVERY)) for a, b in pairwise(ends)]
        rows = [np.linspace(a, b, count, endpoint=False)
                for (a, b), count in zip(pairwise(ends), counts, strict=True)]  # fmt: skip
        lines[d] = np.append(np.concatenate(rows), 1.0)
    grid = np.stack(np.broadcast_arrays(*open_grid(*lines)), axis=-1)
    return np.asarray(np.take(grid, 0, axis=direction))
