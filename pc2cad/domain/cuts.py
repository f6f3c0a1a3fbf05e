"""The same solid cut into more pieces, for a receiver that needs them smaller."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

from pc2cad.domain.analysis import Analysis, recut
from pc2cad.topology.cells import DIRECTIONS, normal_direction


def halved(analysis: Analysis) -> Analysis:
    """Return the same solid with each direction in which its faces close cut in the middle.

    No face then comes round to itself. Where none does, as in a direction of several pieces, the
    analysis itself.
    """
    closed = {
        normal_direction(side.patch)
        for side in analysis.boundary.sides
        if side.partner not in (None, side.patch)
    }
    places = tuple(
        {(Fraction(row[0]) + Fraction(row[1])) / 2} if d in closed and len(row) == 2 else set()
        for d, row in enumerate(analysis.bounds)
    )
    return recut(analysis, places)


def parted(analysis: Analysis, direction: int) -> Analysis:
    """Return the same solid with each piece of a direction cut in the middle.

    Plane faces end there as others do.
    """
    row = analysis.bounds[direction]
    middles = {(Fraction(a) + Fraction(b)) / 2 for a, b in pairwise(row)}
    cut = recut(analysis, tuple(middles if d == direction else set() for d in DIRECTIONS))
    apart = list(cut.apart)
    apart[direction] = tuple(sorted({*apart[direction], *map(float, middles)}))
    return replace(cut, apart=tuple(apart))
