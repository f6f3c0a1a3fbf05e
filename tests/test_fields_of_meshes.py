"""Fields on meshes, as other libraries read them, against their expressions."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
import vtk
from numpy.typing import ArrayLike
from shipped import checked_of, part_of
from vtkmodules.util.numpy_support import vtk_to_numpy

from pc2cad.checked import CheckedMap
from pc2cad.cli.main import main
from pc2cad.errors import InputError
from pc2cad.export.mesh_files import write_mesh
from pc2cad.export.spline_files import write_splines
from pc2cad.mesh.meshing import MeshOptions, mesh_volume
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.representation.volume import represent_volume

#: a scalar and a vector, of the place and of parameters
FIELDS = {"T": "x + 2*u", "q": "vector(v, w, x*y)"}


def with_fields(name: str) -> CheckedMap:
    known = checked_of(name)
    equation = known.equation.with_fields(**FIELDS)
    return replace(known, analysis=replace(known.analysis, equation=equation))


def mesh_of(name: str, **options: object) -> VolumeMesh:
    return mesh_volume(with_fields(name), MeshOptions(**options))[0]  # type: ignore[arg-type]


def holds(points: ArrayLike, columns: dict[str, ArrayLike]) -> None:
    """Hold columns at nodes against the expressions, to rounding."""
    x, y, _ = np.asarray(points).T
    u, v, w, T, q = (np.asarray(columns[name]) for name in ("u", "v", "w", "T", "q"))
    np.testing.assert_allclose(T, x + 2 * u, rtol=0, atol=1e-14 * np.abs(x).max() + 1e-15)
    np.testing.assert_allclose(q, np.stack([v, w, x * y], axis=1), rtol=0, atol=1e-14 * 4)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("ending", [".vtu", ".vtk"])
def test_vtk_reads_fields_of_nodes_and_cells(tmp_path: Path, ending: str, order: int) -> None:
    path = tmp_path / f"ball{ending}"
    write_mesh(mesh_of("half_ball", cells=(12, 4, 4), order=order), path)
    kind = {".vtu": "XMLUnstructuredGridReader", ".vtk": "UnstructuredGridReader"}[ending]
    reader = getattr(vtk, f"vtk{kind}")()
    if ending == ".vtk":
        reader.ReadAllScalarsOn()
        reader.ReadAllVectorsOn()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    nodes, cells = (
        {
            data.GetArrayName(k): vtk_to_numpy(data.GetArray(k))
            for k in range(data.GetNumberOfArrays())
        }
        for data in (grid.GetPointData(), grid.GetCellData())
    )
    assert {*nodes} == {*cells} - {"side"} == {"u", "v", "w", "T", "q"}
    holds(vtk_to_numpy(grid.GetPoints().GetData()), nodes)
    centres = vtk.vtkCellCenters()
    centres.SetInputData(grid)
    centres.Update()
    x, y, _ = vtk_to_numpy(centres.GetOutput().GetPoints().GetData()).T
    # a value within the cell: no further from its centre than half of a cell
    assert np.abs(cells["T"] - 2 * cells["u"] - x).max() < 0.15
    assert np.abs(cells["q"][:, 2] - x * y).max() < 0.2
    # no cell is on the wrong side of the seam
    turn = np.mod(np.arctan2(y, x) / (2 * np.pi) - cells["u"] + 0.5, 1) - 0.5
    away = np.hypot(x, y) > 0.3
    assert np.abs(turn[away]).max() < 0.03
    assert cells["side"].max() == 2


def test_meshio_reads_fields_from_med_and_objects(tmp_path: Path) -> None:
    mesh = mesh_of("hollow_cylinder", cells=(12, 3, 2))
    path = tmp_path / "pipe.med"
    write_mesh(mesh, path)
    read = meshio.read(path)
    holds(read.points, read.point_data)
    quads = next(k for k, block in enumerate(read.cells) if block.type == "quad")
    solids = next(k for k, block in enumerate(read.cells) if block.type == "hexahedron")
    for k in (quads, solids):
        middles = read.points[read.cells[k].data].mean(axis=1)
        gap = read.cell_data["T"][k] - 2 * read.cell_data["u"][k] - middles[:, 0]
        assert np.abs(gap).max() < 0.15
    ours = mesh.to_meshio()
    holds(mesh.points, ours.point_data)
    assert len(ours.cells) == 1 + len(mesh.whole_sides)
    for name, blocks in ours.cell_data.items():
        assert [len(rows) for rows in blocks] == [len(block.data) for block in ours.cells]
        # the file has the elements first, too
        assert np.array_equal(blocks[0], read.cell_data[name][solids])


@pytest.mark.parametrize("kind", ["ogrid", "tetrahedra"])
def test_other_meshes_have_fields(kind: str) -> None:
    """Places are found from the points: x and y of fields are the nodes' own."""
    if kind == "ogrid":
        mesh = mesh_of("ball", cells=(8, 4, 2), core="ogrid")
    else:
        body = replace(part_of("hollow_cylinder").body, checked=with_fields("hollow_cylinder"))
        mesh = body.meshed(MeshOptions(size=1.0, shape="tetrahedra"))[0]
    assert mesh.columns is not None
    columns = {name: mesh.columns.at_nodes(name) for name in mesh.columns.sizes}
    holds(
        mesh.points, {n: rows if rows.shape[1] > 1 else rows[:, 0] for n, rows in columns.items()}
    )
    (block,) = mesh.blocks
    inside = mesh.columns.in_elements("T", block) - 2 * mesh.columns.in_elements("u", block)
    middles = mesh.points[mesh.blocks[block]].mean(axis=1)
    # O-grids: straight elements hold their middles, and M is found there
    size = 1e-9 if kind == "ogrid" else 0.2
    assert np.abs(inside[:, 0] - middles[:, 0]).max() < size


@pytest.mark.interop
def test_who_meshes_survives_a_closed_pipe() -> None:
    """gmsh.initialize lets SIGPIPE end the process: a server would be gone without a word."""
    part_of("hollow_cylinder").mesh(size=1.0, shape="tetrahedra")
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "wb", buffering=0) as pipe, pytest.raises(BrokenPipeError):
        pipe.write(b"x")


def test_gmsh_shows_fields(tmp_path: Path) -> None:
    import gmsh

    mesh = mesh_of("half_ball", cells=(9, 4, 3))
    path = tmp_path / "ball.msh"
    write_mesh(mesh, path)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        views = gmsh.view.getTags()
        names = [gmsh.view.option.getString(tag, "Name") for tag in views]
        data = {}
        for name, tag in zip(names, views, strict=True):
            kind, _, values, _, _ = gmsh.view.getModelData(tag, 0)
            data[kind, name] = np.array(values)
    finally:
        gmsh.finalize()
    assert names == ["u", "u", "v", "v", "w", "w", "T", "T", "q", "q"]
    holds(mesh.points, {n: data["NodeData", n].squeeze() for n in ("u", "v", "w", "T", "q")})
    assert len(data["ElementData", "T"]) == mesh.elements + sum(
        len(rows) for side in mesh.whole_sides for rows in mesh.facet_nodes(side).values()
    )


@pytest.mark.parametrize("name", ["torus", pytest.param("coil", marks=pytest.mark.slow)])
def test_fields_share_the_space_of_the_spline(name: str) -> None:
    """x, y, z are as near as M is, rational or fitted; what the space cannot hold is stated."""
    known = checked_of(name)
    equation = known.equation.with_fields(place="point(x, y, z)", warm="1 + z/10", wave="sin(9*x)")
    checked = replace(known, analysis=replace(known.analysis, equation=equation))
    model = represent_volume(checked)
    place, warm, wave = model.fields
    grid = [np.linspace(0, 1, 12)] * 3
    for patch, own, one in zip(model.patches, place.volumes, warm.volumes, strict=True):
        assert own.axes is patch.volume.axes
        np.testing.assert_allclose(own(*grid), patch.volume(*grid), atol=1e-12)
        height = 1 + patch.volume(*grid)[..., 2:] / 10
        np.testing.assert_allclose(one(*grid), height, atol=1e-12)
    assert place.deviation <= model.deviation + 1e-12
    assert wave.deviation > 1e-3
    assert wave.largest == pytest.approx(1, abs=0.05)


@pytest.mark.interop
def test_other_readers_evaluate_fields_of_splines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """splinepy, and G+Smo's own reader, of geometry and field: 1 + z/10."""
    splinepy = pytest.importorskip("splinepy")
    monkeypatch.chdir(tmp_path)
    Path("part.toml").write_text(
        'title = "Bent block"\n[solid]\nx = "u"\ny = "v*(1 + u)"\nz = "w + u*v"\n'
        '[fields]\nwarm = "1 + z/10"\n'
    )
    assert main(["spline", "part.toml", "-o", "part.xml", "--field", "warm=warm.xml"]) == 0
    places = np.random.default_rng(2).random((100, 3))
    (shape,), (warm,) = (
        splinepy.io.gismo.load(f"{name}.xml")[0].patches for name in ("part", "warm")
    )
    found = warm.evaluate(places)[:, 0]
    np.testing.assert_allclose(found, 1 + shape.evaluate(places)[:, 2] / 10, atol=1e-14)
    pygismo = pytest.importorskip("pygismo")
    patches = pygismo.core.gsMultiPatch()
    pygismo.io.gsFileData("warm.xml").getFirst(patches)
    assert patches.nPatches() == 1


def test_a_field_of_splines_needs_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for text, words in (("a", "write a field and a file"), ("heat=h.xml", "no field 'heat'")):
        assert main(["spline", "cone", "-o", str(tmp_path / "c.xml"), "--field", text]) != 0
        assert words in capsys.readouterr().err
    model = represent_volume(checked_of("cone"))
    with pytest.raises(InputError, match=r"use one of \.xml, \.gf"):
        write_splines(model, tmp_path / "heat.g2", field="heat")


@pytest.mark.interop
@pytest.mark.parametrize("name", ["elbow_pipe", "turned_ring", "channel_ellipse"])
def test_mfem_evaluates_fields_beside_its_mesh(tmp_path: Path, name: str) -> None:
    """Rational, with reversed patches, fitted: no value is further off than is said."""
    mfem = pytest.importorskip("mfem.ser")
    known = checked_of(name)
    equation = known.equation.with_fields(T="x*y + 2*z", q="vector(x, z, 1)")
    model = represent_volume(replace(known, analysis=replace(known.analysis, equation=equation)))
    mesh_file, field_file = tmp_path / "a.mesh", tmp_path / "a.gf"
    write_splines(model, mesh_file)
    mesh = mfem.Mesh(str(mesh_file), 1, 1)
    random, node, found = np.random.default_rng(1), mfem.IntegrationPoint(), mfem.Vector()
    gaps: dict[str, list[float]] = {"T": [], "q": []}
    for field, rows in gaps.items():
        write_splines(model, field_file, field=field)
        function = mfem.GridFunction(mesh, str(field_file))
        for element in random.integers(mesh.GetNE(), size=100).tolist():
            node.Set3(*random.random(3))
            x, y, z = mesh.GetElementTransformation(element).Transform(node)
            if field == "T":
                rows.append(abs(function.GetValue(element, node) - (x * y + 2 * z)))
            else:
                function.GetVectorValue(element, node, found)
                rows.append(np.abs(np.array([found[k] for k in range(3)]) - (x, z, 1)).max())
    # x and z are in M's own spaces
    assert max(gaps["q"]) < 1e-13 * known.scale.size
    assert 0 < max(gaps["T"]) < 1.1 * model.field("T").deviation


def test_a_field_that_jumps_is_none_of_mfem(tmp_path: Path) -> None:
    known = checked_of("elbow_pipe")
    equation = known.equation.with_fields(turn="v")
    model = represent_volume(replace(known, analysis=replace(known.analysis, equation=equation)))
    with pytest.raises(InputError, match="v=0 and v=1 are one place, and the field turn has two"):
        write_splines(model, tmp_path / "turn.gf", field="turn")
    assert not (tmp_path / "turn.gf").exists()
