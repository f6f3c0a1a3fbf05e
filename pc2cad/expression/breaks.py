"""Breaks of a parameter direction: where a piecewise function changes its piece."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil, floor

from pc2cad.errors import InputError
from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import ANALYTIC, ZERO, Expr, piece_rows, rewrite, walk

#: positions nearer than this (of a direction of length 1) are one break
SAME_POSITION = 1e-12


class BreaksNotAlignedError(InputError):
    """A piecewise function's breaks do not lie at constant values of one parameter."""


@dataclass(frozen=True)
class Break:
    """A place in [0, 1] where only derivatives up to order `smoothness` are continuous."""

    position: float
    smoothness: int


def find_breaks(roots: tuple[Expr, ...], analytic: bool = False) -> tuple[tuple[Break, ...], ...]:
    """Return the breaks per direction (u, v, w), ascending, ends included where one lies there.

    The trees are in local coordinates. `analytic` includes the breaks of what is one function but
    for rounding. Raises BreaksNotAlignedError for a piecewise function whose
    argument is not an affine function of a single parameter.
    """
    found: tuple[dict[float, int], ...] = ({}, {}, {})
    for node in walk(roots):
        if node.op != "pieces":
            continue
        argument = node.args[0]
        if len(argument.symbols) != 1 or not _is_affine(argument):
            raise BreaksNotAlignedError(
                f"a piecewise curve is taken at {argument!r}; its breaks are lines of the solid "
                "only when that is a·v + b in one of the parameters"
            )
        (name,) = argument.symbols
        breaks, _, smoothness, closed = node.payload
        if smoothness == ANALYTIC and not analytic:
            continue
        for position in _positions(argument, name, [float(b) for b in breaks], closed):
            table = found[PARAMETERS.index(name)]
            same = next((p for p in table if abs(p - position) < SAME_POSITION), position)
            table[same] = max(0, min(table.get(same, smoothness), smoothness))
    return tuple(tuple(Break(p, s) for p, s in sorted(table.items())) for table in found)


def resolve_pieces(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return the trees with every piecewise function that stays in one piece replaced by it.

    The trees are in the local coordinates of a cell: each symbol runs from 0 to 1.
    """
    return rewrite(roots, "pieces", _only_piece)


def _only_piece(node: Expr) -> Expr:
    argument = node.args[0]
    if len(argument.symbols) != 1 or not _is_affine(argument):
        return node
    (name,) = argument.symbols
    low, high = sorted(evaluate(argument, {name: x}) for x in (0.0, 1.0))
    breaks, _, _, closed = node.payload
    period = breaks[-1] - breaks[0]
    turn = floor(((low + high) / 2 - float(breaks[0])) / float(period)) if closed else 0
    rows = piece_rows(node)
    for i, (row, start, end) in enumerate(zip(rows, breaks, breaks[1:], strict=False)):
        shift = start + turn * period
        width = float(end - start) * SAME_POSITION
        begins = float(shift) - width <= low or (not closed and i == 0)
        ends = high <= float(shift + end - start) + width or (not closed and i == len(rows) - 1)
        if begins and ends:
            value: Expr = ZERO
            for coefficient in reversed(row):
                value = value * (argument - shift) + coefficient
            return value
    return node


def _is_affine(argument: Expr) -> bool:
    form = normal_form(argument, largest=50)
    if form is None:
        return False
    for monomial in form:
        free = [(atom, exponent) for atom, exponent in monomial if atom.symbols]
        if len(free) > 1 or any(atom.op != "symbol" or e != 1 for atom, e in free):
            return False
    return True


def _positions(argument: Expr, name: str, breaks: list[float], closed: bool) -> list[float]:
    at = [evaluate(argument, {name: x}) for x in (0.0, 1.0)]
    slope = at[1] - at[0]
    if not closed:
        return _within((b - at[0]) / slope for b in breaks[1:-1])
    period = breaks[-1] - breaks[0]
    low, high = min(at), max(at)
    turns = range(floor((low - breaks[0]) / period), ceil((high - breaks[0]) / period) + 1)
    return _within((b + k * period - at[0]) / slope for k in turns for b in breaks[:-1])


def _within(places: Iterable[float]) -> list[float]:
    """Return the places in [0, 1], ascending; what lies beside an end is the end."""
    inside = (p for p in places if -SAME_POSITION <= p <= 1 + SAME_POSITION)
    return sorted(0.0 if p < SAME_POSITION else 1.0 if p > 1 - SAME_POSITION else p for p in inside)
