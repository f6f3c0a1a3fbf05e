"""Fields on voxels: what a printer or a picture of layers asks for, from the map inverted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pc2cad.arrays import Array, Booleans
from pc2cad.arrays.distinct import distinct
from pc2cad.checked import CheckedMap
from pc2cad.domain.fields import local_field
from pc2cad.errors import InputError
from pc2cad.sampling.inversion import Inverse, seed_points

#: voxels along the longest edge of the box where nothing is said, and in all at most
USUAL, MOST = 64, 30_000_000
#: seeds from which a voxel's middle is looked for, the nearest first
_STARTS = 4
_CHUNK = 200_000


@dataclass(frozen=True, eq=False)
class Voxels:
    """A box of cubes: whether their middles are inside, and fields there.

    Arrays are (nz, ny, nx), ascending. Beside the solid a field has the value of a near place of
    it, so that what is interpolated near the surface is right.
    """

    #: the corner of the box, and the edge of a cube, in model units
    low: tuple[float, float, float]
    step: float
    inside: Booleans
    values: Mapping[str, Array]

    @property
    def extent(self) -> tuple[float, float, float]:
        """The edges of the box along x, y and z."""
        nz, ny, nx = self.inside.shape
        return nx * self.step, ny * self.step, nz * self.step

    def middles(self) -> tuple[Array, Array, Array]:
        """Return the coordinates of the cubes' middles along x, y and z."""
        nz, ny, nx = self.inside.shape
        return _middles(self.low, self.step, (nx, ny, nz))


def voxels(checked: CheckedMap, names: Sequence[str] = (), count: int = USUAL) -> Voxels:
    """Return voxels of a solid, `count` along its longest edge, with some of its scalar fields.

    Where M is inverted at a middle it is inside (sampled). Raises InputError for names of no scalar
    field and for too many voxels, and FieldNotFiniteError.
    """
    if not 2 <= count <= 1024:
        raise InputError(f"a box has 2 to 1024 voxels along its longest edge, and not {count}")
    fields = {name: local_field(checked.analysis, name) for name in names}
    for name, field in fields.items():
        if field.field.kind != "scalar":
            raise InputError(f"voxels hold numbers, and the field {name} is a {field.field.kind}")
    places, images = seed_points(checked.analysis)
    low, high = images.min(axis=0), images.max(axis=0)
    step = float((high - low).max()) / count
    # a voxel more on each side: between seeds the surface bulges
    shape = np.ceil((high - low) / step - 1e-9).astype(int) + 2
    low = (low + high - shape * step) / 2
    if shape.prod() > MOST:
        raise InputError(f"{shape.prod():,} voxels are more than {MOST:,}: take fewer")
    x, y, z = _middles(low.tolist(), step, shape.tolist())
    tree, inverse = cKDTree(images), Inverse(checked.analysis)
    reach = _spacing(places, images) + 2 * step
    inside = np.zeros((len(z), len(y), len(x)), dtype=bool)
    values = {name: np.empty(inside.shape) for name in fields}
    flat, rows = inside.ravel(), {name: row.ravel() for name, row in values.items()}
    for start in range(0, inside.size, _CHUNK):
        k, j, i = np.unravel_index(np.arange(start, min(start + _CHUNK, inside.size)), inside.shape)
        targets = np.stack((x[i], y[j], z[k]), axis=1)
        local, found = _found(targets, places, tree, inverse, reach)
        part = slice(start, start + len(targets))
        flat[part] = found
        for name, field in fields.items():
            rows[name][part] = field.checked_at(local)[:, 0]
    a, b, c = low.tolist()
    return Voxels((a, b, c), step, inside, values)


def _middles(
    low: Sequence[float], step: float, counts: Sequence[int]
) -> tuple[Array, Array, Array]:
    """Return the coordinates of the middles of cubes of a box along x, y and z."""
    edges = zip(low, counts, strict=True)
    x, y, z = (np.asarray(a + step * (np.arange(n) + 0.5)) for a, n in edges)
    return x, y, z


def _found(
    targets: Array, places: Array, tree: cKDTree, inverse: Inverse, reach: float
) -> tuple[Array, Booleans]:
    """Return local places near targets, and which of them are the targets' own."""
    distance, nearest = tree.query(targets, k=_STARTS)
    local, square = places[nearest[:, 0]].copy(), np.full(len(targets), np.inf)
    asked = np.flatnonzero(distance[:, 0] <= reach)
    for rank in range(_STARTS):
        if not len(asked):
            break
        there, gap = inverse.descend(targets[asked], places[nearest[asked, rank]])
        better = gap < square[asked]
        local[asked[better]], square[asked[better]] = there[better], gap[better]
        asked = asked[square[asked] > inverse.tolerance**2]
    return local, square <= inverse.tolerance**2


def _spacing(places: Array, images: Array) -> float:
    """Return how far a place may be from the nearest seed: across the largest cell of them."""
    sizes = [len(distinct(places[:, d])) for d in range(3)]
    grid = images.reshape(*sizes, 3)
    return sum(
        float(np.sqrt((np.diff(grid, axis=d) ** 2).sum(axis=-1)).max()) for d in range(3)
    ) / 2  # fmt: skip
