"""Proved deviations: never below any sample, near the largest, and not fooled between samples."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from shipped import checked_of

import pc2cad as pc
from pc2cad.arrays import linear
from pc2cad.bounds import taylor_evaluation
from pc2cad.bounds.deviation import Bound, bound_curve, bound_surface
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import Place
from pc2cad.bounds.taylor_products import MOST_GATHERED, product
from pc2cad.checked import CheckedMap
from pc2cad.compiler import compile_part
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.expression.evaluation import Program
from pc2cad.expression.sigmoids import as_tanh
from pc2cad.expression.tree import PI, Expr, call, number, pieces, symbol, walk
from pc2cad.geometry.carriers import SplineCurve, SplineSurface
from pc2cad.geometry.splines.arcs import Arcs
from pc2cad.geometry.splines.bernstein import bezier_knots
from pc2cad.geometry.splines.spline_space import SplineSpace
from pc2cad.geometry.splines.tensor import fit_surface
from pc2cad.options import CompileOptions
from pc2cad.representation.boundary import represent

Array = NDArray[np.float64]
U, V = symbol("u"), symbol("v")


def _values(spline: SplineSurface, s: Array, t: Array) -> Array:
    along = BSpline(spline.knots[0], spline.poles, spline.degrees[0])(s)
    return np.asarray(BSpline(spline.knots[1], along.transpose(1, 0, 2), spline.degrees[1])(t))


def _fit(trees: tuple[Expr, Expr, Expr], s: SplineSpace, t: SplineSpace) -> SplineSurface:
    sample = _sampler(trees)
    poles = fit_surface(sample(s.sites, t.sites), s, t)
    return SplineSurface((s.degree, t.degree), (s.knots, t.knots), poles)


def _sampler(trees: tuple[Expr, ...]) -> Callable[[Array, Array], Array]:
    program = Program(trees)

    def sample(s: Array, t: Array) -> Array:
        columns = program({"u": s[:, None], "v": t[None, :]})
        return np.stack([np.broadcast_to(c, (len(s), len(t))) for c in columns], axis=-1)

    return sample


def _largest_sample(trees: tuple[Expr, ...], spline: SplineSurface, count: int) -> float:
    """Return the largest distance over a random grid of about `count` places."""
    n = int(np.sqrt(count))
    rng = np.random.default_rng(count)
    s, t = (np.sort(rng.uniform(0, 1, n)) for _ in range(2))
    gap = _values(spline, s, t).transpose(1, 0, 2) - _sampler(trees)(s, t)
    return float(np.sqrt((gap * gap).sum(axis=-1)).max())


CHANNELS = ("channel_ellipse", "channel_contour", "channel_sine", "helical_channel")


def _spline_faces(
    checked: CheckedMap, tolerance: float
) -> list[tuple[RestrictedMap, SplineSurface]]:
    # of degree 5 a round wall is no rational spline: that would have a parameter of its own
    options = CompileOptions(tolerance, max_degree=5)
    model, analysis = represent(checked, options), checked.analysis
    return [
        (RestrictedMap(analysis, analysis.boundary.faces[face.cells[0]].patch), face.carrier)
        for face in model.faces
        if isinstance(face.carrier, SplineSurface)
    ]


@pytest.mark.parametrize("name", CHANNELS)
@pytest.mark.parametrize("count", [4_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_bounds_of_channels_hold_samples_and_are_within_twice(name: str, count: int) -> None:
    faces = _spline_faces(checked_of(name), 1e-6)
    assert faces
    for function, carrier in faces:
        trees, names = function.trees
        bound = bound_surface(trees, names, carrier)
        n = int(np.sqrt(count))
        rng = np.random.default_rng(count)
        s, t = (np.sort(rng.uniform(0, 1, n)) for _ in range(2))
        gap = _values(carrier, s, t).transpose(1, 0, 2) - function(s, t)
        seen = float(np.sqrt((gap * gap).sum(axis=-1)).max())
        assert max(seen, bound.sampled) <= bound.largest <= min(2 * bound.sampled, 1e-6)
        assert not bound.open
        ends, places = np.array([0.0, 1.0]), np.sort(rng.uniform(0, 1, count))
        across = _values(carrier, ends, places).transpose(1, 0, 2) - function(ends, places)
        along = _values(carrier, places, ends).transpose(1, 0, 2) - function(places, ends)
        on_sides = (*across, *along.transpose(1, 0, 2))
        for gap, side in zip(on_sides, map(bound.side, range(4)), strict=True):
            seen = float(np.sqrt((gap * gap).sum(axis=-1)).max())
            assert max(seen, side.sampled) <= side.largest <= 2 * side.sampled


HARD: dict[str, tuple[Expr, Expr, Expr]] = {
    "waves": (U, V, call("sin", 40 * PI * U) * number(Fraction(1, 1000))),
    "both": (U, V, call("sin", 18 * U + 7 * V) * call("exp", -3 * V)),
    "quotient": (U / (V + Fraction(1, 9)), V, 1 / (Fraction(3, 2) + call("cos", 9 * U * V))),
    "roots": (call("sqrt", 1 + 25 * (U - V) ** 2), U, V**2),
    "inverse": (call("atan2", U + Fraction(1, 3), V + Fraction(1, 3)), call("log", 2 * U + 1),
                call("asin", U * V * Fraction(9, 10))),
}  # fmt: skip


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("degree", [1, 2, 3, 5, 7])
@pytest.mark.parametrize("pieces_each_way", [1, 5])
def test_bounds_hold_samples_for_any_degree_and_knots(
    name: str, degree: int, pieces_each_way: int
) -> None:
    trees = HARD[name]
    s = SplineSpace(degree, np.linspace(0, 1, pieces_each_way + 1) ** 1.3)
    t = SplineSpace(max(1, degree - 1), np.linspace(0, 1, pieces_each_way + 2))
    carrier = _fit(trees, s, t)
    bound = bound_surface(trees, ("u", "v"), carrier)
    seen = _largest_sample(trees, carrier, 20_000)
    assert np.isfinite(bound.largest)
    assert seen <= bound.largest <= 2 * max(seen, bound.sampled)


def test_a_wave_that_every_sample_misses_is_caught() -> None:
    # zero at the sites and at four places in every cell, the same ones in each
    space = SplineSpace(3, (0.0, 0.25, 0.5, 0.75, 1.0))
    shares = [Fraction(0), *(Fraction(k, 8) for k in (1, 3, 5, 7))]
    wave = number(1)
    for share in shares:
        wave = wave * call("sin", PI * (4 * U - share))
    trees = (U, V, wave)
    places = np.array([(i + float(share)) / 4 for i in range(4) for share in shares])
    assert np.abs(_sampler(trees)(places, places)[..., 2]).max() < 1e-14
    truth = np.abs(_sampler(trees)(np.linspace(0, 1, 2001), np.zeros(1))[..., 2]).max()
    assert truth > 0.03
    bound = bound_surface(trees, ("u", "v"), _fit((U, V, number(0)), space, space))
    assert truth <= bound.largest <= 1.5 * truth


@pytest.mark.parametrize("width", [30, 300, 3000])
def test_a_narrow_bump_is_caught_or_left_open_with_its_place(width: int) -> None:
    trees = (U, V, number(1) / (1 + (width * (U - Fraction(1234, 10000))) ** 2))
    flat = _fit((U, V, number(0)), SplineSpace(1, (0.0, 1.0)), SplineSpace(1, (0.0, 1.0)))
    bound = bound_surface(trees, ("u", "v"), flat)
    assert bound.largest >= 1.0
    if np.isinf(bound.largest):
        (low, high), _ = bound.open
        assert low <= 0.1234 <= high < low + 0.1
    else:
        assert bound.largest <= 1.5


def test_a_singular_side_is_named() -> None:
    trees = (U, V, U ** Fraction(1, 16))
    carrier = _fit(trees, SplineSpace(3, np.linspace(0, 1, 9)), SplineSpace(1, (0.0, 1.0)))
    bound = bound_surface(trees, ("u", "v"), carrier)
    assert np.isinf(bound.largest)
    (start, end), across = bound.open
    assert start == 0
    assert end <= 1 / 512
    assert across == (0, 1)
    assert bound.sampled > 0.01


@pytest.mark.parametrize(
    "root", [call("sqrt", U**2 + V**2), pytest.param((U**3 + V**3) ** Fraction(1, 3),
                                                     marks=pytest.mark.slow)], ids=["2", "3"]
)  # fmt: skip
def test_a_root_at_a_corner_is_bounded_by_its_values_there(root: Expr) -> None:
    """No disc round the corner's cell is free of it; knots graded towards it make cells small."""
    space = SplineSpace(3, np.concatenate(([0.0], 2.0 ** np.arange(-6, 1))))
    trees = (U**2, V**2, (2 - U * V) * root)
    carrier = _fit(trees, space, space)
    bound = bound_surface(trees, ("u", "v"), carrier)
    near = np.concatenate(([0.0], np.geomspace(1e-7, 0.99, 500), [1.0]))
    gap = _values(carrier, near, near).transpose(1, 0, 2) - _sampler(trees)(near, near)
    seen = float(np.sqrt((gap * gap).sum(axis=-1)).max())
    assert seen <= bound.largest <= 1.5 * seen
    assert max(bound.side(k).largest for k in range(4)) <= bound.largest


def test_a_root_along_a_side_is_bounded_where_it_may_be_off_by_as_much() -> None:
    trees = (U, V, call("sqrt", U))
    carrier = _fit(trees, SplineSpace(3, np.linspace(0, 1, 9)), SplineSpace(1, (0.0, 1.0)))
    bound = bound_surface(trees, ("u", "v"), carrier)
    assert bound.sampled <= bound.largest <= 1.5 * bound.sampled


def test_what_a_spline_holds_exactly_is_bounded_by_rounding() -> None:
    trees = (U**5 - 3 * V, U * V**3, U**2 * (1 - V) ** 2)
    for scale in (Fraction(1, 1000), Fraction(1), Fraction(100_000)):
        scaled = tuple(number(scale) * tree for tree in trees)
        carrier = _fit(scaled, SplineSpace(5, (0.0, 0.3, 1.0)), SplineSpace(3, (0.0, 0.6, 1.0)))
        bound = bound_surface(scaled, ("u", "v"), carrier)
        assert bound.largest <= 2e-13 * float(scale) * 4


def test_a_perturbed_pole_is_seen() -> None:
    trees = HARD["roots"]
    s = SplineSpace(5, np.linspace(0, 1, 12))
    carrier = _fit(trees, s, s)
    before = bound_surface(trees, ("u", "v"), carrier)
    carrier.poles[6, 4, 1] += 1e-2
    after = bound_surface(trees, ("u", "v"), carrier)
    assert after.largest > 2 * before.largest
    assert 2e-3 < after.largest < 1e-2


def test_knots_at_breaks_keep_piecewise_functions_bounded() -> None:
    tent = pieces(2 * U, (Fraction(0), Fraction(2, 3), Fraction(2)),
                  ((number(0), number(3), number(-1)), (number(Fraction(14, 9)), number(-1),
                                                       number(0))), 0)  # fmt: skip
    trees = (U, call("cos", tent * V), tent)
    at = SplineSpace(3, (0.0, 1 / 3, 1.0), (3,))
    across = SplineSpace(5, (0.0, 0.5, 1.0))
    good = bound_surface(trees, ("u", "v"), _fit(trees, at, across))
    assert good.largest <= 2 * good.sampled < 0.02
    beside = SplineSpace(3, (0.0, 0.3, 1.0), (3,))
    off = bound_surface(trees, ("u", "v"), _fit(trees, beside, across))
    assert good.largest < off.sampled <= off.largest <= 2 * off.sampled


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.floats(-1, 1), min_size=4, max_size=4), st.integers(2, 7), st.integers(1, 6),
    st.integers(0, 10**6),
)  # fmt: skip
def test_curves_are_bounded_like_surfaces(
    weights: list[float], degree: int, intervals: int, seed: int
) -> None:
    a, b, c, d = (Fraction(repr(round(w, 3))) for w in weights)
    trees = (
        a * call("sin", 5 * U) + b * U**2,
        call("exp", c * U) + d * call("cos", 3 * U + 1),
        call("sqrt", 2 + a * U),
    )
    space = SplineSpace(degree, np.linspace(0, 1, intervals + 1))
    program = Program(trees)

    def sample(t: Array) -> Array:
        return np.stack([np.broadcast_to(x, t.shape) for x in program({"u": t})], axis=-1)

    carrier = SplineCurve(degree, space.knots, space.fit(sample(space.sites)))
    bound = bound_curve(trees, "u", carrier)
    t = np.random.default_rng(seed).uniform(0, 1, 3000)
    gap = np.sqrt(((BSpline(space.knots, carrier.poles, degree)(t) - sample(t)) ** 2).sum(axis=-1))
    assert gap.max() <= bound.largest <= 2 * bound.sampled + 1e-12


def test_a_bound_is_no_shorter_than_what_was_sampled() -> None:
    bezier = SplineSurface((1, 1), (bezier_knots(1), bezier_knots(1)), np.zeros((2, 2, 3)))
    bound = bound_surface((number(3), number(4), number(0)), ("u", "v"), bezier)
    assert isinstance(bound, Bound)
    assert bound.sampled == pytest.approx(5)
    assert 5 <= bound.largest <= 5.0001


def test_mixed_faces_are_bounded_in_the_parameter_of_their_arcs() -> None:
    # w=0 is exact with arcs along u, so w=1 runs through them, too, and is approximated along v
    wall = number(1) / 3 * symbol("w")
    turn = 2 * PI * U
    trees = (
        (2 + V**3 + wall * call("exp", V / 3)) * call("cos", turn),
        (1 + V**2 + wall * call("exp", V / 2)) * call("sin", turn),
        3 * V**2 + V + wall * call("sin", V) / 3,
    )
    part = compile_part(trees)
    face = next(f for f in part.model.faces if f.name == "w=1")
    carrier = face.carrier
    assert isinstance(carrier, SplineSurface)
    assert carrier.weights is not None
    assert face.evidence == "bounded"
    rng = np.random.default_rng(5)
    s, t = np.sort(rng.uniform(0, 1, 150)), np.sort(rng.uniform(0, 1, 150))
    numerator = SplineSurface(
        carrier.degrees, carrier.knots, carrier.poles * carrier.weights[..., None]
    )
    weights = SplineSurface(
        carrier.degrees, carrier.knots, np.repeat(carrier.weights[..., None], 3, axis=2)
    )
    surface = (_values(numerator, s, t) / _values(weights, s, t)).transpose(1, 0, 2)
    program = Program(trees)
    arcs = Arcs(2 * np.pi, 4)
    columns = program({"u": arcs.places(s)[:, None], "v": t[None, :], "w": 1.0})
    gap = surface - np.stack([np.broadcast_to(c, (150, 150)) for c in columns], axis=-1)
    seen = float(np.sqrt((gap * gap).sum(axis=-1)).max())
    assert 0 < seen <= face.deviation <= 2 * seen
    assert {e.evidence for e in part.model.edges} <= {"exact", "bounded"}


def test_models_on_pairs_of_boxes_are_those_of_their_product():
    first, second = np.array([0.1, 0.4, 0.6, 0.9]), np.array([0.3, 0.8, 0.2, 0.5])
    along, across = (Place(x, np.full(4, 0.02), np.full(4, 0.05)) for x in (first, second))
    pairs = along.spread(0), across.spread(1)
    pairs = pairs[0], Place(*(x.T for x in (pairs[1].centre, pairs[1].half, pairs[1].radius)))
    limits = Fraction(0), Fraction(1, 2), Fraction(1)
    halves = pieces(V, limits, ((number(1), number(2)), (number(2), number(3))), -1)
    tree = call("sin", U * V) / (2 + U) + halves * pc.fourier([(0, 1, 2), (1, 1, 1)])(U, V)
    (product,) = enclose([tree], ["u", "v"], [along, across], 4)
    (model,) = enclose([tree], ["u", "v"], pairs, 4)
    each = np.arange(4)
    np.testing.assert_allclose(model.terms[..., 0], product.terms[..., each, each], atol=1e-15)
    np.testing.assert_allclose(model.radius[:, 0], product.radius[each, each], rtol=1e-9)
    assert np.isfinite(model.radius).tolist() == [[True], [True], [True], [False]]


def test_products_at_once_have_the_models_that_they_have_alone(monkeypatch):
    place = Place(np.array([0.1, 0.4, 0.9]), np.full(3, 0.02), np.full(3, 0.05))
    sine, cosine, growing = call("sin", U), call("cos", U), call("exp", U * U)
    rows = sine * cosine, cosine * growing, growing**2, sine**2, sine**3, U * growing, 3 * sine
    trees = *rows, rows[0] * rows[1] + rows[2] * rows[3], rows[1] * rows[4]
    together = enclose(trees, ["u"], [place], 4)
    monkeypatch.setattr(taylor_evaluation, "MOST_BESIDE", 0)
    for model, alone in zip(together, enclose(trees, ["u"], [place], 4), strict=True):
        np.testing.assert_allclose(model.terms, alone.terms, rtol=1e-14, atol=1e-16)
        np.testing.assert_allclose(model.radius, alone.radius, rtol=1e-12)
        np.testing.assert_allclose(model.error, alone.error, rtol=1e-12)


def test_what_is_divided_by_a_root_is_within_its_model():
    """On the rims of the discs, and as computed against 40 digits at real places."""
    tree = (1 + U) / call("sqrt", Fraction(1, 3) + U * U + V / 5)
    assert (tree.op, tree.args[1].op) == ("div", "sqrt")
    centre, disc = np.array([-0.2, 0.3]), 0.05
    place = Place(centre, np.full(2, 0.02), np.full(2, disc))
    (model,) = enclose([tree], ["u", "v"], [place, place], 4)
    s = np.exp(0.7j * np.arange(9))[:, None, None, None]
    t = s.reshape(1, -1, 1, 1)
    u, v = centre[:, None] + disc * s, centre + disc * t
    terms = sum(model.terms[i, j] * s**i * t**j for i in range(5) for j in range(5 - i))
    off = np.abs((1 + u) / np.sqrt(1 / 3 + u * u + v / 5) - terms).max(axis=(0, 1))
    assert (off <= model.radius).all()
    assert (model.radius <= 12 * off).all()
    assert (off > 1e-9).all()  # far above the rounding of these samples
    (computed,) = Program((tree,))({"u": centre[:, None], "v": centre})
    with localcontext(prec=40):
        x, y = Decimal(centre[0]), Decimal(centre[1])
        exact = [
            [(1 + a) / (1 / Decimal(3) + a * a + b / 5).sqrt() for b in (x, y)] for a in (x, y)
        ]
        errors = [
            [float(abs(Decimal(computed[n, m]) - exact[n][m])) for m in (0, 1)] for n in (0, 1)
        ]
    assert (errors <= model.error).all()
    # nothing is known where what is below the root may be 0
    near = Place(np.array([0.04]), np.array([0.01]), np.array([0.05]))
    (model,) = enclose([1 / call("sqrt", U)], ["u"], [near], 4)
    assert np.isinf(model.radius).all()


def test_tanh_is_level_on_wide_discs_far_from_0():
    """Its quotient of series knows nothing there; beside a ridge few boxes then do for many."""
    centre = np.array([-30.0, -12.0, 12.0, 30.0])
    place = Place(centre, np.full(4, 2.0), np.full(4, 8.0))
    tree = call("tanh", symbol("u"))
    (model,) = enclose([tree], ["u"], [place], 6)
    radius = model.radius.ravel()
    # the true distance from 1 or -1, at the disc's point that is nearest to 0
    truth = 1 - np.tanh(np.abs(centre) - 8)
    assert (radius >= truth).all()
    assert (radius <= 1.01 * truth + 1e-15).all()
    assert np.array_equal(model.centre.ravel(), np.sign(centre))


def test_a_needle_is_level_on_wide_discs_far_from_it():
    """Where exp(-x²) is next to nothing, its series at the middle of a disc is 0 times infinity."""
    place = Place(np.array([0.02, 0.3, 0.7]), np.full(3, 0.01), np.full(3, 0.04))
    (model,) = enclose([call("exp", -(10**6) * (U - Fraction(1, 2)) ** 2)], ["u"], [place], 6)
    assert (model.radius < 1e-100).all()
    assert (model.error < 1e-100).all()
    assert np.array_equal(model.centre.ravel(), np.zeros(3))
    # near it nothing is known of a disc that is wider than the needle
    near = Place(np.array([0.495]), np.array([0.01]), np.array([0.04]))
    (model,) = enclose([call("exp", -(10**6) * (U - Fraction(1, 2)) ** 2)], ["u"], [near], 6)
    assert np.isinf(model.radius).all()


@pytest.mark.parametrize(("p", "q"), [(1, 1), (3, 2)])
def test_logistic_functions_are_level_on_wide_discs_far_from_0(p: int, q: int) -> None:
    grown = call("exp", U)
    trees = (1 / (p + q * grown), 5 * V / (q * call("exp", -U) + p), 2 * grown / (p + q * grown))
    written = as_tanh(trees)
    assert all("exp" not in {node.op for node in walk((tree,))} for tree in written)
    places = {"u": np.linspace(-9, 9, 50), "v": np.linspace(0, 1, 50)}
    for one, other in zip(Program(trees)(places), Program(written)(places), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-15)
    place = Place(np.array([-60.0, 60.0]), np.full(2, 2.0), np.full(2, 8.0))
    for model in enclose([written[0], written[2]], ["u"], [place], 6):
        assert (model.radius < 1e-13).all()
    untouched = (1 / (U + grown), 1 / (2 - grown), U / (1 + call("exp", number(1))))
    assert as_tanh(untouched) == untouched


@pytest.mark.parametrize("boxes", [(3, 2), (20, 20), (40, 25)])
def test_products_of_terms_are_those_of_polynomials(boxes: tuple[int, int]) -> None:
    """Of whole numbers, which are exact: laid side by side for few boxes, term by term for many.

    Side by side they are added up by a matrix, or by runs where that is too much to multiply.
    """
    order, rng = 4, np.random.default_rng(3)
    assert (np.prod(boxes) * 70 > MOST_GATHERED) == (boxes == (40, 25))  # 70 pairs are kept
    assert (np.prod(boxes) * 70 * 15 > linear.ONE_THREAD) == (boxes != (3, 2))  # 15 products
    shapes = [((5, 5, *boxes), (5, 5, *boxes)), ((5, 1, boxes[0], 1), (5, 5, *boxes)),
              ((2, 3, *boxes), (4, 5, 1, boxes[1])), ((1, 1, 1, 1), (5, 5, *boxes)),
              ((2, 5, 1, boxes[1]), (5, 1, boxes[0], 1))]  # fmt: skip
    assert len(shapes) == 5
    for shape, other in shapes:
        x, y = (rng.integers(-9, 10, s).astype(float) for s in (shape, other))
        kept = [np.add.outer(*map(np.arange, s[:2])) <= order for s in (shape, other)]
        x, y = x * kept[0][..., None, None], y * kept[1][..., None, None]
        found = product(x, y, order)
        whole = np.zeros((9, 9, *boxes))
        for i, j in np.ndindex(*shape[:2]):
            whole[i : i + other[0], j : j + other[1]] += x[i, j] * y
        whole *= (np.add.outer(np.arange(9), np.arange(9)) <= order)[..., None, None]
        a, b = found.shape[:2]
        np.testing.assert_array_equal(found, whole[:a, :b])
        assert not whole[a:].any()
        assert not whole[:, b:].any()


def test_pieces_have_the_same_values_at_many_places_as_at_few() -> None:
    rows = tuple(tuple(number(Fraction(k * n + 1, n + 2)) for n in range(5)) for k in range(4))
    tree = pieces(U, tuple(Fraction(k, 4) for k in range(5)), rows, 0, closed=False)
    run, places = Program((tree,)), np.linspace(0, 1, 20_001)
    (many,) = run({"u": places})
    k = np.minimum((4 * places).astype(int), 3)
    table = np.array([[float(c.payload) for c in row] for row in rows])
    exact = np.zeros_like(places)
    for n in reversed(range(5)):
        exact = exact * (places - k / 4) + table[k, n]
    np.testing.assert_array_equal(many, exact)
    few = [run({"u": places[i : i + 100]})[0] for i in range(0, len(places), 100)]
    np.testing.assert_array_equal(np.concatenate(few), many)
