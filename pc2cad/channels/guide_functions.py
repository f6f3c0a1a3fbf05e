"""Functions of the guide's parameter by numbers: samples, smallest values, antiderivatives.

What cannot be written as a tree (the angle of a rotation-minimising frame) is integrated here and
becomes a tree again: a piecewise polynomial that defines it from then on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import numpy as np

from pc2cad.arrays import Array
from pc2cad.errors import InputError
from pc2cad.expression.breaks import find_breaks
from pc2cad.expression.evaluation import Program
from pc2cad.expression.tree import ANALYTIC, Expr, number, pieces, substitute, symbol

#: a scalar function on an array
Function = Callable[[Array], Array]

U = symbol("u")
#: degree of the pieces of an antiderivative: high enough to be short, low enough to be exact as
#: powers of the distance from the piece's beginning
DEGREE = 16
#: a series has converged when its last coefficients are this small against the function
CONVERGED = 4e-15
#: halvings of a smooth stretch
DEEPEST = 14
_NODES = np.cos(np.pi * (2 * np.arange(DEGREE) + 1) / (2 * DEGREE))
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(24)


class NotSmoothError(InputError):
    """A function along the guide cannot be integrated to full accuracy."""


def values(roots: Sequence[Expr], u: Array) -> Array:
    """Return trees of u alone on an array: shape (len(roots),) + u.shape."""
    strange = frozenset[str]().union(*(r.symbols for r in roots)) - {"u"}
    if strange:
        raise InputError(f"along the guide only u may vary, not {', '.join(sorted(strange))}")
    columns = Program(tuple(roots))({"u": u})
    return np.array([np.broadcast_to(c, u.shape) for c in columns], dtype=float)


def function(root: Expr) -> Function:
    """Return a tree of u as a function of arrays."""
    return lambda u: np.asarray(values((root,), u)[0])


def extent(curves: Sequence[tuple[tuple[Expr, ...], tuple[float, float]]]) -> float:
    """Return the diagonal of the box round curves (trees, limits of u); nan where one is not."""
    places = [values(roots, np.linspace(*limits, 17)) for roots, limits in curves]
    return float(np.linalg.norm(np.ptp(np.concatenate(places, axis=1), axis=1)))


def smallest(function: Function, low: float, high: float, count: int = 257) -> tuple[float, float]:
    """Return (place, value) of the smallest value on an interval: a sweep, then finer ones."""
    u = np.linspace(low, high, count)
    for _ in range(12):
        found = function(u)
        found = np.where(np.isfinite(found), found, -np.inf)
        i = int(np.argmin(found))
        place, value = float(u[i]), float(found[i])
        u = np.linspace(u[max(i - 1, 0)], u[min(i + 1, len(u) - 1)], 33)
    return place, value


def knots(roots: Sequence[Expr], low: float, high: float) -> list[float]:
    """Return low, high, and between them the breaks of the piecewise functions of u."""
    local = number(low) + number(high - low) * U
    inner = find_breaks(substitute(tuple(roots), {"u": local}))[0]
    return [low, *(low + (high - low) * b.position for b in inner if 0 < b.position < 1), high]


@dataclass(frozen=True)
class Antiderivative:
    """The integral of a function from the beginning of its interval, as piecewise polynomial."""

    #: limits of the pieces
    breaks: tuple[float, ...]
    #: (pieces, DEGREE + 1) ascending coefficients in the distance from the piece's beginning
    rows: Array
    #: largest difference from the quadrature at the end of a piece and within it
    deviation: float

    @property
    def total(self) -> float:
        """The integral over the whole interval."""
        return float(np.polyval(self.rows[-1][::-1], self.breaks[-1] - self.breaks[-2]))

    def tree(self, start: float) -> Expr:
        """Return start + integral as a tree of u; linear where the function is constant."""
        slopes = self.rows[:, 1]
        flat = np.abs(self.rows[:, 2:]).max() <= 1e-13 * max(np.abs(slopes).max(), 1e-300)
        if flat and np.ptp(slopes) <= 1e-13 * np.abs(slopes).max():
            if np.abs(slopes).max() * (self.breaks[-1] - self.breaks[0]) < 1e-13:
                return tidy(start)
            slope = self.total / (self.breaks[-1] - self.breaks[0])
            return tidy(start) + number(slope) * (U - number(self.breaks[0]))
        rows = self.rows.copy()
        rows[:, 0] += start
        trees = tuple(tuple(number(float(c)) for c in row) for row in rows)
        breaks = tuple(Fraction(b) for b in self.breaks)
        return pieces(U, breaks, trees, ANALYTIC, closed=False)


def tidy(angle: float) -> Expr:
    """Return an angle as a number, 0 where it is only rounding."""
    return number(0 if abs(angle) < 1e-15 else angle)


def antiderivative(function: Function, limits: Sequence[float]) -> Antiderivative:
    """Integrate a function that is smooth between neighbouring limits.

    Chebyshev series on pieces that are halved until the series has converged; raises
    NotSmoothError where that takes too many halvings.
    """
    ends = [float(limits[0])]
    rows: list[Array] = []
    total = deviation = 0.0
    scale = float(np.abs(function(np.linspace(limits[0], limits[-1], 129)[1:-1])).max())
    for a, b in pairwise(limits):
        stack = [(float(a), float(b), 0)]
        while stack:
            low, high, depth = stack.pop()
            series = _series(function, low, high)
            size = max(scale, float(np.abs(series).max()), 1e-300)
            if not np.isfinite(series).all() or depth > DEEPEST:
                raise NotSmoothError(f"the guide is not smooth near u = {low:.6g}")
            if np.abs(series[-2:]).max() > CONVERGED * size:
                middle = (low + high) / 2
                stack += [(middle, high, depth + 1), (low, middle, depth + 1)]
                continue
            row = _powers(series, high - low)
            row[0] = total
            deviation = max(deviation, _error(function, row - row[0] * _unit(0), low, high))
            rows.append(row)
            ends.append(high)
            total = float(np.polyval(row[::-1], high - low))
    return Antiderivative(tuple(ends), np.array(rows), deviation)


def _unit(k: int) -> Array:
    return np.asarray(np.eye(DEGREE + 1)[k], dtype=float)


def _series(function: Function, low: float, high: float) -> Array:
    """Return DEGREE Chebyshev coefficients of the function on an interval."""
    samples = function((low + high) / 2 + (high - low) / 2 * _NODES)
    k = np.arange(DEGREE)[:, None]
    table = np.cos(k * np.arccos(_NODES)) * 2 / DEGREE
    table[0] /= 2
    return np.asarray(table @ samples, dtype=float)


def _powers(series: Array, width: float) -> Array:
    """Return the integral of a series from the interval's beginning, in powers of the distance."""
    integral = np.polynomial.chebyshev.chebint(series * width / 2, lbnd=-1)
    # T_k(2s - 1) by powers of s in [0, 1], then of the distance s * width
    power: Array = np.zeros(DEGREE + 1)
    previous, current = np.zeros(DEGREE + 1), _unit(0)
    for k, c in enumerate(integral):
        power = np.asarray(power + c * current, dtype=float)
        shifted = 2 * np.roll(current, 1) - current
        previous, current = current, shifted if k == 0 else 2 * shifted - previous
    scaled: Array = power / width ** np.arange(DEGREE + 1)
    return scaled


def _error(function: Function, row: Array, low: float, high: float) -> float:
    """Return the difference from Gauss's rule at two places of a piece."""
    worst = 0.0
    for share in (0.6180339887, 1.0):
        width = (high - low) * share
        exact = float(_WEIGHTS @ function(low + width * (_GAUSS + 1) / 2)) * width / 2
        worst = max(worst, abs(float(np.polyval(row[::-1], width)) - exact))
    return worst


def at(roots: Sequence[Expr], place: float) -> Array:
    """Return trees of u at one place: shape (len(roots),)."""
    return values(roots, np.array([place]))[:, 0]
