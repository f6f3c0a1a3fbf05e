"""``pc2cad points``: points of the solid's interior."""

from __future__ import annotations

import argparse

from pc2cad.cli.inputs import add_template, bind, check_different, load_one, read_length
from pc2cad.cli.output import Progress, say, shown
from pc2cad.errors import InputError, named


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template, the outputs and the options."""
    add_template(parser)
    parser.add_argument(
        "-o", "--output", metavar="FILE", action="append", required=True, dest="outputs",
        help="file to write, its format by its ending: .ply, .npz, .vtp (repeatable)",
    )  # fmt: skip
    parser.add_argument(
        "--method", choices=("uniform", "blue", "grid"), default="uniform",
        help="uniform: random, of equal density in space; blue: random, apart from one another; "
        "grid: a cubic lattice (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--count", type=int, metavar="N", help="number of points (uniform, blue)")
    parser.add_argument("--spacing", metavar="LENGTH", help="distance of the lattice (grid)")
    parser.add_argument(
        "--seed", type=int, default=0, help="start of the random numbers (default: %(default)s)"
    )
    parser.add_argument("--quiet", action="store_true", help="show no progress and no results")


def run(arguments: argparse.Namespace) -> int:
    """Sample the template's solid and write every file."""
    template, path = load_one(arguments)
    equation = bind(template, arguments)
    grid = arguments.method == "grid"
    if (arguments.count if grid else arguments.spacing) is not None:
        raise InputError("a grid has a --spacing, random points have a --count")
    spacing = read_length("--spacing", arguments.spacing)
    if grid and spacing is None:
        raise InputError("--method grid needs a --spacing")
    if arguments.seed < 0:
        raise InputError(f"--seed {arguments.seed}: must not be negative")
    with Progress(arguments.quiet) as progress:
        progress("load NumPy and SciPy")
        from pc2cad.checked import Stages, check_map
        from pc2cad.export.point_files import check_points_writable, write_points
        from pc2cad.sampling.interior import sample_blue, sample_grid, sample_uniform

        for output in arguments.outputs:
            check_points_writable(output)
        check_different(arguments.outputs, path)
        with named(arguments.template):
            checked = check_map(equation, stages=Stages(progress))
            progress("sample")
            if spacing is not None:
                points = sample_grid(checked, spacing)
            else:
                sample = sample_blue if arguments.method == "blue" else sample_uniform
                count = 1000 if arguments.count is None else arguments.count
                points = sample(checked, count, arguments.seed)
        for output in arguments.outputs:
            write_points(points, output)
    if not arguments.quiet:
        apart = f", at least {points.spacing:.4g} {points.units} apart" if points.spacing else ""
        for output in arguments.outputs:
            say(f"{shown(output)}: {len(points.points)} points{apart}")
    return 0
