"""Where points of a side of a body lie in the box of its equation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from pc2cad.arrays import Array
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.topology.cells import Cell, directions_of, normal_direction

#: points along each direction of a patch from which the search begins
_SEEDS = 65
_STEPS = 12
#: share of a side's extent that two places of one are apart
ONE = 1e-9


class SidePlaces:
    """The local parameters, on some patches of a side, of the places nearest to points.

    Points lie on the side but for what a face deviates: Gauss-Newton steps with two parameters.
    """

    def __init__(self, analysis: Analysis, patches: Sequence[Cell]) -> None:
        self._map = analysis.map
        self._patches = [_Patch(analysis, patch) for patch in patches]

    def __call__(self, points: Array) -> Array:
        """Return local parameters (n, 3) for points (n, 3)."""
        found = [patch.nearest(points) for patch in self._patches]
        gaps = np.stack([((self._map.points(*x.T) - points) ** 2).sum(axis=1) for x in found])
        return np.asarray(np.stack(found)[gaps.argmin(axis=0), np.arange(len(points))])


class _Patch:
    def __init__(self, analysis: Analysis, patch: Cell) -> None:
        self._map, self._free = analysis.map, directions_of(patch)
        spans = [analysis.span(d, patch[d]) for d in range(3)]
        self._low, self._high = (np.array([span[k] for span in spans]) for k in (0, 1))
        # middles of cells: of seeds on a seam or at a pole several are one place
        shares = (np.arange(_SEEDS) + 0.5) / _SEEDS
        rows = [a + (b - a) * shares for a, b in spans]
        d = normal_direction(patch)
        rows[d] = self._low[d : d + 1]
        self._closed = np.array([self._closes(rows, k) for k in range(3)])
        grid = np.broadcast_arrays(*open_grid(*rows))
        self._seeds = np.stack([g.ravel() for g in grid], axis=1)
        self._tree = cKDTree(self._map.points(*self._seeds.T))

    def nearest(self, points: Array) -> Array:
        """Return the places on this patch that are nearest to points."""
        places: Array = self._seeds[self._tree.query(points)[1]].copy()
        s, t = self._free
        for _ in range(_STEPS):
            image, *_ = here = self._map.frame(*places.T)
            a, b, gap = here[1 + s], here[1 + t], points - image
            aa, ab, bb = ((x * y).sum(axis=1) for x, y in ((a, a), (a, b), (b, b)))
            ga, gb = (a * gap).sum(axis=1), (b * gap).sum(axis=1)
            # where a tangent vanishes, at a pole, its parameter stays
            det = aa * bb - ab * ab
            sound = det > 1e-14 * aa * bb
            with np.errstate(divide="ignore", invalid="ignore"):
                ds = np.where(sound, (bb * ga - ab * gb) / det, np.where(aa > 0, ga / aa, 0.0))
                dt = np.where(sound, (aa * gb - ab * ga) / det, np.where(bb > 0, gb / bb, 0.0))
            moved = places.copy()
            moved[:, s] += ds
            moved[:, t] += dt
            moved = self._inside(moved)
            nearer = ((self._map.points(*moved.T) - points) ** 2).sum(axis=1)
            better = nearer <= (gap * gap).sum(axis=1)
            places[better] = moved[better]
            if not better.any() or np.abs(ds[better]).max() + np.abs(dt[better]).max() < 1e-14:
                break
        return places

    def _closes(self, rows: list[Array], k: int) -> bool:
        """Say whether the patch comes back to itself along a direction."""
        if k not in self._free:
            return False
        low, high = (
            self._map.points(*np.ix_(*rows[:k], end[k : k + 1], *rows[k + 1 :]))
            for end in (self._low, self._high)
        )
        return bool(np.abs(low - high).max() <= ONE * max(np.ptp(low.reshape(-1, 3), axis=0)))

    def _inside(self, places: Array) -> Array:
        width = np.where(self._closed, self._high - self._low, 1.0)
        turns = np.floor((places - self._low) / width)
        wrapped = np.where(self._closed, places - turns * width, places)
        return np.asarray(np.clip(wrapped, self._low, self._high))
