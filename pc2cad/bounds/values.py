"""What the ranges of values alone say of a function on cells, where it is continuous and no more.

Beside the corner at which a root vanishes no disc is free of it, however small. But where all
values are within r of a middle, an interpolant of them is within Λ r of it, and so off by (1 + Λ) r
at most: on small enough cells that is little.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.bounds.cells import Cells
from pc2cad.bounds.taylor_models import UNIT
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.intervals import Interval
from pc2cad.expression.tree import Expr


def ranges(
    vectors: Sequence[Sequence[Expr]], names: Sequence[str], cells: Sequence[Cells],
    wanted: Booleans,
) -> tuple[Array, Array]:  # fmt: skip
    """Return how far vectors are from the middles of their ranges, and their sizes, (k, n, m) each.

    Values that are computed in double precision lie in the ranges as well, at parameters that are
    off by 4 units. Cells (n, m) that are not wanted are inf.
    """
    lines = [np.flatnonzero(wanted.any(axis=1 - axis)) for axis in range(len(names))]
    boxes = {}
    for axis, (name, row, line) in enumerate(zip(names, cells, lines, strict=True)):
        shape = (-1, 1) if axis == 0 else (1, -1)
        low, high = row.points[line] - 4 * UNIT, row.points[line + 1] + 4 * UNIT
        boxes[name] = Interval(low.reshape(shape), high.reshape(shape))
    flat = iter(IntervalProgram(tuple(tree for row in vectors for tree in row))(boxes))
    found = np.full((2, len(vectors), *wanted.shape), np.inf)
    part = np.ix_(*lines) if len(lines) == 2 else (lines[0], slice(None))
    for k, vector in enumerate(vectors):
        values = [next(flat) for _ in vector]
        widths = (x.upper - x.lower for x in values)
        sizes = (np.maximum(-x.lower, x.upper) for x in values)
        with np.errstate(all="ignore"):
            found[0, k][part] = length(widths) / 2
            found[1, k][part] = length(sizes)
    found[np.isnan(found)] = np.inf
    return found[0], found[1]


def length(coordinates: Iterable[Array]) -> Array:
    """Return the length of a vector of bounds, rounded up."""
    total: Array = np.zeros((1, 1))
    for x in coordinates:
        total = total + x * x
    return np.asarray(np.sqrt(total) * (1 + 1e-9))
