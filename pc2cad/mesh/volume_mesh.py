"""A volume mesh: nodes, elements by type, and the sides of the solid as named sets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product
from pc2cad.mesh.elements import TYPES, gradients, rule, shapes
from pc2cad.topology.cells import SideKey
from pc2cad.topology.complex import BoundaryComplex

if TYPE_CHECKING:
    from pc2cad.mesh.columns import Columns

#: facets integrated at once
_CHUNK = 100_000


@dataclass(frozen=True)
class Facets:
    """Faces of elements of one type: element numbers within the type, and faces (0 is S1)."""

    kind: str
    elements: Integers
    faces: Integers


def by_whole_side(side: SideKey) -> list[str]:
    """Return the sets that a patch of a side belongs to: the whole side, and its own of several."""
    return [key.label for key in dict.fromkeys((side.whole, side))]


def pieces_among(boundary: BoundaryComplex) -> frozenset[str]:
    """Return the names of the patches that are pieces of a side, and no whole one."""
    keys = (boundary.key(side.patch) for side in boundary.sides)
    return frozenset(key.label for key in keys if key.is_piece)


def by_layer(
    names: Sequence[str], numbers: Mapping[str, Integers]
) -> dict[str, dict[str, Integers]]:
    """Return the elements of each layer, for the layer's number of every element by type."""
    return {
        name: {kind: here for kind, row in numbers.items() if len(here := np.flatnonzero(row == k))}
        for k, name in enumerate(names)
    }


@dataclass(frozen=True, eq=False)
class VolumeMesh:
    """Nodes and elements that fill a solid; lengths in `units`.

    Elements are numbered type by type, in the order of `elements.TYPES`.
    """

    name: str
    units: str
    order: int
    #: (nodes, 3)
    points: Array
    #: type name -> nodes of each element, (n, k), numbered as in VTK
    blocks: Mapping[str, Integers]
    #: side (or patch of a side) that bounds the solid -> its faces of elements
    sides: Mapping[str, tuple[Facets, ...]]
    #: side -> its nodes, ascending; collapsed and glued sides too
    node_sets: Mapping[str, Integers]
    #: layer -> its elements: numbers within each type; empty where the solid is one
    layers: Mapping[str, Mapping[str, Integers]] = field(default_factory=dict)
    #: names of sets that are single patches of a creased side, which is a set as well
    pieces: frozenset[str] = frozenset()
    #: u, v, w and the equation's fields at nodes and in elements, where the equation is known
    columns: Columns | None = field(default=None, repr=False)

    @property
    def elements(self) -> int:
        """Number of elements."""
        return sum(len(block) for block in self.blocks.values())

    def first_element(self, kind: str) -> int:
        """Return the number of the first element of a type."""
        names = list(TYPES)
        return sum(len(self.blocks.get(n, ())) for n in names[: names.index(kind)])

    def facet_nodes(self, side: str) -> dict[str, Integers]:
        """Return the nodes of a side's facets by shape, ``quad`` or ``triangle``: (n, k) each.

        Corners run anti-clockwise from outside, middles follow in the same order.
        """
        return self.facet_rows(side, self.blocks, self.order)

    def facet_rows(
        self, side: str, blocks: Mapping[str, Integers], order: int
    ) -> dict[str, Integers]:
        """Return what stands for a side's facets in tables of elements of some order."""
        found: dict[str, list[Integers]] = {}
        for facets in self.sides[side]:
            kind = TYPES[facets.kind]
            for face in distinct(facets.faces):
                rows = facets.elements[facets.faces == face]
                local = kind.face_nodes(int(face), order)
                shape = "quad" if len(kind.faces[face]) == 4 else "triangle"
                found.setdefault(shape, []).append(blocks[facets.kind][rows][:, local])
        return {shape: np.concatenate(parts) for shape, parts in found.items()}

    def to_meshio(self, nodes: Literal[20, 27] = 20) -> Any:
        """Return a `meshio.Mesh` with the sets of sides and layers, and fields.

        Hexahedra of order 2 have 20 nodes, or 27 where a (u,v,w) grid is made of nothing else.
        Raises InputError, PackageMissingError.
        """
        from pc2cad.mesh.objects import to_meshio

        return to_meshio(self, nodes)

    def to_skfem(self) -> Any:
        """Return scikit-fem's mesh of hexahedra, or of tetrahedra of order 1, with names of sides.

        Hexahedra of order 2 are those of 27 nodes. Raises InputError where there are others,
        PackageMissingError.
        """
        from pc2cad.mesh.objects import to_skfem

        return to_skfem(self)

    def area(self, side: str) -> float:
        """Return the area of a side's facets."""
        total = 0.0
        for normals, weights, _ in self.facet_integrands(side):
            total += float((np.sqrt((normals**2).sum(axis=-1)) * weights).sum())
        return total

    def volume(self) -> float:
        """Return the volume inside all facets, by the divergence theorem.

        It is the sum of the elements' volumes where they fit together without gaps.
        """
        total = 0.0
        for side in self.whole_sides:
            for normals, weights, places in self.facet_integrands(side):
                total += float(((places * normals).sum(axis=-1) * weights).sum())
        return total / 3

    @property
    def whole_sides(self) -> list[str]:
        """The names of whole sides, without those of single patches of a creased one."""
        return [name for name in self.sides if name not in self.pieces]

    @cached_property
    def centre(self) -> Array:
        """A place amidst the nodes, about which sums lose least, (3,)."""
        return np.asarray(self.points[:: max(1, len(self.points) // 1000)].mean(axis=0))

    def facet_integrands(self, side: str) -> Iterator[tuple[Array, Array, Array]]:
        """Give normals, weights and places at quadrature nodes.

        Normals are as long as the area element, places are seen from `centre`.
        """
        centre = self.centre
        for shape, nodes in self.facet_nodes(side).items():
            at, weights = rule(shape, 4 if self.order == 1 else 6)
            slopes, values = gradients(shape, self.order, at), shapes(shape, self.order, at)
            for start in range(0, len(nodes), _CHUNK):
                points = self.points[nodes[start : start + _CHUNK]] - centre
                tangents = [product(slopes[:, d], points) for d in range(2)]
                yield np.cross(tangents[0], tangents[1]), weights, product(values, points)
