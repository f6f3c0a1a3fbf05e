"""Curves in the parameter plane of a surface, as straight pieces or splines to rounding."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pc2cad.arrays import Array
from pc2cad.errors import ToleranceNotReachedError
from pc2cad.geometry.carriers import PCurve, Segment, SplinePath
from pc2cad.geometry.splines.rational import PiecewiseSpace

#: what a path may be off, relative to its own size: a few roundings
ROUNDING = 1e-13
DEGREE = 15
MOST_PIECES = 512
#: the kernel takes no knots that are nearer than a tenth of this
NARROWEST = 1e-9


def path(
    values: Callable[[Array], Array],
    breaks: Array,
    scale: Array,
    weights: Callable[[Array], Array] | None = None,
) -> PCurve:
    """Return the curve with these values (n,) -> (n, 2) over [0, 1].

    `breaks` are ascending places with both ends where the function may have a kink; `scale` (2,)
    is the size of the values, `weights` (n,) -> (n, 2) what their differences count. Raises
    ToleranceNotReachedError where splines do not converge.
    """

    def worth(at: Array) -> Array:
        return (1.0 if weights is None else weights(at)) / scale

    probe = np.linspace(0.0, 1.0, 33)
    ends = values(np.array([0.0, 1.0]))
    straight = ends[0] + probe[:, None] * (ends[1] - ends[0])
    if (np.abs(values(probe) - straight) * worth(probe)).max() <= ROUNDING:
        (a, b), (c, d) = ends.tolist()
        return Segment((a, b), (c, d))
    points = np.asarray(breaks, dtype=float)
    shares = np.linspace(0.03, 0.97, 13)
    before = np.inf
    while len(points) <= MOST_PIECES and np.diff(points).min() >= NARROWEST:
        space = PiecewiseSpace(DEGREE, points)
        poles = space.fit(values(space.sites))
        places = (points[:-1, None] + np.diff(points)[:, None] * shares).ravel()
        gap = (np.abs(space.basis(places) @ poles - values(places)) * worth(places)).max(axis=1)
        worst = gap.reshape(len(points) - 1, -1).max(axis=1)
        # one more halving, where that still helps
        enough = 2 * ROUNDING if worst.max() < before / 4 else 20 * ROUNDING
        before = worst.max()
        if before <= enough:
            poles[[0, -1]] = ends
            return SplinePath(DEGREE, space.knots, poles)
        middles = ((points[:-1] + points[1:]) / 2)[worst > enough]
        points = np.sort(np.concatenate((points, middles)))
    raise ToleranceNotReachedError(
        "an edge has no smooth curve in the parameters of a face that it bounds"
    )
