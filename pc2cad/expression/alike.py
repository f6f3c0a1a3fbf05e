"""Pieces of one form as one function of tables, for evaluation.

A section of 200 arcs is 200 cosines, each of an angle of its own; it is one cosine as well, of an
angle whose numbers are looked up by the piece. Each place is then worked out once, not once for
every piece. The values are the same, and so are the operations behind each of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

from pc2cad.expression.rewriting import rewrite
from pc2cad.expression.tree import Expr, Layout, intern, piece_rows, pieces, walk

#: pieces of one form from which on a table is worth its look-up
LEAST: Final = 6
#: what is taken as it is
_WHOLE: Final = frozenset(("pieces", "fourier"))
#: operations whose operands change places freely
_COMMUTATIVE: Final = frozenset(("add", "mul"))
#: the form of what holds no symbol
_CONSTANT: Final = 0


def with_tables(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return trees of the same values, pieces that differ in constants only made one function."""
    return rewrite(roots, "pieces", _tabled, keep=True)


@lru_cache(maxsize=256)  # the map, its derivatives and its sides are made of the same functions
def _tabled(node: Expr) -> Expr:
    argument, layout = node.args[0], node.payload
    flat = node.args[1:]
    if not argument.symbols or not any(c.symbols for c in flat):
        return node
    columns = [_united(column, argument, layout) for column in zip(*piece_rows(node), strict=True)]
    rows = tuple(zip(*columns, strict=True))
    return pieces(argument, layout.breaks, rows, layout.smoothness, layout.closed)


def _united(column: tuple[Expr, ...], argument: Expr, layout: Layout) -> tuple[Expr, ...]:
    """Return the trees of all pieces, those of one form replaced by what holds for all of them."""
    forms = _forms(column)
    alike: dict[int, list[int]] = {}
    for i, tree in enumerate(column):
        alike.setdefault(forms[tree], []).append(i)
    result = list(column)
    for members in alike.values():
        if len(members) < LEAST:
            continue
        # elsewhere anything of this form does: it is not taken there
        of = dict(zip(members, range(len(members)), strict=True))
        places = [of.get(i, 0) for i in range(len(column))]
        one = _one([column[i] for i in members], forms, places, argument, layout)
        for i in members:
            result[i] = one
    return tuple(result)


def _forms(trees: Sequence[Expr]) -> dict[Expr, int]:
    """Return a number for each tree and what is below it: trees of one number differ in constants.

    Exponents are part of a form: powers of small whole numbers are products.
    """
    known: dict[object, int] = {}
    found: dict[Expr, int] = {}
    for node in walk(tuple(trees), _below):
        if not node.symbols:
            found[node] = _CONSTANT
            continue
        key: object = node
        if _below(node):
            inner = [found[arg] for arg in node.args]
            if node.op == "pow":
                key = ("pow", inner[0], node.args[1])
            else:
                ordered = sorted(inner) if node.op in _COMMUTATIVE else inner
                key = (node.op, node.payload, tuple(ordered))
        found[node] = known.setdefault(key, len(known) + 1)
    return found


def _below(node: Expr) -> tuple[Expr, ...]:
    return node.args if node.symbols and node.op not in _WHOLE else ()


def _one(
    trees: list[Expr], forms: dict[Expr, int], places: list[int], argument: Expr, layout: Layout
) -> Expr:
    """Return the function that is each of some trees of one form in the pieces that are its own."""
    done: dict[tuple[Expr, ...], Expr] = {}
    stack = [tuple(trees)]
    while stack:
        nodes = stack[-1]
        first = nodes[0]
        if nodes in done:
            stack.pop()
        elif all(node is first for node in nodes):
            done[stack.pop()] = first
        elif not first.symbols:
            rows = tuple((nodes[k],) for k in places)
            done[stack.pop()] = pieces(argument, layout.breaks, rows, -1, layout.closed)
        else:
            operands = list(zip(*(_ordered(node, forms) for node in nodes), strict=True))
            missing = [each for each in operands if each not in done]
            stack += missing
            if not missing:
                args = tuple(done[each] for each in operands)
                done[stack.pop()] = intern(first.op, args, first.payload)
    return done[tuple(trees)]


def _ordered(node: Expr, forms: dict[Expr, int]) -> tuple[Expr, ...]:
    if node.op not in _COMMUTATIVE:
        return node.args
    return tuple(sorted(node.args, key=forms.__getitem__))
