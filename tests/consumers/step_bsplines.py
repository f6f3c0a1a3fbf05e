"""B-spline surfaces of a STEP file with numpy only."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .step_curves import (
    BSplineCurve,
    basis,
    closest,
    distinct,
    full_knots,
    homogeneous,
    make_b_spline,
    project,
)
from .step_parse import StepDefect, StepGraph, Vector

Range = tuple[float, float]
Jet = tuple[Vector, Vector, Vector]
NEAR = 1e-9


@dataclass(frozen=True)
class BSplineSurface:
    """A tensor product B-spline, homogeneous poles (weight last) if it is rational."""

    knots: tuple[Vector, Vector]
    degrees: tuple[int, int]
    poles: Vector
    rational: bool
    periods: tuple[float | None, float | None]
    limits: tuple[Range, Range]
    points: tuple[int, int]
    exact: bool

    def _bases(self, axis: int, t: Vector) -> tuple[Vector, Vector]:
        low, high = self.limits[axis]
        period = self.periods[axis]
        if period is not None:
            outside = (t < low) | (t > high)
            t = np.where(outside, low + np.mod(t - low, period), t)
        return basis(self.knots[axis], self.degrees[axis], self.poles.shape[axis], t)

    def _jet(self, value: Vector, slope_u: Vector, slope_v: Vector) -> Jet:
        if not self.rational:
            return value, slope_u, slope_v
        point, along_u = project(value, slope_u)
        return point, along_u, project(value, slope_v)[1]

    def grid(self, u: Vector, v: Vector) -> Jet:
        (bu, du), (bv, dv) = self._bases(0, u), self._bases(1, v)
        rows, rows_u = (np.tensordot(b, self.poles, axes=(1, 0)) for b in (bu, du))
        value, along_u, along_v = (
            np.moveaxis(np.tensordot(part, b, axes=(1, 1)), 1, 2)
            for part, b in ((rows, bv), (rows_u, bv), (rows, dv))
        )
        return self._jet(value, along_u, along_v)

    def at(self, u: Vector, v: Vector) -> Jet:
        (bu, du), (bv, dv) = self._bases(0, u), self._bases(1, v)
        rows, rows_u = (np.tensordot(b, self.poles, axes=(1, 0)) for b in (bu, du))
        return self._jet(
            np.einsum("nj,njk->nk", bv, rows),
            np.einsum("nj,njk->nk", bv, rows_u),
            np.einsum("nj,njk->nk", dv, rows),
        )

    def locate(self, points: Vector) -> tuple[Vector, Vector]:
        """On a side of the parameter rectangle if the points lie there, else anywhere."""
        scale = float(np.abs(self.poles).max())
        for axis in (0, 1):
            for level in self.limits[axis]:
                side = self.side(axis, level)
                t = closest(side.at, side.sampling(points), points)
                if np.abs(side.at(t)[0] - points).max() <= NEAR * scale:
                    fixed = np.full(len(t), level)
                    return (fixed, t) if axis == 0 else (t, fixed)
        return self._search(points)

    def side(self, axis: int, level: float) -> BSplineCurve:
        """The iso-parametric curve at a level of one parameter."""
        row = basis(self.knots[axis], self.degrees[axis], self.poles.shape[axis], np.array([level]))
        poles = np.tensordot(row[0][0], self.poles, axes=(0, axis))
        other = 1 - axis
        return make_b_spline(self.knots[other], self.degrees[other], poles, self.rational)

    def flat_frame(self) -> tuple[Vector, Vector] | None:
        """Origin and axes (normal last) if all poles lie in one plane."""
        poles = self.poles.reshape(-1, self.poles.shape[-1])
        if self.rational:
            poles = poles[:, :-1] / poles[:, -1:]
        centre = poles.mean(axis=0)
        _, sizes, axes = np.linalg.svd(poles - centre, full_matrices=False)
        if sizes[2] > 1e-11 * sizes[0]:
            return None
        middle = [np.array([0.5 * (low + high)]) for low, high in self.limits]
        _, along_u, along_v = self.at(*middle)
        normal = axes[2] * np.sign(axes[2] @ np.cross(along_u[0], along_v[0]))
        return centre, np.array([axes[0], np.cross(normal, axes[0]), normal])

    def _samples(self, axis: int) -> Vector:
        spans = distinct(self.knots[axis], self.limits[axis])
        return np.unique(np.linspace(spans[:-1], spans[1:], self.degrees[axis] + 3))

    def _search(self, points: Vector) -> tuple[Vector, Vector]:
        """Nearest grid point, then Gauss-Newton in both parameters."""
        us, vs = self._samples(0), self._samples(1)
        known = self.grid(us, vs)[0].reshape(-1, 3)
        nearest = np.array([((known - point) ** 2).sum(axis=1).argmin() for point in points])
        u, v = us[nearest // len(vs)], vs[nearest % len(vs)]
        for _ in range(24):
            place, along_u, along_v = self.at(u, v)
            jacobian = np.stack([along_u, along_v], axis=2)
            step = np.linalg.pinv(jacobian) @ (points - place)[:, :, None]
            u = np.clip(u + step[:, 0, 0], *self.limits[0])
            v = np.clip(v + step[:, 1, 0], *self.limits[1])
        return u, v

    def breaks(self, axis: int, a: float, b: float) -> Vector:
        inner = distinct(self.knots[axis], self.limits[axis])
        period = self.periods[axis]
        if period is not None:
            inner = np.concatenate([inner - period, inner, inner + period])
        margin = 1e-12 * (b - a)
        inner = np.unique(inner[(inner > a + margin) & (inner < b - margin)])
        return np.concatenate([[a], inner, [b]])


def read_b_spline_surface(graph: StepGraph, parts: dict[str, Any], ref: Any) -> BSplineSurface:
    """A simple or complex B-spline surface instance."""
    knots_part = parts["B_SPLINE_SURFACE_WITH_KNOTS"]
    if "B_SPLINE_SURFACE" in parts:
        head, tail = parts["B_SPLINE_SURFACE"], knots_part
    else:
        head, tail = knots_part[1:], knots_part[8:]
    degrees, rows = (int(head[0]), int(head[1])), head[2]
    if len({len(row) for row in rows}) != 1:
        raise StepDefect(f"The rows of poles of B-spline {ref} differ in length.")
    poles = graph.points([pole for row in rows for pole in row])
    poles = poles.reshape(len(rows), -1, poles.shape[-1])
    rational = "RATIONAL_B_SPLINE_SURFACE" in parts
    if rational:
        poles = homogeneous(poles, parts["RATIONAL_B_SPLINE_SURFACE"][0], ref)
    knots = (
        full_knots(tail[2], tail[0], poles.shape[0], degrees[0], ref),
        full_knots(tail[3], tail[1], poles.shape[1], degrees[1], ref),
    )
    return make_surface(knots, degrees, poles, rational)


def make_surface(
    knots: tuple[Vector, Vector], degrees: tuple[int, int], poles: Vector, rational: bool
) -> BSplineSurface:
    """A B-spline surface, periodic in a direction if its two sides coincide."""
    limits = [
        (float(knot[degree]), float(knot[count]))
        for knot, degree, count in zip(knots, degrees, poles.shape[:2], strict=True)
    ]
    points = tuple(degree + 8 if rational else 2 * degree for degree in degrees)
    surface = BSplineSurface(
        knots, degrees, poles, rational, (None, None), (limits[0], limits[1]), points, not rational
    )
    size = float(np.ptp(poles.reshape(-1, poles.shape[-1]), axis=0).max())
    periods: list[float | None] = [None, None]
    for axis in (0, 1):
        low, high = (surface.side(axis, level).poles for level in limits[axis])
        if np.abs(low - high).max() <= 1e-10 * size:
            periods[axis] = limits[axis][1] - limits[axis][0]
    return replace(surface, periods=(periods[0], periods[1]))
