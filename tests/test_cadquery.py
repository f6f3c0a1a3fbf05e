"""The CadQuery plugin keeps CadQuery's conventions: stack, combine, clean, tags, selectors."""

from __future__ import annotations

import importlib
import math
import pickle
import subprocess
import sys

import cadquery as cq
import pytest
from shipped import CUBES

import pc2cad as pc
import pc2cad.cadquery as pcq
from pc2cad.errors import InputError
from pc2cad.templates.file import parse_template
from pc2cad.templates.shipped import find_template

VOLUME = 31.5  # of the pyramid
SIDES = {"u=0", "u=1", "v=1", "w=0"}


def cube(edge: float):
    """A cube with a corner at the origin; u, v and w run along x, y and z."""
    return [edge * parameter for parameter in pc.parameters()]


def tags(workplane: cq.Workplane) -> dict[str, int]:
    """Return how many faces each tag has; sides under the names that they have in reports."""
    found = {name: tagged.size() for name, tagged in workplane.ctx.tags.items()}
    plain = {name: n for name, n in found.items() if "=" not in name}
    named = {name: n for name, n in found.items() if "=" in name}
    assert plain == {name.replace("=", ""): n for name, n in named.items()}
    return named


def test_every_kind_of_source_gives_the_same_solid():
    template = pc.read_template(find_template("pyramid_cut"))
    equation = template.bind({"p": "0.3"})
    sources = [
        pcq.point_solid("pyramid_cut", p=0.3),
        pcq.point_solid(find_template("pyramid_cut"), p="3/10"),
        pcq.point_solid(template, p=0.3),
        pcq.point_solid(equation),
        pcq.point_solid(equation.coordinates, {}),
        pcq.point_solid(pc.compile_equation(equation)),
    ]
    assert {type(solid) for solid in sources} == {cq.Solid}
    exact = VOLUME * (1 - 0.3 * 0.25 * 0.75)
    assert [solid.Volume() for solid in sources] == pytest.approx([exact] * 6, rel=1e-12)


def test_the_solid_carries_its_part_and_its_name():
    solid = pcq.point_solid("pyramid")
    assert solid.part.report.evidence == "exact"
    assert solid.part.report.equation.volume == pytest.approx(VOLUME, rel=1e-12)
    assert solid.label == solid.part.equation.title
    assert pickle.loads(pickle.dumps(solid)).Volume() == pytest.approx(VOLUME, rel=1e-12)


def test_one_solid_per_stack_point_in_the_workplane():
    apart = cq.Workplane("XZ", origin=(1, 2, 3)).rarray(20, 20, 2, 2)
    apart = apart.pointSolid("pyramid", combine=False)
    assert apart.size() == 4
    assert all(solid.Volume() == pytest.approx(VOLUME, rel=1e-12) for solid in apart.vals())
    box = apart.combine().val().BoundingBox()
    low = (1 - 10 - 2, 2 - 6, 3 - 10 - 1)  # the pyramid spans x -2..4, y -1..5, z 0..6
    assert (box.xmin, box.ymin, box.zmin) == pytest.approx(low, abs=1e-3)
    assert tags(apart) == dict.fromkeys(SIDES, 4)


def test_combine_fuses_cuts_or_keeps_apart():
    base = cq.Workplane().box(10, 10, 10, centered=False)
    start = base.faces(">Z").workplane(centerOption="CenterOfBoundBox")
    fused = start.pointSolid(cube(3))
    cut = start.transformed(offset=(0, 0, -3)).pointSolid(cube(3), combine="cut")
    apart = start.pointSolid(cube(3), combine=False)
    assert fused.val().Volume() == pytest.approx(1027, rel=1e-12)
    assert cut.val().Volume() == pytest.approx(973, rel=1e-12)
    assert apart.val().Volume() == pytest.approx(27, rel=1e-12)
    assert all(found.val().isValid() for found in (fused, cut, apart))


def test_tags_follow_the_sides_through_booleans_and_cleaning():
    base = cq.Workplane().box(10, 10, 10, centered=False)
    start = base.faces(">Z").workplane(origin=(10, 5, 10))
    # half of the cube lies on the box, half beside it: w=0 is left in part
    fused = start.transformed(offset=(-1.5, 0, 0)).pointSolid(cube(3))
    assert set(tags(fused)) == {"u=0", "u=1", "v=0", "v=1", "w=0", "w=1"}
    assert fused.faces(tag="w=1").val().Area() == pytest.approx(9, rel=1e-12)
    assert fused.faces(tag="w=0").val().Area() == pytest.approx(4.5, rel=1e-12)
    sunk = start.transformed(offset=(-5, 0, -3)).pointSolid(cube(3), combine="cut")
    assert set(tags(sunk)) == {"u=0", "u=1", "v=0", "v=1", "w=0"}  # w=1 is cut away
    assert sunk.faces(tag="w=0").val().Center().z == pytest.approx(7, rel=1e-12)


def test_tagged_faces_are_faces_of_the_result():
    made = cq.Workplane().pointSolid(cube(3), prefix="block ")
    assert set(tags(made)) == {f"block {d}={n}" for d in "uvw" for n in (0, 1)}
    faces = set(made.faces().vals())
    assert all(made.faces(tag=tag).val() in faces for tag in tags(made))
    rounded = made.faces(tag="block w=1").edges().fillet(0.5)
    assert rounded.val().isValid()
    # the four edges and, at the corners, an eighth of a ball less its cube
    assert 27 - 4 * 3 * 0.25 < rounded.val().Volume() < 27 - 4 * 2 * 0.25 * (1 - math.pi / 4)


def test_a_side_in_pieces_has_a_tag_of_its_own():
    v = pc.parameters()[1]
    bend = pc.polyline([(0, 0, 0), (30, 0, 0), (30, 20, 0)], 6)
    duct = cq.Workplane().pointSolid(pc.channel(bend, pc.ellipse(3, 3, v), wall=0.5))
    names = ("w=0", "w=1", "w0", "w1", "w=1 (piece 2 of u)", "u=0")
    assert [duct.faces(tag=name).size() for name in names] == [3, 3, 3, 3, 1, 1]
    outside = duct.faces(tag="w=1")
    assert sum(face.Area() for face in outside.vals()) == pytest.approx(
        2 * math.pi * 3.25 * (24 + 14 + 3 * math.pi), rel=1e-12
    )
    roofs = parse_template("""
title = "A roof over a box"
result = "union(roof, box)"
[[bodies]]
name = "roof"
[bodies.solid]
M = "[u, v, 1 + w*(1 - abs(u - 1/2))]"
[[bodies]]
name = "box"
[bodies.solid]
M = "[u, v, w]"
""", "roofs")  # fmt: skip
    made = cq.Workplane().pointSolid(roofs.bind())
    assert made.faces(tag="roof:w=1").size() == 2
    assert made.faces(tag="roof:w=1 (piece 2 of u)").size() == 1


def test_the_chain_keeps_the_parts_in_order():
    chain = cq.Workplane().pointSolid("pyramid").pointSolid(cube(1), combine=False)
    assert [part.equation.name for part in chain.pointParts()] == ["pyramid", "part"]
    assert chain.val().part is chain.pointParts()[1]
    assert cq.Workplane().pointParts() == ()


def test_channels_by_section_with_parameters():
    duct = cq.Workplane().channelSolid("ellipse", delta=0.3)
    (part,) = duct.pointParts()
    assert part.equation.name == "channel_ellipse"
    assert duct.val().isValid()
    assert duct.val().Volume() == pytest.approx(part.report.equation.volume, rel=1e-5)
    assert tags(duct) == dict.fromkeys(("u=0", "u=1", "w=0", "w=1"), 1)
    other = cq.Workplane().channelSolid("torus_tube", combine=False)
    assert other.val().Volume() == pytest.approx(2 * math.pi**2 * 5 * (2**2 - 1), rel=1e-9)
    assert other.val().part.equation.name == "torus_tube"


@pytest.mark.parametrize(
    ("section", "volume"),
    [
        ("ellipse", 77.074041557967),
        pytest.param("sine", 75.845394697557, marks=pytest.mark.slow),
        pytest.param("contour", 72.7442151959, marks=pytest.mark.slow),
    ],
)
def test_a_channel_solid_is_the_shipped_channel(section, volume):
    solid = pcq.channel_solid(section)
    assert type(solid) is cq.Solid
    assert solid.part.equation.name == f"channel_{section}"
    assert solid.isValid()
    assert solid.Volume() == pytest.approx(volume, rel=1e-3)  # CadQuery's plain rule
    assert solid.part.report.solid.volume == pytest.approx(volume, rel=1e-7)


def test_a_channel_solid_takes_parameters_a_tolerance_and_other_channels():
    wide = pcq.channel_solid("ellipse", delta=0.8, tolerance=1e-3)
    assert wide.part.report.tolerance == 1e-3
    # the wall is centred, so that its volume goes with its thickness
    assert wide.Volume() == pytest.approx(2 * 77.074041557967, rel=1e-4)
    assert pcq.channel_solid(cube(2)).Volume() == pytest.approx(8, rel=1e-12)


def test_a_part_becomes_a_solid_of_cadquery():
    part = pc.compile_part(cube(2))
    solid = part.to_cadquery()
    assert type(solid) is cq.Solid
    assert solid.wrapped.IsSame(part.shape)
    assert solid.Volume() == pytest.approx(8, rel=1e-12)
    assert len(solid.Faces()) == 6
    beside = solid.cut(cq.Solid.makeBox(1, 1, 2))
    assert beside.Volume() == pytest.approx(6, rel=1e-12)


def test_invoke_eachpoint_and_assembly():
    placed = cq.Workplane().rarray(20, 1, 2, 1).invoke(pcq.placed("pyramid", combine=False))
    each = cq.Workplane().rarray(20, 1, 2, 1).eachpoint(pcq.point_solid("pyramid"), True)
    assert [v.Center().x for v in placed.vals()] == pytest.approx(
        [v.Center().x for v in each.vals()], rel=1e-12
    )
    assembly = cq.Assembly().add(pcq.point_solid("pyramid"), name="tip", loc=cq.Location(0, 0, 9))
    assert assembly.toCompound().Volume() == pytest.approx(VOLUME, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("no such template", {}), "no shipped template"),
        (("pyramid", {"p": 0.1}), "no parameter 'p'"),
        (("pyramid_cut", {"p": 2}), "outside its range"),
        ((cube(1), {"p": 1}), "only a template has parameters"),
    ],
)
def test_wrong_input_is_named(arguments, message):
    source, parameters = arguments
    with pytest.raises(InputError, match=message):
        pcq.point_solid(source, **parameters)
    with pytest.raises(InputError, match="domain belongs"):
        pcq.point_solid("pyramid", {"u": (0, 1)})


def test_registering_again_does_no_harm_and_takes_nothing_away(monkeypatch):
    again = importlib.reload(pcq)
    assert cq.Workplane.pointSolid is again.pointSolid
    monkeypatch.setattr(cq.Workplane, "pointSolid", lambda self: self)
    with pytest.raises(again.PluginClashError, match="pointSolid already"):
        again.register()


RENDERS = """
import sys
import cadquery as cq
before = set(sys.modules)
for turn in range(3):
    import pc2cad.cadquery
    ring = cq.Workplane().pointSolid("torus")
    assert ring.faces(tag="w=1").size() == 1 and ring.val().isValid()
    for name in set(sys.modules) - before:
        del sys.modules[name]
print(ring.faces(tag="w=1").val().Area())
"""


@pytest.mark.slow
def test_renders_in_one_process_that_unloads_the_modules_as_cq_editor_does():
    done = subprocess.run(
        [sys.executable, "-c", RENDERS], capture_output=True, text=True, timeout=120, check=True
    )
    assert float(done.stdout) == pytest.approx(4 * math.pi**2 * 5 * 2, rel=1e-6)


def test_several_bodies(tmp_path):
    (tmp_path / "t.toml").write_text(CUBES.format(result="cut(big, small)"))
    placed = cq.Workplane().pointSolid(str(tmp_path / "t.toml"), d=1.5)
    assert placed.val().Volume() == pytest.approx(7.5)
    assert placed.faces(tag="small:u=0").size() == 1
    assert placed.pointParts()[0].report.steps
    assert pcq.point_solid("common_of_pipes", R=1).Volume() == pytest.approx(16 / 3, rel=1e-6)


def test_constraints_of_assemblies_find_sides_by_their_plain_tags():
    wedge = cq.Workplane().pointSolid("pyramid_cut", prefix="p_")
    block = cq.Workplane().box(9, 9, 1).faces(">Z").tag("top").end()
    assembly = cq.Assembly().add(block, name="block").add(wedge, name="wedge")
    side = next(name for name in sorted(wedge.ctx.tags) if "=" in name)
    with pytest.raises(Exception, match=r"Expected|expected"):
        assembly.constrain(f"wedge?{side}", "block?top", "Plane")
    assembly.constrain(f"wedge?{side.replace('=', '')}", "block?top", "Plane")
    assert len(assembly.constraints) == 1


def test_a_solid_in_cadquery_has_triangles_for_viewers_and_its_part_a_box_of_its_own():
    part = pc.compile_equation(pc.read_template("ellipsoid").bind({}))
    solid = pcq.point_solid(part)
    # the kernel's mesher, which keeps what is fine enough, has nothing to do
    corners, triangles = solid.tessellate(1e-3, 0.2)
    assert len(triangles) > 50_000
    assert len(corners) < len(triangles)
    assert part.bounding_box[1][0] == pytest.approx(3, abs=3e-7)
    assert abs(solid.BoundingBox().xmax - 3) < 1e-3
