"""Distinct and middle values without the masked arrays that NumPy loads for its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pc2cad.arrays import AnyArray, Integers


def distinct(values: AnyArray | Sequence[float]) -> AnyArray:
    """Return the distinct numbers of an array or a list, (n,), ascending.

    As `numpy.unique` does, which loads numpy.ma at its first call: more than all of a small part's
    numbers take.
    """
    ordered = np.sort(np.asarray(values), axis=None)
    first = np.ones(len(ordered), dtype=bool)
    np.not_equal(ordered[1:], ordered[:-1], out=first[1:])
    return ordered[first]


def ranked(values: AnyArray, share: float) -> float:
    """Return the number that a share of an array does not exceed: 0.5 is the upper median."""
    place = min(int(share * values.size), values.size - 1)
    return float(np.partition(values, place, axis=None)[place])


def distinct_rows(*columns: AnyArray) -> tuple[Integers, Integers]:
    """Return places of different rows of a table, and for each row which of these it is."""
    first = code = np.zeros(len(columns[0]), dtype=np.int64)
    for column in columns:
        values, index = np.unique(column, return_inverse=True)
        # numbered anew each time: no product of counts is too large
        _, first, code = np.unique(
            code * len(values) + index, return_index=True, return_inverse=True
        )
    return first, code
