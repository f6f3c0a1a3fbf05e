"""``pc2cad show``: the point equation, and its coordinate-wise system."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pc2cad.cli.inputs import add_template, bind, load, read_settings
from pc2cad.cli.output import one_line, say
from pc2cad.templates.bodies import Bodies, BodiesTemplate
from pc2cad.trust.names import visible

if TYPE_CHECKING:
    from pc2cad.equation.point_equation import PointEquation
    from pc2cad.templates.header import Parameter
    from pc2cad.templates.template import Template


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template and ``--latex``."""
    add_template(parser)
    parser.add_argument("--latex", action="store_true", help="print LaTeX instead of text")


def run(arguments: argparse.Namespace) -> int:
    """Print the equation and its system."""
    template, path = load(arguments)
    bound = bind(template, arguments)
    moved, _ = template.split(read_settings(arguments.settings))
    template = template.move(moved) if moved else template
    bodies = template.bodies if isinstance(template, BodiesTemplate) else (template,)
    equations = bound.equations.values() if isinstance(bound, Bodies) else (bound,)
    if isinstance(template, BodiesTemplate):
        mark = "% " if arguments.latex else ""
        say(f"{mark}{one_line(f'{template.name}: {template.title}')}")
        say(f"{mark}  result = {template.result}\n")
    for number, (body, equation) in enumerate(zip(bodies, equations, strict=True)):
        if number:
            say("")
        for line in _latex(body) if arguments.latex else _text(body, equation, path):
            say(line)
    return 0


def _text(template: Template, equation: PointEquation, path: Path) -> Iterator[str]:
    from pc2cad.equation.points import Combination
    from pc2cad.expression.printing import as_text
    from pc2cad.templates.coordinatewise import coordinate_system

    yield one_line(f"{template.name}: {template.title}")
    yield from (f"  {one_line(line)}" for line in template.about.strip().splitlines())
    if template.source:
        yield f"  source: {one_line(template.source)}"
    if template.parameters:
        yield "\nParameters"
        yield from (
            f"  {p.name} = {equation.parameters[p.name]:.12g}{_meaning(p)}"
            for p in template.parameters
        )
    if template.points:
        yield f"\nPoints ({template.units})"
    for point in template.points:
        assert isinstance(point.value, Combination)
        coordinates = ", ".join(as_text(c) for c in point.value.coordinates)
        yield f"  {point.name} = [{coordinates}]"
    yield "\nDomain"
    for name, (low, high) in zip("uvw", template.domain, strict=True):
        yield f"  {as_text(low)} <= {name} <= {as_text(high)}"
    yield from _curves(template, path)
    if template.guide is not None:
        yield f"\nGuide\n  N(u): {one_line(template.guide.words)}"
    if template.frame is not None:
        yield f"\nFrame\n  R = N + normal, Q = N + binormal: {one_line(template.frame.words)}"
    if template.layers:
        yield "\nLayers (from w = 0 up, each with the same share of w; depth(w): all below w)"
        yield from (f"  {d.name} = {one_line(d.text)}" for d in template.layers)
    yield "\nPoint equation"
    for definition in (*template.lets, *template.solid):
        yield f"  {definition.name} = {one_line(definition.text)}"
    yield from _fields(equation)
    yield "\nCoordinate-wise system"
    for expansion in coordinate_system(template):
        yield from (f"  {row.name} = {row.text}" for row in expansion.rows)


def _fields(equation: PointEquation) -> Iterator[str]:
    """Yield each field with its components, of which x, y and z are the solid's own point."""
    from pc2cad.expression.printing import as_text

    if equation.fields:
        yield "\nFields (of u, v, w and the place x, y, z)"
    for field in equation.fields:
        texts = ", ".join(map(as_text, field.components))
        shown = texts if field.kind == "scalar" else f"{field.kind}({texts})"
        yield f"  {field.name} = {shown}"


def _meaning(parameter: Parameter) -> str:
    from pc2cad.expression.printing import as_text

    low, high = parameter.minimum, parameter.maximum
    parts = []
    if low is not None and high is not None:
        parts.append(f"{as_text(low)} to {as_text(high)}")
    elif low is not None:
        parts.append(f"from {as_text(low)}")
    elif high is not None:
        parts.append(f"to {as_text(high)}")
    parts.append(f"default {as_text(parameter.default)}")
    about = f"  {one_line(parameter.about)}" if parameter.about else ""
    return f"  ({', '.join(parts)}){about}"


def _curves(template: Template, path: Path) -> Iterator[str]:
    """Yield what each curve and series is in words, and its formula where it has one."""
    if not (template.curves or template.data):
        return
    import tomllib

    from pc2cad.expression.printing import as_text
    from pc2cad.expression.tree import symbol, walk

    raw = tomllib.loads(path.read_text(encoding="utf-8"))
    if "fourier" in raw:
        yield "\nSeries (sums of c*cos(m*theta - n*periods*phi) and c*sin(m*theta - n*periods*phi))"
    for name, table in raw.get("fourier", {}).items():
        counts = ", ".join(f"{len(table.get(part, []))} of {part}" for part in ("cos", "sin"))
        yield f"  {name}(theta, phi): periods = {table.get('periods', 1)}; waves: {counts}"
    yield from _tables(template, raw)
    if "curves" not in raw:
        return
    yield "\nCurves (coordinates in the plane of the section, once round for t from 0 to 1)"
    for name, table in raw["curves"].items():
        yield f"  {name}_x(t), {name}_y(t): {visible(_in_words(table))}"
        for axis in "xy":
            tree = template.curves[f"{name}_{axis}"](symbol("t"))
            if not any(node.op == "pieces" for node in walk((tree,))):
                yield f"    {name}_{axis}(t) = {as_text(tree)}"


def _tables(template: Template, raw: dict[str, Any]) -> Iterator[str]:
    """Yield the size of each list, and what each table is a function of."""
    if template.data:
        yield "\nData (entries counted from 0)"
    for name, listed in template.data.items():
        size = (
            len(listed.rows[0]) if listed.plain else f"{len(listed.rows)} x {len(listed.rows[0])}"
        )
        yield f"  {name}: {size} entries"
    if "tables" in raw:
        yield "\nTables (functions through given values, between their first and last places)"
    for name, given in raw.get("tables", {}).items():
        table = template.curves[name].table
        rows = zip(table.places, table.periodic, strict=True)
        ranges = "; ".join(
            f"{len(places)} places from {float(places[0]):g} to {float(places[-1]):g}"
            + (", periodic" if turns else "") for places, turns in rows
        )  # fmt: skip
        through = "points" if "points" in given else "values"
        yield f"  {name}({', '.join('abc'[: table.arity])}): {given.get('kind', 'cubic')}, " \
              f"{through} at {ranges}"  # fmt: skip


def _in_words(table: dict[str, Any]) -> str:
    kind = table["kind"]
    given = ", ".join(f"{k} = {v}" for k, v in table.items() if k not in ("kind", "points"))
    through = ""
    if "points" in table:
        nodes = ", ".join(f"({x}, {y})" for x, y in table["points"])
        through = f" through {len(table['points'])} points, {nodes}"
    words = {
        "sine": "sine wave round a circle, r = radius + amplitude*sin(waves*phi)",
        "contour": "closed contour of first order of smoothness",
        "plane": "plane curve",
        "polar": "curve about the guide",
        "regular": "regular polygon",
    }.get(kind, kind)
    return f"{words}{through}{'; ' if given else ''}{given}"


def _latex(template: Template) -> Iterator[str]:
    from pc2cad.cli.typeset import definition_latex
    from pc2cad.expression.printing import name_latex
    from pc2cad.templates.coordinatewise import coordinate_system

    yield f"% {one_line(f'{template.name}: {template.title}')}"
    yield "% point equation (needs the package amsmath)"
    yield r"\begin{align*}"
    yield _aligned(
        (name_latex(d.name), definition_latex(d.text)) for d in (*template.lets, *template.solid)
    )
    yield r"\end{align*}"
    yield "% coordinate-wise system"
    yield r"\begin{align*}"
    for expansion in coordinate_system(template):
        rows = _aligned((row.name_latex, row.latex) for row in expansion.rows)
        yield rf"&\left\{{\begin{{aligned}}{chr(10)}{rows}{chr(10)}\end{{aligned}}\right.\\"
    yield r"\end{align*}"


def _aligned(equations: Iterable[tuple[str, str]]) -> str:
    return ",\\\\\n".join(f"  {left} &= {right}" for left, right in equations)
