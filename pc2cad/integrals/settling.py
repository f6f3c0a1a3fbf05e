"""Integrals that settle: where two rules differ, what they missed is looked for, and taken in.

Input: a density, and the limits of its smooth pieces. Output: its integral, an estimate of the
error, and the rules. A needle on a face that bends far more than the needle does stands out of
nothing in the whole box, and does in the panels on which two rules differ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.domain.map import open_grid
from pc2cad.integrals.quadrature import Panels, single
from pc2cad.integrals.rules import (
    SLAB_POINTS,
    Density,
    features_in,
    features_of,
    in_one,
    integral,
    panels_for,
    total,
)

#: relative difference of two rules at which nothing more is looked for
SETTLED = 1e-10
#: how often features are looked for, in how many boxes of panels, how many in each, and the
#: share of the error that a round may leave for another one to be worth it
MOST_ROUNDS, MOST_BOXES, MOST_IN_A_BOX, GAIN = 5, 6, 2, 0.25


@dataclass(frozen=True, eq=False)
class Settled:
    """Integrals (k,) over each part, the relative error of the worst, and the rules."""

    values: list[Array]
    error: float
    rules: list[Panels]


def whole(rules: list[Panels]) -> list[list[Panels]]:
    """Return the rules as those of one part."""
    return [rules]


def settle(
    density: Density,
    limits: list[list[float]],
    parts: Callable[[list[Panels]], list[list[Panels]]] = whole,
    measure: Density | None = None,
) -> Settled:
    """Return the integrals of a density over a box, or over each of its `parts`.

    `limits` are those of the smooth pieces of each direction, two equal ones where it is fixed.
    Features are looked for in `measure`, if that is another function.
    """
    measure = density if measure is None else measure
    features = features_of(measure, limits)
    found = _settled_on(density, limits, parts, features)
    for _ in range(MOST_ROUNDS):
        if not SETTLED < found.error < np.inf:
            break
        # two rules that differ are reason enough to look: what is left need not be peaked
        boxes = _boxes_that_differ(measure, found.rules)
        more = [features_in(measure, box, 1.0, MOST_IN_A_BOX) for box in boxes]
        if sum(map(len, more)) == 0:
            break
        features = np.concatenate((features, *more))
        before, found = found, _settled_on(density, limits, parts, features)
        if found.error > GAIN * before.error:
            break
    return found


def _settled_on(
    density: Density,
    limits: list[list[float]],
    parts: Callable[[list[Panels]], list[list[Panels]]],
    features: Array,
) -> Settled:
    """Return the integrals by rules along lines through the features, and common ones."""
    rules = [
        single(row[0]) if row[0] == row[-1] else panels_for(density, limits, d, features)
        for d, row in enumerate(limits)
    ]
    pieces = parts(rules)
    if not all(np.isfinite(panels.unresolved) for panels in rules):
        # there is no value in a whole panel, and so no integral
        one = total(density, [(panels.limits[:1], np.ones(1)) for panels in rules])
        return Settled([np.full_like(one, np.nan)] * len(pieces), np.inf, rules)
    found = [integral(density, part) for part in pieces]
    return Settled([value for value, _ in found], max(error for _, error in found), rules)


def _boxes_that_differ(density: Density, rules: list[Panels]) -> list[Array]:
    """Return the limits (3, 2) of the boxes of panels in which two rules differ most."""
    one = in_one(density, np.array([p.limits[[0, -1]] for p in rules]))
    coarse, fine = (_sums(one, rules, grow) for grow in (1.0, 1.5))
    gaps = np.abs(fine - coarse)
    least = SETTLED * float(np.abs(fine).mean())
    boxes = []
    for index in np.argsort(-gaps, axis=None)[:MOST_BOXES]:
        place = np.unravel_index(index, gaps.shape)
        if gaps[place] > least:
            boxes.append(np.array([
                (p.limits[k], p.limits[k + 1]) for p, k in zip(rules, place, strict=True)
            ]))  # fmt: skip
    return boxes


def _sums(one: Callable[[Array, Array, Array], Array], rules: list[Panels], grow: float) -> Array:
    """Return the integral of a function over each box of panels, (n, m, l)."""
    (u, wu), (v, wv), (w, ww) = (p.rule(grow) for p in rules)
    first = [_first_nodes(p, grow) for p in rules]
    step = max(1, SLAB_POINTS // (len(v) * len(w)))
    rows = []
    for i in range(0, len(u), step):
        part = slice(i, i + step)
        values = one(*open_grid(u[part], v, w)) * wv[:, None] * ww
        rows.append(np.add.reduceat(np.add.reduceat(values, first[2], axis=2), first[1], axis=1))
    found = np.concatenate(rows) * wu[:, None, None]
    return np.asarray(np.add.reduceat(found, first[0], axis=0))


def _first_nodes(panels: Panels, grow: float) -> Integers:
    """Return the number of the first node of each panel."""
    return np.asarray(np.searchsorted(panels.rule(grow)[0], panels.limits[:-1]))
