"""Reading template files (TOML) strictly: every mistake is named with file, key and column."""

from __future__ import annotations

import math
import os
import re
import stat
import tomllib
from collections.abc import Iterable, Mapping
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any, Final

from pc2cad.equation import curves
from pc2cad.equation.language import PARAMETER_NAMES, RESERVED_NAMES, nearest, read_expression
from pc2cad.equation.point_equation import UNITS, Interval
from pc2cad.equation.points import Combination, Kind, Value, kind_of, point
from pc2cad.equation.template import Definition, Moved, Parameter, Template, TemplateError
from pc2cad.equation.tree import ONE, ZERO, Expr, number, symbol
from pc2cad.errors import InputError

LARGEST_FILE: Final = 256 * 1024
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}\Z")
#: the TOML parser takes quadratic time for keys of thousands of parts
_DEEP_KEY: Final = re.compile(r"(?<![A-Za-z0-9_-])(?:[A-Za-z0-9_-]++[ \t]*+\.[ \t]*+){16}")
_TEXTS: Final = ("title", "about", "source", "units")
_TABLES: Final = ("parameters", "points", "domain", "curves", "let", "solid", "expect")
_EXPECTED: Final = (
    "volume", "area", "centroid", "faces", "edges", "vertices", "shells", "euler",
)  # fmt: skip
#: kind of curve -> (required keys, optional keys)
_CURVE_KEYS: Final = {
    "contour": (("points",), ("handle",)),
    "polygon": (("points",), ()),
    "sine": (("radius", "amplitude", "waves"), ()),
}


def read_template(path: str | os.PathLike[str]) -> Template:
    """Read a template file; raise TemplateError for whatever is not as the format asks."""
    return parse_template(read_template_text(Path(path)), Path(path).stem, str(path))


def parse_template(text: str, name: str, file: str = "template") -> Template:
    """Return the template that a TOML text holds; `file` is named in messages."""
    if _DEEP_KEY.search(text):
        raise TemplateError(f"{file}: a dotted key is nested deeper than the format goes")
    try:
        # as_float keeps decimals exact: 0.1 is one tenth
        data = tomllib.loads(text, parse_float=_decimal)
    except (tomllib.TOMLDecodeError, ValueError) as error:
        raise TemplateError(f"{file}: not valid TOML: {error}") from error
    except (RecursionError, MemoryError) as error:
        raise TemplateError(f"{file}: the TOML is nested too deeply") from error
    return _read(name, file, data, {}, {})


def _read(
    name: str,
    file: str,
    data: dict[str, Any],
    bound: Mapping[str, Expr],
    moved: Mapping[str, Moved],
) -> Template:
    return _Reader(file, data, bound, moved).template(name)


def read_template_text(path: Path) -> str:
    """Return the text of a template file; raise TemplateError where it is no such file."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise TemplateError(f"{path}: not a regular file")
        with path.open("rb") as stream:
            raw = stream.read(LARGEST_FILE + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise TemplateError(f"{path}: cannot be read: {reason}") from error
    if len(raw) > LARGEST_FILE:
        raise TemplateError(f"{path}: larger than {LARGEST_FILE // 1024} kB")
    try:
        return raw.decode("utf-8").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise TemplateError(f"{path}: not UTF-8 (byte {error.start})") from error


def _decimal(text: str) -> Fraction | float:
    text = text.replace("_", "")
    mantissa, _, exponent = text.lower().partition("e")
    if mantissa.lstrip("+-") in ("inf", "nan") or abs(int(exponent or 0)) > 60 or len(text) > 60:
        return float(text)
    return Fraction(text)


class _Reader:
    """Reads the tables in the order in which they may refer to one another."""

    def __init__(
        self,
        file: str,
        data: dict[str, Any],
        bound: Mapping[str, Expr],
        moved: Mapping[str, Moved],
    ) -> None:
        self._file = file
        self._data = data
        #: values of parameters (without them, all are symbols) and what replaces points
        self._bound = bound
        self._moved = moved
        self._names: dict[str, Value] = {}
        self._curves: dict[str, Any] = {}

    def template(self, name: str) -> Template:
        self._check_keys(self._data, (*_TEXTS, *_TABLES), "")
        texts = {key: self._text(key) for key in _TEXTS}
        units = texts["units"] or "mm"
        if units not in UNITS:
            self._fail("units", f"unknown units '{units}'; use one of {', '.join(UNITS)}")
        if not texts["title"]:
            self._fail("title", "a template needs a title")
        parameters = self._parameters()
        domain = self._domain()
        points = self._points()
        self._read_curves()
        self._names |= {p: symbol(p) for p in PARAMETER_NAMES}
        lets = self._lets()
        solid, M = self._solid()
        return Template(
            name, texts["title"], texts["about"], texts["source"], units, parameters, points,
            dict(self._curves), lets, domain, solid, M, self._expected(),
            partial(_read, name, self._file, self._data),
        )  # fmt: skip

    def _fail(self, key: str, message: str) -> Any:
        raise TemplateError(f"{self._file}: {key}: {message}")

    def _check_keys(self, table: Mapping[str, Any], known: Iterable[str], where: str) -> None:
        known = tuple(known)
        for key in table:
            if key not in known:
                self._fail(where + _shown(key), f"unknown key{nearest(key, known)}")

    def _text(self, key: str) -> str:
        value = self._data.get(key, "")
        if not isinstance(value, str):
            self._fail(key, "must be a text in quotes")
        return str(value)

    def _table(self, key: str) -> dict[str, Any]:
        value = self._data.get(key, {})
        if not isinstance(value, dict):
            self._fail(key, f"must be a table, [{key}]")
        return dict(value)

    def _scalar(self, key: str, raw: object) -> Expr:
        """Read a number or the text of a scalar expression."""
        if isinstance(raw, str):
            value = self._expression(key, raw)
            if not isinstance(value, Expr):
                self._fail(key, f"must be a scalar, and {kind_of(value).value} was given")
            return value  # type: ignore[return-value]
        if isinstance(raw, bool) or not isinstance(raw, (int, float, Fraction)):
            self._fail(key, "must be a number or an expression in quotes")
        if isinstance(raw, float) and not math.isfinite(raw):
            self._fail(key, f"{raw} is not a finite number")
        try:
            return number(raw)  # type: ignore[arg-type]
        except InputError as error:
            return self._fail(key, str(error))  # type: ignore[no-any-return]

    def _expression(self, key: str, text: str) -> Value:
        try:
            return read_expression(text, self._names, self._curves)
        except InputError as error:
            return self._fail(key, str(error))  # type: ignore[no-any-return]

    def _define(self, key: str, name: str, value: Value | None) -> None:
        """Add a name, which must be new, well formed and not reserved."""
        if not _NAME.match(name):
            self._fail(key, f"'{_shown(name)}' is not a name (a letter, then letters, digits, _)")
        if name in RESERVED_NAMES:
            self._fail(key, f"the name {name} is reserved")
        if name in self._names or name in self._curves:
            self._fail(key, f"the name {name} is defined twice")
        if value is not None:
            self._names[name] = value

    def _parameters(self) -> tuple[Parameter, ...]:
        result = []
        for name, raw in self._table("parameters").items():
            key = f"[parameters] {_shown(name)}"
            if not isinstance(raw, dict):
                raw = {"default": raw}
            self._check_keys(raw, ("default", "min", "max", "about"), f"{key}.")
            if "default" not in raw:
                self._fail(key, "needs a default")
            limits = {k: self._scalar(f"{key}.{k}", raw[k]) for k in raw if k != "about"}
            about = raw.get("about", "")
            if not isinstance(about, str):
                self._fail(f"{key}.about", "must be a text in quotes")
            for k, tree in limits.items():
                if tree.symbols:
                    self._fail(f"{key}.{k}", "must be constant")
            result.append(
                Parameter(name, limits["default"], limits.get("min"), limits.get("max"), about)
            )
        for parameter in result:
            value = self._bound.get(parameter.name, symbol(parameter.name))
            self._define(f"[parameters] {parameter.name}", parameter.name, value)
        return tuple(result)

    def _points(self) -> tuple[Definition, ...]:
        result = []
        for name, raw in self._table("points").items():
            key = f"[points] {_shown(name)}"
            if not isinstance(raw, list) or len(raw) != 3:
                self._fail(key, "a point is a list of three coordinates, [x, y, z]")
            value = point(*(self._scalar(f"{key}[{i}]", x) for i, x in enumerate(raw)))
            text = "[" + ", ".join(_written(x) for x in raw) + "]"
            result.append(Definition(name, text, value))
        for definition in result:
            self._define(f"[points] {definition.name}", definition.name, definition.value)
        return self._move(result)

    def _move(self, points: list[Definition]) -> tuple[Definition, ...]:
        """Return the points with current points in the place of those that are moved."""
        known = self._names | {p: symbol(p) for p in PARAMETER_NAMES}
        moved = [self._current(d, known) if d.name in self._moved else d for d in points]
        self._names |= {d.name: d.value for d in moved}
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
        table = self._table("domain")
        self._check_keys(table, PARAMETER_NAMES, "[domain] ")
        limits: list[Interval] = []
        for name in PARAMETER_NAMES:
            key = f"[domain] {name}"
            raw = table.get(name, [ZERO, ONE])
            if not isinstance(raw, list) or len(raw) != 2:
                self._fail(key, "is a list of two limits, [lower, upper]")
            low, high = (x if isinstance(x, Expr) else self._scalar(key, x) for x in raw)
            limits.append((low, high))
        return limits[0], limits[1], limits[2]

    def _read_curves(self) -> None:
        for name, raw in self._table("curves").items():
            key = f"[curves.{_shown(name)}]"
            if not isinstance(raw, dict) or raw.get("kind") not in _CURVE_KEYS:
                self._fail(key, f"needs a kind, one of {', '.join(_CURVE_KEYS)}")
            required, optional = _CURVE_KEYS[raw["kind"]]
            self._check_keys(raw, ("kind", *required, *optional), f"{key} ")
            for needed in required:
                if needed not in raw:
                    self._fail(key, f"a {raw['kind']} needs the key {needed}")
            try:
                pair = self._curve(key, raw)
            except InputError as error:
                if isinstance(error, TemplateError):
                    raise
                self._fail(key, str(error))
            self._define(key, name, None)
            for axis, function in zip("xy", pair, strict=True):
                self._define(key, f"{name}_{axis}", None)
                self._curves[f"{name}_{axis}"] = function

    def _curve(self, key: str, raw: dict[str, Any]) -> curves.Curve:
        if raw["kind"] == "sine":
            values = (self._scalar(f"{key} {k}", raw[k]) for k in ("radius", "amplitude", "waves"))
            return curves.sine_wave(*values)
        nodes = raw["points"]
        if not isinstance(nodes, list) or not all(isinstance(n, list) and len(n) == 2
                                                  for n in nodes):  # fmt: skip
            self._fail(f"{key} points", "is a list of plane points, [[x, y], …]")
        plane = [
            (self._scalar(f"{key} points[{i}]", x), self._scalar(f"{key} points[{i}]", y))
            for i, (x, y) in enumerate(nodes)
        ]
        if raw["kind"] == "polygon":
            return curves.polygon(plane)
        return curves.contour(plane, self._scalar(f"{key} handle", raw.get("handle", "1/6")))

    def _lets(self) -> tuple[Definition, ...]:
        result = []
        for name, raw in self._table("let").items():
            key = f"[let] {_shown(name)}"
            value = self._expression(key, raw) if isinstance(raw, str) else self._scalar(key, raw)
            self._define(key, name, value)
            result.append(Definition(name, _written(raw), value))
        return tuple(result)

    def _solid(self) -> tuple[tuple[Definition, ...], Combination]:
        table = self._table("solid")
        self._check_keys(table, ("M", "x", "y", "z"), "[solid] ")
        if set(table) == {"M"}:
            key, raw = "[solid] M", table["M"]
            value = self._expression(key, raw) if isinstance(raw, str) else None
            if not isinstance(value, Combination) or kind_of(value).name != "POINT":
                what = kind_of(value).value if value is not None else "something else"
                self._fail(key, f"M must be a point equation in quotes, and {what} was given")
            return (Definition("M", str(raw), value),), value  # type: ignore[arg-type,return-value]
        if set(table) == {"x", "y", "z"}:
            trees = [self._scalar(f"[solid] {axis}", table[axis]) for axis in "xyz"]
            written = (
                Definition(a, _written(table[a]), t) for a, t in zip("xyz", trees, strict=True)
            )
            return tuple(written), point(*trees)
        return self._fail("[solid]", "needs either M or all of x, y and z")  # type: ignore[no-any-return]

    def _expected(self) -> dict[str, tuple[Expr, ...]]:
        table = self._table("expect")
        self._check_keys(table, _EXPECTED, "[expect] ")
        result = {}
        for name, raw in table.items() if not self._moved else ():
            # what is stated of the points as written need not hold of moved ones
            key = f"[expect] {name}"
            values = raw if name == "centroid" else [raw]
            if not isinstance(values, list) or len(values) != (3 if name == "centroid" else 1):
                self._fail(key, "is a list of three coordinates")
            trees = tuple(self._scalar(key, value) for value in values)
            if any(not tree.symbols.isdisjoint(PARAMETER_NAMES) for tree in trees):
                self._fail(key, "must not depend on u, v or w")
            result[name] = trees
        return result


def _written(raw: object) -> str:
    """Return a value of the file as text, numbers as decimals."""
    return repr(number(raw)) if isinstance(raw, Fraction) else str(raw)


def _shown(key: str) -> str:
    """Make a key safe for a one-line message."""
    return key if key.isprintable() and len(key) <= 80 else repr(key)[:80]
