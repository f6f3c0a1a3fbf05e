"""Proving that a tree is zero but for the rounding of its numbers.

Where the equation of a surface is put upon a point, everything cancels, except that the surface's
radii and axes are rounded. In the normal form, with squares of roots taken and denominators
cleared, rounding is what is left of the terms, each bounded by its value over the unit box.
"""

from __future__ import annotations

from fractions import Fraction
from math import fsum

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.angle_multiples import written_out
from pc2cad.expression.magnitudes import MOST_LOST, bounds, largest_seen, least
from pc2cad.expression.normal_form import Monomial, NormalForm, normal_form, times
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, number, power

#: longer forms are given up
LARGEST = 2000
#: roots and denominators that are taken out, one at a time
MOST_STEPS = 24


def is_zero_to_rounding(root: Expr, measure: Expr) -> bool:
    """Say whether a tree is proved to be zero but for rounding, relative to another tree.

    Both are polynomials in the same coordinates, whose coefficients are of one size. The first is
    bounded over the unit box of its parameters, of the second counts what is seen at samples. The
    carriers of short pieces, which look like many others, come with digits lost: what may be left
    is `MOST_LOST` of the second.
    """
    form = normal_form(written_out(root), LARGEST)
    cleared: list[Expr] = []
    for _ in range(MOST_STEPS):
        if form is None:
            return False
        atom = next((a for m in form for a, e in m if _step(a, e)), None)
        if atom is None:
            break
        form = _cleared(form, atom, cleared)
    else:
        return False
    return bool(_bound(form, cleared) <= MOST_LOST * largest_seen(measure))


def _step(atom: Expr, exponent: int) -> bool:
    """Say whether an atom is a denominator, or a square of a root."""
    if not atom.symbols:
        return False
    return _denominator(atom) is not None or (exponent >= 2 and _squared(atom) is not None)


def _denominator(atom: Expr) -> Expr | None:
    if atom.op == "div":
        return atom.args[1]
    exponent = _exponent(atom)
    return power(atom.args[0], number(-exponent)) if exponent is not None and exponent < 0 else None


def _squared(atom: Expr) -> Expr | None:
    """Return the square of a square root, also of odd powers of one."""
    if atom.op == "sqrt":
        return atom.args[0]
    exponent = _exponent(atom)
    if exponent is None or exponent.denominator != 2:
        return None
    return power(atom.args[0], number(2 * exponent))


def _exponent(atom: Expr) -> Fraction | None:
    if atom.op != "pow" or atom.args[1].op != "number":
        return None
    exponent: Fraction = atom.args[1].payload
    return exponent


def _cleared(form: NormalForm, atom: Expr, factors: list[Expr]) -> NormalForm | None:
    """Return the form times a denominator, or with the squares of a root taken.

    What the form is multiplied by is added to the factors.
    """
    below, square = _denominator(atom), _squared(atom)
    parts: dict[int, NormalForm] = {}
    for monomial, coefficient in form.items():
        rest = tuple((a, e) for a, e in monomial if a is not atom)
        parts.setdefault(dict(monomial).get(atom, 0), {})[rest] = coefficient
    if below is not None:
        factors += [below] * max(parts)
    total: NormalForm = {}
    for exponent, part in parts.items():
        if below is not None:
            factor = power(below, number(max(parts) - exponent))
        else:
            assert square is not None
            factor = power(square, number(exponent // 2)) * power(atom, number(exponent % 2))
        grown = times(part, factor, LARGEST)
        if grown is None:
            return None
        for monomial, coefficient in grown.items():
            total[monomial] = total.get(monomial, Fraction(0)) + coefficient
    return {monomial: c for monomial, c in total.items() if c}


def _bound(form: NormalForm, factors: list[Expr]) -> float:
    """Return a proved bound of a form over the product of its factors, on the unit box."""
    sums: dict[Monomial, list[float]] = {}
    for monomial, coefficient in form.items():
        value = float(coefficient)
        for atom, exponent in monomial:
            if not atom.symbols:
                value *= evaluate(atom, {}) ** exponent
        moving = tuple((a, e) for a, e in monomial if a.symbols)
        sums.setdefault(moving, []).append(value)
    total: Array = np.zeros(())
    with np.errstate(all="ignore"):
        for moving, values in sums.items():
            size = abs(fsum(values))
            if size:
                total = total + size * bounds(moving)
        for factor in factors:
            total = np.where(total == 0, 0.0, total / least(factor))
    return float(np.max(total))
