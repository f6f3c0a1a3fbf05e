"""Mass, centre of mass and inertia of a solid of given density, from the equation itself.

Second moments are fractions where M is a rational polynomial and come by adaptive Gauss rules
elsewhere, layer by layer. Layers of different densities are joined by the parallel-axis law.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations_with_replacement

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import symmetric
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.jacobian_watch import JacobianWatch
from pc2cad.equation.point_equation import PointEquation
from pc2cad.errors import InputError
from pc2cad.integrals.exact import exact_second_moments
from pc2cad.integrals.mass_properties import CLOSED_FORM, QUADRATURE, MassProperties
from pc2cad.integrals.quadrature import Samples
from pc2cad.integrals.rules import by_layer, limits_of, narrowed
from pc2cad.integrals.settling import settle

#: products of inertia below this share of the trace may be rounding: they turn no axis
ROUNDING = 1e-14

#: of the coordinates, in the order of second moments
PAIRS = tuple(combinations_with_replacement(range(3), 2))

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Mass:
    """Mass properties of a solid: lengths in model units, masses in those of the density."""

    mass: float
    #: the centre of mass
    centroid: Vector
    #: tensor of inertia about it, along x, y and z
    inertia: tuple[Vector, Vector, Vector]
    #: its principal moments, ascending
    principal: Vector
    #: their axes, one a row: unit vectors, right-handed
    axes: tuple[Vector, Vector, Vector]
    #: radii of gyration about those axes
    radii_of_gyration: Vector
    #: estimate of the relative error; 0 where everything is in closed form
    relative_error: float
    source: str
    #: of all, or the mean one
    density: float
    #: the same of each layer
    layers: Mapping[str, Mass] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class SecondMoments:
    """∫(r - c)_i (r - c)_j dV of each layer about one place c, (layers, 3, 3), in units^5."""

    values: Array
    relative_error: float
    source: str


def second_moments(analysis: Analysis, about: Vector) -> SecondMoments:
    """Return the second moments about the centroid; raise what `integrate` raises."""
    exact = exact_second_moments(analysis)
    if exact is not None:
        values = np.array([[[float(x) for x in row] for row in exact]])
        return SecondMoments(values, 0.0, CLOSED_FORM)
    centre, watch = np.array(about), JacobianWatch(analysis.map)

    def second(u: Array, v: Array, w: Array) -> Samples:
        points, *tangents = analysis.map.frame(u, v, w)
        determinant, size, _ = watch.note(tangents, (u, v, w))
        from_centre = points - centre
        with np.errstate(all="ignore"):
            values = [from_centre[..., i] * from_centre[..., j] * determinant for i, j in PAIRS]
            size = size * (from_centre * from_centre).sum(axis=-1)
        return Samples(np.stack(values, axis=-1), size, points, tangents)

    limits = narrowed(analysis, limits_of(analysis))
    found = settle(second, limits, partial(by_layer, analysis))
    values = np.array([symmetric(PAIRS, row) for row in found.values])
    # det J may be negative all over
    values *= np.sign(np.trace(values.sum(axis=0)))
    return SecondMoments(values, found.error, QUADRATURE)


def densities(given: float | Mapping[str, float], equation: PointEquation) -> list[float]:
    """Return the density of each layer, or of the whole; raise InputError for what is none."""
    names = equation.layers
    if isinstance(given, Mapping):
        if set(given) != set(names) or not names:
            what = f"has the layers {', '.join(names)}" if names else "has no layers"
            raise InputError(
                f"densities are given for {', '.join(map(str, given)) or 'nothing'}, and "
                f"{equation.name} {what}; give each layer its own, or one number for all"
            )
        found = [given[name] for name in names]
    else:
        found = [given] * max(1, len(names))
    return [weighed_by(density) for density in found]


def weighed_by(density: object) -> float:
    """Return a density as a number; raise InputError for what is none."""
    number = isinstance(density, (int, float, np.number)) and not isinstance(density, bool)
    if not (number and 0.0 < float(density) < math.inf):  # type: ignore[arg-type]
        raise InputError(f"a density is a positive number, and {density!r:.80} was given")
    return float(density)  # type: ignore[arg-type]


def mass_of(analysis: Analysis, geometry: MassProperties, densities: Sequence[float]) -> Mass:
    """Return the mass properties for one density, or one for each layer from w = 0 up."""
    moments = second_moments(analysis, geometry.centroid)
    # the geometry's error is that of areas, too: in closed form there is none of volumes
    closed = moments.source == CLOSED_FORM
    error = 0.0 if closed else max(moments.relative_error, geometry.relative_error)
    if len(moments.values) == 1:
        (density,), (values,) = densities, moments.values
        return made(
            density * geometry.volume, geometry.centroid, density * values, error,
            moments.source, density,
        )  # fmt: skip
    names = analysis.equation.layers
    layers: dict[str, Mass] = {}
    rows = zip(names, geometry.layers, moments.values, densities, strict=True)
    for name, (volume, centroid), values, density in rows:
        way = np.subtract(centroid, geometry.centroid)
        own = values - volume * np.outer(way, way)
        layers[name] = made(
            density * volume, centroid, density * own, error, moments.source, density
        )
    return joined(layers, geometry.volume)


def joined(layers: Mapping[str, Mass], volume: float, off: float = 0.0) -> Mass:
    """Return the mass properties of several that lie side by side (the parallel-axis law).

    `off` is what else is open of them, relative.
    """
    parts = list(layers.values())
    mass = sum(part.mass for part in parts)
    centre = np.sum([part.mass * np.array(part.centroid) for part in parts], axis=0) / mass
    moments = np.zeros((3, 3))
    for part in parts:
        way = np.array(part.centroid) - centre
        moments += _moments(np.array(part.inertia)) + part.mass * np.outer(way, way)
    x, y, z = centre.tolist()
    error = max(off, *(part.relative_error for part in parts))
    return made(mass, (x, y, z), moments, error, parts[0].source, mass / volume, layers)


def inertia_of(moments: Array) -> Array:
    """Return the inertia tensor of second moments, both (3, 3) and about one place."""
    return np.asarray(np.trace(moments) * np.eye(3) - moments)


def made(
    mass: float,
    centroid: Vector,
    moments: Array,
    relative_error: float,
    source: str,
    density: float,
    layers: Mapping[str, Mass] | None = None,
) -> Mass:
    """Return mass properties from the moments ∫(r - c)_i (r - c)_j dm about the centroid (3, 3)."""
    inertia = inertia_of(moments)
    principal, axes = principal_axes(inertia, relative_error)
    radii = np.sqrt(np.maximum(principal, 0.0) / mass)
    return Mass(
        mass, centroid, _rows(inertia), _vector(principal), _rows(axes), _vector(radii),
        relative_error, source, density, dict(layers or {}),
    )  # fmt: skip


def principal_axes(inertia: Array, relative_error: float = 0.0) -> tuple[Array, Array]:
    """Return the principal moments (3,), ascending, and their axes (3, 3), one a row.

    What the error of the tensor leaves open turns no axis: those of a ball are x, y and z. The
    largest component of the first two axes is positive; the third completes them right-handed.
    """
    noise = max(ROUNDING, 2 * relative_error) * np.trace(inertia)
    off = inertia - np.diag(np.diag(inertia))
    if np.abs(off).max() <= noise:
        # equal ones stay in the order of x, y and z
        order = np.argsort(np.round(np.diag(inertia) / noise), kind="stable")
        moments, axes = np.diag(inertia)[order], np.eye(3)[order]
    else:
        moments, columns = np.linalg.eigh(inertia)
        axes = columns.T
    for k in (0, 1):
        axes[k] *= np.sign(axes[k, np.abs(axes[k]).argmax()])
    axes[2] = np.cross(axes[0], axes[1])
    return np.asarray(moments), np.asarray(axes + 0.0)


def _moments(inertia: Array) -> Array:
    """Return ∫ r_i r_j dm from the tensor of inertia."""
    return np.asarray(np.trace(inertia) / 2 * np.eye(3) - inertia)


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z


def _rows(values: Array) -> tuple[Vector, Vector, Vector]:
    a, b, c = (_vector(row) for row in values)
    return a, b, c
