"""Carriers as polynomial equations in x, y and z, to be put upon a point equation.

With them it can be proved that a face or an edge lies on its carrier, whatever its parameters are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.magnitudes import largest_seen
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.rounded_identity import is_zero_to_rounding
from pc2cad.expression.tree import ZERO, Expr, call, number, symbol
from pc2cad.geometry.carriers import (
    AnalyticSurface,
    Arc,
    Cone,
    CurveCarrier,
    Cylinder,
    Extrusion,
    Frame,
    Line,
    Plane,
    Revolution,
    Sphere,
    SplineCurve,
    Torus,
    frame_on,
)
from pc2cad.geometry.point_inversion import conic_pieces, conic_shares

Point = Sequence[Expr]
#: a polynomial that is zero on the carrier, and one of the same size that is not
Equation = tuple[Expr, Expr]

#: what is worth less than this share of the whole is nothing
ROUNDING = 1e-12


def holds(carrier: Plane | AnalyticSurface | CurveCarrier, point: Point) -> bool:
    """Say whether a point is proved to lie on a surface, a line or a conic, to rounding."""
    return all(is_zero_to_rounding(*equation) for equation in _equations(carrier, point))


def point_along(start: Array, terms: Mapping[str, Array], ends: tuple[float, float]) -> Point:
    """Return a place plus vectors times functions of a parameter t, as trees: a line or a conic.

    The functions are t, t**2, cos, sin, cosh and sinh. `ends` are those of t, which the trees run
    through as their symbol runs from 0 to 1: what may be left of an equation is asked between them.
    """
    low, high = (number(end) for end in ends)
    t = low + (high - low) * symbol(PARAMETERS[0])
    point = [number(float(c)) for c in start]
    for name, along in terms.items():
        factor = {"t": t, "t**2": t**2}.get(name) or call(name, t)
        point = [c + x * factor for c, x in zip(point, _numbers(along), strict=True)]
    return point


def _equations(carrier: Plane | AnalyticSurface | CurveCarrier, point: Point) -> list[Equation]:
    if isinstance(carrier, Line):
        x, y, z = _local(_frame_along(carrier.start, carrier.end - carrier.start), point)
        return [(x, z), (y, z)]
    if isinstance(carrier, Plane):
        x, y, z = _local(_frame_along(carrier.origin, carrier.normal), point)
        return [(z, x + y)]
    if isinstance(carrier, Arc | SplineCurve):
        plane = _plane_of(carrier)
        x, y, z = _local(plane, point)
        return [(z, x + y), _conic(_form(carrier, plane), x, y)]
    if isinstance(carrier, Extrusion):
        assert isinstance(carrier.basis, Arc | SplineCurve)
        plane = _plane_of(carrier.basis)
        x, y, _ = _local(plane, point)
        return [_conic(_form(carrier.basis, plane), x, y)]
    x, y, z = _local(carrier.frame, point)
    square = x * x + y * y
    if isinstance(carrier, Cylinder):
        return [(square - number(carrier.radius) ** 2, square)]
    if isinstance(carrier, Sphere):
        return [(square + z * z - number(carrier.radius) ** 2, square + z * z)]
    return [_turned(_meridian(carrier), square, z)]


def _frame_along(origin: Array, z: Array) -> Frame:
    return frame_on(origin, z, np.eye(3)[np.argmin(np.abs(z))])


def _meridian(carrier: Cone | Torus | Revolution) -> Array:
    """Return the conic of radius and height: factors of r², r h, h², r, h, 1."""
    if isinstance(carrier, Cone):
        c, s = np.cos(carrier.angle), np.sin(carrier.angle)
        # (r c)² = (R c + h s)²
        k = carrier.radius * c
        return np.array([c * c, 0.0, -s * s, 0.0, -2 * k * s, -k * k])
    if isinstance(carrier, Torus):
        major, minor = carrier.major, carrier.minor
        return np.array([1.0, 0.0, 1.0, -2 * major, 0.0, major**2 - minor**2])
    frame = carrier.frame
    assert isinstance(carrier.basis, Arc | SplineCurve)
    half_plane = Frame(frame.origin, np.array([frame.axes[0], frame.axes[2], -frame.axes[1]]))
    return _form(carrier.basis, half_plane)


def _turned(form: Array, square: Expr, height: Expr) -> Equation:
    """Return the equation of a conic with x² = `square`: squared where x itself occurs.

    Odd terms that are worth nothing are left out.
    """
    a, b, c, d, e, f = _numbers(form)
    even = a * square + c * height**2 + e * height + f
    r, h, *_ = _numbers(np.abs(form[[0, 2]]))
    measure = r * square + h * height**2 + e * height
    reach = sqrt(largest_seen(square) + largest_seen(height) ** 2)
    odd = (abs(form[1]) * reach + abs(form[3])) * reach
    if odd <= ROUNDING * largest_seen(measure):
        return even, measure
    # of the two factors one is zero: the other is twice the odd terms
    other = call("sqrt", square) * (b * height + d)
    return even**2 - square * (b * height + d) ** 2, measure * other


def _conic(form: Array, x: Expr, y: Expr) -> Equation:
    a, b, c, d, e, f = _numbers(form)
    p, q = _numbers(np.abs(form[[0, 2]]))
    return a * x**2 + b * x * y + c * y**2 + d * x + e * y + f, p * x**2 + q * y**2


def _numbers(values: Array) -> list[Expr]:
    """Return exact numbers; what is nothing beside the largest is zero."""
    least = ROUNDING**2 * float(np.abs(values).max())
    return [number(x if abs(x) > least else 0.0) for x in values.tolist()]


def _plane_of(conic: Arc | SplineCurve) -> Frame:
    """Return a frame whose x and y span the plane of a conic."""
    if isinstance(conic, Arc):
        return conic.frame
    first, apex, last = conic.poles[:3]
    x = (last - first) / np.linalg.norm(last - first)
    z = np.cross(x, apex - first)
    z = z / np.linalg.norm(z)
    return Frame(first, np.array([x, np.cross(z, x), z]))


def _form(conic: Arc | SplineCurve, plane: Frame) -> Array:
    """Return the factors of x², xy, y², x, y, 1 of a conic in its plane."""
    size = conic.radii[0] if isinstance(conic, Arc) else float(np.ptp(conic.poles, axis=0).max())
    corners = plane.origin + size * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) @ plane.axes[:2]

    def affine(values: Array) -> Array:
        slopes = (values[1:] - values[0]) / size
        return np.array([*slopes, values[0]])

    if isinstance(conic, Arc):
        local = (corners - conic.frame.origin) @ conic.frame.axes[:2].T / conic.radii
        u, v = (affine(values) for values in local.T)
        form = _product(u, u) + _product(v, v)
        form[5] -= 1.0
        return form
    piece = conic_pieces(conic)[0]
    first, middle, last = (affine(values) for values in conic_shares(piece, corners))
    return _product(middle, middle) - 4 * _product(first, last)


def _product(u: Array, v: Array) -> Array:
    table = np.outer(u, v)
    table = table + table.T
    return np.array([table[0, 0] / 2, table[0, 1], table[1, 1] / 2, table[0, 2], table[1, 2],
                     table[2, 2] / 2])  # fmt: skip


def _local(frame: Frame, point: Point) -> tuple[Expr, Expr, Expr]:
    """Return the coordinates of a point in a frame."""
    away = [c - number(float(o)) for c, o in zip(point, frame.origin, strict=True)]
    rows = []
    for axis in frame.axes:
        row: Expr = ZERO
        for share, coordinate in zip(_numbers(axis), away, strict=True):
            row = row + share * coordinate
        rows.append(row)
    return rows[0], rows[1], rows[2]
