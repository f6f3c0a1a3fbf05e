"""Series of two angles as one node: values, derivatives, enclosures, models, and what is exact."""

from __future__ import annotations

import pickle
from fractions import Fraction

import numpy as np
import pytest
import sympy

import pc2cad as pc
from pc2cad.bounds.taylor_evaluation import enclose as models_of
from pc2cad.bounds.taylor_models import Place
from pc2cad.errors import InputError
from pc2cad.expression.centred import CentredProgram
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.evaluation import Program
from pc2cad.expression.intervals import Interval
from pc2cad.expression.printing import as_latex, as_text
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.sympy_bridge import to_sympy
from pc2cad.expression.tree import (
    ONE,
    PI,
    ZERO,
    Expr,
    ValueDomainError,
    call,
    number,
    substitute,
    symbol,
    walk,
)
from pc2cad.expression.waves import LARGEST_WAVE, fourier, series
from pc2cad.templates.coordinatewise import coordinate_system
from pc2cad.templates.file import parse_template

U, V = symbol("u"), symbol("v")


class Sum:
    """A series of random waves, as one node and as plain sums."""

    def __init__(self, seed: int, count: int = 40, periods: int = 3) -> None:
        rng = np.random.default_rng(seed)
        self.m, self.n = rng.integers(0, 7, count), rng.integers(-6, 7, count)
        self.c, self.s = (np.round(rng.normal(size=count) / (1 + self.m), 6) for _ in range(2))
        self.k = self.n * periods
        tables = [
            [
                (int(m), int(n), Fraction(repr(float(x))))
                for m, n, x in zip(self.m, self.n, column, strict=True)
            ]
            for column in (self.c, self.s)
        ]
        self.payload = series(periods, *tables)

    def at(self, theta, phi):
        angle = np.multiply.outer(theta, self.m) - np.multiply.outer(phi, self.k)
        return np.cos(angle) @ self.c + np.sin(angle) @ self.s

    def along(self, theta, phi, axis):
        angle = np.multiply.outer(theta, self.m) - np.multiply.outer(phi, self.k)
        factor = -self.k if axis else self.m
        return np.cos(angle) @ (self.s * factor) - np.sin(angle) @ (self.c * factor)


@pytest.fixture
def waves() -> Sum:
    return Sum(1)


def places(count: int, seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    return tuple(np.random.default_rng(seed).uniform(-4, 7, (2, count)))


def test_values_at_places_on_grids_and_of_numbers(waves: Sum) -> None:
    run = Program((fourier(waves.payload, U, V),))
    u, v = places(500)
    np.testing.assert_allclose(run({"u": u, "v": v})[0], waves.at(u, v), atol=1e-12)
    (grid,) = run({"u": u[:30, None, None], "v": v[None, :40, None]})
    expected = waves.at(*np.meshgrid(u[:30], v[:40], indexing="ij"))
    np.testing.assert_allclose(grid, expected[..., None], atol=1e-12)
    (turned,) = run({"u": u[None, :30], "v": v[:40, None]})
    np.testing.assert_allclose(turned, expected.T, atol=1e-12)
    assert abs(run({"u": 0.3, "v": 0.7})[0] - waves.at(0.3, 0.7)) < 1e-13
    assert abs(evaluate(fourier(waves.payload, U, V), {"u": 0.3, "v": 0.7})
               - waves.at(0.3, 0.7)) < 1e-13  # fmt: skip


def test_angles_may_be_functions_of_several_parameters(waves: Sum) -> None:
    tree = fourier(waves.payload, 2 * U + call("sin", V), V * U)
    u, v = places(300)
    (found,) = Program((tree,))({"u": u, "v": v})
    np.testing.assert_allclose(found, waves.at(2 * u + np.sin(v), v * u), atol=1e-11)
    (slope,) = Program(derivatives((tree,), "v"))({"u": u, "v": v})
    theta, phi = 2 * u + np.sin(v), u * v
    chain = waves.along(theta, phi, 0) * np.cos(v) + waves.along(theta, phi, 1) * u
    np.testing.assert_allclose(slope, chain, atol=1e-10)


@pytest.mark.parametrize("axis", [0, 1])
def test_derivatives_are_series_of_as_many_waves(waves: Sum, axis: int) -> None:
    tree = fourier(waves.payload, U, V)
    (slope,) = derivatives((tree,), "uv"[axis])
    assert slope.op == "fourier"
    assert len(slope.payload.rows) <= len(tree.payload.rows)
    u, v = places(300)
    (found,) = Program((slope,))({"u": u, "v": v})
    np.testing.assert_allclose(found, waves.along(u, v, axis), atol=1e-11)


@pytest.mark.parametrize("width", [1e-9, 0.02, 0.3, 3.0])
@pytest.mark.parametrize("program", [IntervalProgram, CentredProgram])
def test_enclosures_contain_samples(waves: Sum, width: float, program: type) -> None:
    tree = fourier(waves.payload, U, V)
    trees = (tree, *derivatives((tree,), "u"), call("exp", tree * Fraction(1, 9)) * U)
    low = np.random.default_rng(2).uniform(-4, 4, (2, 50))
    boxes = {name: Interval(x, x + width) for name, x in zip("uv", low, strict=True)}
    found = program(trees)(boxes)
    shares = np.random.default_rng(3).uniform(size=(2, 2000, 1))
    shares[:, :4, 0] = [[0, 0, 1, 1], [0, 1, 0, 1]]
    u, v = (x + share * width for x, share in zip(low, shares, strict=True))
    value = waves.at(u, v)
    values = value, waves.along(u, v, 0), np.exp(value / 9) * u
    assert len(found) == len(values) == 3
    for enclosure, seen in zip(found, values, strict=True):
        box = getattr(enclosure, "value", enclosure)
        slack = 1e-13 * np.abs(seen).max()
        assert (box.lower <= seen.min(axis=0) + slack).all()
        assert (box.upper >= seen.max(axis=0) - slack).all()
    box = getattr(found[0], "value", found[0])
    if width < 0.1:  # nearly as narrow as what is seen
        seen = np.ptp(value, axis=0)
        assert (box.upper - box.lower <= 1.5 * seen + 1e-11).all()


@pytest.mark.parametrize("order", [1, 4, 6])
@pytest.mark.parametrize("places_along", [("u", "v"), ("u",)])
def test_taylor_models_contain_values_at_complex_places(
    waves: Sum, order: int, places_along: tuple[str, ...]
) -> None:
    second = V if "v" in places_along else 3 * U * U + 1
    theta = 2 * U + Fraction(1, 3)
    tree = fourier(waves.payload, theta, second)
    centre, radius = np.array([0.1, 0.4, 0.9]), np.array([0.01, 0.03, 0.002])
    where = [Place(centre, radius / 4, radius), Place(centre[:2], radius[:2] / 9, radius[:2])]
    (model,) = models_of((tree,), places_along, where[: len(places_along)], order)
    rng = np.random.default_rng(4)
    count = 0
    for i, j in np.ndindex(3, 2 if len(places_along) == 2 else 1):
        turn = np.exp(2j * np.pi * rng.uniform(size=(2, 200)))
        s, t = turn * rng.uniform(size=(2, 200)) ** 0.25
        u, v = centre[i] + radius[i] * s, centre[j] + radius[j] * t
        exact = waves.at(2 * u + 1 / 3, v if len(places_along) == 2 else 3 * u * u + 1)
        powers = [s[None, :] ** np.arange(len(model.terms))[:, None],
                  t[None, :] ** np.arange(model.terms.shape[1])[:, None]]  # fmt: skip
        value = np.einsum("ab,ax,bx->x", model.terms[:, :, i, j], *powers)
        assert (np.abs(value - exact) <= model.radius[i, j] + 1e-12).all()
        assert np.isfinite(model.radius[i, j])
        count += 1
    assert count == (6 if len(places_along) == 2 else 3)
    assert model.error.max() < 1e-11
    if order == 6:
        assert model.radius.min() < 1e-5


def test_whole_turns_and_quarters_are_taken_out_exactly(waves: Sum) -> None:
    tree = fourier(waves.payload, 2 * PI * U, PI * V * Fraction(2, 3))
    at = [substitute((tree,), {"u": end})[0] for end in (ZERO, ONE)]
    assert at[0] is at[1]
    assert at[0].args[0] is ZERO
    assert at[0].symbols == {"v"}
    at = [substitute((tree,), {"v": end})[0] for end in (ZERO, ONE)]
    assert at[0] is at[1]
    assert at[0].symbols == {"u"}
    assert substitute((tree,), {"v": number(Fraction(1, 2))})[0] is not at[0]
    assert substitute((at[0],), {"u": ZERO})[0].op == "number"
    quarter = fourier(waves.payload, U + PI / 2, V)
    assert quarter.args[0] is U
    u, v = places(50)
    (found,) = Program((quarter,))({"u": u, "v": v})
    np.testing.assert_allclose(found, waves.at(u + np.pi / 2, v), atol=1e-12)
    third = fourier(waves.payload, U + PI / 3, -V)
    assert third.args[1] is V
    (found,) = Program((third,))({"u": u, "v": v})
    np.testing.assert_allclose(found, waves.at(u + np.pi / 3, -v), atol=1e-12)


def test_short_series_are_written_out_and_equal_waves_added_up() -> None:
    rows = [(1, 0, Fraction(1, 2)), (-1, 0, Fraction(1, 2)), (0, 0, Fraction(6))]
    tree = fourier(series(1, rows, []), U, V)
    assert tree is 6 + call("cos", U)
    assert fourier(series(1, [(2, 1, Fraction(1))], [(2, 1, Fraction(0))]), U, V).op == "cos"
    assert fourier(series(4, [], [(0, 0, Fraction(3))]), U, V) is ZERO


def test_a_series_is_one_node_that_stores_and_prints(waves: Sum) -> None:
    tree = fourier(waves.payload, 2 * PI * U, V)
    assert sum(node.op == "fourier" for node in walk((tree,))) == 1
    assert pickle.loads(pickle.dumps(tree)) is tree
    assert as_text(tree).startswith(f"<series of {len(tree.payload.rows)} waves of ")
    assert r"\sum" in as_latex(tree)
    value = to_sympy(tree).subs({sympy.Symbol("u", real=True): 0.3,
                                 sympy.Symbol("v", real=True): 0.7})  # fmt: skip
    assert abs(float(value) - waves.at(0.6 * np.pi, 0.7)) < 1e-12


def test_ranks_and_values_are_those_of_every_process(waves: Sum) -> None:
    first, again = fourier(waves.payload, U, V), fourier(Sum(1).payload, U, V)
    assert first is again
    assert isinstance(first, Expr)
    assert fourier(Sum(2).payload, U, V) is not first


@pytest.mark.parametrize(
    ("periods", "row", "message"),
    [
        (0, (1, 1, Fraction(1)), "periods are 1 to"),
        (3, (LARGEST_WAVE + 1, 0, Fraction(1)), "beyond 200"),
        (3, (1, -LARGEST_WAVE - 1, Fraction(1)), "beyond 200"),
        (3, (1, 1, Fraction(10) ** 61), "outside the range"),
    ],
)
def test_refused(periods: int, row: tuple[int, int, Fraction], message: str) -> None:
    with pytest.raises(ValueDomainError, match=message):
        series(periods, [row], [])


# -- templates and Python --------------------------------------------------------------------------

TEMPLATE = """\
title = "A wall"
[parameters]
a = 0.5
[fourier]
R = { periods = 2, cos = [[0, 0, 6], [1, 0, 2], [1, 1, "a"], [2, -1, 0.25], [3, 1, 0.1]] }
Z = { periods = 2, sin = [[1, 0, 2], [1, 1, "a/2"], [2, -1, -0.25], [3, 1, -0.1]] }
[domain]
u = [0, "2*pi"]
v = [0, "pi"]
[let]
r = "R(u, v)"
z_u = "diff(Z(u, v), u)"
[solid]
x = "(r + w/10)*cos(v)"
y = "(r + w/10)*sin(v)"
z = "Z(u, v)"
"""


def test_a_template_has_series_with_its_parameters() -> None:
    template = parse_template(TEMPLATE, "wall")
    for a in (0.5, 0.3):
        at = {"u": 0.3, "v": 0.4, "w": 0.0}
        x, y, z = (evaluate(c, at) for c in template.bind({"a": a}).coordinates)
        angles = [(1, 0), (1, 2), (2, -2), (3, 2)]
        waves = [(m * 0.3 - k * 0.4) for m, k in angles]
        r = 6 + np.dot([2, a, 0.25, 0.1], np.cos(waves))
        assert (x, y) == pytest.approx((r * np.cos(0.4), r * np.sin(0.4)), rel=1e-14)
        assert z == pytest.approx(np.dot([2, a / 2, -0.25, -0.1], np.sin(waves)), rel=1e-13)


def test_python_has_the_same_series() -> None:
    u, v, _ = pc.parameters()
    R = pc.fourier([(0, 0, 6), (1, 0, 2.5), (1, 1, 0.5), (2, -1, 0.25), (3, 1, 0.1)], periods=2)
    tree = R(2 * pc.pi * u, v)
    assert tree.op == "fourier"
    at = {"u": 0.3, "v": 0.4}
    angle = [0, 0.6 * np.pi, 0.6 * np.pi - 0.8, 1.2 * np.pi + 0.8, 1.8 * np.pi - 0.8]
    assert evaluate(tree, at) == pytest.approx(np.dot([6, 2.5, 0.5, 0.25, 0.1], np.cos(angle)))
    assert pc.fourier(sin=[(1, 0, 1)])(u, v) is pc.sin(u)
    for wrong in ([(1, 0)], [(0.5, 0, 1)], [(1, 0, float("nan"))]):
        with pytest.raises(InputError):
            pc.fourier(wrong)


def test_the_coordinate_system_names_series_and_their_derivatives() -> None:
    rows = [row for expansion in coordinate_system(parse_template(TEMPLATE, "wall"))
            for row in expansion.rows]  # fmt: skip
    texts = {row.name: row.text for row in rows}
    assert texts["r"] == "R(u, v)"
    assert texts["z_u"] == "d[1] Z(u, v)"
    assert r"\partial_{1} Z\left(u, v\right)" in next(r.latex for r in rows if r.name == "z_u")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("R = { periods = 2, ", "R = { period = 2, "), "unknown key; did you mean periods"),
        (("periods = 2, cos", "periods = 0, cos"), "whole number from 1 to 200"),
        (("periods = 2, cos", "periods = true, cos"), "whole number from 1 to 200"),
        (("[1, 0, 2], [1, 1", "[1, 0], [1, 1"), r"is a list of waves, \[\[m, n, c\], …\]"),
        (("[1, 0, 2], [1, 1", "[1.5, 0, 2], [1, 1"), r"\[fourier\] R cos\[1\] m: is a whole"),
        (("[1, 0, 2], [1, 1", "[1, 999, 2], [1, 1"), r"R cos\[1\] n: is a whole number from -200"),
        (("[1, 0, 2], [1, 1", "[1, inf, 2], [1, 1"), r"R cos\[1\] n: is a whole number from -200"),
        (("[1, 0, 2], [1, 1", '[1, 0, "u"], [1, 1'), "unknown name 'u'"),
        (("[1, 0, 2], [1, 1", "[1, 0, nan], [1, 1"), "not a finite number"),
        (("[1, 0, 2], [1, 1", "[1, 0, 1e70], [1, 1"), "outside the range"),
        (("R = {", "sin = {"), "the name sin is reserved"),
        (("R(u, v)", "R(u)"), "R takes 2 operands, here are 1"),
        (("R = { periods = 2, cos = ", "R = 1 # "), "is a table"),
    ],
)
def test_templates_are_read_strictly(change: tuple[str, str], message: str) -> None:
    assert change[0] in TEMPLATE
    with pytest.raises(InputError, match=message):
        parse_template(TEMPLATE.replace(*change), "wall")


def test_too_many_waves_are_refused() -> None:
    rows = ", ".join(f"[{i % 100}, {i // 100}, 1]" for i in range(5000))
    with pytest.raises(InputError, match="5004 waves, and at most 4000"):
        parse_template(TEMPLATE.replace("[1, 0, 2], [1, 1", f"{rows}, [1, 1"), "wall")
