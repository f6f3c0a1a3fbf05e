"""Exact means exact: what a term is worth over the box decides whether it is rounding."""

from __future__ import annotations

from fractions import Fraction
from math import exp, pi

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.domain.analysis import analyse
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.equation.point_equation import point_equation
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.intervals import interval
from pc2cad.expression.magnitudes import PLACES, bound, extent, least, rounding
from pc2cad.expression.normal_form import NormalForm, normal_form
from pc2cad.expression.tree import ZERO, Expr, number
from pc2cad.geometry.carriers import Cylinder, Frame, Line, Plane, Torus
from pc2cad.geometry.recognition.from_separable_form import arc, is_straight, lay, plane
from pc2cad.geometry.recognition.implicit import holds
from pc2cad.geometry.recognition.separable_form import is_planar, separate
from pc2cad.representation.face_carriers import planes_of

U, V, W = pc.parameters()
COS, SIN = pc.cos, pc.sin
FACE = ("u", "v")
PLACE = Fraction(3711, 10000)
#: of the needles below
HEIGHT = 1e-15 * exp(34.5)


def ten(exponent: int) -> Expr:
    return number(Fraction(10) ** exponent)


def needle(t: Expr, share: int = -15, sharpness: int = 6) -> Expr:
    return ten(share) * pc.exp(Fraction(69, 2) - ten(sharpness) * (t - PLACE) ** 2)


def chebyshev(t: Expr, degree: int) -> Expr:
    """T_degree(2t - 1), written out in powers of t: of size 1, with huge coefficients."""
    powers = np.polynomial.chebyshev.cheb2poly([0] * degree + [1])
    return sum((int(c) * (2 * t - 1) ** k for k, c in enumerate(powers.tolist()) if c), ZERO)


#: functions of tiny coefficients, or among huge ones, that are worth something
WORTH = {
    "needle": needle,
    "narrow needle": lambda t: needle(t, sharpness=12),
    "small needle": lambda t: needle(t, share=-23),
    "exponential": lambda t: ten(-20) * pc.exp(40 * t),
    "huge times tiny": lambda t: ten(15) * pc.exp(-40 - t),
    "hyperbolic": lambda t: ten(-18) * pc.cosh(36 * t) * pc.tanh(t),
    "rational needle": lambda t: ten(-14) / (ten(-13) + (t - PLACE) ** 2),
    "unbounded": lambda t: ten(-20) * pc.log(t),
    "wave": lambda t: ten(-8) * SIN(9 * t),
}
#: functions that are rounding
WORTHLESS = {
    "needle": lambda t: needle(t, share=-30),
    "huge times tiny": lambda t: ten(15) * pc.exp(-80 - t),
    "wave": lambda t: ten(-16) * SIN(9 * t),
    "rational": lambda t: ten(-28) / (ten(-13) + (t - PLACE) ** 2),
    "nothing": lambda t: ZERO,
}
SIZES = (Fraction(1, 1000), 1, 100000)

#: faces with a bump h that are on no plane, or on none of the analytic surfaces
SHAPES = {
    "plane": lambda h: (U, V, 2 * U + h(U)),
    "tilted plane": lambda h: (U + V / 3 + h(U) / 7, U - V, V / 5 + h(U)),
    "cylinder": lambda h: ((1 + h(V)) * COS(U), (1 + h(V)) * SIN(U), V),
    "cone": lambda h: ((1 + V + h(V)) * COS(U), (1 + V + h(V)) * SIN(U), V),
    "sphere": lambda h: tuple(
        (1 + h(V)) * x for x in (COS(V) * COS(U), COS(V) * SIN(U), SIN(V))
    ),
}  # fmt: skip


def carried(trees: tuple[Expr, ...]) -> bool:
    """Whether a face is said to lie on a plane or a quadric: no profile but a line or an arc."""
    form = separate(trees, FACE)
    if is_planar(trees, FACE) or (form is not None and plane(form) is not None):
        return True
    placed = form and lay(form)
    return bool(placed) and not any(along.values is None for along in (placed.a, placed.b))


def scaled(trees: tuple[Expr, ...], size: Fraction | int) -> tuple[Expr, ...]:
    return tuple(size * tree for tree in trees)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_bump_is_no_rounding_however_small_its_coefficient(shape, size):
    assert len(WORTH) == 9
    taken = [name for name, h in WORTH.items() if carried(scaled(SHAPES[shape](h), size))]
    assert taken == []


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("shape", ["plane", "tilted plane", "cylinder", "cone"])
def test_rounding_is_dropped_whatever_its_function_is(shape, size):
    assert len(WORTHLESS) == 5
    lost = [name for name, h in WORTHLESS.items() if not carried(scaled(SHAPES[shape](h), size))]
    assert lost == []


def test_bumps_along_a_surface_leave_it_exact():
    on_cylinder = (COS(U), SIN(U), V + needle(V) / 1000)
    in_plane = (U + needle(U), V, 3 * V - U - needle(U))
    assert isinstance(lay(separate(on_cylinder, FACE)).carrier(None), Cylinder)
    assert is_planar(in_plane, FACE)
    assert plane(separate(in_plane, FACE)) is not None


def test_coefficients_that_cancel_hide_no_term():
    wavy = chebyshev(U, 28)
    assert not carried((U + wavy / 100, V, ten(-5) * (U**2 + V**2)))
    assert carried((U + wavy / 100, V, 3 * V))


def test_edges_with_a_bump_are_no_lines_and_no_circles():
    assert len(WORTH) == 9
    for h in WORTH.values():
        line = separate((U, h(U), 2 * U), ("u",))
        circle = separate(((1 + h(U)) * COS(U), (1 + h(U)) * SIN(U), ZERO), ("u",))
        assert line is None or not is_straight(line)
        assert circle is None or arc(circle) is None
    assert is_straight(separate((U, needle(U, share=-30), 2 * U), ("u",)))
    assert arc(separate((COS(U), SIN(U), ten(-16) * COS(3 * U)), ("u",))) is not None


#: a quarter of a circle without angles
ROUND = ((1 - V**2) / (1 + V**2), 2 * V / (1 + V**2))
FRAME = Frame(np.zeros(3), np.eye(3))


#: denominators are multiplied out, and bounds of what is then expanded are too wide here
PROVED = {name: h for name, h in WORTHLESS.items() if name != "rational"}


@pytest.mark.parametrize(("functions", "exact"), [(WORTH, False), (PROVED, True)])
def test_a_proof_from_the_equation_bounds_values(functions, exact):
    assert len(functions) >= 4
    for h in functions.values():
        bump = h(U)
        pipe = tuple((1 + bump) * x for x in ROUND)
        on_line = Line(np.zeros(3), np.array([1.0, 0.0, 2.0]))
        assert holds(Plane(np.zeros(3), np.array([0.0, 0.0, 1.0])), (U, V, bump)) is exact
        assert holds(on_line, (U, bump, 2 * U)) is exact
        assert holds(Cylinder(FRAME, 1.0), (*pipe, U)) is exact


def test_a_torus_whose_circle_is_nearly_on_the_axis_is_proved_as_sharply():
    """Its equation is squared; beside the root that holds, the other is hardly anything."""
    major = Fraction(1, 2**16)
    torus = Torus(FRAME, float(major), 1.0)

    def point(bump: Expr) -> tuple[Expr, ...]:
        along, up = ((1 + bump) * x for x in ROUND)
        return (major + along) * COS(U), (major + along) * SIN(U), up

    assert holds(torus, point(ZERO))
    assert not holds(torus, point(needle(V, share=-22)))


def test_no_bound_no_rounding():
    (monomial,) = normal_form(pc.log(U))
    assert bound(monomial) == np.inf
    assert separate((U, V, ten(-30) * pc.log(U)), FACE) is None


def test_bounds_hold_and_are_near():
    tree = pc.exp(Fraction(69, 2) - ten(6) * (U - PLACE) ** 2) * COS(3 * U)
    (monomial,) = normal_form(tree)
    true = exp(34.5) * np.cos(3 * float(PLACE))
    assert true <= bound(monomial) <= 1.2 * true


def test_what_is_seen_is_no_more_than_the_extent():
    corner = extent((3 * U, 4 * V, ZERO), FACE)
    assert corner == pytest.approx(5, rel=1e-15)
    assert extent((chebyshev(U, 12),), ("u",)) == pytest.approx(2, rel=1e-2)
    assert len(PLACES) == 19
    assert rounding(1.0, 1.0) < 1e-12 < rounding(1.0, 1e30) <= 1e-10


def top(height: Expr) -> RestrictedMap:
    """Return the face w = 1 of a box with a height, as a map."""
    return RestrictedMap(analyse(point_equation((U, V, W * height))), (1, 1, 2))


@pytest.mark.parametrize("sharpness", [6, 8, 10])
def test_a_needle_between_all_samples_is_no_plane(sharpness):
    face = top(1 + needle(U, sharpness=sharpness) * (1 + V))
    assert planes_of([face], [1], 1e-12) == [None]


def test_a_plane_that_only_samples_show_stays_one():
    """An identity that no normal form knows, so that nothing proves the plane."""
    face = top(2 + pc.log(1 + U) + pc.log(1 + V) - pc.log((1 + U) * (1 + V)))
    ((found, evidence),) = planes_of([face], [1], 1e-12)
    assert evidence == "sampled"
    assert found.normal == pytest.approx((0, 0, 1), abs=1e-12)


@pytest.mark.slow
def test_a_needle_on_a_box_is_bounded_not_exact():
    part = pc.compile_part((U, V, W * (1 + needle(U))), tolerance=1e-3)
    evidence = {face.name: face.evidence for face in part.report.faces}
    assert len(evidence) == 6
    assert evidence.pop("w=1") == "bounded"
    assert set(evidence.values()) == {"exact"}
    true = 1 + HEIGHT * (pi / 1e6) ** 0.5
    assert part.report.solid.volume == pytest.approx(true, rel=1e-5)


@pytest.mark.slow
def test_a_needle_along_a_pipe_is_bounded_not_exact():
    bump = 1 + needle(V) / 10
    part = pc.compile_part(((1 + W) * COS(U) * bump, (1 + W) * SIN(U) * bump, V), tolerance=1e-3)
    evidence = {face.name: face.evidence for face in part.report.faces}
    assert (evidence["w=0"], evidence["w=1"]) == ("bounded", "bounded")


def test_normal_forms_do_not_depend_on_what_is_remembered() -> None:
    common = (U + 3) * COS(2 * V) - W
    roots = [common * common, common * SIN(V) + U**3, -common, common * common * W]
    alone = [normal_form(root, 40) for root in roots]
    known: dict[Expr, NormalForm] = {}
    together = [normal_form(root, 40, known=known) for root in roots]
    assert together == alone
    # in the same order of their terms, too
    assert [list(form or ()) for form in together] == [list(form or ()) for form in alone]
    large = common**12
    assert normal_form(large, 40) is None
    assert normal_form(large, 40, known=known) is None
    assert normal_form(roots[0], 40, known=known) == alone[0]


def test_functions_of_one_parameter_are_bounded_by_their_enclosures_over_even_parts() -> None:
    ends = np.linspace(0.0, 1.0, 33)
    for tree in (pc.sqrt(2 + COS(7 * V)) / (1 + V * V), needle(V), pc.abs(3 * V - 1), 2 * V):
        parts = IntervalProgram((tree,))({"v": interval(ends[:-1], ends[1:])})[0].magnitude()
        assert bound(((tree, 1),)) >= parts.upper.max()
        assert np.array_equal(least(tree)[0, :, 0], parts.lower)
