"""Receipts: files of anybody's that are sound, and files with one thing wrong."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import cadquery as cq
import pytest
from consumers.samples import AP214, SplineSolid, as_nurbs, write_step
from consumers.step_edits import read_instances
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
from OCP.gp import gp_Ax2, gp_Dir, gp_Parab, gp_Pnt
from plain_step import box
from shipped import part_of

import pc2cad as pc
from pc2cad.brep.integrals import solid_integrals
from pc2cad.cli.main import main
from pc2cad.verify.receipt import describe, parse_step, receipt


def swap(text: str, one: str, other: str) -> str:
    return text.replace(one, "\0").replace(other, one).replace("\0", other)


def turned(text: str) -> str:
    """Turn the faces and their loops over: consistent, and inside out."""
    flags = {"T": "F", "F": "T"}
    pattern = r"((?:ADVANCED_FACE|FACE_OUTER_BOUND)\([^;]*\.)([TF])(\.\);)"
    return re.sub(pattern, lambda m: m[1] + flags[m[2]] + m[3], text)


#: what is done to the text of a box, and a word of the sentence that tells of it
BOXES: dict[str, tuple[Callable[[str], str], str]] = {
    "face dropped": (lambda t: re.sub(r"(CLOSED_SHELL\('',\([^)]*),#\d+\)", r"\1)", t), "is open"),
    "face doubled": (
        lambda t: re.sub(r"CLOSED_SHELL\('',\((#\d+)", r"CLOSED_SHELL('',(\1,\1", t), "twice",
    ),
    "no faces": (lambda t: re.sub(r"CLOSED_SHELL\('',\([^)]*\)", "CLOSED_SHELL('',()", t),
                 "no face"),
    "no solid": (lambda t: re.sub(r"MANIFOLD_SOLID_BREP", "SHELL_OF_SORTS", t), "no solid"),
    "inside out": (turned, "inside out"),
    "face turned": (
        lambda t: re.sub(r"(ADVANCED_FACE\([^;]*)\.T\.", r"\1.F.", t, count=1), "turned over",
    ),
    "loop turned": (
        lambda t: re.sub(r"(FACE_OUTER_BOUND\([^;]*)\.T\.", r"\1.F.", t, count=1), "turned over",
    ),
    "edge turned": (lambda t: t.replace(",.F.);", ",.T.);", 1), "not closed"),
    "curve turned": (
        lambda t: re.sub(r"(EDGE_CURVE\([^;]*),\.T\.", r"\1,.F.", t, count=1), "does not run",
    ),
    "corner moved": (lambda t: t.replace("(1.0,2.0,3.0)", "(1.0,2.0,3.00001)", 1), ""),
    "corners swapped": (lambda t: swap(t, "(1.0,2.0,3.0)", "(0.0,2.0,3.0)"), ""),
    "volume false": (lambda t: t.replace("VOLUME_MEASURE(6.0)", "VOLUME_MEASURE(6.00002)"),
                     "states"),
    "unit of the volume": (lambda t: t.replace(",3.);", ",2.);"), "states"),
    "no unit": (lambda t: t.replace("LENGTH_UNIT()", "MASS_UNIT()"), "unit of length"),
    "unknown unit": (lambda t: t.replace("SI_UNIT(.MILLI.,.METRE.)", "OWN_UNIT()"), "unit"),
    "unknown prefix": (lambda t: t.replace(".MILLI.", ".WILLI."), "prefix"),
    "unit of itself": (
        lambda t: re.sub(
            r"#(\d+)=\(LENGTH_UNIT\(\)NAMED_UNIT\(\*\)SI_UNIT\(.MILLI.,.METRE.\)\)",
            r"#\1=(LENGTH_UNIT()NAMED_UNIT(*)CONVERSION_BASED_UNIT('x',#9999))", t,
        ).replace("ENDSEC;\nEND", "#9999=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(2.),#"
                  + re.search(r"#(\d+)=\(LENGTH", t)[1] + ");\nENDSEC;\nEND"),
        "of itself",
    ),
    "plane unknown": (lambda t: t.replace("=PLANE(", "=PLAIN(", 1), "not known"),
    "line unknown": (lambda t: t.replace("=LINE(", "=LIME(", 1), "not known"),
    "curve of itself": (
        lambda t: re.sub(r"#(\d+)=LINE\(.*?\)", r"#\1=TRIMMED_CURVE('',#\1,(),(),.T.,.CARTESIAN.)",
                         t, count=1),
        "in itself",
    ),
    "direction of no length": (lambda t: t.replace("(0.0,0.0,-1.0)", "(0.0,0.0,0.0)"), "no length"),
    "axes parallel": (lambda t: t.replace("(0.0,-1.0,0.0)", "(0.0,0.0,-1.0)", 1), "parallel"),
    "point for a vertex": (lambda t: t.replace("VERTEX_POINT('',#1)", "POINT_OF_SORTS('',#1)"), ""),
    "two coordinates": (lambda t: t.replace("(1.0,2.0,3.0)", "(1.0,2.0)", 1), "three coordinates"),
    "text for a number": (lambda t: t.replace("(1.0,2.0,3.0)", "(1.0,2.0,'3')", 1), "number"),
    "flag of sorts": (lambda t: t.replace(",.T.);", ",.U.);", 1), ".T. or .F."),
    "parameters missing": (lambda t: re.sub(r"(EDGE_CURVE\('',#\d+,#\d+).*?\)", r"\1)", t, count=1),
                           "parameters"),
    "no context": (lambda t: t.replace("ADVANCED_BREP_SHAPE_REPRESENTATION", "DRAWING"), "holds"),
    "plane moved": (lambda t: re.sub(
        r"AXIS2_PLACEMENT_3D\('',#1,", "AXIS2_PLACEMENT_3D('',#8,", t, count=1),
        "leaves the plane"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BOXES)
def test_a_box_with_one_thing_wrong_is_not_sound(kind: str) -> None:
    change, words = BOXES[kind]
    text = box(volume=6.0)
    changed = change(text)
    assert changed != text
    found = describe(parse_step(changed.encode()))
    assert found["sound"] is not True
    told = found["defects"] + found["unknown"]
    assert any(words in sentence for sentence in told), told
    json.dumps(found, allow_nan=False)


def lost_by_revolving() -> cq.Workplane:
    return cq.Workplane().spline([(100, 10), (80, 50), (100, 100)]).offset2D(2).revolve()


def lost_by_extruding() -> cq.Workplane:
    return cq.Workplane().ellipse(50, 100).offset2D(50).extrude(10)


@pytest.mark.parametrize("make", [lost_by_revolving, lost_by_extruding])
def test_valid_solids_that_lose_faces_in_their_files_are_told(
    make: Callable[[], cq.Workplane], tmp_path: Path
) -> None:
    solid = make().val()
    assert solid.isValid()
    found = receipt(write_step(solid, tmp_path / "lost.step"))
    assert found["sound"] is False, found


def plate() -> cq.Workplane:
    return cq.Workplane().box(20, 30, 5)


def dish() -> cq.Solid:
    """Three wide, its floor the paraboloid y = x²/8: a parabola turned about its own axis."""
    drawn = gp_Parab(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, 0, -1), gp_Dir(0, 1, 0)), 2.0)
    floor = cq.Edge(BRepBuilderAPI_MakeEdge(drawn, gp_Pnt(0, 0, 0), gp_Pnt(3, 9 / 8, 0)).Edge())
    corners = [cq.Vector(3, 9 / 8, 0), cq.Vector(0, 9 / 8, 0), cq.Vector(0, 0, 0)]
    sides = [cq.Edge.makeLine(*ends) for ends in pairwise(corners)]
    face = cq.Face.makeFromWires(cq.Wire.assembleEdges([floor, *sides]))
    return cq.Solid.revolve(face, 360, cq.Vector(0, 0, 0), cq.Vector(0, 1, 0))


#: solids of CadQuery with all kinds of surfaces and trimmed faces
FOREIGN: dict[str, Callable[[], cq.Workplane | cq.Shape]] = {
    "plate": lambda: plate().faces(">Z").workplane().rect(14, 24, forConstruction=True)
    .vertices().hole(3),
    "rounded": lambda: plate().edges("|Z").fillet(2).faces(">Z").edges().chamfer(0.5),
    "filleted": lambda: plate().edges().fillet(1),
    "cross": lambda: cq.Workplane().circle(4).extrude(20, both=True)
    .union(cq.Workplane("YZ").circle(3).extrude(20, both=True)),
    "cone": lambda: cq.Solid.makeCone(5, 2, 7),
    "pointed": lambda: cq.Solid.makeCone(5, 0, 7),
    "ball cut": lambda: cq.Workplane().sphere(5).cut(cq.Workplane().box(4, 4, 20)),
    "half ball": lambda: cq.Workplane().sphere(5)
    .cut(cq.Workplane().box(20, 20, 20).translate((0, 0, 10))),
    "loft": lambda: cq.Workplane().rect(4, 4).workplane(offset=6).circle(2).loft(),
    "sweep": lambda: cq.Workplane().circle(1)
    .sweep(cq.Workplane("XZ").spline([(0, 0), (2, 5), (0, 10)])),
    "hollow box": lambda: cq.Workplane().box(8, 8, 8).shell(-1),
    "tapered": lambda: cq.Workplane().ellipse(4, 2).extrude(5, taper=3),
    "two": lambda: cq.Compound.makeCompound(
        [cq.Solid.makeBox(1, 1, 1), cq.Solid.makeBox(1, 1, 1, cq.Vector(3, 0, 0))]),
    "hollow": lambda: cq.Workplane().sphere(5).cut(cq.Workplane().sphere(3)),
    "nurbs": lambda: as_nurbs(cq.Solid.makeCylinder(5, 12)),
    "spline": lambda: SplineSolid().solid(),
    "half ring": lambda: cq.Workplane().rect(2, 3).revolve(180, (5, 0, 0), (5, 1, 0)),
    "spun spline": lambda: cq.Workplane().moveTo(2, 0).spline([(4, 2), (3, 5)], includeCurrent=True)
    .lineTo(0, 5).lineTo(0, 0).close().revolve(),
    "dish": dish,
    "text": lambda: cq.Workplane().text("Ab8", 10, 3),
    "screw": lambda: cq.Workplane().polygon(6, 10).twistExtrude(8, 60),
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if n == "text" else ()) for n in FOREIGN]
)
def test_sound_solids_of_cadquery_raise_no_alarm(name: str, tmp_path: Path) -> None:
    made = FOREIGN[name]()
    shape = made if isinstance(made, cq.Shape) else made.val()
    found = receipt(write_step(shape, tmp_path / "part.step", schema=AP214))
    assert not found["defects"], found["defects"]
    assert found["sound"] is True, found["unknown"]
    volume = sum(solid["volume"] for solid in found["solids"])
    assert volume == pytest.approx(shape.Volume(1e-9), rel=1e-6)


def moved_in_parameters(text: str, ref: str) -> str:
    """Move the first point of two coordinates that an instance leads to by a thousandth each."""
    while True:
        (own,) = re.findall(rf"(?<![0-9#]){ref} = ([^;]*);", text)
        found = re.fullmatch(r"CARTESIAN_POINT\('',\(([-+0-9.E]+),([-+0-9.E]+)\)\)", own)
        if found:
            u, v = (float(x) + 1e-3 for x in found.groups())
            return text.replace(f"{ref} = {own};", f"{ref} = CARTESIAN_POINT('',({u},{v}));")
        ref = re.findall(r"#\d+", own)[0]


@pytest.mark.parametrize(
    "name", ["pointed", "half ring", "spun spline", pytest.param("cross", marks=pytest.mark.slow)]
)
def test_curves_in_parameters_lie_on_their_edges(name: str, tmp_path: Path) -> None:
    made = FOREIGN[name]()
    path = write_step(made if isinstance(made, cq.Shape) else made.val(), tmp_path / "part.step")
    text = read_instances(path)
    curves = re.findall(r"DEFINITIONAL_REPRESENTATION\('',\((#\d+)\)", text)
    assert len(curves) > 3
    for ref in curves[:: len(curves) // 3]:
        found = describe(parse_step(moved_in_parameters(text, ref).encode()))
        assert any("in the parameters of the face" in line for line in found["defects"]), ref


def test_the_verb_tells_and_returns_what_was_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad, garbled = (tmp_path / name for name in ("good.step", "bad.step", "garbled.step"))
    good.write_text(box())
    bad.write_text(BOXES["face dropped"][0](box()))
    garbled.write_text(box()[:-100])
    assert main(["verify", str(good)]) == 0
    assert "good.step: sound" in capsys.readouterr().out
    assert main(["verify", str(bad)]) == 6
    assert "is open" in capsys.readouterr().out
    assert main(["verify", str(bad), "--json"]) == 6
    assert json.loads(capsys.readouterr().out)["sound"] is False
    assert main(["verify", str(garbled)]) == 2
    assert "garbled.step" in capsys.readouterr().err


def test_a_file_of_a_loose_tolerance_states_the_solid_that_it_holds(tmp_path: Path) -> None:
    A, X, Y, Z = pc.points(A=(0, 0, 0), X=(1, 0, 0), Y=(0, 1, 0), Z=(0, 0, 1))
    u, v, w = pc.parameters()
    height = 2 + pc.sin(5 * u) * pc.cos(2 * v)
    part = pc.compile_part(A + (X - A) * u + (Y - A) * v + (Z - A) * w * height, tolerance=0.02)
    part.write(tmp_path / "loose.step")
    found = receipt(tmp_path / "loose.step")
    assert found["sound"], found["defects"]
    own, equation = found["solids"][0]["volume"], part.report.equation.volume
    assert abs(own - equation) > 1e-5 * equation
    assert found["stated"]["volume"] == pytest.approx(own, rel=1e-11)
    text = read_instances(tmp_path / "loose.step")
    false = re.sub(r"VOLUME_MEASURE\([^)]*\)", f"VOLUME_MEASURE({own * 1.000003!r})", text)
    assert false != text
    assert "states the volume" in describe(parse_step(false.encode()))["defects"][0]


def test_a_closed_surface_with_a_hole_keeps_its_area_wherever_its_seams_are_followed(
    tmp_path: Path,
) -> None:
    """Along seams that are followed to the other side the edges run round the whole torus."""
    torus = cq.Workplane(cq.Shape.cast(part_of("simplex_torus").body.shape))
    place = (-2.2982, -0.8822, 2.3514)
    file = str(tmp_path / "torus.step")
    torus.cut(cq.Workplane().sphere(1.6).translate(place)).val().exportStep(file)
    found = receipt(file)
    assert found["sound"] is True
    (of_file,) = found["solids"]
    again = cq.importers.importStep(file).val()
    assert of_file["volume"] == pytest.approx(solid_integrals(again.wrapped).volume, rel=1e-9)
