"""The limits of channels are found, are sharp to 1 %, and are named in refusals."""

from __future__ import annotations

from math import pi, sqrt

import pytest

import pc2cad as pc
from pc2cad.channels.limits import ChannelLimitError, Limit, find_limits
from pc2cad.cli.main import main
from pc2cad.compiler import compile_equation
from pc2cad.domain.jacobian_watch import FlatMapError
from pc2cad.equation.point_equation import PointEquation, point_equation

u, v, w = pc.parameters()
A, B, C, D = pc.points(A=(10, 0, 0), B=(0, 10, 0), C=(0, 0, 10), D=(0, 0, 0))
G1 = (A - D) * u**3 + (B - D) * (1 - u) ** 3 + (C - D) * pc.sin(u) + D
EIGHT = pc.point(20 * pc.sin(2 * pc.pi * u), 10 * pc.sin(4 * pc.pi * u), 4 * pc.cos(2 * pc.pi * u))


def limit(equation: PointEquation, name: str) -> Limit:
    (found,) = [x for x in find_limits(equation) if x.name == name]
    return found


def pipe(guide, radius: float, **options) -> PointEquation:
    return pc.channel(guide, pc.ellipse(radius, radius, v), **options)


def test_bend_of_the_papers_guide():
    found = limit(pipe(G1, 2), "bend")
    assert found.value == pytest.approx(2, rel=1e-6)
    assert found.breaks_at == pytest.approx(4.41879744, rel=1e-8)
    assert "u = 0.51782" in found.sentence


def test_bend_of_an_arc_counts_what_faces_its_centre():
    arc = pc.guide(pc.point(5 * pc.cos(u), 5 * pc.sin(u), 0))
    frame = pc.frame(arc, "direction", pc.vector(0, 0, 1))
    found = limit(pc.channel(frame, pc.ellipse(3, 1, v), 0.4), "bend")
    assert (found.value, found.breaks_at) == pytest.approx((1.2, 5), rel=1e-5)
    shifted = (1 + pc.cos(2 * pc.pi * v), pc.sin(2 * pc.pi * v) - 0.5)
    found = limit(pc.channel(frame, shifted), "bend")
    assert min(abs(found.value - 1.5), abs(found.value - 0.5)) < 1e-5


def test_straight_guide_has_no_bend():
    found = limit(pipe(pc.polyline([(0, 0, 0), (0, 0, 5)]), 2), "bend")
    assert found.holds
    assert found.sentence == "the guide is straight"


def test_wall_clearance_and_star_shape():
    ellipse = pc.channel(G1, pc.ellipse(2, 1.2, v), 0.4)
    assert limit(ellipse, "wall clearance").value == pytest.approx(1.0, rel=1e-6)
    # the least angle between KN and an ellipse: sine 2ab/(a²+b²), seen on the section itself
    thin = pc.channel(G1, pc.ellipse(2, 1.2, v), 1e-6)
    assert limit(thin, "star-shaped").value == pytest.approx(4.8 / 5.44, rel=1e-4)
    square = pc.polygon([(2, 1), (-2, 1), (-2, -1), (2, -1)], v)
    duct = pc.channel(pc.polyline([(0, 0, 0), (0, 0, 5)]), square, 1e-6)
    assert limit(duct, "star-shaped").value == pytest.approx(1 / sqrt(5), rel=1e-4)


def test_strands_of_a_figure_of_eight():
    found = limit(pipe(EIGHT, 3), "strands")
    assert (found.value, found.breaks_at) == pytest.approx((8, 6), rel=1e-6)


def test_strands_of_a_long_spring():
    found = limit(pipe(pc.helix(10, 3, 100), 1), "strands")
    # a little less than the pitch times the cosine of the slope
    assert found.value == pytest.approx(3 * 20 * pi / sqrt((20 * pi) ** 2 + 9), rel=1e-3)
    assert found.breaks_at == pytest.approx(2, rel=1e-6)


def test_a_guide_that_crosses_itself():
    flat = pc.point(20 * pc.sin(2 * pc.pi * u), 10 * pc.sin(4 * pc.pi * u), 0)
    with pytest.raises(ChannelLimitError, match="the guide crosses itself"):
        compile_equation(pipe(flat, 1))


def winding(x: float):
    """A section whose direction from the guide turns back for x > 1, where its radius changes."""
    t = 2 * pc.pi * v
    turn = t + x / 3 * pc.sin(3 * t)
    r = 2 + 0.3 * pc.sin(3 * t)
    return r * pc.cos(turn), r * pc.sin(turn)


SHARP = {
    "bend": (lambda x: pipe(G1, 4.41879744 * x), "reaches 4.46.* which is 4.4188 away"),
    "bend of a wall": (
        lambda x: pipe(G1, 4.41879744 * x - 0.2, wall=0.4), "which is 4.4188 away",
    ),
    "fillet": (
        lambda x: pipe(pc.polyline([(0, 0, 0), (9, 0, 0), (9, 9, 0)], 3), 3 * x),
        "which is 3 away",
    ),
    "wall": (
        lambda x: pc.channel(G1, pc.ellipse(2, 1.2, v), 2.4 * x),
        r"lies 0\.012 beyond the guide .*, and at 0 it touches it.*a thinner wall may hold",
    ),
    "wall inside": (
        lambda x: pipe(G1, 2, wall=2 * x, side="inside"),
        r"lies 0\.02 beyond the guide .*, and at 0 it touches it",
    ),
    "star-shaped": (
        lambda x: pc.channel(G1, winding(x), 0.3),
        r"not star-shaped about it, at .* \(under a sine of -0\.0.*, and at 0 it breaks\)",
    ),
    "strands": (lambda x: pipe(EIGHT, 4 * x), "within 8 of itself at u = [01] and u = 0.5"),
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n == "star-shaped")) for n in SHARP]
)
def test_just_inside_builds_and_just_outside_is_refused(name):
    make, message = SHARP[name]
    report = compile_equation(make(0.99), tolerance=1e-3).report
    assert {x.name for x in report.limits} >= {"bend", "star-shaped"}
    with pytest.raises(ChannelLimitError, match=message):
        compile_equation(make(1.01))


def test_section_that_is_not_star_shaped():
    curled = pc.contour([(3, 0), (1, 0.5), (0, 3), (-1, 0.2), (-3, 0), (0, -3)], v)
    with pytest.raises(ChannelLimitError, match="not star-shaped about it"):
        compile_equation(pc.channel(G1, curled, 0.2))


def test_what_is_no_channel_has_no_limits():
    assert find_limits(point_equation((u, v, w))) == ()
    mitred = pc.polyline([(0, 0, 0), (9, 0, 0), (9, 9, 0)], corners="mitre")
    assert find_limits(pipe(mitred, 1)) == ()


def test_a_guide_that_is_one_point_is_refused_as_flat():
    with pytest.raises(FlatMapError, match="has no volume"):
        compile_equation(pipe(pc.helix(5, 4, 0), 1))


def test_check_prints_the_limits(capsys):
    assert main(["check", "channel_ellipse"]) == 0
    out = capsys.readouterr().out
    assert "Limits of the channel (mm; found by search)" in out
    assert "wall clearance" in out
    assert main(["check", "channel_ellipse", "-s", "a=4.5", "-s", "b=4.5"]) == 3
    assert "which is 4.4188 away" in capsys.readouterr().err
