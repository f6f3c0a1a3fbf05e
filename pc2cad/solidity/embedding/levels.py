"""Parts in planes one above the other: what separates where tangents say nothing.

Where a parameter was slowed down (x = s²), a part leaves its side at no speed, and the first
differences of its control points are rounding. Heights above a plane still tell its points apart:
a sum with positive factors is positive wherever one height that counts is.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.linear import heights, lengths, unit

#: what rounding leaves of the product with a normal, relative
_UNIT = 1e-15
#: a rise of so many times what is rounding is one
_CLEAR = 16


def rises(height: Array, free: Booleans, noise: Array | float) -> Booleans:
    """Say which parts are above a plane but where they are `free`: (n, d+1, d+1) both.

    Control points may be in the plane: inside a part any higher one counts, on a side one of the
    side's, at a corner its own.
    """
    room = 2 * np.broadcast_to(np.asarray(noise), len(height))[:, None, None]
    above = height > room
    result = np.asarray((free | (height >= -room)).all(axis=(1, 2)))
    result &= above.any(axis=(1, 2))
    for i in (0, -1):
        for end, line in ((free[:, i], above[:, i]), (free[:, :, i], above[:, :, i])):
            result &= end.all(axis=1) | line.any(axis=1)
        for j in (0, -1):
            result &= free[:, i, j] | above[:, i, j]
    return result


def by_levels(nets: Array, noise: float) -> Booleans:
    """Say which parts (n, d+1, d+1, 3) meet themselves nowhere by two heights of theirs.

    One does not change along the first parameter and rises along the second, the other way round
    the other: equal points have equal parameters then.
    """
    result = np.ones(len(nets), dtype=bool)
    for turned in (nets, nets.transpose(0, 2, 1, 3)):
        along, across = (np.diff(turned, axis=k).reshape(len(nets), -1, 3) for k in (1, 2))
        found = np.zeros(len(nets), dtype=bool)
        for normal, room in _normals(along, noise):
            steps, rests = (heights(x, normal) for x in (across, along))
            level = np.abs(rests).max(axis=1) <= room
            for rise in (steps, -steps):
                found |= level & (rise.min(axis=1) >= -room) & (rise.max(axis=1) > _CLEAR * room)
        result &= found
    return result


def is_graph(poles: Array, index: tuple[Integers, Integers], noise: float) -> bool:
    """Say whether a spline (N, M, 3) meets itself nowhere by two of space's heights, as a whole.

    The poles of a patch are the rows `index[0][i]` and columns `index[1][j]`. A height rises along
    a patch whose poles rise, if one of them does; (u, v, f) is the commonest of such splines.
    """
    for axis, rows in enumerate(index):
        steps, rests = np.diff(poles, axis=axis), np.abs(np.diff(poles, axis=1 - axis))
        room = noise + _UNIT * np.abs(steps).max(initial=0.0)
        for height in np.flatnonzero(rests.max(axis=(0, 1), initial=0.0) <= room):
            line = np.moveaxis(steps[..., height], axis, 0)
            line = line * np.sign(line.sum())
            within = line.min(axis=1)[rows[:, :-1]]
            if (within >= -room).all() and (within.max(axis=1) > _CLEAR * room).all():
                break
        else:
            return False
    return True


def beyond_plane(first: Array, second: Array, noise: float) -> Booleans:
    """Say which pairs of parts a plane parts that has their common side, the first along axis 2."""
    side = np.diff(first[:, :, 0], axis=1)
    free = np.zeros(first.shape[:3], dtype=bool)
    free[:, :, 0] = True
    result = np.zeros(len(first), dtype=bool)
    for normal, room in _normals(side, noise):
        one, other = (
            np.einsum("nijc,nc->nij", net - first[:, :1, :1], normal) for net in (first, second)
        )
        flat = np.maximum(np.abs(one[:, :, 0]), np.abs(other[:, :, 0])).max(axis=1) <= 2 * room
        for a, b in ((one, -other), (-one, other)):
            result |= flat & rises(a, free, room) & rises(b, free, room)
    return result


def beyond_corner(first: Array, second: Array) -> Iterator[Array]:
    """Yield directions (n, 3) that may part what leads away from a corner (n, k, 3 each).

    Two heights of space's, each as far as it reaches, together: parts on two sides of both planes
    that meet on neither are on two sides of the plane between.
    """
    reach = np.maximum(np.abs(first).max(axis=1), np.abs(second).max(axis=1))
    share = 1 / np.where(reach > 0, reach, 1.0)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        for sign in (1.0, -1.0):
            normal = np.zeros_like(share)
            normal[:, i], normal[:, j] = share[:, i], sign * share[:, j]
            yield unit(normal)


def _normals(steps: Array, noise: float) -> Iterator[tuple[Array, Array]]:
    """Yield directions that steps (n, k, 3) may be across, with what is rounding along them (n,).

    The one that is across them as well as any, and those of space's axes.
    """
    room = noise + _UNIT * lengths(steps).max(axis=1, initial=0.0)
    if len(steps):
        yield np.linalg.svd(steps, full_matrices=True)[2][:, 2], room
    for axis in np.eye(3):
        yield np.broadcast_to(axis, (len(steps), 3)), room
