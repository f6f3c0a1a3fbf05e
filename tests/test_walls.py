"""How thick walls are: closed forms, and walls laid along the normal or from the guide."""

from __future__ import annotations

import re
from math import cos, pi
from pathlib import Path

import pytest

import pc2cad as pc
from pc2cad.domain.analysis import analyse
from pc2cad.equation.point_equation import PointEquation, point_equation
from pc2cad.sampling.walls import thickness
from pc2cad.templates.file import parse_template

u, v, w = pc.parameters()
PAGE = (Path(__file__).parents[1] / "docs" / "channels.md").read_text()


def straight(section: object, measured: str, size: float = 1.0) -> PointEquation:
    guide = pc.frame(pc.polyline([(0, 0, 0), (0, 0, 10 * size)]))
    return pc.channel(guide, section, wall=0.2 * size, side="inside", measured=measured)


@pytest.mark.parametrize("size", [0.01, 1e5])
def test_a_wall_along_the_normal_is_as_thick_as_asked_for(size: float) -> None:
    found = thickness(analyse(straight(pc.ellipse(2 * size, size, v), "normal", size)))
    assert list(found) == ["w=0 to w=1", "w=1 to w=0"]
    assert list(found.values()) == [pytest.approx((0.2 * size, 0.2 * size), rel=1e-9)] * 2


def test_a_mitred_square_is_farther_only_from_its_outer_corners() -> None:
    found = thickness(analyse(straight(pc.regular_polygon(4, 2, v), "normal")))
    assert found["w=0 to w=1"] == pytest.approx((0.2, 0.2), rel=1e-9)
    assert found["w=1 to w=0"] == pytest.approx((0.2, 0.2 * 2**0.5), rel=1e-9)


def test_a_wall_from_the_guide_is_thinner_beside_corners() -> None:
    least, largest = thickness(analyse(straight(pc.regular_polygon(4, 2, v), "radial")))[
        "w=0 to w=1"
    ]
    assert least == pytest.approx(0.2 * cos(pi / 4), rel=1e-9)
    assert largest == pytest.approx(0.2, rel=1e-6)


@pytest.mark.parametrize(
    ("solid", "expected"),
    [
        (("4*u", "3*v", "2*w"), {"w=0 to w=1": (2, 2), "w=1 to w=0": (2, 2)}),
        (("2*w", "4*u", "3*v"), {"w=0 to w=1": (2, 2), "w=1 to w=0": (2, 2)}),
        (("u*(1 + w)", "v*4", "8*w"), {"u=0 to u=1": (1, 16 / 65**0.5), "u=1 to u=0": (1, 2)}),
        ("[3*w*cos(2*pi*u)*sin(pi*v), 3*w*sin(2*pi*u)*sin(pi*v), 3*w*cos(pi*v)]", {}),
    ],
)
def test_blocks_are_as_thick_as_they_are(solid: object, expected: dict[str, object]) -> None:
    found = thickness(analyse(point_equation(solid)))
    assert found == {name: pytest.approx(pair, rel=1e-6) for name, pair in expected.items()}


def test_the_even_wall_of_the_channels_page_is_even() -> None:
    (text,) = re.findall(r'```toml\n(title = "Oval duct.*?)```', PAGE, re.DOTALL)
    even = parse_template(text, "oval", "oval.toml").bind({"wall": 0.25})
    pairs = thickness(analyse(even)).values()
    assert list(pairs) == [pytest.approx((0.25, 0.25), rel=1e-6)] * 2
