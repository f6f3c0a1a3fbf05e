"""A template: one solid with parameters that a user may set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from pc2cad.equation.language import nearest, read_expression
from pc2cad.equation.point_equation import (
    PARAMETERS,
    Expectations,
    Interval,
    PointEquation,
    check_point,
    interval,
)
from pc2cad.equation.points import Combination, Value
from pc2cad.equation.scalar import evaluate
from pc2cad.equation.tree import Expr, Number, as_expr, substitute
from pc2cad.errors import InputError


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


@dataclass(frozen=True)
class Definition:
    """A named value of the template: its text as written and what it means."""

    name: str
    text: str
    value: Value


@dataclass(frozen=True)
class Template:
    """A template as read: every expression is a tree in its parameters and u, v, w."""

    name: str
    title: str
    about: str
    source: str
    units: str
    parameters: tuple[Parameter, ...]
    points: tuple[Definition, ...]
    curves: Mapping[str, Any]
    lets: tuple[Definition, ...]
    domain: tuple[Interval, Interval, Interval]
    #: M, or x, y and z, as written
    solid: tuple[Definition, ...]
    M: Combination
    #: name of the figure -> the tree that states it (three for the centroid)
    expected: Mapping[str, tuple[Expr, ...]]

    def bind(self, values: Mapping[str, Number | str | Expr] | None = None) -> PointEquation:
        """Return the point equation with these parameter values (the defaults elsewhere).

        A value is a number or the text of a constant expression such as ``1/3``. Raises
        InputError for an unknown name, and ParameterRangeError outside min…max.
        """
        given = {name: _constant(name, value) for name, value in (values or {}).items()}
        known = [p.name for p in self.parameters]
        for name in given:
            if name not in known:
                listed = ", ".join(known) or "none"
                raise InputError(
                    f"{self.name} has no parameter '{name}' (it has: {listed})"
                    f"{nearest(name, known)}"
                )
        bound = {p.name: given.get(p.name, p.default) for p in self.parameters}
        for parameter in self.parameters:
            _check_range(parameter, bound[parameter.name])
        M = self.M.substitute(bound)
        check_point(M)
        return PointEquation(
            M.coordinates,
            tuple(
                interval(p, substitute(limits, bound))
                for p, limits in zip(PARAMETERS, self.domain, strict=True)
            ),  # type: ignore[arg-type]
            name=self.name,
            title=self.title,
            about=self.about,
            source=self.source,
            units=self.units,
            parameters={name: evaluate(value, {}) for name, value in bound.items()},
            expectations=self._expectations(bound),
        )

    def _expectations(self, bound: dict[str, Expr]) -> Expectations:
        figures: dict[str, Any] = {}
        for name, trees in self.expected.items():
            numbers = tuple(evaluate(tree, {}) for tree in substitute(trees, bound))
            if name == "centroid":
                figures[name] = numbers
            else:
                whole = name not in ("volume", "area")
                figures[name] = round(numbers[0]) if whole else numbers[0]
        return Expectations(**figures)


def _constant(name: str, value: Number | str | Expr) -> Expr:
    if isinstance(value, str):
        try:
            read = read_expression(value, {})
        except InputError as error:
            raise InputError(f"the value '{value}' of parameter {name}: {error}") from error
        if not isinstance(read, Expr):
            raise InputError(f"the value of parameter {name} must be a number, not a point")
        value = read
    if isinstance(value, bool) or not isinstance(value, (int, float, Fraction, Expr)):
        raise InputError(f"the value of parameter {name} must be a number")
    tree = as_expr(value)
    if tree.symbols:
        raise InputError(f"the value of parameter {name} must be constant")
    return tree


def _check_range(parameter: Parameter, value: Expr) -> None:
    number = evaluate(value, {})
    low = evaluate(parameter.minimum, {}) if parameter.minimum else float("-inf")
    high = evaluate(parameter.maximum, {}) if parameter.maximum else float("inf")
    if not low <= number <= high:
        allowed = (
            f"from {low:g} to {high:g}" if parameter.minimum and parameter.maximum
            else f"{low:g} or more" if parameter.minimum else f"{high:g} or less"
        )  # fmt: skip
        raise ParameterRangeError(
            f"the parameter {parameter.name} = {number:g} is outside its range: {allowed}"
        )
