"""``pc2cad spline``: the equation itself, in all three parameters, as trivariate splines."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from pc2cad.cli.inputs import (
    add_options,
    add_template,
    add_velocity,
    bind,
    check_different,
    load_one,
    read_options,
    with_velocities,
)
from pc2cad.cli.output import Progress, say, shown, table
from pc2cad.errors import InputError, named

if TYPE_CHECKING:
    from pc2cad.checked import CheckedMap
    from pc2cad.equation.point_equation import PointEquation
    from pc2cad.representation.volume import VolumeModel


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template, the outputs and the options."""
    add_template(parser)
    parser.add_argument(
        "-o", "--output", metavar="FILE", action="append", required=True, dest="outputs",
        help="file to write, its format by its ending: .xml (G+Smo), .mesh (MFEM), .itd (IRIT), "
        ".g2 (GoTools) (repeatable)",
    )  # fmt: skip
    parser.add_argument(
        "--field", metavar="NAME=FILE", action="append", default=[], dest="fields",
        help="write a field of the template as splines on the same spaces: .xml (G+Smo), .gf "
        "(MFEM, beside its .mesh) (repeatable)",
    )  # fmt: skip
    add_velocity(parser, "splines")
    add_options(parser)
    parser.add_argument("--quiet", action="store_true", help="show no progress and no results")


def run(arguments: argparse.Namespace) -> int:
    """Represent the template's volume and write every file."""
    template, path = load_one(arguments)
    equation = with_velocities(bind(template, arguments), arguments.velocity)
    options = read_options(arguments)
    fields = [_field(equation, text) for text in arguments.fields]
    with Progress(arguments.quiet) as progress:
        progress("load NumPy and SciPy")
        from pc2cad.compiler import spline_equation
        from pc2cad.export.spline_files import (
            check_field_writable,
            check_splines_writable,
            write_splines,
        )

        for output in arguments.outputs:
            check_splines_writable(output)
        for output, _ in fields:
            check_field_writable(output)
        check_different((*arguments.outputs, *(file for file, _ in fields)), path)
        with named(arguments.template):
            model, checked = spline_equation(equation, options, progress)
        for output in arguments.outputs:
            write_splines(model, output)
        for output, field in fields:
            write_splines(model, output, field=field)
    if not arguments.quiet:
        _tell(arguments.outputs, model, checked)
    return 0


def _tell(outputs: list[str], model: VolumeModel, checked: CheckedMap) -> None:
    """Say what was written, and how well it is known."""
    known = f"deviation {model.deviation:.2g} ({model.evidence})"
    how = "exact" if model.evidence == "exact" else known
    kind = "rational " if model.rational else ""
    for output in outputs:
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
    if model.fields:
        say(table([("field", "deviation in these spaces", "bound", "of"), *(
            (f.name, f"{f.deviation:.2g}", "-" if f.bound is None else f"{f.bound:.2g}",
             f"{f.largest:.3g}")
            for f in model.fields
        )]))  # fmt: skip
    found = model.volume()
    off = found / checked.mass.volume - 1
    say(table([("volume", f"{found:.12g} {model.units}^3", f"{off:+.1e}")]))


def _field(equation: PointEquation, text: str) -> tuple[str, str]:
    """Return the file and the name of a field; raise InputError where there is no such field."""
    name, sign, file = text.partition("=")
    if not (sign and file):
        raise InputError(f"--field '{text[:40]}': write a field and a file: heat=heat.xml")
    return file, equation.field(name).name
