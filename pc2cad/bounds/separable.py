"""The function whose distance from a spline is bounded: as a whole, or as a sum of products.

Σ A_k(s) b_k(t) needs models of one parameter only. Interpolation along s is off by Σ |A_k - I A_k|
|b_k| at most, and so along t; the models of the A_k serve both walls of a channel and its edges.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import product
from pc2cad.bounds.cells import Direction
from pc2cad.bounds.remainder import (
    Remainders,
    Vectors,
    first_places,
    order_of,
    remainders,
)
from pc2cad.bounds.taylor_evaluation import Known
from pc2cad.bounds.taylor_models import UNIT
from pc2cad.bounds.values import length
from pc2cad.expression.evaluation import Program
from pc2cad.expression.separable_sums import vector_products
from pc2cad.expression.tree import Expr

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
        return remainders(vectors, directions, reach, allowed)


class Products:
    """The sum of some vectors in the first parameter, times a factor each in the second."""

    def __init__(
        self, products: Sequence[tuple[tuple[Expr, ...], Expr]], names: tuple[str, ...],
        known: Known,
    ) -> None:  # fmt: skip
        self._names, self._known = names, known
        self._rows = tuple(v for v, _ in products), tuple((factor,) for _, factor in products)

    @cached_property
    def _programs(self) -> tuple[Program, Program]:
        first, second = (Program(tuple(t for row in rows for t in row)) for rows in self._rows)
        return first, second

    def on(self, s: Array, t: Array) -> Slabs:
        """Return the values on a grid, by slabs."""
        a, b = (
            np.stack([np.broadcast_to(x, len(places)) for x in program({name: places})])
            for program, name, places in zip(self._programs, self._names, (s, t), strict=True)
        )
        vectors, factors = a.reshape(len(b), -1), np.ascontiguousarray(b.T)
        return lambda part: product(factors[part], vectors).reshape(-1, 3, len(s))

    def remainders(
        self, directions: Sequence[Direction], reach: Sequence[float], size: float, allowed: float
    ) -> tuple[list[Direction], Remainders] | None:
        """Return the same as `Whole`; None where the products are too large or not bounded."""
        part = allowed / max(1, sum(not d.exact for d in directions))
        second = self._largest(directions[1], reach[1])
        s, along = self._remainders(0, second, directions, reach, part)
        across_first = part / s.cells.lebesgue
        first = along.sizes.max(axis=(1, 2))
        total = float(first @ second)
        if not total * LEAST_SUM <= size:
            return None
        t, across = self._remainders(1, first, directions, reach, across_first)
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

    def _remainders(
        self,
        axis: int,
        weights: Array,
        directions: Sequence[Direction],
        reach: Sequence[float],
        allowed: float,
    ) -> tuple[Direction, Remainders]:
        vectors = Vectors(self._rows[axis], tuple(weights.tolist()), self._known)
        (direction,), rest = remainders(
            vectors, directions[axis : axis + 1], reach[axis : axis + 1], allowed
        )
        return direction, rest

    def _largest(self, direction: Direction, reach: float) -> Array:
        """Return bounds of the sizes of all factors, over the whole second parameter."""
        rows = Vectors(self._rows[1], (), self._known)
        for wide in (True, False):
            places = [first_places(direction, reach, wide)]
            models = rows.models([direction.name], places, order_of([direction]))
            found = np.array([length([m.largest for m in row]).max() for row in models])
            if np.isfinite(found).all():
                break
        return found


def function_of(trees: tuple[Expr, ...], names: tuple[str, ...], known: Known) -> Whole | Products:
    """Return a function of one or two parameters, as a sum of products where it is one."""
    products = vector_products(trees, names[0]) if len(names) == 2 else None
    # what vanishes everywhere, as a field may on a slice, is a sum of no products
    if not products or len(products) > MOST_PRODUCTS:
        return Whole(trees, names, known)
    return Products(products, names, known)
