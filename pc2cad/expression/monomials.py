"""Monomials of normal forms: their order, products and quotients, and exact division by them."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

from pc2cad.expression.normal_form import Monomial, NormalForm, normal_form, ordered, tree_of
from pc2cad.expression.tree import Expr

#: what monomials are ordered by
Rank = tuple[int, int, list[int]]


def order_of(*forms: NormalForm) -> Callable[[Monomial], Rank]:
    """Return a key that orders monomials: by degree, then by the exponents of their atoms."""
    found = {a for form in forms for m in form for a, _ in m if a.op != "number"}
    atoms = sorted(found, key=lambda a: (not a.symbols, a.rank))

    def key(monomial: Monomial) -> Rank:
        exponents = dict(monomial)
        moving = sum(e for a, e in monomial if a.symbols)
        return moving, sum(exponents.values()), [exponents.get(a, 0) for a in atoms]

    return key


def times(a: Monomial, b: Monomial) -> Monomial:
    """Return the product of two monomials."""
    powers = dict(a)
    for atom, exponent in b:
        powers[atom] = powers.get(atom, 0) + exponent
    return ordered(powers)


def lowered(monomial: Monomial, atom: Expr, exponent: int) -> Monomial:
    """Return a monomial with the exponent of an atom made less."""
    powers = dict(monomial)
    powers[atom] -= exponent
    return ordered(powers)


def over(top: Monomial, bottom: Monomial) -> Monomial | None:
    """Return the quotient of two monomials, None where it is none."""
    powers = dict(top)
    for atom, exponent in bottom:
        if powers.get(atom, 0) < exponent:
            return None
        powers[atom] -= exponent
    return ordered(powers)


def halved(monomial: Monomial) -> Monomial | None:
    """Return the root of a monomial, None where it has none."""
    if any(exponent % 2 for _, exponent in monomial):
        return None
    return ordered({atom: exponent // 2 for atom, exponent in monomial})


def quotient(above: NormalForm, divisor: NormalForm, most: int) -> NormalForm | None:
    """Return the polynomial quotient if at most so many steps leave nothing, else None."""
    order = order_of(above, divisor)
    lead = max(divisor, key=order)
    rest, result = dict(above), dict[Monomial, Fraction]()
    for _ in range(most):
        if not rest:
            return result
        top = max(rest, key=order)
        share = over(top, lead)
        if share is None:
            return None
        factor = rest[top] / divisor[lead]
        result[share] = factor
        for monomial, coefficient in divisor.items():
            place = times(monomial, share)
            left = rest.get(place, Fraction(0)) - factor * coefficient
            if left:
                rest[place] = left
            else:
                rest.pop(place, None)
    return None


def with_multiple(
    form: NormalForm, share: NormalForm, factor: Monomial, most: int
) -> NormalForm | None:
    """Return the normal form of form + share · factor, None beyond so many terms.

    The factor holds no sine; a share may hold squares of sines, which no normal form does.
    """
    if any(a.op == "sin" and e > 1 for monomial in share for a, e in monomial):
        multiple = tree_of(share) * tree_of({factor: Fraction(1)})
        return normal_form(tree_of(form) + multiple, most)
    total = dict(form)
    for monomial, coefficient in share.items():
        place = times(monomial, factor)
        both = total.get(place, Fraction(0)) + coefficient
        if both:
            total[place] = both
        else:
            total.pop(place, None)
    return total if len(total) <= most else None
