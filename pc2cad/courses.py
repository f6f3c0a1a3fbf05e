"""The course of every direction: in what parameter and in which space faces and edges run along it.

Faces that are neither planes nor on an analytic surface have to agree along their common edges at
equal parameters. So all of them take one course per class of directions. Where it makes a face
exact, or keeps an edge on an analytic surface, that course runs through arcs (`geometry.rational`),
and what has to be approximated along it is approximated in the arcs' parameter. Elsewhere arcs
would only make faces rougher, and the equation's own parameter stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from pc2cad.directions import (
    SECTIONS,
    CellFunction,
    DirectionClasses,
    Piece,
    polynomial_space,
)
from pc2cad.equation.breaks import Break
from pc2cad.equation.multiples import common
from pc2cad.geometry.profile import SplineProfile
from pc2cad.geometry.rational import Arcs, Course, rational_course
from pc2cad.geometry.refinement import DirectionRules, Sampler, adapt
from pc2cad.geometry.separation import LARGEST_ORDER
from pc2cad.geometry.spline_space import SplineSpace

Array = NDArray[np.float64]

#: arcs are no longer than this: a quarter turn, and half of it where weights would spread too far
LONGEST_ARC = np.pi / 2
MODEST_ORDER = 5


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
    def wave(self) -> tuple[float, int] | None:
        """Extent of the angle (radians) and order, where it is a trigonometric polynomial."""
        form = self.function.form if self.function.may_be_exact(self.axis) else None
        if form is None or form.axes[self.axis].kind != "wave":
            return None
        axis = form.axes[self.axis]
        if not axis.is_linear:
            return None
        first, last = axis.turn(1, np.array([0.0, 1.0])).tolist()
        return abs(last - first), form.order(self.axis)


class Courses:
    """The courses of one model's strands."""

    def __init__(
        self, classes: DirectionClasses, strands: Sequence[Strand], profile: SplineProfile
    ) -> None:
        self._classes = classes
        self._strands = strands
        self._profile = profile
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
        ratios = [_ratio(extent, waves[0][0]) for extent, _ in waves]
        known = [r for r in ratios if r is not None]
        if len(known) < len(ratios):
            return None
        unit = reduce(common, known)
        order = max(int(r / unit) * k for r, (_, k) in zip(known, waves, strict=True))
        if order > LARGEST_ORDER or not self._allowed(order):
            return None
        return _arcs(waves[0][0] * float(unit), order), order

    def _allowed(self, order: int) -> bool:
        return self._profile.rational and 2 * order <= self._profile.exact

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
        wave = strand.wave if found is not None or not strand.bound else None
        if found is None and wave is not None and self._allowed(wave[1]):
            found = _arcs(*wave), wave[1]
        if found is None:
            space = self._polynomial(strand)
            return None if space is None else Course(space, exact=True)
        if wave is None:
            return None
        arcs, _ = found
        multiple = round(wave[0] / arcs.extent)
        return rational_course(arcs, multiple * wave[1])

    def course(self, strand: Strand) -> Course:
        """Return the course of a strand; call `resolve` first."""
        exact = self.exact(strand)
        if exact is not None:
            return exact
        owner = self._owner(strand)
        arcs, order = self._arcs.get(owner, (None, 0))
        return Course(self._spaces[owner], arcs, order)

    # -- approximation -------------------------------------------------------------------------

    def resolve(self, target: float, floor: float) -> None:
        """Choose the space of every class that some strand is approximated in.

        `target` and `floor` (what rounding leaves) are lengths. Raises ToleranceNotReachedError.
        """
        users: dict[Piece, list[Strand]] = {}
        for strand in self._strands:
            # the sections of a face include the edges that follow its parameters
            is_section = strand.bound and len(strand.function.pieces) == 1
            if not is_section and self.exact(strand) is None:
                users.setdefault(self._owner(strand), []).append(strand)
        for owner, strands in users.items():
            columns = [self._column(strand) for strand in strands]
            self._spaces[owner] = adapt(_beside(columns), self._rules(owner), target, floor)

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


def _beside(samplers: list[Sampler]) -> Sampler:
    def sample(x: Array) -> Array:
        return np.concatenate([s(x).reshape(len(x), -1, 3) for s in samplers], axis=1)

    return sample


def _arcs(extent: float, order: int) -> Arcs:
    longest = LONGEST_ARC if order <= MODEST_ORDER else LONGEST_ARC / 2
    return Arcs(extent, max(1, int(np.ceil(extent / longest - 1e-9))))


def _ratio(a: float, b: float) -> Fraction | None:
    """Return a/b where it is a fraction of small numbers."""
    ratio = Fraction(a / b).limit_denominator(LARGEST_ORDER)
    return ratio if ratio and abs(float(ratio) * b / a - 1) < 1e-13 else None
