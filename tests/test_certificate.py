"""Proofs that det J keeps its sign: found where it does, never where it does not."""

from __future__ import annotations

import time
from fractions import Fraction
from itertools import combinations

import mpmath
import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from shipped import every_template
from test_intervals import TREES, X, Y, inside, truth

import pc2cad as pc
from pc2cad.bounds.known import Known
from pc2cad.domain.jacobian_watch import FoldedMapError
from pc2cad.domain.map import local_map
from pc2cad.equation.point_equation import point_equation
from pc2cad.expression.centred import CentredProgram
from pc2cad.expression.evaluation import Program
from pc2cad.expression.intervals import interval
from pc2cad.expression.normal_form import determinant_form, normal_form
from pc2cad.expression.tree import ONE, Expr, as_expr, call, div, number, symbol
from pc2cad.solidity.jacobian_proof import proved_sign, separable, triple_models
from pc2cad.solidity.jacobian_proof.determinant import determinant
from pc2cad.solidity.jacobian_proof.enclosures import sign_from_enclosures
from pc2cad.solidity.jacobian_proof.factors import sign_from_factors, sign_of_form
from pc2cad.solidity.jacobian_proof.polynomial import sign_from_coefficients
from pc2cad.solidity.jacobian_proof.separable import sign_from_products
from pc2cad.solidity.jacobian_proof.triples import Scaled, triple
from pc2cad.solidity.orientation import find_orientation
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import template_paths

U, V, W = pc.parameters()
PI = pc.pi
COS, SIN = pc.cos(2 * PI * U), pc.sin(2 * PI * U)
#: sign of det J (spec 6): negative for A1, A4-A8, A12-A16 and all channels, and where (u, v, w) run
#: along, round, outwards (bellows), round, outwards, up (cam, coil), or back, across, down (hull)
NEGATIVE = {
    "oblique_prism", "ball", "half_ball", "ball_wedge", "hollow_ball", "ellipsoid", "cone",
    "cone_frustum", "hollow_cylinder", "turned_ring", "helical_channel", "channel_ellipse",
    "channel_sine", "channel_contour", "pyramid", "pyramid_cut", "pyramid_sum",
    "pyramid_truncated", "simplex_ball", "simplex_cone", "simplex_hyperboloid",
    "simplex_paraboloid", "duct", "figure_of_eight", "layered_pipe", "spring", "square_to_round",
    "trefoil", "bellows", "coil", "disc_cam", "propeller_blade", "stellarator_wall",
    "wigley_hull",
}  # fmt: skip


def mapped(map_, domain=None):
    return local_map(point_equation(map_, domain))


@every_template
def test_every_template_is_proved(path):
    mapping = local_map(read_template(path).bind({}))
    assert proved_sign(mapping) == (-1 if path.stem in NEGATIVE else 1)


def wobble(share):
    """x = u + share·sin(2πku)/(2πk) turns back where the share is above 1."""
    return (U + share / (14 * PI) * pc.sin(14 * PI * U), V + pc.exp(U) * W / 9, W)


@pytest.mark.parametrize("share", [0, 0.5, 0.99, 0.9999])
def test_a_map_on_the_safe_side_of_a_fold_is_proved(share):
    assert proved_sign(mapped(wobble(share))) == 1


@pytest.mark.parametrize("share", [1, 1.0001, 1.01, 2])
def test_a_fold_is_never_proved_sound(share):
    assert proved_sign(mapped(wobble(share))) == 0
    assert proved_sign(mapped(tuple(reversed(wobble(share))))) == 0


def tilted(depth):
    """det J has a dip of half-width 1e-3 at an irrational place, down to 1 - depth."""
    a, b = U - Fraction(4142, 10000), V - Fraction(7321, 10000)
    return U, V, W * (1 - depth * pc.exp(-(a**2 + b**2) * 10**6))


def test_a_narrow_dip_between_all_samples_is_seen():
    assert proved_sign(mapped(tilted(0.9))) == 1
    assert proved_sign(mapped(tilted(1.1))) == 0


def furrow(shape, depth):
    """A brick whose thickness is 1 - depth where a shape of height 1 is highest."""
    a, b = U - Fraction(4289, 10000), V - Fraction(3675, 10000)
    height = {
        "ridge": pc.exp(-((b / Fraction(887, 10000)) ** 2)),
        "needle": pc.exp(-(a**2 + b**2) / Fraction(727, 10000) ** 2),
        "wave": (1 + pc.cos(8 * PI * b)) / 2,
        "crease": (1 - abs(a)) * pc.exp(-((b / Fraction(309, 10000)) ** 2)),
    }[shape]
    return 2 * U, 3 * V, W * (1 - depth * height)


@pytest.mark.parametrize("shape", ["ridge", "needle", "wave", "crease"])
def test_a_shallow_fold_is_found_where_the_proof_ends(shape):
    """Its place is not among those of any sweep, and steep slopes beside it mislead."""
    with pytest.raises(FoldedMapError, match="near u = "):
        find_orientation(mapped(furrow(shape, Fraction(100_003, 100_000))))
    assert find_orientation(mapped(furrow(shape, Fraction(99, 100)))).sign == 1


#: maps, and the sign of their det J by hand: u, v, w turn left-handed round an axis
SOUND = {
    "pole of high order": ((V * W**5 * COS, V * W**5 * SIN, W**5), -1),
    "cusp": ((V * W**3 * COS, V * W**3 * SIN, W), -1),
    "slow at two sides": ((U**3, V**3 * (1 + W / 9), W), 1),
    "slow where tangents are parallel": ((U**3, V**3 * (1 + U / 9), W), 1),
    "tip of a paraboloid": ((V * W * COS, V * W * SIN, W**2), -1),
    "pole at the end": ((V * (1 - W**2) * COS, V * (1 - W**2) * SIN, 2 * W - 1), -1),
    "turned by a tangent": (
        (pc.tan(U), pc.atan2(V + 1, 1 + U), pc.log(1 + W) + pc.sinh(U) / 4), 1,
    ),
    "root": ((pc.sqrt(1 + U + V) + U, V, W), 1),
    "absolute value": ((U, V, W * (1 + abs(V - 0.5))), 1),
}  # fmt: skip


@pytest.mark.parametrize("name", SOUND)
def test_sound_maps_are_proved_by_enclosures(name):
    map_, sign = SOUND[name]
    assert sign_from_enclosures(mapped(map_)) == sign
    assert sign_from_enclosures(mapped((map_[1], map_[0], map_[2]))) == -sign


Q = 1 + (2 * U - 1) ** 2  # a circle as a rational curve
RATIONAL = {
    "projective brick": ((U / (1 + W), V / (1 + W), W / (1 + W + U)), 1),
    "rational half disc": (
        (V * 2 * (2 * U - 1) / Q, V * (1 - (2 * U - 1) ** 2) / Q, W * (1 + 1 / (2 + V))), 1,
    ),
    "reciprocal powers": (((1 + U) ** -2, V * (1 + U) ** -1, W), -1),
}  # fmt: skip


@pytest.mark.parametrize("name", RATIONAL)
def test_rational_maps_are_proved_by_coefficients(name):
    map_, sign = RATIONAL[name]
    assert sign_from_coefficients(mapped(map_)) == sign
    assert sign_from_coefficients(mapped((map_[1], map_[0], map_[2]))) == -sign


def swept(radius, turns=1):
    """det J = -2 pi turns · r r_v · z_w for a section of radius r(v) and height W."""
    angle = 2 * PI * turns * U
    return radius * pc.cos(angle), radius * pc.sin(angle), W


FACTORS = {
    "pole": (swept(V * W**3), -1),
    "both poles": ((W * pc.sin(PI * V) * COS, W * pc.sin(PI * V) * SIN, W * pc.cos(PI * V)), -1),
    "cosine in its half turn": ((U, V, pc.sin(PI * (W - Fraction(1, 2)))), 1),
    "apex": ((U * (1 - W), V * (1 - W), W), 1),
    "root": (swept(pc.sqrt(1 + V**2)), -1),
    "root that ends at a side": (swept(pc.sqrt(V)), -1),
    # det J vanishes on planes, lines or points inside the box or its sides
    "four cusps": ((W * COS**3, W * SIN**3, 2 * V), 1),
    "a slit between foci": (
        (pc.cosh(Fraction(3, 2) * V) * COS, pc.sinh(Fraction(3, 2) * V) * SIN, W), -1
    ),
    "Viviani's body": (
        (2 * W * pc.sin(PI * U) ** 2, 2 * W * pc.sin(PI * U) * pc.cos(PI * U),
         V * pc.sqrt(4 - 4 * W**2 * pc.sin(PI * U) ** 2)), -1,
    ),
    "an even power": ((U, V, W * COS**4), 1),
    "squares": ((U, V, W * (COS**2 + pc.sin(U + 3 * V) ** 2)), 1),
}  # fmt: skip


@pytest.mark.parametrize("name", FACTORS)
def test_factors_prove_the_sign(name):
    map_, sign = FACTORS[name]
    assert sign_from_factors(mapped(map_)) == sign
    assert sign_from_factors(mapped(tuple(reversed(map_)))) == -sign


@pytest.mark.parametrize("exponent", [Fraction(1, 2), Fraction(2, 3), Fraction(3, 4)])
def test_roots_are_proved_in_parameters_that_run_evenly(exponent):
    """As it is written: every term of det J has the same sign by itself."""
    a, b = PI * U / 2, PI * V / 2
    x, y = (W * f(a) ** exponent * pc.cos(b) ** exponent for f in (pc.cos, pc.sin))
    mapping = mapped((x, y, W * pc.sin(b) ** exponent))
    assert mapping.even
    assert sign_from_factors(mapping) == 0
    assert proved_sign(mapping) == 1
    assert proved_sign(mapped((y, x, W * pc.sin(b) ** exponent))) == -1


#: integrals of what det J is to be
NO_SIGN = {
    "a parameter beyond its limit": U**2 / 2 - Fraction(9, 20) * U,
    "a zero inside": (U - Fraction(1, 2)) ** 2,
    "sine over a whole turn": pc.cos(2 * PI * U),
    "sine past half a turn": pc.cos(Fraction(101, 100) * PI * U),
    "cosine past a quarter": pc.sin(Fraction(51, 100) * PI * U),
    "touches zero between": U + pc.sin(2 * PI * U) / (2 * PI),
    "just past zero": U + Fraction(1000001, 1000000) * pc.sin(2 * PI * U) / (2 * PI),
    "an angle that is no share of pi": pc.cos(Fraction(315, 100) * U),
}


@pytest.mark.parametrize("name", NO_SIGN)
def test_factors_prove_nothing_where_the_sign_changes_or_zero_is_reached(name):
    for map_ in ((NO_SIGN[name], V, W), (V, NO_SIGN[name], W + V * U)):
        assert sign_from_factors(mapped(map_)) == 0


#: heights of which some are negative somewhere, or nothing on a part of the box
NO_HEIGHT = {
    "odd power": COS**3,
    "square less than it has to be": COS**2 - Fraction(1, 10**6),
    "squares that do not add up": COS**2 - pc.sin(U + 3 * V) ** 2,
    "flat on a half": (U - Fraction(1, 2) + abs(U - Fraction(1, 2))) ** 2,
    "flat where a root is what it is of": (pc.sqrt((U - Fraction(1, 3)) ** 2) - U + 0.5) ** 2,
    "a constant in disguise": pc.sin(pc.cos(U) ** 2 + pc.sin(U) ** 2 - 1) ** 2,
}


@pytest.mark.parametrize("name", NO_HEIGHT)
def test_factors_prove_nothing_of_heights_that_are_negative_or_nothing(name):
    assert sign_from_factors(mapped((U, V, W * NO_HEIGHT[name]))) == 0


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.integers(-9, 9), min_size=8, max_size=8), st.integers(2, 4))
def test_factors_and_coefficients_agree_on_polynomials(numbers, power):
    a, b, c, d, e, f, g, h = numbers
    x, y = a * U + b * V * W + c * W**power, d * V + e * U * W + f * U * V
    mapping = mapped((x, y, g * W + h * U * V))
    exact, rounded = sign_from_factors(mapping), sign_from_coefficients(mapping)
    assert exact * rounded >= 0
    places = np.random.default_rng(0).random((3, 2000))
    tangents = mapping.tangents((0, 1, 2), *places)
    determinant = np.linalg.det(np.stack(tangents, axis=-1))
    if exact:
        assert (exact * determinant > -1e-9).all()


def test_rational_folds_and_poles_are_not_proved():
    assert proved_sign(mapped((U / (1 + 3 * U**2), V, W))) == 0  # turns back at 1/sqrt(3)
    assert proved_sign(mapped((1 / (U - Fraction(2, 5)), V, W))) == 0


def test_a_duct_with_corners_is_proved():
    square = pc.polygon(((1, 1), (-1, 1), (-1, -1), (1, -1)), V)
    # v runs round counter-clockwise, w outwards, u upwards: (u, v, w) is left-handed
    assert sign_from_enclosures(mapped((square[0] * (1 + W), square[1] * (1 + W), 3 * U))) == -1


def test_the_effort_is_bounded():
    waves = sum((pc.sin(k * 7 * (U + V * W)) / k for k in range(1, 12)), start=U)
    mapping = mapped((U, V + waves / 300, W + pc.exp(waves / 7) * U))
    start = time.process_time()
    proved_sign(mapping)
    assert time.process_time() - start < 3


#: coarse enough for differences to show in 60 digits
floats = st.floats(-8, 8, width=16) | st.sampled_from([0.0, 1.0, 1e-8])


@pytest.mark.parametrize("root", [X**-1, X**-3, pc.tan(X), pc.atan2(X, Y - 2), 1 / X + X])
def test_no_slope_reaches_over_a_pole_or_a_cut(root):
    boxes = {"x": interval(np.array([-1.5]), np.array([2.5]))}
    if "y" in root.symbols:
        boxes["y"] = interval(np.array([0.0]), np.array([1.0]))
    (found,) = CentredProgram((root,))(boxes)
    assert (found.slopes["x"].lower, found.slopes["x"].upper) == (-np.inf, np.inf)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(root=st.sampled_from(TREES), a=floats, b=floats, c=floats, d=floats, s=inside, t=inside)
def test_slopes_bound_every_change(root, a, b, c, d, s, t):
    limits = {"x": (min(a, b), max(a, b)), "y": (min(c, d), max(c, d))}
    limits = {k: limits[k] for k in root.symbols}
    boxes = {k: interval(np.array([low]), np.array([high])) for k, (low, high) in limits.items()}
    (found,) = CentredProgram((root,))(boxes)
    shares = {"x": s, "y": t}
    with mpmath.workdps(60):
        near = {k: float(box.middle[0]) for k, box in boxes.items()}
        place = {k: min(max(lo + (hi - lo) * shares[k], lo), hi) for k, (lo, hi) in limits.items()}
        value, centre = truth(root, place), truth(root, near)
        if value is None or centre is None:
            reject()
        for truth_, enclosed in ((value, found.value), (centre, found.centre)):
            assert float(enclosed.lower[0]) <= truth_ <= float(enclosed.upper[0])
        low = high = mpmath.mpf(0)
        for name, slope in found.slopes.items():
            step = mpmath.mpf(place[name]) - near[name]
            if step == 0:
                continue
            ends = sorted(mpmath.mpf(float(x[0])) * step for x in (slope.lower, slope.upper))
            low, high = low + ends[0], high + ends[1]
        rounding = mpmath.mpf(10) ** -50 * (1 + abs(value) + abs(centre))
        assert low - rounding <= value - centre <= high + rounding


# -- sums of products ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        *(n for n in template_paths() if "channel" in n or "torus" in n),
        # knots at the ends of a parameter and inside it
        "duct",
        "square_to_round",
    ],
)
def test_products_of_functions_of_one_parameter_agree(name):
    mapping = local_map(read_template(template_paths()[name]).bind({}))
    assert sign_from_products(mapping) == (-1 if name in NEGATIVE else 1)


def test_models_of_vectors_hold_their_triple_products():
    u = symbol("u")
    one, root = call("cos", u) + 2, div(ONE, call("sqrt", u * u + 1))
    rows = [
        Scaled(ONE, (u, u * u, call("sin", u)), ONE),
        Scaled(root, (one, call("sin", 3 * u), u * u * u), ONE),
        Scaled(-one, (u * root, one * one, call("sin", u) * u), ONE),
        Scaled(call("sin", u) - 2, (u, ONE, one), ONE),
    ]
    place = separable._boxes(16, 1, ())
    every = [(k, i, j) for i, j in combinations(range(4), 2) for k in range(4)]
    for triples in (every, [(k, 1, 2) for k in range(4)]):
        middle, off, _ = triple_models.ranges_of_triples(rows, triples, "u", place, Known())
        assert (off < 0.4 * np.abs(middle).max()).all()
        for share in (-1, -0.3, 0.8, 1):
            at = {"u": place.centre + share * place.half}
            lengths = np.array(Program(tuple(row.length for row in rows))(at)[1:])
            for row, (k, i, j) in enumerate(triples):
                (value,) = Program((triple(rows, k, i, j, "u"),))(at)
                if triples is not every:  # what all have in common is left out
                    value = value / np.abs(lengths[i - 1] * lengths[j - 1])
                gap = np.abs(value * place.half - middle[row])
                assert (gap <= off[row] * (1 + 1e-12) + 1e-15).all()


@pytest.mark.parametrize("name", ["helical_channel", "ball", "pyramid_cut", "turned_ring", "coil"])
def test_a_determinant_in_whole_numbers_is_the_same_form(name):
    columns = local_map(read_template(template_paths()[name]).bind({})).derivatives
    found = determinant_form(columns)
    form = normal_form(determinant(columns))
    assert found is not None
    assert form is not None
    assert list(found) == list(form)
    (factor,) = {found[monomial] / c for monomial, c in form.items()}
    assert factor > 0
    assert all(int(c) == c for c in found.values())
    assert determinant_form(columns, 1) is None or len(form) == 1


def test_a_length_that_may_vanish_leaves_triple_products_open():
    u = symbol("u")
    rows = [
        Scaled(u - number(Fraction(1, 2)), (u, ONE, u * u), ONE),
        Scaled(ONE, (call("sin", u), u, ONE), ONE),
    ]
    middle, off, _ = triple_models.ranges_of_triples(
        rows, [(0, 0, 1)], "u", separable._boxes(8, 1, ()), Known()
    )
    clear = off < np.abs(middle)
    assert not clear[0, 3:5].any()


def test_a_section_that_shrinks_to_an_axis_off_its_middle():
    radius = pc.sqrt(1 + 5 * COS**2) + pc.sin(2 * PI * U + V) / 5
    x, y = (middle * (1 - W) + radius * turn * W for middle, turn in ((0.4 * V, COS), (0.2, SIN)))
    mapping = mapped((x, y, V + W * COS / 10))
    assert sign_from_factors(mapping) == 0
    assert sign_from_products(mapping) == 1 == sign_from_enclosures(mapping)


def bent(reach):
    """A rod of this half width along a wave whose least radius of curvature is 1."""
    slope = pc.cos(U)
    length = pc.sqrt(1 + slope**2)
    x, y, z = (2 * V - 1) * reach, (2 * W - 1) * reach, 1 / length
    return (U - x * slope * z, pc.sin(U) + x * z, y)


@pytest.mark.parametrize(("reach", "sign"), [(0.3, 1), (0.99, 1), (1.0, 0), (1.01, 0), (3, 0)])
def test_a_channel_is_proved_up_to_its_bend(reach, sign):
    mapping = mapped(bent(reach), {"u": (0, pc.pi)})
    assert sign_from_products(mapping) == sign


def test_only_boxes_without_a_sign_are_halved(monkeypatch):
    boxes, enclose = [], separable.enclose

    def counted(trees, names, places, order, known):
        if len(places) == 2:
            spread = [place.spread(axis) for axis, place in enumerate(places)]
            boxes.append(np.broadcast(*(place.centre for place in spread)).size)
        return enclose(trees, names, places, order, known)

    monkeypatch.setattr(separable, "enclose", counted)
    mapping = mapped((U / (1.02 + pc.sin(6 * V) * pc.cos(6 * W)), V, W))
    assert sign_from_products(mapping) == 1
    _, first, ends, *halves = boxes
    assert (first, ends, len(halves)) == (128, 4, 3)
    # equal boxes as small as the last ones are 8,192
    assert sum(halves) < 1000


@given(*[st.integers(-60, 60).map(lambda n: n / 40)] * 3, st.sampled_from("uvw"))
@settings(max_examples=20, deadline=None)
def test_products_never_prove_a_fold(a, b, c, turned):
    waves = {"u": pc.sin(3 * U), "v": V**2 * pc.exp(V), "w": pc.cos(2 * W)}
    other = {"u": V, "v": W, "w": U}[turned]
    mapping = mapped(
        (U + a * waves[turned] * other, V + b * U * waves["w"], W + c * waves["v"] * U)
    )
    sign = sign_from_products(mapping)
    grid = np.ix_(*[np.linspace(0, 1, 9)] * 3)
    x, y, z = (m.reshape(-1, 3) for m in mapping.tangents((0, 1, 2), *grid))
    seen = (x * np.cross(y, z)).sum(axis=1)
    assert not sign or (sign * seen > 0).all()
    assert sign or np.abs(seen).min() < 0.3 or seen.min() * seen.max() < 0


def test_coefficients_know_a_fold_of_any_depth():
    """x = u² - εu turns back at u = ε/2: nothing is rounded, so no ε is small enough to pass."""
    for share in (Fraction(1, 10**6), Fraction(1, 10**15), Fraction(1, 10**30)):
        assert sign_from_coefficients(mapped((U**2 - share * U, V, W))) == 0
        assert sign_from_coefficients(mapped((U**2 + share * U, V, W))) == 1


@pytest.mark.parametrize(
    ("atom", "sign"),
    [
        (1 / pc.sqrt(2 * PI**4), 1),
        (1 / (3 + (pc.e - PI) ** 2), 1),
        (PI - 3, 1),
        (3 - PI, -1),
        (-1 / pc.sqrt(PI), -1),
        (pc.sqrt(PI - 3) * (pc.e - 3), -1),
        (pc.sin(5) - pc.cos(5), -1),
        (PI - PI * 1, 0),
    ],
)
def test_signs_of_constants(atom: Expr, sign: int) -> None:
    form = {((as_expr(U), 1), (as_expr(atom), 1)): Fraction(-2)}
    assert sign_of_form(form) == -sign
