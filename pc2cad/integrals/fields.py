"""Integrals of fields over the solid, and its mass where a field is the density.

In closed form where the map and the field are polynomials with rational coefficients, by adaptive
Gauss rules elsewhere, as volumes are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import symmetric
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.fields import LocalField, looked_at
from pc2cad.domain.jacobian_watch import JacobianWatch
from pc2cad.errors import InputError
from pc2cad.integrals.exact import exact_weighted
from pc2cad.integrals.inertia import PAIRS, Mass, joined, made
from pc2cad.integrals.mass_properties import CLOSED_FORM, QUADRATURE, UNSETTLED, MassProperties
from pc2cad.integrals.quadrature import Samples
from pc2cad.integrals.rules import (
    Density,
    by_layer,
    limits_of,
    narrowed,
)
from pc2cad.integrals.settling import settle


class FieldNotIntegrableError(InputError):
    """The integral of a field over the solid does not settle."""


@dataclass(frozen=True)
class FieldIntegral:
    """∫ f dV of each component, and its mean over the volume."""

    integral: tuple[float, ...]
    mean: tuple[float, ...]
    #: estimate of the error of the integral; 0 in closed form
    error: float
    source: str


def integrate_field(
    analysis: Analysis, geometry: MassProperties, field: LocalField
) -> FieldIntegral:
    """Return the integral of a field; raise FieldNotIntegrableError, FieldNotFiniteError."""
    exact = exact_weighted(analysis, field.trees)
    if exact is not None:
        values = [float(x) for x in exact]
        mean = tuple(x / geometry.volume for x in values)
        return FieldIntegral(tuple(values), mean, 0.0, CLOSED_FORM)
    seen = field.checked_at(looked_at(analysis, field))
    size = float(np.abs(seen).max()) or 1.0
    watch = JacobianWatch(analysis.map)

    def weighted(u: Array, v: Array, w: Array) -> Samples:
        points, *tangents = analysis.map.frame(u, v, w)
        determinant, terms, _ = watch.note(tangents, (u, v, w))
        values = field.at(u, v, w, points) / size
        columns = np.concatenate((np.ones((*determinant.shape, 1)), values), axis=-1)
        # beside the volume, so that an integral of nothing has an error of its field's size
        return Samples(columns * determinant[..., None], terms, points, tangents)

    found, error = _integrated(analysis, field, weighted)
    whole = np.sum(found, axis=0)
    sums = whole[1:] * np.sign(whole[0]) * size
    values = [float(x) for x in sums]
    mean = tuple(x / geometry.volume for x in values)
    return FieldIntegral(tuple(values), mean, error * size * geometry.volume, QUADRATURE)


def mass_by_field(analysis: Analysis, geometry: MassProperties, field: LocalField) -> Mass:
    """Return mass, centre of mass and inertia where a scalar field is the density.

    Raises InputError where the density is negative at a place, or no scalar.
    """
    largest = check_density(analysis, field)
    exact = _exact_mass(analysis, geometry, field)
    if exact is not None:
        return exact
    centre = np.array(geometry.centroid)
    rows, error = _moments(analysis, field, centre, largest)
    volumes = [v for v, _ in geometry.layers] or [geometry.volume]
    parts = [_weighed(row, centre, v, error) for row, v in zip(rows, volumes, strict=True)]
    if len(parts) == 1:
        return parts[0]
    return joined(dict(zip(analysis.equation.layers, parts, strict=True)), geometry.volume)


def check_density(analysis: Analysis, field: LocalField) -> float:
    """Return the largest value of a density that is seen; raise InputError for what is none."""
    if field.field.kind != "scalar":
        raise InputError(f"a density is a scalar, and {field.field.name} is a {field.field.kind}")
    places = looked_at(analysis, field)
    seen = field.checked_at(places)[:, 0]
    if seen.min() < 0 or not seen.max() > 0:
        raise InputError(
            f"the density {field.field.name} is {seen.min():.4g} at "
            f"{analysis.map.shown(places[seen.argmin()])}, and none is negative, or 0 all over"
        )
    return float(seen.max())


def _weighed(row: Array, about: Array, volume: float, error: float) -> Mass:
    """Return mass properties from the moments 1, r, r r about a place."""
    mass, way = float(row[0]), row[1:4] / row[0]
    rows = zip(PAIRS, row[4:], strict=True)
    second = symmetric(PAIRS, (value - mass * way[i] * way[j] for (i, j), value in rows))
    x, y, z = (about + way).tolist()
    return made(mass, (x, y, z), second, error, QUADRATURE, mass / volume)


def _exact_mass(analysis: Analysis, geometry: MassProperties, field: LocalField) -> Mass | None:
    """Return the mass properties of fractions, each rounded once, or None."""
    (density,) = field.trees
    r = analysis.map.coordinates
    trees = (density, *(density * c for c in r), *(density * r[i] * r[j] for i, j in PAIRS))
    found = exact_weighted(analysis, trees)
    if found is None or not found[0] > 0:
        return None
    mass, *rest = found
    centre = [moment / mass for moment in rest[:3]]
    rows = zip(PAIRS, rest[3:], strict=True)
    second = symmetric(PAIRS, (float(x - mass * centre[i] * centre[j]) for (i, j), x in rows))
    x, y, z = map(float, centre)
    mean = float(mass) / geometry.volume
    return made(float(mass), (x, y, z), second, 0.0, CLOSED_FORM, mean)


def _moments(
    analysis: Analysis, field: LocalField, centre: Array, largest: float
) -> tuple[list[Array], float]:
    """Return the moments of each layer about a place, and their relative error."""
    watch, reach = JacobianWatch(analysis.map), analysis.size / 2

    def moments(u: Array, v: Array, w: Array) -> Samples:
        points, *tangents = analysis.map.frame(u, v, w)
        determinant, terms, _ = watch.note(tangents, (u, v, w))
        density = field.at(u, v, w, points)[..., 0] / largest
        way = (points - centre) / reach
        with np.errstate(all="ignore"):
            mass = density * determinant
            columns = [mass, *(mass * way[..., i] for i in range(3))]
            columns += [mass * way[..., i] * way[..., j] for i, j in PAIRS]
        return Samples(np.stack(columns, axis=-1), terms, points, tangents)

    found, error = _integrated(analysis, field, moments)
    scale = largest * np.array([1.0] + [reach] * 3 + [reach**2] * 6)
    sign = np.sign(np.sum(found, axis=0)[0])
    return [row * sign * scale for row in found], error


def _integrated(
    analysis: Analysis, field: LocalField, density: Density
) -> tuple[list[Array], float]:
    """Return the integral of a density over each layer, and the largest relative error."""
    limits = narrowed(analysis, limits_of(analysis))
    limits = [sorted({*row, *more}) for row, more in zip(limits, field.breaks, strict=True)]
    found = settle(density, limits, partial(by_layer, analysis))
    if not found.error < UNSETTLED:
        raise FieldNotIntegrableError(
            f"the integral of the field {field.field.name} does not settle (still "
            f"{found.error:.2g} of it from one rule to the next): look for a jump along no line of "
            "the grid, or a division by zero"
        )
    return found.values, found.error
