"""``pc2cad spline``: the equation itself, in all three parameters, as trivariate splines."""

from __future__ import annotations

import argparse

from pc2cad.cli.inputs import (
    add_splines,
    add_template,
    add_tolerance,
    bind,
    check_different,
    load_one,
    named,
    read_length,
    spline_options,
)
from pc2cad.cli.output import Progress, say, shown, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template, the outputs and the options."""
    add_template(parser)
    parser.add_argument(
        "-o", "--output", metavar="FILE", action="append", required=True, dest="outputs",
        help="file to write, its format by its ending: .xml (G+Smo), .mesh (MFEM), .itd (IRIT), "
        ".g2 (GoTools) (repeatable)",
    )  # fmt: skip
    add_tolerance(parser)
    add_splines(parser)
    parser.add_argument("--quiet", action="store_true", help="show no progress and no results")


def run(arguments: argparse.Namespace) -> int:
    """Represent the template's volume and write every file."""
    template, path = load_one(arguments)
    equation = bind(template, arguments)
    tolerance = read_length("--tolerance", arguments.tolerance)
    with Progress(arguments.quiet) as progress:
        progress("load NumPy and SciPy")
        from pc2cad.export.spline_files import check_splines_writable, write_splines
        from pc2cad.geometry.profile import spline_profile
        from pc2cad.volume import spline_equation

        for output in arguments.outputs:
            check_splines_writable(output)
        check_different(arguments.outputs, path)
        profile = spline_profile(**spline_options(arguments))
        with named(arguments.template):
            model, volume = spline_equation(equation, tolerance, profile, progress)
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
    say(table([("volume", f"{found:.12g} {model.units}^3", f"{found / volume - 1:+.1e}")]))
    return 0
