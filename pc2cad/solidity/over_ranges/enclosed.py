"""The sign of det J for all values of some parameters, from interval enclosures of its columns.

As for one map (`jacobian_proof.enclosures`), with the parameters as further intervals. Boxes of u,
v and w are split; where it is the parameters that are to blame, their own box has to be halved.
"""

from __future__ import annotations

import math
from functools import cached_property
from itertools import count

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.intervals import Interval, enclosed_range
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import Expr, walk
from pc2cad.solidity.jacobian_proof.determinant import determinant
from pc2cad.solidity.jacobian_proof.enclosures import (
    MOST_BOXES,
    NARROWEST,
    PLACES,
    Columns,
    columns_of,
    split,
)
from pc2cad.solidity.jacobian_proof.factors import Spans

#: boxes whose enclosures take as long as it takes to begin with some
A_ROUND = 6000
#: operations for a box and a node of the trees, slopes included
A_BOX = 6


class Enclosed:
    """Columns of J, in which parameters are left free."""

    def __init__(
        self, coordinates: tuple[Expr, ...], derivatives: tuple[tuple[Expr, ...], ...], whole: Spans
    ) -> None:
        self._coordinates, self._derivatives, self._whole = coordinates, derivatives, whole

    @cached_property
    def _columns(self) -> list[Columns]:
        """The three columns, and det J as one, where zeros on sides are known of them."""
        matrices = self._derivatives, ((determinant(self._derivatives),),)
        spans = _intervals(self._whole)
        found = (columns_of(matrix, spans) for matrix in matrices)
        return [columns for columns in found if columns is not None]

    @cached_property
    def _breaks(self) -> list[list[float]]:
        """Where pieces begin along u, v and w."""
        found: dict[str, set[float]] = {name: set() for name in PARAMETERS}
        for node in walk(self._coordinates):
            if node.op == "pieces" and node.args[0].op == "symbol":
                found.get(node.args[0].payload, set()).update(map(float, node.payload.breaks))
        return [sorted(x for x in found[name] if 0 < x < 1) for name in PARAMETERS]

    def sign(self, spans: Spans, effort: float, most: float) -> tuple[int, float]:
        """Return the sign that is proved for all values in the spans, else 0, and what it took.

        Boxes are split while that takes no more than an effort; at first it may take the `most`.
        """
        looking = 0.0
        for known in self._columns:
            columns = known.within(_intervals(spans))
            looking += PLACES**3 * self._size
            counts = columns.counts()
            if counts and math.prod(counts) * A_BOX * self._size > most:
                return 0, looking
            if counts:
                sign, rounds = _sign_in_boxes(columns, self._first_boxes(counts), effort)
                return sign, looking + columns.spent + rounds * A_ROUND * self._size
        return 0, looking

    @cached_property
    def _size(self) -> int:
        # of a piecewise polynomial each coefficient takes an operation
        return sum(max(1, len(node.args)) for node in walk(sum(self._derivatives, ())))

    def _first_boxes(self, counts: tuple[int, ...]) -> tuple[Array, Array]:
        axes = []
        for inner, n in zip(self._breaks, counts, strict=True):
            even = [x for x in np.arange(1, n) / n if not any(abs(x - y) < 1e-3 for y in inner)]
            axes.append(np.array(sorted([0.0, *inner, *even, 1.0])))
        low, high = (
            np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, 3)
            for ends in ([a[:-1] for a in axes], [a[1:] for a in axes])
        )
        return low, high


def _intervals(spans: Spans) -> dict[str, Interval]:
    return {name: enclosed_range(*limits) for name, limits in spans}


def _sign_in_boxes(columns: Columns, boxes: tuple[Array, Array], effort: float) -> tuple[int, int]:
    """Return the sign, 0 for none, and in how many rounds of boxes."""
    low, high = boxes
    signs: set[int] = set()
    for rounds in count():
        if not len(low):
            break
        narrow = (high - low).min() < NARROWEST
        if columns.spent > effort or len(low) > MOST_BOXES or narrow:
            return 0, rounds
        regular, blame, sign = columns.test(low, high)
        signs |= set(sign[regular].tolist())
        left = blame[~regular]
        own, others = left[:, :3].max(axis=1, initial=0.0), left[:, 3:].sum(axis=1)
        if len(signs) > 1 or np.any((others >= 1) & (others >= own)):
            return 0, rounds + 1
        low, high = split(low[~regular], high[~regular], left[:, :3])
    return (signs.pop() if len(signs) == 1 else 0), rounds
