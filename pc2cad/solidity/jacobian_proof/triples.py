"""Vectors of one parameter, and their triple products, without what multiplies a whole vector.

Where A = s·a with a function s, det(A', A, B) is s²·det(a', a, B): the derivative of s, which is
that of a root of a whole frame, cancels. What multiplies a vector and is constant goes to the
factor that the vector has in the sum, and vectors that are then the same one share a term.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import reduce
from operator import add, and_
from typing import Final, NamedTuple

from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.normal_form import normal_form, tree_of
from pc2cad.expression.rewriting import has_more
from pc2cad.expression.separable_sums import signed_terms
from pc2cad.expression.tree import ONE, ZERO, Expr, div, number
from pc2cad.solidity.jacobian_proof.determinant import determinant

#: nodes and terms of a determinant beyond which it is not asked what cancels in it
MOST_NODES: Final = 40
MOST_TERMS: Final = 12
#: a point as a sum of products: vectors of one parameter, and their factors in the others
Products = Sequence[tuple[tuple[Expr, ...], Expr]]


class Scaled(NamedTuple):
    """A vector of one parameter times a function of it, and the factor of both in a sum."""

    length: Expr
    vector: tuple[Expr, ...]
    factor: Expr


def scaled(products: Products, name: str) -> list[Scaled]:
    """Return products with what multiplies all coordinates of a vector by itself."""
    found: dict[tuple[Expr, tuple[Expr, ...]], Expr] = {}
    for vector, factor in products:
        multiple, common, plain = _split(vector)
        moving = [atom for atom in common if name in atom.symbols]
        constant = [atom for atom in common if name not in atom.symbols]
        key = _product(Fraction(1), moving), plain
        found[key] = found.get(key, ZERO) + _product(multiple, constant) * factor
    return [Scaled(*key, factor) for key, factor in found.items() if factor is not ZERO]


def triple(rows: Sequence[Scaled], k: int, i: int, j: int, name: str) -> Expr:
    """Return det(A_k', A_i, A_j) of the vectors A = length·vector."""
    one, a, b = rows[k], rows[i], rows[j]
    length = a.length * b.length
    if k in (i, j):
        length, slope = length * one.length, derivatives(one.vector, name)
    else:
        slope = derivatives(tuple([one.length * x for x in one.vector]), name)
    return length * _short(determinant((slope, a.vector, b.vector)))


def _short(tree: Expr) -> Expr:
    """Return a tree as the one product, or nothing, that its normal form may be."""
    form = None if has_more(tree, MOST_NODES) else normal_form(tree, MOST_TERMS)
    return tree if form is None or len(form) > 1 else tree_of(form)


def minor(first: Expr, second: Expr, names: Sequence[str]) -> Expr:
    """Return f_v g_w - f_w g_v of two factors f and g, in the parameters v and w.

    Where f = p·r and g = q·r, and p and q depend on v alone, as in walls of a section, it is
    r r_w (p_v q - q_v p), without the derivative r_v.
    """
    if not first.symbols or not second.symbols:
        return ZERO
    (p, r), (q, other) = _parted(first), _parted(second)
    for sign, (name, rest) in ((1, names), (-1, names[::-1])):
        if r is other and rest not in p.symbols | q.symbols:
            (p_v, q_v), (r_w,) = derivatives((p, q), name), derivatives((r,), rest)
            return r * r_w * (sign * _short(p_v * q - q_v * p))
    (f_v, g_v), (f_w, g_w) = (derivatives((first, second), name) for name in names)
    return f_v * g_w - g_v * f_w


def _parted(tree: Expr) -> tuple[Expr, Expr]:
    """Return what all terms of a sum, or of a multiple of one, are multiples of, and the rest."""
    outer, atoms = _factors(tree)
    sums = [atom for atom in atoms if atom.op == "add"]
    if len(sums) != 1:
        return tree, ONE
    atoms.remove(sums[0])
    terms = list[tuple[Fraction, Counter[Expr]]]()
    for sign, node in signed_terms(sums[0]):
        multiple, own = _factors(node)
        terms.append((sign * multiple, Counter(own)))
    first, common = terms[0][0], reduce(and_, (own for _, own in terms))
    rest = [_product(multiple / first, (own - common).elements()) for multiple, own in terms]
    return _product(outer * first, [*atoms, *common.elements()]), reduce(add, rest)


def _split(vector: Sequence[Expr]) -> tuple[Fraction, list[Expr], tuple[Expr, ...]]:
    """Return the number and the trees that multiply all coordinates, and what they multiply."""
    rows = [_factors(x) for x in vector]
    moving = [(multiple, Counter(atoms)) for multiple, atoms in rows if multiple]
    if not moving:
        return Fraction(1), [], tuple(vector)
    first, common = moving[0][0], reduce(and_, (atoms for _, atoms in moving))
    rest = tuple([
        _product(multiple / first, (Counter(atoms) - common).elements()) if multiple else ZERO
        for multiple, atoms in rows
    ])  # fmt: skip
    return first, list(common.elements()), rest


def _factors(tree: Expr) -> tuple[Fraction, list[Expr]]:
    """Return a number and the trees whose product a tree is, as it is written."""
    multiple, atoms, stack = Fraction(1), list[Expr](), [tree]
    while stack:
        node = stack.pop()
        if node.op == "number":
            multiple *= node.payload
        elif node.op == "neg":
            multiple = -multiple
            stack.append(node.args[0])
        elif node.op == "mul":
            stack += reversed(node.args)
        elif node.op == "div" and node.args[0] is not ONE:
            stack += [div(ONE, node.args[1]), node.args[0]]
        else:
            atoms.append(node)
    return multiple, atoms


def _product(multiple: Fraction, atoms: Iterable[Expr]) -> Expr:
    return reduce(lambda a, b: a * b, atoms, ONE) * number(multiple)
