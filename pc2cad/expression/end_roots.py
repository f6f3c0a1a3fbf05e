"""Roots that end at a limit of their parameters, taken out of the root.

sqrt(t²(1-t)²q) is t(1-t)·sqrt(q) for t in [0, 1]; written so, it has finite derivatives. Arcs whose
sine (or cosine) reaches 1 at a limit are written with atan2, whose derivatives are finite there.
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from itertools import product

from pc2cad.expression.normal_form import NormalForm, normal_form
from pc2cad.expression.rewriting import nodes_of, rewrite
from pc2cad.expression.sign_changes import keeps_sign, on_cells, sign_changes
from pc2cad.expression.tree import ONE, ZERO, Expr, call, number, ops_of, power, symbol

#: the operations that polynomials are made of: others are not worked out to see them cancel
POLYNOMIAL = frozenset(("number", "symbol", "add", "neg", "mul", "pow"))
#: functions that are analytic everywhere, and what is where nothing vanishes
_ANALYTIC = POLYNOMIAL | {
    "constant", "sin", "cos", "exp", "sinh", "cosh", "tanh", "atan", "asinh", "fourier", "div",
    "sqrt",
}  # fmt: skip
#: those of them that need something that vanishes nowhere
_ENDING = frozenset(("div", "sqrt", "pow"))


def take_out_ends(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return the trees with powers of parameters t, and of 1-t, taken out of roots of polynomials.

    Every symbol is a local parameter and runs from 0 to 1.
    """
    changes = {"sqrt": _factored, "pow": _factored, "asin": _arc, "acos": _arc}
    for op, change in changes.items():
        roots = rewrite(roots, op, change, keep=True)
    return roots


@lru_cache(maxsize=8)
def is_analytic(roots: tuple[Expr, ...]) -> bool:
    """Say whether trees are known to be analytic up to the limits: their powers there are whole.

    They are made of analytic functions, and what they divide by, or take roots of, depends on one
    parameter and vanishes nowhere, as enclosures prove. Every symbol runs from 0 to 1.
    """
    held = ops_of(roots)
    if not held <= _ANALYTIC:
        return False
    for node in [n for op in held & _ENDING for n in nodes_of(roots, op)]:
        ending, has_root = ONE, node.op == "sqrt"
        if node.op in ("div", "sqrt"):
            ending = node.args[-1]
        elif node.op == "pow":
            exponent = node.args[1]
            whole = exponent.op == "number" and exponent.payload.denominator == 1
            has_root = not whole
            ending = ONE if whole and exponent.payload > 0 else node.args[0]
            if exponent.symbols:
                return False
        if len(ending.symbols) > 1:
            return False
        for name in ending.symbols:
            values = on_cells(ending, name)
            if not keeps_sign(values) or (has_root and values.upper.flat[0] < 0):
                return False
    return True


def root_exponent(node: Expr) -> Fraction | None:
    """Return the positive, broken exponent of a square root or power of parameters, else None."""
    exponent = Fraction(1, 2)
    if node.op == "pow":
        if node.args[1].op != "number":
            return None
        exponent = node.args[1].payload
    return exponent if exponent.denominator > 1 and exponent > 0 and node.symbols else None


def of_one_sign(node: Expr) -> Expr:
    """Return an absolute value without it where its argument changes its sign nowhere.

    What is returned may be less than 0 by rounding, where the argument vanishes.
    """
    if node.op != "abs" or len(node.symbols) != 1:
        return node
    changes = sign_changes(node.args[0])
    if changes is None or changes.places:
        return node
    return node.args[0] if changes.signs == (1,) else -node.args[0]


def _factored(node: Expr) -> Expr:
    """Return a root with whole powers taken out."""
    exponent = root_exponent(node)
    if exponent is None:
        return node
    below = rewrite(node.args, "abs", of_one_sign, keep=True)[0]
    form = _polynomial(below)
    if form is None:
        return node
    step, outside = exponent.denominator, ONE
    for name in sorted(node.symbols):
        t = symbol(name)
        times = min(dict(monomial).get(t, 0) for monomial in form) // step
        if times:
            form = {_lowered(monomial, t, times * step): c for monomial, c in form.items()}
            outside = outside * t ** (times * exponent.numerator)
    if len(node.symbols) == 1:
        t = symbol(next(iter(node.symbols)))
        coefficients = _coefficients(form, t)
        while (shorter := _without_end(coefficients, step)) is not None:
            coefficients = shorter
            outside = outside * (1 - t) ** exponent.numerator
        form = {((t, k),) if k else (): c for k, c in enumerate(coefficients) if c}
    inside = _zeros_told(form)
    if inside is None and outside is ONE and below is node.args[0]:
        return node
    inside = _tree(form) if inside is None else inside
    if inside is ONE:
        return outside
    return outside * (call("sqrt", inside) if node.op == "sqrt" else power(inside, node.args[1]))


def _zeros_told(form: NormalForm) -> Expr | None:
    """Return a sum of polynomials in one parameter each with their zeros at ends as factors.

    Where all of them vanish at a corner at which 1-t is small, the rounding of sums would be taken
    for the value of the root. None where that is no corner, or the polynomial no such sum.
    """
    names = {name: [Fraction(0)] for name in sorted({a.payload for m in form for a, _ in m})}
    if len(names) < 2 or any(len(monomial) > 1 for monomial in form):
        return None
    for monomial, coefficient in form.items():
        for atom, exponent in monomial:
            row = names[atom.payload]
            row += [Fraction(0)] * (exponent + 1 - len(row))
            row[exponent] += coefficient
    constant = form.get((), Fraction(0))
    for corner in product((0, 1), repeat=len(names)):
        if 1 in corner:
            offsets = [sum(row) if end else row[0]
                       for end, row in zip(corner, names.values(), strict=True)]  # fmt: skip
            if sum(offsets) + constant == 0:
                rows = zip(names.items(), offsets, strict=True)
                parts = [_by_zeros([row[0] - off, *row[1:]], symbol(n)) for (n, row), off in rows]
                return sum(parts, start=ZERO)
    return None


def _by_zeros(coefficients: list[Fraction], t: Expr) -> Expr:
    """Return a polynomial in t as a product with powers of t and 1-t, as high as there are."""
    start = end = 0
    while len(coefficients) > 1 and coefficients[0] == 0:
        coefficients, start = coefficients[1:], start + 1
    while (shorter := _without_end(coefficients, 1)) is not None:
        coefficients, end = shorter, end + 1
    rest = _tree({((t, k),) if k else (): c for k, c in enumerate(coefficients) if c})
    return t**start * (1 - t) ** end * rest


def _arc(node: Expr) -> Expr:
    """Return an arc sine or cosine with finite derivatives where it ends at a limit."""
    x = node.args[0]
    across = call("sqrt", 1 - x * x)
    taken_out = _factored(across)
    if taken_out is across:
        return node
    return call("atan2", x, taken_out) if node.op == "asin" else call("atan2", taken_out, x)


def _polynomial(tree: Expr) -> NormalForm | None:
    """Return the normal form of a polynomial in the parameters with rational coefficients."""
    if not tree.ops <= POLYNOMIAL:
        return None
    form = normal_form(tree, largest=60)
    if not form or any(atom.op != "symbol" for monomial in form for atom, _ in monomial):
        return None
    return form


def _lowered(
    monomial: tuple[tuple[Expr, int], ...], t: Expr, by: int
) -> tuple[tuple[Expr, int], ...]:
    return tuple((a, e - by if a is t else e) for a, e in monomial if a is not t or e > by)


def _coefficients(form: NormalForm, t: Expr) -> list[Fraction]:
    """Return the ascending coefficients of a polynomial in one parameter."""
    powers = {dict(monomial).get(t, 0): c for monomial, c in form.items()}
    return [powers.get(k, Fraction(0)) for k in range(max(powers) + 1)]


def _tree(form: NormalForm) -> Expr:
    total = ZERO
    for monomial in sorted(form, key=lambda m: sorted((a.payload, e) for a, e in m)):
        term = number(form[monomial])
        for atom, exponent in monomial:
            term = term * atom**exponent
        total = total + term
    return total


def _without_end(coefficients: list[Fraction], times: int) -> list[Fraction] | None:
    """Divide by (1-t) so many times, or return None where that leaves a remainder."""
    quotient = coefficients
    for _ in range(times):
        if len(quotient) < 2 or sum(quotient) != 0:
            return None
        # p = (1-t) q with q_k = p_0 + … + p_k
        sums, total = [], Fraction(0)
        for c in quotient[:-1]:
            total += c
            sums.append(total)
        quotient = sums
    return quotient
