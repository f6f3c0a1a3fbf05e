"""Faces, edges and vertices of a shape as functions, for who looks for distances between them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepClass3d import BRepClass3d_SolidClassifier
from OCP.BRepTools import BRepTools
from OCP.gp import gp_Pnt, gp_Pnt2d
from OCP.IntTools import IntTools_FClass2d
from OCP.TopAbs import TopAbs_EDGE, TopAbs_IN, TopAbs_OUT, TopAbs_ShapeEnum, TopAbs_VERTEX
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape
from scipy.spatial import cKDTree

from pc2cad.arrays import Array, Booleans
from pc2cad.brep.booleans import NamedShape
from pc2cad.brep.from_kernel import curve_function, path_function, surface_function
from pc2cad.brep.kernel import IndexedMapOfShape, as_edge, as_vertex
from pc2cad.brep.tolerance import KERNEL_TOLERANCE
from pc2cad.topology.cells import SideKey

#: places along an edge, and along each parameter of a face, from which distances are looked for
ALONG, ACROSS = 33, 13

#: points (n, 3), and derivatives (n, 3) along each of k parameters, at places (n, k)
PieceJet = Callable[[Array], tuple[Array, tuple[Array, ...]]]


@dataclass(frozen=True, eq=False)
class Piece:
    """A face, an edge or a vertex: k parameters within bounds, k = 2, 1 or 0."""

    #: what the faces at it are parts of
    names: tuple[SideKey, ...]
    jet: PieceJet
    #: (k,) each
    low: Array
    high: Array
    #: some of its places, (n, k)
    places: Array
    #: which places (n, k) belong to it
    holds: Callable[[Array], Booleans]
    #: corners of a box round it, (2, 3)
    box: Array
    #: numbers of the shape's edges and vertices on it, itself included
    edges: frozenset[int] = frozenset()
    vertices: frozenset[int] = frozenset()

    @property
    def bodies(self) -> set[str]:
        """The bodies whose faces are at it."""
        return {name.body for name in self.names}

    def may_meet(self, other: Piece, reach: float) -> bool:
        """Say whether two pieces may come within a length of one another.

        They do not where their boxes are farther apart, or the places that are looked at by more
        than lies between these.
        """
        far = boxes_apart(self.box, other.box) > reach
        if not len(self.places) or not len(other.places) or far:
            return False
        (points, step), (_, step_there) = self.net, other.net
        nearest = other.tree.query(points, distance_upper_bound=reach + step + step_there)[0]
        return bool(np.isfinite(nearest).any())

    def moved(self, turn: Array, offset: Array) -> Piece:
        """Return the piece where x goes to `turn` x + `offset`; its box is one round its box."""

        def jet(at: Array) -> tuple[Array, tuple[Array, ...]]:
            points, slopes = self.jet(at)
            return points @ turn.T + offset, tuple(slope @ turn.T for slope in slopes)

        return replace(self, jet=jet, box=moved_box(self.box, turn, offset))

    @cached_property
    def net(self) -> tuple[Array, float]:
        """Points over all of the parameters, and what lies between them: a whole cell, at most."""
        span = self.high - self.low
        points, slopes = self.jet(self.low + _middles(len(span)) * span)
        steps = (np.linalg.norm(d, axis=1).max() * x for d, x in zip(slopes, span, strict=True))
        return points, float(sum(steps)) / ACROSS

    @cached_property
    def tree(self) -> cKDTree:
        """Those points, to ask for the nearest one."""
        return cKDTree(self.net[0])


@dataclass(frozen=True, eq=False)
class Pieces:
    """All pieces of a shape; edges and vertices by their numbers."""

    faces: tuple[Piece, ...]
    edges: dict[int, Piece]
    vertices: dict[int, Piece]


def pieces_of(shape: NamedShape) -> Pieces:
    """Return the pieces of a shape; edges that are a point are left out."""
    edges, vertices = IndexedMapOfShape(), IndexedMapOfShape()
    TopExp.MapShapes_s(shape.shape, TopAbs_EDGE, edges)
    TopExp.MapShapes_s(shape.shape, TopAbs_VERTEX, vertices)
    faces = []
    at_edge: dict[int, list[SideKey]] = {}
    at_vertex: dict[int, list[SideKey]] = {}
    for face, names in shape.faces:
        own = frozenset(_numbers(face, TopAbs_EDGE, edges))
        ends = frozenset(_numbers(face, TopAbs_VERTEX, vertices))
        faces.append(_face(face, names, own, ends))
        for index, found in ((own, at_edge), (ends, at_vertex)):
            for number in index:
                found.setdefault(number, []).extend(names)
    lines = {
        i: _edge(edges.FindKey(i), tuple(dict.fromkeys(names)), i, vertices)
        for i, names in at_edge.items()
        if not BRep_Tool.Degenerated_s(as_edge(edges.FindKey(i)))
    }
    corners = {
        i: _vertex(vertices.FindKey(i), tuple(dict.fromkeys(names)), i)
        for i, names in at_vertex.items()
    }
    return Pieces(tuple(faces), lines, corners)


def cross(first: NamedShape, second: NamedShape, depth: float) -> bool:
    """Say whether a place that is looked at, on faces of one shape, is so deep inside the other.

    Where the kernel fails it may find nothing that two bodies have in common, and be consistent.
    """
    return _reaches_into(first, second, depth) or _reaches_into(second, first, depth)


def _reaches_into(shape: NamedShape, other: NamedShape, depth: float) -> bool:
    points = np.concatenate([face.jet(face.places)[0] for face in pieces_of(shape).faces])
    for solid in other.solids:
        inside, (low, high) = BRepClass3d_SolidClassifier(solid), _box(solid)
        boxed = (points >= low + depth).all(axis=1) & (points <= high - depth).all(axis=1)
        for point in points[boxed].tolist():
            inside.Perform(gp_Pnt(*point), depth)
            if inside.State() == TopAbs_IN:
                return True
    return False


def boxes_apart(box: Array, other: Array) -> float:
    """Return by how much boxes (2, 3) are apart along an axis; negative where they are not."""
    return float(np.maximum(box[0] - other[1], other[0] - box[1]).max())


def moved_box(box: Array, turn: Array, offset: Array) -> Array:
    """Return the corners (2, 3) of a box round a moved one."""
    middle = turn @ box.mean(axis=0) + offset
    half = np.abs(turn) @ ((box[1] - box[0]) / 2)
    return np.array([middle - half, middle + half])


def _box(shape: TopoDS_Shape) -> Array:
    box = Bnd_Box()
    BRepBndLib.Add_s(shape, box, False)
    return np.array([box.CornerMin().Coord(), box.CornerMax().Coord()])


def _numbers(
    shape: TopoDS_Shape, kind: TopAbs_ShapeEnum, numbers: IndexedMapOfShape
) -> Iterator[int]:
    found = IndexedMapOfShape()
    TopExp.MapShapes_s(shape, kind, found)
    for index in range(1, found.Extent() + 1):
        yield numbers.FindIndex(found.FindKey(index))


def _face(
    face: TopoDS_Face, names: tuple[SideKey, ...], edges: frozenset[int], ends: frozenset[int]
) -> Piece:
    surface = surface_function(BRep_Tool.Surface_s(face), np.zeros(3))
    u0, u1, v0, v1 = BRepTools.UVBounds_s(face)
    low, high = np.array([u0, v0]), np.array([u1, v1])
    classifier = IntTools_FClass2d(face, KERNEL_TOLERANCE)

    def jet(at: Array) -> tuple[Array, tuple[Array, ...]]:
        point, along_a, along_b = surface.jet(at[:, 0], at[:, 1])
        return point, (along_a, along_b)

    def holds(at: Array) -> Booleans:
        found = (classifier.Perform(gp_Pnt2d(a, b)) for a, b in at.tolist())
        return np.array([state != TopAbs_OUT for state in found], dtype=bool)

    places = low + _middles(2) * (high - low)
    places = places[holds(places)]
    if not len(places):  # it is narrower than what lies between them
        places = np.clip(_border(face), low, high)
    return Piece(names, jet, low, high, places, holds, _box(face), edges, ends)


def _border(face: TopoDS_Face) -> Array:
    """Return places along the edges of a face, in its parameters, (n, 2)."""
    edges = IndexedMapOfShape()
    TopExp.MapShapes_s(face, TopAbs_EDGE, edges)
    found = []
    for index in range(1, edges.Extent() + 1):
        edge = as_edge(edges.FindKey(index))
        first, last = BRep_Tool.Range_s(edge)
        path = path_function(BRep_Tool.CurveOnSurface_s(edge, face, first, last))
        found.append(path.jet(np.linspace(first, last, ALONG))[0])
    return np.concatenate(found)


def _edge(
    shape: TopoDS_Shape, names: tuple[SideKey, ...], number: int, vertices: IndexedMapOfShape
) -> Piece:
    edge = as_edge(shape)
    first, last = BRep_Tool.Range_s(edge)
    curve = curve_function(BRep_Tool.Curve_s(edge, first, last), np.zeros(3))

    def jet(at: Array) -> tuple[Array, tuple[Array, ...]]:
        point, along = curve.jet(at[:, 0])
        return point, (along,)

    ends = frozenset(vertices.FindIndex(v) for v in
                     (TopExp.FirstVertex_s(edge), TopExp.LastVertex_s(edge)))  # fmt: skip
    low, high = np.array([first]), np.array([last])
    places = np.linspace(low, high, ALONG)
    return Piece(names, jet, low, high, places, _all, _box(edge), frozenset({number}), ends)


def _vertex(shape: TopoDS_Shape, names: tuple[SideKey, ...], number: int) -> Piece:
    point = np.array(BRep_Tool.Pnt_s(as_vertex(shape)).Coord())

    def jet(at: Array) -> tuple[Array, tuple[Array, ...]]:
        return np.broadcast_to(point, (len(at), 3)), ()

    nowhere = np.zeros((1, 0))
    box = np.array([point, point])
    return Piece(
        names, jet, nowhere[0], nowhere[0], nowhere, _all, box, vertices=frozenset({number})
    )


def _middles(count: int) -> Array:
    """Return the middles of the cells of a grid of the unit box of so many directions, (n, k)."""
    share = ((np.arange(ACROSS) + 0.5) / ACROSS).tolist()
    return np.array([*product(share, repeat=count)])


def _all(at: Array) -> Booleans:
    return np.ones(len(at), dtype=bool)
