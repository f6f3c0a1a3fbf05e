"""The topology room's questions, answered for all values of some parameters at once.

Yes is an identity of trees in which the parameters are symbols. No is a place of the sides at which
enclosures over all values keep two points apart, farther than rounding could make of one: samples
of any one of the maps say the same. What is neither is open, and so is the boundary then.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.analysis import SampledSides
from pc2cad.domain.map_questions import NODES
from pc2cad.errors import NotASolidError
from pc2cad.expression.centred import CentredProgram
from pc2cad.expression.identity import Verdict
from pc2cad.expression.intervals import Interval, interval
from pc2cad.expression.normal_form import is_identically_zero, normal_form, tree_of
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import (
    ONE,
    ZERO,
    Expr,
    ValueDomainError,
    number,
    ops_of,
    substitute,
    symbol,
)
from pc2cad.geometry.scale import Scale
from pc2cad.topology.cells import Cell, Symmetry, directions_of
from pc2cad.topology.complex import BoundaryComplex
from pc2cad.topology.quotient import derive_boundary

#: what has no creases; of others, sides are in pieces
SMOOTH = frozenset((
    "number", "constant", "symbol", "add", "neg", "mul", "div", "pow", "sqrt", "sin", "cos", "tan",
    "exp", "log", "sinh", "cosh", "tanh", "asin", "acos", "atan",
))  # fmt: skip
#: the limits of the box by name, which stand for those of any one map
LABELS = (("0", "1"),) * 3
#: places along a direction where points are held against one another: some of those of one map
TRIED = NODES[[0, 2, 6, 10, 12]]
#: distances at which points are two, in units of what is too near to be that on one map: what is
#: seen of a map at other places may be larger, and with it what rounding leaves of its points
_ROOM = 10.0
#: terms of a squared distance
_MOST_TERMS = 300

#: a point as trees
_Point = tuple[Expr, ...]
#: values of some of u, v and w
_Place = tuple[tuple[str, float], ...]


class OpenQuestionError(Exception):
    """A question has no one answer that is proved for all values; `name` is most to blame."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.name = name


class FamilySides:
    """The sides of maps that differ in some parameters: x, y and z over the unit box."""

    def __init__(self, coordinates: _Point) -> None:
        self._coordinates = coordinates
        self._is_smooth = ops_of(coordinates) <= SMOOTH
        self.at_places = CentredProgram(coordinates)
        self._same: dict[tuple[_Point, _Point], bool] = {}
        self._distances: dict[tuple[_Point, _Point, _Place], CentredProgram] = {}
        self._cells: dict[tuple[Cell, tuple[Expr, ...] | None], _Point] = {}

    def boundary(self, values: Mapping[str, Interval]) -> BoundaryComplex | None:
        """Return the boundary complex that all maps have whose parameters are in intervals.

        None where the maps have creases, no closed boundary, or no value at one of their sides as
        trees tell it. Raises OpenQuestionError.
        """
        if not self._is_smooth:
            return None
        try:
            with np.errstate(all="ignore"):  # what is not bounded keeps nothing apart
                return derive_boundary(_Answers(self, values), LABELS)
        except (NotASolidError, ValueDomainError):
            return None

    def on(self, cell: Cell, local: tuple[Expr, ...] | None = None) -> _Point:
        """Return the trees on a cell, in other parameters than its own where they are given."""
        key = cell, local
        if key not in self._cells:
            own = directions_of(cell)
            change = {PARAMETERS[d]: ONE if p else ZERO for d, p in enumerate(cell) if d not in own}
            change |= {PARAMETERS[d]: t for d, t in zip(own, local or (), strict=False)}
            self._cells[key] = substitute(self._coordinates, change)
        return self._cells[key]

    def distance(self, first: _Point, second: _Point, place: _Place) -> CentredProgram:
        """Return the squared distance of two points at a place: as it is, and multiplied out."""
        key = first, second, place
        if key not in self._distances:
            there = {name: number(x) for name, x in place}
            pairs = zip(substitute(first, there), substitute(second, there), strict=True)
            square = sum(((x - y) ** 2 for x, y in pairs), start=ZERO)
            form = normal_form(square, _MOST_TERMS)
            self._distances[key] = CentredProgram(
                (square,) if form is None else (square, tree_of(form))
            )
        return self._distances[key]

    def is_one(self, first: _Point, second: _Point) -> bool:
        """Say whether two points are one for all values by algebra."""
        key = first, second
        if key not in self._same:
            pairs = zip(first, second, strict=True)
            self._same[key] = all(a is b or is_identically_zero(a - b) for a, b in pairs)
        return self._same[key]


def own_boundary(sides: SampledSides, known: BoundaryComplex | None) -> BoundaryComplex | None:
    """Return a boundary that is known of a family as that of one of its maps, with its own labels.

    None where the map has creases, or parameters that do not run evenly.
    """
    if known is None or sides.map.even or any(len(row) > 2 for row in sides.bounds):
        return None
    labels = sides.questions.labels
    return known if known.labels == labels else replace(known, labels=labels)


class _Points:
    """Points at places of the box, as functions of the values: centres and slopes with bounds.

    Two points move alike with most parameters: slopes are subtracted before they are bounded.
    """

    def __init__(self, program: CentredProgram, values: Mapping[str, Interval]) -> None:
        count = len(TRIED)
        places = np.stack(np.meshgrid(TRIED, TRIED, TRIED, indexing="ij")).reshape(3, -1)
        boxes = {name: interval(x) for name, x in zip(PARAMETERS, places, strict=True)}
        for name, x in values.items():
            boxes[name] = Interval(*(np.full(count**3, end) for end in (x.lower, x.upper)))
        rows = [
            [entry.centre, *(entry.slopes.get(name, interval(np.zeros(1))) for name in values)]
            for entry in program(boxes)
        ]
        shape = count, count, count
        #: lower and upper ends, by places, (u, v, w, coordinates, 1 + parameters, 2)
        self._table = np.moveaxis(
            np.array([
                [[np.broadcast_to(end, count**3).reshape(shape) for end in (x.lower, x.upper)]
                 for x in row] for row in rows
            ]), (0, 1, 2), (3, 4, 5),
        )  # fmt: skip
        self._names = tuple(values)
        # farther than any value is from the middle
        self._reach = np.array([
            float(max(x.middle - x.lower, x.upper - x.middle)) for x in values.values()
        ]) * (1 + 1e-12)  # fmt: skip

    @property
    def largest(self) -> float:
        """No coordinate is larger at these places."""
        centre, slopes = self._sizes[..., 0], self._sizes[..., 1:]
        return float(np.max(centre + slopes @ self._reach))

    @property
    def _sizes(self) -> Array:
        return np.asarray(np.abs(self._table).max(axis=-1))

    def on(self, cell: Cell) -> Array:
        """Return what is known of the points of a cell: its own directions first."""
        i, j, k = (slice(None) if p % 2 else (-1 if p else 0) for p in cell)
        return np.asarray(self._table[i, j, k])

    def gap(self, first: Array, second: Array) -> tuple[float, str]:
        """Return a lower bound of the largest distance along an axis, and what lessens it most."""
        low = first[..., 0] - second[..., 1]
        high = first[..., 1] - second[..., 0]
        # a few roundings
        slack = 1e-15 * (np.abs(first).max(axis=-1) + np.abs(second).max(axis=-1))
        moved = (np.maximum(-low, high) + slack)[..., 1:] * self._reach
        off = moved.sum(axis=-1) * (1 + 1e-12)
        gaps = np.maximum((low - slack)[..., 0] - off, -(high + slack)[..., 0] - off)
        gaps = np.where(np.isnan(gaps), -np.inf, gaps)
        best = np.unravel_index(int(np.argmax(gaps)), gaps.shape)
        share = np.where(np.isfinite(moved[best]), moved[best], np.inf)
        return float(gaps[best]), self._names[int(np.argmax(share))]


class _Answers:
    """Answers for one box of values (see `topology.questions`)."""

    def __init__(self, sides: FamilySides, values: Mapping[str, Interval]) -> None:
        self._sides, self._values = sides, values
        self._points = _Points(sides.at_places, values)
        largest = self._points.largest
        scale = Scale(2 * math.sqrt(3) * largest, largest)
        self._apart = 1000 * _ROOM * scale.same_point

    def _is_one(
        self, known: tuple[Array, Array], trees: tuple[_Point, _Point], along: tuple[int, ...] = ()
    ) -> bool:
        """Say whether two points are the same at all places; raise OpenQuestionError.

        Given are what is known of both at some places, and both as functions of these, which are
        those of TRIED along some directions.
        """
        gap, name = self._points.gap(*known)
        if gap > self._apart:
            return False
        lengths = np.abs(known[0][..., 0, 0] - known[1][..., 0, 0]).max(axis=-1)
        if not np.all(lengths <= self._apart):
            index = np.unravel_index(int(np.argmax(lengths)), lengths.shape)
            place = zip(along, index, strict=True)
            there = tuple((PARAMETERS[d], float(TRIED[i])) for d, i in place)
            name = self._why_near(*trees, there)
            if not name:
                return False
        elif self._sides.is_one(*trees):
            return True
        raise OpenQuestionError(name)

    def _why_near(self, first: _Point, second: _Point, place: _Place) -> str:
        """Return what keeps two points from being apart at a place, whichever way that is, or ''.

        It is the parameter with which their distance may change most.
        """
        boxes = {n: Interval(x.lower[None], x.upper[None]) for n, x in self._values.items()}
        squares = self._sides.distance(first, second, place)(boxes)
        best = max(squares, key=lambda x: float(np.max(x.value.lower)))
        if float(np.max(best.value.lower)) > self._apart**2:
            return ""
        changes = {
            name: float(np.max(np.maximum(-best.slopes[name].lower, best.slopes[name].upper)))
            * float(x.upper - x.lower)
            for name, x in self._values.items()
            if name in best.slopes
        }
        return max(changes, key=lambda name: changes[name], default=next(iter(self._values)))

    def ignores(self, patch: Cell, direction: int) -> Verdict:
        """See Questions.ignores."""
        trees, points = self._sides.on(patch), self._points.on(patch)
        start = np.take(points, [0], axis=directions_of(patch).index(direction))
        there = substitute(trees, {PARAMETERS[direction]: ZERO})
        return _verdict(self._is_one((points, start), (trees, there), directions_of(patch)))

    def coincide(self, first: Cell, second: Cell, symmetry: Symmetry) -> Verdict:
        """See Questions.coincide."""
        own = [symbol(PARAMETERS[d]) for d in directions_of(first)]
        s, t = reversed(own) if symmetry.swap else own
        there = 1 - s if symmetry.reverse_s else s, 1 - t if symmetry.reverse_t else t
        image = symmetry.read(self._points.on(second))
        trees = self._sides.on(first), self._sides.on(second, there)
        known = self._points.on(first), image
        return _verdict(self._is_one(known, trees, directions_of(first)))

    def is_point(self, edge: Cell) -> bool:
        """See Questions.is_point."""
        points = self._points.on(edge)
        trees = self._sides.on(edge), self._sides.on(edge, (ZERO,))
        return self._is_one((points, points[:1]), trees, directions_of(edge))

    def same_edge(self, first: Cell, second: Cell, reverse: bool) -> bool:
        """See Questions.same_edge."""
        t = symbol(PARAMETERS[directions_of(first)[0]])
        trees = self._sides.on(first), self._sides.on(second, (1 - t if reverse else t,))
        other = self._points.on(second)[:: -1 if reverse else 1]
        return self._is_one((self._points.on(first), other), trees, directions_of(first))

    def places(self, corners: Sequence[Cell]) -> list[list[Cell]]:
        """See Questions.places."""
        groups: list[list[Cell]] = []
        for corner in corners:
            for group in groups:
                known = self._points.on(group[0]), self._points.on(corner)
                if self._is_one(known, (self._sides.on(group[0]), self._sides.on(corner))):
                    group.append(corner)
                    break
            else:
                groups.append([corner])
        return groups


def _verdict(same: bool) -> Verdict:
    return Verdict.PROVED if same else Verdict.REFUTED
