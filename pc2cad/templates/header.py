"""What all templates have: words, parameters with their ranges, and points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

from pc2cad.equation.language import nearest, read_expression
from pc2cad.equation.points import Combination, Value
from pc2cad.errors import InputError
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, Number, as_expr


class TemplateError(InputError):
    """A template is not as the format asks; the message names file, key and column."""


class ParameterRangeError(InputError):
    """A parameter's value is outside the range its template allows."""


@dataclass(frozen=True)
class Parameter:
    """A scalar that a user may set: its default, its range (None: open) and its meaning."""

    name: str
    default: Expr
    minimum: Expr | None = None
    maximum: Expr | None = None
    about: str = ""

    @property
    def limits(self) -> tuple[float, float]:
        """Its least and its largest value."""
        low = evaluate(self.minimum, {}) if self.minimum else float("-inf")
        high = evaluate(self.maximum, {}) if self.maximum else float("inf")
        return low, high


@dataclass(frozen=True)
class Definition:
    """A named value of the template: its text as written and what it means."""

    name: str
    text: str
    value: Value


#: what may stand for a template's point: text, a point, or three coordinates
Moved = str | Combination | Sequence[Expr | Number]


@dataclass(frozen=True, repr=False)
class Header:
    """What every template has: its words, its unit, its parameters and its points."""

    name: str
    title: str
    about: str
    source: str
    units: str
    parameters: tuple[Parameter, ...]
    points: tuple[Definition, ...]

    def __repr__(self) -> str:
        given = ", ".join(f"{p.name}={p.default}" for p in self.parameters)
        return (
            f"<{type(self).__name__} {self.name}: {'; '.join(filter(None, (self.title, given)))}>"
        )

    def values(self, values: Mapping[str, Any] | None) -> tuple[dict[str, Expr], dict[str, Moved]]:
        """Return the value of every parameter and what moves points, checked as `bind` does."""
        moved, rest = self.split(values or {})
        given = {name: _constant(name, value) for name, value in rest.items()}
        known = [p.name for p in self.parameters]
        self._check_names(given, [*known, *(p.name for p in self.points)], "parameter")
        bound = {p.name: given.get(p.name, p.default) for p in self.parameters}
        for parameter in self.parameters:
            _check_range(parameter, bound[parameter.name])
        return bound, moved

    def split(self, values: Mapping[str, Any]) -> tuple[dict[str, Moved], dict[str, Any]]:
        """Return what moves points and what sets parameters, told apart by the names."""
        points = {p.name for p in self.points}
        moved = {name: value for name, value in values.items() if name in points}
        return moved, {name: value for name, value in values.items() if name not in points}

    def _check_names(self, given: Mapping[str, Any], known: list[str], what: str) -> None:
        for name in given:
            if name not in known:
                listed = ", ".join(known) or "none"
                raise InputError(
                    f"{self.name} has no {what} '{name}' (it has: {listed}){nearest(name, known)}"
                )


def _constant(name: str, value: Number | str | Expr) -> Expr:
    if isinstance(value, str):
        try:
            read = read_expression(value, {})
        except InputError as error:
            raise InputError(f"the value '{value}' of parameter {name}: {error}") from error
        if not isinstance(read, Expr):
            raise InputError(f"the value of parameter {name} must be a number, not a point")
        value = read
    if isinstance(value, bool) or not isinstance(value, (Real, Expr)):
        raise InputError(f"the value of parameter {name} must be a number")
    tree = as_expr(value)
    if tree.symbols:
        raise InputError(f"the value of parameter {name} must be constant")
    return tree


def _check_range(parameter: Parameter, value: Expr) -> None:
    number, (low, high) = evaluate(value, {}), parameter.limits
    if not low <= number <= high:
        allowed = (
            f"from {low:g} to {high:g}" if parameter.minimum and parameter.maximum
            else f"{low:g} or more" if parameter.minimum else f"{high:g} or less"
        )  # fmt: skip
        raise ParameterRangeError(
            f"the parameter {parameter.name} = {number:g} is outside its range: {allowed}"
        )
