"""A face on the surface that carries its points, whatever its own parameters are.

The surface is found from points and normals; angles over the face are made continuous on a grid, so
that every side of the face, along any curve, gets its own continuous parameters on the surface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import product

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import ranked
from pc2cad.arrays.scatter import scattered
from pc2cad.geometry.carriers import (
    AnalyticSurface,
    Arc,
    Cone,
    CurveCarrier,
    Cylinder,
    Extrusion,
    Frame,
    Line,
    PCurve,
    Revolution,
    Segment,
    Sphere,
    SplineCurve,
    SplinePath,
    Torus,
    frame_on,
)
from pc2cad.geometry.parameter_path import ROUNDING, path
from pc2cad.geometry.point_inversion import TURN, along_curve, distance_from_axis, periods, places
from pc2cad.geometry.recognition.conics import Branch, Oval, conic_through
from pc2cad.geometry.recognition.kinematic import free_motions, sweep_through, tidy
from pc2cad.geometry.recognition.meridians import meets_axis, rational_meridian

#: points (len(s), len(t), 3) of a face over local parameters
Sampler = Callable[[Array, Array], Array]
#: points (n, 3) along a curve over [0, 1]
Curve = Callable[[Array], Array]

#: nodes of the grid along an axis; an odd number
NODES = 33
#: points nearer to the axis than this share of the size are on it
ON_AXIS = 1e-9
#: parameters and angles that differ by less are one
SAME = 1e-12
#: angles of two neighbours on the grid do not differ by more
LONGEST_STEP = 2.0
#: places beside the end of a curve, and weights of their steps from there that give its tangent
_STEPS: Array = np.asarray(0.004 * np.arange(1, 8))
_ONE_SIDED = np.linalg.solve(_STEPS[None, :] ** np.arange(1, 8)[:, None], np.eye(7)[0])
#: directions that a sphere's axis may have: along coordinates, or where no such axis will do
_AXES = np.array([
    *np.eye(3), *(np.array(v) / np.linalg.norm(v) for v in product((-1, 0, 1), repeat=3) if any(v))
])  # fmt: skip


@dataclass(frozen=True, eq=False)
class Fitted:
    """A face on an analytic surface, found from its points."""

    carrier: AnalyticSurface
    size: float
    #: parameters of the surface on a grid of the face: (NODES, NODES, 2), angles without jumps
    grid: Array

    def follows(self, axis: int) -> bool:
        """Say whether the surface's parameter along an axis is that of a spline: never."""
        return False

    @property
    def turned(self) -> bool:
        """True where (s, t) to the surface's parameters reverses the orientation."""
        along_s, along_t = (np.asarray(np.gradient(self.grid, axis=k)) for k in (0, 1))
        turn = along_s[..., 0] * along_t[..., 1] - along_s[..., 1] * along_t[..., 0]
        return bool(ranked(turn, 0.5) < 0)

    def border(self, side: int) -> Array:
        """Return the grid's parameters (NODES, 2) along a side, in the direction of its axis."""
        grid = self.grid
        return (grid[:, 0], grid[-1], grid[:, -1], grid[0])[side]

    def is_pole(self, point: Array) -> bool:
        """Say whether angles have no value at a point."""
        return bool(distance_from_axis(self.carrier, point[None])[0] <= ON_AXIS * self.size)

    def side(self, side: int, curve: Curve, upwards: bool, breaks: Array | None = None) -> PCurve:
        """Return a curve that runs along a side, in the direction of its axis if `upwards`."""
        near = self.border(side) if upwards else self.border(side)[::-1]
        x = np.linspace(0.0, 1.0, 2 * NODES - 1)
        points = curve(x)
        table = places(self.carrier, points)
        known = np.flatnonzero(distance_from_axis(self.carrier, points) > ON_AXIS * self.size)
        # one place tells which turn it is: an end, or where both are poles the middle
        here = next(i for i in (0, len(x) - 1, NODES - 1) if i in known)
        for k, closes in enumerate(periods(self.carrier)):
            if closes:
                column = np.unwrap(table[known, k])
                shift = near[here // 2, k] - column[np.searchsorted(known, here)]
                table[:, k] = np.interp(x, x[known], column + TURN * np.round(shift / TURN))
        ends = self._beyond_poles(curve)
        # angles count in full but on the way to a pole
        poles = any(self.is_pole(point) for point in curve(np.array([0.0, 1.0])))
        found = path(
            lambda y: self._continued(curve(y), y, x, table, ends),
            np.array([0.0, 1.0]) if breaks is None else breaks, self._scale(points),
            (lambda y: self._weights(curve(y))) if poles else None,
        )  # fmt: skip
        return self._tidied(found)

    def _weights(self, points: Array) -> Array:
        """Return what a step of the surface's parameters is worth: of angles, less near a pole."""
        away = np.minimum(1.0, distance_from_axis(self.carrier, points) / self.size)
        return np.stack([away, np.ones(len(points))], axis=-1)

    def _beyond_poles(self, curve: Curve) -> Array:
        """Return points (2, 3) that stand for the ends of a curve where these are poles.

        A curve comes to a pole at the angle of its tangent there; elsewhere they are its own ends.
        """
        ends = curve(np.array([0.0, 1.0]))
        for k, at in enumerate((_STEPS, 1.0 - _STEPS)):
            if self.is_pole(ends[k]):
                along = np.asarray(_ONE_SIDED @ (curve(np.asarray(at)) - ends[k]))
                length = float(np.linalg.norm(along))
                beside = ends[k] + along * (self.size / length) if length else ends[k]
                ends[k] = beside
        return ends

    def _continued(self, points: Array, y: Array, x: Array, table: Array, ends: Array) -> Array:
        """Return the parameters of points of a curve, on the turn of its table."""
        raw = places(self.carrier, points)
        on_axis = distance_from_axis(self.carrier, points) <= ON_AXIS * self.size
        for k, place in enumerate((0.0, 1.0)):
            here = on_axis & (np.abs(y - place) <= _STEPS[0])
            if here.any() and not self.is_pole(ends[k]):
                raw[here, 0] = places(self.carrier, ends[k : k + 1])[0, 0]
                on_axis &= ~here
        for k, closes in enumerate(periods(self.carrier)):
            if closes:
                near = np.interp(y, x, table[:, k])
                raw[:, k] += TURN * np.round((near - raw[:, k]) / TURN)
                if k == 0:
                    raw[on_axis, 0] = near[on_axis]
        return raw

    def _scale(self, points: Array) -> Array:
        """Return the sizes of the parameters to which rounding is compared."""
        noise = 16 * np.finfo(float).eps * float(np.abs(points).max()) / ROUNDING
        extent = np.abs(self.grid).max(axis=(0, 1))
        angles = np.array(self._angles)
        return np.asarray(np.maximum(extent, np.where(angles, noise / self.size, noise)))

    @property
    def _angles(self) -> tuple[bool, bool]:
        """Say which parameters are angles."""
        first, second = periods(self.carrier)
        return first, second or isinstance(self.carrier, Sphere)

    def _tidied(self, curve: PCurve) -> PCurve:
        if isinstance(curve, SplinePath):
            return curve
        ends = np.array([curve.start, curve.end])
        for k, extent in enumerate(np.abs(self.grid).max(axis=(0, 1)).tolist()):
            if abs(ends[1, k] - ends[0, k]) <= SAME * extent:
                ends[:, k] = ends[0, k]
            if self._angles[k]:
                right = np.round(ends[:, k] * 4 / TURN) * (TURN / 4)
                ends[:, k] = np.where(np.abs(ends[:, k] - right) <= SAME, right, ends[:, k])
        if isinstance(self.carrier, Revolution) and isinstance(self.carrier.basis, SplineCurve):
            # a spline's parameter begins at 0 and ends at 1
            whole = np.round(ends[:, 1])
            ends[:, 1] = np.where(np.abs(ends[:, 1] - whole) <= SAME, whole, ends[:, 1])
        (a, b), (c, d) = ends.tolist()
        return Segment((a, b), (c, d))


def fit_curve(curve: Curve, slack: float) -> CurveCarrier | None:
    """Return the line or conic that holds a curve within a distance, run through as it is, or None.

    None also where it turns back.
    """
    points = curve(np.linspace(0.0, 1.0, NODES))
    centre = points.mean(axis=0)
    axes = np.linalg.svd(points - centre, full_matrices=False)[2]
    away = np.abs((points - centre) @ axes.T).max(axis=0)
    if away[2] > slack:
        return None
    if away[1] <= slack:
        forwards = np.diff(points @ axes[0])
        return Line(points[0], points[-1]) if abs(np.sign(forwards).sum()) == NODES - 1 else None
    plane = Frame(centre, np.array([axes[0], axes[1], np.cross(axes[0], axes[1])]))
    conic = conic_through((points - centre) @ plane.axes[:2].T, slack)
    if isinstance(conic, Oval):
        return _arc_of(conic.arc(plane), points, float(away.max()))
    if not isinstance(conic, Branch):
        return None
    found = conic.curve(plane)
    t = np.diff(along_curve(found, points))
    if abs(np.sign(t).sum()) < NODES - 1:
        return None
    return found if t[0] > 0 else replace(found, poles=found.poles[::-1])


def _arc_of(whole: Arc, points: Array, size: float) -> Arc | None:
    """Return the arc that points run through, upwards; None where they turn back."""
    angles = np.unwrap(along_curve(whole, points))
    sense = np.sign(angles[-1] - angles[0])
    if abs(np.sign(np.diff(angles)).sum()) < NODES - 1:
        return None
    x, y, _ = whole.frame.axes
    major, minor = (float(tidy(np.asarray(radius), size)) for radius in whole.radii)
    start, end = sense * angles[[0, -1]]
    if major == minor:
        # a circle has no axes of its own: it begins at its first point
        start, end, x = 0.0, end - start, points[0] - whole.frame.origin
    y = sense * y
    frame = frame_on(tidy(whole.frame.origin, size), np.cross(whole.frame.axes[0], y), x)
    if abs(end - start - TURN) < SAME:
        end = start + TURN
    turns = TURN * np.floor((start + SAME) / TURN)
    return Arc(frame, (major, minor), float(start - turns), float(end - turns))


@lru_cache(maxsize=8)
def irrational(count: int) -> Array:
    """Return ascending places in (0, 1), evenly spread and at the zeros of no wave."""
    places = np.sort(scattered(count, 1, 0.0).ravel())
    places.flags.writeable = False
    return places


def fit(sample: Sampler, normals: Sampler, slack: float) -> Fitted | None:
    """Return a face on the surface that carries its points within a distance, or None."""
    inner = irrational(9)
    points, directions = sample(inner, inner).reshape(-1, 3), normals(inner, inner).reshape(-1, 3)
    lengths = np.linalg.norm(directions, axis=1)
    if not lengths.min() > 1e-9 * lengths.max():
        return None
    motions = free_motions(points, directions / lengths[:, None])
    if motions is None:
        return None
    nodes = np.linspace(0.0, 1.0, NODES)
    grid_of = cache(lambda: sample(nodes, nodes))
    found = sweep_through(points, motions, lambda: _around(grid_of()), slack)
    if found is None:
        return None
    grid = grid_of()
    carrier = _with_axis(found, grid) if isinstance(found, Sphere) else found.carrier()
    if carrier is None:
        return None
    size = float(np.linalg.norm(np.ptp(grid, axis=(0, 1))))
    return _placed(carrier, grid, size)


def _around(grid: Array) -> Array:
    """Return the points all round a grid."""
    return np.concatenate((grid[:, 0], grid[-1], grid[:, -1], grid[0]))


def _placed(carrier: AnalyticSurface, grid: Array, size: float) -> Fitted | None:
    """Return the face with its surface turned and moved so that the face begins at zero."""
    unrolled = _unrolled(carrier, grid, size)
    if unrolled is None:
        return None
    low, high = unrolled.min(axis=(0, 1)), unrolled.max(axis=(0, 1))
    start = np.zeros(2)
    if not isinstance(carrier, Extrusion):
        corners = unrolled[[0, 0, -1, -1], [0, -1, 0, -1], 0]
        begins = corners.min() <= low[0] + SAME or high[0] - low[0] >= TURN - SAME
        start[0] = low[0] if begins else (low[0] + high[0]) / 2 - np.pi
        carrier = _turned(carrier, float(start[0]))
    if isinstance(carrier, Cylinder | Cone):
        # lengths are counted from the lower end, on a cone from the wider one
        start[1] = low[1] if isinstance(carrier, Cylinder) else high[1]
        carrier = _moved(carrier, float(start[1]))
    unrolled = unrolled - start
    for k, closes in enumerate(periods(carrier)):
        if closes:
            unrolled[..., k] -= TURN * np.floor((unrolled[..., k].min() + SAME) / TURN)
    if isinstance(carrier, Revolution) and meets_axis(carrier):
        assert isinstance(carrier.basis, Arc)
        low, high = unrolled[..., 1].min(), unrolled[..., 1].max()
        points = carrier.basis.points(unrolled[..., 1].ravel())
        carrier = rational_meridian(carrier, float(low), float(high), size)
        unrolled[..., 1] = along_curve(carrier.basis, points).reshape(unrolled.shape[:2])
    return Fitted(_tidied(carrier, size), size, unrolled)


def _unrolled(carrier: AnalyticSurface, grid: Array, size: float) -> Array | None:
    """Return the surface's parameters on the grid, angles made continuous; None where they jump."""
    flat = grid.reshape(-1, 3)
    raw = places(carrier, flat).reshape(*grid.shape[:2], 2)
    poles = (distance_from_axis(carrier, flat) <= ON_AXIS * size).reshape(grid.shape[:2])
    rows, columns = np.nonzero(poles)
    inner = NODES - 2
    raw[rows, columns, 0] = raw[np.clip(rows, 1, inner), np.clip(columns, 1, inner), 0]
    middle = NODES // 2
    for k, closes in enumerate(periods(carrier)):
        if not closes:
            continue
        column = np.unwrap(raw[:, middle, k])
        above = np.unwrap(raw[:, middle:, k], axis=1)
        below = np.unwrap(raw[:, middle::-1, k], axis=1)
        raw[:, middle:, k] = above + (column - above[:, 0])[:, None]
        raw[:, middle::-1, k] = below + (column - below[:, 0])[:, None]
        steps = [np.abs(np.diff(raw[..., k], axis=axis)).max() for axis in (0, 1)]
        if max(steps) > LONGEST_STEP:
            return None
    return raw


def _with_axis(sphere: Sphere, grid: Array) -> Sphere:
    """Return a sphere whose poles are where sides of the face are points, or else off the face."""
    centre = sphere.frame.origin
    out = (grid - centre) / sphere.radius
    sides = (out[:, 0], out[-1], out[:, -1], out[0])
    points = [side[0] for side in sides if np.abs(side - side[0]).max() <= ON_AXIS]
    mean = out.mean(axis=(0, 1))
    if points:
        z = points[0]
    elif np.abs(out[0] - out[-1]).max() <= ON_AXIS:
        z = _round_about(out[:, 0])
    elif np.abs(out[:, 0] - out[:, -1]).max() <= ON_AXIS:
        z = _round_about(out[0])
    else:
        reach = [np.abs(out @ z).max() for z in _AXES]
        z = _AXES[np.argmin(reach[:3]) if min(reach[:3]) < 0.95 else np.argmin(reach)]
    z = tidy(z / np.linalg.norm(z), 1.0)
    x = mean if np.linalg.norm(np.cross(mean, z)) > 1e-6 else np.eye(3)[np.argmin(np.abs(z))]
    return replace(sphere, frame=frame_on(centre, z, x))


def _round_about(loop: Array) -> Array:
    """Return the direction about which a closed loop (n, 3) runs."""
    return np.asarray(np.cross(loop[:-1], loop[1:]).sum(axis=0))


# -- surfaces moved along themselves ---------------------------------------------------------------


def _turned(carrier: AnalyticSurface, angle: float) -> AnalyticSurface:
    """Return a surface about an axis with its angles counted from another place."""
    assert not isinstance(carrier, Extrusion)
    old = carrier.frame
    frame = frame_on(old.origin, old.axes[2], old.round(np.asarray(angle)))
    frame = replace(frame, axes=np.where(np.abs(frame.axes) <= 1e-15, 0.0, frame.axes))
    if not isinstance(carrier, Revolution):
        return replace(carrier, frame=frame)
    rotation = old.axes.T @ frame.axes
    basis = carrier.basis
    if isinstance(basis, Arc):
        origin = frame.origin + (basis.frame.origin - frame.origin) @ rotation
        return Revolution(replace(basis, frame=Frame(origin, basis.frame.axes @ rotation)), frame)
    assert isinstance(basis, SplineCurve)
    poles = frame.origin + (basis.poles - frame.origin) @ rotation
    return Revolution(replace(basis, poles=poles), frame)


def _moved(carrier: Cylinder | Cone, start: float) -> Cylinder | Cone:
    """Return a surface with lengths counted from another place."""
    frame = carrier.frame
    if isinstance(carrier, Cylinder):
        return replace(carrier, frame=replace(frame, origin=frame.origin + start * frame.axes[2]))
    along, across = float(np.cos(carrier.angle)), float(np.sin(carrier.angle))
    origin = frame.origin + start * along * frame.axes[2]
    return Cone(replace(frame, origin=origin), carrier.radius + start * across, carrier.angle)


def _tidied(carrier: AnalyticSurface, size: float) -> AnalyticSurface:
    """Return a surface with lengths that are short decimals but for rounding made so."""

    def length(x: float) -> float:
        return float(tidy(np.asarray(x), size))

    if isinstance(carrier, Extrusion | Revolution):
        return carrier
    frame = replace(carrier.frame, origin=tidy(carrier.frame.origin, size))
    if isinstance(carrier, Torus):
        return Torus(frame, length(carrier.major), length(carrier.minor))
    return replace(carrier, frame=frame, radius=length(carrier.radius))
