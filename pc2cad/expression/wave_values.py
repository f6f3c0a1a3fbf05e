"""Values of Fourier series on arrays, as products of matrices, and enclosures from their slopes.

With cos(mθ - kφ) = cos mθ cos kφ + sin mθ sin kφ a series is Bθ G Bφᵀ: rows of Bθ are the waves of
one θ, rows of Bφ those of one φ, and G holds the coefficients. On an open grid that is two products
of matrices, at single places a product and a sum; derivatives have the same Bθ and Bφ. Sums of
|coefficient| m^i k^j bound what is left of Taylor's series, and all roundings.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import comb, factorial
from typing import Any, Final

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.linear import product
from pc2cad.expression.intervals import ULP, Interval
from pc2cad.expression.waves import Waves

#: single places whose waves are held at once
SLAB: Final = 20_000
#: roundings that a value may have lost, relative to the sum of all amplitudes: a wave is a product
#: of two, each taken from a library function and multiplied up, and sums are short
ROUNDINGS: Final = 24
#: angles whose waves are remembered for the next series
MOST_KEPT: Final = 2048
#: how often a series is differentiated in each angle
Order = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Table:
    """The waves of a series as arrays."""

    #: of which all k are multiples
    unit: int
    #: m, k, and the coefficients of cosine and sine, (waves,) each
    m: Array
    k: Array
    cos: Array
    sin: Array
    #: the m, and |k| over the unit, that occur, and where each wave's is among them
    powers: tuple[Integers, Integers]
    places: tuple[Integers, Integers]

    @property
    def amplitude(self) -> Array:
        """Amplitudes of the waves, rounded up."""
        return np.asarray(np.hypot(self.cos, self.sin) * (1 + 4 * ULP))

    @property
    def terms(self) -> int:
        """Entries of a row of both bases."""
        return 2 * sum(len(powers) for powers in self.powers)

    def basis(self, axis: int, angle: Array) -> Array:
        """Return cosines and sines (places, 2 · powers) of the multiples of angles (places,)."""
        angle = angle * self.unit if axis else angle
        if angle.size > MOST_KEPT:
            return _basis(self.powers[axis], angle)
        return _known_basis(self.powers[axis].tobytes(), angle.tobytes())


def _basis(powers: Integers, angle: Array) -> Array:
    highest = int(powers.max(initial=0))
    rows = np.empty((max(highest, 1) + 1, len(angle)), dtype=complex)
    rows[0] = 1
    rows[1] = np.exp(1j * angle)
    for power in range(2, highest + 1):
        # halves keep the products in a row few: the logarithm of the power, not the power
        np.multiply(rows[power // 2], rows[power - power // 2], out=rows[power])
    rows = rows[powers].T
    return np.concatenate((rows.real, rows.imag), axis=1)


@lru_cache(maxsize=64)
def _known_basis(powers: bytes, angle: bytes) -> Array:
    """Return the same from bytes: several series, and their derivatives, are asked at one angle."""
    result = _basis(np.frombuffer(powers, dtype=np.int64), np.frombuffer(angle))
    result.flags.writeable = False
    return result


@lru_cache(maxsize=256)
def table_of(waves: Waves) -> Table:
    """Return the waves as arrays."""
    m, k = (np.array([row[i] for row in waves.rows], dtype=float) for i in range(2))
    cos, sin = (np.array([float(row[i]) for row in waves.rows]) for i in (2, 3))
    unit = int(np.gcd.reduce(np.abs(k).astype(int), initial=0)) or 1
    along, place_m = np.unique(m.astype(int), return_inverse=True)
    across, place_k = np.unique(np.abs(k).astype(int) // unit, return_inverse=True)
    return Table(unit, m, k, cos, sin, (along, across), (place_m, place_k))


@lru_cache(maxsize=1024)
def moment(waves: Waves, i: int, j: int) -> float:
    """Return Σ |amplitude| m^i |k|^j, rounded up."""
    table = table_of(waves)
    return float((table.amplitude * table.m**i * np.abs(table.k) ** j).sum() * (1 + 1e-12))


@lru_cache(maxsize=1024)
def _matrix(waves: Waves, i: int, j: int) -> Array:
    """Return the coefficients of a derivative (2 · powers of θ, 2 · powers of φ), cosines first."""
    table = table_of(waves)
    cos, sin = table.cos, table.sin
    for factor in [table.m] * i + [-table.k] * j:
        cos, sin = factor * sin, -factor * cos
    along, across = table.powers
    matrix = np.zeros((2, len(along), 2, len(across)))
    sign = np.where(table.k < 0, -1.0, 1.0)
    # cos(mθ - kφ) = cos cos + sin sin, sin(mθ - kφ) = sin cos - cos sin
    parts = (0, 0, cos), (1, 1, sign * cos), (1, 0, sin), (0, 1, -sign * sin)
    for first, second, part in parts:
        np.add.at(matrix[first, :, second], table.places, part)
    # a sine of the angle 0 is none
    matrix[1, along == 0] = 0.0
    matrix[:, :, 1, across == 0] = 0.0
    return matrix.reshape(2 * len(along), 2 * len(across))


def values(waves: Waves, theta: Any, phi: Any) -> Array:
    """Return the series at angles of any shapes that broadcast."""
    ((_, result),) = jet(waves, theta, phi, [(0, 0)])
    return np.asarray(result)


def jet(waves: Waves, theta: Any, phi: Any, orders: Iterable[Order]) -> Iterator[tuple[Order, Any]]:
    """Yield derivatives of the series at angles of any shapes that broadcast, with their orders."""
    theta, phi = np.asarray(theta, float), np.asarray(phi, float)
    shape = np.broadcast_shapes(theta.shape, phi.shape)
    rank = len(shape)
    a, b = ((1,) * (rank - x.ndim) + x.shape for x in (theta, phi))
    table = table_of(waves)
    if all(p == 1 or q == 1 for p, q in zip(a, b, strict=True)):
        rows, columns = table.basis(0, theta.ravel()), table.basis(1, phi.ravel())
        for order in orders:
            yield order, _interleaved(_on_grid(_matrix(waves, *order), rows, columns), a, b)
        return
    angles = tuple(np.broadcast_to(x, shape).ravel() for x in (theta, phi))
    places = [np.unique(x, return_inverse=True) for x in angles]
    rows, columns = (table.basis(axis, places[axis][0]) for axis in (0, 1))
    where = places[0][1], places[1][1]
    for order in orders:
        matrix = _matrix(waves, *order)
        if len(rows) * len(columns) <= 4 * len(angles[0]):
            found = _on_grid(matrix, rows, columns)[where]
        else:
            found = _at_places(matrix, rows, columns, where)
        yield order, found.reshape(shape)


def _interleaved(grid: Array, a: tuple[int, ...], b: tuple[int, ...]) -> Array:
    """Return values on a grid (places of θ, places of φ) in the shape that both broadcast to."""
    rank = len(a)
    order = [axis for pair in zip(range(rank), range(rank, 2 * rank), strict=True) for axis in pair]
    shape = [p * q for p, q in zip(a, b, strict=True)]
    return grid.reshape(a + b).transpose(order).reshape(shape)


def _on_grid(matrix: Array, rows: Array, columns: Array) -> Array:
    if len(rows) < len(columns):
        return product(product(rows, matrix), columns.T)
    return product(rows, product(matrix, columns.T))


def _at_places(matrix: Array, rows: Array, columns: Array, where: tuple[Any, Any]) -> Array:
    """Return the values at places (row, column) of the bases; each column is multiplied once."""
    across = product(columns, matrix.T)
    result = np.empty(len(where[0]))
    for start in range(0, len(result), SLAB):
        part = slice(start, start + SLAB)
        row, column = (index[part] for index in where)
        np.einsum("ij,ij->i", rows[row], across[column], out=result[part])
    return result


def rounding(waves: Waves, theta: Any, phi: Any, i: int = 0, j: int = 0) -> Array:
    """Return a bound of the rounding of derivatives at angles of no more than these sizes."""
    table = table_of(waves)
    fixed = (ROUNDINGS + 2 * (i + j) + table.terms) * moment(waves, i, j)
    # the first power is off by its rounding and its angle's, the others by so many times that
    moving = 2 * moment(waves, i + 1, j) * (np.abs(theta) + 4)
    moving = moving + 2 * moment(waves, i, j + 1) * (np.abs(phi) + 4 / table.unit)
    return np.asarray((fixed + moving) * ULP)


# -- enclosures ------------------------------------------------------------------------------------

_SLOPES: Final = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


def enclose(waves: Waves, theta: Interval, phi: Interval) -> Interval:
    """Return an enclosure of the series over boxes of angles.

    Taylor's series at their middles to the second order; what is left is at most
    Σ |amplitude| (m h + |k| h')³/6, and no value is further from the constant than all amplitudes.
    """
    (a, first), (b, second) = _middle(theta), _middle(phi)
    slack = 2 * rounding(waves, np.abs(a) + first, np.abs(b) + second)
    still = not (first.any() or second.any())
    parts = jet(waves, a, b, ((0, 0), *(() if still else _SLOPES)))
    low = high = next(parts)[1]
    slack = slack + 8 * ULP * np.abs(low)
    for (i, j), at in parts:
        size = first**i * second**j / (factorial(i) * factorial(j)) * (1 + 8 * ULP)
        change = at * size
        slack = slack + size * rounding(waves, a, b, i, j) + 8 * ULP * np.abs(change)
        if i == 2 or j == 2:  # squares have one sign
            low, high = low + np.minimum(change, 0.0), high + np.maximum(change, 0.0)
        else:
            low, high = low - np.abs(change), high + np.abs(change)
    left = sum(comb(3, j) * moment(waves, 3 - j, j) * first ** (3 - j) * second**j
               for j in range(4))  # fmt: skip
    slack = (slack + left / 6) * (1 + 16 * ULP)
    mean = float(next((c for m, k, c, _ in waves.rows if m == k == 0), 0))
    most = (moment(waves, 0, 0) - abs(mean)) * (1 + 1e-9) + abs(mean) * 4 * ULP
    # an angle that is not bounded takes every value
    lower, upper = np.fmax(low - slack, mean - most), np.fmin(high + slack, mean + most)
    return Interval(np.asarray(lower), np.asarray(upper))


def _middle(x: Interval) -> tuple[Array, Array]:
    """Return numbers within intervals and how far these reach from them, rounded up."""
    centre = x.middle
    if x.lower is x.upper:
        return centre, np.zeros_like(centre)
    reach = np.maximum(x.upper - centre, centre - x.lower) * (1 + 4 * ULP)
    return centre, np.asarray(reach)
