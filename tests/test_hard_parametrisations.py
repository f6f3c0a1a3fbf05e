"""Maps that are hard on a fit, a quadrature or a mesh: built right, or refused in words."""

from __future__ import annotations

from fractions import Fraction
from math import asinh, erfc, exp, hypot, pi, sqrt

import numpy as np
import pytest
from scipy.integrate import quad
from test_quadrature import step_length

import pc2cad as pc
from pc2cad.compiler import compile_equation
from pc2cad.domain.analysis import analyse
from pc2cad.equation.point_equation import point_equation
from pc2cad.errors import InputError, NotASolidError, PointCadError, ToleranceNotReachedError
from pc2cad.solidity.continuity import DiscontinuousMapError, check_continuous
from pc2cad.solidity.face_mesh import cut
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import template_paths

U, V, W = pc.parameters()
PI = pc.pi
COS, SIN = pc.cos(2 * PI * U), pc.sin(2 * PI * U)
THIRD = Fraction(1, 3)


def poles_of(part: pc.Part) -> int:
    return sum(n * m for n, m in (f.poles or (0, 0) for f in part.report.faces))


def check(part: pc.Part, volume: float, area: float | None = None, poles: int = 20_000) -> None:
    """Right to the stated deviation, and not with more poles than it is worth."""
    report = part.report
    slack = report.deviation * report.solid.area / volume + 1e-9
    assert report.equation.relative_error < 1e-9
    assert report.equation.volume == pytest.approx(volume, rel=1e-9, abs=0)
    assert report.solid.volume == pytest.approx(volume, rel=slack, abs=0)
    if area is not None:
        assert report.equation.area == pytest.approx(area, rel=1e-8, abs=0)
        assert report.solid.area == pytest.approx(area, rel=1e-6, abs=0)
    assert report.deviation <= report.tolerance
    assert poles_of(part) <= poles


# -- roots that end at a side: plain solids whose speed is infinite there --------------------------

Z = 2 * W - 1
R1 = pc.sqrt(1 - Z**2)
ROOTS = {
    "disc by area": ((3 * pc.sqrt(W) * COS, 3 * pc.sqrt(W) * SIN, 4 * V), 36 * pi, 42 * pi),
    "ball by height": ((V * R1 * COS, V * R1 * SIN, Z), 4 * pi / 3, 4 * pi),
    "half ball by height": (
        (V * pc.sqrt(1 - W**2) * COS, V * pc.sqrt(1 - W**2) * SIN, W), 2 * pi / 3, 3 * pi,
    ),
    "paraboloid by height": (
        (V * pc.sqrt(W) * COS, V * pc.sqrt(W) * SIN, W), pi / 2, pi + pi / 6 * (5**1.5 - 1),
    ),
    "egg": ((V * pc.sqrt(W - W**2) * COS, V * pc.sqrt(W - W**2) * SIN, W), pi / 6, pi),
    # x = sqrt(u) under z = 1 + x²: 4/3
    "wedge": ((pc.sqrt(U), V, W * (1 + U)), 4 / 3, 4 + 8 / 3 + sqrt(5) / 2 + asinh(2) / 4),
    "cube root, brick": ((U**THIRD, V, W), 1.0, 6.0),
    "cube root, revolved": ((V * W**THIRD * COS, V * W**THIRD * SIN, W), 0.6 * pi, None),
    "fourth root": ((V * W**0.25 * COS, V * W**0.25 * SIN, W), 2 / 3 * pi, None),
    "root at two sides": ((U, V, W * (1 + pc.sqrt(U * V))), 1 + 4 / 9, None),
    "arc sine": ((pc.asin(U), V, W), pi / 2, 2 + 2 * pi),
    "arc cosine, both ends": ((pc.acos(2 * U - 1), V, W), pi, 2 + 4 * pi),
    "area cosine": ((pc.acosh(1 + U), V, W), float(np.arccosh(2)), None),
    "three halves": ((U ** Fraction(3, 2), V, W * (1 + U)), 1.6, None),
}  # fmt: skip


@pytest.mark.parametrize("name", ROOTS)
def test_roots_at_a_side_are_built(name):
    map_, volume, area = ROOTS[name]
    check(pc.compile_part(map_), volume, area, poles=600)


@pytest.mark.parametrize("name", ["cube root, brick", "root at two sides", "arc sine"])
def test_roots_of_polynomials_keep_exact_faces(name):
    # the same point set by powers of the parameter: planes and Bézier faces
    assert pc.compile_part(ROOTS[name][0]).report.evidence == "exact"


@pytest.mark.slow
def test_a_root_at_a_corner_is_built_with_knots_towards_it():
    report = pc.compile_part((U, V, W * (1 + (1 + U) * pc.sqrt(U + V))), tolerance=1e-5).report
    # the mean of sqrt(u + v), and that of u sqrt(u + v), with u = s²
    mean = 4 / 15 * (2**2.5 - 2)
    first, weights = np.polynomial.legendre.leggauss(40)
    u = ((first + 1) / 2) ** 2
    moment = float((weights * (first + 1) / 2 * u * ((1 + u) ** 1.5 - u**1.5)).sum()) * 2 / 3
    assert report.solid.volume == pytest.approx(1 + mean + moment, rel=1e-9)


def test_a_root_at_a_corner_is_no_harm_on_a_parabolic_cylinder():
    # the top is (z - 1)² = x + y
    part = pc.compile_part((U, V, W * (1 + pc.sqrt(U + V))))
    assert [f.carrier for f in part.report.faces].count("extrusion") == 1
    assert part.report.evidence == "exact"
    volume = 1 + 4 / 15 * (2**2.5 - 2)
    assert part.report.solid.volume == pytest.approx(volume, rel=1e-12)


# -- slow-downs, poles of high order, thin faces ---------------------------------------------------

SLOW = {
    "prism u³": ((2 * U**3, V, W), 2.0, 10.0),
    "prism (2u-1)³": (((2 * U - 1) ** 3, V, W), 2.0, 10.0),
    "rod w³": ((V * COS, V * SIN, W**3), pi, 4 * pi),
    "rod turned u³": ((V * pc.cos(2 * PI * U**3), V * pc.sin(2 * PI * U**3), W), pi, 4 * pi),
    "ball w³": (
        (W**3 * pc.sin(PI * V) * COS, W**3 * pc.sin(PI * V) * SIN, W**3 * pc.cos(PI * V)),
        4 * pi / 3, 4 * pi,
    ),
    **{
        f"cone w^{k}": ((V * W**k * COS, V * W**k * SIN, W**k), pi / 3, pi * (1 + sqrt(2)))
        for k in (2, 5, 8)
    },
    "cusp w³": ((V * W**3 * COS, V * W**3 * SIN, W), pi / 7, None),
}  # fmt: skip


@pytest.mark.parametrize("name", SLOW)
def test_slow_downs_and_poles_of_high_order(name):
    map_, volume, area = SLOW[name]
    check(pc.compile_part(map_), volume, area, poles=2000)


@pytest.mark.parametrize("top", [1e-3, 1e-5])
def test_a_side_that_nearly_collapses_is_a_thin_face(top):
    r = 1 + (top - 1) * W
    part = pc.compile_part((V * r * COS, V * r * SIN, W))
    volume = pi / 3 * (1 + top + top**2)
    check(part, volume, pi + pi * top**2 + pi * (1 + top) * hypot(1, 1 - top), poles=200)
    assert len(part.report.faces) == 3
    part = pc.compile_part(((2 * U - 1) * r, (2 * V - 1) * r, W))
    check(part, 4 * (1 + top + top**2) / 3)
    assert len(part.report.faces) == 6
    assert part.report.evidence == "exact"
    part = pc.compile_part((U, V, top * W))
    check(part, top, 2 + 4 * top)


@pytest.mark.parametrize("top", [1e-8, 1e-10])
def test_between_a_thin_face_and_none_it_is_refused_with_a_reason(top):
    r = 1 + (top - 1) * W
    for map_ in ((V * r * COS, V * r * SIN, W), ((2 * U - 1) * r, (2 * V - 1) * r, W)):
        with pytest.raises(PointCadError, match=r"apart") as caught:
            pc.compile_part(map_)
        assert caught.value.exit_code in (3, 5)


# -- uneven speed, sharp bends, waves, narrow features ---------------------------------------------

RUN = (pc.exp(6 * U) - 1) / (pc.e**6 - 1)


def test_strongly_uneven_speed():
    check(pc.compile_part((RUN, V, W)), 1.0, 6.0)
    turned = pc.cos(2 * PI * RUN), pc.sin(2 * PI * RUN)
    check(pc.compile_part((V * turned[0], V * turned[1], W)), pi, 4 * pi, poles=2000)


def test_twist_with_uneven_speed_has_the_exact_area():
    def side(u: float) -> float:
        rise = 30 * exp(6 * u) / (exp(6) - 1)
        # |M_u × M_v| = sqrt(rise² + (6a)²), a from -1/2 to 1/2
        return quad(lambda a: sqrt(rise**2 + 36 * a * a), -0.5, 0.5, epsabs=1e-13)[0]

    area = 2 + 4 * quad(side, 0, 1, epsabs=1e-12, epsrel=1e-12)[0]
    c, s = pc.cos(6 * U), pc.sin(6 * U)
    a, b = V - 0.5, W - 0.5
    check(pc.compile_part((a * c - b * s, a * s + b * c, 5 * RUN)), 5.0, area)


@pytest.mark.parametrize("k", [5, 50, pytest.param(1000, marks=pytest.mark.slow)])
def test_sharp_step_next_to_straight_runs_in_a_slab(k):
    x = 4 * U - 2
    part = pc.compile_part((x, pc.tanh(k * x) + V, W))
    check(part, 4.0, 10 + 2 * step_length(k, 1.0), poles=2000)


@pytest.mark.parametrize("waves", [10, pytest.param(200, marks=pytest.mark.slow)])
def test_a_wavy_slab_is_built_whatever_its_wave_number(waves):
    part = pc.compile_part((U, V, W * (2 + 0.1 * pc.sin(2 * waves * PI * U))))
    check(part, 2.0)
    assert [f.carrier for f in part.report.faces].count("plane") == 5


@pytest.mark.parametrize(("width", "place"), [(0.1, 0.5), (0.01, 0.3141), (0.001, 0.3141)])
def test_a_narrow_bump_is_built_with_knots_where_it_is(width, place):
    bump = 1 / (1 + ((U - place) / width) ** 2)
    volume = 2 + width / 2 * (np.arctan((1 - place) / width) + np.arctan(place / width))
    part = pc.compile_part((U, V, W * (2 + 0.5 * bump)))
    check(part, float(volume), poles=500)


def test_values_that_vanish_are_no_reason_to_refuse():
    # exp(-2500) at the ends is 0 in double precision and no error; exp(2500) is
    bump = pc.exp(-(((U - 0.5) / 0.01) ** 2))
    check(pc.compile_part((U, V, W * (2 + 0.5 * bump))), 2 + 0.005 * sqrt(pi))
    with pytest.raises(NotASolidError, match="finite"):
        pc.compile_part((U, V, W * (2 + pc.exp((100 * U) ** 2))))


def test_a_slender_cone_keeps_its_volume_at_the_default_tolerance():
    part = pc.compile_part((3 * V * (1 - W) * COS, 3 * V * (1 - W) * SIN, 4000 * W))
    assert part.report.tolerance == pytest.approx(1e-6 * 2, rel=1e-2)  # 2V/A = 2r/3
    assert part.report.solid.volume == pytest.approx(12_000 * pi, rel=1e-7)


def test_a_seam_that_does_not_close_is_named():
    template = read_template(template_paths()["channel_sine"])
    with pytest.raises(NotASolidError, match=r"v=0 and v=1 nearly close, 0\.28.* whole period"):
        compile_equation(template.bind({"n": "7.3"}))


# -- not finite, not continuous --------------------------------------------------------------------

BROKEN = {
    "pole inside": (U, V, W * (1 + 1 / (U - 0.5) ** 2)),
    "pole inside, off the grid": (U, V, W * (1 + 1 / (U - 0.513) ** 2)),
    "logarithm": (U, V, W * (1 - pc.log(U))),
    "root of a negative number": (U, V, W * (1 + pc.sqrt(U - 0.1))),
    "jump": (U, V, W * (5 + pc.atan2(V - 0.5123, U - 0.4987))),
    "tangent": (U, V, W * (2 + pc.tan(3 * U))),
    "step": (U, V, W + (U - 0.4567) / abs(U - 0.4567)),
}


@pytest.mark.parametrize(("name", "place"), [("jump", "v = 0.5123"), ("step", "u = 0.4567")])
def test_a_jump_is_named_with_its_place(name, place):
    with pytest.raises(DiscontinuousMapError, match=place):
        pc.compile_part(BROKEN[name])


@pytest.mark.parametrize("jump", [pc.sign(U - 0.4), pc.atan(1 / (U - 0.4))], ids=["sign", "atan"])
def test_a_jump_that_reaches_no_side_is_refused(jump):
    """It leaves gaps, and covers as much twice, in equal parts all round: the integrals agree."""
    inside = U * (1 - U) * V * (1 - V) * W * (1 - W) * (V - Fraction(1, 2)) * (W - Fraction(1, 2))
    with pytest.raises(DiscontinuousMapError, match=r"near u = 0\.4,"):
        pc.compile_part((U + inside * jump, V, W))


STEPS_AT_ENDS = {
    "floor": (pc.floor(U), "u = 1, v = 0"),
    "of another parameter": (U * pc.floor(V), "v = 1, w = 0"),
    "sign": (pc.sign(V), "v = 0, w = 0"),
    "a condition": (pc.where(U > 0, 0, 1), "u = 0, v = 0"),
    "mod": (pc.mod(V, 1), "v = 1, w = 0"),
    "at a corner": (pc.floor(U * V), "u = 1, v = 1, w = 1:"),
    "at a crease": (abs(U - Fraction(1, 2)) + pc.sign(U - Fraction(1, 2)) ** 2, "u = 0.5, v = 0"),
}


@pytest.mark.parametrize("name", STEPS_AT_ENDS)
def test_a_step_at_an_end_alone_is_a_jump(name):
    """Pieces of M hold their ends: as floor(u) is 0 up to u = 1, samples of M do not show it."""
    step, place = STEPS_AT_ENDS[name]
    with pytest.raises(DiscontinuousMapError, match=f"jumps at .*{place}"):
        pc.compile_part((U, V, W * (2 + step)))


@pytest.mark.parametrize(
    "height", [2 + pc.cos(2 * pc.pi * pc.mod(U, 1)), 2 + U * pc.sign(U), 2 + pc.floor(V) * (1 - V)]
)
def test_steps_that_m_does_not_take_are_none(height):
    part = pc.compile_part((U, V, W * height))
    assert part.report.own.injectivity == "proved"


def test_a_map_of_functions_that_may_jump_is_not_called_proved():
    part = pc.compile_part((U, V, W + (U - Fraction(1, 2)) * pc.sign(U - Fraction(1, 2)) / 3))
    assert part.report.own.injectivity == "sampled"
    assert part.report.own.overlap_open == "that M does not jump is sampled"


def test_a_steep_place_is_no_jump():
    step = pc.tanh(10**7 * (V - THIRD))
    steep = analyse(point_equation((U + step / 100, V, W)))
    check_continuous(steep, cut(steep))


@pytest.mark.parametrize("name", BROKEN)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_what_is_not_finite_or_jumps_is_refused(name):
    with pytest.raises((NotASolidError, ToleranceNotReachedError, InputError)):
        pc.compile_part(BROKEN[name])


# -- divisions by zero that leave a value ----------------------------------------------------------

#: nought in the middle of the box
X = U - Fraction(1, 2)
POLES = {
    # ∫ atan(1/x²) = ∫ (π/2 - atan x²), by its series
    "arc tangent": (pc.atan(1 / X**2), 1.488189845279646),
    # 1 + ∫ exp(-1/x²) over [-1/2, 1/2]
    "exponential": (1 + pc.exp(-1 / X**2), 1 + exp(-4) - 2 * sqrt(pi) * erfc(2)),
    "power": (U**U, sum((-1) ** k / (k + 1) ** (k + 1) for k in range(20))),
    "root of three": (1 + abs(X) ** Fraction(1, 3), 1 + 0.75 * 0.5 ** (1 / 3)),
}


@pytest.mark.parametrize("name", POLES)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_value_that_a_pole_leaves_is_one(name):
    height, volume = POLES[name]
    part = pc.compile_part((U, V, W * height))
    assert part.report.solid.volume == pytest.approx(volume, rel=1e-7)
    assert not part.report.warnings  # det J does not vanish there


@pytest.mark.parametrize("height", [2 + pc.atan(1 / U), 2 + pc.tanh(1 / U), 1 + pc.exp(-1 / U**2)])
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_division_by_zero_on_a_side_is_named_with_it(height):
    with pytest.raises(InputError, match=r"M has no value on u=0 .* \(division by zero\)"):
        pc.compile_part((U, V, W * height))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_derivatives_without_a_value_are_refused_with_the_place():
    """1/(1 + exp(1/x²)) is smooth, and exp(1/x²) beyond all numbers about x = 0."""
    with pytest.raises(NotASolidError, match=r"no finite value inside the box near u = 0\.4"):
        pc.compile_part((U, V, W * (1 + X**2 + 1 / (1 + pc.exp(1 / X**2)))))
