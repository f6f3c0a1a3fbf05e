"""Mass, inertia and derivatives of solids of several bodies, against closed forms."""

from __future__ import annotations

import json
from functools import cache
from math import pi
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike
from shipped import CUBES, part_of

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.domain.velocity import NotDifferentiableError
from pc2cad.errors import InputError
from pc2cad.part import Part
from pc2cad.templates.file import parse_template


@cache
def cubes(result: str, d: float) -> Part:
    """A cube of edge 2, and one of edge 1 that begins at x = d amidst it, joined."""
    return pc.compile_equation(parse_template(CUBES.format(result=result), "cubes").bind({"d": d}))


def boxes(*rows: tuple[float, ArrayLike, ArrayLike]) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass, centre and inertia of boxes (density, low, high) by the parallel-axis law."""
    masses, centres, second = [], [], np.zeros((3, 3))
    for density, low, high in rows:
        size = np.subtract(high, low)
        masses.append(density * float(np.prod(size)))
        centres.append(np.add(low, high) / 2)
        second += masses[-1] * np.diag(size**2 / 12)
    centre = np.average(centres, axis=0, weights=masses)
    for mass, place in zip(masses, centres, strict=True):
        second += mass * np.outer(place - centre, place - centre)
    return sum(masses), centre, np.trace(second) * np.eye(3) - second


PINS = """
title = "A block less a row of pins"
result = "cut(block, linear(pin, 2, vector(s, s^2/5, 0)))"
[parameters]
s = 1.5
r = 0.4
[[bodies]]
name = "block"
[bodies.solid]
x = "5*u - 1"
y = "4*v - 1"
z = "w"
[[bodies]]
name = "pin"
[bodies.solid]
x = "w*r*cos(2*pi*u)"
y = "w*r*sin(2*pi*u)"
z = "3*v - 1"
"""
ARMS = """
title = "Two arms in a mirror that turns"
result = "union(bar, mirror(arm, [0, 0, 0], vector(1, 0, k)))"
[parameters]
k = 0.2
[[bodies]]
name = "bar"
[bodies.solid]
x = "4*u - 2"
y = "v"
z = "w"
[[bodies]]
name = "arm"
[bodies.solid]
x = "1 + 3/10*u"
y = "3/10 + 3/10*v"
z = "1/2 + w*2"
"""
SECOND = ([2, 0.5, 0.5], [2.5, 1.5, 1.5])


def test_a_union_weighs_what_it_holds_once() -> None:
    found = cubes("union(big, small)", 1.5).mass_properties(2.0)
    mass, centre, inertia = boxes((2, [0, 0, 0], [2, 2, 2]), (2, *SECOND))
    assert found.mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(found.centroid, centre, rtol=1e-12)
    np.testing.assert_allclose(found.inertia, inertia, rtol=1e-12, atol=1e-12)
    assert 0 < found.relative_error < 1e-10


def test_what_is_cut_away_weighs_nothing() -> None:
    found = cubes("cut(big, small)", 0.5).mass_properties({"big": 3.0, "small": 99.0})
    mass, centre, inertia = boxes((3, [0, 0, 0], [2, 2, 2]), (-3, [0.5, 0.5, 0.5], [1.5] * 3))
    assert found.mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(found.centroid, centre, rtol=1e-12)
    np.testing.assert_allclose(found.inertia, inertia, rtol=1e-11, atol=1e-11)


def test_bodies_side_by_side_have_densities_of_their_own() -> None:
    found = cubes("union(big, small)", 2.0).mass_properties({"big": 1.0, "small": 3.0})
    mass, centre, inertia = boxes((1, [0, 0, 0], [2] * 3), (3, [2, 0.5, 0.5], [3, 1.5, 1.5]))
    assert (list(found.layers), found.layers["small"].mass) == (["big", "small"], 3.0)
    assert found.mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(found.centroid, centre, rtol=1e-12)
    np.testing.assert_allclose(found.inertia, inertia, rtol=1e-11, atol=1e-11)


def test_densities_that_cannot_be_told_are_refused() -> None:
    part = cubes("union(big, small)", 1.5)
    with pytest.raises(InputError, match="big and small overlap, and their densities differ"):
        part.mass_properties({"big": 1.0, "small": 2.0})
    with pytest.raises(InputError, match="has the bodies big, small"):
        part.mass_properties({"large": 1.0})
    with pytest.raises(InputError, match="small has no density: give it a number"):
        part.mass_properties({"big": 1.0})
    with pytest.raises(InputError, match="no body of cubes has a field 'heavy'"):
        part.mass_properties("heavy")
    with pytest.raises(InputError, match="positive number"):
        part.mass_properties(-1.0)
    assert part.mass_properties({"big": 2.0, "small": 2.0}).mass == pytest.approx(17, rel=1e-12)


def test_a_body_that_moves_takes_volume_with_it() -> None:
    """The small cube sticks out by d - 1: V = 8 + d - 1, and inertia as by differences of it."""
    found = cubes("union(big, small)", 1.5).sensitivity("d", 2.0)
    assert found.value == 1.5
    assert found.volume == pytest.approx(1.0, rel=1e-12)
    assert found.area == pytest.approx(4.0, rel=1e-12)

    def at(d: float) -> tuple[np.ndarray, np.ndarray]:
        _, centre, inertia = boxes((2, [0] * 3, [2] * 3), (2, SECOND[0], [d + 1, 1.5, 1.5]))
        return centre, inertia

    h = 1e-4
    ahead, behind = at(1.5 + h), at(1.5 - h)
    np.testing.assert_allclose(found.centroid, (ahead[0] - behind[0]) / (2 * h), atol=1e-8)
    np.testing.assert_allclose(found.inertia, (ahead[1] - behind[1]) / (2 * h), atol=1e-6)
    hidden = cubes("cut(big, small)", 0.5).sensitivity("d")
    assert hidden.volume == pytest.approx(0.0, abs=1e-12)


def against_differences(text: str, p: str, h: float, most: float) -> None:
    """Hold every derivative against the difference of rebuilt solids."""
    template = parse_template(text, "meeting")
    bound = template.bind()
    found = pc.compile_equation(bound).sensitivity(p, 2.0)

    def at(k: int) -> np.ndarray:
        part = pc.compile_equation(template.bind({p: bound.parameters[p] + k * h}))
        whole, mass = part.report.solid, part.mass_properties(2.0)
        return np.array((whole.volume, whole.area, *whole.centroid, *np.ravel(mass.inertia)))

    wanted = (at(1) - at(-1)) / (2 * h)
    own = (found.volume, found.area, *found.centroid, *np.ravel(found.inertia))
    np.testing.assert_allclose(own, wanted, atol=most * np.abs(wanted).max())


@pytest.mark.slow
def test_a_mirror_that_turns_moves_what_is_behind_it() -> None:
    against_differences(ARMS, "k", 2e-5, 1e-8)


def test_copies_move_with_the_places_that_they_have() -> None:
    """Two holes, the second at (s, s²/5): V = 20 - 2πr², A = 58 - 4πr² + 4πr."""
    part, r, s = pc.compile_equation(parse_template(PINS, "pins").bind()), 0.4, 1.5
    wide, apart = part.sensitivity("r"), part.sensitivity("s")
    volume, one = 20 - 2 * pi * r**2, pi * r**2
    assert wide.volume == pytest.approx(-4 * pi * r, rel=1e-9)
    assert wide.area == pytest.approx(4 * pi - 8 * pi * r, rel=1e-9)
    assert apart.volume == pytest.approx(0, abs=1e-12)
    assert apart.area == pytest.approx(0, abs=1e-9)
    # the first moment is that of the block less that of the holes
    np.testing.assert_allclose(
        apart.centroid, [-one / volume, -one * 2 * s / 5 / volume, 0], atol=1e-12
    )


def test_bodies_of_densities_that_differ_are_derived() -> None:
    """The big cube grows round the small one, which is three times as dense, by 4 - 1."""
    text = CUBES.replace("2*u", "d*u").replace("u + d", "2 + u")
    template = parse_template(text.format(result="union(cut(big, small), small)"), "cubes")
    given = {"big": 1.0, "small": 3.0}
    part = pc.compile_equation(template.bind({"d": 2.5}))
    found = part.sensitivity("d", given)
    assert part.mass_properties(given).mass == pytest.approx(2.5 * 4 - 0.5 + 3, rel=1e-12)
    assert (found.volume, found.mass) == pytest.approx((3.0, 3.0), rel=1e-12)
    assert found.area == pytest.approx(8.0 - 4.0, rel=1e-12)


def test_a_length_that_nothing_is_cut_at_has_no_area() -> None:
    """A ball of a rod's own radius, moved within it, touches it all round."""
    text = """
title = "A ball in a rod"
result = "union(rod, ball)"
[parameters]
c = 3
[[bodies]]
name = "rod"
[bodies.solid]
x = "w*cos(2*pi*u)"
y = "w*sin(2*pi*u)"
z = "3*v"
[[bodies]]
name = "ball"
[bodies.solid]
x = "w*cos(2*pi*u)*sin(pi*v)"
y = "w*sin(2*pi*u)*sin(pi*v)"
z = "c - w*cos(pi*v)"
"""
    found = pc.compile_equation(parse_template(text, "rod").bind()).sensitivity("c")
    assert found.volume == pytest.approx(pi, rel=1e-9)
    assert found.area is None
    assert "touch along an edge without an angle" in found.open


def test_sides_that_part_have_no_derivative() -> None:
    """Flush with the big cube's side, the small one would stick out on one side of the value."""
    with pytest.raises(NotDifferentiableError, match="coincide, and part as it changes"):
        cubes("union(big, small)", 1.0).sensitivity("d")


def test_the_command_line_weighs_and_derives_bodies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cubes.toml"
    path.write_text(CUBES.format(result="union(big, small)"))
    weighed = ["--density", "big=1", "--density", "small=3"]
    assert main(["check", str(path), "-s", "d=2", *weighed, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["mass"]["mass"] == pytest.approx(11, rel=1e-12)
    assert main(["sensitivities", str(path), "-s", "d=3/2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["volume"]["d"] == pytest.approx(1, rel=1e-12)
    assert found["area"]["d"] == pytest.approx(4, rel=1e-12)
    path.write_text(path.read_text() + '[bodies.fields]\ndensity = "2"\n')
    assert main(["check", str(path), "-s", "d=2", "--json"]) == 0
    known = json.loads(capsys.readouterr().out)
    assert known["mass"] is None
    assert any("big has no density" in text for text in known["warnings"])


#: a block, two bars that reach into it, and a hole through a bar; the bars' density is a field
GRADED = """
title = "Bars of graded density"
result = "cut(union(cut(block, bars), bars), hole)"
[[bodies]]
name = "block"
[bodies.solid]
x = "2*u"
y = "8*v - 1"
z = "w"
[bodies.fields]
density = "2 + z"
[[bodies]]
name = "bar"
[bodies.solid]
x = "1 + 4*u^2 + u"
y = "1 + v"
z = "w"
[bodies.fields]
density = "1 + x*z + w"
[[bodies]]
name = "hole"
[bodies.solid]
x = "4 + 3/10*w*cos(2*pi*u)"
y = "3/2 + 3/10*w*sin(2*pi*u)"
z = "4*v - 1"
""".replace("bars", "linear(bar, 2, vector(0, 3, 0))")


@pytest.mark.slow
def test_bodies_of_graded_density_have_their_closed_forms() -> None:
    """∫(1 + xz + z) over boxes 5 long from x = 1; a hole at x = 4 through the first."""
    part = pc.compile_equation(parse_template(GRADED, "bars").bind())
    found = part.mass_properties()
    bar, hole = 5 + 17.5 / 2 + 5 / 2, pi * 0.3**2 * (1 + 4 / 2 + 1 / 2)
    block = (2 * 8 - 2 * 1) * 2.5
    assert found.mass == pytest.approx(2 * bar - hole + block, rel=1e-10)
    assert found.relative_error < 1e-8
    # a copy carries its density
    assert sum(x.mass for name, x in found.layers.items() if "bar[1]" in name) == pytest.approx(
        part.bodies["bar"].mass_properties().mass, rel=1e-10
    )


#: a block whose density is of parameters, places and the box, with a hole that is moved and widened
#: in it, and two knobs beside it whose places move
HEAVIER = """
title = "A block with a hole"
result = "union(cut(block, hole), linear(knob, 2, vector(s, 0, 0)))"
[parameters]
k = 0.5
L = 4
r = 0.4
c = 1.5
s = 1.25
[[bodies]]
name = "block"
[bodies.solid]
x = "L*(u^2 + u)/2"
y = "2*v"
z = "w"
[bodies.fields]
density = "1 + k*x + u*v"
[[bodies]]
name = "knob"
[bodies.solid]
x = "1 + u"
y = "2 + v"
z = "w"
[bodies.fields]
density = "2 + k*z + x"
[[bodies]]
name = "hole"
[bodies.solid]
x = "c + r*w*cos(2*pi*u)"
y = "1 + r*w*sin(2*pi*u)"
z = "3*v - 1"
"""


@pytest.mark.slow
def test_bodies_of_graded_density_are_derived() -> None:
    given = {"k": 0.5, "L": 4.0, "r": 0.4, "c": 1.5, "s": 1.25}
    template = parse_template(HEAVIER, "heavier")
    part = pc.compile_equation(template.bind(given))
    found = {p: part.sensitivity(p) for p in given}
    # ∫x over the block less the hole, and ∫z over two knobs
    assert found["k"].mass == pytest.approx(16 - 1.5 * pi * 0.4**2 + 2 * 0.5, rel=1e-10)
    # knobs carry their density with them
    assert found["s"].mass == pytest.approx(0.0, abs=1e-9)
    steps = {"L": 2e-3, "r": 1e-3, "c": 2e-3, "s": 2e-3}
    assert len(steps) == 4
    for p, h in steps.items():
        ends = [
            pc.compile_equation(template.bind({**given, p: given[p] + n * h})).mass_properties()
            for n in (-2, -1, 1, 2)
        ]
        one, two, three, four = ([x.mass, *np.ravel(x.inertia)] for x in ends)
        slope = (np.subtract(one, four) + 8 * np.subtract(three, two)) / (12 * h)
        own = [found[p].mass, *np.ravel(found[p].inertia)]
        np.testing.assert_allclose(own, slope, atol=1e-8 * np.abs(own).max())


@pytest.mark.slow
def test_curved_bodies_have_their_closed_forms() -> None:
    """Two crossed cylinders; a block with a wavy duct, whose section does not change."""
    R = 2.0
    both = part_of("common_of_pipes")
    second = np.array([64 / 45, 16 / 15, 64 / 45]) * R**5  # ∫x², ∫y², ∫z²
    inertia = both.mass_properties(3.0).inertia
    np.testing.assert_allclose(inertia, 3 * np.diag(second.sum() - second), atol=1e-6)
    assert both.sensitivity("R").volume == pytest.approx(16 * R**2, rel=1e-8)
    duct = part_of("cooled_block")
    found = duct.mass_properties(2.0)
    # ∫(x - 4)(y - 3) over the duct is πr²h ∫u sin(πu/4) du = -32 r² h
    assert found.inertia[0][1] == pytest.approx(-2 * 32 * 0.8**2, rel=1e-6)
    assert found.relative_error < 1e-6
    assert duct.sensitivity("r").volume == pytest.approx(-16 * pi * 0.8, rel=1e-7)
    assert duct.sensitivity("h").volume == pytest.approx(0.0, abs=1e-6)
