"""Triangles on the faces' own grids: as near as asked, few, and never in a file of the solid."""

from __future__ import annotations

import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from OCP.BRep import BRep_Tool
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location

from pc2cad.brep.display import FINEST, attach_for_display
from pc2cad.brep.face_patches import shapes_of
from pc2cad.brep.kernel import as_face
from pc2cad.brep.triangle_grids import FaceGrid, grids
from pc2cad.brep.triangles import edge_defects, tessellate
from pc2cad.compiler import compile_equation
from pc2cad.part import Part
from pc2cad.templates.file import parse_template, read_template
from pc2cad.templates.shipped import find_template


@cache
def shipped(name: str, **values: float) -> Part:
    return compile_equation(read_template(find_template(name)).bind(values))


def off_the_surface(grid: FaceGrid, seed: int = 0) -> float:
    """Return the largest distance of surface points from the planes of their triangles."""
    shares = np.random.default_rng(seed).dirichlet((1.0, 1.0, 1.0), len(grid.triangles))
    a, b, c = (grid.points[grid.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.sqrt((normals**2).sum(axis=1))
    assert lengths.min() > 0  # sides that are points make fans
    places = (grid.parameters[grid.triangles] * shares[:, :, None]).sum(axis=1)
    points = grid.patch.surface.jet(places[:, 0], places[:, 1])[0]
    heights = np.abs(((points - a) * normals).sum(axis=1)) / lengths
    return float(heights.max())


def of_the_kernel(part: Part) -> list[int]:
    """Return the triangles that each face of a part's own solid has upon it."""
    found = [
        BRep_Tool.Triangulation_s(as_face(face), TopLoc_Location())
        for face in shapes_of(part.shape, TopAbs_ShapeEnum.TopAbs_FACE)
    ]
    return [0 if mesh is None else mesh.NbTriangles() for mesh in found]


def test_two_walls_take_a_moment_and_few_triangles() -> None:
    part = shipped("channel_ellipse", delta=0.3)
    true = part.report.equation
    start = time.process_time()
    mesh = tessellate(
        part.shape, deflection=1e-3, angular_deflection=0.1, volume=true.volume, area=true.area
    )
    # the kernel's own: 20 s and 143,000
    assert time.process_time() - start < 5
    assert len(mesh.triangles) < 60_000
    assert edge_defects(mesh.triangles, len(mesh.vertices)).closed
    assert abs(mesh.volume - true.volume) < 1e-3 * true.area
    own = grids(part.shape, 1e-3, 0.1)
    assert len(own) == 2
    for grid in own.values():
        assert 0.5e-3 < off_the_surface(grid) <= 1e-3


@pytest.mark.parametrize("name", ["ball", "torus", "elbow_pipe", "ellipsoid", "half_ball"])
@pytest.mark.parametrize("share", [0.01, 0.0004])
def test_triangles_are_as_near_as_asked(name: str, share: float) -> None:
    part = shipped(name)
    deflection = share * part.report.size
    own = grids(part.shape, deflection, 0.3)
    assert own
    for grid in own.values():
        assert off_the_surface(grid) <= 1.02 * deflection
        assert grid.deflection <= deflection


def test_lines_are_close_where_the_surface_bends() -> None:
    bump = parse_template(
        'title = "B"\n[solid]\nx = "u"\ny = "v"\nz = "w + 0.05*w/(1 + 900*(u - 0.5)**2)"\n', "bump"
    )
    part = compile_equation(bump.bind({}))
    (grid,) = grids(part.shape, 1e-4, 0.5).values()
    along = max(grid.lines, key=len)
    steps = np.diff(along)
    middle = steps[np.abs(along[1:] - 0.5) < 0.05]
    assert 20 < len(along) < 80
    assert len(middle) > 5
    assert steps.max() > 5 * middle.max()
    assert min(map(len, grid.lines)) == 2  # straight across


def test_curved_neighbours_share_the_nodes_of_their_edges() -> None:
    text = 'title = "P"\n[solid]\nx = "u + 0.2*w*w"\ny = "v + 0.2*u*w"\nz = "w + 0.3*u*v*v"\n'
    part = compile_equation(parse_template(text, "pillow").bind({}))
    assert len(grids(part.shape, 1e-3, 0.3)) >= 3
    mesh = tessellate(part.shape, deflection=1e-3, volume=part.report.integrals.volume)
    assert edge_defects(mesh.triangles, len(mesh.vertices)).closed


def test_what_is_displayed_is_in_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")

    def written() -> dict[str, bytes]:
        for ending in ("step", "brep", "stl", "glb"):
            part.write(tmp_path / f"a.{ending}")
        return {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    part = compile_equation(read_template(find_template("ellipsoid")).bind({}))
    before = written()
    assert len(before) == 4
    assert sum(of_the_kernel(part)) == 0
    assert attach_for_display(part.shape) is not None
    shown = of_the_kernel(part)
    assert sum(shown) > 10_000
    assert written() == before
    assert attach_for_display(part.shape) is None
    assert of_the_kernel(part) == shown


def test_the_kernel_keeps_them_where_they_are_fine_enough() -> None:
    part = compile_equation(read_template(find_template("bilinear_top")).bind({}))
    deflection = attach_for_display(part.shape)
    assert deflection == pytest.approx(FINEST * part.report.size, rel=0.5)
    walls = max(of_the_kernel(part))
    assert walls > 1000
    BRepMesh_IncrementalMesh(part.shape, deflection, False, 0.1, False)
    now = of_the_kernel(part)
    assert max(now) == walls
    assert min(now) > 0  # the planes have taken its nodes


def test_solids_of_elementary_faces_are_left_to_the_kernel() -> None:
    part = shipped("ball")
    assert attach_for_display(part.shape) is None
    assert of_the_kernel(part) == [0]
