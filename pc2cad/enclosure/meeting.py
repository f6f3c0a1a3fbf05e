"""A proved upper bound of how far an edge is from its two faces, and from where they meet.

The edge C(t) was made by a Boolean, with a curve p(t) in the parameters of each surface S. Between
breaks C(t) - S(p(t)) is a polynomial (times a weight, where something is rational), because one of
a polynomial is one; sines and cosines of angles that turn by `TURN` at most are within rounding of
polynomials of degree `ORDER`. A polynomial of degree D is at most 1/cos(πD/2N) times its largest
value at N + 1 Chebyshev-Lobatto places (see `between`), for vectors too.

Where two surfaces at the distances d and e from a point meet at an angle α, they meet at most
√(d² + e² + 2de|cos α|)/sin α away from it, if they were planes. They bend: within a distance r a
surface of curvature κ stays within κr² of its tangent plane, and turns by 2κr at most, if κr is
1/16 at most. That the surfaces of the equations, which are within their faces' deviations of S,
meet there too follows from Brouwer's fixed-point theorem; it needs no derivatives of theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pc2cad.enclosure.cells import Cells, conversion_loss, enlargement, to_bernstein
from pc2cad.enclosure.models import UNIT
from pc2cad.geometry.functions import (
    EdgeFunction,
    Trace,
    crossings,
    cuts_between,
)

Array = NDArray[np.float64]

#: angles turn by this much either way within a cell; sines and cosines are off their Taylor
#: polynomials by TURN^(ORDER + 1)/(ORDER + 1)! = 2e-18 then
TURN, ORDER = 0.25, 12
#: places per degree and cell: what is seen at them is enlarged by 1.16
PER_DEGREE = 3
#: share of what is seen that a cell which straddles a break of a surface may cost
SPILLED = 0.05
#: cells are halved for that as long as it leaves no more than this of it
HELPFUL = 0.7
#: within κr no larger than this the curvature κ says how far a surface bends within r
STRAIGHT = 1 / 16


@dataclass(frozen=True)
class Meeting:
    """How far an edge is from its two surfaces and from where they meet (lengths)."""

    #: bounds of the distances from the surfaces at equal parameters; inf where there is none
    off: tuple[float, float]
    #: bound of the distance from the places common to both faces of the equations; inf where there
    #: is none
    largest: float
    #: largest distances seen: from a surface, and from where the two meet (by first order)
    off_seen: float
    seen: float
    #: where no bound could be had: ranges of the edge's parameter
    open: tuple[tuple[float, float], ...] = ()


def bound_meeting(edge: EdgeFunction, deviations: tuple[float, float]) -> Meeting:
    """Bound how far an edge is from its faces.

    `deviations` bound how far the equations are from the two surfaces at equal parameters.
    """
    with np.errstate(all="ignore"):
        survey = _settled(edge)
        off = [survey.off(k) for k in (0, 1)]
        largest = survey.meeting(off, deviations)
    lost = ~np.isfinite(largest)
    points = survey.cells.points
    runs = np.flatnonzero(np.diff(np.concatenate(([False], lost, [False])).astype(int)))
    return Meeting(
        (float(off[0].max()), float(off[1].max())),
        float(np.inf if lost.any() else largest.max()),
        *survey.seen,
        tuple((float(points[i]), float(points[j])) for i, j in runs.reshape(-1, 2)),
    )


def _settled(edge: EdgeFunction) -> _Survey:
    """Return a survey on cells in which no angle turns far and no break of a surface costs much."""
    span = edge.span
    cuts = cuts_between(span, edge.curve.breaks, *(trace.path.breaks for trace in edge.traces))
    met = [
        crossings(trace.path, cuts, axis, breaks)
        for trace in edge.traces
        for axis, breaks in enumerate(trace.surface.breaks)
        if breaks is not None and len(breaks) > 2
    ]
    survey = _Survey(edge, cuts_between(span, cuts, *met))
    while survey.far.any():
        survey = _Survey(edge, survey.cells.split(survey.far).points)
    while survey.spilling.max() > 1:
        finer = _Survey(edge, survey.cells.split(survey.spilling > 1).points)
        if finer.spilling.max() > HELPFUL * survey.spilling.max():
            break
        survey = finer
    return survey


def _order(degree: int, breaks: Array | None) -> int:
    return ORDER if breaks is None else degree


class _Survey:
    """An edge on cells of its parameter, at the nodes of each."""

    def __init__(self, edge: EdgeFunction, points: Array) -> None:
        self._edge, self._curve = edge, edge.curve
        self._degree = max(self._degree_with(trace) for trace in edge.traces)
        self.cells = Cells(points, PER_DEGREE * self._degree)

    def _degree_with(self, trace: Trace) -> int:
        """Return the degree of the difference, times its weight, from one surface."""
        curve, path, surface = self._curve, trace.path, trace.surface
        own = _order(curve.degree, curve.breaks)
        degrees = zip(surface.degrees, surface.breaks, strict=True)
        other = _order(path.degree, path.breaks) * sum(_order(*d) for d in degrees)
        rational = curve.weight is not None or surface.weight is not None
        return own + other if rational else max(own, other)

    @cached_property
    def hulls(self) -> list[tuple[Array, Array]]:
        """Boxes that hold the curves in the parameter planes, (cells, 2) each."""
        found = []
        for trace in self._edge.traces:
            degree = _order(trace.path.degree, trace.path.breaks)
            cells = Cells(self.cells.points, degree)
            places = trace.path.jet(cells.nodes(0, cells.count))[0]
            net = np.einsum("ij,cjk->cik", to_bernstein(degree), _by_cell(places, cells))
            loss = (conversion_loss(degree, 0) + 8 * (degree + 2) * UNIT) * np.abs(places).max()
            found.append((net.min(axis=1) - loss, net.max(axis=1) + loss))
        return found

    @cached_property
    def far(self) -> NDArray[np.bool_]:
        """Cells in which an angle turns by more than `TURN` either way."""
        far = np.zeros(self.cells.count, dtype=bool)
        angular = [self._curve.breaks is None]
        angular += [trace.path.breaks is None for trace in self._edge.traces]
        if any(angular):
            far |= self.cells.half > TURN
        for trace, (low, high) in zip(self._edge.traces, self.hulls, strict=True):
            for axis, breaks in enumerate(trace.surface.breaks):
                if breaks is None:
                    far |= high[:, axis] - low[:, axis] > 2 * TURN
        return far

    @cached_property
    def spilling(self) -> Array:
        """What breaks of a surface inside cells cost, as a share of what they may."""
        return np.asarray(np.max([
            spill / max(SPILLED * sizes.max(), rounding)
            for spill, sizes, rounding in zip(self._spill, self._sizes, self._rounding, strict=True)
        ], axis=0))  # fmt: skip

    @cached_property
    def _spill(self) -> list[Array]:
        """What may be missing where a path leaves the piece of its surface that its middle is on.

        Both pieces meet at the break, and neither changes faster than its derivative.
        """
        found = []
        for trace, (low, high) in zip(self._edge.traces, self.hulls, strict=True):
            slopes, spill = trace.surface.sizes().first, np.zeros(self.cells.count)
            for axis, breaks in enumerate(trace.surface.breaks):
                if breaks is not None and len(breaks):
                    below, above = low[:, axis], high[:, axis]
                    index = np.searchsorted(breaks, (below + above) / 2, side="right") - 1
                    index = np.clip(index, 0, len(breaks) - 2)
                    over = np.maximum(breaks[index] - below, above - breaks[index + 1])
                    spill += 2.01 * slopes[axis] * np.maximum(over, 0.0)
            found.append(spill)
        return found

    # -- at the nodes ------------------------------------------------------------------------------

    @cached_property
    def _nodes(self) -> Array:
        return self.cells.nodes(0, self.cells.count)

    @cached_property
    def _at(self) -> tuple[Array, Array]:
        """The edge's points and derivatives."""
        return self._curve.jet(self._nodes)

    @cached_property
    def _paths(self) -> list[tuple[Array, Array]]:
        return [trace.path.jet(self._nodes) for trace in self._edge.traces]

    @cached_property
    def _jets(self) -> list[tuple[Array, Array, Array]]:
        """Points and derivatives of both surfaces."""
        return [
            trace.surface.jet(place[:, 0], place[:, 1])
            for trace, (place, _) in zip(self._edge.traces, self._paths, strict=True)
        ]

    @cached_property
    def _gaps(self) -> list[Array]:
        return [self._at[0] - jet[0] for jet in self._jets]

    @cached_property
    def _sizes(self) -> list[Array]:
        return [_lengths(gap) for gap in self._gaps]

    @cached_property
    def _rounding(self) -> list[float]:
        """Bounds of the rounding of the differences, that of the parameters included.

        Sums of products without cancellation: some 8 roundings per degree; a parameter is off by 4
        units, and moves with the derivatives (twice those at the nodes are more than any).
        """
        found, (points, speed) = [], self._at
        for trace, jet, (place, motion) in zip(
            self._edge.traces, self._jets, self._paths, strict=True
        ):
            path, degrees = trace.path, (self._curve.degree, *trace.surface.degrees)
            poles = self._curve.sizes().poles, trace.surface.sizes().poles
            size = max(*poles, _lengths(points).max(), _lengths(jet[0]).max())
            slopes = np.array([_lengths(slope).max() for slope in jet[1:]])
            moved = 8 * (path.degree + 2) * max(path.sizes().poles, np.abs(place).max())
            drift = 8 * np.abs(self._nodes).max() * (
                _lengths(speed).max() + np.abs(motion).max(axis=0) @ slopes
            )  # fmt: skip
            total = 16 * (sum(degrees) + 8) * size + 2 * moved * slopes.sum() + drift
            found.append(float(UNIT * total))
        return found

    @cached_property
    def seen(self) -> tuple[float, float]:
        """The largest distances at the nodes: from a surface, and from where both meet."""
        return float(max(size.max() for size in self._sizes)), float(self._seen_at.max())

    @cached_property
    def _seen_at(self) -> Array:
        f, g = (
            np.einsum("ni,ni->n", normal, gap)
            for normal, gap in zip(self._normals, self._gaps, strict=True)
        )
        return _apart(f, g, *self._angle)

    # -- bounds ------------------------------------------------------------------------------------

    def off(self, k: int) -> Array:
        """Return bounds of the distance from one surface, cell by cell."""
        return self._bounded(k, self._sizes[k])

    def _bounded(self, k: int, sizes: Array) -> Array:
        """Return bounds over cells of a difference from one surface, from its sizes at the nodes.

        It may be the difference's part along a vector that does not change within a cell.
        """
        seen, factor = sizes + self._rounding[k], enlargement(PER_DEGREE)
        if sizes.ndim == 1:
            seen = _by_cell(seen, self.cells)
        weight = self._weight(k)
        if weight is None:
            return np.asarray(seen.max(axis=1) * factor + self._spill[k])
        weights = _by_cell(weight, self.cells)
        least, most = weights.min(axis=1), weights.max(axis=1)
        least = (least + most) / 2 - factor * (most - least) / 2
        found = (seen * weights).max(axis=1) * factor / least
        return np.where(least > 0, found + self._spill[k], np.inf)

    def _weight(self, k: int) -> Array | None:
        """Return what makes the difference a polynomial; None where it is one."""
        trace, (place, _) = self._edge.traces[k], self._paths[k]
        found = [] if self._curve.weight is None else [self._curve.weight(self._nodes)]
        if trace.surface.weight is not None:
            found.append(trace.surface.weight(place[:, 0], place[:, 1]))
        return np.prod(found, axis=0) if found else None

    @cached_property
    def _normals(self) -> list[Array]:
        crossed = [np.cross(jet[1], jet[2]) for jet in self._jets]
        return [normal / _lengths(normal)[:, None] for normal in crossed]

    @cached_property
    def _angle(self) -> tuple[Array, Array]:
        """Cosine and sine of the angle between the surfaces."""
        n, m = self._normals
        return np.einsum("ni,ni->n", n, m), _lengths(np.cross(n, m))

    def _curvature(self, k: int) -> Array:
        """Return bounds of the curvature of a surface near the nodes."""
        surface, (_, a, b) = self._edge.traces[k].surface, self._jets[k]
        aa, ab, bb = surface.sizes().second
        la, lb = _lengths(a), _lengths(b)
        skew = np.abs(np.einsum("ni,ni->n", a, b)) / (la * lb)
        second = np.stack(np.broadcast_arrays(
            (la if surface.turns else aa) / la**2, (lb if surface.turns else ab) / (la * lb),
            bb / lb**2,
        ))  # fmt: skip
        squares = second[0] ** 2 + 2 * second[1] ** 2 + second[2] ** 2
        return np.asarray(np.sqrt(squares) / (1 - skew))

    def _across(self, k: int, off: Array, turned: Array) -> Array:
        """Return bounds of the distance from one surface's tangent plane, cell by cell.

        Normals are `turned` at most from the nearest node's. Those of a cell differ from the one in
        its middle, along which the difference is bounded as a whole.
        """
        normals = _by_cell(self._normals[k], self.cells)
        middle = normals[:, normals.shape[1] // 2]
        sizes = np.abs(np.einsum("cni,ci->cn", _by_cell(self._gaps[k], self.cells), middle))
        change = _lengths(normals - middle[:, None]).max(axis=1) + turned
        return np.asarray(np.minimum(self._bounded(k, sizes) + change * off, off))

    def meeting(self, off: Sequence[Array], deviations: tuple[float, float]) -> Array:
        """Return bounds of the distance from where the equations meet, cell by cell."""
        cells = self.cells
        steps = np.diff(_by_cell(self._nodes, cells), axis=1).max(axis=1) / 2
        # a place between two nodes, and its points on the surfaces, are no further from one
        steps = self._curve.sizes().first[0] * steps
        bends = [_by_cell(self._curvature(k), cells).max(axis=1) for k in (0, 1)]
        ways = [steps + 2 * d for d in off]
        turned = [2 * bend * way for bend, way in zip(bends, ways, strict=True)]
        sine = (_by_cell(self._angle[1], cells).min(axis=1) - sum(turned)) * (1 - 1e-12)
        total = sum(off) + sum(deviations)
        reach = 2 * total / sine
        bows = [bend * reach**2 for bend in bends]
        first, second = (
            self._across(k, off[k], turned[k]) + deviations[k] + bows[k] for k in (0, 1)
        )
        found = _apart(first, -second, np.sqrt(np.maximum(1 - sine**2, 0.0)), sine)
        right = (sine > 0) & (4 * (bows[0] + bows[1]) <= total)
        for bend, way in zip(bends, ways, strict=True):
            right &= bend * (reach + way) <= STRAIGHT
        return np.asarray(np.where(right, found * (1 + 1e-12), np.inf))


def _apart(f: Array, g: Array, cosine: Array, sine: Array) -> Array:
    """Return how far from a point two planes meet that are f and g away, on the sides of it."""
    return np.asarray(np.sqrt(np.maximum(f * f + g * g - 2 * f * g * cosine, 0.0)) / sine)


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))


def _by_cell(values: Array, cells: Cells) -> Array:
    """Return values at the nodes of all cells cell by cell: neighbours share one."""
    index = cells.degree * np.arange(cells.count)[:, None] + np.arange(cells.degree + 1)
    return np.asarray(values[index])
