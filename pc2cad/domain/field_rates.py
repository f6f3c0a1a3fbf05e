"""How a scalar field of the solid changes with a parameter, at a point that moves along."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.fields import LocalField
from pc2cad.domain.velocity import NotDifferentiableError, at_its_value
from pc2cad.equation.fields import COORDINATES, SYMBOLS
from pc2cad.equation.variation import Variation
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.evaluation import Program
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, number, substitute, symbol, walk

#: operations that jump where their operands pass some value
_JUMPS: Final = ("where", "floor", "sign", "mod")
#: the parameter in a field, which knows coordinates that it may share its name with
_FREE: Final = "_free"


class FieldRate:
    """A density and its derivative: ∂f/∂p + ∂f/∂(u, v, w) of limits that move + ∇f · V."""

    def __init__(self, field: LocalField, variation: Variation, largest: float) -> None:
        #: what values are shares of
        self.largest = largest
        self._map, self._field = field.map, field
        (tree,) = _free(field, variation)
        moving = {_FREE, *COORDINATES}
        rows = []
        for p, pair in zip(PARAMETERS, variation.domain, strict=True):
            ends = [evaluate(limit, {}) for limit in at_its_value(variation, pair)]
            along = at_its_value(variation, derivatives(pair, variation.name))
            rows.append((*ends, *(evaluate(limit, {}) for limit in along)))
            if any(rows[-1][2:]):
                moving.add(p)
        #: limits of u, v and w, and how these change, one a column
        self._limits = np.array(rows).T
        _check_jumps(tree, moving, field.field.name, variation.name)
        trees = [derivatives((tree,), name)[0] for name in (_FREE, *SYMBOLS)]
        self._program = Program(at_its_value(variation, tuple(trees), _FREE))

    def __call__(
        self, u: Array, v: Array, w: Array, points: Array, speed: Array
    ) -> tuple[Array, Array]:
        """Return the density and its rate as shares of the largest one, at local places.

        `points` and `speed` are M and V there; shapes as `Mapping3.points` without the last axis.
        """
        local = [np.asarray(x, dtype=float) for x in (u, v, w)]
        own = [self._map.values(d, x) for d, x in enumerate(local)]
        known: Mapping[str, Array] = dict(
            zip(SYMBOLS, (*own, *np.moveaxis(points, -1, 0)), strict=True)
        )
        alone, *slopes = self._program(known)
        rate = np.zeros(points.shape[:-1]) + alone
        low, high, to, by = self._limits
        for d, x in enumerate(own):
            share = (x - low[d]) / (high[d] - low[d])
            rate = rate + slopes[d] * (to[d] + (by[d] - to[d]) * share)
        for k in range(3):
            rate = rate + slopes[3 + k] * speed[..., k]
        value = self._field.at(u, v, w, points)[..., 0]
        return value / self.largest, rate / self.largest


def _free(field: LocalField, variation: Variation) -> tuple[Expr, ...]:
    """Return the field with the parameter left free, `_FREE`; raise NotDifferentiableError."""
    own = field.field.components
    if variation.coordinates is not None:
        free = variation.fields.get(field.field.name)
        return own if free is None else substitute(free, {variation.name: symbol(_FREE)})
    beside = variation.at(number(Fraction(variation.value) * (1 + Fraction(1, 64)) or 1))
    there = [other.components for other in beside.fields if other.name == field.field.name]
    if not there or there[0] != own or beside.domain != variation.at(variation.bound).domain:
        raise NotDifferentiableError(
            f"the mass has no derivative with respect to {variation.name}: a guide takes it as a "
            f"number, and the field {field.field.name} goes with it by itself"
        )
    return own


def _check_jumps(tree: Expr, moving: set[str], field: str, name: str) -> None:
    """Raise NotDifferentiableError where a jump of a field moves in the box."""
    for node in walk((tree,)):
        told = node.args[:1] if node.op == "where" else node.args
        if node.op in _JUMPS and any(arg.symbols & moving for arg in told):
            raise NotDifferentiableError(
                f"the mass has no derivative with respect to {name} that is known: the field "
                f"{field} jumps at places that move with it"
            )
