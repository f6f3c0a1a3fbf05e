"""Integrals of polynomial maps in closed form, over the rationals.

det J of a polynomial map is a polynomial: volume and centroid are sums of fractions. The area of a
plane polynomial face is the length of the integral of M_s × M_t, whose direction does not change.
Everything is exact until the last rounding to a float.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations_with_replacement
from itertools import product as pairs_of
from math import lcm, prod, sqrt

from pc2cad.domain.analysis import Analysis
from pc2cad.expression.polynomials import (
    MOST_PRODUCTS,
    POLYNOMIAL,
    Polynomial,
    cross,
    polynomials,
    product,
    rational_polynomial,
)
from pc2cad.expression.tree import Expr, ops_of
from pc2cad.topology.cells import Cell, directions_of, normal_direction


@dataclass(frozen=True)
class ExactIntegrals:
    """Volume (without its sign), centroid, and the areas of faces (None: not plane)."""

    volume: Fraction
    centroid: tuple[Fraction, Fraction, Fraction]
    face_areas: tuple[float | None, ...]


def exact_integrals(analysis: Analysis) -> ExactIntegrals | None:
    """Return the integrals of a map that is polynomial with rational coefficients, or None."""
    found = polynomials(analysis.map.coordinates)
    if found is None:
        return None
    volume = _integral(found.determinant)
    if not volume:
        return None
    below = volume * found.scale
    first, second, third = (_integral(product(f, found.determinant)) / below for f in found.map)
    areas = [
        _plane_area(analysis, face.patch, found.tangents, found.scale)
        for face in analysis.boundary.faces
    ]
    return ExactIntegrals(abs(volume) / found.scale**3, (first, second, third), tuple(areas))


def exact_second_moments(analysis: Analysis) -> tuple[tuple[Fraction, ...], ...] | None:
    """Return ∫(r - c)_i (r - c)_j dV about the centroid c, (3, 3) in units^5, or None.

    For maps that `exact_integrals` knows, unless quadrature is quicker.
    """
    found = polynomials(analysis.map.coordinates)
    if found is None:
        return None
    pairs = [product(f, g) for f, g in combinations_with_replacement(found.map, 2)]
    if max(map(len, pairs)) * len(found.determinant) > MOST_PRODUCTS:
        return None
    volume = _integral(found.determinant)
    if not volume:
        return None
    first = [_integral(product(f, found.determinant)) for f in found.map]
    second = iter([_integral(product(f, found.determinant)) for f in pairs])
    table: dict[tuple[int, int], Fraction] = {}
    for i, j in combinations_with_replacement(range(3), 2):
        about = (next(second) - first[i] * first[j] / volume) / found.scale**5
        table[i, j] = table[j, i] = about if volume > 0 else -about
    return tuple(tuple(table[i, j] for j in range(3)) for i in range(3))


def exact_weighted(analysis: Analysis, trees: Sequence[Expr]) -> list[Fraction] | None:
    """Return ∫ f dV for trees f of the local parameters, or None where one is no polynomial.

    For maps that `exact_integrals` knows, unless quadrature is quicker.
    """
    found = polynomials(analysis.map.coordinates)
    if found is None or not ops_of(trees) <= POLYNOMIAL:
        return None
    sign = 1 if _integral(found.determinant) > 0 else -1
    result = []
    for tree in trees:
        table = rational_polynomial(tree)
        if table is None or len(table[0]) * len(found.determinant) > MOST_PRODUCTS:
            return None
        total = _integral(product(table[0], found.determinant))
        result.append(sign * total / table[1] / found.scale**3)
    return result


def _integral(f: Polynomial) -> Fraction:
    """Return the integral over the unit box."""
    return Fraction(*_quotient(f))


def _quotient(f: Polynomial) -> tuple[int, int]:
    """Return the integral over the unit box as whole numbers: fractions are slow to add."""
    shares = [((a + 1) * (b + 1) * (c + 1), value) for (a, b, c), value in f.items()]
    common = lcm(*[share for share, _ in shares])
    return sum([value * (common // share) for share, value in shares]), common


def _integral_over(f: Polynomial, spans: Sequence[tuple[Fraction, Fraction]]) -> Fraction:
    """Return the integral over a box."""
    total = Fraction(0)
    for powers, c in f.items():
        total += c * prod(
            (high ** (n + 1) - low ** (n + 1)) / (n + 1)
            for n, (low, high) in zip(powers, spans, strict=True)
        )
    return total


def _plane_area(
    analysis: Analysis, patch: Cell, tangents: list[list[Polynomial]], scale: int
) -> float | None:
    """Return the area of a plane face, or None where M_s × M_t turns."""
    d = normal_direction(patch)
    limit = patch[d] // 2
    if len(analysis.bounds[d]) != 2:
        return None
    s, t = directions_of(patch)
    along = [[_restricted(f, d, limit) for f in tangents[axis]] for axis in (s, t)]
    normal = cross(*along)
    vectors = [[f.get(powers, 0) for f in normal] for powers in set().union(*normal)]
    first = next((v for v in vectors if any(v)), None)
    if first is None:
        return None
    for v, (i, j) in pairs_of(vectors, ((0, 1), (1, 2), (2, 0))):
        if v[i] * first[j] != v[j] * first[i]:
            return None
    spans = [(0.0, 1.0)] * 3
    for axis in (s, t):
        spans[axis] = analysis.span(axis, patch[axis])
    if all(span == (0.0, 1.0) for span in spans):
        parts = [_quotient(f) for f in normal]
        common = lcm(*[below for _, below in parts])
        square = sum([(above * (common // below)) ** 2 for above, below in parts])
        return sqrt(square / (common * common * scale**4))
    exact = [(Fraction(low), Fraction(high)) for low, high in spans]
    return sqrt(sum(_integral_over(f, exact) ** 2 for f in normal) / scale**4)


def _restricted(f: Polynomial, direction: int, limit: int) -> Polynomial:
    """Return the polynomial at 0 or 1 of one direction."""
    result: Polynomial = {}
    for powers, c in f.items():
        if limit or not powers[direction]:
            rest = list(powers)
            rest[direction] = 0
            key = (rest[0], rest[1], rest[2])
            result[key] = result.get(key, 0) + c
    return result
