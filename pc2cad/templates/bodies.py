"""Templates of several bodies: each a point equation, joined into one solid by Booleans.

A body has the tables of a template of one solid; texts, parameters, points, curves and the entries
of [let] of the file are common to all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from typing import Any, Final, Literal, cast

from pc2cad.equation.language import Curves, Named, nearest
from pc2cad.equation.point_equation import Expectations, PointEquation
from pc2cad.equation.syntax import (
    CallNode,
    ExpressionSyntaxError,
    NameNode,
    Node,
    operand_texts,
    parse,
)
from pc2cad.errors import InputError
from pc2cad.expression.tree import Expr
from pc2cad.expression.tree import number as as_number
from pc2cad.templates.header import Header, Moved, TemplateError
from pc2cad.templates.patterns import PATTERNS, Placement, check_operands, placements
from pc2cad.templates.reader import TABLES, TEXTS, Reader, read_tables
from pc2cad.templates.tables import Tables, shown
from pc2cad.templates.template import Template, expectations

MOST_BODIES: Final = 32
Kind = Literal["union", "cut", "intersect", "difference"]
KINDS: Final = ("union", "cut", "intersect", "difference")
_BODY_TABLES: Final = ("domain", "let", "guide", "frame", "solid", "fields", "expect")
_SHARED: Final = ("parameters", "points", "data", "curves", "fourier", "tables", "let")


@dataclass(frozen=True)
class Operation:
    """A Boolean of bodies and of other Booleans; a cut takes the others from the first.

    So does a difference, in one equation where the sum of two is proved to be that.
    """

    kind: Kind
    operands: tuple[Tree, ...]

    def __str__(self) -> str:
        return f"{self.kind}({', '.join(map(str, self.operands))})"


@dataclass(frozen=True)
class Pattern:
    """Copies of a body, or of a Boolean: the text of its operands, and where the copies lie.

    The places are known once the parameters have values. Copies are named ``tooth[0]``,
    ``tooth[1]`` …
    """

    kind: str
    operand: Tree
    texts: tuple[str, ...]
    copies: tuple[Placement, ...] = ()

    def __str__(self) -> str:
        return f"{self.kind}({', '.join((str(self.operand), *self.texts))})"


#: a body's name, a Boolean, or copies of one
Tree = str | Operation | Pattern


@dataclass(frozen=True, repr=False)
class Bodies:
    """The point equations of several bodies and how they make one solid."""

    equations: Mapping[str, PointEquation]
    result: Tree
    name: str
    title: str
    about: str
    units: str
    parameters: Mapping[str, float]
    expectations: Expectations
    #: the result with the places of its copies, at another value of one parameter
    placed_at: Callable[[str, Fraction], Tree] = field(repr=False, compare=False)

    def __repr__(self) -> str:
        given = ", ".join(f"{name}={value:g}" for name, value in self.parameters.items())
        return f"<Bodies {'; '.join(filter(None, (f'{self.name}: {self.result}', given)))}>"


@dataclass(frozen=True, repr=False)
class BodiesTemplate(Header):
    """A template of several bodies as read."""

    #: each a template of its own, with the parameters and points of all
    bodies: tuple[Template, ...]
    result: Operation | Pattern
    #: reads what is expected of the result, with values for the parameters and other points
    _expected: Any = field(repr=False)
    #: what replaces points
    _moved: Mapping[str, Moved] = field(default_factory=dict, repr=False)

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
        every = {**self._moved, **points}
        return replace(self, bodies=moved, points=moved[0].points, _moved=every)

    def bind(self, values: Mapping[str, Any] | None = None) -> Bodies:
        """Return the bodies with these parameter values, as `Template.bind` does."""
        equations = {body.name: body.bind(values) for body in self.bodies}
        given = next(iter(equations.values())).parameters
        bound, given_points = self.values(values)
        moved = {**self._moved, **given_points}
        head = self._expected(bound, moved)
        expected = expectations(self.name, head["expected"], bound)
        try:
            result = cast("Operation | Pattern", _placed(self.result, head["names"]))
        except InputError as error:
            raise TemplateError(f"{self.name}: result: {error}") from error
        return Bodies(
            equations, result, self.name, self.title, self.about, self.units, given, expected,
            partial(self._placed_at, bound, moved),
        )  # fmt: skip

    def _placed_at(
        self, bound: Mapping[str, Expr], moved: Mapping[str, Moved], name: str, value: Fraction
    ) -> Tree:
        there = {**bound, name: as_number(value)}
        return _placed(self.result, self._expected(there, moved)["names"])


def read_bodies(name: str, file: str, data: dict[str, Any]) -> BodiesTemplate:
    """Return the template of several bodies that a file's tables hold; raise TemplateError."""
    tables = Tables(file, data)
    tables.check_keys(data, (*TEXTS, *TABLES, "bodies", "result"), "")
    rows = _rows(tables)
    own = [key for key in ("domain", "guide", "frame", "solid", "fields") if key in data]
    if "layers" in data:
        tables.fail("[layers]", "a template of several bodies has no layers")
    if own:
        tables.fail(f"[{own[0]}]", f"belongs to a body, as [bodies.{own[0]}] below its [[bodies]]")
    shared: dict[str, Any] = {k: data[k] for k in (*TEXTS, *_SHARED) if k in data}
    head = partial(_shared, file, {**shared, "expect": data.get("expect", {})})
    known = head({}, {})
    del known["expected"], known["names"]
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
    if len(raw) < (1 if any(name in str(tables.data.get("result")) for name in PATTERNS) else 2):
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
        if name in (*KINDS, *PATTERNS):
            tables.fail(key, f"the name {name} is reserved")
        names.define(key, name, None)
        if name in rows:
            tables.fail(key, f"the name {name} is defined twice")
        common = [part for part in row if part in _SHARED and part != "let"]
        if common:
            tables.fail(f"{key}: {common[0]}", f"is common to all bodies: write [{common[0]}] once")
        tables.check_keys(row, ("name", "about", *_BODY_TABLES), f"{key}: ")
        rows[name] = row
    return rows


def _result(tables: Tables, bodies: list[str]) -> Operation | Pattern:
    text = tables.text("result")
    if not text:
        tables.fail("result", f'is missing: how the bodies join, for example "union({bodies[0]}, '
                    f'{bodies[1]})"')  # fmt: skip
    try:
        tree = _operation(parse(text), text, bodies)
    except InputError as error:
        tables.fail("result", str(error))
    if isinstance(tree, str):
        tables.fail("result", f"takes one body, {tree}, and no Boolean of it with another")
    unused = [name for name in bodies if name not in set(_names(tree))]
    if unused:
        tables.fail("result", f"the body {unused[0]} is not used")
    return cast("Operation | Pattern", tree)


def _placed(tree: Tree, known: tuple[Mapping[str, Named], Curves]) -> Tree:
    """Return the tree with the places of its copies."""
    if isinstance(tree, str):
        return tree
    if isinstance(tree, Operation):
        return Operation(tree.kind, tuple(_placed(operand, known) for operand in tree.operands))
    copies = placements(tree.kind, tree.texts, *known)
    return replace(tree, operand=_placed(tree.operand, known), copies=copies)


def _operation(node: Node, text: str, bodies: list[str]) -> Tree:
    if isinstance(node, NameNode):
        if node.name not in bodies:
            raise ExpressionSyntaxError(
                f"no body is called '{node.name}'{nearest(node.name, bodies)}", node.column
            )
        return node.name
    if not isinstance(node, CallNode):
        raise ExpressionSyntaxError(
            "bodies are joined by union(a, b), cut(a, b), intersect(a, b) and difference(a, b); "
            "sums of points belong into an equation", node.column,
        )  # fmt: skip
    if node.name in PATTERNS:
        check_operands(node)
        body = _operation(node.operands[0], text, bodies)
        return Pattern(node.name, body, operand_texts(text, node)[1:])
    if node.name not in KINDS:
        known = (*KINDS, *PATTERNS)
        raise ExpressionSyntaxError(
            f"'{node.name}' is none of {', '.join(known)}{nearest(node.name, known)}", node.column
        )
    if len(node.operands) < 2:
        raise ExpressionSyntaxError(f"{node.name} takes two bodies or more", node.column)
    return Operation(
        cast(Kind, node.name), tuple(_operation(operand, text, bodies) for operand in node.operands)
    )


def _names(tree: Tree) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    else:
        for operand in tree.operands if isinstance(tree, Operation) else (tree.operand,):
            yield from _names(operand)
