"""What was built is proved to meet itself nowhere, or refused: equation and faces alike."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from OCP.BRepCheck import BRepCheck_Analyzer
from shipped import checked_of

import pc2cad as pc
from pc2cad.checked import CheckedMap
from pc2cad.domain.analysis import analyse
from pc2cad.equation.point_equation import PointEquation, point_equation
from pc2cad.errors import NotASolidError
from pc2cad.expression.plain_constants import with_plain_constants
from pc2cad.expression.tree import call, number, symbol
from pc2cad.geometry.carriers import SplineCurve, SplineSurface
from pc2cad.geometry.sheets import (
    OUTSIDE,
    Patches,
    Sheet,
    SheetSide,
    circle_pieces,
    curve_pieces,
    patches_of,
    projected,
    restriction,
    surface_patches,
)
from pc2cad.options import CompileOptions
from pc2cad.representation.boundary import represent
from pc2cad.representation.embedding import embed
from pc2cad.representation.face_sheets import sheets_of
from pc2cad.solidity.embedding import proof
from pc2cad.solidity.embedding.blocks import near_pairs
from pc2cad.solidity.embedding.holds import hold
from pc2cad.solidity.embedding.levels import beyond_corner, beyond_plane, by_levels, is_graph, rises
from pc2cad.solidity.embedding.proof import prove
from pc2cad.solidity.embedding.separation import boxes
from pc2cad.solidity.embedding.verdict import BuiltFacesMeetError
from pc2cad.solidity.injectivity import OverlappingMapError
from pc2cad.solidity.orientation import find_orientation
from pc2cad.solidity.solidity import Question

U, V, W = pc.parameters()


def unexamined(equation: PointEquation) -> CheckedMap:
    """A map of which the samples' word on overlaps is not asked."""
    from pc2cad.integrals.mass_properties import integrate

    analysis = analyse(equation)
    orientation = find_orientation(analysis.map)
    return CheckedMap(
        analysis, orientation, (), integrate(analysis), Question(analysis, orientation)
    )


def embedding(map_, tolerance: float | None = None, domain=None):
    checked = unexamined(point_equation(map_, domain))
    return embed(checked, represent(checked, CompileOptions(tolerance)))


def spiral(gap: Fraction):
    """Two turns of a strip of thickness 1 that rises and falls, and comes back `gap` away."""
    radius = 2 + (2 + 2 * gap) * U + W
    t = 4 * pc.pi * U
    return radius * pc.cos(t), radius * pc.sin(t), V + Fraction("0.3") * pc.sin(2 * pc.pi * U)


def ramp(width: str, height: str):
    """Two turns of a ramp, 1.5 apart, with a bump on the lower one."""
    t = 4 * pc.pi * U
    gap = (U - Fraction("0.2113")) ** 2 + (V - Fraction("0.5317")) ** 2
    bump = Fraction(height) * pc.exp(-gap / Fraction(width) ** 2)
    return (2 + V) * pc.cos(t), (2 + V) * pc.sin(t), t / pc.pi + W * (Fraction(1, 2) + bump)


def ring(gap: str):
    """A ring whose ends nearly meet: nearest at v = 1/8, 3/8, 5/8 and 7/8."""
    t = (2 * pc.pi - Fraction(gap) - Fraction("0.0166667") * (1 + pc.cos(8 * pc.pi * V))) * U
    return (3 + W) * pc.cos(t), (3 + W) * pc.sin(t), V


# -- the proof, and what it refuses ----------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    ["ball", "bilinear_top", "cone", "elbow_pipe", "ellipsoid", "half_ball", "helical_channel",
     "hollow_cylinder", "hypar_slab", "paraboloid_cap", "pyramid", "simplex_hyperboloid", "torus",
     "turned_ring"],
)  # fmt: skip
def test_templates_are_proved(name):
    checked = checked_of(name)
    found = embed(checked, represent(checked))
    assert found.proved, found.open
    assert found.cells >= 4


@pytest.mark.parametrize(
    ("width", "height"),
    [pytest.param("0.01", "3", marks=pytest.mark.slow), ("0.03", "1.6")],
)
def test_a_needle_that_pierces_the_next_turn_is_refused(width, height):
    """Its place is between the samples of the equation, but not between the knots of the fit."""
    with pytest.raises(OverlappingMapError, match="covers itself") as caught:
        pc.compile_part(ramp(width, height))
    x, y, z = map(float, re.search(r"both lie at \((.*?)\)", str(caught.value))[1].split(","))
    told = float(re.search(r"itself, ([\d.e-]+) mm deep or more", str(caught.value))[1])
    # what comes out on top of the next turn leaves half of its thickness on either side
    assert told == pytest.approx(min(float(height) - 1.5, 0.25), rel=0.1)
    turn = 4 * math.pi * 0.2113
    middle = 2.5317 * np.array([math.cos(turn), math.sin(turn)])
    assert np.hypot(*(np.array([x, y]) - middle)) < 0.35
    assert z == pytest.approx(2 + turn / math.pi, abs=0.1)


def test_a_needle_that_ends_below_the_next_turn_is_proved():
    assert embedding(ramp("0.03", "1.45")).proved


@pytest.mark.parametrize("gap", ["0.0002", "0.001"])
def test_a_tolerance_that_closes_a_gap_is_refused_with_one_that_does_not(gap):
    with pytest.raises(BuiltFacesMeetError) as caught:
        pc.compile_part(ring(gap), tolerance=0.05)
    text = str(caught.value)
    assert "u = 1, " in text
    assert "u = 0, " in text
    deep = float(re.search(r"meet, ([\d.e-]+) mm deep or more, at", text)[1])
    both = float(re.search(r"by up to ([\d.e-]+) mm together", text)[1])
    assert 0 < deep < both
    asked = float(re.search(r"a tolerance of ([\d.e-]+) mm would", text)[1])
    assert 0 < asked < 0.05
    assert embedding(ring(gap), asked).proved


@pytest.mark.parametrize("place", [1e-5, 1.0, 1e5])
def test_the_proof_does_not_depend_on_the_unit(place):
    size = Fraction(place)

    def scaled(map_):
        return tuple(size * x for x in map_)

    good, bad = (spiral(Fraction(sign, 50)) for sign in (1, -1))
    assert embedding(scaled(good)).proved
    with pytest.raises(OverlappingMapError):
        embedding(scaled(bad))


SIZE = 9
SHARES = "1e-1 3e-2 1e-2 3e-3 1e-3 3e-4 1e-4 3e-5 1e-5 1e-6 3e-7 1e-7"
DEPTHS = [Fraction(share) for share in SHARES.split()]


@pytest.mark.slow
@pytest.mark.parametrize("depth", DEPTHS, ids=[f"{float(d):.0e}" for d in DEPTHS])
def test_overlaps_of_every_depth_and_gaps_of_the_same_width(depth):
    """As shares of the size: each is refused to its depth, and built with a gap in its place."""
    assert len(DEPTHS) == 12
    with pytest.raises(OverlappingMapError, match="both lie at") as caught:
        pc.compile_part(spiral(-depth * SIZE))
    told = float(re.search(r"itself, ([\d.e-]+) mm deep or more", str(caught.value))[1])
    # of turns that share nearly all of the strip no place is deeper than half of it
    assert told == pytest.approx(min(float(depth * SIZE), 0.25), rel=0.2)
    assert pc.compile_part(spiral(depth * SIZE)).report.injectivity == "proved"


def test_a_spiral_whose_turns_nearly_touch_is_proved():
    """Samples cannot tell them apart."""
    radius, t = 2 + (2 + Fraction("2e-5")) * U + W, 4 * pc.pi * U
    found = embedding((radius * pc.cos(t), radius * pc.sin(t), V))
    assert found.proved, found.open


@pytest.mark.slow
def test_walls_that_the_checker_takes_for_one_are_cut_across():
    """That they are apart is proved; no face then has both."""
    gap = Fraction("1e-5")
    radius, t = 2 + Fraction(5, 4) * (1 + gap) * U + W, Fraction(5, 2) * pc.pi * U
    part = pc.compile_part((radius * pc.cos(t), radius * pc.sin(t), V))
    assert part.report.injectivity == "proved"
    assert len(part.report.faces) == 10
    assert part.report.euler == 2
    assert BRepCheck_Analyzer(part.shape).IsValid()
    (said,) = part.report.warnings
    assert "walls that bound v=0, v=1 for one" in said
    # a ring's sector at every height: thickness times the middle line
    length = float(5 * math.pi / 2) * (2.5 + 0.625 * (1 + 1e-5))
    assert part.volume == pytest.approx(length, rel=1e-9)


def test_faces_that_lie_on_one_another_are_refused():
    """Exact faces, too: a ring that runs on over its beginning."""
    t = 2 * pc.pi * U
    with pytest.raises(OverlappingMapError, match="covers itself"):
        embedding(((1 + W) * pc.cos(t), (1 + W) * pc.sin(t), V), domain={"u": (0, Fraction(5, 4))})


def test_sides_that_differ_by_how_constants_are_written_coincide_by_algebra():
    """At one end of v the side of the square is 2*sqrt(2), at the other 8*sqrt(2)*0.25."""
    sides = checked_of("square_to_round").analysis.boundary.sides
    glued = [side for side in sides if side.fate == "interface"]
    assert len(glued) == 2
    assert {side.verdict.value for side in glued} == {"proved"}
    u, root = symbol("u"), call("sqrt", number(2))
    one, other = 8 * root * Fraction(1, 4), 2 * root
    trees = (
        1 / call("sqrt", (one * u) ** 2 + (one - other) ** 2),
        1 / call("sqrt", (other * u) ** 2),
    )
    assert trees[0] is not trees[1]
    assert len(set(with_plain_constants(trees))) == 1


@pytest.mark.slow
def test_sides_that_algebra_does_not_show_to_coincide_are_bounded():
    """The ends of a figure of eight: a bound of their distance takes the place of the identity."""
    checked = checked_of("figure_of_eight")
    verdicts = {side.verdict.value for side in checked.analysis.boundary.sides}
    assert verdicts == {"proved", "sampled"}
    found = embed(checked, represent(checked))
    assert found.proved
    assert found.sides == ()
    assert 0 < found.depth < 1e-9 * checked.scale.size


# -- sheets ----------------------------------------------------------------------------------------


def values(nets, s, t):
    """Points of one patch, by the sum of Bernstein polynomials."""
    p, q = nets.shape[0] - 1, nets.shape[1] - 1
    a, b = (
        np.array([math.comb(d, k) * x**k * (1 - x) ** (d - k) for k in range(d + 1)])
        for d, x in ((p, s), (q, t))
    )
    return projected(np.einsum("i,j,ijc->c", a, b, nets))


def test_patches_of_a_spline_are_the_spline():
    rng = np.random.default_rng(1)
    knots = np.array([0, 0, 0, 0, 0.3, 0.5, 0.5, 1, 1, 1, 1]), np.array([0, 0, 0, 0.7, 1, 1, 1.0])
    poles, weights = (
        rng.normal(size=(7, 4, 3)),
        np.outer(rng.uniform(0.5, 1, 7), rng.uniform(0.5, 1, 4)),
    )
    surface = SplineSurface((3, 2), knots, poles, weights)
    nets = surface_patches(surface).nets
    assert nets.shape == (3, 2, 4, 3, 4)
    from scipy.interpolate import BSpline

    homogeneous = np.concatenate((poles * weights[..., None], weights[..., None]), axis=2)
    for (i, s), (j, t) in (((0, 0.2), (0, 0.5)), ((1, 0.4), (1, 0.9)), ((2, 1.0), (0, 0.0))):
        x = np.array([0, 0.3, 0.5, 1])[i] + s * np.diff([0, 0.3, 0.5, 1])[i]
        y = np.array([0, 0.7, 1])[j] + t * np.diff([0, 0.7, 1])[j]
        row = BSpline(knots[0], homogeneous, 3)(x)
        assert values(nets[i, j], s, t) == pytest.approx(projected(BSpline(knots[1], row, 2)(y)))


def test_corners_and_bends_hold_the_patches_of_a_spline_and_its_tangents():
    rng = np.random.default_rng(2)
    inner = np.array([0.1, 0.25, 0.3, 0.45, 0.6, 0.6, 0.7, 0.85])
    knots = tuple(np.concatenate((np.zeros(d + 1), inner, np.ones(d + 1))) for d in (3, 2))
    at = [np.array([k[i + 1 : i + d + 1].mean() for i in range(len(k) - d - 1)])
          for k, d in zip(knots, (3, 2), strict=True)]  # fmt: skip
    x, y = np.meshgrid(*at, indexing="ij")
    poles = np.stack((x, y, 0.2 * x * x + y), axis=-1) + 2e-3 * rng.normal(size=(*x.shape, 3))
    patches = surface_patches(SplineSurface((3, 2), knots, poles))
    held = hold(patches, poles)
    low, high = held.limits()
    cones = [held.tangents(axis, 1e-12) for axis in (0, 1)]
    ways = held.ways(1e-12)
    assert min(cone.radii.min() for cone in (*cones, ways)) > 0
    assert min(np.median(cone.radii) for cone in cones) < 1
    nodes = np.linspace(0, 1, 6)
    checked = 0
    for k, net in enumerate(patches.nets.reshape(64, 4, 3, 4)):
        points = np.array([[values(net, s, t) for t in nodes] for s in nodes])
        values_along, _ = boxes(points[..., None, :])
        assert (values_along >= low[k] - 1e-12).all()
        assert (values_along <= high[k] + 1e-12).all()
        for cone, vectors in (
            (cones[0], np.diff(points, axis=0)), (cones[1], np.diff(points, axis=1)), (ways, points)
        ):  # fmt: skip
            if cone.radii[k] < 2:
                unit = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
                gap = np.linalg.norm(unit - cone.axes[k], axis=-1)
                assert gap.max() <= cone.radii[k] + 1e-12
                checked += 1
    assert checked >= 100


def test_most_patches_of_a_spline_are_never_made(monkeypatch):
    """A wavy plate in 1,600 patches: large parts of it are plain as they are."""
    made = []
    take = Patches.take
    monkeypatch.setattr(Patches, "take", lambda self, i, j: made.append(len(i)) or take(self, i, j))
    knots = np.concatenate((np.zeros(3), np.linspace(0, 1, 41), np.ones(3)))
    greville = np.array([knots[i + 1 : i + 4].mean() for i in range(43)])
    x, y = np.meshgrid(10 * greville, 10 * greville, indexing="ij")
    poles = np.stack((x, y, 0.3 * np.sin(x) * np.cos(y)), axis=-1)
    patches = surface_patches(SplineSurface((3, 3), (knots, knots), poles))
    sides = tuple(SheetSide(k, ends, np.linspace(0, 1, 41))
                  for k, ends in enumerate([(0, 1), (1, 2), (3, 2), (0, 3)]))  # fmt: skip
    found = prove([Sheet(0, 0, patches, sides)], lines(4), 15.0, 1e-13)
    assert found.meeting is None
    assert sum(made) < 160


def test_pieces_of_curves_and_circles():
    arcs = circle_pieces(0.3, 0.3 + 1.5 * math.pi)
    assert arcs.shape == (8, 3, 3)
    shoulder = arcs[1].T @ np.array([0.25, 0.5, 0.25])
    angle = 0.3 + 1.5 * 1.5 * math.pi / 8
    assert shoulder[:2] / shoulder[2] == pytest.approx([math.cos(angle), math.sin(angle)])
    curve = SplineCurve(2, np.array([0, 0, 0, 0.5, 1, 1, 1.0]), np.eye(4)[:, :3] + 1)
    pieces, ends = curve_pieces(curve)
    assert ends.tolist() == [0, 0.5, 1]
    assert pieces[0, -1] == pytest.approx(pieces[1, 0])


def test_restriction_is_the_polynomial_on_a_part():
    coefficients = np.array([3.0, -1, 2, 5, 0])
    part = (restriction(4, np.array([0.25]), np.array([0.75])) @ coefficients)[0]

    def at(c, x):
        return sum(math.comb(4, k) * x**k * (1 - x) ** (4 - k) * c[k] for k in range(5))

    for x in (0.0, 0.3, 1.0):
        assert at(part, x) == pytest.approx(at(coefficients, 0.25 + x / 2))


@pytest.mark.parametrize("name", ["ball", "cone", "elbow_pipe", "half_ball", "paraboloid_cap",
                                  "hollow_cylinder", "turned_ring", "torus_wedge"])  # fmt: skip
def test_sheets_end_in_their_vertices_and_lie_on_the_equation(name):
    checked = checked_of(name)
    model = represent(checked)
    sheets, left = sheets_of(model)
    assert left == []
    assert len(sheets) >= len(model.faces) >= 1
    for sheet in sheets:
        low = projected(sheet.patches.nets[0, 0, 0, 0])
        assert low == pytest.approx(model.vertices[sheet.sides[0].ends[0]], abs=1e-9 * model.size)
        high = projected(sheet.patches.nets[-1, -1, -1, -1])
        assert high == pytest.approx(model.vertices[sheet.sides[2].ends[1]], abs=1e-9 * model.size)


# -- pairs of patches by hand ----------------------------------------------------------------------


def patch(index, points, edges, vertices):
    """A bilinear patch with points (2, 2, 3)."""
    nets = np.concatenate((np.array(points, dtype=float), np.ones((2, 2, 1))), axis=2)[None, None]
    ends = [(0, 1), (1, 2), (3, 2), (0, 3)]
    sides = [SheetSide(e, (vertices[a], vertices[b]), np.array([0.0, 1.0]))
             for e, (a, b) in zip(edges, ends, strict=True)]  # fmt: skip
    return Sheet(index, index, patches_of(nets), tuple(sides), name=str(index))


def lines(count: int):
    return np.full((count, 2, 3), np.nan)


def joined(angle: float):
    c, s = math.cos(angle), math.sin(angle)
    # side 3 (s = 0) of both is the edge 0, from the vertex 0 to the vertex 1
    first = patch(0, [[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]]], (1, 2, 3, 0), (0, 2, 3, 1))
    other = patch(1, [[[0, 0, 0], [0, 1, 0]], [[c, 0, s], [c, 1, s]]], (4, 5, 6, 0), (0, 4, 5, 1))
    return prove([first, other], lines(7), 2.0, 1e-13)


@pytest.mark.parametrize("degrees", [1, 30, 90, 150, 180, 210, 300, 355])
def test_two_faces_joined_at_an_angle(degrees):
    found = joined(math.radians(degrees))
    assert found.meeting is None
    assert found.depth == 0


def test_two_faces_that_lie_on_one_another_are_not_proved():
    found = joined(0.0)
    assert found.meeting is not None


def test_a_face_that_crosses_another_is_found():
    flat = patch(0, [[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]]], (0, 1, 2, 3), (0, 1, 2, 3))
    for depth in (0.3, 1e-3, 1e-6, 1e-8):
        low = patch(1, [[[0.3, 0.4, 1], [0.6, 0.4, 1]], [[0.3, 0.4, -depth], [0.6, 0.4, -depth]]],
                    (4, 5, 6, 7), (4, 5, 6, 7))  # fmt: skip
        found = prove([flat, low], lines(8), 2.0, 1e-14)
        assert found.meets, depth
        assert found.meeting.point == pytest.approx((found.meeting.point[0], 0.4, 0), abs=1e-7)
        high = patch(1, [[[0.3, 0.4, 1], [0.6, 0.4, 1]], [[0.3, 0.4, depth], [0.6, 0.4, depth]]],
                     (4, 5, 6, 7), (4, 5, 6, 7))  # fmt: skip
        assert prove([flat, high], lines(8), 2.0, 1e-14).meeting is None, depth


# -- several solids --------------------------------------------------------------------------------


def test_faces_with_no_solid_in_common_are_compared_where_the_others_are_not_proved(monkeypatch):
    """Nothing follows for them then."""
    flat = patch(0, [[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]]], (0, 1, 2, 3), (0, 1, 2, 3))
    cross = patch(1, [[[0.3, 0.4, 1], [0.6, 0.4, 1]], [[0.3, 0.4, -1], [0.6, 0.4, -1]]],
                  (4, 5, 6, 7), (4, 5, 6, 7))  # fmt: skip
    two = [replace(flat, beside=(0, 1)), replace(cross, beside=(2, 3))]
    assert prove(two, lines(8), 2.0, 1e-14).meeting is None
    assert prove(two, lines(8), 2.0, 1e-14, every=True).meets
    assert prove([two[0], replace(cross, beside=(1, 2))], lines(8), 2.0, 1e-14).meets
    outside = [replace(sheet, beside=(k, OUTSIDE)) for k, sheet in enumerate((flat, cross))]
    assert prove(outside, lines(8), 2.0, 1e-14).meets
    asked = []

    def spy(*given):
        asked.append(given[2])
        return near_pairs(*given)

    monkeypatch.setattr(proof, "near_pairs", spy)
    monkeypatch.setattr(proof, "MOST_CELLS", 0)
    close = replace(flat, beside=(0, 1)), replace(cross, beside=(1, 2))
    assert not prove(close, lines(8), 2.0, 1e-14).meets
    assert asked == [False, True]


# -- what comes near without meeting ---------------------------------------------------------------


@pytest.mark.parametrize("wall", ["0.001", "0.00001"])
def test_a_wall_however_thin_is_proved(wall):
    """By ways across it: cells as small as it is thick would be thousands of millions."""
    t, p = 2 * pc.pi * U, pc.pi * V
    r = 10 + Fraction(wall) * W
    found = embedding((r * pc.sin(p) * pc.cos(t), r * pc.sin(p) * pc.sin(t), r * pc.cos(p)))
    assert found.proved, found.open
    assert found.cells < 60_000


def test_both_sides_of_a_sharp_apex_are_no_meeting():
    """They are nearer to one another than what counts as touching, and joined in the apex."""
    t = 2 * pc.pi * U
    found = embedding((V * W**2 * pc.cos(t), V * W**2 * pc.sin(t), W**2))
    assert found.proved, found.open


def test_a_slender_cone_is_cut_round_its_axis():
    """Where it turns, and not where it is long."""
    t = 2 * pc.pi * U
    r = 3 * V * (1 - W)
    found = embedding((r * pc.cos(t), r * pc.sin(t), 4000 * W))
    assert found.proved, found.open
    assert found.cells < 500


def test_a_cusp_is_left_open_after_a_bounded_effort(monkeypatch):
    monkeypatch.setattr("pc2cad.solidity.embedding.proof.MOST_WORK", 100_000)
    t = 2 * pc.pi * U
    found = embedding((V * W**3 * pc.cos(t), V * W**3 * pc.sin(t), W))
    assert not found.proved
    assert 0 < found.depth < 0.1
    assert "v=1 at (" in found.open


def test_parts_that_leave_their_side_at_no_speed_are_told_apart_by_heights():
    """(s², t², f), as where f has a root at s = t = 0: tangents at both sides are rounding."""
    s, t = np.meshgrid([0.0, 0, 1 / 3, 1], [0.0, 0, 1 / 3, 1], indexing="ij")
    rng = np.random.default_rng(1)
    net = np.stack((s, t, rng.normal(size=(4, 4))), axis=-1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    folded = net.copy()
    folded[3, :, 0] = -1e-3
    nets = np.array([net, net @ turn, folded, folded @ turn])
    assert by_levels(nets, 1e-15).tolist() == [True, True, False, False]
    # two parts with a common line s = 0, on two sides of its plane and on one
    other, same = net * [-1, 1, 1], net * [1 / 2, 1, 1]
    away = np.array([net, net @ turn, net, net @ turn]).transpose(0, 2, 1, 3)
    beside = np.array([other, other @ turn, same, same @ turn]).transpose(0, 2, 1, 3)
    assert beyond_plane(away, beside, 1e-15).tolist() == [True, True, False, False]


def test_splines_over_a_plane_are_proved_as_wholes():
    steps = np.sort(np.random.default_rng(2).uniform(size=30))
    net = np.stack(
        (
            *np.meshgrid(steps, steps[::2] ** 2, indexing="ij"),
            np.cos(9 * np.outer(steps, steps[::2])),
        ),
        axis=-1,
    )
    index = tuple(np.arange(n - 3)[:, None] + np.arange(4) for n in net.shape[:2])
    back, level, stopped = (net.copy() for _ in range(3))
    back[12, :, 0] = net[10, 0, 0]
    level[4, 7, 1] += 1e-9
    stopped[10:14, :, 0] = net[10, 0, 0]
    nets = [net, net[..., [2, 0, 1]] * [1, -1, 1], back, level, stopped]
    assert [is_graph(n, index, 1e-15) for n in nets] == [True, True, False, False, False]


def test_parts_joined_in_a_point_beyond_two_planes_are_told_apart():
    """On two sides of x = 0 and of y = 0, and in both planes: no plane of one height parts them."""
    rng = np.random.default_rng(3)
    heights = rng.uniform(-1, 1, size=(2, 40))
    first = np.stack((-rng.uniform(0, 1e-9, 40), rng.uniform(1e-6, 1e-5, 40), heights[0]), axis=1)
    second = np.stack((rng.uniform(0, 1e-9, 40), -rng.uniform(1e-6, 1e-5, 40), heights[1]), axis=1)
    first[:20, 0] = second[:20, 0] = 0

    def parted(one, other):
        found = [(one @ n[0], other @ n[0]) for n in beyond_corner(one[None], other[None])]
        assert len(found) == 6
        return any((a > 0).all() and (b < 0).all() for a, b in [*found, *(x[::-1] for x in found)])

    assert parted(first, second)
    assert not parted(first, first)
    assert not parted(first, second * [1, -1, 1])


def test_a_part_above_a_plane_may_rest_on_it_along_its_side_only():
    free = np.zeros((4, 3, 3), dtype=bool)
    free[:, 0] = True
    resting = np.array([[0.0, 0, 0], [0, 0, 0], [1, 1, 1]])
    height = np.stack((resting, resting, resting, resting))
    height[1, 1, 1] = -1e-6
    height[2, 2, 0] = 0  # its corner lies on the plane
    height[3, 1:, 2] = 0  # a whole side does
    assert rises(height, free, 1e-15).tolist() == [True, False, False, False]


@pytest.mark.slow
def test_a_root_at_a_corner_is_bounded_and_proved():
    report = pc.compile_part((U, V, W * (1 + (1 + U) * pc.sqrt(U + V))), tolerance=1e-3).report
    assert (report.evidence, report.injectivity) == ("bounded", "proved")
    volume = 1 + 2 / 3 * (2 / 7 * (2**3.5 - 1) - 2 / 5 - 2 / 7)
    assert report.equation.volume == pytest.approx(volume, rel=1e-9)
    assert report.solid.volume == pytest.approx(volume, rel=1e-4)


@pytest.mark.slow
def test_roots_at_four_corners_are_bounded_and_proved():
    """Parameters are slow at both ends, and near them small numbers are told from rounding."""
    root = pc.sqrt(U * (1 - U) + V * (1 - V))
    report = pc.compile_part((U, V, W * (1 + (1 + U * V) * root)), tolerance=1e-4).report
    assert (report.evidence, report.injectivity) == ("bounded", "proved")
    # half a ball without four halves of caps, and 5/4 of it, as u v is 1/4 but for what is odd
    radius = math.sqrt(0.5)
    cap = radius - 0.5
    part = 2 * math.pi / 3 * (radius**3 - cap**2 * (3 * radius - cap))
    assert report.equation.volume == pytest.approx(1 + 1.25 * part, rel=1e-11)
    assert report.solid.volume == pytest.approx(1 + 1.25 * part, rel=1e-6)


def test_a_face_by_its_lines_is_whole():
    """The ends of its range are 0 and 1 but for rounding: no patch of that length is made."""
    r = (1 + W) * pc.sqrt(1 + (2 * V - 1) ** 2)
    wall = (r * (1 - U * U) / (1 + U * U), r * 2 * U / (1 + U * U), 2 * V - 1)
    found = embedding(wall)
    assert found.proved, found.open
    assert found.cells < 200


@pytest.mark.parametrize("shear", [0, 3, 6])
def test_sheared_blocks_are_proved_at_once(shear):
    """However flat the angles are: the half spaces are amid what leads away from an edge."""
    bent = Fraction(1, 50) * U * (1 - U) * V
    found = embedding((U + shear * V + bent, V + shear * W, W + bent))
    assert found.proved, found.open
    assert found.cells < 100


def test_long_walls_that_are_straight_one_way_are_compared():
    """Many patches in a row, of degree 1 across: no second derivative bows them there."""
    height = 2 + pc.sin(2 * pc.pi * 60 * U) / 50
    found = embedding((30 * U, V, W * height))
    assert found.proved, found.open


def tube(twist, turns, radii=(Fraction(1, 5), 1)):
    """A ring whose lines of v run round the section as u goes round the axis."""
    around, turn = 2 * pc.pi * (twist * U + V), 2 * pc.pi * turns * U
    r = radii[0] + (radii[1] - radii[0]) * W
    out = 3 + r * pc.cos(around)
    return out * pc.cos(turn), out * pc.sin(turn), r * pc.sin(around)


@pytest.mark.parametrize(("twist", "turns"), [(1, 1), (-2, 1), (2, Fraction(1, 2))])
def test_faces_that_go_round_are_whole_wherever_their_seams_run(twist, turns):
    found = embedding(tube(twist, turns))
    assert found.proved, found.open
    assert found.cells < 1000


@pytest.mark.parametrize(("twist", "turns"), [(1, 2), (1, Fraction(11, 10))])
def test_faces_that_go_round_more_than_once_are_no_rectangle(twist, turns):
    with pytest.raises(NotASolidError):
        pc.compile_part(tube(twist, turns))


@pytest.mark.parametrize("angle", ["0.07", "0.02"])
def test_the_depth_that_is_told_is_one_that_is_there(angle):
    """The end of a ring reaches this angle into its beginning, of radii from 3 to 4."""
    reach = Fraction("0.3") + Fraction(angle)
    bump = pc.exp(-((V - Fraction("0.3711")) ** 2) * 400)
    t = (2 * pc.pi - Fraction("0.3") + reach * bump) * U
    with pytest.raises(OverlappingMapError) as caught:
        pc.compile_part(((3 + W) * pc.cos(t), (3 + W) * pc.sin(t), 2 * V))
    told = float(re.search(r"itself, ([\d.e-]+) mm deep or more", str(caught.value))[1])
    assert 2.5 * float(angle) < told <= 4 * float(angle)


#: maps whose det J vanishes inside, without a change of its sign, and which touch themselves there
PINCHED = {
    "walls in a point": lambda a: (U, V, (2 * W - 1) * ((U - a) ** 2 + (V - a) ** 2)),
    "walls in a point, sides in common": lambda a: (
        U, V + U**2 / 4,
        (W - Fraction(1, 2)) * U * (1 - U) * V * (1 - V) * ((U - a) ** 2 + (V - a) ** 2)
        + U * V / 3,
    ),
    "walls along a line": lambda a: (
        U, V + U**2 / 5, (W - Fraction(1, 3)) * (U - a) ** 2 + pc.sin(U) / 5
    ),
    "a neck without width": lambda a: (
        U, (V - Fraction(1, 2)) * (U - a) ** 2 + U**2 / 3,
        (W - Fraction(1, 2)) * (U - a) ** 2 + pc.sin(2 * U),
    ),
    "a sheet along a line": lambda a: (
        U, (V - Fraction(1, 2)) * (U - a) ** 4 + U**2 / 3, W + pc.sin(2 * U)
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", PINCHED)
def test_what_has_no_width_inside_is_refused(case):
    """Of tangents and ways that vanish cones say nothing, wherever they do."""
    for place in (Fraction(3, 8), Fraction(1, 2)):
        with pytest.raises(OverlappingMapError):
            embedding(PINCHED[case](place), 1e-4)


@pytest.mark.parametrize("root", [False, True])
def test_samples_see_that_a_wall_has_no_width_at_an_inner_place(root):
    """A wall that comes to nothing between samples, smoothly or to a point."""
    gap = (U - pc.sqrt(2) / 3) ** 2 + (V - Fraction(2, 7)) ** 2
    map_ = U, V, (2 * W - 1) * (pc.sqrt(gap) if root else gap) * pc.exp(U)
    with pytest.raises(OverlappingMapError):
        unexamined(point_equation(map_, None)).solidity  # noqa: B018


def test_samples_are_asked_where_a_fitted_wall_is_thinner_than_its_deviation():
    """The fitted walls are apart in wide blocks, the equation's touch."""
    gap = (U - Fraction(47, 100)) ** 2 + (V - Fraction(18, 25)) ** 2
    asked = []
    for more in (0, Fraction(1, 10)):
        checked = unexamined(point_equation((U, V, (2 * W - 1) * pc.sqrt(gap + more)), None))
        model = represent(checked, CompileOptions(0.03))
        assert embed(checked, model, lambda: asked.append(more)).proved  # noqa: B023
    assert asked == [0]


def test_what_has_no_width_along_its_sides_is_proved():
    bump = U * (1 - U) * V * (1 - V)
    for slow in (1, 2):
        assert embedding((U, V + U**2 / 4, (W - Fraction(1, 2)) * bump**slow + U * V / 3)).proved
