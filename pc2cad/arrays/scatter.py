"""Places that are spread evenly and stand in no regular row, the same ones at every call."""

from __future__ import annotations

from typing import Final

import numpy as np

from pc2cad.arrays import Array

#: steps by number of directions: powers of the inverse of the number x for which x^(d+1) = x + 1
_STEPS: Final = {
    1: ((5**0.5 - 1) / 2,),
    2: (0.7548776662466927, 0.5698402909980532),
    3: (0.8191725133961645, 0.6710436067037893, 0.5497004779019703),
}


def scattered(count: int, directions: int, start: float = 0.5) -> Array:
    """Return places (count, directions) in the unit box, of 1 to 3 directions.

    Multiples of irrational steps (Roberts' sequence, of the golden ratio along a line): however
    many are taken they leave no large gap, and the zeros of no wave are among them.
    """
    steps = np.outer(np.arange(1, count + 1), _STEPS[directions])
    return np.asarray((start + steps) % 1.0)
