"""How far a function is from a spline, rational ones in the parameters of their arcs included."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, reduce

import numpy as np

from pc2cad.bounds.along_arcs import along_arcs
from pc2cad.bounds.deviation import Bound, bound_curve, bound_surface, expect_surface
from pc2cad.bounds.known import Known
from pc2cad.expression.tree import ZERO, Expr
from pc2cad.geometry.carriers import SplineCurve, SplineSurface
from pc2cad.geometry.splines.rational import Parametrisation


def bound_spline(
    trees: tuple[Expr, ...],
    names: Sequence[str],
    carrier: SplineCurve | SplineSurface,
    parametrisations: Sequence[Parametrisation],
    known: Known,
    seen: float = 0.0,
) -> Bound:
    """Bound the distance of a function from its spline, rational ones included.

    With the denominator W as a tree, ω as the spline of the weights and N = ω S, all over the
    spline's parameters, |M - S| = |ω M - N|/ω is at most (|W M - N| + |M| |W - ω|)/ω.
    """
    weights, lowest, amiss = None, 1.0, 0.0
    for name, parametrisation in zip(names, parametrisations, strict=True):
        arcs, order = parametrisation.arcs, parametrisation.order
        if arcs is None:
            continue
        trees, factor = along_arcs(trees, name, arcs, order)
        if order:
            weights = carrier.weights
            lowest *= parametrisation.lowest * (1 - 1e-12)
            gap = _weights_off(parametrisation, name, factor)
            amiss = amiss + gap + amiss * gap
    if isinstance(carrier, SplineCurve):
        bound = bound_curve(trees, names[0], carrier, known)
    else:
        spaces = [parametrisation.space for parametrisation in parametrisations]
        bound = bound_surface(trees, names, carrier, known=known, spaces=spaces, seen=seen)
    if weights is None:
        return bound
    # rounding of the products of poles and weights, and of the places
    size = float(np.sqrt((carrier.poles**2).sum(axis=-1)).max())
    product = reduce(np.multiply.outer, [row.weights for row in parametrisations])
    amiss += float(np.abs(weights - product).max())
    extra = (size + bound.largest) * (amiss + 1e-15) / (lowest - amiss)
    return replace(bound, largest=bound.largest + extra, pairs=_farther(bound, extra))


def _farther(bound: Bound, extra: float) -> Callable[[int], tuple[Bound, Bound]] | None:
    """Return what gives the sides of a bound by so much larger."""
    if (pairs := bound.pairs) is None:
        return None

    def larger(axis: int) -> tuple[Bound, Bound]:
        first, last = (replace(side, largest=side.largest + extra) for side in pairs(axis))
        return first, last

    return larger


def expect_spline(
    trees: tuple[Expr, ...],
    names: Sequence[str],
    parametrisations: Sequence[Parametrisation],
    known: Known,
) -> None:
    """Let what a surface's bound will ask for be worked out with what those before it ask for.

    They have the same parametrisations.
    """
    for name, parametrisation in zip(names, parametrisations, strict=True):
        if parametrisation.arcs is not None:
            trees, _ = along_arcs(trees, name, parametrisation.arcs, parametrisation.order)
    expect_surface(trees, names, known)


@lru_cache(maxsize=64)  # all faces along a direction have the same
def _weights_off(parametrisation: Parametrisation, name: str, factor: Expr) -> float:
    """Return a bound of how far the spline of the weights is off the denominator, a tree."""
    space = parametrisation.space
    poles = np.zeros((space.size, 3))
    poles[:, 0] = parametrisation.weights
    column = SplineCurve(space.degree, space.knots, poles)
    return bound_curve((factor, ZERO, ZERO), name, column).largest
