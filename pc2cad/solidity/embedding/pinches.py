"""Where a sheet, or a wall of two, has no width for no reason: inside, away from what joins it.

Vectors that are rounding have no direction, and no cone needs to hold them: sums in which others
count, too, are inside one. That leaves places at which no others count: sides of a part along which
all tangents vanish, and corners and sides where all ways across a wall do. They are points, and
joints, of the sheets themselves, or else the boundary touches itself there.
"""

from __future__ import annotations

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.linear import lengths
from pc2cad.solidity.embedding.cells import ENDS, Cells, cells_of
from pc2cad.solidity.embedding.levels import rises
from pc2cad.solidity.embedding.surfaces import SAME, Surfaces

#: of the sides along s, and along t: those at the lower and at the upper end of the other parameter
_SIDES = ((0, 2), (3, 1))


def pinched_sides(cells: Cells, noise: float) -> Booleans:
    """Say which cells have a side along s, and along t, that is a point but none of its sheet's.

    (n, 2).
    """
    found = []
    for axis, sides in enumerate(_SIDES):
        both = cells.points.take((0, -1), axis=2 - axis)
        short = lengths(np.diff(both, axis=1 + axis)).max(axis=1 + axis) <= noise
        found.append((short & ~cells.collapsed[:, sides]).any(axis=1))
    return np.stack(found, axis=1)


def pinched_patches(points: Array, is_point: Booleans, noise: float) -> Booleans:
    """Say the same of all patches of some sheets, (2, sheets, m, n).

    By control points (3, q+1, p+1, sheets, m, n), and which sides of the sheets are points, (…, 4).
    """
    found = np.zeros((2, *points.shape[3:]), dtype=bool)
    for axis, sides in enumerate(_SIDES):
        for end, side in zip((0, -1), sides, strict=True):
            row = np.asarray(points.take(end, axis=1 + axis))
            steps = row[:, 1:] - row[:, :-1]
            longest = np.asarray((steps * steps).sum(axis=0).max(axis=0))
            short: Booleans = longest <= noise * noise
            border: Booleans = np.moveaxis(short, 1 + axis, 0)[end]
            border &= ~is_point[:, side, None]
            found[axis] |= short
    return found


def pinched_ways(cells: Cells, one: Integers, other: Integers, noise: float) -> Booleans:
    """Say between which cells on two sides of a wall ways vanish where these are not joined."""
    size = lengths(cells.points[other] - cells.points[one])
    ends = size[:, (0, 0, -1, -1), (0, -1, 0, -1)]
    result: Booleans = np.asarray((ends <= noise).any(axis=1) & (one != other))
    rows = np.flatnonzero(result)
    if len(rows):
        result[rows] = ~rises(size[rows], _common(cells, one[rows], other[rows]), noise / 2)
    return result


def pinched_walls(surfaces: Surfaces, wall: tuple[int, int], ways: Array, noise: float) -> Booleans:
    """Say the same of all patches of two sheets, row by row, by the ways (3, q+1, p+1, m, n)."""
    ends = ways[:, [[0], [-1]], [0, -1]]
    near = ((ends * ends).sum(axis=0) <= noise * noise).any(axis=(0, 1))
    result: Booleans = near.T.ravel()
    rows = np.flatnonzero(result)
    if len(rows):
        patches = np.concatenate([rows + surfaces.start[sheet] for sheet in wall])
        zero, own = np.zeros((len(patches), 2)), np.arange(len(rows))
        cells = cells_of(surfaces, patches, zero, zero + 1)
        result[rows] = pinched_ways(cells, own, own + len(rows), noise)
    return result


def _common(cells: Cells, one: Integers, other: Integers) -> Booleans:
    """Say which control points (n, d+1, d+1) are of sides and corners that two cells both have."""
    name, where = cells.nodes
    corner = (name[one] == name[other]) & (np.abs(where[one] - where[other]) <= SAME).all(axis=2)
    side = (cells.edge[one] == cells.edge[other]) & corner[:, ENDS].all(axis=2)
    side &= (cells.edge[one] >= 0) | (cells.collapsed[one] & cells.collapsed[other])
    free = np.zeros((len(one), *cells.points.shape[1:3]), dtype=bool)
    for k, part in enumerate((free[:, :, 0], free[:, -1], free[:, :, -1], free[:, 0])):
        part |= side[:, k, None]
    for c, (i, j) in enumerate(((0, 0), (-1, 0), (-1, -1), (0, -1))):
        free[:, i, j] |= corner[:, c]
    return free
