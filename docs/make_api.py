"""Make docs/api.md from the docstrings: ``python docs/make_api.py``."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pc2cad
from pc2cad import cadquery, part, report
from pc2cad.checked import FieldFigures
from pc2cad.equation.point_equation import PointEquation
from pc2cad.integrals.inertia import Mass
from pc2cad.integrals.sensitivity import Sensitivity
from pc2cad.templates.bodies import BodiesTemplate
from pc2cad.templates.template import Template
from pc2cad.verify.against import verify_file

FILE = Path(__file__).parent / "api.md"
CLASSES = (
    Template, BodiesTemplate, PointEquation, part.Part, part.Body, report.Report,
    report.EquationReport, report.FaceReport, report.EdgeReport, report.Integrals, Mass,
    Sensitivity, FieldFigures,
)  # fmt: skip
PLUGIN = ("point_solid", "channel_solid", "placed", "pointSolid", "channelSolid", "pointParts")


def reference() -> str:
    """Return the whole page."""
    return "\n".join(_lines()).rstrip() + "\n"


def _lines() -> Iterator[str]:
    yield from ("# Python API", "", "Made from the docstrings by `python docs/make_api.py`.", "")
    yield from ("## `import pc2cad as pc`", "")
    for name in dir(pc2cad):
        thing = verify_file if name == "verify" else getattr(pc2cad, name)
        if inspect.isfunction(thing):
            yield from _entry(name, thing)
    yield from (
        "`pc.pi`, `pc.e` and `pc.deg` (pi/180) are the constants, exact; `abs` is Python's own.",
        "",
    )
    yield from ("## Classes", "")
    for kind in CLASSES:
        yield from (f"### {kind.__name__}", "", _text(kind), "")
        found: dict[str, str] = {}
        for base in reversed(kind.__mro__):
            if base.__module__.startswith("pc2cad."):
                found |= dict(_members(base))
        yield from (*found.values(), "")
    yield from ("## `import pc2cad.cadquery as pcq`", "")
    for name in PLUGIN:
        yield from _entry(name, getattr(cadquery, name))


def _members(kind: type[Any]) -> Iterator[tuple[str, str]]:
    for name, annotation in inspect.get_annotations(kind).items():
        if not name.startswith("_"):
            yield name, f"- `{name}: {annotation}`"
    for name, member in kind.__dict__.items():
        if name.startswith("_"):
            continue
        if isinstance(member, property):
            yield name, f"- `{name}`: {_first(member)}"
        elif inspect.isfunction(member):
            yield name, f"- `{name}{_signature(member)}`: {_first(member)}"


def _entry(name: str, thing: Any) -> Iterator[str]:
    yield from (f"### {name}", "", f"    {name}{_signature(thing)}", "", _text(thing), "")


def _signature(thing: Any) -> str:
    text = re.sub(r"(: |-> )(['\"])(.*?)\2", r"\1\3", str(inspect.signature(thing)))
    return re.sub(r"^\(self(, )?", "(", text)


def _text(thing: Any) -> str:
    return inspect.getdoc(thing) or ""


def _first(thing: Any) -> str:
    return _text(thing).partition("\n\n")[0].replace("\n", " ")


if __name__ == "__main__":
    FILE.write_text(reference(), encoding="utf-8")
    sys.stdout.write(f"{FILE}\n")
