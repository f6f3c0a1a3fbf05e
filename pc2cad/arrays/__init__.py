"""Names of the array types, products whose last bits do not depend on threads, and places."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: coordinates, lengths, parameters, coefficients
Array = NDArray[np.float64]
#: numbers of nodes, cells, faces; counts
Integers = NDArray[np.integer]
#: one answer per entry
Booleans = NDArray[np.bool_]
#: arrays of any kind of number, on their way into a file or out of a library
AnyArray = NDArray[Any]
#: rows, columns and colours of a picture, 0 to 255
Pixels = NDArray[np.uint8]
#: integers without limit, as objects of Python
BigIntegers = NDArray[np.object_]
