"""What is asked of a new format, carrier or figure: every place that has to know of it does."""

from __future__ import annotations

import ast
from dataclasses import fields
from pathlib import Path
from typing import get_args

import pytest

from pc2cad.brep import to_kernel
from pc2cad.cli.main import main
from pc2cad.export import contracts, mesh_files, point_files, registry, spline_files
from pc2cad.geometry import carriers, point_inversion
from pc2cad.report import _OF_BODIES, _OF_EQUATION, EquationReport, Report
from pc2cad.templates.reader import _CARRIERS

ROOT = Path(__file__).parent.parent
#: verb -> endings of the files that it writes
ENDINGS = {
    "build": [ending for entry in registry.FORMATS for ending in entry.extensions],
    "mesh": [entry.extension for entry in mesh_files.MESH_FORMATS],
    "spline": [entry.extension for entry in spline_files.SPLINE_FORMATS],
    "points": [*point_files.POINT_FORMATS],
}


@pytest.mark.parametrize(
    ("name", "table", "contract"),
    [
        ("SOLIDS", registry.FORMATS, "SolidModule"),
        ("MESHES", mesh_files.MESH_FORMATS, "MeshModule"),
        ("SPLINES", spline_files.SPLINE_FORMATS, "SplineModule"),
    ],
)
def test_every_module_of_a_table_is_held_against_its_contract(name, table, contract):
    held = [
        node
        for node in ast.walk(ast.parse(Path(contracts.__file__).read_text()))
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == name
    ]
    assert [ast.unparse(node.annotation) for node in held] == [f"tuple[{contract}, ...]"]
    names = [f"pc2cad.export.{ast.unparse(entry)}" for entry in held[0].value.elts]
    assert len(names) > 3
    assert names == [entry.module for entry in table]


@pytest.mark.parametrize("verb", ENDINGS)
def test_every_ending_is_in_the_help_and_on_the_first_page(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert len(ENDINGS[verb]) > 2
    assert main([verb, "--help"]) == 0
    shown, page = capsys.readouterr().out, (ROOT / "README.md").read_text()
    assert [e for e in ENDINGS[verb] if e not in shown] == []
    assert [e for e in ENDINGS[verb] if f"`{e}`" not in page] == []


@pytest.mark.parametrize("kind", [carriers.Plane, *get_args(carriers.AnalyticSurface)])
def test_every_carrier_is_named_built_inverted_and_expected(kind: type) -> None:
    assert carriers._NAMES[kind] in _CARRIERS
    for ask in (to_kernel.surface, *([] if kind is carriers.Plane else [point_inversion.places])):
        assert ask.dispatch(kind) is not ask.dispatch(object), ask


def test_plain_data_hold_every_field_of_a_report() -> None:
    own = {"own", "result", "bodies", "steps", "seams"}  # in parts, or of several bodies
    one = {field.name for kind in (Report, EquationReport) for field in fields(kind)} - own
    assert len(one) > 20
    assert one - {"integrals"} <= set(_OF_EQUATION)
    assert {field.name for field in fields(Report)} - {"own"} <= set(_OF_BODIES)
