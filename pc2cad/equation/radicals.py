"""Square roots that end at a limit of their parameter, taken out of the root.

sqrt(t²(1-t)²q) is t(1-t)·sqrt(q) for t in [0, 1]; written so, it has finite derivatives.
"""

from __future__ import annotations

from fractions import Fraction

from pc2cad.equation.normal_form import normal_form
from pc2cad.equation.tree import ONE, ZERO, Expr, call, number, rewrite, walk


def take_out_ends(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return the trees with squares of t and 1-t taken out of square roots of polynomials in t.

    Every symbol is a local parameter and runs from 0 to 1.
    """
    return rewrite(roots, "sqrt", _factored)


def _factored(node: Expr) -> Expr:
    if len(node.symbols) != 1:
        return node
    (name,) = node.symbols
    coefficients = _polynomial(node.args[0], name)
    if coefficients is None:
        return node
    t = next(n for n in walk((node,)) if n.op == "symbol")
    outside = ONE
    while len(coefficients) > 2 and coefficients[0] == coefficients[1] == 0:
        coefficients = coefficients[2:]
        outside = outside * t
    while (shorter := _without_end(coefficients)) is not None:
        coefficients = shorter
        outside = outside * (1 - t)
    if outside is ONE:
        return node
    inside = ZERO
    for c in reversed(coefficients):
        inside = inside * t + number(c)
    return outside * call("sqrt", inside)


def _polynomial(tree: Expr, name: str) -> list[Fraction] | None:
    """Return ascending rational coefficients in the symbol, or None."""
    form = normal_form(tree, largest=60)
    if not form:
        return None
    result: dict[int, Fraction] = {}
    for monomial, coefficient in form.items():
        if any(atom.op != "symbol" or atom.payload != name for atom, _ in monomial):
            return None
        result[sum(exponent for _, exponent in monomial)] = coefficient
    return [result.get(k, Fraction(0)) for k in range(max(result) + 1)]


def _without_end(coefficients: list[Fraction]) -> list[Fraction] | None:
    """Divide by (1-t)², or return None where that leaves a remainder."""
    quotient = coefficients
    for _ in range(2):
        if len(quotient) < 2 or sum(quotient) != 0:
            return None
        # p = (1-t) q with q_k = p_0 + … + p_k
        sums, total = [], Fraction(0)
        for c in quotient[:-1]:
            total += c
            sums.append(total)
        quotient = sums
    return quotient
