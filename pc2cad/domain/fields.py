"""Fields on the map: their values at places of the box, and their trees over it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import Mapping3, open_grid
from pc2cad.equation.fields import SYMBOLS, Field
from pc2cad.errors import InputError, NotASolidError
from pc2cad.expression.breaks import find_breaks
from pc2cad.expression.evaluation import Program
from pc2cad.expression.kinks import take_kinks_apart
from pc2cad.expression.simplification import simplified
from pc2cad.expression.tree import Expr, substitute


class FieldNotFiniteError(InputError):
    """A field has no finite value somewhere in the solid."""


@dataclass(frozen=True, eq=False)
class LocalField:
    """One field over the unit box of one map."""

    map: Mapping3
    field: Field

    def at(self, u: ArrayLike, v: ArrayLike, w: ArrayLike, points: Array | None = None) -> Array:
        """Return the components, shape broadcast(u, v, w) + (k,), at local parameters.

        `points` are M's there, where they are known already.
        """
        local = [np.asarray(x, dtype=float) for x in (u, v, w)]
        places = self.map.points(*local) if points is None else points
        own = [self.map.values(d, x) for d, x in enumerate(local)]
        known = dict(zip(SYMBOLS, (*own, *np.moveaxis(places, -1, 0)), strict=True))
        shape = places.shape[:-1]
        found = [np.broadcast_to(value, shape) for value in self._program(known)]
        return np.stack(found, axis=-1)

    def checked_at(self, places: Array, points: Array | None = None) -> Array:
        """Return the components (n, k) at local places (n, 3); raise FieldNotFiniteError.

        `points` (n, 3) are M's there, where they are known already.
        """
        u, v, w = places.T
        values = self.at(u, v, w, points)
        bad = np.flatnonzero(~np.isfinite(values).all(axis=-1))
        if len(bad):
            raise FieldNotFiniteError(
                f"the field {self.field.name} has no finite value at "
                f"{self.map.shown(places[bad[0]])}: a division by zero, the root or logarithm of "
                "a negative number, or a table that ends before"
            )
        return values

    @cached_property
    def _program(self) -> Program:
        return Program(self.field.components)

    @cached_property
    def trees(self) -> tuple[Expr, ...]:
        """The components as trees of the local parameters."""
        change = dict(zip(SYMBOLS, (*self.map.parameters, *self.map.coordinates), strict=True))
        trees = substitute(self.field.components, change)
        # kinks along curves of the box are refused: no break is at a value of one parameter
        with suppress(InputError):
            trees = take_kinks_apart(trees, self.map.parameters)
        return simplified(trees)

    @cached_property
    def breaks(self) -> tuple[tuple[float, ...], ...]:
        """Where formulas change, per direction, in local parameters."""
        try:
            found = find_breaks(self.trees)
        except (InputError, NotASolidError):
            return ((), (), ())
        return tuple(tuple(b.position for b in row if 0 < b.position < 1) for row in found)


def local_field(analysis: Analysis, name: str) -> LocalField:
    """Return a field of the equation over the unit box; raise InputError for a name of none."""
    return LocalField(analysis.map, analysis.equation.field(name))


def looked_at(analysis: Analysis, field: LocalField, inside: int = 9) -> Array:
    """Return places (n, 3) of every smooth piece of the box, its limits included."""
    rows = []
    for d in range(3):
        limits = sorted({*analysis.bounds[d], *field.breaks[d]})
        parts = [np.linspace(a, b, inside) for a, b in pairwise(limits)]
        rows.append(distinct(np.concatenate(parts)))
    grid = np.broadcast_arrays(*open_grid(*rows))
    return np.stack([g.ravel() for g in grid], axis=1)
