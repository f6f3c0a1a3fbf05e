"""Quality of a volume mesh: scaled Jacobian, aspect, and the refusal of inverted elements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import product
from pc2cad.errors import NotASolidError
from pc2cad.mesh.elements import COLLAPSED_PYRAMID, TYPES, gradients, rule
from pc2cad.mesh.volume_mesh import VolumeMesh

_CHUNK = 1 << 12


class InvertedElementError(NotASolidError):
    """An element of the mesh is turned inside out, or flat."""


@dataclass(frozen=True)
class Quality:
    """Figures over all elements of a mesh.

    The scaled Jacobian is the product of three edge directions at a corner, over that of the ideal
    element: 1 is best, 0 flat. The aspect is the longest over the shortest edge of an element.
    """

    scaled_jacobian: float
    mean_scaled_jacobian: float
    aspect: float
    mean_aspect: float
    #: sum of the elements' volumes, by Gauss rules
    volume: float
    #: the same for each layer
    layers: Mapping[str, float] = field(default_factory=dict)


def measure(mesh: VolumeMesh) -> Quality:
    """Return the quality of a mesh; raise InvertedElementError where an element is inverted.

    Inverted is an element whose Jacobian determinant is not positive at a node of the Gauss rule
    that solvers integrate it with (2 or 3 nodes per direction for order 1 or 2) or, for order 1,
    at a corner.
    """
    least, aspect = np.inf, 1.0
    sums = np.zeros(3)
    layers = {layer: 0.0 for layer in mesh.layers}
    for name, start, corners, volumes, determinant in _figures(mesh):
        scaled, ratio = corners
        flat = ~((determinant > 0) & (scaled > 0 if mesh.order == 1 else determinant > 0))
        if flat.any():
            _refuse(mesh, name, start + int(np.flatnonzero(flat)[0]), int(flat.sum()))
        least = min(least, float(scaled.min()))
        aspect = max(aspect, float(ratio.max()))
        sums += scaled.sum(), ratio.sum(), volumes.sum()
        for layer, numbers in mesh.layers.items():
            first, last = np.searchsorted(numbers.get(name, ()), (start, start + len(volumes)))
            if first < last:
                layers[layer] += float(volumes[numbers[name][first:last] - start].sum())
    mean = sums / mesh.elements
    return Quality(least, float(mean[0]), aspect, float(mean[1]), float(sums[2]), layers)


_Corners = tuple[Array, Array]


def _figures(mesh: VolumeMesh) -> Iterator[tuple[str, int, _Corners, Array, Array]]:
    """Give, chunk by chunk: type, first element, corner figures, volumes and least determinants."""
    for name, block in mesh.blocks.items():
        shape, columns = name, np.arange(block.shape[1])
        if name == "pyramid":
            shape, columns = "hexahedron", np.array(COLLAPSED_PYRAMID[mesh.order])
        places, weights = rule(shape, mesh.order + 1)
        slopes = gradients(shape, mesh.order, places)
        count = len(places)
        # (nodes, 3 · places): one matrix product gives every tangent at every place
        table = np.ascontiguousarray(slopes.transpose(2, 1, 0).reshape(len(columns), -1).T)
        for start in range(0, len(block), _CHUNK):
            nodes = block[start : start + _CHUNK].T
            axes = [mesh.points[nodes, k] for k in range(3)]
            tangents = [product(table, x[columns]).reshape(3, count, -1) for x in axes]
            determinant = _determinant(*(np.stack([t[d] for t in tangents]) for d in range(3)))
            yield (
                name, start, _at_corners(name, axes), product(weights, determinant),
                determinant.min(axis=0),
            )  # fmt: skip


def _determinant(a: Array, b: Array, c: Array) -> Array:
    """Return a · (b × c) of vectors along the first axis."""
    return np.asarray(
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


def _at_corners(name: str, axes: list[Array]) -> _Corners:
    """Return the least scaled Jacobian and the aspect of each element."""
    kind = TYPES[name]
    edges, lengths = {}, {}
    longest: Array | float = 0.0
    shortest: Array | float = np.inf
    for a, b in kind.edges:
        edge = np.stack([x[b] - x[a] for x in axes])
        length = np.sqrt((edge * edge).sum(axis=0))
        longest, shortest = np.maximum(longest, length), np.minimum(shortest, length)
        edges[a, b], lengths[a, b] = edge, length
        edges[b, a], lengths[b, a] = -edge, length
    least: Array | float = np.inf
    with np.errstate(all="ignore"):
        for corner, *ends in kind.corner_edges:
            product = _determinant(*(edges[corner, end] for end in ends))
            for end in ends:
                product = product / lengths[corner, end]
            least = np.fmin(least, np.where(np.isfinite(product), product, -1.0))
        return np.asarray(least / kind.ideal), np.asarray(longest / shortest)


def _refuse(mesh: VolumeMesh, name: str, element: int, count: int) -> None:
    corners = mesh.points[mesh.blocks[name][element][: len(TYPES[name].corners)]]
    place = ", ".join(f"{x:.6g}" for x in corners.mean(axis=0))
    advice = "take more, or order 2" if mesh.order == 1 else "take more"
    raise InvertedElementError(
        f"{count} element{'s are' if count > 1 else ' is'} inverted or flat, first a {name} at "
        f"({place}): the cells are too coarse for the curvature there; {advice}"
    )
