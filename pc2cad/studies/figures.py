"""Figures of a solid that may be asked for by name, and their slopes by some parameters.

Of one equation no kernel is asked. Several bodies are joined for it, and known as well as that is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from pc2cad.compiler import compile_solid
from pc2cad.domain.analysis import derive, sample_sides
from pc2cad.domain.family_sides import own_boundary
from pc2cad.domain.velocity import NotDifferentiableError
from pc2cad.integrals.inertia import Mass
from pc2cad.integrals.mass_properties import integrate
from pc2cad.integrals.weighing import Density, derived, weighed
from pc2cad.part.several import BodiesSensitivity
from pc2cad.solidity.orientation import find_orientation
from pc2cad.templates.bodies import Bodies

if TYPE_CHECKING:
    from pc2cad.checked import CheckedMap
    from pc2cad.equation.point_equation import PointEquation
    from pc2cad.integrals.sensitivity import Sensitivity
    from pc2cad.solidity.over_ranges.boxes import ProvedBox

#: centroid by its coordinates, inertia about the centre of mass by axes
FIGURES: Final = (
    "volume", "area", "mass", "x", "y", "z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz",
)  # fmt: skip


@dataclass(frozen=True)
class Figures:
    """Figures of one solid, and their slopes by each parameter that was asked for."""

    values: Mapping[str, float]
    slopes: tuple[Mapping[str, float], ...]
    #: share of the figures that is open
    error: float


def figures_of(
    equation: PointEquation | Bodies,
    density: Density,
    names: Sequence[str],
    asked: frozenset[str],
    known: ProvedBox | None = None,
) -> Figures:
    """Return the figures, those that are `asked` for with slopes.

    What is `known` for a box of parameters, in which those of the equation lie, is not asked again.
    Raises NotASolidError, KernelError, and NotDifferentiableError.
    """
    if isinstance(equation, Bodies):
        return _of_bodies(equation, density, names, asked)
    sides = sample_sides(equation)
    sign, boundary = (known.sign, known.boundary) if known else (0, None)
    sign = find_orientation(sides.map, sign).sign
    analysis = derive(sides, own_boundary(sides, boundary))
    geometry = integrate(analysis)
    mass = weighed(analysis, geometry, density)
    moved = [derived(analysis, sign, geometry, density, equation.variation(name)) for name in names]
    values = _figures(geometry.volume, geometry.area, geometry.centroid, mass)
    # the methods of integration say what is open of them; steps go by their values
    return Figures(values, tuple(_slopes(s, s.area) for s in moved), 0.0)


def _of_bodies(
    bodies: Bodies, density: Density, names: Sequence[str], asked: frozenset[str]
) -> Figures:
    part = compile_solid(bodies)
    rows = []
    for name in names:
        found = part.sensitivity(name, density)
        if isinstance(found, BodiesSensitivity) and found.area is None and "area" in asked:
            raise NotDifferentiableError(found.open)
        rows.append(_slopes(found, found.area or 0.0))
    best = part.report.integrals
    values = _figures(best.volume, best.area, best.centroid, part.mass_properties(density))
    return Figures(values, tuple(rows), best.relative_error or 0.0)


def figures_of_map(checked: CheckedMap, density: Density) -> dict[str, float]:
    """Return the figures of a checked map."""
    found = checked.mass
    return _figures(found.volume, found.area, found.centroid, checked.mass_properties(density))


def _figures(volume: float, area: float, centroid: Sequence[float], mass: Mass) -> dict[str, float]:
    return {
        "volume": volume, "area": area, "mass": mass.mass, **_named(centroid, mass.inertia),
    }  # fmt: skip


def _slopes(found: Sensitivity | BodiesSensitivity, area: float) -> dict[str, float]:
    return {
        "volume": found.volume, "area": area, "mass": found.mass,
        **_named(found.centroid, found.inertia),
    }  # fmt: skip


def _named(centroid: Sequence[float], inertia: Sequence[Sequence[float]]) -> dict[str, float]:
    pairs = {"I" + "xyz"[i] + "xyz"[j]: inertia[i][j] for i in range(3) for j in range(i, 3)}
    return {**dict(zip("xyz", centroid, strict=True)), **pairs}
