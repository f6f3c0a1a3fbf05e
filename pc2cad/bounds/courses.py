"""Functions of one parameter beside the splines that were fitted to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import product
from pc2cad.bounds.cells import Cells, to_bernstein, windows
from pc2cad.bounds.homogeneous_spline import rounding_along
from pc2cad.geometry.splines.spline_basis import basis_matrix
from pc2cad.geometry.splines.spline_space import SplineSpace


@dataclass(frozen=True, eq=False)
class Course:
    """Functions of one parameter beside their fits: values at the nodes of cells (k, d, n)."""

    values: Array
    #: fits less functions, (k, d, n)
    off: Array
    #: those of the fits, (k, d, size), and bounds of their rounding (k)
    poles: Array
    rounding: Array
    cells: Cells

    @classmethod
    def of(cls, sample: Callable[[Array], Array], cells: Cells, space: SplineSpace) -> Course:
        """Return functions (k, d, n) of places (n) beside their fits in a space."""
        nodes, count = cells.nodes(0, cells.count), len(space.sites)
        both = sample(np.concatenate((space.sites, nodes)))
        poles = space.fit(both[..., :count].transpose(2, 0, 1))
        fits = basis_matrix(space.knots, space.degree, nodes) @ poles.reshape(len(poles), -1)
        values = both[..., count:]
        rounding = rounding_along(space.knots, space.degree, poles)
        off = fits.T.reshape(values.shape) - values
        return cls(values, off, poles.transpose(1, 2, 0), rounding, cells)

    def coefficients(self, pairs: Array) -> Array:
        """Return the Bernstein coefficients of functions (k, d, n), (k, d, cells, nodes)."""
        rows = windows(pairs, 2, self.cells.degree)
        flat = product(rows.reshape(-1, rows.shape[-1]), to_bernstein(self.cells.degree).T)
        return flat.reshape(rows.shape)


def largest(vectors: Array) -> Array:
    """Return the largest lengths of vectors (k, d, n), (k)."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=1).max(axis=1)) * (1 + 1e-12))
