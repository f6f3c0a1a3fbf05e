"""Proved deviations in place of sampled ones, for the faces and edges of a boundary model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from pc2cad.directions import CellFunction
from pc2cad.enclosure.deviation import Bound, bound_curve, bound_surface
from pc2cad.enclosure.evaluate import Known
from pc2cad.equation.breaks import BreaksNotAlignedError
from pc2cad.equation.tree import ONE, ZERO, Expr, call, number, pieces, substitute, symbol
from pc2cad.geometry.bernstein import bezier_knots
from pc2cad.geometry.carriers import Evidence, Plane, SplineCurve, SplineSurface
from pc2cad.geometry.rational import Arcs, Course
from pc2cad.model import ModelEdge, ModelFace

#: degree in which the distance from a plane, which is zero, is looked at
_FLAT_DEGREE = 7


def prove_edge(edge: ModelEdge, function: CellFunction, course: Course, known: Known) -> ModelEdge:
    """Return the edge with a proved deviation, where one can be had; it is no exact one.

    What is `known` of the equation's parts is used, and added to.
    """
    carrier = edge.carrier
    if not isinstance(carrier, SplineCurve):
        return edge
    try:
        bound = _bound_spline(function, carrier, (course,), known)
    except BreaksNotAlignedError:
        return replace(edge, sampled=edge.deviation, open=((0.0, 1.0),))
    evidence, deviation = _judge(bound)
    return replace(
        edge, evidence=evidence, deviation=deviation, sampled=bound.sampled, open=bound.open
    )


def prove_face(
    face: ModelFace,
    functions: Sequence[CellFunction],
    courses: Sequence[Course],
    rounding: float,
    known: Known,
) -> ModelFace:
    """Return the face with a proved deviation, where one can be had; it is no exact one.

    `functions` are those of the patches that it covers, `courses` those along a spline's axes, and
    `rounding` is the length below which places of the part cannot be told apart.
    """
    try:
        if isinstance(face.carrier, Plane):
            bounds = [_from_plane(function, face.carrier, rounding) for function in functions]
        elif isinstance(face.carrier, SplineSurface):
            bounds = [_bound_spline(functions[0], face.carrier, courses, known)]
        else:
            return face
    except BreaksNotAlignedError:
        return replace(face, sampled=face.deviation, open=((0.0, 1.0), (0.0, 1.0)))
    bound = max(bounds, key=lambda b: b.largest)
    evidence, deviation = _judge(bound)
    return replace(
        face, evidence=evidence, deviation=deviation, sampled=bound.sampled,
        samples=sum(b.samples for b in bounds), open=bound.open,
    )  # fmt: skip


def _bound_spline(
    function: CellFunction,
    carrier: SplineCurve | SplineSurface,
    courses: Sequence[Course],
    known: Known,
) -> Bound:
    """Bound the distance of a function from its spline, rational ones included.

    With the denominator W as a tree, ω as the spline of the weights and N = ω S, all over the
    spline's parameters, |M - S| = |ω M - N|/ω is at most (|W M - N| + |M| |W - ω|) / (W - |W - ω|).
    """
    trees, names = function.trees
    weight = ONE
    lowest, amiss = 1.0, 0.0
    for name, course in zip(names, courses, strict=True):
        if course.arcs is None:
            continue
        trees = substitute(trees, {name: _path(course.arcs, symbol(name))})
        if course.order:
            factor = _denominator(course.arcs, symbol(name)) ** course.order
            weight = weight * factor
            lowest *= course.lowest * (1 - 1e-12)
            space = course.space
            poles = np.zeros((space.size, 3))
            poles[:, 0] = course.weights
            column = SplineCurve(space.degree, space.knots, poles)
            gap = bound_curve((factor, ZERO, ZERO), name, column).largest
            amiss = amiss + gap + amiss * gap
    if weight is not ONE:
        trees = tuple(weight * tree for tree in trees)
    poles = carrier.poles if carrier.weights is None else _numerators(carrier)
    numerator = replace(carrier, poles=poles, weights=None)
    if isinstance(numerator, SplineCurve):
        bound = bound_curve(trees, names[0], numerator, known)
    else:
        bound = bound_surface(trees, names, numerator, known=known)
    if weight is ONE:
        return bound
    # rounding of the products of poles and weights, and of the places
    size = float(np.sqrt((carrier.poles**2).sum(axis=-1)).max())
    extra = (size + bound.largest) * (amiss + 1e-15)
    return replace(bound, largest=(bound.largest + extra) / (lowest - amiss))


def _numerators(carrier: SplineCurve | SplineSurface) -> NDArray[np.float64]:
    assert carrier.weights is not None
    return np.asarray(carrier.poles * carrier.weights[..., None])


def _path(arcs: Arcs, x: Expr) -> Expr:
    """Return the equation's own parameter as a tree of the spline's, x (see `Arcs.places`)."""
    half = arcs.extent / arcs.count / 4
    rows = [
        (k + Fraction(1, 2) + call("atan", number(arcs.tangent) * y) * number(1 / (2 * half)))
        / arcs.count
        for k, y in enumerate(_within(arcs, x))
    ]
    return _joined(arcs, x, rows)


def _denominator(arcs: Arcs, x: Expr) -> Expr:
    """Return the denominator of order 1 as a tree (see `Arcs.weight`)."""
    square = number(arcs.tangent) ** 2
    return _joined(arcs, x, [(1 + square * y**2) / (1 + square) for y in _within(arcs, x)])


def _within(arcs: Arcs, x: Expr) -> list[Expr]:
    """Return the place on each arc, from -1 to 1."""
    return [2 * (x * arcs.count - k) - 1 for k in range(arcs.count)]


def _joined(arcs: Arcs, x: Expr, rows: list[Expr]) -> Expr:
    breaks = tuple(Fraction(k, arcs.count) for k in range(arcs.count + 1))
    return pieces(x, breaks, tuple((row,) for row in rows), 0, closed=False)


def _judge(bound: Bound) -> tuple[Evidence, float]:
    if np.isfinite(bound.largest):
        return "bounded", bound.largest
    return "sampled", bound.sampled


def _from_plane(function: CellFunction, plane: Plane, rounding: float) -> Bound:
    """Bound the distance of a patch from a plane: that of (n·(M - o), 0, 0) from zero."""
    trees, names = function.trees
    height: Expr = ZERO
    for tree, origin, normal in zip(trees, plane.origin, plane.normal, strict=True):
        height = height + number(float(normal)) * (tree - number(float(origin)))
    flat = SplineSurface(
        (_FLAT_DEGREE, _FLAT_DEGREE),
        (bezier_knots(_FLAT_DEGREE), bezier_knots(_FLAT_DEGREE)),
        np.zeros((_FLAT_DEGREE + 1, _FLAT_DEGREE + 1, 3)),
    )
    return bound_surface((height, ZERO, ZERO), names, flat, rounding)
