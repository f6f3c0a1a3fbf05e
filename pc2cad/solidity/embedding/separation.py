"""What proves that two parts of sheets meet nowhere, or only where they are joined.

A part lies in the convex hull of its control points; its tangents along s are sums, with positive
factors, of the differences of control points along s (of rational parts too, where weights are
products). So a plane that has the points of two parts on its two sides separates them.

Two parts joined along a curve: x = c + P on the first, y = c' + Q on the second, where c and c' are
places of the curve, and P and Q sums of tangents that lead away from it. If x = y, then P - Q is a
chord of the curve. With all Q and -P within the half space n·g ≥ m|g|, and all chords within
|n·d| ≤ s|d| < m|d|, that is so at the curve only. A part meets itself nowhere by the same token:
its tangents along t are the Q there, and those along s the chords.

Two parts on two sides of a wall, by the same parameters: the straight way from x to y in the solid
between the two is a sum of tangents of both and of ways across.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.linear import cross, dots, heights, lengths, product, unit
from pc2cad.solidity.embedding.cells import ENDS, Cells, Joints
from pc2cad.solidity.embedding.levels import beyond_corner, beyond_plane, by_levels, rises
from pc2cad.solidity.embedding.pinches import pinched_sides

#: rounding of the sums and products of unit vectors here
_UNIT = 1e-12
#: steps of the search for a plane, how far each ray pulls it, and the sine that does
_TURNS, _PULL, _BEFORE = 24, 0.5, 0.02
#: what is added to the second moments of rays that all lie in a plane
_LEAST = 1e-4
#: space's three axes, and the diagonals of a cube and of its faces
_DIRECTIONS = np.array([
    [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1],
    [1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1],
], dtype=float)  # fmt: skip
_SHARES = 1 / np.sqrt((_DIRECTIONS**2).sum(axis=1, keepdims=True))
_DIRECTIONS *= _SHARES


def boxes(points: Array) -> tuple[Array, Array]:
    """Return limits (…, 13) of control points (…, k, 3) in thirteen directions."""
    # control points first: limits of many parts are found side by side
    first = np.moveaxis(points, -2, 0)
    values = in_directions(first)
    return values.min(axis=0), values.max(axis=0)


def boxes_of_rows(points: Array) -> tuple[Array, Array]:
    """Return limits (n, 13) of control points (3, k, n), k of each part, in thirteen directions."""
    low, high = np.empty((2, len(_DIRECTIONS), points.shape[2]))
    x, y, z = points
    p, q = x + y, x - y
    # in the order of the directions; sums take less than products with these
    for k, values in enumerate(
        (x, y, z, p + z, p - z, q + z, z - q, p, q, x + z, x - z, y + z, y - z)
    ):
        np.minimum.reduce(values, axis=0, out=low[k])
        np.maximum.reduce(values, axis=0, out=high[k])
    return (low * _SHARES).T, (high * _SHARES).T


def in_directions(points: Array) -> Array:
    """Return how far points (…, 3) lie along thirteen directions, (…, 13)."""
    return product(points.reshape(-1, 3), _DIRECTIONS.T).reshape(*points.shape[:-1], -1)


def side_nets(cells: Cells, rows: Integers, sides: Integers) -> Array:
    """Return control points of cells with an index along a side first, one away from it second."""
    n = cells.surfaces.degree + 1
    flat = np.arange(n * n).reshape(n, n)
    index = np.stack((flat, flat[::-1].T, flat[:, ::-1], flat.T))[sides]
    points = cells.points.reshape(len(cells), -1, 3)
    return points[rows[:, None, None], index]


def _directions(steps: Array, noise: float) -> tuple[Array, Booleans]:
    """Return steps (n, …, 3) at length 1, (n, k, 3), and which of them are more than rounding."""
    flat = steps.reshape(len(steps), -1, 3)
    size = lengths(flat)
    there = size > noise
    return flat / np.where(there, size, 1.0)[..., None], there


def half_space(chords: Array, has: Booleans, ways: Array, there: Booleans) -> Booleans:
    """Say where no chord is a sum of ways: unit vectors (n, k, 3), and which of them count."""
    axis = unit(np.where(has[..., None], chords, 0.0).sum(axis=1))
    forward = np.where(has, heights(chords, axis), 1.0).min(axis=1)

    def parted(rows: Integers | slice, normal: Array) -> Booleans:
        off = np.where(has[rows], np.abs(heights(chords[rows], normal)), 0.0).max(axis=1)
        least = np.where(there[rows], heights(ways[rows], normal), 1.0).min(axis=1)
        return np.asarray((least > 0) & (least * forward[rows] > off + _UNIT))

    # amid most ways is their mean
    mean = np.where(there[..., None], ways, 0.0).sum(axis=1)
    known = has.any(axis=1) & there.any(axis=1) & (forward > _UNIT)
    done = known & parted(slice(None), unit(mean - dots(mean, axis)[:, None] * axis))
    left = np.flatnonzero(known & ~done)
    if len(left):
        done[left] = parted(left, _amid(ways[left], there[left], axis[left]))
    return np.asarray(done)


def _amid(rays: Array, there: Booleans, axis: Array) -> Array:
    """Return directions (n, 3) across axes that are amid rays (n, k, 3), seen along the axes."""
    flat = rays - heights(rays, axis)[..., None] * axis[:, None]
    flat = np.where(there[..., None], unit(flat), 0.0)
    first = unit(flat.sum(axis=1))
    second = np.cross(axis, first)
    angle = np.arctan2(heights(flat, second), heights(flat, first))
    low = np.where(there, angle, np.inf).min(axis=1, initial=0.0)
    high = np.where(there, angle, -np.inf).max(axis=1, initial=0.0)
    middle = (low + high) / 2
    return np.asarray(np.cos(middle)[:, None] * first + np.sin(middle)[:, None] * second)


def _between(first: Array, has: Booleans, second: Array, there: Booleans) -> Array:
    """Return normals (n, 3) with rays (n, k, 3) on two sides, where such are found soon.

    A perceptron: the ray that is farthest on the wrong side pulls; the best normal is kept. Space
    is stretched first so that the rays lie all round: sides at flat angles are no harder then.
    """
    rays, known = np.concatenate((first, -second), axis=1), np.concatenate((has, there), axis=1)
    rays = np.where(known[..., None], rays, 0.0)
    moments = np.swapaxes(rays, 1, 2) @ rays / np.maximum(known.sum(axis=1), 1)[:, None, None]
    values, axes = np.linalg.eigh(moments + _LEAST * np.eye(3))
    stretch = axes / np.sqrt(values)[:, None] @ np.swapaxes(axes, 1, 2)
    rays = unit(rays @ stretch)
    count = first.shape[1]
    normal = unit(unit(rays[:, :count].sum(axis=1)) + unit(rays[:, count:].sum(axis=1)))
    best, most = normal.copy(), np.full(len(normal), -np.inf)
    left = np.arange(len(normal))
    for _ in range(_TURNS):
        values = heights(rays[left], normal)
        values = np.where(known[left], values, np.inf)
        worst = values.argmin(axis=1)
        least = values[np.arange(len(left)), worst]
        better = least > most[left]
        best[left[better]], most[left[better]] = normal[better], least[better]
        behind = np.flatnonzero(least < _BEFORE)
        if len(behind) == 0:
            break
        normal = unit(normal[behind] + _PULL * rays[left[behind], worst[behind]])
        left = left[behind]
    return unit(np.einsum("nij,nj->ni", stretch, best))


def _on_two_sides(
    first: Array, has: Booleans, second: Array, there: Booleans, normal: Array
) -> Booleans:
    """Say where planes part rays (n, k, 3), and which of them count, whichever lie above."""
    one, other = (heights(rays, normal) for rays in (first, second))
    result = np.zeros(len(normal), dtype=bool)
    for sign in (1.0, -1.0):
        low = np.where(has, sign * one, 1.0).min(axis=1)
        high = np.where(there, sign * other, -1.0).max(axis=1)
        result |= (low > _UNIT) & (high < -_UNIT)
    return result


def _first(vectors: Array, a: Integers, b: Integers) -> Array:
    return vectors[a]


def _second(vectors: Array, a: Integers, b: Integers) -> Array:
    return vectors[b]


def _from_one(points: Array, a: Integers, b: Integers) -> Array:
    return unit(points[a] - points[b])


def _across(first: Array, second: Array, a: Integers, b: Integers) -> Array:
    return unit(cross(first[a], second[b]))


def _axes(cells: Cells) -> list[Callable[[Integers, Integers], Array]]:
    """Return what gives axes that may separate pairs of cells, those that separate most first."""
    s, t, normal, centre = cells.frames
    own = [partial(side, vectors) for vectors in (s, t) for side in (_first, _second)]
    return [
        partial(_first, normal), partial(_second, normal), partial(_from_one, centre), *own,
        *(partial(_across, x, y) for x in (s, t) for y in (s, t)),
    ]  # fmt: skip


@dataclass(frozen=True)
class Separation:
    """The tests, with the length below which differences of control points are rounding."""

    noise: float

    def self_meeting(self, cells: Cells, rows: Integers) -> Booleans:
        """Say which cells may meet themselves."""
        result = ~cells.surfaces.separable[cells.sheet[rows]]
        left = np.flatnonzero(~result)
        pinched = np.asarray(pinched_sides(cells.take(rows), self.noise).any(axis=1))
        for side in (0, 1):
            if len(left) == 0:
                break
            sides = np.full(len(left), 3 * side)
            nets = side_nets(cells, rows[left], sides)
            chords, has = _directions(np.diff(nets, axis=1), self.noise)
            ways, there = _directions(np.diff(nets, axis=2), self.noise)
            parted = half_space(chords, has, ways, there)
            parted &= ~pinched[left]
            left = left[~parted]
        if len(left):
            parted = by_levels(side_nets(cells, rows[left], np.zeros_like(left)), self.noise)
            left = left[~parted]
        result[left] = True
        return result

    def joined_along(self, cells: Cells, pairs: Integers, joints: Joints) -> Booleans:
        """Say which pairs, joined along one edge, meet there only."""
        surfaces = cells.surfaces
        a, b = pairs[:, 0], pairs[:, 1]
        index = joints.sides.reshape(len(pairs), 16).argmax(axis=1)
        parts, both = [], []
        for rows, sides in ((a, index // 4), (b, index % 4)):
            nets = side_nets(cells, rows, sides)
            both.append(nets)
            chords, has = _directions(np.diff(nets[:, :, 0], axis=1), self.noise)
            ways, there = _directions(np.diff(nets, axis=2), self.noise)
            parts.append((chords, has, ways, there))
        (c, hc, p, hp), (d, hd, q, hq) = parts
        axis = np.where(hc[..., None], c, 0.0).sum(axis=1)
        # the second part's side may run the other way
        turn = np.sign(np.einsum("nki,ni->n", np.where(hd[..., None], d, 0.0), axis))
        d = d * np.where(turn < 0, -1.0, 1.0)[:, None, None]
        fine = surfaces.separable[cells.sheet[a]] & surfaces.separable[cells.sheet[b]]
        done = fine & half_space(
            np.concatenate((c, d), axis=1), np.concatenate((hc, hd), axis=1),
            np.concatenate((q, -p), axis=1), np.concatenate((hq, hp), axis=1),
        )  # fmt: skip
        left = np.flatnonzero(~done)
        done[left] = beyond_plane(both[0][left], both[1][left], self.noise)
        return done

    def joined_at(self, cells: Cells, pairs: Integers, joints: Joints) -> Booleans:
        """Say which pairs, joined in a point, meet there only."""
        a, b = pairs[:, 0], pairs[:, 1]
        corner = joints.corners.any(axis=2).argmax(axis=1)
        point = cells.corners[a, corner]
        ways = [cells.points[rows].reshape(len(pairs), -1, 3) - point[:, None] for rows in (a, b)]
        (p, hp), (q, hq) = (_directions(way, self.noise) for way in ways)
        one, other = (
            unit(np.where(has[..., None], rays, 0.0).sum(axis=1))
            for rays, has in ((p, hp), (q, hq))
        )
        # between most of them is the plane amid their means
        done = _on_two_sides(p, hp, q, hq, unit(one - other))
        left = np.flatnonzero(~done)
        if len(left):
            rest = (p[left], hp[left], q[left], hq[left])
            done[left] = _on_two_sides(*rest, _between(*rest))
            left = left[~done[left]]
        if len(left):
            for normal in beyond_corner(ways[0][left], ways[1][left]):
                done[left] |= _on_two_sides(p[left], hp[left], q[left], hq[left], normal)
        return done

    def beside_plane(self, cells: Cells, pairs: Integers) -> Booleans:
        """Say of which pairs one is in a plane that the other meets only on that face's sides."""
        result = np.zeros(len(pairs), dtype=bool)
        planes = cells.surfaces.plane
        for first, second in ((0, 1), (1, 0)):
            flat = planes[cells.sheet[pairs[:, first]]]
            rows = np.flatnonzero((flat >= 0) & ~result)
            if len(rows):
                sheets = cells.sheet[pairs[rows, first]]
                result[rows] = self._above(cells, pairs[rows, second], sheets)
        same = (planes[cells.sheet[pairs[:, 0]]] == planes[cells.sheet[pairs[:, 1]]]) & (
            planes[cells.sheet[pairs[:, 0]]] >= 0
        )
        return np.asarray(result | same)

    def _above(self, cells: Cells, rows: Integers, sheets: Integers) -> Booleans:
        origin, normal = (part[sheets] for part in cells.surfaces.planes)
        n = cells.surfaces.degree + 1
        gap = cells.points[rows].reshape(len(rows), -1, 3) - origin[:, None]
        height = heights(gap, normal)
        edges, vertices = cells.surfaces.borders
        face = cells.surfaces.plane[sheets]
        on_side = edges[face[:, None], cells.edge[rows]]
        free = np.zeros((len(rows), n, n), dtype=bool)
        free[:, :, 0] |= on_side[:, 0, None]
        free[:, -1] |= on_side[:, 1, None]
        free[:, :, -1] |= on_side[:, 2, None]
        free[:, 0] |= on_side[:, 3, None]
        name, where = cells.nodes
        corner = (name[rows] == -2) & vertices[
            face[:, None], np.where(name[rows] == -2, where[rows, :, 0], 0).astype(np.int64)
        ]
        count = edges.shape[1] - 1
        named = (name[rows] >= 0) & (name[rows] < count)
        corner |= named & edges[face[:, None], np.where(named, name[rows], count)]
        for c, (i, j) in enumerate(((0, 0), (-1, 0), (-1, -1), (0, -1))):
            free[:, i, j] |= corner[:, c]
        for k in range(4):
            # a side that is one point of the plane face's
            point = cells.collapsed[rows, k] & corner[:, ENDS[k][0]]
            index = ((slice(None), 0), (-1, slice(None)), (slice(None), -1), (0, slice(None)))[k]
            free[(point.nonzero()[0], *index)] = True
        height = height.reshape(free.shape)
        return rises(height, free, self.noise) | rises(-height, free, self.noise)

    def apart(self, cells: Cells, pairs: Integers, wanted: float = 0.0) -> tuple[Booleans, Array]:
        """Say which pairs an axis separates, and how far each would have to move to be.

        Axes are tried until one leaves a gap as wide as is `wanted`.
        """
        a, b = pairs[:, 0], pairs[:, 1]
        points = cells.points.reshape(len(cells), -1, 3)
        left = np.arange(len(pairs))
        depth = np.full(len(pairs), np.inf)
        for axis_of in _axes(cells):
            one, other = a[left], b[left]
            axis = axis_of(one, other)
            first, second = heights(points[one], axis), heights(points[other], axis)
            gap = np.maximum(
                first.min(axis=1) - second.max(axis=1), second.min(axis=1) - first.max(axis=1)
            )
            over = np.where(axis.any(axis=1), 2 * self.noise - gap, np.inf)
            depth[left] = np.minimum(depth[left], over)
            left = left[over >= -wanted]
            if len(left) == 0:
                break
        return depth < 0, depth
