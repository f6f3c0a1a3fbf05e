"""A function of one parameter, looked at once: Chebyshev pieces that hold it.

They are bisected until their last coefficients vanish. What is asked of the function from then on,
values and derivatives, is worked out of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product, squares
from pc2cad.errors import ToleranceNotReachedError

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
PLACES = 16


@dataclass(frozen=True, eq=False)
class Portrait:
    """Chebyshev pieces: limits (n + 1,) and coefficients (n, _NODES, columns, 3)."""

    limits: Array
    coefficients: Array
    #: sizes of derivatives that were asked for, by their order: degrees side by side share some
    _sizes: dict[int, tuple[Array, Array]] = field(default_factory=dict, repr=False)

    def __call__(self, *ascending: Array) -> list[Array]:
        """Return the values at each of several arrays of ascending t, (len(t), 3 columns)."""
        inner, lengths = self.limits[1:-1], self.lengths
        t = np.concatenate(ascending)
        piece = inner.searchsorted(t, side="right")
        x = 2 * (t - self.limits[piece]) / lengths[piece] - 1
        values, start, results = _chebyshev(x, self.coefficients.shape[1]), 0, []
        for places in ascending:
            own = values[start : start + len(places)]
            cuts = [0, *places.searchsorted(inner).tolist(), len(places)]
            result = np.empty((len(places), self._flat[0].shape[1]))
            for first, last, flat in zip(cuts, cuts[1:], self._flat, strict=False):
                if first < last:
                    result[first:last] = product(own[first:last], flat)
            start += len(places)
            results.append(result)
        return results

    @cached_property
    def lengths(self) -> Array:
        """The lengths of the pieces, (n,)."""
        return np.asarray(self.limits[1:] - self.limits[:-1])

    @cached_property
    def edges(self) -> Array:
        """The limits of PLACES equal parts of every piece, (PLACES n + 1,)."""
        parts = self.lengths[:, None] * np.arange(PLACES) / PLACES
        return np.append((self.limits[:-1, None] + parts).ravel(), 1.0)

    @cached_property
    def _flat(self) -> list[Array]:
        """The coefficients of each piece, (_NODES, 3 columns)."""
        return list(self.coefficients.reshape(*self.coefficients.shape[:2], -1))

    def derivative(self, order: int) -> tuple[Array, Array]:
        """Return the sizes of a derivative at the middles of equal parts, and their mean squares.

        Of all columns the largest, (n, PLACES), and one number a piece, (n,).
        """
        if order not in self._sizes:
            sizes = self._derived(order)
            self._sizes[order] = sizes.max(axis=-1), np.sqrt((sizes * sizes).mean(axis=(1, 2)))
        return self._sizes[order]

    def _derived(self, order: int) -> Array:
        n, count, columns, _ = self.coefficients.shape
        if not 0 <= order < count:
            return np.zeros((n, PLACES, columns))
        flat = self.coefficients.transpose(1, 0, 2, 3).reshape(count, -1)
        values = product(_derivatives(order, count), flat).reshape(PLACES, n, columns, 3)
        sizes = np.sqrt(squares(values)).transpose(1, 0, 2)
        return np.asarray(sizes * (2 / self.lengths[:, None, None]) ** order)


def _chebyshev(x: Array, count: int) -> Array:
    """Return so many Chebyshev polynomials at x, (len(x), count), as NumPy's `chebvander` does."""
    values = np.empty((count, len(x)))
    values[0], values[1], twice = 1.0, x, 2 * x
    rows = list(values)
    for before, last, row in zip(rows, rows[1:], rows[2:], strict=False):
        np.multiply(last, twice, out=row)
        row -= before
    return values.T


def longest(vectors: Array) -> Array:
    """Return the length of the longest of vectors (…, columns, 3), (…)."""
    return np.asarray(np.sqrt(np.maximum.reduce(squares(vectors), axis=-1)))


@lru_cache
def _derivatives(order: int, count: int) -> Array:
    """Return the derivatives of Chebyshev polynomials at the middles of PLACES equal parts."""
    x = (2 * np.arange(PLACES) + 1) / PLACES - 1
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


def _first_pieces(pieces: Array, limits: Array) -> Array:
    """Return the limits of the pieces to begin with, some of them given."""
    start = np.linspace(0, 1, max(2, -(-4 // (len(pieces) - 1))) + 1)[:-1]
    first = np.append((pieces[:-1, None] + np.diff(pieces)[:, None] * start).ravel(), 1.0)
    new = distinct(limits)
    new = new[np.append(True, np.diff(new) > FINEST_INTERVAL)[: len(new)]]
    new = new[np.abs(new[:, None] - first).min(axis=1, initial=np.inf) > FINEST_INTERVAL]
    return np.sort(np.concatenate((first, new)))


def look(sample: Sampler, smooth: Array, target: float, floor: float, limits: Array) -> Portrait:
    """Bisect the direction until Chebyshev pieces hold the function.

    `smooth` are the limits of its smooth pieces, `limits` others to begin with. Raises
    ToleranceNotReachedError when `MOST_INTERVALS` are not enough.
    """
    nodes, matrix = _transform()
    small = max(target / 100, floor / 4)
    low = _first_pieces(smooth, limits)
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
        size = longest(coefficients)
        resolved = size[:, -_TAIL:].max(axis=1) <= small
        # what is no larger than rounding would only be magnified by derivatives
        coefficients[size < small] = 0.0
        done.append((a[resolved], coefficients[resolved]))
        total += int(resolved.sum())
        a, b = a[~resolved], b[~resolved]
        if len(a) and (total + len(a) > MOST_INTERVALS or (b - a).min() < FINEST_INTERVAL):
            raise not_reached(total + len(a), target, a[0])
        pending = np.stack((np.concatenate((a, (a + b) / 2)), np.concatenate(((a + b) / 2, b))))
    starts = np.concatenate([a for a, _ in done])
    order = np.argsort(starts)
    return Portrait(np.append(starts[order], 1.0), np.concatenate([c for _, c in done])[order])


def not_reached(intervals: int, target: float, place: float) -> ToleranceNotReachedError:
    """Return the error that says how many intervals do not reach a target, and where least."""
    return ToleranceNotReachedError(
        f"{intervals} spline intervals do not reach the deviation of {target:.3g} that is needed, "
        f"least near {place:.4g} of the direction's length; a kink or a jump there, or a larger "
        "--tolerance, would explain or mend it"
    )
