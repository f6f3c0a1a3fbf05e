"""Integrals over tensor-product splines: Gauss per knot span, on homogeneous poles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface
from OCP.Geom2d import Geom2d_BSplineCurve

from pc2cad.arrays import Array, Integers
from pc2cad.brep.spline_numbers import curve_numbers, surface_numbers
from pc2cad.brep.spline_tables import Table, bases, part_of, summing
from pc2cad.geometry.splines.spline_basis import (
    local_bases,
    spline_jets,
    windows,
)

_Spline = TypeVar("_Spline", Geom_BSplineCurve, Geom2d_BSplineCurve, Geom_BSplineSurface)


def spline_jet(knots: Array, poles: Array, degree: int) -> Callable[[Array], tuple[Array, Array]]:
    """Return a function of t, (n,), that gives a spline's values and first derivatives, (n, k)."""
    net = differences(poles[:, None], knots, degree, 0)[:, 0]

    def jet(t: Array) -> tuple[Array, Array]:
        return spline_jets(knots, poles, net, degree, t)

    return jet


def project(value: Array, *slopes: Array) -> list[Array]:
    """Return the point and its derivatives from homogeneous ones (weight last)."""
    if value.shape[-1] == 3:
        return [value, *slopes]
    weight = value[..., 3:]
    point = value[..., :3] / weight
    return [point, *((slope[..., :3] - point * slope[..., 3:]) / weight for slope in slopes)]


@dataclass(frozen=True, eq=False)
class SplineCurveData:
    """A kernel spline curve: homogeneous poles (n, 3 or 4), flat knots, degree."""

    poles: Array
    knots: Array
    degree: int

    def jet(self, t: Array) -> tuple[Array, Array]:
        """Return points and first derivatives, (len(t), 3) each."""
        point, along = project(*self._jet(t))
        return point, along

    @cached_property
    def _jet(self) -> Callable[[Array], tuple[Array, Array]]:
        return spline_jet(self.knots, self.poles, self.degree)


def clamped(spline: _Spline) -> _Spline:
    """Return a kernel spline whose knots hold the ends of its parameters, as files have them.

    Those of a periodic one do not, and taking its period away leaves knots beyond.
    """
    if isinstance(spline, Geom_BSplineSurface):
        if not (spline.IsUPeriodic() or spline.IsVPeriodic()):
            return spline
        copy = spline.Copy()
        copy.SetUNotPeriodic()
        copy.SetVNotPeriodic()
        copy.Segment(*copy.Bounds())
        return copy
    if not spline.IsPeriodic():
        return spline
    copy = spline.Copy()
    copy.SetNotPeriodic()
    copy.Segment(copy.FirstParameter(), copy.LastParameter())
    return copy


def read_curve(curve: Geom_BSplineCurve, origin: Array) -> SplineCurveData:
    """Return a kernel spline curve relative to `origin`."""
    curve = clamped(curve)
    poles, knots = curve_numbers(curve)
    return SplineCurveData(_homogeneous(poles, origin), knots, curve.Degree())


def _homogeneous(poles: Array, origin: Array) -> Array:
    """Return poles relative to `origin`, times their weights where they have some."""
    places = poles[..., :3] - origin
    if poles.shape[-1] == 3:
        return places
    weights = poles[..., 3:]
    return np.concatenate((places * weights, weights), axis=-1)


def flat_knots(curve: Geom_BSplineCurve | Geom2d_BSplineCurve) -> Array:
    """Return the knots of a kernel spline curve, each as often as its multiplicity says."""
    places = range(1, curve.NbKnots() + 1)
    return np.repeat([curve.Knot(i) for i in places], [curve.Multiplicity(i) for i in places])


def read_patch(surface: Geom_BSplineSurface, origin: Array) -> Patch:
    """Return a kernel spline surface relative to `origin`."""
    surface = clamped(surface)
    poles, u, v = surface_numbers(surface)
    degrees = surface.UDegree(), surface.VDegree()
    return Patch(_homogeneous(poles, origin), (u, v), degrees)


#: scattered places that are evaluated at once
CHUNK = 20_000

ALL = slice(None)


@dataclass(frozen=True, eq=False)
class Patch:
    """A tensor-product spline: homogeneous poles, flat knots and degrees along s and t."""

    poles: Array
    knots: tuple[Array, Array]
    degrees: tuple[int, int]

    def scattered(self, s: Array, t: Array) -> tuple[Array, Array, Array]:
        """Return points and both derivatives, (n, 3) each, at places (s, t) of shape (n,)."""
        rows = [self._scattered(s[i : i + CHUNK], t[i : i + CHUNK])
                for i in range(0, len(s), CHUNK)]  # fmt: skip
        point, along_s, along_t = (np.concatenate(part) for part in zip(*rows, strict=True))
        return point, along_s, along_t

    def weight(self, s: Array, t: Array) -> Array:
        """Return a rational patch's weights (n,) at places."""
        three = np.broadcast_to(self.poles[..., 3:], (*self.poles.shape[:2], 3))
        return Patch(three, self.knots, self.degrees).scattered(s, t)[0][:, 0]

    def _scattered(self, s: Array, t: Array) -> list[Array]:
        places = [np.clip(x, k[0], k[-1]) for x, k in zip((s, t), self.knots, strict=True)]
        (i, a, slope_a), (j, b, slope_b) = (
            local_bases(k, n, x) for x, k, n in zip(places, self.knots, self.degrees, strict=True)
        )
        return project(
            _sum(i, a, self.poles, j, b),
            _sum(i, slope_a, self._nets[0], j, b),
            _sum(i, a, self._nets[1], j, slope_b),
        )

    @cached_property
    def _nets(self) -> list[Array]:
        """The poles of both derivatives."""
        return [differences(self.poles, self.knots[d], self.degrees[d], d) for d in (0, 1)]

    def on_grid(self, s: Array, t: Array) -> tuple[Array, Array]:
        """Return points and normals (of the parameters' own length), (n, m, 3), on a grid."""
        places = (np.clip(x, k[0], k[-1]) for x, k in zip((s, t), self.knots, strict=True))
        tables = (bases(x, k, n) for x, k, n in zip(places, self.knots, self.degrees, strict=True))
        rows = Stack([self]).on_tables(*tables)(ALL)
        points, normals = (np.moveaxis(row[:, 0], 0, -1) for row in rows)
        return points, normals


class Stack:
    """Patches (w of them) of the same knots and degrees, rational all or none: evaluated at once.

    Attributes:
        poles: coordinate by coordinate, (3 or 4, w, n, m).

    """

    def __init__(self, patches: Sequence[Patch]) -> None:
        first = patches[0]
        self.knots, self.degrees = first.knots, first.degrees
        nets = np.array([patch.poles for patch in patches])
        self.poles = np.ascontiguousarray(nets.transpose(3, 0, 1, 2))
        along = (differences(self.poles, self.knots[d], self.degrees[d], d - 2) for d in (0, 1))
        self._nets = [net.reshape(-1, *net.shape[2:]) for net in (self.poles, *along)]

    def on_tables(
        self, s: Sequence[Table], t: Sequence[Table]
    ) -> Callable[[slice], tuple[Array, Array]]:
        """Return what gives points and normals, (3, w, n, m) each, on a part of s and all of t.

        These are told by the tables (`bases`) of places. Normals have the parameters' own length.
        """
        (a, slope_a), (b, slope_b) = s, t
        poles, net_s, net_t = self._nets
        tables = a, slope_a, a
        sums = summing(a, poles, b), summing(slope_a, net_s, b), summing(a, net_t, slope_b)
        shape = self.poles.shape[:2]

        def seen(part: slice) -> tuple[Array, Array]:
            pairs = zip(sums, tables, strict=True)
            rows = [take(part_of(table, part)) for take, table in pairs]
            point, ds, dt = (row.reshape(*shape, *row.shape[1:]) for row in rows)
            if len(point) > 3:
                weight = point[3:]
                point = point[:3] / weight
                ds, dt = ((along[:3] - point * along[3:]) / weight for along in (ds, dt))
            normal = np.empty_like(point)
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                np.subtract(ds[j] * dt[k], ds[k] * dt[j], out=normal[i])
            return point, normal

        return seen


def _sum(i: Integers, a: Array, poles: Array, j: Integers, b: Array) -> Array:
    """Return the values (n, k) of Σ a_i b_j P_ij at n places, of functions from i and j on."""
    local = windows(poles, a.shape[1], b.shape[1])[i, j]
    return np.asarray(np.einsum("nj,njk->nk", b, np.einsum("ni,nijk->njk", a, local)))


def differences(poles: Array, knots: Array, degree: int, axis: int) -> Array:
    """Return the poles of the derivative along one axis."""
    n = poles.shape[axis]
    scale = degree / (knots[degree + 1 : degree + n] - knots[1:n])
    after = poles.ndim - 1 - axis % poles.ndim
    return np.diff(poles, axis=axis) * scale.reshape(-1, *[1] * after)
