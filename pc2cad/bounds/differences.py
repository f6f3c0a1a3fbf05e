"""The difference between a spline and a function on cells: its values at nodes, and coefficients.

Of any function it is sampled. Of a sum of products M = Σ A_k(s) b_k(t) it follows from functions of
one parameter where the spline was fitted to it: a fit is linear in each direction, so that it is
Σ α_k(s) β_k(t), of the fits of the factors. By how much S is off that its poles tell. What is left,

    Σ α_k β_k - M = Σ (α_k - A_k) b_k + α_k (β_k - b_k),

has values, and coefficients, that are products of two matrices. Nothing large is subtracted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import ONE_THREAD, product
from pc2cad.bounds.cells import Cells, conversion_loss, own_loss, to_bernstein, windows
from pc2cad.bounds.courses import Course, largest
from pc2cad.bounds.homogeneous_spline import HomogeneousSpline
from pc2cad.bounds.separable import Products, Slabs, Whole
from pc2cad.bounds.taylor_models import UNIT
from pc2cad.geometry.splines.spline_space import SplineSpace

#: nodes whose values are held at once: few enough for a processor's own memory
SLAB = 10_000
#: what the poles of a spline may differ from those of products, and rounding of these may cost, as
#: a share of the expected difference
MOST_LEFT = 1e-3


class Difference(Protocol):
    """S - M on cells, rows of cells along t at a time."""

    #: bound of the rounding of the spline's values, at nodes
    rounding: float
    #: by how many times as much as when sampled the function's own values are off
    worse: float

    def values(self, part: slice) -> Array:
        """Return values at nodes: (rows along t, 3, places s), 4 of a rational spline."""

    def coefficients(self, first: int, last: int, gap: Array) -> Array:
        """Return the Bernstein coefficients on some rows of cells, whose values are given.

        Their shape is (t cells, t nodes, 3 or 4, s cells, s nodes).
        """

    def loss(self, sampled: float) -> float:
        """Return how far the coefficients may be off, where the largest value is known."""

    @property
    def rows(self) -> int:
        """Number of rows of cells that are held at once."""


class Sampled:
    """The difference from any function, sampled."""

    worse = 1.0

    def __init__(
        self, function: Whole | Products, spline: HomogeneousSpline, cells: tuple[Cells, Cells]
    ) -> None:
        """Look at the nodes of cells."""
        self._s, self._t = cells
        s, t = (c.nodes(0, c.count) for c in cells)
        self.values = difference_at(function, spline, s, t)
        self.rounding = spline.rounding
        # what is lost of the coefficients of a numerator and of its denominator
        self._spread = 1.0 if spline.is_polynomial else 3 / spline.least_weight
        self.rows = max(1, SLAB // (len(s) * max(self._t.degree, 1)))

    def coefficients(self, first: int, last: int, gap: Array) -> Array:
        """Return the Bernstein coefficients of values at nodes."""
        # what a step works along is last, or has what lies behind it in one piece: that is many
        # times faster
        t, s = self._t.degree, self._s.degree
        along = windows(gap, 0, t)
        along = product(to_bernstein(t), along.reshape(*along.shape[:2], -1))
        across = windows(along.reshape(*along.shape[:2], *gap.shape[1:]), 3, s)
        return product(across.reshape(-1, s + 1), to_bernstein(s).T).reshape(across.shape)

    def loss(self, sampled: float) -> float:
        """Return how far the coefficients may be off."""
        return conversion_loss(self._s.degree, self._t.degree) * self._spread * sampled


def difference_at(
    function: Whole | Products, spline: HomogeneousSpline, s: Array, t: Array
) -> Slabs:
    """Return S - M on a grid, by slabs; of a rational S the numerator, and the denominator."""
    of_spline, of_function = spline.on(s, t), function.on(s, t)

    def gap(part: slice) -> Array:
        result = of_spline(part)
        result[:, :3] -= of_function(part)
        return result

    return gap


class Factored:
    """The difference from a sum of products whose spline is the fit of it."""

    def __init__(self, s: Course, t: Course, net: Array) -> None:
        """Of the spline with the poles `net`, (n, m, 3)."""
        pairs = [np.concatenate((s.off, s.values + s.off)), np.concatenate((t.values, t.off))]
        self._values = pairs[0].reshape(len(pairs[0]), -1), np.ascontiguousarray(pairs[1][:, 0].T)
        self._degrees = s.cells.degree, t.cells.degree
        forms = s.coefficients(pairs[0]), t.coefficients(pairs[1])
        self._cells = forms[0].shape[1:]
        self._forms = forms[0].reshape(len(forms[0]), -1), forms[1].reshape(len(forms[1]), -1).T
        a, b = (largest(pair) for pair in pairs)
        total = float(a @ b)
        adding = (len(a) + 4) * UNIT
        half = len(s.values)
        self.rounding = float(s.rounding @ (b[:half] + b[half:]) + t.rounding @ a[half:])
        self.rounding += (adding + 2 * UNIT) * total
        own = largest(s.values)
        self.worse = 1 + 2 * float((a[:half] / own).max())
        # what a product of coefficients is off: by what both are off, and by its own rounding
        wide = [largest(form.reshape(*form.shape[:2], -1)) for form in forms]
        lost = [own_loss(n) * x for n, x in zip(self._degrees, (a, b), strict=True)]
        off = lost[0] @ (wide[1] + lost[1]) + wide[0] @ lost[1] + adding * (wide[0] @ wide[1])
        self._lost = float(off) + _left(net, s, t)
        most = min(SLAB, ONE_THREAD // (3 * len(a)))
        self.rows = max(1, most // (pairs[0].shape[2] * max(t.cells.degree, 1)))

    def values(self, part: slice) -> Array:
        """Return values at nodes."""
        s, t = self._values
        return product(t[part], s).reshape(-1, 3, s.shape[1] // 3)

    def coefficients(self, first: int, last: int, gap: Array) -> Array:
        """Return the Bernstein coefficients."""
        del gap
        s, t = self._forms
        nodes = self._degrees[1] + 1
        flat = product(t[first * nodes : last * nodes], s)
        return flat.reshape(last - first, nodes, *self._cells)

    def loss(self, sampled: float) -> float:
        """Return how far the coefficients may be off."""
        del sampled
        return self._lost


def _left(net: Array, s: Course, t: Course) -> float:
    """Return a bound of how far the spline with the poles `net` is off the sum of products."""
    (k, d, n), m = s.poles.shape, t.poles.shape[2]
    sums = product(t.poles.reshape(k, m).T, s.poles.reshape(k, d * n)).reshape(m, d, n)
    gap = net.transpose(1, 2, 0) - sums
    rounding = (len(s.poles) + 4) * UNIT * float(largest(s.poles) @ largest(t.poles))
    return float(np.sqrt((gap * gap).sum(axis=1)).max()) * (1 + 1e-12) + rounding


def difference(
    function: Whole | Products,
    spline: HomogeneousSpline,
    cells: tuple[Cells, Cells],
    spaces: Sequence[SplineSpace],
    expected: float,
) -> Difference:
    """Return the difference, from factors where these lose next to nothing of what is expected.

    `spaces` are those that the spline was fitted in; none where that is not known.
    """
    fitted = [np.array_equal(x.knots, y) for x, y in zip(spaces, spline.knots, strict=False)]
    if isinstance(function, Products) and spline.is_polynomial and fitted == [True, True]:
        s, t = (function.course(k, cells[k], spaces[k]) for k in (0, 1))
        found = Factored(s, t, spline.poles)
        # written so that what is not a number is not overlooked
        if found.loss(expected) + found.rounding <= MOST_LEFT * expected and found.worse < 2:
            return found
    return Sampled(function, spline, cells)
