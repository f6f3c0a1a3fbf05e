"""What a refusal says is what is wrong, with the place and a limit that holds."""

from __future__ import annotations

import re
from math import pi
from typing import Any

import pytest

import pc2cad as pc
from pc2cad.checked import check_map
from pc2cad.domain.analysis import analyse
from pc2cad.domain.jacobian_watch import FoldedMapError
from pc2cad.domain.pinch import PinchedBoundaryError, pinch_of
from pc2cad.equation.degrees import degrees_remark
from pc2cad.equation.point_equation import LayersError, PointEquation, point_equation
from pc2cad.errors import NotASolidError
from pc2cad.expression.identity import Verdict
from pc2cad.solidity.orientation import find_orientation
from pc2cad.templates.file import parse_template
from pc2cad.templates.header import TemplateError

u, v, w = pc.parameters()
turn = 2 * pc.pi * u
Box = dict[str, tuple[float, float]]


def refusal(map_: Any, domain: Box | None = None) -> str:
    with pytest.raises(NotASolidError) as error:
        check_map(point_equation(map_, domain))
    return str(error.value)


# -- folds -----------------------------------------------------------------------------------------

FOLDS = {
    "a corner": ((u, v, w * (u + v - 0.02)), None, {"u from": 0.02, "v from": 0.02}),
    "a corner off the grid": ((u, v, w * (u + v - 0.0372)), None, {"u from": 0.0372}),
    "a whole side": ((u, v, w * (0.9 - u)), None, {"u up to": 0.9}),
    "its own units": ((u, v, w * (u - 3)), {"u": (0, 50)}, {"u from": 3}),
    "curved": ((u, v, w * (u * u - 0.3)), None, {"u from": 0.3**0.5}),
}


@pytest.mark.parametrize("case", FOLDS)
def test_the_limit_of_a_fold_is_one_that_holds(case: str) -> None:
    map_, domain, limits = FOLDS[case]
    assert limits
    text = refusal(map_, domain)
    for words, true in limits.items():
        assert re.search(rf"{words} ([\d.]+)", text), text  # without "about": it is proved
        limit = float(re.search(rf"{words} ([\d.]+)", text)[1])
        name, beyond = words[0], 1 if "from" in words else -1
        size = (domain or {}).get(name, (0, 1))[1]
        assert 0 <= beyond * (limit - true) <= 2e-3 * size
        low, high = (limit, size) if beyond > 0 else (0, limit)
        kept = analyse(point_equation(map_, {name: (low, high)}))
        assert find_orientation(kept.map).verdict is Verdict.PROVED


# -- contact in points -----------------------------------------------------------------------------

LEMON = 2 * pc.cos((2 * pc.pi / 3) * (v - 0.5)) - 1
HEIGHT = 2 * pc.sin((2 * pc.pi / 3) * (v - 0.5))


def turned(radius: Any, height: Any) -> tuple[Any, Any, Any]:
    return radius * pc.cos(turn), radius * pc.sin(turn), height


PINCHED = {
    "a dimple that reaches the bottom": (turned(v, w * v**2), (0, 0, 0)),
    "the same elsewhere": ((3 + v * pc.cos(turn), v * pc.sin(turn), 7 + w * v), (3, 0, 7)),
    "two lemons in one another": (turned((1 + w) / 2 * LEMON, HEIGHT), (0, 0, -(3**0.5))),
}  # fmt: skip


@pytest.mark.parametrize("case", PINCHED)
def test_a_pinch_is_told_with_its_place(case: str) -> None:
    map_, place = PINCHED[case]
    with pytest.raises(PinchedBoundaryError, match="touches itself in the point") as error:
        pc.compile_part(map_)
    found = re.search(r"point \((.*?)\)", str(error.value))[1].split(", ")
    assert [float(x) for x in found] == pytest.approx(place, abs=1e-5)


SOUND = {
    "a dimple above the bottom": turned(v, w * (v**2 + 0.01)),
    "a cone": turned(v * w, w),
    "a ball": turned(w * pc.sin(pc.pi * v), w * pc.cos(pc.pi * v)),
    "a lemon": turned(w * LEMON, HEIGHT),
    "a lens": turned(v, (2 * w - 1) * (1 - v * v)),
    "a half ring": turned(2 + w * pc.cos(pc.pi * v), w * pc.sin(pc.pi * v)),
    "a pyramid": (u * (1 - w), v * (1 - w), w),
}


@pytest.mark.parametrize("case", SOUND)
def test_apexes_and_poles_are_no_pinches(case: str) -> None:
    assert pinch_of(analyse(point_equation(SOUND[case]))) is None


def test_two_cones_with_one_apex_are_built_all_the_same() -> None:
    ring = turned((1 + v) * (1 - w), 3 * w)
    assert pinch_of(analyse(point_equation(ring))) is not None
    part = pc.compile_part(ring)
    assert part.report.solid.volume == pytest.approx(3 * pi, rel=1e-9)


# -- layers ----------------------------------------------------------------------------------------

LAYERED = """
title = "layers"
[layers]
a = 1
b = {b}
c = 0.5
[solid]
x = "(1+depth(w))*cos(2*pi*u)"
y = "(1+depth(w))*sin(2*pi*u)"
z = "v"
"""


@pytest.mark.parametrize("b", ["0", '"u-u"', '"0*v"', "1e-30"])
def test_a_layer_of_no_thickness_is_named(b: str) -> None:
    with pytest.raises(LayersError, match="the layer b has no thickness"):
        check_map(parse_template(LAYERED.format(b=b), "layers").bind())


def test_a_thin_layer_is_one() -> None:
    checked = check_map(parse_template(LAYERED.format(b="1e-4"), "layers").bind())
    assert len(checked.analysis.complex.layers) == 3


# -- turns and angles ------------------------------------------------------------------------------


@pytest.mark.parametrize("height", [1, pytest.param(1.5, marks=pytest.mark.slow)])
def test_a_ramp_that_meets_its_next_turn_is_told_of_its_pitch(height: float) -> None:
    ring = ((2 + v) * pc.cos(2 * turn), (2 + v) * pc.sin(2 * turn), 2 * u + height * w)
    text = refusal(ring)
    assert "a larger pitch" in text
    assert "seam" not in text
    assert float(re.search(r"for w up to about ([\d.]+)", text)[1]) == pytest.approx(
        1 / height, 0.01
    )


ANGLES = {
    "cos(360*v)": True, "cos(90*v)": True, "sin(45*v + 3*u)": True, "tan(30*w - 1)": True,
    "cos(2*pi*v)": False, "cos(360*deg*v)": False, "sin(7*v)": False, "cos(40*v)": False,
    "cos(360*pi*v)": False, "cos(360)*v": False,
}  # fmt: skip


@pytest.mark.parametrize("angle", ANGLES)
def test_degrees_are_told_from_radians(angle: str) -> None:
    text = f'title = "t"\n[solid]\nx = "u + {angle}"\ny = "v"\nz = "w"\n'
    bound = parse_template(text, "t").bind()
    assert isinstance(bound, PointEquation)
    assert ("angles are in radians" in degrees_remark(bound)) == ANGLES[angle]


def test_a_refusal_says_so_of_degrees() -> None:
    degrees = {"v": (0.0, 360.0)}
    map_ = ((2 - w) * pc.cos(v), (2 - w) * pc.sin(v), u * (1 - 2 * w))
    with pytest.raises(
        FoldedMapError, match=r"radians: that of cos\(v\) goes through 360, .* turns"
    ):
        check_map(point_equation(map_, degrees))


# -- quotes ----------------------------------------------------------------------------------------

UNQUOTED = {
    "z = 30*w": 'z = "30*w"', "z = w # c": 'z = "w"', "A = [4*u, 0, 0]": '"4*u"',
    "A = [1, u, 0]": '"u"', "z = atan2(u, v)": 'z = "atan2(u, v)"', "k = { a = 2*u }": '"2*u"',
    "z = 1/3": 'z = "1/3"', "z = -w": 'z = "-w"',
}  # fmt: skip


@pytest.mark.parametrize("line", UNQUOTED)
def test_an_expression_without_quotes_is_shown_with_them(line: str) -> None:
    with pytest.raises(TemplateError) as error:
        parse_template(f'title = "t"\n[solid]\n{line}\n', "t")
    assert str(error.value).endswith(f"line 3: an expression stands in quotes: {UNQUOTED[line]}")


@pytest.mark.parametrize("line", ['z = "w', "z = ", "[solid", 'z = "a" "b"', "z = 1 2", "z == 'w'"])
def test_other_mistakes_of_toml_keep_their_words(line: str) -> None:
    with pytest.raises(TemplateError, match="not valid TOML"):
        parse_template(f'title = "t"\n[solid]\n{line}\n', "t")
