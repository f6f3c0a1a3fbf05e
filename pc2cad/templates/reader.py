"""The tables of a template, read in the order in which they may refer to one another."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Final

from pc2cad.channels.layers import depth
from pc2cad.equation.language import PARAMETER_NAMES, read_expression
from pc2cad.equation.point_equation import UNITS, Interval
from pc2cad.equation.points import Combination, Kind, Value, kind_of, point
from pc2cad.errors import InputError
from pc2cad.expression.budget import bounded
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import ONE, ZERO, Expr, symbol
from pc2cad.templates.channel_tables import attempt, read_curves, read_frame, read_guide
from pc2cad.templates.tables import Tables, shown, written
from pc2cad.templates.template import Definition, Moved, Parameter, Template
from pc2cad.trust.names import LABEL_RULE, clean, clean_lines, is_label

TEXTS: Final = ("title", "about", "source", "units")
TABLES: Final = (
    "parameters", "points", "domain", "curves", "guide", "frame", "layers", "let", "solid",
    "expect",
)  # fmt: skip
_EXPECTED: Final = (
    "volume", "area", "centroid", "faces", "carriers", "edges", "vertices", "shells", "euler",
)  # fmt: skip
#: those that are no counts
_MEASURED: Final = ("volume", "area", "centroid")
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
) -> Template:
    """Return the template that the tables of one solid hold.

    `bound` gives parameters their values and `moved` replaces points; `file` is named in messages.
    Raises TemplateError for a mistake, also where the trees grow beyond all measure (see `budget`).
    """
    with bounded():
        return Reader(file, data, bound, moved).template(name)


class Reader(Tables):
    """Reads the tables in the order in which they may refer to one another."""

    def __init__(
        self,
        file: str,
        data: dict[str, Any],
        bound: Mapping[str, Expr],
        moved: Mapping[str, Moved],
    ) -> None:
        super().__init__(file, data)
        #: values of parameters (without them, all are symbols) and what replaces points
        self._bound = bound
        self._moved = moved

    def template(self, name: str) -> Template:
        """Return the template of one solid."""
        self.check_keys(self.data, (*TEXTS, *TABLES), "")
        texts = self.texts()
        parameters = self._parameters()
        domain = self._domain()
        points = self._points()
        read_curves(self)
        self.names |= {p: symbol(p) for p in PARAMETER_NAMES}
        u = self.bound(domain[0][0]), self.bound(domain[0][1])
        guide, carried = read_guide(self, u)
        frame, normals = read_frame(self, guide)
        curves, layers = dict(self.curves), self._layers()
        written_out = carried if "N" in self.table("guide") else []
        carried = [] if written_out else carried
        lets = (*written_out, *self._lets())
        solid, M = self._solid()
        return Template(
            name, **texts, parameters=parameters, points=points, curves=curves,
            guide=guide, frame=frame, carried=(*carried, *normals), layers=layers, lets=lets,
            domain=domain, solid=solid, M=M, expected=self._expected(),
            _again=partial(read_tables, name, self.file, self.data),
            _given=(self._bound, self._moved),
        )  # fmt: skip

    def shared(self) -> dict[str, Any]:
        """Return what bodies have in common, and what is expected of their result."""
        texts, parameters, points = self.texts(), self._parameters(), self._points()
        read_curves(self)
        self.names |= {p: symbol(p) for p in PARAMETER_NAMES}
        self._lets()
        return {
            **texts, "parameters": parameters, "points": points, "expected": self._expected(),
        }  # fmt: skip

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

    def _current(self, fixed: Definition, known: Mapping[str, Value]) -> Definition:
        raw = self._moved[fixed.name]
        key = f"the point {fixed.name}"
        try:
            if isinstance(raw, str):
                value = read_expression(raw, known)
            elif isinstance(raw, Combination):
                value = raw
            elif len(raw) == 3:
                value = point(*raw)
            else:
                raise InputError(f"a point has 3 coordinates, here are {len(raw)}")
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

    def _lets(self) -> tuple[Definition, ...]:
        result = []
        for name, raw in self.table("let").items():
            key = f"[let] {shown(name)}"
            value = self.expression(key, raw) if isinstance(raw, str) else self.scalar(key, raw)
            self.define(key, name, value)
            result.append(Definition(name, written(raw), value))
        return tuple(result)

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

    def _check_count(self, key: str, tree: Expr) -> None:
        value = evaluate(tree, {})
        exact = tree.payload.denominator == 1 if tree.op == "number" else value == round(value)
        if not exact or (value < 0 and "euler" not in key):
            self.fail(key, f"is a whole number, and {tree!r} was given")

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
            if name not in _MEASURED and not trees[0].symbols:
                self._check_count(key, trees[0])
            result[path] = trees
        return result
