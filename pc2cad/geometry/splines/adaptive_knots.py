"""Adaptive choice of a spline space for one direction: degree and knots with the fewest poles.

The function is looked at once: Chebyshev pieces, bisected until their coefficients vanish, hold it
to a hundredth of the target. Their derivatives say for every degree p how far apart knots may be,
h = (target / (c |f^(p+1)|))^(1/(p+1)), and so how many poles each degree needs (de Boor's
equidistribution). The cheapest is tried, measured against the function itself, and its distances
are corrected where the measured errors differ from the target.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product
from pc2cad.errors import ToleranceNotReachedError
from pc2cad.expression.breaks import Break
from pc2cad.geometry.splines.spline_space import SplineSpace, smallest_error

#: values at parameters t of shape (m,): shape (m, columns, 3)
Sampler = Callable[[Array], Array]

#: more intervals than this in one direction are refused
MOST_INTERVALS = 6000
#: and so are intervals shorter than this: the kernel wants knots further apart than 1e-10
FINEST_INTERVAL = 1e-9
#: nodes of a Chebyshev piece, and how many of its last coefficients have to vanish
_NODES, _TAIL = 17, 3
#: pieces that begin at a place of focus are halved so often from the whole direction
_CLOSEST = 26
#: places per Chebyshev piece at which the distance of knots is worked out
_PLACES = 16
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
        inner = [multiplicity.get(float(x), 1) for x in points[1:-1]]
        seam = multiplicity.get(0.0, 1) if self.periodic else None
        return SplineSpace(degree, points, inner, seam)

    @property
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
    portrait = _look(sample, rules, target, floor, np.empty(0) if limits is None else limits)
    plans = []
    for degree in rules.degrees:
        distances = portrait.distances(degree, target, rules)
        plans.append((rules.space(degree, distances.knots(rules)).size, degree, distances))
    best: SplineSpace | None = None
    for size, degree, distances in sorted(plans, key=lambda plan: plan[:2]):
        if best is None or size <= _DOUBT * best.size:
            space = _settle(portrait, rules, degree, distances, target, best)
            if space and (best is None or (space.size, degree) < (best.size, best.degree)):
                best = space
    assert best is not None
    return best


def beside(samplers: Sequence[Sampler]) -> Sampler:
    """Return several functions along one direction as one, (n, …, 3) each, as (n, columns, 3)."""

    def sample(t: Array) -> Array:
        return np.concatenate([s(t).reshape(len(t), -1, 3) for s in samplers], axis=1)

    return sample


# -- the function, looked at once ------------------------------------------------------------------


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
        widths = np.diff(self.edges)
        count = np.concatenate(([0.0], np.cumsum(widths / self.h)))
        result = [np.zeros(1)]
        pieces = rules.pieces
        for low, high in pairwise(pieces):
            first, last = np.interp((low, high), self.edges, count)
            number = max(1, int(np.ceil(last - first - 0.02)))
            inner = np.interp(np.linspace(first, last, number + 1)[1:-1], count, self.edges)
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
            h = np.tile(h, 3)
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


@dataclass(frozen=True, eq=False)
class _Portrait:
    """Chebyshev pieces: limits (n + 1,) and coefficients (n, _NODES, columns, 3)."""

    limits: Array
    coefficients: Array
    #: sizes of derivatives that were asked for, by their order: degrees side by side share some
    _sizes: dict[int, Array] = field(default_factory=dict, repr=False)

    def __call__(self, t: Array) -> Array:
        """Return the values at ascending t, (len(t), 3 columns)."""
        count = self.coefficients.shape[1]
        result = np.empty((len(t), self.coefficients[0, 0].size))
        cuts = np.concatenate(([0], np.searchsorted(t, self.limits[1:-1]), [len(t)]))
        x = 2 * (t - np.repeat(self.limits[:-1], np.diff(cuts)))
        x = x / np.repeat(np.diff(self.limits), np.diff(cuts)) - 1
        values = _chebyshev(x, count)
        for i in np.flatnonzero(np.diff(cuts)):
            rows = slice(cuts[i], cuts[i + 1])
            result[rows] = product(values[rows], self.coefficients[i].reshape(count, -1))
        return result

    def distances(self, degree: int, target: float, rules: DirectionRules) -> _Distances:
        """Return how far apart the knots of a degree may be for an error of `target`.

        On equal knots, h apart, a wave of frequency ω is off by c |f^(p+1)| h^(p+1) for small h,
        by 1/(1 - ωh/2π)^(p+1) times that for larger ones. So the distance that suits small ones is
        divided by 1 + ωh/2π.
        """
        order = degree + 1
        lengths = np.diff(self.limits)
        edges = np.append(
            (self.limits[:-1, None] + lengths[:, None] * np.arange(_PLACES) / _PLACES).ravel(), 1.0
        )
        sizes, before = self._derivative(order), self._derivative(order - 2)
        largest = sizes.max(axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            h = np.minimum((target / (smallest_error(degree) * largest)) ** (1 / order), 1.0)
            frequency = np.sqrt(_mean(sizes) / _mean(before))[:, None]
        waves = np.nan_to_num(frequency * h / (2 * np.pi), posinf=1.0)
        h = h / (1 + _MIXED * np.minimum(waves, 1.0))
        return _Distances(edges, h.ravel()).regular(rules)

    def _derivative(self, order: int) -> Array:
        """Return the sizes of a derivative at the middles of equal parts, (n, _PLACES, columns)."""
        if order not in self._sizes:
            self._sizes[order] = self._derived(order)
        return self._sizes[order]

    def _derived(self, order: int) -> Array:
        n, count, columns, _ = self.coefficients.shape
        if not 0 <= order < count:
            return np.zeros((n, _PLACES, columns))
        flat = self.coefficients.transpose(1, 0, 2, 3).reshape(count, -1)
        values = product(_derivatives(order, count), flat).reshape(_PLACES, n, columns, 3)
        sizes = np.sqrt((values**2).sum(axis=-1)).transpose(1, 0, 2)
        return np.asarray(sizes * (2 / np.diff(self.limits)[:, None, None]) ** order)


def _chebyshev(x: Array, count: int) -> Array:
    """Return so many Chebyshev polynomials at x, (len(x), count), as NumPy's `chebvander` does."""
    values = np.empty((count, len(x)))
    values[0], values[1], twice = 1.0, x, 2 * x
    for k in range(2, count):
        values[k] = values[k - 1] * twice - values[k - 2]
    return values.T


def _longest(vectors: Array) -> Array:
    """Return the length of the longest of vectors (…, columns, 3), (…)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.asarray(np.sqrt((x * x + y * y + z * z).max(axis=-1)))


def _mean(sizes: Array) -> Array:
    return np.asarray(np.sqrt((sizes**2).mean(axis=(1, 2))))


@lru_cache
def _derivatives(order: int, count: int) -> Array:
    """Return the derivatives of Chebyshev polynomials at the middles of _PLACES equal parts."""
    x = (2 * np.arange(_PLACES) + 1) / _PLACES - 1
    coefficients = chebyshev.chebder(np.eye(count), order)
    return np.asarray(product(chebyshev.chebvander(x, len(coefficients) - 1), coefficients))


@lru_cache
def _transform() -> tuple[Array, Array]:
    """Return nodes on [0, 1], ends not among them, and the matrix from values to coefficients."""
    x = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)[::-1]
    matrix = np.asarray(chebyshev.chebvander(x, _NODES - 1).T * (2 / _NODES), dtype=float)
    matrix[0] /= 2
    return (x + 1) / 2, matrix


def closer(places: Array) -> Array:
    """Return limits in ]0, 1[ that come ever closer to some places, as far as knots may."""
    steps = 0.5 ** np.arange(3, _CLOSEST + 1)
    limits = (places[:, None] + np.concatenate((-steps, [0.0], steps))).ravel()
    return distinct(limits[(limits > 0) & (limits < 1)])


def _first_pieces(rules: DirectionRules, limits: Array) -> Array:
    """Return the limits of the pieces to begin with, some of them given."""
    pieces = rules.pieces
    start = np.linspace(0, 1, max(2, -(-4 // (len(pieces) - 1))) + 1)[:-1]
    first = np.append((pieces[:-1, None] + np.diff(pieces)[:, None] * start).ravel(), 1.0)
    new = distinct(limits)
    new = new[np.append(True, np.diff(new) > FINEST_INTERVAL)[: len(new)]]
    new = new[np.abs(new[:, None] - first).min(axis=1, initial=np.inf) > FINEST_INTERVAL]
    return np.sort(np.concatenate((first, new)))


def _look(
    sample: Sampler, rules: DirectionRules, target: float, floor: float, limits: Array
) -> _Portrait:
    """Bisect the direction until Chebyshev pieces hold the function."""
    nodes, matrix = _transform()
    small = max(target / 100, floor / 4)
    low = _first_pieces(rules, limits)
    pending = np.stack((low[:-1], low[1:]))
    done: list[tuple[Array, Array]] = []
    total = 0
    while pending.size:
        a, b = pending
        values = sample((a[:, None] + (b - a)[:, None] * nodes).ravel())
        if not np.isfinite(values).all():
            raise ToleranceNotReachedError(
                "the equation has no finite value inside its box: look for a division by zero"
            )
        pieces = values.reshape(len(a), _NODES, -1).transpose(1, 0, 2)
        coefficients = product(matrix, pieces.reshape(_NODES, -1)).reshape(pieces.shape)
        coefficients = coefficients.transpose(1, 0, 2).reshape(-1, _NODES, *values.shape[1:])
        size = _longest(coefficients)
        resolved = size[:, -_TAIL:].max(axis=1) <= small
        # what is no larger than rounding would only be magnified by derivatives
        coefficients[size < small] = 0.0
        done.append((a[resolved], coefficients[resolved]))
        total += int(resolved.sum())
        a, b = a[~resolved], b[~resolved]
        if len(a) and (total + len(a) > MOST_INTERVALS or (b - a).min() < FINEST_INTERVAL):
            raise _not_reached(total + len(a), target, a[0])
        pending = np.stack((np.concatenate((a, (a + b) / 2)), np.concatenate(((a + b) / 2, b))))
    starts = np.concatenate([a for a, _ in done])
    order = np.argsort(starts)
    return _Portrait(np.append(starts[order], 1.0), np.concatenate([c for _, c in done])[order])


def _not_reached(intervals: int, target: float, place: float) -> ToleranceNotReachedError:
    return ToleranceNotReachedError(
        f"{intervals} spline intervals do not reach the deviation of {target:.3g} that is needed, "
        f"least near {place:.4g} of the direction's length; a kink or a jump there, or a larger "
        "--tolerance, would explain or mend it"
    )


# -- spaces, measured ------------------------------------------------------------------------------


def _interval_errors(portrait: _Portrait, space: SplineSpace) -> Array:
    """Return the largest deviation per interval over the checks and all columns."""
    poles = space.fit(portrait(space.sites))
    places, starts = space.checks
    gap = (space.check_basis @ poles - portrait(places)).reshape(len(places), -1, 3)
    size = _longest(gap)
    # a knot belongs to both its intervals
    return np.asarray(np.maximum(np.maximum.reduceat(size[:-1], starts), size[[*starts[1:], -1]]))


def _at_best(errors: Array, degree: int) -> float:
    """Return what one interval less would leave if all carried the same error, by the law h^(p+1).

    That is what corrections lead to at best. Before errors follow the law they grow faster.
    """
    order, count = degree + 1, len(errors)
    if count == 1:
        return np.inf
    return float(((errors ** (1 / order)).sum() / (count - 1)) ** order)


def _settle(
    portrait: _Portrait,
    rules: DirectionRules,
    degree: int,
    distances: _Distances,
    target: float,
    rival: SplineSpace | None = None,
) -> SplineSpace | None:
    """Return the smallest space of a degree that a few corrections of its knots lead to.

    None as soon as it is seen not to become smaller than that of a `rival`.
    """
    best: SplineSpace | None = None
    rounds = 0
    measured, largest = np.zeros(0), np.inf
    raw = errors = np.zeros(0)
    while best is None or rounds < _ROUNDS:
        points = distances.knots(rules)
        nearest = int(np.argmin(np.diff(points)))
        if len(points) > MOST_INTERVALS or points[nearest + 1] - points[nearest] < FINEST_INTERVAL:
            if best is None and rival is None:
                raise _not_reached(len(points) - 1, target, points[nearest])
            break
        space = rules.space(degree, points)
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
        rounds += 1
    return best
