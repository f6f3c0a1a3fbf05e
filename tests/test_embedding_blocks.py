"""What parts blocks of patches before any patch is made: cones of tangents, and planes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pc2cad.geometry.carriers import Plane, SplineSurface
from pc2cad.geometry.sheets import (
    Sheet,
    SheetSide,
    elevated,
    patches_of,
    points_of,
    projected,
    restriction,
    surface_limits,
    surface_patches,
)
from pc2cad.solidity.embedding.above_planes import sides_of_planes
from pc2cad.solidity.embedding.blocks import near_pairs
from pc2cad.solidity.embedding.holds import hold, hold_in_pieces
from pc2cad.solidity.embedding.separation import boxes, boxes_of_rows
from pc2cad.solidity.embedding.surfaces import Surfaces
from pc2cad.solidity.embedding.windows import Cones, are_ahead, cones_of, is_alone, is_wall


def cones(axes, degrees):
    """Cones of half angles about axes."""
    axes = np.asarray(axes, dtype=float)
    axes = axes / np.linalg.norm(axes, axis=-1, keepdims=True)
    return Cones(axes, 2 * np.sin(np.radians(np.asarray(degrees, dtype=float)) / 2))


def rays(rng, cone, count):
    """Unit vectors of one cone, most of them on it."""
    axis, half = cone.axes[0], 2 * np.arcsin(cone.radii[0] / 2)
    first = np.cross(axis, rng.normal(size=3))
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    turn = rng.uniform(0, 2 * np.pi, count)[:, None]
    tilt = np.where(rng.uniform(size=(count, 1)) < 0.8, half, half * rng.uniform(size=(count, 1)))
    return np.cos(tilt) * axis + np.sin(tilt) * (np.cos(turn) * first + np.sin(turn) * second)


def test_cones_hold_all_vectors_that_are_more_than_rounding():
    vectors = np.random.default_rng(5).normal(size=(4, 6, 3)) + np.array([3.0, 0, 0])
    vectors[1, 2:] *= 1e-13
    vectors[2], vectors[3, 0] = 0.0, np.nan
    found = cones_of(vectors, 1e-12)
    assert found.radii[2] == -np.inf
    for axis, radius, own in zip(found.axes[[0, 1]], found.radii, vectors, strict=False):
        size = np.linalg.norm(own, axis=1)
        off = np.linalg.norm(own / size[:, None] - axis, axis=1)[size > 1e-12]
        assert off.max() == pytest.approx(radius, rel=1e-14)
    # what is not known is too wide for every test
    assert found.slopes[0].tolist()[2:] == [pytest.approx(1.0, rel=1e-15)] * 2


@pytest.mark.parametrize("cut", [True, False])
def test_control_points_of_grids_made_alike_come_in_long_rows(cut):
    """Of several grids with weights; limits of theirs are those of single patches."""
    knots = tuple(np.concatenate((np.zeros(3), np.linspace(0, 1, k), np.ones(3))) for k in (4, 3))
    rng, grids = np.random.default_rng(7), []
    for _ in range(2):
        poles, weights = rng.normal(size=(6, 5, 3)), rng.uniform(0.5, 2, (6, 5))
        grids.append(surface_patches(SplineSurface((3, 3), knots, poles, weights)))
    grids = grids if cut else [patches_of(g.nets[:, :1, :, 2:]) for g in grids]
    points = points_of(grids)
    assert len(grids) == 2
    for k, grid in enumerate(grids):
        nets = projected(grid.nets)
        assert points[:, :, :, k].transpose(4, 3, 2, 1, 0) == pytest.approx(nets, rel=1e-13)
        rows = points[:, :, :, k].reshape(3, nets.shape[2] * nets.shape[3], -1)
        for own, limits in zip(boxes_of_rows(rows), boxes(rows.T), strict=True):
            assert own == pytest.approx(limits, abs=1e-14)


@pytest.mark.parametrize("between", [10, 60, 90, 120, 175])
def test_cones_have_no_vectors_in_common_up_to_the_angle_between_them(between):
    angle = np.radians(between)
    room = min(between, 180 - between)
    axes = [1, 0, 0], [np.cos(angle), np.sin(angle), 0]
    for share in (0.1, 0.5, 0.9):
        s = cones([axes[0]] * 2, [share * room - 1e-3, share * room + 1e-3])
        t = cones([axes[1]] * 2, [(1 - share) * room] * 2)
        assert is_alone(s, t).tolist() == [True, False]


def test_cones_of_more_than_half_of_space_or_of_nothing_are_never_alone():
    axes = np.array([[1.0, 0, 0]] * 3)
    radii = np.array([1.5, 2.0, -np.inf])
    s, t = Cones(axes, radii), Cones(np.roll(axes, 1, axis=1), np.zeros(3))
    w = Cones(np.roll(axes, 2, axis=1), np.zeros(3))
    assert not is_alone(s, t).any()
    assert not is_alone(t, s).any()
    for three in ((s, t, w), (t, w, s), (w, s, t)):
        assert not is_wall(*three).any()


def test_three_cones_at_right_angles_are_a_wall_up_to_the_sphere_round_a_cube():
    """The corner of the cube of half sides sin a is on the unit sphere where sin a = 1/√3."""
    limit = np.degrees(np.arcsin(1 / np.sqrt(3)))
    widths = np.array([limit - 1e-6, limit + 1e-6])
    s, t, w = (cones([axis] * 2, widths) for axis in np.eye(3))
    assert is_wall(s, t, w).tolist() == [True, False]


def test_no_vectors_of_three_cones_lie_in_a_plane_where_that_is_said():
    rng = np.random.default_rng(3)
    said, least = 0, np.inf
    for _ in range(300):
        three = [cones(rng.normal(size=(1, 3)), rng.uniform(0, 50, 1)) for _ in range(3)]
        s, t, w = (rays(rng, cone, 400) for cone in three)
        volume = np.einsum("ni,ni->n", np.cross(s, t), w)
        if is_wall(*three)[0]:
            said += 1
            least = min(least, np.abs(volume).min())
            assert np.abs(np.sign(volume).sum()) == len(volume)
        elif np.abs(np.sign(volume).sum()) == len(volume):
            # wherever it is not said, somewhat wider cones do have such vectors
            wider = [cones(c.axes, np.degrees(2 * np.arcsin(c.radii / 2)) * 1.5 + 3) for c in three]
            s, t, w = (rays(rng, cone, 20_000) for cone in wider)
            volume = np.einsum("ni,ni->n", np.cross(s, t), w)
            assert np.abs(np.sign(volume).sum()) < len(volume)
    assert said >= 30
    assert least < 0.1


def is_ahead_with(signs, parts):
    """Say of cones (k, n) with signs (k, n) what `are_ahead` says of their axes and sines."""
    return are_ahead(np.moveaxis(parts.axes, -1, 0) * signs, parts.slopes[0])


def test_cones_are_ahead_of_a_plane_up_to_half_of_space():
    """Two cones at an angle have a plane before them where their half angles leave room for it."""
    for between in (40, 90, 130):
        angle = np.radians(between)
        axes = [[[1, 0, 0]] * 2, [[np.cos(angle), np.sin(angle), 0]] * 2]
        half = (180 - between) / 2
        both = cones(axes, [[half - 1, half + 1]] * 2)
        assert is_ahead_with(np.ones((2, 2)), both).tolist() == [True, False]
        # the same cones turned round, and their signs with them
        turned = Cones(both.axes * np.array([1, -1])[:, None, None], both.radii)
        assert is_ahead_with([[1, 1], [-1, -1]], turned).tolist() == [True, False]


def test_vectors_of_cones_are_on_one_side_of_a_plane_where_that_is_said():
    rng = np.random.default_rng(4)
    said = 0
    for _ in range(300):
        count = int(rng.integers(2, 10))
        signs = rng.choice([-1, 1], count)
        axes = rng.normal(size=(count, 3)) + rng.normal(size=3) * 2
        parts = cones(axes * signs[:, None], rng.uniform(0, 40, count))
        if not is_ahead_with(signs[:, None], Cones(parts.axes[:, None], parts.radii[:, None]))[0]:
            continue
        said += 1
        vectors = np.concatenate(
            [
                sign * rays(rng, Cones(parts.axes[[k]], parts.radii[[k]]), 100)
                for k, sign in enumerate(signs.tolist())
            ]
        )
        # the shortest mean of vectors has a length where a plane parts them from its origin
        mean = vectors.mean(axis=0)
        for step in range(2000):
            worst = vectors[(vectors @ mean).argmin()]
            mean += (worst - mean) * (2 / (step + 2 + 2))
        assert (vectors @ mean).min() > 0
    assert said >= 30


def test_cones_of_nothing_or_of_half_of_space_are_never_ahead():
    for radius in (-np.inf, 1.5, 2.0):
        axes = np.array([[[1.0, 0, 0]], [[0.9, 0.1, 0]]])
        assert not is_ahead_with(np.ones((2, 1)), Cones(axes, np.array([[0.1], [radius]]))).any()


def test_patches_are_raised_before_they_are_taken_as_after():
    rng = np.random.default_rng(5)
    knots = np.array([0.0, 0, 0, 0.4, 1, 1, 1])
    surface = SplineSurface((2, 2), (knots, knots), rng.normal(size=(4, 4, 3)))
    for patches in (surface_patches(surface), patches_of(rng.uniform(1, 2, (2, 3, 3, 2, 4)))):
        n, m = patches.shape
        i, j = np.divmod(rng.permutation(n * m)[:3], m)
        found = patches.raised(4).take(i, j)
        true = elevated(elevated(patches.nets[i, j], 4, 1), 4, 2)
        assert found == pytest.approx(true, abs=1e-13)


# -- planes ----------------------------------------------------------------------------------------


def above_floor(dip: float, weight: float = 1.0, row: int = 6, degree: int = 3):
    """A spline that stands on the floor along its side s = 0, and the floor as a plane face."""
    inner = np.linspace(0, 1, 9)
    knots = [np.concatenate((np.zeros(p), inner, np.ones(p))) for p in (degree, 3)]
    places = [[k[i + 1 : i + 1 + p].mean() for i in range(8 + p)]
              for k, p in zip(knots, (degree, 3), strict=True)]  # fmt: skip
    x, y = np.meshgrid(*places, indexing="ij")
    poles = np.stack((y, 0.1 * x, x), axis=-1)
    poles[row, 5, 2] -= dip
    weights = np.ones(x.shape)
    weights[3, 3] = weight
    patches = surface_patches(SplineSurface((degree, 3), (knots[0], knots[1]), poles, weights))
    names = [(0, (0, 1)), (1, (1, 2)), (2, (3, 2)), (3, (0, 3))]
    sides = tuple(SheetSide(edge, at_ends, inner) for edge, at_ends in names)
    unit = np.array([0.0, 1.0])
    nets = np.array([[[0, 0, 0, 1], [0, -1, 0, 1]], [[1, 0, 0, 1], [1, -1, 0, 1.0]]])[None, None]
    floor_sides = [(3, (0, 3)), (4, (3, 5)), (5, (4, 5)), (6, (0, 4))]
    floor = Sheet(1, 1, patches_of(nets), tuple(SheetSide(e, v, unit) for e, v in floor_sides),
                  plane=Plane(np.zeros(3), np.array([0.0, 0, 1])))  # fmt: skip
    return Surfaces([Sheet(0, 0, patches, sides), floor], np.full((7, 2, 3), np.nan))


def parted(surfaces, pairs=((0, 1),)):
    """Which patches of the first sheet the plane of the second parts from its face, (8, 8)."""
    found = sides_of_planes(surfaces, np.array(pairs), 1e-12)
    patches = np.arange(64)
    rows = np.column_stack((patches, np.full(64, 64)))
    one = found.part(rows, surfaces.sheet_of)
    assert np.array_equal(one, found.part(rows[:, ::-1], surfaces.sheet_of))
    return one.reshape(8, 8)


def test_a_sheet_that_stands_on_a_plane_is_parted_from_it_but_for_their_side():
    assert parted(above_floor(0.0)).all()
    assert parted(above_floor(0.0), [(1, 0)]).all()


def test_patches_of_a_pole_below_the_plane_are_not_parted():
    """A pole counts for the four patches along each parameter that are made of it."""
    found = parted(above_floor(0.9))
    assert np.argwhere(~found).min(axis=0).tolist() == [3, 2]
    assert np.argwhere(~found).max(axis=0).tolist() == [6, 5]
    assert (~found).sum() == 16


def test_patches_along_a_side_are_parted_where_only_their_poles_are_beyond_the_plane():
    """The end of the first patches is 1/8 above the floor, a pole of the fourth row 1/6 of it."""
    above, below = parted(above_floor(0.7, row=3)), parted(above_floor(0.8, row=3))
    assert above[0].all()
    assert np.argwhere(~above).min(axis=0).tolist() == [1, 2]
    assert np.argwhere(~below).min(axis=0).tolist() == [0, 2]
    assert (~below[0]).sum() == 4


def test_the_other_side_of_patches_of_degree_one_is_not_left_out():
    found = parted(above_floor(0.5, row=1, degree=1))
    assert np.argwhere(~found).min(axis=0).tolist() == [0, 2]
    assert (~found).sum() == 8


def test_a_side_that_the_plane_face_does_not_have_is_not_left_out():
    surfaces = above_floor(0.0)
    first = surfaces.sheets[0]
    along = first.sides[0].along
    named = (SheetSide(0, (8, 1), along), first.sides[1], SheetSide(2, (9, 2), along),
             SheetSide(7, (8, 9), along))  # fmt: skip
    other = Surfaces([Sheet(0, 0, first.patches, named), surfaces.sheets[1]],
                     np.full((8, 2, 3), np.nan))  # fmt: skip
    found = parted(other)
    assert not found[0].any()
    assert found[1:].all()


def test_nothing_is_said_with_weights_of_both_signs():
    assert not parted(above_floor(0.0, weight=-0.1)).any()


def test_blocks_are_parted_where_all_their_patches_are():
    surfaces = above_floor(0.9)
    found = sides_of_planes(surfaces, np.array([[0, 1]]), 1e-12)
    order = np.arange(65)
    merged = found.merged(order, np.arange(0, 65, 8))
    sheet = np.array([0] * 8 + [1])
    rows = np.column_stack((np.arange(8), np.full(8, 8)))
    assert merged.part(rows, sheet).tolist() == parted(surfaces).all(axis=1).tolist()


# -- blocks on one line ----------------------------------------------------------------------------


def curl(x, y, pieces: int):
    """A sheet over a curve of cubic Bernstein coefficients, in so many equal pieces."""
    ends = np.linspace(0, 1, pieces + 1)
    curve = restriction(3, ends[:-1], ends[1:]) @ np.stack((x, y, 0 * x, 1 + 0 * x), axis=-1)
    nets = np.stack((curve, curve + np.array([0.0, 0, 1, 0])), axis=1)[None]
    unit = np.array([0.0, 1.0])
    sides = (SheetSide(0, (0, 1), unit), SheetSide(1, (1, 2), ends),
             SheetSide(2, (3, 2), unit), SheetSide(3, (0, 3), ends))  # fmt: skip
    return Surfaces([Sheet(0, 0, patches_of(nets), sides)], np.full((4, 2, 3), np.nan))


@pytest.mark.parametrize("pieces", [3, 4])
def test_blocks_on_one_line_are_parted_though_ways_along_the_other_lead_both_ways(pieces):
    """The parabola (t², t/2) for |t| < 1, with boxes that part nothing."""
    surfaces = curl(np.array([1, -1 / 3, -1 / 3, 1]), np.array([-1, -1 / 3, 1 / 3, 1]) / 2, pieces)
    assert len(near_pairs(surfaces, 1e-12, near=10.0)[0]) == 0


@pytest.mark.parametrize("pieces", [2, 3, 4, 6])
def test_blocks_on_one_line_that_meet_are_left(pieces):
    """The loop (t² - 1, t³ - t) for |t| < 1.3 meets itself at t = ±1: in its end pieces."""
    ends = np.array([-1.3, 1.3])
    c = np.array([ends[[0] * (3 - k) + [1] * k] for k in range(4)])
    square = (c[:, 0] * c[:, 1] + c[:, 0] * c[:, 2] + c[:, 1] * c[:, 2]) / 3
    surfaces = curl(square - 1, c.prod(axis=1) - c.mean(axis=1), pieces)
    left = near_pairs(surfaces, 1e-12)[0].tolist()
    assert [0, pieces - 1] in left


# -- pieces ----------------------------------------------------------------------------------------


def tube(spans: int, around: int) -> SplineSurface:
    """A quarter of a bent tube, each span of which turns far."""
    knots = [np.concatenate((np.zeros(3), np.linspace(0, 1, k + 1), np.ones(3)))
             for k in (spans, around)]  # fmt: skip
    s, t = (np.array([k[i + 1 : i + 4].mean() for i in range(len(k) - 4)]) for k in knots)
    along, across = np.meshgrid(0.5 * np.pi * s, 1.5 * np.pi * t, indexing="ij")
    radius = 3 + np.cos(across)
    poles = np.stack((radius * np.cos(along), radius * np.sin(along), np.sin(across)), axis=-1)
    return SplineSurface((3, 3), (knots[0], knots[1]), poles)


@pytest.mark.parametrize(("spans", "around", "pieces"), [(2, 4, 3), (6, 18, 2), (16, 50, 1)])
def test_patches_that_turn_far_are_held_in_pieces(spans, around, pieces):
    surface = tube(spans, around)
    patches = surface_patches(surface)
    whole, held = hold(patches, surface.poles), hold_in_pieces(patches, surface.poles)
    assert held.corners.shape == (pieces * spans + 1, pieces * around + 1, 3)
    low, high = held.limits()
    cones = [held.tangents(axis, 1e-12) for axis in (0, 1)]
    nodes = np.linspace(0, 1, 9)
    bernstein = np.stack([math.comb(3, k) * nodes**k * (1 - nodes) ** (3 - k) for k in range(4)])
    points = np.einsum("ix,jy,nijc->nxyc", bernstein, bernstein, projected(patches.nets).reshape(
        -1, 4, 4, 3))  # fmt: skip
    heights, _ = boxes(points[..., None, :])
    assert (heights >= low[:, None, None] - 1e-12).all()
    assert (heights <= high[:, None, None] + 1e-12).all()
    for axis, cone in enumerate(cones):
        chords = np.diff(points, axis=1 + axis)
        ways = chords / np.linalg.norm(chords, axis=-1, keepdims=True)
        off = np.linalg.norm(ways - cone.axes[:, None, None], axis=-1).max(axis=(1, 2))
        assert (off <= cone.radii + 1e-12).all()
        if pieces > 1:
            # nearer than the patches as they are, and no nearer than they are
            before = whole.tangents(axis, 1e-12)
            assert np.median(cone.radii) < 0.9 * np.median(before.radii)
    if pieces > 1:
        wide, narrow = (np.subtract(*h.limits()[::-1]) for h in (whole, held))
        assert np.median(narrow) < 0.95 * np.median(wide)


# -- pieces of splines -----------------------------------------------------------------------------


def strip(bend: float, width: float, spans: int = 6) -> SplineSurface:
    """A flat strip of length 1 that turns by an angle in all, of equal spans."""
    knots = [
        np.concatenate((np.zeros(2), np.linspace(0, 1, k + 1), np.ones(2))) for k in (spans, 2)
    ]
    s, t = (np.array([k[i + 1 : i + 3].mean() for i in range(len(k) - 3)]) for k in knots)
    radius = 1 / bend
    angle, out = np.meshgrid(bend * s, radius + width * t, indexing="ij")
    poles = np.stack((out * np.sin(angle), radius - out * np.cos(angle), 0 * out), axis=-1)
    return SplineSurface((2, 2), (knots[0], knots[1]), poles)


def test_splines_that_bow_far_beside_their_width_are_cut_in_equal_parts():
    """Six spans of a sixth each, which turn by 0.2: a bow of 1/240."""
    for width, parts in ((0.1, 1), (0.03, 1), (0.01, 2), (0.004, 3), (1e-6, 4)):
        ((s, t),) = surface_limits([strip(1.2, width)])
        assert np.allclose(s, np.linspace(0, 1, 6 * parts + 1), atol=1e-15), width
        assert t.tolist() == [0, 0.5, 1]
    ((s, _),) = surface_limits([strip(1e-9, 1e-6)])
    assert len(s) == 7


def test_both_sides_of_a_wall_are_cut_alike():
    """The narrower one alone would be cut in more parts."""
    wide, narrow = strip(1.2, 0.1), strip(1.2, 0.01)
    assert len(surface_limits([wide])[0][0]) == 7
    cut = surface_limits([wide, narrow])
    assert [len(s) for s, _ in cut] == [13, 13]
    assert np.array_equal(cut[0][0], cut[1][0])


@pytest.mark.parametrize("width", [0.1, 0.01, 0.004])
def test_parts_of_spans_are_held_as_such(width):
    """The bends of half a span are a quarter of the span's."""
    surface = strip(1.2, width)
    (limits,) = surface_limits([surface])
    patches = surface_patches(surface, limits)
    held, whole = (hold(p, surface.poles) for p in (patches, surface_patches(surface)))
    parts = (len(limits[0]) - 1) // 6
    for k, share in ((0, parts**2), (1, parts), (2, 1)):
        assert held.bends[k] == pytest.approx(np.repeat(whole.bends[k], parts, axis=0) / share)
    low, high = held.limits()
    heights, _ = boxes(projected(patches.nets).reshape(len(low), -1, 1, 3))
    corners = heights.reshape(len(low), 3, 3, -1)[:, ::2, ::2]
    assert (corners >= low[:, None, None] - 1e-15).all()
    assert (corners <= high[:, None, None] + 1e-15).all()


def test_splines_with_the_same_knots_are_held_together_as_each_alone():
    surface = tube(3, 4)
    patches = surface_patches(surface)
    other = surface.poles[:, ::-1] * [1.0, 0.5, 2.0]
    both = hold_in_pieces(patches, np.stack((surface.poles, other), axis=2))
    for k, poles in enumerate((surface.poles, other)):
        alone = hold_in_pieces(patches, poles)
        for one, whole in zip(alone.limits(), both.limits(), strict=True):
            assert np.array_equal(one, whole[k])
        for axis in (0, 1):
            one, whole = alone.tangents(axis, 1e-12), both.tangents(axis, 1e-12)
            assert np.array_equal(one.axes, whole.axes[k])
            assert np.array_equal(one.radii, whole.radii[k])
        assert np.array_equal(alone.ways(1e-12).radii, both.ways(1e-12).radii[k])
        assert np.array_equal(alone.ways(1e-12).radii, both.of(k).ways(1e-12).radii)
