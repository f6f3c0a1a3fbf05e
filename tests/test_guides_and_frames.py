"""Guides and frames against closed forms, the reference table and an independent discrete frame."""

from __future__ import annotations

import functools
from collections import Counter
from fractions import Fraction
from math import pi, sqrt, tan

import numpy as np
import pytest
from reference import channel
from scipy.special import ellipk

import pc2cad as pc
from pc2cad.channels import guide_functions
from pc2cad.channels.frames import Frame
from pc2cad.channels.guides import Guide, GuideError
from pc2cad.channels.normals import FrameError, ReferenceAlongTangentError
from pc2cad.compiler import compile_equation
from pc2cad.domain.analysis import analyse
from pc2cad.equation.points import Combination
from pc2cad.errors import InputError, NotASolidError
from pc2cad.integrals.mass_properties import MassProperties, integrate
from pc2cad.templates.file import parse_template

u, v, w = pc.parameters()
SIMPLEX = {
    "G1": dict(A=(10, 0, 0), B=(0, 10, 0), C=(0, 0, 10), D=(0, 0, 0)),
    "G2": dict(A=(9, 1, 2), B=(-2, 8, 1), C=(1, -1, 11), D=(1, 2, -1)),
}
LENGTH = {"G1": 20.1186157947867914, "G2": 19.4856594121794608}
P6 = [(2, 0), (1, 1.5), (-1, 1.8), (-2.2, 0.2), (-1.2, -1.4), (0.8, -1.7)]


def paper(name: str) -> tuple[Combination, dict[str, Combination]]:
    A, B, C, D = pc.points(**SIMPLEX[name])
    return (A - D) * u**3 + (B - D) * (1 - u) ** 3 + (C - D) * pc.sin(u) + D, dict(
        A=A, B=B, C=C, D=D
    )


@functools.cache
def frames_of(name: str) -> dict[str, Frame]:
    N, p = paper(name)
    return {
        "E=D": pc.frame(N, "point", p["D"]),
        "E=A": pc.frame(N, "point", p["A"]),
        "C-D": pc.frame(N, "direction", p["C"] - p["D"]),
        "frenet": pc.frame(N, "frenet"),
        "rmf": pc.frame(N, reference=p["D"]),
    }


def integrals(frame: Frame | Guide, section, wall=None, **options) -> MassProperties:
    return integrate(analyse(pc.channel(frame, section, wall, **options)))


def vectors(frame: Frame, places: np.ndarray) -> np.ndarray:
    """Unit tangent, normal, binormal: (3, 3, n)."""
    N = frame.N
    speed = pc.diff(N, u)
    roots = [c for e in (speed, frame.normal, frame.binormal) for c in e.coordinates]
    found = guide_functions.values(roots, places).reshape(3, 3, -1)
    found[0] /= np.linalg.norm(found[0], axis=0)
    return found


# -- the reference table ---------------------------------------------------------------------------

#: what carries the section: the table's frames and the rotation-minimising one
FRAMES = ("E=D", "E=A", "C-D", "frenet", "rmf")
#: 8a on G1: S per frame
AREAS = {"E=D": 419.360532, "E=A": 418.887043, "C-D": 419.185449, "frenet": 419.690207,
         "rmf": 418.849169}  # fmt: skip
#: 8c on G1: V per frame
VOLUMES = {"E=D": 72.744215, "C-D": 73.273377, "frenet": 73.680191}
#: circle of radius 2, wall 0.4: w = 0, w = 1, centroid
CIRCLE = {
    "G1": (227.5361840927, 278.0997805577, (2.634672877, 2.755467049, 4.508157004)),
    "G2": (220.3776160548, 269.3504196225, (2.526134353, 1.680711729, 6.057659483)),
}
#: case -> section, wall, area of the wall's section where it has its centroid on the guide
CASES = {
    "8a": (pc.ellipse(2, 1.2, v), 0.4, 0.4 * 4 * 1.2 * ellipk(1 - 0.36)),
    "8b": (pc.sine_wave(2, 0.3, 7, v), 0.3, 1.2 * pi),
    "8c": (pc.contour(P6, v), 0.3, None),
    "circle": (pc.ellipse(2, 2, v), 0.4, 1.6 * pi),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("kind", FRAMES)
@pytest.mark.parametrize("name", SIMPLEX)
def test_every_row_of_the_table_in_every_frame(name, kind, case):
    """Against the table, and against an evaluation that shares no code with the compiler."""
    section, wall, symmetric = CASES[case]
    found = integrals(frames_of(name)[kind], section, wall)
    expected = channel(case, name, kind=kind).integrals(48, 240)
    assert found.volume == pytest.approx(expected.volume, rel=1e-11)
    assert found.area == pytest.approx(expected.area, rel=1e-11)
    assert sorted(found.face_areas) == pytest.approx(sorted(expected.areas.values()), rel=1e-11)
    assert found.centroid == pytest.approx(expected.centroid, abs=1e-11)
    if symmetric is not None:
        assert found.volume == pytest.approx(symmetric * LENGTH[name], rel=1e-12)
    if (name, case) == ("G1", "8a"):
        assert found.area == pytest.approx(AREAS[kind], abs=6e-7)
    if (name, case) == ("G1", "8c") and kind in VOLUMES:
        assert found.volume == pytest.approx(VOLUMES[kind], abs=6e-7)
    if case == "circle":
        inner, outer, centroid = CIRCLE[name]
        assert found.area == pytest.approx(8 * pi * LENGTH[name] + 3.2 * pi, rel=1e-12)
        assert sorted(found.face_areas)[-2:] == pytest.approx([inner, outer], abs=6e-11 * outer)
        assert found.centroid == pytest.approx(centroid, abs=6e-10)


UNEVEN = (pc.superellipse(2, 1, 4, v), 0.3 + 0.1 * pc.cos(4 * pi * v))


@functools.cache
def area_of_uneven() -> float:
    return integrals(pc.polyline([(0, 0, 0), (0, 0, 1)]), *UNEVEN).volume


@pytest.mark.parametrize("kind", FRAMES)
def test_volume_of_any_centrally_symmetric_wall_is_area_times_length(kind):
    bent = integrals(frames_of("G2")[kind], *UNEVEN)
    assert bent.volume == pytest.approx(area_of_uneven() * LENGTH["G2"], rel=1e-10)


# -- the rotation-minimising frame -----------------------------------------------------------------


def double_reflection(points: np.ndarray, tangents: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Normals (n, 3) after Wang, Jüttler, Zheng and Liu 2008, fourth order."""
    normals = [start]
    for i in range(len(points) - 1):
        first = points[i + 1] - points[i]
        square = first @ first
        r = normals[-1] - 2 * (first @ normals[-1]) / square * first
        t = tangents[i] - 2 * (first @ tangents[i]) / square * first
        second = tangents[i + 1] - t
        normals.append(r - 2 * (second @ r) / (second @ second) * second)
    return np.array(normals)


@pytest.mark.parametrize("name", SIMPLEX)
def test_rotation_minimising_frame_against_double_reflection(name):
    frame = frames_of(name)["rmf"]
    places = np.linspace(0, 1, 1025)
    tangent, normal, binormal = vectors(frame, places)
    points = guide_functions.values(frame.N.coordinates, places).T
    discrete = double_reflection(points, tangent.T, normal[:, 0])
    assert np.abs(discrete - normal.T).max() < 1e-11
    assert np.abs(np.cross(tangent.T, normal.T) - binormal.T).max() < 1e-14
    assert np.abs(np.linalg.norm(normal, axis=0) - 1).max() < 1e-14


@pytest.mark.parametrize(
    ("name", "kind", "turn"),
    [("G1", "E=A", -0.394), ("G1", "E=D", 0.870), ("G1", "C-D", 0.870), ("G1", "frenet", -2.271),
     ("G2", "E=A", -0.405), ("G2", "E=D", 0.822), ("G2", "frenet", -2.320)],
)  # fmt: skip
def test_turning_of_other_frames_against_it(name, kind, turn):
    both = [vectors(frames_of(name)[k], np.array([0.0, 1.0])) for k in (kind, "rmf")]

    def angle(i: int) -> float:
        (_, e1, _), (_, r1, r2) = both[0][..., i], both[1][..., i]
        return np.arctan2(e1 @ r2, e1 @ r1)

    assert (angle(1) - angle(0) - turn + pi) % (2 * pi) - pi == pytest.approx(0, abs=6e-4)


def test_twist_turns_the_frame_by_the_angle_asked_for():
    N, p = paper("G1")
    plain, twisted = (pc.frame(N, reference=p["D"], twist=t) for t in (0, 3 * u**2))
    places = np.linspace(0, 1, 7)
    _, e1, e2 = vectors(plain, places)
    _, t1, _ = vectors(twisted, places)
    assert np.abs(np.cos(3 * places**2) * e1 + np.sin(3 * places**2) * e2 - t1).max() < 1e-14
    assert "a twist of its own" in twisted.words


# -- closed guides ---------------------------------------------------------------------------------

T = 2 * pi * u
TREFOIL = pc.point(
    10 * (pc.sin(T) + 2 * pc.sin(2 * T)), 10 * (pc.cos(T) - 2 * pc.cos(2 * T)), -10 * pc.sin(3 * T)
)
SKEW = [(0, 0, 0), (12, 0, 0), (12, 12, 5), (-3, 12, 0)]


@pytest.mark.parametrize(
    "guide", [pc.guide(TREFOIL), pc.spline(SKEW, closed=True), pc.polyline(SKEW, 3, closed=True)],
    ids=["trefoil", "spline", "polyline"],
)  # fmt: skip
def test_frame_of_a_closed_guide_closes_and_turns_evenly(guide):
    assert guide.closed
    frame = pc.frame(guide)
    assert "spread evenly over the length" in frame.words
    ends = vectors(frame, np.array([0.0, 1.0]))
    assert np.abs(ends[..., 0] - ends[..., 1]).max() < 1e-13
    # the rate of turning per length is the same everywhere
    places = (np.arange(40) + 0.37) / 40
    roots = [*frame.normal.coordinates, *pc.diff(frame.N, u).coordinates]
    step = 1e-5
    below, here, above = (guide_functions.values(roots, places + h) for h in (-step, 0, step))
    speed = np.linalg.norm(here[3:], axis=0)
    side = np.cross(here[3:] / speed, here[:3], axis=0)
    rates = ((above[:3] - below[:3]) / (2 * step) * side).sum(axis=0) / speed
    assert np.ptp(rates) < 1e-6 * np.abs(rates).max() + 1e-8


@pytest.mark.parametrize("symmetry", [2, 3, 5])
def test_closing_to_the_nearest_symmetry_of_the_section(symmetry):
    whole, near = (pc.frame(TREFOIL, symmetry=k) for k in (1, symmetry))
    ends = vectors(near, np.array([0.0, 1.0]))
    angle = 2 * pi * near.shift
    turned = ends[1, :, 0] * np.cos(angle) + ends[2, :, 0] * np.sin(angle)
    assert np.abs(turned - ends[1, :, 1]).max() < 1e-13
    assert near.shift * symmetry == pytest.approx(round(near.shift * symmetry))
    added = [float(f.words.split("closed by ")[1].split()[0]) for f in (whole, near)]
    # printed with some digits: the nearest angle that closes the section, not the whole one
    step = 2 * pi / symmetry
    nearest = added[0] - step * round(added[0] / step)
    assert added[1] == pytest.approx(nearest, abs=1e-3)


@pytest.mark.slow
def test_solid_that_closes_after_a_third_of_a_turn():
    """Glued with a shift: two shells, and the volume of the wall times the length."""
    frame = pc.frame(TREFOIL, symmetry=3)
    assert frame.shift
    equation = pc.channel(frame, pc.sine_wave(3, 0.4, 3, v), 0.5)
    part = compile_equation(equation, tolerance=1e-4)
    assert part.report.genus == (1, 1)
    assert part.report.frame.startswith("rotation-minimising")
    speed = pc.length(pc.diff(TREFOIL, u))
    length = guide_functions.antiderivative(guide_functions.function(speed), (0, 1)).total
    assert part.report.equation.volume == pytest.approx(3 * pi * length, rel=1e-11)
    assert part.report.solid.volume == pytest.approx(3 * pi * length, rel=1e-5)


# -- guides ----------------------------------------------------------------------------------------


def test_spline_reproduces_a_cubic_and_passes_through_its_points():
    places = np.array([0, 0.3, 0.5, 0.6, 1])
    cubic = np.stack((places, places**3 - places, 2 * places**2), axis=1)
    shares = [Fraction(float(p)) for p in places]
    from pc2cad.expression.interpolation import cubic_rows

    _, axes = cubic_rows(cubic, shares, closed=False)
    assert np.array(axes[1])[:, 3] == pytest.approx(1)
    assert np.array(axes[2])[:, 3] == pytest.approx(0, abs=1e-12)
    for closed in (False, True):
        for spacing in ("uniform", "centripetal", "chord"):
            guide = pc.spline(SKEW, closed, spacing)
            (x, *_) = guide.N.coordinates
            inner = [float(b) for b in x.payload.breaks]
            found = guide_functions.values(guide.N.coordinates, np.array(inner)).T
            wanted = [*SKEW, SKEW[0]] if closed else SKEW
            assert np.abs(found - wanted).max() < 1e-13
            jumps = [
                guide_functions.values(
                    pc.diff(guide.N, u, 2).coordinates, np.array(inner[1:-1]) + h
                )
                for h in (-1e-14, 0)
            ]
            assert np.abs(jumps[0] - jumps[1]).max() < 1e-9


def test_short_splines():
    for points in (SKEW[:2], SKEW[:3]):
        found = guide_functions.values(pc.spline(points).N.coordinates, np.array([0.0, 1.0])).T
        assert found == pytest.approx(np.array([points[0], points[-1]]))


def test_polyline_with_fillets_has_the_length_of_its_lines_and_arcs():
    guide = pc.polyline([(0, 0, 0), (10, 0, 0), (10, 8, 0), (10, 8, 6)], [2, 1.5])
    length = 24 - 2 * 3.5 + pi / 2 * 3.5
    speeds = guide_functions.values([pc.length(pc.diff(guide.N, u))], np.linspace(0.001, 0.999, 50))
    assert speeds == pytest.approx(length, rel=1e-13)
    found = integrals(guide, pc.ellipse(0.5, 0.3, v))
    assert found.volume == pytest.approx(pi * 0.15 * length, rel=1e-13)


def test_straight_corner_and_acute_corner():
    straight = pc.polyline([(0, 0, 0), (5, 0, 0), (10, 0, 0)], 1)
    assert len(straight.parts) == 2
    acute = pc.polyline([(0, 0, 0), (10, 0, 0), (0, 4, 0)], 0.5)
    angle = pi - np.arctan2(4, 10)
    side = sqrt(116)
    length = 10 + side - 2 * 0.5 * tan(angle / 2) + 0.5 * angle
    found = integrals(acute, pc.ellipse(0.2, 0.2, v))
    assert found.volume == pytest.approx(pi * 0.04 * length, rel=1e-13)


ROUND = {
    "straight": (pc.polyline([(1, 2, 3), (4, 6, 3)]), {"cylinder": 2, "plane": 2}, 5),
    "arc": (pc.guide(pc.point(6 * pc.cos(u), 6 * pc.sin(u), 0)), {"torus": 2, "plane": 2}, 6),
    "tilted arc": (
        pc.guide(pc.point(6 * pc.cos(u), 3.6 * pc.sin(u), 4.8 * pc.sin(u))),
        {"torus": 2, "plane": 2}, 6,
    ),
    "circle": (
        pc.guide(pc.point(6 * pc.cos(2 * pi * u), 0, 6 * pc.sin(2 * pi * u))),
        {"torus": 2}, 12 * pi,
    ),
    "filleted polyline": (
        pc.polyline([(0, 0, 0), (10, 0, 0), (10, 8, 0), (10, 8, 6)], [3, 2]),
        {"cylinder": 6, "torus": 4, "plane": 2}, 24 - 10 + 2.5 * pi,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ROUND)
def test_round_pipes_are_cylinders_and_tori(name):
    guide, carriers, length = ROUND[name]
    report = compile_equation(pc.channel(guide, pc.ellipse(1, 1, v), 0.5)).report
    assert Counter(face.carrier for face in report.faces) == carriers
    assert report.evidence == "exact"
    assert report.solid.volume == pytest.approx(pi * length, rel=1e-12)
    pipes = [face for face in report.faces if face.carrier != "plane"]
    radii = sorted({round(min(face.figures.values()), 12) for face in pipes})
    assert radii == [0.75, 1.25]


@pytest.mark.slow
def test_a_spring_of_a_hundred_turns():
    guide = pc.helix(10, 3, 100)
    report = compile_equation(pc.channel(guide, pc.ellipse(1, 1, v)), tolerance=1e-3).report
    assert report.genus == (0,)
    length = 100 * sqrt((20 * pi) ** 2 + 9)
    assert report.equation.volume == pytest.approx(pi * length, rel=1e-12)
    assert report.equation.area == pytest.approx(2 * pi * (length + 1), rel=1e-12)
    assert report.solid.volume == pytest.approx(pi * length, rel=1e-4)


def test_mitred_duct_is_exact_and_has_the_volume_of_its_straight_pieces():
    guide = pc.polyline([(0, 0, 0), (10, 0, 0), (10, 8, 0), (10, 8, 6)], corners="mitre")
    duct = pc.polygon([(2, 1), (-2, 1), (-2, -1), (2, -1)], v)
    part = compile_equation(pc.channel(guide, duct, 0.4, measured="normal"))
    assert part.report.evidence == "exact"
    assert {face.carrier for face in part.report.faces} == {"plane"}
    assert part.report.solid.volume == pytest.approx(24 * 4.8, rel=1e-12)


def test_helix_and_its_frame():
    rise = 3 / (2 * pi)
    length = 4 * pi * sqrt(16 + rise**2)
    found = integrals(pc.helix(4, 3, 2), pc.ellipse(0.75, 0.75, v), 0.5)
    assert found.volume == pytest.approx(0.75 * pi * length, rel=1e-12)
    assert pc.frame(pc.helix(4, 3, 2)).words == "rotation-minimising"
    conic = pc.helix(4, 3, 2, end_radius=2)
    ends = guide_functions.values(conic.N.coordinates, np.array([0.0, 1.0])).T
    assert ends == pytest.approx(np.array([[4, 0, 0], [2, 0, 6]]), abs=1e-14)


def test_composite_of_a_line_an_arc_and_a_spline():
    line = pc.guide(pc.point(10 * u, 0, 0))
    quarter = pi / 2 * u
    arc = pc.guide(pc.point(10 + 5 * pc.sin(quarter), 5 - 5 * pc.cos(quarter), 0))
    guide = pc.composite(line, arc, pc.guide(pc.point(15, 5 + 3 * u, 2 * u**2)))

    tail = guide_functions.antiderivative(lambda x: np.sqrt(9 + 16 * x**2), (0, 1)).total
    assert float(guide.breaks[1]) == pytest.approx(10 / (10 + 2.5 * pi + tail))
    found = integrals(guide, pc.ellipse(1, 1, v), 0.2)
    assert found.volume == pytest.approx(0.4 * pi * (10 + 2.5 * pi + tail), rel=1e-11)
    with pytest.raises(GuideError, match="part 2 of the guide begins 10 from the end of part 1"):
        pc.composite(line, line)
    with pytest.raises(GuideError, match="parts 1 and 2 of the guide meet in a corner"):
        pc.composite(line, pc.guide(pc.point(10, u, 0)))


def test_mitred_composite_of_a_template():
    text = 'title = "t"\n[guide]\nkind = "composite"\nparts = [{ N = "[4*u, 0, 0]" }, '
    text += '{ kind = "polyline", points = [[4, 0, 0], [4, 3, 0]] }]\nCORNERS\n[frame]\n[solid]\n'
    text += 'M = "N + (R-N)*v + (Q-N)*w"\n'
    with pytest.raises(InputError, match="meet in a corner of 90 degrees"):
        parse_template(text.replace("CORNERS", ""), "t")
    equation = parse_template(text.replace("CORNERS", 'corners = "mitre"'), "t").bind()
    report = compile_equation(equation).report
    assert {face.carrier for face in report.faces} == {"plane"}
    # the square's centre runs half a unit beside the guide, round the corner's in- or outside
    assert min(abs(report.solid.volume - x) for x in (6, 7, 8)) < 1e-12


# -- refusals --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: ("point", p["B"]), "undefined at u = 0: the fixed point lies on the tangent"),
        (lambda p: ("direction", pc.diff(paper("G1")[0], u).substitute({"u": pc.pi / 9})),
         r"undefined at u = 0\.349066: the fixed direction lies along the tangent there"),
    ],
)  # fmt: skip
def test_reference_along_the_tangent_is_refused_with_its_place(make, message):
    N, p = paper("G1")
    kind, reference = make(p)
    with pytest.raises(ReferenceAlongTangentError, match=message):
        pc.frame(N, kind, reference)


def test_frenet_is_refused_at_an_inflection_and_the_default_is_not():
    N = pc.point(u, (u - Fraction(1, 3)) ** 3, 0)
    with pytest.raises(ReferenceAlongTangentError, match=r"u = 0\.33333.: the guide is straight"):
        pc.frame(N, "frenet")
    pc.frame(N)


@pytest.mark.parametrize("sine", [0.9e-3, 1.1e-3])
def test_the_least_sine_is_sharp(sine):
    """The tangent runs along (1, 0, 0) at u = 1/2."""
    N = pc.point(u, (u - 0.5) ** 2, 0)
    direction = pc.vector(1, 0, sine)
    if sine > 1e-3:
        pc.frame(N, "direction", direction)
        return
    with pytest.raises(ReferenceAlongTangentError, match=r"at u = 0\.5: .*sine 0\.0009"):
        pc.frame(N, "direction", direction)


@pytest.mark.parametrize("guide", [functools.partial(pc.polyline, radius=1), pc.spline])
def test_a_guide_that_comes_back_is_told_how_to_close(guide):
    corners = [(0, 0, 0), (10, 0, 0), (10, 10, 0)]
    with pytest.raises(NotASolidError, match=r"ends at its first point: .* say closed = true"):
        compile_equation(pc.channel(guide([*corners, corners[0]]), pc.ellipse(0.2, 0.1, v)))


def test_three_numbers_are_a_guide_a_direction_and_a_fixed_point():
    N = (10 * pc.cos(u), 10 * pc.sin(u), 3 * u)
    pairs = [
        (pc.frame(N), pc.frame(pc.point(*N))),
        (pc.frame(N, "direction", (0, 0, 1)), pc.frame(N, "direction", pc.vector(0, 0, 1))),
        (pc.frame(N, reference=[0, 1, 1]), pc.frame(N, reference=pc.vector(0, 1, 1))),
        (pc.frame(N, "point", np.zeros(3)), pc.frame(N, "point", pc.point(0, 0, 0))),
    ]
    assert len(pairs) == 4
    for short, long in pairs:
        assert short.N.coordinates == long.N.coordinates
        assert short.normal.coordinates == long.normal.coordinates


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: pc.guide(pc.vector(u, 0, 0)), GuideError, "a guide is a point"),
        (lambda: pc.channel(SKEW, pc.ellipse(1, 1, v)), GuideError, r"runs spline\(points\)"),
        (lambda: pc.guide((1, 2)), GuideError, "a point N\\(u\\) or its three coordinates"),
        (lambda: pc.frame(pc.spline(SKEW), "point", (1, 2)), InputError, "a point is point"),
        (lambda: pc.guide(pc.point(1, 0, 0)), GuideError, "depends on u, and this one does not"),
        (lambda: pc.guide(pc.point(u, v, 0)), GuideError, "on u alone, not on v"),
        (lambda: pc.spline([(0, 0, 0)]), GuideError, "at least 2 points"),
        (lambda: pc.spline([(0, 0, 0), (0, 0, 0), (1, 0, 0)]), GuideError, "point 1 .* point 2"),
        (lambda: pc.spline(SKEW, spacing="even"), GuideError, "the spacing is one of"),
        (lambda: pc.polyline(SKEW), GuideError, "a corner at point 2 and no radius"),
        (lambda: pc.polyline(SKEW, 8), GuideError, "from point 2 to point 3 is 13 long"),
        (lambda: pc.polyline(SKEW, [1, 2, 3]), GuideError, "has 2 corners, and 3 radii"),
        (lambda: pc.polyline([(0, 0, 0), (1, 0, 0), (0.5, 0, 0)], 1), GuideError, "turns back"),
        (lambda: pc.frame(TREFOIL, "point"), FrameError, "takes a fixed point"),
        (lambda: pc.frame(TREFOIL, "frame"), FrameError, "the kind of a frame is one of"),
        (lambda: pc.frame(TREFOIL, twist=v), FrameError, "depends on u alone"),
    ],
)
def test_what_is_no_guide_or_frame_is_refused(make, error, message):
    with pytest.raises(error, match=message):
        make()
