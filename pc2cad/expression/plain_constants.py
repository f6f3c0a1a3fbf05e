"""Constant parts of trees, made of their normal forms: what is equal becomes one tree."""

from __future__ import annotations

from fractions import Fraction

from pc2cad.expression.exact import ValueDomainError
from pc2cad.expression.normal_form import Monomial, is_identically_zero, normal_form, tree_of
from pc2cad.expression.tree import Expr, rebuild, walk


def with_plain_constants(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return equal trees whose largest sub-trees without symbols are made of their normal forms.

    Where trees differ by 8·sqrt(2)/4 for 2·sqrt(2) alone, they become the same ones.
    """
    done: dict[Expr, Expr] = {}

    def below(node: Expr) -> tuple[Expr, ...]:
        return tuple([arg for arg in node.args if arg.args]) if node.symbols else ()

    for node in walk(roots, below):
        if node.symbols:
            args = tuple([done.get(arg, arg) for arg in node.args])
            try:
                done[node] = node if args == node.args else rebuild(node, args)
            except ValueDomainError:  # as in a branch that is taken nowhere
                done[node] = node
        else:
            form = None if node.op == "number" else normal_form(node)
            done[node] = node if form is None else tree_of(dict(sorted(form.items(), key=_ranks)))
    return tuple(done[root] for root in roots)


def _ranks(term: tuple[Monomial, Fraction]) -> list[tuple[int, int]]:
    return [(atom.rank, exponent) for atom, exponent in term[0]]


def are_identical(first: tuple[Expr, ...], second: tuple[Expr, ...]) -> bool:
    """Say whether as many trees are proved to be equal, one by one (False proves nothing)."""
    if first != second:  # equal trees are one object
        first, second = with_plain_constants(first), with_plain_constants(second)
    pairs = zip(first, second, strict=True)
    return all(a is b or is_identically_zero(a - b) for a, b in pairs)
