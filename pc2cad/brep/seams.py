"""Where faces of a shape come round to themselves, and where they are drawn together in a point."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_FORWARD, TopAbs_REVERSED, TopAbs_VERTEX
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face

from pc2cad.arrays import Array, Booleans
from pc2cad.brep.booleans import NamedShape
from pc2cad.brep.from_kernel import path_function, surface_function
from pc2cad.brep.kernel import (
    IndexedDataMapOfShapeListOfShape,
    IndexedMapOfShape,
    as_edge,
    as_face,
)
from pc2cad.brep.pieces import ALONG, Piece
from pc2cad.topology.cells import SideKey


@dataclass(frozen=True, eq=False)
class Seam:
    """A line of a face at which it begins and ends, or might; or a pole, which has no parameter."""

    piece: Piece
    #: unit normals (n, 3) of the face at places (n, k) of the line
    normal: Callable[[Array], Array] | None = None
    #: the same line where the face would begin a share of the period farther on
    at: Callable[[float], Seam] | None = None

    @property
    def is_pole(self) -> bool:
        """Whether it is a place at which the face is drawn together."""
        return self.normal is None

    def moved(self, turn: Array, offset: Array) -> Seam:
        """Return it where x goes to `turn` x + `offset`."""
        normal, at = self.normal, self.at
        return replace(
            self, piece=self.piece.moved(turn, offset),
            normal=normal and (lambda places: normal(places) @ turn.T),
            at=at and (lambda share: at(share).moved(turn, offset)),
        )  # fmt: skip


def seams_of(shape: NamedShape) -> Iterator[Seam]:
    """Yield the seams of a shape's faces, and the poles that lie on one face only."""
    at_vertex = IndexedDataMapOfShapeListOfShape()
    TopExp.MapShapesAndUniqueAncestors_s(shape.shape, TopAbs_VERTEX, TopAbs_FACE, at_vertex)
    for face, names in shape.faces:
        edges, seen = IndexedMapOfShape(), IndexedMapOfShape()
        TopExp.MapShapes_s(face, TopAbs_EDGE, edges)
        for index in range(1, edges.Extent() + 1):
            edge = as_edge(edges.FindKey(index))
            if BRep_Tool.Degenerated_s(edge):
                vertex = TopExp.FirstVertex_s(edge)
                alone = at_vertex.FindFromKey(vertex).Size() == 1
                if alone and not seen.FindIndex(vertex):
                    seen.Add(vertex)
                    yield _pole(np.array(BRep_Tool.Pnt_s(vertex).Coord()), names)
            elif BRep_Tool.IsClosed_s(edge, face):
                yield _seam(edge, face, names)


def _pole(point: Array, names: tuple[SideKey, ...]) -> Seam:
    def jet(at: Array) -> tuple[Array, tuple[Array, ...]]:
        return np.broadcast_to(point, (len(at), 3)), ()

    nowhere = np.zeros((1, 0))
    box = np.array([point, point])
    return Seam(Piece(names, jet, nowhere[0], nowhere[0], nowhere, _all, box))


def _seam(edge: TopoDS_Edge, face: TopoDS_Face, names: tuple[SideKey, ...]) -> Seam:
    first, last = BRep_Tool.Range_s(edge)
    face = as_face(face.Oriented(TopAbs_FORWARD))
    start, end = (
        path_function(
            BRep_Tool.CurveOnSurface_s(as_edge(edge.Oriented(side)), face, first, last)
        ).jet
        for side in (TopAbs_FORWARD, TopAbs_REVERSED)
    )
    surface = surface_function(BRep_Tool.Surface_s(face), np.zeros(3)).jet
    low, high = np.array([first]), np.array([last])

    def line(share: float) -> Seam:
        def on_surface(at: Array) -> tuple[Array, Array, Array, Array]:
            (place, along), (there, along_there) = start(at[:, 0]), end(at[:, 0])
            place = place + share * (there - place)
            way = along + share * (along_there - along)
            return (*surface(place[:, 0], place[:, 1]), way)

        def jet(at: Array) -> tuple[Array, tuple[Array, ...]]:
            point, a, b, way = on_surface(at)
            return point, (way[:, :1] * a + way[:, 1:] * b,)

        def normal(at: Array) -> Array:
            _, a, b, _ = on_surface(at)
            found = np.cross(a, b)
            return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])

        places = np.linspace(low, high, ALONG)
        points = jet(places)[0]
        # between two places it leaves their box by no more than what lies between places
        step = float(np.linalg.norm(np.diff(points, axis=0), axis=1).max())
        box = np.array([points.min(axis=0) - step, points.max(axis=0) + step])
        return Seam(Piece(names, jet, low, high, places, _all, box), normal, line)

    return line(0.0)


def _all(at: Array) -> Booleans:
    return np.ones(len(at), dtype=bool)
