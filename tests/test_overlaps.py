"""Boundaries that meet themselves are refused however little they do, and near misses are built."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.bounds.known import Known
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import Place
from pc2cad.checked import Stages
from pc2cad.compiler import compile_solid
from pc2cad.domain.analysis import analyse
from pc2cad.equation.point_equation import PointEquation, point_equation
from pc2cad.errors import PointCadError, ToleranceNotReachedError
from pc2cad.expression.tree import symbol
from pc2cad.solidity import continuity, solidity
from pc2cad.solidity.cell_table import CellTable
from pc2cad.solidity.continuity import is_continuous
from pc2cad.solidity.embedding.verdict import BuiltFacesMeetError
from pc2cad.solidity.face_mesh import cut
from pc2cad.solidity.injectivity import OverlappingMapError, check_injective, material_shell
from pc2cad.solidity.near_parts import told_number
from pc2cad.solidity.orientation import find_orientation
from pc2cad.solidity.overlap_depth import overlap_depth
from pc2cad.solidity.self_intersection import Contact, find_contact
from pc2cad.solidity.solidity import Question
from pc2cad.templates.file import parse_template, read_template
from pc2cad.templates.shipped import template_paths

U, V, W = pc.parameters()
THETA, PHI = 2 * pc.pi * U, 2 * pc.pi * V


def contact(map_, domain=None) -> Contact | None:
    """Where the boundary meets itself; the two places are one, to a billionth of the part."""
    analysis = analyse(point_equation(map_, domain))
    face_meshes = cut(analysis)
    found = find_contact(analysis, face_meshes)
    if not isinstance(found, Contact):
        assert 0 < found.apart < 1e-8 * analysis.size
        return None
    points = [
        face_meshes[face].function.at(*map(np.asarray, place))
        for face, place in zip(found.faces, found.places, strict=True)
    ]
    assert np.abs(np.subtract(*points)).max() <= 1e-8 * analysis.size
    assert found.point == pytest.approx(points[0], abs=1e-8 * analysis.size)
    return found


def helix(R: float, pitch: float, turns: int, rho):
    """A helix of radius R with a round section of radius rho in its frame."""
    t, c = 2 * pc.pi * turns * U, pitch / (2 * math.pi)
    x, y = rho * pc.cos(PHI), rho * pc.sin(PHI) / math.hypot(R, c)
    return (
        (R - x) * pc.cos(t) + y * c * pc.sin(t),
        (R - x) * pc.sin(t) - y * c * pc.cos(t),
        c * t + y * R,
    )


def touching_pitch(R: float, rho: float) -> float:
    """Where the axes of neighbouring turns are 2 rho apart: by bisection, to all digits."""

    def nearest(pitch: float) -> float:
        c = pitch / (2 * math.pi)
        low, high = math.pi, 2.5 * math.pi
        for _ in range(200):  # the slope of the squared distance changes its sign once
            t = (low + high) / 2
            if R * R * math.sin(t) + c * c * t > 0:
                high = t
            else:
                low = t
        return math.sqrt(2 * R * R * (1 - math.cos(low)) + (c * low) ** 2)

    low, high = rho, 4 * rho
    for _ in range(200):
        pitch = (low + high) / 2
        low, high = (low, pitch) if nearest(pitch) > 2 * rho else (pitch, high)
    return low


def test_overlaps_of_every_depth_are_seen():
    """However many pairs of cells are left when the nearest of them have been parted."""
    for share in (0.986, 0.99, 0.992, 0.994, 0.9985):
        assert contact(helix(3, share * touching_pitch(3, 0.5), 2, W / 2)) is not None, share


@pytest.mark.parametrize("share", [0.9, 0.96, 0.99, 0.999, 0.9999, 1.0001, 1.001, 1.01, 1.1])
def test_turns_of_a_rod_at_their_touching_pitch(share):
    found = contact(helix(4, share * touching_pitch(4, 1), 2, W))
    assert (found is not None) == (share < 1)


@pytest.mark.parametrize("share", [0.999, 1.01])
def test_thirty_turns_of_a_tube(share):
    """The report of an accepted one says less than a ten-millionth of the tube."""
    rho = Fraction(1, 2) + W / 2
    found = contact(helix(4, share * touching_pitch(4, 1), 30, rho))
    assert (found is not None) == (share < 1)


def eight(height: float):
    """A rod of radius 1 along a figure of eight whose strands cross `height` apart."""
    t = 2 * pc.pi * U
    dx, dy = pc.cos(t), pc.cos(2 * t)
    speed = pc.sqrt(dx * dx + dy * dy)
    return (
        10 * pc.sin(t) - W * pc.cos(PHI) * dy / speed,
        10 * pc.sin(t) * pc.cos(t) + W * pc.cos(PHI) * dx / speed,
        height / 2 * pc.cos(t) + W * pc.sin(PHI),
    )


@pytest.mark.parametrize("height", [1.5, 1.8, 1.9, 1.98, 1.999, 2.0, 2.001, 2.1])
def test_crossing_strands(height):
    found = contact(eight(Fraction(str(height))))
    assert (found is not None) == (height <= 2)
    if height == 2:  # they touch in the origin
        assert found.point == pytest.approx((0, 0, 0), abs=1e-3)


def torus(R, r):
    ring = R + r * pc.cos(PHI)
    return ring * pc.cos(THETA), ring * pc.sin(THETA), r * pc.sin(PHI)


def test_horn_torus_touches_itself_in_a_point():
    with pytest.raises(OverlappingMapError) as caught:
        pc.compile_part(torus(1, W))
    place = re.search(r"both lie at \((.*?)\)", str(caught.value))[1]
    assert [float(x) for x in place.split(",")] == pytest.approx([0, 0, 0], abs=1e-6)


def test_nearly_a_horn_torus():
    r = Fraction(999, 1000)
    report = pc.compile_part(torus(1, r * W)).report
    assert report.solid.volume == pytest.approx(2 * math.pi**2 * float(r) ** 2, rel=1e-7)
    assert 0 < report.contact_clearance < 1e-8 * report.size


RING = ((2 + V) * pc.cos(THETA), (2 + V) * pc.sin(THETA), 5 * W)


@pytest.mark.parametrize(("turn", "refused"), [("0.999", False), ("0.99999", False),
                                               ("1.001", True), ("1.25", True)])  # fmt: skip
def test_ring_that_nearly_closes_or_covers_itself(turn, refused):
    assert (contact(RING, {"u": (0, Fraction(turn))}) is not None) == refused


def test_two_blocks_that_touch_along_a_curved_face():
    """A spiral of one turn and a half whose wall is as thick as its pitch."""

    def spiral(thickness):
        t = 3 * pc.pi * U
        r = 2 + t / (2 * pc.pi) + thickness * W
        return r * pc.cos(t), r * pc.sin(t), 3 * V

    assert contact(spiral(1)) is not None
    assert contact(spiral(Fraction(9999, 10000))) is None


@pytest.mark.parametrize("wall", ["0.1", "0.001", "0.0001"])
def test_a_thin_wall_is_no_contact(wall):
    assert contact(ball(10, Fraction(wall))) is None


@pytest.mark.parametrize("waves", [13, pytest.param(40, marks=pytest.mark.slow)])
def test_waves_both_ways_are_seen_whatever_their_number(waves):
    height = 2 + Fraction(1, 50) * pc.sin(2 * pc.pi * waves * U) * pc.sin(2 * pc.pi * waves * V)
    analysis = analyse(point_equation((U, V, W * height)))
    found = check_injective(analysis, 1, cut(analysis))
    assert found.images >= 125


# -- what the refusal says -------------------------------------------------------------------------


def rod(radius: float, pitch: float) -> PointEquation:
    """A rod of 2.2 turns about an axis, 5 away from it, whose sections begin at their top."""
    t = 2 * pc.pi * Fraction(11, 5) * U
    guide = pc.point(5 * pc.cos(t), 5 * pc.sin(t), pitch * Fraction(11, 5) * U)
    frame = pc.frame(guide, "direction", pc.vector(0, 0, 1))
    # its limits would be a quicker reason
    return replace(pc.channel(frame, pc.ellipse(radius, radius, V)), guide=None, frame="")


def test_a_touch_is_told_without_a_depth():
    """Its points have a second place, on the boundary as well, and beside the seam."""
    analysis = analyse(rod(1, touching_pitch(5, 1)))
    face_meshes = cut(analysis)
    found = find_contact(analysis, face_meshes)
    assert isinstance(found, Contact)
    functions = [face_meshes[face].function for face in found.faces]
    assert overlap_depth(analysis, functions, found.places) == 0


def test_built_faces_cross_no_deeper_than_they_deviate():
    """Turns 2e-8 apart: what of the next one is on the other side of the end face is elsewhere."""
    with pytest.raises(BuiltFacesMeetError) as caught:
        pc.compile_equation(rod(1 - 1e-8, touching_pitch(5, 1)), 5e-5)
    text = str(caught.value)
    reach = float(re.search(r"deviate from the equation by up to ([\d.e-]+) mm", text)[1])
    deep = re.search(r"meet, ([\d.e-]+) mm deep", text)
    assert deep is None or float(deep[1]) <= reach
    assert float(re.search(r"equation's are ([\d.e-]+) mm apart", text)[1]) <= reach
    assert float(re.search(r"a tolerance of ([\d.e-]+) mm", text)[1]) < reach


def test_the_period_is_what_mends_a_double_cover():
    with pytest.raises(OverlappingMapError, match=r"shorten the domain of u to \[0, 1\]"):
        pc.compile_part(RING, {"u": (0, Fraction(5, 4))})


@pytest.mark.parametrize(
    ("turns", "limit"), [(U, r"2\*pi"), (3 * pc.pi * U / 7, "14/3"), (2 * U + 1, "pi")]
)
def test_the_period_is_written_as_it_has_to_be_typed(turns, limit):
    """Six digits of 2*pi are more than a turn, and are refused as too close to one."""
    rod = [W * pc.cos(turns), W * pc.sin(turns), V]
    with pytest.raises(OverlappingMapError, match=rf"the domain of u to \[0, {limit}\] at most"):
        pc.compile_part(rod, {"u": (0, 7)})


@pytest.mark.slow
def test_the_largest_section_is_what_mends_a_rod():
    """Of radius 1 at a pitch of 1.8: what touches at 1.8 is 1.8/2.0064 of it."""
    pitch = 1.8
    with pytest.raises(OverlappingMapError) as caught:
        pc.compile_part(helix(4, pitch, 2, W))
    text = str(caught.value)
    assert "covers itself" in text
    assert len(text) < 400
    largest = float(re.search(r"w up to about ([\d.]+)", text)[1])
    low, high = 0.5, 1.0
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if touching_pitch(4, middle) < pitch else (low, middle)
    assert largest == pytest.approx(low, abs=0.01)
    assert largest <= low


@pytest.mark.slow
def test_places_of_a_contact_are_two_places_of_the_equation():
    map_ = helix(4, 1.9, 2, W)
    with pytest.raises(PointCadError) as caught:
        pc.compile_part(map_)
    places = re.findall(r"u = ([-\d.e]+), v = ([-\d.e]+), w = ([-\d.e]+)", str(caught.value))
    point = re.search(r"both lie at \((.*?)\)", str(caught.value))[1]
    expected = [float(x) for x in point.split(",")]
    mapping = analyse(point_equation(map_)).map
    for place in places:
        # printed with four digits
        assert mapping.points(*map(float, place)) == pytest.approx(expected, abs=0.03)
    assert abs(float(places[0][0]) - float(places[1][0])) > 0.1


@pytest.mark.parametrize("place", [1e8, -1e10])
def test_too_far_away_is_said_at_once(place):
    with pytest.raises(PointCadError, match="nearer to the origin"):
        pc.compile_part((V * pc.cos(THETA) + place, V * pc.sin(THETA), W))


def ramp(bump: str, depth: float):
    """Two turns of a ramp whose bump ends `depth` inside the turn above."""
    t = 4 * pc.pi * U
    height = Fraction(str(1.5 + depth))
    gap = (U - Fraction("0.2113")) ** 2 + (V - Fraction("0.5317")) ** 2
    rise = Fraction(1, 2) + height * pc.exp(-int(bump) * gap)
    return (2 + V) * pc.cos(t), (2 + V) * pc.sin(t), t / pc.pi + W * rise


@pytest.mark.parametrize("depth", [1.0, 1e-2, 1e-3, 1e-5, 1e-6, -1e-6, -1e-3])
def test_a_bump_that_reaches_the_next_turn(depth):
    """Between its samples a cell overshoots along its chord as well as beside it."""
    assert (contact(ramp("400", depth)) is not None) == (depth > 0)


@pytest.mark.parametrize("depth", [1e-3, 1e-6])
def test_walls_that_overlap_along_a_whole_turn(depth):
    """The walls are near all the way without crossing: other faces cross them."""
    radius = 2 + (2 - 2 * Fraction(str(depth))) * U + W
    t = 4 * pc.pi * U
    spiral = radius * pc.cos(t), radius * pc.sin(t), V + Fraction("0.3") * pc.sin(2 * pc.pi * U)
    assert contact(spiral) is not None


def test_what_the_effort_leaves_open_is_said():
    """A gap too thin for the pairs that may be followed is a warning with its depth and place."""
    radius = 2 + (2 + Fraction("1e-5")) * U + W
    t = 4 * pc.pi * U
    spiral = radius * pc.cos(t), radius * pc.sin(t), V + Fraction("0.3") * pc.sin(2 * pc.pi * U)
    analysis = analyse(point_equation(spiral))
    sign = find_orientation(analysis.map).sign
    found = check_injective(analysis, sign, cut(analysis), 1000)
    assert 1e-5 < found.apart < 0.1
    assert f"an overlap of up to {found.apart:.2g} mm is not excluded" in found.warning


def ball(r, wall):
    """A hollow ball whose wall is `wall` thick."""
    rho = r + wall * W
    return (rho * pc.sin(pc.pi * V) * pc.cos(THETA), rho * pc.sin(pc.pi * V) * pc.sin(THETA),
            rho * pc.cos(pc.pi * V))  # fmt: skip


@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9, 1e-12, -1e-12, -1e-9, -1e-6, -1e-3])
def test_cells_are_cut_until_a_place_is_told_from_the_boundary(depth: float) -> None:
    analysis = analyse(point_equation(ball(1, 1)))
    table = CellTable(cut(analysis), find_orientation(analysis.map).sign)
    direction = np.array([0.36, 0.48, 0.8])
    for radius in (2 - depth, 1 + depth):
        place = radius * direction
        cells = table.near(place[None], np.full((1, 3), np.nan), 0)
        assert told_number(table, place, cells, 0) == (1 if depth > 0 else 0)


@pytest.mark.parametrize("place", [(0, 0, 2), (0, 0, 1), (0.72, 0.96, 1.6)])
def test_places_of_the_boundary_end_the_cutting(place) -> None:
    """About a pole all parts round it stay near, however small."""
    analysis = analyse(point_equation(ball(1, 1)))
    table = CellTable(cut(analysis), find_orientation(analysis.map).sign)
    at = np.array(place, dtype=float)
    cells = table.near(at[None], np.full((1, 3), np.nan), 0)
    assert told_number(table, at, cells, 0) in (0, 1)


@pytest.mark.slow
@pytest.mark.parametrize("wall", [Fraction(1, 100), Fraction(1, 10**5)])
def test_a_wall_thinner_than_the_finest_mesh_is_no_overlap(wall: Fraction) -> None:
    analysis = analyse(point_equation(ball(1000, wall)))
    sign = find_orientation(analysis.map).sign
    assert check_injective(analysis, sign, cut(analysis)).images > 0


# -- samples that are put off ----------------------------------------------------------------------


def test_nothing_is_left_to_samples_where_the_faces_are_proved_to_meet_nowhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With one shell, with a void, and with layers; a sampled sign of det J is none of these."""
    looked: list[bool] = []

    def look(*given, **more):
        looked.append(True)
        return check_injective(*given, **more)

    monkeypatch.setattr(solidity, "check_injective", look)
    for map_ in (torus(3, W), torus(3, 1 + W), helix(4, 1.1 * touching_pitch(4, 1), 2, W)):
        report = pc.compile_part(map_).report
        assert (report.injectivity, report.images) == ("proved", 0)
        assert 0 < report.contact_clearance < 1e-8 * report.size
    assert looked == []
    shells = analyse(point_equation(torus(3, 1 + W))).boundary.shells
    assert len(shells) == 2
    monkeypatch.setattr("pc2cad.solidity.orientation.proved_sign", lambda *given: 0)
    report = pc.compile_part(torus(3, W)).report
    assert report.injectivity == "sampled"
    assert report.images >= 125
    assert looked == [True]


@pytest.mark.parametrize(
    "map_",
    [
        helix(4, 0.9 * touching_pitch(4, 1), 2, W),
        ramp("400", 1e-3),
        eight(Fraction(2)),  # the strands touch, within what built faces may deviate
    ],
    ids=["rod", "ramp", "strands"],
)
def test_what_samples_refuse_is_refused_in_their_words(map_) -> None:
    equation = point_equation(map_)
    analysis = analyse(equation)
    with pytest.raises(OverlappingMapError) as before:
        Question(analysis, find_orientation(analysis.map), faces=True).answer  # noqa: B018
    told: list[str] = []
    with pytest.raises(OverlappingMapError) as after:
        compile_solid(equation, progress=told.append)
    assert str(after.value) == str(before.value)
    assert told[-4:] == ["solidity", "represent", "embed", "solidity"]


def test_a_void_needs_no_samples_to_be_one() -> None:
    analysis = analyse(point_equation(torus(3, 1 + W)))
    question = Question(analysis, find_orientation(analysis.map), faces=True)
    assert question.can_wait
    assert question.outer_shell == question.answer.outer_shell
    outer = analysis.boundary.shells[question.outer_shell].faces
    assert [analysis.boundary.name(analysis.boundary.faces[f].patch) for f in outer] == ["w=1"]


def test_shells_of_which_two_enclose_material_are_left_to_samples() -> None:
    """Their volumes have the wrong sign where det J has, too."""
    analysis = analyse(point_equation(torus(3, 1 + W)))
    sign = find_orientation(analysis.map).sign
    meshes = cut(analysis)
    assert material_shell(analysis, sign, meshes) is not None
    same = [replace(mesh, shell=1 - mesh.shell) for mesh in meshes]
    assert material_shell(analysis, sign, same) == 1 - material_shell(analysis, sign, meshes)
    one = [mesh for mesh in meshes if mesh.shell == material_shell(analysis, sign, meshes)]
    twice = [*one, *(replace(mesh, shell=1 - mesh.shell) for mesh in one)]
    assert material_shell(analysis, sign, twice) is None


def test_a_check_that_was_put_off_is_made_once_and_has_the_first_word() -> None:
    told: list[str] = []
    stages = Stages(told.append)
    stages.remarks.append(lambda: "the remark")

    def fail(error: Exception) -> None:
        raise error

    stages.put_off("check", lambda: None)
    with pytest.raises(ToleranceNotReachedError, match=r"^too rough$"):
        stages("fit", lambda: fail(ToleranceNotReachedError("too rough")))
    assert told == ["fit", "check"]
    stages.put_off("check", lambda: fail(OverlappingMapError("it overlaps")))
    with pytest.raises(OverlappingMapError, match=r"^it overlaps \(the remark\)$"):
        stages("fit", lambda: fail(ToleranceNotReachedError("too rough")))
    stages.put_off("check", lambda: fail(OverlappingMapError("it overlaps")))
    with pytest.raises(OverlappingMapError, match=r"^it overlaps \(the remark\)$"):
        stages("embed", stages.make_up)
    assert told[2:] == ["fit", "check", "embed", "check"]


@pytest.mark.parametrize(
    ("tree", "proved"),
    [
        (pc.sin(U) * pc.exp(V - W) + abs(U - V), True),
        (U / (1 + V * W), True),
        (pc.sqrt(2 + U - V * W), True),
        ((1 + U) ** Fraction(-3, 2), True),
        (pc.log(1 + U + V), True),
        (pc.asin(U / 2), True),
        (U**3 * (V + 1) ** (-2), True),
        (1 / (U - Fraction(1, 3)), False),
        ((U - Fraction(1, 3)) ** (-2), False),
        (pc.log(U), False),
        (pc.sqrt(U - V), False),
        (pc.floor(U + V), False),
        (pc.atan2(V, U - 2), False),
        (pc.tan(U), False),
        ((U + 1) ** (V - 2), True),
        ((U - 1) ** (V - 2), False),
    ],
)
def test_what_is_made_of_continuous_functions_does_not_jump(tree, proved: bool) -> None:
    coordinates = point_equation((tree, V, W)).coordinates
    assert is_continuous(coordinates) == proved


def test_what_the_sign_was_proved_with_is_not_asked_again(monkeypatch):
    name = "channel_sine"
    analysis = analyse(read_template(template_paths()[name]).bind({}))
    found = find_orientation(analysis.map)
    coordinates = analysis.map.coordinates
    assert found.models
    asked = []
    monkeypatch.setattr(continuity, "_stay", lambda names, trees: asked.append(names) or True)
    assert is_continuous(coordinates, found.models)
    assert not asked
    assert is_continuous(coordinates)
    assert asked


@pytest.mark.parametrize(
    ("tree", "proved"), [(U + Fraction(1, 10), True), (U, False), (U - Fraction(1, 2), False)]
)
def test_models_show_where_operands_keep_off_zero(tree, proved: bool) -> None:
    (coordinate, _, _) = point_equation((pc.log(tree), V, W)).coordinates
    known, ends = Known(), np.linspace(0, 1, 65)
    half = np.diff(ends) / 2 * (1 + 1e-12)
    places = [Place((ends[1:] + ends[:-1]) / 2, half, half)]
    enclose(coordinate.args, ("u",), places, 3, known)
    models = known.at(("u",), places, 3)
    assert continuity._is_known("log", coordinate.args[0], models) == proved
    assert continuity._is_known("div", coordinate.args[0], models) == proved
    assert not continuity._is_known("log", symbol("v"), models)


def test_what_only_touches_is_told_no_depth() -> None:
    """The table is nought at 1/2 and rises on both sides: rounding alone has a depth there."""
    pinched = """
title = "T"
[tables]
h = { at = [0, 0.5, 1], values = [1, 0, 1], kind = "pchip" }
[solid]
x = "u"
y = "v"
z = "w*h(u)"
"""
    with pytest.raises(OverlappingMapError, match=r"or touches: u = 0\.5, v = 0"):
        pc.compile_equation(parse_template(pinched, "T").bind())
