"""STL: closed for every shape, size and place; the reader here shares no code with the writer."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter

import numpy as np
import pytest
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid, BRepBuilderAPI_Transform
from OCP.BRepPrimAPI import (
    BRepPrimAPI_MakeBox,
    BRepPrimAPI_MakeCylinder,
    BRepPrimAPI_MakeSphere,
)
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt, gp_Trsf, gp_Vec
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Shell, TopoDS_Solid
from test_export_shapes import SHAPES, exportable, faces_of, parts

from pc2cad.brep.kernel import as_shell, as_solid
from pc2cad.brep.triangles import edge_defects, enclosed_volume, tessellate, weld
from pc2cad.errors import InputError, KernelError
from pc2cad.export import stl
from pc2cad.export.model import Exportable, ExportOptions, GeometricProperties
from pc2cad.export.registry import write

DEFAULT = ExportOptions()


def read(data: bytes) -> np.ndarray:
    """Corners of the facets, (m, 3, 3), single precision; also checks the normals."""
    count = int.from_bytes(data[80:84], "little")
    assert len(data) == 84 + 50 * count
    records = np.frombuffer(data[84:], dtype=np.dtype([("f", "<f4", (4, 3)), ("a", "<u2")]))
    normals, corners = records["f"][:, 0].astype(float), records["f"][:, 1:]
    exact = corners.astype(float)
    cross = np.cross(exact[:, 1] - exact[:, 0], exact[:, 2] - exact[:, 0])
    lengths = np.linalg.norm(cross, axis=1)
    assert np.allclose(normals * lengths[:, None], cross, atol=1e-6 * lengths.max())
    return corners


def volume(corners: np.ndarray) -> float:
    exact = corners.astype(float) - corners.astype(float).mean(axis=(0, 1))
    return float(np.linalg.det(exact).sum() / 6.0)


def assert_closed(corners: np.ndarray) -> None:
    """Every directed edge occurs once and its reverse once, by the bytes in the file."""
    edges = Counter()
    for triangle in corners:
        a, b, c = (corner.tobytes() for corner in triangle)
        assert len({a, b, c}) == 3
        edges.update([(a, b), (b, c), (c, a)])
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)


def changed(item: Exportable, factor: float, offset=(0.0, 0.0, 0.0)) -> Exportable:
    """The part scaled about the origin, then moved."""
    scale, move = gp_Trsf(), gp_Trsf()
    scale.SetScaleFactor(factor)
    move.SetTranslation(gp_Vec(*offset))
    solid = BRepBuilderAPI_Transform(item.solid, move.Multiplied(scale), True).Shape()
    old = item.properties
    figures = GeometricProperties(old.volume * factor**3, old.area * factor**2, old.centroid)
    return dataclasses.replace(item, solid=as_solid(solid), faces=(), properties=figures)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    ("factor", "offset"),
    [
        (1.0, (0.0, 0.0, 0.0)),
        (1e-3, (0.0, 0.0, 0.0)),
        (1e4, (0.0, 0.0, 0.0)),
        (1.0, (1000.0, -2000.0, 500.0)),
    ],
    ids=["as is", "hundredths of mm", "100 m", "far"],
)
def test_is_closed_and_has_the_volume(shape, factor, offset):
    item = changed(exportable(shape), factor, offset)
    corners = read(stl.encode(item, DEFAULT))
    assert_closed(corners)
    assert volume(corners) == pytest.approx(item.properties.volume, rel=0.0101)


@pytest.mark.parametrize("angle", [0.15, 1.5])
@pytest.mark.parametrize("deflection", [0.5, 0.05, 0.005])
@pytest.mark.parametrize("shape", ["hollow sphere", "cylinder", "torus"])
def test_is_closed_for_every_fineness(shape, deflection, angle):
    options = ExportOptions(deflection=deflection, angular_deflection=angle)
    assert_closed(read(stl.encode(exportable(shape), options)))


def test_the_volume_converges_with_the_square_of_the_edge_length():
    item = exportable("torus")
    errors = [
        abs(
            tessellate(item.solid, deflection=d, angular_deflection=1.5).volume
            / item.properties.volume
            - 1.0
        )
        for d in (0.08, 0.02, 0.005)
    ]
    assert errors[0] > 2.5 * errors[1] > 2.5**2 * errors[2]


def test_a_box_has_twelve_triangles():
    corners = read(stl.encode(exportable("box"), DEFAULT))
    assert corners.shape == (12, 3, 3)
    assert volume(corners) == pytest.approx(6000.0, rel=1e-12)


def test_header_is_no_text_variant_and_names_the_unit():
    item = dataclasses.replace(exportable("box"), name="solid Ölwanne\n" + "x" * 200, units="in")
    data = stl.encode(item, DEFAULT)
    assert data[:7] == b"pc2cad "
    assert b"unit in: solid %C3%96lwanne x" in data[:80]
    assert data[:80].isascii()


def test_the_same_part_gives_the_same_bytes():
    assert len({stl.encode(exportable("hollow sphere"), DEFAULT) for _ in range(3)}) == 1


def test_a_coarse_export_does_not_spoil_a_later_fine_one_nor_the_solid():
    item = exportable("torus")
    fine = ExportOptions(deflection=0.01)
    first = stl.encode(item, fine)
    coarse = stl.encode(item, ExportOptions(deflection=1.0, angular_deflection=1.5))
    assert len(coarse) < len(first)
    assert stl.encode(item, fine) == first
    (face,) = faces_of(item.solid)
    assert BRep_Tool.Triangulation_s(face, TopLoc_Location()) is None


def test_the_mesh_is_refined_until_its_volume_is_right():
    # 1/1000 of the rod's length is its radius: the section is a coarse polygon at first
    rod = BRepPrimAPI_MakeCylinder(1.0, 1000.0).Solid()
    exact = 1000.0 * math.pi
    coarse = tessellate(rod, angular_deflection=1.5)
    fine = tessellate(rod, angular_deflection=1.5, volume=exact)
    assert abs(coarse.volume / exact - 1.0) > 0.01
    assert abs(fine.volume / exact - 1.0) <= 0.01
    assert fine.deflection < coarse.deflection


def test_a_thin_wall_keeps_its_volume():
    axes = gp_Ax2(gp_Pnt(0.0, 0.0, 0.0), gp_Dir(1.0, 0.3, 0.0))
    balls = BRepPrimAPI_MakeSphere(50.0), BRepPrimAPI_MakeSphere(axes, 49.99)
    outer, inner = (
        as_shell(parts(ball.Solid(), TopAbs_ShapeEnum.TopAbs_SHELL)[0]) for ball in balls
    )
    solid = BRepBuilderAPI_MakeSolid(outer, as_shell(inner.Reversed())).Solid()
    exact = 4.0 / 3.0 * math.pi * (50.0**3 - 49.99**3)
    assert tessellate(solid, volume=exact).volume == pytest.approx(exact, rel=0.01)


def test_a_volume_that_no_chords_explain_is_refused():
    with pytest.raises(KernelError, match=r"part.s is 5000: more than the"):
        tessellate(exportable("box").solid, volume=5000.0)


def test_triangles_know_their_face():
    mesh = tessellate(exportable("box").solid)
    assert Counter(mesh.faces.tolist()) == dict.fromkeys(range(6), 2)
    middles = mesh.vertices[mesh.triangles].mean(axis=1)
    for face in range(6):
        spread = np.ptp(middles[mesh.faces == face], axis=0)
        assert np.isclose(spread, 0.0).any()


def test_a_solid_with_a_mirrored_location_still_faces_outwards():
    mirror = gp_Trsf()
    mirror.SetMirror(gp_Ax2(gp_Pnt(1.0, 2.0, 3.0), gp_Dir(1.0, 0.0, 0.0)))
    item = exportable("cylinder")
    mirrored = BRepBuilderAPI_Transform(item.solid, mirror, False).Shape()
    corners = read(stl.encode(dataclasses.replace(item, solid=mirrored), DEFAULT))
    assert_closed(corners)
    assert volume(corners) == pytest.approx(item.properties.volume, rel=0.01)
    assert corners[:, :, 0].min() == pytest.approx(-1.0, abs=0.01)


@pytest.mark.parametrize("shape", SHAPES)
def test_too_far_for_single_precision_is_said(shape):
    item = changed(exportable(shape), 1.0, (1e9, 0.0, 0.0))
    with pytest.raises(KernelError, match=r"single precision .* write STEP"):
        stl.encode(item, DEFAULT)


def test_rounding_that_merges_corners_keeps_the_surface_closed():
    fine = ExportOptions(deflection=0.01, angular_deflection=0.1)
    item = changed(exportable("hollow sphere"), 1.0, (3000.0, 0.0, 0.0))
    exact = tessellate(item.solid, deflection=0.01, angular_deflection=0.1)
    corners = read(stl.encode(item, fine))
    assert len(np.unique(corners.reshape(-1, 3), axis=0)) <= len(exact.vertices)
    assert_closed(corners)


def test_deflections_without_end_are_refused():
    with pytest.raises(InputError, match="too fine"):
        stl.encode(exportable("torus"), ExportOptions(deflection=1e-6))


def test_an_inside_out_solid_is_refused():
    item = exportable("box")
    turned = as_solid(item.solid.Reversed())
    with pytest.raises(KernelError, match="must be positive"):
        stl.encode(dataclasses.replace(item, solid=turned, faces=()), DEFAULT)


def test_an_open_shell_is_refused_with_counts():
    builder, shell, solid = BRep_Builder(), TopoDS_Shell(), TopoDS_Solid()
    builder.MakeShell(shell)
    for face in exportable("box").faces[1:]:
        builder.Add(shell, face.face)
    builder.MakeSolid(solid)
    builder.Add(solid, shell)
    with pytest.raises(KernelError, match=r"of 30 directed edges 4 are open and 0 are repeated"):
        tessellate(solid)


def test_an_infinite_solid_is_refused():
    solid = BRepPrimAPI_MakeBox(gp_Pnt(math.inf, 0.0, 0.0), 1.0, 1.0, 1.0).Solid()
    with pytest.raises(KernelError):
        tessellate(solid)


def test_nothing_is_printed(capfd, tmp_path):
    write(exportable("hollow sphere"), tmp_path / "a.stl")
    write(exportable("hollow sphere"), tmp_path / "a.step")
    assert capfd.readouterr() == ("", "")
    assert (tmp_path / "a.stl").read_bytes()[:7] == b"pc2cad "
    assert (tmp_path / "a.step").read_bytes()[:13] == b"ISO-10303-21;"


TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def test_edge_defects_are_counted():
    assert edge_defects(TETRAHEDRON, 4).closed
    hole = edge_defects(TETRAHEDRON[1:], 4)
    assert (hole.open, hole.repeated, hole.closed) == (3, 0, False)
    flipped = TETRAHEDRON.copy()
    flipped[0] = flipped[0, ::-1]
    assert edge_defects(flipped, 4).repeated == 3


def test_weld_merges_equal_points_and_drops_collapsed_triangles():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.0, 0, 0], [1, 0, 0]])
    triangles = np.array([[0, 1, 2], [3, 4, 1], [3, 2, 4]])
    vertices, left, remaining = weld(points, triangles)
    assert vertices.tolist() == [[0, 0, 0], [0, 1, 0], [1, 0, 0]]
    assert left.tolist() == [[0, 2, 1], [0, 1, 2]]
    assert remaining.tolist() == [True, False, True]


def test_volume_far_from_the_origin_does_not_cancel():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) + 2.0**40
    assert enclosed_volume(corners, TETRAHEDRON) == pytest.approx(1.0 / 6.0, rel=1e-3)
    assert enclosed_volume(corners, TETRAHEDRON[:, ::-1]) < 0.0
