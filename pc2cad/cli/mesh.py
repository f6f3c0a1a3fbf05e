"""``pc2cad mesh``: a template compiled into a volume mesh for finite elements."""

from __future__ import annotations

import argparse
import json
import os
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

from pc2cad.cli.deck import add_deck, for_deck, is_job, read_deck
from pc2cad.cli.inputs import (
    add_options,
    add_template,
    add_velocity,
    bind,
    check_different,
    load,
    put,
    read_length,
    read_options,
    read_triple,
    with_velocities,
)
from pc2cad.cli.output import Progress, say, shown, table
from pc2cad.errors import InputError, named

if TYPE_CHECKING:
    from pc2cad.mesh.grid import Grading
    from pc2cad.mesh.meshing import MeshOptions
    from pc2cad.mesh.report import MeshReport


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template, the outputs and the options."""
    add_template(parser)
    parser.add_argument(
        "-o", "--output", metavar="FILE", action="append", required=True, dest="outputs",
        help="file to write, its format by its ending: .vtu, .inp (CalculiX, Abaqus), .msh "
        "(gmsh), .vtk, .med (repeatable)",
    )  # fmt: skip
    cells = parser.add_mutually_exclusive_group()
    cells.add_argument(
        "--cells", metavar="NxNxN", help="cells along u, v and w, e.g. 40x24x3; tetrahedra get "
        "the size of as many cubes that fill the volume",
    )  # fmt: skip
    cells.add_argument(
        "--size", metavar="LENGTH",
        help="length of the longest cells, in model units (default: a tenth of the cube root of "
        "the volume)",
    )  # fmt: skip
    parser.add_argument(
        "--tetrahedra", action="store_true",
        help="mesh the B-rep with tetrahedra by gmsh (pip install 'pc2cad[fea]') instead",
    )  # fmt: skip
    parser.add_argument(
        "--core", choices=("grid", "ogrid"), default="grid",
        help="at an axis or a centre: cells of the grid, which become wedges, pyramids and "
        "tetrahedra there, or an O-grid of hexahedra alone (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--order", type=int, choices=(1, 2),
        help="order of the elements: 2 has curved ones with a node on every edge "
        "(default: 1, in a job 2)",
    )  # fmt: skip
    parser.add_argument(
        "--grade", metavar="DIRECTION=RATIO", action="append", default=[],
        help="let cells grow along u, v or w: length at the end over that at the start (w=4; of n "
        "cells the last is 4^((n-1)/n) times the first), or in the middle over both ends "
        "(w=4,both) (repeatable)",
    )  # fmt: skip
    add_velocity(parser, "nodes and cells")
    add_deck(parser)
    add_options(parser)
    parser.add_argument("--report", metavar="FILE", help="write the report as JSON to this file")
    parser.add_argument("--quiet", action="store_true", help="show no progress and no results")


def run(arguments: argparse.Namespace) -> int:
    """Mesh the template and write every file."""
    template, path = load(arguments)
    equation = bind(template, arguments)
    if arguments.velocity is not None:
        from pc2cad.templates.bodies import Bodies

        if isinstance(equation, Bodies):
            raise InputError("--velocity: fields belong to one equation; choose a --body")
        equation = with_velocities(equation, arguments.velocity)
    wanted = read_options(arguments)
    deck = read_deck(arguments)
    with Progress(arguments.quiet) as progress:
        progress("load NumPy and SciPy")
        from pc2cad.compiler import mesh_equation
        from pc2cad.export.deck import write_deck
        from pc2cad.export.files import check_target, write_atomically
        from pc2cad.export.mesh_files import check_mesh_writable, write_mesh

        options = for_deck(_options(arguments), deck, arguments)
        for output in arguments.outputs:
            check_mesh_writable(output)
        if arguments.report is not None:
            check_target(arguments.report)
        reports = () if arguments.report is None else (arguments.report,)
        check_different((*arguments.outputs, *reports), path)
        with named(arguments.template):
            mesh, report = mesh_equation(equation, options, progress, wanted)
        for output in arguments.outputs:
            progress(f"write {os.path.basename(output)}")
            if deck is not None and is_job(output):
                write_deck(mesh, output, deck)
            else:
                write_mesh(mesh, output)
        if arguments.report is not None:
            text = json.dumps(report.to_dict(), indent=2, allow_nan=False)
            write_atomically(arguments.report, f"{text}\n".encode())
    if not arguments.quiet:
        for output in arguments.outputs:
            say(f"{shown(output)}: {_summary(report)}")
        for paragraph in _paragraphs(report):
            say(paragraph)
    return 0


def _options(arguments: argparse.Namespace) -> MeshOptions:
    from pc2cad.mesh.meshing import MeshOptions

    return MeshOptions(
        _cells(arguments.cells), read_length("--size", arguments.size), arguments.order or 1,
        "tetrahedra" if arguments.tetrahedra else "hexahedra", _grading(arguments.grade),
        arguments.core,
    )  # fmt: skip


def _cells(text: str | None) -> tuple[int, int, int] | None:
    if text is None:
        return None
    cells = read_triple("--cells", text, "x")
    if min(cells) < 1:
        raise InputError(f"--cells {text[:40]}: there is at least one cell along u, v and w")
    return cells


def _grading(texts: list[str]) -> tuple[Grading, Grading, Grading]:
    from pc2cad.mesh.grid import Growth, gradings

    wanted: dict[str, Growth] = {}
    for text in texts:
        found = re.fullmatch(r"([uvw])=([0-9.eE+-]+)(,both)?", text.strip())
        try:
            ratio = float(found[2]) if found else 0.0
        except ValueError:
            ratio = 0.0
        if found is None or not 1e-6 <= ratio <= 1e6:
            raise InputError(
                f"--grade '{text[:40]}': write a direction and a ratio between 1e-6 and 1e6, for "
                "example w=4 or w=4,both"
            )
        growth: Growth = ratio if found[3] is None else (ratio, "both")
        put(wanted, found[1], growth, f"--grade {found[1]}")
    return gradings(wanted)


def _summary(report: MeshReport) -> str:
    kinds = ", ".join(f"{count} {_plural(kind, count)}" for kind, count in report.elements.items())
    return f"{report.nodes} nodes; {kinds} of order {report.order}"


def _plural(kind: str, count: int) -> str:
    names = {"hexahedron": "hexahedra", "wedge": "wedges", "pyramid": "pyramids"}
    if count == 1:
        return "tetrahedron" if kind == "tetra" else kind
    return names.get(kind, "tetrahedra")


def _paragraphs(report: MeshReport) -> Iterator[str]:
    quality = report.quality
    rows = [
        ("volume", f"{report.volume:.10g} {report.units}^3",
         f"{report.volume_difference:+.1e} of the equation's"),
        ("scaled Jacobian", f"{quality.scaled_jacobian:.3g}",
         f"mean {quality.mean_scaled_jacobian:.3g}"),
        ("aspect", f"{quality.aspect:.3g}", f"mean {quality.mean_aspect:.3g}"),
    ]  # fmt: skip
    if report.cells is not None:
        rows.insert(0, ("cells", "x".join(map(str, report.cells)), "along u, v, w"))
    yield table(rows)
    if report.layers:
        yield table(
            [("layer", "elements", "volume", "difference")]
            + [
                (name, str(layer.elements), f"{layer.volume:.10g} {report.units}^3",
                 f"{layer.volume / layer.equation_volume - 1:+.1e}")
                for name, layer in report.layers.items()
            ]
        )  # fmt: skip
    yield table(
        [("side", "facets", "area", "difference")]
        + [
            (name, str(side.facets), f"{side.area:.10g} {report.units}^2",
             f"{side.area / side.equation_area - 1:+.1e}")
            for name, side in report.sides.items()
        ]
    )  # fmt: skip
