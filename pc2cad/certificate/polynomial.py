"""Proof that det J keeps one sign, from Bernstein coefficients (spec 4.3).

A polynomial lies in the convex hull of its Bernstein coefficients: when those of det J are all of
one sign, and not all zero, det J cannot vanish inside the box. Where they are not, the box is
halved a few times; what is then still open is left to others. With coordinates N/D the sign is that
of the determinant of N_j D - N D_j, provided that the denominators keep theirs. The coefficients of
N and D are taken by interpolation of their known degrees, and those of the determinant follow by
exact rules; their rounding, some 1e-15 of the largest, is allowed for.
"""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

from pc2cad.equation.evaluation import Program
from pc2cad.equation.point_equation import PARAMETERS
from pc2cad.equation.tree import ONE, Expr, walk
from pc2cad.geometry.bernstein import degree_in
from pc2cad.mapping import Mapping3, open_grid

Array = NDArray[np.float64]

#: a coefficient nearer to zero than this share of the largest is taken for zero
ROUNDING = 1e-13
#: halvings of the box, boxes looked at, and degree of M, beyond which the proof is given up
DEEPEST = 5
MOST_BOXES = 2000
LARGEST_DEGREE = 8


def sign_from_coefficients(mapping: Mapping3) -> int:
    """Return the sign of det J where it is proved to be one inside the box, else 0."""
    if any(node.op == "pieces" for node in walk(mapping.coordinates)):
        return 0  # one polynomial per piece, not one
    numerators, denominators = zip(*fractions(mapping.coordinates), strict=True)
    above, below = _control(numerators), _control(denominators)
    if above is None or below is None:
        return 0
    largest = np.abs(below).max(axis=(0, 1, 2))
    if ((below < -ROUNDING * largest).any(axis=(0, 1, 2)) & (below > 0).any(axis=(0, 1, 2))).any():
        return 0
    tangents = [_numerator_of_derivative(above, below, d) for d in range(3)]
    if any(m.size == 0 or max(m.shape[:3]) > 2 * LARGEST_DEGREE for m in tangents):
        return 0
    coefficients = _determinant(tangents)
    bound = ROUNDING * float(np.prod([np.abs(m).max() for m in tangents]))
    sign = 1 if coefficients.sum() > 0 else -1
    boxes = [sign * coefficients]
    if boxes[0].max() <= bound:
        return 0
    for _ in range(DEEPEST + 1):
        boxes = [box for box in boxes if box.min() < -bound]
        if not boxes:
            return sign
        if len(boxes) * 8 > MOST_BOXES:
            break
        boxes = [part for box in boxes for part in _halve(box)]
    return 0


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


def _control(roots: tuple[Expr, ...]) -> Array | None:
    """Return Bernstein coefficients (l, m, n, 3) of three polynomials; None where one is none."""
    degrees = [degree_in(roots, name) for name in PARAMETERS]
    if any(n is None or n > LARGEST_DEGREE for n in degrees):
        return None
    nodes = [(1 - np.cos(np.pi * np.arange(n + 1) / max(n, 1))) / 2 for n in map(int, degrees)]  # type: ignore[arg-type]
    grid = open_grid(*nodes)
    rows = Program(roots)(dict(zip(PARAMETERS, grid, strict=True)))
    shape = tuple(len(t) for t in nodes)
    control = np.stack([np.broadcast_to(row, shape) for row in rows], axis=-1)
    if not np.isfinite(control).all():
        return None
    for axis, t in enumerate(nodes):
        control = np.moveaxis(
            np.tensordot(np.linalg.inv(_basis(t)), control, axes=(1, axis)), 0, axis
        )
    return control


def _numerator_of_derivative(above: Array, below: Array, d: int) -> Array:
    """Return the Bernstein coefficients of N_d D - N D_d, coordinate by coordinate."""
    up, down = ((control.shape[d] - 1) * np.diff(control, axis=d) for control in (above, below))
    columns = []
    for i in range(3):
        top: Array | float = 0.0
        if up.size:
            top = _product(up[..., i], below[..., i])
        if down.size:
            top = top - _product(above[..., i], down[..., i])
        columns.append(np.asarray(top))
    return np.stack(columns, axis=-1) if up.size or down.size else np.empty((0, 0, 0, 3))


def _basis(t: Array) -> Array:
    """Return the Bernstein polynomials of degree len(t) - 1 at t, (len(t), len(t))."""
    n = len(t) - 1
    return np.array([[comb(n, k) * x**k * (1 - x) ** (n - k) for k in range(n + 1)] for x in t])


def _determinant(tangents: list[Array]) -> Array:
    """Return Bernstein coefficients of det J from those of M_u, M_v, M_w, (l, m, n, 3) each."""
    a, b, c = tangents
    total: Array | float = 0.0
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        minor = _product(b[..., j], c[..., k]) - _product(b[..., k], c[..., j])
        total = total + _product(a[..., i], minor)
    return np.asarray(total)


def _product(p: Array, q: Array) -> Array:
    """Return the Bernstein coefficients of a product, of the sum of the degrees."""
    left, right = _scaled(p, 1), _scaled(q, 1)
    shape = tuple(a + b - 1 for a, b in zip(p.shape, q.shape, strict=True))
    result = np.zeros(shape)
    for index in np.ndindex(*p.shape):
        window = tuple(slice(i, i + n) for i, n in zip(index, q.shape, strict=True))
        result[window] += left[index] * right
    return _scaled(result, -1)


def _scaled(coefficients: Array, power: int) -> Array:
    """Multiply (power 1) or divide (-1) by the binomials, per axis."""
    result = coefficients
    for axis, n in enumerate(coefficients.shape):
        row = np.ones(n)
        for k in range(1, n):
            row[k] = row[k - 1] * (n - k) / k
        shape = [1] * coefficients.ndim
        shape[axis] = n
        result = result * row.reshape(shape) ** power
    return result


def _halve(box: Array) -> list[Array]:
    """Return the coefficients on the eight halves (de Casteljau at 1/2 along each axis)."""
    parts = [box]
    for axis in range(3):
        parts = [half for part in parts for half in _halve_along(part, axis)]
    return parts


def _halve_along(box: Array, axis: int) -> tuple[Array, Array]:
    work = np.moveaxis(box, axis, 0)
    low, high = [work[0]], [work[-1]]
    while len(work) > 1:
        work = (work[:-1] + work[1:]) / 2
        low.append(work[0])
        high.append(work[-1])
    return (
        np.moveaxis(np.array(low), 0, axis),
        np.moveaxis(np.array(high[::-1]), 0, axis),
    )
