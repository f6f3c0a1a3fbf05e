"""Rectangles of parameters in which a sheet, or two sides of a wall, cannot meet.

The straight way of parameters between two places of a rectangle is a sum of tangents along s and t;
where cones that hold these have only the zero in common, both ways round, it does not come back. Of
two sheets on one grid of patches the straight way leads from one to the other, through the solid
between them: a sum of tangents of both and of ways across. That is so for rectangles of any size:
one look does what would be many pairs of patches, and for walls however thin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.distinct import distinct_rows
from pc2cad.arrays.linear import areas, cross, dots, lengths, unit
from pc2cad.solidity.embedding.cells import Cells, cells_of
from pc2cad.solidity.embedding.pinches import pinched_sides, pinched_ways
from pc2cad.solidity.embedding.surfaces import Surfaces

#: from a cell to the four corners of the rectangle round it and the other one, in steps
_SHIFTS = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
#: the radius of a cone that says nothing
UNKNOWN = 2.0
#: the chord of a right angle
RIGHT = np.sqrt(2.0)
#: steps of the search for a plane, and how far before it the cone farthest behind is to be then
_TURNS, _BEFORE = 8, 0.02
#: where a cone is so far behind a plane that no turn helps: at first, and at least
_FAR, _BEHIND = 0.8, 0.2
#: rounding of the sums and products of unit vectors here
_UNIT = 1e-14


@dataclass(frozen=True, eq=False)
class Cones:
    """Cones that hold vectors, and all sums of these.

    Unit axes (…, 3), and how far the vectors, at length 1, are from them at most (…), as chords:
    -inf where no vector is longer than rounding.
    """

    axes: Array
    radii: Array

    def __getitem__(self, rows: Integers | int | slice) -> Cones:
        return Cones(self.axes[rows], self.radii[rows])

    @property
    def slopes(self) -> tuple[Array, Array]:
        """Sine and cosine of half the angle at the tip.

        It is a right angle, too wide for every test, where sums may leave a cone, and where there
        is no vector.
        """
        chord = np.where((self.radii >= 0) & (self.radii < RIGHT), self.radii, RIGHT)
        square = chord * chord
        return chord * np.sqrt(1 - square / 4), 1 - square / 2


def radii_round(size: Array, reach: Array, noise: float) -> Array:
    """Return the radii of cones of all that is nearer than a reach to vectors of some size."""
    there = size > noise
    share = (reach + noise) / np.where(there, size, 1.0)
    # a chord of the angle whose sine is the share
    chord = np.sqrt(2 - 2 * np.sqrt(np.maximum(1 - share * share, 0.0)))
    return np.where(there, np.where(share < 1, chord, 2.0), np.where(reach <= noise, -np.inf, 2.0))


def cones_of(vectors: Array, noise: float) -> Cones:
    """Return the cones that hold vectors (n, k, 3) each, as far as these are not rounding."""
    return cones_of_rows(np.array(vectors.transpose(2, 1, 0), order="C"), noise)


def cones_of_rows(rows: Array, noise: float) -> Cones:
    """Return the cones that hold vectors (3, k, n), which are used up: k to each of n cones.

    Coordinate by coordinate and cones last: long rows, not three numbers at a time.
    """
    size = np.sqrt(_squares_of_rows(rows))
    none = size <= noise
    some = bool(none.any())
    if some:
        size[none] = np.inf
        rows[:, none] = 0.0
    rows /= size
    axes = unit(rows.sum(axis=1).T)
    rows -= axes.T[:, None]
    squares = _squares_of_rows(rows)
    if some:
        squares[none] = -1.0
    most = squares.max(axis=0)
    return Cones(axes, np.sqrt(most, out=np.full(len(most), -np.inf), where=most >= 0))


def _squares_of_rows(rows: Array) -> Array:
    """Return the squares of the lengths of vectors (3, …)."""
    squares = rows * rows
    return np.asarray(squares[0] + squares[2] + squares[1])


def joint(parts: Cones) -> Cones:
    """Return the cones that hold those (k, …) of one row each."""
    axes = unit(parts.axes.sum(axis=0))
    return Cones(axes, (lengths(parts.axes - axes) + parts.radii).max(axis=0))


def joint_of_rows(axes: Array, radii: Array) -> Cones:
    """Return the same of axes (3, k, …), which are used up, and radii (k, …).

    Coordinate by coordinate, as `cones_of_rows`.
    """
    joint_axes = _unit_rows(axes.sum(axis=1))
    axes -= joint_axes[:, None]
    off = np.sqrt(_squares_of_rows(axes))
    off += radii
    return Cones(np.moveaxis(joint_axes, 0, -1), off.max(axis=0))


def is_alone(s: Cones, t: Cones) -> Booleans:
    """Say where no vectors of two cones are parallel: both half angles are less than that between.

    Opposite vectors are parallel too.
    """
    (sine, cosine), (other, base) = s.slopes, t.slopes
    narrow = cosine * base > sine * other
    between = areas(s.axes, t.axes)
    return np.asarray(narrow & (between > sine * base + cosine * other + _UNIT))


def is_wall(s: Cones, t: Cones, w: Cones) -> Booleans:
    """Say where no vectors of three cones lie in a plane.

    A plane of normal n, |n| = 1, has a vector of a cone round a if |n·a| is no more than the sine
    of its half angle. All three such numbers together leave n in a parallelepiped round the origin,
    which is to have its corners within the unit sphere.
    """
    cones = (s, t, w)
    faces = [cross(cones[k - 2].axes, cones[k - 1].axes) for k in range(3)]
    volume = np.abs(dots(faces[2], w.axes))
    p, q, r = (cone.slopes[0][..., None] * face for cone, face in zip(cones, faces, strict=True))
    corner = lengths(p + q + r)
    for other in (p + q - r, p - q + r, q + r - p):
        np.maximum(corner, lengths(other), out=corner)
    return np.asarray(volume > corner + _UNIT)


def are_ahead(axes: Array, sines: Array) -> Booleans:
    """Say where a plane has all vectors of k cones on one side: no sum of any is zero then.

    `axes` (3, k, n) count with their signs; `sines` (k, n) are those of half the angles at the tip.
    The plane is sought: as far as a cone is behind it, the cone is to be before it after the next
    step. Coordinate by coordinate: long rows, not three numbers at a time.
    """
    normal = _unit_rows(axes.sum(axis=1))
    left, result = np.arange(axes.shape[2]), np.zeros(axes.shape[2], dtype=bool)
    for turn in range(_TURNS):
        room = axes[0] * normal[0]
        room += axes[2] * normal[2]
        room += axes[1] * normal[1]
        room -= sines
        least = room.min(axis=0)
        result[left[least > _UNIT]] = True
        rest = np.flatnonzero((least <= _UNIT) & (least > -max(_BEHIND, _FAR / (1 + turn))))
        if len(rest) == 0:
            break
        # the cone that is farthest behind pulls
        pull = axes[:, room[:, rest].argmin(axis=0), rest]
        pull *= _BEFORE - 2 * least[rest]
        left, axes, sines = left[rest], axes[:, :, rest], sines[:, rest]
        normal = _unit_rows(normal[:, rest] + pull)
    return result


def _unit_rows(rows: Array) -> Array:
    """Return vectors (3, …) at length 1; those of no length stay."""
    size = np.sqrt(_squares_of_rows(rows))
    return np.asarray(rows / np.where(size > 0, size, 1.0))


def parted_beside(cells: Cells, pairs: Integers, noise: float) -> Booleans:
    """Say which pairs of different cells, side by side on one sheet or a wall, do not meet.

    Their own rectangle of parameters is looked at, on both sheets of a wall.
    """
    surfaces, result = cells.surfaces, np.zeros(len(pairs), dtype=bool)
    a, b = pairs[:, 0], pairs[:, 1]
    one, other = cells.sheet[a], cells.sheet[b]
    size = cells.high - cells.low
    near = (size[a] == size[b]).all(axis=1)
    apart = cells.limits[0][b] - cells.limits[0][a]
    # cells may be halved until nothing is left of them
    step = np.divide(apart, size[a], out=np.full_like(apart, np.inf), where=size[a] > 0)
    near &= (np.abs(step) <= 1).all(axis=1)
    near &= surfaces.separable[one] & (surfaces.plane[one] < 0)
    two = near & (one != other)
    near[two] = surfaces.walls(one[two], other[two])
    rows = np.flatnonzero(near)
    if len(rows) == 0:
        return result
    a, b, step = a[rows], b[rows], step[rows]
    low = (cells.limits[0][a] + _SHIFTS[:, None] * step * size[a]).reshape(-1, 2)
    place = np.floor(low).astype(np.int64)
    patches = [
        surfaces.start[sheet] + place[:, 0] * surfaces.shapes[sheet, 1] + place[:, 1]
        for sheet in (np.tile(cells.sheet[a], 4), np.tile(cells.sheet[b], 4))
    ]
    windows = np.column_stack((low - place, np.tile(size[a], (4, 1))))
    s, t, w = _cones(surfaces, patches, windows, noise)
    result[rows] = np.where(two[rows], is_wall(s, t, w), is_alone(s, t))
    return result


def _cones(
    surfaces: Surfaces, patches: Sequence[Integers], windows: Array, noise: float
) -> list[Cones]:
    """Return cones along s, along t and across of the rectangles round pairs of cells.

    `patches` are those of both sheets at the four corners of each rectangle, (4n,), `windows` the
    lowest parameters and the lengths in these (4n, 4). Pairs share most of them: each is looked at
    once.
    """
    chosen, ways = distinct_rows(*patches, *windows.T)
    patch, window = (
        np.concatenate([row[chosen] for row in patches]),
        np.tile(windows[chosen], (2, 1)),
    )
    kept, nets = distinct_rows(patch, *window.T)
    low, length = window[kept, :2], window[kept, 2:]
    cells = cells_of(surfaces, patch[kept], low, low + length)
    points, pinched = cells.points, pinched_sides(cells, noise)
    one, other = nets.reshape(2, -1)
    corners = ways.reshape(4, -1)
    result = []
    for axis in (1, 2):
        cones = cones_of(np.diff(points, axis=axis).reshape(len(points), -1, 3), noise)
        cones.radii[pinched[:, axis - 1]] = UNKNOWN
        result.append(joint(cones[np.concatenate((one[corners], other[corners]))]))
    across = cones_of((points[other] - points[one]).reshape(len(one), -1, 3), noise)
    across.radii[pinched_ways(cells, one, other, noise)] = UNKNOWN
    return [*result, joint(across[corners])]
