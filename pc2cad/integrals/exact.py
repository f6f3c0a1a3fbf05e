"""Integrals of polynomial maps in closed form, over the rationals.

det J of a polynomial map is a polynomial: volume and centroid are sums of fractions. The area of a
plane polynomial face is the length of the integral of M_s × M_t, whose direction does not change.
Everything is exact until the last rounding to a float.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations_with_replacement, product
from math import lcm, prod, sqrt

from pc2cad.domain.analysis import Analysis
from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import Expr, ops_of
from pc2cad.topology.cells import Cell, directions_of, normal_direction

#: powers of u, v and w to integer coefficients
_Polynomial = dict[tuple[int, int, int], int]
#: what a polynomial is made of; normal forms say whether it is one
_POLYNOMIAL = {"number", "symbol", "add", "neg", "mul", "div", "pow"}
#: the span of a parameter that runs through the box
WHOLE = (Fraction(0), Fraction(1))
#: products of coefficients beyond which quadrature is quicker
MOST_PRODUCTS = 300_000


@dataclass(frozen=True)
class ExactIntegrals:
    """Volume (without its sign), centroid, and the areas of faces (None: not plane)."""

    volume: Fraction
    centroid: tuple[Fraction, Fraction, Fraction]
    face_areas: tuple[float | None, ...]


def exact_integrals(analysis: Analysis) -> ExactIntegrals | None:
    """Return the integrals of a map that is polynomial with rational coefficients, or None."""
    found = _polynomials(analysis)
    if found is None:
        return None
    volume = _integral(found.determinant)
    if not volume:
        return None
    first, second, third = (
        _integral(_product(f, found.determinant)) / volume / found.scale for f in found.map
    )
    areas = [
        _plane_area(analysis, face.patch, found.tangents, found.scale)
        for face in analysis.boundary.faces
    ]
    return ExactIntegrals(abs(volume) / found.scale**3, (first, second, third), tuple(areas))


def exact_second_moments(analysis: Analysis) -> tuple[tuple[Fraction, ...], ...] | None:
    """Return ∫(r - c)_i (r - c)_j dV about the centroid c, (3, 3) in units^5, or None.

    For maps that `exact_integrals` knows, unless quadrature is quicker.
    """
    found = _polynomials(analysis)
    if found is None:
        return None
    pairs = [_product(f, g) for f, g in combinations_with_replacement(found.map, 2)]
    if max(map(len, pairs)) * len(found.determinant) > MOST_PRODUCTS:
        return None
    volume = _integral(found.determinant)
    if not volume:
        return None
    first = [_integral(_product(f, found.determinant)) for f in found.map]
    second = iter([_integral(_product(f, found.determinant)) for f in pairs])
    table: dict[tuple[int, int], Fraction] = {}
    for i, j in combinations_with_replacement(range(3), 2):
        about = (next(second) - first[i] * first[j] / volume) / found.scale**5
        table[i, j] = table[j, i] = about if volume > 0 else -about
    return tuple(tuple(table[i, j] for j in range(3)) for i in range(3))


def exact_weighted(analysis: Analysis, trees: Sequence[Expr]) -> list[Fraction] | None:
    """Return ∫ f dV for trees f of the local parameters, or None where one is no polynomial.

    For maps that `exact_integrals` knows, unless quadrature is quicker.
    """
    found = _polynomials(analysis)
    if found is None or not ops_of(trees) <= _POLYNOMIAL:
        return None
    sign = 1 if _integral(found.determinant) > 0 else -1
    result = []
    for tree in trees:
        table = _table(tree)
        if table is None or len(table) * len(found.determinant) > MOST_PRODUCTS:
            return None
        scale = lcm(*(c.denominator for c in table.values()))
        whole = {powers: int(c * scale) for powers, c in table.items()}
        total = _integral(_product(whole, found.determinant))
        result.append(sign * total / scale / found.scale**3)
    return result


@dataclass(frozen=True)
class _Polynomials:
    """A polynomial map times `scale`, so that coefficients are whole; its tangents and det J."""

    map: tuple[_Polynomial, ...]
    tangents: list[list[_Polynomial]]
    determinant: _Polynomial
    scale: int


def _polynomials(analysis: Analysis) -> _Polynomials | None:
    coordinates = analysis.map.coordinates
    if not ops_of(coordinates) <= _POLYNOMIAL:
        return None  # functions that would cancel are not worth a long expansion
    tables = [_table(tree) for tree in coordinates]
    known = [table for table in tables if table is not None]
    if len(known) < 3 or prod(max(1, len(table)) for table in known) > MOST_PRODUCTS:
        return None
    scale = lcm(*(c.denominator for table in known for c in table.values()))
    scaled = tuple({p: int(c * scale) for p, c in table.items()} for table in known)
    tangents = [[_derivative(f, d) for f in scaled] for d in range(3)]
    determinant = _sum(
        _product(f, g) for f, g in zip(tangents[0], _cross(*tangents[1:]), strict=True)
    )
    return _Polynomials(scaled, tangents, determinant, scale)


def _table(tree: Expr) -> dict[tuple[int, int, int], Fraction] | None:
    """Return a tree's coefficients by powers, or None where it is no rational polynomial."""
    form = normal_form(tree, largest=400)
    if form is None:
        return None
    table = {}
    for monomial, coefficient in form.items():
        powers = [0, 0, 0]
        for atom, exponent in monomial:
            if atom.op != "symbol":
                return None
            powers[PARAMETERS.index(atom.payload)] = exponent
        table[(powers[0], powers[1], powers[2])] = coefficient
    return table


def _derivative(f: _Polynomial, direction: int) -> _Polynomial:
    result: _Polynomial = {}
    for powers, c in f.items():
        if powers[direction]:
            lower = list(powers)
            lower[direction] -= 1
            result[(lower[0], lower[1], lower[2])] = c * powers[direction]
    return result


def _product(f: _Polynomial, g: _Polynomial) -> _Polynomial:
    result: _Polynomial = {}
    for (a, b, c), p in f.items():
        for (i, j, k), q in g.items():
            powers = (a + i, b + j, c + k)
            result[powers] = result.get(powers, 0) + p * q
    return result


def _sum(terms: Iterable[_Polynomial], sign: int = 1) -> _Polynomial:
    result: _Polynomial = {}
    factor = 1
    for term in terms:
        for powers, c in term.items():
            result[powers] = result.get(powers, 0) + factor * c
        factor *= sign
    return result


def _cross(a: list[_Polynomial], b: list[_Polynomial]) -> list[_Polynomial]:
    return [
        _sum((_product(a[i], b[j]), _product(a[j], b[i])), sign=-1)
        for i, j in ((1, 2), (2, 0), (0, 1))
    ]


def _integral(f: _Polynomial) -> Fraction:
    """Return the integral over the unit box."""
    shares = [((a + 1) * (b + 1) * (c + 1), value) for (a, b, c), value in f.items()]
    # whole numbers over one denominator: fractions are slow to add
    common = lcm(*(share for share, _ in shares))
    return Fraction(sum(value * (common // share) for share, value in shares), common)


def _integral_over(f: _Polynomial, spans: Sequence[tuple[Fraction, Fraction]]) -> Fraction:
    """Return the integral over a box."""
    if all(span == WHOLE for span in spans):
        return _integral(f)
    total = Fraction(0)
    for powers, c in f.items():
        total += c * prod(
            (high ** (n + 1) - low ** (n + 1)) / (n + 1)
            for n, (low, high) in zip(powers, spans, strict=True)
        )
    return total


def _plane_area(
    analysis: Analysis, patch: Cell, tangents: list[list[_Polynomial]], scale: int
) -> float | None:
    """Return the area of a plane face, or None where M_s × M_t turns."""
    d = normal_direction(patch)
    limit = patch[d] // 2
    if len(analysis.bounds[d]) != 2:
        return None
    s, t = directions_of(patch)
    along = [[_restricted(f, d, limit) for f in tangents[axis]] for axis in (s, t)]
    normal = _cross(*along)
    vectors = [[f.get(powers, 0) for f in normal] for powers in set().union(*normal)]
    first = next((v for v in vectors if any(v)), None)
    if first is None:
        return None
    for v, (i, j) in product(vectors, ((0, 1), (1, 2), (2, 0))):
        if v[i] * first[j] != v[j] * first[i]:
            return None
    spans = [WHOLE] * 3
    for axis in (s, t):
        low, high = analysis.span(axis, patch[axis])
        spans[axis] = Fraction(low), Fraction(high)
    square = sum(_integral_over(f, spans) ** 2 for f in normal)
    return sqrt(square / scale**4)


def _restricted(f: _Polynomial, direction: int, limit: int) -> _Polynomial:
    """Return the polynomial at 0 or 1 of one direction."""
    result: _Polynomial = {}
    for powers, c in f.items():
        if limit or not powers[direction]:
            rest = list(powers)
            rest[direction] = 0
            key = (rest[0], rest[1], rest[2])
            result[key] = result.get(key, 0) + c
    return result
