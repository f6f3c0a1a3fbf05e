"""``pc2cad render``: pictures of a template, PNG or SVG, without a display."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from pc2cad.cli.inputs import (
    add_options,
    add_template,
    bind,
    check_different,
    load,
    read_numbers,
    read_options,
    read_triple,
)
from pc2cad.cli.output import Progress, say, shown
from pc2cad.errors import InputError, named

if TYPE_CHECKING:
    from pc2cad.picture.style import Style


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template, the outputs and what the picture shows."""
    add_template(parser)
    parser.add_argument(
        "-o", "--output", metavar="FILE", action="append", required=True, dest="outputs",
        help="picture to write, .png or .svg by its ending (repeatable)",
    )  # fmt: skip
    add_options(parser)
    parser.add_argument(
        "--view", metavar="VIEW", default="iso",
        help="iso, front, back, left, right, top, bottom, or the direction to the eye as X,Y,Z "
        "(default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--size", metavar="WxH", default="960x640", help="pixels (%(default)s)")
    parser.add_argument(
        "--colours",
        "--colors",
        action="store_true",
        help="give every side of the box its own colour",
    )  # fmt: skip
    parser.add_argument(
        "--labels", action="store_true", help="name the sides; hidden and collapsed ones too"
    )
    parser.add_argument("--no-edges", action="store_true", help="leave out the edges of the faces")
    parser.add_argument(
        "--explode", metavar="SHARE", type=float, default=0.0,
        help="move the faces apart, by this share of the part's size",
    )  # fmt: skip
    parser.add_argument(
        "--isolines", metavar="N", type=int, default=0,
        help="draw N inner parameter lines in each direction of every face",
    )  # fmt: skip
    parser.add_argument(
        "--points", metavar="NU,NV,NW", help="draw the points of an even grid of the box instead"
    )
    parser.add_argument(
        "--map", choices=("deviation", "thickness"), dest="numbers",
        help="colour the faces by their distance from the equation, or by the wall's thickness",
    )  # fmt: skip
    parser.add_argument(
        "--across", choices=("u", "v", "w"),
        help="parameter across the wall, for --map thickness (default: the thinnest)",
    )  # fmt: skip
    parser.add_argument(
        "--field", metavar="NAME", help="colour the faces by a scalar field of the template"
    )
    parser.add_argument("--quiet", action="store_true", help="show no progress and no results")


def run(arguments: argparse.Namespace) -> int:
    """Compile the template and write every picture."""
    from pc2cad.export.files import check_target
    from pc2cad.picture.style import check_ending

    template, path = load(arguments)
    equation = bind(template, arguments)
    style, view = _style(arguments), _view(arguments.view)
    width, height = read_numbers("--size", arguments.size, int, "x", 2)
    for output in arguments.outputs:
        check_ending(output)
        check_target(output)
    check_different(arguments.outputs, path)
    with Progress(arguments.quiet) as progress:
        progress.first("loading the kernel")
        from pc2cad.compiler import compile_solid
        from pc2cad.picture.drawing import drawing
        from pc2cad.picture.image import camera_for, write_picture

        with named(arguments.template):
            part = compile_solid(equation, read_options(arguments), progress)
            progress("draw")
            scene = drawing(part, style)
        camera = camera_for(scene, view, (width, height))
        for output in arguments.outputs:
            write_picture(scene, camera, output)
    if not arguments.quiet:
        for output in arguments.outputs:
            say(f"{shown(output)}: {width} x {height} pixels{_range(scene.bar)}")
    return 0


def _range(bar: object) -> str:
    from pc2cad.picture.scene import Bar

    return f"; {bar.title}: {bar.low:.6g} to {bar.high:.6g}" if isinstance(bar, Bar) else ""


def _style(arguments: argparse.Namespace) -> Style:
    from pc2cad.picture.style import Style

    return Style(
        colours=arguments.colours,
        labels=arguments.labels,
        edges=not arguments.no_edges,
        explode=arguments.explode,
        isolines=arguments.isolines,
        points=None if arguments.points is None else read_triple("--points", arguments.points, ","),
        map=arguments.numbers,
        across=arguments.across,
        field=arguments.field,
    )


def _view(text: str) -> tuple[float, float, float]:
    from pc2cad.picture.camera import VIEWS

    if text in VIEWS:
        return VIEWS[text]
    if "," not in text:
        raise InputError(f"--view: '{text[:40]}' is none of {', '.join(VIEWS)}, nor X,Y,Z")
    x, y, z = read_numbers("--view", text, float, ",", 3)
    return x, y, z
