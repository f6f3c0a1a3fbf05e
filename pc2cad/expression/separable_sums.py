"""Trees as sums of products: what one parameter does, times what the others do.

The point of a channel is a guide and two vectors of its frame, which depend on u, times coordinates
in the frame's plane, which do not. What has to be known of such a point is known from functions of
one parameter each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Final

from pc2cad.expression.normal_form import ordered
from pc2cad.expression.tree import ONE, ZERO, Expr, add, div, mul, number, power, walk

#: a product of whole powers of trees in the other parameters, in a fixed order
Factors = tuple[tuple[Expr, int], ...]
_TWO: Final = number(2)
_UNIT: Final = Fraction(1)
#: sums with more terms than this are given up
MOST_TERMS = 24


def products(roots: Sequence[Expr], name: str) -> list[dict[Factors, Expr]] | None:
    """Return each tree as Σ factors · coefficient, the coefficients in the named symbol alone.

    The factors are trees without that symbol. None where a tree is no such sum, or too long a one.
    """
    alone = frozenset((name,))
    forms: dict[Expr, dict[Factors, Expr]] = {}
    for node in walk(tuple(roots), lambda n: () if _is_apart(n, alone) else n.args):
        form = _leaf(node, alone) if _is_apart(node, alone) else _joined(node, forms, alone)
        if form is None or len(form) > MOST_TERMS:
            return None
        forms[node] = form
    return [forms[root] for root in roots]


def product_of(factors: Factors) -> Expr:
    """Return the product as a tree."""
    result = ONE
    for atom, exponent in factors:
        result = mul(result, atom if exponent == 1 else power(atom, number(exponent)))
    return result


def vector_products(roots: Sequence[Expr], name: str) -> list[tuple[tuple[Expr, ...], Expr]] | None:
    """Return a point as Σ vector · factor: vectors of the named symbol, factors without it.

    Vectors that are multiples of one another share a term. None where `products` has none.
    """
    columns = products(roots, name)
    if columns is None:
        return None
    found: dict[tuple[Expr, ...], Expr] = {}
    for factors in dict.fromkeys(f for column in columns for f in column):
        multiple, vector = _without_multiple([column.get(factors, ZERO) for column in columns])
        factor = product_of(factors)
        if multiple is not _UNIT:
            factor = mul(number(multiple), factor)
        found[vector] = add(found[vector], factor) if vector in found else factor
    return [(vector, factor) for vector, factor in found.items() if factor is not ZERO]


def _without_multiple(vector: Sequence[Expr]) -> tuple[Fraction, tuple[Expr, ...]]:
    """Return the number by which all coordinates are multiplied, and the vector without it."""
    rows = [_multiple(x) for x in vector]
    first, *others = [m for m, x in rows if x is not ZERO] or [_UNIT]
    if all([m is first or m == first for m in others]):
        return first, tuple([x for _, x in rows])
    return _UNIT, tuple(vector)


def _multiple(tree: Expr) -> tuple[Fraction, Expr]:
    factor = _UNIT
    while True:
        if tree.op == "neg":
            factor, tree = -factor, tree.args[0]
        elif tree.op == "mul" and tree.args[0].op == "number":
            factor, tree = _times(factor, tree.args[0]), tree.args[1]
        elif tree.op == "mul" and tree.args[1].op == "number":
            factor, tree = _times(factor, tree.args[1]), tree.args[0]
        elif tree.op == "number" and tree.payload:
            return _times(factor, tree), ONE
        else:
            return factor, tree


def _times(factor: Fraction, leaf: Expr) -> Fraction:
    """Return the product with a number; most factors are the one object, and need none."""
    payload: Fraction = leaf.payload
    return payload if factor is _UNIT else factor * payload


def without_number(root: Expr) -> tuple[Fraction, Expr]:
    """Return a number that a sum of products is multiplied by, and what it multiplies.

    It is that of the first product; sums within products are left alone.
    """
    first, total = Fraction(0), ZERO
    for sign, node in signed_terms(root):
        factor, rest = _number_and_rest(node)
        first = first or sign * factor
        total = total + (number(sign * factor / first) * rest if first else ZERO)
    return (first, total) if first else (Fraction(1), ZERO)


def signed_terms(root: Expr) -> Iterator[tuple[int, Expr]]:
    """Yield the terms of a sum of sums as they are written, each with its sign, 1 or -1."""
    stack = [(root, 1)]
    while stack:
        node, sign = stack.pop()
        if node.op == "neg":
            stack.append((node.args[0], -sign))
        elif node.op == "add":
            stack += [(arg, sign) for arg in reversed(node.args)]
        else:
            yield sign, node


def _number_and_rest(product: Expr) -> tuple[Fraction, Expr]:
    """Return the number in a product of products, and the product of what else there is."""
    found: dict[Expr, tuple[Fraction, Expr]] = {}
    for node in walk((product,), _factors):
        known = [found[arg] for arg in _factors(node)]
        if node.op == "number":
            found[node] = node.payload, ONE
        elif not known:
            found[node] = _UNIT, node
        elif node.op == "mul":
            (p, a), (q, b) = known
            found[node] = q if p is _UNIT else p if q is _UNIT else p * q, mul(a, b)
        else:
            ((p, a),) = known
            found[node] = (-p, a) if node.op == "neg" else (p * p, power(a, _TWO))
    return found[product]


def _factors(node: Expr) -> tuple[Expr, ...]:
    if node.op in ("mul", "neg"):
        return node.args
    return node.args[:1] if node.op == "pow" and node.args[1] is _TWO else ()


def _is_apart(node: Expr, alone: frozenset[str]) -> bool:
    return node.symbols <= alone or node.symbols.isdisjoint(alone)


def _leaf(node: Expr, alone: frozenset[str]) -> dict[Factors, Expr]:
    if node.symbols <= alone:
        return {(): node} if node is not ZERO else {}
    return {((node, 1),): ONE}


def _joined(
    node: Expr, forms: dict[Expr, dict[Factors, Expr]], alone: frozenset[str]
) -> dict[Factors, Expr] | None:
    if node.op == "add":
        result = dict(forms[node.args[0]])
        for factors, coefficient in forms[node.args[1]].items():
            result[factors] = add(result.get(factors, ZERO), coefficient)
        return {f: c for f, c in result.items() if c is not ZERO}
    if node.op == "neg":
        return {f: -c for f, c in forms[node.args[0]].items()}
    if node.op == "mul":
        return _product(*(forms[arg] for arg in node.args))
    if node.op == "div" and _is_apart(node.args[1], alone):
        return _product(forms[node.args[0]], _leaf(div(ONE, node.args[1]), alone))
    exponent = node.args[1].payload if node.op == "pow" and node.args[1].op == "number" else None
    if exponent is not None and exponent.denominator == 1 and 0 < exponent.numerator <= 8:
        form = base = forms[node.args[0]]
        for _ in range(int(exponent) - 1):
            form = _product(form, base)
        return form
    return None


def _product(a: dict[Factors, Expr], b: dict[Factors, Expr]) -> dict[Factors, Expr]:
    result: dict[Factors, Expr] = {}
    for left, p in a.items():
        for right, q in b.items():
            factors = left or right
            if left and right:
                powers = dict(left)
                for atom, exponent in right:
                    powers[atom] = powers.get(atom, 0) + exponent
                factors = ordered(powers)
            term = mul(p, q)
            result[factors] = add(result[factors], term) if factors in result else term
    return {f: c for f, c in result.items() if c is not ZERO}
