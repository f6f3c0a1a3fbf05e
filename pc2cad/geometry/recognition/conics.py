"""Lines and conics through points of a plane, whatever the parameter along them.

Points lie on a curve of a family where their monomials have a null vector. The families are tried
from the smallest up, because a null vector is the sharper the fewer components it has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.geometry.carriers import Arc, Frame, SplineCurve
from pc2cad.geometry.splines.bernstein import bezier_knots

#: singular values below this share of the largest are zero; those of the others are larger by GAP
NULL = 1e-12
GAP = 1e3
#: a circle or conic that bends less than this share of its own size is taken for straight
FLATTEST = 1e-6


@dataclass(frozen=True, eq=False)
class Straight:
    """A line: `along` has length 1."""

    point: Array
    along: Array


@dataclass(frozen=True, eq=False)
class Oval:
    """A circle or an ellipse: `axes` are the rows x and y, at right angles, the longer first."""

    centre: Array
    axes: Array
    radii: tuple[float, float]

    def arc(self, plane: Frame) -> Arc:
        """Return the whole of it in the plane of x and y of a frame."""
        x, y = self.axes @ plane.axes[:2]
        frame = Frame(plane.origin + self.centre @ plane.axes[:2], np.array([x, y, np.cross(x, y)]))
        return Arc(frame, self.radii, 0.0, 2 * np.pi)


@dataclass(frozen=True, eq=False)
class Branch:
    """A parabola or one branch of a hyperbola: poles (3, 2) and the middle weight of an arc."""

    poles: Array
    weight: float

    def curve(self, plane: Frame) -> SplineCurve:
        """Return the arc in the plane of x and y of a frame."""
        poles = plane.origin + self.poles @ plane.axes[:2]
        weights = None if self.weight == 1.0 else np.array([1.0, self.weight, 1.0])
        return SplineCurve(2, bezier_knots(2), poles, weights)


Conic = Straight | Oval | Branch


def conic_through(points: Array, slack: float, coaxial: bool = False) -> Conic | None:
    """Return the curve that holds points (n, 2) within a distance, or None.

    `coaxial` prefers conics with x = 0 as an axis: meridians of quadrics. An open conic runs from
    end to end of the points.
    """
    centre = points.mean(axis=0)
    size = float(np.abs(points - centre).max())
    local = (points - centre) / size
    line = _straight(local)
    if line is not None:
        return Straight(centre + size * line.point, line.along)
    x, y = local.T
    one = np.ones_like(x)
    found = _null(np.stack((x * x + y * y, x, y, one), axis=1))
    if found is not None and abs(found[0]) > FLATTEST:
        middle = -found[1:3] / (2 * found[0])
        radius = float(np.sqrt(middle @ middle - found[3] / found[0]))
        gap = np.abs(np.hypot(*(local - middle).T) - radius).max() * size
        oval = Oval(centre + size * middle, np.eye(2), (size * radius, size * radius))
        return oval if gap <= slack else None
    form = _coaxial(points, centre, size) if coaxial else None
    if form is None:
        form = _null(np.stack((x * x, x * y, y * y, x, y, one), axis=1))
    if form is None:
        return None
    value, gradient = _values(form, local), _gradients(form, local)
    steep = np.hypot(*gradient.T)
    if steep.min() <= FLATTEST * steep.max() or np.abs(value / steep).max() * size > slack:
        return None
    conic = _classified(form, local)
    if isinstance(conic, Oval):
        radii = (size * conic.radii[0], size * conic.radii[1])
        return Oval(centre + size * conic.centre, conic.axes, radii)
    return conic and Branch(centre + size * conic.poles, conic.weight)


def _straight(local: Array) -> Straight | None:
    point = local.mean(axis=0)
    _, values, axes = np.linalg.svd(local - point, full_matrices=False)
    return Straight(point, axes[0]) if values[1] <= NULL * values[0] else None


def _null(columns: Array) -> Array | None:
    """Return the null vector of the columns where there is exactly one."""
    _, values, rows = np.linalg.svd(columns, full_matrices=False)
    alone = values[-1] <= NULL * values[0] and values[-2] > GAP * NULL * values[0]
    return rows[-1] if alone else None


def _coaxial(points: Array, centre: Array, size: float) -> Array | None:
    """Return the form, over local coordinates, of a conic with x = 0 as an axis."""
    x, y = points[:, 0] / size, (points[:, 1] - centre[1]) / size
    found = _null(np.stack((x * x, y * y, y, np.ones_like(x)), axis=1))
    if found is None:
        return None
    a, c, e, f = found
    shift = centre[0] / size
    return np.array([a, 0.0, c, 2 * a * shift, e, f + a * shift * shift])


def _values(form: Array, points: Array) -> Array:
    a, b, c, d, e, f = form
    x, y = points.T
    return np.asarray(a * x * x + b * x * y + c * y * y + d * x + e * y + f)


def _gradients(form: Array, points: Array) -> Array:
    a, b, c, d, e, _ = form
    x, y = points.T
    return np.stack((2 * a * x + b * y + d, b * x + 2 * c * y + e), axis=1)


def _classified(form: Array, points: Array) -> Oval | Branch | None:
    a, b, c, d, e, f = form
    quadratic = np.array([[a, b / 2], [b / 2, c]])
    if a + c < 0:
        quadratic, d, e, f = -quadratic, -d, -e, -f
    values, axes = np.linalg.eigh(quadratic)
    if abs(values[0]) <= 1e-9 * values[1]:
        # a parabola: its places are told apart across its axis
        return _branch(form, points, axes[:, 1])
    centre = np.linalg.solve(quadratic, -np.array([d, e]) / 2)
    level = f + (d * centre[0] + e * centre[1]) / 2
    if values[0] > 0:
        if level >= 0:
            return None
        radii = np.sqrt(-level / values)
        return Oval(centre, axes.T, (float(radii[0]), float(radii[1])))
    # a hyperbola: along the axis that it does not meet
    return _branch(form, points, axes[:, 0] if level < 0 else axes[:, 1])


def _branch(form: Array, points: Array, across: Array) -> Branch | None:
    """Return the arc of an open conic from the first to the last of the points across its axis."""
    places = points @ across
    ends = points[[np.argmin(places), np.argmax(places)]]
    slopes = _gradients(form, ends)
    if abs(np.linalg.det(slopes)) <= FLATTEST**2 * np.abs(slopes).max() ** 2:
        return None
    apex = np.linalg.solve(slopes, (slopes * ends).sum(axis=1))
    middle = ends.mean(axis=0)
    # the form along the way from the chord's middle to the apex: k2 λ² + k1 λ + k0
    k0, k1, half = (_values(form, (middle + x * (apex - middle))[None])[0] for x in (0, 1, 0.5))
    k2 = 2 * (k1 + k0 - 2 * half)
    roots = np.roots([k2, k1 - k0 - k2, k0])
    shares = [float(r.real) for r in roots if abs(r.imag) < 1e-9 and 0 < r.real < 1]
    if not shares:
        return None
    weight = shares[0] / (1 - shares[0])
    return Branch(np.array([ends[0], apex, ends[1]]), 1.0 if abs(weight - 1) < 1e-12 else weight)
