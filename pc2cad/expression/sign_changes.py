"""Where a function changes its sign along one parameter: all places, found and proved to be all.

Conditions, absolute values, the larger of two numbers and all else that changes its formula at a
zero ask here. The search is an interval Newton method without the division: an interval is done
with where the enclosure of the values has one sign, or that of the slopes, so that there is one
zero at most; what is left is halved.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise, product

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.breaks import SAME_POSITION, find_breaks, resolve_pieces
from pc2cad.expression.centred import CentredProgram
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.enclosures import IntervalProgram, enclose
from pc2cad.expression.evaluation import Program
from pc2cad.expression.intervals import Interval, interval
from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.operations import operands
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.recent import Recent
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, number, pieces, substitute, symbol

#: intervals that the search begins with, that it takes at once, and how narrow they get
_FIRST, _MOST, _NARROW = 16, 2048, 2.0**-44
#: even cells over which a function is enclosed at once: those that say whether it changes at short
#: length (`narrow`), and those that are looked at before its zeros are looked for
EVEN = 16, 64
#: and those over which its size is bounded (`magnitudes`)
PARTS = 32
#: cells of each other parameter, and the places of it at which zeros are compared first
_CELLS, _ASKED = 6, (0.37, 0.83)
#: where between the ends of an interval a function is looked at
_BETWEEN = (0.37, 0.61)
#: zeros at different values of the other parameters are one line if they are no further apart
_ONE_LINE = 1e-9
#: derivatives that are compared at a join, where between joins, and what is rounding of them
_ORDERS, _SHARES, _AGREE = 6, (0.04, 0.27, 0.5, 0.71, 0.93), 1e-10


@dataclass(frozen=True)
class SignChanges:
    """The sign of a function along one parameter over [0, 1], the same for all other parameters."""

    #: the parameter
    name: str
    #: where the sign changes, ascending, in ]0, 1[; exact where the function is linear
    places: tuple[Fraction, ...]
    #: 1 or -1 before, between and after the places
    signs: tuple[int, ...]

    def choose(self, positive: Expr, negative: Expr, smoothness: int | None = None) -> Expr:
        """Return one tree where the function is positive and the other where it is negative.

        See `in_pieces`.
        """
        return in_pieces(
            self.name,
            self.places,
            tuple(positive if sign > 0 else negative for sign in self.signs),
            smoothness,
        )


def sign_changes(tree: Expr, name: str | None = None) -> SignChanges | None:
    """Return where a function changes its sign along a parameter; None where that is not known.

    Every symbol of the tree is a parameter that runs from 0 to 1; `name` may be left out where
    there is one. Complete: there are no other changes. Places within 1e-12 of a limit are no
    changes. None where there are more than about a thousand, or where the places depend on
    other parameters.
    """
    if name is None:
        (name,) = tree.symbols
    others = sorted(tree.symbols - {name})
    if others and not _may_be_lines(tree, name, others):
        return None
    rows = _rows(tree, name, others)
    if rows is None:
        return None
    return _told(_at(tree, others, _ASKED), name, rows)


def on_cells(tree: Expr, name: str) -> Interval:
    """Return the enclosures of a function of one parameter on the last of the `EVEN` cells."""
    return _taken(_on_every_cell(tree, name), EVEN[0], sum(EVEN))


def on_all_cells(tree: Expr, name: str) -> Interval:
    """Return the enclosures of a function of one parameter on all `EVEN` cells of [0, 1]."""
    return _taken(_on_every_cell(tree, name), 0, sum(EVEN))


def on_parts(tree: Expr, name: str) -> Interval:
    """Return the enclosures of a function of one parameter on `PARTS` even cells of [0, 1]."""
    return _taken(_on_every_cell(tree, name), sum(EVEN), None)


def _taken(values: Interval, first: int, last: int | None) -> Interval:
    if not values.lower.ndim:
        return values
    return Interval(values.lower[first:last], values.upper[first:last])


def _on_every_cell(tree: Expr, name: str) -> Interval:
    """Return all these enclosures: more cells cost next to nothing, operations do."""
    remembered = _enclosed(name)
    known = remembered.get(tree)
    if known is not None:
        return known
    boxes = {name: interval(*_every_cell())}

    def find(node: Expr, below: dict[Expr, Interval]) -> Interval:
        return enclose(node, tuple([below[arg] for arg in operands(node)]), boxes)

    with np.errstate(all="ignore"):
        return remembered.of((tree,), find, lambda _: None, operands)[tree]


def even_cells() -> tuple[Array, Array]:
    """Return the lower and the upper ends of the `EVEN` cells."""
    low, high = _every_cell()
    return low[: sum(EVEN)], high[: sum(EVEN)]


@lru_cache(maxsize=1)
def _every_cell() -> tuple[Array, Array]:
    ends = [np.arange(count + 1) / count for count in (*EVEN, PARTS)]
    return np.concatenate([x[:-1] for x in ends]), np.concatenate([x[1:] for x in ends])


@lru_cache(maxsize=3)
def _enclosed(_: str) -> Recent[Interval]:
    """Return the enclosures that are remembered: roots have most of their trees in common."""
    return Recent()


def keeps_sign(values: Interval) -> bool:
    """Say whether enclosures prove that a function vanishes nowhere, as they do of most."""
    return bool((values.lower > 0).all() or (values.upper < 0).all())


def in_pieces(
    name: str, places: tuple[Fraction, ...], rows: tuple[Expr, ...], smoothness: int | None = None
) -> Expr:
    """Return the function of a parameter that is one tree after the other between some places.

    `rows` holds one tree more than there are places in ]0, 1[. The order of continuity is that at
    which all derivatives up to it agree at all places, as far as samples of the other parameters
    show, unless `smoothness` tells it.
    """
    # what a row does beyond its own piece is of no matter
    ends = pairwise((Fraction(0), *places, Fraction(1)))
    rows = tuple(
        resolve_pieces((row,), (name, *span))[0] for row, span in zip(rows, ends, strict=True)
    )
    changes = [k for k, (a, b) in enumerate(pairwise(rows)) if a is not b]
    kept = (rows[0], *(rows[k + 1] for k in changes))
    joins = tuple(places[k] for k in changes)
    if not joins:
        return rows[0]
    if smoothness is None:
        smoothness = _smoothness(name, (Fraction(0), *joins, Fraction(1)), kept)
    breaks = (Fraction(0), *joins, Fraction(1))
    return pieces(symbol(name), breaks, tuple((row,) for row in kept), smoothness, closed=False)


def _smoothness(name: str, breaks: tuple[Fraction, ...], rows: tuple[Expr, ...]) -> int:
    """Return up to what order derivatives agree at all joins; -1 where not even values do."""
    others = sorted(frozenset[str]().union(*(row.symbols for row in rows)) - {name})
    samples = np.array(list(product(_SHARES, repeat=len(others))))
    known = {other: samples[None, :, k] for k, other in enumerate(others)}
    for order in range(_ORDERS):
        values = []
        for row, low, high in zip(rows, breaks, breaks[1:], strict=False):
            shares = np.array([0.0, *_SHARES, 1.0])[:, None]
            along = float(low) + float(high - low) * shares
            (found,) = Program((row,))({name: along, **known})
            values.append(np.broadcast_to(found, (len(shares), len(samples))))
        finite = np.abs(np.concatenate(values))
        scale = float(finite[np.isfinite(finite)].max(initial=0.0))
        for before, after in pairwise(values):
            if not np.all(np.abs(after[0] - before[-1]) <= _AGREE * scale):
                return order - 1
        rows = derivatives(rows, name)
    return _ORDERS - 1


# -- the search ------------------------------------------------------------------------------------

#: begin, end, sign at the begin, sign at the end; 0 where it is not known
_Row = tuple[float, float, int, int]


def _rows(tree: Expr, name: str, others: list[str]) -> list[_Row] | None:
    """Return the signs at the ends of intervals in which there is one change at most.

    Of several parameters each sign is that for all values of the others, and changes lie in
    intervals of the least length.
    """
    ask = _Enclosures(tree, name, others)
    # a function that is zero along a whole piece is so from its break on
    own = {b.position for b in find_breaks((tree,))[PARAMETERS.index(name)]}
    ends = list(pairwise(sorted(own | {k / _FIRST for k in range(_FIRST + 1)})))
    most = _MOST >> (2 * len(others))
    rows: list[_Row] = []
    while ends:
        if len(ends) > most:
            return None
        starts, stops = [a for a, _ in ends], [b for _, b in ends]
        value, slope = ask(starts, stops)
        columns = (_signs(value, ask.is_zero(starts, stops)), _strict_signs(slope),
                   *(_strict_signs(ask(row, row)[0]) for row in _inside(ends, own)))  # fmt: skip
        left = []
        for (a, b), sign, monotone, begin, end in zip(ends, *columns, strict=True):
            if sign:
                rows.append((a, b, sign, sign))
            elif monotone and (not others or (begin and end)):
                rows.append((a, b, begin, end))
            elif b - a < _NARROW:
                rows.append((a, b, 0, 0))
            else:
                left += [(a, (a + b) / 2), ((a + b) / 2, b)]
        ends = left
    return sorted(rows)


def _inside(ends: list[tuple[float, float]], breaks: set[float]) -> tuple[list[float], list[float]]:
    """Return where intervals begin and end, a little inside where that is a break.

    Functions may jump there, and at the break itself both values would be found: no sign is known.
    """
    steps = [min(_NARROW, (b - a) / 4) for a, b in ends]
    starts = [a + step if a in breaks else a for (a, _), step in zip(ends, steps, strict=True)]
    stops = [b - step if b in breaks else b for (_, b), step in zip(ends, steps, strict=True)]
    return starts, stops


class _Enclosures:
    """Values and slopes over intervals of one parameter and all of the others."""

    def __init__(self, tree: Expr, name: str, others: list[str]) -> None:
        trees = (tree, *derivatives((tree,), name))
        # what several parameters have in common cancels only in centred forms
        self._centred = CentredProgram(trees) if others else None
        self._plain = IntervalProgram(trees)
        self._values = Program((tree,))
        self._name, self._others = name, others
        cells = list(product(range(_CELLS), repeat=len(others)))
        self._cells = np.array(cells, dtype=float).reshape(len(cells), len(others)) / _CELLS

    def __call__(self, starts: list[float], stops: list[float]) -> tuple[Interval, ...]:
        count = len(self._cells)
        low, high = np.tile(self._cells, (len(starts), 1)).T, 1 / _CELLS
        boxes = {other: Interval(x, x + high) for other, x in zip(self._others, low, strict=True)}
        boxes[self._name] = interval(np.repeat(starts, count), np.repeat(stops, count))
        found: Iterable[Interval]
        if self._centred is None:
            found = self._plain(boxes)
        else:
            found = (row.value for row in self._centred(boxes))
        zeros = np.zeros(len(starts) * count)
        return tuple(
            Interval(
                (value.lower + zeros).reshape(-1, count).min(axis=1),
                (value.upper + zeros).reshape(-1, count).max(axis=1),
            )
            for value in found
        )

    def is_zero(self, starts: list[float], stops: list[float]) -> list[bool]:
        """Say where the function vanishes between two ends, as it does along a whole piece."""
        along = np.array(starts)[:, None] + np.subtract(stops, starts)[:, None] * np.array(_BETWEEN)
        places = {other: np.asarray(at) for other, at in zip(self._others, _ASKED, strict=False)}
        (values,) = self._values({self._name: along, **places})
        found: list[bool] = (np.broadcast_to(values, along.shape) == 0).all(axis=1).tolist()
        return found


def _signs(value: Interval, is_zero: list[bool]) -> list[int]:
    """Return the signs of enclosures: 1 where none is negative, -1 where none is positive.

    What is zero along a whole piece counts as positive.
    """
    positive = (value.lower >= 0) | (is_zero & (value.upper <= 0))
    found: list[int] = np.where(positive, 1, np.where(value.upper <= 0, -1, 0)).tolist()
    return found


def _strict_signs(value: Interval) -> list[int]:
    found: list[int] = ((value.lower > 0).astype(int) - (value.upper < 0)).tolist()
    return found


def _told(tree: Expr, name: str, rows: list[_Row]) -> SignChanges:
    """Return the changes of sign along intervals that follow one another.

    Where rounding hides the sign at an end, the next signs that are known decide.
    """
    sign = next((s for _, _, *ends in rows for s in ends if s), 1)
    places: list[Fraction] = []
    signs = [sign]
    known = 0.0
    for place, here in ((x, s) for a, b, *ends in rows for x, s in zip((a, b), ends, strict=True)):
        if not here:
            continue
        if here != sign:
            zero = _zero(tree, name, known, place)
            if zero < SAME_POSITION:
                signs = [here]
            elif zero < 1 - SAME_POSITION:
                places.append(zero)
                signs.append(here)
        known, sign = place, here
    return SignChanges(name, tuple(places), tuple(signs))


def _zero(tree: Expr, name: str, a: float, b: float) -> Fraction:
    """Return where a function changes its sign between two places; exactly where it is linear."""
    if a < b:
        exact = _linear_zero(tree, name)
        if exact is not None and a <= exact <= b:
            return exact
    low = evaluate(tree, {name: a}) > 0
    for _ in range(64):
        middle = (a + b) / 2
        if not a < middle < b:
            break
        value = evaluate(tree, {name: middle})
        if value == 0:
            return Fraction(middle)
        a, b = (middle, b) if (value > 0) == low else (a, middle)
    return Fraction((a + b) / 2)


def _linear_zero(tree: Expr, name: str) -> Fraction | None:
    form = normal_form(tree, largest=50)
    if form is None or not set(form) <= {(), ((symbol(name), 1),)}:
        return None
    slope = form.get(((symbol(name), 1),), Fraction(0))
    return -form.get((), Fraction(0)) / slope if slope else None


# -- several parameters ----------------------------------------------------------------------------


def _at(tree: Expr, others: list[str], places: tuple[float, ...]) -> Expr:
    """Return the tree at one place of the other parameters, whose values are taken in turn."""
    values = {other: number(places[k % len(places)]) for k, other in enumerate(others)}
    return substitute((tree,), values)[0]


def _may_be_lines(tree: Expr, name: str, others: list[str]) -> bool:
    """Say whether the sign changes at the same places at two samples of the other parameters."""
    found = []
    for places in (_ASKED, _ASKED[::-1]):
        there = _at(tree, others, places)
        changes = sign_changes(there, name) if there.symbols else None
        if changes is None:
            return False
        found.append(changes)
    first, second = found
    return first.signs == second.signs and all(
        abs(a - b) <= _ONE_LINE for a, b in zip(first.places, second.places, strict=True)
    )
