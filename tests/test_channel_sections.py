"""Sections and walls of channels against closed forms of their areas."""

from __future__ import annotations

from collections import Counter
from math import gamma, pi, sqrt

import pytest
from scipy.special import ellipe

import pc2cad as pc
from pc2cad.channels.channel import ChannelError
from pc2cad.channels.curves import SectionError
from pc2cad.compiler import compile_equation
from pc2cad.domain.analysis import analyse
from pc2cad.errors import InputError
from pc2cad.expression.scalar import evaluate
from pc2cad.integrals.mass_properties import integrate
from pc2cad.templates.file import parse_template
from pc2cad.templates.header import TemplateError

u, v, w = pc.parameters()
LINE = pc.polyline([(0, 0, 0), (0, 0, 1)])
RECTANGLE = [(2, 1), (-2, 1), (-2, -1), (2, -1)]
ROUNDED = 8 - (4 - pi) * 0.25
PERIMETER = 4 * 2 * ellipe(1 - 0.36)


def area(section, wall=None, **options) -> float:
    return integrate(analyse(pc.channel(LINE, section, wall, **options))).volume


FILLED = {
    "ellipse": (pc.ellipse(2, 1.2, v), 2.4 * pi),
    "superellipse": (pc.superellipse(2, 1, 4, v), 8 * gamma(1.25) ** 2 / gamma(1.5)),
    "wave": (pc.sine_wave(2, 0.3, 7, v), 12.7077422837708),
    "wave on an ellipse": (pc.sine_wave(2, 0.2, 5, v, 1), 2 * pi * (1 + 0.01 / 2)),
    "polygon": (pc.polygon(RECTANGLE, v), 8),
    "rounded": (pc.polygon(RECTANGLE, v, 0.5), ROUNDED),
    "one round corner": (pc.polygon(RECTANGLE, v, [0, 0, 1, 0]), 8 - (1 - pi / 4)),
    "hexagon": (pc.regular_polygon(6, 2, v), 6 * sqrt(3)),
    "contour": (pc.contour([(1, 0), (0, 1), (-1, 0), (0, -1)], v, spacing="chord"), None),
}


@pytest.mark.parametrize("name", FILLED)
def test_filled_section(name):
    section, exact = FILLED[name]
    if exact is None:
        # equal chords: the spacing makes no difference
        exact = area(pc.contour([(1, 0), (0, 1), (-1, 0), (0, -1)], v))
    assert area(section) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize(
    ("section", "options", "exact"),
    [
        (pc.ellipse(2, 2, v), {}, 0.8 * 2 * pi),
        (pc.ellipse(2, 2, v), {"side": "inside"}, pi * (4 - 2.56)),
        (pc.ellipse(2, 2, v), {"side": "outside"}, pi * (5.76 - 4)),
        (pc.ellipse(2, 1.2, v), {"measured": "normal"}, 0.4 * PERIMETER),
        (pc.ellipse(2, 1.2, v), {"measured": "normal", "side": "outside"},
         0.4 * PERIMETER + 0.16 * pi),
        (pc.polygon(RECTANGLE, v), {"measured": "normal"}, 4.4 * 2.4 - 3.6 * 1.6),
        (pc.polygon(RECTANGLE, v), {"measured": "normal", "side": "inside"}, 8 - 3.2 * 1.2),
        (pc.polygon(RECTANGLE[::-1], v), {"measured": "normal", "side": "inside"}, 8 - 3.2 * 1.2),
        (pc.polygon(RECTANGLE, v, 0.5), {"measured": "normal", "side": "outside"},
         0.4 * (8 + pi) + 0.16 * pi),
        (pc.polygon(RECTANGLE, v), {"measured": "radial", "domain": {"v": (0, 0.5)}}, None),
    ],
)  # fmt: skip
def test_walls(section, options, exact):
    if exact is None:
        whole = area(section, 0.4, measured="radial")
        assert area(section, 0.4, **options) == pytest.approx(whole / 2, rel=1e-12)
        return
    assert area(section, 0.4, **options) == pytest.approx(exact, rel=1e-11)


POLAR = """
title = "polar"
[guide]
N = "[0, 0, 3*u]"
[frame]
[curves]
rose = { kind = "polar", r = "2 + 0.3*cos(3*phi) + 0.1*t*(1 - t)" }
oval = { kind = "plane", x = "2*cos(phi)", y = "sin(phi) + 0.2*sin(2*phi)" }
[let]
K = "N + (R-N)*CURVE_x(v) + (Q-N)*CURVE_y(v)"
[solid]
M = "N*(1 - w) + K*w"
"""


@pytest.mark.parametrize(("curve", "area"), [
    # half the integral of r², φ = 2πt: mean of (2 + 0.3 cos 3φ + 0.1 t(1-t))², times π
    ("rose", pi * (4 + 0.045 + 0.4 / 6 + 0.01 / 30 + 0.06 * (-2 / (6 * pi) ** 2))),
    ("oval", 2 * pi),
])  # fmt: skip
def test_polar_and_plane_curves_of_a_template(curve, area):
    equation = parse_template(POLAR.replace("CURVE", curve), "polar").bind()
    assert integrate(analyse(equation)).volume == pytest.approx(3 * area, rel=1e-12)


def test_polar_curve_in_python():
    r = 2 + 0.3 * pc.cos(6 * pc.pi * v)
    section = (r * pc.cos(2 * pc.pi * v), r * pc.sin(2 * pc.pi * v))
    assert area(section) == pytest.approx(pi * 4.045, rel=1e-12)
    # a radial wall: δ∮r dφ
    assert area(section, 0.2) == pytest.approx(0.2 * 4 * pi, rel=1e-12)


def test_taper_and_varying_walls():
    x, y = pc.ellipse(2, 1, v)
    assert area((x * (1 - u / 2), y * (1 - u / 2))) == pytest.approx(2 * pi * 7 / 12, rel=1e-12)
    thick = 0.3 * (1 + u) * (1 + pc.cos(2 * pi * v) / 2)
    assert area(pc.ellipse(2, 2, v), thick) == pytest.approx(2 * pi * 2 * 0.45, rel=1e-12)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: pc.polygon(RECTANGLE, v, 1.5), SectionError, "the arcs at its ends need 3"),
        (lambda: pc.polygon(RECTANGLE, v, [1, 1]), SectionError, "4 corners, and 2 radii"),
        (lambda: pc.superellipse(1, 1, 1, v), SectionError, "2 or more, and 1 was given"),
        (lambda: pc.contour(RECTANGLE, v, spacing="x"), SectionError, "the spacing is one of"),
        (lambda: pc.channel(LINE, (1, 2)), ChannelError, "is a function of v"),
        (lambda: pc.channel(LINE, (v, v), w), ChannelError, "depends on u and v alone"),
        (lambda: pc.channel(LINE, (v, v), 1, side="up"), ChannelError, "the side of the wall"),
        (lambda: pc.channel(LINE, (v, v), 1, measured="x"), ChannelError, "radial or normal"),
        (lambda: pc.channel(LINE, pc.polygon(RECTANGLE, v, [0, 1, 0, 0]), 0.1, measured="normal"),
         SectionError, "the section has a corner at v = "),
        (lambda: pc.channel(LINE, pc.polygon([*RECTANGLE, (2, -1)], v), 0.1, measured="normal"),
         SectionError, r"stands still at v = 0\.6, and has no normal"),
        (lambda: pc.channel(LINE, pc.contour(RECTANGLE, v, 0), 0.1, measured="normal"),
         SectionError, "stands still at v = 1, and has no normal"),
    ],
)  # fmt: skip
def test_what_is_no_section_or_wall_is_refused(make, error, message):
    assert issubclass(error, InputError)
    with pytest.raises(error, match=message):
        make()


def test_walls_round_the_arcs_of_a_section_are_exact():
    section = pc.polygon(RECTANGLE, v, 0.5)
    report = compile_equation(pc.channel(LINE, section, 0.2, measured="normal")).report
    assert report.evidence == "exact"
    assert Counter(f.carrier for f in report.faces) == {"cylinder": 8, "plane": 10}
    assert report.solid.volume == pytest.approx(0.2 * (8 + pi), rel=1e-12)


EVEN = """
title = "t"
[parameters]
wall = {{ default = 0.3, min = 0.01, max = 0.8 }}
size = {{ default = 2, min = 1, max = 3 }}
[guide]
kind = "polyline"
points = [[0, 0, 0], [0, 0, 1]]
[curves]
c = {{ {curve} }}
[let]
K = "N + (R-N)*c_x(v) + (Q-N)*c_y(v)"
out = "(R-N)*c_nx(v) + (Q-N)*c_ny(v)"
[solid]
M = "K + out*wall*(w - 0.5)"
"""


@pytest.mark.parametrize(
    ("curve", "section"),
    [
        ('kind = "ellipse", a = "size", b = 1.2', lambda s: pc.ellipse(s, 1.2, v)),
        ('kind = "polar", r = "size*(1 - cos(3*phi)/20)"',
         lambda s: tuple(s * (1 - pc.cos(6 * pc.pi * v) / 20) * f(2 * pc.pi * v)
                         for f in (pc.cos, pc.sin))),
        ('kind = "polygon", points = [["size", 1], [-2, 1], [-2, -1], [2, -1]]',
         lambda s: pc.polygon([(s, 1), *RECTANGLE[1:]], v)),
        ('kind = "polygon", points = [[2, -1], [-2, -1], [-2, 1], ["size", 1]]',
         lambda s: pc.polygon([*RECTANGLE[:0:-1], (s, 1)], v)),
        ('kind = "contour", points = [["size", 0], [0, 1], [-1, 0], [0, -1]]',
         lambda s: pc.contour([(s, 0), (0, 1), (-1, 0), (0, -1)], v)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("size", [2, 2.5])
def test_even_walls_of_templates_are_those_of_python(curve, section, size):
    bound = parse_template(EVEN.format(curve=curve), "t").bind({"size": size})
    made = pc.channel(pc.frame(LINE), section(size), 0.3, measured="normal")
    places = [{"u": 0.3, "v": t, "w": s} for t in (0.03, 0.26, 0.61, 0.97) for s in (0, 0.7, 1)]
    got, wanted = (
        [evaluate(c, p) for p in places for c in equation.coordinates] for equation in (bound, made)
    )
    assert got == pytest.approx(wanted, rel=1e-13, abs=1e-13)


def test_a_corner_without_a_normal_is_refused_where_it_is_asked_for():
    rounded = (
        'kind = "polygon", points = [[2, 1], [-2, 1], [-2, -1], [2, -1]], radius = [0, 0, 1, 0]'
    )
    with pytest.raises(TemplateError, match=r"\[let\] out.*has a corner at v = "):
        parse_template(EVEN.format(curve=rounded), "t").bind()
    normal, radial = "(R-N)*c_nx(v) + (Q-N)*c_ny(v)", "(K-N)/hypot(c_x(v), c_y(v))"
    text = EVEN.format(curve=rounded).replace(normal, radial)
    assert parse_template(text, "t").bind().name == "t"
