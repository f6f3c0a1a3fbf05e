"""Registries of files: every module of a table is one that the type checker holds to a contract."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from pc2cad.export import contracts, mesh_files, registry, spline_files


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
