"""The splines that functions are compared with, rational ones by numerator and denominator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import product
from pc2cad.bounds.taylor_models import UNIT
from pc2cad.geometry.carriers import SplineCurve, SplineSurface
from pc2cad.geometry.splines.spline_basis import basis_matrix, local_basis


def homogeneous(carrier: SplineCurve | SplineSurface) -> Array:
    """Return poles (…, 3), or those times their weights and the weights (…, 4)."""
    if carrier.weights is None:
        return carrier.poles
    weights = carrier.weights[..., None]
    return np.concatenate((carrier.poles * weights, weights), axis=-1)


@dataclass(frozen=True, eq=False)
class HomogeneousSpline:
    """A spline in one or two parameters; poles (n, m, 3), m = 1 where there is no second.

    Those of a rational one are homogeneous: (n, m, 4).
    """

    degrees: tuple[int, ...]
    knots: tuple[Array, ...]
    poles: Array

    def on(self, s: Array, t: Array) -> Callable[[slice], Array]:
        """Return the values on a grid, by slabs: (rows along t, 3 or 4, len(s)) for some rows."""
        along = basis_matrix(self.knots[0], self.degrees[0], s)
        n, m, k = self.poles.shape
        rows = np.ascontiguousarray((along @ self.poles.reshape(n, m * k)).T)
        if len(self.knots) == 1:
            return lambda _: np.asarray(rows.reshape(m, k, len(s)))
        rows, p = rows.reshape(m, k * len(s)), self.degrees[1]
        first, across = local_basis(self.knots[1], p, t)

        def values(part: slice) -> Array:
            # few functions live in a slab: a small full matrix of theirs is the fastest one
            start, own = first[part], across[part]
            some = np.zeros((len(own), start[-1] - start[0] + p + 1))
            np.put_along_axis(some, (start - start[0])[:, None] + np.arange(p + 1), own, axis=1)
            flat = product(some, rows[start[0] : start[-1] + p + 1])
            return np.asarray(flat.reshape(len(own), k, len(s)))

        return values

    @property
    def is_polynomial(self) -> bool:
        """Whether there is no denominator."""
        return bool(self.poles.shape[2] == 3)

    @property
    def least_weight(self) -> float:
        """What no denominator is less than, where the largest is 1."""
        return 1.0 if self.is_polynomial else float(self.poles[..., 3].min())

    @property
    def most_rounding(self) -> float:
        """What `rounding` does not exceed, told sooner: poles differ by twice the largest."""
        size = float(np.abs(self.poles).max()) * self.poles.shape[2] ** 0.5
        total = 0.0
        for p, knots in zip(self.degrees, self.knots, strict=True):
            gaps = knots[1 + p : -1] - knots[1 : -1 - p]
            least = float(gaps[gaps > 0].min(initial=np.inf))
            total += (8 * (p + 2) + 8 * p / least) * UNIT * size
        return total * (1 + 1e-9)

    @cached_property
    def rounding(self) -> float:
        """Bound of the error of values, that of the parameters included.

        The basis is positive, a sum of products without cancellation: some 6 roundings per degree;
        the poles then enter once per direction. A parameter is off by 4 units at most.
        """
        return sum(
            float(rounding_along(knots, p, np.moveaxis(self.poles, axis, 0)).max())
            for axis, (p, knots) in enumerate(zip(self.degrees, self.knots, strict=True))
        )


def rounding_along(knots: Array, degree: int, poles: Array) -> Array:
    """Return bounds of the errors of values of splines with the poles (n, k, d), (k).

    Those of the parameter are included.
    """
    gaps = knots[1 + degree : -1] - knots[1 : -1 - degree]
    # between knots that are one there is no step: the spline is not continuous there
    slopes = (poles[1:] - poles[:-1]) / np.where(gaps > 0, gaps, np.inf)[:, None, None]
    size, slope = (np.sqrt(np.einsum("nki,nki->nk", x, x).max(axis=0)) for x in (poles, slopes))
    result = 8 * (degree + 2) * UNIT * size + 4 * UNIT * degree * slope
    return np.asarray(result * (1 + 1e-9))
