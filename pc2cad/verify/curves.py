"""Curves of a STEP file: lines, conics, B-splines, and what is wrapped round them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import product
from pc2cad.verify.defects import StepDefectError, StepUnknownError
from pc2cad.verify.exchange import Parts
from pc2cad.verify.inversion import Sampling
from pc2cad.verify.records import DEEPEST, Record, Records, is_true, length, numbers, whole
from pc2cad.verify.splines import SplineCurve, make_curve

TURN = 2.0 * np.pi
HIGHEST_DEGREE = 40
WRAPPERS = ("SURFACE_CURVE", "SEAM_CURVE", "INTERSECTION_CURVE", "BOUNDED_SURFACE_CURVE")


class Curve(Protocol):
    """A parametric curve; `period` is the length of its parameter range if it is closed."""

    @property
    def period(self) -> float | None:
        """The length of the parameter range if it is closed."""
        ...

    @property
    def points(self) -> int:
        """Gauss points per break."""
        ...

    def at(self, t: Array) -> tuple[Array, Array]:
        """Return points and first derivatives, one per row."""
        ...

    def breaks(self, a: float, b: float) -> Array:
        """Return parameters from a to b (a < b) between which the curve is smooth and short."""
        ...

    def sampling(self, points: Array) -> Sampling:
        """Return parameters dense enough to start an inversion, and the bounds it must keep."""
        ...

    def locate(self, points: Array) -> Array:
        """Return the parameters of the nearest points."""
        ...


@dataclass(frozen=True, eq=False)
class Line:
    """A straight line, parametrised by its vector."""

    origin: Array
    vector: Array
    period: float | None = None
    points: int = 4

    def at(self, t: Array) -> tuple[Array, Array]:
        """Return points and first derivatives."""
        return self.origin + t[:, None] * self.vector, np.tile(self.vector, (len(t), 1))

    def breaks(self, a: float, b: float) -> Array:
        """Return where it is smooth and short between."""
        return np.array([a, b])

    def sampling(self, points: Array) -> Sampling:
        """Return where an inversion starts, and its bounds."""
        offsets = np.linalg.norm(points - self.origin, axis=1)
        reach = 1.0 + float(offsets.max() / np.linalg.norm(self.vector))
        return np.linspace(-reach, reach, 129), -2.0 * reach, 2.0 * reach

    def locate(self, points: Array) -> Array:
        """Return the parameters of the nearest points."""
        return product(points - self.origin, self.vector) / (self.vector @ self.vector)


@dataclass(frozen=True, eq=False)
class Conic:
    """A circle or an ellipse about a centre, by its two half axes."""

    centre: Array
    first: Array
    second: Array
    period: float | None = TURN
    points: int = 16

    def at(self, t: Array) -> tuple[Array, Array]:
        """Return points and first derivatives."""
        c, s = np.cos(t)[:, None], np.sin(t)[:, None]
        return (
            self.centre + c * self.first + s * self.second,
            c * self.second - s * self.first,
        )

    def breaks(self, a: float, b: float) -> Array:
        """Return where it is smooth and short between."""
        return np.linspace(a, b, 1 + max(1, int(np.ceil((b - a) / (TURN / 8.0)))))

    def sampling(self, points: Array) -> Sampling:
        """Return where an inversion starts, and its bounds."""
        return np.linspace(0.0, TURN, 65), -TURN, 2.0 * TURN

    def locate(self, points: Array) -> Array:
        """Return the parameters of the nearest points."""
        away = points - self.centre
        x, y = (product(away, part) / (part @ part) for part in (self.first, self.second))
        return np.asarray(np.arctan2(y, x))


@dataclass(frozen=True, eq=False)
class OpenConic:
    """A parabola or one branch of a hyperbola: centre + f(t) first + g(t) second."""

    centre: Array
    first: Array
    second: Array
    jet: Callable[[Array], tuple[Array, Array, Array, Array]]
    inverse: Callable[[Array], Array]
    #: what counts as one where a parabola's parameter is the length across its axis
    unit: float = 1.0
    period: float | None = None
    points: int = 20

    def at(self, t: Array) -> tuple[Array, Array]:
        """Return points and first derivatives."""
        f, g, df, dg = (part[:, None] for part in self.jet(t))
        return self.centre + f * self.first + g * self.second, df * self.first + dg * self.second

    def breaks(self, a: float, b: float) -> Array:
        """Return where it is smooth and short between."""
        return np.linspace(a, b, 9)

    def sampling(self, points: Array) -> Sampling:
        """Return where an inversion starts, and its bounds."""
        t = self.locate(points)
        low, high = float(t.min()), float(t.max())
        reach = 1.0 + high - low
        return np.linspace(low - reach, high + reach, 129), low - 2 * reach, high + 2 * reach

    def locate(self, points: Array) -> Array:
        """Return the parameters of the nearest points."""
        along = product(points - self.centre, self.second) / (self.second @ self.second)
        return self.inverse(along)


@dataclass(frozen=True, eq=False)
class Reversed:
    """A curve that runs the other way: its parameter is the negative one."""

    curve: Curve

    @property
    def period(self) -> float | None:
        """The length of the parameter range if it is closed."""
        return self.curve.period

    @property
    def points(self) -> int:
        """Gauss points per break."""
        return self.curve.points

    def at(self, t: Array) -> tuple[Array, Array]:
        """Return points and first derivatives."""
        point, slope = self.curve.at(-t)
        return point, -slope

    def breaks(self, a: float, b: float) -> Array:
        """Return where it is smooth and short between."""
        return -self.curve.breaks(-b, -a)[::-1]

    def sampling(self, points: Array) -> Sampling:
        """Return where an inversion starts, and its bounds."""
        samples, low, high = self.curve.sampling(points)
        return -samples[::-1], -high, -low

    def locate(self, points: Array) -> Array:
        """Return the parameters of the nearest points."""
        return -self.curve.locate(points)

    @property
    def domain(self) -> tuple[float, float]:
        """The ends of the parameter."""
        low, high = domain_of(self.curve)
        return -high, -low


def domain_of(curve: Curve) -> tuple[float, float]:
    """Return the ends of a curve's parameter, infinite where it has none."""
    low, high = getattr(curve, "domain", (-np.inf, np.inf))
    return float(low), float(high)


@lru_cache(maxsize=32)
def _unit_rule(points: int) -> tuple[Array, Array]:
    return np.polynomial.legendre.leggauss(points)


def gauss_rule(breaks: Array, points: int) -> tuple[Array, Array]:
    """Return Gauss nodes and weights on every interval between breaks."""
    x, w = _unit_rule(points)
    half = 0.5 * np.diff(breaks)[:, None]
    middle = 0.5 * (breaks[:-1] + breaks[1:])[:, None]
    return (middle + half * x).ravel(), (half * w).ravel()


def read_curve(records: Records, ref: Any, depth: int = 0) -> Curve:
    """Return the curve in space behind a reference, wrappers removed."""
    if depth > DEEPEST:
        raise StepDefectError(f"the curve {ref} is wrapped more than {DEEPEST} times, or in itself")
    record = records.get(ref)
    kind = spline_kind(record.parts, "CURVE")
    if kind is not None:
        return _read_spline(records, record, kind)
    if record.keyword in WRAPPERS:
        return read_curve(records, record.values(2)[1], depth + 1)
    if record.keyword == "TRIMMED_CURVE":
        basis = read_curve(records, record.values(5)[1], depth + 1)
        return basis if is_true(record.values()[4]) else Reversed(basis)
    if record.keyword == "LINE":
        values = record.values(3)
        return Line(records.point(values[1]), records.vector(values[2]))
    if record.keyword == "POLYLINE":
        poles = records.points(record.values(2)[1])
        if len(poles) < 2:
            raise StepDefectError(f"the polyline {ref} has no two points")
        knots = np.repeat(np.arange(float(len(poles))), [2, *[1] * (len(poles) - 2), 2])
        return make_curve(knots, 1, poles, False)
    return _read_conic(records, record)


def _read_conic(records: Records, record: Record) -> Curve:
    if record.keyword not in ("CIRCLE", "ELLIPSE", "PARABOLA", "HYPERBOLA"):
        raise StepUnknownError(f"the curve {record.ref} is a {record.keyword}, which is not known")
    values = record.values(3)
    origin, (x, y, _) = records.frame(values[1])
    first = length(values[2], record.ref)
    if record.keyword == "PARABOLA":
        return OpenConic(
            origin, first * x, 2.0 * first * y,
            lambda t: (t * t, t, 2.0 * t, np.ones_like(t)), lambda along: along,
            0.5 / first,
        )  # fmt: skip
    second = length(values[-1], record.ref)
    if record.keyword == "HYPERBOLA":
        return OpenConic(
            origin, first * x, second * y,
            lambda t: (np.cosh(t), np.sinh(t), np.sinh(t), np.cosh(t)), np.arcsinh,
        )  # fmt: skip
    return Conic(origin, first * x, second * y)


def spline_kind(parts: Parts, what: str) -> str | None:
    """Return which of the forms of knots a B-spline has, None where it is no B-spline."""
    named = {f"B_SPLINE_{what}_WITH_KNOTS": "KNOTS", f"QUASI_UNIFORM_{what}": "QUASI",
             f"BEZIER_{what}": "BEZIER", f"UNIFORM_{what}": "UNIFORM"}  # fmt: skip
    return next((kind for word, kind in named.items() if word in parts), None)


def plain_knots(kind: str, count: int, degree: int, ref: Any) -> tuple[Array, list[int]]:
    """Return the knots and multiplicities of a form that does not write them."""
    if not 1 <= degree < count:
        raise StepDefectError(f"the B-spline {ref} of degree {degree} has {count} poles")
    if kind == "UNIFORM":
        return np.arange(-degree, count + 1.0), [1] * (count + degree + 1)
    if kind == "BEZIER":
        spans, rest = divmod(count - 1, degree)
        if rest:
            raise StepDefectError(f"the Bezier form {ref} of degree {degree} has {count} poles")
        return np.arange(spans + 1.0), [degree + 1, *[degree] * (spans - 1), degree + 1]
    spans = count - degree
    return np.arange(spans + 1.0), [degree + 1, *[1] * (spans - 1), degree + 1]


def check_knots(values: Array, multiplicities: Sequence[int], count: int, degree: int) -> Array:
    """Return the knot vector written out; raise StepDefectError where it is no such vector."""
    if len(values) != len(multiplicities) or sum(multiplicities) != count + degree + 1:
        raise StepDefectError(
            f"a B-spline of degree {degree} has {sum(multiplicities)} knots for {count} poles"
        )
    if not 1 <= degree <= HIGHEST_DEGREE:
        raise StepDefectError(f"a B-spline has the degree {degree}")
    knots = np.repeat(values, multiplicities)
    inner = multiplicities[1:-1]
    if (
        np.any(np.diff(values) <= 0.0)
        or knots[degree] >= knots[count]
        or max(inner, default=1) > degree
        or max(multiplicities) > degree + 1
    ):
        raise StepDefectError("the knots of a B-spline do not ascend, or come too often")
    return knots


def homogeneous(poles: Array, weights: Any, ref: Any) -> Array:
    """Return poles times weights, with the weights as last coordinate."""
    factors = numbers(weights, ref)[..., None]
    if factors.shape[:-1] != poles.shape[:-1] or not np.all(factors > 0.0):
        raise StepDefectError(f"the weights of the B-spline {ref} do not fit its poles")
    return np.concatenate([poles * factors, factors], axis=-1)


def _read_spline(records: Records, record: Record, kind: str) -> SplineCurve:
    parts, ref = record.parts, record.ref
    own = record.part("B_SPLINE_CURVE_WITH_KNOTS")
    if "B_SPLINE_CURVE" in parts:
        head, tail = record.part("B_SPLINE_CURVE", 2), own
    else:
        simple = record.values(6)
        head, tail = simple[1:], simple[6:]
    if len(head) < 2 or (kind == "KNOTS" and len(tail) < 2):
        raise StepDefectError(f"the B-spline {ref} has too few parameters")
    degree, poles = whole(head[0]), records.points(head[1])
    if kind == "KNOTS":
        values, often = numbers(tail[1], ref), [whole(n) for n in tail[0]]
    else:
        values, often = plain_knots(kind, len(poles), degree, ref)
    knots = check_knots(values, often, len(poles), degree)
    rational = "RATIONAL_B_SPLINE_CURVE" in parts
    if rational:
        poles = homogeneous(poles, record.part("RATIONAL_B_SPLINE_CURVE", 1)[0], ref)
    return make_curve(knots, degree, poles, rational)


def without_period(curve: Curve) -> Curve:
    """Return a spline that is not taken for closed, other curves as they are."""
    return replace(curve, period=None) if isinstance(curve, SplineCurve) else curve
