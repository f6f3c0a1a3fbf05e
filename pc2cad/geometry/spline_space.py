"""Univariate spline spaces on [0, 1] and interpolation in them.

Interpolation is a linear operator per direction, so a tensor-product fit restricted to a boundary
line is the fit of that line: faces that use one space along a common edge agree on it pole for
pole. Sites include both ends (for periodic spaces: the seam), so limits are met exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]


class SplineSpace:
    """Splines of one degree over strictly ascending points with multiplicities.

    ``points`` run from 0 to 1; ``multiplicities`` belong to the interior points. A periodic space
    has in addition the multiplicity of the seam, ``seam`` (1 for the smoothest).
    """

    def __init__(
        self,
        degree: int,
        points: Sequence[float] | Array,
        multiplicities: Sequence[int] | None = None,
        seam: int | None = None,
    ) -> None:
        self.degree = degree
        self.points = np.asarray(points, dtype=float)
        self.multiplicities = np.asarray(
            np.ones(len(self.points) - 2, dtype=int) if multiplicities is None else multiplicities,
            dtype=int,
        )
        self.seam = seam
        inner = np.repeat(self.points[1:-1], self.multiplicities)
        ends = degree + 1
        self.knots: Array = np.concatenate((np.zeros(ends), inner, np.ones(ends)))

    @property
    def periodic(self) -> bool:
        """True where value and derivatives agree at the two ends."""
        return self.seam is not None

    @property
    def size(self) -> int:
        """Number of poles (of the clamped form)."""
        return len(self.knots) - self.degree - 1

    @cached_property
    def sites(self) -> Array:
        """Interpolation sites: as many as the space has degrees of freedom."""
        p = self.degree
        if self.seam is not None:
            n = len(self._cycle)
            windows = self._cyclic_knots(np.arange(n)[:, None] + np.arange(1, p + 1))
            sites = np.sort(windows.mean(axis=1) % 1.0)
            distance = np.minimum(sites, 1 - sites)
            sites[np.argmin(distance)] = 0.0
            return np.sort(sites)
        if len(self.points) == 2:
            # Chebyshev-Lobatto: a single Bézier piece of high degree stays well conditioned
            return (1 - np.cos(np.pi * np.arange(p + 1) / max(p, 1))) / 2
        return np.array([self.knots[i + 1 : i + p + 1].mean() for i in range(self.size)])

    @cached_property
    def _cycle(self) -> Array:
        """Knots of one period from the seam on."""
        inner = np.repeat(self.points[1:-1], self.multiplicities)
        return np.concatenate((np.zeros(self.seam or 0), inner))

    def _cyclic_knots(self, index: NDArray[np.int_]) -> Array:
        n = len(self._cycle)
        return self._cycle[index % n] + index // n

    @cached_property
    def _unclamped(self) -> tuple[Array, NDArray[np.int_]]:
        """Knots of the periodic basis over [0, 1], and the coefficient each function belongs to."""
        n, p, seam = len(self._cycle), self.degree, self.seam or 0
        functions = np.arange(seam - p - 1, n)
        return self._cyclic_knots(np.arange(seam - p - 1, n + p + 1)), functions % n

    @cached_property
    def _solver(self) -> splu:
        if self.seam is None:
            matrix = self.basis(self.sites)
        else:
            knots, owner = self._unclamped
            local = BSpline.design_matrix(self.sites, knots, self.degree)
            fold = csr_array(
                (np.ones(len(owner)), (np.arange(len(owner)), owner)),
                shape=(len(owner), len(self._cycle)),
            )
            matrix = csr_array(local) @ fold
        return splu(csc_array(matrix))

    def basis(self, t: Array) -> csr_array:
        """Return the values of the clamped basis at t, (len(t), size)."""
        return csr_array(BSpline.design_matrix(t, self.knots, self.degree))

    def fit(self, values: Array) -> Array:
        """Return clamped poles of the interpolant: values (sites, …) to poles (size, …)."""
        flat = np.ascontiguousarray(values.reshape(len(self.sites), -1))
        poles: Array = self._solver.solve(flat)
        if self.seam is not None:
            poles = self._clamp(poles)
            poles[-1] = poles[0]
        else:
            poles[0], poles[-1] = flat[0], flat[-1]
        return poles.reshape(self.size, *values.shape[1:])

    def _clamp(self, cyclic: Array) -> Array:
        """Insert end knots: the poles near the ends are blossoms of the end pieces."""
        knots, owner = self._unclamped
        poles = cyclic[owner]
        p, last = self.degree, self.size - 1
        result = poles.copy()
        for j in range(min(p, last) + 1):
            arguments = self.knots[j + 1 : j + p + 1]
            result[j] = _blossom(knots, poles, p, p, arguments)
        for j in range(max(last - p, 0), last + 1):
            if j > p:
                arguments = self.knots[j + 1 : j + p + 1]
                result[j] = _blossom(knots, poles, p, last, arguments)
        return result


def _blossom(knots: Array, poles: Array, p: int, piece: int, arguments: Array) -> Array:
    """Return the blossom of the polynomial on [knots[piece], knots[piece+1]] (de Boor's scheme)."""
    work = poles[piece - p : piece + 1].copy()
    for r, x in enumerate(arguments, start=1):
        left = knots[piece - p + r : piece + 1]
        right = knots[piece + 1 : piece + 1 + p - r + 1]
        ratio = ((x - left) / (right - left))[:, None]
        work = (1 - ratio) * work[:-1] + ratio * work[1:]
    value: Array = work[0]
    return value


def bezier_space(degree: int) -> SplineSpace:
    """Return the space of polynomials of a degree."""
    return SplineSpace(max(degree, 1), (0.0, 1.0))
