"""Mesh files in other programs: gmsh, VTK, meshio, CalculiX; and the verb that writes them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import vtk
from shipped import checked_of
from vtkmodules.util.numpy_support import vtk_to_numpy

import pc2cad as pc
from pc2cad.checked import check_map
from pc2cad.cli.main import main
from pc2cad.compiler import mesh_equation
from pc2cad.errors import FileNotWrittenError, InputError, require
from pc2cad.export.mesh_files import MESH_FORMATS, plain_names, write_mesh
from pc2cad.mesh.grid import make_grid
from pc2cad.mesh.hexahedra import hexahedra
from pc2cad.mesh.meshing import MeshOptions
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.templates.file import read_template

TEMPLATES = sorted(Path(__file__).parent.parent.glob("templates/*.toml"))
needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX is not installed (apt-get install calculix-ccx)"
)


def make(name: str, cells: tuple[int, int, int] | None, order: int) -> VolumeMesh:
    checked = checked_of(name)
    return hexahedra(checked, make_grid(checked, cells), order)


#: all four types of element
BALL = ("half_ball", (9, 4, 3))


@pytest.mark.interop
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("ending", [".msh", ".med"])
def test_gmsh_reads_upright_elements_and_named_sides(
    tmp_path: Path, ending: str, order: int
) -> None:
    import gmsh

    mesh = make(*BALL, order)
    path = tmp_path / f"part{ending}"
    write_mesh(mesh, path)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        _, tags, _ = gmsh.model.mesh.getElements(3)
        worst = [gmsh.model.mesh.getElementQualities(t, "minDetJac").min() for t in tags]
        volume = sum(gmsh.model.mesh.getElementQualities(t, "volume").sum() for t in tags)
        groups = {
            gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups(2)
        }
        area = {}
        for name, (dimension, tag) in groups.items():
            entities = gmsh.model.getEntitiesForPhysicalGroup(dimension, tag)
            facets = [t for e in entities for t in gmsh.model.mesh.getElements(dimension, e)[1]]
            area[name] = sum(gmsh.model.mesh.getElementQualities(t, "volume").sum() for t in facets)
    finally:
        gmsh.finalize()
    assert min(worst) > 0
    # gmsh has other shape functions on curved pyramids
    assert volume == pytest.approx(mesh.volume(), rel=1e-12 if order == 1 else 1e-3)
    assert set(area) == {"w=1", "v=0.5"}
    for name, value in area.items():
        assert value == pytest.approx(mesh.area(name), rel=1e-9 if order == 1 else 1e-3)


@pytest.mark.interop
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("ending", [".vtu", ".vtk"])
def test_vtk_reads_upright_elements_and_numbered_sides(
    tmp_path: Path, ending: str, order: int
) -> None:
    mesh = make(*BALL, order)
    path = tmp_path / f"part{ending}"
    write_mesh(mesh, path)
    kind = "XMLUnstructuredGridReader" if ending == ".vtu" else "UnstructuredGridReader"
    reader = getattr(vtk, f"vtk{kind}")()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    side = grid.GetCellData().GetArray("side")
    counts = np.bincount([int(side.GetValue(i)) for i in range(grid.GetNumberOfCells())])
    facets = [sum(len(f.elements) for f in mesh.sides[name]) for name in ("w=1", "v=0.5")]
    assert counts.tolist() == [mesh.elements, *facets]
    if ending == ".vtu":
        field = grid.GetFieldData()
        numbers = [field.GetArray(name).GetValue(0) for name in ("w=1", "v=0.5")]
        assert numbers == [1, 2]
    assert inward_faces(grid, mesh.elements) == 0
    checked = vtk.vtkCellValidator()
    checked.SetInputData(grid)
    checked.Update()
    states = vtk_to_numpy(checked.GetOutput().GetCellData().GetArray("ValidityState"))
    assert not states[: mesh.elements].any()
    if order == 1:  # of curved cells VTK measures chords
        sizes = vtk.vtkCellSizeFilter()
        sizes.SetInputData(grid)
        sizes.Update()
        found = vtk_to_numpy(sizes.GetOutput().GetCellData().GetArray("Volume"))
        assert found[: mesh.elements].min() > 0
        # and of pyramids those of two tetrahedra
        assert found[: mesh.elements].sum() == pytest.approx(mesh.volume(), rel=2e-2)
    assert grid.GetPoint(7) == tuple(mesh.points[7])


def inward_faces(grid: vtk.vtkUnstructuredGrid, count: int) -> int:
    """Count the faces of the first cells that VTK turns inwards."""
    inward = seen = 0
    for index in range(count):
        cell = grid.GetCell(index)
        for face in map(cell.GetFace, range(cell.GetNumberOfFaces())):
            seen += 1
            corners = vtk_to_numpy(face.GetPoints().GetData())[: face.GetNumberOfEdges()]
            middle = vtk_to_numpy(cell.GetPoints().GetData()).mean(axis=0)
            following = np.roll(corners, -1, axis=0)
            normal = np.cross(corners - middle, following - middle).sum(axis=0)
            inward += bool(normal @ (corners.mean(axis=0) - middle) <= 0)
    assert seen >= 4 * count > 0
    return inward


@pytest.mark.parametrize("ending", [".vtu", ".vtk", ".inp", ".msh", ".med"])
def test_meshio_agrees_on_the_sign_of_every_wedge(tmp_path: Path, ending: str) -> None:
    meshio = pytest.importorskip("meshio")
    mesh = make(*BALL, 1)
    assert len(mesh.blocks["wedge"]) == 18
    path = tmp_path / f"part{ending}"
    write_mesh(mesh, path)
    content = meshio.read(path)
    corners = content.points[content.cells_dict["wedge"]]
    a, b, c = (corners[:, k] - corners[:, 0] for k in (1, 2, 3))
    signs = np.sign((np.cross(a, b) * c).sum(axis=1))
    # meshio takes wedges as gmsh and Abaqus number them, and leaves those of MED as they are
    assert signs.tolist() == [-1.0 if ending == ".med" else 1.0] * 18


@pytest.mark.interop
@pytest.mark.parametrize("ending", [".vtu", ".vtk"])
def test_pyvista_agrees_on_the_sign_of_every_wedge(tmp_path: Path, ending: str) -> None:
    pyvista = pytest.importorskip("pyvista")
    write_mesh(make(*BALL, 1), tmp_path / f"part{ending}")
    grid = pyvista.read(tmp_path / f"part{ending}")
    volumes = grid.compute_cell_sizes(length=False, area=False)["Volume"]
    wedges = volumes[grid.celltypes == pyvista.CellType.WEDGE]
    assert len(wedges) == 18
    assert wedges.min() > 0


@pytest.mark.parametrize("ending", [".vtu", ".inp", ".msh", ".vtk", ".med"])
def test_meshio_reads_the_same_nodes_and_cells(tmp_path: Path, ending: str) -> None:
    meshio = pytest.importorskip("meshio")
    mesh = make("hollow_cylinder", (8, 2, 3), 2)
    path = tmp_path / f"part{ending}"
    write_mesh(mesh, path)
    content = meshio.read(path)
    assert content.points == pytest.approx(mesh.points, rel=1e-13, abs=1e-14)
    block = content.cells_dict["hexahedron20"]
    expected = mesh.blocks["hexahedron"]
    if ending == ".med":  # numbered the other way round
        assert np.array_equal(np.sort(block, axis=1), np.sort(expected, axis=1))
    else:
        assert np.array_equal(block, expected)
    if ending == ".inp":
        assert {"u_0", "v_0", "v_1", "w_0", "w_1"} <= set(content.point_sets)


@pytest.mark.parametrize("ending", [".vtu", ".inp", ".msh", ".vtk", ".med"])
def test_layers_are_sets_of_elements_by_name(tmp_path: Path, ending: str) -> None:
    meshio = pytest.importorskip("meshio")
    mesh = make("layered_pipe", (10, 8, 6), 1)
    assert list(mesh.layers) == ["inner", "pipe", "outer"]
    path = tmp_path / f"part{ending}"
    write_mesh(mesh, path)
    content = meshio.read(path)
    cells = content.cells_dict["hexahedron"]
    found = {}
    if ending == ".inp":
        found = {name: cells[content.cell_sets_dict[name]["hexahedron"]] for name in mesh.layers}
    else:
        data = {".med": "cell_tags", ".msh": "gmsh:physical"}.get(ending, "layer")
        number = content.cell_data_dict[data]["hexahedron"].ravel()
        for k, name in enumerate(mesh.layers, start=1):
            if ending == ".med":
                (k,) = (tag for tag, names in content.cell_tags.items() if names == [name])
            elif ending == ".msh":
                k = content.field_data[name][0]
            elif ending == ".vtu":
                assert content.field_data[name] == [k]
            found[name] = cells[number == k]
    for name, layer in mesh.layers.items():
        expected = np.sort(mesh.blocks["hexahedron"][layer["hexahedron"]], axis=1)
        # MED numbers the corners otherwise, so that sets are compared
        assert np.array_equal(np.sort(found[name], axis=1), expected)


def test_names_of_sides_in_abaqus_files_are_plain_and_different() -> None:
    names = plain_names(["u=0", "u=-1", "u=1", "w=1 (piece 2 of v)", "v=1/2", "v=1.2", "u=0"])
    assert names == {
        "u=0": "u_0", "u=-1": "u_m1", "u=1": "u_1", "w=1 (piece 2 of v)": "w_1_piece_2_of_v",
        "v=1/2": "v_1_2", "v=1.2": "v_1_2_2",
    }  # fmt: skip


@needs_ccx
@pytest.mark.interop
@pytest.mark.parametrize("order", [1, 2])
def test_calculix_sums_the_volume_of_all_element_types(tmp_path: Path, order: int) -> None:
    mesh = make(*BALL, order)
    write_mesh(mesh, tmp_path / "part.inp")
    deck = """*INCLUDE, INPUT=part.inp
*MATERIAL, NAME=m
*ELASTIC
1000., 0.3
*SOLID SECTION, ELSET=solid, MATERIAL=m
*BOUNDARY
w_0, 1, 3
*STEP
*STATIC
*DSLOAD
w_1, P, 1.
*EL PRINT, ELSET=solid, TOTALS=ONLY
EVOL
*END STEP
"""
    (tmp_path / "job.inp").write_text(deck)
    done = subprocess.run(
        ["ccx", "-i", "job"], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert "ERROR" not in done.stdout, done.stdout[-2000:]
    found = re.findall(r"total volume.*\n+\s*([-+.\dEe]+)", (tmp_path / "job.dat").read_text())
    assert float(found[0]) == pytest.approx(mesh.volume(), rel=1e-5 if order == 1 else 1e-4)


# -- the verb --------------------------------------------------------------------------------------


def test_the_verb_writes_files_and_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, report = tmp_path / "tube.vtu", tmp_path / "tube.json"
    code = main(
        ["mesh", "hollow_cylinder", "-o", str(out), "-o", str(tmp_path / "tube.inp"),
         "--cells", "8x2x3", "--order", "2", "--grade", "v=2", "--report", str(report)]
    )  # fmt: skip
    assert code == 0
    said = capsys.readouterr().out
    assert "tube.vtu: 328 nodes; 48 hexahedra of order 2" in said
    assert out.stat().st_size > 328 * 24
    content = json.loads(report.read_text())
    assert content["cells"] == [8, 2, 3]
    assert content["elements"] == {"hexahedron": 48}
    assert set(content["sides"]) == {"v=0", "v=1", "w=0", "w=1"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "x.stl"], "use one of .vtu"),
        (["-o", "x.vtu", "--cells", "4x4"], "is not 3 numbers with 'x' between"),
        (["-o", "x.vtu", "--cells", "4x0x4"], "at least one cell"),
        (["-o", "x.vtu", "--size", "-1"], "positive length"),
        (["-o", "x.vtu", "--grade", "q=2"], "a direction and a ratio"),
        (["-o", "x.vtu", "-o", "./x.vtu"], "same file"),
        (["-o", "x.vtu", "--cells", "2x2x2"], "at least 3"),
        (["-o", "x.vtu", "--cells", "90000x90000x90000"], "make them larger"),
    ],
)
def test_the_verb_refuses_with_a_reason_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    arguments: list[str], message: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["mesh", "hollow_cylinder", *arguments]) == InputError.exit_code
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_meshing_loads_no_kernel(tmp_path: Path) -> None:
    script = (
        "import sys; from pc2cad.cli.main import main\n"
        f"code = main(['mesh', 'ball', '--cells', '8x4x2', '-o', r'{tmp_path / 'b.vtu'}'])\n"
        "sys.exit(code or {'OCP', 'cadquery', 'sympy'} & set(sys.modules) != set())"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


LIMITED = """
import resource, sys
sys.dont_write_bytecode = True  # it would be cut off as well
from pc2cad.cli.main import main
resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
sys.exit(main(["mesh", "hollow_cylinder", "--cells", "20x20x20", "-o", sys.argv[1]]))
"""


@pytest.mark.parametrize("ending", [entry.extension for entry in MESH_FORMATS])
def test_a_file_that_finds_no_room_is_told_in_one_sentence(tmp_path: Path, ending: str) -> None:
    """Whoever writes it: HDF5 printed tracebacks, or ended the process; NumPy kept the reason."""
    path = tmp_path / f"part{ending}"
    path.write_bytes(b"old")
    script = [sys.executable, "-c", LIMITED, str(path)]
    done = subprocess.run(script, capture_output=True, text=True, check=False)
    assert done.returncode == FileNotWrittenError.exit_code
    (line,) = [line for line in done.stderr.splitlines() if line.strip()]
    assert "size limit" in line
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


# -- tetrahedra ------------------------------------------------------------------------------------


@pytest.mark.interop
@pytest.mark.parametrize(
    ("name", "size"),
    [
        pytest.param("hollow_cylinder", 1.5, marks=pytest.mark.slow),
        ("hollow_ball", 1.0),
        ("pyramid_cut", 1.0),
    ],
)
def test_tetrahedra_have_the_same_names_and_nearly_the_same_measures(
    name: str, size: float
) -> None:
    path = next(path for path in TEMPLATES if path.stem == name)
    equation = read_template(path).bind({})
    options = MeshOptions(size=size, order=2, shape="tetrahedra")
    mesh, report = mesh_equation(equation, options)
    assert set(report.elements) == {"tetra"}
    boundary = check_map(equation).analysis.boundary
    assert set(mesh.sides) == {boundary.name(face.patch) for face in boundary.faces}
    assert abs(report.volume_difference) < 5e-3
    assert report.quality.volume == pytest.approx(report.volume, rel=1e-10)
    for side in report.sides.values():
        assert side.area == pytest.approx(side.equation_area, rel=5e-3)


@pytest.mark.interop
def test_numbers_of_cells_are_a_size_of_tetrahedra() -> None:
    """Of a block of 2 x 3 x 4 those of cubes: 1/2."""
    u, v, w = pc.parameters()
    block = pc.compile_equation((2 * u, 3 * v, 4 * w))
    by_cells, by_size = (
        block.mesh(shape="tetrahedra", **given) for given in ({"cells": (2, 6, 16)}, {"size": 0.5})
    )
    assert len(by_cells.points) > 300
    np.testing.assert_array_equal(by_cells.points, by_size.points)
    with pytest.raises(InputError, match="at least one cell along u, v and w, not 0"):
        block.mesh(shape="tetrahedra", cells=(1, 0, 1))


@pytest.mark.interop
@pytest.mark.parametrize(("thickness", "size"), [(3.0, 1e-3), (1e-4, 2e-4)])
def test_tetrahedra_without_number_are_refused(thickness: float, size: float) -> None:
    """A block has too many, and a sheet has too many triangles on its sides."""
    u, v, w = pc.parameters()
    block = pc.compile_equation((3 * u, 3 * v, thickness * w))
    with pytest.raises(InputError, match="make them larger"):
        block.mesh(shape="tetrahedra", size=size)


SPINDLE = """
from math import pi
import pc2cad as pc
u, v, w = pc.parameters()
reach = w*pc.sin(pi*u)
spindle = pc.compile_part((reach*pc.cos(2*pi*v), reach*pc.sin(2*pi*v), 4*u))
try:
    spindle.mesh(shape="tetrahedra", order=2)
except pc.errors.NotASolidError as error:
    print(error)
"""


@pytest.mark.interop
def test_tetrahedra_with_middles_that_gmsh_cannot_place_are_no_abort() -> None:
    """At the tips of a spindle; what gmsh raised there, within its threads, ended the process."""
    script = [sys.executable, "-c", SPINDLE]
    done = subprocess.run(script, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert not done.stdout or "inverted or flat" in done.stdout


def test_a_package_that_is_missing_is_named_with_its_extra() -> None:
    with pytest.raises(InputError, match=r"pip install 'pc2cad\[fea\]'"):
        require("no_such_package", "tetrahedra")
