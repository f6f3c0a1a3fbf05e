"""MFEM NURBS meshes (.mesh), version 1.0, in the form with patches.

Sides that the solid glues stay open unless the direction has three pieces or more: MFEM's elements
need different vertices. Collapsed sides have equal poles.
"""

from __future__ import annotations

from itertools import product

from pc2cad.export.patches import sides
from pc2cad.export.spline_files import numbers, rows
from pc2cad.isogeometry import VolumeModel

#: corners of a hexahedron in MFEM's order, and its sides, outwards
_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
_SIDES = ((3, 0, 4, 7), (1, 2, 6, 5), (0, 1, 5, 4), (2, 3, 7, 6), (3, 2, 1, 0), (4, 5, 6, 7))


def encode(model: VolumeModel) -> str:
    """Return the text of the file; coordinates are Cartesian, every pole has a weight."""
    lattice = _Lattice(model)
    fates = list(sides(model))
    elements = [lattice.corners(k) for k in range(len(model.patches))]
    boundary = [
        f"{side + 1} 3 " + " ".join(str(elements[patch][k]) for k in _SIDES[side])
        for patch, side, _, fate in fates
        if fate is not None and not lattice.closed[model.directions[side // 2]]
    ]
    edges = lattice.edges()
    lines = ["MFEM NURBS mesh v1.0", "", "dimension", "3", "", "elements", str(len(elements))]
    lines += ["1 5 " + " ".join(map(str, corners)) for corners in elements]
    lines += ["", "boundary", str(len(boundary)), *boundary]
    lines += ["", "edges", str(len(edges))]
    lines += [f"{knot} {a} {b}" for (a, b), knot in edges.items()]
    lines += ["", "vertices", str(lattice.count), "", "patches"]
    for patch in model.patches:
        lines += ["", "knotvectors", "3"]
        for axis in patch.volume.axes:
            space = axis.space
            lines.append(f"{space.degree} {space.size} {numbers(space.knots)}")
        lines += ["", "dimension", "3", "", "controlpoints_cartesian"]
        polynomial = patch.volume.weights is None
        lines += [f"{row} 1" if polynomial else row for row in rows(patch, homogeneous=False)]
    return "\n".join(lines) + "\n"


class _Lattice:
    """Vertices and knot vectors of the pieces of the box."""

    def __init__(self, model: VolumeModel) -> None:
        self._model = model
        glued = {
            d
            for side in model.boundary.sides
            if side.partner is not None and side.symmetry is not None
            for d in range(3)
            if side.patch[d] % 2 == 0 == side.partner[d] % 2
            and side.patch[d] != side.partner[d]
            and not (side.symmetry.swap or side.symmetry.reverse_s or side.symmetry.reverse_t)
        }
        self.closed = [d in glued and model.pieces[d] >= 3 for d in range(3)]
        self._shape = [n + (0 if c else 1) for n, c in zip(model.pieces, self.closed, strict=True)]
        self.count = self._shape[0] * self._shape[1] * self._shape[2]

    def _vertex(self, place: list[int]) -> int:
        i, j, k = (p % n for p, n in zip(place, self._shape, strict=True))
        return (i * self._shape[1] + j) * self._shape[2] + k

    def corners(self, patch: int) -> list[int]:
        """Return the vertices of a patch in MFEM's order."""
        cell = self._model.patches[patch].cell
        found = []
        for corner in _CORNERS:
            place = [position // 2 for position in cell]
            for axis, upper in enumerate(corner):
                place[self._model.directions[axis]] += upper
            found.append(self._vertex(place))
        return found

    def edges(self) -> dict[tuple[int, int], int]:
        """Return the edges, each along its axis, with the number of its knot vector."""
        found: dict[tuple[int, int], int] = {}
        first = 0
        for direction in self._model.directions:
            for piece in range(self._model.pieces[direction]):
                spans = [range(n + 1) for n in self._model.pieces]
                spans[direction] = range(piece, piece + 1)
                for place in product(*spans):
                    end = list(place)
                    end[direction] += 1
                    found[self._vertex(list(place)), self._vertex(end)] = first + piece
            first += self._model.pieces[direction]
        return found
