"""A template: one solid with parameters that a user may set."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from math import isfinite
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from pc2cad.equation.family import Family
from pc2cad.equation.fields import make_field
from pc2cad.equation.language import Listed, nearest, read_expression
from pc2cad.equation.point_equation import (
    Expectations,
    Interval,
    PointEquation,
    Written,
    check_point,
    interval,
    over_unit_box,
)
from pc2cad.equation.points import Combination, Value
from pc2cad.equation.variation import Variation
from pc2cad.errors import InputError
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, Number, as_expr, substitute, symbol

if TYPE_CHECKING:
    from pc2cad.channels.frames import Frame
    from pc2cad.channels.guides import Guide


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


#: what [expect] may state that is no count
MEASURED: Final = frozenset(("volume", "area", "centroid"))
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


@dataclass(frozen=True, repr=False)
class Template(Header):
    """A template as read: every expression is a tree in its parameters and u, v, w."""

    #: functions that [curves] and [tables] define
    curves: Mapping[str, Any]
    #: lists of [data]
    data: Mapping[str, Listed]
    guide: Guide | None
    frame: Frame | None
    #: the points that [guide] and [frame] define: N, and R and Q
    carried: tuple[Definition, ...]
    #: thicknesses from w = 0 up, of a part in layers
    layers: tuple[Definition, ...]
    lets: tuple[Definition, ...]
    domain: tuple[Interval, Interval, Interval]
    #: M, or x, y and z, as written
    solid: tuple[Definition, ...]
    M: Combination
    #: what varies over the solid beside its shape
    fields: tuple[Definition, ...]
    #: name of the figure -> the tree that states it (three for the centroid)
    expected: Mapping[tuple[str, ...], tuple[Expr, ...]]

    #: reads the template again with values for its parameters and other points
    _again: Callable[..., Template] = field(repr=False)
    #: the values and points that it was read with
    _given: tuple[Mapping[str, Expr], Mapping[str, Moved]] = field(repr=False)
    #: parameters whose values the reading asked for, and did not leave symbols
    consumed: frozenset[str] = field(default=frozenset(), repr=False)

    def __reduce__(self) -> tuple[Callable[..., Template], tuple[Any, ...]]:
        return self._again, self._given  # curves are functions, which do not pickle

    def move(self, points: Mapping[str, Moved]) -> Template:
        """Return the template with some of its points replaced by current points.

        A point is three coordinates that may depend on u, v, w and the parameters, as text
        (``"[4+u, 0, 0]"``, ``"A + vector(0, 0, u)"`` with the template's own A), as a point or as
        a sequence. The equation stays as it is; derivatives in it see the moving point. What
        [expect] states of the points as they were is dropped. Raises TemplateError or InputError.
        """
        self._check_names(points, [p.name for p in self.points], "point")
        return self._again({}, points)

    def bind(
        self, values: Mapping[str, Number | str | Expr | Moved] | None = None
    ) -> PointEquation:
        """Return the point equation with these parameter values (the defaults elsewhere).

        A value is a number or the text of a constant expression such as ``1/3``; the name of a
        point takes what `move` takes. Raises InputError for an unknown name, and
        ParameterRangeError outside min…max.
        """
        bound, moved = self.values(values)
        # what has no parameters has been read with all of them already
        whole = not (bound or moved or any(self._given))
        known = None if whole or moved else self._figures(bound)
        read = self if whole else self._again(bound, moved, expects=known is None)
        equation = read._equation(bound, partial(self._bind_moved, values or {}))
        changes: dict[str, Any] = {} if known is None else {"expectations": known}
        if bound:
            changes["freer"] = partial(self._freed, bound, moved)
        return replace(equation, **changes) if changes else equation

    def family(
        self, names: Sequence[str], values: Mapping[str, Number | str | Expr | Moved] | None = None
    ) -> Family:
        """Return the equation with some parameters left free, and the others as `bind` has them.

        Raises InputError for a name of no parameter, for one that has a value, and where the way to
        M asks for the value of one, as a guide does that is given by numbers.
        """
        bound, moved = self.values(values)
        self._check_names(dict.fromkeys(names), [p.name for p in self.parameters], "parameter")
        both = sorted(set(names) & set(values or {}))
        if both:
            raise InputError(
                f"the parameter {both[0]} of {self.name} is set, and left free as well"
            )
        fixed = {name: value for name, value in bound.items() if name not in names}
        read = self._again(fixed, moved, expects=False)
        asked = sorted(read.consumed & set(names))
        if asked:
            raise InputError(
                f"the parameter {asked[0]} of {self.name} cannot be left free: the way to M asks "
                "for its value, as a guide does that is given by numbers"
            )
        M = read.frame.shifted(read.M) if read.frame else read.M
        x, y, z = substitute(M.coordinates, over_unit_box(read.domain))
        return Family(self.name, tuple(names), fixed, (x, y, z), read.domain)

    def _figures(self, bound: Mapping[str, Expr]) -> Expectations | None:
        """Return what [expect] states at some values of the parameters, if it is told by its trees.

        Not so where the reading asked for values, or a count depends on them: it is whole, exactly.
        """
        depend = [name for (name, *_), trees in self.expected.items() for x in trees if x.symbols]
        if self.consumed or any(self._given) or not MEASURED.issuperset(depend):
            return None
        figures = expectations(self.expected, {n: evaluate(x, {}) for n, x in bound.items()})
        told = figures.volume, figures.area, *(figures.centroid or ())
        return figures if all(x is None or isfinite(x) for x in told) else None

    def _freed(self, bound: Mapping[str, Expr], moved: Mapping[str, Moved], name: str) -> Variation:
        """Return how the equation changes with one of its parameters."""
        read = self._again(bound, moved, name)
        coordinates = None
        if name not in read.consumed:
            M = read.frame.shifted(read.M) if read.frame else read.M
            x, y, z = substitute(M.coordinates, over_unit_box(read.domain))
            coordinates = x, y, z

        def at(value: Expr) -> PointEquation:
            values = {**bound, name: value}
            return self._again(values, moved)._equation(values, partial(self._bind_moved, values))

        fields = {
            d.name: d.value.coordinates if isinstance(d.value, Combination) else (d.value,)
            for d in read.fields
        }
        return Variation(name, bound[name], coordinates, at, read.domain, fields)

    def _bind_moved(self, values: Mapping[str, Any], points: Mapping[str, Moved]) -> PointEquation:
        self._check_names(points, [p.name for p in self.points], "point")
        return self.bind({**values, **points})

    def _equation(
        self, bound: dict[str, Expr], mover: Callable[[Mapping[str, Moved]], PointEquation]
    ) -> PointEquation:
        """Return the equation of a template that was read with all its parameters bound."""
        M = self.frame.shifted(self.M) if self.frame else self.M
        check_point(M)
        u, v, w = (interval(p, d) for p, d in zip(PARAMETERS, self.domain, strict=True))
        equation = PointEquation(
            M.coordinates,
            (u, v, w),
            name=self.name,
            title=self.title,
            about=self.about,
            source=self.source,
            units=self.units,
            parameters={name: evaluate(value, {}) for name, value in bound.items()},
            expectations=expectations(self.expected),
            guide=self.guide.N.coordinates if self.guide else None,
            frame=f"{self.frame.words}; guide: {self.guide.words}"
            if self.frame and self.guide
            else "",
            fields=tuple(make_field(d.name, d.value) for d in self.fields),
            written=self._sums,
            mover=mover,
        )
        if not self.layers:
            return equation
        from pc2cad.channels.layers import depth

        below = depth([layer.value for layer in self.layers if isinstance(layer.value, Expr)])
        return equation.layered([layer.name for layer in self.layers], below(symbol("w")))

    def _sums(self) -> tuple[Written, ...]:
        """Return the sums of points that M is written as."""
        if self.frame or len(self.solid) > 1:
            return ()
        from pc2cad.templates.forms import written_sums

        named = (*self.points, *self.lets)
        known = {d.name: d.value for d in named if isinstance(d.value, Combination)}
        return written_sums(self.solid[0].text, known)


def expectations(
    expected: Mapping[tuple[str, ...], tuple[Expr, ...]],
    values: Mapping[str, float] = MappingProxyType({}),
) -> Expectations:
    """Return the figures that trees state, by their keys in [expect], at values of parameters."""
    figures: dict[str, Any] = {}
    for (name, *below), trees in expected.items():
        numbers = tuple(evaluate(tree, values) for tree in trees)
        if name == "centroid":
            figures[name] = numbers
        elif below:
            figures.setdefault(name, {})[below[0]] = round(numbers[0])
        else:
            whole = name not in MEASURED
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
    number, (low, high) = evaluate(value, {}), parameter.limits
    if not low <= number <= high:
        allowed = (
            f"from {low:g} to {high:g}" if parameter.minimum and parameter.maximum
            else f"{low:g} or more" if parameter.minimum else f"{high:g} or less"
        )  # fmt: skip
        raise ParameterRangeError(
            f"the parameter {parameter.name} = {number:g} is outside its range: {allowed}"
        )
