"""Parametrisations: in what parameter and in which space faces and edges run along a direction.

Faces that are neither planes nor on an analytic surface have to agree along their common edges at
equal parameters. So all of them take one parametrisation per class of directions. Where it makes a
face exact, or keeps an edge on an analytic surface, it runs through arcs (`splines.arcs`), and what
has to be approximated along it is approximated in the arcs' parameter. Where all are trigonometric
polynomials along it, and approximated along others only, it is one arc: nowhere is there a knot,
and a fit would take more poles. Elsewhere arcs would only make faces rougher, and the equation's
own parameter stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from itertools import groupby

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.domain.direction_classes import DirectionClasses
from pc2cad.domain.looks import sampled
from pc2cad.domain.restrictions import Piece, RestrictedMap, polynomial_space
from pc2cad.domain.sections import sections
from pc2cad.expression.angle_multiples import common
from pc2cad.expression.breaks import Break
from pc2cad.expression.narrow import narrow_limits
from pc2cad.geometry.recognition.separable_form import LARGEST_ORDER, is_wave
from pc2cad.geometry.splines.adaptive_knots import DirectionRules, adapt
from pc2cad.geometry.splines.arcs import Arcs, Wave
from pc2cad.geometry.splines.portrait import Sampler, closer
from pc2cad.geometry.splines.rational import Parametrisation, rational_course
from pc2cad.geometry.splines.spline_profile import SplineProfile
from pc2cad.geometry.splines.spline_space import SplineSpace
from pc2cad.representation.tightening import Aim

#: what stands for a wave that nobody has asked for
_ASK = Wave(0.0, 0)


@dataclass(frozen=True, eq=False)
class FaceDirection:
    """A face or an edge along one of its axes."""

    function: RestrictedMap
    axis: int
    #: False for an edge whose neighbours do not ask for a certain parameter
    bound: bool = True
    #: True for a face on an analytic surface (along the axis of its spline), and for an edge of one
    on_surface: bool = False
    #: two others that a face is no further from its fit than, where both are fitted alike
    between: tuple[RestrictedMap, ...] = ()

    @property
    def piece(self) -> Piece:
        """The direction piece along which it runs."""
        return self.function.pieces[self.axis]

    @property
    def wave(self) -> Wave | None:
        """The wave that it is, where it is a trigonometric polynomial of a linear angle."""
        known = self.function.waves
        if self.axis not in known:
            known[self.axis] = _wave(self.function, self.axis)
        return known[self.axis]

    @property
    def is_no_wave(self) -> bool:
        """Say whether it is known already that it is none."""
        return self.function.waves.get(self.axis, _ASK) is None


@dataclass(frozen=True, eq=False)
class _Look:
    """A face or an edge along one of its axes, and the places of a face's other one."""

    function: RestrictedMap
    axis: int
    across: Array | None

    @property
    def key(self) -> tuple[int, bytes | None]:
        """What those have in common that may be evaluated together."""
        return self.axis, None if self.across is None else self.across.tobytes()


def _seen(looks: Sequence[_Look], places: Array) -> Iterator[Array]:
    """Yield the points at places (n,) along what is looked at alike, (n, sections, 3)."""
    axis, across = looks[0].axis, looks[0].across
    local = [places] if across is None else [places, across]
    for points in sampled([look.function for look in looks], *(local[::-1] if axis else local)):
        rows = points.transpose(1, 0, 2) if axis else points
        yield rows.reshape(len(places), -1, 3)


class Parametrisations:
    """The parametrisations of one model's directions."""

    def __init__(
        self, classes: DirectionClasses, directions: Sequence[FaceDirection], profile: SplineProfile
    ) -> None:
        self._classes = classes
        self._face_directions = directions
        self._profile = profile
        #: of the classes in which something is approximated, in a copy that `resolved` makes
        self._spaces: dict[Piece, SplineSpace] = {}
        self._runs: dict[Piece, Parametrisation] = {}
        self._arcs: dict[Piece, tuple[Arcs, int]] = {}
        #: what `exact` found: it is asked for many times
        self._exact: dict[tuple[RestrictedMap, int, bool], Parametrisation | None] = {}
        members: dict[Piece, list[FaceDirection]] = {}
        for direction in directions:
            same = members.setdefault(classes.owner(direction.piece), [])
            if direction.bound:
                same.append(direction)
        for owner, same in members.items():
            arcs = self._common_arcs(same)
            if arcs is not None:
                self._arcs[owner] = arcs

    def _owner(self, direction: FaceDirection) -> Piece:
        return self._classes.owner(direction.piece)

    def _common_arcs(self, directions: Sequence[FaceDirection]) -> tuple[Arcs, int] | None:
        """Return the arcs of a class and the highest order along it; None where it has none."""
        powers = any(self._polynomial(s) is not None for s in directions)
        if powers or not directions:
            return None
        complete = any(self._completes_a_face(s) for s in directions)
        # most often the faces were asked just now, and no edge has to be
        if not complete and (
            any(s.is_no_wave for s in directions) or any(s.wave is None for s in directions)
        ):
            return None
        waves = [wave for s in directions if (wave := s.wave) is not None]
        ratios = [_ratio(wave.extent, waves[0].extent) for wave in waves]
        known = [r for r in ratios if r is not None]
        if len(known) < len(ratios):
            return None
        unit = reduce(common, known)
        order = max(int(r / unit) * wave.order for r, wave in zip(known, waves, strict=True))
        common_wave = Wave(waves[0].extent * float(unit), order)
        if order > LARGEST_ORDER or not self._profile.allows(common_wave):
            return None
        if complete:
            return common_wave.arcs, order
        if not self._profile.turns:
            return None
        # where all else is fitted, arcs must not be rougher than fits are, nor of higher degree
        arcs = common_wave.single_arc
        return (arcs, order) if arcs.degree(order) <= self._profile.degrees[-1] else None

    def _completes_a_face(self, direction: FaceDirection) -> bool:
        """Say whether a face is exact as soon as the direction is run through in arcs.

        An analytic surface beside an edge is such a face: the edge has to lie on it.
        """
        if direction.on_surface or len(direction.function.pieces) == 1:
            return direction.on_surface and direction.wave is not None
        other = FaceDirection(direction.function, 1 - direction.axis)
        return (
            direction.function.may_be_exact(other.axis)
            and direction.wave is not None
            and (other.wave is not None or self._polynomial(other) is not None)
        )

    def _polynomial(self, direction: FaceDirection) -> SplineSpace | None:
        breaks = self._classes.breaks(direction.piece)
        return polynomial_space(direction.function, direction.axis, breaks)

    def arcs(self, piece: Piece) -> Arcs | None:
        """Return the arcs in which the class of a piece is run through."""
        found = self._arcs.get(self._classes.owner(piece))
        return found and found[0]

    def exact(self, direction: FaceDirection) -> Parametrisation | None:
        """Return a parametrisation that holds the direction exactly, or None."""
        key = direction.function, direction.axis, direction.bound
        if key not in self._exact:
            self._exact[key] = self._exact_of(direction)
        return self._exact[key]

    def _exact_of(self, direction: FaceDirection) -> Parametrisation | None:
        found = self._arcs.get(self._owner(direction)) if direction.bound else None
        if found is None:
            wave = None if direction.bound else direction.wave
            breaks = self._classes.breaks(direction.piece)
            return exact_course(direction.function, direction.axis, breaks, wave, self._profile)
        wave, (arcs, _) = direction.wave, found
        if wave is None:
            return None
        return rational_course(arcs, round(wave.extent / arcs.extent) * wave.order)

    def parametrisation(self, direction: FaceDirection) -> Parametrisation:
        """Return a direction's parametrisation; if it is approximated, after `resolved`."""
        exact = self.exact(direction)
        if exact is not None:
            return exact
        owner = self._owner(direction)
        if owner not in self._runs:
            arcs, order = self._arcs.get(owner, (None, 0))
            self._runs[owner] = Parametrisation(self._spaces[owner], arcs, order)
        return self._runs[owner]

    # -- approximation -------------------------------------------------------------------------

    def resolved(self, aim: Aim, floor: float) -> Parametrisations:
        """Return the parametrisations with a space for each class in which one is approximated.

        `floor` (what rounding leaves) is a length. Raises ToleranceNotReachedError.
        """
        users: dict[Piece, list[FaceDirection]] = {}
        for direction in self._face_directions:
            # the sections of a face include the edges that follow its parameters
            is_section = direction.bound and len(direction.function.pieces) == 1
            if not is_section and self.exact(direction) is None:
                users.setdefault(self._owner(direction), []).append(direction)
        result = copy(self)
        result._spaces, result._runs = {}, {}
        for owner, same in users.items():
            fitted = {direction.function for direction in same}
            directions = [d for d in same if not (d.between and fitted.issuperset(d.between))]
            columns = result._columns(directions, aim)
            limits = np.concatenate(
                [closer(self._focus(owner, aim)), *map(self._narrow, directions)]
            )
            result._spaces[owner] = adapt(columns, self._rules(owner), aim.target, floor, limits)
        return result

    def _narrow(self, direction: FaceDirection) -> Array:
        """Return limits where the function changes at short length, in the splines' parameter."""
        owner = self._owner(direction)
        if owner in self._arcs:
            return np.empty(0)
        trees, names = direction.function.trees
        limits = narrow_limits(trees, names[direction.axis])
        symmetric = self._classes.rules(owner).symmetric
        return np.concatenate((limits, 1 - limits)) if symmetric else limits

    def _focus(self, owner: Piece, aim: Aim) -> Array:
        """Return the places of a class that are looked at closely, in the splines' parameter."""
        focus = np.array(aim.focus.get(owner, ()), dtype=float)
        symmetric = self._classes.rules(owner).symmetric
        return distinct(np.concatenate((focus, 1 - focus))) if symmetric else focus

    def _rules(self, owner: Piece) -> DirectionRules:
        rules = self._classes.rules(owner)
        if owner not in self._arcs:
            return rules
        arcs, order = self._arcs[owner]
        smoothness = {b.position: b.smoothness for b in rules.breaks}
        smoothness |= dict.fromkeys(arcs.points.tolist(), 0)
        breaks = tuple(Break(p, smoothness[p]) for p in sorted(smoothness))
        degrees = sorted({max(degree, arcs.degree(order)) for degree in rules.degrees})
        return replace(rules, degrees=degrees, breaks=breaks, periodic=False)

    def _columns(self, directions: Sequence[FaceDirection], aim: Aim) -> Sampler:
        """Return the functions along a class of directions, others taken at their sections.

        They are one function of the splines' parameter, (n,) to (n, columns, 3). Faces and edges
        that follow one another, and are looked at across the same places, are evaluated together.
        """
        arcs, order = self._arcs.get(self._owner(directions[0]), (None, 0))
        along = Parametrisation(SplineSpace(1, (0.0, 1.0)), arcs, order)
        looks = [_Look(d.function, d.axis, self._across(d, aim)) for d in directions]
        alike = [list(same) for _, same in groupby(looks, lambda look: look.key)]

        def sample(x: Array) -> Array:
            places, weight = along.places(x), along.weight(x)[:, None, None]
            found = [points for same in alike for points in _seen(same, places)]
            return np.concatenate(found, axis=1) * weight

        return sample

    def _across(self, direction: FaceDirection, aim: Aim) -> Array | None:
        """Return the places across which a direction is looked at, None for an edge."""
        if len(direction.function.pieces) == 1:
            return None
        return self._sections(FaceDirection(direction.function, 1 - direction.axis), aim)

    def _sections(self, direction: FaceDirection, aim: Aim) -> Array:
        """Return the places across which a face is looked at: the sites of a small known space."""
        exact, owner = self.exact(direction), self._owner(direction)
        focus = self._focus(owner, aim)
        if exact is None and owner in self._spaces and len(focus) == 0:
            exact = self.parametrisation(direction)
        if exact is not None and exact.space.size <= 12:
            return exact.sites
        arcs, _ = self._arcs.get(owner, (None, 0))
        close = focus if arcs is None else arcs.places(focus)
        return distinct(np.concatenate((sections(aim.density), close)))


def exact_course(
    function: RestrictedMap,
    axis: int,
    breaks: Sequence[Break],
    wave: Wave | None,
    profile: SplineProfile,
) -> Parametrisation | None:
    """Return a parametrisation that holds a function exactly along one axis, None if none does.

    `wave` is what is known of it as a trigonometric polynomial.
    """
    if wave is not None and profile.allows(wave):
        return rational_course(wave.arcs, wave.order)
    space = polynomial_space(function, axis, breaks)
    return None if space is None else Parametrisation(space, exact=True)


def _wave(function: RestrictedMap, axis: int) -> Wave | None:
    trees, names = function.trees
    form = function.form if function.may_be_exact(axis) and is_wave(trees, names[axis]) else None
    extent = None if form is None else form.axes[axis].extent
    return None if form is None or extent is None else Wave(extent, form.order(axis))


def _ratio(a: float, b: float) -> Fraction | None:
    """Return a/b where it is a fraction of small numbers."""
    ratio = Fraction(a / b).limit_denominator(LARGEST_ORDER)
    return ratio if ratio and abs(float(ratio) * b / a - 1) < 1e-13 else None
