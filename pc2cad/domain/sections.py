"""Places at which functions along a direction are looked at."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pc2cad.arrays import Array


@lru_cache(maxsize=8)
def sections(density: int = 1) -> Array:
    """Return ascending places along a direction: both ends, and 13 Gauss nodes or more between."""
    nodes = (np.polynomial.legendre.leggauss(13 * density)[0] + 1) / 2
    places = np.concatenate(([0.0], nodes, [1.0]))
    places.flags.writeable = False
    return places


SECTIONS = sections()
