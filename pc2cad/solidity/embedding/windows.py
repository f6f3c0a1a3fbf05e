"""Windows of two by two patches, in which a sheet, or two sides of a wall, cannot meet.

The straight way of parameters between two places of a window is a sum of tangents along s and t;
where cones that hold these have only the zero in common, both ways round, it does not come back. Of
two sheets on one grid of patches the straight way leads from one to the other, through the solid
between them: a sum of tangents of both and of ways across. This does with one look what would be
ten pairs of patches, and for walls however thin.
"""

from __future__ import annotations

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.geometry.sheets import projected
from pc2cad.solidity.embedding.cells import Cells, Surfaces, cells_of, lengths, unit

#: axes (n, m, 3) and how far unit vectors are from them at most, as chords (n, m)
_Cones = tuple[Array, Array]


def not_in_windows(surfaces: Surfaces, pairs: Integers, noise: float) -> Integers:
    """Return the pairs of patches that no window shows to meet nowhere, or only where joined."""
    sheet, place = surfaces.sheet_of, surfaces.place
    a, b = pairs[:, 0], pairs[:, 1]
    one, other = sheet[a], sheet[b]
    flat = (surfaces.plane[one] >= 0) & (surfaces.plane[one] == surfaces.plane[other])
    near = (np.abs(place[a] - place[b]) <= 1).all(axis=1)
    near &= (surfaces.shapes[one] == surfaces.shapes[other]).all(axis=1) & ~flat
    near &= surfaces.separable[one] & surfaces.separable[other]
    done = flat.copy()
    cones: dict[int, tuple[_Cones, _Cones]] = {}
    keys = one[near] * len(surfaces.sheets) + other[near]
    for key, count in zip(*np.unique(keys, return_counts=True), strict=True):
        i, j = divmod(int(key), len(surfaces.sheets))
        n, m = (int(x) for x in surfaces.shapes[i])
        if count < max(4, n * m):
            continue  # they only touch along a side, or are few
        for k in (i, j):
            if k not in cones:
                cones[k] = _tangents(surfaces, k, noise)
        holds = _wall(surfaces, i, j, cones, noise) if i != j else _alone(cones[i])
        if holds is None:
            continue
        rows = np.flatnonzero(near & (one == i) & (other == j))
        corner = np.minimum(np.minimum(place[a[rows]], place[b[rows]]), np.array(holds.shape) - 1)
        done[rows] = holds[corner[:, 0], corner[:, 1]]
    return np.asarray(pairs[~done])


def parted_walls(cells: Cells, pairs: Integers, noise: float) -> Booleans:
    """Say which pairs of cells, side by side on two sheets of one grid, a wall keeps apart.

    Their own rectangle of parameters is looked at, on both sheets.
    """
    surfaces, result = cells.surfaces, np.zeros(len(pairs), dtype=bool)
    a, b = pairs[:, 0], pairs[:, 1]
    one, other = cells.sheet[a], cells.sheet[b]
    near = (one != other) & surfaces.walls[one, other]
    size = cells.high - cells.low
    near &= (size[a] == size[b]).all(axis=1)
    apart = cells.limits[0][b] - cells.limits[0][a]
    # cells may be halved until nothing is left of them
    step = np.divide(apart, size[a], out=np.full_like(apart, np.inf), where=size[a] > 0)
    near &= (np.abs(step) <= 1).all(axis=1)
    rows = np.flatnonzero(near)
    if len(rows) == 0:
        return result
    a, b, step = a[rows], b[rows], step[rows]
    parts: list[list[_Cones]] = [[], [], []]
    for shift in ((0, 0), (1, 0), (0, 1), (1, 1)):
        low = cells.limits[0][a] + np.array(shift) * step * size[a]
        nets = []
        for sheet in (cells.sheet[a], cells.sheet[b]):
            place = np.floor(low).astype(np.int64)
            patch = surfaces.start[sheet] + place[:, 0] * surfaces.shapes[sheet, 1] + place[:, 1]
            nets.append(cells_of(surfaces, patch, low - place, low - place + size[a]).points)
        for net in nets:
            for axis in (1, 2):
                vectors = np.diff(net, axis=axis).reshape(len(rows), 1, -1, 3)
                parts[axis - 1].append(_cones(vectors, noise))
        parts[2].append(_cones((nets[1] - nets[0]).reshape(len(rows), 1, -1, 3), noise))
    (s, r), (t, q), (w, p) = (_joint(part) for part in parts)
    volume = np.abs(np.einsum("nmi,nmi->nm", np.cross(s, t), w))
    result[rows] = (volume > (1 + r) * (1 + q) * (1 + p) - 1)[:, 0]
    return result


def _tangents(surfaces: Surfaces, sheet: int, noise: float) -> tuple[_Cones, _Cones]:
    """Return the cones of tangents along s and t of a sheet's windows."""
    n, m = surfaces.shapes[sheet]
    start = surfaces.start[sheet]
    points = projected(surfaces.nets[start : start + n * m])
    found = []
    for axis in (1, 2):
        steps = np.diff(points, axis=axis).reshape(n, m, -1, 3)
        found.append(_windows(_cones(steps, noise)))
    return found[0], found[1]


def _cones(vectors: Array, noise: float) -> _Cones:
    """Return the cones that hold vectors (n, m, k, 3) longer than rounding."""
    size = lengths(vectors)
    there = size > noise
    ways = np.where(there, 1 / np.where(there, size, 1.0), 0.0)[..., None] * vectors
    axis = unit(ways.sum(axis=2))
    gap = lengths(ways - axis[:, :, None])
    return axis, np.where(there, gap, 0.0).max(axis=2) + np.where(there.any(axis=2), 0.0, 2.0)


def _windows(cones: _Cones) -> _Cones:
    """Return the cones of windows of two by two patches, as far as there are two."""
    axes, radii = cones
    shifts = [(slice(None, -1), slice(1, None)) if k > 1 else (slice(None),) for k in radii.shape]
    parts = [(axes[i, j], radii[i, j]) for i in shifts[0] for j in shifts[1]]
    return _joint(parts)


def _joint(parts: list[_Cones]) -> _Cones:
    axis = unit(np.sum([part[0] for part in parts], axis=0))
    return axis, np.max([lengths(a - axis) + r for a, r in parts], axis=0)


def _alone(cones: tuple[_Cones, _Cones]) -> Booleans:
    """Say in which windows of a sheet tangents along s and t are never parallel."""
    (a, r), (b, q) = cones
    sine = lengths(np.cross(a, b))
    return np.asarray(sine > (1 + r) * (1 + q) - 1)


def _wall(
    surfaces: Surfaces, i: int, j: int, cones: dict[int, tuple[_Cones, _Cones]], noise: float
) -> Booleans | None:
    """Say in which windows of two sheets on one grid the way across leads out of both."""
    if not surfaces.walls[i, j]:
        return None
    n, m = surfaces.shapes[i]
    nets = [surfaces.nets[surfaces.start[k] : surfaces.start[k] + n * m] for k in (i, j)]
    across = (projected(nets[1]) - projected(nets[0])).reshape(n, m, -1, 3)
    w, p = _windows(_cones(across, noise))
    (a, r), (b, q) = (_joint([x, y]) for x, y in zip(cones[i], cones[j], strict=True))
    size = np.abs(np.einsum("nmi,nmi->nm", np.cross(a, b), w))
    return np.asarray(size > (1 + r) * (1 + q) * (1 + p) - 1)
