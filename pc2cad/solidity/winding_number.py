"""Winding numbers of closed triangle meshes about many points at once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pc2cad.arrays import Array, Integers

#: point-triangle pairs tested at once
_PAIRS = 2_000_000


@lru_cache(maxsize=4)
def ray_frame(seed: int = 0) -> Array:
    """Return a fixed rotation whose last axis is the direction of the rays, read-only."""
    odd = np.sin((1.0 + seed) * np.sqrt([[2.0, 3.0, 5.0], [7.0, 11.0, 13.0], [17.0, 19.0, 23.0]]))
    turn = np.linalg.qr(odd)[0]
    if np.linalg.det(turn) < 0:
        turn[:, 0] *= -1
    turn.flags.writeable = False
    return np.asarray(turn)


def winding_numbers(points: Array, triangles: Array, seed: int = 0) -> Integers:
    """Return how often the triangles go round each point: points (n, 3) to (n,) integers.

    `triangles` (m, 3, 3) hold corners and point outwards by the right-hand rule. Along a ray from
    each point (see `ray_frame`), crossings count +1 outwards and -1 inwards. The triangles are
    sorted into columns along the ray, so that a point meets only those of its own.
    """
    if len(triangles) == 0:
        return np.zeros(len(points), dtype=np.int64)
    turn = ray_frame(seed)
    # coordinate by coordinate: (3, corner, triangle) and (3, point)
    corners = np.ascontiguousarray((triangles.reshape(-1, 3) @ turn).reshape(-1, 3, 3).T)
    places = np.ascontiguousarray((points @ turn).T)
    low = corners[:2].min(axis=(1, 2))
    extent = corners[:2].max(axis=(1, 2)) - low
    # no more columns than points: most triangles then lie in one
    columns = int(np.clip(np.sqrt(min(len(triangles), 2 * len(points))), 1, 1024))
    cell = np.where(extent > 0, extent, 1.0) / columns
    starts, members = _columns(corners, low, cell, columns)
    i, j = np.floor((places[:2] - low[:, None]) / cell[:, None]).astype(np.int64)
    inside = (i >= 0) & (i < columns) & (j >= 0) & (j < columns)
    column = np.where(inside, i * columns + j, 0)
    counts = np.where(inside, starts[column + 1] - starts[column], 0)
    result = np.zeros(len(points), dtype=np.int64)
    edges = np.flatnonzero(np.diff(np.cumsum(counts) // _PAIRS)) + 1
    for part in np.split(np.arange(len(points)), edges):
        owner = np.repeat(part, counts[part])
        offset = np.arange(len(owner)) - np.repeat(
            np.cumsum(counts[part]) - counts[part], counts[part]
        )
        triangle = members[starts[column[owner]] + offset]
        np.add.at(result, owner, _crossings(places[:, owner], corners[:, :, triangle]))
    return result


def _columns(corners: Array, low: Array, cell: Array, columns: int) -> tuple[Integers, Integers]:
    """Return the triangles (3, 3, m) of every column as starts (columns² + 1,) and members."""
    flat, low, cell = corners[:2], low[:, None], cell[:, None]
    first, last = (
        np.clip(np.floor((ends - low) / cell), 0, columns - 1).astype(np.int64)
        for ends in (flat.min(axis=1), flat.max(axis=1))
    )
    spans = last - first + 1
    counts = spans[0] * spans[1]
    triangle = np.repeat(np.arange(corners.shape[2]), counts)
    offset = np.arange(len(triangle)) - np.repeat(np.cumsum(counts) - counts, counts)
    across = spans[1, triangle]
    i = first[0, triangle] + offset // across
    j = first[1, triangle] + offset % across
    counts = np.bincount(i * columns + j, minlength=columns * columns)
    starts = np.concatenate(([0], np.cumsum(counts)))
    # short integers are sorted by counting, in linear time
    by_row = np.argsort(j.astype(np.uint16), kind="stable")
    order = by_row[np.argsort(i[by_row].astype(np.uint16), kind="stable")]
    return starts, triangle[order]


def _crossings(points: Array, corners: Array) -> Integers:
    """Return the sign with which a ray along +z from each point crosses its triangle, or 0.

    Points are (3, n), corners (3, 3, n): coordinates first, then the corners.
    """
    x, y = (corners[k] - points[k] for k in (0, 1))
    # twice the signed areas of the triangles that the point makes with each side; the side
    # opposite to a corner carries its barycentric weight
    a, b, c = (x[i] * y[j] - x[j] * y[i] for i, j in ((1, 2), (2, 0), (0, 1)))
    up, down = (a > 0) & (b > 0) & (c > 0), (a < 0) & (b < 0) & (c < 0)
    sign = up.astype(np.int64) - down
    (met,) = np.nonzero(sign)
    a, b, c = (weight[met] for weight in (a, b, c))
    z = corners[2][:, met]
    with np.errstate(invalid="ignore", divide="ignore"):
        height = (a * z[0] + b * z[1] + c * z[2]) / (a + b + c)
    sign[met[~(height > points[2, met])]] = 0
    return np.asarray(sign)
