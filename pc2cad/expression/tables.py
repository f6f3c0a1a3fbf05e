"""Tables: functions through given values, of one argument or as tensors of two or three.

A table is a piecewise polynomial, and so exact: linear, cubic with slopes that keep the shape of
the values (pchip, akima), or the cubic with continuous second derivatives. A tensor takes the same
along each of its arguments; slopes across are the means over the orders in which they are taken.

*Source:* F. N. Fritsch and J. Butland (SIAM J. Sci. Stat. Comput. 5, 1984) for pchip; H. Akima (J.
ACM 17, 1970); C. de Boor, A Practical Guide to Splines, chapter IV, for the others and for tensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Any, Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.ranges import anywhere, within
from pc2cad.expression.table_rules import KINDS, MOST_VALUES, TableError
from pc2cad.expression.table_slopes import akima_slopes, cubic_slopes, pchip_slopes
from pc2cad.expression.tree import Expr, number, pieces

#: order of continuity at the places
_SMOOTHNESS: Final = {"linear": 0, "pchip": 1, "akima": 1, "cubic": 2}
#: coefficients below this share of the largest value are nothing
_NOTHING: Final = 1e-30


@dataclass(frozen=True)
class Tabulated:
    """A table as a function: call it with a scalar per list of places.

    It returns a tuple of trees, one per component: one of numbers, three of points.
    """

    name: str
    places: tuple[tuple[Fraction, ...], ...]
    periodic: tuple[bool, ...]
    smoothness: int
    #: coefficients (powers per argument…, pieces per argument…, components)
    coefficients: Any

    @property
    def arity(self) -> int:
        """Number of arguments."""
        return len(self.places)

    def __call__(self, *arguments: Expr) -> tuple[Expr, ...]:
        """Return the components at some arguments."""
        inside = [
            anywhere(self.name, t) if turns
            else within(self.name, t, places[0], places[-1])
            for t, places, turns in zip(arguments, self.places, self.periodic, strict=True)
        ]  # fmt: skip
        components = self.coefficients.shape[-1]
        return tuple(self._tree(0, self.coefficients[..., c], inside) for c in range(components))

    def _tree(self, axis: int, table: Any, inside: list[Expr]) -> Expr:
        """Return the function of the arguments from one on, as pieces of pieces."""
        if axis == self.arity:
            return number(table)
        rest = self.arity - axis
        powers, count = table.shape[0], table.shape[rest]
        rows = tuple(
            tuple(
                self._tree(axis + 1, np.take(table[k], i, axis=rest - 1), inside)
                for k in range(powers)
            )
            for i in range(count)
        )
        places, closed = self.places[axis], self.periodic[axis]
        return pieces(inside[axis], places, rows, self.smoothness, closed)


def tabulate(
    name: str,
    places: Sequence[Sequence[Fraction]],
    values: Sequence[Any],
    kind: str = "cubic",
    periodic: Sequence[bool] = (False,),
    ends: Sequence[Any] | None = None,
) -> Tabulated:
    """Return the table through values at places.

    `places` has an ascending list per argument; `values` is nested alike, each entry the list of
    the components (exact numbers). `ends` gives the slopes of a cubic of one argument at its ends.
    A periodic one ends where it begins. Raises TableError.
    """
    if kind not in KINDS:
        raise TableError(f"unknown kind '{kind}' of table; use one of {', '.join(KINDS)}")
    exact = _checked(places, values, periodic)
    if ends is not None and (kind != "cubic" or len(places) > 1 or periodic[0]):
        raise TableError("ends are slopes of a cubic table of one argument that is not periodic")
    if kind == "linear":
        table = exact.reshape((1,) * len(places) + exact.shape)
        for axis, row in enumerate(places):
            table = _lines(table, axis, len(places) + axis, np.array(row, dtype=object))
        return Tabulated(name, _tuples(places), tuple(periodic), 0, table)
    jets = _jets(kind, places, exact.astype(float), periodic, ends)
    for axis, row in enumerate(places):
        jets = _hermite(jets, axis, len(places) + axis, np.array([float(x) for x in row]))
    jets[np.abs(jets) < _NOTHING * np.abs(jets).max()] = 0.0
    fractions = np.vectorize(Fraction, otypes=[object])(jets)
    return Tabulated(name, _tuples(places), tuple(periodic), _SMOOTHNESS[kind], fractions)


def _tuples(places: Sequence[Sequence[Fraction]]) -> tuple[tuple[Fraction, ...], ...]:
    return tuple(tuple(row) for row in places)


def _checked(
    places: Sequence[Sequence[Fraction]], values: Sequence[Any], periodic: Sequence[bool]
) -> Any:
    """Return the values as an array of exact numbers, (places…, components)."""
    if not 1 <= len(places) <= 3:
        raise TableError(f"a table has one to three lists of places, here are {len(places)}")
    if len(periodic) != len(places):
        raise TableError(f"periodic is said of {len(periodic)} arguments of {len(places)}")
    for row, turns in zip(places, periodic, strict=True):
        least = 3 if turns else 2
        if len(row) < least:
            raise TableError(f"a table has at least {least} places along each argument")
        for i in range(1, len(row)):
            if not row[i - 1] < row[i]:
                before, here = float(row[i - 1]), float(row[i])
                raise TableError(
                    f"at ascends, and {here:g} follows {before:g} as number {i + 1} of its list"
                )
    _check_net(values, [len(row) for row in places], "values")
    table = np.array(values, dtype=object)
    if table.size > MOST_VALUES:
        raise TableError(f"the table has {table.size} numbers, and at most {MOST_VALUES} are read")
    for axis, turns in enumerate(periodic):
        if turns:
            first, last = table.take(0, axis), table.take(-1, axis)
            if (first != last).any():
                raise TableError(
                    "a periodic table ends as it begins: its last values are its first ones, at "
                    "the place where the period ends"
                )
    return table


def _check_net(values: Any, counts: list[int], what: str) -> None:
    if not counts:
        return
    if not isinstance(values, (list, tuple)) or len(values) != counts[0]:
        found = len(values) if isinstance(values, (list, tuple)) else "none"
        raise TableError(f"{what} has {found} entries for {counts[0]} places of at")
    for i, inner in enumerate(values):
        _check_net(inner, counts[1:], f"row {i + 1} of {what}" if what == "values" else what)


# -- coefficients ----------------------------------------------------------------------------------


def _lines(jets: Any, order: int, axis: int, places: Any) -> Any:
    """Return value and slope of the lines along one argument, exact (see `_hermite`)."""
    table = np.moveaxis(jets, (order, axis), (0, 1))
    h = np.diff(places).reshape(-1, *(1,) * (table.ndim - 2))
    first = table[0, :-1]
    return np.moveaxis(np.stack((first, (table[0, 1:] - first) / h)), (0, 1), (order, axis))


def _jets(
    kind: str,
    places: Sequence[Sequence[Fraction]],
    values: Array,
    periodic: Sequence[bool],
    ends: Sequence[Any] | None,
) -> Array:
    """Return values and slopes, (2 per argument…, places…, components)."""
    count = len(places)
    jets = np.zeros((2,) * count + values.shape)
    rows = [np.array([float(x) for x in row]) for row in places]
    for orders in sorted(product((0, 1), repeat=count), key=sum):
        ways = [
            _slopes(kind, rows[k], jets[(*orders[:k], 0, *orders[k + 1 :])], k, periodic[k], ends)
            for k in range(count)
            if orders[k]
        ]
        jets[orders] = np.mean(ways, axis=0) if ways else values
    return jets


def _slopes(
    kind: str, places: Array, values: Array, axis: int, closed: bool, ends: Sequence[Any] | None
) -> Array:
    table = np.moveaxis(values, axis, 0)
    h, flat = np.diff(places), table.reshape(len(places), -1)
    rise = np.diff(flat, axis=0) / h[:, None]
    if kind == "cubic":
        limits = None if ends is None else np.array(ends, dtype=object).astype(float).reshape(2, -1)
        found = cubic_slopes(h, rise, closed, limits)
    else:
        found = (pchip_slopes if kind == "pchip" else akima_slopes)(h, rise, closed)
    return np.moveaxis(found.reshape(table.shape), 0, axis)


def _hermite(jets: Array, order: int, axis: int, places: Array) -> Array:
    """Return powers in the place of values and slopes along one argument, pieces for places."""
    table = np.moveaxis(jets, (order, axis), (0, 1))
    h = np.diff(places).reshape(-1, *(1,) * (table.ndim - 2))
    (p, q), (a, b) = (table[0, :-1], table[0, 1:]), (table[1, :-1], table[1, 1:])
    rise = (q - p) / h
    powers = np.stack((p, a, (3 * rise - 2 * a - b) / h, (a + b - 2 * rise) / h**2))
    return np.moveaxis(powers, (0, 1), (order, axis))
