"""Where an integrand over a box stands out of its surroundings: peaks, also in corners.

Input: an integrand and its box. Output: places on top of what a cubic polynomial does not explain.
They are *sampled*: a feature much narrower than the scatter, and without slopes, is not found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import product as pairs
from typing import Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import ranked
from pc2cad.arrays.linear import product, solve, vectors
from pc2cad.arrays.scatter import scattered

#: places that are looked at, how many features are followed, how far apart (shares of the box)
SCATTER: Final = 2048
MOST_FEATURES: Final = 8
APART: Final = 0.1
#: boxes that are looked at together
TOGETHER: Final = 4
#: reach of the steps with which a feature's top is climbed
CLIMB: Final = (0.05, 0.01, 0.002, 0.0004)
#: what is left of the integrand, against its largest value, that rounding may explain
ROUNDING: Final = 1e-12
#: how much more is left on a feature than in half of all places: waves are seen from every line
PEAKED: Final = 8.0


def find_features(
    values: Callable[[Array], Array],
    spans: Array,
    peaked: float = PEAKED,
    most: int = MOST_FEATURES,
) -> Array:
    """Return places (m, 3) on top of what stands out of an integrand.

    `values` takes places (n, 3) to the integrand (n,); `spans` (3, 2) are the limits of the box,
    equal ones for a direction that is fixed. Half of the scattered places crowd towards the sides.
    What is left on a feature is more than so many times that in half of all places.
    """
    none = np.empty((0, 3))
    moving = _moving(spans)
    share = scatter()
    with np.errstate(all="ignore"):
        fitted, (rest,) = explained(values(_places(spans, share))[None], moving, peaked)
        if rest is None:
            return none
        surface = _Surface(values, spans, moving, fitted[:, 0])
        found = tops(rest, moving, most)
        return surface.climb(share[found]) if found else none


def tops(rest: Array, moving: tuple[int, ...], most: int = MOST_FEATURES) -> list[int]:
    """Return which scattered places stand out most, apart from one another, the highest first."""
    share, left, found = scatter(), rest.copy(), list[int]()
    while left.any() and len(found) < most:
        found.append(int(left.argmax()))
        left[(np.abs(share - share[found[-1]])[:, moving] <= APART).all(axis=1)] = 0.0
    return found


def stand_out(values: Callable[[Array], Array], boxes: Array) -> list[bool]:
    """Say of boxes (n, 3, 2) that extend along the same directions what has features.

    `values` takes places (n, k, 3) to the integrand (n, k); see `find_features`.
    """
    moving, share = _moving(boxes[0]), scatter()
    out: list[bool] = []
    with np.errstate(all="ignore"):
        for start in range(0, len(boxes), TOGETHER):
            several = boxes[start : start + TOGETHER]
            low, high = several[:, None, :, 0], several[:, None, :, 1]
            rests = explained(values(low + (high - low) * share), moving, PEAKED)[1]
            out += [rest is not None and bool(rest.any()) for rest in rests]
    return out


def _moving(spans: Array) -> tuple[int, ...]:
    return tuple(int(d) for d in np.flatnonzero(spans[:, 1] > spans[:, 0]))


@dataclass(frozen=True, eq=False)
class _Surface:
    """A cubic polynomial through an integrand over a box, in shares of its sides."""

    values: Callable[[Array], Array]
    spans: Array
    moving: tuple[int, ...]
    coefficients: Array

    def rest(self, share: Array) -> Array:
        """Return what the polynomial leaves of the integrand, 0 where that is not finite."""
        found = self.values(_places(self.spans, share))
        rest = np.abs(found - vectors(_columns(share[:, self.moving]), self.coefficients))
        return np.where(np.isfinite(rest), rest, 0.0)

    def climb(self, share: Array) -> Array:
        """Return the places near some in which most is left, inside the box."""
        steps = np.linspace(-1.0, 1.0, 17)
        every = np.arange(len(share))
        for reach in CLIMB:
            for d in self.moving:
                near = np.repeat(share[:, None], len(steps), axis=1)
                near[..., d] = np.clip(near[..., d] + reach * steps, 1e-6, 1 - 1e-6)
                rest = self.rest(near.reshape(-1, 3)).reshape(near.shape[:2])
                share = near[every, rest.argmax(axis=1)]
        return _places(self.spans, share)


def explained(
    several: Array, moving: tuple[int, ...], peaked: float = PEAKED
) -> tuple[Array, list[Array | None]]:
    """Return the polynomials through rows of values at the scattered places, and their rests.

    Coefficients are (m, n) for n rows. What a polynomial leaves is 0 where that may be rounding;
    None where hardly any value is finite.
    """
    columns, inverse = _fitting(moving)
    coefficients = product(inverse, several.T)
    finite = np.isfinite(several)
    for k in np.flatnonzero(~finite.all(axis=1)):
        good = finite[k]
        if 2 * good.sum() >= len(good):
            coefficients[:, k] = np.linalg.lstsq(columns[good], several[k][good], rcond=None)[0]
    left = np.abs(several - product(columns, coefficients).T)
    sizes = np.abs(several)
    if not finite.all():
        left, sizes = np.where(finite, left, 0.0), np.where(finite, sizes, 0.0)
    rests: list[Array | None] = []
    counts = np.count_nonzero(finite, axis=1).tolist()
    largest = zip(sizes.max(axis=1).tolist(), left.max(axis=1).tolist(), strict=True)
    for rest, count, (size, most) in zip(left, counts, largest, strict=True):
        if 2 * count < len(rest):
            rests.append(None)
            continue
        least = ROUNDING * size
        if most > least:
            least = max(least, peaked * ranked(rest, 0.5))
        rests.append(np.where(rest > least, rest, 0.0))
    return coefficients, rests


@lru_cache(maxsize=1)
def scatter() -> Array:
    """Return the places that are looked at, (SCATTER, 3), as shares of the box's sides."""
    share = scattered(SCATTER, 3)
    share[::2] = (1 - np.cos(np.pi * share[::2])) / 2
    share.flags.writeable = False
    return share


@lru_cache(maxsize=8)
def _fitting(moving: tuple[int, ...]) -> tuple[Array, Array]:
    """Return the polynomials in the scattered places, and what makes coefficients of values."""
    columns = _columns(scatter()[:, moving])
    return columns, solve(product(columns.T, columns), columns.T)


def _places(spans: Array, share: Array) -> Array:
    return np.asarray(spans[:, 0] + (spans[:, 1] - spans[:, 0]) * share)


def _columns(share: Array) -> Array:
    """Return the products of Legendre's polynomials up to degree 3: they are nearly orthogonal."""
    x = 2 * share.T - 1
    alone = np.stack((np.ones_like(x), x, (3 * x**2 - 1) / 2, (5 * x**3 - 3 * x) / 2))
    degrees = [row for row in pairs(range(len(alone)), repeat=len(x)) if sum(row) < len(alone)]
    first, *others = (alone[list(row), k] for k, row in enumerate(zip(*degrees, strict=True)))
    for other in others:
        first *= other
    return np.ascontiguousarray(first.T)
