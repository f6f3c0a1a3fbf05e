"""The types of arrays: one name for each kind of entry, whatever its width."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: coordinates, lengths, parameters, coefficients
Array = NDArray[np.float64]
#: numbers of nodes, cells, faces; counts
Integers = NDArray[np.integer]
#: one answer per entry
Booleans = NDArray[np.bool_]
