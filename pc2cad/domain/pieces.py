"""M on one piece of the box: its trees without the pieces of functions that lie elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from pc2cad.expression.breaks import resolve_pieces
from pc2cad.expression.linear_terms import cancel_terms
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.rewriting import among
from pc2cad.expression.tree import Expr, number, substitute, symbol
from pc2cad.geometry.splines.bernstein import degree_in
from pc2cad.topology.cells import Cell


def piece_at(
    cell: Cell, bounds: Sequence[Sequence[float]]
) -> tuple[tuple[tuple[float, float], ...], dict[str, Expr]]:
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


@lru_cache(maxsize=1024)
def in_piece(
    coordinates: tuple[Expr, ...], spans: tuple[tuple[float, float], ...]
) -> tuple[tuple[Expr, ...], bool]:
    """Return trees in the local parameters of a piece of the box, and whether it is one of several.

    All faces and edges of the piece take their trees from these: many have the parts of all pieces.
    Every span is run through from 0 to 1 in the trees' own symbols.
    """
    whole, single = coordinates, False
    for name, span in zip(PARAMETERS, spans, strict=True):
        whole, fewer = _along(whole, name, span)
        single = single or fewer
    trees = cancel_terms(resolve_pieces(whole))
    return trees, single or trees != whole


@lru_cache(maxsize=1024)
def _along(
    trees: tuple[Expr, ...], name: str, span: tuple[float, float]
) -> tuple[tuple[Expr, ...], bool]:
    """Return trees in the local parameter of a span of one parameter, without what is not met.

    Also whether something is not. Pieces side by side have most of these spans in common.
    """
    low, high = (number(x) for x in span)
    alone = resolve_pieces(trees, (name, low.payload, high.payload))
    return substitute(alone, {name: low + (high - low) * symbol(name)}), alone != trees


@lru_cache(maxsize=1024)
def degree_in_piece(
    coordinates: tuple[Expr, ...], spans: tuple[tuple[float, float], ...], name: str
) -> int | None:
    """Return the degree of a piece's trees in a parameter; None where they are no polynomials."""
    trees, _ = in_piece(coordinates, spans)
    return None if has_pieces(trees, name) else degree_in(trees, name)


def has_pieces(trees: tuple[Expr, ...], name: str) -> bool:
    """Say whether a function in pieces depends on a parameter."""
    among_pieces = among(trees, lambda n: "pieces" in n.ops and name in n.symbols)
    return any(node.op == "pieces" for node in among_pieces)
