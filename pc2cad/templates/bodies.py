"""Templates of several bodies: each a point equation, joined into one solid by Booleans.

A body has the tables of a template of one solid; texts, parameters, points, curves and the entries
of [let] of the file are common to all.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final, Literal, cast

from pc2cad.equation.language import nearest
from pc2cad.equation.point_equation import Expectations, PointEquation
from pc2cad.equation.syntax import CallNode, ExpressionSyntaxError, NameNode, Node, parse
from pc2cad.errors import InputError
from pc2cad.expression.tree import Expr
from pc2cad.templates.reader import TABLES, TEXTS, Reader, read_tables
from pc2cad.templates.tables import Tables, shown
from pc2cad.templates.template import Header, Moved, Template, expectations

MOST_BODIES: Final = 32
Kind = Literal["union", "cut", "intersect"]
KINDS: Final = ("union", "cut", "intersect")
_BODY_TABLES: Final = ("domain", "let", "guide", "frame", "solid", "expect")
_SHARED: Final = ("parameters", "points", "curves", "let")


@dataclass(frozen=True)
class Operation:
    """A Boolean of bodies and of other Booleans; a cut takes the others from the first."""

    kind: Kind
    operands: tuple[Tree, ...]

    def __str__(self) -> str:
        return f"{self.kind}({', '.join(map(str, self.operands))})"


#: a body's name, or a Boolean
Tree = str | Operation


@dataclass(frozen=True)
class Bodies:
    """The point equations of several bodies and how they make one solid."""

    equations: Mapping[str, PointEquation]
    result: Operation
    name: str
    title: str
    about: str
    units: str
    parameters: Mapping[str, float]
    expectations: Expectations


@dataclass(frozen=True)
class BodiesTemplate(Header):
    """A template of several bodies as read."""

    #: each a template of its own, with the parameters and points of all
    bodies: tuple[Template, ...]
    result: Operation
    #: reads what is expected of the result, with values for the parameters and other points
    _expected: Any = field(repr=False)

    def body(self, name: str) -> Template:
        """Return one body as a template of its own; raise InputError for an unknown name."""
        found = {body.name: body for body in self.bodies}
        if name not in found:
            raise InputError(
                f"{self.name} has no body '{name}' (it has: {', '.join(found)})"
                f"{nearest(name, found)}"
            )
        return found[name]

    def move(self, points: Mapping[str, Moved]) -> BodiesTemplate:
        """Return the template with some of its points replaced, as `Template.move` does."""
        moved = tuple(body.move(points) for body in self.bodies)
        return replace(self, bodies=moved, points=moved[0].points)

    def bind(self, values: Mapping[str, Any] | None = None) -> Bodies:
        """Return the bodies with these parameter values, as `Template.bind` does."""
        equations = {body.name: body.bind(values) for body in self.bodies}
        given = next(iter(equations.values())).parameters
        bound, moved = self.values(values)
        expected = expectations(self._expected(bound, moved)["expected"])
        return Bodies(
            equations, self.result, self.name, self.title, self.about, self.units, given, expected
        )


def read_bodies(name: str, file: str, data: dict[str, Any]) -> BodiesTemplate:
    """Return the template of several bodies that a file's tables hold; raise TemplateError."""
    tables = Tables(file, data)
    tables.check_keys(data, (*TEXTS, *TABLES, "bodies", "result"), "")
    rows = _rows(tables)
    own = [key for key in ("domain", "guide", "frame", "solid") if key in data]
    if "layers" in data:
        tables.fail("[layers]", "a template of several bodies has no layers")
    if own:
        tables.fail(f"[{own[0]}]", f"belongs to a body, as [bodies.{own[0]}] below its [[bodies]]")
    shared: dict[str, Any] = {k: data[k] for k in (*TEXTS, *_SHARED) if k in data}
    head = partial(_shared, file, {**shared, "expect": data.get("expect", {})})
    known = head({}, {})
    del known["expected"]
    bodies = []
    for body, row in rows.items():
        common, own_lets = tables.table("let"), row.get("let", {})
        if not isinstance(own_lets, dict):
            tables.fail(f"body {body}: let", "must be a table, [bodies.let]")
        again = [key for key in own_lets if key in common]
        if again:
            tables.fail(f"body {body}: [let] {shown(again[0])}", "is defined for all bodies")
        merged: dict[str, Any] = dict(shared)
        merged |= {key: value for key, value in row.items() if key in _BODY_TABLES}
        merged |= {
            "let": common | own_lets,
            "title": f"{known['title']}: {body}",
            "about": row.get("about", ""),
        }
        bodies.append(read_tables(body, f"{file}: body {body}", merged, {}, {}))
    result = _result(tables, list(rows))
    return BodiesTemplate(name, **known, bodies=tuple(bodies), result=result, _expected=head)


def _shared(
    file: str, data: dict[str, Any], bound: Mapping[str, Expr], moved: Mapping[str, Moved]
) -> dict[str, Any]:
    return Reader(file, data, bound, moved).shared()


def _rows(tables: Tables) -> dict[str, dict[str, Any]]:
    raw = tables.data.get("bodies", [])
    if not isinstance(raw, list) or not all(isinstance(row, dict) for row in raw):
        tables.fail("bodies", "each body is a table of its own, [[bodies]]")
    if len(raw) < 2:
        tables.fail("bodies", f"a result needs two bodies or more, [[bodies]]; here are {len(raw)}")
    if len(raw) > MOST_BODIES:
        tables.fail("bodies", f"there are {len(raw)} bodies; at most {MOST_BODIES} are allowed")
    names = Tables(tables.file, {})
    rows: dict[str, dict[str, Any]] = {}
    for number, row in enumerate(raw, start=1):
        name = row.get("name")
        if not isinstance(name, str):
            tables.fail(f"body {number}", 'needs a name, name = "…"')
        key = f"body {shown(name)}"
        if name in KINDS:
            tables.fail(key, f"the name {name} is reserved")
        names.define(key, name, None)
        if name in rows:
            tables.fail(key, f"the name {name} is defined twice")
        common = [part for part in row if part in ("parameters", "points", "curves")]
        if common:
            tables.fail(f"{key}: {common[0]}", f"is common to all bodies: write [{common[0]}] once")
        tables.check_keys(row, ("name", "about", *_BODY_TABLES), f"{key}: ")
        rows[name] = row
    return rows


def _result(tables: Tables, bodies: list[str]) -> Operation:
    text = tables.text("result")
    if not text:
        tables.fail("result", f'is missing: how the bodies join, for example "union({bodies[0]}, '
                    f'{bodies[1]})"')  # fmt: skip
    try:
        tree = _operation(parse(text), bodies)
    except InputError as error:
        tables.fail("result", str(error))
    if isinstance(tree, str):
        tables.fail("result", f"takes one body, {tree}, and no Boolean of it with another")
    unused = [name for name in bodies if name not in set(_names(tree))]
    if unused:
        tables.fail("result", f"the body {unused[0]} is not used")
    return cast(Operation, tree)


def _operation(node: Node, bodies: list[str]) -> Tree:
    if isinstance(node, NameNode):
        if node.name not in bodies:
            raise ExpressionSyntaxError(
                f"no body is called '{node.name}'{nearest(node.name, bodies)}", node.column
            )
        return node.name
    if not isinstance(node, CallNode):
        raise ExpressionSyntaxError(
            "bodies are joined by union(a, b), cut(a, b) and intersect(a, b); sums of points "
            "belong into an equation", node.column,
        )  # fmt: skip
    if node.name not in KINDS:
        raise ExpressionSyntaxError(
            f"'{node.name}' is none of {', '.join(KINDS)}{nearest(node.name, KINDS)}", node.column
        )
    if len(node.operands) < 2:
        raise ExpressionSyntaxError(f"{node.name} takes two bodies or more", node.column)
    return Operation(
        cast(Kind, node.name), tuple(_operation(operand, bodies) for operand in node.operands)
    )


def _names(tree: Tree) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    else:
        for operand in tree.operands:
            yield from _names(operand)
