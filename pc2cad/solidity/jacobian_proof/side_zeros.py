"""Zeros of trees on sides of the box: sampled first, then proved from the trees."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.map import open_grid
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.evaluation import Program
from pc2cad.expression.normal_form import is_identically_zero
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import ONE, ZERO, Expr, ValueDomainError, substitute

#: highest order of a zero on a side
HIGHEST_ORDER = 9
#: a derivative this small on a side, against its size inside, is worth a proof that it vanishes
SUSPECT = 1e-10


def order_of_zero(
    trees: tuple[Expr, ...], d: int, end: int, others: Mapping[str, Array]
) -> int | None:
    """Return the order of the zero of a tangent on a side; None where it is only suspected.

    It is looked for at one value of the other symbols, and proved for all.
    """
    for order in range(HIGHEST_ORDER + 1):
        program = Program(trees)
        inner = np.array([0.1732, 0.4142, 0.7071, 0.8541])
        axes = [inner] * 3
        size = _largest(program, axes, others)
        axes[d] = np.array([float(end)])
        here = _largest(program, axes, others)
        if not math.isfinite(here):
            return None
        if here > SUSPECT * size or not size:
            return order
        try:
            at_side = substitute(trees, {PARAMETERS[d]: ONE if end else ZERO})
        except ValueDomainError:
            return None
        if not all(is_identically_zero(tree) for tree in at_side):
            return None
        trees = derivatives(trees, PARAMETERS[d])
    return None


def _largest(program: Program, axes: Iterable[Array], others: Mapping[str, Array]) -> float:
    values = program({**dict(zip(PARAMETERS, open_grid(*axes), strict=True)), **others})
    return max(float(np.max(np.abs(value))) for value in values)
