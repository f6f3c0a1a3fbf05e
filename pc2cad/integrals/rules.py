"""Product rules over the box, or a patch of it, that resolve a given integrand.

Panels and orders come from lines along each direction (see `quadrature`); an integral is taken with
such rules and with finer ones, and the difference is the error estimate.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from operator import attrgetter

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import product
from pc2cad.arrays.scatter import scattered
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.expression.narrow import narrow_limits
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.integrals.features import MOST_FEATURES, PEAKED, find_features, stand_out
from pc2cad.integrals.quadrature import Panels, Samples, resolve
from pc2cad.topology.cells import Cell

#: points of one integral
MOST_POINTS = 3e6
#: relative error of a rule that is exact
EXACT = 1e-15
#: points evaluated at once
SLAB_POINTS = 300_000
#: relative difference of two rules at which a third is tried
DOUBTFUL = 1e-12
#: places of the lines in the other two directions
LINES = scattered(8, 2)
#: places at which the sizes of integrands are looked at
_SIZED = 32
#: where a break lies
_POSITION = attrgetter("position")
#: nodes and weights per direction
_Rules = list[tuple[Array, Array]]
#: u, v and w (broadcastable) to integrands (…, k) and the size of the first one's terms (…)
Density = Callable[[Array, Array, Array], Samples]


def by_layer(analysis: Analysis, whole: list[Panels]) -> list[list[Panels]]:
    """Return the rules of the whole box, layer by layer."""
    if not analysis.equation.layers:
        return [whole]
    u, v, w = whole
    limits = analysis.bounds[2]
    cuts = np.searchsorted(w.limits, np.array(limits) - 1e-12).tolist()
    return [
        [u, v, Panels(w.limits[a : b + 1], w.orders[a:b], w.unresolved)] for a, b in pairwise(cuts)
    ]


def features_of(density: Density, limits: list[list[float]]) -> Array:
    """Return places (m, 3) where a density stands out of its surroundings."""
    return features_in(density, np.array([(row[0], row[-1]) for row in limits]))


def features_in(
    density: Density, spans: Array, peaked: float = PEAKED, most: int = MOST_FEATURES
) -> Array:
    """Return places (m, 3) where a density stands out of its surroundings in a box (3, 2)."""
    all_in_one = in_one(density, spans)
    return find_features(lambda x: all_in_one(*_columns(x, spans)), spans, peaked, most)


def any_features(density: Density, boxes: Array) -> list[bool]:
    """Say of boxes (n, 3, 2) whether a density of one integrand stands out of its surroundings.

    The boxes extend along the same directions.
    """
    return stand_out(lambda x: density(*_columns(x, boxes[0])).values[..., 0], boxes)


def _columns(places: Array, spans: Array) -> list[Array]:
    """Return u, v and w of places (..., n, 3): a parameter that is fixed is looked at once."""
    still = spans[:, 0] == spans[:, 1]
    return [places[..., : 1 if still[d] else None, d] for d in range(3)]


def in_one(density: Density, spans: Array) -> Callable[[Array, Array, Array], Array]:
    """Return a sum of all integrands of a density, each by its size in a box (3, 2).

    What stands out of one of them, and be it a moment of a solid without a feature of det J, stands
    out of the sum: its factors are irrational to one another. One alone is taken as it is.
    """

    @cache
    def factors() -> Array:
        places = spans[:, :1] + (spans[:, 1:] - spans[:, :1]) * scattered(_SIZED, 3).T
        with np.errstate(all="ignore"):
            seen = np.abs(density(*places).values)
            sizes = np.where(np.isfinite(seen), seen, 0.0).max(axis=0)
        known = sizes > 0
        by_size = (0.5 + scattered(len(sizes), 1)[:, 0]) / np.where(known, sizes, 1)
        return np.where(known, by_size, 0)

    def one(u: Array, v: Array, w: Array) -> Array:
        values = density(u, v, w).values
        return np.asarray(
            values[..., 0] if values.shape[-1] == 1 else np.einsum("...k,k->...", values, factors())
        )

    return one


def panels_for(
    density: Density, limits: list[list[float]], direction: int, features: Array
) -> Panels:
    """Return panels that resolve a density along one direction of a cell with such limits."""
    others = [d for d in range(3) if d != direction]
    spans = [(limits[d][0], limits[d][-1]) for d in others]
    across = [
        np.append(low + (high - low) * LINES[:, k], features[:, others[k]])
        for k, (low, high) in enumerate(spans)
    ]

    def sample(t: Array) -> Samples:
        places: list[Array] = [t[:, None]] * 3
        for d, x in zip(others, across, strict=True):
            places[d] = x[None, :]
        seen = density(*places)
        tangents = None if seen.tangents is None else [seen.tangents[direction]]
        return Samples(seen.values, seen.terms, seen.points, tangents)

    look = all(len(set(row)) > 1 for row in limits)
    return resolve(sample, limits[direction], look, len(features))


def limits_of(analysis: Analysis, patch: Cell | None = None) -> list[list[float]]:
    """Return per direction the limits of the smooth pieces of a patch, or of the whole box."""
    found = []
    for d in range(3):
        low, high = (0.0, 1.0) if patch is None else analysis.span(d, patch[d])
        breaks = analysis.breaks[d]
        first = bisect_right(breaks, low, key=_POSITION)
        last = bisect_left(breaks, high, first, key=_POSITION)
        found.append([low, *map(_POSITION, breaks[first:last]), high])
    return found


def narrowed(analysis: Analysis, limits: list[list[float]]) -> list[list[float]]:
    """Return limits with those between which functions change at short length."""
    trees = analysis.map.coordinates
    return [
        sorted({*row, *narrow_limits(trees, name).tolist()})
        for name, row in zip(PARAMETERS, limits, strict=True)
    ]


def integral(density: Density, panels: list[Panels]) -> tuple[Array, float]:
    """Return an integral over the product of three rules, and its relative error.

    It is taken with the rules and with half as many nodes again; their difference is the error.
    """
    grow = 1.0
    while grow > 0.05 and _points(panels, 1.5 * grow) > MOST_POINTS:
        # what this costs in accuracy shows in the error estimate
        grow *= 0.8
    value = _total(density, panels, grow)
    error = np.inf
    for _ in range(2):
        grow *= 1.5
        coarse, value = value, _total(density, panels, grow)
        error = float(np.abs(value - coarse).max() / max(np.abs(value).max(), 1e-300))
        if error < DOUBTFUL or _points(panels, 1.5 * grow) > MOST_POINTS:
            break
    # two rules may agree to the last bit by chance
    return value, max(error, EXACT, *(p.unresolved for p in panels))


def _total(density: Density, panels: list[Panels], grow: float) -> Array:
    """Return an integral by rules with so many times the nodes, single places without a value out.

    Those that anybody writes, as 1/2, are in the middle of a panel.
    """
    value = total(density, [p.rule(grow) for p in panels])
    if np.isfinite(value).all():
        return value
    return total(density, [p.rule(grow, even=True) for p in panels])


def _points(panels: list[Panels], grow: float) -> float:
    return float(np.prod([len(p.rule(grow)[0]) for p in panels], dtype=float))


def total(density: Density, rules: _Rules) -> Array:
    """Return the integral over the product of three rules, in slabs of bounded memory."""
    (u, wu), (v, wv), (w, ww) = rules
    step = max(1, SLAB_POINTS // (len(v) * len(w)))
    total: Array | float = 0.0
    for i in range(0, len(u), step):
        part = slice(i, i + step)
        values = np.moveaxis(density(*open_grid(u[part], v, w)).values, -1, 0)
        total = total + product(product(product(values, ww), wv), wu[part])
    return np.asarray(total)
