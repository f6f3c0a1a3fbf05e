"""Integrals over plane faces: Green's theorem along their edges as curves in space."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepTools import BRepTools_WireExplorer
from OCP.Geom import (
    Geom_BSplineCurve,
    Geom_Circle,
    Geom_Curve,
    Geom_Ellipse,
    Geom_Line,
    Geom_Plane,
)
from OCP.TopAbs import TopAbs_REVERSED, TopAbs_WIRE
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Face

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import cross, product
from pc2cad.brep.from_kernel import conic_terms, curve_function, frame
from pc2cad.brep.gauss_rules import between, gauss_on, nodes_between, rules_together
from pc2cad.brep.kernel import as_wire
from pc2cad.brep.settling import ORDERS, settled
from pc2cad.brep.spline_integrals import differences, read_curve
from pc2cad.brep.spline_tables import bases, times
from pc2cad.brep.trimmed_integrals import ACCURACY, ENOUGH, STEP
from pc2cad.geometry.jets import cuts_between
from pc2cad.geometry.splines.turns import turns_of

#: places of a piece of a curve at which it is looked how far it turns
LOOKS = 9

#: of what power of lengths each of the integrals is, per length
_POWERS = (1, 2, 2, 3, 3, 3)

#: a curve in a plane, its first and its last parameter, and -1 where it is run through backwards
PlaneEdge = tuple[Geom_Curve, float, float, float]


def plane_integrals(faces: Sequence[tuple[Geom_Plane, TopoDS_Face]], origin: Array) -> list[Array]:
    """Return flux, area and moments of plane faces by the normals of their planes, from `origin`.

    Raises KernelError where the integrals do not settle.
    """
    places = [frame(plane.Position(), origin) for plane, _ in faces]
    regions = [
        (list(_edges_of(face)), origin + base, axes[:2])
        for (_, face), (base, axes) in zip(faces, places, strict=True)
    ]
    rows = []
    for (_, face), (base, axes), moments in zip(faces, places, _moments(regions), strict=True):
        # the walk runs round the face's own orientation: take it back to the plane's
        area, p, q, pp, pq, qq = -moments if face.Orientation() == TopAbs_REVERSED else moments
        x, y, _ = axes
        normal = cross(x, y)
        second = (
            base * base * area + 2 * base * (x * p + y * q) + x * x * pp + 2 * x * y * pq
            + y * y * qq
        )  # fmt: skip
        rows.append(np.concatenate(([area * (base @ normal), abs(area)], second * normal)))
    return rows


def _edges_of(face: TopoDS_Face) -> Iterator[PlaneEdge]:
    """Yield the edges of a face, wire by wire."""
    explorer = TopExp_Explorer(face, TopAbs_WIRE)
    while explorer.More():
        wire = BRepTools_WireExplorer(as_wire(explorer.Current()), face)
        while wire.More():
            edge = wire.Current()
            first, last = BRep_Tool.Range_s(edge)
            sign = -1.0 if edge.Orientation() == TopAbs_REVERSED else 1.0
            yield BRep_Tool.Curve_s(edge, first, last), first, last, sign
            wire.Next()
        explorer.Next()


def _moments(regions: Sequence[tuple[list[PlaneEdge], Array, Array]]) -> Array:
    """Return ∮ of 1, p, q, p², pq, q² as line integrals along curves: ∮ (∫ f dp) dq, (n, 6).

    Of each region its edges, a place, and the two axes (2, 3) from there along which p and q are
    coordinates. Arcs of a region are taken together, and splines of all that have the same knots.
    """
    total = np.zeros((len(regions), 6))
    splines: list[_PlaneSpline] = []
    for i, (edges, origin, axes) in enumerate(regions):
        arcs: list[PlaneEdge] = []
        corners: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
        for curve, first, last, sign in edges:
            if isinstance(curve, Geom_Line):
                ends = [curve.Value(t).Coord() for t in (first, last)]
                corners.append((ends[0], ends[1]) if sign > 0 else (ends[1], ends[0]))
            elif isinstance(curve, Geom_Circle | Geom_Ellipse):
                pieces = max(1, int(np.ceil((last - first) / STEP)))
                arcs += [
                    (curve, *ends, sign) for ends in pairwise(np.linspace(first, last, pieces + 1))
                ]
            elif isinstance(curve, Geom_BSplineCurve):
                data = read_curve(curve, origin)
                poles = np.concatenate((data.poles[:, :3] @ axes.T, data.poles[:, 3:]), axis=1)
                edge = curve, first, last, sign
                splines.append(_PlaneSpline(i, edge, data.knots, data.degree, poles))
            else:
                total[i] += sign * _along_curve(curve, first, last, origin, axes)
        if corners:
            total[i] += _along_lines(((np.array(corners) - origin) @ axes.T).tolist())
        if arcs:
            total[i] += _along_arcs(arcs, origin, axes)
    groups: dict[object, list[_PlaneSpline]] = {}
    for spline in splines:
        groups.setdefault(spline.key, []).append(spline)
    for group in groups.values():
        found = _along_splines(group)
        for k, spline in enumerate(group):
            curve, first, last, sign = spline.edge
            _, origin, axes = regions[spline.region]
            total[spline.region] += sign * (
                _along_curve(curve, first, last, origin, axes) if found is None else found[:, k]
            )
    return total


@dataclass(frozen=True, eq=False)
class _PlaneSpline:
    """A spline in the plane of a region: flat knots, and poles (n, 2), or homogeneous (n, 3)."""

    region: int
    edge: PlaneEdge
    knots: Array
    degree: int
    poles: Array

    @property
    def key(self) -> object:
        """What those that are integrated together have in common."""
        return self.edge[1:3], self.knots.tobytes(), self.degree, self.poles.shape[1]


def _along_splines(group: Sequence[_PlaneSpline]) -> Array | None:
    """Return the integrals of `_moments` along splines (w) of one key, (6, w).

    Those of polynomials are exact but for rounding; None where others need more nodes.
    """
    first, last = group[0].edge[1:3]
    knots, degree = group[0].knots, group[0].degree
    # coordinate by coordinate, and the weights
    poles = np.stack([spline.poles for spline in group], axis=2)
    net = differences(poles, knots, degree, 0)

    def jet(t: Array) -> tuple[Array, Array]:
        # places and slopes (2, w, n)
        (point, slope) = (
            times(table, rows.reshape(len(rows), -1)).T.reshape(*rows.shape[1:], -1)
            for table, rows in zip(bases(t, knots, degree), (poles, net), strict=True)
        )
        if len(point) == 2:
            return point, slope
        weight = point[2:]
        place = point[:2] / weight
        return place, (slope[:2] - place * slope[2:]) / weight

    cuts = cuts_between((first, last), knots)
    if poles.shape[1] == 2:
        t, weights = gauss_on(cuts, 2 * degree)
        (p, q), (_, rise) = jet(t)
        return product(_primitives(p, q) * rise, weights)
    places, slopes = jet(np.linspace(cuts[:-1], cuts[1:], LOOKS, axis=1).ravel())
    reach, speed = (np.abs(x).max(axis=(0, 2)) for x in (places, slopes))
    steps = np.stack((*slopes, np.zeros_like(slopes[0])), axis=-1)
    turns = turns_of(steps.reshape(len(group), -1, LOOKS, 3)).max(axis=0)
    cuts = _short_pieces(cuts, turns)
    worth = (last - first) * speed * np.array([reach**k for k in _POWERS]) + np.finfo(float).tiny
    x, rules = rules_together(ORDERS[1:])
    half = np.diff(cuts)[:, None] / 2
    (p, q), (_, rise) = jet(((cuts[:-1] + cuts[1:])[:, None] / 2 + half * x).ravel())
    values = (_primitives(p, q) * rise).reshape(6, len(group), len(half), -1)
    few, many = (product(values, row) * half[:, 0] for row in rules)
    return many.sum(axis=2) if (np.abs(few - many).max(axis=2) <= ACCURACY * worth).all() else None


def _along_lines(lines: Iterable[tuple[tuple[float, float], tuple[float, float]]]) -> Array:
    """Return the sums along lines from one place to another: in closed form, few by few."""
    total = [0.0] * 6
    for (p, q), (x, y) in lines:
        squares, both = p * p + p * x + x * x, 2 * p * x
        parts = (
            6 * (p + x), 2 * squares, 2 * (p * (2 * q + y) + x * (q + 2 * y)),
            (p + x) * (p * p + x * x),
            (q * (3 * p * p + both + x * x) + y * (p * p + both + 3 * x * x)) / 2,
            p * (3 * q * q + 2 * q * y + y * y) + x * (q * q + 2 * q * y + 3 * y * y),
        )  # fmt: skip
        rise = (y - q) / 12
        total = [known + rise * part for known, part in zip(total, parts, strict=True)]
    return np.array(total)


def _along_arcs(edges: list[PlaneEdge], origin: Array, axes: Array) -> Array:
    """Return the sums along arcs of circles and ellipses."""
    t, weights = nodes_between(np.array([edge[1:3] for edge in edges]), ENOUGH)
    weights = weights * np.array([edge[3:] for edge in edges])
    terms = [conic_terms(curve, origin) for curve, *_ in edges]
    # one row per edge, and one vector in the plane for each function of t
    flat = np.array([(start, *along.values()) for start, along in terms]) @ axes.T
    cos, sin = np.cos(t), np.sin(t)
    p, q = np.einsum("fkn,kfc->ckn", np.array([np.ones_like(t), cos, sin]), flat)
    slope = np.einsum("fkn,kf->kn", np.array([-sin, cos]), flat[:, 1:, 1])
    return np.asarray((_primitives(p, q) * (slope * weights)).sum(axis=(1, 2)))


def _primitives(p: Array, q: Array) -> Array:
    """Return the integrals over p of 1, p, q, p², pq, q², (6, ...)."""
    pp, pq = p * p, p * q
    return np.array([p, pp / 2, pq, pp * p / 3, pp * q / 2, pq * q])


def _along_curve(curve: Geom_Curve, first: float, last: float, origin: Array, axes: Array) -> Array:
    """Return the integrals of `_moments` along one curve, (6,)."""
    basis = curve_function(curve, origin)
    cuts = cuts_between((first, last), basis.breaks)
    point, slope = basis.jet(np.linspace(cuts[:-1], cuts[1:], LOOKS, axis=1).ravel())
    reach, speed = (float(np.abs(x @ axes.T).max()) for x in (point, slope))
    cuts = _short_pieces(cuts, turns_of(slope.reshape(-1, LOOKS, 3)))
    cells = np.stack((cuts[:-1], cuts[1:]), axis=1)
    worth = (last - first) * speed * reach ** np.array(_POWERS) + np.finfo(float).tiny

    def rules(cells: Array, orders: tuple[int, ...]) -> list[Array]:
        x, weights = rules_together(orders)
        half = np.diff(cells) / 2
        t = between(cells, x)
        points, slopes = basis.jet(t.ravel())
        values = _primitives(*(points @ axes.T).T) * (slopes @ axes[1])
        values = values.reshape(6, *t.shape)
        return [(product(values, row) * half[:, 0]).T for row in weights]

    # the higher two orders in one go, which is hardly dearer than one alone
    few, many = rules(cells, ORDERS[1:])
    if (np.abs(few - many) / worth).max() <= ACCURACY:
        return np.asarray(many.sum(axis=0))
    return settled(lambda *cut: rules(*cut)[0], cells, 1, ACCURACY, lambda _: worth)


def _short_pieces(cuts: Array, turns: Array) -> Array:
    """Return cuts of a curve, and more where it turns by more than `STEP` between two."""
    pieces = np.maximum(np.ceil(turns / STEP - 1e-9), 1).astype(int).tolist()
    return distinct(np.concatenate(
        [np.linspace(*ends, count + 1) for ends, count in zip(pairwise(cuts), pieces, strict=True)]
    ))  # fmt: skip
