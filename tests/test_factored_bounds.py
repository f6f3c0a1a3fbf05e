"""Bounds from functions of one parameter: discs of several radii, and differences of products."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from pc2cad.bounds import discs, known, taylor_evaluation
from pc2cad.bounds.cells import Cells
from pc2cad.bounds.deviation import bound_surface, direction_along, expect_surface
from pc2cad.bounds.differences import Factored, Sampled, difference
from pc2cad.bounds.discs import first_discs, remainders_along
from pc2cad.bounds.homogeneous_spline import HomogeneousSpline
from pc2cad.bounds.known import Known
from pc2cad.bounds.remainder import Vectors
from pc2cad.bounds.separable import Products, function_of
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import Place
from pc2cad.expression.evaluation import Program
from pc2cad.expression.tree import PI, Expr, call, number, pieces, symbol
from pc2cad.geometry.carriers import SplineSurface
from pc2cad.geometry.splines.spline_space import SplineSpace
from pc2cad.geometry.splines.tensor import fit_surface

Array = NDArray[np.float64]
U, V = symbol("u"), symbol("v")
#: a guide with a frame that turns, and a section with a wall
SPEED = call("sqrt", Fraction(5, 4) + U * U)
TUBE = tuple(
    guide + along / SPEED * call("cos", 2 * PI * V) + across * call("sin", 2 * PI * V) / (3 + V)
    for guide, along, across in ((3 * U, call("cos", 2 * U), call("sin", 2 * U)),
                                 (U**2, call("sin", 2 * U), -call("cos", 2 * U)),
                                 (call("exp", U), number(1), U))
)  # fmt: skip


def _fitted(trees: tuple[Expr, ...], *spaces: SplineSpace) -> tuple[HomogeneousSpline, Array]:
    s, t = spaces
    columns = Program(trees)({"u": s.sites[:, None], "v": t.sites[None, :]})
    shape = len(s.sites), len(t.sites)
    values = np.stack([np.broadcast_to(c, shape) for c in columns], axis=-1)
    poles = fit_surface(values, s, t)
    return HomogeneousSpline((s.degree, t.degree), (s.knots, t.knots), poles), poles


@pytest.mark.parametrize("scale", [Fraction(1, 1000), Fraction(1), Fraction(10**5)])
def test_differences_of_products_are_those_that_are_sampled(scale: Fraction) -> None:
    """In values at nodes and in coefficients, to within what both say that rounding costs."""
    trees = tuple(number(scale) * tree for tree in TUBE)
    s, t = SplineSpace(5, np.linspace(0, 1, 8)), SplineSpace(7, np.linspace(0, 1, 11))
    spline, _ = _fitted(trees, s, t)
    cells = Cells(s.points, 7), Cells(t.points, 9)
    function = function_of(trees, ("u", "v"), Known())
    assert isinstance(function, Products)
    found = difference(function, spline, cells, (s, t), 1e-5 * float(scale))
    assert isinstance(found, Factored)
    sampled = Sampled(function, spline, cells)
    every = slice(0, cells[1].count * cells[1].degree + 1)
    one, other = found.values(every), sampled.values(every)
    largest = float(np.abs(other).max())
    assert largest > 1e-7 * float(scale)
    size = 20 * float(scale)
    np.testing.assert_allclose(one, other, rtol=0, atol=2e-14 * size)
    forms = found.coefficients(0, 10, one), sampled.coefficients(0, 10, other)
    loss = found.loss(largest) + sampled.loss(largest)
    np.testing.assert_allclose(*forms, rtol=0, atol=loss + 1e-11 * size)
    assert found.loss(largest) < 1e-12 * size


def test_poles_that_no_fit_has_are_seen() -> None:
    s, t = SplineSpace(5, np.linspace(0, 1, 8)), SplineSpace(7, np.linspace(0, 1, 11))
    spline, poles = _fitted(TUBE, s, t)
    surface = SplineSurface((5, 7), (s.knots, t.knots), poles)
    plain = bound_surface(TUBE, ("u", "v"), surface)
    fitted = bound_surface(TUBE, ("u", "v"), surface, spaces=(s, t), seen=plain.sampled)
    assert fitted.sampled == pytest.approx(plain.sampled, rel=1e-6)
    assert fitted.largest == pytest.approx(plain.largest, rel=0.1)
    assert fitted.place == plain.place
    cells = Cells(s.points, 7), Cells(t.points, 9)
    function = function_of(TUBE, ("u", "v"), Known())
    poles[4, 6, 1] += 1e-2
    moved = difference(function, spline, cells, (s, t), plain.sampled)
    assert isinstance(moved, Sampled)
    other = bound_surface(TUBE, ("u", "v"), surface, spaces=(s, t), seen=plain.sampled)
    assert 2e-3 < other.sampled <= other.largest < 1e-2
    # a spline of other spaces is looked at as it is
    beside = SplineSpace(5, np.linspace(0, 1, 9))
    assert isinstance(difference(function, spline, cells, (beside, t), 1.0), Sampled)


def test_a_surface_that_is_expected_is_bounded_from_what_the_first_one_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """To the last bit as it is alone, with no program of its factors and no models of its own."""
    s, t = SplineSpace(5, np.linspace(0, 1, 8)), SplineSpace(7, np.linspace(0, 1, 11))
    walls = [
        tuple(a + b * number(w) / (2 + V) for a, b in zip(TUBE, (U, SPEED, number(1)), strict=True))
        for w in (-1, 1)
    ]
    surfaces = [SplineSurface((5, 7), (s.knots, t.knots), _fitted(w, s, t)[1]) for w in walls]
    alone = [bound_surface(*row) for row in zip(walls, [("u", "v")] * 2, surfaces, strict=True)]
    shared = Known()
    expect_surface(walls[1], ("u", "v"), shared)
    found = [bound_surface(walls[0], ("u", "v"), surfaces[0], known=shared)]
    monkeypatch.setattr(known, "Program", None)
    monkeypatch.setattr(taylor_evaluation, "_step", None)
    found.append(bound_surface(walls[1], ("u", "v"), surfaces[1], known=shared))
    assert found == alone
    for one, other in zip(found, alone, strict=True):
        assert [one.side(k) for k in range(4)] == [other.side(k) for k in range(4)]


NEAR = {
    "pole": 1 / ((U - Fraction(1, 3)) ** 2 + Fraction(1, 50)),
    "root": call("sqrt", U + Fraction(1, 40)),
    "wave": call("sin", 30 * U),
    "pieces": pieces(U, (Fraction(0), Fraction(1, 4), Fraction(1)),
                     ((number(1), number(2)), (number(Fraction(3, 2)), number(-1))), 0),
}  # fmt: skip


@pytest.mark.parametrize("name", NEAR)
@pytest.mark.parametrize("allowed", [1e-3, 1e-8])
def test_discs_bound_what_interpolation_leaves(name: str, allowed: float) -> None:
    """Of every cell, halved or not; and to halve cells asks for next to no other models."""
    trees, known = (NEAR[name], U, number(0)), Known()
    direction = direction_along(trees, "u", np.array([0, 0.25, 0.5, 1.0]), 4)
    vectors = Vectors((trees,), (2.0,), known)
    asked = []

    def count(self: Vectors, names: object, places: list[Place], order: int) -> object:
        asked.append(places[0].centre.size)
        return models(self, names, places, order)  # type: ignore[arg-type]

    models = Vectors.models
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Vectors, "models", count)
        first = first_discs(vectors, direction, 1.0)
        found, rest = remainders_along(vectors, direction, first, allowed)
    assert asked[0] == 3 * (len(discs.RADII) if name != "pieces" else 1)
    assert len(asked) <= 4
    assert (rest.along[0] <= allowed).all()
    cells = found.cells
    nodes, program = cells.nodes(0, cells.count), Program(trees)
    values = program({"u": nodes})[0]
    shares = np.linspace(0, 1, 301)
    for k in range(cells.count):
        own = slice(k * cells.degree, (k + 1) * cells.degree + 1)
        places = cells.points[k] + np.diff(cells.points)[k] * shares
        true = program({"u": places})[0]
        off = 2 * np.abs(_interpolated(nodes[own], values[own], places) - true).max()
        assert off <= rest.along[0][k, 0] + 1e-13 * np.abs(true).max()
        assert np.hypot(true, places).max() <= rest.sizes[0, k, 0]


def _interpolated(nodes: Array, values: Array, places: Array) -> Array:
    """Return the interpolant by Lagrange's formula."""
    total = np.zeros_like(places)
    for i, (node, value) in enumerate(zip(nodes, values, strict=True)):
        others = np.delete(nodes, i)
        total += value * np.prod((places[:, None] - others) / (node - others), axis=1)
    return total


@pytest.mark.parametrize("order", [1, 4, 8])
def test_models_of_one_parameter_hold_the_rims_of_their_discs(order: int) -> None:
    """Products by numbers, series of arguments of degree 1, and of others."""
    third = number(Fraction(1, 3))
    trees = [third * call("cos", U), call("sin", 3 * U + 1) * (2 * PI), 1 / (U * U + 2),
             call("exp", U * U) * call("log", 3 + U), call("sqrt", call("sin", U) + 2)]  # fmt: skip
    values = (
        lambda u: np.cos(u) / 3, lambda u: np.sin(3 * u + 1) * 2 * np.pi, lambda u: 1 / (u * u + 2),
        lambda u: np.exp(u * u) * np.log(3 + u), lambda u: np.sqrt(np.sin(u) + 2),
    )  # fmt: skip
    centre = np.array([0.2, 0.4, 0.9])
    place = Place(centre, np.full(3, 0.05), np.full(3, 0.2))
    rim = np.exp(2j * np.pi * np.arange(16) / 16)[:, None]
    for model, value in zip(enclose(trees, ["u"], [place], order), values, strict=True):
        terms = sum(model.terms[i, 0, :, 0] * rim**i for i in range(len(model.terms)))
        off = np.abs(value(centre + 0.2 * rim) - terms).max(axis=0)
        assert (off <= model.radius[:, 0] * (1 + 1e-12) + 1e-15).all()
        assert (model.radius[:, 0] <= 500 * off + 1e-12).all()


def test_what_is_told_sooner_of_rounding_is_no_less() -> None:
    generator = np.random.default_rng(5)
    for k in range(40):
        inner = np.sort(generator.uniform(0.01, 0.99, size=(2, 6)), axis=1)
        inner[0, 2:4] = inner[0, 2]
        p, q = int(generator.integers(1, 6)), int(generator.integers(1, 6))
        knots = [np.concatenate((np.zeros(n + 1), row, np.ones(n + 1)))
                 for n, row in zip((p, q), inner, strict=True)]  # fmt: skip
        counts = [len(row) - n - 1 for n, row in zip((p, q), knots, strict=True)]
        poles = generator.normal(size=(*counts, 3 + k % 2)) * 10.0 ** generator.integers(-5, 5)
        spline = HomogeneousSpline((p, q), tuple(knots), poles)
        assert spline.rounding <= spline.most_rounding
