"""Adaptive choice of a spline space for one direction: degree and knots with the fewest poles.

The function is looked at once: Chebyshev pieces, bisected until their coefficients vanish, hold it
to a hundredth of the target. Their derivatives say for every degree p how far apart knots may be,
h = (target / (c |f^(p+1)|))^(1/(p+1)), and so how many poles each degree needs (de Boor's
equidistribution). The cheapest is tried, measured against the function itself, and its distances
are corrected where the measured errors differ from the target.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.breaks import Break
from pc2cad.geometry.splines.portrait import (
    FINEST_INTERVAL,
    MOST_INTERVALS,
    Portrait,
    Sampler,
    longest,
    look,
    not_reached,
)
from pc2cad.geometry.splines.spline_space import SplineSpace, smallest_error

#: knot distances grow at most by this share from one interval to the next
_GROWTH = 0.5
#: corrections of a degree's knots by its measured errors, and what they aim at
_ROUNDS, _AIM = 4, 0.9
#: a degree is tried where its estimated poles are at most so many times those of the best so far
_DOUBT = 1.08
#: share of what one wave of a mix's mean frequency would cost that the mix costs
_MIXED = 0.9
#: before errors fall as h^(p+1) they fall faster: the order that a correction reckons with
_STEEPER = 1.3
#: share of an interval's error that its neighbours answer for
_NEIGHBOUR = 0.7


@dataclass(frozen=True)
class DirectionRules:
    """What a direction's space has to respect."""

    #: ascending degrees to choose from
    degrees: Sequence[int]
    #: places of reduced smoothness, ends included where they are such places
    breaks: Sequence[Break] = ()
    periodic: bool = False
    #: knots must be symmetric about 1/2 (a gluing reverses the direction)
    symmetric: bool = False

    def space(self, degree: int, points: Array) -> SplineSpace:
        """Return the space with these points; breaks get the multiplicity that they need."""
        multiplicity = {b.position: max(1, degree - b.smoothness) for b in self.breaks}
        inner = [multiplicity.get(x, 1) for x in points[1:-1].tolist()] if multiplicity else None
        seam = multiplicity.get(0.0, 1) if self.periodic else None
        return SplineSpace(degree, points, inner, seam)

    @cached_property
    def pieces(self) -> Array:
        """Ascending limits of the smooth pieces: 0, inner breaks, 1."""
        inner = {b.position for b in self.breaks if 0 < b.position < 1}
        return np.array([0.0, *sorted(inner), 1.0])


def adapt(
    sample: Sampler,
    rules: DirectionRules,
    target: float,
    floor: float,
    limits: Array | None = None,
) -> SplineSpace:
    """Return a space whose fit of all columns stays within `target` at the checks.

    Of the degrees that the rules allow it is the one with the fewest poles, the lower of equals.
    `target` and `floor` are lengths; errors below `floor` are rounding. The function is
    first looked at between `limits` in ]0, 1[. Raises ToleranceNotReachedError when
    `MOST_INTERVALS` are not enough.
    """
    portrait = look(sample, rules.pieces, target, floor, np.empty(0) if limits is None else limits)
    plans = []
    for degree in rules.degrees:
        distances = _distances_of(portrait, degree, target, rules)
        space = rules.space(degree, distances.knots(rules))
        plans.append((space.size, degree, space, distances))
    best: SplineSpace | None = None
    for size, degree, first, distances in sorted(plans, key=lambda plan: plan[:2]):
        if best is None or size <= _DOUBT * best.size:
            found = _settle(portrait, rules, first, distances, target, best)
            if found and (best is None or (found.size, degree) < (best.size, best.degree)):
                best = found
    assert best is not None
    return best


def beside(samplers: Sequence[Sampler]) -> Sampler:
    """Return several functions along one direction as one, (n, …, 3) each, as (n, columns, 3)."""

    def sample(t: Array) -> Array:
        return np.concatenate([s(t).reshape(len(t), -1, 3) for s in samplers], axis=1)

    return sample


# -- distances of knots ----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Distances:
    """How far apart knots may be, `h`, at ascending places `t` between `edges` around them."""

    edges: Array
    h: Array

    @property
    def places(self) -> Array:
        return (self.edges[:-1] + self.edges[1:]) / 2

    def knots(self, rules: DirectionRules) -> Array:
        """Return points that are nowhere further apart, in equal shares between breaks."""
        widths = self.edges[1:] - self.edges[:-1]  # np.diff takes eight times as long
        count = np.concatenate(([0.0], (widths / self.h).cumsum()))
        result = [np.zeros(1)]
        pieces = rules.pieces
        for low, high in pairwise(pieces):
            first, last = np.interp((low, high), self.edges, count)
            number = max(1, int(np.ceil(last - first - 0.02)))
            # the inner places of np.linspace
            shares = np.arange(1, number) * ((last - first) / number) + first
            inner = np.interp(shares, count, self.edges)
            result += [inner, np.array([high])]
        points = np.concatenate(result)
        return (points + 1 - points[::-1]) / 2 if rules.symmetric else points

    def scaled(self, points: Array, factors: Array, rules: DirectionRules) -> _Distances:
        """Return distances multiplied by factors, one for each interval between points."""
        middles = (points[:-1] + points[1:]) / 2
        factor = np.interp(self.places, middles, factors)
        return _Distances(self.edges, self.h * factor).regular(rules)

    def regular(self, rules: DirectionRules) -> _Distances:
        """Return distances that are symmetric where they have to be and change gradually."""
        t, h = self.places, self.h
        if rules.periodic:
            t = np.concatenate((t - 1, t, t + 1))
            h = np.concatenate((h, h, h))
        rate = _GROWTH
        h = np.minimum(
            np.minimum.accumulate(h - rate * t) + rate * t,
            (np.minimum.accumulate((h + rate * t)[::-1])[::-1]) - rate * t,
        )
        if rules.periodic:
            h = h[len(h) // 3 : 2 * len(h) // 3]
        if rules.symmetric:
            h = np.minimum(h, np.interp(1 - self.places, self.places, h))
        return _Distances(self.edges, h)


def _distances_of(
    portrait: Portrait, degree: int, target: float, rules: DirectionRules
) -> _Distances:
    """Return how far apart the knots of a degree may be for an error of `target`.

    On equal knots, h apart, a wave of frequency ω is off by c |f^(p+1)| h^(p+1) for small h, by
    1/(1 - ωh/2π)^(p+1) times that for larger ones. So the distance that suits small ones is divided
    by 1 + ωh/2π.
    """
    order = degree + 1
    largest, mean = portrait.derivative(order)
    _, before = portrait.derivative(order - 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        h = np.minimum((target / (smallest_error(degree) * largest)) ** (1 / order), 1.0)
        waves = np.sqrt(mean / before)[:, None] * h / (2 * np.pi)
    waves[np.isnan(waves)] = 0.0
    h = h / (1 + _MIXED * np.minimum(waves, 1.0))
    return _Distances(portrait.edges, h.ravel()).regular(rules)


# -- spaces, measured ------------------------------------------------------------------------------


def _interval_errors(portrait: Portrait, space: SplineSpace) -> Array:
    """Return the largest deviation per interval over the checks and all columns."""
    places, starts = space.checks
    seen, truth = portrait(space.sites, places)
    gap = (space.check_basis @ space.fit(seen) - truth).reshape(len(places), -1, 3)
    size = longest(gap)
    # a knot belongs to both its intervals
    ends = np.append(size[starts[1:]], size[-1:])
    return np.asarray(np.maximum(np.maximum.reduceat(size[:-1], starts), ends))


def _at_best(errors: Array, degree: int) -> float:
    """Return what one interval less would leave if all carried the same error, by the law h^(p+1).

    That is what corrections lead to at best. Before errors follow the law they grow faster.
    """
    order, count = degree + 1, len(errors)
    if count == 1:
        return np.inf
    return float(((errors ** (1 / order)).sum() / (count - 1)) ** order)


def _settle(
    portrait: Portrait,
    rules: DirectionRules,
    space: SplineSpace,
    distances: _Distances,
    target: float,
    rival: SplineSpace | None = None,
) -> SplineSpace | None:
    """Return the smallest space of a degree that a few corrections of its knots lead to.

    `space` is the first, that of the `distances`. None as soon as it is seen not to become smaller
    than that of a `rival`.
    """
    best: SplineSpace | None = None
    rounds, degree = 0, space.degree
    measured, largest = np.zeros(0), np.inf
    raw = errors = np.zeros(0)
    while best is None or rounds < _ROUNDS:
        points = space.points
        nearest = int((points[1:] - points[:-1]).argmin())
        if len(points) > MOST_INTERVALS or points[nearest + 1] - points[nearest] < FINEST_INTERVAL:
            if best is None and rival is None:
                raise not_reached(len(points) - 1, target, points[nearest])
            break
        if best is not None and space.size >= best.size:
            break
        # the first knots are guesses, later ones are not
        if rounds and rival and (space.size, degree) >= (rival.size, rival.degree):
            break
        if not np.array_equal(points, measured):
            raw = errors = _interval_errors(portrait, space)
            measured, largest = points, float(errors.max())
            # a knot's place matters to its neighbours' errors as well
            beside = np.concatenate((errors[:1], errors, errors[-1:]))
            errors = np.maximum(errors, _NEIGHBOUR * np.maximum(beside[:-2], beside[2:]))
        if largest <= target:
            best = space
            if _at_best(raw, degree) > target:
                break
        with np.errstate(divide="ignore"):
            factors = (_AIM * target / errors) ** (1 / (_STEEPER * (degree + 1)))
        # from the third round on the worst interval speaks for all
        limit = factors.min() if rounds > 1 and best is None else 1.5
        distances = distances.scaled(points, np.clip(factors, 0.5, max(limit, 0.5)), rules)
        space = rules.space(degree, distances.knots(rules))
        rounds += 1
    return best
