"""``pc2cad verify``: a STEP file held against itself and its equation, without a kernel."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pc2cad.cli.inputs import read_length, read_settings
from pc2cad.cli.output import complain, one_line, say, shown, table
from pc2cad.errors import InputError, named

if TYPE_CHECKING:
    from pc2cad.verify.verdict import Verification

#: what reading a certificate or a file may end in that is none
UNREADABLE: Final = (
    OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError,
    MemoryError,
)  # fmt: skip
#: exit code: not sound, or not to be judged whole
NOT_VERIFIED: Final = 6


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the file and the options."""
    parser.add_argument("file", metavar="FILE.step", help="the STEP file, of any program")
    parser.add_argument(
        "template", metavar="TEMPLATE", nargs="?",
        help="the template that the file is said to be made from: a file, or a shipped one's name",
    )  # fmt: skip
    parser.add_argument(
        "-s", "--set", metavar="NAME=VALUE", action="append", default=[], dest="settings",
        help="value of a parameter of the template (repeatable)",
    )  # fmt: skip
    parser.add_argument(
        "--tolerance", metavar="LENGTH",
        help="largest distance of a face from its side (default: that of build)",
    )  # fmt: skip
    parser.add_argument(
        "--certificate", metavar="FILE",
        help="write what was proved as JSON, for --replay (docs/certificate.md)",
    )  # fmt: skip
    parser.add_argument(
        "--replay", metavar="CERTIFICATE",
        help="hold a certificate against the file (and the template), by arithmetic alone",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print the receipt as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Read the file, print what holds of it, and return 0 where nothing is wrong."""
    if arguments.replay is not None:
        return _replay(arguments)
    if arguments.template is not None:
        return _against(arguments)
    given = (arguments.settings, arguments.tolerance, arguments.certificate)
    if any(value not in (None, []) for value in given):
        raise InputError(
            "-s, --tolerance and --certificate belong to a template: name it after the file"
        )
    from pc2cad.verify.receipt import describe, read_step

    with named(arguments.file):
        file = read_step(arguments.file)
    found = describe(file)
    if arguments.json:
        say(json.dumps(found, indent=2, allow_nan=False))
    else:
        for paragraph in paragraphs(arguments.file, found):
            say(paragraph)
    return 0 if file.sound else NOT_VERIFIED


def _against(arguments: argparse.Namespace) -> int:
    """Hold the file against a template."""
    from pc2cad.verify.against import equation_of, verification
    from pc2cad.verify.receipt import read_step

    tolerance = read_length("--tolerance", arguments.tolerance)
    with named(arguments.template):
        equation = equation_of(arguments.template, read_settings(arguments.settings))
    with named(arguments.file):
        file = read_step(arguments.file)
    found = verification(file, equation, tolerance, claims=arguments.certificate is not None)
    if arguments.json:
        say(json.dumps(found.to_dict(), indent=2, allow_nan=False))
    else:
        for paragraph in _verdict(arguments.file, found):
            say(paragraph)
    if arguments.certificate is not None and found.verified:
        _certify(arguments, found)
    return 0 if found.verified else NOT_VERIFIED


def _certify(arguments: argparse.Namespace, found: Verification) -> None:
    from pc2cad.export.files import write_atomically
    from pc2cad.templates.shipped import find_template
    from pc2cad.verify.certificate import certificate

    held = certificate(found, arguments.file, find_template(arguments.template))
    text = json.dumps(held, separators=(",", ":"), allow_nan=False)
    write_atomically(arguments.certificate, f"{text}\n".encode())


def _replay(arguments: argparse.Namespace) -> int:
    """Hold a certificate against the file, and against the template where one is named."""
    from pc2cad.templates.shipped import find_template
    from pc2cad.verify.replay import ReplayError, replay

    if arguments.settings or arguments.tolerance is not None or arguments.certificate is not None:
        raise InputError("--replay takes a file, and a template, but no other option")
    names = [arguments.replay, arguments.file]
    if arguments.template is not None:
        names.append(str(find_template(arguments.template)))
    try:
        first, *others = (Path(name).read_bytes() for name in names)
        lines = replay(json.loads(first), *others)
    except ReplayError as error:
        complain(f"{shown(arguments.replay)}: does not hold: {error}")
        return NOT_VERIFIED
    except UNREADABLE as error:
        complain(f"{shown(arguments.replay)}: cannot be read: {type(error).__name__}: {error}")
        return 2
    say("\n  ".join((f"{shown(arguments.replay)}: holds", *lines)))
    return 0


def _verdict(path: str, found: Verification) -> Iterator[str]:
    units = found.units
    if found.verified:
        yield (
            f"{shown(path)}: verified, no face further than {found.deviation:.2g} {units} from its "
            f"side ({found.evidence}; {found.tolerance:.2g} allowed)"
        )
        if found.places is not None:
            yield f"  bounds the bodies as they are joined at {found.places} places (sampled)"
    else:
        yield f"{shown(path)}: not this solid"
        yield f"  first: {one_line(found.differences[0])}"
        if found.worst != found.differences[0]:
            yield f"  worst: {one_line(found.worst)}"
        if len(found.differences) > 2:
            yield f"  and {len(found.differences) - 1} more; --json lists all"
    if found.matches:
        yield f"\nFaces (distances in {units})"
        yield table(
            [("side", "carrier", "surface", "", "border", "")]
            + [
                (one_line(m.name), m.face.face.carrier.lower(), f"{m.reach:.1e}",
                 m.nearness.rests_on,
                 f"{m.border_reach:.1e}", m.edges.rests_on)
                for m in found.matches
            ]
        )  # fmt: skip


def paragraphs(path: str, found: dict[str, Any]) -> Iterator[str]:
    """Yield a receipt in words."""
    verdict = {True: "sound", False: "contradicts itself", None: "not all of it is known here"}
    yield f"{shown(path)}: {verdict[found['sound']]}"
    yield f"  {one_line(found['schema'])}; {found['instances']} instances"
    for solid in found["solids"]:
        yield from _solid(solid)
    for title, key in (("Defects", "defects"), ("Not known", "unknown"), ("Remarks", "remarks")):
        if found[key]:
            yield f"\n{title}"
            yield from (f"  {one_line(sentence)}" for sentence in found[key])


def _solid(solid: dict[str, Any]) -> Iterator[str]:
    carriers = ", ".join(
        f"{count} {name.lower()}" for name, count in sorted(solid["carriers"].items())
    )
    yield f"\n{one_line(solid['name']) or 'a solid'} (unit {solid['unit_m']:g} m)"
    rows = [
        ("shells", f"{solid['shells']}"),
        ("faces", f"{solid['faces']} ({carriers})"),
        ("edges", f"{solid['edges']}, vertices {solid['vertices']}"),
    ]
    if solid["volume"] is not None:
        rows += [
            (name, f"{solid[name]:.12g} (± {solid[f'{name}_error'] + 1e-15:.0e} of it, "
             f"{solid[f'{name}_is']})")
            for name in ("volume", "area")
        ]  # fmt: skip
    if solid["centroid"] is not None:
        place = ", ".join(f"{x:.10g}" for x in solid["centroid"])
        off = f"± {solid['centroid_error'] + 1e-15 * solid['size']:.0e}, {solid['centroid_is']}"
        rows.append(("centroid", f"{place} ({off})"))
    stated = solid["uncertainty"]
    rows.append(
        ("largest gaps", f"vertices {solid['largest_vertex_gap']:.1e}, edges "
         f"{solid['largest_edge_gap']:.1e} ({solid['gaps_are']})"
         + ("" if stated is None else f"; stated uncertainty {stated:.1e}"))
    )  # fmt: skip
    yield table(rows)
