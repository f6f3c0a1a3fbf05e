"""Solids that a turn carries onto themselves: where their faces begin is free.

A face of revolution begins at a seam, and a sphere has two poles besides: places of its parameters,
not of the solid. Where every face goes all the way round one axis, or is a whole sphere about one
centre, the boundary model may be turned as it stands, and the solid stays the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pc2cad.arrays import Array
from pc2cad.geometry.carriers import (
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
    SplineSurface,
    SurfaceCarrier,
    Torus,
)
from pc2cad.representation.boundary_model import BoundaryModel

#: share of the size, and sine, within which axes are one; and of a turn
ONE_AXIS, WHOLE = 1e-12, 1e-12


@dataclass(frozen=True, eq=False)
class Roundness:
    """What a solid may be turned about: an axis through a place, or a place (no axis)."""

    #: (3,); the axis is a unit vector
    centre: Array
    axis: Array | None

    def turn(self, angle: float) -> Array:
        """Return the matrix (3, 3) of a turn about the axis, radians."""
        assert self.axis is not None
        x, y, z = self.axis
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return np.asarray(
            np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * across @ across
        )


def roundness(model: BoundaryModel) -> Roundness | None:
    """Return what a solid may be turned about, or None.

    The faces lie on surfaces of revolution about one axis and end in whole circles about it only.
    """
    if model.layers:
        return None
    carriers = [face.carrier for face in model.faces]
    rims = [model.edges[index].carrier for index in sorted(model.creases)]
    slack = ONE_AXIS * model.size
    if not rims and all(isinstance(carrier, Sphere) for carrier in carriers):
        centres = [carrier.frame.origin for carrier in carriers if isinstance(carrier, Sphere)]
        same = all(float(np.abs(c - centres[0]).max()) <= slack for c in centres)
        return Roundness(centres[0], None) if same else None
    frames = [c.frame for c in (*carriers, *rims) if isinstance(c, _AXIAL)]
    if not frames:
        return None
    axis = _Axis(frames[0].origin, frames[0].axes[2], slack)
    if not all(map(axis.carries, carriers)) or not all(map(axis.is_rim, rims)):
        return None
    return Roundness(axis.centre, axis.way)


_AXIAL = (Cylinder, Cone, Torus, Revolution, Arc)


@dataclass(frozen=True, eq=False)
class _Axis:
    """An axis through a place, and the length within which it is another."""

    centre: Array
    way: Array
    slack: float

    def carries(self, carrier: SurfaceCarrier) -> bool:
        """Say whether turns about it carry a surface onto itself."""
        if isinstance(carrier, Plane):
            return float(np.linalg.norm(np.cross(carrier.normal, self.way))) <= ONE_AXIS
        if isinstance(carrier, Sphere):
            return self._has(carrier.frame.origin)
        return not isinstance(carrier, Extrusion | SplineSurface) and self._is(carrier.frame)

    def is_rim(self, carrier: CurveCarrier) -> bool:
        """Say whether an edge is a whole circle about it."""
        return (
            isinstance(carrier, Arc)
            and carrier.radii[0] == carrier.radii[1]
            and abs(carrier.end - carrier.start - 2 * np.pi) <= WHOLE
            and self._is(carrier.frame)
        )

    def _is(self, frame: Frame) -> bool:
        sine = float(np.linalg.norm(np.cross(frame.axes[2], self.way)))
        return sine <= ONE_AXIS and self._has(frame.origin)

    def _has(self, place: Array) -> bool:
        return float(np.linalg.norm(np.cross(place - self.centre, self.way))) <= self.slack


def turned(model: BoundaryModel, centre: Array, turn: Array) -> BoundaryModel:
    """Return the boundary model turned by a matrix (3, 3) about a place (3,).

    The names, the evidence and the deviations of its faces and edges stay: it is for solids that
    the turn carries onto themselves.
    """
    motion = _Motion(turn, centre - turn @ centre)
    return replace(
        model, vertices=motion.points(model.vertices),
        edges=tuple(replace(edge, carrier=motion.curve(edge.carrier)) for edge in model.edges),
        faces=tuple(replace(face, carrier=motion.surface(face.carrier)) for face in model.faces),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Motion:
    """x goes to `turn` x + `offset`."""

    turn: Array
    offset: Array

    def points(self, points: Array) -> Array:
        return np.asarray(points @ self.turn.T + self.offset)

    def frame(self, frame: Frame) -> Frame:
        return Frame(self.points(frame.origin), frame.axes @ self.turn.T)

    def curve(self, carrier: CurveCarrier) -> CurveCarrier:
        if isinstance(carrier, Line):
            return Line(self.points(carrier.start), self.points(carrier.end))
        if isinstance(carrier, SplineCurve):
            return replace(carrier, poles=self.points(carrier.poles))
        return replace(carrier, frame=self.frame(carrier.frame))

    def surface(self, carrier: SurfaceCarrier) -> SurfaceCarrier:
        if isinstance(carrier, Plane):
            return Plane(self.points(carrier.origin), self.turn @ carrier.normal)
        if isinstance(carrier, SplineSurface):
            return replace(carrier, poles=self.points(carrier.poles))
        if isinstance(carrier, Extrusion):
            return Extrusion(self.curve(carrier.basis), self.turn @ carrier.direction)
        if isinstance(carrier, Revolution):
            return Revolution(self.curve(carrier.basis), self.frame(carrier.frame))
        return replace(carrier, frame=self.frame(carrier.frame))
