"""Proved deviations in place of sampled ones, for the faces and edges of a boundary model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pc2cad.directions import CellFunction
from pc2cad.enclosure.deviation import Bound, bound_curve, bound_surface
from pc2cad.equation.tree import ZERO, Expr, number
from pc2cad.geometry.bernstein import bezier_knots
from pc2cad.geometry.carriers import Evidence, Plane, SplineCurve, SplineSurface
from pc2cad.model import ModelEdge, ModelFace

#: degree in which the distance from a plane, which is zero, is looked at
_FLAT_DEGREE = 7


def prove_edge(edge: ModelEdge, function: CellFunction, arcs: bool) -> ModelEdge:
    """Return the edge with a proved deviation, where it is not exact and a bound can be had."""
    carrier = edge.carrier
    if edge.evidence != "sampled" or not isinstance(carrier, SplineCurve) or arcs:
        return edge
    trees, names = function.trees
    bound = bound_curve(trees, names[0], carrier)
    evidence, deviation = _judge(bound)
    return replace(
        edge, evidence=evidence, deviation=deviation, sampled=bound.sampled, open=bound.open
    )


def prove_face(
    face: ModelFace, functions: Sequence[CellFunction], arcs: bool, rounding: float
) -> ModelFace:
    """Return the face with a proved deviation, where it is not exact and a bound can be had.

    `functions` are those of the patches that it covers, `rounding` the length below which places
    of the part cannot be told apart.
    """
    if face.evidence != "sampled":
        return face
    if isinstance(face.carrier, Plane):
        bounds = [_from_plane(function, face.carrier, rounding) for function in functions]
        bound = max(bounds, key=lambda b: b.largest)
        samples = sum(b.samples for b in bounds)
    elif isinstance(face.carrier, SplineSurface) and not arcs:
        bound = bound_surface(*functions[0].trees, face.carrier)
        samples = bound.samples
    else:
        return face
    evidence, deviation = _judge(bound)
    return replace(
        face, evidence=evidence, deviation=deviation, sampled=bound.sampled, samples=samples,
        open=bound.open,
    )  # fmt: skip


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
