"""What the verbs have in common: the template argument, parameter values, lengths."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, overload
from unicodedata import normalize

from pc2cad.errors import InputError, named
from pc2cad.options import PROFILES, CompileOptions

if TYPE_CHECKING:
    from pc2cad.equation.point_equation import PointEquation
    from pc2cad.templates.bodies import Bodies, BodiesTemplate
    from pc2cad.templates.template import Template


Kind = TypeVar("Kind", int, float)
Key = TypeVar("Key")
Value = TypeVar("Value")


class OutputClashError(InputError):
    """Two of the files of a command are the same one."""


def add_template(parser: argparse.ArgumentParser, *, body: bool = True) -> None:
    """Add the template argument, ``-s`` and, unless told otherwise, ``--body``."""
    parser.add_argument(
        "template", metavar="TEMPLATE",
        help="a template file (TOML), or the name of a shipped one (see: pc2cad templates)",
    )  # fmt: skip
    parser.add_argument(
        "-s", "--set", metavar="NAME=VALUE", action="append", default=[], dest="settings",
        help="value of a parameter, a number or a constant expression such as 1/3; or a current "
        "point in the place of one of the template's, such as 'A=[4+u, 0, 0]' (repeatable)",
    )  # fmt: skip
    if body:
        parser.add_argument(
            "--body", metavar="NAME", help="one body of a template of several, by itself"
        )


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--tolerance``, ``--degree``, ``--max-degree`` and ``--profile``."""
    parser.add_argument(
        "--tolerance", metavar="LENGTH",
        help="largest distance of a face from the equation, in model units "
        "(default: 1e-7 of the part's size, or 1e-6 of its thickness 2V/A where that is less)",
    )  # fmt: skip
    parser.add_argument(
        "--degree", type=int, metavar="N",
        help="degree of fitted splines, 2 to 13 (default: of 3, 5 and 7 that with fewest poles)",
    )  # fmt: skip
    parser.add_argument(
        "--max-degree", type=int, metavar="N", dest="max_degree",
        help="let fits choose odd degrees from 3 up to N, at most 13",
    )  # fmt: skip
    parser.add_argument(
        "--profile", choices=PROFILES, default="compact",
        help="compact: fewest poles; polynomial: rational where that is exact only; cubic: for "
        "receivers that take no splines above degree 3 and no rational ones (default: %(default)s)",
    )  # fmt: skip


def read_options(arguments: argparse.Namespace) -> CompileOptions:
    """Return what `add_options` has read, checked."""
    return CompileOptions(
        read_length("--tolerance", arguments.tolerance),
        arguments.degree,
        arguments.max_degree,
        arguments.profile,
    )


def check_different(outputs: Sequence[str], template: Path) -> None:
    """Raise OutputClashError where two outputs, or one and the template, are the same file."""
    taken: dict[str, tuple[str, str]] = {}
    for path, what in (
        (os.fspath(template), "the template"),
        *((path, f"another output, {path}") for path in outputs),
    ):
        real = os.path.realpath(path)
        alike = normalize("NFC", normalize("NFD", real).casefold())
        if alike in taken:
            other, known = taken[alike]
            how = "is the same file as" if other == real else (
                "differs in capitals or accents alone, which many systems take for one name, from"
            )  # fmt: skip
            raise OutputClashError(f"the output {path} {how} {known}")
        taken[alike] = real, what


def load(arguments: argparse.Namespace) -> tuple[Template | BodiesTemplate, Path]:
    """Return the template that the arguments name, or the body of it, and its file."""
    from pc2cad.templates.bodies import BodiesTemplate
    from pc2cad.templates.file import read_template
    from pc2cad.templates.shipped import find_template

    path = find_template(arguments.template)
    template = read_template(path)
    if arguments.body is None:
        return template, path
    if not isinstance(template, BodiesTemplate):
        raise InputError(f"--body: {template.name} is one solid and has no bodies")
    return template.body(arguments.body), path


def load_one(arguments: argparse.Namespace) -> tuple[Template, Path]:
    """Return the template of one solid that the arguments name, and its file."""
    from pc2cad.templates.bodies import BodiesTemplate

    template, path = load(arguments)
    if isinstance(template, BodiesTemplate):
        names = ", ".join(body.name for body in template.bodies)
        raise InputError(
            f"{template.name} has several bodies and no equation of its own; choose one of them "
            f"with --body: {names}"
        )
    return template, path


@overload
def bind(template: Template, arguments: argparse.Namespace) -> PointEquation: ...
@overload
def bind(template: BodiesTemplate, arguments: argparse.Namespace) -> Bodies: ...
def bind(
    template: Template | BodiesTemplate, arguments: argparse.Namespace
) -> PointEquation | Bodies:
    """Return the template's equation, or equations, with the values given by ``-s``."""
    values = read_settings(arguments.settings)
    with named(arguments.template):
        return template.bind(values)


def read_settings(settings: Sequence[str]) -> dict[str, str]:
    """Return the parameters and values of ``NAME=VALUE`` texts."""
    values: dict[str, str] = {}
    for text in settings:
        name, sign, value = (part.strip() for part in text.partition("="))
        if not (name and sign and value):
            raise InputError(f"-s '{text[:80]}': write NAME=VALUE, for example -s p=0.3")
        if name in values:
            raise InputError(f"-s {name[:80]}: the parameter is set twice")
        values[name] = value
    return values


def put(found: dict[Key, Value], key: Key, value: Value, said: str) -> None:
    """Note what a repeatable option gives for a key; raise InputError where there is one already.

    `said` names the option and the key.
    """
    if key in found:
        raise InputError(f"{said} is given twice")
    found[key] = value


def read_triple(option: str, text: str, mark: str) -> tuple[int, int, int]:
    """Return the three whole numbers, one for u, v and w, that an option gives."""
    u, v, w = read_numbers(option, text, int, mark, 3)
    return u, v, w


def read_numbers(
    option: str, text: str, kind: Callable[[str], Kind], mark: str, count: int
) -> list[Kind]:
    """Return `count` numbers with a mark between them."""
    try:
        numbers = [kind(part) for part in text.split(mark)]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise InputError(f"{option}: '{text[:40]}' is not {count} numbers with '{mark}' between")
    return numbers


def add_density(parser: argparse.ArgumentParser) -> None:
    """Add ``--density``."""
    parser.add_argument(
        "--density", metavar="[LAYER=]VALUE", action="append", default=[], dest="densities",
        help="mass per cubed model unit, such as 7.85e-6 (kg/mm^3): mass, centre of mass and "
        "inertia are told; LAYER=VALUE, repeated, for layers or bodies of different density",
    )  # fmt: skip


def add_velocity(parser: argparse.ArgumentParser, where: str) -> None:
    """Add ``--velocity``."""
    parser.add_argument(
        "--velocity", metavar="NAMES",
        help=f"parameters, with commas between: {where} also hold how places move with each, as "
        "the field velocity_NAME",
    )  # fmt: skip


def with_velocities(equation: PointEquation, names: str | None) -> PointEquation:
    """Return the equation with the fields that ``--velocity`` asks for."""
    if names is None:
        return equation
    with named("--velocity"):
        return equation.with_velocities(*(name.strip() for name in names.split(",")))


def read_densities(texts: Sequence[str]) -> float | dict[str, float] | None:
    """Return one density, one by each layer's name, or None where none is given."""
    if not texts:
        return None
    named_ones = [text.rpartition("=") for text in texts]
    if len(texts) == 1 and not named_ones[0][1]:
        return read_length("--density", texts[0], "density")
    found: dict[str, float] = {}
    for name, sign, value in named_ones:
        if not (name.strip() and sign):
            raise InputError("--density: give one for all, or LAYER=VALUE for each layer")
        if name.strip() in found:
            raise InputError(f"--density {name.strip()[:80]}: the layer's density is set twice")
        found[name.strip()] = read_length("--density", value, "density") or math.nan
    return found


def read_length(option: str, text: str | None, what: str = "length") -> float | None:
    """Return the positive number that an option gives, None where it is not given."""
    if text is None:
        return None
    from pc2cad.equation.language import read_expression
    from pc2cad.expression.scalar import evaluate
    from pc2cad.expression.tree import Expr

    with named(option):
        tree = read_expression(text, {})
        length = evaluate(tree, {}) if isinstance(tree, Expr) else math.nan
        if not 0.0 < length < math.inf:
            raise InputError(f"must be a positive {what}, and '{text[:80]}' was given")
    return length
