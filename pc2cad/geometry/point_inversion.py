"""Places on curves and surfaces: which parameters points have there.

On curves and surfaces that close, parameters come out between -π and π.
"""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from pc2cad.arrays import Array
from pc2cad.geometry.carriers import (
    AnalyticSurface,
    Arc,
    Cone,
    CurveCarrier,
    Cylinder,
    Extrusion,
    Frame,
    Line,
    Revolution,
    Sphere,
    SplineCurve,
    Torus,
)
from pc2cad.geometry.splines.spline_basis import spline_values

TURN = 2 * np.pi


# -- curves ----------------------------------------------------------------------------------------


def along_curve(carrier: CurveCarrier, points: Array) -> Array:
    """Return the parameters (n,) of points (n, 3) on an arc, or on a conic in rational pieces."""
    if isinstance(carrier, Arc):
        local = (points - carrier.frame.origin) @ carrier.frame.axes[:2].T
        return np.asarray(
            np.arctan2(local[:, 1] / carrier.radii[1], local[:, 0] / carrier.radii[0])
        )
    assert isinstance(carrier, SplineCurve)
    pieces = conic_pieces(carrier)
    # (1-t)² : 2w t(1-t) : t² are the shares of the three poles, weights left out
    first, middle, last = np.stack([conic_shares(piece, points) for piece in pieces], axis=1)
    total = first + middle + last
    # on the conic 2t(1-t) is negative beyond the ends of a piece
    own = np.argmax(middle / total, axis=0)
    places = (np.arange(len(pieces))[:, None] + (last + middle / 2) / total) / len(pieces)
    return np.asarray(np.take_along_axis(places, own[None], axis=0)[0])


def conic_pieces(carrier: SplineCurve) -> list[SplineCurve]:
    """Return the equal pieces of degree 2 of a conic, each over [0, 1]."""
    starts = range(0, len(carrier.poles) - 1, 2)
    weights = np.ones(len(carrier.poles)) if carrier.weights is None else carrier.weights
    knots = np.repeat([0.0, 1.0], 3)
    return [
        SplineCurve(2, knots, carrier.poles[i : i + 3], weights[i : i + 3] / weights[i])
        for i in starts
    ]


def conic_shares(conic: SplineCurve, points: Array) -> Array:
    """Return (1-t)², 2t(1-t) and t² over the denominator, by points in the plane: shape (3, n)."""
    weight = 1.0 if conic.weights is None else float(conic.weights[1])
    legs = np.array([conic.poles[1] - conic.poles[0], conic.poles[2] - conic.poles[0]])
    middle, last = ((points - conic.poles[0]) @ np.linalg.pinv(legs)).T
    return np.stack((1 - middle - last, middle / weight, last))


def curve_points(carrier: CurveCarrier, share: Array) -> Array:
    """Return points (n, 3) at shares (n,) of the range of a curve's parameter."""
    if isinstance(carrier, Line):
        return np.asarray(carrier.start + share[:, None] * (carrier.end - carrier.start))
    if isinstance(carrier, Arc):
        return carrier.points(carrier.start + share * (carrier.end - carrier.start))
    homogeneous = carrier.poles
    if carrier.weights is not None:
        homogeneous = np.column_stack((carrier.poles * carrier.weights[:, None], carrier.weights))
    values = spline_values(carrier.knots, homogeneous, carrier.degree, share)
    return np.asarray(values if carrier.weights is None else values[:, :3] / values[:, 3:])


# -- surfaces --------------------------------------------------------------------------------------


def periods(carrier: AnalyticSurface) -> tuple[bool, bool]:
    """Say along which of its parameters a surface closes after a turn."""
    if isinstance(carrier, Extrusion):
        return isinstance(carrier.basis, Arc), False
    closes = isinstance(carrier, Revolution) and isinstance(carrier.basis, Arc)
    return True, closes or isinstance(carrier, Torus)


def distance_from_axis(carrier: AnalyticSurface, points: Array) -> Array:
    """Return how far points (n, 3) are from where angles have no value: none on an extrusion."""
    if isinstance(carrier, Extrusion):
        return np.full(len(points), np.inf)
    local = (points - carrier.frame.origin) @ carrier.frame.axes[:2].T
    return np.asarray(np.hypot(local[:, 0], local[:, 1]))


@singledispatch
def places(carrier: AnalyticSurface, points: Array) -> Array:
    """Return the parameters (n, 2) of points (n, 3) on a surface."""
    raise TypeError(f"no places are known on a {type(carrier).__name__}")


def _round(frame: Frame, points: Array) -> tuple[Array, Array, Array]:
    """Return angle, radius and height in a frame."""
    x, y, z = ((points - frame.origin) @ frame.axes.T).T
    return np.arctan2(y, x), np.hypot(x, y), z


@places.register
def _(carrier: Cylinder, points: Array) -> Array:
    angle, _, height = _round(carrier.frame, points)
    return np.stack((angle, height), axis=1)


@places.register
def _(carrier: Cone, points: Array) -> Array:
    angle, radius, height = _round(carrier.frame, points)
    slant = (radius - carrier.radius) * np.sin(carrier.angle) + height * np.cos(carrier.angle)
    return np.stack((angle, slant), axis=1)


@places.register
def _(carrier: Sphere, points: Array) -> Array:
    angle, radius, height = _round(carrier.frame, points)
    return np.stack((angle, np.arctan2(height, radius)), axis=1)


@places.register
def _(carrier: Torus, points: Array) -> Array:
    angle, radius, height = _round(carrier.frame, points)
    return np.stack((angle, np.arctan2(height, radius - carrier.major)), axis=1)


@places.register
def _(carrier: Extrusion, points: Array) -> Array:
    basis = carrier.basis
    assert isinstance(basis, Arc | SplineCurve)
    origin = basis.frame.origin if isinstance(basis, Arc) else basis.poles[0]
    height = (points - origin) @ carrier.direction
    section = points - height[:, None] * carrier.direction
    return np.stack((along_curve(carrier.basis, section), height), axis=1)


@places.register
def _(carrier: Revolution, points: Array) -> Array:
    frame = carrier.frame
    angle, radius, height = _round(frame, points)
    meridian = frame.origin + radius[:, None] * frame.axes[0] + height[:, None] * frame.axes[2]
    return np.stack((angle, along_curve(carrier.basis, meridian)), axis=1)
