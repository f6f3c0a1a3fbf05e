"""MFEM NURBS meshes (.mesh), version 1.0, in the form with patches.

A direction in which the solid closes is divided into three patches at least, because MFEM's
elements need different vertices; sides that are glued with a turn stay open. Collapsed sides have
equal poles.
"""

from __future__ import annotations

from itertools import product

from pc2cad.export.spline_files import numbers, rows
from pc2cad.geometry.trivariate import SplineVolume
from pc2cad.isogeometry import VolumeModel

#: corners of a hexahedron in MFEM's order, and its sides, outwards
_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
_SIDES = ((3, 0, 4, 7), (1, 2, 6, 5), (0, 1, 5, 4), (2, 3, 7, 6), (3, 2, 1, 0), (4, 5, 6, 7))
#: fewest patches round
_ROUND = 3


def encode(model: VolumeModel) -> str:
    """Return the text of the file; coordinates are Cartesian, every pole has a weight.

    Boundary attributes are 1 … 6 for the lower and upper side of the first, second, third axis.
    """
    closed = [model.closes(d) for d in model.directions]
    pieces = [model.pieces[d] for d in model.directions]
    parts = [-(-_ROUND // n) if c else 1 for n, c in zip(pieces, closed, strict=True)]
    lattice = _Lattice([n * k for n, k in zip(pieces, parts, strict=True)], closed)
    blocks: list[tuple[tuple[int, ...], SplineVolume]] = []
    for patch in model.patches:
        first = [patch.cell[d] // 2 * k for d, k in zip(model.directions, parts, strict=True)]
        for steps, volume in _divided(patch.volume, parts):
            blocks.append((tuple(a + b for a, b in zip(first, steps, strict=True)), volume))
    elements = [lattice.corners(place) for place, _ in blocks]
    boundary = [
        f"{side + 1} 3 " + " ".join(str(corners[k]) for k in _SIDES[side])
        for (place, _), corners in zip(blocks, elements, strict=True)
        for side in range(6)
        if lattice.ends(place, side)
    ]
    edges = lattice.edges()
    lines = ["MFEM NURBS mesh v1.0", "", "dimension", "3", "", "elements", str(len(elements))]
    lines += ["1 5 " + " ".join(map(str, corners)) for corners in elements]
    lines += ["", "boundary", str(len(boundary)), *boundary]
    lines += ["", "edges", str(len(edges))]
    lines += [f"{knot} {a} {b}" for (a, b), knot in edges.items()]
    lines += ["", "vertices", str(lattice.count), "", "patches"]
    for _, volume in blocks:
        lines += ["", "knotvectors", "3"]
        for axis in volume.axes:
            space = axis.space
            lines.append(f"{space.degree} {space.size} {numbers(space.knots)}")
        lines += ["", "dimension", "3", "", "controlpoints_cartesian"]
        tail = " 1" if volume.weights is None else ""
        lines += [row + tail for row in rows(volume, homogeneous=False)]
    return "\n".join(lines) + "\n"


def _divided(volume: SplineVolume, parts: list[int]) -> list[tuple[list[int], SplineVolume]]:
    """Return the parts of a volume, divided along each axis, with their places."""
    blocks = [([0, 0, 0], volume)]
    for axis, count in enumerate(parts):
        if count > 1:
            blocks = [
                ([*place[:axis], k, *place[axis + 1 :]], part)
                for place, whole in blocks
                for k, part in enumerate(whole.split(axis, count))
            ]
    return blocks


class _Lattice:
    """Vertices and knot vectors of a box of patches, the axes in the file's order."""

    def __init__(self, patches: list[int], closed: list[bool]) -> None:
        self._patches = patches
        self._closed = closed
        self._shape = [n + (0 if c else 1) for n, c in zip(patches, closed, strict=True)]
        self.count = self._shape[0] * self._shape[1] * self._shape[2]

    def _vertex(self, place: list[int]) -> int:
        i, j, k = (p % n for p, n in zip(place, self._shape, strict=True))
        return (i * self._shape[1] + j) * self._shape[2] + k

    def corners(self, place: tuple[int, ...]) -> list[int]:
        """Return the vertices of a patch in MFEM's order."""
        return [
            self._vertex([p + c for p, c in zip(place, corner, strict=True)]) for corner in _CORNERS
        ]

    def ends(self, place: tuple[int, ...], side: int) -> bool:
        """Say whether a side of a patch ends the box."""
        axis, upper = divmod(side, 2)
        last = self._patches[axis] - 1 if upper else 0
        return not self._closed[axis] and place[axis] == last

    def edges(self) -> dict[tuple[int, int], int]:
        """Return the edges, each along its axis, with the number of its knot vector."""
        found: dict[tuple[int, int], int] = {}
        first = 0
        for axis in range(3):
            for piece in range(self._patches[axis]):
                spans = [range(n + 1) for n in self._patches]
                spans[axis] = range(piece, piece + 1)
                for place in product(*spans):
                    end = list(place)
                    end[axis] += 1
                    found[self._vertex(list(place)), self._vertex(end)] = first + piece
            first += self._patches[axis]
        return found
