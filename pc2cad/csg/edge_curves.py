"""The curve in which two surfaces meet, from both of them: what the kernel's edge only comes near.

The kernel's edge says where to begin. Points of it go to the places that both surfaces have in
common, by Newton's method in the four parameters, each in a plane across the edge. A polynomial of
low degree through these points gives the planes for good: the common curve is a smooth function of
the polynomial's parameter, whatever the kernel's edge was. Pieces of degree 7 take its values and
its tangents, which the same equations give, and are halved until the curve is near both surfaces at
equal parameters. They join with a common tangent.

Where the curve is known, as a conic, such pieces are fitted to where its points are in a surface's
parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
from numpy.polynomial import chebyshev
from scipy.special import comb

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.geometry.carriers import SplinePath
from pc2cad.geometry.jets import CurveFunction, EdgeFunction, Sizes, Trace, crossings
from pc2cad.geometry.splines.spline_basis import spline_values

#: of the pieces: values and tangents at both ends, and four values between
DEGREE = 7
INNER = np.array([0.15, 0.38, 0.62, 0.85])
#: points of the kernel's edge that planes are found from
FIRST = 129
#: steps of Newton's method
STEPS = 14
#: degrees of the polynomial that gives the planes, which has to come this near to the curve, as a
#: share of its length
DEGREES, NEAR = (4, 8, 12, 18, 26, 38, 54), 2e-3
#: how fast the planes' order along the curve is that of their parameters, at least
ADVANCE = 0.1
#: a curve of more pieces is none that a file should have; and the shortest piece
MOST, SHORTEST = 300, 1e-4
#: places in a piece at which its distance from both surfaces is looked at
CHECKS = np.linspace(0.0, 1.0, 17)[1:-1]
#: a tangent of a surface that is shorter than this share of the longest has no direction: at a pole
FLAT = 1e-8
#: places along an edge at which a path is compared with another, and the share of its distance that
#: is worth replacing it
PLACES, BETTER = 257, 0.5


class _UnsettledError(Exception):
    """Newton's method does not settle, or too many pieces are needed."""


@dataclass(frozen=True, eq=False)
class CommonCurve:
    """A spline of degree 7 over [0, 1], in space and in the parameters of both surfaces."""

    #: flat, for all three
    knots: Array
    #: (n, 3), relative to the place that the surfaces are
    poles: Array
    #: (n, 2) each
    paths: tuple[Array, Array]
    #: largest distance from a surface at equal parameters that was seen
    seen: float


def common_curve(
    edge: EdgeFunction, ends: tuple[Array, Array], target: float
) -> CommonCurve | None:
    """Return the curve that two surfaces have in common, from an edge near it.

    `ends` are its first and last point, (3,), relative as the edge is; pieces are halved down to a
    distance `target` from the surfaces, in model units. None where Newton's method does not settle,
    as where the surfaces are tangent, or where too many pieces are needed.
    """
    try:
        with np.errstate(all="ignore"):
            knots, poles, seen = _fitted(_planes(edge, ends, target), target)
    except (_UnsettledError, np.linalg.LinAlgError):
        return None
    return CommonCurve(knots, poles[:, :3], (poles[:, 3:5], poles[:, 5:]), seen)


def path_along(
    curve: CurveFunction, span: tuple[float, float], trace: Trace, target: float
) -> tuple[SplinePath, float] | None:
    """Return where a curve near a surface is in its parameters, over [0, 1], and how far off.

    It begins at the trace's path, and comes to within `target` (a length) of the nearest places at
    equal parameters. None where that cannot be had, as where the surface has no normal, or is no
    better than the trace's path.
    """
    feet = _Feet((trace,), curve, span)
    try:
        with np.errstate(all="ignore"):
            knots, poles, _ = _fitted(feet, target)
    except (_UnsettledError, np.linalg.LinAlgError):
        return None
    t = np.linspace(0.0, 1.0, PLACES)
    tau = feet.at(t)
    point = curve.jet(tau)[0]
    found, known = (
        float(_distances((trace,), np.hstack((point, path))).max())
        for path in (spline_values(knots, poles[:, 3:], DEGREE, t), trace.path.jet(tau)[0])
    )
    if not found <= BETTER * known:
        return None
    return SplinePath(DEGREE, knots, poles[:, 3:]), found


class _Common(Protocol):
    """A curve on surfaces, over [0, 1]."""

    @property
    def traces(self) -> tuple[Trace, ...]:
        """The surfaces."""

    def curve(self, t: Array) -> tuple[Array, Array]:
        """Return points with all surfaces' parameters, (n, 3 + 2k), and their derivatives by t."""

    def off(self, t: Array, fitted: Array) -> Array:
        """Return by how much the fitted ones, (n, 3 + 2k), are too far off a surface, (n,)."""


@dataclass(frozen=True, eq=False)
class _Feet:
    """A curve that is known, and the places nearest to it on a surface."""

    traces: tuple[Trace]
    known: CurveFunction
    span: tuple[float, float]

    def at(self, t: Array) -> Array:
        """Return the known curve's own parameters."""
        first, last = self.span
        return first + (last - first) * t

    def curve(self, t: Array) -> tuple[Array, Array]:
        (trace,), tau = self.traces, self.at(t)
        point, along = self.known.jet(tau)
        y = trace.path.jet(tau)[0]
        least, kept = np.full(len(t), np.inf), y
        for _ in range(STEPS):
            there, *slopes = trace.surface.jet(y[:, 0], y[:, 1])
            gap = np.linalg.norm(there - point, axis=1)
            better = gap < least
            least, kept = np.where(better, gap, least), np.where(better[:, None], y, kept)
            if not better.any():
                break
            y = np.where(
                better[:, None], y - _solved(np.stack(slopes, axis=2), there - point), kept
            )
        _, *slopes = trace.surface.jet(kept[:, 0], kept[:, 1])
        moved = np.hstack((along, _solved(np.stack(slopes, axis=2), along)))
        return np.hstack((point, kept)), moved * (self.span[1] - self.span[0])

    def off(self, t: Array, fitted: Array) -> Array:
        foot = self.curve(t)[0]
        near, least = (
            _distances(self.traces, np.hstack((foot[:, :3], at[:, 3:]))) for at in (fitted, foot)
        )
        return near - least


@dataclass(frozen=True, eq=False)
class _Planes:
    """Planes across a curve, one for each parameter in [0, 1], and where to begin in each."""

    traces: tuple[Trace, Trace]
    #: coefficients of the polynomial by Chebyshev's, (degree + 1, 3)
    spine: Array
    #: parameters (n,), and both surfaces' parameters there, (n, 4)
    starts: tuple[Array, Array]
    enough: float

    def curve(self, t: Array) -> tuple[Array, Array]:
        """Return points with both surfaces' parameters, (n, 7), and their derivatives by t."""
        known, places = self.starts
        y = np.stack([np.interp(t, known, column) for column in places.T], axis=1)
        base, along, bend = (_spine(self.spine, t, order) for order in (0, 1, 2))
        y, point, slopes = _newton(self.traces, base, along, y, self.enough)
        speed = np.einsum("ni,ni->n", along, along)
        advance = speed - np.einsum("ni,ni->n", point - base, bend)
        if not np.all(advance > ADVANCE * speed):
            raise _UnsettledError
        right = np.zeros((len(t), 4))
        right[:, 3] = advance / np.sqrt(speed)
        moved = _solved(_matrix(slopes, along), right)
        tangent = slopes[0] * moved[:, :1] + slopes[1] * moved[:, 1:2]
        return np.hstack((point, y)), np.hstack((tangent, moved))

    def off(self, t: Array, fitted: Array) -> Array:
        return _distances(self.traces, fitted)


def _spine(coefficients: Array, t: Array, order: int = 0) -> Array:
    # the polynomial's own parameter runs from -1 to 1
    slopes = chebyshev.chebder(coefficients, order, scl=2.0) if order else coefficients
    return np.asarray(chebyshev.chebval(2 * t - 1, slopes), dtype=float).T


def _newton(
    traces: tuple[Trace, Trace], base: Array, along: Array, y: Array, enough: float
) -> tuple[Array, Array, tuple[Array, Array, Array, Array]]:
    """Return parameters (n, 4), points and slopes where both surfaces meet planes.

    The planes go through `base` across `along`. Raises where a distance stays above `enough`.
    """
    first, second = (trace.surface for trace in traces)
    length = np.linalg.norm(along, axis=1)
    least, kept = np.full(len(y), np.inf), y
    for _ in range(STEPS):
        p, p_a, p_b = first.jet(y[:, 0], y[:, 1])
        q, q_a, q_b = second.jet(y[:, 2], y[:, 3])
        plane = np.einsum("ni,ni->n", p - base, along)
        gap = np.linalg.norm(p - q, axis=1) + np.abs(plane) / length
        better = gap < least
        least, kept = np.where(better, gap, least), np.where(better[:, None], y, kept)
        if not better.any():
            break
        rest = np.concatenate((p - q, (plane / length)[:, None]), axis=1)
        step = _solved(_matrix((p_a, p_b, q_a, q_b), along), rest)
        y = np.where(better[:, None], y - step, kept)
    if not np.all(least <= enough):
        raise _UnsettledError
    p, p_a, p_b = first.jet(kept[:, 0], kept[:, 1])
    q, q_a, q_b = second.jet(kept[:, 2], kept[:, 3])
    return kept, (p + q) / 2, (p_a, p_b, q_a, q_b)


def _matrix(slopes: tuple[Array, Array, Array, Array], along: Array) -> Array:
    p_a, p_b, q_a, q_b = slopes
    matrix = np.zeros((len(along), 4, 4))
    matrix[:, :3] = np.stack((p_a, p_b, -q_a, -q_b), axis=2)
    length = np.linalg.norm(along, axis=1)
    matrix[:, 3, 0] = np.einsum("ni,ni->n", p_a, along) / length
    matrix[:, 3, 1] = np.einsum("ni,ni->n", p_b, along) / length
    return matrix


def _solved(matrix: Array, right: Array) -> Array:
    """Solve (n, k, m) for (n, k), by the nearest where it is none; no step without a direction.

    At a pole the angle round it has no tangent, and keeps its value.
    """
    lengths = np.linalg.norm(matrix, axis=1)
    flat = ~(lengths.min(axis=1) > FLAT * lengths.max(axis=1))
    if matrix.shape[1] > matrix.shape[2]:
        flat[:] = True
    found = np.empty(lengths.shape)
    if not flat.all():
        found[~flat] = np.linalg.solve(matrix[~flat], right[~flat, :, None])[:, :, 0]
    inverse = np.linalg.pinv(matrix[flat], rcond=FLAT)
    found[flat] = np.einsum("nij,nj->ni", inverse, right[flat])
    return found


def _planes(edge: EdgeFunction, ends: tuple[Array, Array], target: float) -> _Planes:
    """Return planes across the common curve, from points of it near the kernel's edge."""
    tau = np.linspace(*edge.span, FIRST)
    base, along = edge.curve.jet(tau)
    # across the ends themselves: beyond them a surface may have none
    base[0], base[-1] = ends
    y = np.hstack([trace.path.jet(tau)[0] for trace in edge.traces])
    y, points, _ = _newton(edge.traces, base, along, y, target)
    points[0], points[-1] = ends
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if not chords.min() > 0:
        raise _UnsettledError
    length = float(chords.sum())
    t = np.append(0.0, np.cumsum(chords)) / length
    for degree in DEGREES:
        spine = _nearest(t, points, degree)
        if np.linalg.norm(_spine(spine, t) - points, axis=1).max() <= NEAR * length:
            rounding = 64 * np.finfo(float).eps * float(np.abs(points).max())
            return _Planes(edge.traces, spine, (t, y), max(target / 8, rounding))
    raise _UnsettledError


def _nearest(t: Array, points: Array, degree: int) -> Array:
    """Return the polynomial through the first and the last point that is nearest to the others."""
    table = chebyshev.chebvander(2 * t - 1, degree)
    # those of even order are 1 at both ends, those of odd order -1 and 1
    ends = table[:, [k % 2 for k in range(2, degree + 1)]]
    chord = points[0] + t[:, None] * (points[-1] - points[0])
    found = np.linalg.lstsq(table[:, 2:] - ends, points - chord, rcond=None)[0]
    even, odd = (points[0] + points[-1]) / 2, (points[-1] - points[0]) / 2
    lowest = [even - found[::2].sum(axis=0), odd - found[1::2].sum(axis=0)]
    return np.vstack((lowest, found))


def _fitted(common: _Common, target: float) -> tuple[Array, Array, float]:
    """Return knots, poles and the largest distance from a surface that was seen.

    Pieces have common tangents, and each is halved until it is near the surfaces.
    """
    cuts = _cuts(common)
    while True:
        nets = _nets(common, cuts)
        widths = np.diff(cuts)
        t = cuts[:-1, None] + widths[:, None] * CHECKS
        fitted = np.einsum("ij,njk->nik", _bernstein(CHECKS), nets).reshape(t.size, -1)
        off = common.off(t.ravel(), fitted).reshape(t.shape).max(axis=1)
        coarse = (off > target) & (widths > SHORTEST)
        if not coarse.any():
            break
        cuts = np.sort(np.append(cuts, (cuts[:-1] + widths / 2)[coarse]))
        if len(cuts) > MOST:
            raise _UnsettledError
    # next pieces share a pole, and the tangents make it the point between its neighbours
    poles = np.concatenate((nets[0, :1], nets[:, 1:-1].reshape(-1, nets.shape[2]), nets[-1, -1:]))
    inner = np.repeat(cuts[1:-1], DEGREE - 1)
    knots = np.concatenate((np.zeros(DEGREE + 1), inner, np.ones(DEGREE + 1)))
    return knots, poles, float(off.max())


def _cuts(common: _Common) -> Array:
    """Return where pieces begin: where the curve crosses the knots of a surface."""
    found = [np.array([0.0, 1.0])]
    for number, trace in enumerate(common.traces):
        columns = slice(3 + 2 * number, 5 + 2 * number)

        def jet(t: Array, columns: slice = columns) -> tuple[Array, Array]:
            values, slopes = common.curve(t)
            return values[:, columns], slopes[:, columns]

        path = CurveFunction(jet, None, 1, _no_sizes)
        for axis, breaks in enumerate(trace.surface.breaks):
            if breaks is not None and len(breaks) > 2:
                found.append(crossings(path, np.linspace(0.0, 1.0, 9), axis, breaks[1:-1]))
    cuts = distinct(np.concatenate(found))
    cuts = cuts[np.append(True, np.diff(cuts) > SHORTEST)]
    return np.append(cuts[:-1], 1.0) if len(cuts) > 1 else np.array([0.0, 1.0])


def _no_sizes() -> Sizes:
    raise NotImplementedError


def _bernstein(places: Array) -> Array:
    k = np.arange(DEGREE + 1)
    return np.asarray(comb(DEGREE, k) * places[:, None] ** k * (1 - places[:, None]) ** k[::-1])


@cache
def _interpolation() -> tuple[Array, Array]:
    """Return the places in a piece, and what gives its poles from values and end tangents."""
    places = np.concatenate(([0.0], INNER, [1.0]))
    tangents = np.zeros((2, DEGREE + 1))
    tangents[0, :2] = tangents[1, -2:] = (-DEGREE, DEGREE)
    return places, np.linalg.inv(np.vstack((_bernstein(places), tangents)))


def _nets(common: _Common, cuts: Array) -> Array:
    """Return Bézier poles of the pieces, (pieces, 8, 3 + 2k)."""
    places, matrix = _interpolation()
    widths = np.diff(cuts)
    t = (cuts[:-1, None] + widths[:, None] * places).ravel()
    values, slopes = (rows.reshape(len(widths), len(places), -1) for rows in common.curve(t))
    ends = slopes[:, [0, -1]] * widths[:, None, None]
    rows = np.concatenate((values, ends), axis=1)
    return np.asarray(np.einsum("ij,njk->nik", matrix, rows))


def _distances(traces: Sequence[Trace], fitted: Array) -> Array:
    """Return how far points are from the farthest surface at the parameters beside them."""
    points = fitted[:, :3]
    return np.asarray(np.max([
        np.linalg.norm(points - trace.surface.jet(fitted[:, k], fitted[:, k + 1])[0], axis=1)
        for k, trace in zip(range(3, fitted.shape[1], 2), traces, strict=True)
    ], axis=0))  # fmt: skip
