"""Colours that tell sides of the box, or bodies, apart."""

from __future__ import annotations

from typing import Final

from pc2cad.topology.cells import Cell, normal_direction

#: lower and upper side of u, v and w: distinguishable also for colour-blind eyes (Okabe, Ito)
SIDE_COLOURS: Final = (
    ((0.90, 0.62, 0.00), (0.84, 0.37, 0.00)),
    ((0.34, 0.71, 0.91), (0.00, 0.45, 0.70)),
    ((0.00, 0.62, 0.45), (0.80, 0.47, 0.65)),
)


def side_colour(patch: Cell) -> tuple[float, float, float]:
    """Return the colour (red, green, blue in 0…1) of a side of the box, or of a piece of one."""
    direction = normal_direction(patch)
    return SIDE_COLOURS[direction][1 if patch[direction] else 0]


def body_colour(number: int) -> tuple[float, float, float]:
    """Return the colour (red, green, blue in 0…1) of a body of several."""
    return SIDE_COLOURS[number % 3][number // 3 % 2]
