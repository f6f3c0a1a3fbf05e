"""The course of every direction: in what parameter and in which space faces and edges run along it.

Faces that are neither planes nor on an analytic surface have to agree along their common edges at
equal parameters. So all of them take one course per class of directions. Where it makes a face
exact, or keeps an edge on an analytic surface, that course runs through arcs (`geometry.rational`),
and what has to be approximated along it is approximated in the arcs' parameter. Elsewhere arcs
would only make faces rougher, and the equation's own parameter stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.restrictions import (
    SECTIONS,
    CellFunction,
    DirectionClasses,
    Piece,
    polynomial_space,
)
from pc2cad.expression.angle_multiples import common
from pc2cad.expression.breaks import Break
from pc2cad.geometry.recognition.separable_form import LARGEST_ORDER
from pc2cad.geometry.splines.adaptive_knots import DirectionRules, Sampler, adapt, beside
from pc2cad.geometry.splines.arcs import Arcs, Wave
from pc2cad.geometry.splines.rational import Course, rational_course
from pc2cad.geometry.splines.spline_profile import SplineProfile
from pc2cad.geometry.splines.spline_space import SplineSpace


@dataclass(frozen=True, eq=False)
class Strand:
    """A face or an edge along one of its axes."""

    function: CellFunction
    axis: int
    #: False for an edge whose neighbours do not ask for a certain parameter
    bound: bool = True
    #: True for a face on an analytic surface (along the axis of its spline), and for an edge of one
    laid: bool = False

    @property
    def piece(self) -> Piece:
        """The direction piece along which it runs."""
        return self.function.pieces[self.axis]

    @property
    def wave(self) -> Wave | None:
        """The wave that it is, where it is a trigonometric polynomial of a linear angle."""
        form = self.function.form if self.function.may_be_exact(self.axis) else None
        if form is None or form.axes[self.axis].kind != "wave":
            return None
        axis = form.axes[self.axis]
        if not axis.is_linear:
            return None
        first, last = axis.turn(1, np.array([0.0, 1.0])).tolist()
        return Wave(abs(last - first), form.order(self.axis))


class Courses:
    """The courses of one model's strands."""

    def __init__(
        self, classes: DirectionClasses, strands: Sequence[Strand], profile: SplineProfile
    ) -> None:
        self._classes = classes
        self._strands = strands
        self._profile = profile
        #: of the classes in which something is approximated, in a copy that `resolved` makes
        self._spaces: dict[Piece, SplineSpace] = {}
        self._arcs: dict[Piece, tuple[Arcs, int]] = {}
        for owner in {classes.owner(s.piece) for s in strands}:
            arcs = self._common_arcs([s for s in strands if s.bound and self._owner(s) == owner])
            if arcs is not None:
                self._arcs[owner] = arcs

    def _owner(self, strand: Strand) -> Piece:
        return self._classes.owner(strand.piece)

    def _common_arcs(self, strands: Sequence[Strand]) -> tuple[Arcs, int] | None:
        """Return the arcs of a class and the highest order along it; None where it has none."""
        powers = any(self._polynomial(s) is not None for s in strands)
        if powers or not any(self._completes_a_face(s) for s in strands):
            return None
        waves = [wave for s in strands if (wave := s.wave) is not None]
        ratios = [_ratio(wave.extent, waves[0].extent) for wave in waves]
        known = [r for r in ratios if r is not None]
        if len(known) < len(ratios):
            return None
        unit = reduce(common, known)
        order = max(int(r / unit) * wave.order for r, wave in zip(known, waves, strict=True))
        common_wave = Wave(waves[0].extent * float(unit), order)
        if order > LARGEST_ORDER or not self._profile.allows(common_wave):
            return None
        return common_wave.arcs, order

    def _completes_a_face(self, strand: Strand) -> bool:
        """Say whether a face is exact as soon as the strand is run through in arcs.

        An analytic surface beside an edge is such a face: the edge has to lie on it.
        """
        if strand.laid or len(strand.function.pieces) == 1:
            return strand.laid and strand.wave is not None
        other = Strand(strand.function, 1 - strand.axis)
        return (
            strand.function.may_be_exact(other.axis)
            and strand.wave is not None
            and (other.wave is not None or self._polynomial(other) is not None)
        )

    def _polynomial(self, strand: Strand) -> SplineSpace | None:
        breaks = self._classes.breaks(strand.piece)
        return polynomial_space(strand.function, strand.axis, breaks)

    def arcs(self, piece: Piece) -> Arcs | None:
        """Return the arcs in which the class of a piece is run through."""
        found = self._arcs.get(self._classes.owner(piece))
        return found and found[0]

    def exact(self, strand: Strand) -> Course | None:
        """Return a course that holds the strand exactly, or None."""
        found = self._arcs.get(self._owner(strand)) if strand.bound else None
        if found is None:
            wave = None if strand.bound else strand.wave
            breaks = self._classes.breaks(strand.piece)
            return exact_course(strand.function, strand.axis, breaks, wave, self._profile)
        wave, (arcs, _) = strand.wave, found
        if wave is None:
            return None
        return rational_course(arcs, round(wave.extent / arcs.extent) * wave.order)

    def course(self, strand: Strand) -> Course:
        """Return the course of a strand; of one that is approximated, after `resolved`."""
        exact = self.exact(strand)
        if exact is not None:
            return exact
        owner = self._owner(strand)
        arcs, order = self._arcs.get(owner, (None, 0))
        return Course(self._spaces[owner], arcs, order)

    # -- approximation -------------------------------------------------------------------------

    def resolved(self, target: float, floor: float) -> Courses:
        """Return the courses with a space for every class that some strand is approximated in.

        `target` and `floor` (what rounding leaves) are lengths. Raises ToleranceNotReachedError.
        """
        users: dict[Piece, list[Strand]] = {}
        for strand in self._strands:
            # the sections of a face include the edges that follow its parameters
            is_section = strand.bound and len(strand.function.pieces) == 1
            if not is_section and self.exact(strand) is None:
                users.setdefault(self._owner(strand), []).append(strand)
        result = copy(self)
        result._spaces = {}
        for owner, strands in users.items():
            column = beside([result._column(strand) for strand in strands])
            result._spaces[owner] = adapt(column, self._rules(owner), target, floor)
        return result

    def _rules(self, owner: Piece) -> DirectionRules:
        rules = self._classes.rules(owner)
        if owner not in self._arcs:
            return rules
        arcs, order = self._arcs[owner]
        smoothness = {b.position: b.smoothness for b in rules.breaks}
        smoothness |= dict.fromkeys(arcs.points.tolist(), 0)
        breaks = tuple(Break(p, smoothness[p]) for p in sorted(smoothness))
        degrees = sorted({max(degree, 2 * order) for degree in rules.degrees})
        return replace(rules, degrees=degrees, breaks=breaks, periodic=False)

    def _column(self, strand: Strand) -> Sampler:
        """Return the function of one axis alone, the other taken at its sections."""
        arcs, order = self._arcs.get(self._owner(strand), (None, 0))
        along = Course(SplineSpace(1, (0.0, 1.0)), arcs, order)
        function = strand.function
        if len(function.pieces) == 1:
            return lambda x: function(along.places(x)) * along.weight(x)[:, None]
        across = self._sections(Strand(function, 1 - strand.axis))
        if strand.axis == 0:
            return lambda x: function(along.places(x), across) * along.weight(x)[:, None, None]
        return lambda x: (
            function(across, along.places(x)).transpose(1, 0, 2) * along.weight(x)[:, None, None]
        )

    def _sections(self, strand: Strand) -> Array:
        """Return the places across which a face is looked at: the sites of a small known space."""
        exact = self.exact(strand)
        if exact is None and self._owner(strand) in self._spaces:
            exact = self.course(strand)
        if exact is None or exact.space.size > 12:
            return SECTIONS
        return exact.places(exact.space.sites)


def exact_course(
    function: CellFunction,
    axis: int,
    breaks: Sequence[Break],
    wave: Wave | None,
    profile: SplineProfile,
) -> Course | None:
    """Return a course of its own that holds a function exactly along one axis, None if none does.

    `wave` is what is known of it as a trigonometric polynomial.
    """
    if wave is not None and profile.allows(wave):
        return rational_course(wave.arcs, wave.order)
    space = polynomial_space(function, axis, breaks)
    return None if space is None else Course(space, exact=True)


def _ratio(a: float, b: float) -> Fraction | None:
    """Return a/b where it is a fraction of small numbers."""
    ratio = Fraction(a / b).limit_denominator(LARGEST_ORDER)
    return ratio if ratio and abs(float(ratio) * b / a - 1) < 1e-13 else None
