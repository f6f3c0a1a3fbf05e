"""Tensor-product fits and their deviation from the function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import squares
from pc2cad.geometry.splines.spline_space import SplineSpace

#: values on the product of two parameter arrays: shape (len(s), len(t), 3)
GridSampler = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Deviation:
    """The largest distance seen between a fit and its function, and how many places were seen."""

    largest: float
    samples: int
    #: where it was seen, in the spline's parameters
    place: tuple[float, ...] = ()


def fit_surface(values: Array, s: SplineSpace, t: SplineSpace) -> Array:
    """Return the poles (s.size, t.size, 3) of the tensor-product fit to values at the sites."""
    along_s = s.fit(values)
    return t.fit(along_s.transpose(1, 0, 2)).transpose(1, 0, 2)


def surface_deviation(
    truth: Array, s: SplineSpace, t: SplineSpace, poles: Array, weight: Array | float = 1.0
) -> Deviation:
    """Return the largest distance to the values (at the `check_places`) of a surface.

    Of numerators it is the distance divided by the `weight` there, (len(s), len(t)).
    """
    places_s, places_t = s.check_places, t.check_places
    rows = s.check_basis @ poles.reshape(s.size, -1)
    rows = rows.reshape(len(places_s), t.size, 3).transpose(1, 0, 2).reshape(t.size, -1)
    values = (t.check_basis @ rows).reshape(len(places_t), len(places_s), 3)
    gap = values.transpose(1, 0, 2) - truth
    return _largest(gap, weight, places_s, places_t)


def curve_deviations(
    truth: Array, space: SplineSpace, poles: Array, weight: Array | float = 1.0
) -> list[Deviation]:
    """Return the largest distances to the values (at its `check_places`) of curves.

    Values and poles are (curves, …, 3).
    """
    gaps = space.check_basis @ poles - truth
    return [_largest(gap, weight, space.check_places) for gap in gaps]


def _largest(gap: Array, weight: Array | float, *places: Array) -> Deviation:
    away = np.sqrt(squares(gap)) / weight
    at = np.unravel_index(int(away.argmax()), away.shape)
    place = tuple(float(x[i]) for x, i in zip(places, at, strict=True))
    return Deviation(float(away[at]), away.size, place)
