"""Options of ``pc2cad mesh`` that make a job for a solver of the mesh."""

from __future__ import annotations

import argparse
import re
from typing import TYPE_CHECKING, Any

from pc2cad.cli.inputs import put
from pc2cad.errors import InputError, named
from pc2cad.trust.names import is_identifier

if TYPE_CHECKING:
    from pc2cad.export.deck import Deck, Material
    from pc2cad.mesh.meshing import MeshOptions

_ANALYSES = ("static", "frequency", "heat")
_ELEMENTS = ("C3D20R", "C3D8I", "C3D20", "C3D8", "C3D10", "C3D4")
#: options that say something of a job only
_OPTIONS = (
    "material", "orient", "fix", "move", "pressure", "temperature", "flux", "warm", "bins",
    "element", "modes",
)  # fmt: skip


def add_deck(parser: argparse.ArgumentParser) -> None:
    """Add what a job is made of."""
    group = parser.add_argument_group("a job for CalculiX, in .inp files")
    group.add_argument("--deck", choices=_ANALYSES, help="what the job finds")
    group.add_argument(
        "--material", metavar="[LAYER:]KEY=VALUE,…", action="append", default=[],
        help="E, nu, rho, k, alpha of the part, or of a layer, in units that fit the part's: "
        "E=210e3,nu=0.3,rho=7.85e-9; E1 … G23, k1, k2, k3 of an orthotropic one; a field of the "
        "part by its name, E=stiffness (repeatable)",
    )  # fmt: skip
    group.add_argument(
        "--orient", metavar="A,B", help="axis 1 of materials runs along A, and axis 2 lies in the "
        "plane of A and B, element by element: u, v, w, guide, or a field of vectors",
    )  # fmt: skip
    for name, what in (
        ("fix", "SIDE[:AXES]  hold a side, along x, y and z or some of them"),
        ("move", "SIDE:AXIS:VALUE  move a side along x, y or z, by a number or a field"),
        ("pressure", "SIDE:VALUE  press on a side, inwards"),
        ("temperature", "SIDE:VALUE  hold a side at a temperature"),
        ("flux", "SIDE:VALUE  let heat in through a side, per area"),
    ):
        group.add_argument(
            f"--{name}", metavar=what.split("  ")[0], action="append", default=[],
            help=f"{what.split('  ')[1]} (repeatable)",
        )  # fmt: skip
    group.add_argument(
        "--warm", metavar="FIELD", help="the field that is the temperature at all nodes, where 0 "
        "is free of stress; of --deck heat, that at the start",
    )  # fmt: skip
    group.add_argument(
        "--bins", type=int, metavar="N",
        help="sections for each property of a material that is a field (default: 20)",
    )  # fmt: skip
    group.add_argument(
        "--element", choices=_ELEMENTS, help="elements of the job (default: C3D20R; of order 1 "
        "C3D8I; of tetrahedra C3D10 and C3D4)",
    )  # fmt: skip
    group.add_argument("--modes", type=int, metavar="N", help="number of frequencies (default: 10)")


def is_job(output: str) -> bool:
    """Return whether a job is written into this file."""
    return output.lower().endswith(".inp")


def read_deck(arguments: argparse.Namespace) -> Deck | None:
    """Return the job that is asked for; InputError where parts of it are amiss."""
    if arguments.deck is None:
        given = next((name for name in _OPTIONS if getattr(arguments, name)), None)
        if given is not None:
            raise InputError(f"--{given} belongs to a job: add --deck {_ANALYSES[0]}")
        return None
    from pc2cad.export.deck import Deck

    if not any(map(is_job, arguments.outputs)):
        raise InputError("--deck is written into a file .inp: give one with -o")
    element = arguments.element or _usual(arguments)
    modes = {} if arguments.modes is None else {"modes": arguments.modes}
    bins = {} if arguments.bins is None else {"bins": arguments.bins}
    if modes and arguments.deck != "frequency":
        raise InputError("--modes belongs to --deck frequency")
    with named("--deck"):
        return Deck(
            arguments.deck, _materials(arguments.material), _sides(arguments.fix),
            _values("pressure", arguments.pressure), _values("temperature", arguments.temperature),
            _values("flux", arguments.flux), element, warm=arguments.warm,
            moved=_moves(arguments.move), oriented=_orientation(arguments.orient), **modes, **bins,
        )  # fmt: skip


def for_deck(options: MeshOptions, deck: Deck | None, arguments: argparse.Namespace) -> MeshOptions:
    """Return the options of a mesh with the elements that its job asks for."""
    if deck is None:
        return options
    from dataclasses import replace

    from pc2cad.export.deck import ELEMENTS

    shape, order = ELEMENTS[deck.element]
    tetrahedra = shape == "tetra"
    if (arguments.tetrahedra and not tetrahedra) or arguments.order not in (None, order):
        raise InputError(
            f"--element {deck.element} has {'tetrahedra' if tetrahedra else 'hexahedra'} of order "
            f"{order}: leave --order and --tetrahedra out"
        )
    return replace(options, order=order, shape="tetrahedra" if tetrahedra else "hexahedra")


def _usual(arguments: argparse.Namespace) -> str:
    order = arguments.order or 2
    if arguments.tetrahedra:
        return "C3D10" if order == 2 else "C3D4"
    return "C3D20R" if order == 2 else "C3D8I"


def _materials(texts: list[str]) -> dict[str, Material]:
    from dataclasses import fields

    from pc2cad.export.deck import Material

    known = [entry.name for entry in fields(Material)]
    found: dict[str, Material] = {}
    for text in texts:
        layer, _, entries = text.rpartition(":")
        values: dict[str, Any] = {}
        for entry in entries.split(","):
            match = re.fullmatch(r"\s*(\w+)\s*=\s*(\S+)\s*", entry)
            if match is None or match[1] in values or match[1] not in known:
                raise InputError(
                    f"--material '{text[:40]}': write {', '.join(known[:4])} or {known[4]} and a "
                    f"number or a field, each once, for example E=210e3,nu=0.3; orthotropic "
                    f"materials have {', '.join(known[5:])}"
                )
            values[match[1]] = _number_or_field("material", match[2])
        if layer in found:
            raise InputError(f"--material: {layer or 'the part'} has two materials")
        found[layer] = Material(**values)
    return found


def _sides(texts: list[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for text in texts:
        side, colon, axes = text.rpartition(":")
        # a side of several bodies has a colon of its own: tooth:u=1
        if not colon or "=" in axes:
            side, axes = text, "xyz"
        put(found, side, axes, f"--fix {side[:40]}")
    return found


def _moves(texts: list[str]) -> dict[tuple[str, str], float | str]:
    found: dict[tuple[str, str], float | str] = {}
    for text in texts:
        side, _, value = text.rpartition(":")
        side, _, axis = side.rpartition(":")
        if not side:
            raise InputError(
                f"--move '{text[:40]}': write a side, x, y or z, and a number or a field: u=1:x:0.5"
            )
        way = _number_or_field("move", value)
        put(found, (side, axis), way, f"--move {side[:40]}:{axis[:40]}")
    return found


def _orientation(text: str | None) -> tuple[str, str] | None:
    if text is None:
        return None
    first, comma, second = (part.strip() for part in text.partition(","))
    if not (first and comma and second):
        raise InputError(f"--orient '{text[:40]}': write two directions, for example guide,w")
    return first, second


def _number_or_field(option: str, text: str) -> float | str:
    field = is_identifier(text) and text.lower() not in ("nan", "inf", "infinity")
    return text if field else _number(option, text)


def _values(option: str, texts: list[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for text in texts:
        side, _, value = text.rpartition(":")
        if not side:
            raise InputError(f"--{option} '{text[:40]}': write a side and a value: w=0:1.5")
        put(found, side, _number(option, value), f"--{option} {side[:40]}")
    return found


def _number(option: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < float("inf"):
        raise InputError(f"--{option}: '{text[:40]}' is no number")
    return value
