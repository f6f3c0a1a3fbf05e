"""Directions that are run through in one arc: circles and ellipses along guides, without knots."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from pc2cad.bounds.along_arcs import along_arcs
from pc2cad.compiler import compile_part
from pc2cad.expression.evaluation import Program
from pc2cad.expression.tree import PI, Expr, call, number, symbol
from pc2cad.geometry.carriers import SplineCurve, SplineSurface
from pc2cad.geometry.splines.arcs import Arcs, Wave
from pc2cad.geometry.splines.bernstein import degree_in
from pc2cad.geometry.splines.rational import rational_course
from pc2cad.geometry.splines.turns import turning_limits
from pc2cad.part import Part
from pc2cad.representation.boundary_model import ModelFace
from pc2cad.verify.arc_courses import arc_course

Array = NDArray[np.float64]
U, V, W = (symbol(name) for name in "uvw")


def spline_values(carrier: SplineSurface, s: Array, t: Array) -> Array:
    """Return points (len(s), len(t), 3) by the basis alone."""
    assert carrier.weights is not None
    weights = carrier.weights[..., None]
    net = np.concatenate((carrier.poles * weights, weights), axis=2)
    rows = BSpline(carrier.knots[0], net, carrier.degrees[0])(s)
    columns = BSpline(carrier.knots[1], rows.transpose(1, 0, 2), carrier.degrees[1])(t)
    values = columns.transpose(1, 0, 2)
    return np.asarray(values[..., :3] / values[..., 3:])


def tube(a: float, b: float, turn: float) -> tuple[Expr, Expr, Expr]:
    """Return an elliptic tube with a wall, part of a turn, along a guide that is no circle."""
    angle = number(turn) * V
    across = (1 + W / 2) * number(a) * call("cos", angle)
    up = (1 + W / 2) * number(b) * call("sin", angle)
    bend = call("exp", U) * 4
    return (bend + across) * call("cos", U), (bend + across) * call("sin", U), up + U**3


@pytest.mark.parametrize(
    ("extent", "degree"), [(0.7, 2), (2.0, 2), (np.pi, 4), (4.0, 4), (2 * np.pi, 6)]
)
def test_one_arc_holds_a_circle_without_a_knot(extent: float, degree: int) -> None:
    arcs = Wave(extent, 1).single_arc
    course = rational_course(arcs, 1)
    assert course.space.degree == degree == arcs.degree(1)
    assert len(course.space.knots) == 2 * (degree + 1)
    assert course.weights.min() > 0
    assert course.weights[[0, -1]] == pytest.approx([1, 1], abs=1e-15)
    angle = extent * course.places(course.space.sites)
    values = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    numerators = course.space.fit(values * course.weight(course.space.sites)[:, None])
    x = np.linspace(0, 1, 301)
    basis = course.space.basis(x)
    points = (basis @ numerators) / (basis @ course.weights[:, None])
    assert np.abs(np.hypot(*points.T) - 1).max() < 1e-14
    expected = extent * course.places(x)
    assert np.abs(points - np.stack((np.cos(expected), np.sin(expected)), axis=1)).max() < 1e-14


@pytest.mark.parametrize("sign", [1, -1])
def test_waves_times_the_denominator_are_polynomials(sign: int) -> None:
    angle = sign * 2 * PI * V
    tree = (2 + U) * call("cos", angle + U) ** 2 - call("sin", 2 * angle) / (1 + U) + U
    arcs = Wave(2 * np.pi, 2).single_arc
    (found,), weight = along_arcs((tree,), "v", arcs, 2)
    assert degree_in((found,), "v") == degree_in((weight,), "v") == arcs.degree(2)
    x, u = np.linspace(0, 1, 41), np.linspace(0, 1, 41)[:, None]
    value, denominator = Program((found, weight))({"u": u, "v": x})
    (expected,) = Program((tree,))({"u": u, "v": arcs.places(x)})
    assert np.abs(value / denominator - expected).max() < 1e-13
    assert np.abs(denominator - arcs.weight(x) ** 2).max() < 1e-14


def test_what_is_no_wave_of_the_arc_is_followed_along_its_path() -> None:
    arcs = Arcs(2 * np.pi, 1, 3)
    tree = call("exp", call("cos", 2 * PI * V)) + V
    (found,), _ = along_arcs((tree,), "v", arcs, 1)
    assert degree_in((found,), "v") is None
    x = np.linspace(0, 1, 41)
    (value,) = Program((found,))({"v": x})
    (expected,) = Program((tree,))({"v": arcs.places(x)})
    assert np.abs(value - expected * arcs.weight(x)).max() < 1e-13


def walls_of(part: Part) -> list[tuple[ModelFace, SplineSurface]]:
    """Return the inner and the outer wall."""
    faces = [face for face in part.model.faces if face.name in ("w=0", "w=1")]
    return [(f, f.carrier) for f in faces if isinstance(f.carrier, SplineSurface)]


@pytest.mark.parametrize(
    ("a", "b", "turn", "poles"),
    [(1.0, 1.0, 2 * np.pi, 7), (1.0, 0.6, 2 * np.pi, 7), (1.0, 0.5, 2.5, 5)],
)
def test_walls_along_a_guide_are_fitted_along_it_alone(
    a: float, b: float, turn: float, poles: int
) -> None:
    trees = tube(a, b, turn)
    part = compile_part(trees, tolerance=1e-4)
    program, rng = Program(trees), np.random.default_rng(2)
    arcs, walls = Wave(turn, 1).single_arc, walls_of(part)
    assert len(walls) == 2
    for face, carrier in walls:
        assert carrier.poles.shape[1] == poles
        assert len(np.unique(carrier.knots[1])) == 2
        # it is near to the equation, and not on it
        assert face.evidence == "bounded"
        s, t = (np.sort(rng.uniform(0, 1, 200)) for _ in range(2))
        grid = {"u": s[:, None], "v": arcs.places(t), "w": float(face.name[-1])}
        true = np.stack(np.broadcast_arrays(*program(grid)), axis=-1)
        gap = np.linalg.norm(spline_values(carrier, s, t) - true, axis=-1).max()
        assert 0.5 * face.deviation < gap <= face.deviation <= 1e-4
    # the rims are exact, and pole for pole those of the walls
    carriers = [(edge, edge.carrier) for edge in part.model.edges]
    rims = [
        (edge, c) for edge, c in carriers if isinstance(c, SplineCurve) and c.degree == poles - 1
    ]
    assert len(rims) == 4
    assert {edge.evidence for edge, _ in rims} == {"exact"}
    rows = {row.tobytes() for _, carrier in walls for row in carrier.poles[[0, -1]]}
    assert {carrier.poles.tobytes() for _, carrier in rims} == rows
    assert part.report.deviation <= 1e-4


def test_no_arc_is_taken_of_a_degree_that_fits_may_not_have() -> None:
    kinds = ({"degree": 5}, {"profile": "cubic"}, {"profile": "polynomial"})
    for options, rational in (({}, True), *((kind, False) for kind in kinds)):
        part = compile_part(tube(1.0, 0.6, 2 * np.pi), None, 1e-3, **options)
        assert all((carrier.weights is not None) is rational for _, carrier in walls_of(part))


def test_a_face_beside_that_is_no_wave_keeps_the_parameter_of_all() -> None:
    x, y, z = tube(1.0, 0.6, 2 * np.pi)
    part = compile_part((x, y, z + W * call("exp", call("cos", 2 * PI * V)) / 9), tolerance=1e-3)
    assert len(walls_of(part)) == 2
    assert all(carrier.weights is None for _, carrier in walls_of(part))


def test_a_file_runs_in_an_arc_only_with_its_weights() -> None:
    angle = 2 * PI * V
    trees = (U * call("cos", angle), U * call("sin", angle), U)
    course = rational_course(Wave(2 * np.pi, 1).single_arc, 1)
    knots, weights = course.space.knots, 3 * course.weights
    assert arc_course(trees, "v", knots, weights) is course
    assert arc_course(trees, "u", knots, weights) is None
    assert arc_course(trees, "v", knots, weights * (1 + 1e-6 * np.arange(7))) is None
    assert arc_course((*trees[:2], V), "v", knots, weights) is None


def test_single_pieces_are_cut_where_they_turn() -> None:
    angle = np.linspace(0, 2 * np.pi, 50)
    circle = np.stack((np.cos(angle), np.sin(angle), 0 * angle), axis=1)
    line = np.stack((angle, 2 * angle, angle), axis=1)
    whole, cut = np.array([0.0, 1.0]), np.array([0.0, 0.3, 1.0])
    np.testing.assert_array_equal(
        turning_limits(whole, np.stack((line, circle)), np.pi / 2), [0, 0.25, 0.5, 0.75, 1]
    )
    np.testing.assert_array_equal(turning_limits(whole, line[None], np.pi / 2), whole)
    np.testing.assert_array_equal(turning_limits(cut, circle[None], np.pi / 2), cut)
