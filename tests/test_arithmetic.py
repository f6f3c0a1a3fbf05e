"""Sums of point equations that are Booleans: proved, or the condition that fails."""

from __future__ import annotations

import re
from math import pi

import pytest

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.equation.point_equation import point_equation
from pc2cad.equation.sums import sums
from pc2cad.errors import InputError
from pc2cad.templates.file import parse_template

TWO = """
title = "two"
result = "{result}"
[parameters]
r = 2
[points]
A = [4, 0, 0]
B = [1, 5, 1]
C = [-2, -1, 0]
D = [1, 1, 6]
[[bodies]]
name = "a"
[bodies.solid]
M = "{a}"
[[bodies]]
name = "b"
[bodies.solid]
M = "{b}"
"""
PYRAMID = "A*u*v*(1-w) + B*(1-v)*(1-w) + C*(1-u)*v*(1-w) + D*w"
CUT_OFF = "(A-D)*w*u*v/2 + (B-D)*w*(1-v)/4 + (C-D)*w*v*(1-u)*3/4 + D"
ROD = "[3*w*cos(2*pi*v), 3*w*sin(2*pi*v), 5*u]"
BORE = "[r*w*cos(2*pi*v), 1.2*w*sin(2*pi*v), 5*u]"
BALL = "[{0}*w*sin(pi*u)*cos(2*pi*v), {0}*w*sin(pi*u)*sin(2*pi*v), {0}*w*cos(pi*u)]"
#: a cone of 60 degrees to each side, cut from a ball
SECTOR = "[{0}*w*sin(pi*u/3)*cos(2*v), {0}*w*sin(pi*u/3)*sin(2*v), {1}*w*cos(pi*u/3)]"


def two(a: str, b: str, result: str = "difference(a, b)"):
    return parse_template(TWO.format(a=a, b=b, result=result), "two").bind()


@pytest.mark.parametrize(
    ("a", "b", "volume", "faces", "grounds"),
    [
        (PYRAMID, CUT_OFF, 63 / 2 * (1 - 3 / 32), 5, "v=0 collapses, v=1 lies in one plane"),
        (ROD, BORE, 5 * pi * (9 - 2.4), 4, "u=0 lies in one plane, u=1 lies in one plane; v clos"),
        (BALL.format(3), BALL.format(2), 4 / 3 * pi * 19, 2, "u=0 collapses, u=1 collapses"),
        (SECTOR.format(3, 3), SECTOR.format(2, 2), 19 / 3, 5, "u=1 lies on common rays"),
        ("[u, v, 2*w]", "[w, u, v]", 1, 6, "the core is w=0 of the one, w=1 of the other"),
    ],
    ids=["pyramid", "tube", "shell", "sector", "blocks"],
)  # fmt: skip
def test_differences_that_are_sums_are_one_equation(a, b, volume, faces, grounds):
    report = pc.compile_equation(two(a, b)).report
    assert report.own is not None
    assert report.integrals.volume == pytest.approx(volume, rel=1e-12)
    assert len(report.faces) == faces
    (sentence,) = report.arithmetic
    assert "a + b - their core is a less b: proved" in sentence
    assert grounds in sentence


@pytest.mark.parametrize(
    ("a", "b", "why"),
    [
        # the bore is somewhere else, and nothing is a core
        (ROD, "[w*cos(2*pi*v) + 1, w*sin(2*pi*v), 5*u]", "no side of the one is the opposite"),
        # the same points in space, but the inner side's rays end on another cone
        (SECTOR.format(3, 3), SECTOR.format(2, 1), "on common rays from the core"),
        (BORE, ROD, "a does not hold b"),
        # a pyramid with another apex angle: its planes are others
        (PYRAMID, "D + ((A-D)*u*v + (B-D)*(1-v) + (C-D)*v*(1-u) + vector(1,0,0)*u*v)*w/2",
         "nor on common rays"),
    ],
    ids=["elsewhere", "rays", "larger", "planes"],
)  # fmt: skip
def test_a_condition_that_fails_is_named(a, b, why):
    from pc2cad.compiler import compile_solid
    from pc2cad.csg.arithmetic import reduced

    bodies = two(a, b)
    parts = {name: compile_solid(e).body for name, e in bodies.equations.items()}
    made = reduced(bodies, parts, lambda e: compile_solid(e).body)
    assert str(made.result) == "cut(a, b)"
    assert re.search(why, made.reasons["cut(a, b)"])


PIPE = """
title = "A pipe"
result = "difference(rod, bore)"
[parameters]
R = 2
r = 1
h = 3
cut = 0
[[bodies]]
name = "rod"
[bodies.solid]
M = "[R*w*cos(2*pi*u), R*w*sin(2*pi*u), h*v + cut*v*w]"
[[bodies]]
name = "bore"
[bodies.solid]
M = "[r*w*cos(2*pi*u), r*w*sin(2*pi*u), h*v]"
"""


def test_a_difference_that_is_one_equation_changes_with_its_parameters():
    """V = π (R² - r²) h, and A = 2π (R + r) h + 2π (R² - r²)."""
    template = parse_template(PIPE, "pipe")
    part = pc.compile_equation(template.bind())
    volumes = {"R": 2 * pi * 2 * 3, "r": -2 * pi * 3, "h": 3 * pi}
    areas = {"R": 6 * pi + 8 * pi, "r": 6 * pi - 4 * pi, "h": 6 * pi}
    assert len(volumes) == 3
    for p, volume in volumes.items():
        found = part.sensitivity(p)
        assert found.volume == pytest.approx(volume, rel=1e-12)
        assert found.volume_by_flux == pytest.approx(volume, rel=1e-12)
        assert found.area == pytest.approx(areas[p], rel=1e-9)
    adjusted = pc.adjust(template, {"r": (0.2, 1.5)}, ["volume=30"])
    assert adjusted.parameters["r"] == pytest.approx((4 - 10 / pi) ** 0.5, rel=1e-10)
    with pytest.raises(InputError, match="rod less bore is one equation at cut = 0 and not beside"):
        part.sensitivity("cut")


def test_the_kernel_cuts_where_no_sum_is_a_difference():
    report = pc.compile_equation(two("[4*u, 4*v, w]", "[1 + u, 1 + v, 3*w - 1]")).report
    assert report.solid.volume == pytest.approx(15, rel=1e-14)
    (step,) = report.steps
    assert "not one equation: a + b - their core: no side of the one" in step.sentence


def test_a_difference_within_a_boolean_is_a_body_of_its_own():
    template = TWO + '[[bodies]]\nname = "c"\n[bodies.solid]\nM = "[2 + 4*u, v/2, 1 + w]"\n'
    text = template.format(a=ROD, b=BORE, result="union(difference(a, b), c)")
    part = pc.compile_equation(parse_template(text, "three").bind())
    report = part.report
    assert set(report.bodies) == {"difference(a, b)", "c"}
    assert [step.operation for step in report.steps] == ["difference", "union"]
    assert "proved" in report.steps[0].sentence
    assert any(face.name.startswith("difference(a, b):w=") for face in report.faces)
    with pytest.raises(InputError, match=r"with r is not known: .* write cut\(a, b\)"):
        part.sensitivity("r")


def test_signs_tell_a_difference_from_a_union():
    up, down = point_equation(["u", "v", "w"]), point_equation(["u", "v", "-w"])
    found = [s for s in sums(up, down) if not s.unmet]
    # w = 0 is common: with the second's w turned round (det J < 0 twice) it is both together
    assert [(s.core, s.turned) for s in found] == [(("w=0", "w=1"), -1)]
    whole = pc.compile_equation(found[0].equation)
    assert whole.volume == pytest.approx(2)


def test_check_says_what_a_sum_of_points_is(capsys):
    assert main(["check", "pyramid_sum"]) == 0
    said = capsys.readouterr().out
    assert "M1 + M2 - D is M1 less M2: proved" in said
    assert "31.5 - 2.953125 = 28.546875" in said
    assert main(["check", "pyramid_cut"]) == 0
    said = capsys.readouterr().out
    assert "N*(1 - w) + K*w is the cone D-N less the cone D-K: proved" in said


def test_check_says_which_condition_of_a_written_sum_fails(tmp_path, capsys):
    text = """
title = "t"
[points]
O = [0, 0, 0]
[let]
M1 = "[3*u, 3*v, 3*w]"
M2 = "[u*(1-w), v, w]"
[solid]
M = "M1 + M2 - O"
"""
    path = tmp_path / "t.toml"
    path.write_text(text)
    assert main(["check", str(path)]) == 0
    assert "M1 begins nowhere, at an end of u, v or w, where M2 ends" in capsys.readouterr().out
