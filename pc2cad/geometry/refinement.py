"""Adaptive choice of a spline space for one direction.

Two steps: bisect until every interval meets the target, which finds out where the function is
hard; then spread the knots so that every interval carries the same error, which needs far fewer
of them (de Boor's equidistribution of the density |f^(p+1)|^(1/(p+1))).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pc2cad.equation.breaks import Break
from pc2cad.errors import ToleranceNotReachedError
from pc2cad.geometry.spline_space import SplineSpace

Array = NDArray[np.float64]
#: values at parameters t of shape (m,): shape (m, columns, 3)
Sampler = Callable[[Array], Array]

#: more intervals than this in one direction are refused
MOST_INTERVALS = 6000
#: and so are intervals shorter than this: the kernel wants knots further apart than 1e-10
FINEST_INTERVAL = 1e-9
#: where an interval is checked, as fractions of its length: off the sites of every degree
_CHECKS = np.array([0.113, 0.29, 0.5, 0.71, 0.887])


@dataclass(frozen=True)
class DirectionRules:
    """What a direction's space has to respect."""

    degree: int
    #: places of reduced smoothness, ends included where they are such places
    breaks: Sequence[Break] = ()
    periodic: bool = False
    #: knots must be symmetric about 1/2 (a gluing reverses the direction)
    symmetric: bool = False

    def space(self, points: Array) -> SplineSpace:
        """Return the space with these points; breaks get the multiplicity that they need."""
        p = self.degree
        multiplicity = {b.position: max(1, p - b.smoothness) for b in self.breaks}
        inner = [multiplicity.get(float(x), 1) for x in points[1:-1]]
        seam = multiplicity.get(0.0, 1) if self.periodic else None
        return SplineSpace(p, points, inner, seam)

    @property
    def pieces(self) -> Array:
        """Ascending limits of the smooth pieces: 0, inner breaks, 1."""
        inner = {b.position for b in self.breaks if 0 < b.position < 1}
        return np.array([0.0, *sorted(inner), 1.0])


def adapt(sample: Sampler, rules: DirectionRules, target: float, floor: float) -> SplineSpace:
    """Return a space whose interpolant of all columns stays within `target` at the checks.

    `target` and `floor` are lengths; errors below `floor` are rounding. Raises
    ToleranceNotReachedError when `MOST_INTERVALS` are not enough.
    """
    points, errors = _bisect(sample, rules, target)
    for ease in (1.0, 0.8, 0.6, 0.45):
        spread = _equidistribute(points, errors, rules, target * ease, floor)
        if len(spread) >= len(points):
            break
        space = rules.space(spread)
        if _interval_errors(sample, space).max() <= target:
            return space
    return rules.space(points)


def _bisect(sample: Sampler, rules: DirectionRules, target: float) -> tuple[Array, Array]:
    pieces = rules.pieces
    each = max(3, -(-(rules.degree + 3) // (len(pieces) - 1)))
    points = _subdivide(pieces, np.full(len(pieces) - 1, each))
    while True:
        errors = _interval_errors(sample, rules.space(points))
        worst = errors.max()
        if not np.isfinite(worst):
            raise ToleranceNotReachedError(
                "the equation has no finite value inside its box: look for a division by zero"
            )
        if worst <= target:
            return points, errors
        if len(points) > MOST_INTERVALS or np.diff(points).min() < FINEST_INTERVAL:
            place = int(np.argmax(errors))
            raise ToleranceNotReachedError(
                f"{len(points) - 1} spline intervals leave a deviation of {worst:.3g} where "
                f"{target:.3g} is needed, worst near {points[place]:.4g} of the direction's "
                "length; a kink or a jump there, or a larger --tolerance, would explain or mend it"
            )
        wanted = np.ceil((errors / target) ** (1 / (rules.degree + 1))).astype(int)
        points = _subdivide(points, np.where(errors > target, np.clip(wanted, 2, 4), 1),
                            rules.symmetric)  # fmt: skip


def _subdivide(points: Array, counts: NDArray[np.int_], symmetric: bool = False) -> Array:
    if symmetric:
        counts = np.maximum(counts, counts[::-1])
    lists = [
        np.linspace(a, b, n + 1)[:-1]
        for a, b, n in zip(points[:-1], points[1:], counts, strict=True)
    ]
    result = np.concatenate([*lists, points[-1:]])
    return (result + 1 - result[::-1]) / 2 if symmetric else result


def _interval_errors(sample: Sampler, space: SplineSpace) -> Array:
    """Return the largest deviation per interval over the checks and all columns."""
    poles = space.fit(sample(space.sites))
    a, b = space.points[:-1, None], space.points[1:, None]
    t = (a + (b - a) * _CHECKS).ravel()
    truth = sample(t)
    values = (space.basis(t) @ poles.reshape(len(poles), -1)).reshape(truth.shape)
    gap = np.sqrt(((values - truth) ** 2).sum(axis=-1)).max(axis=-1)
    return np.asarray(gap.reshape(-1, len(_CHECKS)).max(axis=1))


def _equidistribute(
    points: Array, errors: Array, rules: DirectionRules, target: float, floor: float
) -> Array:
    """Return points at equal shares of the error density, breaks kept."""
    order = rules.degree + 1
    lengths = np.diff(points)
    density = np.maximum(errors, floor) ** (1 / order) / lengths
    # an interval's error has contributions of its neighbours: take the larger of both sides
    padded = np.concatenate((density[:1], density, density[-1:]))
    density = np.maximum(density, (padded[:-2] + padded[2:]) / 2)
    if rules.symmetric:
        density = np.maximum(density, density[::-1])
    result = [np.zeros(1)]
    pieces = rules.pieces
    for low, high in pairwise(pieces):
        inside = (points[:-1] >= low - 1e-15) & (points[1:] <= high + 1e-15)
        share = np.concatenate(([0.0], np.cumsum(density[inside] * lengths[inside])))
        count = max(1, int(np.ceil(share[-1] / target ** (1 / order))))
        if len(pieces) == 2:
            count = max(count, rules.degree + 2)
        edges = np.concatenate(([low], points[1:][inside]))
        edges[-1] = high
        new = np.interp(np.linspace(0, share[-1], count + 1), share, edges)
        new[-1] = high
        result.append(new[1:])
    spread = np.concatenate(result)
    return (spread + 1 - spread[::-1]) / 2 if rules.symmetric else spread
