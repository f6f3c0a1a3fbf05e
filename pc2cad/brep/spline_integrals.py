"""Integrals over tensor-product splines: Gauss per knot span, on homogeneous poles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface
from OCP.Geom2d import Geom2d_BSplineCurve

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product
from pc2cad.brep.forms import FLUX, Form
from pc2cad.brep.gauss_rules import gauss, rules_together
from pc2cad.brep.spline_numbers import curve_numbers, surface_numbers
from pc2cad.brep.spline_tables import bases, part_of, summing, times
from pc2cad.errors import KernelError
from pc2cad.geometry.splines.spline_basis import (
    local_bases,
    spline_jets,
    windows,
)
from pc2cad.geometry.splines.turns import turning_limits

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

    def along(self, t: Array) -> tuple[Array, Array]:
        """Return what `jet` does, by tables that curves with the same knots have in common."""
        values, slopes = bases(t, self.knots, self.degree)
        net = differences(self.poles[:, None], self.knots, self.degree, 0)[:, 0]
        point, along = project(times(values, self.poles), times(slopes, net))
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


def spline_flux(
    surface: Geom_BSplineSurface, sign: float, origin: Array, form: Form = FLUX
) -> Array:
    """Return the integrals of a form over a whole spline surface relative to `origin`."""
    return read_patch(surface, origin, sign).integrate(form)


def read_patch(surface: Geom_BSplineSurface, origin: Array, sign: float = 1.0) -> Patch:
    """Return a kernel spline surface relative to `origin`, its normal turned by `sign`."""
    surface = clamped(surface)
    poles, u, v = surface_numbers(surface)
    degrees = surface.UDegree(), surface.VDegree()
    return Patch(_homogeneous(poles, origin), (u, v), degrees, sign)


#: exact forms have few pieces (a full turn has 4)
MOST_EXACT_PIECES = 64
#: places of the lines on which a rule is settled: uneven, near both ends, for so many spans
_SPANS = 40
_LINES = np.array([0.004, 0.083, 0.207, 0.311, 0.468, 0.547, 0.719, 0.854, 0.934, 0.996])
#: orders of Gauss rules, the last of which the others are held against, and what that is itself
#: held against where spans are halved; and how often these are
_ORDERS, _HIGHEST, DEEPEST = (4, 6, 8), 12, 24
#: what the first order may leave, by the accuracy, for the second to be tried, and what that may:
#: less, as little more makes it much better
NEAR, CLOSE = 100, 0.02
#: pieces turn by so much at most (radians) before rules are tried on them
FARTHEST_TURN = np.pi / 3
#: how often lines are taken anew; what is sharp beyond that shows in areas that disagree with the
#: equation's
MOST_ROUNDS = 4
#: what may be left open in the end, by the accuracy that each span is settled to
LEFT_OPEN = 100
#: scattered places that are evaluated at once, and those of a grid: what is made of them stays near
CHUNK, TOGETHER = 20_000, 3_000

ALL = slice(None)
TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, eq=False)
class Patch:
    """A tensor-product spline: homogeneous poles, flat knots and degrees along s and t."""

    poles: Array
    knots: tuple[Array, Array]
    degrees: tuple[int, int]
    sign: float

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        """The ends of the pieces along both directions that rules begin with."""
        net = project(self.poles)[0]
        first, second = (distinct(knots) for knots in self.knots)
        return (
            turning_limits(first, net.transpose(1, 0, 2), FARTHEST_TURN),
            turning_limits(second, net, FARTHEST_TURN),
        )

    @property
    def accuracy(self) -> float:
        """What the area is worth: all digits on few pieces (exact forms), a fit's own on many."""
        pieces = [len(limits) - 1 for limits in self._limits]
        return 1e-13 if pieces[0] * pieces[1] <= MOST_EXACT_PIECES else 1e-10

    def integrate(self, form: Form = FLUX) -> Array:
        """Return the integrals with as many Gauss nodes as they need, where they need them."""
        (s, along_s), (t, along_t) = self._rules()
        seen = self._product(s, t)
        total: Array | float = 0.0
        step = max(1, TOGETHER // len(t))
        for i in range(0, len(s), step):
            part = slice(i, i + step)
            values = form.rows(*seen(part))
            total = total + product(product(values, along_t), along_s[part])
        return np.asarray(total)

    def _rules(self) -> list[tuple[Array, Array]]:
        """Return nodes and weights along both directions, each settled on lines across it.

        Where spans had to be halved there is something sharp, and it may be sharper between the
        lines of the other direction: these are then taken anew, until no span is halved for it.
        """
        limits = list(self._limits)
        rules: list[tuple[Array, Array]] = []
        for _ in range(MOST_ROUNDS):
            before = [len(x) for x in limits]
            rules = []
            for d in (0, 1):
                nodes, weights, limits[d] = self._rule(d, _lines(limits[1 - d]))
                rules.append((nodes, weights))
            if [len(x) for x in limits] == before:
                break
        return rules

    def _rule(self, direction: int, lines: Array) -> tuple[Array, Array, Array]:
        """Return nodes and weights along one direction, settled on lines across it, and its panels.

        Panels are returned as their limits.
        """
        limits = self._limits[direction]
        panels = np.stack((limits[:-1], limits[1:]), axis=1)
        few, some, high = _ORDERS
        sums, many = self._panel_sums(direction, panels, lines, (few, high))
        scale = self._scale(np.abs(many).sum(axis=1))
        gap = _gaps(sums, many, scale).max()
        if gap <= self.accuracy:
            return *gauss(panels, few), limits
        if gap <= NEAR * self.accuracy:
            (sums,) = self._panel_sums(direction, panels, lines, (some,))
            if _gaps(sums, many, scale).max() <= CLOSE * self.accuracy:
                return *gauss(panels, some), limits
        return self._rule_of_halves(direction, lines, panels, many)

    def _rule_of_halves(
        self, direction: int, lines: Array, panels: Array, few: Array
    ) -> tuple[Array, Array, Array]:
        """Return what `_rule` does, where spans of one order do not do; `few` are their sums by it.

        Spans whose integrals change with the order of the rule are halved until they do not: a
        crease much sharper than its span is found, and only there is it resolved.
        """
        last = panels[-1:, 1]
        done, starts = list[tuple[Array, Array]](), list[Array]()
        sizes = np.zeros((5, len(lines)))
        for depth in range(DEEPEST):
            orders = (_HIGHEST, _ORDERS[-1])[: 1 if depth == 0 else 2]
            many, *others = self._panel_sums(direction, panels, lines, orders)
            (few,) = others or [few]
            sizes = np.maximum(sizes, np.abs(many).sum(axis=1))
            gaps = _gaps(few, many, self._scale(sizes))
            right = gaps <= self.accuracy
            done.append(gauss(panels[right], _ORDERS[-1]))
            starts.append(panels[right, 0])
            panels = panels[~right]
            if len(panels) == 0:
                break
            middle = panels.mean(axis=1)
            panels = np.concatenate((
                np.stack((panels[:, 0], middle), axis=1), np.stack((middle, panels[:, 1]), axis=1)
            ))  # fmt: skip
        if len(panels) and not gaps[~right].sum() <= LEFT_OPEN * self.accuracy:
            raise KernelError(
                f"the integrals over a face do not settle: after halving its spans {DEEPEST} "
                f"times, {gaps[~right].sum():.2g} of them is left open"
            )
        done.append(gauss(panels, _HIGHEST))
        nodes, weights = (np.concatenate([rule[k] for rule in done]) for k in (0, 1))
        order = np.argsort(nodes)
        limits = np.sort(np.concatenate((*starts, panels[:, 0], last)))
        return nodes[order], weights[order], limits

    def _scale(self, sizes: Array) -> Array:
        """Return what integrals (5,) along lines count against, from those of sizes (5, lines)."""
        # lines near a pole add little: what counts is the largest
        volume, area = sizes.max(axis=1)[:2].tolist()
        return np.array([volume, area, *[volume * self._reach] * 3]) + TINY

    @cached_property
    def _reach(self) -> float:
        return float(np.sqrt((self.poles[..., :3] ** 2).sum(axis=-1).max()))

    def _panel_sums(
        self, direction: int, panels: Array, lines: Array, orders: tuple[int, ...]
    ) -> list[Array]:
        """Return the integrands of `FLUX` along each line over each panel, (5, panels, lines).

        Once for each order of a Gauss rule.
        """
        x, weights = rules_together(orders)
        half = (panels[:, 1] - panels[:, 0])[:, None] / 2
        nodes = (panels.mean(axis=1)[:, None] + half * x).ravel()
        shape = len(panels), len(x)
        if direction == 0:
            values = FLUX.rows(*self._product(nodes, lines)(ALL))
            sums = weights @ values.reshape(5, *shape, -1)
            return [sums[:, :, k] * half for k in range(len(orders))]
        values = FLUX.rows(*self._product(lines, nodes)(ALL))
        sums = values.reshape(5, -1, *shape) @ weights.T
        return [sums[..., k].transpose(0, 2, 1) * half for k in range(len(orders))]

    def scattered(self, s: Array, t: Array) -> tuple[Array, Array, Array]:
        """Return points and both derivatives, (n, 3) each, at places (s, t) of shape (n,)."""
        rows = [self._scattered(s[i : i + CHUNK], t[i : i + CHUNK])
                for i in range(0, len(s), CHUNK)]  # fmt: skip
        point, along_s, along_t = (np.concatenate(part) for part in zip(*rows, strict=True))
        return point, along_s, along_t

    def weight(self, s: Array, t: Array) -> Array:
        """Return a rational patch's weights (n,) at places."""
        three = np.broadcast_to(self.poles[..., 3:], (*self.poles.shape[:2], 3))
        return Patch(three, self.knots, self.degrees, self.sign).scattered(s, t)[0][:, 0]

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
        rows = self._product(*places)(ALL)
        points, normals = (np.moveaxis(row, 0, -1) for row in rows)
        return points, normals

    def _product(self, s: Array, t: Array) -> Callable[[slice], tuple[Array, Array]]:
        """Return what gives points and outward normals, (3, n, m) each, on a part of s and all t.

        Normals have the parameters' own length.
        """
        (a, slope_a), (b, slope_b) = (
            bases(x, k, n) for x, k, n in zip((s, t), self.knots, self.degrees, strict=True)
        )
        poles, net_s, net_t = self._rows
        tables = a, slope_a, a
        sums = summing(a, poles, b), summing(slope_a, net_s, b), summing(a, net_t, slope_b)

        def seen(part: slice) -> tuple[Array, Array]:
            pairs = zip(sums, tables, strict=True)
            rows = [take(part_of(table, part)) for take, table in pairs]
            if len(rows[0]) > 3:
                rational = project(*(np.moveaxis(x, 0, -1) for x in rows))
                rows = [np.moveaxis(x, -1, 0) for x in rational]
            point, ds, dt = rows
            normal = np.empty_like(point)
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                np.subtract(ds[j] * dt[k], ds[k] * dt[j], out=normal[i])
            return point, normal if self.sign > 0 else -normal

        return seen

    @cached_property
    def _rows(self) -> tuple[Array, Array, Array]:
        """The poles and those of both derivatives, coordinate by coordinate (k, …)."""
        poles, along_s, along_t = (
            np.ascontiguousarray(np.moveaxis(net, -1, 0)) for net in (self.poles, *self._nets)
        )
        return poles, along_s, along_t


def _lines(knots: Array) -> Array:
    """Return places of lines across a direction with these knots.

    They are spread over the spans and not over the parameter: where a fit saw more, there is more
    to see, and a needle lies between lines that are even.
    """
    spans = len(knots) - 1
    parts = -(-spans // _SPANS)
    places = (np.arange(parts)[:, None] + _LINES).ravel() / parts
    return np.asarray(np.interp(places * spans, np.arange(spans + 1), knots))


def _sum(i: Integers, a: Array, poles: Array, j: Integers, b: Array) -> Array:
    """Return the values (n, k) of Σ a_i b_j P_ij at n places, of functions from i and j on."""
    local = windows(poles, a.shape[1], b.shape[1])[i, j]
    return np.asarray(np.einsum("nj,njk->nk", b, np.einsum("ni,nijk->njk", a, local)))


def _gaps(few: Array, many: Array, scale: Array) -> Array:
    """Return by how much integrals (5, panels, lines) of two rules differ on each panel."""
    return np.asarray((np.abs(few - many).max(axis=2) / scale[:, None]).max(axis=0))


def differences(poles: Array, knots: Array, degree: int, axis: int) -> Array:
    """Return the poles of the derivative along one axis."""
    n = poles.shape[axis]
    scale = degree / (knots[degree + 1 : degree + n] - knots[1:n])
    return np.diff(poles, axis=axis) * (scale[:, None, None] if axis == 0 else scale[:, None])
