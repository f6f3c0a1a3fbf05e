"""Where the lines of faces' grids run: as dense as chords and normals ask for, shared along edges.

Lines cross a face from side to side, so opposite sides have the same shares of their lengths, and
so has whatever face lies beyond. Along each direction a density says how many cells a unit of the
share needs: by the curvature in the direction of the normal (a chord of length h is off by κh²/8),
by how fast the normal turns, and on edges by the bow of the edge itself. What comes out is measured
in the middles of edges, cells and diagonals, and made denser where that says so.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pc2cad.arrays import Array
from pc2cad.brep.face_patches import Patch

#: samples of a direction at least and at most, and per piece of a spline
_LEAST, _MOST, _PER_PIECE = 96, 1024, 4
#: least share of the largest density: cells grow by no more than this
_FLATTEST = 0.04
#: share of the deflection that is aimed at
_AIM = 0.95
#: rounds of measuring, and cells of a direction at most
ROUNDS, _MOST_CELLS = 8, 20_000
#: nodes of all faces at most
MOST_NODES = 1_000_000


@dataclass(eq=False)
class _Group:
    """Edges that have the same shares, some of them run backwards."""

    #: share -> cells per unit, at samples of the finest look
    shares: Array = field(default_factory=lambda: np.linspace(0.0, 1.0, _MOST + 1))
    density: Array = field(default_factory=lambda: np.zeros(_MOST + 1))

    def ask(self, shares: Array, density: Array, backwards: bool) -> None:
        """Take in a density at ascending shares; the largest one counts."""
        if backwards:
            shares, density = 1 - shares[::-1], density[::-1]
        # the largest of neighbours, so that nothing between samples is missed
        wide = np.maximum.reduce([density, np.roll(density, 1), np.roll(density, -1)])
        wide[0], wide[-1] = density[:2].max(), density[-2:].max()
        self.density = np.maximum(self.density, np.interp(self.shares, shares, wide))

    def lines(self) -> Array:
        """Return the shares of the lines, 0 and 1 among them."""
        density = np.maximum(self.density, _FLATTEST * self.density.max())
        steps = (density[1:] + density[:-1]) / 2 * np.diff(self.shares)
        total = np.concatenate(([0.0], np.cumsum(steps)))
        count = int(np.clip(np.ceil(total[-1] - 1e-9), 1, _MOST_CELLS))
        if total[-1] <= 0:
            return np.array([0.0, 1.0])
        lines = np.interp(np.linspace(0.0, total[-1], count + 1), total, self.shares)
        lines[0], lines[-1] = 0.0, 1.0
        return np.asarray(lines)


class Lines:
    """The lines of all grids of a shape."""

    def __init__(self, patches: list[Patch]) -> None:
        self._parent: dict[int, tuple[int, bool]] = {}
        self._mirrored: set[int] = set()
        for patch in patches:
            for k in (0, 1):
                self._join(patch, k)
        roots = {self._root(edge)[0] for edge in list(self._parent)}
        self._groups = {root: _Group() for root in roots}

    def _root(self, edge: int) -> tuple[int, bool]:
        """Return the edge that stands for a group, and whether this one runs against it."""
        turned = False
        while self._parent.setdefault(edge, (edge, False))[0] != edge:
            edge, turn = self._parent[edge]
            turned ^= turn
        return edge, turned

    def _join(self, patch: Patch, direction: int) -> None:
        one, other = patch.sides[direction], patch.sides[direction + 2]
        # both are walked round the face: against each other
        turned = one.forward == other.forward
        (a, turn_a), (b, turn_b) = self._root(one.index), self._root(other.index)
        if a != b:
            self._parent[a] = (b, turn_a ^ turn_b ^ turned)
            if a in self._mirrored:
                self._mirrored.add(b)
        elif turn_a ^ turn_b ^ turned:
            self._mirrored.add(a)

    def ask(self, patch: Patch, direction: int, shares: Array, density: Array) -> None:
        """Ask for a density along a direction of a face."""
        side = patch.sides[direction]
        root, turned = self._root(side.index)
        self._groups[root].ask(shares, density, turned ^ (not side.forward))
        if root in self._mirrored:
            self._groups[root].ask(shares, density, not turned ^ (not side.forward))

    def along(self, patch: Patch, direction: int) -> Array:
        """Return the shares of the lines along a direction of a face, ascending from 0 to 1."""
        side = patch.sides[direction]
        root, turned = self._root(side.index)
        lines = self._groups[root].lines()
        return 1 - lines[::-1] if turned ^ (not side.forward) else lines


def ask_for(lines: Lines, patch: Patch, deflection: float, angle: float) -> None:
    """Ask for the density of lines that a face needs by what its curvatures are.

    `deflection` in model units, `angle` between neighbouring normals in radians.
    """
    shares = [_samples(patch.breaks(k)) for k in (0, 1)]
    points, normals = patch.places(patch.parameters(*shares))
    lengths = np.sqrt((normals * normals).sum(axis=-1, keepdims=True))
    known = lengths > 1e-9 * lengths.max(initial=0.0)
    units = np.where(known, normals / np.where(known, lengths, 1.0), 0.0)
    looks = [_Look(shares[0], points, units), _Look(shares[1], *(x.swapaxes(0, 1) for x in
                                                                 (points, units)))]  # fmt: skip
    half = [look.bow(look.density(_AIM * deflection / 2, angle)) for look in looks]
    for k, look in enumerate(looks):
        own = max(_AIM * deflection - half[1 - k], _AIM * deflection / 2)
        density = look.density(own, angle)
        density = np.maximum(density, look.edges(_AIM * deflection, angle))
        lines.ask(patch, k, shares[k], density)


def _samples(breaks: Array) -> Array:
    if len(breaks) < 2:
        return np.linspace(0.0, 1.0, _LEAST + 1)
    pieces = len(breaks) - 1
    each = int(np.clip(max(_PER_PIECE, -(-_LEAST // pieces)), 1, max(1, _MOST // pieces)))
    inside = np.linspace(0.0, 1.0, each, endpoint=False)
    rows = breaks[:-1, None] + np.diff(breaks)[:, None] * inside
    return np.append(rows.ravel(), 1.0)


class _Look:
    """Curvatures along the first direction of points and unit normals (n, m, 3)."""

    def __init__(self, shares: Array, points: Array, units: Array) -> None:
        before, after = np.diff(shares)[:-1], np.diff(shares)[1:]
        part = (before / (before + after))[:, None, None]
        self._points = points
        bows = points[1:-1] - (1 - part) * points[:-2] - part * points[2:]
        self._second = 2 * bows / (before * after)[:, None, None]
        #: second derivative along the normal, and how fast the normal turns, (n - 2, largest)
        self._curvature = _padded(np.abs((self._second * units[1:-1]).sum(-1)).max(axis=1))
        self._turning = _padded(
            (_angles(units[:-2], units[2:]) / (before + after)[:, None]).max(axis=1)
        )
        self._steps = before + after

    def density(self, deflection: float, angle: float) -> Array:
        """Return the cells per unit of the share that the surface needs."""
        return np.maximum(np.sqrt(self._curvature / (8 * deflection)), self._turning / angle)

    def bow(self, density: Array) -> float:
        """Return how far chords of this density are off."""
        known = density > 0
        return float((self._curvature[known] / (8 * density[known] ** 2)).max(initial=0.0))

    def edges(self, deflection: float, angle: float) -> Array:
        """Return the cells per unit that the first and last line need as curves in space."""
        ends = self._points[:, [0, -1]]
        tangents = ends[2:] - ends[:-2]
        lengths = np.sqrt((tangents * tangents).sum(-1, keepdims=True))
        known = lengths > 1e-12 * max(float(np.abs(ends).max()), 1e-300)
        units = np.where(known, tangents / np.where(known, lengths, 1.0), 0.0)
        second = self._second[:, [0, -1]]
        across = second - (second * units).sum(-1, keepdims=True) * units
        bows = np.where(known[..., 0], np.sqrt((across * across).sum(-1)), 0.0)
        turns = np.zeros_like(bows)
        turns[1:-1] = _angles(units[:-2], units[2:]) / (self._steps[1:-1, None])
        curvature, turning = (_padded(x.max(axis=1)) for x in (bows, turns))
        return np.maximum(np.sqrt(curvature / (8 * deflection)), turning / angle)


def _padded(inner: Array) -> Array:
    return np.concatenate((inner[:1], inner, inner[-1:]))


def _angles(a: Array, b: Array) -> Array:
    """Return the angles between unit vectors; 0 where there is none."""
    known = (np.abs(a).max(axis=-1) > 0) & (np.abs(b).max(axis=-1) > 0)
    difference, total = a - b, a + b
    found = 2 * np.arctan2(*(np.sqrt((x * x).sum(-1)) for x in (difference, total)))
    return np.where(known, found, 0.0)
