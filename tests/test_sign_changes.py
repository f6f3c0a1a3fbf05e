"""Where a formula changes: all zeros along a parameter, and the pieces between them."""

from __future__ import annotations

from fractions import Fraction
from math import pi

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.domain.analysis import analyse
from pc2cad.equation.point_equation import point_equation
from pc2cad.expression.breaks import BreaksNotAlignedError
from pc2cad.expression.evaluation import Program
from pc2cad.expression.kinks import by_sign
from pc2cad.expression.sign_changes import in_pieces, sign_changes
from pc2cad.expression.tree import ONE, ZERO, Expr, call, number

u, v, w = pc.parameters()
BOX = (u, v, w)
THIRD, HALF = number(1) / 3, number(1) / 2
#: 0 up to 0.3, then rising
RAMP = in_pieces("u", (Fraction(3, 10),), (ZERO, u - Fraction(3, 10)))
#: rising from -1/2 to 1/2 in every tenth, and down again at once
TENTHS = tuple(Fraction(k, 10) for k in range(1, 10))
SAW = in_pieces("u", TENTHS, tuple(10 * u - k - HALF for k in range(10)))

#: function, parameter, places, sign before the first
LINES = {
    "linear": (u - THIRD, "u", [1 / 3], -1),
    "touching": ((u - HALF) ** 2, "u", [], 1),
    "touching from below": (-((u - Fraction(17, 32)) ** 2), "u", [], -1),
    "wave": (pc.cos(5 * u), "u", [pi / 10, 3 * pi / 10], 1),
    "none on its piece": (RAMP, "u", [], 1),
    "none, then falling": (-RAMP, "u", [0.3], 1),
    "rising, then none": (-in_pieces("u", (Fraction(3, 10),), (Fraction(3, 10) - u, ZERO)), "u",
                          [0.3], -1),
    "jumping as often as it rises": (SAW, "u", [k / 20 for k in range(1, 20)], -1),
    "factors multiplied out": (u * v - v / 3 + u - THIRD, "u", [1 / 3], -1),
    "waves multiplied out": (pc.sin(3 * u) * (2 + v) - (v + 2) / 2, "u",
                             [pi / 18, 5 * pi / 18], -1),
}  # fmt: skip


@pytest.mark.parametrize("name", LINES)
def test_all_changes_of_sign_are_found(name: str) -> None:
    tree, parameter, places, first = LINES[name]
    found = sign_changes(tree, parameter)
    assert found is not None
    assert [float(place) for place in found.places] == pytest.approx(places, abs=1e-13)
    assert found.signs == tuple(first * (-1) ** k for k in range(len(places) + 1))


@pytest.mark.parametrize("tree", [u - v, u * v - THIRD, pc.sin(6 * u) - v / 2, u - HALF + w * v])
def test_lines_of_no_parameter_are_not_said_to_be_some(tree: Expr) -> None:
    assert all(sign_changes(tree, name) is None for name in sorted(tree.symbols))


def test_what_never_changes_for_some_values_of_the_others_is_not_taken_for_a_line() -> None:
    # at u = 0.37 and at u = 0.83 there is no change along v
    assert sign_changes(10 * u - 5 - v, "v") is None


def test_places_that_are_fractions_are_exact() -> None:
    found = sign_changes(u * v - v / 3 + u - THIRD, "u")
    assert found is not None
    assert found.places == (Fraction(1, 3),)


#: two pieces that meet at 1/2, and up to what order they agree
JOINS = {
    "jump": (u, u + 1, -1),
    "crease": (u, 1 - u, 0),
    "tangent": (u**2, u - Fraction(1, 4), 1),
    "of equal curvature": (pc.cos(u - HALF), 1 - (u - HALF) ** 2 / 2, 3),
    "tangent for every v": (v * u**2, v * (u - Fraction(1, 4)), 1),
    "crease but at v = 0": (v * u, v * (1 - u), 0),
}


@pytest.mark.parametrize("name", JOINS)
def test_a_join_is_as_smooth_as_its_derivatives_agree(name: str) -> None:
    before, after, order = JOINS[name]
    joined = in_pieces("u", (Fraction(1, 2),), (before, after))
    assert joined.payload.smoothness == order


def test_equal_neighbours_are_one_piece() -> None:
    places = tuple(Fraction(k, 4) for k in (1, 2, 3))
    joined = in_pieces("u", places, (u, u, v, v))
    assert joined.payload.breaks == (0, Fraction(1, 2), 1)
    assert in_pieces("u", places, (u, u, u, u)) is u


CONDITIONS = {
    "linear": u - THIRD,
    "product": (u - THIRD) * (v - HALF),
    "negative product": -(THIRD - u) * (v - HALF) * -2,
    "kept": 1 + u * v,
    "kept below": -1 - u * v,
    "cubed": (u - THIRD) ** 3,
    "product multiplied out": u * v - u / 2 - v / 3 + Fraction(1, 6),
    "of three": (u * v + 1) * w - u * v / 4 - Fraction(1, 4),
    "three lines": (u * v - u / 2 - v / 3 + Fraction(1, 6)) * w
    - u * v / 3
    + u / 6
    + v / 9
    - Fraction(1, 18),
    "with rounding": u * v - v / 3 + u - 0.3333333333333333,
    "squared": (u - THIRD) ** 2,
    "divided": (u - THIRD) / (v - 2),
}


@pytest.mark.parametrize("name", CONDITIONS)
def test_one_of_two_trees_is_taken_by_the_sign_of_a_third(name: str) -> None:
    condition = CONDITIONS[name]
    yes, no = 2 + pc.sin(u), v * w
    found = by_sign(condition, yes, no, BOX)
    assert found is not None
    places = dict(zip("uvw", np.random.default_rng(3).random((3, 400)), strict=True))
    value, asked, if_yes, if_no = (
        np.broadcast_to(x, 400) for x in Program((found, condition, yes, no))(places)
    )
    assert np.array_equal(value, np.where(asked > 0, if_yes, if_no))
    sign = by_sign(condition, ONE, -ONE, BOX)
    (signs,) = Program((sign or ZERO,))(places)
    assert np.array_equal(np.broadcast_to(signs, 400), np.sign(asked))


def test_a_smooth_join_is_a_knot_and_a_crease_an_edge() -> None:
    bent = by_sign(u - THIRD, u**2, (2 * u - THIRD) / 3, BOX)
    assert bent is not None
    for rise, tops in ((bent, 1), (abs(u - THIRD), 2)):
        analysis = analyse(point_equation((u, v, w * (1 + rise)), name="join"))
        assert len([f for f in analysis.boundary.faces if f.patch[2] == 2]) == tops
        assert [b.position for b in analysis.breaks[0]] == [pytest.approx(1 / 3)]


def test_the_sign_of_a_function_is_a_break() -> None:
    # (u - 1/3) sign(u - 1/3) is |u - 1/3|
    height = 1 + (u - THIRD) * call("sign", u - THIRD)
    report = pc.compile_part((u, v, w * height)).report
    assert report.solid.volume == pytest.approx(1 + 5 / 18, rel=1e-12)
    assert sum(face.name.startswith("w=1") for face in report.faces) == 2


def test_factors_that_are_multiplied_out_are_edges_of_the_solid() -> None:
    height = 1 + abs(u * v - v / 3 + u - THIRD)
    report = pc.compile_part((u, v, w * height)).report
    assert report.solid.volume == pytest.approx(1 + 1.5 * 5 / 18, rel=1e-12)
    assert report.evidence == "exact"


def test_a_curve_is_refused_with_its_course_and_two_bodies() -> None:
    with pytest.raises(BreaksNotAlignedError) as refused:
        analyse(point_equation((u, v, w * (1 + abs(u - v**2))), name="curve"))
    text = str(refused.value)
    course = text.split("through ")[1].split(";")[:3]
    for place in course:
        a, b = (float(part.split(" = ")[1]) for part in place.split(","))
        assert a == pytest.approx(b**2, abs=1e-4)
    assert "two bodies, one with v^2*u for u and one with v^2 + (1 - v^2)*u" in text
