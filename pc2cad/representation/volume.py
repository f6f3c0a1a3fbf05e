"""The represent stage for the whole volume: M itself as a trivariate spline, for isogeometry.

Input: CheckedMap. Output: VolumeModel, one spline per piece of the box (creases limit pieces).
Directions along which M is polynomial or a trigonometric polynomial are carried exactly; the
others get a spline space that meets the tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import squares
from pc2cad.checked import CheckedMap, resolve_tolerance
from pc2cad.domain.direction_classes import DirectionClasses
from pc2cad.domain.fields import LocalField, local_field
from pc2cad.domain.map import open_grid
from pc2cad.domain.restrictions import Piece, RestrictedMap
from pc2cad.errors import InputError, ToleranceNotReachedError
from pc2cad.expression.narrow import narrow_limits
from pc2cad.expression.tree import ZERO
from pc2cad.geometry.carriers import Evidence
from pc2cad.geometry.splines.adaptive_knots import adapt, beside
from pc2cad.geometry.splines.arcs import wave_in
from pc2cad.geometry.splines.portrait import Sampler
from pc2cad.geometry.splines.rational import Parametrisation
from pc2cad.geometry.splines.spline_profile import SplineProfile, spline_profile
from pc2cad.geometry.splines.spline_space import SplineSpace
from pc2cad.geometry.splines.trivariate import GridSampler, SplineVolume, fit_volume
from pc2cad.options import DEFAULTS, CompileOptions
from pc2cad.representation.deviation_proof import bound_volume
from pc2cad.representation.parametrisation import exact_course
from pc2cad.representation.tightening import Aim, Attempt, tighten
from pc2cad.topology.cells import Cell, SideKey
from pc2cad.topology.complex import BoundaryComplex

#: cross sections on which a direction is resolved: ends and Gauss nodes
_SECTIONS = np.concatenate(([0.0], (np.polynomial.legendre.leggauss(7)[0] + 1) / 2, [1.0]))
#: what one direction's fit aims at of the tolerance, and what all three may deviate as sampled
DIRECTION_SHARE, _ALL = 0.2, 0.9
_MOST_CHECKS = 1_000_000


@dataclass(frozen=True, eq=False)
class Patch:
    """The spline over one piece of the box; its axes are `VolumeModel.directions`."""

    cell: Cell
    volume: SplineVolume
    #: largest distance seen from the equation at equal parameters, and at how many places
    sampled: float
    samples: int
    #: an upper bound of it over the whole patch, None where none could be proved
    bound: float | None = None

    @property
    def deviation(self) -> float:
        """What is known best: the bound, or the largest distance seen."""
        return self.sampled if self.bound is None else self.bound


@dataclass(frozen=True, eq=False)
class SplineField:
    """A field interpolated in the spaces that carry M, whatever these can hold of it."""

    name: str
    #: one for each patch: its poles have the field's components, its weights are the patch's
    volumes: tuple[SplineVolume, ...]
    #: largest difference seen between it and the field, of any component, and the field's largest
    deviation: float
    largest: float
    #: an upper bound of the length of the difference everywhere, None where none could be proved
    bound: float | None = None


@dataclass(frozen=True, eq=False)
class VolumeModel:
    """M as trivariate splines; lengths in `units`."""

    name: str
    units: str
    #: which of u, v, w the first, second and third axis are; v, u, w for a left-handed map
    directions: tuple[int, int, int]
    #: patches in the order of their cells
    patches: tuple[Patch, ...]
    #: number of pieces of u, v and w
    pieces: tuple[int, int, int]
    boundary: BoundaryComplex
    #: exact: polynomial or rational, coefficients rounded; bounded: no place is further away than
    #: the deviation, proved; sampled: deviation measured
    evidence: Evidence
    tolerance: float
    #: the equation's fields on the same spaces
    fields: tuple[SplineField, ...] = ()

    @property
    def deviation(self) -> float:
        """Largest deviation of any patch."""
        return max(patch.deviation for patch in self.patches)

    @property
    def rational(self) -> bool:
        """True where a patch has weights."""
        return any(patch.volume.weights is not None for patch in self.patches)

    def field(self, name: str) -> SplineField:
        """Return the field of a name; raise InputError where there is none."""
        for field in self.fields:
            if field.name == name:
                return field
        known = ", ".join(field.name for field in self.fields) or "none"
        raise InputError(f"{self.name} has no field '{name:.80}' (it has: {known})")

    def volume(self) -> float:
        """Return the volume of all patches."""
        return sum(patch.volume.volume() for patch in self.patches)

    def side_key(self, patch: Patch, axis: int, upper: bool) -> SideKey:
        """Return the cell of the box that a side of a patch is."""
        cell = list(patch.cell)
        cell[self.directions[axis]] += 1 if upper else -1
        return self.boundary.key((cell[0], cell[1], cell[2]))


def represent_volume(checked: CheckedMap, options: CompileOptions = DEFAULTS) -> VolumeModel:
    """Return M as trivariate splines within the options' tolerance.

    Their profile says which degrees directions without an exact form choose from, how high the
    degree of an exact one may be, and whether it may be rational. Raises ToleranceNotReachedError.
    """
    analysis, profile = checked.analysis, spline_profile(options)
    tolerance = resolve_tolerance(checked, options)
    spans = [range(1, 2 * len(limits) - 1, 2) for limits in analysis.bounds]
    functions = [RestrictedMap(analysis, (a, b, c), profile.exact) for a, b, c in product(*spans)]
    classes = DirectionClasses(analysis, profile.degrees)
    exact = {
        (f.cell, d): _exact_course(classes, f, d, profile) for f in functions for d in range(3)
    }
    work = _Work(checked, classes, functions, exact, tolerance)
    if work.is_exact:
        patches = _patches(work, {})
        _check_exact(patches, checked.scale.fitting_noise)
    else:
        patches = tighten(
            partial(_attempt, work), DIRECTION_SHARE * tolerance, "the spline volume deviates",
            tolerance,
        )  # fmt: skip
    proved = all(patch.bound is not None for patch in patches)
    evidence: Evidence = "exact" if work.is_exact else "bounded" if proved else "sampled"
    u, v, w = (len(span) for span in spans)
    return VolumeModel(
        analysis.equation.name, analysis.equation.units, checked.orientation.axes, patches,
        (u, v, w), analysis.boundary, evidence, tolerance,
        tuple(_field(work, patches, field.name) for field in analysis.equation.fields),
    )  # fmt: skip


def _field(work: _Work, patches: tuple[Patch, ...], name: str) -> SplineField:
    """Return a field in the spaces of the patches; raise FieldNotFiniteError."""
    analysis, directions = work.checked.analysis, work.checked.orientation.axes
    field = local_field(analysis, name)
    volumes, deviations, largest = [], [0.0], 0.0
    bounds: list[float | None] = []
    for patch in patches:
        spans = [analysis.span(d, patch.cell[d]) for d in range(3)]

        def sample(x: Array, y: Array, z: Array, spans: list[tuple[float, float]] = spans) -> Array:
            places = (x, y, z)
            local = [a + (b - a) * places[directions.index(d)] for d, (a, b) in enumerate(spans)]
            grid = np.broadcast_arrays(*open_grid(*local))
            values = field.checked_at(np.stack([g.ravel() for g in grid], axis=1))
            return np.transpose(values.reshape(*grid[0].shape, -1), (*directions, 3))

        volume = fit_volume(sample, patch.volume.axes)
        off, seen = _field_deviation(sample, volume)
        deviations.append(off)
        largest = max(largest, seen)
        volumes.append(volume)
        bounds.append(_field_bound(work, field, patch.cell, volume))
    known = [bound for bound in bounds if bound is not None]
    bound = max(known) if len(known) == len(bounds) else None
    return SplineField(name, tuple(volumes), max(deviations), largest, bound)


def _field_bound(work: _Work, field: LocalField, cell: Cell, volume: SplineVolume) -> float | None:
    """Return a proved bound of a field's deviation on a patch, None where there is none."""
    checked = work.checked
    if all(axis.arcs is not None for axis in volume.axes[:2]):
        return None
    x, y, z = (*field.trees, ZERO, ZERO)[:3]
    analysis = replace(
        checked.analysis, map=replace(checked.map, coordinates=(x, y, z), _programs={})
    )
    missing = ((0, 0),) * 3 + ((0, 3 - volume.poles.shape[-1]),)
    padded = replace(volume, poles=np.pad(volume.poles, missing))
    return _proved(RestrictedMap(analysis, cell), padded, checked.orientation.axes)


def _field_deviation(sample: GridSampler, volume: SplineVolume) -> tuple[float, float]:
    """Return the largest difference of a component over a grid off the sites, and the largest."""
    x, y, z = (axis.space.check_places for axis in volume.axes)
    a, b, c = (axis.places(t) for axis, t in zip(volume.axes, (x, y, z), strict=True))
    values = sample(a, b, c)
    return float(np.abs(volume(x, y, z) - values).max()), float(np.abs(values).max())


@dataclass(frozen=True, eq=False)
class _Work:
    """What one call of `represent_volume` is given."""

    checked: CheckedMap
    classes: DirectionClasses
    #: M on each piece of the box
    functions: list[RestrictedMap]
    #: piece and direction -> a parametrisation that holds M exactly
    exact: dict[tuple[Cell, int], Parametrisation | None]
    tolerance: float

    @property
    def is_exact(self) -> bool:
        return all(parametrisation is not None for parametrisation in self.exact.values())


def _check_exact(patches: tuple[Patch, ...], noise: float) -> None:
    worst = max(patch.deviation for patch in patches)
    if worst > noise:
        raise ToleranceNotReachedError(
            f"the exact spline of the volume deviates by {worst:.3g}: its degree is too high "
            "for double precision"
        )


def _attempt(work: _Work, aim: Aim) -> Attempt[tuple[Patch, ...]]:
    """Return the patches from fits with an aim."""
    patches = _patches(work, _spaces(work, aim.target, work.checked.scale.fitting_noise / 16))
    proved = all(patch.bound is not None for patch in patches)
    worst = max(patch.deviation for patch in patches)
    return Attempt(patches, worst, (1.0 if proved else _ALL) * work.tolerance)


def _patches(work: _Work, spaces: dict[Piece, SplineSpace]) -> tuple[Patch, ...]:
    directions = work.checked.orientation.axes
    patches = []
    for function in work.functions:
        a, b, c = (
            work.exact[function.cell, d]
            or Parametrisation(spaces[work.classes.owner((d, function.cell[d]))])
            for d in directions
        )
        sample = turned(function, directions)
        volume = fit_volume(sample, (a, b, c))
        deviation, samples = _deviation(sample, volume)
        bound = None if work.is_exact else _proved(function, volume, directions)
        patches.append(Patch(function.cell, volume, deviation, samples, bound))
    return tuple(patches)


def turned(function: RestrictedMap, directions: tuple[int, int, int]) -> GridSampler:
    """Return the function with its arguments and axes in the order of `directions`."""

    def sample(x: Array, y: Array, z: Array) -> Array:
        places = (x, y, z)
        local = [places[directions.index(d)] for d in range(3)]
        return np.transpose(function(*local), (*directions, 3))

    return sample


def _proved(
    function: RestrictedMap, volume: SplineVolume, directions: tuple[int, int, int]
) -> float | None:
    """Return a proved bound of a patch's deviation, None where there is none."""
    bound = bound_volume(function, volume, directions)
    return bound.largest if bound is not None and np.isfinite(bound.largest) else None


def _exact_course(
    classes: DirectionClasses, function: RestrictedMap, d: int, profile: SplineProfile
) -> Parametrisation | None:
    """Return the parametrisation that carries a function exactly along a direction, or None."""
    trees, names = function.trees
    breaks = classes.breaks((d, function.cell[d]))
    return exact_course(function, d, breaks, wave_in(trees, names[d]), profile)


def _spaces(work: _Work, target: float, floor: float) -> dict[Piece, SplineSpace]:
    """Return a space for every class of pieces of directions that has no exact form."""
    users: dict[Piece, list[Sampler]] = {}
    limits: dict[Piece, list[Array]] = {}
    for function in work.functions:
        for d in range(3):
            if work.exact[function.cell, d] is None:
                owner = work.classes.owner((d, function.cell[d]))
                users.setdefault(owner, []).append(_along(function, d))
                trees, names = function.trees
                limits.setdefault(owner, []).append(narrow_limits(trees, names[d]))
    found = {}
    for owner, samplers in users.items():
        rules, close = work.classes.rules(owner), np.concatenate(limits[owner])
        close = np.concatenate((close, 1 - close)) if rules.symmetric else close
        found[owner] = adapt(beside(samplers), rules, target, floor, close)
    return found


def _along(function: RestrictedMap, d: int) -> Sampler:
    def sample(t: Array) -> Array:
        places = [_SECTIONS] * 3
        places[d] = t
        return np.moveaxis(function(*places), d, 0).reshape(len(t), -1, 3)

    return sample


def _deviation(sample: GridSampler, volume: SplineVolume) -> tuple[float, int]:
    """Return the largest distance between function and spline over a grid off the sites."""
    places = [axis.space.check_places for axis in volume.axes]
    while np.prod([len(p) for p in places], dtype=float) > _MOST_CHECKS:
        longest = max(range(3), key=lambda k: len(places[k]))
        places[longest] = places[longest][::2]
    x, y, z = places
    a, b, c = (axis.places(t) for axis, t in zip(volume.axes, places, strict=True))
    gap = volume(x, y, z) - sample(a, b, c)
    return float(np.sqrt(squares(gap)).max()), gap.size // 3
