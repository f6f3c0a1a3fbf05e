"""Which parts of sheets are on one side of a plane face's plane, told by poles alone.

Inside a patch all poles that it is made of have positive factors, and at an end of its sheet, where
knots are clamped, the first (or last) ones only. So where all poles are above a plane, but for
those of sides and corners that the plane face has too, the patch meets that face there only. No
patch is made for that, and a block of patches is above where all of them are. Along a common side
control points are taken across it where poles do not do: these reach farther round a bend.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product
from pc2cad.geometry.sheets import Patches
from pc2cad.solidity.embedding.surfaces import POINT, Surfaces

#: bits of what is above a plane, and below it
_ABOVE, _BELOW = 1, 2
#: where the poles of the sides t = 0, s = 1, t = 1, s = 0 are: axis and end
_ROWS = ((1, 0), (0, -1), (1, -1), (0, 0))


@dataclass(frozen=True, eq=False)
class PlaneSides:
    """On which sides of planes blocks of patches are."""

    #: bits (blocks, planes); the first column is of no plane
    bits: NDArray[np.uint8]
    #: the column of each sheet
    columns: Integers

    def merged(self, order: Integers, first: Integers) -> PlaneSides:
        """Return the same of larger blocks, made of those that follow one another in an order."""
        return PlaneSides(np.bitwise_and.reduceat(self.bits[order], first), self.columns)

    def part(self, pairs: Integers, sheet: Integers) -> Booleans:
        """Say of which pairs of blocks (k, 2) one meets the other's plane on its borders only.

        `sheet` is the sheet of each block.
        """
        a, b = pairs[:, 0], pairs[:, 1]
        columns = self.columns[sheet]
        return np.asarray((self.bits[a, columns[b]] | self.bits[b, columns[a]]) > 0)


def sides_of_planes(surfaces: Surfaces, pairs: Integers, room: float) -> PlaneSides:
    """Return on which sides of plane faces' planes patches are, farther from these than a room.

    Asked are pairs of sheets (k, 2), one curved and one in a plane.
    """
    flat = surfaces.plane >= 0
    mixed = pairs[flat[pairs[:, 0]] != flat[pairs[:, 1]]]
    turned = flat[mixed[:, 0]]
    curved, planes = np.where(turned[:, None], mixed[:, ::-1], mixed).T
    columns = np.zeros(len(flat), dtype=np.int64)
    asked = distinct(planes)
    columns[asked] = 1 + np.arange(len(asked))
    bits = np.zeros((len(surfaces.sheet_of), 1 + len(asked)), dtype=np.uint8)
    for sheets, own in _asked(surfaces, curved, planes):
        size = int(surfaces.shapes[sheets[0]].prod())
        rows = surfaces.start[sheets][:, None, None] + np.arange(size)
        bits[rows, columns[own][:, None]] = _bits(surfaces, sheets, own, room)
    return PlaneSides(bits, columns)


def _asked(
    surfaces: Surfaces, curved: Integers, planes: Integers
) -> list[tuple[list[int], Integers]]:
    """Return sheets that are made alike, and the planes that are asked for of all of these.

    Sheets with poles of no positive weight are left out.
    """
    groups: dict[tuple[object, ...], tuple[list[int], Integers]] = {}
    for index in distinct(curved).tolist():
        own, patches = planes[curved == index], surfaces.sheets[index].patches
        if (patches.poles[..., 3] > 0).all():
            key = own.tobytes(), patches.making
            groups.setdefault(key, ([], own))[0].append(index)
    return list(groups.values())


def _bits(
    surfaces: Surfaces, sheets: list[int], planes: Integers, room: float
) -> NDArray[np.uint8]:
    """Return on which sides of some sheets' planes the patches of others are.

    These are made alike; (sheets, planes, patches).
    """
    patches = surfaces.sheets[sheets[0]].patches
    poles = np.array([surfaces.sheets[i].patches.poles for i in sheets])
    origin, normal = (part[planes] for part in surfaces.planes)
    # heights times weights
    equations = np.column_stack((normal, -(normal * origin).sum(axis=1)))
    shape = len(sheets), len(planes), *poles.shape[1:3]
    heights = product(equations, poles.reshape(-1, 4).T).reshape(shape[1], shape[0], *shape[2:])
    heights = heights.transpose(1, 0, 2, 3).reshape(-1, *shape[2:])
    rooms = np.repeat(room * poles[..., 3], len(planes), axis=0)
    faces = surfaces.plane[planes]
    free = np.concatenate([_free(surfaces, index, faces) for index in sheets])
    result = np.zeros((len(heights), *patches.shape), dtype=np.uint8)
    for bit, height in ((_ABOVE, heights), (_BELOW, -heights)):
        there = _of_patches(free | (height > rooms), patches)
        result |= np.where(there, np.uint8(bit), np.uint8(0))
    edges = surfaces.borders[0][faces]
    for side, (axis, end) in enumerate(_ROWS):
        row: NDArray[np.uint8] = np.moveaxis(result, 1 + axis, 0)[end]
        common = edges[:, surfaces.edges[sheets, side]].T.ravel()
        some = np.flatnonzero((row == 0).any(axis=1) & common)
        if len(some) and patches.matrices is not None:
            row[some] |= _finer(patches, axis, end, heights[some], free[some], rooms[some])
    return result.reshape(*shape[:2], -1)


def _finer(
    patches: Patches, axis: int, end: int, heights: Array, free: Booleans, rooms: Array
) -> NDArray[np.uint8]:
    """Return the bits of the patches along one side (k, m), of heights times weights (k, N, M).

    `rooms` are the heights that do not count. Away from the side patches are held by their own
    control points: poles may be far ahead.
    """
    assert patches.matrices is not None
    index, matrix = patches.index[axis][end], patches.matrices[axis][end]
    rooms, heights = (matrix @ np.moveaxis(x, 1 + axis, 1)[:, index] for x in (rooms, heights))
    free = np.asarray(np.moveaxis(free, 1 + axis, 1))
    # inside poles are free along a whole side only; on its own sides a patch has the poles
    inside: Booleans = np.asarray(free[:, index[1:-1]].all(axis=1) & (len(index) > 2))
    own = np.repeat(inside[:, None], len(index), axis=1)
    for last in (0, -1):
        if last == end or len(patches.index[axis]) == 1:
            own[:, last] = free[:, index[last]]
    result = np.zeros((len(heights), len(patches.index[1 - axis])), dtype=np.uint8)
    for bit, height in ((_ABOVE, heights), (_BELOW, -heights)):
        within: Booleans = np.asarray((own | (height > rooms)).all(axis=1))
        there = within[:, patches.index[1 - axis]].all(axis=2)
        result |= np.where(there, np.uint8(bit), np.uint8(0))
    return result


def _of_patches(poles: Booleans, patches: Patches) -> Booleans:
    """Say for which patches (k, n, m) something is so of all poles that they are made of."""
    rows, columns = patches.index
    along = np.asarray(poles[:, rows].all(axis=2))
    return np.asarray(along[:, :, columns].all(axis=3))


def _free(surfaces: Surfaces, index: int, faces: Integers) -> Booleans:
    """Say which poles lie on sides or corners that plane faces have too, (faces, N, M)."""
    shape = surfaces.sheets[index].patches.poles.shape[:2]
    result = np.zeros((len(faces), *shape), dtype=bool)
    edges, vertices = surfaces.borders
    for side, (axis, end) in enumerate(_ROWS):
        edge, ends = surfaces.edges[index, side], surfaces.vertices[index, side]
        poles: Booleans = np.moveaxis(result, 1 + axis, 0)[end]
        there = vertices[faces, ends[0]] if edge == POINT else edges[faces, edge]
        poles |= there[:, None]
        poles[:, 0] |= vertices[faces, ends[0]]
        poles[:, -1] |= vertices[faces, ends[1]]
    return result
