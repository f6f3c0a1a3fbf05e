"""How deep two built faces run through one another, where the equation's are apart.

Both faces are sampled. How far a point of one lies behind the other, along the other's normal, is
a depth; what is told is the largest that was found, so "or more".
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.geometry.sheets import Sheet, projected
from pc2cad.geometry.splines.bernstein import bernstein_values
from pc2cad.solidity.embedding.proof import Meeting
from pc2cad.solidity.nearest_places import descended

#: places along each parameter of a face, distances of more places from where the faces meet, and
#: the points that are followed to the nearest place of the other face
_EVEN = np.linspace(0.0, 1.0, 33)
_NEAR = 2.0 ** -np.arange(2, 12)
_FOLLOWED, _REACH = 12, 0.05
#: step of the difference that gives a normal
_STEP = 1e-5


def crossing_depth(sheets: Sequence[Sheet], meeting: Meeting, apart: Array, reach: float) -> float:
    """Return how deep two sheets cross, 0 where no point of one is seen behind the other.

    `apart` (3,) leads from the equation's second face to its first, where they are nearest. Faces
    that deviate by `reach` together cross no deeper: what lies farther behind one is elsewhere.
    """
    one, other = (
        _Face(sheets[i], place) for i, place in zip(meeting.sheets, meeting.places, strict=True)
    )
    return max(_behind(one, other, apart, reach), _behind(other, one, -apart, reach))


class _Face:
    """A sheet over the unit square, and samples of it."""

    def __init__(self, sheet: Sheet, place: Sequence[float]) -> None:
        self._sheet = sheet
        self.meeting = np.array(place) / sheet.shape
        nodes = []
        for x, count in zip(place, sheet.shape, strict=True):
            near = np.concatenate((x / count + _NEAR, x / count - _NEAR, [x / count]))
            nodes.append(distinct(np.concatenate((_EVEN, near[(near >= 0) & (near <= 1)]))))
        self.places = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, 2)
        self.points = self.at(self.places)

    def at(self, places: Array) -> Array:
        """Return points (…, 3) at places (…, 2)."""
        flat = places.reshape(-1, 2)
        index, local = [], []
        for x, count in zip(flat.T, self._sheet.shape, strict=True):
            own = np.clip((x * count).astype(int), 0, count - 1)
            index.append(own)
            local.append(x * count - own)
        nets = self._sheet.patches.take(*index)
        along, across = (
            bernstein_values(d, x) for d, x in zip(self._sheet.patches.degrees, local, strict=True)
        )
        found = np.einsum("ni,nj,nijc->nc", along, across, nets)
        return projected(found).reshape(*places.shape[:-1], 3)

    def normal(self, place: Array) -> Array:
        """Return the unit normal at a place (2,), to one side of the whole face; or zeros."""
        steps = np.where(place + _STEP > 1, -_STEP, _STEP)
        ways = self.at(place + np.diag(steps)) - self.at(place)
        found = np.cross(ways[0] / steps[0], ways[1] / steps[1])
        length = float(np.linalg.norm(found))
        return found / length if length else found


def _behind(one: _Face, other: _Face, apart: Array, reach: float) -> float:
    """Return how far points of a face lie behind another, which looks along `apart` at the meeting.

    Nothing counts that is farther from it than `reach`.
    """
    unit = apart / np.linalg.norm(apart)
    side = np.sign(other.normal(other.meeting) @ unit)
    nearest = []
    for point in one.points:
        gap = point - other.points
        square = np.einsum("ni,ni->n", gap, gap)
        nearest.append(int(square.argmin()))
    heights = (one.points - other.points[nearest]) @ unit
    deepest = 0.0
    for k in np.argsort(heights)[:_FOLLOWED]:
        point = one.points[k]

        def gap_at(x: Array, point: Array = point) -> Array:
            return other.at(x) - point

        foot = descended(gap_at, other.places[nearest[k]], _REACH)
        way = other.at(foot) - point
        # beyond the border of the other face nothing is behind it
        if np.all((foot > 0) & (foot < 1)) and np.linalg.norm(way) <= reach:
            deepest = max(deepest, float(side * way @ other.normal(foot)))
    return deepest
