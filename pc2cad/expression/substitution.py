"""Replacing symbols of expression trees."""

from __future__ import annotations

from fractions import Fraction

from pc2cad.expression.tree import (
    Expr,
    number,
    piece_rows,
    polynomial,
    rebuild,
    row_at,
    symbol,
    walk,
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
    known: dict[Expr, tuple[tuple[Expr, ...], Fraction]] = {}

    def below(node: Expr) -> tuple[Expr, ...]:
        if node.symbols.isdisjoint(names):
            return ()
        if node.op == "pieces" and node.args[0].symbols <= names:
            (at,) = substituted(node.args[:1], values)
            if at.op == "number":
                index, local = row_at(node.payload, at.payload)
                known[node] = piece_rows(node)[index], local
                return known[node][0]
        return node.args

    done: dict[Expr, Expr] = {}
    for node in walk(roots, below):
        if node.symbols.isdisjoint(names):
            done[node] = node
        elif node.op == "symbol":
            done[node] = values[node.payload]
        elif node in known:
            row, local = known[node]
            done[node] = polynomial(tuple(done[c] for c in row), number(local))
        else:
            done[node] = rebuild(node, tuple(done[arg] for arg in node.args))
    return tuple(done[root] for root in roots)
