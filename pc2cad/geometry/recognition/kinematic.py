"""The surface that points with normals lie on, found from the motions that leave it in its place.

A motion with the velocity c + ω × p leaves a surface in its place where n · (c + ω × p) = 0
everywhere on it: linear equations for (ω, c). Three motions are a sphere's, two a cylinder's; one
is the turning of a surface of revolution, or the translation of an extrusion. What is swept is then
a plane curve, and a line or a conic can be told from its points. No parameter of the surface comes
into this.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import cross, product
from pc2cad.geometry.carriers import (
    AnalyticSurface,
    Cone,
    Cylinder,
    Extrusion,
    Frame,
    Revolution,
    Sphere,
    Torus,
    frame_on,
)
from pc2cad.geometry.recognition.conics import Conic, Oval, Straight, conic_through

#: motions hold to this share of their size
NULL = 1e-11
#: and those whose squares are larger than this share are none, however these are rounded
_SEEN = 1e-12
#: shares of the size: numbers as near as this to a decimal of that many places are meant to be it
NEAR, DECIMAL = 1e-14, 1e-11


def tidy(values: Array, size: float) -> Array:
    """Return numbers with those that rounding has moved off a short decimal put back there."""
    rounded = np.round(values, -int(np.ceil(np.log10(DECIMAL * size))))
    return np.asarray(np.where(np.abs(rounded - values) <= NEAR * size, rounded, values) + 0.0)


@dataclass(frozen=True, eq=False)
class Sweep:
    """A plane curve turned about the axis z of a frame, or moved along it.

    A meridian has the coordinates (radius, height), a section those along x and y.
    """

    frame: Frame
    conic: Conic
    turned: bool

    def carrier(self) -> AnalyticSurface | None:
        """Return it as a surface with parameters of its own, or None for a plane."""
        frame, conic = self.frame, self.conic
        if self.turned:
            return self._revolution()
        if isinstance(conic, Straight):
            return None
        if not isinstance(conic, Oval):
            return Extrusion(conic.curve(frame), frame.axes[2])
        if conic.radii[0] != conic.radii[1]:
            return Extrusion(conic.arc(frame), frame.axes[2])
        return Cylinder(replace(frame, origin=conic.arc(frame).frame.origin), conic.radii[0])

    def _revolution(self) -> AnalyticSurface | None:
        frame, conic = self.frame, self.conic
        if isinstance(conic, Straight):
            place = replace(frame, origin=frame.origin + conic.point[1] * frame.axes[2])
            return Cone(place, float(conic.point[0]), float(np.arctan2(*conic.along)))
        meridian = Frame(frame.origin, np.array([frame.axes[0], frame.axes[2], -frame.axes[1]]))
        if not isinstance(conic, Oval):
            return Revolution(conic.curve(meridian), frame)
        major, minor = float(conic.centre[0]), conic.radii[0]
        if conic.radii[0] == conic.radii[1] and major > minor * (1 + 1e-9):
            place = replace(frame, origin=frame.origin + conic.centre[1] * frame.axes[2])
            return Torus(place, major, minor)
        return Revolution(conic.arc(meridian), frame)


def free_motions(points: Array, normals: Array) -> Array | None:
    """Return the motions (1 to 3, 6), velocities last, that leave a surface in its place, or None.

    The surface has unit normals (n, 3) at points (n, 3), which motions take about their middle and
    in units of their size.
    """
    centre, size = _middle(points)
    local = (points - centre) / size
    table = np.concatenate((cross(local, normals), normals), axis=1)
    # most surfaces have none, and the squares of the singular values show that sooner
    squares = np.linalg.eigvalsh(product(table.T, table))
    if squares[0] > _SEEN * squares[-1]:
        return None
    _, values, motions = np.linalg.svd(table, full_matrices=False)
    free = int((values <= NULL * values[0]).sum())
    return motions[-free:] if 1 <= free <= 3 else None


def _middle(points: Array) -> tuple[Array, float]:
    centre = points.mean(axis=0)
    return centre, float(np.abs(points - centre).max())


def sweep_through(
    points: Array, motions: Array, border: Callable[[], Array], slack: float
) -> Sweep | Sphere | None:
    """Return what holds points (n, 3) within a distance and has free motions, or None.

    `border` gives points (m, 3) all round it: an open meridian or section ends there. What moves
    along a helix is not asked for them.
    """
    centre, size = _middle(points)
    if len(motions) == 3:
        return _sphere(np.concatenate((points, border())), centre, size, slack)
    motion = motions[-1]
    if len(motions) == 2:
        # of a cylinder's motions the one that does not turn
        motion = np.linalg.svd(motions[:, :3].T)[2][-1] @ motions
    turning, moving = motion[:3], motion[3:]
    pitch = float(np.linalg.norm(turning))
    if pitch <= 100 * NULL * np.linalg.norm(moving):
        z = tidy(moving / np.linalg.norm(moving), 1.0)
        frame = frame_on(centre, z, np.eye(3)[np.argmin(np.abs(z))])
        every = np.concatenate((points, border()))
        section = (every - centre) @ frame.axes[:2].T
        conic = conic_through(section, slack)
        return None if conic is None else Sweep(frame, conic, False)
    if abs(turning @ moving) > 100 * NULL * pitch:
        return None  # a helical motion
    z = tidy(turning / pitch, 1.0)
    foot = tidy(centre + size * np.cross(turning, moving) / pitch**2, size)
    frame = frame_on(foot, z, np.eye(3)[np.argmin(np.abs(z))])
    away = (np.concatenate((points, border())) - foot) @ frame.axes.T
    meridian = np.stack((np.hypot(away[:, 0], away[:, 1]), away[:, 2]), axis=1)
    conic = conic_through(meridian, slack, coaxial=True)
    if isinstance(conic, Straight):
        return Sweep(*_widening(frame, conic), True)
    return None if conic is None else Sweep(frame, conic, True)


def _widening(frame: Frame, line: Straight) -> tuple[Frame, Straight]:
    """Return a cone's axis and line such that it widens along the axis."""
    along = line.along if line.along[0] > 0 else -line.along
    if along[1] > 0:
        return frame, Straight(line.point, along)
    upside_down = Frame(frame.origin, frame.axes * np.array([[1.0], [-1.0], [-1.0]]))
    flip = np.array([1.0, -1.0])
    return upside_down, Straight(line.point * flip, along * flip)


def _sphere(points: Array, centre: Array, size: float, slack: float) -> Sphere | None:
    local = (points - centre) / size
    table = np.column_stack(((local * local).sum(axis=1), local, np.ones(len(local))))
    row = np.linalg.svd(table, full_matrices=False)[2][-1]
    if abs(row[0]) <= NULL:
        return None
    middle = -row[1:4] / (2 * row[0])
    radius = float(np.sqrt(middle @ middle - row[4] / row[0]))
    gap = float(np.abs(np.linalg.norm(local - middle, axis=1) - radius).max()) * size
    return Sphere(Frame(centre + size * middle, np.eye(3)), size * radius) if gap <= slack else None
