"""Proof that det J keeps one sign, from its exact normal form.

det J is a polynomial in atoms: parameters, sines and cosines, roots, constants (see `normal_form`).
Atoms that all terms share are taken out, where they keep a sign inside the box: sin(pi v) between
its zeros, a power of the parameter in which a side collapses, an even power of any. In what is left
each atom, or its square where all its powers are even, is a variable in the range that it has over
the box. A polynomial lies in the convex hull of its Bernstein coefficients there, and these are
taken in whole numbers, without any rounding; where some have the other sign, the ranges are halved
a few times.

A sign is that of det J but for a set without volume, where it may vanish: an analytic function that
is not constant takes no value on more than that (B. Mityagin, The zero set of a real analytic
function, 2015). Between two places of such a set det J has its sign, and degrees are counted there.

Other symbols than u, v and w, the parameters of a template, may be left in the form: spans say in
which intervals they are, ends included, and a sign is that for every value of them. What depends on
them has the sign of an enclosure that keeps off zero: at one value it may be the same everywhere.
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import lru_cache
from math import comb
from typing import Any

import numpy as np

from pc2cad.arrays import BigIntegers, Integers
from pc2cad.arrays.scatter import scattered
from pc2cad.domain.map import Mapping3
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.intervals import enclosed_range, interval
from pc2cad.expression.normal_form import NormalForm, determinant_form, normal_form, ordered
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.polynomials import polynomials
from pc2cad.expression.tree import PI, Expr, symbol, walk
from pc2cad.solidity.jacobian_proof.integer_bernstein import along, sign_inside

Range = tuple[Fraction, Fraction]
#: names of other symbols than u, v and w, and their limits
Spans = tuple[tuple[str, Range], ...]

#: nodes of the derivatives (those inside a piecewise polynomial, which is one atom, do not count),
#: terms of det J, Bernstein coefficients, and halvings beyond which the proof is left to others
MOST_NODES = 300
MOST_TERMS = 200
MOST_COEFFICIENTS = 500
DEEPEST = 4
MOST_BOXES = 64
#: operations that are analytic wherever they are bounded
ANALYTIC = frozenset((
    "number", "constant", "symbol", "add", "neg", "mul", "div", "pow", "sin", "cos", "exp", "sinh",
    "cosh", "tanh",
))  # fmt: skip
#: what is asked of the same few atoms again and again
_remembered = lru_cache(maxsize=256)
#: operations that are unbounded, or have derivatives that are, where this operand vanishes
_ENDING = {"div": 1, "sqrt": 0, "log": 0}
#: what does not run
_STILL: Range = (Fraction(0), Fraction(0))
#: the box
_WHOLE = {name: interval([0.0], [1.0]) for name in PARAMETERS}
#: places at which a function that is not constant has different values, u, v and w
_PLACES = [interval(x, x) for x in scattered(8, 3).T]


def sign_from_factors(mapping: Mapping3) -> int:
    """Return the sign of det J where it is proved to be one inside the box, else 0."""
    form = None if _is_large(mapping) else _form(mapping)
    return sign_of_form(form) if form else 0


def sign_of_form(form: NormalForm, spans: Spans = (), most: int = MOST_COEFFICIENTS) -> int:
    """Return the sign that a form is proved to have inside the box, 0 for none.

    It is one sign for all values in the spans; a proof has so many Bernstein coefficients at most.
    """
    sign, rest = _without_factors(form, spans)
    if of_terms := _sign_of_terms(rest, spans):
        return sign * of_terms
    atoms = sorted({atom for monomial in rest for atom, _ in monomial}, key=repr)
    powers = np.array([[dict(m).get(atom, 0) for atom in atoms] for m in rest], dtype=int)
    powers = powers.reshape(len(rest), len(atoms))
    squared = (powers % 2 == 0).all(axis=0)
    powers = np.where(squared, powers // 2, powers)
    degrees = powers.max(axis=0).tolist()
    if math.prod(n + 1 for n in degrees) > most:
        return 0
    ranges = [_range(atom, spans) for atom in atoms]
    known = [_squared(r) if two else r for r, two in zip(ranges, squared, strict=True) if r]
    if len(known) < len(atoms):
        return 0
    control = _bernstein(list(rest.values()), powers, degrees, known)
    # but for no volume, these stay clear of their limits; other atoms may be at theirs
    clear = tuple(axis for axis, atom in enumerate(atoms) if _spreads(atom))
    return sign * sign_inside(control, clear, DEEPEST, MOST_BOXES, MOST_BOXES * most)


def has_known_ranges(mapping: Mapping3) -> bool:
    """Say whether the atoms of det J are bounded, as far as roots and denominators of M tell.

    Where they are not, det J has seldom its sign from factors, and others are asked first.
    """
    if polynomials(mapping.coordinates) is not None or _is_large(mapping):
        return True  # which is told at once
    nodes = [node for node in walk(mapping.coordinates) if node.symbols and node.op in _ENDING]
    ends = tuple({node.args[_ENDING[node.op]]: None for node in nodes})
    found = IntervalProgram(ends)(_WHOLE)
    return all(bool(np.all(x.lower > 0) or np.all(x.upper < 0)) for x in found)


def _form(mapping: Mapping3) -> NormalForm | None:
    """Return the normal form of det J, times a positive number; None where it is too large."""
    known = polynomials(mapping.coordinates)
    if known is None:
        return determinant_form(mapping.derivatives, MOST_TERMS)
    own = [symbol(name) for name in PARAMETERS]
    form = {
        ordered(dict(zip(own, powers, strict=True))): Fraction(c)
        for powers, c in known.determinant.items()
        if c
    }
    return form if len(form) <= MOST_TERMS else None


def _is_large(mapping: Mapping3) -> bool:
    """Say whether it would be long to multiply det J out, if it has not been done."""
    if polynomials(mapping.coordinates) is not None:
        return False
    return _has_many_nodes(sum(mapping.derivatives, ()))


@lru_cache(maxsize=4)
def _has_many_nodes(roots: tuple[Expr, ...]) -> bool:
    seen, left = set(roots), list(roots)
    while left and len(seen) <= MOST_NODES:
        node = left.pop()
        if node.op != "pieces":
            below = set(node.args) - seen
            seen |= below
            left += below
    return bool(left)


def _without_factors(form: NormalForm, spans: Spans) -> tuple[int, NormalForm]:
    """Divide out the factors of a sign that all terms share; return their sign and the rest."""
    powers = [dict(monomial) for monomial in form]
    sign, taken = 1, {}
    for atom in set.intersection(*(set(row) for row in powers)):
        of_atom, least = _sign_inside(atom, spans), min(row[atom] for row in powers)
        if of_atom or _spreads(atom):
            taken[atom] = least if of_atom else least - least % 2
            sign *= (of_atom or 1) ** taken[atom]
    rest: NormalForm = {}
    for row, coefficient in zip(powers, form.values(), strict=True):
        left = ((atom, n - taken.get(atom, 0)) for atom, n in row.items())
        rest[tuple((atom, n) for atom, n in left if n)] = coefficient
    return sign, rest


def _sign_of_terms(form: NormalForm, spans: Spans) -> int:
    """Return the sign that every term has by itself inside the box, 0 where there is none."""
    signs = set()
    for monomial, coefficient in form.items():
        sign = 1 if coefficient > 0 else -1
        for atom, exponent in monomial:
            even = exponent % 2 == 0 and _spreads(atom)
            sign *= 1 if even else _sign_inside(atom, spans) ** (exponent % 2 or 2)
        signs.add(sign)
        if len(signs) > 1 or 0 in signs:
            return 0
    return signs.pop()


def _sign_inside(atom: Expr, spans: Spans) -> int:
    """Return the sign that an atom has inside the box, but for no volume; 0 if it is not known."""
    if atom.op == "symbol":
        return 1 if atom.payload in PARAMETERS else _sign_of(dict(spans)[atom.payload])
    if atom.op == "sqrt" or (atom.op == "pow" and atom.args[1].op == "number"):
        if _is_root(atom) and _spreads(atom):
            return 1
        inner = max(_sign_inside(atom.args[0], spans), 0)
        return inner or _sign_of(_enclosure(atom, spans))
    turns = _half_turns(atom, spans)
    if turns is not None and math.ceil(turns[1]) - math.floor(turns[0]) == 1:
        return -1 if math.floor(turns[0]) % 2 else 1
    return _sign_of_constant(atom) or _sign_of(_enclosure(atom, spans))


@_remembered
def _sign_of_constant(atom: Expr) -> int:
    """Return the sign that an atom without symbols has by those of its parts, else 0."""
    if atom.symbols:
        return 0
    signs: dict[Expr, int] = {}
    for node in walk((atom,)):
        op, parts = node.op, [signs[arg] for arg in node.args]
        if op == "number":
            signs[node] = (node.payload > 0) - (node.payload < 0)
        elif op in ("mul", "div"):
            signs[node] = parts[0] * parts[1]
        elif op == "neg":
            signs[node] = -parts[0]
        elif op == "add":
            signs[node] = parts[0] if parts[0] == parts[1] else 0
        elif op in ("sqrt", "pow"):
            signs[node] = max(parts[0], 0)
        else:
            signs[node] = int(op == "constant")
    return signs[atom]


def _is_root(atom: Expr) -> bool:
    """Say whether an atom has no negative value, wherever it has one."""
    if atom.op == "pow" and atom.args[1].op == "number":
        return bool(atom.args[1].payload.denominator % 2 == 0)
    return atom.op == "sqrt"


@_remembered
def _spreads(atom: Expr) -> bool:
    """Say whether an atom takes no value on more than a set without volume.

    So does what is analytic over the whole box, where it is bounded, and is not constant; and so
    do its roots. Of what depends on other symbols as well nothing is said.
    """
    if not atom.symbols.issubset(PARAMETERS):
        return False
    inner = atom.args[0] if _is_root(atom) else atom
    if inner.op == "symbol":
        return True
    nodes = tuple(walk((inner,)))
    if any(node.op not in ANALYTIC for node in nodes) or _enclosure(inner, ()) is None:
        return False
    if any(node.op == "pow" and not _is_whole(node.args[1]) for node in nodes):
        return False
    (seen,) = IntervalProgram((inner,))(dict(zip(PARAMETERS, _PLACES, strict=True)))
    return bool(np.max(seen.lower) > np.min(seen.upper))


def _is_whole(exponent: Expr) -> bool:
    return exponent.op == "number" and bool(exponent.payload.denominator == 1)


def _squared(limits: Range) -> Range:
    """Return the limits of the squares of what lies between limits."""
    low, high = sorted(x * x for x in limits)
    return (Fraction(0) if limits[0] < 0 < limits[1] else low), high


def _sign_of(limits: Range | None) -> int:
    if limits is None:
        return 0
    return 1 if limits[0] > 0 else -1 if limits[1] < 0 else 0


def _range(atom: Expr, spans: Spans) -> Range | None:
    """Return limits of an atom over the box, None where there are none."""
    if atom.op == "symbol":
        return dict(spans).get(atom.payload, (Fraction(0), Fraction(1)))
    turns = _half_turns(atom, spans)
    limits = _enclosure(atom, spans)
    if turns is None or limits is None:
        return limits
    # a sine of whole half turns is 0, which no enclosure in floating point says
    low, high = turns
    inside = any(n.denominator == 1 for n in turns)
    if inside and math.ceil(high) - math.floor(low) == 1:
        return (min(limits[0], Fraction(0)), Fraction(0)) if math.floor(low) % 2 else (
            Fraction(0), max(limits[1], Fraction(0))
        )  # fmt: skip
    return limits


@_remembered
def _half_turns(atom: Expr, spans: Spans) -> Range | None:
    """Return a and b where an atom is sin(πx) and x runs evenly from a to b, None elsewhere.

    With other symbols in it, x runs between a and b, whatever they are, and stands still for none
    of their values; or it keeps off a whole a and b.
    """
    if atom.op not in ("sin", "cos"):
        return None
    form = normal_form(atom.args[0], 4)
    if form is None:
        return None
    low = high = Fraction(atom.op == "cos", 2)
    known, step = dict(spans), _STILL
    for monomial, coefficient in form.items():
        powers = dict(monomial)
        if powers.pop(PI, 0) != 1 or any(a.op != "symbol" or n != 1 for a, n in powers.items()):
            return None
        own = [a for a in powers if a.payload in PARAMETERS]
        term = _multiple(coefficient, [known[a.payload] for a in powers if a not in own])
        if len(own) > 1 or (own and (step != _STILL or not _sign_of(term))):
            return None
        step = term if own else step
        low, high = (low, high) if own else (low + term[0], high + term[1])
    if step == _STILL and low < high and any(n.denominator == 1 for n in (low, high)):
        return None
    return low + min(step[0], Fraction(0)), high + max(step[1], Fraction(0))


def _multiple(factor: Fraction, limits: list[Range]) -> Range:
    """Return the limits of a number times others that have limits."""
    low = high = factor
    for a, b in limits:
        ends = low * a, low * b, high * a, high * b
        low, high = min(ends), max(ends)
    return low, high


@_remembered
def _enclosure(atom: Expr, spans: Spans) -> Range | None:
    boxes = _WHOLE | {name: enclosed_range(*limits) for name, limits in spans}
    (found,) = IntervalProgram((atom,))(boxes)
    low, high = float(found.lower.item()), float(found.upper.item())
    return (Fraction(low), Fraction(high)) if math.isfinite(low) and math.isfinite(high) else None


def _bernstein(
    numbers: list[Fraction], powers: Integers, degrees: list[int], ranges: list[Range]
) -> BigIntegers:
    """Return coefficients over the ranges (`integer_bernstein`), times a positive number.

    Given are the coefficients of the terms, and their powers (terms, variables).
    """
    common = math.lcm(*(c.denominator for c in numbers))
    total: Any = np.zeros([n + 1 for n in degrees], dtype=object)
    total[tuple(powers.T)] = [int(c * common) for c in numbers]
    for axis, (degree, limits) in enumerate(zip(degrees, ranges, strict=True)):
        total = along(_powers(degree, limits), total, axis)
    return np.asarray(total, dtype=object)


@lru_cache(maxsize=64)
def _powers(degree: int, limits: Range) -> BigIntegers:
    """Return the coefficients of 1, x … x^degree over limits as columns, times one whole number.

    On them x is high·t + low·(1-t); its powers are raised by those of t + (1-t).
    """
    low, high = limits
    columns = [
        [
            sum(
                (comb(k, j) * high**j * low ** (k - j) * comb(degree - k, i - j)
                 for j in range(max(0, k + i - degree), min(i, k) + 1)),
                start=Fraction(0),
            )
            for i in range(degree + 1)
        ]
        for k in range(degree + 1)
    ]  # fmt: skip
    common = math.lcm(*(x.denominator for column in columns for x in column))
    return np.array([[int(x * common) for x in column] for column in columns], dtype=object).T
