"""The limits of a channel: how far its section, its wall and its guide are from breaking the solid.

Input: a point equation that knows its guide. Output: Limits, each with the value at which the solid
would break. With q = M - N in the normal plane, det J = |N'|·(1 - κ q·n)·(the
section's own determinant), so that the first two are sharp; all values are found by search
(sampled), and each violation is a witness: the place is named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.equation.point_equation import PointEquation, over_unit_box
from pc2cad.errors import NotASolidError
from pc2cad.expression.breaks import find_breaks
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.evaluation import Program
from pc2cad.expression.linear_terms import cancel_terms
from pc2cad.expression.simplification import simplified
from pc2cad.expression.tree import Expr, substitute

#: a scalar over broadcastable places u, v, w
Field = Callable[[Array, Array, Array], Array]

#: places per smooth piece of a direction, at least and over the whole of it
PER_PIECE, PER_DIRECTION = 9, 96
#: rounds in which a smallest value is looked at more closely
ZOOMS = 5
#: largest cosine between M - N and the tangent that rounding can leave
PERPENDICULAR = 1e-7
#: samples of the guide in the search for strands that come near each other
MOST_STRANDS = 1200


class ChannelLimitError(NotASolidError):
    """A channel is beyond one of its limits; the message says which, where, and what would hold."""


@dataclass(frozen=True)
class Limit:
    """One limit of a channel: lengths in model units."""

    name: str
    #: what was found, and where it would break the solid
    value: float
    breaks_at: float
    #: whether the value is on the good side
    holds: bool
    #: what it means, with the place
    sentence: str


def find_limits(equation: PointEquation) -> tuple[Limit, ...]:
    """Return the limits of a channel; none where M does not lie in the normal planes of its guide.

    An equation without a guide has none.
    """
    if equation.guide is None:
        return ()
    channel = _Channel(equation, equation.guide)
    with np.errstate(all="ignore"):
        if not channel.is_perpendicular():
            return ()
        section = channel.section()
        found = [channel.clearance(section.holds), section, channel.bend(), channel.strands()]
    return tuple(limit for limit in found if limit is not None)


def describe(limits: tuple[Limit, ...]) -> str:
    """Return the limits as one clause for a message."""
    return "; ".join(f"{limit.name}: {limit.sentence}" for limit in limits)


def loose_ends(equation: PointEquation) -> str:
    """Say how a guide is closed that comes back to its beginning in a corner; else nothing."""
    if equation.guide is None:
        return ""
    N = substitute(equation.guide, over_unit_box(equation.domain))
    with np.errstate(all="ignore"):  # where there is no value, nothing is said
        columns = Program((*N, *derivatives(N, "u")))({"u": np.linspace(0.0, 1.0, 9)})
        points, tangents = np.array([np.broadcast_to(c, 9) for c in columns]).reshape(2, 3, 9)
        gap, extent = np.linalg.norm(points[:, 0] - points[:, -1]), np.ptp(points, axis=1).max()
        along = tangents[:, 0] @ tangents[:, -1]
        speeds = np.prod(np.linalg.norm(tangents[:, ::8], axis=0))
    if not (extent > 0 and gap <= 1e-9 * extent and along <= (1.0 - 1e-9) * speeds):
        return ""
    return "the guide ends at its first point: leave that point out there, and say closed = true"


def check_limits(limits: tuple[Limit, ...]) -> None:
    """Raise ChannelLimitError where one does not hold."""
    broken = [limit.sentence for limit in limits if not limit.holds]
    if broken:
        raise ChannelLimitError(f"the channel is beyond its limit: {'; '.join(broken)}")


class _Channel:
    def __init__(self, equation: PointEquation, guide: tuple[Expr, Expr, Expr]) -> None:
        local = over_unit_box(equation.domain)
        self._equation = equation
        M = simplified(substitute(equation.coordinates, local))
        N = substitute(guide, local)
        first = derivatives(N, "u")
        q = cancel_terms(tuple(m - n for m, n in zip(M, N, strict=True)))
        self._offset = Program(q)
        self._section = Program((*first, *q, *derivatives(q, "v"), *derivatives(q, "w")))
        self._bend = Program((*first, *derivatives(first, "u"), *q))
        self._guide = Program((*N, *first))
        self._points = Program(N)
        breaks = find_breaks((*M, *N))
        self._axes = [_axis([b.position for b in row]) for row in breaks]
        across = [0.0, *(b.position for b in breaks[2] if 0 < b.position < 1), 1.0]
        self._axes[2] = distinct([*across, *((a + b) / 2 for a, b in pairwise(across))])

    # -- values over the box ------------------------------------------------------------------

    def _run(self, program: Program, u: Array, v: Array, w: Array) -> list[Array]:
        columns = program({"u": u, "v": v, "w": w})
        shape = np.broadcast_shapes(u.shape, v.shape, w.shape)
        rows = [np.broadcast_to(c, shape) for c in columns]
        return [np.stack(rows[i : i + 3], axis=-1) for i in range(0, len(rows), 3)]

    def _vectors(self, program: Program, u: Array, v: Array, w: Array) -> list[tuple[Array, ...]]:
        """Return the same by coordinates, each as large as what it depends on asks for."""
        columns = program({"u": u, "v": v, "w": w})
        return [columns[i : i + 3] for i in range(0, len(columns), 3)]

    def _smallest(self, field: Field) -> tuple[float, tuple[float, float, float]]:
        """Return the smallest value of a field over the box, and where: a sweep, then zooms."""
        axes = list(self._axes)
        for _ in range(ZOOMS):
            u, v, w = np.ix_(*axes)
            values = field(u, v, w)
            values = np.where(np.isfinite(values), values, np.inf)
            index = [int(i) for i in np.unravel_index(int(np.argmin(values)), values.shape)]
            place = tuple(float(axis[i]) for axis, i in zip(axes, index, strict=True))
            smallest = float(values[tuple(index)])
            axes = [
                np.linspace(axis[max(i - 1, 0)], axis[min(i + 1, len(axis) - 1)], 17)
                for axis, i in zip(axes, index, strict=True)
            ]
            for d in range(3):
                # the places of what was found stay among those looked at
                axes[d] = distinct(np.append(axes[d], place[d]))
        return smallest, (place[0], place[1], place[2])

    def _shown(self, place: tuple[float, ...]) -> str:
        parts = []
        for name, (low, high), x in zip("uv", self._equation.limits, place, strict=False):
            parts.append(f"{name} = {low + (high - low) * x:.5g}")
        return ", ".join(parts)

    def is_perpendicular(self) -> bool:
        """Say whether M - N lies in the normal planes; a guide that is one point has none."""
        u, v, w = np.ix_(self._axes[0], self._axes[1][::4], self._axes[2])
        tangent, q, *_ = self._vectors(self._section, u, v, w)
        size = _length(tangent) * _length(q).max()
        # also where the guide stands still, and has no direction
        across = (np.abs(_product(tangent, q)) <= PERPENDICULAR * size).all()
        return bool(across and _length(tangent).any())

    # -- the limits ---------------------------------------------------------------------------

    def clearance(self, regular: bool) -> Limit | None:
        """Return how far the inner side of the wall is from the guide.

        A wall may well lie beyond the guide where the section does not go round it; where the
        section is not `regular`, that is what is wrong with it.
        """
        u, v, ends = np.ix_(self._axes[0], self._axes[1], np.array([0.0, 1.0]))
        (q,) = self._vectors(self._offset, u, v, ends)
        reach = np.broadcast_to(_length(q), (u.size, v.size, 2))
        inner = 0 if reach[..., 0].sum() <= reach[..., 1].sum() else 1
        if reach[..., inner].max() <= 1e-9 * reach.max():
            return None  # the section is filled: its inner side is the guide

        def distance(u: Array, v: Array, w: Array) -> Array:
            (q,) = self._vectors(self._offset, u, v, ends)
            both = [np.broadcast_to(x, np.broadcast_shapes(x.shape, (1, 1, 2))) for x in q]
            first, last = ([x[..., k : k + 1] for x in both] for k in (inner, 1 - inner))
            return _product(first, last) / _length(last)

        value, place = self._smallest(distance)
        holds = regular or value > 0
        sentence = (
            f"the inside of the wall is {value:.6g} from the guide at {self._shown(place)}"
            if holds
            else f"the inside of the wall lies {-value:.6g} beyond the guide at "
            f"{self._shown(place)}, and at 0 it touches it"
        )
        return Limit("wall clearance", value, 0.0, holds, sentence)

    def section(self) -> Limit:
        """Return the least sine between the wall's direction and the section."""

        def sine(u: Array, v: Array, w: Array) -> Array:
            tangent, _, along, across = self._vectors(self._section, u, v, w)
            a, b, c = across
            x, y, z = along
            area = _product((b * z - c * y, c * x - a * z, a * y - b * x), tangent)
            return area / (_length(tangent) * _length(along) * _length(across))

        u, v, w = np.ix_(self._axes[0][::4], self._axes[1][::4], self._axes[2])
        sign = 1.0 if np.nansum(sine(u, v, w)) >= 0 else -1.0
        value, place = self._smallest(lambda u, v, w: sign * sine(u, v, w))
        holds = value > -1e-9
        sentence = (
            f"the section is seen from the wall's direction under a sine of {value:.4g} at least, "
            f"at {self._shown(place)}"
            if holds
            else f"the wall crosses itself or the guide, or the section is not star-shaped about "
            f"it, at {self._shown(place)} (under a sine of {value:.4g}, and at 0 it breaks); a "
            "thinner wall may hold"
        )
        return Limit("star-shaped", value, 0.0, holds, sentence)

    def bend(self) -> Limit:
        """Return how far the section reaches towards the centre of curvature."""

        def room(u: Array, v: Array, w: Array) -> Array:
            first, second, q = self._vectors(self._bend, u, v, w)
            square = _product(first, first)
            return 1 - _product(q, tuple(x / square for x in second))

        value, place = self._smallest(room)
        first, second, q = (x[0] for x in self._run(self._bend, *(np.array([x]) for x in place)))
        square = float(first @ first)
        curvature = second - first * float(first @ second) / square
        kappa = float(np.linalg.norm(curvature)) / square
        if kappa <= 1e-12 / max(float(np.linalg.norm(q)), 1e-300):
            return Limit("bend", 0.0, 1.0, True, "the guide is straight")
        reach = float(q @ curvature) / (square * kappa)
        return Limit(
            "bend", reach, 1 / kappa, value > 0,
            f"the section reaches {reach:.6g} towards the centre of curvature, which is "
            f"{1 / kappa:.6g} away, at {self._shown(place)}",
        )  # fmt: skip

    def strands(self) -> Limit | None:
        """Return how near parts of the guide come to each other that are no neighbours."""
        pairs, gaps = self._critical(*self._near_pairs())
        ends, tangents = self._curve(pairs)
        size = _norm(np.ptp(self._curve(np.linspace(0, 1, 65))[0], axis=0))
        crossing = gaps <= 1e-9 * size
        chords = (ends[:, 1] - ends[:, 0]) / gaps[:, None]
        cosines = np.abs(np.einsum("nkc,nc->nk", tangents, chords)) / _norm(tangents)
        apart = (cosines.max(axis=1) <= 1e-4) & (np.abs(pairs[:, 0] - pairs[:, 1]) >= 1e-6)
        seen = crossing | apart
        if not seen.any():
            return None
        pairs, gaps, chords, crossing = pairs[seen], gaps[seen], chords[seen], crossing[seen]
        if self._closed:
            pairs = pairs % 1
        reach = self._reach(pairs[:, 0], chords) + self._reach(pairs[:, 1], -chords)
        reach[crossing] = 0.0
        k = int(np.argmin(gaps - reach))
        gap, both = float(gaps[k]), float(reach[k])
        places = " and ".join(self._shown((float(u),)) for u in pairs[k])
        if crossing[k]:
            return Limit("strands", gap, 0.0, False, f"the guide crosses itself at {places}")
        return Limit(
            "strands", gap, both, gap > both,
            f"the guide comes within {gap:.6g} of itself at {places}, where the sections reach "
            f"{both:.6g} towards each other",
        )  # fmt: skip

    def _near_pairs(self) -> tuple[Array, float]:
        """Return places (n, 2) whose distance is a local minimum, and the step between samples."""
        u = self._axes[0]
        fine = distinct(np.concatenate([u, (u[1:] + u[:-1]) / 2]))
        _, first = self._curve(fine)
        speed = _norm(first)
        moving = speed > 0  # where the guide stands still, its neighbours tell how it turns
        direction = first[moving] / speed[moving, None]
        turning = np.arccos(np.clip((direction[1:] * direction[:-1]).sum(axis=1), -1, 1)).sum()
        count = int(np.clip(24 * turning, 200, MOST_STRANDS))
        u = (np.arange(count) + 0.5) / count
        points, _ = self._curve(u)
        gaps = _norm(points[:, None] - points[None, :])
        around = gaps
        for axis in (0, 1):
            sides = (np.roll(around, step, axis=axis) for step in (-1, 1))
            around = np.minimum(around, np.minimum(*sides))
        # equal but for rounding all along a helix
        lower = gaps <= around * (1 + 1e-9)
        rows, columns = np.nonzero(np.triu(lower, 3))
        inner = (rows > 0) & (columns < count - 1)
        if self._closed:
            inner = columns - rows < count - 3
        rows, columns = rows[inner], columns[inner]
        order = np.argsort(gaps[rows, columns])[:24]
        return np.stack((u[rows[order]], u[columns[order]]), axis=-1), 1 / count

    def _critical(self, pairs: Array, step: float) -> tuple[Array, Array]:
        """Return pairs of places moved to where their distance is smallest, and the distances."""
        every = np.arange(len(pairs))
        gaps = np.zeros(len(pairs))
        for _ in range(50 if len(pairs) else 0):
            places = pairs[..., None] + step * np.linspace(-1, 1, 9)
            (points,) = self._run(self._points, self._wrapped(places), np.zeros(1), np.zeros(1))
            grid = _norm(points[:, 0, :, None] - points[:, 1, None, :]).reshape(len(pairs), -1)
            i, j = np.divmod(grid.argmin(axis=1), 9)
            pairs, gaps = np.stack((places[every, 0, i], places[every, 1, j]), axis=-1), grid.min(1)
            step *= 0.6
        return pairs, gaps

    @cached_property
    def _closed(self) -> bool:
        points, _ = self._curve(np.linspace(0, 1, 9), wrap=False)
        return bool(_norm(points[-1] - points[0]) <= 1e-9 * _norm(np.ptp(points, axis=0)))

    def _wrapped(self, u: Array) -> Array:
        return np.asarray(u % 1 if self._closed else np.clip(u, 0, 1))

    def _curve(self, u: Array, wrap: bool = True) -> tuple[Array, Array]:
        u = self._wrapped(u) if wrap else u
        points, first = self._run(self._guide, u, np.zeros(1), np.zeros(1))
        return points, first

    def _reach(self, u: Array, directions: Array) -> Array:
        """Return how far sections at u (n,) go from the guide in directions (n, 3)."""
        every = np.arange(len(u))
        v = np.broadcast_to(self._axes[1], (len(u), len(self._axes[1])))
        for _ in range(ZOOMS):
            places = u[:, None, None], v[:, :, None], np.array([[[0.0, 1.0]]])
            (q,) = self._run(self._offset, *places)
            q = np.take_along_axis(q, _norm(q).argmax(axis=2)[..., None, None], axis=2)[:, :, 0]
            cosines = np.einsum("nkc,nc->nk", q, directions) / _norm(q)
            k = cosines.argmax(axis=1)
            limits = v[every, np.maximum(k - 1, 0)], v[every, np.minimum(k + 1, v.shape[1] - 1)]
            v = np.linspace(*limits, 33, axis=1)
        return np.where(cosines[every, k] > 0.999, _norm(q[every, k]), 0.0)


def _axis(breaks: list[float]) -> Array:
    """Return places over [0, 1], dense in every smooth piece and just beside its ends."""
    limits = [0.0, *(b for b in breaks if 0 < b < 1), 1.0]
    count = max(PER_PIECE, PER_DIRECTION // (len(limits) - 1))
    share = np.linspace(0, 1, count)
    rows = []
    for low, high in pairwise(limits):
        ends = np.where(share == 1.0, 1 - 1e-12, share) if high < 1 else share
        rows.append(low + (high - low) * ends)
    return distinct(np.concatenate(rows))


def _product(a: Sequence[Array], b: Sequence[Array]) -> Array:
    """Return the scalar product of two vectors given by their coordinates."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _length(a: Sequence[Array]) -> Array:
    return np.asarray(np.sqrt(_product(a, a)))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _norm(a: Array) -> Array:
    return np.asarray(np.sqrt(_dot(a, a)))
