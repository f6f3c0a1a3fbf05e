"""Exact change of basis: trees that are polynomial in some parameters to Bernstein coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from math import comb

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.normal_form import NormalForm, normal_form
from pc2cad.expression.recent import Recent
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import ANALYTIC, Expr
from pc2cad.geometry.splines.spline_profile import LARGEST_DEGREE

#: what is remembered as the degree of a tree that is not polynomial
NO_POLYNOMIAL = -1


def degree_in(roots: Sequence[Expr], name: str) -> int | None:
    """Return the degree of the trees in one symbol, or None where they are not polynomial in it.

    Terms that would cancel are counted. Piecewise polynomials count with the degree of their
    pieces: whoever uses the degree must put knots at their breaks.
    """

    def find(node: Expr, degrees: dict[Expr, int]) -> int:
        degree = _node_degree(node, [degrees[arg] for arg in node.args])
        return NO_POLYNOMIAL if degree is None else degree

    degrees = _degrees(name).of(
        tuple(roots), find, lambda node: None if name in node.symbols else 0, worst=NO_POLYNOMIAL
    )
    if NO_POLYNOMIAL in degrees.values():
        return None
    largest = max(degrees[root] for root in roots)
    return largest if largest <= LARGEST_DEGREE else None


@lru_cache(maxsize=8)
def _degrees(_: str) -> Recent[int]:
    """Return what is remembered of degrees in a symbol: most trees are asked for several times."""
    return Recent()


def _node_degree(node: Expr, known: list[int]) -> int | None:
    if node.op == "symbol":
        return 1
    if node.op in ("add", "neg", "within"):
        return max(known)
    if node.op == "mul":
        return sum(known)
    if node.op == "div":
        return known[0] if known[1] == 0 else None
    if node.op == "pow" and node.args[1].op == "number":
        exponent: Fraction = node.args[1].payload
        whole = exponent.denominator == 1 and 0 < exponent <= LARGEST_DEGREE
        return known[0] * int(exponent) if whole else None
    if node.op == "pieces":
        width: int = node.payload.width
        if node.payload.smoothness == ANALYTIC and known[0] != 0:
            return None  # its breaks are not among those of the direction
        return known[0] * (width - 1) + max(known[1:])
    return None


def bernstein(roots: Sequence[Expr], names: Sequence[str]) -> Array | None:
    """Return Bernstein coefficients of trees that are polynomial in `names` on the unit box.

    Shape (n1 + 1, …, len(roots)), degrees n taken as low as the trees allow, at least 1.
    Coefficients that are rational are converted exactly and rounded once. None where a tree is not
    a polynomial, or has a degree above `LARGEST_DEGREE`.
    """
    if any(degree_in(roots, name) is None for name in names):
        return None
    tables = []
    for root in roots:
        form = normal_form(root)
        table = None if form is None else _power_table(form, tuple(names))
        if table is None:
            return None
        tables.append(table)
    degrees = tuple(
        max([1, *(powers[axis] for table in tables for powers in table)])
        for axis in range(len(names))
    )
    if max(degrees) > LARGEST_DEGREE:
        return None
    result = np.empty((*(n + 1 for n in degrees), len(roots)))
    for column, table in enumerate(tables):
        result[..., column] = _change_of_basis(table, degrees)
    return result


_Table = dict[tuple[int, ...], Fraction | float]


def _power_table(form: NormalForm, names: tuple[str, ...]) -> _Table | None:
    """Collect a normal form by powers of the names; None where an atom depends on them."""
    table: _Table = {}
    for monomial, coefficient in form.items():
        powers = [0] * len(names)
        value: Fraction | float = coefficient
        for atom, exponent in monomial:
            if atom.op == "symbol" and atom.payload in names:
                powers[names.index(atom.payload)] = exponent
            elif atom.symbols:
                return None
            else:
                value = float(value) * evaluate(atom, {}) ** exponent
        key = tuple(powers)
        table[key] = table.get(key, Fraction(0)) + value
    return table


def _change_of_basis(table: _Table, degrees: tuple[int, ...]) -> Array:
    shape = tuple(n + 1 for n in degrees)
    exact = all(isinstance(value, Fraction) for value in table.values())
    values = np.zeros(shape, dtype=object if exact else float)
    for powers, value in table.items():
        values[powers] = value
    for axis, n in enumerate(degrees):
        matrix = np.array(
            [
                [Fraction(comb(j, i), comb(n, i)) if i <= j else Fraction(0) for i in range(n + 1)]
                for j in range(n + 1)
            ],
            dtype=object,
        )
        if not exact:
            matrix = matrix.astype(float)
        values = np.moveaxis(np.tensordot(matrix, values, axes=(1, axis)), 0, axis)
    return values.astype(float)


def bezier_knots(degree: int) -> Array:
    """Return the clamped knots of a single Bézier piece on [0, 1]."""
    return np.repeat([0.0, 1.0], degree + 1)


def bernstein_values(degree: int, t: Array) -> Array:
    """Return the Bernstein polynomials of a degree at places t (n,), (n, degree + 1)."""
    k = np.arange(degree + 1)
    factors = np.array([comb(degree, i) for i in range(degree + 1)])
    return np.asarray(factors * t[:, None] ** k * (1 - t[:, None]) ** (degree - k))


@lru_cache(maxsize=64)
def chebyshev_nodes(degree: int) -> Array:
    """Return the Chebyshev-Lobatto nodes on [0, 1]."""
    return np.asarray((1 - np.cos(np.pi * np.arange(degree + 1) / max(degree, 1))) / 2)


@lru_cache(maxsize=64)
def to_powers(degree: int) -> Array:
    """Return the matrix from values at the nodes to coefficients of the powers of t.

    By way of Chebyshev coefficients; those of T_k(2t - 1) are whole numbers.
    """
    rows: list[list[int]] = [[1], [-1, 2]]
    for _ in range(2, degree + 1):
        last, before = rows[-1], [*rows[-2], 0, 0]
        shifted = [0, *(4 * c for c in last)]
        own = [*(-2 * c for c in last), 0]
        rows.append([a + b - c for a, b, c in zip(shifted, own, before, strict=True)])
    powers = np.zeros((degree + 1, degree + 1))
    for k in range(degree + 1):
        powers[: k + 1, k] = rows[k]
    basis = np.polynomial.chebyshev.chebvander(2 * chebyshev_nodes(degree) - 1, degree)
    return np.asarray(powers @ np.linalg.inv(basis))
