"""Sums with the terms that cancel taken out.

A point equation says N + (R - N)·x, and K - N later: as trees these hold N twice, which costs time,
digits, and above all the sharpness of an enclosure, which cannot know that both are one value.
"""

from __future__ import annotations

from fractions import Fraction

from pc2cad.expression.tree import ONE, ZERO, Expr, number, rebuild, walk

#: a tree as a linear form: coefficients of the nodes that are no sums
_Terms = dict[Expr, Fraction]


def cancel_terms(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return equal trees in which no sum, however nested, holds a term and its opposite.

    Sums in which nothing cancels keep their form, so that what several trees share stays shared.
    """
    done: dict[Expr, Expr] = {}
    terms: dict[Expr, _Terms] = {}
    for node in walk(roots):
        args = tuple(done[arg] for arg in node.args)
        moved = node if args == node.args else rebuild(node, args)
        if moved not in terms:
            moved = _record(moved, terms)
        done[node] = moved
    return tuple(done[root] for root in roots)


def _record(node: Expr, terms: dict[Expr, _Terms]) -> Expr:
    """Work out the terms of a node whose operands are known; return the node without those lost."""
    if node.op == "number":
        terms[node] = {ONE: node.payload} if node.payload else {}
    elif node.op == "add":
        left, right = (_terms_of(arg, terms) for arg in node.args)
        total = dict(left)
        for atom, coefficient in right.items():
            total[atom] = total.get(atom, Fraction(0)) + coefficient
        lost = any(not coefficient for coefficient in total.values())
        total = {atom: coefficient for atom, coefficient in total.items() if coefficient}
        if lost:
            node = ZERO
            for atom, coefficient in total.items():
                node = node + number(coefficient) * atom
        terms[node] = total
    elif node.op == "neg":
        terms[node] = {a: -c for a, c in _terms_of(node.args[0], terms).items()}
    elif node.op == "mul" and node.args[0].op == "number":
        factor: Fraction = node.args[0].payload
        terms[node] = {a: factor * c for a, c in _terms_of(node.args[1], terms).items()}
        if len(terms[node]) == 1 and node.args[1].op == "mul":
            # a number times a multiple is one multiple
            ((atom, coefficient),) = terms[node].items()
            multiple = number(coefficient) * atom
            terms[multiple] = terms[node]
            node = multiple
    else:
        terms[node] = {node: Fraction(1)}
    return node


def _terms_of(node: Expr, terms: dict[Expr, _Terms]) -> _Terms:
    if node not in terms:
        # folding made a node that was no operand before: its own operands may be new as well
        for inner in walk((node,)):
            if inner not in terms:
                _record(inner, terms)
    return terms[node]
