"""``pc2cad check``: everything that is known of a solid, and no file."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from pc2cad.cli import over_ranges
from pc2cad.cli.figures import with_figures
from pc2cad.cli.inputs import (
    add_density,
    add_options,
    add_template,
    bind,
    load,
    read_densities,
    read_options,
)
from pc2cad.cli.output import Progress, one_line, say, table
from pc2cad.errors import named

if TYPE_CHECKING:
    from pc2cad.arrays import Array
    from pc2cad.equation.point_equation import Expectations
    from pc2cad.integrals.inertia import Mass
    from pc2cad.report import EdgeReport, EquationReport, FaceReport, Report, TopologyReport


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template and the options."""
    add_template(parser)
    add_options(parser)
    parser.add_argument(
        "--triangles", action="store_true",
        help="hold the triangles that an STL file would hold against the equation, too",
    )  # fmt: skip
    add_density(parser)
    over_ranges.add_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print the report as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Compile the template in memory and print the report."""
    if arguments.over:
        return over_ranges.run(arguments)
    template, _ = load(arguments)
    equation = bind(template, arguments)
    options, density = read_options(arguments), read_densities(arguments.densities)
    with Progress() as progress:
        progress.first("loading the kernel")
        from pc2cad.compiler import compile_solid, with_arithmetic

        with named(arguments.template):
            part = compile_solid(equation, options, progress)
            report = part.report
            if arguments.triangles:
                progress("mesh")
                report = replace(report, triangles=part.triangle_integrals())
            report = with_figures(part, report, density, progress)
            if report.own is not None:
                from pc2cad.sampling.walls import thickness

                progress("wall")
                report = replace(report, thickness=thickness(part.checked.analysis))
                report = with_arithmetic(part, report, options, progress)
    if arguments.json:
        say(json.dumps(report.to_dict(), indent=2, allow_nan=False))
    else:
        for paragraph in _paragraphs(report, equation.expectations, part.bounding_box):
            say(paragraph)
    return 0


def _paragraphs(report: Report, expected: Expectations, box: Array) -> Iterator[str]:
    yield one_line(f"{report.name}: {report.title}" if report.title else report.name)
    yield f"  {report.verdict}"
    if report.parameters:
        yield "  " + ", ".join(f"{name} = {x:.12g}" for name, x in report.parameters.items())
    yield from _bodies(report) if report.own is None else _sides(report.own)
    yield f"\nFaces (deviation in {report.units}, area in {report.units}^2)"
    yield _faces(report)
    yield f"\nEdges (deviation in {report.units})"
    yield _edges(report)
    yield f"\nTopology\n  {_topology(report)}"
    yield f"\nIntegrals ({report.units})"
    yield _integrals(report)
    yield f"\nBounding box ({report.units})"
    yield table(
        [("", "from", "to", "length")]
        + [(axis, f"{low:.7g}", f"{high:.7g}", f"{high - low:.7g}")
           for axis, low, high in zip("xyz", *box, strict=True)]
    )  # fmt: skip
    if report.thickness:
        yield f"\nWall ({report.units}; shortest distances, sampled)"
        yield table(
            [("", "least", "largest")]
            + [(name, f"{a:.6g}", f"{b:.6g}") for name, (a, b) in report.thickness.items()]
        )
    if report.mass is not None:
        yield from _mass(report.mass, report.units)
    if report.fields:
        yield f"\nFields (integrals over the volume, {report.units}^3)"
        yield _fields(report.fields)
    if report.own is not None:
        yield from _layers_and_limits(report.own, report.units)
    yield "\nEvidence"
    yield table(_evidence(report, expected))
    for warning in report.warnings:
        yield f"\nWarning\n  {warning}"
    yield f"\nTimes\n  {', '.join(f'{k} {1000 * s:.0f} ms' for k, s in report.times.items())}"


def _sides(own: EquationReport) -> Iterator[str]:
    if own.frame:
        yield f"  frame: {one_line(own.frame)}"
    yield "\nSides of the parameter box"
    yield table([(s.name, s.fate, s.verdict, s.detail) for s in own.sides])


def _layers_and_limits(own: EquationReport, units: str) -> Iterator[str]:
    if own.layers:
        yield f"\nLayers ({units}; from w = 0 up)"
        yield table(
            [("", "volume", "B-rep", "area", "centroid")]
            + [
                (x.name, f"{x.volume:.12g}", f"{x.solid_volume:.12g}", f"{x.area:.10g}",
                 ", ".join(f"{c:.9g}" for c in x.centroid))
                for x in own.layers
            ]
        )  # fmt: skip
    if limits := own.limits():
        layers_only = all(limit.name == "depth" for limit in limits)
        what = "layers" if layers_only else "channel"
        yield f"\nLimits of the {what} ({units}; found by search)"
        yield table(
            [("", "found", "breaks at", "where")]
            + [(x.name, f"{x.value:.6g}", f"{x.breaks_at:.6g}", x.sentence) for x in limits]
        )


def _bodies(report: Report) -> Iterator[str]:
    yield f"  result = {report.result}"
    yield f"\nBodies (volume in {report.units}^3)"
    yield table([("body", "volume", "faces", "evidence", "deviation")] + [
        (name, f"{body.equation.volume:.10g}", str(len(body.faces)), body.evidence,
         f"{body.deviation:.2g}" if body.evidence != "exact" else "-")
        for name, body in report.bodies.items()
    ])  # fmt: skip
    yield f"\nWhich volumes add up ({report.units}^3)"
    yield table([(step.name, step.sentence, f"gap {step.gap:.1e}") for step in report.steps])
    known = [(step.name, step.topology) for step in report.steps if step.topology is not None]
    yield "\nWhether the edges are all curves in which the boundaries meet"
    yield table([(name, found.evidence, _meeting(found, report.units)) for name, found in known])


def _meeting(found: TopologyReport, units: str) -> str:
    if found.open:
        return f"volumes say so; not proved: {found.open}"
    if not found.within:
        return f"they are apart ({found.cells} cells)"
    return f"the equations' within {found.within:.1e} {units} of them ({found.cells} cells)"


def _faces(report: Report) -> str:
    rows: list[tuple[str, ...]] = [
        ("face", "carrier", "evidence", "deviation", "seen", "samples", "degrees", "poles", "area")
    ]
    rows += [
        (
            face.name, _carrier(face), face.evidence, *_deviations(face), str(face.samples or "-"),
            " x ".join(map(str, face.degrees)) or "-", " x ".join(map(str, face.poles)) or "-",
            f"{face.area:.10g}",
        )
        for face in report.faces
    ]  # fmt: skip
    return table(rows)


def _carrier(face: FaceReport) -> str:
    return ", ".join([face.carrier, *(f"{name} {x:.6g}" for name, x in face.figures.items())])


def _edges(report: Report) -> str:
    rows: list[tuple[str, ...]] = [
        ("edge", "carrier", "evidence", "deviation", "seen", "degree", "poles", "off faces")
    ]
    rows += [
        (
            edge.name, edge.carrier, edge.evidence, *_deviations(edge), str(edge.degree or "-"),
            str(edge.poles or "-"), f"{edge.surface_distance:.2g}",
        )
        for edge in report.curves
    ]  # fmt: skip
    return table([row if report.own is None else row[:-1] for row in rows])


def _deviations(part: FaceReport | EdgeReport) -> tuple[str, str]:
    """Return the deviation, a bound where it is proved, and the largest one seen."""
    if part.evidence == "exact":
        return "-", "-"
    return f"{part.deviation:.2g}", f"{part.sampled:.2g}"


def _topology(report: Report) -> str:
    from pc2cad.report import count

    genus = ""
    if report.own is not None:
        genus = f" of genus {', '.join(str(g) for g in report.own.genus)}"
    return (
        f"{count(len(report.faces), 'face')}, {count(report.edges, 'edge')}, "
        f"{report.vertices} {'vertex' if report.vertices == 1 else 'vertices'}, "
        f"{count(report.shells, 'shell')}{genus}; Euler number {report.euler}"
    )


def _integrals(report: Report) -> str:
    truth = report.integrals
    others = [] if report.own is None else [("B-rep", report.solid)]
    if report.triangles is not None:
        others.append(("triangles", report.triangles))
    rows: list[list[str]] = [["", "B-rep" if report.own is None else "equation"]]
    # a centroid may lie in the origin: its difference is held against the part's size
    figures = [("volume", abs(truth.volume)), ("area", abs(truth.area))]
    figures += [(f"centroid {axis}", report.size) for axis in "xyz"]
    best = (truth.volume, truth.area, *truth.centroid)
    rows += [[name, f"{a:.12g}"] for (name, _), a in zip(figures, best, strict=True)]
    for heading, found in others:
        rows[0] += [heading, "relative difference"]
        values = (found.volume, found.area, *found.centroid)
        for row, (_, size), a, b in zip(rows[1:], figures, best, values, strict=True):
            row += [f"{b:.12g}", f"{abs(a - b) / size:.1e}"]
    return table([tuple(row) for row in rows])


def _mass(mass: Mass, units: str) -> Iterator[str]:
    parts = {"": mass, **mass.layers}
    yield f"\nMass (density times {units}^3; {mass.source})"
    yield table(
        [("", "mass", "density", "centroid")]
        + [
            (name, f"{x.mass:.12g}", f"{x.density:.10g}", ", ".join(f"{c:.9g}" for c in x.centroid))
            for name, x in parts.items()
        ]
    )
    yield f"\nInertia about the centroid (mass times {units}^2)"
    rows = [
        (axis, *(f"{x:.10g}" for x in row)) for axis, row in zip("xyz", mass.inertia, strict=True)
    ]
    yield table([("", "x", "y", "z"), *rows])
    yield table(
        [("principal", "radius of gyration", "axis")]
        + [
            (f"{moment:.10g}", f"{radius:.10g}", ", ".join(f"{c:.6f}" for c in axis))
            for moment, radius, axis in zip(
                mass.principal, mass.radii_of_gyration, mass.axes, strict=True
            )
        ]
    )
    if mass.relative_error:
        yield f"  error estimate {mass.relative_error:.1e} (estimate, relative)"


def _fields(fields: Mapping[str, Any]) -> str:
    rows: list[tuple[str, ...]] = [("", "integral", "mean", "from", "to", "evidence")]
    for name, found in fields.items():
        several = len(found["integral"]) > 1
        for k, axis in enumerate("xyz" if several else " "):
            low, high = found["least"][k], found["largest"][k]
            rows.append((
                f"{name}.{axis}" if several else name, f"{found['integral'][k]:.12g}",
                f"{found['mean'][k]:.10g}", f"{low['seen']:.10g}", f"{high['seen']:.10g}",
                _field_evidence(low, high),
            ))  # fmt: skip
    return table(rows)


def _field_evidence(low: Mapping[str, Any], high: Mapping[str, Any]) -> str:
    """Return how far a proof leaves the least and the largest value open."""
    if low["bound"] is None or high["bound"] is None:
        return "sampled"
    gap = max(low["seen"] - low["bound"], high["bound"] - high["seen"])
    return f"bounded, within {max(gap, 0.0):.1e}"


def _evidence(report: Report, expected: Expectations) -> list[tuple[str, ...]]:
    units = report.units
    stated = [name for name, value in vars(expected).items() if value is not None]
    error = report.integrals.relative_error
    rows = [
        ("size", f"{report.size:.10g} {units}"),
        ("tolerance", f"{report.tolerance:.3g} {units}"),
        ("integrals", report.integrals.source),
        ("deviation", _deviation(report)),
        ("kernel tolerance", f"{report.kernel_tolerance:.2g} {units}"),
    ]
    if error and math.isfinite(error):
        rows.append(("error estimate", f"{error:.1e} (estimate, relative)"))
    if report.own is not None:
        rows += [
            ("solid", "valid in the kernel, closed, of the derived topology and right integrals"),
            ("det J", f"keeps its sign ({report.own.determinant})"),
            ("overlap", _overlap(report.own, report.units)),
        ]
    else:
        rows.append(("solid", "valid in the kernel and closed; volumes of all steps add up"))
    rows += [("arithmetic", sentence) for sentence in report.arithmetic]
    rows += [("seams", sentence) for sentence in report.seams]
    rows.append(("[expect]", f"met: {', '.join(stated)}" if stated else "nothing stated"))
    return [(name, value) for name, value in rows]


def _deviation(report: Report) -> str:
    if report.evidence == "exact":
        return "none: every face and edge is exact"
    text = f"{report.deviation:.2g} {report.units} ({report.evidence})"
    places = [f"{p.name} at {p.open}" for p in report.parts if p.open]
    return f"{text}; no bound for {'; '.join(places)}" if places else text


def _overlap(own: EquationReport, units: str) -> str:
    if own.injectivity == "proved":
        near = f", but within {own.overlap_depth:.2g} {units} of the boundary"
        return (
            f"none: proved that no place is covered twice{near if own.overlap_depth else ''} "
            f"({own.overlap_cells} parts of faces)"
        )
    return (
        f"none deeper than {own.overlap_depth:.2g} {units} (sampled: {own.overlap_open}); "
        f"{own.images} inner points have winding number 1"
    )
