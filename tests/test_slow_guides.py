"""Guides whose speed vanishes inside: a straight one is built, a cusp is refused as one."""

from __future__ import annotations

from math import pi

import pytest

import pc2cad as pc
from pc2cad.compiler import compile_equation
from pc2cad.errors import PointCadError

TEMPLATE = """
title = "channel"
[domain]
u = [-1, 1]
[guide]
kind = "curve"
N = "point(GUIDE)"
[frame]
kind = "rotation-minimising"
[curves]
s = { kind = "ellipse", a = 0.5, b = 0.5 }
[solid]
M = "N + (R-N)*s_x(v)*w + (Q-N)*s_y(v)*w"
"""


def channel_along(guide, tmp_path):
    path = tmp_path / "channel.toml"
    path.write_text(TEMPLATE.replace("GUIDE", guide))
    return compile_equation(pc.read_template(path).bind())


@pytest.mark.parametrize("guide", ["10*u^3, 0, 0", "10*u^5, 0, 0", "6*u^3, 8*u^3, 0"])
def test_a_straight_guide_may_slow_down_to_nothing(guide, tmp_path):
    report = channel_along(guide, tmp_path).report
    assert report.solid.volume == pytest.approx(5 * pi, rel=1e-11)
    assert {face.evidence for face in report.faces} == {"exact"}
    assert sorted(face.carrier for face in report.faces) == ["cylinder", "plane", "plane"]


@pytest.mark.parametrize("guide", ["u^2, u^3, 0", "5*u^2, 2*u^3, u^5"])
def test_a_cusp_is_beyond_the_limit_of_bends(guide, tmp_path):
    with pytest.raises(PointCadError, match=r"beyond its limit: .* centre of curvature"):
        channel_along(guide, tmp_path)
