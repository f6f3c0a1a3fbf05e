"""Current points in the place of a template's points: the equation stays, the solid bends."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.compiler import compile_equation
from pc2cad.equation.point_equation import PointEquation
from pc2cad.errors import InputError
from pc2cad.expression.tree import symbol
from pc2cad.templates.file import parse_template
from pc2cad.templates.shipped import template_paths

u, v, w = pc.parameters()
A, B, C, D = np.array([[4, 0, 0], [1, 5, 1], [-2, -1, 0], [1, 1, 6]])


def pyramid() -> PointEquation:
    return pc.read_template(template_paths()["pyramid"]).bind()


def volume(**points: object) -> float:
    part = compile_equation(pyramid().move(**points))
    assert part.report.genus == (0,)
    assert part.report.solid.volume == pytest.approx(part.report.equation.volume, rel=1e-7)
    return part.report.equation.volume


def test_pyramid_over_a_curved_base():
    """V = |∫ det(b, a - c + u·a', u·a + (1-u)·c) du|/6 with a = A(u) - D, for A(u) = A + u·e."""
    a, b, c, e = A - D, B - D, C - D, np.array([1, 0, 0])
    det = np.linalg.det
    exact = abs(det([b, a, c]) + det([b, e, a]) / 3 + det([b, e, c]) * 2 / 3) / 6
    assert exact == pytest.approx(332 / 9)
    assert volume(A="[4+u, 0, 0]") == pytest.approx(exact, rel=1e-13)
    assert volume(A=(4 + u, 0, 0)) == pytest.approx(exact, rel=1e-13)
    assert volume(A="A + vector(u, 0, 0)") == pytest.approx(exact, rel=1e-13)


BASE = {"A": (4, 0, 0), "B": (0, 3, 0), "C": (0, 0, 0), "D": (0, 0, 5)}


def test_pyramid_whose_apex_wanders_keeps_its_volume():
    """Every level is the same triangle, shifted (Cavalieri)."""
    assert volume(**BASE) == pytest.approx(10, rel=1e-13)
    bent = BASE | {"D": (3 * w**2, pc.sin(w), 5)}
    assert volume(**bent) == pytest.approx(10, rel=1e-12)


def test_twisted_pyramid_keeps_its_volume():
    """Every level is the same triangle, turned."""
    turn = pi / 2
    c, s = pc.cos(turn * w), pc.sin(turn * w)
    twisted = BASE | {"A": (4 * c, 4 * s, 0), "B": (-3 * s, 3 * c, 0)}
    assert volume(**twisted) == pytest.approx(10, rel=1e-12)


def test_pyramid_that_widens_as_it_rises():
    """The triangle at w has (1-w)² of the area with A = (4+2w, 0, 0): V = 5·∫(1-w)²(6+3w) dw."""
    assert volume(**(BASE | {"A": (4 + 2 * w, 0, 0)})) == pytest.approx(11.25, rel=1e-13)


def test_points_may_move_one_after_another():
    equation = pyramid().move(**{name: BASE[name] for name in "AB"})
    equation = equation.move(**{name: BASE[name] for name in "CD"})
    part = compile_equation(equation)
    assert part.report.equation.volume == pytest.approx(10, rel=1e-13)


def test_derivatives_in_the_equation_see_the_moving_point():
    text = 'title = "t"\n[points]\nA = [1, 0, 0]\n[let]\nd = "diff(A, u)"\n[solid]\n'
    text += 'M = "point(u, v, w) + d*w"\n'
    template = parse_template(text, "t")
    x, y, z = template.bind({"A": "[0, 0, u^2]"}).coordinates
    assert (x, y) == (u, v)
    assert repr(z) == "w + w*(2*u)"


def test_what_was_stated_of_the_fixed_points_is_dropped():
    assert pyramid().expectations.volume == pytest.approx(31.5)
    assert pyramid().move(A=(5, 0, 0)).expectations.volume is None


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ({"E": (1, 2, 3)}, "has no point 'E' .it has: A, B, C, D"),
        ({"A": "[4+q, 0, 0]"}, "the point A: column 4: unknown name 'q'"),
        ({"A": "A + B"}, "the point A: column 3: the weights of the points sum to 2"),
        ({"A": "A - B"}, "the point A must be a point, .x, y, z., and a free vector was given"),
        ({"A": "3"}, "the point A must be a point, .x, y, z., and a scalar was given"),
        ({"A": (1, 2)}, "the point A: a point has 3 coordinates, here are 2"),
        ({"A": (symbol("q"), 0, 0)}, "the point A depends on q, which nothing defines"),
    ],
)
def test_what_is_no_point_of_the_template_is_refused(points, message):
    with pytest.raises(InputError, match=message):
        pyramid().move(**points)


def test_an_equation_without_named_points_cannot_move():
    equation = PointEquation((u, v, w), pyramid().domain)
    with pytest.raises(InputError, match="no named points"):
        equation.move(A=(1, 2, 3))


def test_command_line(capsys):
    setting = "A=[4 + u, 0, 0]"
    assert main(["check", "pyramid", "-s", setting]) == 0
    assert "36.8888888889" in capsys.readouterr().out
    assert main(["show", "pyramid", "-s", setting]) == 0
    assert "A = [4 + u, 0, 0]" in capsys.readouterr().out
    assert main(["check", "pyramid", "-s", "A=[4+, 0, 0]"]) == 2
    assert "pyramid: the point A: column" in capsys.readouterr().err
