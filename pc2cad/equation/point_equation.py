"""The point equation: what the rest of the pipeline is given."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, Final

from pc2cad.equation.fields import VELOCITY, Field, FieldValue, checked_fields, make_field
from pc2cad.equation.language import read_expression
from pc2cad.equation.points import Combination, Kind, kind_of, point
from pc2cad.equation.variation import Variation
from pc2cad.errors import InputError
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import ONE, ZERO, Expr, Number, as_expr, substitute, symbol
from pc2cad.trust.names import LABEL_RULE, clean, clean_lines, is_label

#: the three current parameters, in the order of every array and table
#: length of the unit in metres
UNITS: Final = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}

#: lower and upper limit of one parameter
Interval = tuple[Expr, Expr]


class NotAPointEquationError(InputError):
    """The equation's value is not a point, or it depends on more than u, v and w."""


class EmptyDomainError(InputError):
    """A parameter's domain has no length, or runs backwards."""


class LayersError(InputError):
    """The layers of a part are not the pieces of w."""


@dataclass(frozen=True)
class Expectations:
    """Exact values a template states about its solid; None where it states nothing."""

    volume: float | None = None
    area: float | None = None
    centroid: tuple[float, float, float] | None = None
    faces: int | None = None
    #: number of faces by the kind of their carrier
    carriers: Mapping[str, int] | None = None
    edges: int | None = None
    vertices: int | None = None
    shells: int | None = None
    euler: int | None = None


@dataclass(frozen=True)
class Written:
    """A sum as somebody has written it: M1 + M2 - K by name, and as trees over the box."""

    #: ``M1 + M2 - D``
    text: str
    names: tuple[str, str]
    core_name: str
    first: tuple[Expr, Expr, Expr]
    second: tuple[Expr, Expr, Expr]
    core: tuple[Expr, Expr, Expr]


@dataclass(frozen=True, repr=False)
class PointEquation:
    """One solid M(u,v,w) over a box of parameters, with every template parameter bound.

    ``coordinates`` are the trees of x, y and z (in `units`); their only symbols are u, v and w.
    """

    coordinates: tuple[Expr, Expr, Expr]
    domain: tuple[Interval, Interval, Interval]
    name: str = "part"
    title: str = ""
    about: str = ""
    source: str = ""
    units: str = "mm"
    parameters: Mapping[str, float] = field(default_factory=dict)
    expectations: Expectations = Expectations()
    #: of a channel: its guide N(u), and what frame carries the section along it
    guide: tuple[Expr, Expr, Expr] | None = None
    frame: str = ""
    #: names of the pieces of w, from w = 0 up, each a solid of its own; without them M is one solid
    layers: tuple[str, ...] = ()
    #: the thickness of all layers below w, where that is known
    depth: Expr | None = None
    #: what varies over the solid beside its shape
    fields: tuple[Field, ...] = ()
    #: what sums of points it is written as
    written: Callable[[], tuple[Written, ...]] = field(default=tuple, repr=False, compare=False)
    #: makes the equation again with other points, where it knows the names of its points
    mover: Callable[[Mapping[str, Any]], PointEquation] | None = field(
        default=None, repr=False, compare=False
    )
    #: leaves one parameter free, where the equation has parameters
    freer: Callable[[str], Variation] | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        # texts come from files, their names and scripts, and go into files and to terminals
        for key in ("name", "title", "about", "source", "frame"):
            if not isinstance(getattr(self, key), str):
                raise InputError(
                    f"the {key} of an equation is a text, not {getattr(self, key)!r:.80}"
                )
        for key in ("name", "title", "source", "frame"):
            object.__setattr__(self, key, clean(getattr(self, key)))
        object.__setattr__(self, "about", clean_lines(self.about))
        for layer in self.layers:
            if not isinstance(layer, str) or not is_label(layer):
                raise LayersError(f"the name of a layer is {LABEL_RULE}; here is {layer!r:.80}")
        checked_fields(self.fields)

    def __repr__(self) -> str:
        given = ", ".join(f"{name}={value:g}" for name, value in self.parameters.items())
        return f"<PointEquation {': '.join(filter(None, (self.name, given)))} ({self.units})>"

    def with_fields(self, **fields: FieldValue) -> PointEquation:
        """Return the equation with more fields: text, expressions, vectors or points.

        ``equation.with_fields(density="7.85e-6*(1 + z/10)", flow=pc.vector(0, 0, 1))`` in u, v, w
        and x, y, z, the coordinates of the solid's point. Raises FieldError or InputError.
        """
        more = tuple(make_field(name, value) for name, value in fields.items())
        return replace(self, fields=(*self.fields, *more))

    def with_velocities(self, *names: str) -> PointEquation:
        """Return the equation with ∂M/∂p of parameters as fields: ``velocity_r`` of ``r``.

        Of the point that stays at the same share of the way from limit to limit. Meshes and splines
        then hold how their nodes and poles move. Raises InputError for a name of no parameter,
        where M has no derivative, and where a guide takes the parameter as a number, so that there
        is no formula of it.
        """
        from pc2cad.expression.derivatives import derivatives
        from pc2cad.expression.simplification import simplified

        fields = []
        for name in names:
            variation = self.variation(name)
            if variation.coordinates is None:
                raise InputError(
                    f"a guide takes {name} as a number: there is no formula of how places move "
                    f"with it (sensitivity('{name}').velocity gives differences)"
                )
            own = over_own_box(self.domain)
            along = derivatives(variation.coordinates, name)
            try:
                trees = substitute(substitute(along, {name: variation.bound}), own)
            except InputError as error:
                raise InputError(
                    f"there is no velocity with {name} = {variation.value:g}: {error}"
                ) from error
            x, y, z = simplified(trees)
            fields.append(Field(f"{VELOCITY}{name}", "vector", (x, y, z)))
        return replace(self, fields=(*self.fields, *fields))

    def field(self, name: str) -> Field:
        """Return the field of a name; raise InputError where there is none."""
        found = checked_fields(self.fields)
        if name not in found:
            known = ", ".join(found) or "none"
            raise InputError(f"{self.name} has no field '{name:.80}' (it has: {known})")
        return found[name]

    def move(self, **points: Any) -> PointEquation:
        """Return the equation with points replaced by current points (the moving simplex).

        ``equation.move(A=(4 + u, 0, 0))``; see `Template.move` for what a point may be. Raises
        InputError where the equation does not come from a template with these points.
        """
        if self.mover is None:
            raise InputError(
                f"the equation {self.name} has no named points to move; those of a template have"
            )
        return self.mover(points)

    def variation(self, name: str) -> Variation:
        """Return how the equation changes with one parameter; InputError where it has no such."""
        if self.freer is None and name in self.parameters:
            raise InputError(
                f"how {self.name} changes with {name} is not known: it was made of other equations "
                "at one value; of bodies, write cut(a, b) in the place of difference(a, b)"
            )
        if self.freer is None or name not in self.parameters:
            known = ", ".join(self.parameters) or "none"
            raise InputError(f"{self.name} has no parameter '{name:.80}' (it has: {known})")
        return self.freer(name)

    def layered(self, names: Sequence[str], depth: Expr | None = None) -> PointEquation:
        """Return the equation with its pieces of w, from w = 0 up, as named layers of one part.

        M has creases at w = 1/n, 2/n, … where it comes from `layers.depth`; `analyse` looks. With
        `depth`, the thickness of all that lies below w, it is found how deep layers can go.
        Raises LayersError for names that are not distinct and for a domain of w other than [0, 1].
        """
        found = tuple(names)
        if not found:
            return self
        if len(set(found)) != len(found) or not all(isinstance(n, str) and n for n in found):
            raise LayersError("the names of layers are texts, each another")
        if self.limits[2] != (0.0, 1.0):
            raise LayersError("layers share w from 0 to 1, and the domain of w is another one")
        return replace(self, layers=found, depth=depth)

    @property
    def limits(self) -> tuple[tuple[float, float], ...]:
        """Lower and upper limit of u, v and w as floats."""
        return tuple((evaluate(lo, {}), evaluate(hi, {})) for lo, hi in self.domain)


def over_unit_box(domain: Iterable[tuple[Expr, Expr]]) -> dict[str, Expr]:
    """Return what u, v and w are in parameters that run from 0 to 1, to be put in their places."""
    return {
        name: low + (high - low) * symbol(name)
        for name, (low, high) in zip(PARAMETERS, domain, strict=True)
    }


def over_own_box(domain: Iterable[tuple[Expr, Expr]]) -> dict[str, Expr]:
    """Return what parameters that run from 0 to 1 are in u, v and w: `over_unit_box` inverted."""
    return {
        name: (symbol(name) - low) / (high - low)
        for name, (low, high) in zip(PARAMETERS, domain, strict=True)
    }


#: a point, or its three coordinates: trees, numbers, SymPy expressions, texts in the language of
#: templates or functions of u, v and w; or a text or a function for all three
Equation = Combination | Sequence[Any] | PointEquation | str | Callable[..., Any]
Domain = Mapping[str, Sequence[Expr | Number]]


def point_equation(
    equation: Equation, domain: Domain | None = None, name: str = "part", units: str = "mm"
) -> PointEquation:
    """Return the point equation of a point (or of three coordinates) over a box.

    `domain` maps u, v and w to their limits; what is missing runs from 0 to 1, or as it did in an
    equation that is one already (which keeps its name and units). Raises
    NotAPointEquationError, WeightsDoNotSumError or EmptyDomainError.
    """
    if isinstance(equation, PointEquation):
        limits = dict(zip(PARAMETERS, equation.domain, strict=True)) | dict(domain or {})
        return replace(equation, domain=_domain(limits))
    if isinstance(equation, str) or _is_function(equation):
        equation = _in_parameters(equation)
    if not isinstance(equation, Combination):
        if not isinstance(equation, Iterable):
            first = ": bind() makes an equation of it" if hasattr(equation, "bind") else ""
            raise NotAPointEquationError(
                f"{equation!r:.120} is neither a point nor three coordinates{first}"
            )
        coordinates = tuple(equation)
        if len(coordinates) != 3:
            raise NotAPointEquationError(
                f"a solid needs the three coordinates x, y and z; here are {len(coordinates)}"
            )
        equation = point(*(_coordinate(c) for c in coordinates))
    check_point(equation)
    if units not in UNITS:
        raise InputError(f"unknown units '{units}'; use one of {', '.join(UNITS)}")
    return PointEquation(equation.coordinates, _domain(domain or {}), name=name, units=units)


def _domain(limits: Domain) -> tuple[Interval, Interval, Interval]:
    unknown = set(limits) - set(PARAMETERS)
    if unknown:
        raise InputError(f"the domain names {sorted(unknown)[0]}; a solid has only u, v and w")
    u, v, w = (interval(p, limits.get(p, (ZERO, ONE))) for p in PARAMETERS)
    return u, v, w


def _coordinate(value: Any) -> Expr | Number:
    # classes that SymPy makes for undefined functions belong to no module, but their parents do
    if any(str(kind.__module__).partition(".")[0] == "sympy" for kind in type(value).__mro__):
        from pc2cad.expression.sympy_bridge import from_sympy

        return from_sympy(value)
    if isinstance(value, str) or _is_function(value):
        value = _in_parameters(value)
    if isinstance(value, bool) or not isinstance(value, (Expr, int, float, Fraction)):
        raise NotAPointEquationError(f"a coordinate is {value!r}, not an expression in u, v and w")
    return value


def _is_function(value: object) -> bool:
    return callable(value) and not isinstance(value, type)


def _in_parameters(value: Any) -> Any:
    """Return what a text or a function of Python says of u, v and w."""
    names = {p: symbol(p) for p in PARAMETERS}
    return read_expression(value, names) if isinstance(value, str) else value(*names.values())


def check_point(value: object) -> None:
    """Raise NotAPointEquationError unless the value is a point of u, v and w only."""
    if not isinstance(value, (Expr, Combination)):
        raise NotAPointEquationError("M must be a point equation")
    kind = kind_of(value)
    if kind is not Kind.POINT or isinstance(value, Expr):
        raise NotAPointEquationError(f"M must be a point, and {kind.value} was given")
    strange = set().union(*(c.symbols for c in value.coordinates)) - set(PARAMETERS)
    if strange:
        raise NotAPointEquationError(
            f"M depends on {', '.join(sorted(strange))}; only u, v and w may stay free"
        )


def interval(parameter: str, limits: Sequence[Expr | Number]) -> Interval:
    """Return the limits of a parameter; raise EmptyDomainError unless they ascend."""
    if len(limits) != 2:
        raise InputError(f"the domain of {parameter} has two limits [lower, upper]")
    lower, upper = (as_expr(limit) for limit in limits)
    if lower.symbols or upper.symbols:
        raise InputError(f"the domain of {parameter} must be constant")
    a, b = evaluate(lower, {}), evaluate(upper, {})
    if not b - a > 1e-12 * max(abs(a), abs(b)):
        raise EmptyDomainError(
            f"the domain of {parameter} runs from {a:g} to {b:g}; the upper limit must be larger"
        )
    return lower, upper
