"""Proving that a tree is zero but for the rounding of its numbers.

Where the equation of a surface is put upon a point, everything cancels, except that the surface's
radii and axes are rounded. In the normal form, with squares of roots taken and denominators
cleared, rounding is what is left of coefficients; what does not cancel is larger by far.
"""

from __future__ import annotations

from fractions import Fraction

from pc2cad.expression.angle_multiples import written_out
from pc2cad.expression.normal_form import Monomial, NormalForm, normal_form, times
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, number, power, symbol

#: what rounding may leave of coefficients, as a share of the largest: the carriers of short pieces,
#: which look like many others, come with digits lost, though nothing is off by more than rounding
ROUNDING = 1e-10
#: longer forms are given up
LARGEST = 2000
#: roots and denominators that are taken out, one at a time
MOST_STEPS = 24

#: stands for what the tree is measured by; no parameter has such a name
_MEASURE = symbol("|")


def is_zero_to_rounding(root: Expr, measure: Expr) -> bool:
    """Say whether a tree is proved to be zero but for rounding, relative to another tree.

    Both are polynomials in the same coordinates, whose coefficients are of one size.
    """
    form = normal_form(written_out(root + _MEASURE * measure), LARGEST)
    for _ in range(MOST_STEPS):
        if form is None:
            return False
        atom = next((a for m in form for a, e in m if _step(a, e)), None)
        if atom is None:
            break
        form = _cleared(form, atom)
    else:
        return False
    left, whole = (_largest(form, measured) for measured in (False, True))
    return left <= ROUNDING * whole


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


def _cleared(form: NormalForm, atom: Expr) -> NormalForm | None:
    """Return the form times a denominator, or with the squares of a root taken."""
    below, square = _denominator(atom), _squared(atom)
    parts: dict[int, NormalForm] = {}
    for monomial, coefficient in form.items():
        rest = tuple((a, e) for a, e in monomial if a is not atom)
        parts.setdefault(dict(monomial).get(atom, 0), {})[rest] = coefficient
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


def _largest(form: NormalForm, measured: bool) -> float:
    """Return the largest coefficient, constants multiplied out, of one of the two trees."""
    sums: dict[Monomial, float] = {}
    for monomial, coefficient in form.items():
        if ((_MEASURE, 1) in monomial) != measured:
            continue
        value = float(coefficient)
        for atom, exponent in monomial:
            if not atom.symbols:
                value *= evaluate(atom, {}) ** exponent
        moving = tuple((a, e) for a, e in monomial if a.symbols)
        sums[moving] = sums.get(moving, 0.0) + value
    return max((abs(value) for value in sums.values()), default=0.0)
