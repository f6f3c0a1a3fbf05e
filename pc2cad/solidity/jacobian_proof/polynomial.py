"""Proof that det J keeps one sign, from Bernstein coefficients.

A polynomial lies in the convex hull of its Bernstein coefficients: when those of det J are all of
one sign, and not all zero, det J cannot vanish inside the box. Where they are not, the box is
halved a few times; what is then still open is left to others. With coordinates N/D the sign is that
of the determinant of N_j D - N D_j, provided that the denominators keep theirs.

All of it is done in whole numbers, without any rounding: coordinates are multiplied by the common
denominator of their coefficients, and what is kept are the coefficients of t^k (1-t)^(n-k), which
are the Bernstein coefficients times positive binomials.
"""

from __future__ import annotations

from math import comb, lcm
from typing import Any

import numpy as np

from pc2cad.arrays import BigIntegers, Integers
from pc2cad.domain.map import Mapping3
from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import ONE, Expr, ops_of, walk
from pc2cad.solidity.jacobian_proof.integer_bernstein import along, sign_inside

_RATIONAL = {"number", "symbol", "add", "neg", "mul", "div", "pow"}
#: halvings of the box, boxes looked at, degree of M, terms of a coordinate and products of
#: coefficients beyond which the proof is given up
DEEPEST = 5
MOST_BOXES = 500
LARGEST_DEGREE = 8
MOST_TERMS = 300
MOST_PRODUCTS = 200_000


def sign_from_coefficients(mapping: Mapping3) -> int:
    """Return the sign of det J where it is proved to be one inside the box, else 0."""
    if not ops_of(mapping.coordinates) <= _RATIONAL:
        return 0
    columns = []
    for pair in fractions(mapping.coordinates):
        above, below = (_control(tree) for tree in pair)
        if above is None or below is None or below.min() < 0 < below.max():
            return 0
        columns.append([_numerator_of_derivative(above, below, d) for d in range(3)])
    tangents = [[row[d] for row in columns] for d in range(3)]
    shapes = [m.shape for column in tangents for m in column]
    sizes = [np.prod(np.max([m.shape for m in column], axis=0)) for column in tangents]
    if max(max(shape) for shape in shapes) > 2 * LARGEST_DEGREE or np.prod(sizes) > MOST_PRODUCTS:
        return 0
    limits = DEEPEST, MOST_BOXES, MOST_PRODUCTS
    return sign_inside(_determinant(tangents), (0, 1, 2), *limits)


def fractions(roots: tuple[Expr, ...]) -> list[tuple[Expr, Expr]]:
    """Return each tree as a numerator and a denominator that hold no division by a symbol."""
    done: dict[Expr, tuple[Expr, Expr]] = {}
    for node in walk(roots):
        args = [done[arg] for arg in node.args]
        done[node] = (node, ONE) if not node.symbols else _fraction(node, args)
    return [done[root] for root in roots]


def _fraction(node: Expr, args: list[tuple[Expr, Expr]]) -> tuple[Expr, Expr]:
    if node.op == "neg":
        return -args[0][0], args[0][1]
    if node.op in ("add", "mul", "div"):
        (a, b), (c, d) = args
        if node.op == "mul":
            return a * c, b * d
        if node.op == "div":
            return a * d, b * c
        return (a + c, b) if b is d else (a * d + c * b, b * d)
    if node.op == "pow" and node.args[1].op == "number" and node.args[1].payload.denominator == 1:
        exponent = node.args[1].payload
        top, bottom = args[0] if exponent > 0 else args[0][::-1]
        return top ** abs(exponent), bottom ** abs(exponent)
    return node, ONE


def _control(tree: Expr) -> BigIntegers | None:
    """Return the coefficients of a polynomial times a positive number; None where it is none."""
    form = normal_form(tree, MOST_TERMS)
    if form is None or any(atom.op != "symbol" for m in form for atom, _ in m):
        return None
    table = {
        tuple(dict((a.payload, e) for a, e in m).get(name, 0) for name in PARAMETERS): c
        for m, c in form.items()
    }
    degrees = np.max([*table, (0, 0, 0)], axis=0)
    if degrees.max() > LARGEST_DEGREE:
        return None
    common = lcm(*(c.denominator for c in table.values()))
    control = np.zeros(degrees + 1, dtype=object)
    for powers, c in table.items():
        control[powers] = int(c * common)
    for axis, n in enumerate(degrees.tolist()):
        # t^j = t^j (t + 1-t)^(n-j)
        rise = [[comb(n - j, k - j) if k >= j else 0 for j in range(n + 1)] for k in range(n + 1)]
        control = along(np.array(rise, dtype=object), control, axis)
    return control


def _numerator_of_derivative(above: BigIntegers, below: BigIntegers, d: int) -> BigIntegers:
    """Return the coefficients of N_d D - N D_d."""
    up, down = _slope(above, d), _slope(below, d)
    return _difference(_product(up, below), _product(above, down))


def _slope(coefficients: BigIntegers, d: int) -> BigIntegers:
    """Return the coefficients of a derivative, of the degree below (0 where it is 0 already)."""
    work = np.moveaxis(coefficients, d, 0)
    n = len(work) - 1
    if not n:
        return np.zeros_like(coefficients)
    shape = (n,) + (1,) * (work.ndim - 1)
    up = np.array([k + 1 for k in range(n)], dtype=object).reshape(shape)
    down = np.array([n - k for k in range(n)], dtype=object).reshape(shape)
    return np.moveaxis(up * work[1:] - down * work[:-1], 0, d)


def _determinant(tangents: list[list[BigIntegers]]) -> BigIntegers:
    """Return the coefficients of det J from those of the coordinates of M_u, M_v and M_w."""
    a, b, c = tangents
    total: Any = 0
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        minor = _difference(_product(b[j], c[k]), _product(b[k], c[j]))
        term = _product(a[i], minor)
        total = term if i == 0 else _difference(total, -term)
    return np.asarray(total)


def _difference(p: BigIntegers, q: BigIntegers) -> BigIntegers:
    """Return p - q, both raised to the higher degrees."""
    shape = np.maximum(p.shape, q.shape)
    return np.asarray(_raised(p, shape) - _raised(q, shape))


def _raised(coefficients: BigIntegers, shape: Integers) -> BigIntegers:
    """Return the coefficients in higher degrees: those of the product with (t + 1-t)^m."""
    for axis, (have, want) in enumerate(zip(coefficients.shape, shape.tolist(), strict=True)):
        row = [comb(want - have, k) for k in range(want - have + 1)]
        one = [1] * coefficients.ndim
        one[axis] = len(row)
        if len(row) > 1:
            coefficients = _product(coefficients, np.array(row, dtype=object).reshape(one))
    return coefficients


def _product(p: BigIntegers, q: BigIntegers) -> BigIntegers:
    """Return the coefficients of a product, of the sum of the degrees."""
    result = np.zeros([a + b - 1 for a, b in zip(p.shape, q.shape, strict=True)], dtype=object)
    for index in np.ndindex(*p.shape):
        if p[index]:
            window = tuple(slice(i, i + n) for i, n in zip(index, q.shape, strict=True))
            result[window] += p[index] * q
    return result
