"""Plane generator curves of channels: coordinates in the plane of the section.

A curve is a pair of scalar functions, x(t) and y(t), once round for t from 0 to 1, periodic.
Formulas: docs/channels.md; the paper names the curves (its references 30 and 31) without formulas.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import accumulate, pairwise
from math import atan2, dist, hypot, tan
from typing import Final

from pc2cad.errors import InputError
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import PI, Expr, Number, as_expr, call, number, pieces

Curve = tuple[Callable[[Expr], Expr], Callable[[Expr], Expr]]
Plane = Sequence[tuple[Expr, Expr]]

#: spacing of a contour's nodes -> power of the chord that each arc's share of t goes with
SPACINGS: Final = {"uniform": 0.0, "centripetal": 0.5, "chord": 1.0}


class SectionError(InputError):
    """A section curve is not closed, or not as its kind asks."""


def ellipse(a: Expr, b: Expr) -> Curve:
    """Return the ellipse with semi-axes a and b."""
    return lambda t: a * call("cos", 2 * PI * t), lambda t: b * call("sin", 2 * PI * t)


def superellipse(a: Expr, b: Expr, exponent: Expr) -> Curve:
    """Return the superellipse |x/a|^n + |y/b|^n = 1, n ≥ 2, by the angle about its centre.

    It is analytic for even n; otherwise its derivatives above n jump where it meets the axes.
    """
    n = evaluate(exponent, {}) if not exponent.symbols else 2.0
    if n < 2:
        raise SectionError(f"the exponent of a superellipse is 2 or more, and {n:g} was given")
    even = exponent.op == "number" and exponent.payload % 2 == 0

    def r(t: Expr) -> Expr:
        c, s = call("cos", 2 * PI * t) / a, call("sin", 2 * PI * t) / b
        if not even:
            c, s = call("abs", c), call("abs", s)
        return (c**exponent + s**exponent) ** (-1 / exponent)

    return polar(r)


def polar(r: Callable[[Expr], Expr]) -> Curve:
    """Return the curve at distance r(t) in the direction of the angle 2πt."""
    return (
        lambda t: r(t) * call("cos", 2 * PI * t),
        lambda t: r(t) * call("sin", 2 * PI * t),
    )


def sine_wave(radius: Expr, amplitude: Expr, waves: Expr, radius_y: Expr | None = None) -> Curve:
    """Return the sine wave round a circle, r = R + h sin(nφ), φ = 2πt.

    With a second radius it goes round the ellipse (R, R_y), both coordinates by the factor
    1 + (h/R) sin(nφ). It closes (and is then C∞) exactly when the number of waves is whole.
    """

    def r(own: Expr, t: Expr) -> Expr:
        wave = call("sin", 2 * waves * PI * t)
        return own + amplitude * wave if own is radius else own + own * (amplitude / radius) * wave

    return (
        lambda t: r(radius, t) * call("cos", 2 * PI * t),
        lambda t: r(radius if radius_y is None else radius_y, t) * call("sin", 2 * PI * t),
    )


def polygon(corners: Plane) -> Curve:
    """Return the closed polygon through `corners`, each side with the same share of t.

    Only its value is continuous at a corner: faces that it sweeps meet there in edges.
    """
    k = _count(corners, "polygon")
    breaks = tuple(Fraction(i, k) for i in range(k + 1))
    axes = [
        tuple(
            (corners[i][axis], k * (corners[(i + 1) % k][axis] - corners[i][axis]))
            for i in range(k)
        )
        for axis in (0, 1)
    ]
    return (
        lambda t: pieces(t, breaks, axes[0], smoothness=0),
        lambda t: pieces(t, breaks, axes[1], smoothness=0),
    )


def regular_polygon(count: int, radius: Expr) -> list[tuple[Expr, Expr]]:
    """Return the corners of a regular polygon on a circle, the first one on the x axis."""
    if count < 3:
        raise SectionError(f"a polygon has at least 3 corners, and {count} were asked for")
    turns = [2 * PI * number(Fraction(i, count)) for i in range(count)]
    return [(radius * call("cos", turn), radius * call("sin", turn)) for turn in turns]


def rounded_polygon(corners: Plane, radii: Sequence[Number | Expr]) -> Curve:
    """Return the polygon with its corners rounded by arcs; t goes with the length.

    Sides and arcs become faces of their own. Corners and radii are numbers. Raises SectionError
    where two arcs need more than their common side.
    """
    k = _count(corners, "polygon")
    if len(radii) != k:
        raise SectionError(f"the polygon has {k} corners, and {len(radii)} radii were given")
    places = [(_value(x), _value(y)) for x, y in corners]
    cuts = [
        _rounding(places[i - 1], places[i], places[(i + 1) % k], _value(as_expr(r)))
        for i, r in enumerate(radii)
    ]
    stretches: list[tuple[float, Callable[[Expr], tuple[Expr, Expr]]]] = []
    for i in range(k):
        here, there = cuts[i], cuts[(i + 1) % k]
        side = dist(places[i], places[(i + 1) % k])
        left = side - here.reach - there.reach
        if left < -1e-9 * side:
            raise SectionError(
                f"the side behind corner {i + 1} of the polygon is {side:.6g} long, and the arcs "
                f"at its ends need {here.reach + there.reach:.6g}"
            )
        if left > 1e-9 * side:
            stretches.append((left, _line(here.end, there.start)))
        if there.radius > 0:
            stretches.append((there.radius * abs(there.angle), there.arc))
    return _stretched(stretches)


class _Rounding:
    """The arc at a corner, from `start` to `end` round `centre`."""

    def __init__(
        self, here: tuple[float, float], a: tuple[float, float], b: tuple[float, float], r: float
    ) -> None:
        self.radius = r
        self.angle = atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])
        self.reach = r * abs(tan(self.angle / 2))
        self.start = (here[0] - a[0] * self.reach, here[1] - a[1] * self.reach)
        self.end = (here[0] + b[0] * self.reach, here[1] + b[1] * self.reach)
        self._along = a
        turn = 1.0 if self.angle > 0 else -1.0
        self._inward = (-turn * a[1], turn * a[0])

    def arc(self, t: Expr) -> tuple[Expr, Expr]:
        """Return the arc's point for t from 0 to 1."""
        angle = number(abs(self.angle)) * t
        c, s = call("cos", angle), call("sin", angle)
        x, y = (
            self.start[k] + self.radius * (self._inward[k] * (1 - c) + self._along[k] * s)
            for k in (0, 1)
        )
        return x, y


def _rounding(
    before: tuple[float, float], here: tuple[float, float], after: tuple[float, float], r: float
) -> _Rounding:
    if not 0 <= r < float("inf"):
        raise SectionError("the radius of a corner is 0 or more")
    steps = []
    for p, q in ((before, here), (here, after)):
        size = dist(p, q)
        if size == 0:
            raise SectionError("two corners of the polygon that follow each other are one place")
        steps.append(((q[0] - p[0]) / size, (q[1] - p[1]) / size))
    return _Rounding(here, steps[0], steps[1], r)


def _line(
    start: tuple[float, float], end: tuple[float, float]
) -> Callable[[Expr], tuple[Expr, Expr]]:
    return lambda t: (start[0] + (end[0] - start[0]) * t, start[1] + (end[1] - start[1]) * t)


def _stretched(
    stretches: Sequence[tuple[float, Callable[[Expr], tuple[Expr, Expr]]]],
) -> Curve:
    """Return stretches one after another, t going with their length."""
    total, run, breaks = sum(length for length, _ in stretches), 0.0, [Fraction(0)]
    for length, _ in stretches:
        run += length
        breaks.append(Fraction(run / total))
    breaks[-1] = Fraction(1)
    limits = tuple(breaks)
    shares = tuple((number(0), number(1 / (b - a))) for a, b in pairwise(limits))

    def axis(k: int) -> Callable[[Expr], Expr]:
        def at(t: Expr) -> Expr:
            local = pieces(t, limits, shares, smoothness=0)
            rows = tuple((curve(local)[k],) for _, curve in stretches)
            return pieces(t, limits, rows, smoothness=0)

        return at

    return axis(0), axis(1)


def contour(nodes: Plane, handle: Expr, spacing: str = "uniform") -> Curve:
    """Return the closed contour of first order of smoothness through `nodes`.

    The tangent at each node is parallel to the chord of its neighbours. With ``uniform`` spacing
    arc i is the cubic Bézier P_i, P_i + λ(P_{i+1} - P_{i-1}), P_{i+1} - λ(P_{i+2} - P_i), P_{i+1}
    (λ is the `handle`; 1/6 is Catmull-Rom). With ``chord`` or ``centripetal`` spacing each arc's
    share of t goes with its chord d, or with √d, and its handles with twice its share of both arcs
    at the node: nodes of unequal distance make no loops. It is C¹ in t for every λ.
    """
    k = _count(nodes, "contour")
    if spacing not in SPACINGS:
        raise SectionError(f"the spacing is one of {', '.join(SPACINGS)}, not '{spacing}'")
    if spacing == "uniform":
        shares = [Fraction(1, k)] * k
    else:
        places = [(_value(x), _value(y)) for x, y in nodes]
        chords = [dist(p, q) ** SPACINGS[spacing] for p, q in pairwise([*places, places[0]])]
        if min(chords) == 0:
            raise SectionError("two points of the contour that follow each other are one place")
        shares = [Fraction(c / sum(chords)) for c in chords]
    breaks = (*accumulate(shares[:-1], initial=Fraction(0)), Fraction(1))
    widths = [b - a for a, b in pairwise(breaks)]
    axes = []
    for axis in (0, 1):
        p = [node[axis] for node in nodes]
        # velocity at each node: both its arcs run with it
        speeds = [
            6 * handle * (p[(i + 1) % k] - p[i - 1]) / number(widths[i - 1] + widths[i])
            for i in range(k)
        ]
        axes.append(
            tuple(
                _arc_row(p[i], p[(i + 1) % k], speeds[i], speeds[(i + 1) % k], widths[i])
                for i in range(k)
            )
        )
    return (
        lambda t: pieces(t, breaks, axes[0], smoothness=1),
        lambda t: pieces(t, breaks, axes[1], smoothness=1),
    )


def _arc_row(start: Expr, end: Expr, first: Expr, last: Expr, width: Fraction) -> tuple[Expr, ...]:
    """Return ascending coefficients of the cubic with these ends and end velocities."""
    h = number(width)
    rise = (end - start) / h
    return start, first, (3 * rise - 2 * first - last) / h, (first + last - 2 * rise) / h**2


def _count(points: Plane, what: str) -> int:
    if len(points) < 3:
        raise SectionError(f"a closed {what} needs at least 3 points, here are {len(points)}")
    return len(points)


def _value(tree: Expr) -> float:
    found = evaluate(tree, {}) if not tree.symbols else float("nan")
    if not hypot(found) < float("inf"):
        raise SectionError("the points and radii of this section must be finite numbers")
    return found
