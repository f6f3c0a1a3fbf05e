"""Where sides have to be cut, so that what coincides are whole cells.

A side may coincide with another one, or with itself, after a shift along a direction in which it
closes (the end of a ring whose section comes round to itself after a part of a turn), or after a
reflection (a side folded onto a slit between its two halves). The topology room compares whole
cells; so the direction is cut at the multiples of the shift, or at the lines that stay in place.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import combinations_with_replacement

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.domain.closed_sides import (
    ACROSS,
    BEFORE,
    COUNT,
    NEXT,
    TRIED,
    UNIFORM,
    ClosedSide,
    Side,
    all_closed,
    closes,
    farthest,
    few_points,
)
from pc2cad.domain.map import Mapping3
from pc2cad.domain.pieces import span_at
from pc2cad.geometry.scale import Scale
from pc2cad.topology.cells import (
    DIRECTIONS,
    Cell,
    directions_of,
    normal_direction,
    patch_edges,
)
from pc2cad.topology.complex import BoundaryComplex

#: steps of Newton's method, and what is left of a distance after them, in units of "same point"
_STEPS, _LEFT = 12, 100
#: steps after which a distance that is not halved is left: it is rounding, or that of no meeting
_SURE = 3
#: sections of more equal parts than this are not looked for
MOST_PARTS = 64
#: a side by its normal and its limit, and a direction along it
_Way = tuple[int, float, int]
#: by pieces across, the edge in which one begins or ends and whether it has the edge's direction
_Ends = dict[int, tuple[int, bool]]
#: means over a period differ less than this share of the extent where sides may coincide
_ALIKE = 0.02


def shifts(
    mapping: Mapping3,
    sides: Iterable[Cell],
    scale: Scale,
    boundary: BoundaryComplex | None = None,
) -> tuple[set[Fraction], ...]:
    """Return, per direction, where it has to be cut for sides that coincide after a shift.

    `sides` are the cells (pieces) of the sides that bound the solid so far; where these are a
    closed `boundary`, its edges tell of many that they do not close.
    """
    limits = {(d, float(p > 0)) for cell in sides for d, p in enumerate(cell) if p % 2 == 0}
    found: tuple[set[Fraction], ...] = (set(), set(), set())
    ways = [(d, limit, along) for along in DIRECTIONS for d, limit in sorted(limits) if d != along]
    known = _told(boundary) if boundary is not None else dict[_Way, bool]()
    if any([way not in known for way in ways]):
        few = few_points(mapping)
        known = {(d, x, way): closes(few[way][d, x], scale) for d, x, way in ways} | known
    for along in DIRECTIONS:
        closing = [Side(mapping, *way) for way in ways if way[2] == along and known[way]]
        searches = _searches(all_closed(closing), scale) if closing else []
        _follow(searches)
        for search in searches:
            found[along].update(_cuts(search))
    return found


def _told(boundary: BoundaryComplex) -> dict[_Way, bool]:
    """Return which sides close along which directions, as far as a closed boundary tells.

    They do not where a piece across begins in another edge, or in another point, than it ends in;
    they do where all pieces begin in the edge, the same way round, or the point that they end in.
    """
    begin, end = defaultdict[_Way, _Ends](dict), defaultdict[_Way, _Ends](dict)
    for face in boundary.faces:
        normal = normal_direction(face.patch)
        for use, edge in zip(face.uses, patch_edges(face.patch), strict=True):
            along, across = 3 - normal - edge.direction, edge.cell[edge.direction]
            way, place = (normal, float(face.patch[normal] > 0), along), edge.cell[along]
            if place in (0, 2 * (len(boundary.labels[along]) - 1)):
                (end if place else begin)[way][across] = (
                    (~use.vertex, True) if use.edge is None
                    else (use.edge, use.forward == edge.forward)
                )  # fmt: skip
    told = dict[_Way, bool]()
    for way, ends in end.items():
        starts, pieces = begin[way], len(boundary.labels[3 - way[0] - way[2]]) - 1
        if any([across in starts and starts[across][0] != ends[across][0] for across in ends]):
            told[way] = False
        elif len(ends) == pieces and starts == ends:
            told[way] = True
    return told


def folds(
    mapping: Mapping3, sides: Iterable[Cell], bounds: Sequence[Sequence[float]], scale: Scale
) -> tuple[set[Fraction], ...]:
    """Return, per direction, where pieces of sides have to be cut that are folded onto themselves.

    `bounds` are the ascending limits of the pieces of each direction.
    """
    found: tuple[set[Fraction], ...] = (set(), set(), set())
    for cell in sides:
        for along in directions_of(cell):
            (normal,) = (d for d in DIRECTIONS if cell[d] % 2 == 0)
            side = Side(mapping, normal, float(cell[normal] > 0), along)
            low, high = span_at(bounds[along], cell[along])
            other = 3 - along - normal
            first, last = span_at(bounds[other], cell[other])
            across = first + (last - first) * ACROSS
            there, back = low + (high - low) * TRIED, high - (high - low) * TRIED
            points = side(there, across)
            is_one = np.abs(points - side(back, across)).max() <= scale.same_point
            if is_one and np.abs(points - points[:1]).max() > 1000 * scale.same_point:
                found[along].add((Fraction(low) + Fraction(high)) / 2)
    return found


def _searches(closed: Sequence[ClosedSide], scale: Scale) -> list[_Search]:
    """Return the searches for shifts and reflections of sides, or pairs, whose means are alike."""
    means = np.stack([side.mean for side in closed])
    limits = np.array([_ALIKE * side.extent for side in closed])[:, None]
    alike = [
        np.abs(means[:, None] - there).max(axis=(2, 3)) <= limits
        for there in (means, means[:, ::-1])
    ]
    pairs = [
        (first, second, turned)
        for (i, first), (j, second) in combinations_with_replacement(enumerate(closed), 2)
        for turned in (False, True)
        if alike[turned][i, j]
    ]
    if not pairs:
        return []
    there = np.stack([b.points[:, ::-1] if turned else b.points for _, b, turned in pairs])
    away = farthest(there - np.stack([a.tried[:1] for a, _, _ in pairs]))
    lowest = (away <= away[:, BEFORE]) & (away <= away[:, NEXT])
    lowest &= away <= np.stack([b.reach for _, b, _ in pairs])
    return [_Search(*pair, scale, row) for pair, row in zip(pairs, lowest, strict=True)]


class _Search:
    """The places along a side at which it goes through two points (2, 3) of the same or another.

    The points are those of the first side at the first place that is tried.
    """

    def __init__(
        self, first: ClosedSide, second: ClosedSide, turned: bool, scale: Scale, lowest: Booleans
    ) -> None:
        """Begin at the uniform places where the distance is lowest, and may be none."""
        self.first, self.second, self.scale = first.side, second.side, scale
        self.across = ACROSS[::-1] if turned else ACROSS
        self.closed, self.turned = second, turned
        self.points = first.tried
        #: places at which the points are met, in the end
        self.met: list[float] = []
        if first is second and not turned:
            # it meets itself there
            self.met.append(float(TRIED[0]))
            lowest = lowest & (np.abs(UNIFORM - TRIED[0]) > 1 / COUNT)
        self.at = UNIFORM[lowest]
        self.is_over = not lowest.any()
        self._off = np.full(len(self.at), np.inf)

    def step(self, k: int, points: Array, slope: Array) -> None:
        """Take the step of Newton's method of a number."""
        rest = points - self.points[0]
        before, self._off = self._off, np.abs(rest).max(axis=(1, 2))
        if k > _SURE and not (self._off < 0.5 * before).any():
            self.is_over = True
            return
        with np.errstate(all="ignore"):
            step = (rest * slope).sum(axis=(1, 2)) / (slope * slope).sum(axis=(1, 2))
        moved = (self.at - np.clip(step, -0.01, 0.01)) % 1
        self.at = np.where(np.isfinite(step), moved, self.at)

    def close(self, points: Array) -> None:
        """Keep the places at which the points are met, of those whose points are given."""
        left = np.abs(points - self.points[0]).max(axis=(1, 2))
        self.met += [float(x) for x in self.at[left <= _LEFT * self.scale.same_point]]


def _follow(searches: Sequence[_Search]) -> None:
    """Take the steps of searches along one direction, those across one normal together."""
    alike = all(s.second.mapping.is_alike_together for s in searches)
    groups: dict[int, list[_Search]] = {}
    for i, search in enumerate(search for search in searches if not search.is_over):
        groups.setdefault(search.second.normal if alike else -1 - i, []).append(search)
    for k in range(_STEPS):
        for group in groups.values():
            going = [search for search in group if not search.is_over]
            if going:
                for search, line in zip(going, zip(*_lines(going), strict=True), strict=True):
                    search.step(k, *line)
    for group in groups.values():
        for search, points in zip(group, _lines(group, still=True)[0], strict=True):
            search.close(points)


def _lines(searches: Sequence[_Search], still: bool = False) -> list[list[Array]]:
    """Return points and derivatives (n, 2, 3) at the places of searches across one normal.

    Points alone where they stand still.
    """
    side = searches[0].second
    other = 3 - side.along - side.normal
    counts = [len(search.at) for search in searches]
    grid = [np.empty(0)] * 3
    grid[side.along] = np.concatenate([search.at for search in searches])[:, None]
    grid[side.normal] = np.repeat([search.second.limit for search in searches], counts)[:, None]
    grid[other] = np.repeat([search.across for search in searches], counts, axis=0)
    axes = (side.along, other, side.normal)
    u, v, w = (np.moveaxis(x[..., None], (0, 1, 2), axes) for x in grid)
    mapping = side.mapping
    found = [mapping.points(u, v, w)] if still else mapping.line(side.along, u, v, w)
    ends = np.cumsum(counts)[:-1]
    return [np.split(side.ordered(values), ends) for values in found]


@lru_cache(maxsize=64)  # a side always meets itself at the first place that is tried
def _simple(shift: float) -> Fraction:
    """Return the nearest fraction of few parts, less than 1."""
    return Fraction(shift).limit_denominator(MOST_PARTS) % 1


def _cuts(search: _Search) -> set[Fraction]:
    """Return where a direction has to be cut for two sides (or one) to coincide cell by cell."""
    second, points, own = search.second, search.points, search.first == search.second
    near = _LEFT * search.scale.same_point
    found: set[Fraction] = set()
    for place in search.met:
        for reverse in (False, True):
            shift = (place + TRIED[0] if reverse else place - TRIED[0]) % 1
            part = _simple(shift)
            if abs((float(part) - shift + 0.5) % 1 - 0.5) > 1e-9:
                if not reverse:
                    continue
                # lines that a reflection leaves in place may lie anywhere
                part = Fraction(shift)
            elif part == 0 and not reverse:
                continue
            moved = (float(part) - TRIED if reverse else float(part) + TRIED) % 1
            if not search.closed.may_meet(points, moved, search.turned):
                continue
            if np.abs(second(moved, search.across) - points).max() > near:
                continue
            if not reverse:
                found.update(Fraction(k, part.denominator) for k in range(1, part.denominator))
            else:
                found.update({part, *((part / 2, (part + 1) / 2) if own else ())})
    return {place for place in found if 0 < place < 1}
