"""Surfaces of revolution whose meridian is approximated: how it runs, and what is seen of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.geometry.carriers import AnalyticSurface, Revolution, SplineCurve
from pc2cad.geometry.recognition.from_points import Fitted
from pc2cad.geometry.recognition.placement import SurfacePlacement
from pc2cad.geometry.splines.rational import Parametrisation, edge_deviations
from pc2cad.geometry.splines.tensor import Deviation
from pc2cad.representation.parametrisation import FaceDirection, Parametrisations


@dataclass(frozen=True, eq=False)
class Meridian:
    """The side or line of a face of which its surface is the turning."""

    function: RestrictedMap
    #: the axis along which it runs, and the other's value there
    axis: int
    level: float
    parametrisation: Parametrisation

    def __call__(self, t: Array) -> Array:
        """Return its points (n, 3)."""
        other = np.array([self.level])
        return self.function(t, other)[:, 0] if self.axis == 0 else self.function(other, t)[0]

    def place(self, along: float) -> tuple[float, float]:
        """Return a place of it in the face's parameters."""
        return (along, self.level) if self.axis == 0 else (self.level, along)

    def seen(self, surface: AnalyticSurface) -> Deviation:
        """Return the largest distance seen between it and the surface's spline."""
        assert isinstance(surface, Revolution)
        assert isinstance(surface.basis, SplineCurve)
        basis = surface.basis
        truth = self(self.parametrisation.checks)[None]
        (seen,) = edge_deviations(truth, self.parametrisation, basis.poles[None], basis.weights)
        return replace(seen, place=self.place(seen.place[0]))


def approximated_meridian(
    function: RestrictedMap,
    placement: SurfacePlacement | Fitted | None,
    parametrisations: Parametrisations,
) -> Meridian | None:
    """Return the meridian of a face that is turned, if it has no exact form; else None."""
    if not isinstance(placement, SurfacePlacement):
        return None
    for axis in (0, 1):
        direction = FaceDirection(function, axis)
        if placement.follows(axis) and parametrisations.exact(direction) is None:
            first, last = placement.a.ends
            level = 0.0 if first < last else 1.0
            return Meridian(function, axis, level, parametrisations.parametrisation(direction))
    return None
