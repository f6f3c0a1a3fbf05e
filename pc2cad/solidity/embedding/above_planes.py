"""Which parts of sheets are on one side of a plane face's plane, told by poles alone.

Inside a patch all poles that it is made of have positive factors, and at an end of its sheet, where
knots are clamped, the first (or last) ones only. So where all poles are above a plane, but for
those of sides and corners that the plane face has too, the patch meets that face there only. No
patch is made for that, and a block of patches is above where all of them are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pc2cad.arrays import Booleans, Integers
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
    for index in distinct(curved).tolist():
        own = planes[curved == index]
        start = int(surfaces.start[index])
        rows = slice(start, start + int(surfaces.shapes[index].prod()))
        bits[rows, columns[own]] = _bits(surfaces, index, own, room).T
    return PlaneSides(bits, columns)


def _bits(surfaces: Surfaces, index: int, planes: Integers, room: float) -> NDArray[np.uint8]:
    """Return on which sides of some sheets' planes the patches of one are, (planes, patches)."""
    patches = surfaces.sheets[index].patches
    origin, normal = (part[planes] for part in surfaces.planes)
    weights = patches.poles[..., 3]
    result = np.zeros((len(planes), *patches.shape), dtype=np.uint8)
    if (weights > 0).all():
        # heights times weights
        equations = np.column_stack((normal, -(normal * origin).sum(axis=1)))
        heights = product(equations, patches.poles.reshape(-1, 4).T).reshape(-1, *weights.shape)
        free = _free(surfaces, index, surfaces.plane[planes])
        for bit, height in ((_ABOVE, heights), (_BELOW, -heights)):
            there = _of_patches(free | (height > room * weights), patches)
            result |= np.where(there, np.uint8(bit), np.uint8(0))
    return result.reshape(len(planes), -1)


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
