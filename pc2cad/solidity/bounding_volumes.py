"""Blocks of the boundary's cells in levels, from cells to whole faces, and what parts two of them.

Boxes in seven directions round two blocks may not meet. Or two blocks adjoin on one face, or lie
opposite to one another on two sides of a wall, and M's tangents keep within cones there that no
straight path of parameters can come back in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.linear import cross, unit
from pc2cad.solidity.face_mesh import FaceMesh, by_shape
from pc2cad.topology.cells import normal_direction

#: unit axes (…, k, 3) and how far a tangent is from them at most (…, k)
Cones = tuple[Array, Array]

#: three axes and four diagonals of space
_DIRECTIONS = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]], dtype=float
)
_DIRECTIONS /= np.sqrt((_DIRECTIONS**2).sum(axis=1, keepdims=True))
#: pairs whose boxes are compared at once, for a processor's own memory
_SLAB = 32_768
#: between three samples a quadratic bows a quarter as far as the middle one from the ends' chord
BETWEEN = 0.3


@dataclass(frozen=True, eq=False)
class Level:
    """Cells, or blocks of them, of all faces: rows of arrays."""

    low: Array  # (N, 7)
    high: Array
    #: mean unit tangents along s and t, and across the wall, and how far any is from that
    axes: Array  # (N, 3, 3)
    radii: Array  # (N, 3)
    face: Integers
    place: Integers  # (N, 2): row and column
    #: first row and shape per face
    start: Integers
    shape: Integers  # (faces, 2)
    #: how many of the next finer level's rows and columns make one here, per face
    factor: Integers  # (faces, 2)


def opposite_faces(face_meshes: Sequence[FaceMesh]) -> Integers:
    """Return, per face, the face over the same parameters at the other limit, or -1."""
    over: dict[tuple[int, ...], list[int]] = {}
    for f, face_mesh in enumerate(face_meshes):
        cell = face_mesh.function.cell
        across = normal_direction(cell)
        parameters = tuple(-1 if d == across else p for d, p in enumerate(cell))
        over.setdefault(parameters, []).append(f)
    result = np.full(len(face_meshes), -1)
    for row in over.values():
        for f in row:
            result[f] = next((other for other in reversed(row) if other != f), -1)
    return result


# -- blocks of cells -----------------------------------------------------------------------------


def build_levels(face_meshes: Sequence[FaceMesh], opposite: Integers) -> list[Level]:
    """Return the levels from cells to whole faces."""
    faces = by_shape(face_meshes)
    stacks = [_leaves(face_meshes, group, opposite) for group in faces]
    levels = [_level(stacks, faces, [(1, 1)] * len(stacks))]
    while max(max(stack[0].shape[1:3]) for stack in stacks) > 1:
        factors = [_factor(stack) for stack in stacks]
        stacks = [_halved(stack, *factor) for stack, factor in zip(stacks, factors, strict=True)]
        levels.append(_level(stacks, faces, factors))
    return levels


#: faces of one shape: boxes (faces, n, m, 7), axes (faces, n, m, 3, 3) and radii (faces, n, m, 3)
_Stack = tuple[Array, Array, Array, Array]


def _level(stacks: list[_Stack], faces: list[list[int]], factors: list[tuple[int, int]]) -> Level:
    order = np.concatenate(faces).astype(np.int64)
    counts = [len(group) for group in faces]
    shapes = np.repeat([stack[0].shape[1:3] for stack in stacks], counts, axis=0)
    sizes = shapes.prod(axis=1)
    low, high, axes, radii = (
        np.concatenate([stack[k].reshape(-1, *stack[k].shape[3:]) for stack in stacks])
        for k in range(4)
    )
    place = np.concatenate([
        np.tile(np.indices(stack[0].shape[1:3]).reshape(2, -1).T, (count, 1))
        for stack, count in zip(stacks, counts, strict=True)
    ])  # fmt: skip
    start, shape, factor = np.empty_like(order), np.empty_like(shapes), np.empty_like(shapes)
    start[order] = np.cumsum(sizes) - sizes
    shape[order] = shapes
    factor[order] = np.repeat(factors, counts, axis=0)
    face = np.repeat(order, sizes)
    return Level(low, high, axes, radii, face, place, start, shape, factor)


def spread(vectors: Array) -> tuple[Array, Array]:
    """Return the mean direction of unit vectors (…, k, 3) and their largest distance from it."""
    axis = unit(vectors.sum(axis=-2))
    gap = vectors - axis[..., None, :]
    return axis, np.sqrt(np.einsum("...i,...i->...", gap, gap).max(axis=-1))


def _corners(samples: Array) -> list[Array]:
    """Return the nine samples of every cell of grids (F, 2n+1, 2m+1, …) as nine (F, n, m, …)."""
    n, m = samples.shape[1] - 1, samples.shape[2] - 1
    return [samples[:, i : n + i : 2, j : m + j : 2] for i in range(3) for j in range(3)]


def _leaves(face_meshes: Sequence[FaceMesh], faces: list[int], opposite: Integers) -> _Stack:
    """Return the cells of some faces of one shape."""
    g = np.stack([face_meshes[f].samples for f in faces])
    slack = BETWEEN * bow(g)
    parts = _corners(g @ _DIRECTIONS.T)
    low, high = parts[0], parts[0]
    for part in parts[1:]:
        low, high = np.minimum(low, part), np.maximum(high, part)
    shape = (len(faces), *face_meshes[faces[0]].shape, 3)
    axes, radii = np.zeros((*shape, 3)), np.full(shape, 2.0)
    step_s, step_t = unit(g[:, 1:] - g[:, :-1]), unit(g[:, :, 1:] - g[:, :, :-1])
    n, m = 2 * shape[1], 2 * shape[2]
    edges = (
        np.stack([step_s[:, i:n:2, j : m + j : 2] for i in (0, 1) for j in (0, 1, 2)], axis=3),
        np.stack([step_t[:, i : n + i : 2, j:m:2] for i in (0, 1, 2) for j in (0, 1)], axis=3),
    )
    for k, vectors in enumerate(edges):
        axes[..., k, :], radii[..., k] = spread(vectors)
    walls = [k for k, f in enumerate(faces) if opposite[f] >= 0]
    if walls:
        # both sides of a wall take the way across it in one sense
        sides = [sorted((faces[k], int(opposite[faces[k]]))) for k in walls]
        ways = np.stack([face_meshes[b].samples - face_meshes[a].samples for a, b in sides])
        axis, radius = spread(np.stack(_corners(unit(ways)), axis=3))
        axes[walls, ..., 2, :] = axis
        thin = may_vanish(ways)
        radii[walls, ..., 2] = np.where(thin, 2.0, radius)
        slack[walls] /= np.where(thin, BETWEEN, 1.0)
    return low - slack[..., None], high + slack[..., None], axes, radii


def bow(samples: Array) -> Array:
    """Return how far the middle samples are from the chords, per cell of (…, 2n+1, 2m+1, 3)."""
    g = samples
    along = _off_chord(g[..., :-1:2, :, :], g[..., 1::2, :, :], g[..., 2::2, :, :])
    across = _off_chord(g[..., :-1:2, :], g[..., 1::2, :], g[..., 2::2, :])
    along = np.maximum(np.maximum(along[..., :-1:2], along[..., 1::2]), along[..., 2::2])
    across = np.maximum(
        np.maximum(across[..., :-1:2, :], across[..., 1::2, :]), across[..., 2::2, :]
    )
    return np.asarray(along + across)


def may_vanish(ways: Array, rounding: float = 0.0) -> Booleans:
    """Say in which cells of vectors (…, 2n+1, 2m+1, 3) one may be nought, by samples and bow."""
    size = np.sqrt(np.einsum("...i,...i->...", ways, ways))
    n, m = size.shape[-2] - 1, size.shape[-1] - 1
    least = [size[..., i : n + i : 2, j : m + j : 2] for i in range(3) for j in range(3)]
    return np.asarray(np.minimum.reduce(least) <= bow(ways) + rounding)


def _off_chord(start: Array, middle: Array, end: Array) -> Array:
    """Return how far the middles of chords are from points, but for what they moved along them.

    A quadratic whose middle moved along its chord by less than a quarter of it runs forward all the
    way, within the chord's ends; beyond that it overshoots one of them. An eighth is let pass.
    """
    chord, offset = end - start, middle - (start + end) / 2
    length = np.einsum("...i,...i->...", chord, chord)
    along = np.einsum("...i,...i->...", chord, offset)
    square = np.einsum("...i,...i->...", offset, offset)
    across = square - along * along / np.where(length > 0, length, 1.0)
    forward = 8 * np.abs(along) <= length
    return np.asarray(np.sqrt(np.where(forward, np.maximum(across, 0.0), square)))


def overshoots(samples: Array) -> Booleans:
    """Say of cells (N, 3, 3, 3) whether one may run beyond the ends of its chords along s."""
    chord, offset = (
        samples[:, 2] - samples[:, 0],
        samples[:, 1] - (samples[:, 0] + samples[:, 2]) / 2,
    )
    length = np.einsum("...i,...i->...", chord, chord)
    along = np.einsum("...i,...i->...", chord, offset)
    return np.asarray((8 * np.abs(along) > length).any(axis=1))


def _factor(stack: _Stack) -> tuple[int, int]:
    """Return how many rows and columns to join: along the shorter side of the blocks first."""
    low, high, axes, _ = stack
    n, m = low.shape[1:3]
    if n == 1 or m == 1:
        return min(n, 2), min(m, 2)
    extent = (high - low)[..., :3]
    along, across = (float((extent * np.abs(axes[..., k, :])).sum()) for k in (0, 1))
    return (2 if along < 1.6 * across else 1), (2 if across < 1.6 * along else 1)


def _halved(stack: _Stack, rows: int, columns: int) -> _Stack:
    low, high, axes, radii = stack
    for axis, factor in ((1, rows), (2, columns)):
        if factor == 1:
            continue
        starts = np.arange(0, low.shape[axis], 2)
        mean = unit(np.add.reduceat(axes, starts, axis=axis))
        which = np.arange(low.shape[axis]) // 2
        gap = axes - np.take(mean, which, axis=axis)
        radii = radii + np.sqrt(np.einsum("...i,...i->...", gap, gap))
        radii = np.maximum.reduceat(radii, starts, axis=axis)
        axes = mean
        low = np.minimum.reduceat(low, starts, axis=axis)
        high = np.maximum.reduceat(high, starts, axis=axis)
    return low, high, axes, radii


# -- pairs of blocks -----------------------------------------------------------------------------


def children(level: Level, coarser: Level, pairs: Integers) -> Integers:
    """Return all pairs of parts of paired blocks, each pair once."""
    parts, exist = _parts(level, coarser)
    a, b = pairs.T
    first, second = parts[:, None, a], parts[None, :, b]
    chosen = exist[:, None, a] & exist[None, :, b] & ~((a == b) & (first > second))
    both = np.broadcast_arrays(first, second)
    return np.stack([side[chosen] for side in both], axis=1)


def _parts(level: Level, coarser: Level) -> tuple[Integers, Booleans]:
    """Return the four parts that a block may have, (4, blocks), and which of them it has."""
    factor, shape = coarser.factor[coarser.face].T, level.shape[coarser.face].T
    step = np.indices((2, 2)).reshape(2, 4, 1)
    row, column = here = coarser.place.T[:, None] * factor[:, None] + step
    exist = ((step < factor[:, None]) & (here < shape[:, None])).all(axis=0)
    return level.start[coarser.face] + row * shape[1] + column, np.asarray(exist)


def meet(level: Level, pairs: Integers) -> Booleans:
    """Say of which pairs the boxes meet."""
    result = np.zeros(len(pairs), dtype=bool)
    rows = [(low.copy(), high.copy()) for low, high in zip(level.low.T, level.high.T, strict=True)]
    for start in range(0, len(pairs), _SLAB):
        left = np.arange(start, min(start + _SLAB, len(pairs)))
        a, b = pairs[left, 0], pairs[left, 1]
        # most are parted along the first directions
        for low, high in rows:
            near = (low[a] <= high[b]) & (low[b] <= high[a])
            left, a, b = left[near], a[near], b[near]
        result[left] = True
    return result


def cannot_return(level: Level, pairs: Integers, opposite: Integers) -> Booleans:
    """Say which pairs the tangents part: adjoining on one face, or on two sides of a wall."""
    a, b = pairs[:, 0], pairs[:, 1]
    near = (np.abs(level.place[a] - level.place[b]) <= 1).all(axis=1)
    same = near & (level.face[a] == level.face[b])
    wall = near & (opposite[level.face[a]] == level.face[b])
    result = np.zeros(len(pairs), dtype=bool)
    for chosen, crossing in ((same, False), (wall, True)):
        rows = np.flatnonzero(chosen)
        if len(rows):
            first, second = ((level.axes[k[rows]], level.radii[k[rows]]) for k in (a, b))
            result[rows] = independent(first, second, crossing)
    return result


def independent(first: Cones, second: Cones, crossing: bool) -> Booleans:
    """Say where tangents within the joint cones of two blocks are never linearly dependent.

    The way between two images is a sum of the tangents along a straight path of parameters; it is
    zero only if they are. A cone is three unit axes (…, 3, 3) and their radii (…, 3).
    """
    mean = unit(first[0] + second[0])
    reaches = []
    for axes, radii in (first, second):
        gap = axes - mean
        reaches.append(radii + np.sqrt(np.einsum("...i,...i->...", gap, gap)))
    reach = np.maximum(*reaches)
    normal = cross(mean[:, 0], mean[:, 1])
    if crossing:
        size = np.abs(np.einsum("...i,...i->...", normal, mean[:, 2]))
        return np.asarray(size > (1 + reach).prod(axis=1) - 1)
    size = np.sqrt(np.einsum("...i,...i->...", normal, normal))
    return np.asarray(size > (1 + reach[:, :2]).prod(axis=1) - 1)


def adjoining(face_meshes: Sequence[FaceMesh], leaf: Level, pairs: Integers) -> Booleans:
    """Say which pairs of cells share a corner."""
    numbers = np.empty((len(leaf.face), 4), dtype=np.int64)
    for face_mesh, start in zip(face_meshes, leaf.start, strict=True):
        n = face_mesh.nodes
        corners = np.stack([n[:-1, :-1], n[:-1, 1:], n[1:, :-1], n[1:, 1:]], axis=2)
        numbers[start : start + corners[..., 0].size] = corners.reshape(-1, 4)
    first, second = numbers[pairs[:, 0]], numbers[pairs[:, 1]]
    return np.asarray((first[:, :, None] == second[:, None, :]).any(axis=(1, 2)))
