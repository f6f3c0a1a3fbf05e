"""Patterns of bodies: copies by one compilation, fused at once, named by their numbers."""

from __future__ import annotations

import gzip
import json
from math import acos, pi, sqrt

import numpy as np
import pytest

from pc2cad.compiler import compile_equation
from pc2cad.csg import bodies as csg
from pc2cad.errors import InputError
from pc2cad.mesh.joined import SidesNotSharedError
from pc2cad.picture.drawing import drawing
from pc2cad.report import SeveralBodiesError
from pc2cad.templates.file import parse_template
from pc2cad.viewer.payload import payload

PIN = """
[[bodies]]
name = "pin"
[bodies.solid]
x = "{x} + r*w*cos(2*pi*v)"
y = "r*w*sin(2*pi*v)"
z = "4*u"
"""
HEAD = "[parameters]\nr = 1\nn = 6\n[points]\nO = [1, 0, 0]\n"
SLAB = """
[[bodies]]
name = "slab"
[bodies.solid]
x = "18*u - 9"
y = "18*v - 9"
z = "w - 0.5"
"""


def part(result: str, x: float = 5, more: str = SLAB, **values: float):
    text = (
        f'title = "t"\nresult = "{result}"\n[parameters]\nr = 1\nn = 6\n[points]\nO = [1, 0, 0]\n'
    )
    return compile_equation(parse_template(text + PIN.format(x=x) + more, "t").bind(values))


def names(found) -> set[str]:
    return {face.name for face in found.report.faces}


def test_a_ring_of_pins_is_fused_once(monkeypatch) -> None:
    calls = []
    fuse = csg.fuse
    monkeypatch.setattr(
        csg, "fuse", lambda shapes, *rest: calls.append(len(shapes)) or fuse(shapes, *rest)
    )
    found = part("union(slab, polar(pin, n))")
    assert calls == [6]
    assert found.report.solid.volume == pytest.approx(18 * 18 + 6 * pi * 3.5, rel=1e-9)
    assert {f"pin[{k}]:u=1" for k in range(6)} <= names(found)
    assert all(face.evidence == "exact" for face in found.report.faces)
    assert all(edge.evidence == "exact" for edge in found.report.curves)
    assert "6 copies with nothing in common: 6 x 12.5663" in found.report.steps[0].sentence


def test_the_number_of_copies_is_a_parameter() -> None:
    assert part("union(slab, polar(pin, n))", n=4).report.solid.volume == pytest.approx(
        18 * 18 + 4 * pi * 3.5, rel=1e-9)  # fmt: skip


def test_holes_are_cut_by_patterns() -> None:
    found = part("cut(slab, polar(pin, 5))")
    assert found.report.solid.volume == pytest.approx(18 * 18 - 5 * pi * 0.5, rel=1e-9)


@pytest.mark.slow
def test_copies_that_overlap_are_held_against_halves() -> None:
    found = part("union(slab, linear(pin, 4, vector(0, 1.5, 0)))")
    lens = 2 * acos(0.75) - 1.5 * sqrt(1 - 0.75**2)
    area = 4 * pi - 3 * lens
    assert found.report.solid.volume == pytest.approx(18 * 18 + 3.5 * area, rel=1e-8)
    assert "overlap" in found.report.steps[0].sentence


def test_mirrors_keep_the_body_and_its_image() -> None:
    found = part("union(slab, mirror(pin, [0, 0, 0], vector(1, 0, 0)))")
    assert {"pin[0]:u=1", "pin[1]:u=1"} <= names(found)
    assert found.report.solid.centroid[:2] == pytest.approx((0, 0), abs=1e-9)
    assert all(edge.evidence == "exact" for edge in found.report.curves)


def test_patterns_of_patterns_and_of_booleans() -> None:
    found = part("union(slab, polar(linear(pin, 2, vector(0, 0, 3)), 3))")
    assert "pin[1][2]:u=1" in names(found)
    assert found.report.solid.volume == pytest.approx(18 * 18 + 3 * pi * 6.5, rel=1e-9)


REFUSED = {
    "polar(pin)": r"write polar\(body, n\) or polar\(body, n, O, a\)",
    "linear(pin, 3)": r"write linear\(body, n, step\)",
    "polar(pin, 2.5)": "n of polar is a whole number from 2 to 1000, not 2.5",
    "polar(pin, 2000)": "from 2 to 1000, not 2000",
    "polar(pin, u)": "n of polar must be constant, and depends on u",
    "polar(pin, 3, O, O)": "a of polar is a free vector, and a point was given",
    "mirror(pin, O, vector(0, 0, 0))": "a of mirror is a direction, and the zero vector was given",
    "polar(pins, 3)": "no body is called 'pins'; did you mean pin",
    "polr(pin, 3)": "'polr' is none of union, .*, polar, linear, mirror; did you mean polar",
}


@pytest.mark.parametrize("pattern", REFUSED)
def test_mistakes_say_how_a_pattern_is_written(pattern: str) -> None:
    with pytest.raises(InputError, match=REFUSED[pattern]) as error:
        part(f"union(slab, {pattern})")
    assert "\n" not in str(error.value)


def test_copies_and_figures_know_of_points_that_were_moved() -> None:
    text = f'title = "t"\nresult = "union(slab, linear(pin, n, O - [0, 0, 0]))"\n{HEAD}'
    stated = text + PIN.format(x=5) + SLAB + "[expect]\nvolume = 1\n"
    template, moved = parse_template(stated, "t"), {"O": "[3*r, 0, 0]"}
    found, set_there = template.move(moved).bind({"r": 2}), template.bind({"r": 2, **moved})
    assert found.result.operands[1].copies[1].offset == pytest.approx([6, 0, 0])
    assert found.placed_at("r", 3).operands[1].copies[1].offset == pytest.approx([9, 0, 0])
    # what is stated of the points as written need not hold of moved ones
    assert template.bind().expectations.volume == 1
    assert found.expectations == set_there.expectations
    assert found.expectations.volume is None


QUARTER = """
title = "t"
result = "{result}"
[[bodies]]
name = "quarter"
[bodies.domain]
v = [0, "pi/2"]
[bodies.solid]
x = "(2 + w)*cos(v)"
y = "(2 + w)*sin(v)"
z = "u"
"""


@pytest.mark.parametrize(
    ("result", "share"),
    [("polar(quarter, 4)", 4), ("mirror(quarter, [0, 0, 0], vector(1, 0, 0))", 2)],
)
def test_copies_of_one_body_are_no_body(result: str, share: int) -> None:
    """A result of one body's copies alone: meshes, pictures and pages showed the first of them."""
    found = compile_equation(parse_template(QUARTER.format(result=result), "t").bind({}))
    assert found.volume == pytest.approx(share * 5 * pi / 4, rel=1e-12)
    with pytest.raises(SeveralBodiesError, match="copies of a body"):
        _ = found.checked
    with pytest.raises(SidesNotSharedError):
        found.mesh(size=0.5)
    drawn = np.concatenate([surface.points for surface in drawing(found).surfaces])
    assert drawn[:, 0].min() == pytest.approx(-3, abs=1e-2)
    page = gzip.decompress(payload(found))
    header = json.loads(page[4 : 4 + int.from_bytes(page[:4], "little")])
    assert {face["name"] for face in header["faces"]} == names(found)


@pytest.mark.interop
def test_copies_of_one_body_are_filled_with_tetrahedra() -> None:
    text = QUARTER.format(result="polar(quarter, 4)")
    found = compile_equation(parse_template(text, "t").bind({}))
    mesh = found.mesh(size=0.5, shape="tetrahedra")
    assert mesh.volume() == pytest.approx(5 * pi, rel=1e-2)
    assert {"quarter[0]:w=1", "quarter[3]:w=1"} <= set(mesh.sides)
