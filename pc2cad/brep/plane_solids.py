"""All numbers of a solid of plane faces and straight edges at once.

One by one they take five times longer. The kernel writes the shape into memory as its binary files
have it (``BinTools_ShapeSet``, OCCT 7.9 and 8.0), and it is read from there where it is in every
byte of the form that is known here.
"""

from __future__ import annotations

import io
import re
from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
from OCP.BinTools import BinTools
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_Plane
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Shape

from pc2cad.arrays import Array, Integers
from pc2cad.brep.kernel import as_face

#: what comes before curves, surfaces and shapes: neither locations nor curves in planes
_CURVES = re.compile(rb"\s*Open CASCADE Topology V4[^\n]*\nLocations 0\nCurve2ds 0\nCurves (\d+)\n")
_SURFACES = re.compile(rb"Polygon3D 0\nPolygonOnTriangulations 0\nSurfaces (\d+)\n")
_SHAPES = re.compile(rb"Triangulations 0\n\s*TShapes (\d+)\n")
_LINE, _PLANE = (np.dtype([("kind", "u1"), ("numbers", "<f8", count)]) for count in (6, 12))
#: orientation, number and location of what a shape is made of
_PARTS = rb"((?:[\x00-\x03].{4}\x00{4})*)\*"
#: vertex, edge whose curves are said to run alike and that is not degenerated (and between which
#: faces it is smooth), face, all others; tolerances, numbers of curve and surface, and parts; flags
#: are passed over
_SHAPE = re.compile(
    rb"(\x07(.{8})(.{24})\x00.{7}\*"
    rb"|\x06(.{8})\x01\x01\x00\x01(.{4})\x00{4}(.{16})(?:\x04.{17})*\x00.{7}" + _PARTS +
    rb"|\x04.(.{8})(.{4})\x00{4}\x01.{7}" + _PARTS +
    rb"|([\x01-\x03\x05]).{7}" + _PARTS + rb")",
    re.DOTALL,
)  # fmt: skip
USE = np.dtype([("turn", "u1"), ("part", "<i4"), ("place", "<i4")])
_SOLID, SHELL, WIRE = (bytes([kind]) for kind in (2, 3, 5))

#: which parts each part is made of, and how turned: of edges, faces and others, whose kinds are the
#: third; the last is the shape itself
Topology = tuple[tuple[bytes, ...], tuple[bytes, ...], tuple[bytes, ...], tuple[bytes, ...], bytes]


@dataclass(frozen=True, eq=False)
class PlaneSolid:
    """A solid of plane faces and straight edges, in the kernel's order of its parts."""

    topology: Topology
    #: of the vertices (n, 3)
    points: Array
    #: parameters of the ends of the edges (m, 2)
    ranges: Array
    #: of the edges' lines a point and the direction (m, 6)
    lines: Array
    #: of the faces' planes a point, the normal and two directions (k, 12)
    planes: Array
    #: the largest of a face, an edge or a vertex
    tolerance: float

    @property
    def rows(self) -> tuple[Array, ...]:
        """All numbers; those of one row are of one size."""
        return self.points, self.ranges, self.lines, self.planes[:, :3], self.planes[:, 3:]

    def count(self, kind: bytes) -> int:
        """Return how many shells or wires there are."""
        return self.topology[2].count(kind)

    @property
    def walks(self) -> tuple[Integers, Integers, Array] | None:
        """The edges along which faces are bounded, whose, and 1 or -1: how they are walked.

        Faces in the order that they have in their shell; edges in that of `lines`. None of shapes
        that are no solids of one shell.
        """
        return _walks(self.topology)


def is_one_shell(topology: Topology) -> bool:
    """Say whether a shape is one solid of one shell."""
    _, _, kinds, _, whole = topology
    return kinds[-2:] == (SHELL, _SOLID) and kinds.count(SHELL) == 1 and whole[0] <= 1


@lru_cache(maxsize=16)
def _walks(topology: Topology) -> tuple[Integers, Integers, Array] | None:
    """Return what `PlaneSolid.walks` does; what is read back has the same, and so have variants."""
    if not is_one_shell(topology):
        return None
    ends, wires, kinds, parts, whole = topology
    count = len(kinds)
    lists = [one or other or third for one, other, third in zip(ends, wires, parts, strict=True)]
    table = np.frombuffer(b"".join(lists), USE)
    owner = np.repeat(np.arange(count), [len(each) // USE.itemsize for each in lists])
    # the kernel counts from the last
    child, turn = count - table["part"], table["turn"].astype(np.int64)
    turned, above = np.zeros((2, count), np.int64)
    turned[-1] = whole[0]
    is_face, is_edge = (np.array([bool(each) for each in of]) for of in (wires, ends))
    is_wire = np.array([kind == WIRE for kind in kinds])
    for one in (owner == count - 1, owner == count - 2, is_face[owner]):
        turned[child[one]] = turned[owner[one]] ^ turn[one]
        above[child[one]] = owner[one]
    faces, wired = child[owner == count - 2], child[is_face[owner]]
    if (
        (turn > 1).any()
        # each face once and in the order of the planes, each wire in one face
        or len(faces) != is_face.sum()
        or (np.diff(faces) <= 0).any()
        or not np.array_equal(np.sort(wired), np.flatnonzero(is_wire))
    ):
        return None
    uses = np.flatnonzero(is_wire[owner])
    edge, face = (np.cumsum(of) - 1 for of in (is_edge, is_face))
    signs = 1.0 - 2.0 * (turned[owner[uses]] ^ turn[uses])
    found = edge[child[uses]], face[above[owner[uses]]], np.asarray(signs, float)
    for each in found:
        each.setflags(write=False)
    return found


def plane_solid(shape: TopoDS_Shape) -> PlaneSolid | None:
    """Return the numbers of a shape, None where it has others than those of planes and lines."""
    faces = TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_FACE)
    while faces.More():
        if not isinstance(BRep_Tool.Surface_s(as_face(faces.Current())), Geom_Plane):
            return None
        faces.Next()
    stream = io.BytesIO()
    BinTools.Write_s(shape, stream)
    return _read(stream.getvalue())


@lru_cache(maxsize=2)  # a solid is asked for when it is held against the equation, and written
def _read(data: bytes) -> PlaneSolid | None:
    text = np.frombuffer(data, np.uint8)
    for form in tuple(_forms):  # another thread may add one
        if form.is_of(text):
            return form.solid(text)
    found = _form(data)
    if found is None:
        return None
    if len(data) <= LONGEST_KEPT:
        _forms.appendleft(found)
    return found.solid(text)


@dataclass(frozen=True, eq=False)
class _Form:
    """Where numbers stand in what the kernel writes of a shape: all variants of one have one."""

    #: which bytes are of no number, and these
    others: Integers
    words: bytes
    #: the bytes of all numbers, and where those of points, ranges, lines, planes and tolerances end
    numbers: Integers
    ends: tuple[int, ...]
    topology: Topology

    def is_of(self, text: Any) -> bool:
        """Say whether a text has this form."""
        same = len(text) == len(self.others) + len(self.numbers)
        return same and text[self.others].tobytes() == self.words

    def solid(self, text: Any) -> PlaneSolid:
        """Return what a text of this form holds."""
        numbers = text[self.numbers].view("<f8")
        points, ranges, lines, planes, tolerances = (
            numbers[start:end] for start, end in pairwise((0, *self.ends))
        )
        return PlaneSolid(
            self.topology, points.reshape(-1, 3), ranges.reshape(-1, 2), lines.reshape(-1, 6),
            planes.reshape(-1, 12), max(tolerances.tolist(), default=0.0),
        )  # fmt: skip


#: forms of the last shapes, and the longest text of one
_forms: Final[deque[_Form]] = deque(maxlen=4)
LONGEST_KEPT: Final = 1 << 16


def _form(data: bytes) -> _Form | None:
    """Return the form of a text, None where it is not wholly known."""
    lines, end = _table(data, _CURVES, 0, _LINE)
    planes, end = _table(data, _SURFACES, end, _PLANE)
    head = _SHAPES.match(data, end)
    if lines is None or planes is None or head is None:
        return None
    rows = _SHAPE.findall(data, head.end(), len(data) - 9)
    lengths = np.array([len(row[0]) for row in rows], np.int64)
    # a shape that is of another form is passed over
    if len(rows) != int(head[1]) or lengths.sum() != len(data) - 9 - head.end():
        return None
    _, of_vertices, _, of_edges, curve, _, ends, of_faces, surface, wires, kinds, parts = (
        zip(*rows, strict=True) if rows else [()] * 12
    )
    begin = head.end() + np.cumsum(lengths) - lengths
    vertices, edges, faces = (
        begin[[bool(one) for one in of]] for of in (of_vertices, of_edges, of_faces)
    )
    numbers = [
        (vertices + 9, 3), (edges + 21, 2), (lines[_places(curve)], 6),
        (planes[_places(surface)], 12), (np.concatenate((vertices + 1, edges + 1, faces + 2)), 1),
    ]  # fmt: skip
    where = [(at[:, None] + np.arange(8 * count)).ravel() for at, count in numbers]
    found, others = np.concatenate(where), np.ones(len(data), bool)
    others[found] = False
    return _Form(
        np.flatnonzero(others), np.frombuffer(data, np.uint8)[others].tobytes(), found,
        tuple((np.cumsum([len(one) for one in where]) // 8).tolist()),
        (ends, wires, kinds, parts, data[-9:]),
    )  # fmt: skip


def _table(
    data: bytes, title: re.Pattern[bytes], start: int, kind: np.dtype[np.void]
) -> tuple[Integers | None, int]:
    """Return where the numbers of curves or surfaces begin, all of one kind, and where they end."""
    head = title.match(data, start)
    if head is None:
        return None, start
    count = int(head[1])
    end = head.end() + count * kind.itemsize
    if end > len(data):
        return None, start
    kinds = np.frombuffer(data, kind, count, head.end())["kind"]
    begin = head.end() + 1 + kind.itemsize * np.arange(count)
    return (begin if (kinds == 1).all() else None), end


def _places(texts: tuple[bytes, ...]) -> Integers:
    return np.frombuffer(b"".join(texts), "<i4") - 1
