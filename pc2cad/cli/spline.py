"""``pc2cad spline``: the equation itself, in all three parameters, as trivariate splines."""

from __future__ import annotations

import argparse

from pc2cad.cli.inputs import (
    add_options,
    add_template,
    bind,
    check_different,
    load_one,
    read_options,
)
from pc2cad.cli.output import Progress, say, shown, table
from pc2cad.errors import named


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template, the outputs and the options."""
    add_template(parser)
    parser.add_argument(
        "-o", "--output", metavar="FILE", action="append", required=True, dest="outputs",
        help="file to write, its format by its ending: .xml (G+Smo), .mesh (MFEM), .itd (IRIT), "
        ".g2 (GoTools) (repeatable)",
    )  # fmt: skip
    add_options(parser)
    parser.add_argument("--quiet", action="store_true", help="show no progress and no results")


def run(arguments: argparse.Namespace) -> int:
    """Represent the template's volume and write every file."""
    template, path = load_one(arguments)
    equation = bind(template, arguments)
    options = read_options(arguments)
    with Progress(arguments.quiet) as progress:
        progress("load NumPy and SciPy")
        from pc2cad.compiler import spline_equation
        from pc2cad.export.spline_files import check_splines_writable, write_splines

        for output in arguments.outputs:
            check_splines_writable(output)
        check_different(arguments.outputs, path)
        with named(arguments.template):
            model, checked = spline_equation(equation, options, progress)
        for output in arguments.outputs:
            write_splines(model, output)
    if arguments.quiet:
        return 0
    known = f"deviation {model.deviation:.2g} ({model.evidence})"
    how = "exact" if model.evidence == "exact" else known
    kind = "rational " if model.rational else ""
    for output in arguments.outputs:
        count = len(model.patches)
        say(f"{shown(output)}: {count} {kind}patch{'' if count == 1 else 'es'}, {how}")
    axes = "".join("uvw"[d] for d in model.directions)
    rows = [("patch", f"degrees along {axes}", "poles", "deviation")]
    for index, patch in enumerate(model.patches, start=1):
        rows.append((
            str(index), " x ".join(map(str, patch.volume.degrees)),
            " x ".join(map(str, patch.volume.poles.shape[:3])), f"{patch.deviation:.2g}",
        ))  # fmt: skip
    say(table(rows))
    found = model.volume()
    off = found / checked.mass.volume - 1
    say(table([("volume", f"{found:.12g} {model.units}^3", f"{off:+.1e}")]))
    return 0
