"""The tables of a template that make channels: [curves], [guide] and [frame]."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, Final

from pc2cad.channels import curves
from pc2cad.channels.outward import V, outward
from pc2cad.equation.points import Combination, Value, point, vector
from pc2cad.errors import InputError
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import PI, Expr, number, substitute, symbol
from pc2cad.templates.header import Definition, TemplateError
from pc2cad.templates.tables import Tables, shown

if TYPE_CHECKING:
    from pc2cad.channels.frames import Frame
    from pc2cad.channels.guides import Guide

#: kind of a table -> (required keys, optional keys)
Keys = Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]

CURVES: Final[Keys] = {
    "contour": (("points",), ("handle", "spacing")),
    "polygon": (("points",), ("radius",)),
    "regular": (("corners", "circumradius"), ("radius",)),
    "sine": (("radius", "amplitude", "waves"), ("radius_y",)),
    "ellipse": (("a", "b"), ()),
    "superellipse": (("a", "b", "exponent"), ()),
    "polar": (("r",), ()),
    "plane": (("x", "y"), ()),
}
GUIDES: Final[Keys] = {
    "curve": (("N",), ()),
    "helix": (("radius", "pitch", "turns"), ("end_radius",)),
    "spline": (("points",), ("closed", "spacing")),
    "polyline": (("points",), ("radius", "closed", "corners")),
    "composite": (("parts",), ("corners",)),
}
FRAMES: Final[Keys] = {
    "rotation-minimising": ((), ("start", "twist", "symmetry")),
    "point": (("E",), ("twist",)),
    "direction": (("direction",), ("twist",)),
    "frenet": ((), ("twist",)),
}
#: parts of a composite guide
MOST_PARTS: Final = 200
_T: Final = symbol("_t")


def _check_kind(tables: Tables, key: str, raw: object, kinds: Keys, default: str = "") -> str:
    """Return the kind of a table after a look at its keys."""
    table = raw if isinstance(raw, dict) else {}
    kind = str(table.get("kind", default))
    if kind not in kinds:
        tables.fail(key, f"needs a kind, one of {', '.join(kinds)}")
    required, optional = kinds[kind]
    tables.check_keys(table, ("kind", *required, *optional), f"{key} ")
    for needed in required:
        if needed not in table:
            article = "an" if kind[0] in "aeiou" else "a"
            tables.fail(key, f"{article} {kind} needs the key {needed}")
    return kind


def attempt(tables: Tables, key: str, make: Callable[[], Any]) -> Any:
    """Return what is made; an input error of it is one of the table's."""
    try:
        return make()
    except TemplateError:
        raise
    except InputError as error:
        return tables.fail(key, str(error))


# -- [curves] --------------------------------------------------------------------------------------


def read_curve(tables: Tables, name: str, raw: Any) -> None:
    """Define NAME_x(t) and NAME_y(t) for a curve, and its outward normal NAME_nx(t), NAME_ny(t)."""
    key = f"[curves.{shown(name)}]"
    kind = _check_kind(tables, key, raw, CURVES)
    pair = attempt(tables, key, partial(_curve, tables, key, kind, raw))
    tables.define(key, name, None)
    functions = (*pair, *_normal(tables, pair))
    for axis, function in zip(("x", "y", "nx", "ny"), functions, strict=True):
        tables.define(key, f"{name}_{axis}", None)
        tables.curves[f"{name}_{axis}"] = function


def _normal(tables: Tables, pair: curves.Curve) -> curves.Curve:
    """Return the curve's outward normal, which is not looked for before it is asked for."""

    @lru_cache(maxsize=1)
    def found() -> tuple[Expr, Expr]:
        return outward((pair[0](V), pair[1](V)), tables.valued)

    def along(axis: int, t: Expr) -> Expr:
        return substitute((found()[axis],), {"v": t})[0]

    return partial(along, 0), partial(along, 1)


def _curve(tables: Tables, key: str, kind: str, raw: dict[str, Any]) -> curves.Curve:
    def scalar(name: str) -> Expr:
        return tables.scalar(f"{key} {name}", raw[name])

    if kind == "sine":
        second = scalar("radius_y") if "radius_y" in raw else None
        return curves.sine_wave(scalar("radius"), scalar("amplitude"), scalar("waves"), second)
    if kind == "ellipse":
        return curves.ellipse(scalar("a"), scalar("b"))
    if kind == "superellipse":
        exponent = tables.constant(f"{key} exponent", raw["exponent"])
        return curves.superellipse(scalar("a"), scalar("b"), exponent)
    if kind == "polar":
        return curves.polar(_function(tables, f"{key} r", raw["r"]))
    if kind == "plane":
        return _function(tables, f"{key} x", raw["x"]), _function(tables, f"{key} y", raw["y"])
    if kind == "regular":
        count = tables.real(f"{key} corners", raw["corners"])
        if count != round(count) or not 3 <= count <= 1000:
            tables.fail(f"{key} corners", "is a whole number from 3 to 1000")
        corners = curves.regular_polygon(round(count), scalar("circumradius"))
    else:
        corners = [
            (tables.scalar(f"{key} points[{i}]", x), tables.scalar(f"{key} points[{i}]", y))
            for i, (x, y) in enumerate(tables.rows(f"{key} points", raw["points"], 2))
        ]
    if kind == "contour":
        spacing = raw.get("spacing", "uniform")
        if spacing != "uniform":
            corners = _bound(tables, corners)
        return curves.contour(corners, tables.scalar(f"{key} handle", raw.get("handle", "1/6")),
                              spacing)  # fmt: skip
    if "radius" not in raw:
        return curves.polygon(corners)
    radius = raw["radius"]
    key = f"{key} radius"
    radii = tables.few(key, radius) if isinstance(radius, list) else [radius] * len(corners)
    given = [tables.constant(key, r) for r in radii]
    return curves.rounded_polygon(_bound(tables, corners), given)


def _bound(tables: Tables, plane: list[tuple[Expr, Expr]]) -> list[tuple[Expr, Expr]]:
    roots = tables.valued(tuple(c for pair in plane for c in pair))
    return list(zip(roots[::2], roots[1::2], strict=True))


def _function(tables: Tables, key: str, raw: object) -> Callable[[Expr], Expr]:
    """Read a function of t (0 to 1) or phi (0 to 2π); u may occur, for a section that changes."""
    names = {"t": _T, "phi": 2 * PI * _T, "u": symbol("u")}
    for name in names:
        if name in tables.names:
            tables.fail(key, f"the name {name} means the curve's own parameter here")
    tree = tables.scalar(key, raw, names)
    return lambda t: substitute((tree,), {"_t": t})[0]


# -- [guide] ---------------------------------------------------------------------------------------


def read_guide(
    tables: Tables, interval: tuple[Value, Value]
) -> tuple[Guide | None, list[Definition]]:
    """Define the point N of a [guide], where there is one.

    A curve's N is an equation like those of [let]; that of other kinds has no text to show.
    """
    if "guide" not in tables.data:
        return None, []
    raw = tables.table("guide")
    made = attempt(tables, "[guide]", lambda: _guide(tables, "[guide]", raw, interval))
    guide, text, value = made
    tables.define("[guide]", "N", value)
    return guide, [Definition("N", text, value)]


def _guide(
    tables: Tables, key: str, raw: dict[str, Any], interval: tuple[Value, Value]
) -> tuple[Guide, str, Combination]:
    """Return a guide, its text and its point."""
    from pc2cad.channels import guides, polylines

    kind = _check_kind(tables, key, raw, GUIDES, "curve" if "N" in raw else "")
    if kind == "curve":
        value = tables.expression(f"{key} N", raw["N"])
        ends = [x if isinstance(x, Expr) else number(0) for x in interval]
        guide = guides.curve(tables.bound(value), ends)
        assert isinstance(value, Combination)
        return guide, str(raw["N"]), value
    if kind == "helix":
        values = [tables.constant(f"{key} {k}", raw[k]) for k in ("radius", "pitch", "turns")]
        if "end_radius" in raw:
            values.append(tables.constant(f"{key} end_radius", raw["end_radius"]))
        guide = guides.helix(*values)
    elif kind == "composite":
        corners = str(raw.get("corners", "refuse"))
        guide = guides.composite(_parts(tables, key, raw["parts"], interval), corners)
    else:
        points = [
            [tables.real(f"{key} points[{i}]", x) for x in row]
            for i, row in enumerate(tables.rows(f"{key} points", raw["points"], 3))
        ]
        closed = raw.get("closed", False)
        if not isinstance(closed, bool):
            tables.fail(f"{key} closed", "is true or false")
        if kind == "spline":
            guide = guides.spline(points, closed, str(raw.get("spacing", "chord")))
        else:
            radius = raw.get("radius", 0)
            radii = (
                [tables.real(f"{key} radius", r) for r in tables.few(f"{key} radius", radius)]
                if isinstance(radius, list) else tables.real(f"{key} radius", radius)
            )  # fmt: skip
            guide = polylines.polyline(points, radii, closed, str(raw.get("corners", "round")))
    if not all(isinstance(x, Expr) and -1e-12 <= evaluate(x, {}) <= 1 + 1e-12 for x in interval):
        tables.fail(key, f"a {kind} runs with u from 0 to 1, and the domain of u goes beyond")
    return guide, guide.words, guide.N


def _parts(tables: Tables, key: str, raw: object, interval: tuple[Value, Value]) -> list[Guide]:
    if not isinstance(raw, list) or not all(isinstance(part, dict) for part in raw):
        return tables.fail(f"{key} parts", "is a list of guides, [{ kind = …, … }, …]")  # type: ignore[no-any-return]
    if len(raw) > MOST_PARTS:
        tables.fail(f"{key} parts", f"has at most {MOST_PARTS} guides, here are {len(raw)}")
    from pc2cad.channels import guides

    rows = [part.get("points") for part in raw]
    if sum(len(row) for row in rows if isinstance(row, list)) > guides.MOST_PARTS:
        tables.fail(f"{key} parts", f"have more than {guides.MOST_PARTS} points in all")
    found: list[Guide] = []
    for i, part in enumerate(raw):
        if part.get("kind") == "composite":
            tables.fail(f"{key} parts[{i}]", "a composite guide cannot be a part of another")
        found.append(_guide(tables, f"{key} parts[{i}]", part, (number(0), number(1)))[0])
        if sum(len(guide.parts) for guide in found) > guides.MOST_PARTS:
            tables.fail(f"{key} parts", f"are more than {guides.MOST_PARTS} in all")
    return found


# -- [frame] ---------------------------------------------------------------------------------------


def read_frame(
    tables: Tables, guide: Guide | None, raw: dict[str, Any]
) -> tuple[Frame, list[Definition]]:
    """Define the points R and Q of a [frame], which is the default one where it says nothing."""
    if guide is None:
        return tables.fail("[frame]", "needs a [guide] to run along")  # type: ignore[no-any-return]
    frame = attempt(tables, "[frame]", lambda: _frame(tables, guide, raw))
    found = []
    for name, value in (("R", frame.R), ("Q", frame.Q)):
        tables.define("[frame]", name, value)
        found.append(Definition(name, frame.words, value))
    return frame, found


def _frame(tables: Tables, guide: Guide, raw: dict[str, Any]) -> Frame:
    from pc2cad.channels import frames

    kind = _check_kind(tables, "[frame]", raw, FRAMES, "rotation-minimising")
    reference = None
    for name in ("start", "E", "direction"):
        if name in raw:
            reference = tables.bound(_reference(tables, name, raw[name]))
    twist = tables.bound(tables.scalar("[frame] twist", raw.get("twist", 0)))
    assert isinstance(twist, Expr)
    symmetry = tables.real("[frame] symmetry", raw.get("symmetry", 1))
    if symmetry != round(symmetry) or not 1 <= symmetry <= 1000:
        tables.fail("[frame] symmetry", "is a whole number from 1 to 1000")
    return frames.frame(guide, kind, reference, twist, round(symmetry))


def _reference(tables: Tables, name: str, raw: object) -> Value:
    key = f"[frame] {name}"
    if not isinstance(raw, list):
        return tables.expression(key, raw)
    if len(raw) != 3:
        tables.fail(key, "is a list of three coordinates, [x, y, z]")
    x, y, z = (tables.scalar(f"{key}[{i}]", coordinate) for i, coordinate in enumerate(raw))
    return point(x, y, z) if name == "E" else vector(x, y, z)
