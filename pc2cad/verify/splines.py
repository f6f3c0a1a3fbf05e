"""B-spline curves and surfaces of a file: values, derivatives and places, by NumPy alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product, vectors
from pc2cad.verify.inversion import Sampling, closest, nearest
from pc2cad.verify.searching import CLOSED, Jet, Searched, Span

#: of the solid's coordinates: a point so near to a side of a surface is on it
NEAR = 1e-9
#: rows of a basis that are multiplied at a time
BAND = 32


def knots_in(knots: Array, domain: Span) -> Array:
    """Return the distinct knots inside a domain, its ends included."""
    inner = distinct(knots)
    inner = inner[(inner > domain[0]) & (inner < domain[1])]
    return np.concatenate([[domain[0]], inner, [domain[1]]])


def local_basis(knots: Array, degree: int, count: int, t: Array) -> tuple[Integers, Array, Array]:
    """Return the numbers of the B-splines that live at each t, (len(t), degree + 1).

    With them their values and first derivatives (Cox-de Boor).
    """
    last = int(np.flatnonzero(knots[:count] < knots[count])[-1])
    span = np.clip(np.searchsorted(knots, t, side="right") - 1, degree, last)
    numbers = span[:, None] + np.arange(1 - degree, degree + 1)
    away = knots[numbers] - t[:, None]
    before, after = -away[:, :degree], away[:, degree:]
    local, ratio = np.ones((len(t), 1)), np.zeros((len(t), 0))
    for d in range(1, degree + 1):
        left, right = before[:, degree - d :], after[:, :d]
        ratio = local / (left + right)
        local = np.empty((len(t), d + 1))
        np.multiply(right, ratio, out=local[:, :d])
        local[:, d] = 0.0
        local[:, 1:] += left * ratio
    slope = np.zeros((len(t), degree + 1))
    ratio *= degree
    slope[:, 1:] = ratio
    slope[:, :-1] -= ratio
    return span[:, None] + np.arange(-degree, 1), local, slope


def banded(basis: Array, poles: Array) -> Array:
    """Return basis @ poles, where few columns next to each other are not 0 in each row."""
    count, most = basis.shape
    if most <= BAND:
        return product(basis, poles)
    found = np.empty((*poles.shape[:-2], count, poles.shape[-1]))
    for begin in range(0, count, BAND):
        part = basis[begin : begin + BAND]
        used = np.flatnonzero(part.any(axis=0))
        columns = slice(used[0], used[-1] + 1)
        found[..., begin : begin + BAND, :] = product(part[:, columns], poles[..., columns, :])
    return found


def across(poles: Array, basis: Array) -> Array:
    """Return poles @ basis.T, likewise."""
    return np.swapaxes(banded(basis, np.swapaxes(poles, -1, -2)), -1, -2)


def project(value: Array, slope: Array) -> tuple[Array, Array]:
    """Return point and derivative of homogeneous coordinates and their derivative."""
    weight = value[..., -1:]
    point = value[..., :-1] / weight
    return point, (slope[..., :-1] - point * slope[..., -1:]) / weight


def cartesian(poles: Array, rational: bool) -> Array:
    """Return poles without weights."""
    return poles[..., :-1] / poles[..., -1:] if rational else poles


@dataclass(frozen=True, eq=False)
class SplineCurve:
    """A B-spline; poles in homogeneous coordinates (weight last) if it is rational."""

    knots: Array
    degree: int
    poles: Array
    rational: bool
    period: float | None
    points: int

    @property
    def domain(self) -> Span:
        """The ends of the parameter."""
        return float(self.knots[self.degree]), float(self.knots[len(self.poles)])

    def at(self, t: Array) -> tuple[Array, Array]:
        """Return points and first derivatives, one per row."""
        low, high = self.domain
        if self.period is not None:
            outside = (t < low) | (t > high)
            t = np.where(outside, low + np.mod(t - low, self.period), t)
        columns, *rows = local_basis(self.knots, self.degree, len(self.poles), t)
        some = self.poles[columns]
        value, slope = (np.einsum("nj,njk->nk", row, some) for row in rows)
        return project(value, slope) if self.rational else (value, slope)

    def breaks(self, a: float, b: float) -> Array:
        """Return parameters from a to b between which the curve is smooth."""
        edges = inner_breaks(self.knots, self.domain, self.period, a, b)
        return distinct(np.linspace(edges[:-1], edges[1:], 3)) if self.rational else edges

    def sampling(self, points: Array) -> Sampling:
        """Return where an inversion starts."""
        return self._samples, *self.domain

    @cached_property
    def _samples(self) -> Array:
        spans = knots_in(self.knots, self.domain)
        return distinct(np.linspace(spans[:-1], spans[1:], 2 * self.degree + 3))

    @cached_property
    def _known(self) -> Array:
        return self.at(self._samples)[0]

    def locate(self, points: Array) -> Array:
        """Return the parameters of the nearest points."""
        return closest(self.at, self.sampling(points), points, self._known)

    def may_hold(self, points: Array, near: float) -> bool:
        """Say whether points may lie on the curve: none is far from all its samples."""
        known = self._known
        # a span's arc is seldom longer than twice its chords; the full search is for others
        step = 2.0 * float(np.linalg.norm(np.diff(known, axis=0), axis=1).max())
        off = np.linalg.norm(known[nearest(known, points)] - points, axis=1)
        return bool(off.max() <= step + near)


def inner_breaks(knots: Array, domain: Span, period: float | None, a: float, b: float) -> Array:
    """Return a, b and the knots between them, of a closed spline those of its next turns too."""
    inner = knots_in(knots, domain)
    if period is not None:
        inner = np.concatenate([inner - period, inner, inner + period])
    margin = 1e-12 * (b - a)
    inner = distinct(inner[(inner > a + margin) & (inner < b - margin)])
    return np.concatenate([[a], inner, [b]])


def make_curve(knots: Array, degree: int, poles: Array, rational: bool) -> SplineCurve:
    """Return a B-spline curve, periodic if its ends meet."""
    points = 24 if rational else 2 * degree + 1
    curve = SplineCurve(knots, degree, poles, rational, None, points)
    ends = curve.at(np.array(curve.domain))[0]
    size = float(np.ptp(cartesian(poles, rational), axis=0).max())
    if size > 0.0 and np.linalg.norm(ends[1] - ends[0]) <= CLOSED * size:
        return replace(curve, period=curve.domain[1] - curve.domain[0])
    return curve


@dataclass(frozen=True, eq=False)
class SplineSurface(Searched):
    """A tensor product B-spline, homogeneous poles (weight last) if it is rational."""

    knots: tuple[Array, Array]
    degrees: tuple[int, int]
    poles: Array
    rational: bool
    periods: tuple[float | None, float | None]
    limits: tuple[Span, Span]

    @property
    def points(self) -> tuple[int, int]:
        """Gauss points per span with which first moments are exact, or nearly if it is rational."""
        p, q = self.degrees
        return (p + 8, q + 8) if self.rational else (2 * p, 2 * q)

    def _turned(self, axis: int, t: Array) -> Array:
        low, high = self.limits[axis]
        period = self.periods[axis]
        if period is not None:
            outside = (t < low) | (t > high)
            return np.where(outside, low + np.mod(t - low, period), t)
        return t

    def _bases(self, axis: int, t: Array) -> tuple[slice, Array, Array]:
        """Return which poles of a direction count for parameters, and their values and slopes."""
        columns, local, slope = self._local(axis, t)
        first, rows = int(columns.min()), np.arange(len(t))[:, None]
        values, slopes = np.zeros((2, len(t), int(columns.max()) + 1 - first))
        values[rows, columns - first], slopes[rows, columns - first] = local, slope
        return slice(first, first + values.shape[1]), values, slopes

    def _local(self, axis: int, t: Array, *, turned: bool = True) -> tuple[Integers, Array, Array]:
        t = self._turned(axis, t) if turned else t
        return local_basis(self.knots[axis], self.degrees[axis], self.poles.shape[axis], t)

    def _jet(self, value: Array, slope_u: Array, slope_v: Array) -> Jet:
        if not self.rational:
            return value, slope_u, slope_v
        point, along_u = project(value, slope_u)
        return point, along_u, project(value, slope_v)[1]

    def grid(self, u: Array, v: Array) -> Jet:
        """Return point, u and v derivative on the tensor grid, (len(u), len(v), 3) each."""
        (rows, bu, du), (own, bv, dv) = self._bases(0, u), self._bases(1, v)
        # one coordinate after the other in memory: products are then fast
        flat = np.ascontiguousarray(np.moveaxis(self.poles[rows, own], -1, 0))
        columns, slopes = (np.ascontiguousarray(across(flat, b)) for b in (bv, dv))
        value, along_u, along_v = (
            np.moveaxis(banded(b, part), 0, -1)
            for b, part in ((bu, columns), (du, columns), (bu, slopes))
        )
        return self._jet(value, along_u, along_v)

    def at(self, u: Array, v: Array) -> Jet:
        """Return point, u and v derivative at pairs of parameters, (len(u), 3) each."""
        found = [np.empty((len(u), self.poles.shape[2])) for _ in range(3)]
        # runs of poles as rows of a view: taking them is ten times faster than pole by pole
        sizes = (self.degrees[0] + 1, self.degrees[1] + 1)
        windows = np.moveaxis(sliding_window_view(self.poles, sizes, axis=(0, 1)), 2, -1)
        slab = max(1, 2_000_000 // (self.poles.shape[2] * (self.degrees[0] + 1) ** 2))
        for begin in range(0, len(u), slab):
            part = slice(begin, begin + slab)
            rows, bu, du = self._local(0, u[part])
            columns, bv, dv = self._local(1, v[part])
            some = windows[rows[:, 0], columns[:, 0]]
            across, along = (np.einsum("nj,nijk->nik", b, some) for b in (bv, dv))
            for out, b, r in zip(found, (bu, du, bu), (across, across, along), strict=True):
                out[part] = np.einsum("ni,nik->nk", b, r)
        return self._jet(*found)

    def locate(self, points: Array) -> tuple[Array, Array]:
        """Return places on a side of the parameter rectangle if the points lie there, else any."""
        scale = float(np.abs(cartesian(self.poles, self.rational)).max())
        for axis, level, side in self._sides:
            if not side.may_hold(points, NEAR * scale):
                continue
            t = side.locate(points)
            if np.abs(side.at(t)[0] - points).max() <= NEAR * scale:
                fixed = np.full(len(t), level)
                return (fixed, t) if axis == 0 else (t, fixed)
        return self.search(points)

    @cached_property
    def _sides(self) -> list[tuple[int, float, SplineCurve]]:
        return [(axis, x, self.side(axis, x)) for axis in (0, 1) for x in self.limits[axis]]

    def side(self, axis: int, level: float) -> SplineCurve:
        """Return the iso-parametric curve at a level of one parameter."""
        columns, local, _ = self._local(axis, np.array([level]), turned=False)
        poles = vectors(local[0], np.moveaxis(np.take(self.poles, columns[0], axis), axis, 0))
        other = 1 - axis
        return make_curve(self.knots[other], self.degrees[other], poles, self.rational)

    def flat_frame(self) -> tuple[Array, Array] | None:
        """Return origin and axes (normal last) if all poles lie in one plane."""
        poles = cartesian(self.poles.reshape(-1, self.poles.shape[-1]), self.rational)
        centre = poles.mean(axis=0)
        _, sizes, axes = np.linalg.svd(poles - centre, full_matrices=False)
        if len(sizes) < 3 or sizes[2] > 1e-11 * sizes[0]:
            return None
        middle = [np.array([0.5 * (low + high)]) for low, high in self.limits]
        _, along_u, along_v = self.at(*middle)
        normal = axes[2] * np.sign(axes[2] @ np.cross(along_u[0], along_v[0]))
        return centre, np.array([axes[0], np.cross(normal, axes[0]), normal])

    def _samples(self, axis: int) -> Array:
        spans = knots_in(self.knots[axis], self.limits[axis])
        return distinct(np.linspace(spans[:-1], spans[1:], self.degrees[axis] + 3))

    def breaks(self, axis: int, a: float, b: float) -> Array:
        """Return parameters from a to b between which the surface is smooth."""
        return inner_breaks(self.knots[axis], self.limits[axis], self.periods[axis], a, b)


def make_surface(
    knots: tuple[Array, Array], degrees: tuple[int, int], poles: Array, rational: bool
) -> SplineSurface:
    """Return a B-spline surface, periodic in a direction if its two sides coincide."""
    limits = [
        (float(knot[degree]), float(knot[count]))
        for knot, degree, count in zip(knots, degrees, poles.shape[:2], strict=True)
    ]
    surface = SplineSurface(knots, degrees, poles, rational, (None, None), (limits[0], limits[1]))
    size = float(np.ptp(cartesian(poles, rational).reshape(-1, 3), axis=0).max())
    periods: list[float | None] = [None, None]
    for axis in (0, 1):
        low, high = (surface.side(axis, level).poles for level in limits[axis])
        if np.abs(low - high).max() <= CLOSED * size:
            periods[axis] = limits[axis][1] - limits[axis][0]
    return replace(surface, periods=(periods[0], periods[1]))
