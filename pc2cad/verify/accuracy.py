"""What the integrals over a face may be off by: bounds of quadrature, gaps and rounding.

Rules of Gauss with enough points integrate polynomials exactly, and waves of low degree over an
eighth of a turn to far less than rounding: what is left of volume and moments is how edges and
surfaces miss each other, to first order, and rounding. Areas have a root, which is a polynomial on
planes, cylinders, cones, spheres and tori only. What is not bounded is infinite.

*Source:* P. J. Davis, P. Rabinowitz, Methods of Numerical Integration (2nd ed.), 4.3 (remainders);
N. J. Higham, Accuracy and Stability of Numerical Algorithms (2nd ed.), 3 and 4.2 (sums in pairs).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.verify.curves import Conic, Curve, Line, Reversed
from pc2cad.verify.edges import Edge
from pc2cad.verify.faces import JudgedFace
from pc2cad.verify.splines import SplineCurve, SplineSurface, knots_in
from pc2cad.verify.surfaces import Pushed, Round, Spun

UNIT: Final = 2.0**-53
#: units of rounding of a term: what evaluation adds to a place or a slope, and a sum in pairs
_TERM: Final = 1024.0
#: moments ∫ n_i x_i² / 2 are no more than this many times the reach, times ∫ |n · x| / 3
_MOMENT: Final = 3.0


@dataclass(frozen=True)
class Slack:
    """Bounds of what volume, area and first moments may be off by; infinite where there is none."""

    volume: float
    area: float
    moment: float


UNKNOWN: Final = Slack(np.inf, np.inf, np.inf)


def slack_of(judged: JudgedFace, origin: Array) -> Slack:
    """Return what the integrals over a face may be off by; volume and moments are about a place."""
    uses = [edge for loop in judged.face.loops for edge, _ in loop.edges]
    if judged.frame is not None:
        return _on_plane(judged, uses, origin)
    if judged.rectangle is None or not np.isfinite(judged.border):
        return UNKNOWN
    found = _rounding(judged, origin)
    if found is None:
        return UNKNOWN
    reach, volume, area = found
    reach = max([reach, *(_reach(edge, origin) for edge in uses)])
    ribbon = 2.0 * judged.border * sum(edge.length for edge in uses)
    volume += reach / 3.0 * ribbon
    return Slack(volume, area + ribbon, _MOMENT * reach * volume)


def _reach(edge: Edge, origin: Array) -> float:
    """Return a distance from a place that no point of an edge exceeds."""
    curve = _plain(edge.curve)
    seen = float(np.linalg.norm(edge.samples - origin, axis=1).max())
    if isinstance(curve, Line):
        return seen
    known = isinstance(curve, Conic) or (isinstance(curve, SplineCurve) and not curve.rational)
    return max(seen, _far(curve, origin, edge.interval)) if known else seen + edge.length


def _on_plane(judged: JudgedFace, uses: Sequence[Edge], origin: Array) -> Slack:
    """Of a plane face: its edges' integrals, in which the coordinates are polynomials or waves."""
    spread = [_spread(edge.curve) for edge in uses]
    if not uses or not np.isfinite([*spread, judged.gap_bound]).all():
        return UNKNOWN
    reach = max(_reach(edge, origin) for edge in uses)
    size = reach + float(np.linalg.norm(origin))
    length = sum(edge.length for edge in uses)
    ribbon = 2.0 * judged.gap_bound * length + 2.0 * reach * sum(edge.gap for edge in uses)
    area = ribbon + UNIT * (_TERM * size * length + 2.0 * reach * size * sum(spread))
    volume = reach / 3.0 * (ribbon + area) + UNIT * _TERM * size * judged.moments.area
    return Slack(volume, area, _MOMENT * reach * volume)


def _plain(curve: Curve) -> Curve:
    return _plain(curve.curve) if isinstance(curve, Reversed) else curve


def _spread(curve: Curve) -> float:
    """Return units of rounding of all steps along a curve, of its coordinates.

    Slopes of splines are differences of poles over spans. Infinite where its integrals are not
    known to be those of polynomials or waves.
    """
    curve = _plain(curve)
    if isinstance(curve, Line | Conic):
        return 64.0
    if isinstance(curve, SplineCurve) and not curve.rational:
        spans = len(knots_in(curve.knots, curve.domain)) - 1
        return 10.0 * (curve.degree + 2) * curve.degree * spans
    return np.inf


def _rounding(judged: JudgedFace, origin: Array) -> tuple[float, float, float] | None:
    """Return a surface's reach, and what rounding adds to volume and area; None if more is open."""
    surface, rectangle = judged.surface, judged.rectangle
    assert rectangle is not None
    if isinstance(surface, SplineSurface):
        return None if surface.rational else _on_spline(surface, origin)
    if isinstance(surface, Round):
        slope = abs(np.tan(surface.lengths[1])) if surface.kind == "CONICAL_SURFACE" else 0.0
        straight = slope or surface.kind == "CYLINDRICAL_SURFACE"
        tall = max(map(abs, rectangle[1])) if straight else 0.0
        wide = sum(surface.lengths[: 1 if slope else 2]) + (1.0 + slope) * tall
        return _of_terms(surface.origin, wide, 0.0, 0.0, origin, sure=True)
    if not isinstance(surface, Pushed | Spun) or not np.isfinite(_spread(surface.curve)):
        return None
    spread, curve = _spread(surface.curve), _plain(surface.curve)
    if isinstance(surface, Spun):
        far = _far(curve, surface.centre, rectangle[1])
        return _of_terms(surface.centre, far, spread, 7.0 * far, origin, sure=False)
    start = surface.curve.at(np.array([rectangle[0][0]]))[0][0]
    high = float(np.linalg.norm(surface.vector)) * max(map(abs, rectangle[1]))
    wide, straight = _far(curve, start, rectangle[0]) + high, isinstance(curve, Line)
    return _of_terms(start, wide, spread, 2.0 * high, origin, sure=straight)


def _far(curve: Curve, middle: Array, ends: tuple[float, float]) -> float:
    """Return a distance from a place that no point of a curve exceeds between parameters."""
    if isinstance(curve, SplineCurve):
        return float(np.linalg.norm(curve.poles - middle, axis=1).max())
    if isinstance(curve, Conic):
        halves = sum(float(np.linalg.norm(half)) for half in (curve.first, curve.second))
        return float(np.linalg.norm(curve.centre - middle)) + halves
    # of a line: it may be read backwards
    points = curve.at(np.array([*ends, *(-end for end in ends)]))[0]
    return float(np.linalg.norm(points - middle, axis=1).max())


def _of_terms(
    middle: Array, wide: float, spread: float, along: float, origin: Array, *, sure: bool
) -> tuple[float, float, float]:
    reach = float(np.linalg.norm(middle - origin)) + wide
    size = reach + float(np.linalg.norm(origin)) + float(np.linalg.norm(middle))
    area = UNIT * (8.0 * _TERM * size * size + spread * size * along)
    return reach, reach * area, area if sure else np.inf


def _on_spline(surface: SplineSurface, origin: Array) -> tuple[float, float, float]:
    """Return reach and rounding: lines of a parameter are no longer than those of the poles."""
    poles, (p, q) = surface.poles, surface.degrees
    reach = float(np.linalg.norm(poles - origin, axis=2).max())
    size = float(np.linalg.norm(poles, axis=2).max())
    long_u, long_v = (
        float(np.linalg.norm(np.diff(poles, axis=axis), axis=2).sum(axis=axis).max())
        for axis in (0, 1)
    )
    spans = [len(knots_in(surface.knots[k], surface.limits[k])) - 1 for k in (0, 1)]
    units = 5.0 * (p + q + 2)
    twist = 2.0 * units * size * (p * spans[0] * long_v + q * spans[1] * long_u)
    terms = (_TERM + units) * (size + reach) * long_u * long_v
    return reach, UNIT * (reach / 3.0 * twist + terms), np.inf
