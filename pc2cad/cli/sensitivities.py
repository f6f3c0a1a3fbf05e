"""``pc2cad sensitivities``: how a solid's figures change with its parameters."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from pc2cad.cli.inputs import add_density, add_template, bind, load, read_densities
from pc2cad.cli.output import Progress, one_line, say, table
from pc2cad.errors import InputError, named

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pc2cad.checked import CheckedMap
    from pc2cad.equation.point_equation import PointEquation
    from pc2cad.integrals.sensitivity import Sensitivity
    from pc2cad.part import Part
    from pc2cad.part.several import BodiesSensitivity
    from pc2cad.studies.reach import Reach
    from pc2cad.templates.bodies import Bodies

    #: of one equation, or of several bodies
    Derived = Sensitivity | BodiesSensitivity

#: what is derived, in the order of the output
FIGURES = ("volume", "area", "centroid", "mass", "inertia")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template, the parameters and the density."""
    add_template(parser)
    parser.add_argument(
        "--for", metavar="NAMES", dest="names",
        help="parameters, with commas between (default: all)",
    )  # fmt: skip
    add_density(parser)
    parser.add_argument(
        "--reach", action="store_true",
        help="search how far each parameter may go until M is no solid (of one equation)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print the derivatives as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Derive the figures with respect to each parameter; of one equation no kernel is loaded."""
    template, _ = load(arguments)
    equation = bind(template, arguments)
    density = read_densities(arguments.densities)
    names = _names(arguments.names, list(equation.parameters), equation.name)
    with Progress() as progress, named(arguments.template):
        known = _known(equation, progress)
        found, refused = _derive(known, names, density, arguments.names is not None, progress)
        ranges = _ranges(equation, names, progress) if arguments.reach else []
    if arguments.json:
        plain = _plain(equation, found, refused)
        if arguments.reach:
            plain["reach"] = {one.parameter: asdict(one) for one in ranges}
        say(json.dumps(plain, indent=2, allow_nan=False))
        return 0
    head = f"{equation.name}: {equation.title}" if equation.title else equation.name
    say(one_line(head))
    say(_table(found, equation.units))
    for s in found:
        for sides in s.parting:
            say(f"  {s.parameter}: {sides} coincide, and part as it changes: no solid of one "
                "piece with the same sides lies beside this value")  # fmt: skip
    for name, sentence in (_open(found) | refused).items():
        say(f"  {name}: {one_line(sentence)}")
    for one in ranges:
        say(f"\n{one.parameter} = {one.value:.10g} may go (found by search)")
        for way, end in (("down", one.low), ("up", one.high)):
            last = "; no end was found" if end.breaks is None else f", not to {end.breaks:.6g}:"
            say(f"  {way} to {end.holds:.6g}{last} {one_line(end.why)}".rstrip())
        if one.proved is not None:
            low, high = one.proved
            say(f"  det J is proved to keep its sign from {low!r} to {high!r}")
    return 0


def _ranges(
    equation: PointEquation | Bodies, names: Sequence[str], progress: Progress
) -> list[Reach]:
    from pc2cad.studies.reach import reach
    from pc2cad.templates.bodies import Bodies

    if isinstance(equation, Bodies):
        raise InputError("--reach: a range belongs to one equation; choose a --body")
    return [reach(equation, name, progress) for name in names]


def _known(equation: PointEquation | Bodies, progress: Progress) -> CheckedMap | Part:
    """Return what is asked: the map of one equation, the solid of several bodies."""
    from pc2cad.templates.bodies import Bodies

    if isinstance(equation, Bodies):
        from pc2cad.compiler import compile_solid

        return compile_solid(equation, progress=progress)
    from pc2cad.checked import Stages, check_map

    return check_map(equation, stages=Stages(progress))


def _names(text: str | None, known: list[str], template: str) -> list[str]:
    if text is None:
        if not known:
            raise InputError(f"{template} has no parameters, so nothing changes with them")
        return known
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in known:
            from pc2cad.equation.language import nearest

            listed = ", ".join(known) or "none"
            raise InputError(
                f"--for: {template} has no parameter '{name[:80]}' (it has: {listed})"
                f"{nearest(name, known)}"
            )
    return list(dict.fromkeys(names))


def _derive(
    known: CheckedMap | Part,
    names: Sequence[str],
    density: float | dict[str, float] | None,
    asked: bool,
    progress: Progress,
) -> tuple[list[Derived], dict[str, str]]:
    """Return the derivatives, and what has none in words; who asks by name gets an error."""
    from pc2cad.domain.velocity import NotDifferentiableError

    found: list[Derived] = []
    refused: dict[str, str] = {}
    for name in names:
        progress(f"derive by {name}")
        try:
            found.append(known.sensitivity(name, density))
        except NotDifferentiableError as error:
            if asked:
                raise
            refused[name] = str(error)
    return found, refused


def _plain(
    equation: PointEquation | Bodies, found: Sequence[Derived], refused: dict[str, str]
) -> dict[str, Any]:
    rows: dict[str, Any] = {
        "name": equation.name, "units": equation.units, "parameters": dict(equation.parameters),
    }  # fmt: skip
    for figure in (*FIGURES, "volume_by_flux", "relative_error", "how", "parting"):
        rows[figure] = {s.parameter: getattr(s, figure) for s in found}
        rows[figure] |= dict.fromkeys(refused)
    return {**rows, "open": _open(found), "refused": refused}


def _open(found: Sequence[Derived]) -> dict[str, str]:
    """Return why areas have no derivative, by the parameters."""
    from pc2cad.part.several import BodiesSensitivity

    return {s.parameter: s.open for s in found if isinstance(s, BodiesSensitivity) and s.open}


def _table(found: Sequence[Derived], units: str) -> str:
    rows: list[tuple[str, ...]] = [
        ("d/d", "at", f"volume {units}^3", f"area {units}^2", f"centroid {units}", "mass",
         "by flux", "error", "how")
    ]  # fmt: skip
    for s in found:
        flux = "-" if s.volume_by_flux is None else f"{s.volume_by_flux:.12g}"
        rows.append((
            s.parameter, f"{s.value:.10g}", f"{s.volume:.12g}",
            "-" if s.area is None else f"{s.area:.12g}",
            ", ".join(f"{c:.9g}" for c in s.centroid), f"{s.mass:.12g}", flux,
            f"{s.relative_error:.1e}", s.how,
        ))  # fmt: skip
    return table(rows)
