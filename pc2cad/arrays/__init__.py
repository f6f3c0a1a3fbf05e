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

# glibc gives memory of arrays from 128 kB on back to the system, and what is free at the top of its
# heap, and the system clears every page of it anew for the next array: for a channel some 1,500
# pages, a twentieth of its time. It learns from the largest array that is let go (mallopt(3),
# ``M_MMAP_THRESHOLD``), so it is shown one of 4 MB, no page of which is touched.
np.empty(1 << 19)
