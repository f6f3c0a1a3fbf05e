"""How far det J is from changing its sign at some values of parameters, by samples.

Samples decide what is halved first, and where no proof is tried; they prove nothing.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.evaluation import Program
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import Expr
from pc2cad.solidity.jacobian_proof.factors import Spans

#: where det J is looked at first, u, v and w of a grid, and how often the step is halved then
_INNER = (np.arange(7) + 0.5) / 7
_STEPS = 8
#: parameters up to which all corners of a box are looked at
_MOST_CORNERS = 4
#: a value below this share of the largest is rounding
_NOISE = 1e-7


class Margins:
    """det J at places of the box, for some values of the parameters."""

    def __init__(self, derivatives: tuple[tuple[Expr, ...], ...], names: tuple[str, ...]) -> None:
        self._names = names
        self._program = Program(sum(derivatives, ()))
        self._grid = np.stack(np.meshgrid(_INNER, _INNER, _INNER, indexing="ij")).reshape(3, -1)
        self._around = np.array(list(product((-1.0, 0.0, 1.0), repeat=3))).T

    def look(self, spans: Spans, whole: Spans) -> tuple[bool, str]:
        """Return whether folds are seen at all values that are looked at, and what to halve.

        That is the parameter with which det J changes most from limit to limit, against its largest
        value, and which has been halved least.
        """
        middle = [float(low + high) / 2 for _, (low, high) in spans]
        limits = [tuple(map(float, row)) for _, row in spans]
        ends = [[*middle[:k], x, *middle[k + 1 :]] for k, row in enumerate(limits) for x in row]
        corners = list(product(*limits)) if len(spans) <= _MOST_CORNERS else []
        values = np.array([*ends, middle, *map(list, corners)])
        volumes = self._volumes(self._grid[:, None, :], values)
        largest = np.maximum(np.abs(volumes).max(axis=1, keepdims=True), 1e-300)
        volumes /= largest
        changes = np.abs(volumes[1 : len(ends) : 2] - volumes[: len(ends) : 2]).max(axis=1)
        shares = [
            float((b - a) / (d - c)) for (_, (a, b)), (_, (c, d)) in zip(spans, whole, strict=True)
        ]
        worst = int(np.argmax(changes * shares)) if changes.any() else int(np.argmax(shares))
        return self._is_folded(volumes, values, largest), spans[worst][0]

    def _is_folded(self, volumes: Array, values: Array, largest: Array) -> bool:
        """Say whether det J is found to have two signs for each value."""
        sign = np.where(np.sign(volumes).sum(axis=1) < 0, -1.0, 1.0)[:, None]
        place = self._grid[:, (sign * volumes).argmin(axis=1)]
        least, step = (sign * volumes).min(axis=1), 0.5 / len(_INNER)
        for _ in range(_STEPS):
            if np.all(least < -_NOISE):
                return True
            near = np.clip(place[:, :, None] + step * self._around[:, None, :], 0.0, 1.0)
            found = sign * self._volumes(near, values) / largest
            best = found.argmin(axis=1)
            place = np.take_along_axis(near, best[None, :, None], axis=2)[:, :, 0]
            least, step = np.minimum(least, found.min(axis=1)), step / 2
        return bool(np.all(least < -_NOISE))

    def _volumes(self, places: Array, values: Array) -> Array:
        """Return det J at places (3, 1 or values, n), (values, n); 0 where it is not finite."""
        given = dict(zip(PARAMETERS, places, strict=True))
        given |= {name: values[:, k, None] for k, name in enumerate(self._names)}
        shape = np.broadcast_shapes(places.shape[1:], (len(values), 1))
        with np.errstate(all="ignore"):
            found = [np.broadcast_to(x, shape) for x in self._program(given)]
            a, b, c = np.stack(found).reshape(3, 3, *shape)
            volumes = (a * np.cross(b, c, axis=0)).sum(axis=0)
        return np.where(np.isfinite(volumes), volumes, 0.0)
