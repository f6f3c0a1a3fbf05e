"""Derivatives of volume, area, centroid, mass and inertia with respect to one parameter of M.

With the design velocity V = ∂M/∂p (see `domain.velocity`), dV/dp is the integral of ∂(det J)/∂p
over the box, and the flux of V through its sides. Both are taken: where they differ, a kink or a
jump of M moves with p, and there is no such derivative.

*Source:* J. Sokolowski, J.-P. Zolésio, Introduction to Shape Optimization (1992), chapter 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from pc2cad.arrays import Array
from pc2cad.arrays.linear import symmetric
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.field_rates import FieldRate
from pc2cad.domain.map import open_grid
from pc2cad.domain.velocity import (
    LOOK,
    DifferenceVelocity,
    NotDifferentiableError,
    SymbolicVelocity,
    velocity,
)
from pc2cad.equation.variation import Variation
from pc2cad.integrals.inertia import PAIRS, Mass, Vector, inertia_of
from pc2cad.integrals.mass_properties import MassProperties
from pc2cad.integrals.quadrature import Panels, Samples, gauss, single
from pc2cad.integrals.rules import (
    Density,
    by_layer,
    limits_of,
    narrowed,
    total,
)
from pc2cad.integrals.settling import settle
from pc2cad.topology.cells import Cell, directions_of

#: relative gap of the two ways that is none, and how often the estimated error explains one
AGREES, EXPLAINED = 1e-9, 1e3


@dataclass(frozen=True)
class Sensitivity:
    """d/dp of a solid's figures, in their units per unit of the parameter."""

    parameter: str
    value: float
    volume: float
    area: float
    #: of the volume
    centroid: Vector
    mass: float
    #: tensor of inertia about the centre of mass, which moves with the parameter
    inertia: tuple[Vector, Vector, Vector]
    #: dV/dp once more, by the flux of ∂M/∂p through the sides; None: not finite on a side
    volume_by_flux: float | None
    #: estimate, relative to the largest of what each is a sum of
    relative_error: float
    #: where ∂M/∂p comes from
    how: str
    #: sides that coincide at this value and at no other near it, as the end of a full turn does
    parting: tuple[str, ...]
    _analysis: Analysis = field(repr=False, compare=False)
    _velocity: SymbolicVelocity | DifferenceVelocity = field(repr=False, compare=False)

    def velocity(self, parameters: ArrayLike) -> Array:
        """Return ∂M/∂p at places (n, 3) of the equation's own u, v and w, (n, 3).

        Of the point that stays at the same share of the way from limit to limit.
        """
        own = np.asarray(parameters, dtype=float)
        local = [self._analysis.map.local(d, own[:, d]) for d in range(3)]
        return self._velocity.frame(*local)[0]


def sensitivity(
    analysis: Analysis,
    sign: int,
    geometry: MassProperties,
    mass: Mass,
    density: Sequence[float] | FieldRate,
    variation: Variation,
) -> Sensitivity:
    """Return the derivatives with respect to one parameter; `sign` is that of det J.

    The density is one for each layer, or a field that changes too.

    Raises NotDifferentiableError where the solid does not change smoothly with it.
    """
    moving = velocity(analysis, variation)
    weigher = density if isinstance(density, FieldRate) else None
    forms = _Forms(analysis, moving, np.array(mass.centroid), weigher)
    limits = narrowed(analysis, limits_of(analysis))
    found = settle(forms.inside, limits, partial(by_layer, analysis))
    # (layers, 10 or 17)
    rows, error = np.array([row[:-1] for row in found.values]), found.error
    flux, passed = _flux(forms, found.rules)
    area, area_error = _area(forms)
    rows, flux = sign * rows, sign * flux
    error = max(error, area_error, moving.doubt())
    volume = float(rows[:, 0].sum())
    moved = max(passed, abs(volume), forms.rate * geometry.volume)
    agrees = max(AGREES, EXPLAINED * error) * moved
    if not np.isfinite(rows).all() or (np.isfinite(flux) and abs(flux - volume) > agrees):
        raise NotDifferentiableError(
            f"there is no derivative with respect to {variation.name} = {variation.value:.6g}: "
            f"the volume changes by {volume:.6g} inside the box and by {flux:.6g} through its "
            "sides; a kink or a jump of M moves with the parameter"
        )
    size = analysis.scale.size
    if isinstance(density, FieldRate):
        weighed = density.largest * rows[:, 10:].sum(axis=0)
    else:
        weighed = np.array(density) @ rows[:, [0, *range(4, 10)]]
    first = rows[:, 1:4].sum(axis=0) * size
    centre = np.subtract(geometry.centroid, mass.centroid)
    x, y, z = ((first - centre * volume) / geometry.volume).tolist()
    a, b, c = inertia_of(symmetric(PAIRS, weighed[1:] * size**2)).tolist()
    return Sensitivity(
        variation.name, variation.value, volume, area, (x, y, z),
        float(weighed[0]), (tuple(a), tuple(b), tuple(c)),
        float(flux) if np.isfinite(flux) else None, error, moving.how, _parting(forms),
        analysis, moving,
    )  # fmt: skip


@dataclass(frozen=True)
class _Forms:
    """The integrands, lengths in shares of the part's size where their powers differ."""

    analysis: Analysis
    moving: SymbolicVelocity | DifferenceVelocity
    centre: Array
    #: where the density is a field
    weigher: FieldRate | None = None

    @cached_property
    def rate(self) -> float:
        """How fast the fastest point moves, in sizes of the part: what integrands are held against.

        Where they vanish, their rounding would be resolved otherwise.
        """
        speed = self.moving.frame(*np.ix_(LOOK, LOOK, LOOK))[0]
        return float(np.nanmax(np.abs(speed), initial=0.0)) / self.analysis.scale.size

    def inside(self, u: Array, v: Array, w: Array) -> Samples:
        """Return ∂(det J)/∂p, and the same of the first and second moments; and det J."""
        points, *tangents = self.analysis.map.frame(u, v, w)
        speed, *speeds = self.moving.frame(u, v, w)
        known = None if self.weigher is None else self.weigher(u, v, w, points, speed)
        size = self.analysis.scale.size
        with np.errstate(all="ignore"):
            r, speed = (points - self.centre) / size, speed / size
            a, b, c = tangents
            terms = [_det(speeds[0], b, c), _det(a, speeds[1], c), _det(a, b, speeds[2])]
            change, det = sum(terms), _det(a, b, c)
            values = [change]
            values += [speed[..., i] * det + r[..., i] * change for i in range(3)]
            values += [
                (speed[..., i] * r[..., j] + r[..., i] * speed[..., j]) * det
                + r[..., i] * r[..., j] * change
                for i, j in PAIRS
            ]
            if known is not None:
                density, along = known
                mass = along * det + density * change
                values.append(mass)
                values += [
                    (speed[..., i] * r[..., j] + r[..., i] * speed[..., j]) * density * det
                    + r[..., i] * r[..., j] * mass
                    for i, j in PAIRS
                ]
            values.append(self.rate * det)
        every = np.broadcast_arrays(*values)
        return Samples(np.stack(every, axis=-1), np.sum([np.abs(term) for term in terms], axis=0))

    def through(self, direction: int) -> Density:
        """Return the function that gives V·(M_s × M_t) across a direction, in cyclic order."""
        s, t = (direction + 1) % 3, (direction + 2) % 3

        def flux(u: Array, v: Array, w: Array) -> Samples:
            a, b = self.analysis.map.tangents((s, t), u, v, w)
            speed = self.moving.frame(u, v, w)[0]
            values = _det(speed, a, b)
            return Samples(values[..., None], np.abs(values))

        return flux

    def spread(self, patch: Cell) -> Density:
        """Return the function that gives ∂|M_s × M_t|/∂p on a patch."""
        s, t = directions_of(patch)

        def area(u: Array, v: Array, w: Array) -> Samples:
            a, b = self.analysis.map.tangents((s, t), u, v, w)
            _, *speeds = self.moving.frame(u, v, w)
            with np.errstate(all="ignore"):
                normal = np.cross(a, b)
                change = np.cross(speeds[s], b) + np.cross(a, speeds[t])
                length = np.sqrt((normal * normal).sum(axis=-1))
                values = np.where(length > 0, (normal * change).sum(axis=-1) / length, 0.0)
            both = np.stack((values, self.rate * length), axis=-1)
            return Samples(both, np.sqrt((change * change).sum(axis=-1)))

        return area


def _det(a: Array, b: Array, c: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, np.cross(b, c)))


def _flux(forms: _Forms, rules: list[Panels]) -> tuple[float, float]:
    """Return the flux through all sides of the box, those that coincide included, and its parts.

    The second is the sum of their sizes, which the rounding of the first goes with.
    """
    flux = size = 0.0
    for d in range(3):
        for limit in (0, 1):
            own = [*rules[:d], single(float(limit)), *rules[d + 1 :]]
            value = float(total(forms.through(d), [p.rule(1.5) for p in own])[0])
            flux += value if limit else -value
            size += abs(value)
    return flux, size


def _parting(forms: _Forms) -> tuple[str, ...]:
    """Return pairs of sides that are one place, and whose velocities are not the same."""
    boundary, found = forms.analysis.boundary, []
    for side in boundary.sides:
        if side.partner is None or side.symmetry is None or side.partner < side.patch:
            continue
        here, there = (_on_side(forms, patch) for patch in (side.patch, side.partner))
        there = side.symmetry.read(there)
        gap = float(np.nanmax(np.abs(here - there), initial=0.0)) / forms.analysis.scale.size
        if gap > max(AGREES, EXPLAINED * forms.moving.doubt()) * forms.rate:
            found.append(f"{boundary.name(side.patch)} and {boundary.name(side.partner)}")
    return tuple(found)


def _on_side(forms: _Forms, patch: Cell) -> Array:
    """Return velocities on a patch, (7, 7, 3), along its own s and t."""
    nodes = (gauss(7)[0] + 1) / 2
    places, keep = [], []
    for d in range(3):
        low, high = forms.analysis.span(d, patch[d])
        places.append(low + (high - low) * nodes if patch[d] % 2 else np.array([low]))
        keep.append(slice(None) if patch[d] % 2 else 0)
    return np.asarray(forms.moving.frame(*open_grid(*places))[0][tuple(keep)])


def _area(forms: _Forms) -> tuple[float, float]:
    """Return the change of the area of all faces, and its relative error."""
    found = []
    for face in forms.analysis.boundary.faces:
        found.append(settle(forms.spread(face.patch), limits_of(forms.analysis, face.patch)))
    return sum(float(face.values[0][0]) for face in found), max(face.error for face in found)
