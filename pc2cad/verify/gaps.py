"""How far edges are from the surfaces of their faces: bounds over all of an edge, not its samples.

Lines, conics and splines are pieces in Bernstein's form with positive weights. What is nought on a
plane, cylinder, cone, sphere or torus is a polynomial over such weights along them, and the
difference from a line of a surface's own parameter is one too: nowhere larger than the largest
quotient of coefficients.

*Source:* G. Farin, Curves and Surfaces for CAGD (5th ed.), 4 (blossoms), 6 (products), 13.
"""

from __future__ import annotations

from collections.abc import Callable
from math import comb
from typing import Final, TypeAlias

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.verify.curves import Conic, Curve, Line, Reversed
from pc2cad.verify.edges import Edge
from pc2cad.verify.inversion import divided
from pc2cad.verify.patches import Trace
from pc2cad.verify.splines import SplineCurve, SplineSurface
from pc2cad.verify.surfaces import Pushed, Round, Spun, Surface

#: place and axes (normal last) of a plane
Frame: TypeAlias = tuple[Array, Array]
#: pieces of a curve between parameters, (pieces, degree + 1, 4): x w, y w, z w, w
Pieces: TypeAlias = Callable[[Array], Array]
#: parts that pieces are cut into until a bound is no more than twice what was seen
_PARTS: Final = (1, 4, 16)
#: units of rounding of the coordinates that a coefficient may be off by
_ROUNDING: Final = 64.0 * 2.0**-53


def gap_bound(carrier: Surface | Frame, edge: Edge, trace: Trace | None, seen: float) -> float:
    """Return a bound of the distance of an edge from a surface; infinite where there is none.

    `trace` is the edge in the surface's parameters, where it runs along one of them; `seen` is the
    largest distance of its samples.
    """
    own = _pieces(edge.curve)
    if own is None:
        return np.inf

    def bound(parts: int) -> float:
        if isinstance(carrier, tuple):
            return _off_plane(own(_cuts(edge, parts)), carrier)
        if isinstance(carrier, Round):
            return _off_round(own(_cuts(edge, parts)), carrier)
        return np.inf if trace is None else _off_line_of(carrier, edge, own, trace, parts)

    return _sharpened(bound, edge, seen)


def line_bound(surface: Surface, edge: Edge, trace: Trace, seen: float) -> float:
    """Return a bound of the distance of an edge from the line of a parameter that it runs along."""
    own = _pieces(edge.curve)
    if own is None:
        return np.inf
    return _sharpened(lambda parts: _off_line_of(surface, edge, own, trace, parts), edge, seen)


def _sharpened(bound: Callable[[int], float], edge: Edge, seen: float) -> float:
    found = np.inf
    slack = _ROUNDING * float(np.abs(edge.samples).max())
    for parts in _PARTS:
        off = bound(parts)
        found = min(found, float(off) + slack if off >= 0.0 else np.inf)
        if not np.isfinite(found) or found <= 2.0 * seen + 4.0 * slack:
            break
    return found


def _cuts(edge: Edge, parts: int) -> Array:
    first, last = edge.interval
    breaks = edge.curve.breaks(min(first, last), max(first, last))
    return divided(breaks if last > first else breaks[::-1], parts)


# -- curves as pieces ------------------------------------------------------------------------------


def _pieces(curve: Curve) -> Pieces | None:
    """Return how a curve is cut into pieces between parameters; None where that is not known."""
    if isinstance(curve, Reversed):
        inner = _pieces(curve.curve)
        return None if inner is None else lambda cuts: inner(-cuts)
    if isinstance(curve, Line):
        return lambda cuts: _joined(curve.at(cuts)[0])
    if isinstance(curve, Conic):
        return lambda cuts: _arcs(curve, cuts)
    if isinstance(curve, SplineCurve):
        return lambda cuts: _spans(curve, cuts)
    return None


def _weighted(points: Array, weights: Array) -> Array:
    return np.concatenate((points * weights[..., None], weights[..., None]), axis=-1)


def _joined(points: Array) -> Array:
    pairs = np.stack((points[:-1], points[1:]), axis=1)
    return _weighted(pairs, np.ones(pairs.shape[:2]))


def _arcs(conic: Conic, cuts: Array) -> Array:
    """Return arcs of less than a half turn as rational pieces of degree 2."""
    middle, half = 0.5 * (cuts[:-1] + cuts[1:]), 0.5 * np.diff(cuts)
    weight = np.cos(half)
    top = conic.centre + (conic.at(middle)[0] - conic.centre) / weight[:, None]
    ends = conic.at(cuts)[0]
    points = np.stack((ends[:-1], top, ends[1:]), axis=1)
    return _weighted(points, np.stack((np.ones_like(weight), weight, np.ones_like(weight)), axis=1))


def _spans(curve: SplineCurve, cuts: Array) -> Array:
    """Return pieces of a spline by its blossom; each is within a span of the knots."""
    p, knots, low = curve.degree, curve.knots, curve.domain[0]
    middle = 0.5 * (cuts[:-1] + cuts[1:])
    turn = 0.0 if curve.period is None else curve.period * np.floor((middle - low) / curve.period)
    a, b = cuts[:-1] - turn, cuts[1:] - turn
    span = np.searchsorted(knots, middle - turn, side="right") - 1
    span = np.clip(span, p, len(curve.poles) - 1)
    poles = curve.poles if curve.rational else _weighted(curve.poles, np.ones(len(curve.poles)))
    near = knots[span[:, None] + np.arange(1 - p, p + 1)]
    ends = np.stack((a, b))[:, :, None]
    # pole j is the blossom of b, j times, and of a: what has been taken of b so far is shared
    found = poles[span[:, None] + np.arange(-p, 1)][None]
    for r in range(1, p + 1):
        left, right = near[:, r - 1 : p], near[:, p : 2 * p + 1 - r]
        at_a, at_b = ((ends - left) / (right - left))[..., None]
        first = (1.0 - at_a) * found[:, :, :-1] + at_a * found[:, :, 1:]
        last = (1.0 - at_b) * found[-1:, :, :-1] + at_b * found[-1:, :, 1:]
        found = np.concatenate((first, last))
    return np.asarray(found[:, :, 0].transpose(1, 0, 2))


# -- what is nought on a surface -------------------------------------------------------------------


def _times(one: Array, other: Array) -> Array:
    """Return products of polynomials in Bernstein's form, (pieces, degree + 1) each."""
    d, e = one.shape[1] - 1, other.shape[1] - 1
    found = np.zeros((len(one), d + e + 1))
    scaled = other * np.array([comb(e, k) for k in range(e + 1)], dtype=float)
    for k in range(d + 1):
        found[:, k : k + e + 1] += comb(d, k) * one[:, k : k + 1] * scaled
    return np.asarray(found / np.array([comb(d + e, k) for k in range(d + e + 1)], dtype=float))


def _local(pieces: Array, origin: Array, axes: Array) -> tuple[Array, Array, Array, Array]:
    weight = pieces[..., 3]
    places = (pieces[..., :3] - weight[..., None] * origin) @ axes.T
    return places[..., 0], places[..., 1], places[..., 2], weight


def _most(values: Array, weights: Array) -> Array:
    """Return bounds of the quotient of each piece."""
    return np.asarray(np.abs(values / weights).max(axis=1))


def _off_plane(pieces: Array, frame: Frame) -> float:
    _, _, z, w = _local(pieces, *frame)
    return float(_most(z, w).max())


def _off_round(pieces: Array, surface: Round) -> float:
    x, y, z, w = _local(pieces, surface.origin, surface.axes)
    first, *more = surface.lengths
    across, weights = _times(x, x) + _times(y, y), _times(w, w)
    if surface.kind == "CYLINDRICAL_SURFACE":
        return float(_most(across - first**2 * weights, weights).max() / first)
    if surface.kind == "SPHERICAL_SURFACE":
        return float(_most(across + _times(z, z) - first**2 * weights, weights).max() / first)
    if surface.kind == "CONICAL_SURFACE":
        radius = first * w + np.tan(more[0]) * z
        # of the cone that is so much wider that no piece of an edge reaches beyond its apex
        wider = np.maximum(0.0, -2.0 * (radius / w).min(axis=1))
        radius = radius + wider[:, None] * w
        # |ρ - k| (ρ + k) is known, and k is no more than the second factor
        off = across - _times(radius, radius)
        return float((_most(off, _times(radius, w)) + wider).max())
    minor = more[0]
    sums = across + _times(z, z) + (first**2 - minor**2) * weights
    off = _most(
        _times(sums, sums) - 4.0 * first**2 * _times(across, weights), _times(weights, weights)
    )
    # (d² - r²) (d'² - r²) with the distances d and d' from the near and the far middle of the tube
    far = float(off.max() / ((first**2 - minor**2) * minor))
    if far > 0.1 * min(minor, first - minor):
        return far
    square = 4.0 * first * (first - minor - far) - 2.0 * minor * far
    return float(off.max() / ((2.0 * minor - far) * square))


# -- lines of a surface's own parameters -----------------------------------------------------------


def _line_of(surface: Surface, trace: Trace) -> tuple[Pieces, Curve] | None:
    """Return the line of one parameter of a surface that an edge runs along, and its curve."""
    curve: Curve | None = None
    if isinstance(surface, SplineSurface):
        curve = surface.side(1 - trace.axis, _turned(surface, trace))
    elif isinstance(surface, Pushed):
        if trace.axis == 1:
            start = surface.curve.at(np.array([trace.level]))[0][0]
            curve = Line(start, surface.vector)
        else:
            return _moved(surface.curve, np.eye(3), trace.level * surface.vector)
    elif isinstance(surface, Spun):
        if trace.axis == 0:
            point = surface.curve.at(np.array([trace.level]))[0][0] - surface.centre
            height = (point @ surface.axis) * surface.axis
            out = point - height
            curve = Conic(surface.centre + height, out, np.cross(surface.axis, out))
        else:
            turn = surface.turn(trace.level)
            return _moved(surface.curve, turn, surface.centre - turn @ surface.centre)
    elif isinstance(surface, Round):
        curve = _round_line(surface, trace)
    own = None if curve is None else _pieces(curve)
    return None if own is None or curve is None else (own, curve)


def _round_line(surface: Round, trace: Trace) -> Curve:
    """Return a circle round the axis, or the meridian at an angle."""
    x, y, z = surface.axes
    if trace.axis == 0:
        radius, height, *_ = (float(part[0]) for part in surface.profile(np.array([trace.level])))
        return Conic(surface.origin + height * z, radius * x, radius * y)
    out = np.cos(trace.level) * x + np.sin(trace.level) * y
    first, *more = surface.lengths
    if surface.kind == "SPHERICAL_SURFACE":
        return Conic(surface.origin, first * out, first * z)
    if surface.kind == "TOROIDAL_SURFACE":
        return Conic(surface.origin + first * out, more[0] * out, more[0] * z)
    slope = np.tan(more[0]) if more else 0.0
    return Line(surface.origin + first * out, slope * out + z)


def _turned(surface: SplineSurface, trace: Trace) -> float:
    other = 1 - trace.axis
    (low, high), period = surface.limits[other], surface.periods[other]
    level = trace.level
    if period is not None and not low <= level <= high:
        level = low + (level - low) % period
    return float(np.clip(level, low, high))


def _moved(curve: Curve, turn: Array, by: Array) -> tuple[Pieces, Curve] | None:
    inner = _pieces(curve)
    if inner is None:
        return None

    def pieces(cuts: Array) -> Array:
        found = inner(cuts)
        return np.concatenate(
            (found[..., :3] @ turn.T + found[..., 3:] * by, found[..., 3:]), axis=-1
        )

    return pieces, curve


def _off_line_of(surface: Surface, edge: Edge, own: Pieces, trace: Trace, parts: int) -> float:
    """Return how far an edge is from the line of a parameter, at equal shares or nearest."""
    line = _line_of(surface, trace)
    if line is None:
        return np.inf
    pieces, curve = line
    first, last = edge.interval
    begin, end = trace.start, trace.start + trace.length
    if not trace.rising:
        begin, end = end, begin
    shares = np.concatenate((
        (_cuts(edge, 1) - first) / (last - first),
        (curve.breaks(min(begin, end), max(begin, end)) - begin) / (end - begin),
    ))  # fmt: skip
    shares = distinct(np.clip(shares, 0.0, 1.0))
    shares = np.append(shares[:-1][np.diff(shares) > 1e-13], 1.0)
    shares = divided(shares, parts)
    other = pieces(begin + (end - begin) * shares)
    apart = _apart(own(first + (last - first) * shares), other)
    ends = np.array([other[0, 0, :3] / other[0, 0, 3], other[-1, -1, :3] / other[-1, -1, 3]])
    # who goes along a line from end to end comes by all of its places
    off = float(np.linalg.norm(ends - edge.samples[[0, -1]], axis=1).max())
    return min(apart, max(off, _off_curve(other, edge.curve)))


def _apart(one: Array, other: Array) -> float:
    """Return a bound of the distance at equal parameters."""
    weights, own = one[..., 3], other[..., 3]
    if np.ptp(weights) == 0.0 and np.ptp(own) == 0.0:
        more = other.shape[1] - one.shape[1]
        longer = [np.ones((len(one), 1 + max(0, k))) for k in (more, -more)]
        gaps = [
            _times(one[..., k], longer[0]) / weights.max()
            - _times(other[..., k], longer[1]) / own.max()
            for k in range(3)
        ]
        return float(np.linalg.norm(gaps, axis=0).max())
    gaps = [_times(one[..., k], own) - _times(other[..., k], weights) for k in range(3)]
    return float((np.linalg.norm(gaps, axis=0) / _times(weights, own)).max())


def _off_curve(pieces: Array, curve: Curve) -> float:
    """Return how far pieces are from a line or a circle that they run along."""
    curve = curve.curve if isinstance(curve, Reversed) else curve
    if isinstance(curve, Line):
        z = curve.vector / np.linalg.norm(curve.vector)
        points = pieces[..., :3] / pieces[..., 3:] - curve.origin
        return float(np.linalg.norm(points - (points @ z)[..., None] * z, axis=-1).max())
    if not isinstance(curve, Conic):
        return np.inf
    radii = [float(np.linalg.norm(half)) for half in (curve.first, curve.second)]
    if abs(radii[0] - radii[1]) > 1e-14 * radii[0]:
        return np.inf
    x, y = curve.first / radii[0], curve.second / radii[1]
    a, b, c, w = _local(pieces, curve.centre, np.array([x, y, np.cross(x, y)]))
    weights = _times(w, w)
    off = _most(_times(a, a) + _times(b, b) - radii[0] ** 2 * weights, weights) / radii[0]
    return float(np.hypot(off, _most(c, w)).max())
