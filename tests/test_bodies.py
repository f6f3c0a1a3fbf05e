"""Templates of several bodies: Booleans against closed forms, names of faces, every bad use."""

from __future__ import annotations

import json
import re
from math import pi
from operator import attrgetter

import numpy as np
import pytest
from shipped import CUBES, part_of

import pc2cad as pc
from pc2cad.brep import booleans
from pc2cad.cli.main import main
from pc2cad.csg.bodies import (
    EmptyResultError,
    KernelTooLooseError,
    SeveralPiecesError,
    VolumesDisagreeError,
)
from pc2cad.errors import InputError, KernelError, NotASolidError, ToleranceNotReachedError
from pc2cad.export.colours import body_colour
from pc2cad.part import Part
from pc2cad.report import SeveralBodiesError
from pc2cad.studies.variant import BUILT, Job, Task, run_variant
from pc2cad.templates.file import parse_template
from pc2cad.templates.header import TemplateError
from pc2cad.templates.shipped import bodies_paths
from pc2cad.validation import ExpectationNotMetError


def cubes(result: str, d: float, more: str = "") -> Part:
    template = parse_template(CUBES.format(result=result) + more, "cubes")
    return pc.compile_equation(template.bind({"d": d}))


@pytest.mark.parametrize(
    ("kind", "d", "volume", "words"),
    [
        ("union", 1.5, 8.5, "0.5 in common"),
        ("union", 0.5, 8, "one lies inside the other"),
        ("cut", 1.5, 7.5, "0.5 of 1 inside"),
        ("cut", 0.5, 7, "wholly inside, the volumes subtract"),
        ("cut", 5, 8, "nothing is cut"),
        ("intersect", 1.5, 0.5, "in common of 8 and 1"),
        ("union", 2, 9, "the volumes add up"),
    ],
)
def test_volumes_that_add_up_are_told_from_those_that_do_not(kind, d, volume, words):
    report = cubes(f"{kind}(big, small)", d).report
    (step,) = report.steps
    assert report.solid.volume == pytest.approx(volume, rel=1e-14)
    assert words in step.sentence
    assert abs(step.gap) < 1e-14
    assert (step.first, step.second) == pytest.approx((8, 1))
    assert bool(report.warnings) == ("nothing is cut" in words)


def test_faces_are_named_by_body_and_side_and_keep_their_evidence():
    part = cubes("cut(big, small)", 1.5)
    names = [face.name for face in part.report.faces]
    assert sorted(names) == sorted(
        [f"big:{s}" for s in ("u=0", "u=1", "v=0", "v=1", "w=0", "w=1")]
        + [f"small:{s}" for s in ("u=0", "v=0", "v=1", "w=0", "w=1")]
    )
    areas = {face.name: face.area for face in part.report.faces}
    assert areas["big:u=1"] == pytest.approx(3)  # 4 less the mouth of the hole
    assert areas["small:v=0"] == pytest.approx(0.5)
    assert {face.evidence for face in part.report.faces} == {"exact"}
    # where bodies meet, the kernel has found lines that lie on both planes
    assert {edge.name for edge in part.report.curves} == {
        f"big:u=1 / small:{s}" for s in ("v=0", "v=1", "w=0", "w=1")
    }
    assert part.report.evidence == "exact"


def test_the_colour_of_a_face_is_that_of_its_body_and_not_read_from_its_name():
    part = cubes("cut(big, small)", 1.5)
    colours = {face.name: face.colour for face in part.exportable(colours=True).faces}
    assert len(colours) == 11
    assert {c for name, c in colours.items() if name.startswith("big")} == {body_colour(0)}
    assert {c for name, c in colours.items() if name.startswith("small")} == {body_colour(1)}
    assert {face.colour for face in part.exportable().faces} == {None}


def test_faces_that_coincide_have_both_names():
    part = cubes("intersect(big, small)", 1)
    assert "big:u=1 = small:u=1" in [face.name for face in part.report.faces]


def gear_volume() -> float:
    """Return the shipped gear's volume by polygons of many corners along fillet and flank."""
    m, z, alpha, r = 2.0, 20, np.radians(20), 20.0
    tip, base = 0.38 * m, r * np.cos(alpha)
    deep = 1.25 * m - tip
    # the middle of the rack's tip, and the place of its circle farthest from the pitch point
    middle = np.linspace(0, deep / np.tan(alpha), 200_001) - 1j * deep
    roll = (middle.real - pi * m / 4 + deep * np.tan(alpha) + tip / np.cos(alpha)) / r
    fillet = (1j * r + middle * (1 + tip / abs(middle))) * np.exp(1j * roll)
    # the involute, from the pitch line's quarter of a pitch
    foot, head = (np.sqrt((far / base) ** 2 - 1) for far in (abs(fillet[-1]), 22))
    t = np.linspace(foot, head, 200_001)
    turn = pi / 2 / z - np.tan(alpha) + alpha + t
    flank = base * (1 + 1j * t) * 1j * np.exp(-1j * turn)
    assert abs(flank[0] - fillet[-1]) < 1e-9
    sectors = sum((np.conj(line[1:]) * line[:-1]).imag.sum() / 2 for line in (fillet, flank))
    angles = np.angle(1j / fillet[0]), np.angle(1j / flank[-1])
    whole = sectors + angles[0] * 17.5**2 / 2 + (pi / z - angles[1]) * 22**2 / 2
    x = np.linspace(-2.5, 2.5, 200_001)
    key = np.trapezoid(8 + 2.3 - np.sqrt(64 - x**2), x)
    return float(15 * (2 * z * whole - 64 * pi - key))


def bolt_volume() -> float:
    """Return the shipped bolt's volume: head by angles, shank, and thread by its section."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    # the bevel of 30 degrees begins at 0.95 of half the width across flats, which is 8
    far, c = 8 / np.cos(pi / 6 * nodes), 0.95 * 8
    lost = ((far**3 - c**3) / 3 - c * (far**2 - c**2) / 2) / np.sqrt(3)
    head = pi * weights @ (6.4 * far**2 / 2 - lost)
    outer = (10 - 0.032) / 2
    root = outer - 5 / 16 * np.sqrt(3) * 1.5
    q = 1 / 16 + 5 / 16 * (nodes + 1) / 2
    flanks = 2 * pi * 5 / 32 * weights @ (outer - np.sqrt(3) * 1.5 * (q - 1 / 16)) ** 2
    section = pi * outer**2 / 8 + pi * root**2 / 4 + flanks
    return float(head + pi * 25 * 8 + section * 12)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name == "bolt" else [])
        for name in bodies_paths()
    ],
)
def test_shipped_templates_meet_their_closed_forms(name, tmp_path):
    # at the default tolerance the wavy duct's volume is within 2e-9 of the whole
    if name == "cooled_block":
        part = pc.compile_part(pc.read_template(bodies_paths()[name]).bind(), tolerance=4e-7)
    else:
        part = part_of(name)
    report = part.report
    exact = {
        "pipe_cross": 2 * pi * (4 - 2.25) * 10 - 16 / 3 * (8 - 1.5**3),
        "cooled_block": 192 - 8 * pi * 0.64,
        "common_of_pipes": 128 / 3,
        "gear": gear_volume(),
        "bolt": bolt_volume(),
    }[name]
    assert report.solid.volume == pytest.approx(exact, rel=1e-9)
    assert abs(report.solid.volume - exact) <= report.solid.relative_error * exact
    assert all(abs(step.gap) <= 1e-8 * step.first for step in report.steps)
    assert report.curves
    assert max(curve.surface_distance for curve in report.curves) < 1e-8
    json.dumps(report.to_dict(), allow_nan=False)
    part.write(tmp_path / "part.step", colours=True)
    text = (tmp_path / "part.step").read_text()
    assert all(f"'{face.name}'" in text for face in report.faces)


ONE_EQUATION = (
    "equation", "checked", "model", "built", "faces", "layers", "face_areas", "report.equation",
    "report.sides", "report.genus", "report.frame", "report.limits", "report.determinant",
    "report.images", "report.contact_clearance", "report.layers",
)  # fmt: skip


def test_what_belongs_to_one_equation_is_asked_of_one_body():
    part = cubes("cut(big, small)", 1.5)
    alone = part.bodies["big"]
    assert len(ONE_EQUATION) == 16
    for name in ONE_EQUATION:
        with pytest.raises(SeveralBodiesError, match=r"several bodies \(big, small\)"):
            attrgetter(name)(part)
    calls = (part.splines, part.sample, lambda: part.locate([[0.5, 0.5, 0.5]]))
    for call in calls:
        with pytest.raises(SeveralBodiesError, match="belongs to one equation"):
            call()
    assert alone.report is part.report.bodies["big"]
    assert alone.report.equation.volume == pytest.approx(8)
    assert set(alone.faces) == {"u=0", "u=1", "v=0", "v=1", "w=0", "w=1"}
    assert len(alone.mesh(cells=(2, 2, 2)).points) == 27
    assert alone.locate([[0.5, 0.5, 0.5]]).inside.tolist() == [True]


def test_one_equation_is_a_tree_of_one_body():
    u, v, w = pc.parameters()
    part = pc.compile_part((u, v, w))
    assert list(part.bodies) == ["part"]
    assert part.body is part.bodies["part"]
    assert part.body.report is part.report
    assert part.report.shells == len(part.report.genus) == 1
    assert (part.report.bodies, part.report.steps, part.edges) == ({}, (), ())


def test_three_pairs_in_one_expression():
    text = CUBES.format(result="cut(union(big, small), post, small)").replace("[[b", """[[bodies]]
name = "post"
let = { top = "3*w" }
solid = { x = "u/2 + 1/4", y = "v/2 + 1/4", z = "top - 1/2" }
[[b""", 1)  # fmt: skip
    report = pc.compile_equation(parse_template(text, "cubes").bind({"d": 1.5})).report
    assert [step.name for step in report.steps] == [
        "union(big, small)", "cut(step 1, post)", "cut(step 2, small)",
    ]  # fmt: skip
    assert report.solid.volume == pytest.approx(8.5 - 0.5 - 1, rel=1e-14)
    assert report.euler == 0


@pytest.mark.parametrize(
    ("result", "d", "error", "words"),
    [
        ("intersect(big, small)", 5, EmptyResultError, "they have no common part"),
        ("cut(small, big)", 0.5, EmptyResultError, "lies wholly inside"),
        ("union(big, small)", 5, SeveralPiecesError, "falls into 2 pieces of the volumes"),
    ],
)
def test_results_that_are_not_one_solid_are_refused(result, d, error, words):
    with pytest.raises(error, match=words) as caught:
        cubes(result, d)
    assert isinstance(caught.value, NotASolidError)


def test_a_result_that_touches_itself_along_an_edge_is_refused():
    text = """
title = "Two notches that meet in an edge"
result = "cut(block, one, other)"
bodies = [
  { name = "block", solid = { x = "2*u", y = "2*v", z = "2*w" } },
  { name = "one", solid = { x = "u", y = "v", z = "w" } },
  { name = "other", solid = { x = "u + 1", y = "v + 1", z = "w" } },
]"""
    with pytest.raises(
        NotASolidError, match=r"touch without crossing: .* along a curve at \(1, 1, 0.5\)"
    ):
        pc.compile_equation(parse_template(text, "notches").bind())


def test_a_body_that_is_no_solid_is_named():
    text = CUBES.format(result="union(big, small)").replace('"u + d"', '"0*u + d"')
    with pytest.raises(NotASolidError, match=r"^body small: "):
        pc.compile_equation(parse_template(text, "cubes").bind())


def test_figures_of_the_result_are_held():
    expected = "\n[expect]\nvolume = 8.5\nfaces = 11\nshells = 1\neuler = 2\n"
    cubes("union(big, small)", 1.5, expected)
    with pytest.raises(ExpectationNotMetError, match=r"volume = 8.5, but it is 8.25"):
        cubes("union(big, small)", 1.25, expected)


def test_a_kernel_that_loses_volume_is_found_out(monkeypatch):
    right = booleans.combine

    def wrong(kinds, *given):
        return right(["cut" if kind == "union" else kind for kind in kinds], *given)

    monkeypatch.setattr("pc2cad.csg.bodies.combine", wrong)
    with pytest.raises(VolumesDisagreeError, match="does not add up"):
        cubes("union(big, small)", 1.5)


def test_tolerances_of_a_hundredth_of_the_part_are_refused_in_the_end(monkeypatch):
    right = booleans.combine

    def loose(*given):
        results = right(*given)
        for edge in booleans.edges_between(results[0]):
            edge.loosen(0.05)
        return results

    monkeypatch.setattr("pc2cad.csg.bodies.combine", loose)
    words = (
        r"joined the bodies within 0.05 mm only, of a part of 3.\d+: it has lost where they meet"
    )
    with pytest.raises(KernelTooLooseError, match=words):
        cubes("union(big, small)", 1.5)


BEND_AND_PIPE = """
title = "A bend that widens, and a pipe on its end"
result = "union(bend, pipe)"
[[bodies]]
name = "bend"
[bodies.let]
r = "w*(1 + u/2)"
[bodies.solid]
x = "(3 + r*cos(2*pi*v))*cos(u)"
y = "(3 + r*cos(2*pi*v))*sin(u)"
z = "r*sin(2*pi*v)"
[[bodies]]
name = "pipe"
[bodies.let]
r = "w*(3/2 + u/4)"
[bodies.solid]
x = "(3 + r*cos(2*pi*v))*cos(1) - 4*u*sin(1)"
y = "(3 + r*cos(2*pi*v))*sin(1) + 4*u*cos(1)"
z = "r*sin(2*pi*v)"
"""


@pytest.mark.parametrize("size", [1, pytest.param(1e5, marks=pytest.mark.slow)])
def test_sides_that_coincide_to_within_their_deviations_vanish(size):
    """The bend's end is a circle to within its spline's deviation; the pipe's is one."""
    text = BEND_AND_PIPE.replace("w*(", f"{size}*w*(").replace("(3 +", f"({3 * size} +")
    part = pc.compile_equation(
        parse_template(text.replace("4*u", f"{4 * size}*u"), "pipe").bind(), 1e-5 * size
    )
    exact = pi * (3 * (1 + 1 / 2 + 1 / 12) + 4 * (9 / 4 + 3 / 8 + 1 / 48)) * size**3
    assert part.report.solid.volume == pytest.approx(exact, rel=1e-6)
    names = sorted(face.name for face in part.report.faces)
    assert names == ["bend:u=0", "bend:w=1", "pipe:u=1", "pipe:w=1"]


def test_an_edge_off_its_faces_is_refused(monkeypatch):
    text = """
title = "Two pipes of different width"
result = "cut(run, bore)"
bodies = [
  { name = "run", solid = { x = "6*u - 3", y = "2*w*cos(2*pi*v)", z = "2*w*sin(2*pi*v)" } },
  { name = "bore", solid = { x = "w*cos(2*pi*v)", y = "w*sin(2*pi*v)", z = "6*u - 3" } },
]"""
    bound = parse_template(text, "pipes").bind()
    assert 0 < pc.compile_equation(bound, 1e-9).report.deviation < 1e-9
    # the kernel's own curve is 1.7e-8 off, which is within what it takes for one place
    monkeypatch.setattr("pc2cad.csg.bodies.with_own_edges", lambda shape, target: shape)
    monkeypatch.setattr("pc2cad.csg.bodies.KERNEL_TOLERANCE", 1e-12)
    with pytest.raises(ToleranceNotReachedError, match=r"run:w=1 / bore:w=1 is .* off its"):
        pc.compile_equation(bound, 1e-9)


MISTAKES = {
    "one body": ("[[bodies]]\nname = 'a'\nsolid = {}", "needs two bodies or more"),
    "no body": ("bodies = []", "here are 0"),
    "a table": ("bodies = { name = 'a' }", "each body is a table of its own"),
    "no name": ("[[bodies]]\n[[bodies]]", "body 1: needs a name"),
    "reserved": ("[[bodies]]\nname = 'cut'\n[[bodies]]", "the name cut is reserved"),
    "no word": ("[[bodies]]\nname = 'a b'\n[[bodies]]", "'a b' is not a name"),
    "twice": ("[[bodies]]\nname = 'a'\n[[bodies]]\nname = 'a'", "a is defined twice"),
    "unknown key": ("[[bodies]]\nname = 'a'\nsolids = 1\n[[bodies]]", "did you mean solid"),
    "own points": ("[[bodies]]\nname = 'a'\npoints = {}\n[[bodies]]", "is common to all bodies"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_bodies_that_are_not_as_the_format_asks(name):
    text, words = MISTAKES[name]
    with pytest.raises(TemplateError, match=words):
        parse_template(f"title = 't'\nresult = 'union(a, b)'\n{text}", "t")


@pytest.mark.parametrize(
    ("result", "words"),
    [
        ("", "is missing: how the bodies join"),
        ("big", "takes one body, big"),
        ("big + small", "joined by union"),
        ("add(big, small)", "'add' is none of union, cut, intersect"),
        ("intersects(big, small)", "did you mean intersect"),
        ("union(big)", "union takes two bodies or more"),
        ("union(big, smal)", "no body is called 'smal'; did you mean small"),
        ("union(big, big)", "the body small is not used"),
        ("union(big, small", "expected"),
        ("union(big, 2)", "joined by union"),
    ],
)
def test_results_that_are_not_as_the_format_asks(result, words):
    with pytest.raises(TemplateError, match=words):
        parse_template(CUBES.format(result=result), "t")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[parameters]", "[solid]\nM = '[u,v,w]'\n[parameters]", r"\[solid\]: belongs to a body"),
        ("[parameters]", "[domain]\nu = [0,2]\n[parameters]", r"\[domain\]: belongs to a body"),
        ('"2*w"', '"2*q"', "body big: "),
        ("[parameters]", "[let]\nk = 1\n[parameters]", ""),
        ('name = "big"', 'name = "big"\nlet = 3', "must be a table"),
    ],
)
def test_tables_of_bodies_are_checked(old, new, words):
    text = CUBES.format(result="union(big, small)").replace(old, new, 1)
    if not words:
        text = text.replace('name = "big"', 'name = "big"\nlet = { k = 2 }')
        words = "k: is defined for all bodies"
    with pytest.raises(TemplateError, match=words):
        parse_template(text, "t")


def test_a_result_without_bodies():
    with pytest.raises(TemplateError, match="here are 0"):
        parse_template("title = 't'\nresult = 'union(a, b)'\n[solid]\nM = '[u,v,w]'", "t")


def test_points_move_in_all_bodies():
    text = CUBES.format(result="union(big, small)").replace("[[", "[points]\nO = [0, 0, 0]\n[[", 1)
    text = text.replace('x = "2*u"\ny = "2*v"\nz = "2*w"', 'M = "O + vector(2*u, 2*v, 2*w)"')
    template = parse_template(text, "cubes")
    moved = pc.compile_equation(template.bind({"O": "[0, 0, w]", "d": 1.5}))
    assert moved.report.bodies["big"].equation.volume == pytest.approx(12)
    with pytest.raises(InputError, match="no parameter 'q'"):
        template.bind({"q": 1})


@pytest.mark.slow
def test_every_verb(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.toml").write_text(CUBES.format(result="cut(big, small)"))
    outputs = [f"-ot.{e}" for e in ("step", "igs", "brep", "stl", "3mf", "glb", "vtp")]
    assert main(["build", "t.toml", "-s", "d=1.5", *outputs, "--report", "t.json"]) == 0
    assert json.loads((tmp_path / "t.json").read_text())["steps"][0]["common"] == pytest.approx(0.5)
    assert "7 faces" not in capsys.readouterr().out
    assert main(["check", "t.toml", "-s", "d=1.5", "--triangles"]) == 0
    shown = capsys.readouterr().out
    assert "0.5 of 1 inside: 8 - 0.5 = 7.5" in shown
    drawn = ["-o", "t.png", "--labels", "--colours", "--explode", "0.3"]
    assert main(["render", "t.toml", *drawn]) == 0
    assert main(["view", "t.toml", "-o", "t.html", "--slider", "d=1.2:1.6:2"]) == 0
    capsys.readouterr()
    assert main(["show", "t.toml"]) == 0
    assert "result = cut(big, small)" in capsys.readouterr().out
    assert main(["show", "t.toml", "--latex"]) == 0
    capsys.readouterr()
    cells = ["--cells", "2x2x2", "-ot.vtu"]
    assert main(["mesh", "t.toml", *cells]) == 2
    assert "several bodies (big, small) have a size of cells" in capsys.readouterr().err
    assert main(["mesh", "t.toml", "--body", "small", *cells]) == 0
    for verb in (["spline", "-ot.xml"], ["points", "-ot.ply"]):
        assert main([verb[0], "t.toml", *verb[1:]]) == 2
        assert "--body: big, small" in capsys.readouterr().err
        assert main([verb[0], "t.toml", "--body", "small", *verb[1:]]) == 0
    for more in (["--isolines", "3"], ["--map", "deviation"], ["--points", "3,3,3"]):
        assert main(["render", "t.toml", "-o", "y.png", *more]) == 2
        assert "belong to one equation" in capsys.readouterr().err
    assert main(["view", "t.toml", "-o", "y.html", "--points", "3,3,3"]) == 2
    assert main(["check", "t.toml", "--body", "bigg"]) == 2
    assert "did you mean big" in capsys.readouterr().err
    assert main(["check", "pyramid", "--body", "a"]) == 2
    assert "has no bodies" in capsys.readouterr().err
    assert main(["templates"]) == 0
    assert "pipe_cross: " in capsys.readouterr().out


def test_a_variant_of_bodies(tmp_path):
    task = Task(
        CUBES.format(result="cut(big, small)"), "cubes", store=str(tmp_path), formats=("step",)
    )
    outcome = run_variant(task, Job("1", {"d": 1.5}))
    assert outcome.status == BUILT, outcome.reason
    assert outcome.figures["volume"] == pytest.approx(7.5)
    assert (outcome.figures["evidence"], outcome.figures["faces"]) == ("exact", 11)


def test_a_refusal_names_two_faces_a_place_and_what_to_try(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that does not read back: of nothing else is known that it would not."""

    def not_back(*_: object) -> bytes:
        raise KernelError("the STEP text reads back as two")

    monkeypatch.setattr("pc2cad.csg.bodies.encode", not_back)
    equation = pc.read_template("common_of_pipes").bind()
    with pytest.raises(KernelError) as error:
        pc.compile_equation(equation)
    said = str(error.value)
    assert said.startswith("the STEP text reads back as two; the edge ")
    pattern = r"the edge (\S+) / (\S+) is the farthest off its faces, \S+ mm near \("
    found = re.search(pattern, said)
    assert found
    assert {name.partition(":")[0] for name in found.groups()} == {"along_x", "along_z"}
    assert "move one of the bodies a little" in said
    assert "in halves: the STEP text reads back as two" in said
