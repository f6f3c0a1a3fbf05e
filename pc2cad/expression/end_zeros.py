"""Roots of functions that vanish at a limit of their parameter, with the zero taken out.

sqrt(sin(pi t)) is sqrt(t)·sqrt(1-t)·sqrt(C) with a C that is analytic and positive. Near a zero, C
is the power series there, as long as the bound of what it leaves is less than rounding; elsewhere
it is the quotient. Then only powers of t and 1-t are left that are not smooth, and those are what
a change of the parameter makes smooth (`end_roots`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import isfinite

import numpy as np

from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.end_roots import POLYNOMIAL, of_one_sign, root_exponent
from pc2cad.expression.normal_form import is_identically_zero
from pc2cad.expression.power_series import series_at_zero
from pc2cad.expression.rewriting import rewrite
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.sign_changes import keeps_sign, on_cells, sign_changes
from pc2cad.expression.tree import (  # fmt: skip
    ANALYTIC,
    ONE,
    ZERO,
    Expr,
    ValueDomainError,
    number,
    pieces,
    power,
    substitute,
    symbol,
)

#: coefficients of a series, how far it may be taken, and the highest zero that is looked for
_COUNT, _REACHES, _HIGHEST = 26, (0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625), 6
#: what a series may leave, relative to the function
_ROUNDING = 2.0**-54
#: how far a simple zero may be from the end, of a parameter of length 1
_ULPS = 2.0**-50
#: least values beside an end, of the largest there, that let none near it be taken for zero
_FAR = 2.0**-30


@dataclass(frozen=True)
class _Zero:
    """A zero at t = 0: its order, and what is left without it, up to a reach."""

    order: int
    reach: Fraction
    #: of the series without the zero, ascending
    coefficients: tuple[float, ...]

    def rest(self, t: Expr) -> Expr:
        """Return the function over t^order as a polynomial."""
        value: Expr = ZERO
        for coefficient in reversed(self.coefficients):
            value = value * t + number(coefficient)
        return value


def take_out_zeros(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return the trees with the zeros of analytic functions taken out of roots.

    Every symbol is a local parameter and runs from 0 to 1. Only zeros at 0 and 1 that are exact
    are taken out, of functions of one parameter that are positive between.
    """
    for op in ("sqrt", "pow"):
        roots = rewrite(roots, op, _without_zeros, keep=True)
    return roots


def _without_zeros(node: Expr) -> Expr:
    exponent = root_exponent(node)
    # of polynomials they are taken out by algebra
    if exponent is None or node.args[0].ops <= POLYNOMIAL | {"abs"}:
        return node
    outside, inside = ONE, ONE
    for factor, times in _factors(node.args[0]):
        parts = _parted(of_one_sign(factor)) if times > 0 else None
        if parts is None:
            inside = inside * power(factor, number(times))
            continue
        *ends, rest = parts
        for end, order in ends:
            outside = outside * power(end, number(order * times * exponent))
        outside = outside * power(rest, number(times * exponent))
    if outside is ONE:
        return node
    return outside if inside is ONE else outside * power(inside, number(exponent))


def _factors(tree: Expr) -> list[tuple[Expr, Fraction]]:
    """Return factors and their exponents."""
    if tree.op == "mul":
        return [*_factors(tree.args[0]), *_factors(tree.args[1])]
    if tree.op == "div":
        return [*_factors(tree.args[0]), *((f, -n) for f, n in _factors(tree.args[1]))]
    if tree.op == "pow" and tree.args[1].op == "number" and tree.args[1].payload.denominator == 1:
        return [(f, n * tree.args[1].payload) for f, n in _factors(tree.args[0])]
    return [(tree, Fraction(1))]


@lru_cache(maxsize=64)  # variants have most of their roots in common
def _parted(tree: Expr) -> tuple[tuple[Expr, int], tuple[Expr, int], Expr] | None:
    """Return t and 1-t with the orders of zeros at 0 and 1, and what is left; None without any."""
    if len(tree.symbols) != 1:
        return None
    (name,) = tree.symbols
    if _stays_clear(tree, name):
        return None
    t = symbol(name)
    (turned,) = substitute((tree,), {name: 1 - t})
    start, end = _zero(tree, name), _zero(turned, name)
    if start is None and end is None:
        return None
    k, m = (zero.order if zero else 0 for zero in (start, end))
    rows: list[Expr] = [tree / (t**k * (1 - t) ** m)]
    breaks = [Fraction(0), Fraction(1)]
    if start is not None:
        rows.insert(0, start.rest(t) / (1 - t) ** m)
        breaks.insert(1, start.reach)
    if end is not None:
        rows.append(end.rest(1 - t) / t**k)
        breaks.insert(-1, 1 - end.reach)
    if breaks[1:-1] == [Fraction(1, 2)] * 2:
        del breaks[1], rows[1]
    # the quotient has no sign of its own: its numerator has
    if not all(
        _is_positive(row.args[0] if row.op == "div" else row, name, low, high)
        for row, low, high in zip(rows, breaks, breaks[1:], strict=False)
    ):
        return None
    rest = pieces(t, tuple(breaks), tuple((row,) for row in rows), ANALYTIC, closed=False)
    return (t, k), (1 - t, m), rest


def _stays_clear(tree: Expr, name: str) -> bool:
    """Say whether enclosures prove that a function is far from zero beside both ends."""
    values = on_cells(tree, name)
    sizes = np.sort(np.abs([values.lower, values.upper]).reshape(2, -1), axis=0)
    return keeps_sign(values) and bool((sizes[0] > _FAR * sizes[1])[[0, -1]].all())


def _is_positive(tree: Expr, name: str, low: Fraction, high: Fraction) -> bool:
    """Say whether a function is proved to be positive over a part of [0, 1]."""
    (part,) = substitute((tree,), {name: low + (high - low) * symbol(name)})
    if not part.symbols:
        return evaluate(part, {}) > 0
    signs = sign_changes(part)
    return signs is not None and signs.signs == (1,)


def _vanishes(tree: Expr, name: str) -> bool:
    try:
        (value,) = substitute((tree,), {name: ZERO})
    except ValueDomainError:
        return False  # a quotient or a logarithm ends there
    return is_identically_zero(value)


def _vanishes_beside(tree: Expr, name: str) -> bool:
    """Say whether a function has a simple zero so near to 0 that rounding may have moved it.

    The end is where the zero is, then: what is made of M is the same.
    """
    slopes = derivatives((tree,), name)
    try:
        value, slope = (evaluate(t, {name: 0.0}) for t in (tree, *slopes))
    except ValueDomainError:
        return False
    return isfinite(slope) and abs(value) <= _ULPS * abs(slope)


def _zero(tree: Expr, name: str) -> _Zero | None:
    """Return the zero of a function at 0, None where it has none that is known."""
    order = 0
    slopes: Sequence[Expr] = (tree,)
    while order <= _HIGHEST and _vanishes(slopes[0], name):
        slopes = derivatives(tuple(slopes), name)
        order += 1
    if order == 0 and _vanishes_beside(tree, name):
        order = 1
    if not 0 < order <= _HIGHEST:
        return None
    series = series_at_zero(tree, name, _COUNT, _REACHES)
    if series is None:
        return None
    middle = (series.lower + series.upper) / 2
    coefficients = np.where((series.lower <= 0) & (series.upper >= 0), 0.0, middle)[order:-1]
    for k, reach in enumerate(_REACHES):
        places = np.linspace(0.0, reach, 33)
        least = float(np.polynomial.polynomial.polyval(places, coefficients).min())
        left = series.largest[-1, k] * reach ** (_COUNT - 1 - order)
        if left <= _ROUNDING * least:
            return _Zero(order, Fraction(reach), tuple(coefficients.tolist()))
    return None
