"""Proof that det J keeps one sign, from interval enclosures of its columns.

A matrix of intervals holds no singular matrix when it is near enough to its middle: with B the
inverse of the middle, |1 - B·J| as a bound has a spectral radius below 1 (Rump's test). Boxes where
this fails are split, along the direction that is to blame, until a stated effort is spent.

On a side that collapses, a tangent vanishes and det J with it. Such a factor is positive inside and
is divided out: where M_j vanishes to the order k at p = 0, M_j/p^k lies in the range of its k-th
derivative over k!, taken from the side to the far end of the box. That it vanishes is proved from
the trees.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise, product
from types import MappingProxyType
from typing import Any

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.distinct import ranked
from pc2cad.domain.map import Mapping3
from pc2cad.expression.breaks import find_breaks, resolve_pieces
from pc2cad.expression.centred import Centred, CentredProgram
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.evaluation import Program
from pc2cad.expression.exact import exact
from pc2cad.expression.intervals import ULP, Interval
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import (
    ONE,
    Expr,
    number,
    substitute,
    symbol,
    walk,
)
from pc2cad.solidity.jacobian_proof.determinant import determinant
from pc2cad.solidity.jacobian_proof.side_zeros import order_of_zero
from pc2cad.solidity.jacobian_proof.small_matrices import (
    dominant_vectors,
    inverse_and_sign,
    radius_bound,
)

#: a direction and the end of it (0 or 1): one side of the box
_Side = tuple[int, int]
_Sides = tuple[_Side, ...]

#: operations on one box at which the proof is given up: some tenths of a second
MOST_OPERATIONS = 4e7
#: boxes looked at together
MOST_BOXES = 20_000
#: a box that is narrower has no sign because there is none there: few such boxes cost no operations
NARROWEST = 2.0**-64
#: parts per direction at the start, and the largest split of one
MOST_PARTS = 4
#: parts into which a box is split per unit of the blame that a direction has
SPLIT = 2.0
#: places per direction where J is sampled, and how many boxes take up its change between two
PLACES = 13
SAFETY = 3.0
#: boxes of the first round
MOST_FIRST = 4000
#: J of unit columns is given up where its inverse has entries beyond this
SINGULAR = 1e8


def sign_from_enclosures(mapping: Mapping3, left: list[Array] | None = None) -> int:
    """Return the sign of det J where it is proved to be one inside the box, else 0.

    A map with creases, or with pieces that are functions, is taken cell by cell. Middles of boxes
    that are without a sign when the effort is spent are added to `left`, (3, n).
    """
    signs: set[int] = set()
    cells = list(_cells(mapping))
    for cell, spans in cells:
        found: list[Array] = []
        signs.add(_sign_in_cell(cell, MOST_OPERATIONS / len(cells), found))
        if left is not None:
            start, stop = np.array(spans, dtype=float).T
            left += [start[:, None] + (stop - start)[:, None] * places.T for places in found]
        if len(signs) > 1 or 0 in signs:
            return 0
    return signs.pop()


def _cells(mapping: Mapping3) -> Iterator[tuple[Mapping3, tuple[tuple[float, float], ...]]]:
    """Yield the map between its creases, each part over a unit box of its own, and its spans."""
    moving = any(
        coefficient.symbols
        for node in walk(mapping.coordinates)
        if node.op == "pieces"
        for coefficient in node.args[1:]
    )
    axes = [
        [0.0, *(b.position for b in row if (moving or b.smoothness < 1) and 0 < b.position < 1), 1]
        for row in find_breaks(mapping.coordinates, analytic=moving)
    ]
    if all(len(axis) == 2 for axis in axes):
        yield mapping, ((0, 1),) * 3
        return
    for spans in product(*(pairwise(axis) for axis in axes)):
        change: dict[str, Expr] = {}
        trees: tuple[Expr, ...] = mapping.coordinates
        for name, (low, high) in zip(PARAMETERS, spans, strict=True):
            # pieces beyond the cell first: there may be many
            trees = resolve_pieces(trees, (name, exact(low), exact(high)))
            change[name] = number(low) + number(high - low) * symbol(name)
        x, y, z = resolve_pieces(substitute(trees, change))
        yield Mapping3((x, y, z), mapping.parameters), spans


def _sign_in_cell(mapping: Mapping3, effort: float, left: list[Array]) -> int:
    # where the tangents are parallel on a side, det J as a whole may still have a factor
    for matrix in (mapping.derivatives, ((determinant(mapping.derivatives),),)):
        columns = columns_of(matrix)
        counts = columns and columns.counts()
        if columns and counts:
            return _sign_in_boxes(columns, _first_boxes(mapping, counts), effort, left)
    return 0


def _sign_in_boxes(
    columns: Columns, boxes: tuple[Array, Array], effort: float, left: list[Array]
) -> int:
    low, high = boxes
    signs: set[int] = set()
    while len(low) and len(signs) < 2:
        if columns.spent > effort or len(low) > MOST_BOXES or (high - low).min() < NARROWEST:
            left.append((low + high) / 2)
            return 0
        regular, blame, sign = columns.test(low, high)
        if len(signs | set(sign[regular])) > 1:
            left.append((low + high) / 2)
        signs |= set(sign[regular])
        low, high = split(low[~regular], high[~regular], blame[~regular])
    return signs.pop() if len(signs) == 1 else 0


def _first_boxes(mapping: Mapping3, counts: tuple[int, ...]) -> tuple[Array, Array]:
    """Return boxes, so many per direction and bounded by its breaks: their corners (n, 3)."""
    axes = []
    for row, count in zip(find_breaks(mapping.coordinates), counts, strict=True):
        inner = [b.position for b in row if 0 < b.position < 1]
        even = [x for x in np.arange(1, count) / count if not any(abs(x - y) < 1e-3 for y in inner)]
        axes.append(np.array(sorted([0.0, *inner, *even, 1.0])))
    low, high = (
        np.stack(np.meshgrid(*corners, indexing="ij"), axis=-1).reshape(-1, 3)
        for corners in ([a[:-1] for a in axes], [a[1:] for a in axes])
    )
    return low, high


def split(low: Array, high: Array, blame: Array) -> tuple[Array, Array]:
    """Split boxes (n, 3) where the blame is."""
    wanted = np.clip(np.ceil(blame * SPLIT), 1, MOST_PARTS)
    worst = blame.argmax(axis=1)
    rows = np.arange(len(low))
    # what is not to blame at all is left whole
    wanted[blame < blame.max(axis=1, keepdims=True) / 4] = 1
    wanted[rows, worst] = np.maximum(wanted[rows, worst], 2)
    for d in range(3):
        parts = wanted[:, d].astype(int)
        index = np.repeat(np.arange(len(low)), parts)
        place = np.concatenate([np.arange(n) for n in parts]) if len(parts) else parts
        start, end, count = low[index, d], high[index, d], parts[index]
        low, high, wanted = low[index], high[index], wanted[index]
        # neighbours share their limit to the last bit
        low[:, d] = np.where(place == 0, start, start + (end - start) * (place / count))
        last = place + 1 == count
        high[:, d] = np.where(last, end, start + (end - start) * ((place + 1) / count))
    return low, high


class Columns:
    """A matrix of trees (3×3 or 1×1), the factors divided out that vanish on sides of the box.

    Trees may have other symbols than u, v and w, which are anywhere in their `spans`.
    """

    def __init__(
        self,
        matrix: tuple[tuple[Expr, ...], ...],
        orders: list[dict[_Side, int]],
        spans: Mapping[str, Interval] = MappingProxyType({}),
    ) -> None:
        self._matrix = matrix
        self._width = len(matrix)
        self._orders = orders
        self._programs: dict[tuple[tuple[int, ...], _Sides], CentredProgram] = {}
        self._sides = sorted({side for row in orders for side in row})
        self._spans = spans
        self._names = (*PARAMETERS, *spans)
        self.spent = 0.0

    def within(self, spans: Mapping[str, Interval]) -> Columns:
        """Return the same columns with the other symbols in other spans."""
        found = Columns(self._matrix, self._orders, spans)
        found._programs = self._programs
        return found

    def test(self, low: Array, high: Array) -> tuple[Booleans, Array, Integers]:
        """Return where J is proved regular (n), what stops it per symbol (n, s), its sign (n).

        J lies in centre + Σ slope_d·reach_d; with B near the inverse of the centre, B·J is near 1.
        """
        centre, slopes, reach = self._enclose(low, high)
        with np.errstate(all="ignore"):
            middle = centre.middle
            inverse, sign = inverse_and_sign(middle)
            size = np.abs(inverse)
            bound = np.abs(inverse @ middle - np.eye(self._width))
            bound += size @ _half(centre) + 16 * ULP * (size @ np.abs(middle) + 1)
            changes = []
            for d, slope in enumerate(slopes):
                change = np.abs(inverse @ slope.middle) + size @ _half(slope)
                change += 16 * ULP * (size @ np.abs(slope.middle))
                changes.append(change * (1 + 16 * ULP) * reach[:, None, :, d])
                bound += changes[d]
            bound *= 1 + 64 * ULP
            weights = dominant_vectors(bound)
            radius = radius_bound(bound, weights) * (1 + 64 * ULP)
            regular = np.isfinite(bound).all(axis=(1, 2)) & (radius < 1)
            blame = np.stack([radius_bound(change, weights) for change in changes], axis=1)
        unknown = ~np.isfinite(blame).all(axis=1)
        shape = np.zeros_like(blame)
        shape[:, :3] = high - low
        blame[unknown] = shape[unknown] / np.maximum(shape[unknown].max(axis=1), 1e-300)[:, None]
        return regular & (sign != 0), blame, sign

    def counts(self) -> tuple[int, ...] | None:
        """Return how many boxes per direction J's changes ask for; None where it is singular.

        J is only sampled here: where it is singular on the boundary, no effort would prove it.
        """
        axis = np.linspace(0.0, 1.0, PLACES)
        places = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
        matrix = np.empty((len(places), self._width, self._width))
        for rows, columns, sides in self._grouped(places, places):
            program = Program(self._trees(columns, sides))
            values = program(
                {name: places[rows, d] for d, name in enumerate(PARAMETERS)} | _middles(self._spans)
            )
            for (j, i), value in zip(product(columns, range(self._width)), values, strict=True):
                matrix[rows, i, j] = value
        with np.errstate(all="ignore"):
            size = np.sqrt((matrix**2).sum(axis=1, keepdims=True))
            matrix /= size if self._width > 1 else ranked(size, 0.5)
            inverse, sign = inverse_and_sign(matrix)
            largest = np.abs(inverse).max(axis=(1, 2))
        regular = np.isfinite(matrix).all() and largest.max() < SINGULAR
        if not regular or abs(sign.sum()) < len(sign):
            return None
        grid = (PLACES,) * 3 + matrix.shape[1:]
        matrix, inverse = matrix.reshape(grid), inverse.reshape(grid)
        counts = []
        for d in range(3):
            step = np.diff(matrix, axis=d)
            change = np.take(inverse, range(PLACES - 1), axis=d) @ step
            size = np.sqrt((change**2).sum(axis=(-1, -2)))
            counts.append(ranked(size, 0.8) * (PLACES - 1) * SAFETY)
        shrink = min(1.0, (MOST_FIRST / np.prod(np.maximum(counts, 1.0))) ** (1 / 3))
        return tuple(max(1, math.ceil(shrink * count)) for count in counts)

    def _enclose(self, low: Array, high: Array) -> tuple[Interval, list[Interval], Array]:
        """Return the reduced J at centres, its slopes and the reach of the boxes they hold for.

        J and its slopes in all symbols are (n, coordinates, columns); each column has a box of its
        own, and the reach from its centre is (n, columns, symbols).
        """
        shape = (len(low), self._width, self._width)
        centre = Interval(np.empty(shape), np.empty(shape))
        slopes = [Interval(np.zeros(shape), np.zeros(shape)) for _ in self._names]
        reach = np.empty((len(low), self._width, len(self._names)))
        for d, x in enumerate(self._spans.values(), 3):
            reach[..., d] = np.maximum(x.middle - x.lower, x.upper - x.middle) * (1 + 4 * ULP)
        for rows, columns, sides in self._grouped(low, high):
            a, b = low[rows], high[rows]
            for d, end in sides:
                (b if end else a)[:, d] = float(end)
            middle = a / 2 + b / 2
            reach[rows[:, None], columns, :3] = np.maximum(middle - a, b - middle)[:, None] * (
                1 + 4 * ULP
            )
            boxes = {name: Interval(a[:, d], b[:, d]) for d, name in enumerate(PARAMETERS)}
            for name, x in self._spans.items():
                boxes[name] = Interval(*(np.full(len(rows), end) for end in (x.lower, x.upper)))
            found = self._program(columns, sides)(boxes)
            self.spent += self._program(columns, sides).size * len(rows)
            for (j, i), entry in zip(product(columns, range(self._width)), found, strict=True):
                steady = _without_unknown_slopes(entry)
                _put(centre, (rows, i, j), steady.centre)
                for d, name in enumerate(self._names):
                    if name in steady.slopes:
                        _put(slopes[d], (rows, i, j), steady.slopes[name])
        return centre, slopes, reach

    def _grouped(
        self, low: Array, high: Array
    ) -> Iterator[tuple[Integers, tuple[int, ...], _Sides]]:
        """Yield boxes and columns together with the sides whose factors derivatives take out."""
        patterns, group = np.unique(self._near(low, high), axis=0, return_inverse=True)
        for index, pattern in enumerate(patterns):
            rows = np.flatnonzero(group.ravel() == index)
            close = [side for side, flag in zip(self._sides, pattern, strict=True) if flag]
            taken = [tuple(s for s in close if s in self._orders[j]) for j in range(self._width)]
            for sides in sorted(set(taken)):
                yield rows, tuple(j for j in range(self._width) if taken[j] == sides), sides

    def _near(self, low: Array, high: Array) -> Booleans:
        """Say which boxes are so near to which sides that a quotient says less than a slope."""
        near = np.zeros((len(low), len(self._sides)), dtype=bool)
        for k, (d, end) in enumerate(self._sides):
            width = high[:, d] - low[:, d]
            near[:, k] = (1 - high[:, d] if end else low[:, d]) <= width
            if end and (d, 0) in self._sides:
                near[:, k] &= ~near[:, self._sides.index((d, 0))]
        return near

    def _program(self, columns: tuple[int, ...], sides: _Sides) -> CentredProgram:
        if (columns, sides) not in self._programs:
            self._programs[columns, sides] = CentredProgram(self._trees(columns, sides))
        return self._programs[columns, sides]

    def _trees(self, columns: tuple[int, ...], sides: _Sides) -> tuple[Expr, ...]:
        return tuple(tree for j in columns for tree in self._reduced(j, sides))

    def _reduced(self, j: int, sides: _Sides) -> tuple[Expr, ...]:
        """Return M_j without its factors: of some sides by derivatives, of the others divided."""
        trees: tuple[Expr, ...] = self._matrix[j]
        divisor: Expr = ONE
        for (d, end), order in self._orders[j].items():
            if (d, end) in sides:
                for _ in range(order):
                    trees = derivatives(trees, PARAMETERS[d])
                divisor = divisor * ((-1) ** (order * end) * math.factorial(order))
            else:
                t = symbol(PARAMETERS[d])
                divisor = divisor * (1 - t if end else t) ** order
        return tuple(tree / divisor for tree in trees)


def _without_unknown_slopes(entry: Centred) -> Centred:
    """Return the values themselves as centres where a slope is not known: at jumps."""
    unknown = np.zeros(len(entry.value.lower), dtype=bool)
    for slope in entry.slopes.values():
        unknown |= ~(np.isfinite(slope.lower) & np.isfinite(slope.upper))
    if not unknown.any():
        return entry
    slopes = {
        name: Interval(np.where(unknown, 0.0, s.lower), np.where(unknown, 0.0, s.upper))
        for name, s in entry.slopes.items()
    }
    centre = Interval(
        np.where(unknown, entry.value.lower, entry.centre.lower),
        np.where(unknown, entry.value.upper, entry.centre.upper),
    )
    return Centred(entry.value, centre, slopes)


def _put(target: Interval, where: tuple[Any, ...], value: Interval) -> None:
    target.lower[where], target.upper[where] = value.lower, value.upper


def _half(x: Interval) -> Array:
    """Return how far an interval reaches from its middle."""
    return np.asarray(np.maximum(x.upper - x.middle, x.middle - x.lower) * (1 + 4 * ULP))


def columns_of(
    matrix: tuple[tuple[Expr, ...], ...], spans: Mapping[str, Interval] = MappingProxyType({})
) -> Columns | None:
    """Return columns with the orders of their zeros on sides, None where one is not proved."""
    orders: list[dict[_Side, int]] = []
    for trees in matrix:
        found: dict[_Side, int] = {}
        for d in range(3):
            for end in (0, 1):
                order = order_of_zero(trees, d, end, _middles(spans))
                if order is None:
                    return None
                if order:
                    found[d, end] = order
        orders.append(found)
    return Columns(matrix, orders, spans)


def _middles(spans: Mapping[str, Interval]) -> dict[str, Array]:
    return {name: x.middle for name, x in spans.items()}
