"""Kinks of absolute values: breaks where they are values of one parameter, refused elsewhere."""

from __future__ import annotations

from math import asin, pi

import numpy as np
import pytest
from test_hexahedra import check_conforming

import pc2cad as pc
from pc2cad.checked import check_map
from pc2cad.domain.analysis import analyse
from pc2cad.equation.point_equation import point_equation
from pc2cad.expression.breaks import BreaksNotAlignedError, find_breaks
from pc2cad.expression.evaluation import Program
from pc2cad.expression.kinks import take_kinks_apart
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, number, walk
from pc2cad.mesh.grid import make_grid
from pc2cad.mesh.hexahedra import hexahedra

u, v, w = pc.parameters()
THIRD, QUARTER, HALF = number(1) / 3, number(1) / 4, number(1) / 2
BOX = (u, v, w)


def split(tree: Expr) -> Expr:
    (found,) = take_kinks_apart((tree,), BOX)
    return found


#: function of u, and where it has kinks
KINKS = {
    "affine": (abs(u - THIRD), [1 / 3]),
    "wave": (abs(pc.sin(3 * u) - THIRD), [asin(1 / 3) / 3, (pi - asin(1 / 3)) / 3]),
    "cosine": (abs(pc.cos(5 * u)), [pi / 10, 3 * pi / 10]),
    "cubic that begins at a zero": (abs(u**3 - u / 4), [0.5]),
    "nested": (abs(abs(u - HALF) - QUARTER), [0.25, 0.5, 0.75]),
    "twice nested": (abs(abs(abs(u - HALF) - QUARTER) - QUARTER / 2), [k / 8 for k in range(1, 8)]),
    "square": (abs((u - HALF) ** 2), []),
    "square, multiplied out": (abs(u * u - u + QUARTER), []),
    "square, lowered by what rounding hides": (abs(u * u - u + QUARTER - number(10) ** -20), []),
    "square, lowered by more": (abs(u * u - u + QUARTER - number(10) ** -8), [0.4999, 0.5001]),
    "two zeros side by side": (abs((u - HALF) * (u - HALF - 1e-7)), [0.5, 0.5000001]),
    "zeros at both sides": (abs(pc.sin(pc.pi * u)), []),
    "zeros at both sides and inside": (abs(pc.sin(2 * pc.pi * u)), [0.5]),
    "beside a side": (abs(u - number(10) ** -3), [1e-3]),
    "third power of a zero": (abs((u - HALF) ** 3), [0.5]),
    "the larger": ((u + HALF + abs(u - HALF)) / 2, [0.5]),
    "quotient": (abs((u - HALF) / (1 + u)), [0.5]),
    "root of a square": (pc.sqrt((pc.sin(9 * u) - 0.2) ** 2), [
        asin(0.2) / 9, (pi - asin(0.2)) / 9, (2 * pi + asin(0.2)) / 9]),
    "there and back": (pc.acos(pc.cos(7 * u + 2)), [(k * pi - 2) / 7 for k in (1, 2)]),
    "there and back by sines": (pc.asin(-pc.sin(9 * u - 1)), [
        (pi / 2 + 1 + k * pi) / 9 for k in range(3)]),
    "there and back within there and back": (pc.acos(pc.cos(5 * pc.acos(pc.cos(5 * u)))), [
        k * pi / 25 for k in range(1, 8)]),
    "sine of a cosine": (pc.asin(pc.cos(8 * u)), [pi / 8, pi / 4]),
}  # fmt: skip


@pytest.mark.parametrize("name", KINKS)
def test_kinks_of_one_parameter_are_its_breaks_and_values_stay(name: str) -> None:
    tree, expected = KINKS[name]
    found = split(tree)
    inner = [b.position for b in find_breaks((found,))[0]]
    inside = [x for x in expected if 0 < x < 1]
    assert inner == pytest.approx(inside, abs=1e-9 if "lowered" not in name else 1e-6)
    assert not {"abs", "acos", "asin"} & {node.op for node in walk((found,))}
    places = np.concatenate((np.linspace(0, 1, 997), inside))
    (values,), (wanted,) = (Program((t,))({"u": places}) for t in (found, tree))
    assert np.abs(values - wanted).max() < 1e-13


def test_a_linear_zero_is_exact() -> None:
    pieces = next(node for node in walk((split(abs(u - THIRD)),)) if node.op == "pieces")
    assert pieces.payload.breaks[1] * 3 == 1


@pytest.mark.parametrize(("exponent", "smoothness"), [(1, 0), (3, 2), (5, 4)])
def test_odd_powers_are_breaks_as_smooth_as_they_are(exponent: int, smoothness: int) -> None:
    for tree in (abs(u - THIRD) ** exponent, abs((u - THIRD) ** exponent)):
        (found,) = find_breaks((split(tree),))[0]
        assert found.smoothness == smoothness
    assert not find_breaks((split(abs(u - THIRD) ** (exponent + 1)),))[0]


def test_many_kinks_are_all_found() -> None:
    breaks = find_breaks((split(abs(pc.sin(200 * u))),))[0]
    assert [b.position for b in breaks] == pytest.approx([k * pi / 200 for k in range(1, 64)])


def test_factors_that_depend_on_other_parameters_go_out() -> None:
    for tree in (abs((u - THIRD) * (1 + v)), abs(u * v - v / 3), abs(v * (u - THIRD) / (w + 1))):
        found = split(tree)
        rows = find_breaks((found,))
        assert [[b.position for b in row] for row in rows] == [[pytest.approx(1 / 3)], [], []]
        place = {"u": 0.2, "v": 0.7, "w": 0.4}
        assert evaluate(found, place) == pytest.approx(evaluate(tree, place), rel=1e-14)


def test_what_keeps_its_sign_loses_the_absolute_value() -> None:
    assert split(abs(1 + u * v)) is 1 + u * v
    assert split(abs(u * v - 2)) is -(u * v - 2)
    # roots and quotients end where it vanishes: they keep it
    for tree in (pc.sqrt(abs(u - THIRD)), 1 / abs(u - THIRD), abs(pc.cos(3 * u)) ** 2.5):
        assert split(tree) is tree


CURVES = {
    "hyperbola": (abs(u * v - QUARTER), "u = .*, v = "),
    "diagonal": (abs(u - v), "u = .*, v = "),
    "surface": (abs(u * v * w - 0.1), "u = .*, v = .*, w = "),
    "in a sum": (2 + abs(pc.sin(3 * u) - v) * u, "u = .*, v = "),
}


@pytest.mark.parametrize("name", CURVES)
def test_kinks_along_a_curve_are_refused_with_a_place_on_it(name: str) -> None:
    tree, place = CURVES[name]
    with pytest.raises(BreaksNotAlignedError, match=f"kink along a curve through {place}"):
        analyse(point_equation((u, v * (1 + tree), w), name="curve"))


def test_the_place_is_in_the_equations_own_parameters() -> None:
    domain = {"u": (0, 10), "v": (5, 6), "w": (0, 1)}
    tree = abs(u - v)
    with pytest.raises(
        BreaksNotAlignedError, match=r"a function of u and v changes .* u = (5\.\d+)"
    ):
        analyse(point_equation((u, v * (10 + tree), w), domain, name="curve"))


# -- solids ----------------------------------------------------------------------------------------


def test_a_wave_with_kinks_is_a_solid_with_edges_there() -> None:
    rise = abs(pc.sin(3 * u) - THIRD)
    part = pc.compile_part((2 * u, v * (1 + rise), w))
    a, b = asin(1 / 3) / 3, (pi - asin(1 / 3)) / 3

    # of |sin 3u - 1/3| over [0, a], [a, b] and [b, 1]
    def integral(x: float) -> float:
        return -np.cos(3 * x) / 3 - x / 3

    exact = 2 * (1 - (integral(a) - integral(0)) + (integral(b) - integral(a))
                 - (integral(1) - integral(b)))  # fmt: skip
    assert part.report.solid.volume == pytest.approx(exact, rel=1e-8)
    names = [face.name for face in part.report.faces]
    assert sum(name.startswith("v=1") for name in names) == 3
    # planes stay whole
    assert len(names) == 8
    assert part.report.evidence == "bounded"


@pytest.mark.parametrize(
    ("height", "volume", "tops"),
    [
        (1 + abs(u - THIRD), 1 + 5 / 18, 2),
        (1 + pc.acos(pc.cos(2 * pc.pi * u)) / 10, 1 + pi / 20, 2),
        (1 + abs(u - THIRD) + abs(v - QUARTER), 1 + 5 / 18 + 5 / 16, 4),
        (1 + abs(abs(u - HALF) - QUARTER), 1 + 1 / 8, 4),
        ((3 + u + v + abs(u - HALF)) / 2, (4 + QUARTER.payload) / 2, 2),
    ],
)
def test_piecewise_linear_tops_are_planes(height: Expr, volume: float, tops: int) -> None:
    report = pc.compile_part((u, v, w * height)).report
    assert report.evidence == "exact"
    assert {face.carrier for face in report.faces} == {"plane"}
    assert len(report.faces) == 5 + tops
    assert report.solid.volume == pytest.approx(float(volume), rel=1e-13)


def test_a_kink_is_a_grid_line_and_order_two_stays_of_fourth_order() -> None:
    rise = abs(pc.sin(3 * u) - THIRD)
    checked = check_map(point_equation((2 * u, v * (1 + rise), w), name="wave"))
    exact = checked.mass.volume
    errors = []
    for n in (8, 16):
        grid = make_grid(checked, (n, 1, 1))
        for kink in (asin(1 / 3) / 3, (pi - asin(1 / 3)) / 3):
            assert np.abs(grid.lines[0] - kink).min() < 1e-15
        mesh = hexahedra(checked, grid, 2)
        errors.append(abs(mesh.volume() / exact - 1))
    check_conforming(mesh)
    assert errors[1] < 1e-5
    assert np.log2(errors[0] / errors[1]) > 3.5


def test_kinks_of_two_parameters_are_lines_of_both() -> None:
    height = 1 + abs(u - THIRD) + abs(pc.cos(5 * v))
    checked = check_map(point_equation((u, v, w * height), name="two"))
    mesh = hexahedra(checked, make_grid(checked, (6, 6, 2)), 2)
    check_conforming(mesh)
    assert checked.analysis.bounds[0] == pytest.approx((0, 1 / 3, 1))
    assert checked.analysis.bounds[1] == pytest.approx((0, pi / 10, 3 * pi / 10, 1))
    assert checked.mass.volume == pytest.approx(1 + 5 / 18 + _mean_cosine(), rel=1e-12)


def _mean_cosine() -> float:
    a, b = pi / 10, 3 * pi / 10
    return float((np.sin(5 * a) - (np.sin(5 * b) - np.sin(5 * a)) + np.sin(5) - np.sin(5 * b)) / 5)
