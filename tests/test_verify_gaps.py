"""Bounds of the distance between edges and surfaces hold, and are no larger than need be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pc2cad.arrays import Array
from pc2cad.verify.curves import Conic, Curve, Line, Reversed
from pc2cad.verify.edges import Edge
from pc2cad.verify.gaps import gap_bound
from pc2cad.verify.patches import Trace
from pc2cad.verify.splines import SplineCurve, make_curve, make_surface
from pc2cad.verify.surfaces import _ROUND, TURN, Pushed, Round, Spun, Surface

SPAN = (0.3, 1.9)
LINES = (-np.inf, np.inf)


def edge_of(curve: Curve, interval: tuple[float, float]) -> Edge:
    samples = curve.at(np.linspace(*interval, 17))[0]
    return Edge(None, None, None, samples, samples, np.diff(samples, axis=0), 0.0, curve, interval)


def round_of(kind: str, *lengths: float) -> Round:
    profile, inverse, period, limits = _ROUND[kind](*lengths)
    axes = np.linalg.qr(np.array([[1.0, 2.0, 3.0], [0.0, 1.0, 2.0], [1.0, 0.0, 1.0]]))[0].T
    origin = np.array([3.0, -1.0, 2.0])
    return Round(origin, axes, profile, inverse, (TURN, period), (LINES, limits), kind, lengths)


def wavy(rng: np.random.Generator, about: Callable[[Array], Array], by: float, rational: bool):
    """Return a spline near a curve: of degree 5, through its values but for so much."""
    knots = np.concatenate(([0.0] * 6, [0.21, 0.5, 0.5, 0.83], [1.0] * 6))
    curve = SplineCurve(knots, 5, np.eye(10), False, None, 11)
    t = np.linspace(0.0, 1.0, 10)
    poles = np.linalg.solve(curve.at(t)[0], about(t) + rng.uniform(-by, by, (10, 3)))
    if rational:
        weights = rng.uniform(0.9, 1.1, (10, 1))
        poles = np.concatenate((poles * weights, weights), axis=1)
    return make_curve(curve.knots, 5, poles, rational)


KINDS = {
    "CYLINDRICAL_SURFACE": (2.0,), "SPHERICAL_SURFACE": (2.0,), "CONICAL_SURFACE": (2.0, 0.4),
    "TOROIDAL_SURFACE": (5.0, 2.0),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rational", [False, True])
def test_a_bound_holds_at_every_place_of_a_curve_on_a_surface(kind: str, rational: bool) -> None:
    rng, surface = np.random.default_rng(5), round_of(kind, *KINDS[kind])
    ratios = []
    for by in (1e-3, 1e-5, 1e-7):
        curve = wavy(rng, lambda t: surface.at(0.2 + 0.9 * t, 0.1 + 0.4 * t * t)[0], by, rational)
        edge = edge_of(Reversed(curve), (-0.9, -0.13))
        dense = curve.at(np.linspace(0.13, 0.9, 4001))[0]
        off = float(np.linalg.norm(surface.at(*surface.locate(dense))[0] - dense, axis=1).max())
        bound = gap_bound(surface, edge, None, off)
        assert bound >= off
        ratios.append(bound / off)
    assert len(ratios) == 3
    assert max(ratios) < 4.0


def test_what_is_exact_is_bounded_by_rounding() -> None:
    cone, ball = round_of("CONICAL_SURFACE", 2.0, 0.4), round_of("SPHERICAL_SURFACE", 2.0)
    apex = -2.0 / np.tan(0.4)
    start, end = (cone.at(np.array([0.7]), np.array([v]))[0][0] for v in (apex, 3.0))
    ruling = edge_of(Line(start, end - start), (0.0, 1.0))
    great = edge_of(Conic(ball.origin, 2.0 * ball.axes[0], 2.0 * ball.axes[2]), (0.1, 6.0))
    frame = (ball.origin, ball.axes[[0, 2, 1]])
    found = [gap_bound(cone, ruling, None, 0.0), gap_bound(ball, great, None, 0.0),
             gap_bound(frame, great, None, 0.0)]  # fmt: skip
    assert max(found) < 1e-12
    assert gap_bound(ball, ruling, None, 0.0) > 1.0


def swept() -> dict[str, tuple[Surface, Curve, Trace, tuple[float, float]]]:
    """Surfaces, with a curve that runs along one of their parameters."""
    rng = np.random.default_rng(8)
    curve = wavy(rng, lambda t: np.stack((4.0 + t, 0 * t, t + t * t), axis=1), 0.1, False)
    axis = np.array([0.0, 0.0, 1.0])
    pushed = Pushed(curve, np.array([0.0, 1.0, 0.3]), (None, None), ((0.0, 1.0), LINES), (11, 4))
    spun = Spun(curve, np.zeros(3), axis, (TURN, None), (LINES, (0.0, 1.0)), (14, 11))
    moved = SplineCurve(curve.knots, 5, curve.poles + 2.0 * pushed.vector, False, None, 11)
    turned = SplineCurve(curve.knots, 5, curve.poles @ spun.turn(0.4).T, False, None, 11)
    out = curve.at(np.array([0.6]))[0][0] * [1.0, 1.0, 0.0]
    height = curve.at(np.array([0.6]))[0][0] * [0.0, 0.0, 1.0]
    circle = Conic(height, out, np.cross(axis, out))
    knots = (np.repeat([0.0, 0.4, 1.0], [4, 2, 4]), np.repeat([0.0, 1.0], [3, 3]))
    poles = rng.uniform(-1.0, 1.0, (6, 3, 3)) + 4.0
    plain = make_surface(knots, (3, 2), poles, False)
    whole, part = (0.0, 1.0), (0.2, 0.9)
    return {
        "pushed": (pushed, moved, Trace(0, 2.0, *whole, True), whole),
        "pushed line": (pushed, Line(curve.at(np.array([0.3]))[0][0], pushed.vector),
                        Trace(1, 0.3, 0.0, 2.0, True), (0.0, 2.0)),
        "spun": (spun, turned, Trace(1, 0.4, 0.2, 0.7, True), part),
        "spun circle": (spun, circle, Trace(0, 0.6, 0.5, 3.0, True), (0.5, 3.5)),
        "side": (plain, plain.side(1, 0.3), Trace(0, 0.3, *whole, True), whole),
        "side backwards": (plain, Reversed(plain.side(1, 0.3)), Trace(0, 0.3, 0.2, 0.7, False),
                           (-0.9, -0.2)),
    }  # fmt: skip


@pytest.mark.parametrize("name", list(swept()))
def test_lines_of_parameters_are_bounded(name: str) -> None:
    surface, curve, trace, interval = swept()[name]
    edge = edge_of(curve, interval)
    assert gap_bound(surface, edge, trace, 0.0) < 1e-12
    assert gap_bound(surface, edge, None, 0.0) == np.inf
    level = Trace(trace.axis, trace.level + 1e-3, trace.start, trace.length, trace.rising)
    assert 1e-5 < gap_bound(surface, edge, level, 1e-3) < 1e-1
