"""Exact polynomial normal forms of expression trees.

A tree becomes a polynomial with rational coefficients in *atoms*: symbols, constants such as pi,
and whole sub-trees that are not polynomial (function calls, reciprocals, fractional powers). Two
trees with one normal form are equal; the converse needs identities between atoms, of which only
sin² = 1 - cos² is applied here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import lru_cache
from math import gcd, lcm
from typing import Final

from pc2cad.expression.recent import Recent
from pc2cad.expression.tree import (
    ONE,
    PI,
    ZERO,
    Expr,
    add,
    call,
    div,
    mul,
    number,
    power,
    walk,
)

#: A monomial: (atom, exponent) pairs in a fixed order. Atoms are compared by identity.
Monomial = tuple[tuple[Expr, int], ...]
#: A polynomial in atoms: no entry is zero.
NormalForm = dict[Monomial, Fraction]
#: a coefficient while forms are made: numerator and positive denominator, with common factors
_Ratio = tuple[int, int]
#: such a form: fractions take ten times as long to multiply
Raw = dict[Monomial, _Ratio]

#: Normal forms with more terms than this are given up: a proof that large is not worth its time.
LARGEST_FORM: Final = 3000
#: the same for the angles of sines and cosines
LARGEST_ANGLE: Final = 12
_angles: Final[Recent[Raw]] = Recent()
#: forms of products all of whose factors are one term each: sums of the same products are met
_monomials: Final[Recent[Raw]] = Recent()
#: most coefficients are this very object, which needs no multiplication
_UNIT: Final[_Ratio] = (1, 1)


class _TooLargeError(Exception):
    pass


def normal_form(
    root: Expr,
    largest: int = LARGEST_FORM,
    whole: Callable[[Expr], bool] | None = None,
    known: dict[Expr, Raw] | None = None,
) -> NormalForm | None:
    """Return the normal form of a tree, or None when it has more than `largest` terms.

    Sub-trees that are `whole` are atoms, whatever they are made of. Forms of nodes are taken from
    `known`, and put there: what the same two arguments left there before.
    """
    forms: dict[Expr, Raw] = {} if known is None else known

    def below(node: Expr) -> tuple[Expr, ...]:
        if node in forms:
            return ()
        if whole is not None:
            if whole(node):
                forms[node] = {((node, 1),): _UNIT}
                return ()
        elif (remembered := _monomials.get(node)) is not None:
            forms[node] = remembered
            return ()
        return _inner(node)

    try:
        for node in walk((root,), below):
            if node not in forms:
                forms[node] = form = _form_of(node, forms, largest)
                term = whole is None and node.op == "mul" and len(form) == 1
                if term and all(map(_is_monomial, node.args)):
                    _monomials.keep(node, form)
    except _TooLargeError:
        return None
    return _in_lowest_terms(forms[root])


def times(form: NormalForm, factor: Expr, largest: int = LARGEST_FORM) -> NormalForm | None:
    """Return the normal form of a product, or None when it has more than `largest` terms."""
    other = normal_form(factor, largest)
    try:
        if other is None:
            return None
        return _in_lowest_terms(_product(_raw(form), _raw(other), largest))
    except _TooLargeError:
        return None


def determinant_form(
    columns: Sequence[Sequence[Expr]], largest: int = LARGEST_FORM
) -> NormalForm | None:
    """Return the normal form of a determinant (3 × 3) times some positive number.

    None beyond `largest` terms. The number makes all coefficients of each column whole, as
    fractions are dear to multiply.
    """
    known: dict[Expr, Raw] = {}
    whole: list[list[Raw]] = []
    for column in columns:
        forms = []
        for tree in column:
            form = normal_form(tree, largest, known=known)
            if form is None:
                return None
            forms.append(form)
        common = lcm(*(c.denominator for form in forms for c in form.values()))
        whole.append([_whole(form, common) for form in forms])
    a, b, c = whole
    total: Raw = {}
    try:
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            second = {m: (-n, d) for m, (n, d) in _product(b[k], c[j], largest).items()}
            minor = _sum(_product(b[j], c[k], largest), second, largest)
            total = _sum(total, _product(a[i], minor, largest), largest)
    except _TooLargeError:
        return None
    return _in_lowest_terms(total)


def _whole(form: NormalForm, common: int) -> Raw:
    """Return a form times a common denominator, in whole numbers."""
    return {m: (c.numerator * (common // c.denominator), 1) for m, c in form.items()}


def with_square(
    form: NormalForm, atom: Expr, square: NormalForm, largest: int = LARGEST_FORM
) -> NormalForm | None:
    """Return a form with the square of an atom put for it, None beyond `largest` terms."""
    total: Raw = {}
    squared = _raw(square)
    try:
        for monomial, coefficient in form.items():
            term: Raw = {(): coefficient.as_integer_ratio()}
            for a, exponent in monomial:
                pairs, rest = divmod(exponent, 2) if a is atom else (0, exponent)
                if pairs:
                    term = _product(term, _raised(squared, pairs, largest), largest)
                if rest:
                    term = _product(term, {((a, rest),): _UNIT}, largest)
            total = _sum(total, term, largest)
    except _TooLargeError:
        return None
    return _in_lowest_terms(total)


def tree_of(form: NormalForm) -> Expr:
    """Return a normal form as a tree."""
    total = ZERO
    for monomial, coefficient in form.items():
        term = number(coefficient)
        for atom, exponent in monomial:
            term = mul(term, power(atom, number(exponent)))
        total = add(total, term)
    return total


def _inner(node: Expr) -> tuple[Expr, ...]:
    """Return the operands that the form is made of: none for an atom."""
    op = node.op
    if op in ("add", "neg", "mul"):
        return node.args
    # what is within limits is equal to its argument wherever it has a value
    if op in ("within", "div") or (op == "pow" and _is_repeated(node.args[1])):
        return node.args[:1]
    return ()


def _is_repeated(exponent: Expr) -> bool:
    if exponent.op != "number" or exponent.payload.denominator != 1:
        return False
    return bool(0 < exponent.payload.numerator <= 64)


def _is_monomial(node: Expr) -> bool:
    """Say whether a factor is one term, and so is every factor of it: no form below is longer."""
    if node.op == "div":
        node = node.args[0]
    return not _inner(node) or _monomials.get(node) is not None


def _form_of(node: Expr, forms: dict[Expr, Raw], largest: int) -> Raw:
    op = node.op
    if op == "mul":
        a, b = node.args
        return _product(forms[a], forms[b], largest)
    if op == "add":
        a, b = node.args
        return _sum(forms[a], forms[b], largest)
    if op == "number":
        return {(): node.payload.as_integer_ratio()} if node.payload else {}
    if op == "within":
        return forms[node.args[0]]
    if op == "neg":
        return {m: (-n, d) for m, (n, d) in forms[node.args[0]].items()}
    if op == "div":
        inverse: Raw = {((_reciprocal(node.args[1]), 1),): _UNIT}
        return _product(forms[node.args[0]], inverse, largest)
    if op == "pow" and _is_repeated(node.args[1]):
        return _raised(forms[node.args[0]], int(node.args[1].payload), largest)
    return {((node, 1),): _UNIT}


def _raised(form: Raw, exponent: int, largest: int) -> Raw:
    result = form
    for _ in range(exponent - 1):
        result = _product(result, form, largest)
    return result


def _reciprocal(denominator: Expr) -> Expr:
    return div(ONE, denominator)


def _sum(a: Raw, b: Raw, largest: int) -> Raw:
    if a.keys().isdisjoint(b):
        result = a | b
    else:
        result = dict(a)
        for monomial, coefficient in b.items():
            _accumulate(result, monomial, coefficient)
    if len(result) > largest:
        raise _TooLargeError
    return result


def _product(a: Raw, b: Raw, largest: int) -> Raw:
    if len(a) == 1 == len(b):  # as of most products
        ((left, p),), ((right, q),) = a.items(), b.items()
        terms = _join(left, right)
        if len(terms) == 1:
            return {terms[0][0]: _times(p, q)}
    if len(a) * len(b) > 20 * largest:
        raise _TooLargeError
    for one, other in ((a, b), (b, a)):
        if len(one) == 1 and () in one:  # a number
            factor = one[()]
            return other if factor is _UNIT else {m: _times(factor, c) for m, c in other.items()}
    result: Raw = {}
    for left, p in a.items():
        for right, q in b.items():
            both = _times(p, q)
            for monomial, sign in _join(left, right):
                _accumulate(result, monomial, both if sign == 1 else (sign * both[0], both[1]))
    if len(result) > largest:
        raise _TooLargeError
    return result


def _times(p: _Ratio, q: _Ratio) -> _Ratio:
    return q if p is _UNIT else p if q is _UNIT else (p[0] * q[0], p[1] * q[1])


def _accumulate(form: Raw, monomial: Monomial, coefficient: _Ratio) -> None:
    before = form.get(monomial)
    if before is None:
        form[monomial] = coefficient
        return
    (n, d), (m, e) = before, coefficient
    if d == e:
        numerator, denominator = n + m, d
    else:  # over the least common denominator, less what the sum shares with what they share
        share = gcd(d, e)
        numerator = n * (e // share) + m * (d // share)
        common = gcd(numerator, share)
        numerator, denominator = numerator // common, d // share * (e // common)
    if numerator:
        form[monomial] = numerator, denominator
    else:
        del form[monomial]


def _raw(form: NormalForm) -> Raw:
    return {monomial: c.as_integer_ratio() for monomial, c in form.items()}


def _in_lowest_terms(form: Raw) -> NormalForm:
    return {monomial: Fraction(n, d) for monomial, (n, d) in form.items()}


def _join(left: Monomial, right: Monomial) -> list[tuple[Monomial, int]]:
    """Multiply two monomials; squares of sines and of square roots are rewritten."""
    if not left:
        return [(right, 1)]
    if not right:
        return [(left, 1)]
    exponents: dict[Expr, int] = dict(left)
    for atom, exponent in right:
        exponents[atom] = exponents[atom] + exponent if atom in exponents else exponent
    rows = [*exponents.items()]
    sines = [atom for atom, exponent in rows if exponent > 1 and atom.op == "sin"]
    if not sines:
        rows.sort(key=lambda row: row[0].rank)
        return [(tuple(rows), 1)]
    terms: list[tuple[dict[Expr, int], int]] = [(exponents, 1)]
    for atom in sines:
        terms = [piece for term in terms for piece in _without_square(term, atom)]
    return [(ordered(powers), factor) for powers, factor in terms]


def _without_square(
    term: tuple[dict[Expr, int], int], sine: Expr
) -> list[tuple[dict[Expr, int], int]]:
    powers, factor = term
    if powers.get(sine, 0) < 2:
        return [term]
    cosine = _cosine(sine.args[0])
    lower = {**powers, sine: powers[sine] - 2}
    higher = {**lower, cosine: lower.get(cosine, 0) + 2}
    return _without_square((lower, factor), sine) + _without_square((higher, -factor), sine)


@lru_cache(maxsize=4096)
def _cosine(angle: Expr) -> Expr:
    return call("cos", angle)  # finds the angle's own normal form each time


def ordered(powers: dict[Expr, int]) -> Monomial:
    """Return the monomial of powers, in the order that normal forms keep."""
    rows = [item for item in powers.items() if item[1]]
    if len(rows) > 1:
        rows.sort(key=lambda row: row[0].rank)
    return tuple(rows)


def is_identically_zero(root: Expr) -> bool:
    """Return True when the normal form proves the tree to be zero (False proves nothing)."""
    if root is ZERO:
        return True
    form = normal_form(root)
    return form is not None and not form


@lru_cache(maxsize=256)  # trees are interned, and the same angle is asked for again and again
def split_turns(root: Expr) -> tuple[Fraction, Expr]:
    """Return (r, rest) with root = r·pi + rest, rest in a canonical order of its terms."""
    if root.op == "pieces":
        return Fraction(0), root
    form = _angle_form(root)
    if form is None:
        return Fraction(0), root
    turns = form.get(((PI, 1),), Fraction(0))
    rest = ZERO
    # printing a tree is dear: what stands alone needs no order
    terms = [monomial for monomial in form if monomial != ((PI, 1),)]
    for monomial in sorted(terms, key=_printed) if len(terms) > 1 else terms:
        negative = form[monomial].numerator < 0
        term = number(-form[monomial] if negative else form[monomial])
        factors = sorted(monomial, key=lambda f: repr(f[0])) if len(monomial) > 1 else monomial
        for atom, exponent in factors:
            term = mul(term, power(atom, number(exponent)))
        rest = rest - term if negative else rest + term
    return turns, rest


def _angle_form(root: Expr) -> NormalForm | None:
    """Return the normal form of an angle, None beyond `LARGEST_ANGLE` terms.

    Angles that are sums on top of one another are met one by one: forms are remembered.
    """
    forms: dict[Expr, Raw] = {}

    def below(node: Expr) -> tuple[Expr, ...]:
        known = _angles.get(node)
        if known is None:
            return _inner(node)
        forms[node] = known
        return ()

    try:
        for node in walk((root,), below):
            if node not in forms:
                forms[node] = _form_of(node, forms, LARGEST_ANGLE)
                if _inner(node):
                    _angles.keep(node, forms[node])
    except _TooLargeError:
        return None
    return _in_lowest_terms(forms[root])


def _printed(monomial: Monomial) -> str:
    return "*".join(sorted(f"{atom!r}^{exponent}" for atom, exponent in monomial))
