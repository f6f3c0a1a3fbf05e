"""Cusps inside a direction: lines of the box along which M turns back.

Where ∂M/∂u vanishes for all v and w, and points the other way behind, sections have a cusp: a
kernel takes no face with one inside, so it is a break. Along one line of the box enclosures are
asked wherever the tangent shortens fast, and what is found there is held against other lines.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import squares
from pc2cad.domain.map import Mapping3
from pc2cad.expression.breaks import SAME_POSITION, Break
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.intervals import Interval
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.polynomials import polynomials
from pc2cad.expression.tree import ZERO

#: values of the other two parameters: of the line that is searched, then of those that are asked
_LINES = ((0.4142135, 0.7320508), *product((0.11, 0.53, 0.87), (0.23, 0.61, 0.94)))
_FIRST_LINE = np.array(_LINES[0])[:, None]
#: parts of the line at first, what is left of the tangent from one to the next where they are
#: looked at closely, and how often these are halved
_PARTS, _FAST, _HALVINGS = 256, 0.7, 36
#: more parts than this in which the tangent may vanish are no cusps
_MOST_PARTS = 128
#: steps to both sides of a place, as shares of the line
_BESIDE = (1e-3, 1e-5)
#: length of the tangent, as a share of its largest, that is none
_NONE = 1e-9


def with_joints(
    breaks: tuple[tuple[Break, ...], ...], mapping: Mapping3
) -> tuple[tuple[Break, ...], ...]:
    """Return the breaks of u, v and w with those where parts of the map meet."""
    rows = []
    for row, places in zip(breaks, mapping.joints, strict=True):
        found = {b.position: b for b in row}
        for place in map(float, places):
            same = next((p for p in found if abs(p - place) < SAME_POSITION), place)
            found[same] = Break(same, 0)
        rows.append(tuple(found[p] for p in sorted(found)))
    return tuple(rows)


def with_cusps(
    breaks: tuple[tuple[Break, ...], ...], mapping: Mapping3
) -> tuple[tuple[Break, ...], ...]:
    """Return the breaks of u, v and w, ascending, with those at cusps."""
    result = list(breaks)
    for direction, slow in _slow_parts(mapping).items():
        row = breaks[direction]
        places = [
            place
            for place in _along(mapping, direction, slow, [b.position for b in row])
            if all(abs(place - b.position) > SAME_POSITION for b in row)
        ]
        both = [*row, *(Break(place, 0) for place in places)]
        result[direction] = tuple(sorted(both, key=lambda b: b.position))
    return tuple(result)


def _along(mapping: Mapping3, direction: int, slow: Array, known: list[float]) -> tuple[float, ...]:
    found: list[float] = []
    for low, high in _vanishing(mapping, direction, slow, known):
        place = _turning_point(mapping, direction, low, high)
        if place is not None and all(abs(place - other) > SAME_POSITION for other in found):
            found.append(place)
    return tuple(sorted(found))


def _has_even_coordinate(mapping: Mapping3, direction: int) -> bool:
    """Say whether a coordinate moves evenly along a direction: its slope is not 0 between sides."""
    found = polynomials(mapping.coordinates)
    if found is not None:
        return any(f and not any([p[direction] for p in f]) for f in found.tangents[direction])
    slopes = mapping.derivatives[direction]
    return any([PARAMETERS[direction] not in x.symbols and x is not ZERO for x in slopes])


def _slow_parts(mapping: Mapping3) -> dict[int, Array]:
    """Return by direction where parts of the first line begin in which the tangent shortens fast.

    It does so before it vanishes, unless it comes back between two of the places that are looked
    at: enclosures of all parts are dear. Directions in which there are none are left out.
    """
    directions = [d for d in range(3) if not _has_even_coordinate(mapping, d)]
    if not directions:
        return {}
    at, count = np.arange(1, _PARTS) / _PARTS, _PARTS - 1
    # the lines one after the other: one call takes less, and its program serves later stages
    places = np.empty((3, count * len(directions)))
    for k, d in enumerate(directions):
        line = slice(k * count, (k + 1) * count)
        places[[x for x in range(3) if x != d], line] = _FIRST_LINE
        places[d, line] = at
    _, *tangents = mapping.frame(*places)
    found = {}
    for k, d in enumerate(directions):
        tangent = tangents[d][k * count : (k + 1) * count]
        lengths = np.sqrt(squares(tangent))
        first, second = lengths[:-1], lengths[1:]
        fast = ~(np.minimum(first, second) > _FAST * np.maximum(first, second))
        if fast.any():
            fast[:-1] |= fast[1:]
            fast[1:] |= fast[:-1]
            found[d] = at[:-1][fast]
    return found


def _vanishing(
    mapping: Mapping3, direction: int, low: Array, known: list[float]
) -> list[tuple[float, float]]:
    """Return the shortest parts of the first line in which the tangent may vanish.

    Parts that begin at `low` are looked at. At breaks that are `known` it jumps: parts end beside
    them.
    """
    if len(low) > _MOST_PARTS:
        return []
    low, high = _cut(low, low + 1 / _PARTS, known)
    ask = IntervalProgram(mapping.derivatives[direction])
    others = [d for d in range(3) if d != direction]
    boxes = {
        PARAMETERS[d]: Interval(np.array(x), np.array(x))
        for d, x in zip(others, _LINES[0], strict=True)
    }
    for _ in range(_HALVINGS):
        boxes[PARAMETERS[direction]] = Interval(low, high)
        zero = np.ones(len(low), dtype=bool)
        for value in ask(boxes):
            zero &= (value.lower <= 0) & (value.upper >= 0)
        low, high = low[zero], high[zero]
        if not 0 < len(low) <= _MOST_PARTS:
            return []
        middle = (low + high) / 2
        low, high = (np.stack(x, axis=1).ravel() for x in ((low, middle), (middle, high)))
    return _joined(low, high)


def _cut(low: Array, high: Array, known: list[float]) -> tuple[Array, Array]:
    """Return parts cut at known places, which they no longer hold."""
    for place in known:
        inside = (low <= place) & (place <= high)
        low = np.concatenate((low, np.full(inside.sum(), place + SAME_POSITION)))
        high = np.concatenate((np.where(inside, place - SAME_POSITION, high), high[inside]))
    order = np.argsort(low, kind="stable")
    order = order[low[order] < high[order]]
    return low[order], high[order]


def _joined(low: Array, high: Array) -> list[tuple[float, float]]:
    """Return parts that follow one another as one."""
    parts: list[tuple[float, float]] = []
    for a, b in zip(low.tolist(), high.tolist(), strict=True):
        if parts and a - parts[-1][1] <= 16 * (b - a):
            parts[-1] = (parts[-1][0], b)
        else:
            parts.append((a, b))
    return parts


def _turning_point(mapping: Mapping3, direction: int, low: float, high: float) -> float | None:
    """Return the place in a part of the line where M turns back on all lines, or None."""
    place = _rounded((low + high) / 2)
    if high - low > 1e-6 or not SAME_POSITION < place < 1 - SAME_POSITION:
        return None
    every = np.array(_LINES)
    at = np.array([0.0, *(s * x for x in _BESIDE for s in (-1, 1))]) + place
    spread = np.concatenate((at, np.linspace(0.03, 0.97, 17)))
    places: list[Array] = [spread[None, :]] * 3
    for d, column in zip((d for d in range(3) if d != direction), every.T, strict=True):
        places[d] = column[:, None]
    tangents, *others = mapping.tangents(
        ((direction), *(d for d in range(3) if d != direction)), *places
    )
    lengths = np.linalg.norm(tangents, axis=-1)
    if not (np.isfinite(lengths).all() and (lengths[:, 0] <= _NONE * lengths.max(axis=1)).all()):
        return None
    before, behind = slice(1, 5, 2), slice(2, 5, 2)
    cosine = (tangents[:, before] * tangents[:, behind]).sum(axis=-1)
    back = cosine < -0.5 * lengths[:, before] * lengths[:, behind]
    # where det J changes its sign as well, it is a fold
    volume = (tangents * np.cross(others[0], others[1])).sum(axis=-1)
    return place if (back & (volume[:, before] * volume[:, behind] > 0)).all() else None


def _rounded(place: float) -> float:
    """Return the simplest fraction that is a place but for rounding, or the place."""
    for denominator in (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 20, 24, 30, 36, 60, 100):
        whole = round(place * denominator) / denominator
        if abs(whole - place) <= 1e-11:
            return whole
    return place
