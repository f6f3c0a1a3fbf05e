"""Partitions of a parameter into cells, and polynomials on them from values at nodes.

Each cell has the Chebyshev-Lobatto nodes of one degree m. From values there come, per cell, the
Bernstein coefficients of the interpolating polynomial, which enclose it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache
from math import comb, cos, log, pi

import numpy as np
from numpy.lib.stride_tricks import as_strided

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.geometry.splines.bernstein import chebyshev_nodes

#: (first, last) of cells that are taken together, one row per group
Groups = Integers


@dataclass(frozen=True, eq=False)
class Cells:
    """Adjoining intervals of one parameter, each with the nodes of degree `degree`.

    A degree of 0 is that of a parameter that nothing depends on: one node per cell.
    """

    points: Array
    degree: int

    @property
    def count(self) -> int:
        """Number of cells."""
        return len(self.points) - 1

    @property
    def key(self) -> tuple[int, bytes]:
        """What tells the cells from others."""
        return self.degree, self.points.tobytes()

    @property
    def half(self) -> Array:
        """Half of each cell's length, rounded up."""
        return np.asarray(np.diff(self.points) / 2 * (1 + 1e-15))

    def nodes(self, first: int, last: int) -> Array:
        """Return the nodes of some cells in a row; neighbours share the one between them."""
        a, b = self.points[first:last, None], self.points[first + 1 : last + 1, None]
        if self.degree == 0:
            return np.asarray(a[:, 0])
        inner = a + (b - a) * chebyshev_nodes(self.degree)[:-1]
        return np.append(inner.ravel(), b[-1])

    @cached_property
    def lebesgue(self) -> float:
        """A bound of how much interpolation can enlarge errors of the values."""
        return 1.0 if self.degree == 0 else 1 + 2 / pi * log(self.degree + 1)

    def split(self, which: Booleans) -> Cells:
        """Return the partition with some cells halved."""
        middles = (self.points[:-1] + self.points[1:]) / 2
        return Cells(np.sort(np.concatenate((self.points, middles[which]))), self.degree)


def enlargement(per_degree: float) -> float:
    """Return by how much a polynomial may exceed its values at per_degree · degree + 1 nodes.

    Ehlich & Zeller 1964: 1/cos(πm/2N) for a degree m and N + 1 nodes; for vectors too, since it
    holds in every fixed direction.
    """
    return 1 / cos(pi / (2 * per_degree)) * (1 + 1e-9)


def windows(values: Array, axis: int, degree: int) -> Array:
    """Return a view with two axes for one: cells, and the nodes of each (shared with the next)."""
    step = max(degree, 1)
    shape, strides = list(values.shape), list(values.strides)
    shape[axis : axis + 1] = [(shape[axis] - 1) // step if degree else shape[axis], degree + 1]
    strides[axis : axis + 1] = [step * strides[axis], strides[axis]]
    return as_strided(values, shape, strides, writeable=False)


@lru_cache(maxsize=64)
def to_bernstein(degree: int) -> Array:
    """Return the matrix from values at the nodes to Bernstein coefficients.

    By way of Chebyshev coefficients, which lose nothing; their change of basis is rational.
    """
    n = degree
    if n == 0:
        return np.ones((1, 1))
    index = np.arange(n + 1)
    cosines = (-1.0) ** index[:, None] * np.cos(pi * np.outer(index, index) / n)
    ends = np.where((index == 0) | (index == n), 0.5, 1.0)
    analysis = 2 / n * ends[:, None] * cosines * ends
    return np.asarray(_chebyshev_to_bernstein(n) @ analysis)


@lru_cache(maxsize=64)
def _chebyshev_to_bernstein(degree: int) -> Array:
    """Return the Bernstein coefficients (rows) of T_k(2x - 1) (columns), rounded once."""
    polynomials: list[list[int]] = [[1], [-1, 2]]
    for _ in range(2, degree + 1):
        last, before = polynomials[-1], polynomials[-2]
        twice = [-2 * c for c in last] + [0]
        for i, c in enumerate(last):
            twice[i + 1] += 4 * c
        polynomials.append([c - (before[i] if i < len(before) else 0)
                            for i, c in enumerate(twice)])  # fmt: skip
    table = [
        [
            float(sum(Fraction(comb(i, j) * c, comb(degree, j)) for j, c in enumerate(p[: i + 1])))
            for p in polynomials[: degree + 1]
        ]
        for i in range(degree + 1)
    ]
    return np.array(table)


@lru_cache(maxsize=64)
def conversion_loss(first: int, second: int) -> float:
    """Return what rounding in `to_bernstein` along two axes costs, relative to values."""
    return sum(
        own_loss(n) * float(np.abs(to_bernstein(other)).sum(axis=1).max())
        for n, other in ((first, second), (second, first))
    )


@lru_cache(maxsize=64)
def own_loss(degree: int) -> float:
    """Return the same of one axis.

    Cosines are off by a few units, and sums by as many as they have terms.
    """
    largest = float(np.abs(_chebyshev_to_bernstein(degree)).sum(axis=1).max())
    return 16 * (degree + 2) * 2.0**-53 * largest


@lru_cache(maxsize=64)
def halving(degree: int) -> Array:
    """Return the matrices (2, n, n) from coefficients on a cell to those on its two halves.

    A constant has one coefficient on the whole cell: there is nothing to halve.
    """
    if degree == 0:
        return np.ones((1, 1, 1))
    left = np.array([
        [comb(i, k) / 2.0**i if k <= i else 0.0 for k in range(degree + 1)]
        for i in range(degree + 1)
    ])  # fmt: skip
    return np.stack((left, left[::-1, ::-1]))


@dataclass(frozen=True, eq=False)
class Direction:
    """One parameter of the function, its cells, and whether it is polynomial in it.

    `exact` says that the function's degree in the parameter is at most that of the cells.
    """

    name: str
    cells: Cells
    exact: bool
    #: the cells first tried: models are taken on their boxes, which all functions share
    boxes: Cells
    #: points of the cells at which the function changes its form: no box reaches over them
    breaks: tuple[float, ...] = ()

    @property
    def key(self) -> tuple[str, int, bytes]:
        """What tells the parameter and its cells from others."""
        return self.name, *self.cells.key

    def on(self, cells: Cells) -> Direction:
        """Return the direction with other cells."""
        return replace(self, cells=cells)

    def halved(self, which: Booleans) -> Direction:
        """Return the direction with some cells halved."""
        return self.on(self.cells.split(which))

    def groups(self, wanted: Booleans, size: int) -> Groups:
        """Return (first, last) of groups, of `size` or fewer, of the wanted cells."""
        if size == 1:
            each = np.flatnonzero(wanted)
            return np.column_stack((each, each + 1))
        starts = np.diff(wanted.astype(int), prepend=0) == 1
        starts |= wanted & np.isin(self.cells.points[:-1], self.breaks)
        label = np.where(wanted, np.cumsum(starts), 0)
        result = []
        for run in range(1, int(label.max(initial=0)) + 1):
            (cells,) = np.nonzero(label == run)
            first, last = cells[0], cells[-1] + 1
            edges = np.linspace(first, last, -(-(last - first) // size) + 1).astype(int)
            result.append(np.column_stack((edges[:-1], edges[1:])))
        return np.concatenate(result) if result else np.zeros((0, 2), dtype=int)
