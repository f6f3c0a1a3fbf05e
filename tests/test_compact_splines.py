"""Fits: a projection that meets the limits, its degree and knots with the fewest poles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from pc2cad.api import parameters
from pc2cad.checked import check_map
from pc2cad.compiler import compile_equation, compile_part
from pc2cad.errors import ToleranceNotReachedError
from pc2cad.expression.breaks import Break
from pc2cad.geometry.carriers import Plane, SplineCurve, SplineSurface
from pc2cad.geometry.splines.adaptive_knots import DirectionRules, adapt
from pc2cad.geometry.splines.spline_basis import SparseRows
from pc2cad.geometry.splines.spline_profile import spline_profile
from pc2cad.geometry.splines.spline_projection import _band_solver
from pc2cad.geometry.splines.spline_space import SplineSpace, smallest_error
from pc2cad.options import CompileOptions
from pc2cad.representation.boundary import represent
from pc2cad.templates.file import parse_template, read_template
from pc2cad.templates.shipped import find_template

#: the paper's guide with A=(100,0,0) B=(0,80,0) C=(0,0,60), Frenet frame, ellipse 12 x 8, wall 2
PAPER = """
title = "Elliptic channel in the Frenet frame"
[points]
A = [100, 0, 0]
B = [0, 80, 0]
C = [0, 0, 60]
D = [0, 0, 0]
[let]
N = "(A-D)*u^3 + (B-D)*(1-u)^3 + (C-D)*sin(u) + D"
P = "N + diff(N, u)"
E = "N + diff(diff(N, u), u)"
N1 = "E - (P-N)*metric(E, P, N)/metric(P, P, N)"
R = "N + unit(N1-N)"
Q = "N + unit(exit_from_plane(N, P, N1)-N)"
K = "N + (R-N)*12*cos(2*pi*v) + (Q-N)*8*sin(2*pi*v)"
[solid]
M = "K + (K-N)*2/distance(K, N)*(w - 1/2)"
"""
LENGTH = 171.04


def paper():
    return parse_template(PAPER, "paper").bind({})


def shipped(name, **values):
    return read_template(find_template(name)).bind(values)


def true_outer_wall(u, v):
    """The outer wall of PAPER, worked out by hand: u and v of shape (n,)."""
    zero = np.zeros_like(u)
    guide = np.stack((100 * u**3, 80 * (1 - u) ** 3, 60 * np.sin(u)), axis=1)
    first = np.stack((300 * u**2, -240 * (1 - u) ** 2, 60 * np.cos(u)), axis=1)
    second = np.stack((600 * u, 480 * (1 - u), -60 * np.sin(u) + zero), axis=1)
    tangent = first / np.linalg.norm(first, axis=1, keepdims=True)
    normal = second - (second * tangent).sum(axis=1, keepdims=True) * tangent
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    binormal = np.cross(tangent, normal)
    x, y = 12 * np.cos(2 * np.pi * v), 8 * np.sin(2 * np.pi * v)
    longer = 1 + 1 / np.hypot(x, y)
    return guide, normal, binormal, x * longer, y * longer


def values(carrier, s, t):
    """The carrier at s and t of shape (n,), by SciPy."""
    along = BSpline.design_matrix(s, carrier.knots[0], carrier.degrees[0]).toarray()
    across = BSpline.design_matrix(t, carrier.knots[1], carrier.degrees[1]).toarray()
    return np.einsum("ni,nj,ijx->nx", along, across, carrier.poles)


def spline_faces(model):
    return [f for f in model.faces if isinstance(f.carrier, SplineSurface)]


# -- one direction -----------------------------------------------------------------------------


@st.composite
def spaces(draw):
    degree = draw(st.integers(2, 13))
    count = draw(st.integers(1, 12))
    widths = draw(st.lists(st.floats(0.4, 1), min_size=count, max_size=count))
    points = np.concatenate(([0.0], np.cumsum(widths)))
    inner = draw(st.lists(st.integers(1, degree), min_size=count - 1, max_size=count - 1))
    seam = draw(st.one_of(st.none(), st.integers(1, degree)))
    return SplineSpace(degree, points / points[-1], inner, seam)


@settings(max_examples=150, deadline=None)
@given(spaces(), st.integers(0, 2**31))
def test_a_spline_of_the_space_is_its_own_fit(space, seed):
    generator = np.random.default_rng(seed)
    t = np.linspace(0, 1, 197)
    if space.periodic:
        knots, owner = space._unclamped
        some = generator.normal(size=(owner.max() + 1, 2))
        spline = BSpline(knots, some[owner], space.degree)
    else:
        spline = BSpline(space.knots, generator.normal(size=(space.size, 2)), space.degree)
    poles = space.fit(spline(space.sites))
    assert np.abs(space.basis(t) @ poles - spline(t)).max() <= 1e-10
    assert np.abs(space.basis(t).values.sum(axis=1) - 1).max() <= 1e-14


@pytest.mark.parametrize("degree", [2, 3, 5, 7, 10])
def test_a_fit_meets_its_limits_and_its_seam(degree):
    t = np.array([0.0, 1.0])
    open_space = SplineSpace(degree, np.linspace(0, 1, 6))
    poles = open_space.fit(np.exp(open_space.sites)[:, None])
    assert (open_space.basis(t) @ poles)[:, 0].tolist() == [1.0, np.exp(1.0)]
    ring = SplineSpace(degree, np.linspace(0, 1, 9) ** 1.2, seam=1)
    poles = ring.fit(np.cos(2 * np.pi * ring.sites + 1)[:, None])
    assert poles[0] == poles[-1] == np.cos(1)
    curve = BSpline(ring.knots, poles[:, 0], degree)
    for order in range(1, degree):
        start, end = curve.derivative(order)(t)
        assert start == pytest.approx(end, rel=1e-7, abs=1e-9 * 30**order)


@pytest.mark.parametrize("degree", [3, 5, 7])
def test_the_error_is_the_smallest_and_its_mean_nearly_nothing(degree):
    """It follows the Bernoulli polynomial, but for the seam: half of interpolation's error."""
    n, k = 48, 4
    space = SplineSpace(degree, np.linspace(0, 1, n + 1), seam=1)
    t = np.linspace(0, 1, 40 * n + 1)
    error = space.basis(t) @ space.fit(np.cos(2 * np.pi * k * space.sites)[:, None])[:, 0]
    error -= np.cos(2 * np.pi * k * t)
    leading = smallest_error(degree) * (2 * np.pi * k / n) ** (degree + 1)
    inside = (t >= 0.25) & (t < 0.75)
    assert np.abs(error[inside]).max() < 1.3 * leading
    assert np.abs(error).max() < 2 * leading
    moment = error * np.cos(2 * np.pi * k * t)
    assert abs(moment[inside].mean()) < 0.002 * leading
    assert abs(moment[:-1].mean()) < 0.03 * leading


def wave(t):
    """Two columns of a curve that is hard near 0.7."""
    bump = 1 / (1 + 900 * (t - 0.7) ** 2)
    columns = np.stack((t, bump, np.sin(7 * t), np.cos(3 * t), t**2, bump * t), axis=1)
    return columns.reshape(len(t), 2, 3)


@pytest.mark.parametrize("target", [1e-2, 1e-4, 1e-6, 1e-9])
def test_the_degree_with_the_fewest_poles_is_taken(target):
    single = {d: adapt(wave, DirectionRules((d,)), target, 1e-14) for d in (3, 5, 7, 9)}
    chosen = adapt(wave, DirectionRules((3, 5, 7, 9)), target, 1e-14)
    fewest = min(space.size for space in single.values())
    assert chosen.size == fewest
    assert chosen.degree == min(d for d, space in single.items() if space.size == fewest)
    t = np.linspace(0, 1, 5001)
    for space in (*single.values(), chosen):
        poles = space.fit(wave(space.sites)).reshape(space.size, 6)
        gap = (space.basis(t) @ poles).reshape(-1, 2, 3) - wave(t)
        assert np.sqrt((gap**2).sum(axis=-1)).max() <= 1.1 * target


def test_knots_gather_where_the_function_is_hard():
    space = adapt(wave, DirectionRules((5,)), 1e-6, 1e-14)
    lengths = np.diff(space.points)
    near = np.argmin(np.abs(space.points - 0.7))
    assert lengths[near] < lengths.max() / 4
    uniform = next(
        n
        for n in range(10, 400, 2)
        if _largest_error(SplineSpace(5, np.linspace(0, 1, n + 1))) <= 1e-6
    )
    assert space.size < 0.6 * uniform


def _largest_error(space):
    t = np.linspace(0, 1, 3001)
    poles = space.fit(wave(space.sites)).reshape(space.size, 6)
    return np.abs(space.basis(t) @ poles - wave(t).reshape(-1, 6)).max()


@pytest.mark.parametrize("degrees", [(2,), (3,), (6,), (7,), (3, 5, 7)])
def test_breaks_symmetry_and_periods_are_kept(degrees):
    def kinked(t):
        return np.stack((np.abs(t - 0.5) * np.exp(t), t, t**3), axis=1)[:, None]

    rules = DirectionRules(degrees, (Break(0.5, 0),), symmetric=True)
    space = adapt(kinked, rules, 1e-7, 1e-14)
    middle = np.flatnonzero(space.points == 0.5)
    assert space.multiplicities[middle - 1].tolist() == [space.degree]
    assert np.abs(space.points + space.points[::-1] - 1).max() <= 1e-15

    def ring(t):
        x = 2 * np.pi * t
        return np.stack((np.exp(np.cos(x)), np.sin(x), np.cos(2 * x)), axis=1)[:, None]

    space = adapt(ring, DirectionRules(degrees, periodic=True), 1e-7, 1e-14)
    assert space.periodic
    poles = space.fit(ring(space.sites))
    assert poles[0].tolist() == poles[-1].tolist()


def test_an_unknown_kink_is_resolved_and_a_jump_is_refused():
    def kink(t):
        return np.stack((np.abs(t - 1 / 3), t, t), axis=1)[:, None]

    space = adapt(kink, DirectionRules((3, 5, 7)), 1e-6, 1e-14)
    t = np.linspace(0, 1, 4001)
    poles = space.fit(kink(space.sites)).reshape(-1, 3)
    assert np.abs(space.basis(t) @ poles - kink(t)[:, 0]).max() <= 1.1e-6
    with pytest.raises(ToleranceNotReachedError, match="kink or a jump"):
        adapt(lambda t: np.sign(kink(t) - 0.1), DirectionRules((3, 5, 7)), 1e-6, 1e-14)


# -- whole solids ------------------------------------------------------------------------------


@pytest.mark.parametrize(("tolerance", "poles"), [(1e-6, 33 * 63), (1e-7, 66 * 85)])
def test_the_papers_outer_wall_takes_fewer_poles_than_the_kernels_routes(tolerance, poles):
    """1e-6: the kernel's tight approximation; 1e-7: its tight pipe (measured on this wall)."""
    model = represent(check_map(paper()), CompileOptions(tolerance))
    (wall,) = [face for face in model.faces if face.name == "w=1"]
    assert wall.carrier.poles[..., 0].size <= poles / 1.5
    generator = np.random.default_rng(7)
    s, t = generator.uniform(size=(2, 4000))
    guide, normal, binormal, x, y = true_outer_wall(s, t)
    found = values(wall.carrier, s, t)
    # the side of the binormal is the template's choice
    gaps = [
        np.linalg.norm(guide + x[:, None] * normal + sign * y[:, None] * binormal - found, axis=1)
        for sign in (1, -1)
    ]
    assert min(gap.max() for gap in gaps) <= tolerance
    assert wall.deviation <= tolerance


@pytest.mark.parametrize("name", ["channel_ellipse", "channel_sine", "helical_channel", "torus"])
def test_volume_and_area_hold_although_fits_use_the_tolerance(name):
    part = compile_equation(shipped(name))
    report = part.report
    assert report.solid.volume == pytest.approx(report.equation.volume, rel=1e-7)
    assert report.solid.area == pytest.approx(report.equation.area, rel=1e-7)
    # the tolerance is used, not a small share of it
    if report.evidence != "exact":
        assert report.deviation > 0.1 * report.tolerance


@pytest.mark.parametrize("degree", [2, 4, 6, 9, 13])
@pytest.mark.parametrize("name", ["channel_contour", "helical_channel"])
def test_every_degree_makes_a_valid_solid(name, degree):
    report = compile_equation(shipped(name), 1e-4, degree).report
    found = {d for face in report.faces for d in face.degrees}
    assert report.deviation <= 1e-4
    assert degree in found


@pytest.mark.slow
def test_options_choose_the_degrees():
    equation = shipped("channel_ellipse")
    usual = compile_equation(equation).report.faces[1]
    high = compile_equation(equation, max_degree=13).report.faces[1]
    cubic = compile_equation(equation, max_degree=3).report.faces[1]
    assert set(usual.degrees) <= {3, 5, 7}
    assert np.prod(high.poles) <= np.prod(usual.poles) < np.prod(cubic.poles)
    assert cubic.degrees == (3, 3)


def test_the_cubic_profile_leaves_nothing_above_degree_three():
    u, v, w = parameters()
    quintic = (u + v**5 * w / 4, v, w + u**4 / 5)
    free, cubic = (compile_part(quintic, tolerance=1e-4, profile=p) for p in ("compact", "cubic"))
    assert free.report.evidence == "exact"
    assert max(d for face in free.report.faces for d in face.degrees) == 5
    carriers = [x.carrier for x in (*cubic.model.faces, *cubic.model.edges)]
    splines = [c for c in carriers if isinstance(c, SplineSurface | SplineCurve)]
    assert splines
    assert (
        max(np.max(c.degrees if isinstance(c, SplineSurface) else c.degree) for c in splines) <= 3
    )
    assert all(c.weights is None for c in splines)
    assert any(isinstance(c, Plane) for c in carriers)
    assert cubic.report.deviation <= 1e-4
    assert cubic.report.solid.volume == pytest.approx(free.report.equation.volume, rel=1e-4)


def test_a_cubic_step_file_has_no_higher_and_no_rational_splines(tmp_path):
    part = compile_equation(shipped("half_ball"), 1e-4, profile="cubic")
    part.write(tmp_path / "cubic.step")
    text = (tmp_path / "cubic.step").read_text()
    assert "RATIONAL" not in text
    heads = [part.split(",")[1:3] for part in text.split("B_SPLINE_SURFACE_WITH_KNOTS(")[1:]]
    assert all(int(degree) <= 3 for head in heads for degree in head)


def test_profiles_know_their_degrees():
    assert spline_profile().degrees == (3, 5, 7)
    assert spline_profile(CompileOptions(max_degree=10)).degrees == (3, 5, 7, 9)
    assert spline_profile(CompileOptions(degree=4)).degrees == (4,)
    assert spline_profile(CompileOptions(profile="cubic")).degrees == (3,)


@pytest.mark.parametrize(("size", "width"), [(33, 4), (64, 33), (70, 8), (150, 40)])
def test_banded_equations_are_solved_block_by_block(size, width):
    rng = np.random.default_rng(size)
    factor = np.tril(np.triu(rng.random((size, size)), 1 - width)) + 2 * np.eye(size)
    matrix, right = factor @ factor.T, rng.random((size, 5))
    band = np.zeros((width, size))
    for k in range(width):
        band[k, : size - k] = np.diagonal(matrix, -k)
    found = _band_solver(band)(right)
    assert found.shape == right.shape
    np.testing.assert_allclose(matrix @ found, right, atol=1e-12)


def test_sparse_rows_are_multiplied_from_both_sides():
    rng = np.random.default_rng(3)
    index = (rng.integers(0, 90, (300, 1)) + np.arange(4)) % 90
    rows = SparseRows(index, rng.random((300, 4)), 90)
    full = np.zeros((300, 90))
    np.add.at(full, (np.arange(300)[:, None], index), rows.values)
    right, left = rng.random((90, 7)), rng.random((300, 7))
    np.testing.assert_allclose(rows @ right, full @ right, rtol=1e-13)
    np.testing.assert_allclose(rows.transposed(left), full.T @ left, rtol=1e-12)
