"""``pc2cad adjust``: parameters for which a solid has a wanted volume, mass or other figure."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pc2cad.cli.build import write_all
from pc2cad.cli.inputs import (
    add_density,
    add_options,
    add_template,
    check_different,
    load,
    read_densities,
    read_options,
    read_settings,
)
from pc2cad.cli.output import Progress, one_line, say, shown, table
from pc2cad.errors import InputError, named

if TYPE_CHECKING:
    from pc2cad.part import Part
    from pc2cad.studies.adjust import Adjusted


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template, what may change, what is wanted, and the files."""
    add_template(parser)
    parser.add_argument(
        "--vary", metavar="NAME=LOW:HIGH", action="append", required=True,
        help="a parameter that may change, and from where to where (repeatable)",
    )  # fmt: skip
    parser.add_argument(
        "--until", metavar="GOAL", action="append", default=[],
        help="FIGURE=VALUE, FIGURE<=VALUE or FIGURE>=VALUE, of volume, area, mass, the centroid's "
        "x, y, z, or Ixx, Ixy, … about the centre of mass (repeatable)",
    )  # fmt: skip
    parser.add_argument("--minimise", "--minimize", metavar="FIGURE", help="make this the least")
    parser.add_argument("--maximise", "--maximize", metavar="FIGURE", help="make this the most")
    add_density(parser)
    parser.add_argument(
        "-o", "--output", metavar="FILE", action="append", default=[], dest="outputs",
        help="write the solid with these values, as build does (repeatable)",
    )  # fmt: skip
    add_options(parser)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Adjust the parameters, write the files, tell the values."""
    template, path = load(arguments)
    options = read_options(arguments)
    if arguments.minimise and arguments.maximise:
        raise InputError("--minimise and --maximise cannot be asked for at once")
    density = read_densities(arguments.densities)
    _check_outputs(arguments.outputs, path)
    with Progress() as progress, named(arguments.template):
        from pc2cad.studies.adjust import adjust, read_goal, read_ranges

        found = adjust(
            template, read_ranges(arguments.vary), [read_goal(text) for text in arguments.until],
            minimise=arguments.minimise, maximise=arguments.maximise,
            values=read_settings(arguments.settings),
            density=density, progress=progress,
        )  # fmt: skip
        if arguments.outputs:
            from pc2cad.compiler import compile_solid

            part = compile_solid(found.equation, options, progress)
            files = _encoded(part, arguments.outputs, progress)
            progress("write")
            write_all(files)
    _tell(found, arguments.outputs, arguments.json, template.title or template.name)
    return 0


def _check_outputs(outputs: Sequence[str], template: Path) -> None:
    """Refuse, before the work begins, what could not be written at its end."""
    from pc2cad.export.registry import check_writable

    for path in outputs:
        check_writable(path)
    check_different(outputs, template)


def _encoded(part: Part, outputs: Sequence[str], progress: Progress) -> dict[str, bytes]:
    """Return the contents of every file: what fails here leaves no file at all."""
    from pc2cad.export.model import ExportOptions
    from pc2cad.export.registry import format_for

    exportable, files = part.exportable(), {}
    for path in outputs:
        kind = format_for(path)
        progress(f"encode {kind.name}")
        files[path] = kind.encoder()(exportable, ExportOptions())
    return files


def _tell(found: Adjusted, outputs: Sequence[str], as_json: bool, title: str) -> None:
    if as_json:
        say(json.dumps({
            "name": found.equation.name, "units": found.equation.units,
            "parameters": dict(found.parameters), "figures": dict(found.figures),
            "goals": [
                {**vars(goal), "found": found.figures[goal.figure]} for goal in found.goals
            ],
            "at_limits": list(found.at_limits), "evaluations": found.evaluations,
            "files": [str(Path(output)) for output in outputs],
        }, indent=2, allow_nan=False))  # fmt: skip
        return
    say(one_line(title))
    rows = [(name, f"{value!r}", "at its limit" if name in found.at_limits else "")
            for name, value in found.parameters.items()]  # fmt: skip
    say(table([("parameter", "value", ""), *rows]))
    say(table([(name, f"{value:.12g}") for name, value in found.figures.items()]))
    say(f"  {', '.join(map(str, found.goals)) or 'no goals'}; {found.evaluations} evaluations")
    for output in outputs:
        say(f"  written: {shown(output)}")
