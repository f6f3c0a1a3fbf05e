"""The function whose distance from a spline is bounded: as a whole, or as a sum of products.

Σ A_k(s) b_k(t) needs models of one parameter only. Interpolation along s is off by Σ |A_k - I A_k|
|b_k| at most, and so along t; the models of the A_k serve both walls of a channel and its edges.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import product
from pc2cad.bounds.cells import Cells, Direction
from pc2cad.bounds.courses import Course
from pc2cad.bounds.discs import first_discs, remainders_along
from pc2cad.bounds.known import Known
from pc2cad.bounds.remainder import Remainders, Vectors, remainders
from pc2cad.bounds.taylor_models import UNIT
from pc2cad.expression.evaluation import Program
from pc2cad.expression.separable_sums import vector_products
from pc2cad.expression.tree import Expr
from pc2cad.geometry.splines.spline_space import SplineSpace

#: more products than this are no help
MOST_PRODUCTS = 12
#: products may cancel one another down to this share of their sizes
LEAST_SUM = 1e-2


#: values on a grid of parameters s and t for some of the rows along t, (rows, 3, len(s)), one after
#: the other in memory
Slabs = Callable[[slice], Array]


class Whole:
    """Three trees in one or two parameters."""

    def __init__(self, trees: tuple[Expr, ...], names: tuple[str, ...], known: Known) -> None:
        self._trees, self._names, self._known = trees, names, known
        self._program = Program(trees)

    def on(self, s: Array, t: Array) -> Slabs:
        """Return the values on a grid, by slabs."""

        def values(part: slice) -> Array:
            rows = t[part, None]
            result = np.empty((len(rows), 3, len(s)))
            grid = dict(zip(self._names, (s[None, :], rows), strict=False))
            for axis, column in enumerate(self._program(grid)):
                result[:, axis] = column
            return result

        return values

    def remainders(
        self, directions: Sequence[Direction], reach: Sequence[float], size: float, allowed: float
    ) -> tuple[list[Direction], Remainders]:
        """Return cells that are small enough, and the remainders on them (see `remainders`)."""
        vectors = Vectors((self._trees,), (1.0,), self._known)
        if len(directions) == 1:
            (direction,) = directions
            first = first_discs(vectors, direction, reach[0])
            direction, rest = remainders_along(vectors, direction, first, allowed)
            return [direction], rest
        return remainders(vectors, directions, reach, allowed)


class Products:
    """The sum of some vectors in the first parameter, times a factor each in the second."""

    def __init__(
        self, products: Sequence[tuple[tuple[Expr, ...], Expr]], names: tuple[str, ...],
        known: Known,
    ) -> None:  # fmt: skip
        self._names, self._known = names, known
        self._rows = tuple(v for v, _ in products), tuple((factor,) for _, factor in products)

    def course(self, axis: int, cells: Cells, space: SplineSpace) -> Course:
        """Return the vectors, or factors, beside their fits in a space."""
        key = self._rows[axis], self._names[axis], cells.key, space
        found = self._known.courses.get(key)
        if found is None:
            found = Course.of(partial(self.factors, axis), cells, space)
            self._known.courses[key] = found
        return found

    def factors(self, axis: int, places: Array) -> Array:
        """Return the vectors (k, 3, n) at places of the first parameter, or factors (k, 1, n)."""
        trees = [tree for row in self._rows[axis] for tree in row]
        columns = self._known.values(trees, self._names[axis], places)
        return np.array(columns).reshape(len(self._rows[axis]), -1, len(places))

    def expect(self) -> None:
        """Let what is known of other functions be worked out together with this one's factors."""
        for rows, name in zip(self._rows, self._names, strict=True):
            expected = self._known.expected.setdefault(name, {})
            expected.update(dict.fromkeys([tree for row in rows for tree in row]))

    def on(self, s: Array, t: Array) -> Slabs:
        """Return the values on a grid, by slabs."""
        a, b = self.factors(0, s), self.factors(1, t)[:, 0]
        vectors, factors = a.reshape(len(b), -1), np.ascontiguousarray(b.T)
        return lambda part: product(factors[part], vectors).reshape(-1, 3, len(s))

    def remainders(
        self, directions: Sequence[Direction], reach: Sequence[float], size: float, allowed: float
    ) -> tuple[list[Direction], Remainders] | None:
        """Return the same as `Whole`; None where the products are too large or not bounded."""
        part = allowed / max(1, sum(not d.exact for d in directions))
        rows = [Vectors(row, (), self._known) for row in self._rows]
        t_discs = first_discs(rows[1], directions[1], reach[1])
        second = t_discs.sizes.max(axis=1)
        s_discs = first_discs(rows[0], directions[0], reach[0])
        s, along = remainders_along(rows[0].weighted(second), directions[0], s_discs, part)
        first = along.sizes.max(axis=(1, 2))
        total = float(first @ second)
        if not total * LEAST_SUM <= size:
            return None
        allowed_along_t = part / s.cells.lebesgue
        t, across = remainders_along(
            rows[1].weighted(first), directions[1], t_discs, allowed_along_t
        )
        of_sums = (len(first) + 4) * UNIT * total
        rounding = along.rounding + across.rounding.T + of_sums
        errors = along.along[0], s.cells.lebesgue * across.along[0].T
        a, b = (error + np.zeros_like(rounding) for error in errors)
        whole = [
            np.minimum(row.along[0] + d.cells.lebesgue * row.rounding, row.by_values)
            for d, row in ((s, along), (t, across))
        ]
        by_values = whole[0] + s.cells.lebesgue * (whole[1].T + t.cells.lebesgue * of_sums)
        sizes = np.full((1, *rounding.shape), total)
        return [s, t], Remainders((a, b), rounding, sizes, by_values)


def function_of(trees: tuple[Expr, ...], names: tuple[str, ...], known: Known) -> Whole | Products:
    """Return a function of one or two parameters, as a sum of products where it is one."""
    if len(names) != 2:
        return Whole(trees, names, known)
    key = trees, names[0]
    if key not in known.products:
        known.products[key] = vector_products(*key)
    products = known.products[key]
    # what vanishes everywhere, as a field may on a slice, is a sum of no products
    if not products or len(products) > MOST_PRODUCTS:
        return Whole(trees, names, known)
    return Products(products, names, known)
