"""Tables as functions of the language: of scalars to a scalar or to a point."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import isfinite
from typing import TYPE_CHECKING, Any

from pc2cad.equation.points import Combination, Value, point
from pc2cad.errors import InputError
from pc2cad.expression.exact import exact
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.table_rules import TableError
from pc2cad.expression.tree import Expr, Number, as_expr

if TYPE_CHECKING:
    from pc2cad.expression.tables import Tabulated


@dataclass(frozen=True)
class TableFunction:
    """A table that is called with a scalar per list of places."""

    table: Tabulated

    @property
    def arity(self) -> int:
        """Number of arguments."""
        return self.table.arity

    @property
    def is_point(self) -> bool:
        """Whether its values are points."""
        return bool(self.table.coefficients.shape[-1] == 3)

    def __call__(self, *arguments: Expr | Number) -> Value:
        """Return the scalar or the point there."""
        if len(arguments) != self.arity:
            raise InputError(
                f"{self.table.name} takes {self.arity} numbers, here are {len(arguments)}"
            )
        found = self.table(*map(as_expr, arguments))
        return point(*found) if self.is_point else found[0]


def function(
    name: str,
    at: Sequence[Sequence[Any]],
    values: Sequence[Any],
    kind: str,
    periodic: Sequence[bool],
    ends: Sequence[Any] | None = None,
) -> TableFunction:
    """Return the function through numbers, or points, at places; raise TableError."""
    # numbers in arrays are dear to load: most templates have no tables
    from pc2cad.expression.tables import tabulate

    places = [[_fraction(x, "a place") for x in _listed(row)] for row in _listed(at)]
    depth = len(places)
    net = _net(values, depth)
    found: list[Any] | None = None
    if ends is not None:
        found = [_entry(slope) for slope in _listed(ends)]
        if len(found) != 2:
            raise TableError("ends are two slopes, at the first and at the last place")
    widths = {len(entry) for entry in _entries([net, *([found] if found else [])], depth)}
    if len(widths) != 1 or not widths <= {1, 3}:
        raise TableError("the values of a table are all numbers, or all points [x, y, z]")
    return TableFunction(tabulate(name, places, net, kind, tuple(periodic), found))


def _listed(values: Any) -> list[Any]:
    if isinstance(values, str) or not hasattr(values, "__len__"):
        raise TableError("the places of a table are a list of numbers, its values a list of lists")
    return list(values)


def _net(values: Any, depth: int) -> Any:
    if depth == 0:
        return _entry(values)
    return [_net(inner, depth - 1) for inner in _listed(values)]


def _entry(value: Any) -> list[Fraction]:
    """Return the components of one value."""
    if isinstance(value, Combination):
        return [_fraction(c, "a value") for c in value.coordinates]
    if hasattr(value, "__len__") and not isinstance(value, str):
        return [_fraction(c, "a value") for c in value]
    return [_fraction(value, "a value")]


def _entries(nets: Sequence[Any], depth: int) -> list[list[Fraction]]:
    first, *ends = nets
    for _ in range(depth - 1):
        first = [entry for row in first for entry in row]
    return [*first, *(entry for slopes in ends for entry in slopes)]


def _fraction(value: Any, role: str) -> Fraction:
    """Return a number exactly; a float means the decimal that it prints as."""
    if hasattr(value, "item") and type(value).__module__ == "numpy":
        value = value.item()
    if isinstance(value, Expr):
        if value.symbols:
            raise TableError(f"{role} of a table is a number, and {value!r} was given")
        value = value.payload if value.op == "number" else evaluate(value, {})
    if isinstance(value, bool) or not isinstance(value, (int, float, Fraction)):
        raise TableError(f"{role} of a table is a number, and {value!r} was given")
    if isinstance(value, float) and not isfinite(value):
        raise TableError(f"{role} of a table is {value!r}, not a finite number")
    return value if isinstance(value, Fraction) else Fraction(exact(value))


def table(
    at: Sequence[Number],
    values: Sequence[Any],
    kind: str = "cubic",
    ends: Sequence[Any] | None = None,
    periodic: bool = False,
) -> Callable[[Expr | Number], Value]:
    """Return the function of one number through values at ascending places.

    Values are numbers, or points (x, y, z). `kind` is ``linear``, ``pchip``, ``akima`` or ``cubic``
    (continuous second derivatives; natural ends, or the slopes `ends`). A periodic one ends where
    it begins. Beyond its places a table has no values. Raises TableError.
    """
    return function("table", [at], values, kind, [periodic], ends)


def net(
    at: Sequence[Sequence[Number]],
    values: Sequence[Any],
    kind: str = "cubic",
    periodic: Sequence[bool] | bool = False,
) -> Callable[..., Value]:
    """Return the function of two or three numbers through a net of numbers or of points.

    `at` has a list of places per argument, and `values` is nested alike, ``values[i][j]`` at
    ``at[0][i]`` and ``at[1][j]``. Through points it is a surface, or a solid. See `table`.
    """
    turns = [periodic] * len(at) if isinstance(periodic, bool) else list(periodic)
    return function("net", at, values, kind, turns)
