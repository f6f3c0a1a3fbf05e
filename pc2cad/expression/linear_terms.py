"""Sums with the terms that cancel taken out.

A point equation says N + (R - N)·x, and K - N later: as trees these hold N twice, which costs time,
digits, and above all the sharpness of an enclosure, which cannot know that both are one value.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Final

from pc2cad.expression.budget import is_counted
from pc2cad.expression.recent import Recent
from pc2cad.expression.tree import ONE, ZERO, Expr, number, rebuild, walk

#: a tree as a linear form: coefficients of the nodes that are no sums
_Terms = dict[Expr, Fraction]
#: linear forms with more terms are not remembered: chains of sums have one another's
MOST_TERMS: Final = 32
#: most coefficients are this very object, which needs no multiplication
_UNIT: Final = Fraction(1)

#: what is remembered: variants of a template, and the pieces of a map, have most trees in common
_forms: Final[Recent[_Terms]] = Recent()
_without: Final[Recent[Expr]] = Recent()


def cancel_terms(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return equal trees in which no sum, however nested, holds a term and its opposite.

    Sums in which nothing cancels keep their form, so that what several trees share stays shared.
    What becomes of a tree does not depend on others.
    """
    terms: dict[Expr, _Terms] = {}

    def find(node: Expr, done: dict[Expr, Expr]) -> Expr:
        args = tuple([done[arg] for arg in node.args])
        return _without_lost(node if args == node.args else rebuild(node, args), terms)

    known = Recent[Expr]() if is_counted() else _without
    done = known.of(roots, find, lambda node: None if node.args else node)
    return tuple([done[root] for root in roots])


def _without_lost(node: Expr, terms: dict[Expr, _Terms]) -> Expr:
    """Return a node of whose operands nothing is lost without the terms that it loses."""
    if node.op == "add":
        a, b = node.args
        if a is not b and not _summed(a) and not _summed(b):
            return node  # two atoms, or one and a number
        left = terms[a] if a in terms else _terms_of(a, terms)
        right = terms[b] if b in terms else _terms_of(b, terms)
        if left.keys().isdisjoint(right):
            return node
        total = _terms_of(node, terms)
        if len(total) < len({*left, *right}):
            node = ZERO
            for atom, coefficient in total.items():
                node = node + number(coefficient) * atom
    elif node.op == "mul" and _is_multiple(node) and _is_multiple(node.args[1]):
        found = _terms_of(node, terms)
        if len(found) == 1:  # a number times a multiple is one multiple
            ((atom, coefficient),) = found.items()
            node = number(coefficient) * atom
    return node


def _terms_of(node: Expr, terms: dict[Expr, _Terms]) -> _Terms:
    """Return the linear form of a tree as it is; `terms` holds those found before."""
    found = _known(node, terms)
    if found is not None:
        return found

    def below(inner: Expr) -> tuple[Expr, ...]:
        return () if _known(inner, terms) is not None else _summed(inner)

    # of most sums the operands were met before
    missing = tuple([arg for arg in _summed(node) if _known(arg, terms) is None])
    for inner in (*walk(missing, below), node) if missing else (node,):
        if inner not in terms:
            terms[inner] = _form_of(inner, terms)
            if len(terms[inner]) <= MOST_TERMS:
                _forms.keep(inner, terms[inner])
    return terms[node]


def _known(node: Expr, terms: dict[Expr, _Terms]) -> _Terms | None:
    """Return a node's form from `terms`, which those of atoms and remembered ones join, or None."""
    found = terms.get(node)
    if found is None:
        found = _forms.get(node)
        if found is None:
            if _summed(node):
                return None
            found = _form_of(node, terms)
        terms[node] = found
    return found


def _summed(node: Expr) -> tuple[Expr, ...]:
    """Return the operands that a node's form is made of: none for an atom."""
    op = node.op
    if op == "mul":
        return node.args[1:] if node.args[0].op == "number" else ()
    return node.args if op == "add" or op == "neg" else ()


def _is_multiple(node: Expr) -> bool:
    return node.op == "mul" and node.args[0].op == "number"


def _form_of(node: Expr, terms: dict[Expr, _Terms]) -> _Terms:
    """Return the linear form of a node whose operands have theirs."""
    op = node.op
    if op == "add":
        a, b = node.args
        left, right = terms[a], terms[b]
        if left.keys().isdisjoint(right):
            return left | right
        total = dict(left)
        for atom, coefficient in right.items():
            before = total.get(atom)
            total[atom] = coefficient if before is None else before + coefficient
        return {atom: coefficient for atom, coefficient in total.items() if coefficient}
    if op == "neg":
        return {a: -c for a, c in terms[node.args[0]].items()}
    if op == "mul" and node.args[0].op == "number":
        factor: Fraction = node.args[0].payload
        return {a: factor if c is _UNIT else factor * c for a, c in terms[node.args[1]].items()}
    if op == "number":
        return {ONE: node.payload} if node.payload else {}
    return {node: _UNIT}
