"""A template: one solid with parameters that a user may set."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from math import isfinite
from typing import TYPE_CHECKING, Any, Final

from pc2cad.equation.family import Family
from pc2cad.equation.fields import make_field
from pc2cad.equation.language import Listed, check_constants
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
from pc2cad.expression.substitution import Substitution
from pc2cad.expression.tree import Expr, Number, substitute, symbol, walk
from pc2cad.templates.header import Definition, Header, Moved, TemplateError

if TYPE_CHECKING:
    from pc2cad.channels.frames import Frame
    from pc2cad.channels.guides import Guide


#: what [expect] may state that is no count
MEASURED: Final = frozenset(("volume", "area", "centroid"))
#: readings of one template that are remembered: a guide by numbers is found anew in each
MOST_READINGS: Final = 8


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
        return self._with({}, points)

    def bind(
        self, values: Mapping[str, Number | str | Expr | Moved] | None = None
    ) -> PointEquation:
        """Return the point equation with these parameter values (the defaults elsewhere).

        A value is a number or the text of a constant expression such as ``1/3``; the name of a
        point takes what `move` takes. Raises InputError for an unknown name, and
        ParameterRangeError outside min…max.
        """
        bound, moved = self.values(values)
        mover = partial(self._bind_moved, values or {})
        equation = self._with(bound, moved)._equation(bound, mover)
        return replace(equation, freer=partial(self._freed, bound, moved)) if bound else equation

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
        read = self._with(fixed, moved)
        asked = sorted(read.consumed & set(names))
        if asked:
            raise InputError(
                f"the parameter {asked[0]} of {self.name} cannot be left free: the way to M asks "
                "for its value, as a guide does that is given by numbers"
            )
        return Family(self.name, tuple(names), fixed, read._over_unit_box(), read.domain)

    def _over_unit_box(self) -> tuple[Expr, Expr, Expr]:
        """Return x, y and z over the unit box."""
        M = self.frame.shifted(self.M) if self.frame else self.M
        x, y, z = substitute(M.coordinates, over_unit_box(self.domain))
        return x, y, z

    def _with(
        self, values: Mapping[str, Expr], moved: Mapping[str, Moved], free: str = ""
    ) -> Template:
        """Return the template with values for parameters, but for a free one, and other points.

        Values are put into the trees that were read. It is read again for other points, for other
        values of what reading asks for, and where they do not fit: then it says where.
        """
        points = {**self._given[1], **moved}
        if not values:
            return self._reading({}, points, free) if moved else self
        with suppress(InputError):
            read = self._reading({}, points, free) if moved else self
            known, asked = {p.name: p.default for p in self.parameters}, dict[str, Expr]()
            while more := {
                n: x for n, x in values.items() if n in read.consumed and known[n] is not x
            }:
                known |= more
                asked |= more
                read = self._reading(asked, points, free)
            return read._put({name: value for name, value in values.items() if name != free})
        return self._again(values, points, free)

    def _reading(
        self, asked: Mapping[str, Expr], points: Mapping[str, Moved], free: str
    ) -> Template:
        """Return the template as read with what it asks for: the last few are remembered."""
        texts = {name: place for name, place in points.items() if isinstance(place, str)}
        if texts.keys() != points.keys():
            return self._again(asked, points, free)
        key = tuple(sorted(asked.items())), tuple(sorted(texts.items()))
        return self._readings(*key, free if free in asked else "")

    @cached_property
    def _readings(self) -> Callable[..., Template]:
        return lru_cache(maxsize=MOST_READINGS)(
            lambda asked, texts, free: self._again(dict(asked), dict(texts), free)
        )

    def _put(self, values: dict[str, Expr]) -> Template:
        """Return the template with values in its trees; raise InputError where they do not fit."""
        trees = iter(self._trees(values))

        def put(defined: tuple[Definition, ...]) -> tuple[Definition, ...]:
            return tuple([Definition(d.name, d.text, _next(d.value, trees)) for d in defined])

        points, layers, lets, fields = map(put, self._defined)
        M, (u, v, w) = _next(self.M, trees), ((next(trees), next(trees)) for _ in self.domain)
        check_constants(tuple(trees))
        assert isinstance(M, Combination)
        return replace(
            self, points=points, layers=layers, lets=lets, fields=fields, M=M,
            domain=(u, v, w), expected=self._figures(values),
            consumed=self.consumed - values.keys(), _given=(values, self._given[1]),
            _again=partial(_put_again, self._again, self._given[0]),
        )  # fmt: skip

    @property
    def _defined(self) -> tuple[tuple[Definition, ...], ...]:
        return self.points, self.layers, self.lets, self.fields

    @cached_property
    def _trees(self) -> Substitution:
        """All trees, and at the end what is made of parameters and numbers alone."""
        trees = [x for defined in self._defined for d in defined for x in _trees_of(d.value)]
        trees += [*_trees_of(self.M), *(limit for limits in self.domain for limit in limits)]
        names = frozenset(p.name for p in self.parameters)
        alone = [x for x in walk(tuple(trees)) if x.args and x.symbols and x.symbols <= names]
        return Substitution((*trees, *alone), names)

    def _figures(self, values: dict[str, Expr]) -> Mapping[tuple[str, ...], tuple[Expr, ...]]:
        """Return what is expected with values in its trees, as it is where these do not fit."""
        with suppress(InputError):  # a choice that is not made may have no value
            trees = iter(self._stated(values))
            return {key: tuple([next(trees) for _ in row]) for key, row in self.expected.items()}
        return self.expected

    @cached_property
    def _stated(self) -> Substitution:
        names = frozenset(p.name for p in self.parameters)
        return Substitution(tuple([x for row in self.expected.values() for x in row]), names)

    def _freed(self, bound: Mapping[str, Expr], moved: Mapping[str, Moved], name: str) -> Variation:
        """Return how the equation changes with one of its parameters."""
        read = self._with(bound, moved, name)
        coordinates = None if name in read.consumed else read._over_unit_box()

        def at(value: Expr) -> PointEquation:
            values = {**bound, name: value}
            return self._with(values, moved)._equation(values, partial(self._bind_moved, values))

        fields = {d.name: _trees_of(d.value)[:3] for d in read.fields}
        return Variation(name, bound[name], coordinates, at, read.domain, fields)

    def _bind_moved(self, values: Mapping[str, Any], points: Mapping[str, Moved]) -> PointEquation:
        self._check_names(points, [p.name for p in self.points], "point")
        return self.bind({**values, **points})

    def _equation(
        self, bound: dict[str, Expr], mover: Callable[[Mapping[str, Moved]], PointEquation]
    ) -> PointEquation:
        """Return the equation of a template in whose trees all parameters have values."""
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
            expectations=expectations(self.name, self.expected, bound),
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

        named = {d.name: d.value for d in (*self.points, *self.lets)}
        known = {name: x for name, x in named.items() if isinstance(x, Combination)}
        return written_sums(self.solid[0].text, known)


def expectations(
    name: str,
    expected: Mapping[tuple[str, ...], tuple[Expr, ...]],
    values: Mapping[str, Expr],
) -> Expectations:
    """Return the figures that trees state, by their keys in [expect], at values of parameters.

    Raises TemplateError, with the template's name, for what is no finite number there or no count.
    """
    figures: dict[str, Any] = {}
    at = {parameter: evaluate(value, {}) for parameter, value in values.items()}
    for (key, *below), trees in expected.items():
        numbers = tuple([evaluate(tree, at) for tree in trees])
        for tree, value in zip(trees, numbers, strict=True):
            if not isfinite(value):
                given = ", ".join(f"{p} = {x:g}" for p, x in at.items() if p in tree.symbols)
                where = f" for {given}" if given else ""
                raise TemplateError(
                    f"{name}: [expect] {key}: {tree!r} is not a finite real number{where}"
                )
        if key in MEASURED:
            figures[key] = numbers if key == "centroid" else numbers[0]
        else:
            check_count(f"{name}: [expect] {' '.join((key, *below))}", trees[0], at)
            held = figures.setdefault(key, {}) if below else figures
            held[below[0] if below else key] = round(numbers[0])
    return Expectations(**figures)


def check_count(key: str, tree: Expr, at: Mapping[str, float]) -> None:
    """Raise TemplateError unless a tree is a whole number, and not negative but for euler."""
    value = evaluate(tree, at)
    exact = tree.payload.denominator == 1 if tree.op == "number" else value == round(value)
    if not exact or (value < 0 and "euler" not in key):
        raise TemplateError(f"{key}: is a whole number, and {tree!r} was given")


def _put_again(
    again: Callable[..., Template], asked: Any, values: dict[str, Expr], moved: Any
) -> Template:
    """Read a template again that values were put into, as one from another process is."""
    return again(asked, moved)._put(values)


def _trees_of(value: Value) -> tuple[Expr, ...]:
    return (*value.coordinates, value.weight) if isinstance(value, Combination) else (value,)


def _next(value: Value, trees: Iterator[Expr]) -> Value:
    """Return what stands for a value in trees that are made of those of many."""
    if isinstance(value, Combination):
        return Combination(next(trees), next(trees), next(trees), next(trees))
    return next(trees)
