"""Pictures: what is drawn is the solid, where it is drawn, and what is said over it is true."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from shipped import LONG, part_of
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOImage import vtkPNGReader

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.errors import InputError
from pc2cad.export.colours import SIDE_COLOURS
from pc2cad.part import Part
from pc2cad.picture import raster
from pc2cad.picture.camera import VIEWS, aim
from pc2cad.picture.colours import shares, viridis
from pc2cad.picture.drawing import drawing
from pc2cad.picture.image import camera_for, encode
from pc2cad.picture.maps import NoWallError, thicknesses
from pc2cad.picture.overlay import TEXT_HEIGHT, Text, overlay, ticks
from pc2cad.picture.scene import Scene
from pc2cad.picture.sides import Sides
from pc2cad.picture.style import Style
from pc2cad.templates.shipped import template_paths

SMALL = (240, 160)


@cache
def cube() -> Part:
    return pc.compile_part(list(pc.parameters()), name="cube")


def pixels(data: bytes) -> np.ndarray:
    reader = vtkPNGReader()
    with tempfile.NamedTemporaryFile(suffix=".png") as file:
        file.write(data)
        file.flush()
        reader.SetFileName(file.name)
        reader.Update()
    width, height, _ = reader.GetOutput().GetDimensions()
    values = vtk_to_numpy(reader.GetOutput().GetPointData().GetScalars())
    return values.reshape(height, width, -1)[::-1]


def enclosed(scene: Scene, inside: frozenset[str] | set[str] = frozenset()) -> float:
    """The volume within all surfaces but those that lie between layers."""
    outer = [s for s in scene.surfaces if s.name not in inside]
    corners = np.concatenate([s.points[s.triangles] for s in outer])
    return float(np.linalg.det(corners).sum() / 6)


@pytest.mark.parametrize("name", sorted({*list(template_paths())[::3]} - {*LONG}))
def test_templates_render_and_the_surfaces_are_their_boundary(name):
    part = part_of(name)
    scene = drawing(part, Style(colours=True, labels=True, isolines=2))
    inside = {p.name for p in Sides(part).patches(2) if p.index not in part.model.outer}
    assert enclosed(scene, inside) == pytest.approx(part.report.solid.volume, rel=5e-3)
    for surface in scene.surfaces:
        assert np.allclose(np.linalg.norm(surface.normals, axis=1), 1.0)
    image = pixels(encode(scene, camera_for(scene, VIEWS["iso"], SMALL), "a.png"))
    assert image.shape == (160, 240, 3)
    drawn = (image < 250).any(axis=2)
    assert 0.04 < drawn.mean() < 0.9
    assert not drawn[:4].any()
    assert not drawn[-4:].any()


def test_faces_that_end_at_a_cusp_are_drawn():
    u, v, w = pc.parameters()
    t = 2 * pc.pi * v
    x = 16 * pc.sin(t) ** 3
    y = 13 * pc.cos(t) - 5 * pc.cos(2 * t) - 2 * pc.cos(3 * t) - pc.cos(4 * t)
    heart = pc.compile_part([x * w, y * w, 5 * u])
    scene = drawing(heart, Style(labels=True, isolines=2))
    assert enclosed(scene) == pytest.approx(900 * math.pi, rel=5e-3)


def test_faces_whose_corners_are_singular_are_lit_from_outside():
    u, v, w = pc.parameters()
    across, up = 2 * pc.pi * u, pc.pi * (v - 0.5)
    x, y = pc.cos(up) * abs(pc.cos(up)) * w, pc.sin(up) * abs(pc.sin(up)) * w
    round_z = (pc.cos(across) * abs(pc.cos(across)), pc.sin(across) * abs(pc.sin(across)))
    octahedron = pc.compile_part([3 * x * round_z[0], 2 * x * round_z[1], y])
    scene = drawing(octahedron, Style())
    assert len(scene.surfaces) == 8
    for surface in scene.surfaces:
        outwards = (surface.points * surface.normals).sum(axis=1)
        assert outwards == pytest.approx(1 / math.sqrt(1 / 9 + 1 / 4 + 1))
    assert enclosed(scene) == pytest.approx(8.0)


def test_a_point_is_where_the_camera_says():
    camera = aim(np.array([[0.0, 0, 0], [2, 2, 2]]), VIEWS["front"], (200, 100))
    middle, depth = camera.project(np.array([[1.0, 1, 1], [1, 0, 1], [2, 1, 1], [1, 1, 2]]))
    assert middle[0] == pytest.approx((100, 50))
    assert depth[1] > depth[0]  # nearer to the eye, which is at -y
    assert middle[2, 0] > middle[0, 0]
    assert middle[3, 1] < middle[0, 1]
    ends, _ = camera.project(np.array([[0.0, 0, 0], [0, 0, 2]]))
    assert abs(ends[1, 1] - ends[0, 1]) == pytest.approx(100 * (1 - 2 * 0.06))


def test_the_depth_of_pixels_is_that_of_the_surface():
    scene = drawing(cube(), Style())
    camera = camera_for(scene, VIEWS["iso"], (200, 200))
    seen = raster.depths(scene, camera)
    places = np.array([[0.4, 0.0, 0.7], [1.0, 0.3, 0.2], [0.6, 0.45, 1.0]])
    at, depth = camera.project(places)
    columns, rows = at.astype(int).T
    assert seen[rows, columns] == pytest.approx(depth, abs=2 * camera.scale)


def test_faces_have_the_colours_of_their_sides():
    scene = drawing(cube(), Style(colours=True, edges=False))
    camera = camera_for(scene, VIEWS["iso"], (200, 200))
    image = raster.colours(scene, camera).astype(float)
    for place, colour in [
        ((0.5, 0.0, 0.5), SIDE_COLOURS[1][0]),
        ((1.0, 0.5, 0.5), SIDE_COLOURS[0][1]),
        ((0.5, 0.5, 1.0), SIDE_COLOURS[2][1]),
    ]:
        (x, y), _ = camera.project(np.array([place]))[0][0], None
        shown = image[int(y), int(x)]
        assert shown @ colour / np.linalg.norm(shown) / np.linalg.norm(colour) > 0.99


def test_names_of_hidden_and_collapsed_sides_say_so():
    scene = drawing(part_of("pyramid"), Style(labels=True))
    camera = camera_for(scene, (0.2, -1.5, -1.0))
    shapes = overlay(scene.labels, None, camera, raster.depths(scene, camera))
    texts = [shape.text for shape in shapes if isinstance(shape, Text)]
    assert len(texts) == 6
    assert "w=0" in texts  # seen from below
    assert {"v=0 is a curve", "w=1 is a point"} <= {
        text.removesuffix(" (behind)") for text in texts
    }
    above = camera_for(scene, (0.0, 0.0, 1.0))
    hidden = overlay(scene.labels, None, above, raster.depths(scene, above))
    assert "w=0 (behind)" in [shape.text for shape in hidden if isinstance(shape, Text)]


def test_pieces_without_room_are_named_once_beside_the_part():
    scene = drawing(cube(), Style(labels=True))
    camera = camera_for(scene, VIEWS["iso"], (640, 520))
    seen = raster.depths(scene, camera)
    one, *_ = (label for label in scene.labels if label.text == "w=1")
    across = np.argsort(-camera.project(one.places)[0][:, 0])[:40]  # beside the outline
    pieces = tuple(
        replace(one, text=f"w=1 (piece {i} of u)", places=one.places[across], whole="w=1")
        for i in range(40)
    )
    few = [s for s in overlay(pieces[:2], None, camera, seen) if isinstance(s, Text)]
    assert [s.text for s in few] == ["w=1 (piece 0 of u)", "w=1 (piece 1 of u)"]
    (text,) = (s for s in overlay(pieces, None, camera, seen) if isinstance(s, Text))
    assert text.text == "w=1 (40 faces)"
    rows = slice(int(text.y - TEXT_HEIGHT / 2), int(text.y + TEXT_HEIGHT / 2))
    assert (seen[rows, int(text.x) : int(text.x + text.width)] == seen.min()).all()


def test_names_without_room_are_counted_and_none_lies_upon_another():
    scene = drawing(part_of("pyramid"), Style(labels=True))
    camera = camera_for(scene, VIEWS["iso"], (640, 520))
    crowd = tuple(
        replace(label, text=f"{label.text} {i}", whole="")
        for i in range(20)
        for label in scene.labels
    )
    *names, note = [s for s in overlay(crowd, None, camera, None) if isinstance(s, Text)]
    assert 10 <= len(names) < len(crowd)
    assert note.text == f"no room for the names of {len(crowd) - len(names)} seen"
    for i, one in enumerate(names):
        assert one.x >= 0
        assert one.x + one.width <= 640
        for other in names[:i]:
            apart = one.x > other.x + other.width or other.x > one.x + one.width
            assert apart or abs(one.y - other.y) >= TEXT_HEIGHT


def test_svg_shows_nine_of_the_twelve_edges_of_a_cube():
    scene = drawing(cube(), Style(labels=True))
    camera = camera_for(scene, VIEWS["iso"], (400, 400))
    root = ET.fromstring(encode(scene, camera, "cube.svg"))
    name = "{http://www.w3.org/2000/svg}"
    length = 0.0
    for line in root.iter(f"{name}polyline"):
        path = np.array([p.split(",") for p in line.get("points").split()], dtype=float)
        length += float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    ends = np.array([[(0, 0, 0), axis] for axis in np.eye(3)])
    edges = [np.linalg.norm(np.subtract(*camera.project(pair)[0])) for pair in ends]
    assert length == pytest.approx(3 * sum(edges), rel=0.03)
    texts = [element.text for element in root.iter(f"{name}text")]
    assert sorted(t for t in texts if "behind" not in t) == ["u=1", "v=0", "w=1"]
    assert root.find(f"{name}image").get("href").startswith("data:image/png;base64,")


def test_exploded_faces_do_not_touch():
    scene = drawing(part_of("channel_ellipse"), Style(explode=0.3))
    boxes = [(s.points.min(axis=0), s.points.max(axis=0)) for s in scene.surfaces]
    assert len(boxes) == 4
    for i, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[i + 1 :]:
            assert (high < other_low).any() or (other_high < low).any()


@pytest.mark.parametrize("counts", [(20, 20, 30), (100, 100, 100)])
def test_the_point_set_of_figure_1_at_any_density(counts):
    scene = drawing(part_of("pyramid"), Style(points=counts))
    (cloud,) = scene.clouds
    assert len(cloud.points) == math.prod(counts)
    heights = np.unique(np.round(cloud.points[:, 2], 9))
    assert heights.min() == 0.0
    assert heights.max() == 6.0
    image = raster.colours(scene, camera_for(scene, VIEWS["iso"], SMALL))
    assert (image < 250).any(axis=2).mean() > 0.1


FIELDS = {"height": "1 + z", "warm": "20 + 80*u", "flow": "vector(0, x, 1)"}


@pytest.mark.parametrize("name", ["pyramid", "torus"])
def test_fields_colour_the_faces_at_every_point(name):
    equation = pc.read_template(template_paths()[name]).bind().with_fields(**FIELDS)
    part = pc.compile_equation(equation)
    scene = drawing(part, Style(field="height"))
    heights = [1 + surface.points[:, 2] for surface in scene.surfaces]
    low, high = min(h.min() for h in heights), max(h.max() for h in heights)
    assert (scene.bar.title, scene.bar.low, scene.bar.high) == ("height (sampled)", low, high)
    assert len(heights) > 0
    for surface, height in zip(scene.surfaces, heights, strict=True):
        assert np.allclose(surface.colour, viridis(shares(height, low, high)), atol=1e-12)
    assert (drawing(part, Style(field="warm")).bar.low, scene.bar.low) == (20.0, low)
    assert drawing(part, Style(field="warm")).bar.high == pytest.approx(100.0)


def test_fields_that_no_colour_shows_are_refused(tmp_path, capsys):
    equation = pc.read_template(template_paths()["pyramid"]).bind().with_fields(**FIELDS)
    part = pc.compile_equation(equation)
    with pytest.raises(InputError, match="flow is a vector: make a field of its length"):
        drawing(part, Style(field="flow"))
    with pytest.raises(InputError, match=r"has no field .cold. \(it has: height"):
        drawing(part, Style(field="cold"))
    with pytest.raises(InputError, match="a map or a field"):
        Style(field="warm", map="deviation")
    with pytest.raises(InputError, match="leave out points"):
        Style(field="warm", explode=1.0)
    target = tmp_path / "p.png"
    assert main(["render", "pyramid", "-o", str(target), "--field", "warm"]) == 2
    assert "warm" in capsys.readouterr().err
    assert not target.exists()


@pytest.mark.slow
def test_deviation_map_agrees_with_the_report():
    part = part_of("channel_ellipse")
    scene = drawing(part, Style(map="deviation"))
    assert 0.2 * part.report.deviation < scene.bar.high <= part.report.tolerance
    assert part.report.units in scene.bar.title
    exact = drawing(part_of("pyramid_cut"), Style(map="deviation"))
    assert exact.bar.high < 1e-14 * 100


def test_deviation_map_finds_a_face_that_is_elsewhere():
    import dataclasses

    slanted = pc.compile_part(list(np.array(pc.parameters()) * (1, 1, 1.01)))
    body = dataclasses.replace(cube().body, built=slanted.built)
    wrong = dataclasses.replace(cube(), bodies={"cube": body})
    assert drawing(wrong, Style(map="deviation")).bar.high == pytest.approx(0.01, rel=1e-9)


def test_thickness_of_a_hollow_ball_is_the_difference_of_its_radii():
    template = pc.read_template(template_paths()["hollow_ball"])
    assert template.bind().expectations.volume == pytest.approx(4 / 3 * math.pi * (2**3 - 1**3))
    thin = pc.compile_equation(template.bind({"r": 3, "wall": 0.1}))
    for part, wall in ((part_of("hollow_ball"), 2 - 1), (thin, 0.1)):
        scene = drawing(part, Style(map="thickness"))
        assert scene.bar.low == pytest.approx(wall, rel=2e-3)
        assert scene.bar.high == pytest.approx(wall, rel=2e-3)


def test_thickness_of_a_wedge_varies_as_its_wall():
    u, v, w = pc.parameters()
    part = pc.compile_part([4 * u, 3 * v, w * (1 + u)])
    patches = list(Sides(part).patches(9))
    upper = next(p for p in patches if (p.direction, p.limit) == (2, 1))
    values = thicknesses(patches, 2)[patches.index(upper)]
    assert values[:, 4] == pytest.approx(np.linspace(1.0, 2.0, 9), rel=1e-12)
    with pytest.raises(NoWallError, match="no wall along w"):
        drawing(part_of("pyramid"), Style(map="thickness", across="w"))


def test_scales_have_round_numbers_and_order():
    assert ticks(0.0, 1.0) == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert ticks(3.0, 3.0) == [3.0]
    assert all(0.18 <= t <= 0.30001 for t in ticks(0.182, 0.3))
    grey = viridis(np.linspace(0, 1, 50)) @ (0.21, 0.72, 0.07)
    assert np.all(np.diff(grey) > 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "a.jpg"], "use one of .png, .svg"),
        (["-o", "a.png", "--view", "0,0,0"], "no length"),
        (["-o", "a.png", "--view", "skew"], "none of iso"),
        (["-o", "a.png", "--points", "2,3"], "3 numbers"),
        (["-o", "a.png", "--points", "9999,9999,9999"], "point set"),
        (["-o", "a.png", "--size", "1x1"], "pixels"),
        (["-o", "a.png", "--map", "thickness", "--explode", "1"], "in place"),
        (["-o", "a.png", "--explode", "-1"], "moved apart"),
        (["-o", "missing/a.png"], "folder does not exist"),
    ],
)
def test_wrong_arguments_are_named_and_leave_nothing(
    arguments, message, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["render", "pyramid", *arguments]) in (2, 5)
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_style_refuses_what_it_cannot_draw():
    with pytest.raises(InputError):
        Style(isolines=-1)


@pytest.mark.slow
def test_without_a_display_and_without_noise(tmp_path):
    environment = {k: v for k, v in os.environ.items() if k != "DISPLAY"}
    command = [sys.executable, "-m", "pc2cad.cli.main", "render", "pyramid", "-o", "p.png"]
    environment["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "p.png: 960 x 640 pixels\n"
