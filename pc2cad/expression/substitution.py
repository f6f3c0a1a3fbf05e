"""Replacing symbols of expression trees."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import lru_cache, partial
from operator import attrgetter

from pc2cad.expression.budget import is_counted
from pc2cad.expression.recent import Recent
from pc2cad.expression.tree import (
    BUILDERS,
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


class Substitution:
    """Trees that symbols are replaced in again and again: what is to be done is planned once.

    The trees that `substituted` returns, in a third of its time. Of pieces that are taken at a
    number all are worked out, so that one that is not asked for may be the one that has no value.
    """

    def __init__(self, roots: tuple[Expr, ...], names: frozenset[str]) -> None:
        changing = [node for node in walk(roots) if not node.symbols.isdisjoint(names)]
        #: what stays, and then a place for each node that changes, operands first
        self._start: list[Expr] = []
        places: dict[Expr, int] = {}
        for node in changing:
            for part in node.args:
                if part.symbols.isdisjoint(names):
                    self._place(part, places)
        for root in roots:
            if root.symbols.isdisjoint(names):
                self._place(root, places)
        self._symbols: list[tuple[int, Expr]] = []
        self._steps: list[tuple[int, Callable[..., Expr], tuple[int, ...]]] = []
        for node in changing:
            place = self._place(node, places)
            if node.op == "symbol":
                self._symbols.append((place, node))
            else:
                build = BUILDERS.get(node.op) or partial(_rebuilt, node)
                self._steps.append((place, build, tuple([places[arg] for arg in node.args])))
        self._roots = tuple([places[root] for root in roots])

    def _place(self, node: Expr, places: dict[Expr, int]) -> int:
        if node not in places:
            places[node] = len(self._start)
            self._start.append(node)
        return places[node]

    def __call__(self, values: Mapping[str, Expr]) -> tuple[Expr, ...]:
        """Return the trees with values for names; a name without one stays as it is."""
        store = self._start.copy()
        for place, name in self._symbols:
            store[place] = values.get(name.payload, name)
        for place, build, args in self._steps:
            if len(args) == 2:
                store[place] = build(store[args[0]], store[args[1]])
            else:
                store[place] = build(*[store[arg] for arg in args])
        return tuple([store[root] for root in self._roots])


def _rebuilt(node: Expr, *args: Expr) -> Expr:
    return rebuild(node, args)
