"""Meetings near to where two sheets are joined: whether they cross there.

Sheets that are joined come as near to one another as one likes, and at a cusp much nearer than
their distance from the joint. There parts that nothing separates are a meeting only if one sheet
is seen on both sides of the other.
"""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.geometry.sheets import projected, restriction
from pc2cad.solidity.embedding.cells import Cells
from pc2cad.solidity.embedding.surfaces import Surfaces

#: a place nearer to a joint than this share of the size is near to it
NEAR = 1e-3
#: how large a neighbourhood is looked at, as a share of the distance from the joint
_SHARE = 0.1
#: cells of it along each parameter, and how far a crossing has to reach, as a share of it
_CELLS, _CLEAR = 8, 1e-3
#: places along each patch of a side
_PLACES = np.arange(17) / 16


class Joints:
    """The vertices and edges at which pairs of sheets are joined, as points."""

    def __init__(self, surfaces: Surfaces) -> None:
        # no method of its own: a cycle would keep all nets until garbage is collected
        self._between = lru_cache(maxsize=64)(partial(_points, surfaces))

    def distance(self, cells: Cells, pairs: Integers) -> Array:
        """Return how far the middles of pairs of cells are from where their sheets are joined."""
        middle = cells.points.mean(axis=(1, 2))[pairs].mean(axis=1)
        sheets = np.sort(cells.sheet[pairs], axis=1)
        result = np.empty(len(pairs))
        for a, b in np.unique(sheets, axis=0):
            rows = np.flatnonzero((sheets == (a, b)).all(axis=1))
            points = self._between(int(a), int(b))
            for part in np.array_split(rows, 1 + len(rows) * len(points) // 1_000_000):
                gap = middle[part, None] - points
                square = np.einsum("nki,nki->nk", gap, gap)
                result[part] = np.sqrt(square.min(axis=1, initial=np.inf))
        return result


def _points(surfaces: Surfaces, a: int, b: int) -> Array:
    """Return points of the sides and vertices that two sheets share; or one has twice."""
    first, second = surfaces.sheets[a], surfaces.sheets[b]
    edges = [side.edge for side in second.sides]
    ends = {v for side in second.sides for v in side.ends}
    found = []
    for k, side in enumerate(first.sides):
        shared = edges.count(side.edge) > (a == b) if side.edge is not None else False
        row = first.row(k)
        if shared:
            d = row.shape[1] - 1
            at = restriction(d, _PLACES, _PLACES)[:, 0]
            found.append(projected(np.einsum("xi,kic->kxc", at, row)).reshape(-1, 3))
        single = side.edge is None
        for end, vertex in ((row[0, 0], side.ends[0]), (row[-1, -1], side.ends[1])):
            if vertex in ends and (a != b or single):
                found.append(projected(end)[None])
    return np.concatenate(found) if found else np.empty((0, 3))


def crosses(cells: Cells, pair: Integers, distance: float) -> bool:
    """Say whether two sheets are seen to cross near the places of two cells.

    `distance` is how far they are from where the sheets are joined.
    """
    grids = [_around(cells, int(row), _SHARE * distance) for row in pair]
    return any(_pierces(one, other) for one, other in (grids, grids[::-1]))


def _around(cells: Cells, row: int, reach: float) -> Array:
    """Return points of a sheet round a cell on a grid, (n+1, n+1, 3), at most `reach` wide."""
    surfaces = cells.surfaces
    (net,) = surfaces.nets(cells.patch[[row]])
    points = projected(net)
    speed = [max(float(np.abs(np.diff(points, axis=k)).max()) * surfaces.degree, 1e-300)
             for k in (0, 1)]  # fmt: skip
    middle = (cells.low[row] + cells.high[row]) / 2
    half = np.minimum(reach / np.array(speed), 0.5)
    low = np.clip(middle - half, 0.0, 1.0)
    high = np.clip(middle + half, 0.0, 1.0)
    s, t = (low[k] + (high[k] - low[k]) * np.arange(_CELLS + 1) / _CELLS for k in (0, 1))
    at_s, at_t = (restriction(surfaces.degree, x, x)[:, 0] for x in (s, t))
    return projected(np.einsum("xi,yj,ijc->xyc", at_s, at_t, net))


def _pierces(one: Array, other: Array) -> bool:
    """Say whether a line of one grid pierces a triangle of another, and clearly so."""
    starts = np.concatenate((one[:-1].reshape(-1, 3), one[:, :-1].reshape(-1, 3)))
    ends = np.concatenate((one[1:].reshape(-1, 3), one[:, 1:].reshape(-1, 3)))
    a, b, c, d = (other[:-1, :-1], other[1:, :-1], other[1:, 1:], other[:-1, 1:])
    corners = [np.concatenate((x.reshape(-1, 3), y.reshape(-1, 3)))
               for x, y in ((a, a), (b, c), (c, d))]  # fmt: skip
    first, second = corners[1] - corners[0], corners[2] - corners[0]
    normal = np.cross(first, second)
    length = np.sqrt(np.einsum("ki,ki->k", normal, normal))
    normal = normal / np.where(length > 0, length, 1.0)[:, None]
    low = np.einsum("nki,ki->nk", starts[:, None] - corners[0], normal)
    high = np.einsum("nki,ki->nk", ends[:, None] - corners[0], normal)
    step = np.sqrt(((ends - starts) ** 2).sum(axis=1))[:, None]
    clear: Booleans = (low * high < 0) & (np.minimum(abs(low), abs(high)) > _CLEAR * step)
    n, k = np.nonzero(clear & (length > 0))
    share = (low[n, k] / (low[n, k] - high[n, k]))[:, None]
    at = starts[n] + share * (ends[n] - starts[n]) - corners[0][k]
    weights = [np.einsum("ni,ni->n", np.cross(x, y), normal[k]) / length[k]
               for x, y in ((at, second[k]), (first[k], at))]  # fmt: skip
    return bool(((weights[0] > 0) & (weights[1] > 0) & (weights[0] + weights[1] < 1)).any())
