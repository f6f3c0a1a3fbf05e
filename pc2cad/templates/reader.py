"""The tables of a template, read in the order in which they may refer to one another."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from pc2cad.channels.layers import depth
from pc2cad.equation.fields import COORDINATES, check_field_name
from pc2cad.equation.language import PARAMETER_NAMES, Listed, Named, read_expression
from pc2cad.equation.point_equation import UNITS, Interval
from pc2cad.equation.points import Combination, Kind, Value, kind_of, point
from pc2cad.errors import InputError
from pc2cad.expression.budget import bounded
from pc2cad.expression.tree import ONE, ZERO, Expr, Number, symbol
from pc2cad.templates.channel_tables import attempt, read_curve, read_frame, read_guide
from pc2cad.templates.header import Definition, Moved, Parameter
from pc2cad.templates.order import FRAME_NAMES, Entry, entries, in_order
from pc2cad.templates.series_tables import read_series
from pc2cad.templates.tables import Tables, shown, written
from pc2cad.templates.template import MEASURED, Template, check_count
from pc2cad.trust.names import LABEL_RULE, clean, clean_lines, is_label

if TYPE_CHECKING:
    from pc2cad.channels.frames import Frame
    from pc2cad.channels.guides import Guide

TEXTS: Final = ("title", "about", "source", "units")
TABLES: Final = (
    "parameters", "points", "domain", "data", "curves", "fourier", "tables", "guide", "frame",
    "layers", "let", "solid", "fields", "expect",
)  # fmt: skip
_EXPECTED: Final = (
    "volume", "area", "centroid", "faces", "carriers", "edges", "vertices", "shells", "euler",
)  # fmt: skip
_CARRIERS: Final = (
    "plane", "cylinder", "cone", "sphere", "torus", "extrusion", "revolution", "bezier", "spline",
    "rational",
)  # fmt: skip


def read_tables(
    name: str,
    file: str,
    data: dict[str, Any],
    bound: Mapping[str, Expr],
    moved: Mapping[str, Moved],
    free: str = "",
) -> Template:
    """Return the template that the tables of one solid hold.

    `bound` gives parameters their values (`free` stays a symbol, and its value is used only where
    there has to be one) and `moved` replaces points; `file` is named in messages.
    Raises TemplateError for a mistake, also where the trees grow beyond all measure (see `budget`).
    """
    with bounded():
        return Reader(file, data, bound, moved, free).template(name)


@dataclass
class _Found:
    """What the entries of a template define, as they are read one after the other."""

    data: dict[str, Listed] = field(default_factory=dict)
    curves: dict[str, Any] = field(default_factory=dict)
    guide: Guide | None = None
    frame: Frame | None = None
    carried: list[Definition] = field(default_factory=list)
    layers: list[Definition] = field(default_factory=list)
    lets: list[Definition] = field(default_factory=list)


class Reader(Tables):
    """Reads the tables in the order in which they may refer to one another."""

    def __init__(
        self,
        file: str,
        data: dict[str, Any],
        bound: Mapping[str, Expr],
        moved: Mapping[str, Moved],
        free: str = "",
    ) -> None:
        super().__init__(file, data)
        #: values of parameters (without them, all are symbols) and what replaces points
        self._bound = bound
        self._moved = moved
        self._free = free

    def template(self, name: str) -> Template:
        """Return the template of one solid."""
        self.check_keys(self.data, (*TEXTS, *TABLES), "")
        texts = self.texts()
        parameters = self._parameters()
        domain = self._domain()
        points = self._points()
        found = self._entries(("guide", "frame", "layers"), domain)
        solid, M = self._solid()
        fields = self._fields()
        return Template(
            name, **texts, parameters=parameters, points=points, curves=found.curves,
            data=found.data, guide=found.guide, frame=found.frame, carried=tuple(found.carried),
            layers=tuple(found.layers), lets=tuple(found.lets), domain=domain, solid=solid, M=M,
            fields=fields, expected=self._expected(),
            _again=partial(read_tables, name, self.file, self.data),
            _given=(self._bound, self._moved), consumed=frozenset(self.consumed),
        )  # fmt: skip

    def shared(self) -> dict[str, Any]:
        """Return what bodies have in common, and what is expected of their result."""
        texts, parameters, points = self.texts(), self._parameters(), self._points()
        self._entries((), None)
        return {
            **texts, "parameters": parameters, "points": points, "expected": self._expected(),
            "names": (self.names, self.curves),
        }  # fmt: skip

    def _entries(
        self, whole: tuple[str, ...], domain: tuple[Interval, Interval, Interval] | None
    ) -> _Found:
        """Read the entries of all tables that may mention one another, each after what it does."""
        self.names |= {p: symbol(p) for p in PARAMETER_NAMES}
        sections = {
            key: self.table(key) for key in ("data", "curves", "fourier", "tables", *whole, "let")
            if key not in whole or key in self.data
        }  # fmt: skip
        if self._frame_is_left_out(sections):
            sections["frame"] = {}
        found = _Found()
        for entry in in_order(entries(sections), self.fail):
            match entry.section:
                case "data":
                    from pc2cad.templates.data_tables import read_list  # it loads NumPy

                    found.data[entry.name] = read_list(self, entry.name, entry.raw)
                case "curves":
                    self._without_parameters(read_curve, entry)
                case "fourier":
                    self._without_parameters(read_series, entry)
                case "tables":
                    from pc2cad.templates.data_tables import read_table

                    read_table(self, entry.name, entry.raw)
                case "guide":
                    assert domain is not None
                    found.guide, carried = read_guide(self, self._run(domain))
                    (found.lets if "N" in entry.raw else found.carried).extend(carried)
                case "frame":
                    found.frame, carried = read_frame(self, found.guide, entry.raw)
                    found.carried += carried
                case "layers":
                    found.layers += self._layers()
                case _:
                    found.lets.append(self._let(entry.name, entry.raw))
        found.curves.update(
            {n: f for n, f in self.curves.items() if n != "depth" or not found.layers}
        )
        return found

    def _frame_is_left_out(self, sections: Mapping[str, dict[str, Any]]) -> bool:
        """Whether R or Q of the default frame is mentioned, and nothing else is called so."""
        if "guide" not in sections or "frame" in sections:
            return False
        listed = entries(sections)
        read = [*listed, *(Entry(key, "", self.data.get(key)) for key in ("solid", "fields"))]
        known = {*self.names, *(name for entry in listed for name in entry.defines)}
        return not known & FRAME_NAMES and any(entry.mentions() & FRAME_NAMES for entry in read)

    def _without_parameters(self, read: Callable[[Tables, str, Any], None], entry: Entry) -> None:
        """Read an entry in which u, v and w mean nothing, or something else."""
        parameters = {p: self.names.pop(p) for p in PARAMETER_NAMES}
        read(self, entry.name, entry.raw)
        self.names |= parameters

    def _run(self, domain: tuple[Interval, Interval, Interval]) -> tuple[Value, Value]:
        return self.bound(domain[0][0]), self.bound(domain[0][1])

    def texts(self) -> dict[str, str]:
        """Return title, about, source and units."""
        texts = {key: clean(self.text(key)) for key in TEXTS}
        texts["about"] = clean_lines(self.text("about"))
        texts["units"] = texts["units"] or "mm"
        if texts["units"] not in UNITS:
            known = ", ".join(UNITS)
            self.fail("units", f"unknown units '{texts['units']}'; use one of {known}")
        if not texts["title"]:
            self.fail("title", "a template needs a title")
        return texts

    def _parameters(self) -> tuple[Parameter, ...]:
        result = []
        for name, raw in self.table("parameters").items():
            key = f"[parameters] {shown(name)}"
            if not isinstance(raw, dict):
                raw = {"default": raw}
            self.check_keys(raw, ("default", "min", "max", "about"), f"{key}.")
            if "default" not in raw:
                self.fail(key, "needs a default")
            limits = {k: self.scalar(f"{key}.{k}", raw[k]) for k in raw if k != "about"}
            about = raw.get("about", "")
            if not isinstance(about, str):
                self.fail(f"{key}.about", "must be a text in quotes")
            for k, tree in limits.items():
                if tree.symbols:
                    self.fail(f"{key}.{k}", "must be constant")
            result.append(
                Parameter(
                    name, limits["default"], limits.get("min"), limits.get("max"), clean(about)
                )
            )
        for parameter in result:
            value = self._bound.get(parameter.name, symbol(parameter.name))
            if parameter.name == self._free:
                value = symbol(parameter.name)
            self.defaults[parameter.name] = self._bound.get(parameter.name, parameter.default)
            self.define(f"[parameters] {parameter.name}", parameter.name, value)
        return tuple(result)

    def _points(self) -> tuple[Definition, ...]:
        result = []
        for name, raw in self.table("points").items():
            key = f"[points] {shown(name)}"
            if not isinstance(raw, list) or len(raw) != 3:
                self.fail(key, "a point is a list of three coordinates, [x, y, z]")
            value = point(*(self.scalar(f"{key}[{i}]", x) for i, x in enumerate(raw)))
            text = "[" + ", ".join(written(x) for x in raw) + "]"
            result.append(Definition(name, text, value))
        for definition in result:
            self.define(f"[points] {definition.name}", definition.name, definition.value)
        return self._move(result)

    def _move(self, points: list[Definition]) -> tuple[Definition, ...]:
        """Return the points with current points in the place of those that are moved."""
        known = self.names | {p: symbol(p) for p in PARAMETER_NAMES}
        moved = [self._current(d, known) if d.name in self._moved else d for d in points]
        self.names |= {d.name: d.value for d in moved}
        return tuple(moved)

    def _current(self, fixed: Definition, known: Mapping[str, Named]) -> Definition:
        raw = self._moved[fixed.name]
        key = f"the point {fixed.name}"
        try:
            if isinstance(raw, str):
                value = read_expression(raw, known)
            else:
                value = raw if isinstance(raw, Combination) else _of_three(raw)
                value = value.substitute({p: x for p, x in self._bound.items() if p != self._free})
            kind = kind_of(value)
            strange = set().union(*(c.symbols for c in value.coordinates)) - set(known) if (
                isinstance(value, Combination)
            ) else set()  # fmt: skip
        except InputError as error:
            raise InputError(f"{key}: {error}") from error
        if kind is not Kind.POINT:
            raise InputError(f"{key} must be a point, [x, y, z], and {kind.value} was given")
        if strange:
            raise InputError(f"{key} depends on {sorted(strange)[0]}, which nothing defines")
        return Definition(fixed.name, raw if isinstance(raw, str) else repr(value), value)

    def _domain(self) -> tuple[Interval, Interval, Interval]:
        table = self.table("domain")
        self.check_keys(table, PARAMETER_NAMES, "[domain] ")
        limits: list[Interval] = []
        for name in PARAMETER_NAMES:
            key = f"[domain] {name}"
            raw = table.get(name, [ZERO, ONE])
            if not isinstance(raw, list) or len(raw) != 2:
                self.fail(key, "is a list of two limits, [lower, upper]")
            low, high = (x if isinstance(x, Expr) else self.scalar(key, x) for x in raw)
            limits.append((low, high))
        return limits[0], limits[1], limits[2]

    def _layers(self) -> tuple[Definition, ...]:
        """Define depth(w), the thickness of the layers below w."""
        result = []
        for name, raw in self.table("layers").items():
            key = f"[layers] {shown(name)}"
            if not is_label(name):
                self.fail(key, f"the name of a layer is {LABEL_RULE}")
            result.append(Definition(name, written(raw), self.scalar(key, raw)))
        if result:
            key = "[layers]"
            self.define(key, "depth", None)
            values = [d.value for d in result if isinstance(d.value, Expr)]
            self.curves["depth"] = attempt(self, key, lambda: depth(values))
        return tuple(result)

    def _let(self, name: str, raw: object) -> Definition:
        key = f"[let] {shown(name)}"
        value = self.expression(key, raw) if isinstance(raw, str) else self.scalar(key, raw)
        self.define(key, name, value)
        return Definition(name, written(raw), value)

    def _solid(self) -> tuple[tuple[Definition, ...], Combination]:
        table = self.table("solid")
        self.check_keys(table, ("M", "x", "y", "z"), "[solid] ")
        if set(table) == {"M"}:
            key, raw = "[solid] M", table["M"]
            value = self.expression(key, raw) if isinstance(raw, str) else None
            if not isinstance(value, Combination) or kind_of(value).name != "POINT":
                what = kind_of(value).value if value is not None else "something else"
                self.fail(key, f"M must be a point equation in quotes, and {what} was given")
            return (Definition("M", str(raw), value),), value  # type: ignore[arg-type,return-value]
        if set(table) == {"x", "y", "z"}:
            trees = [self.scalar(f"[solid] {axis}", table[axis]) for axis in "xyz"]
            rows = (Definition(a, written(table[a]), t) for a, t in zip("xyz", trees, strict=True))
            return tuple(rows), point(*trees)
        return self.fail("[solid]", "needs either M or all of x, y and z")  # type: ignore[no-any-return]

    def _fields(self) -> tuple[Definition, ...]:
        """Read fields, each of which may mention those before it, and x, y, z of the solid."""
        result = []
        known: dict[str, Value] = {
            axis: symbol(axis) for axis in COORDINATES if axis not in self.names
        }
        for name, raw in self.table("fields").items():
            key = f"[fields] {shown(name)}"
            text = isinstance(raw, str)
            value = self.expression(key, raw, known) if text else self.scalar(key, raw)
            attempt(self, key, partial(check_field_name, name))
            self.define(key, name, value)
            result.append(Definition(name, written(raw), value))
        return tuple(result)

    def _expected(self) -> dict[tuple[str, ...], tuple[Expr, ...]]:
        table = dict(self.table("expect"))
        self.check_keys(table, _EXPECTED, "[expect] ")
        result: dict[tuple[str, ...], tuple[Expr, ...]] = {}
        carriers = table.pop("carriers", {})
        if not isinstance(carriers, dict):
            self.fail("[expect] carriers", "is a table such as { sphere = 1, plane = 1 }")
        self.check_keys(carriers, _CARRIERS, "[expect] carriers ")
        entries: dict[tuple[str, ...], Any] = {(name,): raw for name, raw in table.items()}
        entries |= {("carriers", kind): count for kind, count in carriers.items()}
        for path, raw in entries.items() if not self._moved else ():
            # what is stated of the points as written need not hold of moved ones
            key, name = f"[expect] {' '.join(path)}", path[0]
            values = raw if name == "centroid" else [raw]
            if not isinstance(values, list) or len(values) != (3 if name == "centroid" else 1):
                self.fail(key, "is a list of three coordinates")
            trees = tuple(self.scalar(key, value) for value in values)
            if any(not tree.symbols.isdisjoint(PARAMETER_NAMES) for tree in trees):
                self.fail(key, "must not depend on u, v or w")
            if name not in MEASURED and not trees[0].symbols:
                check_count(f"{self.file}: {key}", trees[0], {})
            result[path] = trees
        return result


def _of_three(raw: Sequence[Expr | Number]) -> Combination:
    try:
        coordinates = [*raw]
    except TypeError:
        raise InputError(f"a point has 3 coordinates, and {raw!r:.80} was given") from None
    if len(coordinates) != 3:
        raise InputError(f"a point has 3 coordinates, here are {len(coordinates)}")
    return point(*coordinates)
