"""The nearest places of a surface: from a grid of samples, Gauss-Newton in both parameters."""

from __future__ import annotations

from itertools import product
from typing import TypeAlias

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.verify.inversion import FINER, MOST_STEPS, OFF, divided, nearest

Span: TypeAlias = tuple[float, float]
Jet: TypeAlias = tuple[Array, Array, Array]
#: relative distance at which two ends are one
CLOSED = 1e-9
#: places of the finer grid, at most
FINEST = 1_000_000


class Searched:
    """A surface of whose places the nearest to a point is looked for."""

    limits: tuple[Span, Span]
    periods: tuple[float | None, float | None]

    def at(self, u: Array, v: Array) -> Jet:
        """Return point, u and v derivative at pairs of parameters, (len(u), 3) each."""
        raise NotImplementedError

    def grid(self, u: Array, v: Array) -> Jet:
        """Return point, u and v derivative on the tensor grid, (len(u), len(v), 3) each."""
        raise NotImplementedError

    def _samples(self, axis: int) -> Array:
        """Return parameters from which a search starts."""
        raise NotImplementedError

    def search(
        self, points: Array, start: tuple[Array, Array] | None = None
    ) -> tuple[Array, Array]:
        """Return the nearest places: the nearest grid point, then Gauss-Newton in both.

        Points that stay off are looked for once more, from finer grids of each quarter of the
        surface: beside a steep place the nearest grid point may be of another part of it, and
        where it closes, with a turn or without, of the other side.
        """
        if start is not None:
            return self._descended(points, *start)[:2]
        us, vs = (self._samples(axis) for axis in (0, 1))
        first, chord = self._nearest_samples(points, us, vs)
        u, v, off = self._descended(points, *first)
        parts = int(np.clip((FINEST / (len(us) * len(vs))) ** 0.5, 2, FINER))
        for some_u, some_v in product(_halves(divided(us, parts)), _halves(divided(vs, parts))):
            lost = np.flatnonzero(off > OFF * chord)
            if not len(lost):
                break
            first, _ = self._nearest_samples(points[lost], some_u, some_v)
            again = self._descended(points[lost], *first)
            better = again[2] < off[lost]
            for found, new in zip((u, v, off), again, strict=True):
                found[lost[better]] = new[better]
        return u, v

    def _nearest_samples(
        self, points: Array, us: Array, vs: Array
    ) -> tuple[tuple[Array, Array], float]:
        """Return the nearest places of a grid, and its longest chord."""
        grid, along_u, along_v = self.grid(us, vs)
        # no step leads away from a pole, nor from a side that its parameter comes to without speed
        size = np.ptp(grid.reshape(-1, 3), axis=0).max()
        wide_u, wide_v = (np.ptp(grid, axis=k).max(axis=1) > CLOSED * size for k in (1, 0))
        wide_u, wide_v = wide_u & _has_speed(along_u, 0), wide_v & _has_speed(along_v, 1)
        us, vs, grid = us[wide_u], vs[wide_v], grid[wide_u][:, wide_v]
        found = nearest(grid.reshape(-1, 3), points)
        chords = (np.linalg.norm(np.diff(grid, axis=k), axis=2).max(initial=0.0) for k in (0, 1))
        return (us[found // len(vs)], vs[found % len(vs)]), max(chords)

    def _descended(self, points: Array, at_u: Array, at_v: Array) -> tuple[Array, Array, Array]:
        """Return places that are nearer than given ones, (n,) each, and how near."""
        found = u, v = np.array(at_u), np.array(at_v)
        left: Integers = np.arange(len(points))
        share: Array = np.ones(len(points))
        jet = self.at(u, v)
        off = np.linalg.norm(points - jet[0], axis=1)
        least = np.array(off)
        for _ in range(2 * MOST_STEPS):
            du, dv = self._step(points - jet[0], jet[1], jet[2], u, v)
            new_u, new_v = self._inside(0, u + share * du), self._inside(1, v + share * dv)
            new_jet = self.at(new_u, new_v)
            new_off = np.linalg.norm(points - new_jet[0], axis=1)
            # a step that does not come nearer is halved: over knots the speed may jump
            better = new_off < off
            moved = np.where(better, np.abs(new_u - u) + np.abs(new_v - v), 0.0)
            u, v = np.where(better, new_u, u), np.where(better, new_v, v)
            off = np.where(better, new_off, off)
            place, along_u, along_v = (
                np.where(better[:, None], new, old) for new, old in zip(new_jet, jet, strict=True)
            )
            jet = place, along_u, along_v
            share = np.where(better, np.minimum(1.0, 2.0 * share), 0.5 * share)
            found[0][left], found[1][left], least[left] = u, v, off
            going = (moved > 1e-14) | (share >= 1e-4)
            if not going.all():  # each place by itself: most are there after a few steps
                left, points, off, share = left[going], points[going], off[going], share[going]
                u, v, jet = u[going], v[going], (jet[0][going], jet[1][going], jet[2][going])
            if not len(left):
                break
        return *found, least

    def _step(
        self, gap: Array, along_u: Array, along_v: Array, u: Array, v: Array
    ) -> tuple[Array, Array]:
        """Return a step in both parameters; where one is at its limit, the other goes alone."""
        du, dv = tangent_step(gap, along_u, along_v)
        on_u, on_v = (
            (gap * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300)
            for along in (along_u, along_v)
        )
        stuck_u, stuck_v = self._stuck(0, u, du), self._stuck(1, v, dv)
        return np.where(stuck_v, on_u, du), np.where(stuck_u, on_v, dv)

    def _stuck(self, axis: int, t: Array, step: Array) -> Booleans:
        """Say which parameters are at a limit and would go beyond it."""
        low, high = self.limits[axis]
        beyond = ((t <= low) & (step < 0.0)) | ((t >= high) & (step > 0.0))
        return np.asarray(beyond & (self.periods[axis] is None))

    def _inside(self, axis: int, t: Array) -> Array:
        """Return parameters within the limits: round again where the surface closes."""
        low, high = self.limits[axis]
        if self.periods[axis] is None:
            return np.clip(t, low, high)
        return np.where((t < low) | (t > high), low + np.mod(t - low, high - low), t)


def _halves(t: Array) -> tuple[Array, Array]:
    """Return the first and the second half of parameters; the middle is in both."""
    return t[: len(t) // 2 + 1], t[len(t) // 2 :]


def _has_speed(along: Array, axis: int) -> Booleans:
    """Say at which levels of a parameter a surface goes on with it, of slopes (n, m, 3)."""
    speeds = np.linalg.norm(along, axis=2).max(axis=1 - axis)
    return np.asarray(speeds > CLOSED * speeds.max())


def tangent_step(gap: Array, along_u: Array, along_v: Array) -> tuple[Array, Array]:
    """Return the steps in u and v that go along a gap in the tangent plane (least squares)."""
    uu, uv, vv = ((a * b).sum(axis=1) for a, b in
                  ((along_u, along_u), (along_u, along_v), (along_v, along_v)))  # fmt: skip
    on_u, on_v = (gap * along_u).sum(axis=1), (gap * along_v).sum(axis=1)
    uu, vv = uu + 1e-14 * vv + 1e-300, vv + 1e-14 * uu + 1e-300
    area = uu * vv - uv * uv
    return (vv * on_u - uv * on_v) / area, (uu * on_v - uv * on_u) / area
