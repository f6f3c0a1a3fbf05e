"""Curves of a STEP file: values, first derivatives, inversion and quadrature with numpy only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .step_parse import StepDefect, StepGraph, StepUnsupported, Vector, is_true

TURN = 2.0 * np.pi
_WRAPPERS = ("SURFACE_CURVE", "SEAM_CURVE", "INTERSECTION_CURVE")
_CURVES = ("LINE", "CIRCLE", "ELLIPSE", "B_SPLINE_CURVE_WITH_KNOTS", "TRIMMED_CURVE", *_WRAPPERS)

Sampling = tuple[Vector, float, float]


class Curve(Protocol):
    """A parametric curve; period is the length of its parameter range if it is closed."""

    period: float | None
    points: int

    def at(self, t: Vector) -> tuple[Vector, Vector]:
        """Points and first derivatives, one per row."""
        ...

    def breaks(self, a: float, b: float) -> Vector:
        """Parameters from a to b (a < b) between which the curve is smooth and short."""
        ...

    def sampling(self, points: Vector) -> Sampling:
        """Parameters dense enough to start an inversion, and the bounds it must keep."""
        ...


@dataclass(frozen=True)
class Line:
    """A straight line, parametrised by its vector."""

    origin: Vector
    vector: Vector
    period: float | None = None
    points: int = 4

    def at(self, t: Vector) -> tuple[Vector, Vector]:
        return self.origin + t[:, None] * self.vector, np.tile(self.vector, (len(t), 1))

    def breaks(self, a: float, b: float) -> Vector:
        return np.array([a, b])

    def sampling(self, points: Vector) -> Sampling:
        offsets = np.linalg.norm(points - self.origin, axis=1)
        reach = 1.0 + float(offsets.max() / np.linalg.norm(self.vector))
        return np.linspace(-reach, reach, 129), -2.0 * reach, 2.0 * reach


@dataclass(frozen=True)
class Conic:
    """A circle or an ellipse about a centre, by its two half axes."""

    centre: Vector
    first: Vector
    second: Vector
    period: float | None = TURN
    points: int = 16

    def at(self, t: Vector) -> tuple[Vector, Vector]:
        c, s = np.cos(t)[:, None], np.sin(t)[:, None]
        return (
            self.centre + c * self.first + s * self.second,
            c * self.second - s * self.first,
        )

    def breaks(self, a: float, b: float) -> Vector:
        return np.linspace(a, b, 1 + max(1, int(np.ceil((b - a) / (TURN / 8.0)))))

    def sampling(self, points: Vector) -> Sampling:
        return np.linspace(0.0, TURN, 65), -TURN, 2.0 * TURN


@dataclass(frozen=True)
class BSplineCurve:
    """A B-spline with poles in homogeneous coordinates (weight last) if it is rational."""

    knots: Vector
    degree: int
    poles: Vector
    rational: bool
    period: float | None
    points: int

    @property
    def domain(self) -> tuple[float, float]:
        return float(self.knots[self.degree]), float(self.knots[len(self.poles)])

    def at(self, t: Vector) -> tuple[Vector, Vector]:
        low, high = self.domain
        if self.period is not None:
            outside = (t < low) | (t > high)
            t = np.where(outside, low + np.mod(t - low, self.period), t)
        value, slope = basis(self.knots, self.degree, len(self.poles), t)
        return (
            project(value @ self.poles, slope @ self.poles)
            if self.rational
            else (
                value @ self.poles,
                slope @ self.poles,
            )
        )

    def breaks(self, a: float, b: float) -> Vector:
        inner = distinct(self.knots, self.domain)
        if self.period is not None:
            inner = np.concatenate([inner - self.period, inner, inner + self.period])
        margin = 1e-12 * (b - a)
        inner = np.unique(inner[(inner > a + margin) & (inner < b - margin)])
        edges = np.concatenate([[a], inner, [b]])
        return np.unique(np.linspace(edges[:-1], edges[1:], 3)) if self.rational else edges

    def sampling(self, points: Vector) -> Sampling:
        spans = distinct(self.knots, self.domain)
        samples = np.linspace(spans[:-1], spans[1:], 4 * self.degree + 5)
        return np.unique(samples), *self.domain


def distinct(knots: Vector, domain: tuple[float, float]) -> Vector:
    """The distinct knots inside a domain, its ends included."""
    inner = np.unique(knots)
    inner = inner[(inner > domain[0]) & (inner < domain[1])]
    return np.concatenate([[domain[0]], inner, [domain[1]]])


def basis(knots: Vector, degree: int, count: int, t: Vector) -> tuple[Vector, Vector]:
    """Values and first derivatives of all B-splines, one row per parameter (Cox-de Boor)."""
    last = int(np.flatnonzero(knots[:count] < knots[count])[-1])
    span = np.clip(np.searchsorted(knots, t, side="right") - 1, degree, last)
    local, slope, column = np.ones((len(t), 1)), np.zeros((len(t), 1)), t[:, None]
    for d in range(1, degree + 1):
        first = span[:, None] - d + 1 + np.arange(d)
        left, right = knots[first], knots[first + d]
        ratio = local / (right - left)
        local, slope = np.zeros((2, len(t), d + 1))
        local[:, :-1] += (right - column) * ratio
        local[:, 1:] += (column - left) * ratio
        slope[:, :-1] -= d * ratio
        slope[:, 1:] += d * ratio
    columns = span[:, None] - degree + np.arange(degree + 1)
    rows = np.arange(len(t))[:, None]
    values, slopes = np.zeros((2, len(t), count))
    values[rows, columns], slopes[rows, columns] = local, slope
    return values, slopes


def project(value: Vector, slope: Vector) -> tuple[Vector, Vector]:
    """Point and derivative of homogeneous coordinates and their derivative."""
    weight = value[..., -1:]
    point = value[..., :-1] / weight
    return point, (slope[..., :-1] - point * slope[..., -1:]) / weight


def closest(
    at: Callable[[Vector], tuple[Vector, Vector]], sampling: Sampling, points: Vector
) -> Vector:
    """Parameters of points that lie on a curve: nearest sample, then Gauss-Newton."""
    samples, low, high = sampling
    known = at(samples)[0]
    gap = np.linalg.norm(points[:, None] - known[None], axis=2)
    t = samples[gap.argmin(axis=1)]
    best, nearest = t, np.full(len(points), np.inf)
    for _ in range(24):
        value, slope = at(t)
        distance = np.linalg.norm(points - value, axis=1)
        better = distance < nearest
        best, nearest = np.where(better, t, best), np.minimum(distance, nearest)
        length = np.maximum((slope**2).sum(axis=1), 1e-300)
        t = np.clip(t + ((points - value) * slope).sum(axis=1) / length, low, high)
    for end in (samples[0], samples[-1]):
        distance = np.linalg.norm(points - at(np.array([end]))[0], axis=1)
        snap = distance <= nearest + 1e-11 * (1e-3 + np.abs(points).max())
        best = np.where(snap & (np.abs(best - end) < 1e-6 * (high - low)), end, best)
    return np.asarray(best)


def gauss_rule(breaks: Vector, points: int) -> tuple[Vector, Vector]:
    """Gauss nodes and weights on every interval between breaks."""
    x, w = np.polynomial.legendre.leggauss(points)
    half = 0.5 * np.diff(breaks)[:, None]
    middle = 0.5 * (breaks[:-1] + breaks[1:])[:, None]
    return (middle + half * x).ravel(), (half * w).ravel()


def read_curve(graph: StepGraph, ref: Any) -> Curve:
    """The three-dimensional curve behind a reference, wrappers removed."""
    record = graph.get(ref, *_CURVES)
    if "B_SPLINE_CURVE_WITH_KNOTS" in record.parts:
        return _read_b_spline(graph, record.parts, ref)
    values = record.values
    if record.keyword in _WRAPPERS:
        return read_curve(graph, values[1])
    if record.keyword == "TRIMMED_CURVE":
        if not is_true(values[4]):
            raise StepUnsupported(f"Trimmed curve {ref} runs against its basis curve.")
        return read_curve(graph, values[1])
    if record.keyword == "LINE":
        return Line(graph.point(values[1]), graph.vector(values[2]))
    origin, axes = graph.frame(values[1])
    first, second = float(values[2]), float(values[-1])
    return Conic(origin, first * axes[0], second * axes[1])


def full_knots(values: Any, multiplicities: Any, count: int, degree: int, ref: Any) -> Vector:
    """The knot vector written out, checked for length and order."""
    knots = np.repeat(np.array(values, dtype=float), multiplicities)
    if len(knots) != count + degree + 1:
        raise StepDefect(f"B-spline {ref} has {len(knots)} knots for {count} poles.")
    if degree < 1 or np.any(np.diff(values) <= 0.0) or knots[degree] >= knots[count]:
        raise StepDefect(f"The degree or the knots of B-spline {ref} are not admissible.")
    return knots


def homogeneous(poles: Vector, weights: Any, ref: Any) -> Vector:
    """Poles times weights, with the weights as last coordinate."""
    factors = np.array(weights, dtype=float)[..., None]
    if factors.shape[:-1] != poles.shape[:-1] or not np.all(factors > 0.0):
        raise StepDefect(f"The weights of B-spline {ref} do not fit its poles.")
    return np.concatenate([poles * factors, factors], axis=-1)


def _read_b_spline(graph: StepGraph, parts: dict[str, Any], ref: Any) -> BSplineCurve:
    if "B_SPLINE_CURVE" in parts:
        degree, refs = parts["B_SPLINE_CURVE"][:2]
        multiplicities, values = parts["B_SPLINE_CURVE_WITH_KNOTS"][:2]
    else:
        _, degree, refs, _, _, _, multiplicities, values, _ = parts["B_SPLINE_CURVE_WITH_KNOTS"]
    poles = graph.points(refs)
    knots = full_knots(values, multiplicities, len(poles), degree, ref)
    rational = "RATIONAL_B_SPLINE_CURVE" in parts
    if rational:
        poles = homogeneous(poles, parts["RATIONAL_B_SPLINE_CURVE"][0], ref)
    return make_b_spline(knots, degree, poles, rational)


def make_b_spline(knots: Vector, degree: int, poles: Vector, rational: bool) -> BSplineCurve:
    """A B-spline curve, periodic if its ends meet."""
    points = 24 if rational else 2 * degree + 1
    curve = BSplineCurve(knots, degree, poles, rational, None, points)
    ends = curve.at(np.array(curve.domain))[0]
    cartesian = poles[:, :-1] / poles[:, -1:] if rational else poles
    size = float(np.ptp(cartesian, axis=0).max())
    if size > 0.0 and np.linalg.norm(ends[1] - ends[0]) <= 1e-10 * size:
        period = curve.domain[1] - curve.domain[0]
        return BSplineCurve(knots, degree, poles, rational, period, points)
    return curve
