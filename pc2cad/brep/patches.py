"""Integrals over tensor-product splines: Gauss per knot span, on homogeneous poles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface
from scipy.interpolate import BSpline
from scipy.sparse import csr_array, diags_array

Array = NDArray[np.float64]


def flux(points: Array, normals: Array, weights: Array) -> Array:
    """Return ∬ r·n, ∬ |n| and ∬ r_i² n_i: points and normals (n, 3), weights (n,)."""
    result = np.empty(5)
    result[0] = weights @ (points * normals).sum(axis=1)
    result[1] = weights @ np.sqrt((normals * normals).sum(axis=1))
    result[2:] = weights @ (points * points * normals)
    return result


def gauss_on(knots: Array, count: int) -> tuple[Array, Array]:
    """Return the nodes and weights of a Gauss rule on every span between knots."""
    spans = np.unique(knots)
    x, weight = np.polynomial.legendre.leggauss(count)
    half = np.diff(spans)[:, None] / 2
    nodes = (spans[:-1, None] + spans[1:, None]) / 2 + half * x
    return nodes.ravel(), (half * weight).ravel()


def design(t: Array, knots: Array, degree: int, order: int) -> csr_array:
    """Return values (order 0) or first derivatives of the basis at t, (len(t), n)."""
    if order == 0:
        return csr_array(BSpline.design_matrix(t, knots, degree))
    # the derivative's control points are p (P_i+1 - P_i) / (t_i+p+1 - t_i+1)
    n = len(knots) - degree - 1
    scale = degree / (knots[degree + 1 : degree + n] - knots[1:n])
    difference = diags_array([-scale, scale], offsets=[0, 1], shape=(n - 1, n))
    return csr_array(BSpline.design_matrix(t, knots[1:-1], degree - 1) @ difference)


def project(value: Array, *slopes: Array) -> list[Array]:
    """Return the point and its derivatives from homogeneous ones (weight last)."""
    if value.shape[-1] == 3:
        return [value, *slopes]
    weight = value[..., 3:]
    point = value[..., :3] / weight
    return [point, *((slope[..., :3] - point * slope[..., 3:]) / weight for slope in slopes)]


@dataclass(frozen=True)
class SplineCurveData:
    """A kernel spline curve: homogeneous poles (n, 3 or 4), flat knots, degree."""

    poles: Array
    knots: Array
    degree: int

    def jet(self, t: Array) -> tuple[Array, Array]:
        """Return points and first derivatives, (len(t), 3) each."""
        value, slope = (design(t, self.knots, self.degree, k) @ self.poles for k in (0, 1))
        point, along = project(value, slope)
        return point, along


def read_curve(curve: Geom_BSplineCurve, origin: Array) -> SplineCurveData:
    """Return a kernel spline curve relative to `origin`."""
    count = curve.NbPoles()
    poles = np.array([(p.X(), p.Y(), p.Z()) for p in map(curve.Pole, range(1, count + 1))]) - origin
    if curve.IsRational():
        weights = np.array([[curve.Weight(i)] for i in range(1, count + 1)])
        poles = np.hstack((poles * weights, weights))
    knots = np.repeat([curve.Knot(i + 1) for i in range(curve.NbKnots())],
                      [curve.Multiplicity(i + 1) for i in range(curve.NbKnots())])  # fmt: skip
    return SplineCurveData(poles, knots, curve.Degree())


def spline_flux(surface: Geom_BSplineSurface, sign: float, origin: Array) -> Array:
    """Return the flux integrals over a whole spline surface relative to `origin`."""
    rows, columns = surface.NbUPoles(), surface.NbVPoles()
    rational = surface.IsURational() or surface.IsVRational()
    poles = np.empty((rows, columns, 4 if rational else 3))
    for i in range(rows):
        for j in range(columns):
            p = surface.Pole(i + 1, j + 1)
            poles[i, j, :3] = (p.X(), p.Y(), p.Z())
    poles[..., :3] -= origin
    if rational:
        for i in range(rows):
            for j in range(columns):
                poles[i, j, 3] = surface.Weight(i + 1, j + 1)
        poles[..., :3] *= poles[..., 3:]
    u = np.repeat([surface.UKnot(i + 1) for i in range(surface.NbUKnots())],
                    [surface.UMultiplicity(i + 1) for i in range(surface.NbUKnots())])  # fmt: skip
    v = np.repeat([surface.VKnot(i + 1) for i in range(surface.NbVKnots())],
                    [surface.VMultiplicity(i + 1) for i in range(surface.NbVKnots())])  # fmt: skip
    patch = _Patch(poles, (u, v), (surface.UDegree(), surface.VDegree()), sign)
    return patch.integrate()


#: exact forms have few pieces (a full turn has 4)
MOST_EXACT_PIECES = 64


@dataclass(frozen=True)
class _Patch:
    """A tensor-product spline: homogeneous poles, flat knots and degrees along s and t."""

    poles: Array
    knots: tuple[Array, Array]
    degrees: tuple[int, int]
    sign: float

    @property
    def _accuracy(self) -> float:
        """What the area is worth: all digits on few pieces (exact forms), a fit's own on many."""
        pieces = [len(np.unique(knots)) - 1 for knots in self.knots]
        return 1e-13 if pieces[0] * pieces[1] <= MOST_EXACT_PIECES else 1e-10

    def integrate(self) -> Array:
        """Return the flux integrals with as many Gauss nodes per span as they need."""
        counts = [self._count(d) for d in (0, 1)]
        total = self._sum(counts)
        # an exact form has to be right to all digits, also where it is nearly flat in a corner
        while self._accuracy < 1e-12 and max(counts) < 100:
            counts = [count + count // 2 for count in counts]
            before, total = total, self._sum(counts)
            if abs(total[1] - before[1]) <= 1e-12 * total[1]:
                break
        return total

    def _sum(self, counts: list[int]) -> Array:
        rules = [gauss_on(self.knots[d], counts[d]) for d in (0, 1)]
        total = np.zeros(5)
        step = max(1, 200_000 // len(rules[1][0]))
        for i in range(0, len(rules[0][0]), step):
            part = (rules[0][0][i : i + step], rules[0][1][i : i + step])
            total += self._flux((part, rules[1]))
        return total

    def _count(self, direction: int) -> int:
        """Return the nodes per span along one direction, found on a few lines across it.

        Only the area needs a search: its square root is no polynomial.
        """
        ends = self.knots[1 - direction][0], self.knots[1 - direction][-1]
        shares = np.array([0.004, 0.083, 0.311, 0.547, 0.719, 0.934, 0.996])
        lines = ends[0] + (ends[1] - ends[0]) * shares
        known = None
        count = 3
        while True:
            along = gauss_on(self.knots[direction], count)
            across = (lines, np.ones_like(lines))
            values = self._flux((along, across) if direction == 0 else (across, along))
            if known is not None and abs(values[1] - known) <= self._accuracy * abs(values[1]):
                return count
            if count > 40:
                return count
            known, count = values[1], count + 3

    def _flux(self, rules: tuple[tuple[Array, Array], tuple[Array, Array]]) -> Array:
        along, across = (
            [design(rule[0], knots, degree, order) for order in (0, 1)]
            for rule, knots, degree in zip(rules, self.knots, self.degrees, strict=True)
        )
        point, ds, dt = project(*(
            _tensor(a, self.poles, b)
            for a, b in ((along[0], across[0]), (along[1], across[0]), (along[0], across[1]))
        ))  # fmt: skip
        weights = (rules[0][1][:, None] * rules[1][1]).ravel()
        normal = np.empty_like(ds)
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            normal[:, i] = self.sign * (ds[:, j] * dt[:, k] - ds[:, k] * dt[:, j])
        return flux(point, normal, weights)


def _tensor(a: csr_array, poles: Array, b: csr_array) -> Array:
    """Return the values (len(a)·len(b), k) of Σ a_i b_j P_ij."""
    n, m, k = poles.shape
    rows = (a @ poles.reshape(n, -1)).reshape(-1, m, k).transpose(1, 0, 2)
    values = (b @ rows.reshape(m, -1)).reshape(b.shape[0], -1, k)
    return np.ascontiguousarray(values.transpose(1, 0, 2)).reshape(-1, k)
