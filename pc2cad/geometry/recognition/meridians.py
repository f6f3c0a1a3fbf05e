"""Meridians that are arcs of circles or ellipses which meet the axis, as rational splines.

Readers of STEP files take all of an oval for a face's meridian, also where it crosses the axis; a
spline is an arc of it only. They find an edge along such a meridian by its points: right only
where both run through their points alike, so the edge is a piece of the same spline.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pc2cad.arrays import Array
from pc2cad.geometry.carriers import AnalyticSurface, Arc, Frame, Revolution, SplineCurve
from pc2cad.geometry.point_inversion import TURN, conic_pieces, distance_from_axis, places

#: points of an arc at which it is asked whether it is a meridian, and what their angles may differ
#: by; ends of meridians that are as near to the axis, in shares of the size, are on it
PLACES, SAME = 9, 1e-12
#: share of its size by which an oval has to stay off the axis not to meet it
FREE_OF_AXIS = 1e-9


def meets_axis(carrier: Revolution) -> bool:
    """Say whether a meridian is part of a circle or an ellipse that touches or crosses the axis."""
    if not isinstance(carrier.basis, Arc):
        return False
    oval = carrier.basis
    away = oval.frame.origin - _on_axis(carrier.frame, oval.frame.origin)
    # how far it reaches from its centre across the axis, in its own plane
    across = np.cross(oval.frame.axes[2], carrier.frame.axes[2])
    reach = np.hypot(*(oval.frame.axes[:2] @ across * oval.radii))
    return bool(np.linalg.norm(away) <= reach * (1 + FREE_OF_AXIS))


def rational_meridian(carrier: Revolution, low: float, high: float, size: float) -> Revolution:
    """Return the surface over its oval from one angle to another as a rational spline."""
    assert isinstance(carrier.basis, Arc)
    spline = rational_arc(replace(carrier.basis, start=low, end=high))
    poles = spline.poles.copy()
    for end in (0, -1):
        foot = _on_axis(carrier.frame, poles[end])
        if np.linalg.norm(poles[end] - foot) <= SAME * size:
            poles[end] = foot
    return replace(carrier, basis=replace(spline, poles=poles))


def _on_axis(frame: Frame, point: Array) -> Array:
    return np.asarray(frame.origin + ((point - frame.origin) @ frame.axes[2]) * frame.axes[2])


def rational_arc(arc: Arc) -> SplineCurve:
    """Return an arc in equal rational pieces of a quarter turn at most, weights 1 at their ends."""
    pieces = max(1, int(np.ceil((arc.end - arc.start) / (TURN / 4) - 1e-9)))
    angles = np.linspace(arc.start, arc.end, 2 * pieces + 1)
    weights = np.ones(2 * pieces + 1)
    weights[1::2] = np.cos((arc.end - arc.start) / pieces / 2)
    # between its ends a piece is drawn by the place where their tangents meet
    poles = arc.frame.origin + (arc.points(angles) - arc.frame.origin) / weights[:, None]
    knots = np.repeat(np.arange(pieces + 1) / pieces, 2)
    return SplineCurve(2, np.concatenate(([0.0], knots, [1.0])), poles, weights)


def along_meridian(carrier: AnalyticSurface, arc: Arc) -> SplineCurve | None:
    """Return an arc as a piece of the spline whose turning makes a surface.

    None where the surface is of another kind, or the arc no meridian of it.
    """
    if not isinstance(carrier, Revolution) or not isinstance(carrier.basis, SplineCurve):
        return None
    points = arc.points(np.linspace(arc.start, arc.end, PLACES))
    size = float(np.abs(carrier.basis.poles - carrier.frame.origin).max())
    away = distance_from_axis(carrier, points) > 1e-9 * size
    table = places(carrier, points)
    angles = np.unwrap(table[away, 0])
    turned = carrier.frame.round(angles[:1])[0]
    frame = Frame(carrier.frame.origin,
                  np.array([turned, np.cross(carrier.frame.axes[2], turned),
                            carrier.frame.axes[2]]))  # fmt: skip
    local = (carrier.basis.poles - carrier.frame.origin) @ carrier.frame.axes.T
    basis = replace(carrier.basis, poles=frame.origin + local @ frame.axes)
    found = _restricted(basis, float(table[0, 1]), float(table[-1, 1]))
    if np.ptp(angles) > SAME or not _is_same(found, arc, size):
        return None
    return found


def _is_same(spline: SplineCurve, arc: Arc, size: float) -> bool:
    """Say whether a spline runs through an arc: its pieces' ends lie there, in this order."""
    local = (spline.poles[::2] - arc.frame.origin) @ arc.frame.axes.T
    shares = local[:, :2] / arc.radii
    off = np.abs(np.hypot(*shares.T) - 1) * arc.radii[0]
    angles = np.unwrap(np.arctan2(shares[:, 1], shares[:, 0]))
    run = abs((angles[-1] - angles[0]) - (arc.end - arc.start))
    return bool(max(off.max(), np.abs(local[:, 2]).max()) <= 1e-11 * size and run <= 1e-9)


def _restricted(curve: SplineCurve, start: float, end: float) -> SplineCurve:
    """Return a conic in rational pieces from one of its parameters to another, over [0, 1]."""
    pieces = conic_pieces(curve)
    low, high = (round(x * len(pieces), 12) for x in sorted((start, end)))
    first = int(np.clip(np.floor(low), 0, len(pieces) - 1))
    last = int(np.clip(np.ceil(high) - 1, first, len(pieces) - 1))
    rows = []
    for k in range(first, last + 1):
        rows.append(_blossom(pieces[k], max(low - k, 0.0), min(high - k, 1.0))[k > first :])
    homogeneous = np.concatenate(rows)
    inner = (np.arange(first + 1, last + 1) - low) / (high - low)
    knots = np.concatenate(([0.0] * 3, np.repeat(inner, 2), [1.0] * 3))
    if start > end:
        homogeneous, knots = homogeneous[::-1], 1 - knots[::-1]
    weights = homogeneous[:, 3]
    return SplineCurve(2, knots, homogeneous[:, :3] / weights[:, None], weights)


def _blossom(piece: SplineCurve, low: float, high: float) -> Array:
    """Return the homogeneous poles (3, 4) of a part of one rational piece."""
    assert piece.weights is not None
    a, b, c = np.column_stack((piece.poles * piece.weights[:, None], piece.weights))
    return np.array([
        (1 - x) * (1 - y) * a + ((1 - x) * y + x * (1 - y)) * b + x * y * c
        for x, y in ((low, low), (low, high), (high, high))
    ])  # fmt: skip
