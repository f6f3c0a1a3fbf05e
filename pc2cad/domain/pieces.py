"""M on one piece of the box: its trees without the pieces of functions that lie elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Final, TypeAlias

from pc2cad.expression.breaks import resolve_pieces
from pc2cad.expression.linear_terms import cancel_terms
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.rewriting import among, downwards
from pc2cad.expression.simplification import cancel
from pc2cad.expression.tree import Expr, ValueDomainError, number, ops_of, substitute, symbol
from pc2cad.geometry.splines.bernstein import degree_in
from pc2cad.topology.cells import Cell, Labels, cell_name

_Span: TypeAlias = tuple[float, float]
_Spans: TypeAlias = tuple[_Span, ...]
#: operations that make no roots of what they are given
_ARITHMETIC: Final = frozenset(("add", "mul", "neg", "div"))


def span_at(limits: Sequence[float], position: int) -> _Span:
    """Return the interval of a cell position, of no length for a limit of the pieces."""
    return limits[position // 2], limits[(position + 1) // 2]


def piece_at(cell: Cell, bounds: Sequence[Sequence[float]]) -> tuple[_Spans, dict[str, Expr]]:
    """Return the spans of the piece that a cell is in, or at a limit of, and which limits: 0 or 1.

    `bounds` are the ascending limits of the pieces of each direction.
    """
    spans, limits = [], {}
    for name, position, row in zip(PARAMETERS, cell, bounds, strict=True):
        piece = position if position % 2 else min(position + 1, 2 * len(row) - 3)
        spans.append((row[piece // 2], row[piece // 2 + 1]))
        if position % 2 == 0:
            limits[name] = number(int(position > piece))
    return tuple(spans), limits


@contextmanager
def having_a_value(cell: Cell, labels: Labels) -> Iterator[None]:
    """Name the cell where M has no value there as its trees tell it (ValueDomainError)."""
    try:
        yield
    except ValueDomainError as error:
        raise ValueDomainError(
            f"M has no value on {cell_name(cell, labels)} as it is written ({error}): what it "
            "comes to there is not looked for; write it in a form that has a value, or end the "
            "domain before"
        ) from error


class Pieces:
    """M on each piece of its box, in the piece's local parameters: found once for every piece.

    All faces and edges of a piece take their trees from these: many have the parts of all pieces.
    What is remembered lives as long as the map, and grows with its pieces.
    """

    def __init__(self, coordinates: tuple[Expr, ...]) -> None:
        self._coordinates = coordinates
        self._found: dict[_Spans, tuple[tuple[Expr, ...], bool]] = {}
        self._cut: dict[tuple[tuple[Expr, ...], str, _Span], tuple[tuple[Expr, ...], bool]] = {}
        self._sides: dict[tuple[_Spans, tuple[tuple[str, Expr], ...]], tuple[Expr, ...]] = {}
        self._degrees: dict[tuple[_Spans, str], int | None] = {}

    def trees(self, spans: _Spans) -> tuple[tuple[Expr, ...], bool]:
        """Return the trees of a piece, and whether it is one of several.

        Every span is run through from 0 to 1 in the trees' own symbols.
        """
        if spans not in self._found:
            whole, single = self._coordinates, False
            for name, span in zip(PARAMETERS, spans, strict=True):
                whole, fewer = self._along(whole, name, span)
                single = single or fewer
            alone = resolve_pieces(whole)
            self._found[spans] = cancel_terms(alone), single or alone != whole
        return self._found[spans]

    def restricted(self, spans: _Spans, limits: Mapping[str, Expr]) -> tuple[Expr, ...]:
        """Return the trees of a piece at some of its limits, without what cancels.

        They are made of those of a side that they are a limit of, where these are known: most of a
        channel's trees are numbers at a limit of u already.
        """
        at = tuple(limits.items())
        if (spans, at) not in self._sides:
            wholes = [tuple(x for x in at if x is not left) for left in at]
            whole = next((side for side in wholes if (spans, side) in self._sides), ())
            trees, single = self.trees(spans)
            if whole:
                trees, single = self._sides[spans, whole], False
            put = {name: x for name, x in at if (name, x) not in whole}
            side = substitute(trees, put)
            # what one piece alone makes of a root or a quotient could not be seen before, nor
            # what a side makes of a root
            new = single or (
                "sqrt" in ops_of(side)
                and _may_make_roots(trees, frozenset(put))
                and _has_new_root(side, trees)
            )
            self._sides[spans, at] = cancel(side) if new else side
        return self._sides[spans, at]

    def degree(self, spans: _Spans, name: str) -> int | None:
        """Return the degree of a piece's trees in a parameter; None for no polynomials."""
        key = spans, name
        if key not in self._degrees:
            trees, _ = self.trees(spans)
            self._degrees[key] = None if has_pieces(trees, name) else degree_in(trees, name)
        return self._degrees[key]

    def _along(
        self, trees: tuple[Expr, ...], name: str, span: _Span
    ) -> tuple[tuple[Expr, ...], bool]:
        """Return trees in the local parameter of a span of one parameter, without what is not met.

        Also whether something is not. Pieces side by side have most of these spans in common.
        """
        key = trees, name, span
        if key not in self._cut:
            low, high = (number(x) for x in span)
            alone = resolve_pieces(trees, (name, low.payload, high.payload))
            local = substitute(alone, {name: low + (high - low) * symbol(name)})
            self._cut[key] = local, alone != trees
        return self._cut[key]


def has_pieces(trees: tuple[Expr, ...], name: str) -> bool:
    """Say whether a function in pieces depends on a parameter."""
    among_pieces = among(trees, lambda n: "pieces" in n.ops and name in n.symbols)
    return any(node.op == "pieces" for node in among_pieces)


@lru_cache(maxsize=64)  # of opposite sides
def _may_make_roots(trees: tuple[Expr, ...], names: frozenset[str]) -> bool:
    """Say whether trees may hold other roots of symbols once there are numbers for some names.

    What becomes a number holds none, and sums, products and quotients make none.
    """
    changed = downwards(
        trees, lambda node: not (names.isdisjoint(node.symbols) or node.symbols <= names)
    )
    return any(node.op not in _ARITHMETIC for node in changed)


def _has_new_root(side: tuple[Expr, ...], trees: tuple[Expr, ...]) -> bool:
    """Say whether trees hold a root of symbols that some others do not hold."""
    # below a node of the others there is nothing new
    known = _rooted(trees)
    new = among(side, lambda n: "sqrt" in n.ops and bool(n.symbols) and n not in known)
    return any([node.op == "sqrt" for node in new])


@lru_cache(maxsize=64)  # the sides of one piece are compared with the same trees
def _rooted(trees: tuple[Expr, ...]) -> frozenset[Expr]:
    """Return the nodes that depend on symbols and hold a root."""
    return frozenset(among(trees, lambda n: "sqrt" in n.ops and bool(n.symbols)))
