"""A proved upper bound of how far an edge is from its two faces, and from where they meet.

The edge C(t) was made by a Boolean, with a curve p(t) in the parameters of each surface S. Between
breaks C(t) - S(p(t)) is a polynomial (times a weight, where something is rational), because one of
a polynomial is one; sines and cosines of angles that turn by `TURN` at most are within rounding of
polynomials of degree `ORDER`. Such a polynomial is bounded by its values at a few times as many
places as its degree (`cells.enlargement`).

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
from itertools import product

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.bounds.cells import Cells, conversion_loss, enlargement, to_bernstein, windows
from pc2cad.bounds.taylor_models import UNIT
from pc2cad.geometry.jets import EdgeFunction, Trace, crossings, cuts_between

#: angles turn by this much either way within a cell; sines and cosines are off their Taylor
#: polynomials by TURN^(ORDER + 1)/(ORDER + 1)! = 7e-19 then
TURN, ORDER = 0.5, 15
#: places per degree and cell: what is seen at them is enlarged by 1.035
PER_DEGREE = 6
#: share of a surface's piece by which a path may leave it within a cell: the piece's polynomial
#: changes as it does inside
OVER = 1e-5
#: halvings of cells for the sake of these, and cells beyond which none are (outside a surface: all)
DEEPEST, MOST_CELLS = 40, 4000
#: share of what is seen that leaving a piece may cost, and what halving cells has to leave of it at
#: most to go on
SPILLED, HELPFUL = 0.05, 0.7
#: cells are halved so often where the bound is above so many times what is seen
SHARPEST, SHARP = 2, 2.0
#: within κr no larger than this the curvature κ says how far a surface bends within r
STRAIGHT = 1 / 16


@dataclass(frozen=True)
class EdgeBound:
    """How far an edge is from its two surfaces and from where they meet (lengths)."""

    #: bounds of the distances from the surfaces at equal parameters; inf where there is none
    off: tuple[float, float]
    #: bound of the distance from the places common to both faces of the equations; inf where there
    #: is none
    largest: float
    #: largest distances seen: from a surface at equal parameters, from a surface's tangent plane
    #: there, and from where the two planes meet (inf or nan where they are parallel)
    off_seen: float
    across_seen: float
    seen: float
    #: where no bound could be had: ranges of the edge's parameter
    open: tuple[tuple[float, float], ...] = ()


def bound_edge(edge: EdgeFunction, deviations: tuple[float, float]) -> EdgeBound:
    """Bound how far an edge is from its faces.

    `deviations` bound how far the equations are from the two surfaces at equal parameters.
    """
    with np.errstate(all="ignore"):
        survey = _settled(edge)
        for sharper in range(SHARPEST + 1):
            off = [survey.off(k) for k in (0, 1)]
            largest = survey.meeting(off, deviations)
            seen = survey.seen
            goal = SHARP * max(seen[2], survey.given(deviations))
            blunt = np.isfinite(largest) & (largest > goal)
            if sharper == SHARPEST or not blunt.any():
                break
            survey = _Survey(edge, survey.cells.split(blunt).points)
    lost = np.concatenate(([False], ~np.isfinite(largest), [False]))
    ends = survey.cells.points[np.flatnonzero(lost[1:] != lost[:-1])].reshape(-1, 2)
    return EdgeBound(
        (float(off[0].max()), float(off[1].max())),
        float(largest.max()), *seen, tuple((first, last) for first, last in ends.tolist()),
    )  # fmt: skip


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
    for _ in range(DEEPEST):
        if not 0 < survey.coarse.sum() <= MOST_CELLS - survey.cells.count:
            break
        survey = _Survey(edge, survey.cells.split(survey.coarse).points)
    while survey.spilling.max() > 1 and survey.cells.count < MOST_CELLS:
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
            net = np.einsum("ij,cjk->cik", to_bernstein(degree), windows(places, 0, degree))
            loss = (conversion_loss(degree, 0) + 8 * (degree + 2) * UNIT) * np.abs(places).max()
            found.append((net.min(axis=1) - loss, net.max(axis=1) + loss))
        return found

    @cached_property
    def coarse(self) -> Booleans:
        """Cells in which an angle turns far, or a path leaves the piece that its middle is on."""
        traces = self._edge.traces
        angles = [self._curve.breaks, *(trace.path.breaks for trace in traces)]
        coarse = (self.cells.half > TURN) & any(breaks is None for breaks in angles)
        for trace, (low, high), over in zip(traces, self.hulls, self._over, strict=True):
            for axis, breaks in enumerate(trace.surface.breaks):
                far = high[:, axis] - low[:, axis] > 2 * TURN if breaks is None else False
                coarse |= far | (over[1][:, axis] > OVER)
        return np.asarray(coarse)

    @cached_property
    def _over(self) -> list[tuple[Array, Array]]:
        """How far paths leave the pieces of their surfaces, and as shares of these, (cells, 2)."""
        found = []
        for trace, (low, high) in zip(self._edge.traces, self.hulls, strict=True):
            over, share = np.zeros((2, *low.shape))
            for axis, breaks in enumerate(trace.surface.breaks):
                if breaks is not None and len(breaks):
                    below, above = low[:, axis], high[:, axis]
                    index = np.searchsorted(breaks, (below + above) / 2, side="right") - 1
                    index = np.clip(index, 0, len(breaks) - 2)
                    start, end = breaks[index], breaks[index + 1]
                    over[:, axis] = np.maximum(np.maximum(start - below, above - end), 0.0)
                    share[:, axis] = over[:, axis] / (end - start)
            found.append((over, share))
        return found

    @cached_property
    def _spill(self) -> list[Array]:
        """What may be missing where a path leaves a piece of its surface.

        The next one meets it at the break, and neither changes faster than its derivative: the
        least one of the cell, and what the second ones add to it across the cell.
        """
        found, cells = [], self.cells.degree
        for k, (low, high) in enumerate(self.hulls):
            sizes, over = self._edge.traces[k].surface.sizes(), self._over[k][0]
            aa, ab, bb = sizes.second
            least = [windows(_lengths(x), 0, cells).min(axis=1) for x in self._jets[k][1:]]
            slopes = np.transpose(least) + (high - low) @ np.array([[aa, ab], [ab, bb]])
            slopes = np.fmin(slopes + 8 * np.array(sizes.jumps), sizes.first)
            moved = np.where(over > 0, over * slopes, 0.0).sum(axis=1)
            found.append(np.where(self.coarse, np.inf, 2.01 * moved))
        return found

    @cached_property
    def spilling(self) -> Array:
        """What breaks of a surface inside cells cost, as a share of what they may."""
        return np.asarray(np.max([
            np.where(self.coarse, 0.0, spill) / max(SPILLED * sizes.max(), rounding)
            for spill, sizes, rounding in zip(self._spill, self._sizes, self._rounding, strict=True)
        ], axis=0))  # fmt: skip

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

        Sums take some 8 roundings per degree; a parameter is off by 4 units, and moves with the
        derivatives (twice those at the nodes are more than any).
        """
        found, (points, speed) = [], self._at
        for trace, jet, (place, motion) in zip(
            self._edge.traces, self._jets, self._paths, strict=True
        ):
            path, degrees = trace.path, (self._curve.degree, *trace.surface.degrees)
            size = _lengths(points).max() + _lengths(jet[0]).max()
            for held in (self._curve, trace.surface):
                size += float(_lengths(held.sizes().poles))
            slopes = np.array([_lengths(slope).max() for slope in jet[1:]])
            moved = (path.degree + 2) * (path.sizes().poles + np.abs(place).max(axis=0))
            drift = np.abs(self._nodes).max() * (
                _lengths(speed).max() + np.abs(motion).max(axis=0) @ slopes
            )  # fmt: skip
            total = 8 * (sum(degrees) + 8) * size + 16 * moved @ slopes + 8 * drift
            found.append(float(UNIT * total))
        return found

    @cached_property
    def seen(self) -> tuple[float, float, float]:
        """The largest distances at the nodes (see `EdgeBound`)."""
        f, g = np.einsum("kni,kni->kn", self._normals, self._gaps)
        found = (*self._sizes, np.maximum(np.abs(f), np.abs(g)), _apart(f, g, *self._angle))
        off, other, flat, apart = (float(x.max()) for x in found)
        return max(off, other), flat, apart

    def given(self, deviations: tuple[float, float]) -> float:
        """Return how far from where the surfaces meet deviations and rounding alone may be."""
        f, g = (d + SHARP * r for d, r in zip(deviations, self._rounding, strict=True))
        return float(_apart(f, -g, np.abs(self._angle[0]), self._angle[1]).max())

    # -- bounds ------------------------------------------------------------------------------------

    def off(self, k: int) -> Array:
        """Return bounds of the distance from one surface at equal parameters, cell by cell."""
        sizes, weight = self._sizes[k] + self._rounding[k], self._weight(k)
        least: Array | float = 1.0
        if weight is not None:
            sizes, least = sizes * weight, self._range(weight, PER_DEGREE)[0]
        found = enlargement(PER_DEGREE) * self._most(sizes) / least + self._spill[k]
        return np.asarray(np.where(least > 0, found, np.inf))

    def _heights(self, k: int, off: Array) -> tuple[Array, Array]:
        """Return the least and largest heights above one surface's tangent plane, cell by cell.

        The product with the normal S_a x S_b is a polynomial too, of three times the degree at
        most, and the square of its length one of four times. An edge that is slow or fast against
        its path is far off along the surface, and near it all the same.
        """
        if self._weight(k) is not None:
            return -off, off
        normals = self._crossed[k]
        square = (normals * normals).sum(axis=1)
        longest = [np.sqrt(np.maximum(x, 0.0)) for x in self._range(square, PER_DEGREE / 4)]
        products = np.einsum("ni,ni->n", normals, self._gaps[k])
        low, high = (
            np.stack([bound / length for length in longest])
            for bound in self._range(products, PER_DEGREE / 3)
        )
        # nodes beyond a break have the next piece's normal, which is turned a little
        turned = 4 * self._most(self._curvature(k)) * self._spill[k] + self._crease(k)
        extra = 1.5 * self._rounding[k] * longest[1] / longest[0] + self._spill[k] + turned * off
        return np.fmax(low.min(axis=0) - extra, -off), np.fmin(high.max(axis=0) + extra, off)

    def _most(self, values: Array) -> Array:
        """Return the largest values at nodes, cell by cell."""
        return np.asarray(windows(values, 0, self.cells.degree).max(axis=1))

    def _range(self, values: Array, per_degree: float) -> tuple[Array, Array]:
        """Return bounds of a polynomial from its values at nodes, cell by cell."""
        values = windows(values, 0, self.cells.degree)
        low, high = values.min(axis=1), values.max(axis=1)
        half = (enlargement(per_degree) * (high - low) + 1e-12 * np.abs(values).max(axis=1)) / 2
        return (low + high) / 2 - half, (low + high) / 2 + half

    def _weight(self, k: int) -> Array | None:
        """Return what makes the difference a polynomial; None where it is one."""
        trace, (place, _) = self._edge.traces[k], self._paths[k]
        found = [] if self._curve.weight is None else [self._curve.weight(self._nodes)]
        if trace.surface.weight is not None:
            found.append(trace.surface.weight(place[:, 0], place[:, 1]))
        return np.prod(found, axis=0) if found else None

    @cached_property
    def _crossed(self) -> list[Array]:
        """Normals of both surfaces, of the parameters' own length."""
        return [np.cross(jet[1], jet[2]) for jet in self._jets]

    @cached_property
    def _normals(self) -> list[Array]:
        return [normal / _lengths(normal)[:, None] for normal in self._crossed]

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
        second = np.stack(np.broadcast_arrays(
            (la if surface.turns else aa) / la**2, (lb if surface.turns else ab) / (la * lb),
            bb / lb**2,
        ))  # fmt: skip
        squares = second[0] ** 2 + 2 * second[1] ** 2 + second[2] ** 2
        return np.asarray(np.sqrt(squares) / (1 - self._skew(k)))

    def _crease(self, k: int) -> Array:
        """Return bounds of the angle by which a surface turns at once, cell by cell.

        Several may lie between two nodes; where they are rounding, they do not count.
        """
        jumps = self._edge.traces[k].surface.sizes().jumps
        turns = [jump / _lengths(x) for jump, x in zip(jumps, self._jets[k][1:], strict=True)]
        return self._most(8 * (turns[0] + turns[1]) / (1 - self._skew(k)))

    def _skew(self, k: int) -> Array:
        _, a, b = self._jets[k]
        return np.asarray(np.abs(np.einsum("ni,ni->n", a, b)) / (_lengths(a) * _lengths(b)))

    def meeting(self, off: Sequence[Array], deviations: tuple[float, float]) -> Array:
        """Return bounds of the distance from where the equations meet, cell by cell."""
        cells = self.cells
        steps = np.diff(windows(self._nodes, 0, cells.degree), axis=1).max(axis=1) / 2
        # a place between two nodes, and its points on the surfaces, are no further from one
        if self._curve.weight is None:
            steps *= enlargement(PER_DEGREE) * self._most(_lengths(self._at[1]))
        else:
            steps *= self._curve.sizes().first[0]
        bends = [self._most(self._curvature(k)) for k in (0, 1)]
        ways = [steps + 2 * d + spill for d, spill in zip(off, self._spill, strict=True)]
        creases = [self._crease(k) for k in (0, 1)]
        turned = [2 * b * way + c for b, way, c in zip(bends, ways, creases, strict=True)]
        sine = (windows(self._angle[1], 0, cells.degree).min(axis=1) - sum(turned)) * (1 - 1e-12)
        total = sum(off) + sum(deviations)
        reach = 2 * total / sine
        bows = [b * reach**2 + c * reach for b, c in zip(bends, creases, strict=True)]
        heights = [
            (low - deviations[k] - bows[k], high + deviations[k] + bows[k])
            for k, (low, high) in enumerate(self._heights(k, off[k]) for k in (0, 1))
        ]
        cosine = windows(self._angle[0], 0, cells.degree)
        cosines = cosine.min(axis=1) - sum(turned), cosine.max(axis=1) + sum(turned)
        # the square is convex in both heights, and linear in the cosine
        found = np.max([_apart(f, g, c, sine) for f, g, c in product(*heights, cosines)], axis=0)
        right = (sine > 0) & (4 * (bows[0] + bows[1]) <= total)
        for bend, way, crease in zip(bends, ways, creases, strict=True):
            right &= bend * (reach + way) + crease <= STRAIGHT
        return np.asarray(np.where(right, found * (1 + 1e-12), np.inf))


def _apart(f: Array | float, g: Array | float, cosine: Array, sine: Array) -> Array:
    """Return how far from a point two planes meet that are f and g away, on the sides of it."""
    return np.asarray(np.sqrt(np.maximum(f * f + g * g - 2 * f * g * cosine, 0.0)) / sine)


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))
