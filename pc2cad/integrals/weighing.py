"""Mass of one equation and its derivatives for a density: a number, one a layer, or a field."""

from __future__ import annotations

from collections.abc import Mapping

from pc2cad.domain.analysis import Analysis
from pc2cad.domain.field_rates import FieldRate
from pc2cad.domain.fields import LocalField, local_field
from pc2cad.equation.fields import DENSITY
from pc2cad.equation.variation import Variation
from pc2cad.integrals.fields import check_density, mass_by_field
from pc2cad.integrals.inertia import Mass, densities, mass_of
from pc2cad.integrals.mass_properties import MassProperties
from pc2cad.integrals.sensitivity import Sensitivity, sensitivity

#: a number, the name of a field, one for each layer, or None: the field called density, or 1
Density = float | str | Mapping[str, float] | None


def weighed(analysis: Analysis, geometry: MassProperties, density: Density) -> Mass:
    """Return the mass properties; raise InputError for what is no density."""
    given = _given(analysis, density)
    if isinstance(given, LocalField):
        return mass_by_field(analysis, geometry, given)
    return mass_of(analysis, geometry, given)


def derived(
    analysis: Analysis,
    sign: int,
    geometry: MassProperties,
    density: Density,
    variation: Variation,
) -> Sensitivity:
    """Return how figures change; raise NotDifferentiableError, InputError."""
    given = _given(analysis, density)
    if isinstance(given, LocalField):
        rate = FieldRate(given, variation, check_density(analysis, given))
        mass = mass_by_field(analysis, geometry, given)
        return sensitivity(analysis, sign, geometry, mass, rate, variation)
    mass = mass_of(analysis, geometry, given)
    return sensitivity(analysis, sign, geometry, mass, given, variation)


def _given(analysis: Analysis, density: Density) -> list[float] | LocalField:
    if density is None:
        known = any(field.name == DENSITY for field in analysis.equation.fields)
        density = DENSITY if known else 1.0
    if isinstance(density, str):
        return local_field(analysis, density)
    return densities(density, analysis.equation)
