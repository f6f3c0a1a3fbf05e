"""Arguments of which all are whole multiples of one: cos 2x and cos 3x are polynomials of cos x.

So are tan, sinh, cosh and tanh in terms of sine, cosine and exponentials, and sines of arc sines
are algebraic: what hides a relation between functions is written out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import lru_cache, reduce
from math import gcd, lcm

from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.rewriting import rewrite
from pc2cad.expression.tree import ONE, ZERO, Expr, call, div, number, power, walk

#: multiples beyond this are left as they are
LARGEST_MULTIPLE = 12


@lru_cache(maxsize=1024)
def ratio(a: Expr, b: Expr) -> Fraction | None:
    """Return the rational r with a = r·b, proved from the normal forms, or None."""
    first, second = normal_form(a, largest=24), normal_form(b, largest=24)
    if not first or not second or set(first) != set(second):
        return None
    ratios = {first[m] / second[m] for m in first}
    return ratios.pop() if len(ratios) == 1 else None


def common(a: Fraction, b: Fraction) -> Fraction:
    """Return the largest number of which both are whole multiples."""
    bottom = lcm(a.denominator, b.denominator)
    return Fraction(gcd(int(a * bottom), int(b * bottom)), bottom)


def common_unit(arguments: Sequence[Expr], largest: int) -> Expr | None:
    """Return a tree of which all arguments are whole multiples, up to the largest one, or None."""
    ratios = [ratio(argument, arguments[0]) for argument in arguments]
    known = [r for r in ratios if r is not None]
    if len(known) < len(ratios):
        return None
    unit = reduce(common, (abs(r) for r in known))
    return None if max(abs(r / unit) for r in known) > largest else arguments[0] * unit


def written_out(root: Expr) -> Expr:
    """Return an equal tree in powers of sines, cosines and exponentials of few arguments."""
    roots: tuple[Expr, ...] = (root,)
    for op, change in _PLAINER.items():
        roots = rewrite(roots, op, change)
    for ops, power_of in ((("sin", "cos"), _wave), (("exp",), _exponential)):
        found = {n.args[0]: None for n in walk(roots) if n.op in ops and n.args[0].symbols}
        for unit, arguments in _groups(list(found)):
            multiples = {a: r for a in arguments if (r := ratio(a, unit)) is not None}
            if any(r != 1 for r in multiples.values()):
                for op in ops:
                    roots = rewrite(roots, op, _in_powers(multiples, unit, power_of))
    return roots[0]


def _groups(arguments: list[Expr]) -> list[tuple[Expr, list[Expr]]]:
    """Return the arguments that are multiples of one another, with a unit of each group."""
    groups: list[list[Expr]] = []
    for argument in arguments:
        group = next((g for g in groups if ratio(argument, g[0]) is not None), None)
        if group is None:
            groups.append([argument])
        else:
            group.append(argument)
    units = [(common_unit(group, LARGEST_MULTIPLE), group) for group in groups]
    return [(unit, group) for unit, group in units if unit is not None]


def _in_powers(
    multiples: dict[Expr, Fraction], unit: Expr, power_of: Callable[[str, Expr, int], Expr]
) -> Callable[[Expr], Expr]:
    def change(node: Expr) -> Expr:
        multiple = multiples.get(node.args[0])
        return node if multiple is None else power_of(node.op, unit, int(multiple))

    return change


def _wave(op: str, unit: Expr, multiple: int) -> Expr:
    """Return the sine or cosine of a multiple, from the powers of cos x + i sin x."""
    cosine, sine = ONE, ZERO
    c, s = call("cos", unit), call("sin", unit)
    for _ in range(abs(multiple)):
        cosine, sine = cosine * c - sine * s, sine * c + cosine * s
    if op == "cos":
        return cosine
    return sine if multiple > 0 else -sine


def _exponential(op: str, unit: Expr, multiple: int) -> Expr:
    whole = power(call(op, unit), number(abs(multiple)))
    return whole if multiple > 0 else div(ONE, whole)


def _hyperbolic(sign: int) -> Callable[[Expr], Expr]:
    def change(node: Expr) -> Expr:
        up = call("exp", node.args[0])
        return (up + sign * div(ONE, up)) * Fraction(1, 2)

    return change


def _tanh(node: Expr) -> Expr:
    up = call("exp", 2 * node.args[0])
    return div(up - 1, up + 1)


def _arc(node: Expr) -> Expr:
    """Return the sine or cosine of an arc function without it."""
    inner, op = node.args[0], node.op
    if inner.op not in ("asin", "acos", "atan", "atan2"):
        return node
    x = inner.args[0]
    if inner.op in ("asin", "acos"):
        return x if inner.op == f"a{op}" else call("sqrt", 1 - x * x)
    # of a point with these coordinates
    up, along = (x, ONE) if inner.op == "atan" else inner.args
    return div(up if op == "sin" else along, call("sqrt", up * up + along * along))


_PLAINER: dict[str, Callable[[Expr], Expr]] = {
    "tan": lambda node: div(call("sin", node.args[0]), call("cos", node.args[0])),
    "sinh": _hyperbolic(-1),
    "cosh": _hyperbolic(1),
    "tanh": _tanh,
    "sin": _arc,
    "cos": _arc,
}
