"""Where functions change within a short length of one parameter: needles, ridges, steep fronts.

Enclosures lead there: over a part of a parameter, whatever the others are, a function's values lie
in an enclosure. Parts over which one is wide, against all values of the function, are divided, and
a function that changes in a few short places only leaves few parts. So no needle hides between
places that are looked at, however narrow it is. What changes everywhere tells nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.arrays.distinct import distinct
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.intervals import Interval
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.rewriting import downwards
from pc2cad.expression.sign_changes import EVEN, even_cells, on_all_cells
from pc2cad.expression.tree import Expr

#: a part is left alone where the values over it span no more than this share of all
QUIET = 0.25
#: halvings of the whole parameter: in the last of the `EVEN` parts, which are looked at first, in
#: one step, before a place is narrow, and at most
FIRST, STEP, NARROW, DEEPEST = EVEN[-1].bit_length() - 1, 2, 8, 30
#: a function with more wide parts than this, where narrow ones begin, changes everywhere
MOST_PARTS = 12
#: functions whose changes follow from those of their arguments
_PLAIN = frozenset(("number", "constant", "symbol", "add", "neg", "mul", "sin", "cos", "pieces"))
_NOWHERE = np.empty(0)


def narrow_limits(trees: tuple[Expr, ...], name: str) -> Array:
    """Return ascending limits in ]0, 1[, dense where functions in trees change at short length.

    The trees' symbols run from 0 to 1 each. Empty where no function does.
    """
    nodes = frozenset([node for node in _steep(trees) if name in node.symbols])
    return _limits(nodes, name) if nodes else _NOWHERE


def _are_quiet(values: Sequence[Interval]) -> bool:
    """Say whether no function is wide over any of the last of its first parts."""
    for value in values:
        if value.lower.ndim:
            lower, upper = value.lower[EVEN[0] :], value.upper[EVEN[0] :]
            span = upper.max() - lower.min()
            if not np.isfinite(span) or _wide(lower, upper, span).any():
                return False
    return True


@lru_cache(maxsize=8)  # each parameter of the same trees is asked for
def _steep(trees: tuple[Expr, ...]) -> list[Expr]:
    nodes = downwards(trees, lambda node: bool(node.symbols) and not node.ops <= _PLAIN)
    return [node for node in nodes if _is_steep(node)]


@lru_cache(maxsize=256)  # the faces and edges of a part are made of few such functions
def _limits(functions: frozenset[Expr], name: str) -> Array:
    nodes, known = tuple(functions), list[Interval]()
    if all([len(node.symbols) == 1 for node in nodes]):
        # their enclosures are known, most of them, from the search for zeros
        known = [on_all_cells(node, name) for node in nodes]
        if _are_quiet(known):
            return _NOWHERE
    found: list[Array] = []
    over = _Parts(nodes, name)
    # two steps at once: after these hardly a function is wide, and parts are enclosed within what
    # they are parts of
    low, lower, upper = even_cells()[0], *over.first(known)
    least, most = lower.min(axis=1), upper.max(axis=1)
    useful = np.isfinite(most - least)
    (low, lower, upper), width = (x[..., EVEN[0] :] for x in (low, lower, upper)), 1 / EVEN[1]
    for depth in range(FIRST, DEEPEST + 1, STEP):
        wide = _wide(lower, upper, (most - least)[:, None]) & useful[:, None]
        if depth >= NARROW:
            useful &= wide.sum(axis=1) <= MOST_PARTS
            wide &= useful[:, None]
            found += [low[wide.any(axis=0)], low[wide.any(axis=0)] + width]
        low = low[wide.any(axis=0)]
        if len(low) == 0 or depth + STEP > DEEPEST:
            break
        width /= 2**STEP
        low = (low[:, None] + width * np.arange(2**STEP)).ravel()
        lower, upper = over(low, width)
        least, most = np.minimum(least, lower.min(axis=1)), np.maximum(most, upper.max(axis=1))
        useful &= np.isfinite(most - least)
    limits = distinct(np.concatenate([np.empty(0), *found]))
    limits = np.asarray(limits[(limits > 0) & (limits < 1)])
    limits.flags.writeable = False
    return limits


class _Parts:
    """Enclosures (nodes, parts) of functions over parts of a parameter, whatever others are."""

    def __init__(self, nodes: tuple[Expr, ...], name: str) -> None:
        self._nodes, self._name = nodes, name
        whole = Interval(np.array(0.0), np.array(1.0))
        self._boxes = {p: whole for p in PARAMETERS if p != name}

    @cached_property
    def _program(self) -> IntervalProgram:
        return IntervalProgram(self._nodes, self._boxes.copy())

    def first(self, known: Sequence[Interval]) -> tuple[Array, Array]:
        """Return the enclosures over the `EVEN` parts, which may be known."""
        if known:
            return _rows(known, even_cells()[0])
        low, high = even_cells()
        return self(low, high - low)

    def __call__(self, low: Array, width: Array | float) -> tuple[Array, Array]:
        """Return the enclosures over parts of some widths."""
        found = self._program(self._boxes | {self._name: Interval(low, low + width)})
        return _rows(found, low)


def _rows(values: Sequence[Interval], low: Array) -> tuple[Array, Array]:
    """Return the limits of intervals, an array each, those of constants over all parts."""
    still = 0 * low
    lower = np.array([value.lower + still for value in values])
    return lower, np.array([value.upper + still for value in values])


def _wide(lower: Array, upper: Array, span: Array | float) -> Booleans:
    with np.errstate(invalid="ignore"):
        return np.asarray(upper - lower > QUIET * span)


def _is_steep(node: Expr) -> bool:
    """Say whether a function may change faster than what it is taken of."""
    if node.op == "pow" and node.args[1].op == "number":
        exponent = node.args[1].payload
        return not (exponent.denominator == 1 and exponent > 0)
    return node.op not in _PLAIN
