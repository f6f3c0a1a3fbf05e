"""STEP files of several bodies held against their equations and the Boolean that joins them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from consumers.step_edits import move, pole, read_instances
from plain_step import box, cut_ball
from shipped import part_of

from pc2cad.cli.main import main
from pc2cad.compiler import compile_solid
from pc2cad.domain.analysis import analyse
from pc2cad.integrals.mass_properties import integrate
from pc2cad.options import CompileOptions
from pc2cad.templates.bodies import Bodies, BodiesTemplate
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import bodies_paths
from pc2cad.verify.against import verification
from pc2cad.verify.membership import Membership
from pc2cad.verify.nearness import SEEN
from pc2cad.verify.receipt import parse_step
from pc2cad.verify.sides import Sides
from pc2cad.verify.trimmed import moments_on
from pc2cad.verify.verdict import Verification

#: two boxes that have a box of 1 x 2 x 3 with a corner in the origin in common
BOXES = """
title = "Two boxes"
result = "intersect(a, b)"
[[bodies]]
name = "a"
[bodies.solid]
M = "[2*u - 1, 3*v - 1, 4*w - 1]"
[[bodies]]
name = "b"
[bodies.solid]
M = "[3*u, 4*v, 5*w]"
"""
NAMES = {"u=1": "a:u=1", "v=1": "a:v=1", "w=1": "a:w=1", "u=0": "b:u=0", "v=0": "b:v=0",
         "w=0": "b:w=0"}  # fmt: skip


def bodies(text: str, path: Path) -> Bodies:
    path.write_text(text)
    template = read_template(path)
    assert isinstance(template, BodiesTemplate)
    return template.bind()


def held(text: str, equations: Bodies) -> Verification:
    return verification(parse_step(text.encode()), equations)


def named(text: str, names: dict[str, str]) -> str:
    assert all(text.count(f"'{old}'") == 1 for old in names)
    return re.sub("'([uvw]=[01])'", lambda found: f"'{names[found[1]]}'", text)


def test_a_box_is_what_two_boxes_have_in_common(tmp_path: Path) -> None:
    found = held(named(box(), NAMES), bodies(BOXES, tmp_path / "boxes.toml"))
    assert found.differences == ()
    assert [match.name for match in found.matches] == [NAMES[k] for k in
            ("w=0", "w=1", "v=0", "v=1", "u=0", "u=1")]  # fmt: skip
    assert all(match.trimmed for match in found.matches)
    assert {match.nearness.rests_on for match in found.matches} == {"exact"}
    assert found.mass.volume == pytest.approx(6.0, rel=1e-14)
    assert found.places is not None
    assert found.places > 100


#: what is done to the file, or to the template, and a word of what is said
WRONG: dict[str, tuple[Callable[[str], str], Callable[[str], str], str]] = {
    "the other body's name": (
        lambda t: t.replace("'a:u=1'", "'b:u=1'"), str, "from that of the side b:u=1"),
    "the other side's name": (
        lambda t: t.replace("'a:u=1'", "'a:v=1'"), str, "from that of the side a:v=1"),
    "a name of no body": (lambda t: t.replace("'a:u=1'", "'c:u=1'"), str, "the name of no side"),
    "a name of no side": (lambda t: t.replace("'a:u=1'", "'a:u=2'"), str, "the name of no side"),
    "a name without a body": (lambda t: t.replace("'a:u=1'", "'u=1'"), str, "name of no side"),
    "not what they have in common": (
        str, lambda t: t.replace("intersect", "union"), "does not bound union(a, b)"),
    "cut from another": (
        str, lambda t: t.replace("intersect", "cut"), "does not bound cut(a, b)"),
    "a body that is smaller": (
        str, lambda t: t.replace("[2*u - 1", "[1.999*u - 1"), "from that of the side a:u=1"),
    "a body that ends before": (
        str, lambda t: t.replace("4*v,", "1.5*v,"), "from that of the side b:"),
    "a void that was dropped": (
        str, lambda t: t.replace("intersect(a, b)", "cut(intersect(a, b), void)")
        + '[[bodies]]\nname = "void"\n[bodies.solid]\nM = "[(u+2)/5, (v+2)/5, (w+2)/5]"\n',
        "of the side void:u=0 there is no face"),
    "the unit": (str, lambda t: 'units = "m"\n' + t, "unit of length"),
}  # fmt: skip


#: the others are slow; what is joined in another way is asked of the verb
QUICK = ("the other body's name",)


@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=[] if k in QUICK else [pytest.mark.slow]) for k in WRONG]
)
def test_a_box_that_they_have_not_in_common(kind: str, tmp_path: Path) -> None:
    of_file, of_template, words = WRONG[kind]
    text, template = of_file(named(box(), NAMES)), of_template(BOXES)
    assert (text, template) != (named(box(), NAMES), BOXES)
    found = held(text, bodies(template, tmp_path / "boxes.toml"))
    assert any(words in sentence for sentence in found.differences), found.differences


@pytest.mark.slow
def test_faces_of_copies_may_have_the_names_of_both(tmp_path: Path) -> None:
    """The box and its image in its own middle are one."""
    twice = bodies(
        'title = "twice"\nresult = "mirror(a, O, vector(1, 0, 0))"\n'
        '[points]\nO = ["1/2", 0, 0]\n'
        '[[bodies]]\nname = "a"\n[bodies.solid]\nM = "[u, 2*v, 3*w]"\n',
        tmp_path / "twice.toml",
    )
    names = {side: f"a[0]:{side} = a[1]:{side}" for side in NAMES}
    names |= {"u=0": "a[0]:u=0 = a[1]:u=1", "u=1": "a[0]:u=1 = a[1]:u=0"}
    found = held(named(box(), names), twice)
    assert found.differences == ()
    assert len(found.matches) == 12
    assert found.mass.volume == pytest.approx(6.0, rel=1e-14)


@pytest.mark.slow
def test_a_difference_may_be_one_equation(tmp_path: Path) -> None:
    """Faces are those of M1 + M2 - K; that it is the difference is asked of both bodies."""
    text = (
        'title = "rest"\nresult = "difference(a, b)"\n[[bodies]]\nname = "a"\n[bodies.solid]\n'
        'M = "[u, 2*v, 4*w - 1]"\n[[bodies]]\nname = "b"\n[bodies.solid]\nM = "[u, 2*v, -w]"\n'
    )
    rest = bodies(text, tmp_path / "rest.toml")
    found = held(box(), rest)
    assert found.differences == ()
    assert {match.name for match in found.matches} == set(NAMES)


def test_the_verb_and_the_gate_take_bodies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    template, file = tmp_path / "boxes.toml", tmp_path / "box.step"
    template.write_text(BOXES)
    file.write_text(named(box(), NAMES))
    command = ["verify", str(file), str(template)]
    assert main([*command, "--certificate", str(tmp_path / "box.json")]) == 0
    assert re.search(r"verified, .*\n  bounds .* \d+ places \(sampled\)", capsys.readouterr().out)
    assert main(["verify", str(file), "--replay", str(tmp_path / "box.json")]) == 0
    template.write_text(BOXES.replace("intersect", "union"))
    capsys.readouterr()
    assert main(command) == 6
    assert "does not bound union(a, b)" in capsys.readouterr().out


BLOCK = {side: f"block:{side}" for side in NAMES}


def cooled_block(**values: float) -> Bodies:
    template = read_template(bodies_paths()["cooled_block"])
    assert isinstance(template, BodiesTemplate)
    return template.bind(values)


def test_a_hole_that_was_dropped_is_missed() -> None:
    """The block alone: its faces are whole sides, closed, outwards, and named rightly."""
    found = held(named(box((8.0, 6.0, 4.0)), BLOCK), cooled_block())
    sentences = " ".join(found.differences)
    assert "of the side duct:w=1 there is no face" in sentences


def _turned_over(text: str) -> str:
    """Swap the names of the two ends, which the duct cuts alike."""
    return (
        text.replace("'block:u=0'", "'?'").replace("'block:u=1'", "'block:u=0'")
        .replace("'?'", "'block:u=1'")
    )  # fmt: skip


BALL = """
title = "Ball without a cap"
result = "cut(ball, block)"
[[bodies]]
name = "ball"
[bodies.solid]
x = "2*w*cos(pi*v - pi/2)*cos(2*pi*u)"
y = "2*w*cos(pi*v - pi/2)*sin(2*pi*u)"
z = "2*w*sin(pi*v - pi/2)"
[[bodies]]
name = "block"
[bodies.solid]
M = "[1 + 2*u, 6*v - 3, 6*w - 3]"
"""


def test_a_hole_in_a_side_that_is_closed(tmp_path: Path) -> None:
    """What is left of the ball's side and not what was cut off, whose edge is the same."""
    text = cut_ball()
    first, second = re.findall(r"ADVANCED_FACE\('([^']*)'", text)
    text = text.replace(f"ADVANCED_FACE('{first}'", "ADVANCED_FACE('ball:w=1'", 1)
    text = text.replace(f"ADVANCED_FACE('{second}'", "ADVANCED_FACE('block:u=0'", 1)
    found = held(text, bodies(BALL, tmp_path / "ball.toml"))
    assert found.differences == ()
    volume = 4 / 3 * math.pi * 8 - math.pi * (2 - 1 / 3)
    assert found.mass.volume == pytest.approx(volume, rel=1e-9)
    match = next(m for m in found.matches if m.name == "ball:w=1")
    equation = bodies(BALL, tmp_path / "ball.toml").equations["ball"]
    analysis = analyse(equation)
    sides = Sides(analysis, integrate(analysis).face_areas)
    seen = moments_on(replace(match, nearness=SEEN), sides, found.file.solids[0].origin)
    assert seen is not None
    assert seen.volume == pytest.approx(match.face.moments.volume, rel=1e-9)
    assert seen.area == pytest.approx(12 * math.pi, rel=1e-6)


@pytest.mark.slow
def test_names_of_halves_are_known(tmp_path: Path) -> None:
    """Bodies may be joined with what closes cut in halves; here the face is both of them."""
    text = cut_ball()
    first, second = re.findall(r"ADVANCED_FACE\('([^']*)'", text)
    text = text.replace(f"ADVANCED_FACE('{first}'", "ADVANCED_FACE('ball:w=1 (piece 2 of u)'", 1)
    text = text.replace(f"ADVANCED_FACE('{second}'", "ADVANCED_FACE('block:u=0'", 1)
    found = held(text, bodies(BALL, tmp_path / "ball.toml"))
    assert not any("name of no side" in sentence for sentence in found.differences)
    assert any("from that of the side ball:w=1 (piece 2 of u)" in s for s in found.differences)


def test_a_place_is_found_at_the_end_of_a_spiral_beside_its_beginning(tmp_path: Path) -> None:
    """Descents from the nearest samples all end on the side u=0, which is nearer than the place."""
    spiral = bodies(
        BOXES.replace("[2*u - 1, 3*v - 1, 4*w - 1]", "[c*cos(f), c*sin(f), r*sin(2*pi*v)]").replace(
            'name = "a"\n', 'name = "a"\n[bodies.let]\nr = "(14 + 30*u)*w"\n'
            'c = "118 + 30*u + r*cos(2*pi*v)"\nf = "35/18*pi*u"\n'
        ),
        tmp_path / "spiral.toml",
    )  # fmt: skip
    analysis = analyse(spiral.equations["a"])
    places = analysis.map.points(np.full(3, 0.998), np.full(3, 0.5), np.array([0.9, 0.99, 0.9999]))
    near = np.full(3, 1e-3)
    assert Membership({"a": analysis}, "a").holds(places, near).all()
    assert not Membership({"a": analysis}, "a").holds(places * 0.99, near)[-1]


@pytest.mark.slow
def test_a_block_with_a_duct_and_what_is_done_to_it(tmp_path: Path) -> None:
    part_of("cooled_block").write(tmp_path / "block.step")
    text, equations = read_instances(tmp_path / "block.step"), cooled_block()
    found = held(text, equations)
    assert found.differences == ()
    assert [m.name for m in found.matches if m.trimmed] == ["block:u=0", "duct:w=1", "block:u=1"]
    assert {m.name: m.nearness.rests_on for m in found.matches}["duct:w=1"] == "bounded"
    volume = 8 * 6 * 4 - 8 * 0.8**2 * math.pi
    assert found.mass.volume == pytest.approx(volume, rel=1e-8)
    row = pole(text, -10, 5)
    for changed in (
        move(text, row, 1e-2), move(text, row, 3e-5), _turned_over(text),
        text.replace("'duct:w=1'", "'block:w=1'"), text.replace("'duct:w=1'", "'duct:u=0'"),
    ):  # fmt: skip
        assert changed != text
        assert held(changed, equations).differences != ()
    assert held(text, cooled_block(r=0.8001)).differences != ()


@pytest.mark.slow
def test_whole_turns_of_a_thread_count_along_their_own_normal(tmp_path: Path) -> None:
    """Their normal's integral vanishes: which way they face shows in its moments."""
    bolt = read_template(bodies_paths()["bolt"]).bind()
    part = compile_solid(bolt, CompileOptions(profile="cubic"))
    part.write(tmp_path / "bolt.step")
    found = held(read_instances(tmp_path / "bolt.step"), bolt)
    assert found.differences == ()
    assert found.mass.volume == pytest.approx(part.report.solid.volume, rel=1e-8)
