"""Tables: functions through given values, held against SciPy's, and the solids made of them."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import Akima1DInterpolator, CubicSpline, PchipInterpolator

import pc2cad as pc
from pc2cad.equation.tables import TableFunction
from pc2cad.errors import InputError
from pc2cad.expression.breaks import BreaksNotAlignedError, find_breaks
from pc2cad.expression.centred import CentredProgram
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.evaluation import Program
from pc2cad.expression.exact import ValueDomainError
from pc2cad.expression.intervals import interval
from pc2cad.expression.printing import as_latex, as_text
from pc2cad.expression.ranges import BeyondTableError
from pc2cad.expression.tree import Expr

u, v, w = pc.parameters()
few = settings(max_examples=40, deadline=None, derandomize=True)
steps = st.lists(st.sampled_from([0.1, 0.25, 0.5, 1.0, 3.0]), min_size=1, max_size=8)
heights = st.lists(st.integers(-60, 60), min_size=9, max_size=9)

#: kind -> the same by SciPy, of ascending places and values
KINDS = {
    "linear": None, "pchip": PchipInterpolator, "akima": Akima1DInterpolator,
    "cubic": lambda x, y: CubicSpline(x, y, bc_type="natural"),
}  # fmt: skip


def along(tree: Expr, at: np.ndarray) -> np.ndarray:
    (found,) = Program((tree,))({"u": at})
    return np.broadcast_to(found, at.shape)


@pytest.mark.parametrize("kind", KINDS)
@few
@given(steps=steps, heights=heights)
def test_values_and_slopes_are_those_of_scipy(kind, steps, heights) -> None:
    at = np.cumsum([0.2, *steps])
    values = np.array(heights[: len(at)]) / 8
    tree = pc.table(at.tolist(), values.tolist(), kind)(u)
    places = np.linspace(at[0], at[-1], 41)[1:-1]
    places = places[np.abs(places[:, None] - at).min(axis=1) > 1e-9]
    if kind == "linear":
        wanted, slopes = np.interp(places, at, values), np.diff(values) / np.diff(at)
        slopes = slopes[np.searchsorted(at, places) - 1]
    else:
        truth = KINDS[kind](at, values)
        wanted, slopes = truth(places), truth(places, 1)
    size = 1 + np.abs(values).max()
    assert np.abs(along(tree, places) - wanted).max() < 1e-11 * size
    (slope,) = derivatives((tree,), "u")
    assert np.abs(along(slope, places) - slopes).max() < 1e-9 * size
    assert along(tree, at) == pytest.approx(values, abs=1e-12 * size)


@few
@given(steps=steps, heights=heights, ends=st.tuples(st.integers(-5, 5), st.integers(-5, 5)))
def test_slopes_at_the_ends_and_periods_are_those_of_scipy(steps, heights, ends) -> None:
    at = np.cumsum([0.0, *steps])
    values = np.array(heights[: len(at)]) / 8
    places = np.linspace(at[0], at[-1], 31)
    clamped = CubicSpline(at, values, bc_type=((1, float(ends[0])), (1, float(ends[1]))))
    tree = pc.table(at.tolist(), values.tolist(), ends=ends)(u)
    assert along(tree, places) == pytest.approx(clamped(places), abs=1e-10)
    assume(len(at) > 2)
    values[-1] = values[0]
    tree = pc.table(at.tolist(), values.tolist(), periodic=True)(u)
    turns = np.linspace(at[0] - 2 * at[-1], at[-1] + 3 * at[-1], 57)
    truth = CubicSpline(at, values, bc_type="periodic")
    assert along(tree, turns) == pytest.approx(truth(turns), abs=1e-9)


def test_other_kinds_are_smooth_across_their_period() -> None:
    at, values = [0, 1, 2.5, 4], [1, 3, 2, 1]
    for kind, order in (("linear", 1), ("pchip", 2), ("akima", 2), ("cubic", 3)):
        trees = [pc.table(at, values, kind, periodic=True)(u)]
        for _ in range(order - 1):
            trees += derivatives(trees[-1:], "u")
        for tree in trees:
            before, after = along(tree, np.array([4 - 1e-9, 1e-9]))
            assert before == pytest.approx(after, abs=1e-6), kind
        assert along(trees[0], np.array([4.5, -3.5])) == pytest.approx(
            along(trees[0], np.array([0.5] * 2)))  # fmt: skip


A, B = np.array([0.0, 0.4, 1.0, 1.3]), np.array([0.0, 0.5, 0.7, 1.1, 2.0])
NET = np.round(np.random.default_rng(3).normal(size=(4, 5)), 3)
U, V = np.meshgrid(np.linspace(0, 1.3, 17), np.linspace(0, 2, 19), indexing="ij")


def on_grid(tree: Expr, *axes: np.ndarray) -> np.ndarray:
    (found,) = Program((tree,))(dict(zip("uvw", axes, strict=False)))
    return np.broadcast_to(found, axes[0].shape)


def test_tensors_of_two_are_those_of_scipy() -> None:
    tree = pc.net([A, B], NET.tolist())(u, v)
    inner = CubicSpline(B, NET, axis=1, bc_type="natural")(V[0])
    truth = CubicSpline(A, inner, bc_type="natural")(U[:, 0])
    assert np.abs(on_grid(tree, U, V) - truth).max() < 1e-11
    lines = pc.net([A, B], NET.tolist(), "linear")(u, v)
    rows = np.array([np.interp(V[0], B, row) for row in NET])
    truth = np.array([np.interp(U[:, 0], A, column) for column in rows.T]).T
    assert np.abs(on_grid(lines, U, V) - truth).max() < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_nets_meet_their_values_and_slopes_are_theirs(kind) -> None:
    tree = pc.net([A, B], NET.tolist(), kind)(u, v)
    grid = np.meshgrid(A, B, indexing="ij")
    assert on_grid(tree, *grid) == pytest.approx(NET, abs=1e-12)
    for k, slope in enumerate([*derivatives((tree,), "u"), *derivatives((tree,), "v")]):
        step = 1e-6 * np.eye(2)[k]
        inside = U[1:-1, 1:-1] + 0.003, V[1:-1, 1:-1] - 0.007
        rise = [on_grid(tree, *(x + s * d for x, d in zip(inside, step, strict=True)))
                for s in (-1, 1)]  # fmt: skip
        assert np.abs(on_grid(slope, *inside) - (rise[1] - rise[0]) / 2e-6).max() < 1e-7


def test_tensors_of_three_reproduce_products() -> None:
    at = [[0, 1, 2], [0, 0.5, 2], [0, 1]]
    values = [[[(1 + 2 * a) * (b - 1) * (3 - c) for c in at[2]] for b in at[1]] for a in at[0]]
    tree = pc.net(at, values)(u, v, w)
    x, y, z = np.meshgrid(*[np.linspace(0, 1, 5)] * 3, indexing="ij")
    (found,) = Program((tree,))({"u": 2 * x, "v": 2 * y, "w": z})
    assert found == pytest.approx((1 + 4 * x) * (2 * y - 1) * (3 - z), abs=1e-12)


def hold(trees: tuple[Expr, ...], count: int) -> None:
    random = np.random.default_rng(count)
    low = random.uniform(0, 1, (count, 2))
    high = np.minimum(low + random.choice((1e-5, 0.05, 0.3, 1.0), (count, 1)), 1)
    at = low + (high - low) * random.uniform(0, 1, (count, 2))
    values = Program(trees)({"u": at[:, 0], "v": at[:, 1]})
    box = {name: interval(low[:, k], high[:, k]) for k, name in enumerate("uv")}
    found = zip(values, IntervalProgram(trees)(box), CentredProgram(trees)(box), strict=True)
    for value, plain, centred in found:
        for hull in (plain, centred.value):
            room = 1e-9 * (1 + np.abs(value))
            assert (hull.lower - room <= value).all()
            assert (value <= hull.upper + room).all()


TREES = [
    pc.table(A, NET[:, 0], kind)(1.3 * u * v) * v for kind in KINDS
] + [pc.net([A, B], NET.tolist(), kind)(1.3 * u, 2 * v) for kind in ("pchip", "cubic")]  # fmt: skip


@pytest.mark.parametrize("tree", TREES, ids=range(len(TREES)))
def test_enclosures_hold_samples(tree: Expr) -> None:
    hold((tree, *derivatives((tree,), "u"), *derivatives((tree,), "v")), 300)


@pytest.mark.slow
@pytest.mark.parametrize("tree", TREES, ids=range(len(TREES)))
def test_enclosures_hold_a_hundred_thousand_samples(tree: Expr) -> None:
    hold((tree, *derivatives((tree,), "u"), *derivatives((tree,), "v")), 100_000)


def test_tables_print_by_their_names_and_arguments() -> None:
    chord = pc.table([0, 1, 2], [1, 2, 1])
    assert as_text(chord(2 * u) * v) == "table(2*u)*v"
    assert as_text(derivatives((chord(2 * u),), "u")[0]) == "table'(2*u)*2"
    assert as_text(pc.net([A, B], NET.tolist())(u, v + w)) == "net(u, v + w)"
    assert as_latex(chord(u)) == r"\mathrm{table}\left(u\right)"


def test_places_are_exact_and_so_is_a_linear_table() -> None:
    tree = pc.table([0, Fraction(1, 3), 1], [Fraction(1, 7), 0, 0.1], "linear")(Fraction(1, 6))
    assert tree.payload == Fraction(1, 14)
    assert pc.table([0, 1, 2], [5, 5, 5])(u).payload == 5


# -- solids ----------------------------------------------------------------------------------------


def slab(height: Expr) -> pc.Part:
    return pc.compile_part(pc.point(10 * u, 3 * v, w * height))


CHORD = ([0, 1, 2.5, 4], [1, 2, 1.5, 1])


def test_cubic_tables_are_exact_splines() -> None:
    part = slab(pc.table(*CHORD)(4 * u))
    truth = CubicSpline(*CHORD, bc_type="natural").integrate(0, 4) * 10 * 3 / 4
    assert part.report.solid.volume == pytest.approx(truth, rel=1e-12)
    assert len(part.report.faces) == 6
    assert all(face.evidence == "exact" for face in part.report.faces)


def test_linear_tables_have_a_face_for_each_piece() -> None:
    part = slab(pc.table(*CHORD, "linear")(4 * u))
    assert part.report.solid.volume == pytest.approx(45, rel=1e-12)
    # the second and the third piece lie on one plane
    assert [face.carrier for face in part.report.faces] == ["plane"] * 7


def test_tables_of_functions_of_a_parameter_break_where_these_pass_their_places() -> None:
    height = pc.table(*CHORD)(4 * u * u)
    part = slab(height)
    places = np.linspace(0, 1, 200_001)
    truth = CubicSpline(*CHORD, bc_type="natural")(4 * places**2)
    volume = 30 * float(np.trapezoid(truth, places))
    assert part.report.solid.volume == pytest.approx(volume, rel=1e-8)
    assert all(face.evidence == "exact" for face in part.report.faces)


def test_nets_of_numbers_are_exact_faces() -> None:
    part = slab(pc.net([[0, 1, 2], [0, 1, 3]], [[1, 2, 1], [2, 3, 2], [1, 2, 1.5]])(2 * u, 3 * v))
    assert all(face.evidence == "exact" for face in part.report.faces)
    assert part.report.solid.volume == pytest.approx(part.report.equation.volume, rel=1e-12)


@pytest.mark.slow
def test_a_solid_goes_through_its_points() -> None:
    a = [0, 0.4, 1]
    places = [[[(x * 4, y * 3 + x * x * y, z * (2 + x * y)) for z in a] for y in a] for x in a]
    solid = pc.net([a] * 3, places)
    part = pc.compile_part(solid(u, v, w), tolerance=1e-3)
    assert len(part.report.faces) == 6
    at = solid(Fraction(2, 5), 1, 0)
    assert [float(c) for c in at.coordinates] == pytest.approx(places[1][2][0])


def test_tables_make_guides() -> None:
    spine = pc.table([0, 1, 2], [(0, 0, 0), (1, 0, 5), (0, 0, 10)])
    part = pc.compile_part(pc.channel(spine(2 * u), (pc.cos(2 * pc.pi * v),
                                                     pc.sin(2 * pc.pi * v)), 0.2))  # fmt: skip
    assert part.report.solid.volume == pytest.approx(part.report.equation.volume, rel=1e-6)


# -- refusals --------------------------------------------------------------------------------------

BEYOND = {
    "affine": (lambda t: t(4.1 * u), r"table runs from 0 to 4, .* value at 4.1, where u = 1; end"),
    "curved": (lambda t: t(3 + 2 * pc.sin(pc.pi * u)), r"at 5, where u = 0.5"),
    "of two": (lambda t: t(3 * u + 1.5 * v), r"at 4.5, where u = 1, v = 1"),
    "in a needle": (lambda t: t(3 + 1.5 * pc.exp(-1e4 * (u - 0.3337) ** 2)), r"where u = 0.33"),
    "in a branch": (lambda t: pc.where(u < 0.5, t(9 * u), 1), r"0 to 4, .* at 4.5, where u = 0.5"),
    "below": (lambda t: t(u - 0.5), r"at -0.5, where u = 0"),
}  # fmt: skip


@pytest.mark.parametrize("name", BEYOND)
def test_nothing_is_continued_beyond_the_places(name: str) -> None:
    make, match = BEYOND[name]
    with pytest.raises(BeyondTableError, match=match) as error:
        slab(make(pc.table(*CHORD)) + v)
    assert "\n" not in str(error.value)


def test_constants_beyond_the_places_are_refused_at_once() -> None:
    with pytest.raises(ValueDomainError, match="runs from 0 to 4, and is asked for its value at 5"):
        pc.table(*CHORD)(5)


def test_a_table_may_be_taken_at_one_place_that_is_no_fraction() -> None:
    height = pc.table([0, 3, 4], [1, 2, 4], "linear")(pc.pi)
    assert slab(height).report.solid.volume == pytest.approx(30 * (2 * np.pi - 4), rel=1e-12)


def test_a_branch_that_is_not_taken_may_lie_beyond() -> None:
    part = slab(pc.where(u < 0.25, pc.table(*CHORD, "linear")(16 * u), 1))
    assert part.report.solid.volume == pytest.approx(3 * (2.5 * 1.5 + 7.5), rel=1e-12)


def test_tables_along_a_curve_of_a_face_are_refused_with_its_course() -> None:
    with pytest.raises(BreaksNotAlignedError, match="along a curve through u = "):
        slab(pc.table(*CHORD)(2 * u + 2 * v))


REFUSED = {
    "unsorted": (lambda: pc.table([0, 2, 1], [1, 2, 3]),
                 "at ascends, and 1 follows 2 as number 3 of its list"),
    "twice": (lambda: pc.table([0, 1, 1], [1, 2, 3]), "at ascends, and 1 follows 1"),
    "few": (lambda: pc.table([0], [1]), "a table has at least 2 places along each argument"),
    "short": (lambda: pc.table([0, 1, 2], [1, 2]), "values has 2 entries for 3 places of at"),
    "ragged": (lambda: pc.net([[0, 1], [0, 1]], [[1, 2], [1]]),
               "row 2 of values has 1 entries for 2 places of at"),
    "mixed": (lambda: pc.table([0, 1], [1, (1, 2, 3)]), "all numbers, or all points"),
    "flat": (lambda: pc.net([[0, 1], [0, 1]], [1, 2]), "a list of lists"),
    "kind": (lambda: pc.table([0, 1], [1, 2], "spline"), "use one of linear, pchip, akima, cubic"),
    "open": (lambda: pc.table([0, 1, 2], [1, 2, 3], periodic=True), "ends as it begins"),
    "ends of lines": (lambda: pc.table([0, 1], [1, 2], "linear", ends=[0, 0]), "ends are slopes"),
    "one end": (lambda: pc.table([0, 1], [1, 2], ends=[0]), "ends are two slopes"),
    "nan": (lambda: pc.table([0, 1], [1, float("nan")]), "nan, not a finite number"),
    "text": (lambda: pc.table("01", [1, 2]), "the places of a table are a list of numbers"),
    "free": (lambda: pc.table([0, 1], [u, 2]), "a value of a table is a number, and u was given"),
    "four lists": (lambda: pc.net([[0, 1]] * 4, [[[[0, 1]] * 2] * 2] * 2), "one to three lists"),
    "huge": (lambda: pc.table(range(20_001), range(20_001)), "at most 20000 are read"),
    "arguments": (lambda: pc.net([[0, 1]] * 2, [[0, 1]] * 2)(u), "takes 2 numbers, here are 1"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_table_is_refused_in_one_sentence(name: str) -> None:
    make, match = REFUSED[name]
    with pytest.raises(InputError, match=match) as error:
        make()
    assert "\n" not in str(error.value)


def test_joins_of_tables_are_knots_and_kinks_are_edges() -> None:
    for kind, order in (("linear", 0), ("pchip", 1), ("akima", 1), ("cubic", 2)):
        made = pc.table([0, 0.25, 1], [0, 1, 0], kind)
        assert isinstance(made, TableFunction)
        (found,) = find_breaks((made(u),))[0]
        assert (found.position, found.smoothness) == (0.25, order)
