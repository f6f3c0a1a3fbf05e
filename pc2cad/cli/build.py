"""``pc2cad build``: a template compiled into files."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from pc2cad.cli.figures import with_figures
from pc2cad.cli.inputs import (
    add_density,
    add_options,
    add_template,
    bind,
    check_different,
    load,
    read_densities,
    read_length,
    read_options,
)
from pc2cad.cli.output import Progress, say, shown, table
from pc2cad.errors import FileNotWrittenError, InputError, named

if TYPE_CHECKING:
    from pc2cad.equation.point_equation import PointEquation
    from pc2cad.export.model import ExportOptions
    from pc2cad.part import Part
    from pc2cad.templates.bodies import Bodies


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template, the outputs and the options."""
    from pc2cad.export.registry import FORMATS

    endings = ", ".join(ending for entry in FORMATS for ending in entry.extensions)
    add_template(parser)
    parser.add_argument(
        "-o", "--output", metavar="FILE", action="append", required=True, dest="outputs",
        help=f"file to write, its format by its ending: {endings} (repeatable)",
    )  # fmt: skip
    add_options(parser)
    add_density(parser)
    parser.add_argument("--report", metavar="FILE", help="write the report as JSON to this file")
    parser.add_argument(
        "--verify", action="store_true",
        help="hold every STEP file against the equation before it is put in its place, by a reader "
        "that shares nothing with the kernel; the verdict goes into the report",
    )  # fmt: skip
    parser.add_argument(
        "--schema", choices=("AP242", "AP214"), default="AP242",
        help="application protocol of STEP files (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--colours",
        "--colors",
        action="store_true",
        help="give every side of the box its own colour",
    )  # fmt: skip
    parser.add_argument(
        "--deflection", metavar="LENGTH",
        help="largest distance of a triangle's edge from its surface, in model units "
        "(formats of triangles)",
    )  # fmt: skip
    parser.add_argument(
        "--field", metavar="NAME", action="append", default=[], dest="fields",
        help="a scalar field of the template that goes into .3mf files and --slices (repeatable)",
    )  # fmt: skip
    parser.add_argument(
        "--slices", metavar="FILE", help="write a .zip of pictures across z, for printers: what is "
        "inside, and each --field in 16 bits",
    )  # fmt: skip
    parser.add_argument(
        "--voxels", type=int, metavar="N",
        help="voxels along the longest edge, for slices and fields that are pictures (default: 64)",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="show no progress and no results")
    parser.add_argument(
        "--list-formats", action=_ListFormats, nargs=0,
        help="show the formats, what each keeps of the solid, and exit",
    )  # fmt: skip


class _ListFormats(argparse.Action):
    """Prints the registry of formats."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from pc2cad.export.registry import FORMATS

        rows = [(" ".join(f.extensions), f.title, f.precision) for f in FORMATS]
        say(table([("ending", "format", "precision"), *rows], indent=""))
        parser.exit()


def run(arguments: argparse.Namespace) -> int:
    """Compile the template and write every file."""
    from pc2cad.export.model import ExportOptions

    template, path = load(arguments)
    equation = bind(template, arguments)
    wanted, density = read_options(arguments), read_densities(arguments.densities)
    options = ExportOptions(
        step_schema=arguments.schema, deflection=read_length("--deflection", arguments.deflection)
    )
    _check_outputs(arguments, path)
    with Progress(arguments.quiet) as progress:
        progress.first("loading the kernel")
        from pc2cad.compiler import compile_solid

        with named(arguments.template):
            part = compile_solid(equation, wanted, progress)
            part = replace(part, report=with_figures(part, part.report, density, progress))
        files, said = _encode(part, equation, options, arguments, progress)
        if arguments.slices is not None:
            from pc2cad.export.slices import stack

            progress("slices")
            voxels = part.voxels(arguments.fields, arguments.voxels)
            files[arguments.slices] = stack(voxels, part.units)
        progress("write")
        write_all(files)
    if not arguments.quiet:
        for output in arguments.outputs:
            mass = "" if part.report.mass is None else f", mass {part.report.mass.mass:.10g}"
            say(f"{shown(output)}: {part.report.summary}{mass}{_loss(output, part, options)}")
            for line in said.get(output, ()):
                say(f"  field {line}")
    return 0


def _loss(output: str, part: Part, options: ExportOptions) -> str:
    """Return what the file's format does to the solid, where it does something."""
    from pc2cad.export.registry import format_for

    if not format_for(output).triangles:
        return ""
    from pc2cad.export.surface import surface

    mesh, units = surface(part.exportable(), options), part.report.units
    share = mesh.volume / part.report.integrals.volume - 1
    return (
        f"; written as {len(mesh.triangles)} triangles, deflection {mesh.deflection:.3g} {units}, "
        f"volume {mesh.volume:.10g} {units}^3 ({100 * share:+.2g} %)"
    )


def _check_outputs(arguments: argparse.Namespace, template: Path) -> None:
    """Refuse, before the work begins, what could not be written at its end."""
    from pc2cad.export.files import by_ending, check_target
    from pc2cad.export.registry import check_writable, format_for

    for path in arguments.outputs:
        check_writable(path)
    if arguments.verify and not any(format_for(path).name == "step" for path in arguments.outputs):
        raise InputError("--verify holds STEP files against the equation; name one with -o")
    if arguments.slices is not None:
        by_ending(arguments.slices, {".zip": None}, "file of slices")
    elif arguments.fields and not any(format_for(path).fields for path in arguments.outputs):
        raise InputError("--field goes into .3mf files and --slices: name one")
    others = [path for path in (arguments.report, arguments.slices) if path is not None]
    for path in others:
        check_target(path)
    check_different((*arguments.outputs, *others), template)


def _encode(
    part: Part,
    equation: PointEquation | Bodies,
    options: ExportOptions,
    arguments: argparse.Namespace,
    progress: Progress,
) -> tuple[dict[str, bytes], dict[str, tuple[str, ...]]]:
    """Return the contents of every file, and what is to be said of the fields in them.

    What fails here leaves no file at all.
    """
    from pc2cad.export.registry import format_for

    plain = part.exportable(arguments.colours)
    files, said, verdicts = {}, {}, {}
    for path in arguments.outputs:
        kind = format_for(path)
        progress(f"encode {kind.name}")
        exportable = plain
        if arguments.fields and kind.fields:
            exportable = part.exportable(arguments.colours, arguments.fields, arguments.voxels)
            said[path] = exportable.fields_said
        files[path] = kind.encoder()(exportable, options)
        if arguments.verify and kind.name == "step":
            from pc2cad.verify.gate import require_verified

            progress("verify")
            with named(path):
                verdicts[path] = require_verified(files[path], equation, part.report.tolerance)
    if arguments.report is not None:
        found = part.report.to_dict() | ({"verified": verdicts} if arguments.verify else {})
        text = json.dumps(found, indent=2, allow_nan=False)
        files[arguments.report] = f"{text}\n".encode()
    return files, said


def write_all(files: dict[str, bytes]) -> None:
    """Write the files in turn; an error says which of them are there."""
    from pc2cad.export.files import write_atomically

    written: list[str] = []
    for path, data in files.items():
        try:
            write_atomically(path, data)
        except FileNotWrittenError as error:
            if written:
                error.args = (f"{error}; written before it: {', '.join(written)}",)
            raise
        written.append(path)
