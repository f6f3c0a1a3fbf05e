"""Where a face lies on an analytic surface: what the surface's parameters follow."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.geometry.carriers import AnalyticSurface, SplineCurve
from pc2cad.geometry.recognition.separable_form import Axis, Term

TURN = 2 * np.pi
#: angles that differ by less are one (radians)
SAME_ANGLE = 1e-12

#: makes the spline along one axis of a face, the other parameter fixed at 0 or 1
SplineMaker = Callable[[int, float], SplineCurve]


@dataclass(frozen=True, eq=False)
class Along:
    """A surface parameter that follows one axis of a face."""

    axis: int
    #: surface parameter at the axis' own parameter; None: it is the parameter of the spline basis
    values: Callable[[Array], Array] | None = None

    @property
    def ends(self) -> tuple[float, float]:
        """The values at both ends of the axis."""
        if self.values is None:
            return 0.0, 1.0
        first, last = self.values(np.array([0.0, 1.0])).tolist()
        return first, last


@dataclass(frozen=True, eq=False)
class SurfacePlacement:
    """A face carried by an analytic surface: what its parameters a and b follow."""

    #: the surface, given what makes the spline along an axis (the other parameter fixed)
    carrier: Callable[[SplineMaker], AnalyticSurface]
    a: Along
    b: Along

    def follows(self, axis: int) -> bool:
        """Say whether the surface's parameter along an axis is that of a spline."""
        return any(along.axis == axis and along.values is None for along in (self.a, self.b))

    @property
    def turned(self) -> bool:
        """True where (s, t) to (a, b) reverses the orientation."""
        signs = [float(np.subtract(*along.ends)) for along in (self.a, self.b)]
        return (signs[0] * signs[1] < 0) != (self.a.axis == 1)


def angle_from(values: tuple[float, float]) -> tuple[float, float]:
    """Return (shift, end - start) with whole turns made exact; shift brings the lower end to 0."""
    start, end = values
    run = end - start
    if abs(abs(run) - TURN) < SAME_ANGLE:
        run = TURN if run > 0 else -TURN
    return -min(start, start + run), run


def sum_of(axis: Axis, parts: Mapping[Term, float]) -> Callable[[Array], Array]:
    """Return Σ factor · term(t) as a function of t."""

    def values(t: Array) -> Array:
        total = np.zeros(np.shape(t))
        for term, factor in parts.items():
            total = total + factor * axis.values(term, t)
        return np.asarray(total)

    return values


def turning(axis: Axis, multiple: int, factor: float, offset: float) -> Callable[[Array], Array]:
    """Return the angle factor · (multiple · θ(t)) + offset, ends that make a turn made exact."""
    first, last = axis.turn(multiple, np.array([0.0, 1.0])).tolist()
    _, run = angle_from((factor * first, factor * last))

    def values(t: Array) -> Array:
        share = (axis.turn(multiple, np.asarray(t)) - first) / (last - first)
        return np.asarray(factor * first + offset + run * share)

    return values
