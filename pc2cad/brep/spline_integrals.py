"""Integrals over tensor-product splines: Gauss per knot span, on homogeneous poles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeVar

import numpy as np
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface
from OCP.Geom2d import Geom2d_BSplineCurve

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import cross, product
from pc2cad.brep.forms import FLUX, Form
from pc2cad.brep.spline_numbers import curve_numbers, surface_numbers
from pc2cad.errors import KernelError
from pc2cad.geometry.splines.spline_basis import (
    SparseRows,
    basis_matrices,
    local_bases,
    spline_jets,
    windows,
)
from pc2cad.geometry.splines.turns import turning_limits

_Spline = TypeVar("_Spline", Geom_BSplineCurve, Geom2d_BSplineCurve, Geom_BSplineSurface)


def gauss_on(knots: Array, count: int) -> tuple[Array, Array]:
    """Return the nodes and weights of a Gauss rule on every span between knots."""
    spans = distinct(knots)
    x, weight = legendre(count)
    half = np.diff(spans)[:, None] / 2
    nodes = (spans[:-1, None] + spans[1:, None]) / 2 + half * x
    return nodes.ravel(), (half * weight).ravel()


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
#: orders of Gauss rules that are compared, and halvings of a span
_ORDERS, DEEPEST = (4, 8, 12), 24
#: pieces turn by so much at most (radians) before rules are tried on them
FARTHEST_TURN = np.pi / 3
#: how often lines are taken anew; what is sharp beyond that shows in areas that disagree with the
#: equation's
MOST_ROUNDS = 4
#: what may be left open in the end, by the accuracy that each span is settled to
LEFT_OPEN = 100
#: basis functions up to which matrices are dense
DENSE = 48
#: scattered places that are evaluated at once
CHUNK = 20_000


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
        rules = self._rules()
        total: Array | float = 0.0
        step = max(1, 200_000 // len(rules[1][0]))
        for i in range(0, len(rules[0][0]), step):
            part = (rules[0][0][i : i + step], rules[0][1][i : i + step])
            points, normals = self._jet(part[0], rules[1][0])
            weights = part[1][:, None] * rules[1][1]
            values = form.columns(points.reshape(-1, 3), normals.reshape(-1, 3))
            total = total + product(weights.ravel(), values)
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

        Spans whose integrals change with the order of the rule are halved until they do not: a
        crease much sharper than its span is found, and only there is it resolved. Panels are
        returned as their limits.
        """
        accuracy = self.accuracy
        limits = self._limits[direction]
        panels = np.stack((limits[:-1], limits[1:]), axis=1)
        done, starts = list[tuple[Array, Array]](), list[Array]()
        sizes: Array | float = 0.0
        reach = np.sqrt((self.poles[..., :3] ** 2).sum(axis=-1)).max()
        for depth in range(DEEPEST + 1):
            # the two lower orders settle most rules; the higher ones where they do not
            orders = _ORDERS[:2] if depth == 0 else _ORDERS[1:]
            few, many = self._panel_sums(direction, panels, lines, orders)
            sizes = np.maximum(sizes, np.abs(many).sum(axis=0))
            # lines near a pole add little: what counts is the largest
            volume, area = np.max(sizes, axis=0)[:2]
            scale = np.array([volume, area, *[volume * reach] * 3]) + np.finfo(float).tiny
            gaps = (np.abs(few - many) / scale).max(axis=(1, 2))
            if depth == 0:
                if gaps.max() <= accuracy:
                    return *_gauss(panels, _ORDERS[0]), limits
                continue
            right = gaps <= accuracy
            done.append(_gauss(panels[right], _ORDERS[1]))
            starts.append(panels[right, 0])
            panels = panels[~right]
            if len(panels) == 0:
                break
            middle = panels.mean(axis=1)
            panels = np.concatenate((
                np.stack((panels[:, 0], middle), axis=1), np.stack((middle, panels[:, 1]), axis=1)
            ))  # fmt: skip
        if len(panels) and not gaps[~right].sum() <= LEFT_OPEN * accuracy:
            raise KernelError(
                f"the integrals over a face do not settle: after halving its spans {DEEPEST} "
                f"times, {gaps[~right].sum():.2g} of them is left open"
            )
        done.append(_gauss(panels, _ORDERS[-1]))
        nodes, weights = (np.concatenate([rule[k] for rule in done]) for k in (0, 1))
        order = np.argsort(nodes)
        limits = np.sort(np.concatenate((*starts, panels[:, 0], limits[-1:])))
        return nodes[order], weights[order], limits

    def _panel_sums(
        self, direction: int, panels: Array, lines: Array, orders: Sequence[int]
    ) -> list[Array]:
        """Return the integrands of `FLUX` along each line over each panel, (panels, lines, 5)."""
        rules = [_gauss(panels, order) for order in orders]
        nodes = np.concatenate([rule[0] for rule in rules])
        order = np.argsort(nodes)
        if direction == 0:
            points, normals = self._jet(nodes[order], lines)
        else:
            points, normals = (x.transpose(1, 0, 2) for x in self._jet(lines, nodes[order]))
        values = np.empty((len(nodes), len(lines), 5))
        values[order, :, 0] = np.einsum("ijk,ijk->ij", points, normals)
        values[order, :, 1] = np.sqrt(np.einsum("ijk,ijk->ij", normals, normals))
        values[order, :, 2:] = points**2 * normals
        sums, start = [], 0
        for rule, count in zip(rules, orders, strict=True):
            end = start + len(rule[0])
            part = values[start:end] * rule[1][:, None, None]
            sums.append(part.reshape(len(panels), count, len(lines), 5).sum(axis=1))
            start = end
        return sums

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
        return self._jet(
            *(np.clip(x, k[0], k[-1]) for x, k in zip((s, t), self.knots, strict=True))
        )

    def _jet(self, s: Array, t: Array) -> tuple[Array, Array]:
        """Return points and outward normals (of the parameters' own length) on a grid."""
        (a, slope_a), (b, slope_b) = (
            _bases(x, k, n) for x, k, n in zip((s, t), self.knots, self.degrees, strict=True)
        )
        point, ds, dt = project(
            _tensor(a, self.poles, b),
            _tensor(slope_a, self._nets[0], b),
            _tensor(a, self._nets[1], slope_b),
        )
        return point, self.sign * cross(ds, dt)


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


def _gauss(panels: Array, order: int) -> tuple[Array, Array]:
    """Return the nodes and weights of a Gauss rule on every panel (n, 2), panel by panel."""
    x, weight = legendre(order)
    half = (panels[:, 1] - panels[:, 0])[:, None] / 2
    return (panels.mean(axis=1)[:, None] + half * x).ravel(), (half * weight).ravel()


@lru_cache(maxsize=64)
def legendre(order: int) -> tuple[Array, Array]:
    """Return the nodes and weights of a Gauss rule on [-1, 1], read-only."""
    x, weight = np.polynomial.legendre.leggauss(order)
    x.flags.writeable = weight.flags.writeable = False
    return x, weight


def _bases(t: Array, knots: Array, degree: int) -> list[Array | SparseRows]:
    """Return the values at t of all basis functions, and of those of the derivative's poles.

    Sparse where there are many.
    """
    return _known_bases(t.tobytes(), knots.tobytes(), degree)


@lru_cache(maxsize=8)  # both sides of a wall have their knots in common
def _known_bases(places: bytes, knots: bytes, degree: int) -> list[Array | SparseRows]:
    tables = basis_matrices(np.frombuffer(knots), degree, np.frombuffer(places))
    return [table.toarray() if table.shape[1] <= DENSE else table for table in tables]


def differences(poles: Array, knots: Array, degree: int, axis: int) -> Array:
    """Return the poles of the derivative along one axis."""
    n = poles.shape[axis]
    scale = degree / (knots[degree + 1 : degree + n] - knots[1:n])
    return np.diff(poles, axis=axis) * (scale[:, None, None] if axis == 0 else scale[:, None])


def _times(table: Array | SparseRows, flat: Array) -> Array:
    return product(table, flat) if isinstance(table, np.ndarray) else table @ flat


def _tensor(a: Array | SparseRows, poles: Array, b: Array | SparseRows) -> Array:
    """Return the values (len(a), len(b), k) of Σ a_i b_j P_ij."""
    n, m, k = poles.shape
    rows = _times(a, poles.reshape(n, -1)).reshape(-1, m, k).transpose(1, 0, 2)
    values = _times(b, rows.reshape(m, -1)).reshape(b.shape[0], -1, k)
    return np.ascontiguousarray(values.transpose(1, 0, 2))
