"""Replacing symbols of expression trees."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from operator import attrgetter

from pc2cad.expression.budget import is_counted
from pc2cad.expression.recent import Recent
from pc2cad.expression.tree import (
    Expr,
    number,
    piece_rows,
    polynomial,
    rebuild,
    row_at,
    symbol,
)


def substituted(roots: tuple[Expr, ...], values: dict[str, Expr]) -> tuple[Expr, ...]:
    """Return the trees with symbols replaced and everything folded anew.

    Of pieces that are taken at a number only the one there is looked at: others may end at it, in a
    division by zero.
    """
    found = frozenset[str]().union(*(root.symbols for root in roots))
    names = frozenset(name for name in found & values.keys() if values[name] is not symbol(name))
    if not names:
        return roots
    put = tuple([(name, values[name]) for name in sorted(names)])
    known = Recent[Expr]() if is_counted() else _known(put)
    chosen: dict[Expr, tuple[tuple[Expr, ...], Fraction]] = {}

    plain = not any(["pieces" in root.ops for root in roots])

    def below(node: Expr) -> tuple[Expr, ...]:
        if node.op == "pieces" and node.args[0].symbols <= names:
            (at,) = substituted(node.args[:1], values)
            if at.op == "number":
                index, local = row_at(node.payload, at.payload)
                chosen[node] = piece_rows(node)[index], local
                return chosen[node][0]
        return node.args

    def find(node: Expr, done: dict[Expr, Expr]) -> Expr:
        if node.op == "symbol":
            return values[node.payload]
        if chosen and node in chosen:
            row, local = chosen[node]
            return polynomial(tuple([done[c] for c in row]), number(local))
        return rebuild(node, tuple([done[arg] for arg in node.args]))

    done = known.of(
        roots,
        find,
        lambda node: node if node.symbols.isdisjoint(names) else None,
        attrgetter("args") if plain else below,
    )
    return tuple([done[root] for root in roots])


@lru_cache(maxsize=16)
def _known(_: tuple[tuple[str, Expr], ...]) -> Recent[Expr]:
    """Return what is remembered of a substitution: variants have most of their trees in common."""
    return Recent()
