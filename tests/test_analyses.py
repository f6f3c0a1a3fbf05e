"""Finite elements of meshes from equations, against closed forms (examples/analyses.py)."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import analyses
import pytest
import solvers

from pc2cad.compiler import mesh_equation
from pc2cad.mesh.meshing import MeshOptions
from pc2cad.templates.file import read_template

ROOT = Path(__file__).parent.parent
TEMPLATES = sorted(ROOT.glob("templates/*.toml"))

pytestmark = pytest.mark.interop
needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX is not installed (apt-get install calculix-ccx)"
)
#: cells in the edge of a cube of the same volume, where three are too few for the bends
FINENESS = {"gerotor": 6}
#: all types of element, a gluing with a turn, a wall
QUICK = {"half_ball", "turned_ring", "hollow_cylinder", "pyramid_cut"}


@needs_ccx
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=[] if path.stem in QUICK else [pytest.mark.slow])
        for path in TEMPLATES
    ],
    ids=lambda path: path.stem,
)
def test_a_free_part_expands_without_stress(path: Path) -> None:
    equation = read_template(path).bind({})
    size = mesh_equation(equation)[1].equation_volume ** (1 / 3) / FINENESS.get(path.stem, 3)
    mesh, _ = mesh_equation(equation, MeshOptions(size=size, order=2))
    displacement, stress = analyses.thermal_expansion(mesh)
    # both of what the warming makes; CalculiX prints seven digits
    assert displacement < 1e-6
    assert stress < 1e-5


@needs_ccx
@pytest.mark.parametrize(
    ("name", "cells"),
    [("ball_wedge", (4, 8, 4)), ("quad_pyramid", (4, 4, 4)), ("simplex_torus", (6, 8, 3))],
)
def test_a_free_o_grid_expands_without_stress(name: str, cells: tuple[int, int, int]) -> None:
    equation = read_template(ROOT / "templates" / f"{name}.toml").bind({})
    mesh, _ = mesh_equation(equation, MeshOptions(cells=cells, order=2, core="ogrid"))
    displacement, stress = analyses.thermal_expansion(mesh)
    assert displacement < 1e-6
    assert stress < 1e-5


@needs_ccx
@pytest.mark.parametrize(
    ("name", "most"),
    [("hollow_ball", 5e-4), ("thick_tube", 3e-4), ("torsion", 1e-5), ("heat_in_calculix", 5e-5)],
)
def test_calculix_finds_the_closed_form(name: str, most: float) -> None:
    assert getattr(analyses, name)().error < most


@needs_ccx
def test_a_finer_mesh_is_nearer_to_lame() -> None:
    errors = [analyses.thick_tube(n).error for n in (1, 2, 4)]
    assert errors[0] > 8 * errors[1] > 64 * errors[2] / 2


@needs_ccx
@pytest.mark.slow
@pytest.mark.parametrize("name", ["cantilever", "cantilever_channel"])
def test_clamped_tubes_bend_as_beams(name: str) -> None:
    # the clamp stiffens the root, which beam theory does not see
    assert getattr(analyses, name)().error < 1e-2


def test_the_shear_share_of_a_thin_circle_is_a_half() -> None:
    area, inertia, share = analyses._section(1.0, 1.0, 0.01)
    assert area == pytest.approx(2 * math.pi * 0.01, rel=1e-12)
    assert inertia == pytest.approx(math.pi / 4 * (1.005**4 - 0.995**4), rel=1e-12)
    assert share == pytest.approx(0.5, rel=1e-3)


def test_scikit_fem_reads_names_and_finds_the_heat_flow() -> None:
    pytest.importorskip("skfem")
    coarse, fine = analyses.heat_in_scikit_fem(6), analyses.heat_in_scikit_fem(12)
    assert fine.error < 1e-3
    assert coarse.error / fine.error == pytest.approx(4.0, rel=0.1)


def test_mfem_finds_the_heat_flow_with_few_unknowns() -> None:
    pytest.importorskip("mfem")
    answer = analyses.heat_in_mfem()
    assert answer.unknowns < 100
    assert answer.error < 1e-5


@needs_ccx
@pytest.mark.slow
def test_splines_and_hexahedra_need_fewer_unknowns_than_tetrahedra_on_a_channel() -> None:
    pytest.importorskip("mfem")
    path = next(path for path in TEMPLATES if path.stem == "elbow_pipe")
    equation = read_template(path).bind({})
    _, reference = solvers.isogeometric_conductance(equation, 1, 3)
    unknowns, flow = solvers.isogeometric_conductance(equation, 0, 2)
    assert unknowns < 200
    assert flow == pytest.approx(reference, rel=1e-4)
    hexahedra = solvers.mesh(equation, (12, 12, 2))
    assert len(hexahedra.points) < 2000
    assert solvers.conductance(hexahedra) == pytest.approx(reference, rel=2e-4)
    tetrahedra, _ = mesh_equation(equation, MeshOptions(size=0.5, order=2, shape="tetrahedra"))
    assert len(tetrahedra.points) > 2000
    assert abs(solvers.conductance(tetrahedra) / reference - 1) > 5e-4
