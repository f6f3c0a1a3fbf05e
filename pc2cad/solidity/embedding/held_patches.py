"""What holds all patches of some sheets: their limits, and cones of tangents and of ways across.

Splines of many patches are held by their corners (`holds`), others by all control points; sheets
that are made alike, together.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.geometry.sheets import points_of, projected
from pc2cad.solidity.embedding.holds import Hold, hold, hold_in_pieces
from pc2cad.solidity.embedding.pinches import pinched_patches, pinched_walls
from pc2cad.solidity.embedding.separation import boxes_of_rows
from pc2cad.solidity.embedding.surfaces import POINT, SAME_WEIGHT, Surfaces
from pc2cad.solidity.embedding.windows import RIGHT, UNKNOWN, Cones, cones_of_rows

#: sheets of no more patches are held by the control points of each from the first
FEW = 128


@dataclass(eq=False)
class HeldPatches:
    """Limits and cones of the patches of some sheets; steps no longer than a noise are rounding."""

    surfaces: Surfaces
    noise: float
    #: control points of the patches of sheets that were held by these, (3, q+1, p+1, m, n)
    _points: dict[int, Array] = field(default_factory=dict)
    #: what holds the ways from one of two sheets to the other
    _held_ways: dict[tuple[int, int], Hold] = field(default_factory=dict)
    #: no way that a cone narrower than a right angle holds is shorter, but for those that vanish
    least_way: float = np.inf

    @cached_property
    def _large(self) -> Booleans:
        """Which sheets are held by their corners: splines of many patches."""
        plain = [
            sheet.patches.knots is not None
            and bool(np.ptp(sheet.patches.poles[..., 3]) <= SAME_WEIGHT)
            for sheet in self.surfaces.sheets
        ]
        return np.asarray((self.surfaces.shapes.prod(axis=1) > FEW) & np.array(plain))

    def _alike(self) -> list[list[int]]:
        """Return numbers of sheets that are made, and held, alike."""
        groups: dict[tuple[object, ...], list[int]] = {}
        for number, sheet in enumerate(self.surfaces.sheets):
            key = bool(self._large[number]), sheet.plane is None, sheet.patches.making
            groups.setdefault(key, []).append(number)
        return list(groups.values())

    @cached_property
    def patches(self) -> tuple[Array, Array, Cones]:
        """Limits of all patches, and cones of their tangents along s, then along t."""
        surfaces = self.surfaces
        count = len(surfaces.sheet_of)
        found = (np.empty((count, 13)), np.empty((count, 13)),
                 Cones(np.zeros((2 * count, 3)), np.full(2 * count, UNKNOWN)))  # fmt: skip
        for own in self._alike():
            if not self._large[own[0]]:
                self._hold_by_points(*found, own)
                continue
            held = self._hold_together(own)
            rows = surfaces.start[own][:, None] + np.arange(surfaces.shapes[own[0]].prod())
            found[0][rows], found[1][rows] = held.limits()
            for axis in (0, 1):
                cones = held.tangents(axis, self.noise)
                found[2].axes[axis * count + rows] = cones.axes
                found[2].radii[axis * count + rows] = cones.radii
        return found

    def _hold_together(self, own: list[int]) -> Hold:
        """Return what holds splines made alike, and keep that of the ways from one of two on."""
        patches = self.surfaces.sheets[own[0]].patches
        poles = [projected(self.surfaces.sheets[i].patches.poles) for i in own]
        # two may be the sides of a wall: a third spline takes little more
        ways = [poles[1] - poles[0]] if len(own) == 2 else []
        stacked = np.stack(poles + ways, axis=2)
        held, count = hold(patches, stacked), len(own)
        if ways:
            self._held_ways[own[0], own[1]] = held.of(count)
        return hold_in_pieces(patches, stacked[:, :, :count], held.of(slice(count)))

    def ways(self, i: int, j: int) -> Cones:
        """Return cones of the ways from the patches of one sheet to those of another."""
        first, second = (self.surfaces.sheets[k].patches for k in (i, j))
        if self._large[i] and self._large[j]:
            if (i, j) not in self._held_ways:
                poles = projected(second.poles) - projected(first.poles)
                self._held_ways[i, j] = hold(first, poles)
            held = self._held_ways[i, j]
            found = held.ways(self.noise)
            self._keep_least(found, held.least())
            return found
        one, other = (
            self._points[k] if k in self._points else points_of([patches])[:, :, :, 0]
            for k, patches in ((i, first), (j, second))
        )  # fmt: skip
        # row by row of the grid again
        ways = other - one
        order = np.arange(ways.shape[3] * ways.shape[4]).reshape(ways.shape[3:]).T.ravel()
        pinched = pinched_walls(self.surfaces, (i, j), ways, self.noise)
        rows = ways.reshape(3, -1, len(order))
        found = cones_of_rows(rows.copy(), self.noise)
        heights = np.einsum("ikn,ni->kn", rows, found.axes)
        there = (rows * rows).sum(axis=0) > self.noise * self.noise
        found.radii[order[pinched]] = UNKNOWN
        self._keep_least(found, np.where(there, heights, np.inf).min(axis=0))
        return found[order]

    def _keep_least(self, ways: Cones, least: Array) -> None:
        """Keep how short ways are, by the least of those that a cone holds each."""
        chosen = least[ways.radii < RIGHT]
        self.least_way = min(self.least_way, float(chosen.min(initial=np.inf)))

    def _hold_by_points(self, low: Array, high: Array, cones: Cones, sheets: list[int]) -> None:
        """Hold patches of sheets made alike by their own control points."""
        surfaces = self.surfaces
        points = points_of([surfaces.sheets[i].patches for i in sheets])
        self._points |= {i: points[:, :, :, k] for k, i in enumerate(sheets)}
        m, n = points.shape[4:]
        own = np.arange(n) * m + np.arange(m)[:, None]
        patches = (surfaces.start[sheets][:, None, None] + own).ravel()
        low[patches], high[patches] = boxes_of_rows(points.reshape(3, -1, len(patches)))
        if surfaces.sheets[sheets[0]].plane is not None:
            return
        pinched = pinched_patches(points, surfaces.edges[sheets] == POINT, self.noise)
        # along s, then along t
        both = points[:, :, 1:] - points[:, :, :-1], points[:, 1:] - points[:, :-1]
        for axis, steps in enumerate(both):
            found = cones_of_rows(steps.reshape(3, -1, len(patches)), self.noise)
            found.radii[pinched[axis].ravel()] = UNKNOWN
            rows = axis * len(low) + patches
            cones.axes[rows], cones.radii[rows] = found.axes, found.radii
