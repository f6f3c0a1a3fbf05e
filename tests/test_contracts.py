"""Registries of files: every module of a table is one that the type checker holds to a contract."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from pc2cad.export import mesh_files, registry, spline_files


@pytest.mark.parametrize(
    ("module", "table", "contract"),
    [
        (registry, registry.FORMATS, "SolidModule"),
        (mesh_files, mesh_files.MESH_FORMATS, "MeshModule"),
        (spline_files, spline_files.SPLINE_FORMATS, "SplineModule"),
    ],
)
def test_every_module_of_a_table_is_held_against_its_contract(module, table, contract):
    held = [
        node
        for node in ast.walk(ast.parse(Path(module.__file__).read_text()))
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "_MODULES"
    ]
    assert [ast.unparse(node.annotation) for node in held] == [f"tuple[{contract}, ...]"]
    names = [f"pc2cad.export.{ast.unparse(entry)}" for entry in held[0].value.elts]
    assert len(names) > 3
    assert names == [entry.module for entry in table]
