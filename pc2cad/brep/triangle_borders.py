"""Which nodes of faces' triangulations are one point, by the edges and vertices that they share."""

from __future__ import annotations

from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp, TopExp_Explorer
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pc2cad.arrays import Integers
from pc2cad.brep.kernel import IndexedMapOfShape, as_edge
from pc2cad.errors import KernelError


class Borders:
    """Which nodes of the faces' meshes are one point, because they lie on one edge or vertex.

    Equal coordinates do not tell it: at an end, a face may use the vertex or the end of a curve,
    which differ by up to the tolerance.
    """

    def __init__(self, shape: Any) -> None:
        self._edges = IndexedMapOfShape()
        self._vertices = IndexedMapOfShape()
        TopExp.MapShapes_s(shape, TopAbs_ShapeEnum.TopAbs_EDGE, self._edges)
        TopExp.MapShapes_s(shape, TopAbs_ShapeEnum.TopAbs_VERTEX, self._vertices)
        self._first: dict[int, Integers] = {}
        self._corner: dict[int, int] = {}
        self._pairs: list[Integers] = []

    def add(self, face: Any, mesh: Any, location: Any, offset: int) -> None:
        """Take in the edges of a face whose nodes are numbered from `offset`."""
        explorer = TopExp_Explorer(face, TopAbs_ShapeEnum.TopAbs_EDGE)
        while explorer.More():
            edge = as_edge(explorer.Current())
            explorer.Next()
            # a seam has two polygons; the edge's orientation tells which one is meant
            polygon = BRep_Tool.PolygonOnTriangulation_s(edge, mesh, location)
            if polygon is None:
                raise KernelError("the kernel could not mesh an edge of the solid")
            count = polygon.NbNodes()
            nodes = np.array([polygon.Node(i) for i in range(1, count + 1)], dtype=np.int64)
            self._join(edge, nodes + (offset - 1))

    def _join(self, edge: Any, nodes: Integers) -> None:
        first = self._first.setdefault(self._edges.FindIndex(edge), nodes)
        if len(first) != len(nodes):
            raise KernelError("the kernel meshed an edge differently in its two faces")
        self._pairs.append(np.column_stack((first, nodes)))
        if BRep_Tool.Degenerated_s(edge):
            self._pairs.append(np.column_stack((nodes[:-1], nodes[1:])))
        forward = edge.Oriented(TopAbs_Orientation.TopAbs_FORWARD)
        for vertex, node in (
            (TopExp.FirstVertex_s(as_edge(forward)), int(nodes[0])),
            (TopExp.LastVertex_s(as_edge(forward)), int(nodes[-1])),
        ):
            if not vertex.IsNull():
                corner = self._corner.setdefault(self._vertices.FindIndex(vertex), node)
                self._pairs.append(np.array([[corner, node]]))

    def representatives(self, count: int) -> Integers:
        """Return for each of `count` nodes the one that stands for its point, (count,)."""
        if not self._pairs:
            return np.arange(count, dtype=np.int64)
        pairs = np.concatenate(self._pairs)
        links = coo_array(
            (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count)
        )
        _, group = connected_components(links, directed=False)
        _, first = np.unique(group, return_index=True)
        chosen: Integers = first[group].astype(np.int64)
        return chosen
