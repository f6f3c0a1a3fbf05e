"""The winding number about a place near the boundary: cells are cut until none may hold it.

Faces and their meshes go equally often round a place that lies in no box round a cell and its part
of the face: the one can be drawn to the other within these boxes.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.solidity.cell_table import CellTable
from pc2cad.solidity.face_mesh import corners_of
from pc2cad.solidity.winding_number import ray_frame, winding_numbers

#: a cell is cut into so many parts along both parameters, and each that stays near into these
FIRST, THEN = 64, 8
#: how far a part may leave the box of nine of its points, in terms of the box's largest extent
BOW: Final = 0.25
#: parts near a ray that are cut again
MOST: Final = 4000
#: parts with less extent than this many roundings of coordinates are places
ROUNDINGS: Final = 64


def told_number(table: CellTable, place: Array, cells: Integers, seed: int) -> int:
    """Return how often the faces go round a place (3,), from the cells that its ray may meet.

    Where rounding does not tell the place from one of the boundary, or a whole curve of parts stays
    near, as about a pole, it is what the finest mesh says.
    """
    turned = place @ ray_frame(seed)
    least = ROUNDINGS * float(np.spacing(max(table.reach, np.abs(place).max())))
    near, count = [table.parts(cells)], FIRST
    while True:
        number, held, nearer = 0, 0.0, []
        for parts in near:
            for few, samples in table.grids(parts, 2 * count):
                inner = few.divided(count)
                triangles = table.outward(corners_of(samples), inner.face)
                number += int(winding_numbers(place[None], triangles, seed)[0])
                low, high = _boxes(samples, seed)
                within: Booleans = (low <= turned) & (turned <= high)
                met = within[:, 0] & within[:, 1]
                nearer.append(inner.chosen(met))
                extent = (high - low).max(axis=1)[met & within[:, 2]]
                held = max(held, float(extent.max(initial=0.0)))
        if held <= least or sum(len(parts.face) for parts in nearer) > MOST:
            return number
        near, count = nearer, THEN


def _boxes(samples: Array, seed: int) -> tuple[Array, Array]:
    """Return the boxes, in the frame of the rays, of cells of samples (n, 2c+1, 2c+1, 3)."""
    turned = samples @ ray_frame(seed)
    rows = [slice(k, k + samples.shape[1] - 2, 2) for k in range(3)]
    nine = np.stack([turned[:, i, j] for i in rows for j in rows]).reshape(9, -1, 3)
    low, high = nine.min(axis=0), nine.max(axis=0)
    pad = BOW * (high - low).max(axis=1, keepdims=True)
    return low - pad, high + pad
