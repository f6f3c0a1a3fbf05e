"""How far a function of three parameters is from a spline between the slices where that is known.

Along one parameter, on a cell, M - S is within R of a polynomial of degree m. Such a polynomial is
at most 1/cos(πm/2N) times its largest value at N + 1 Chebyshev-Lobatto places (`enlargement`). So a
bound D of M - S at these places, for all values of the other two parameters, makes it at most
(D + R)/cos(πm/2N) + R.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pc2cad.arrays import Array
from pc2cad.bounds.cells import Cells, enlargement
from pc2cad.bounds.deviation import direction_along
from pc2cad.bounds.known import Known, Models
from pc2cad.bounds.remainder import ORDER
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import UNIT, Model, Place
from pc2cad.bounds.values import length
from pc2cad.expression.linear_terms import cancel_terms
from pc2cad.expression.tree import Expr, symbol, walk

#: places per degree and cell: what is seen at them is enlarged by 1.16
_PER_DEGREE = 3
#: halvings of the cells, and parts of the other parameters, that are tried
_EFFORTS = ((0, 8), (0, 32), (1, 32), (2, 64), (3, 128))
#: degrees beyond those that faces are compared in: discs know one parameter to first order only
_MORE = 4


@dataclass(frozen=True, eq=False)
class Between:
    """Where a function is looked at along one parameter, and what it can be off between."""

    #: cells of the parameter
    cells: Cells
    #: bound of the distance from a polynomial of the cells' degree, per cell
    rest: Array

    def places(self) -> Array:
        """Return the values of the parameter at which slices are looked at, ascending."""
        return Cells(self.cells.points, _PER_DEGREE * self.cells.degree).nodes(0, self.cells.count)

    def largest(self, slices: Array) -> float:
        """Return the bound everywhere, from one at each of `places`."""
        step = _PER_DEGREE * self.cells.degree
        seen = np.array([slices[k * step : (k + 1) * step + 1].max()
                         for k in range(self.cells.count)])  # fmt: skip
        factor = enlargement(_PER_DEGREE)
        return float(((seen + self.rest) * factor + self.rest).max())


def between(
    trees: tuple[Expr, ...],
    names: Sequence[str],
    knots: Sequence[Array],
    degrees: Sequence[int],
    axis: int,
    allowed: float,
) -> Between | None:
    """Return cells along names[axis] on which the trees are within `allowed` of polynomials.

    Knots and degrees are the spline's. None where no such cells were found.
    """
    trees = cancel_terms(trees)
    other, disc = (k for k in range(3) if k != axis)
    if _in_pieces(trees, names[disc]):
        other, disc = disc, other
    if _in_pieces(trees, names[disc]):
        return None
    line, across = (
        direction_along(trees, names[k], knots[k], degrees[k]).cells for k in (axis, other)
    )
    for halvings, parts in _EFFORTS:
        cells = Cells(_divided(line.points, 2**halvings), line.degree + _MORE)
        boxes = _divided(across.points, max(1, parts // across.count))
        rest = np.zeros(cells.count)
        for ends in pairwise(np.linspace(0, 1, parts + 1)):
            found = _off(trees, (names[axis], names[other], names[disc]), cells, boxes, ends)
            rest = np.fmax(rest, found)
            if not (rest <= allowed).all():
                break
        else:
            return Between(cells, rest)
    return None


def _divided(points: Array, parts: int) -> Array:
    """Return points with each interval divided evenly."""
    steps = np.arange(parts) / parts
    inner = points[:-1, None] + np.diff(points)[:, None] * steps
    return np.append(inner.ravel(), points[-1])


def _off(
    trees: tuple[Expr, ...],
    names: tuple[str, str, str],
    cells: Cells,
    boxes: Array,
    ends: tuple[float, float],
) -> Array:
    """Return how far from a polynomial in the first parameter the trees are, cell by cell.

    The second is in `boxes`, the third between the `ends`. Discs are four times as wide as a cell,
    so that interpolation leaves 4 B/6^(m+1) of a distance B (see `remainder`).
    """
    middle, half = (cells.points[1:] + cells.points[:-1]) / 2, cells.half + 4 * UNIT
    second = (boxes[1:] + boxes[:-1]) / 2, np.diff(boxes) / 2 * (1 + 1e-12) + 4 * UNIT
    places = Place(middle, half, 4 * half), Place(second[0], second[1], second[1])
    order = min(ORDER, cells.degree)
    models = enclose(trees, names[:2], places, order, _WithDisc(names[2], *ends))
    shape = (cells.count, len(boxes) - 1)
    distance = np.broadcast_to(length([model.radius for model in models]), shape)
    return np.asarray(distance.max(axis=1) * 4 * (1 / 6 + 1e-9) ** (cells.degree + 1))


def _in_pieces(trees: tuple[Expr, ...], name: str) -> bool:
    """Say whether a parameter decides between pieces: discs do not know in which they are."""
    return any(
        node.op == "pieces" and name in node.args[0].symbols
        for node in walk(trees, lambda n: n.args)
    )


class _WithDisc(Known):
    """Knows one parameter as a disc round an interval, whatever the places of the others."""

    def __init__(self, name: str, low: float, high: float) -> None:
        super().__init__()
        half = np.full((1, 1), (high - low) / 2 * (1 + 1e-12) + 2 * UNIT)
        centre = np.full((1, 1, 1, 1), (low + high) / 2)
        self._symbol, self._model = symbol(name), Model(centre, half, np.full((1, 1), 4 * UNIT))

    def at(self, names: Sequence[str], places: Sequence[Place], order: int) -> Models:
        """See Known.at."""
        return Models({name: {} for name in names}, {self._symbol: self._model})
