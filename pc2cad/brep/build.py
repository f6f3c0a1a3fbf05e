"""The build stage: a boundary model to one solid of the kernel.

Input: BoundaryModel. Output: BuiltSolid. Each vertex and edge is made once and shared by the faces
that meet there, seams carry two pcurves, and sides that collapse become degenerated edges: nothing
is sewn and nothing is healed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from OCP.BRep import BRep_Builder
from OCP.Standard import Standard_Failure
from OCP.TopAbs import TopAbs_FORWARD, TopAbs_REVERSED
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import (
    TopoDS_Edge,
    TopoDS_Face,
    TopoDS_Shape,
    TopoDS_Shell,
    TopoDS_Solid,
    TopoDS_Vertex,
    TopoDS_Wire,
)

from pc2cad.arrays import Array
from pc2cad.arrays.linear import lengths
from pc2cad.brep import to_kernel
from pc2cad.brep.kernel import as_face
from pc2cad.brep.tolerance import KERNEL_TOLERANCE
from pc2cad.errors import KernelError
from pc2cad.geometry.carriers import PCurve, Plane, SplineSurface
from pc2cad.representation.boundary_model import BoundaryModel, ModelFace

#: beyond this, a dozen roundings of a coordinate are as large as what the kernel tells apart
LARGEST_COORDINATE = KERNEL_TOLERANCE / (16 * float(np.finfo(float).eps))


class PartTooSmallError(KernelError):
    """An edge or the part is so small that the kernel takes its ends for one point."""


class PartTooLargeError(KernelError):
    """Coordinates are so large that the kernel's tolerance is lost in their rounding."""


@dataclass(frozen=True)
class BuiltSolid:
    """The solid and, in the order of the model, the face of each side."""

    solid: TopoDS_Solid
    faces: tuple[TopoDS_Face, ...]
    #: the solids of the layers; they share the faces between them, and theirs with `solid`
    layers: tuple[TopoDS_Solid, ...] = ()


def build(model: BoundaryModel) -> BuiltSolid:
    """Return the kernel's solid of a boundary model; raise KernelError where it refuses."""
    try:
        return _Build(model).solid()
    except Standard_Failure as failure:
        raise KernelError(f"the CAD kernel refused the boundary: {failure}") from failure


class _Build:
    def __init__(self, model: BoundaryModel) -> None:
        self._model = model
        self._builder = BRep_Builder()
        self._check_size()
        to_kernel.check_finite(model.vertices, "a vertex")
        self._vertices = [self._vertex(position) for position in model.vertices]
        self._ranges: list[tuple[float, float]] = []
        self._edges = [self._edge(index) for index in range(len(model.edges))]

    def _check_size(self) -> None:
        largest = float(np.abs(self._model.vertices).max()) + self._model.size
        if largest > LARGEST_COORDINATE:
            raise PartTooLargeError(
                f"coordinates reach {largest:.3g} units, where double precision no longer holds "
                f"the kernel's {KERNEL_TOLERANCE:g}; choose a larger unit (m instead of mm), so "
                "that numbers shrink, or move the part nearer to the origin"
            )
        pairs = [(edge.start, edge.end) for edge in self._model.edges]
        ends = np.array(pairs, np.int64).reshape(-1, 2)
        apart = lengths(self._model.vertices[ends[:, 0]] - self._model.vertices[ends[:, 1]])
        near = (ends[:, 0] != ends[:, 1]) & (apart < 10 * KERNEL_TOLERANCE)
        if near.any():
            raise PartTooSmallError(
                f"two vertices are {apart[near][0]:.3g} units apart and the kernel takes points "
                f"within {KERNEL_TOLERANCE:g} for one; choose a smaller unit (mm instead of m), "
                "so that numbers grow"
            )

    def _vertex(self, position: Array) -> TopoDS_Vertex:
        vertex = TopoDS_Vertex()
        self._builder.MakeVertex(vertex, to_kernel.point(position), KERNEL_TOLERANCE)
        return vertex

    def _edge(self, index: int) -> TopoDS_Edge:
        data = self._model.edges[index]
        curve, first, last = to_kernel.curve(data.carrier)
        edge = TopoDS_Edge()
        self._builder.MakeEdge(edge, curve, KERNEL_TOLERANCE)
        self._bound(edge, data.start, data.end, (first, last))
        self._ranges.append((first, last))
        return edge

    def _bound(self, edge: TopoDS_Edge, start: int, end: int, span: tuple[float, float]) -> None:
        self._builder.Add(edge, self._vertices[start].Oriented(TopAbs_FORWARD))
        self._builder.Add(edge, self._vertices[end].Oriented(TopAbs_REVERSED))
        self._builder.Range(edge, *span)

    def _face(self, data: ModelFace) -> TopoDS_Face:
        face = TopoDS_Face()
        self._builder.MakeFace(face, to_kernel.surface(data.carrier), KERNEL_TOLERANCE)
        if isinstance(data.carrier, Plane):
            for wire in data.wires:
                self._builder.Add(face, self._wire([
                    self._edges[edge].Oriented(TopAbs_FORWARD if forward else TopAbs_REVERSED)
                    for edge, forward in wire
                ]))  # fmt: skip
        else:
            self._builder.Add(face, self._wire(self._rectangle(face, data)))
        if isinstance(data.carrier, SplineSurface):
            self._builder.NaturalRestriction(face, True)
        return as_face(face.Reversed()) if data.reversed else face

    def _wire(self, edges: list[TopoDS_Shape]) -> TopoDS_Wire:
        wire = TopoDS_Wire()
        self._builder.MakeWire(wire)
        for edge in edges:
            self._builder.Add(wire, edge)
        wire.Closed(True)
        return wire

    def _rectangle(self, face: TopoDS_Face, data: ModelFace) -> list[TopoDS_Shape]:
        """Return the four sides of a face, anti-clockwise in its parameters, with pcurves set."""
        sides: list[TopoDS_Shape] = []
        counts = [use.edge for use in data.uses]
        for side, (use, pcurve) in enumerate(zip(data.uses, data.pcurves, strict=True)):
            if pcurve is None:
                continue
            corner = data.corner(side)
            if corner is not None:
                pole, forward = self._degenerated(face, corner, use.vertex), not data.turned
                sides.append(pole.Oriented(TopAbs_FORWARD if forward else TopAbs_REVERSED))
            if use.edge is None:
                edge, forward = self._degenerated(face, pcurve, use.vertex), not data.turned
            else:
                edge, forward = self._edges[use.edge], use.forward != data.turned
                if counts.count(use.edge) == 1:
                    self._lay(face, use.edge, pcurve)
                elif use.forward:
                    self._seam(face, data, use.edge)
            sides.append(edge.Oriented(TopAbs_FORWARD if forward else TopAbs_REVERSED))
        return sides[::-1] if data.turned else sides

    def _lay(self, face: TopoDS_Face, edge: int, *pcurves: PCurve) -> None:
        curves = [to_kernel.pcurve(data, *self._ranges[edge]) for data in pcurves]
        self._builder.UpdateEdge(self._edges[edge], *curves, face, KERNEL_TOLERANCE)

    def _seam(self, face: TopoDS_Face, data: ModelFace, edge: int) -> None:
        """Give a seam its two pcurves: that of the forward use first."""
        pcurves = {
            use.forward != data.turned: pcurve
            for use, pcurve in zip(data.uses, data.pcurves, strict=True)
            if use.edge == edge and pcurve is not None
        }
        self._lay(face, edge, pcurves[True], pcurves[False])

    def _degenerated(self, face: TopoDS_Face, pcurve: PCurve, vertex: int) -> TopoDS_Edge:
        edge = TopoDS_Edge()
        self._builder.MakeEdge(edge)
        span = (0.0, to_kernel.length(pcurve))
        self._builder.UpdateEdge(edge, to_kernel.pcurve(pcurve, *span), face, KERNEL_TOLERANCE)
        self._bound(edge, vertex, vertex, span)
        self._builder.Range(edge, face, *span)
        self._builder.Degenerated(edge, True)
        return edge

    def solid(self) -> BuiltSolid:
        faces = [self._face(data) for data in self._model.faces]
        solid = self._solid([[faces[i] for i in members] for members in self._model.shells])
        layers = (
            self._solid([[_turned(faces[i], turn) for i, turn in shell] for shell in layer.shells])
            for layer in self._model.layers
        )
        return BuiltSolid(solid, tuple(faces), tuple(layers))

    def _solid(self, shells: list[list[TopoDS_Face]]) -> TopoDS_Solid:
        solid = TopoDS_Solid()
        self._builder.MakeSolid(solid)
        for faces in shells:
            shell = TopoDS_Shell()
            self._builder.MakeShell(shell)
            for face in faces:
                self._builder.Add(shell, face)
            shell.Closed(True)
            self._builder.Add(solid, shell)
        solid.Location(TopLoc_Location())
        return solid


def _turned(face: TopoDS_Face, turn: bool) -> TopoDS_Face:
    return as_face(face.Reversed()) if turn else face
