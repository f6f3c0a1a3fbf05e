"""Breaks of a parameter direction: where a piecewise function changes its piece."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from math import ceil, floor, inf

from pc2cad.errors import InputError
from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.rewriting import among, rewrite
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import ANALYTIC, ZERO, Expr, ops_of, pieces, rebuild, walk

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
    ordered: tuple[list[float], ...] = ([], [], [])
    for node in among(roots, lambda n: "pieces" in n.ops):
        if node.op != "pieces":
            continue
        argument = node.args[0]
        if not argument.symbols:
            continue  # a table at one place, such as pi/3: nothing breaks along a parameter
        if len(argument.symbols) != 1 or not is_affine(argument):
            raise BreaksNotAlignedError(
                f"a piecewise curve is taken at {argument!r}; its breaks are lines of the solid "
                "only when that is a·v + b in one of the parameters"
            )
        (name,) = argument.symbols
        breaks, _, smoothness, closed = node.payload
        if smoothness == ANALYTIC and not analytic:
            continue
        for position in _positions(argument, name, [float(b) for b in breaks], closed):
            table, places = found[PARAMETERS.index(name)], ordered[PARAMETERS.index(name)]
            at = bisect_right(places, position - SAME_POSITION)
            same = places[at] if at < len(places) else inf
            if not abs(same - position) < SAME_POSITION:
                places.insert(at, same := position)
            table[same] = max(0, min(table.get(same, smoothness), smoothness))
    return tuple(tuple(Break(p, s) for p, s in sorted(table.items())) for table in found)


def resolve_pieces(
    roots: tuple[Expr, ...], span: tuple[str, Fraction, Fraction] | None = None
) -> tuple[Expr, ...]:
    """Return the trees with every piecewise function that stays in one piece replaced by it.

    The trees are in the local coordinates of a cell: each symbol runs from 0 to 1, but for the one
    whose `span` is given.
    """
    if "pieces" not in ops_of(roots):
        return roots
    known: dict[Expr, Expr] = {}

    def only(node: Expr) -> Expr:
        # the pieces that are not taken are not looked at: there may be many within many
        if node not in known:
            (inside,) = resolve_pieces(node.args[:1], span) if node.args[0].args else node.args[:1]
            here = node if inside is node.args[0] else rebuild(node, (inside, *node.args[1:]))
            known[node] = _only_piece(here, span) if here.op == "pieces" else here
        return known[node]

    def below(node: Expr) -> tuple[Expr, ...]:
        if "pieces" not in node.ops:
            return ()
        if node.op != "pieces" or only(node) is node:
            return tuple([arg for arg in node.args if "pieces" in arg.ops])
        return (only(node),)

    done: dict[Expr, Expr] = {}
    for node in walk(roots, below):
        if node.op == "pieces" and known[node] is not node:
            done[node] = done[known[node]]
        else:
            args = tuple([done.get(arg, arg) for arg in node.args])
            done[node] = node if args == node.args else rebuild(node, args)
    return tuple(done[root] for root in roots)


def trim_pieces(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return the trees without the pieces that lie beyond the ends of the parameters.

    The trees are in local coordinates, each from 0 to 1. Where the box ends on a break, the end
    belongs to the piece inside. What is closed, and taken once round or more, stays.
    """
    return rewrite(roots, "pieces", _trimmed, keep=True)


def _trimmed(node: Expr) -> Expr:
    met, (breaks, _, smoothness, closed) = _met(node), node.payload
    if met is None or (not closed and len(met) == len(breaks) - 1):
        return node
    if len(met) == 1:
        return _polynomial(node.args[0], *met[0])
    starts = [start for start, _ in met]
    end = starts[-1] + (breaks[-1] - breaks[0] if closed else breaks[-1])
    rows = tuple(row for _, row in met)
    return pieces(node.args[0], (*starts, end), rows, smoothness, closed=False)


def _only_piece(node: Expr, span: tuple[str, Fraction, Fraction] | None) -> Expr:
    met = _met(node, span)
    return node if met is None or len(met) > 1 else _polynomial(node.args[0], *met[0])


def _polynomial(argument: Expr, start: Fraction, row: tuple[Expr, ...]) -> Expr:
    value: Expr = ZERO
    for coefficient in reversed(row):
        value = value * (argument - start) + coefficient
    return value


def _met(
    node: Expr, span: tuple[str, Fraction, Fraction] | None = None
) -> list[tuple[Fraction, tuple[Expr, ...]]] | None:
    """Return where the pieces begin that are met between the ends of a parameter, and their rows.

    None where the argument is no affine function of one parameter, or goes round once or more.
    """
    limits = _limits(node.args[0], span)
    if limits is None:
        return None
    low, high = limits
    breaks, _, _, closed = node.payload
    period, last, row = breaks[-1] - breaks[0], len(breaks) - 2, node.payload.width
    laps = range(1)
    if closed:
        if high - low > float(period) * (1 - SAME_POSITION):
            return None
        laps = range(*(floor((x - float(breaks[0])) / float(period)) + k
                       for x, k in ((low, -1), (high, 2))))  # fmt: skip
    found = []
    for lap in laps:
        places, lengths = _in_lap(node, lap)
        # those beside the limits are asked, with a margin for what rounds
        near = range(max(bisect_right(places, low) - 2, 0), bisect_left(places, high) + 1)
        for i in near[: last + 1 - near.start]:
            width = lengths[i]
            begins = places[i] < high - width * SAME_POSITION or (not closed and i == 0)
            ends = low + width * SAME_POSITION < places[i + 1] or (not closed and i == last)
            if begins and ends:
                coefficients = node.args[1 + i * row : 1 + (i + 1) * row]
                found.append((breaks[i] + lap * period, coefficients))
    return found


@lru_cache(maxsize=256)
def _limits(
    argument: Expr, span: tuple[str, Fraction, Fraction] | None
) -> tuple[float, float] | None:
    """Return what an argument runs between, None where it is no affine function of one parameter.

    Tables often have their argument in common: those of the coordinates of one profile do.
    """
    if len(argument.symbols) != 1 or not is_affine(argument):
        return None
    (name,) = argument.symbols
    limits = (float(span[1]), float(span[2])) if span and span[0] == name else (0.0, 1.0)
    low, high = sorted(evaluate(argument, {name: x}) for x in limits)
    return (low, high) if high - low < inf else None  # beyond the range of a table


@lru_cache(maxsize=256)
def _in_lap(node: Expr, lap: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the breaks of pieces so many periods on, and how far apart they are."""
    breaks = node.payload.breaks
    shift = lap * (breaks[-1] - breaks[0])
    return (
        tuple(float(b + shift) for b in breaks),
        tuple(float(b - a) for a, b in pairwise(breaks)),
    )


def is_affine(argument: Expr) -> bool:
    """Say whether a tree is a·v + b in one of the parameters, or constant."""
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
