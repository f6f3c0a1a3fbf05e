"""What is no solid is refused, with the proper class and in words, and within seconds."""

from __future__ import annotations

import functools
import math
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction

import pytest
from reference import GUIDES

import pc2cad as pc
from pc2cad.compiler import compile_equation
from pc2cad.domain.jacobian_watch import FlatMapError, FoldedMapError
from pc2cad.equation.point_equation import EmptyDomainError
from pc2cad.equation.points import WeightsDoNotSumError
from pc2cad.errors import InputError, NotASolidError, PointCadError
from pc2cad.templates.file import parse_template
from pc2cad.templates.header import ParameterRangeError
from pc2cad.templates.shipped import template_paths
from pc2cad.validation import SolidNotValidError

P1 = {"A": (4, 0, 0), "B": (1, 5, 1), "C": (-2, -1, 0), "D": (1, 1, 6)}
FLAT = r"the image is flat and has no volume|nothing bounds a solid"
FOLDS = r"det J changes its sign: the map folds the solid over itself near u = "


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Fail when the body has not ended after some seconds of work, however busy the machine is."""

    def late(*_: object) -> None:
        raise TimeoutError(f"no answer after {seconds} s")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def assert_refused(equation, error, message, domain=None, seconds=20.0):
    with within(seconds), pytest.raises(error, match=message) as caught:
        pc.compile_part(equation, domain)
    text = str(caught.value)
    assert "\n" not in text
    assert "nan" not in text
    assert len(text) < 400
    return caught.value


@pytest.mark.parametrize("name", ["torus", "mine/flute.toml"])
def test_templates_given_as_equations_are_told_how_to_read_them(name):
    assert_refused(name, InputError, rf"read_template\('{name}'\)\.bind\(\) makes one of it")


def test_what_lacks_a_parameter_is_told_which():
    u, v, _ = pc.parameters()
    r, turn = 3 + u * (1 - u), 2 * pc.pi * v
    vase = [r * pc.cos(turn), r * pc.sin(turn), 5 * u]
    assert_refused(vase, FlatMapError, r"no volume \(M does not depend on w; a wall")
    assert_refused([u, u * u, 1], FlatMapError, "M does not depend on v or w;")


def pyramid(**points):
    A, B, C, D = pc.points(**(P1 | points))
    u, v, w = pc.parameters()
    return A * u * v * (1 - w) + B * (1 - v) * (1 - w) + C * (1 - u) * v * (1 - w) + D * w


def frustum(p, q, r):
    A, B, C, D = pc.points(**P1)
    u, v, w = pc.parameters()
    a, b, c = ((1 - w) + k * w for k in (p, q, r))
    return (A - D) * u * v * a + (B - D) * (1 - v) * b + (C - D) * v * (1 - u) * c + D


def pipe(radius, delta, guide="G1", reference="D"):
    """A circular channel on a guide of the paper; `reference`: the point E of its normal."""
    A, B, C, D = points = pc.points(**dict(zip("ABCD", GUIDES[guide], strict=True)))
    u, v, w = pc.parameters()
    E = points["ABCD".index(reference)]
    N = (A - D) * u**3 + (B - D) * (1 - u) ** 3 + (C - D) * pc.sin(u) + D
    P = N + pc.diff(N, u)
    N1 = E - (P - N) * (pc.metric(E, P, N) / pc.metric(P, P, N))
    R = N + pc.unit(N1 - N)
    Q = N + pc.unit(pc.exit_from_plane(N, P, N1) - N)
    phi = 2 * pc.pi * v
    K = N + (R - N) * radius * pc.cos(phi) + (Q - N) * radius * pc.sin(phi)
    return K + (K - N) * delta / pc.distance(K, N) * (w - Fraction(1, 2))


# -- folds -----------------------------------------------------------------------------------------


@functools.cache
def folded(case):
    u, v, w = pc.parameters()
    theta, phi = 2 * pc.pi * u, 2 * pc.pi * v
    cos, sin = pc.cos, pc.sin
    if case == "N2 spindle torus":
        ring = 1 + 2 * w * cos(phi)
        return ring * cos(theta), ring * sin(theta), 2 * w * sin(phi)
    if case == "N5 wall across the axis":
        rho = Fraction(1, 2) + Fraction(3, 2) * (w - Fraction(1, 2))
        return rho * cos(phi), rho * sin(phi), 5 * u
    if case == "N6 fold at u = 0.7":
        return (u - Fraction(7, 10)) ** 2, v, w
    if case == "N7 section wider than the bend":
        return pipe(4.6, 0.4)
    return frustum(2, Fraction(1, 2), Fraction(1, 2))


@pytest.mark.parametrize(
    "case",
    [
        "N1 frustum 2, 1/2, 1/2",
        "N2 spindle torus",
        "N5 wall across the axis",
        "N6 fold at u = 0.7",
        "N7 section wider than the bend",
    ],
)
def test_folded_maps(case):
    error = assert_refused(folded(case), FoldedMapError, FOLDS)
    assert isinstance(error, NotASolidError)
    assert error.exit_code == 3


def test_the_place_of_a_fold_is_one_where_the_map_is_turned_over():
    text = str(assert_refused(folded("N6 fold at u = 0.7"), FoldedMapError, FOLDS))
    u, v, w = (float(x) for x in re.findall(r"[uvw] = ([\d.]+)", text))
    x, y, z = (float(x) for x in re.search(r"at \((.*?)\)", text)[1].split(","))
    # for u < 0.7 det J is positive and for u > 0.7 negative; the printed point is the image
    assert 0 <= u <= 1
    assert (x, y, z) == pytest.approx(((u - 0.7) ** 2, v, w), rel=1e-3)


FOLDED_CUTS = [
    (2, "1/2", 1), ("3/2", "1/2", "1/2"), ("1/2", "3/2", "1/2"), ("1/2", "1/2", "3/2"),
    ("11/10", "1/2", "1/2"), (-1, "1/2", "1/2"), ("1/2", -1, "1/2"), ("1/2", "1/2", -1),
]  # fmt: skip


@pytest.mark.parametrize("cut", FOLDED_CUTS, ids=str)
def test_cuts_that_turn_over(cut):
    assert_refused(frustum(*map(Fraction, cut)), FoldedMapError, FOLDS)


#: p, q, r outside 0..1 whose det J keeps one sign all the same -> volume over that of ABCD
UNUSUAL_CUTS = {(-1, 1, 1): 2, (1, 1, "3/2"): Fraction(1, 2), ("3/2", 2, 3): 8, (1, 1, 0): 1}


@pytest.mark.parametrize("cut", UNUSUAL_CUTS, ids=str)
def test_cuts_that_look_wrong_and_are_not(cut):
    part = pc.compile_part(frustum(*map(Fraction, cut)))
    assert part.report.solid.volume == pytest.approx(31.5 * float(UNUSUAL_CUTS[cut]), rel=1e-12)
    assert part.report.evidence == "exact"


@pytest.mark.slow
def test_the_bend_of_the_guide_decides_how_wide_a_pipe_may_be():
    """The least radius of curvature of the guide G1 is 4.41879744."""
    wide = pc.compile_part(pipe(4.2, 0.4))
    length = 20.1186157947867914
    assert wide.report.solid.volume == pytest.approx(math.pi * 3.36 * length, rel=1e-7)
    assert_refused(pipe(4.25, 0.4), FoldedMapError, FOLDS)


@pytest.mark.parametrize("template", ["channel_ellipse", "channel_sine", "channel_contour"])
@pytest.mark.parametrize("values", [{"delta": 5}, {"delta": 3, "s": 1}, {"delta": 20, "s": 0}])
def test_walls_of_templates_that_are_too_thick(template, values):
    equation = pc.read_template(template_paths()[template]).bind(values)
    with within(20), pytest.raises(NotASolidError, match="the channel is beyond its limit"):
        compile_equation(equation)


# -- overlaps: det J keeps its sign ----------------------------------------------------------------


def helical_rod():
    """R = 3, pitch 1, two turns of a rod of radius 0.6: each turn runs through the next."""
    u, v, w = pc.parameters()
    t, phi = 4 * pc.pi * u, 2 * pc.pi * v
    rise = 1 / (2 * pc.pi)
    slant = pc.sqrt(9 + rise**2)
    x, y = Fraction(3, 5) * w * pc.cos(phi), Fraction(3, 5) * w * pc.sin(phi) / slant
    return (
        (3 - x) * pc.cos(t) + y * rise * pc.sin(t),
        (3 - x) * pc.sin(t) - y * rise * pc.cos(t),
        rise * t + 3 * y,
    )


def test_n3_rod_whose_turns_overlap():
    assert_refused(helical_rod(), NotASolidError, "covers itself", seconds=15.0)


def test_n4_cylinder_that_is_covered_twice():
    u, v, w = pc.parameters()
    theta = 2 * pc.pi * u
    ring = ((2 + v) * pc.cos(theta), (2 + v) * pc.sin(theta), 5 * w)
    assert_refused(ring, NotASolidError, "covers itself", {"u": (0, Fraction(5, 4))})


def test_a_cylinder_that_is_covered_once():
    u, v, w = pc.parameters()
    theta = 2 * pc.pi * u
    report = pc.compile_part(((2 + v) * pc.cos(theta), (2 + v) * pc.sin(theta), 5 * w)).report
    assert report.solid.volume == pytest.approx(25 * math.pi, rel=1e-7)
    assert report.solid.area == pytest.approx(60 * math.pi, rel=1e-7)
    assert (len(report.faces), report.genus) == (4, (1,))


# -- nothing there ---------------------------------------------------------------------------------

#: four points of one plane each
COPLANAR = {
    "plane z = 0": {"A": (4, 0, 0), "B": (1, 5, 0), "C": (-2, -1, 0), "D": (1, 1, 0)},
    "D in the plane ABC": {"D": (Fraction(7, 10), Fraction(33, 20), Fraction(2, 5))},
    "oblique, D on the edge AB": {"D": (Fraction(5, 2), Fraction(5, 2), Fraction(1, 2))},
    "D = A": {"D": (4, 0, 0)},
    "B = C": {"B": (-2, -1, 0)},
    "C in the middle of AB": {"C": (Fraction(5, 2), Fraction(5, 2), Fraction(1, 2))},
    "axes": {"A": (4, 0, 0), "B": (0, 3, 0), "C": (0, 0, 6), "D": (2, "3/4", "3/2")},
    "far away": {"A": (1000, 0, 0), "B": (0, 1000, 0), "C": (0, 0, 1000), "D": (700, 200, 100)},
    "decimals": {"A": (0.1, 0.2, 0.3), "B": (1.1, 0.7, -0.4), "C": (-0.3, 2.1, 0.9),
                 "D": (0.3, 1, "4/15")},
}  # fmt: skip


def exact(point):
    return tuple(Fraction(x) if isinstance(x, str) else x for x in point)


@pytest.mark.parametrize("case", COPLANAR)
def test_coplanar_simplex(case):
    points = {name: exact(point) for name, point in COPLANAR[case].items()}
    assert_refused(pyramid(**points), NotASolidError, FLAT)


@pytest.mark.parametrize("exponent", range(-13, -3))
def test_nearly_coplanar_simplex_is_answered(exponent):
    """D is so far above the plane ABC: a right volume or a refusal, and either soon."""
    height = Fraction(10) ** exponent
    M = pyramid(D=(Fraction(7, 10), Fraction(33, 20), Fraction(2, 5) + height))
    try:
        with within(5):
            report = pc.compile_part(M).report
    except PointCadError as error:
        assert exponent <= -6  # 0.33 times that is the mean thickness; the kernel holds 1e-7
        assert re.search(f"{FLAT}|apart|kernel takes points", str(error))  # noqa: PT017
    else:
        # what rounding of the coordinates may change: 1e-15 of the height
        assert report.solid.volume == pytest.approx(5.5 * float(height), rel=1e-14 / float(height))


def test_coplanar_template():
    text = template_paths()["pyramid"].read_text(encoding="utf-8")
    text = text.replace("D = [1, 1, 6]", "D = [0.7, 1.65, 0.4]").partition("[expect]")[0]
    with within(20), pytest.raises(FlatMapError, match="the points lie in one plane"):
        compile_equation(parse_template(text, "flat").bind())


@pytest.mark.parametrize("template", ["pyramid_cut", "pyramid_sum"])
def test_cut_that_leaves_nothing(template):
    equation = pc.read_template(template_paths()[template]).bind({"p": 1, "q": 1, "r": 1})
    with within(20), pytest.raises(NotASolidError, match=FLAT):
        compile_equation(equation)


def test_cut_that_leaves_nothing_in_python():
    assert_refused(frustum(1, 1, 1), NotASolidError, FLAT)


@pytest.mark.parametrize("name", ["p", "q", "r"])
def test_cut_off_pyramid_without_height(name):
    equation = pc.read_template(template_paths()["pyramid_cut_off"]).bind({name: 0})
    with within(20), pytest.raises(NotASolidError, match=FLAT):
        compile_equation(equation)


def test_truncated_pyramid_without_height():
    template = pc.read_template(template_paths()["pyramid_truncated"])
    with pytest.raises(EmptyDomainError, match="the domain of w runs from 0 to 0"):
        template.bind({"t": 0})


@pytest.mark.parametrize("missing", ["u", "v", "w"])
def test_parameter_that_moves_nothing(missing):
    u, v, w = pc.parameters()
    known = {"u": (v, w, v * w), "v": (u, w, u * w), "w": (u, v, u * v)}
    assert_refused(known[missing], NotASolidError, FLAT)


@pytest.mark.parametrize("section", ["(u*w, v*w, u*w + v*w)", "(sin, cos)"])
def test_flat_images_of_other_maps(section):
    u, v, w = pc.parameters()
    if section == "(sin, cos)":
        x, y = (1 + w) * pc.cos(u + v), (1 + w) * pc.sin(u + v)
        equation = (x, y, x / 3 - y / 7)
    else:
        equation = ((1 + u) * w, (2 + v) * w, ((1 + u) / 3 + (2 + v) / 7) * w)
    assert_refused(equation, NotASolidError, FLAT)


# -- undefined normals -----------------------------------------------------------------------------


@pytest.mark.parametrize("guide", GUIDES)
def test_normal_towards_a_point_of_the_guide(guide):
    """N(0) = B, so that the foot construction is 0/0 there."""
    error = assert_refused(pipe(2, 0.4, guide, "B"), NotASolidError, "u=0")
    assert "normal that is undefined" in str(error)


def test_normal_towards_a_point_of_the_guide_in_a_template():
    text = template_paths()["channel_ellipse"].read_text(encoding="utf-8")
    text = text.replace('E = "D"', 'E = "B"')
    with within(20), pytest.raises(NotASolidError, match="no finite value on the side u=0"):
        compile_equation(parse_template(text, "undefined").bind())


@pytest.mark.parametrize("reference", ["A", "C", "D"])
def test_normal_towards_other_points_is_defined(reference):
    part = pc.compile_part(pipe(2, 0.4, "G1", reference))
    # the wall area times the guide's length, whatever the frame
    assert part.report.solid.volume == pytest.approx(101.12719293008, rel=1e-7)


# -- values outside their ranges -------------------------------------------------------------------

OUTSIDE = [
    ("pyramid_cut", "p", 2, "from 0 to 1"), ("pyramid_cut", "q", -0.01, "from 0 to 1"),
    ("pyramid_cut", "r", "1 + 1/1000000", "from 0 to 1"), ("pyramid_sum", "p", 5, "from 0 to 1"),
    ("pyramid_cut_off", "p", -1, "from 0 to 1"), ("pyramid_truncated", "t", 1.5, "from 0 to 1"),
    ("channel_ellipse", "a", 0, "from 0.01 to 1000"), ("channel_ellipse", "s", 2, "from 0 to 1"),
    ("channel_sine", "h", -0.3, "from 0 to 1000"), ("channel_sine", "n", 0, "from 1 to 100"),
    ("channel_contour", "delta", 0, "from 0.001 to 1000"),
]  # fmt: skip


@pytest.mark.parametrize(("template", "name", "value", "allowed"), OUTSIDE)
def test_values_outside_their_range(template, name, value, allowed):
    read = pc.read_template(template_paths()[template])
    with pytest.raises(ParameterRangeError) as caught:
        read.bind({name: value})
    text = str(caught.value)
    assert re.search(rf"parameter {name} = [-\d.e]+ is outside its range: {allowed}", text)
    assert isinstance(caught.value, InputError)
    assert caught.value.exit_code == 2


def test_a_wave_that_does_not_close_is_no_channel():
    """With 7.3 waves the sides v = 0 and v = 1 lie on one ray and do not meet."""
    equation = pc.read_template(template_paths()["channel_sine"]).bind({"n": 7.3})
    with within(20), pytest.raises(NotASolidError, match=r"v = 0, .* v = 1, .* both lie at"):
        compile_equation(equation)


def test_a_sum_of_points_is_no_point():
    text = template_paths()["pyramid_sum"].read_text(encoding="utf-8")
    with pytest.raises(InputError, match=r"\[solid\] M.*sum to 2"):
        parse_template(text.replace('"M1 + M2 - D"', '"M1 + M2"'), "sum")


def test_a_sum_of_points_in_python():
    with pytest.raises(WeightsDoNotSumError, match="sum to 2"):
        pc.compile_part(pyramid() + frustum(1, 1, 0))


@pytest.mark.parametrize("tolerance", [0, -1e-6, float("nan"), float("inf")])
def test_tolerances_that_are_no_length(tolerance):
    with pytest.raises(InputError, match="tolerance must be a positive length"):
        pc.compile_part(pyramid(), tolerance=tolerance)


def rising(x, start):
    return pc.maximum(x - Fraction(start), 0)


U, V, W = pc.parameters()


@pytest.mark.parametrize(
    ("height", "where"),
    [
        (W * rising(U, "1/4"), "u = 0 to 0.25"),
        (pc.minimum(W, Fraction(1, 2)), "w = 0.5 to 1"),
        (W * (rising(U, "1/2") + rising(V, "1/4")), "u = 0 to 0.5, v = 0 to 0.25"),
    ],
)
def test_a_flat_piece_is_named(height, where):
    with pytest.raises(FlatMapError, match=f"zero all over {where}: that part .* is flat"):
        pc.compile_part((U, V, height))


def test_a_face_that_the_checker_refuses_is_named():
    """Both edges of v=0 leave the corner upwards, and are 1e-7 apart where they are 5e-5 long."""
    with pytest.raises(SolidNotValidError, match="invalid: so are, by themselves, its faces v=0;"):
        pc.compile_part((U, V, W * (pc.sin(U) + V) + pc.sqrt(U)))
