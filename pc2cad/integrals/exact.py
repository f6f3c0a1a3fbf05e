"""Integrals of polynomial maps in closed form, over the rationals.

det J of a polynomial map is a polynomial: volume and centroid are sums of fractions. The area of a
plane polynomial face is the length of the integral of M_s × M_t, whose direction does not change.
Everything is exact until the last rounding to a float.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, combinations_with_replacement
from math import lcm, sqrt

from pc2cad.domain.analysis import Analysis
from pc2cad.expression.polynomials import (
    MOST_PRODUCTS,
    POLYNOMIAL,
    Polynomial,
    Polynomials,
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
    areas = [_plane_area(analysis, face.patch, found) for face in analysis.boundary.faces]
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


def _plane_area(analysis: Analysis, patch: Cell, found: Polynomials) -> float | None:
    """Return the area of a plane face, or None where M_s × M_t turns.

    M is a sum of vectors times powers of s and t. M_s × M_t is a sum over pairs of these, and does
    not turn where the products of all pairs that count are parallel.
    """
    d = normal_direction(patch)
    if len(analysis.bounds[d]) != 2:
        return None
    cell = tuple([patch[d] if axis == d else 1 for axis in range(3)])
    along_s, along_t = (analysis.span(axis, patch[axis]) for axis in directions_of(patch))
    first: tuple[int, int, int] | None = None
    shares: list[tuple[tuple[int, int, int], int, int]] = []
    for ((i, j), a), ((k, m), b) in combinations(found.on(cell).items(), 2):
        if not (turn := i * m - k * j):
            continue
        x, y, z = normal = (
            a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
        )  # fmt: skip
        if not any(normal):
            continue
        first = first or normal
        if x * first[1] != y * first[0] or y * first[2] != z * first[1] or (
            z * first[0] != x * first[2]
        ):  # fmt: skip
            return None
        above, below = _of_powers(along_s, i + k)
        more, under = _of_powers(along_t, j + m)
        shares.append((normal, turn * above * more, below * under))
    common = lcm(*[below for _, _, below in shares])
    total = [sum([n[axis] * c * (common // b) for n, c, b in shares]) for axis in range(3)]
    square = sum([x * x for x in total])
    return sqrt(square / (common * common * found.scale**4)) if square else None


def _of_powers(span: tuple[float, float], n: int) -> tuple[int, int]:
    """Return the integral of x^(n-1) over a span as a quotient of whole numbers."""
    if span == (0.0, 1.0):
        return 1, n
    low, high = map(Fraction, span)
    return ((high**n - low**n) / n).as_integer_ratio()
