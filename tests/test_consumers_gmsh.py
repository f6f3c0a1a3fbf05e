"""gmsh, with all healing off, imports and meshes what was written."""

from __future__ import annotations

from math import pi
from pathlib import Path

import cadquery as cq
import pytest
from consumers.gmsh_reader import mesh, read_in_gmsh
from consumers.samples import SplineSolid, write_step

pytestmark = pytest.mark.interop


def test_import_of_a_hollow_sphere(tmp_path: Path) -> None:
    shape = cq.Workplane().sphere(5.0).cut(cq.Workplane().sphere(3.0)).val()
    found = read_in_gmsh(write_step(shape, tmp_path / "hollow.step", unit="M"))
    assert (found["volumes"], found["surfaces"]) == (1, 2)
    assert found["volume"] == pytest.approx(392.0 / 3.0 * pi, rel=1e-11)
    assert found["area"] == pytest.approx(136.0 * pi, rel=1e-11)


def test_curved_mesh_of_a_cylinder(tmp_path: Path) -> None:
    path = write_step(cq.Solid.makeCylinder(5.0, 12.0), tmp_path / "cylinder.step")
    found = mesh(path, 2.0)
    assert found["mesh_volume"] == pytest.approx(300.0 * pi, rel=1e-4)
    assert found["min_jacobian"] > 0.0


def test_curved_mesh_of_a_spline_solid(tmp_path: Path) -> None:
    sample = SplineSolid()
    found = mesh(write_step(sample.solid(), tmp_path / "spline.step"), 4.0)
    assert (found["volumes"], found["surfaces"]) == (1, 6)
    assert found["volume"] == pytest.approx(sample.volume(), rel=1e-6)  # its kernel's own limit
    assert found["mesh_volume"] == pytest.approx(sample.volume(), rel=1e-5)
    assert found["min_jacobian"] > 0.0
