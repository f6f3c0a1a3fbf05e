"""BREP, IGES, STL text, 3MF, GLB and VTP, read back by code that shares nothing with the writer."""

from __future__ import annotations

import dataclasses
import io
import json
import re
import struct
import zipfile
from pathlib import Path

import lib3mf
import numpy as np
import pytest
import trimesh
from OCP.BRep import BRep_Builder
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.BRepTools import BRepTools
from OCP.GProp import GProp_GProps
from OCP.IFSelect import IFSelect_RetDone
from OCP.IGESControl import IGESControl_Reader
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS_Shape
from test_export_shapes import SHAPES, exportable, faces_of, spline_poles

from pc2cad.brep.triangles import Triangles, edge_defects, enclosed_volume, weld
from pc2cad.cli.main import main
from pc2cad.errors import KernelError
from pc2cad.export import brep, glb, iges, stl, stl_text, threemf, vtp
from pc2cad.export.kernel import census, check_read_back
from pc2cad.export.model import Exportable, ExportOptions
from pc2cad.export.registry import FORMATS, format_for

OPTIONS = ExportOptions(timestamp="2026-01-31T12:00:00Z")
every_shape = pytest.mark.parametrize("shape", SHAPES)


def read_brep(data: bytes, _folder: Path) -> TopoDS_Shape:
    found = TopoDS_Shape()
    BRepTools.Read_s(found, io.BytesIO(data), BRep_Builder())
    return found


def read_iges(data: bytes, folder: Path) -> TopoDS_Shape:
    path = folder / "part.igs"
    path.write_bytes(data)
    reader = IGESControl_Reader()
    assert reader.ReadFile(str(path)) == IFSelect_RetDone
    reader.TransferRoots()
    return reader.OneShape()


def volume_of(solid: TopoDS_Shape) -> float:
    found = GProp_GProps()
    BRepGProp.VolumeProperties_s(solid, found)
    return found.Mass()


def coloured(item: Exportable) -> Exportable:
    """Every face its own colour, the first one none."""
    n = len(item.faces)
    faces = [dataclasses.replace(f, colour=(i / n, 0.5, 1 - i / n)) for i, f in
             enumerate(item.faces)]  # fmt: skip
    return dataclasses.replace(item, faces=(item.faces[0], *faces[1:]))


def closed(vertices: np.ndarray, triangles: np.ndarray) -> bool:
    vertices, triangles, _ = weld(np.asarray(vertices), np.asarray(triangles, dtype=np.int64))
    return edge_defects(triangles, len(vertices)).closed


@pytest.mark.parametrize(("module", "read"), [(brep, read_brep), (iges, read_iges)])
@every_shape
def test_exact_formats_come_back_as_they_were(module, read, shape, tmp_path):
    item = exportable(shape)
    found = read(module.encode(item, OPTIONS), tmp_path)
    assert found.ShapeType() == TopAbs_ShapeEnum.TopAbs_SOLID
    assert BRepCheck_Analyzer(found).IsValid()
    assert len(faces_of(found)) == len(faces_of(item.solid))
    assert volume_of(found) == pytest.approx(item.properties.volume, rel=1e-12)
    if shape == "spline box":
        assert np.array_equal(spline_poles(found), spline_poles(item.solid))


@pytest.mark.parametrize(("unit", "in_mm"), [("mm", 1.0), ("cm", 10.0), ("m", 1e3), ("in", 25.4)])
def test_iges_states_the_unit(unit, in_mm, tmp_path):
    item = dataclasses.replace(exportable("cylinder"), units=unit)
    # a reader that works in millimetres, the default
    found = read_iges(iges.encode(item, OPTIONS), tmp_path)
    assert volume_of(found) == pytest.approx(item.properties.volume * in_mm**3, rel=1e-12)


def test_iges_carries_names_and_colours_and_nothing_of_the_machine():
    text = iges.encode(coloured(exportable("box")), OPTIONS).decode("ascii")
    assert {f"side={i}" for i in range(6)} <= set(re.findall(r"side=\d", text))
    assert len(re.findall(r"^ +314 ", text, re.M)) == 2 * 5  # two lines per colour definition
    assert "3Hbox" in text
    assert "15H20260131.120000" in text
    assert all(len(line) == 80 for line in text.splitlines())


@pytest.mark.parametrize("entry", FORMATS, ids=lambda entry: entry.name)
def test_every_format_gives_the_same_bytes_each_time_and_needs_a_solid(entry):
    encode, item = entry.encoder(), coloured(exportable("cylinder"))
    assert encode(item, OPTIONS) == encode(item, OPTIONS)
    with pytest.raises(KernelError):
        encode(dataclasses.replace(item, solid=TopoDS_Shape()), OPTIONS)


def test_reading_back_something_else_is_refused():
    item = exportable("box")
    check_read_back(item.solid, census(item), "file")
    for other in ("cylinder", "torus"):
        with pytest.raises(KernelError, match="file reads back with"):
            check_read_back(exportable(other).solid, census(item), "file")


@every_shape
def test_stl_text_says_the_same_as_binary(shape):
    item = exportable(shape)
    text = stl_text.encode(item, OPTIONS).decode("ascii")
    numbers = re.findall(r"vertex (\S+) (\S+) (\S+)", text)
    corners = np.array(numbers, dtype=float).reshape(-1, 3, 3)
    binary = np.frombuffer(stl.encode(item, OPTIONS)[84:], dtype=stl._FACET)["corners"]
    assert np.array_equal(corners.astype(np.float32), binary)
    assert "-0 " not in text
    mesh = trimesh.load(io.BytesIO(text.encode()), file_type="stl")
    assert mesh.is_volume


def read_3mf(data: bytes):
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(data)
    assert reader.GetWarningCount() == 0
    things = model.GetMeshObjects()
    assert things.Count() == 1
    things.MoveNext()
    return model, things.GetCurrentMeshObject()


@every_shape
def test_3mf_is_accepted_strictly_and_closed(shape):
    item = exportable(shape)
    _, thing = read_3mf(threemf.encode(item, OPTIONS))
    assert thing.IsManifoldAndOriented()
    points = np.array([p.Coordinates[:] for p in thing.GetVertices()])
    triangles = np.array([t.Indices[:] for t in thing.GetTriangleIndices()])
    assert closed(points, triangles)
    assert enclosed_volume(points, triangles) == pytest.approx(item.properties.volume, rel=0.0101)
    sets = [thing.GetTriangleSet(i) for i in range(thing.GetTriangleSetCount())]
    assert [s.GetName() for s in sets] == [face.name for face in item.faces]
    assert sum(len(s.GetTriangleList()) for s in sets) == len(triangles)


@pytest.mark.parametrize("unit", ["mm", "cm", "m", "in"])
def test_3mf_states_unit_title_and_colours(unit):
    item = coloured(dataclasses.replace(exportable("box"), units=unit, name="Kästchen <1>"))
    data = threemf.encode(item, OPTIONS)
    model, thing = read_3mf(data)
    assert thing.GetName() == "Kästchen <1>"
    text = zipfile.ZipFile(io.BytesIO(data)).read("3D/3dmodel.model").decode()
    long = {"mm": "millimeter", "cm": "centimeter", "m": "meter", "in": "inch"}[unit]
    assert f'unit="{long}"' in text
    group = model.GetColorGroups()
    assert group.MoveNext()
    used = {tuple(p.PropertyIDs) for p in thing.GetAllTriangleProperties()}
    assert len(used) == 6


def test_3mf_that_is_not_closed_is_refused(monkeypatch):
    whole = threemf.single_precision

    def torn(*arguments) -> Triangles:
        mesh = whole(*arguments)
        return dataclasses.replace(mesh, triangles=mesh.triangles[1:], faces=mesh.faces[1:])

    monkeypatch.setattr(threemf, "single_precision", torn)
    with pytest.raises(KernelError, match=r"lib3mf|3MF"):
        threemf.encode(exportable("box"), OPTIONS)


def read_glb(data: bytes) -> dict:
    magic, version, length, size, kind = struct.unpack_from("<4sIIII", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), 0x4E4F534A)
    assert (length % 4, size % 4) == (0, 0)
    return json.loads(data[20 : 20 + size])


@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0)])
@every_shape
def test_glb_is_in_metres_with_y_up(shape, unit, metres):
    item = coloured(dataclasses.replace(exportable(shape), units=unit))
    data = glb.encode(item, OPTIONS)
    scene = trimesh.load(io.BytesIO(data), file_type="glb")
    assert set(scene.geometry) == {face.name for face in item.faces}
    whole = scene.to_geometry()
    points = np.asarray(whole.vertices)
    assert closed(points, whole.faces)
    expected = item.properties.volume * metres**3
    assert enclosed_volume(points, whole.faces) == pytest.approx(expected, rel=0.0101)
    x, y, z = item.properties.centroid
    assert whole.center_mass / metres == pytest.approx((x, z, -y), abs=0.05)


def test_glb_has_normals_out_of_the_solid_and_limits():
    document = read_glb(glb.encode(exportable("hollow sphere"), OPTIONS))
    assert document["asset"]["version"] == "2.0"
    limits = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]
    assert np.allclose(limits["max"], 0.005, atol=2e-5)
    scene = trimesh.load(io.BytesIO(glb.encode(exportable("hollow sphere"), OPTIONS)),
                         file_type="glb")  # fmt: skip
    assert len(scene.geometry) == 2
    for mesh in scene.geometry.values():
        radial = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
        outwards = np.einsum("ij,ij->i", radial, mesh.vertex_normals)
        sign = 1.0 if np.linalg.norm(mesh.vertices[0]) > 0.004 else -1.0
        assert np.all(sign * outwards > 0.99)


@every_shape
def test_vtp_keeps_doubles_and_sides(shape, tmp_path):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    item = exportable(shape)
    path = tmp_path / "part.vtp"
    path.write_bytes(vtp.encode(item, OPTIONS))
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    points = vtk_to_numpy(data.GetPoints().GetData())
    assert points.dtype == np.float64
    triangles = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    assert closed(points, triangles)
    assert enclosed_volume(points, triangles) == pytest.approx(item.properties.volume, rel=0.0101)
    sides = data.GetFieldData().GetAbstractArray("sides")
    names = [sides.GetValue(i) for i in range(sides.GetNumberOfValues())]
    assert names == [face.name for face in item.faces]
    assert data.GetFieldData().GetAbstractArray("unit").GetValue(0) == "mm"
    assert set(vtk_to_numpy(data.GetCellData().GetArray("side"))) == set(range(len(names)))


def test_endings_are_told_apart_and_listed(capsys):
    endings = [ending for entry in FORMATS for ending in entry.extensions]
    assert len(endings) == len(set(endings))
    assert all(format_for(f"A{ending.upper()}").extensions[0] for ending in endings)
    assert main(["build", "--list-formats"]) == 0
    listed = capsys.readouterr().out
    assert all(entry.title in listed and entry.precision in listed for entry in FORMATS)
    assert all(entry.specification.startswith("https://") for entry in FORMATS)


def test_build_writes_every_format_at_once(tmp_path, capsys):
    outputs = [tmp_path / f"p{ending}" for entry in FORMATS for ending in entry.extensions]
    flags = [flag for path in outputs for flag in ("-o", str(path))]
    assert main(["build", "pyramid_cut", "--colours", *flags]) == 0
    assert all(path.stat().st_size for path in outputs)
    assert len(re.findall(r"written as \d+ triangles", capsys.readouterr().out)) == sum(
        len(entry.extensions) for entry in FORMATS if entry.triangles
    )
