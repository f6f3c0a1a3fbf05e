"""Sheets: faces as grids of Bézier patches that join along edges, with what each side is.

A sheet is what is known of a face for a comparison of all faces with one another: points as control
nets, whose convex hulls hold their patches, and names of edges and vertices that tell where two
faces are meant to meet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import comb

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import lengths
from pc2cad.geometry.carriers import Plane, SplineCurve, SplineSurface
from pc2cad.geometry.splines.turns import turns_of

#: arcs of conics are no longer than this (radians): patches of longer ones are halved mostly
LONGEST_ARC = np.pi / 5
#: patches of a spline turn by no more, on average (radians): they are near to their control points
LONGEST_TURN = 0.9
#: nor are they farther from straight than this share of their width, as boxes round them hold fewer
#: others then; and how many parts at most a piece is cut in for that
MOST_BOW, MOST_STRAIGHT = 0.4, 4
#: what is beside a face where no solid is
OUTSIDE = -1


@dataclass(frozen=True, eq=False)
class Patches:
    """n × m rational Bézier patches of one degree, made of poles that neighbours may share.

    `poles` (N, M, 4) are points times their weight, and the weight. The patch i, j is made of the
    rows `index[0][i]` and the columns `index[1][j]`, which follow one another, by the matrices
    `matrices[0][i]` and `matrices[1][j]`, whose rows are means; None: of the poles as they are.
    Of a spline come the `knots`, too.
    """

    poles: Array
    index: tuple[Integers, Integers]
    matrices: tuple[Array, Array] | None = None
    knots: tuple[Array, Array] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Patches along s and t."""
        return len(self.index[0]), len(self.index[1])

    @property
    def making(self) -> tuple[int | bytes, ...]:
        """What patches share that are made alike: of as many poles, by one index and matrices."""
        index, matrices = self.index, self.matrices
        by = [x.tobytes() for x in index] if matrices is None else map(id, (*index, *matrices))
        return (*self.shape, *self.poles.shape, *by)

    @property
    def degrees(self) -> tuple[int, int]:
        """Degrees along s and t."""
        return self.index[0].shape[1] - 1, self.index[1].shape[1] - 1

    @cached_property
    def nets(self) -> Array:
        """Control points times their weight, and the weight, of all patches (n, m, p+1, q+1, 4)."""
        n, m = self.shape
        i, j = np.divmod(np.arange(n * m), m)
        found = self.take(i, j)
        return found.reshape(n, m, *found.shape[1:])

    def take(self, i: Integers, j: Integers) -> Array:
        """Return those of some patches (k, p+1, q+1, 4)."""
        rows, columns = self.index
        if self.matrices is None:
            return self.poles[rows[i][:, :, None], columns[j][:, None, :]]
        # what the patches of one row have in common is made once
        some, (along, across) = distinct(i), self.matrices
        lines = along[some] @ self.poles[rows[some]].reshape(len(some), rows.shape[1], -1)
        lines = lines.reshape(*lines.shape[:2], -1, 4).transpose(0, 2, 1, 3)
        lines = lines.reshape(*lines.shape[:2], -1)
        found = across[j] @ lines[np.searchsorted(some, i)[:, None], columns[j]]
        return found.reshape(*found.shape[:2], -1, 4).transpose(0, 2, 1, 3)

    def raised(self, degree: int) -> Patches:
        """Return the same patches with this degree along both."""
        matrices = []
        for axis, index in enumerate(self.index):
            known = None if self.matrices is None else self.matrices[axis]
            if known is None or index.shape[1] <= degree:
                matrix = elevation(index.shape[1] - 1, degree)
                shape = (len(index), *matrix.shape)
                known = np.broadcast_to(matrix, shape) if known is None else matrix @ known
            matrices.append(known)
        return Patches(self.poles, self.index, (matrices[0], matrices[1]), self.knots)


def patches_of(nets: Array) -> Patches:
    """Return a grid of patches with these control points, (n, m, p+1, q+1, 4)."""
    n, m, p, q, _ = nets.shape
    poles = nets.transpose(0, 2, 1, 3, 4).reshape(n * p, m * q, 4)
    return Patches(poles, (np.arange(n * p).reshape(n, p), np.arange(m * q).reshape(m, q)))


@dataclass(frozen=True, eq=False)
class SheetSide:
    """One side of a sheet: a part of the boundary complex, with a coordinate along it."""

    #: index of the edge class; None where the side is one point
    edge: int | None
    #: vertices at its lower and its upper end, along the sheet's own parameter
    ends: tuple[int, int]
    #: coordinate along the edge at the ends of the patches, one for all faces at the edge
    along: Array


@dataclass(frozen=True, eq=False)
class Sheet:
    """A face, or a patch of one, as n × m rational Bézier patches of one degree.

    `sides` are t = 0, s = 1, t = 1 and s = 0. `separable`: the weights are products of those along
    s and t, so that tangents along s are sums, with positive factors, of differences of points
    along s. A sheet in a `plane` may be any surface in that plane with the face's sides. `own`: its
    parameters run as the face's own do.
    """

    face: int
    #: the face of the boundary complex
    cell: int
    patches: Patches
    sides: tuple[SheetSide, SheetSide, SheetSide, SheetSide]
    separable: bool = True
    plane: Plane | None = None
    #: name of the face
    name: str = ""
    own: bool = True
    #: of a sheet in a plane: one number for the faces that make up one region there, -1 if alone
    region: int = -1
    #: what is on its two sides: numbers of solids, `OUTSIDE` where there is none
    beside: tuple[int, int] = (0, OUTSIDE)

    @property
    def shape(self) -> tuple[int, int]:
        """Patches along s and t."""
        return self.patches.shape

    def row(self, side: int) -> Array:
        """Return control points of the patches along one side, (k, d+1, 4), those on it."""
        n, m = self.shape
        last = {1: n - 1, 2: m - 1}.get(side, 0)
        if side % 2:
            i, j = np.full(m, last), np.arange(m)
        else:
            i, j = np.arange(n), np.full(n, last)
        nets = self.patches.take(i, j)
        return np.asarray((nets[:, :, 0], nets[:, -1], nets[:, :, -1], nets[:, 0])[side])


def projected(nets: Array) -> Array:
    """Return control points (…, 3) of nets (…, 4)."""
    points, weights = np.empty((*nets.shape[:-1], 3)), nets[..., 3]
    for axis in range(3):  # long rows at a time, not three numbers
        np.divide(nets[..., axis], weights, out=points[..., axis])
    return points


def points_of(grids: Sequence[Patches]) -> Array:
    """Return control points (3, q+1, p+1, grids, m, n) of grids that are made alike.

    By the index and the matrices of the first: coordinates come first and patches last, in long
    rows for what is asked of all of them.
    """
    (rows, columns), matrices = grids[0].index, grids[0].matrices
    poles = np.array([grid.poles for grid in grids])
    if matrices is None:
        nets = poles[:, rows[:, :, None, None], columns].transpose(5, 4, 2, 0, 3, 1)
    else:
        flat = poles.transpose(1, 0, 2, 3).reshape(poles.shape[1], -1)
        lines = (matrices[0] @ flat[rows]).reshape(*rows.shape, len(grids), -1, 4)
        lines = lines.transpose(3, 4, 1, 2, 0).reshape(poles.shape[2], -1)
        nets = (matrices[1] @ lines[columns]).reshape(*columns.shape, 4, -1, len(grids), len(rows))
        nets = nets.transpose(2, 1, 3, 4, 0, 5)
    points = np.empty((3, *nets.shape[1:]))
    np.divide(nets[:3], nets[3], out=points)
    return points


@lru_cache(maxsize=64)
def elevation(low: int, high: int) -> Array:
    """Return the matrix (high+1, low+1) from Bernstein coefficients of a degree to a higher one."""
    result = np.zeros((high + 1, low + 1))
    for i in range(high + 1):
        for j in range(max(0, i - high + low), min(low, i) + 1):
            result[i, j] = comb(low, j) * comb(high - low, i - j) / comb(high, i)
    result.flags.writeable = False
    return result


def elevated(nets: Array, degree: int, axis: int) -> Array:
    """Return nets raised to a degree along an axis."""
    if nets.shape[axis] == degree + 1:
        return nets
    matrix = elevation(nets.shape[axis] - 1, degree)
    return np.moveaxis(np.tensordot(matrix, nets, axes=(1, axis)), 0, axis)


def restriction(degree: int, low: Array, high: Array) -> Array:
    """Return matrices (N, d+1, d+1) that take coefficients on [0, 1] to those on [low, high].

    Entry (i, j) is the blossom's share of coefficient j at i times `high`, the rest `low`: sums of
    products of positive numbers for parts of [0, 1].
    """
    result = np.empty((len(low), degree + 1, degree + 1))
    for i in range(degree + 1):
        # coefficients of Π (1 - x_k + x_k z), x_k = high i times and low otherwise
        row = np.ones((len(low), 1))
        for k in range(degree):
            x = (high if k < i else low)[:, None]
            longer = np.zeros((len(low), k + 2))
            longer[:, :-1] = row * (1 - x)
            longer[:, 1:] += row * x
            row = longer
        result[:, i] = row
    return result


# -- pieces of curves ------------------------------------------------------------------------------


def circle_pieces(start: float, end: float) -> Array:
    """Return (cos, sin, weight) of the arcs of a unit circle, (k, 3, 3), none too long."""
    extent = end - start
    count = max(1, int(np.ceil(abs(extent) / LONGEST_ARC - 1e-9)))
    middle = start + extent * (np.arange(count) + 0.5) / count
    half = abs(extent) / count / 2
    ends = start + extent * np.arange(count + 1) / count
    corner = np.stack((np.cos(ends), np.sin(ends), np.ones(count + 1)), axis=-1)
    if abs(abs(extent) - 2 * np.pi) < 1e-12:
        corner[-1] = corner[0]
    shoulder = np.stack((np.cos(middle), np.sin(middle), np.full(count, np.cos(half))), axis=-1)
    return np.stack((corner[:-1], shoulder, corner[1:]), axis=1)


def spans(knots: Array) -> Array:
    """Return the ends of a spline's polynomial pieces."""
    return distinct(knots)


def surface_limits(surfaces: Sequence[SplineSurface]) -> list[tuple[Array, Array]]:
    """Return the ends of splines' pieces along s and t, so short that few turn far.

    Splines of the same knots, which may be the two sides of a wall, are cut alike.
    """
    keys = [(first.tobytes(), second.tobytes()) for first, second in (s.knots for s in surfaces)]
    groups: dict[tuple[object, ...], list[SplineSurface]] = {}
    for surface, key in zip(surfaces, keys, strict=True):
        groups.setdefault((key, surface.poles.shape), []).append(surface)
    parts: dict[bytes, int] = {}
    for group in groups.values():
        for knots, count in zip(group[0].knots, _parts(group), strict=True):
            parts[knots.tobytes()] = max(count, parts.get(knots.tobytes(), 1))
    cut = {key: _cut(spans(np.frombuffer(key)), count) for key, count in parts.items()}
    return [(cut[first], cut[second]) for first, second in keys]


def _parts(surfaces: Sequence[SplineSurface]) -> tuple[int, int]:
    """Return in how many parts pieces are cut along s and t, by what they are on average.

    Of several splines of the same knots as many as one of them is cut in.
    """
    poles = np.array([surface.poles for surface in surfaces])
    turns, sizes = [], []
    for axis, knots in enumerate(surfaces[0].knots):
        steps = np.diff(poles if axis else poles.transpose(0, 2, 1, 3), axis=2)
        count = len(spans(knots)) - 1
        turns.append(turns_of(steps).max(axis=1, initial=0.0) / count)
        sizes.append(lengths(steps).sum(axis=2).mean(axis=1) / count)
    first, second = (
        max(
            max(int(np.ceil(turn / LONGEST_TURN - 1e-9)), _straight_parts(turn * size / 8, width))
            for turn, size, width in zip(*(x.tolist() for x in row), strict=True)
        )
        for row in zip(turns, sizes, sizes[::-1], strict=True)
    )
    return first, second


def _straight_parts(bow: float, width: float) -> int:
    """Return how many parts of a piece with a bow are straight beside their width."""
    if bow <= MOST_BOW * width:
        return 1
    # of k parts each has a k²-th of the bow
    share = bow / (MOST_BOW * width) if width > 0 else np.inf
    return int(np.ceil(np.sqrt(min(share, MOST_STRAIGHT**2))))


def _cut(points: Array, parts: int) -> Array:
    """Return the ends of equal parts of pieces, so many of each."""
    inner = points[:-1, None] + np.diff(points)[:, None] * (np.arange(parts) / parts)
    return np.append(inner.ravel(), points[-1])


def _to_pieces(knots: Array, degree: int, points: Array) -> tuple[Integers, Array]:
    """Return the poles of pieces between points, its knots among them, (k, p+1).

    And matrices from those to Bernstein coefficients. Faces of one part have many knots in common.
    """
    return _pieces(knots.tobytes(), degree, points.tobytes())


@lru_cache(maxsize=16)
def _pieces(of_knots: bytes, degree: int, of_points: bytes) -> tuple[Integers, Array]:
    knots, points = np.frombuffer(of_knots), np.frombuffer(of_points)
    nodes = (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2
    places = (points[:-1, None] + np.diff(points)[:, None] * nodes).ravel()
    # the last place of a piece counts with it, and not with the next
    span = np.searchsorted(knots, (points[:-1] + points[1:]) / 2, side="right") - 1
    values = _on_span(knots, degree, places, np.repeat(span, degree + 1))
    i = np.arange(degree + 1)
    binomials = np.array([comb(degree, int(k)) for k in i], dtype=float)
    there = binomials * nodes[:, None] ** i * (1 - nodes[:, None]) ** (degree - i)
    local = values.reshape(-1, degree + 1, degree + 1)
    matrices = np.einsum("ij,kjn->kin", np.linalg.inv(there), local)
    return span[:, None] - degree + i, matrices


def _on_span(knots: Array, degree: int, t: Array, span: Integers) -> Array:
    """Return the values at t of the functions that live on some spans, (len(t), p+1)."""
    values = np.zeros((degree + 1, len(t)))
    values[0] = 1.0
    near = knots[span + np.arange(1 - degree, degree + 1)[:, None]]
    before, after = t - near[:degree], near[degree:] - t
    for r in range(1, degree + 1):
        share = values[:r] / (near[degree : degree + r] - near[degree - r : degree])
        values[:r] = after[:r] * share
        values[1 : r + 1] += before[degree - r :] * share
    return values.T


def curve_pieces(curve: SplineCurve) -> tuple[Array, Array]:
    """Return a spline's Bézier pieces (k, p+1, 4) and their ends (k+1,)."""
    weights = np.ones(len(curve.poles)) if curve.weights is None else curve.weights
    poles = np.concatenate((curve.poles * weights[:, None], weights[:, None]), axis=1)
    points = spans(curve.knots)
    index, matrices = _to_pieces(curve.knots, curve.degree, points)
    pieces = np.einsum("kij,kjc->kic", matrices, poles[index])
    return pieces, points


def surface_patches(surface: SplineSurface, limits: tuple[Array, Array] | None = None) -> Patches:
    """Return a spline's Bézier patches between limits along s and t, or between its knots alone.

    Its knots are among the limits.
    """
    if limits is None:
        limits = spans(surface.knots[0]), spans(surface.knots[1])
    weights = np.ones(surface.poles.shape[:2]) if surface.weights is None else surface.weights
    poles = np.concatenate((surface.poles * weights[..., None], weights[..., None]), axis=2)
    (first, one), (second, other) = (
        _to_pieces(knots, degree, points)
        for knots, degree, points in zip(surface.knots, surface.degrees, limits, strict=True)
    )
    return Patches(poles, (first, second), (one, other), surface.knots)
