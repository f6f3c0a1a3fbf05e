"""Names of the array types, and products whose last bits do not depend on threads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: coordinates, lengths, parameters, coefficients
Array = NDArray[np.float64]
#: numbers of nodes, cells, faces; counts
Integers = NDArray[np.integer]
#: one answer per entry
Booleans = NDArray[np.bool_]
