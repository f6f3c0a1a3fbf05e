"""Values of functions in pieces on arrays: in which piece places are, and polynomials there."""

from __future__ import annotations

from typing import Any

import numpy as np

from pc2cad.arrays import Array

Value = Any  # a float or an array of any broadcastable shape
#: the piece in which each place is, the place from that piece's start, the first and the last piece
Located = tuple[Value, Value, int, int]
#: of each piece: which of the operands its coefficients are
Rows = list[tuple[int, ...]]
#: coefficients of functions in pieces that are looked up in one call
MOST_LOOKED_UP = 1 << 16


def locate(knots: Array, closed: bool, t: Value) -> Located:
    """Return where places are among the pieces of a function."""
    if closed:
        # the closing break belongs to the last piece of its own turn, so that one-sided
        # derivatives at the end of a domain are those from inside
        inside = (t >= knots[0]) & (t <= knots[-1])
        t = np.where(inside, t, (t - knots[0]) % (knots[-1] - knots[0]) + knots[0])
    index = np.searchsorted(knots[1:-1], t, side="right")
    first, last = (int(index.min()), int(index.max())) if np.size(index) else (0, 0)
    return index, t - knots[index], first, last


def rows_of(before: tuple[int, ...], width: int) -> tuple[Rows, tuple[int, ...]]:
    """Return the rows of a function in pieces, and its operands, each taken once."""
    flat = before[1:]
    rows, kept = numbered([flat[i : i + width] for i in range(0, len(flat), width)])
    return rows, (before[0], *kept)


def numbered(rows: Rows) -> tuple[Rows, tuple[int, ...]]:
    """Return rows of places in a list of what they hold, and that list."""
    kept = {k: i for i, k in enumerate(dict.fromkeys(k for row in rows for k in row))}
    return [tuple([kept[k] for k in row]) for row in rows], tuple(kept)


def from_table(table: Array, located: Located) -> Value:
    """Return the values from a table of coefficients, (width, pieces)."""
    index, local, first, last = located
    value: Value = None
    if first == last:
        for coefficient in table[::-1, first].tolist():
            value = coefficient if value is None else value * local + coefficient
        return value if len(table) > 1 else np.full(np.shape(local), value)
    together = index.size * table.shape[0] <= MOST_LOOKED_UP
    rows: Array = table.take(np.asarray(index), axis=1) if together else table
    for row in rows[::-1]:
        coefficient = row if together else row.take(index)
        value = coefficient if value is None else value * local + coefficient
    return value


def from_rows(rows: Rows, start: int, located: Located, *values: Value) -> Value:
    """Return the values from coefficients of the pieces from `start` on."""
    index, local, first, last = located
    value: Value = None
    for k in reversed(range(len(rows[0]))):
        column = [row[k] for row in rows[first - start : last - start + 1]]
        coefficient = values[column[0]]
        if any(which != column[0] for which in column):
            here = np.array(column)[index - first]
            for which in dict.fromkeys(column):
                if which != column[0]:
                    coefficient = np.where(here == which, values[which], coefficient)
        value = coefficient if value is None else value * local + coefficient
    # what is constant in one piece has the shape of the place as well
    return value if len(rows[0]) > 1 else value + np.zeros(np.shape(local))
