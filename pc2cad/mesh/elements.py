"""The element types of volume meshes: numbering of nodes, edges and faces, shape functions.

Nodes are numbered as in VTK (Abaqus, CalculiX and gmsh number corners alike), faces as CalculiX
numbers S1, S2, …; the nodes of a face run anti-clockwise as seen from outside. The order-2 forms
have a node at the middle of every edge (serendipity).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product

import numpy as np

from pc2cad.arrays import Array


@dataclass(frozen=True)
class ElementType:
    """One shape of element."""

    name: str
    #: corners in reference coordinates
    corners: tuple[tuple[float, ...], ...]
    #: corners of each edge; the nodes of order 2 are their middles, in this order
    edges: tuple[tuple[int, int], ...]
    #: corners of each face, anti-clockwise from outside
    faces: tuple[tuple[int, ...], ...]
    #: a product of edge vectors at a corner over their lengths, for the ideal element
    ideal: float

    def size(self, order: int) -> int:
        """Return the number of nodes."""
        return len(self.corners) + (len(self.edges) if order == 2 else 0)

    @cached_property
    def corner_edges(self) -> tuple[tuple[int, int, int, int], ...]:
        """Per corner with three edges: it and their other ends, right-handed."""
        points = np.array(self.corners, dtype=float)
        rows = []
        for corner in range(len(self.corners)):
            ends = [b if a == corner else a for a, b in self.edges if corner in (a, b)]
            if len(ends) == 3:
                x, y, z = ends
                turned = np.linalg.det(points[ends] - points[corner]) < 0
                rows.append((corner, y, x, z) if turned else (corner, x, y, z))
        return tuple(rows)

    def face_nodes(self, face: int, order: int) -> list[int]:
        """Return a face's corners and, for order 2, the middles of its edges in the same order."""
        ring = self.faces[face]
        nodes = list(ring)
        if order == 2:
            index = {frozenset(edge): len(self.corners) + k for k, edge in enumerate(self.edges)}
            nodes += [
                index[frozenset((a, b))] for a, b in zip(ring, ring[1:] + ring[:1], strict=True)
            ]
        return nodes


HEXAHEDRON = ElementType(
    "hexahedron",
    ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
    ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4),
     (0, 4), (1, 5), (2, 6), (3, 7)),
    ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    1.0,
)  # fmt: skip
WEDGE = ElementType(
    "wedge",
    ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)),
    ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    3**0.5 / 2,
)
PYRAMID = ElementType(
    "pyramid",
    ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 1)),
    ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    0.5**0.5,
)
TETRAHEDRON = ElementType(
    "tetra",
    ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
    0.5**0.5,
)
#: all types, in the order in which a mesh numbers its elements
TYPES = {t.name: t for t in (HEXAHEDRON, WEDGE, PYRAMID, TETRAHEDRON)}
#: a pyramid as a hexahedron with one face collapsed: how shape functions are defined on it
COLLAPSED_PYRAMID = {
    1: (0, 1, 2, 3, 4, 4, 4, 4),
    2: (0, 1, 2, 3, 4, 4, 4, 4, 5, 6, 7, 8, 4, 4, 4, 4, 9, 10, 11, 12),
}

_Exponents = list[tuple[int, ...]]


def _basis(name: str, order: int) -> _Exponents:
    """Return the monomials that an element's shape functions span."""
    cube = list(product(range(order + 1), repeat=3))
    square = list(product(range(order + 1), repeat=2))
    if name == "hexahedron":
        return cube if order == 1 else [e for e in cube if _superlinear(e) <= 2]
    if name == "tetra":
        return [e for e in cube if sum(e) <= order]
    if name == "wedge":
        flat = [e for e in square if sum(e) <= order]
        rows = [(*e, k) for e in flat for k in range(2)]
        return rows if order == 1 else rows + [(*e, 2) for e in flat if sum(e) <= 1]
    if name == "quad":
        return square if order == 1 else [e for e in square if _superlinear(e) <= 2]
    return [e for e in square if sum(e) <= order]


def _superlinear(exponents: tuple[int, ...]) -> int:
    return sum(e for e in exponents if e > 1)


def _monomials(places: Array, exponents: _Exponents) -> Array:
    return np.stack([np.prod(places ** np.array(e), axis=-1) for e in exponents], axis=-1)


@lru_cache(maxsize=64)
def _coefficients(name: str, order: int) -> Array:
    """Return the matrix from monomials to shape functions."""
    nodes = _reference_nodes(name, order)
    return np.asarray(np.linalg.inv(_monomials(nodes, _basis(name, order))))


def _reference_nodes(name: str, order: int) -> Array:
    if name == "quad":
        corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    elif name == "triangle":
        corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]
    else:
        kind = TYPES[name]
        points = np.array(kind.corners, dtype=float)
        middles = [(points[a] + points[b]) / 2 for a, b in kind.edges]
        return np.array([*points, *middles]) if order == 2 else points
    points = np.array(corners)
    middles = list((points + np.roll(points, -1, axis=0)) / 2)
    return np.array([*points, *middles]) if order == 2 else points


def gradients(name: str, order: int, places: Array) -> Array:
    """Return the derivatives of the shape functions, (places, dimensions, nodes)."""
    exponents = np.array(_basis(name, order))
    rows = []
    for axis in range(exponents.shape[1]):
        lowered = exponents.copy()
        lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
        table = _monomials(places, [tuple(e) for e in lowered]) * exponents[:, axis]
        rows.append(table @ _coefficients(name, order))
    return np.stack(rows, axis=1)


def shapes(name: str, order: int, places: Array) -> Array:
    """Return the values of the shape functions, (places, nodes)."""
    return np.asarray(_monomials(places, _basis(name, order)) @ _coefficients(name, order))


@lru_cache(maxsize=64)
def rule(name: str, count: int) -> tuple[Array, Array]:
    """Return places and weights on the reference element: Gauss, collapsed for triangles."""
    x, weight = np.polynomial.legendre.leggauss(count)
    x, weight = (x + 1) / 2, weight / 2
    dimensions = 2 if name in ("quad", "triangle") else 3
    places = np.array(list(product(x, repeat=dimensions)))
    weights = np.array([np.prod(w) for w in product(weight, repeat=dimensions)])
    if name in ("triangle", "wedge", "tetra"):
        weights = weights * (1 - places[:, 1])
        places[:, 0] *= 1 - places[:, 1]
    if name == "tetra":
        weights = weights * (1 - places[:, 2]) ** 2
        places[:, :2] *= (1 - places[:, 2])[:, None]
    return places, weights
