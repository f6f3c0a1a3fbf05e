"""How faces, edges and volumes run along a direction, and fits of them.

Where a direction is run through in arcs (`arcs`), every face and edge that varies along it takes
their parameter, so that neighbours still agree. Multiplied by the denominator a function is a
polynomial on each arc, and interpolation in a spline space that holds it is exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import comb

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import solve
from pc2cad.geometry.splines.arcs import Arcs
from pc2cad.geometry.splines.spline_space import SplineSpace
from pc2cad.geometry.splines.tensor import (
    Deviation,
    GridSampler,
    curve_deviations,
    fit_surface,
    surface_deviation,
)


class PiecewiseSpace(SplineSpace):
    """Polynomials on every arc that are only continuous, interpolated at Chebyshev's places."""

    def __init__(self, degree: int, points: Array) -> None:
        super().__init__(degree, points, [degree] * (len(points) - 2))

    @cached_property
    def sites(self) -> Array:
        """Interpolation sites: as many as the space has degrees of freedom."""
        a, b = self.points[:-1, None], self.points[1:, None]
        inner = (a + (b - a) * _chebyshev(self.degree)[:-1]).ravel()
        return np.append(inner, 1.0)

    def fit(self, values: Array) -> Array:
        """Return the poles of the interpolant: values (sites, …) to poles (size, …)."""
        p, count = self.degree, len(self.points) - 1
        pieces = p * np.arange(count)[:, None] + np.arange(p + 1)
        flat = values.reshape(len(values), -1)[pieces]
        poles = np.empty((p * count + 1, flat.shape[-1]))
        columns = flat.transpose(1, 0, 2).reshape(p + 1, -1)
        solved = solve(_collocation(p), columns).reshape(p + 1, count, -1)
        poles[pieces] = solved.transpose(1, 0, 2)
        # Chebyshev's places include the ends, where poles are values
        poles[::p] = values.reshape(len(values), -1)[::p]
        return poles.reshape(len(poles), *values.shape[1:])

    def fit_each(self, curves: Array) -> Array:
        """Return what `fit` does of each of several curves, (k, sites, 3) to (k, size, 3)."""
        return np.stack([self.fit(curve) for curve in curves])


@lru_cache(maxsize=64)
def _chebyshev(degree: int) -> Array:
    return np.asarray((1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2)


@lru_cache(maxsize=64)
def _collocation(degree: int) -> Array:
    """Return the Bernstein polynomials at Chebyshev's places."""
    x, i = _chebyshev(degree)[:, None], np.arange(degree + 1)
    binomials = np.array([comb(degree, int(k)) for k in i], dtype=float)
    return np.asarray(binomials * x**i * (1 - x) ** (degree - i))


@dataclass(frozen=True, eq=False)
class Parametrisation:
    """How all cells run along one direction: spline space, parameter and denominators."""

    space: SplineSpace
    #: None where the spline's parameter is the equation's own
    arcs: Arcs | None = None
    #: power of the arcs' denominator; 0: not rational
    order: int = 0
    #: whether the space holds the function, rather than come near it
    exact: bool = False

    def places(self, x: Array) -> Array:
        """Return the equation's own local parameter at the spline parameter x."""
        return x if self.arcs is None else self.arcs.places(x)

    def weight(self, x: Array) -> Array:
        """Return the denominator at x."""
        if self.arcs is None or not self.order:
            return np.ones(np.shape(x))
        return np.asarray(self.arcs.weight(x) ** self.order)

    @cached_property
    def sites(self) -> Array:
        """The equation's own parameter where a fit needs values."""
        return self.places(self.space.sites)

    @cached_property
    def checks(self) -> Array:
        """The equation's own parameter where a fit is compared."""
        return self.places(self.space.check_places)

    @cached_property
    def site_weights(self) -> Array:
        """The denominator where a fit needs values."""
        return self.weight(self.space.sites)

    @cached_property
    def check_weights(self) -> Array:
        """The denominator where a fit is compared."""
        return self.weight(self.space.check_places)

    @property
    def lowest(self) -> float:
        """The smallest value of the denominator."""
        if self.arcs is None:
            return 1.0
        return float(self.arcs.weight(np.array([0.5 / self.arcs.count]))[0] ** self.order)

    @cached_property
    def weights(self) -> Array:
        """The denominator's coefficients in the space, all positive."""
        if self.arcs is None or not self.order:
            return np.ones(self.space.size)
        return self.space.fit(self.site_weights[:, None])[:, 0]


@lru_cache(maxsize=64)
def rational_course(arcs: Arcs, order: int) -> Parametrisation:
    """Return the parametrisation that holds trigonometric polynomials of an order exactly."""
    space = PiecewiseSpace(arcs.degree(order), arcs.points)
    return Parametrisation(space, arcs, order, exact=True)


def fit_face(
    sample: GridSampler, s: Parametrisation, t: Parametrisation
) -> tuple[Array, Array | None]:
    """Return poles (n, m, 3) and weights (n, m) of the tensor-product fit."""
    values = sample(s.sites, t.sites)
    if not (s.order or t.order):
        return fit_surface(values, s.space, t.space), None
    numerators = values * np.outer(s.site_weights, t.site_weights)[..., None]
    weights = np.outer(s.weights, t.weights)
    return fit_surface(numerators, s.space, t.space) / weights[..., None], weights


def face_deviation(
    sample: GridSampler, s: Parametrisation, t: Parametrisation, poles: Array, weights: Array | None
) -> Deviation:
    """Return the largest distance at equal parameters over a grid off the sites."""
    truth = sample(s.checks, t.checks)
    if weights is None:
        return surface_deviation(truth, s.space, t.space, poles)
    weight = np.outer(s.check_weights, t.check_weights)
    numerators, poles = truth * weight[..., None], poles * weights[..., None]
    return surface_deviation(numerators, s.space, t.space, poles, weight)


def edge_deviations(
    truth: Array, parametrisation: Parametrisation, poles: Array, weights: Array | None
) -> list[Deviation]:
    """Return the largest distances at equal parameters at places off the sites, of several edges.

    Their values at the parametrisation's checks and their poles are (edges, n, 3).
    """
    if weights is None:
        return curve_deviations(truth, parametrisation.space, poles)
    weight = parametrisation.check_weights
    numerators, poles = truth * weight[:, None], poles * weights[:, None]
    return curve_deviations(numerators, parametrisation.space, poles, weight)


def fit_edges(values: Array, parametrisation: Parametrisation) -> tuple[Array, Array | None]:
    """Return poles (edges, n, 3) and weights (n) of curves.

    They have values (edges, sites, 3) at the parametrisation's sites.
    """
    space = parametrisation.space
    if not parametrisation.order:
        return space.fit_each(values), None
    poles = space.fit_each(values * parametrisation.site_weights[:, None])
    return poles / parametrisation.weights[:, None], parametrisation.weights
