"""The boundary model: faces and edges with their carriers, which the kernel is asked to build."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.geometry.carriers import (
    CurveCarrier,
    Evidence,
    PCurve,
    Segment,
    SurfaceCarrier,
    ends_of,
)
from pc2cad.topology.cells import SideKey
from pc2cad.topology.complex import BoundaryComplex, EdgeUse


@dataclass(frozen=True, eq=False)
class ModelEdge:
    """An edge with its carrier; its parameter runs as the edge class's own direction."""

    key: SideKey
    carrier: CurveCarrier
    start: int
    end: int
    evidence: Evidence
    #: largest distance from the equation: proved, or seen where the evidence is no better
    deviation: float
    #: the largest distance seen, and the parameters (of the edge) where no bound could be had
    sampled: float = 0.0
    open: tuple[tuple[float, float], ...] = ()
    #: where it was seen, in the spline's parameter
    place: tuple[float, ...] = ()

    @property
    def name(self) -> str:
        """What the edge of the box is called."""
        return self.key.label


#: parameters of a surface that differ by less are one place, as a share of the face's extent
ONE_PLACE: Final = 1e-6

#: a closed walk of (edge, forward) with the face on the left, seen against the plane's normal
Wire = tuple[tuple[int, bool], ...]


@dataclass(frozen=True, eq=False)
class ModelFace:
    """A face with its carrier.

    `reversed` says that the carrier's own normal points into the solid. A plane's boundary is
    `wires`, anti-clockwise about its normal, the outer one first. Any other face is bounded by its
    four `uses`: their `pcurves` run along the edges' own directions (those of collapsed sides along
    the walk), with None for sides that bound nothing on the carrier; `turned` says that the walk
    goes clockwise in the carrier's parameters.
    """

    key: SideKey
    #: the faces of the boundary complex that it covers: several where patches lie in one plane
    cells: tuple[int, ...]
    carrier: SurfaceCarrier
    uses: tuple[EdgeUse, ...]
    wires: tuple[Wire, ...]
    pcurves: tuple[PCurve | None, ...]
    turned: bool
    reversed: bool
    evidence: Evidence
    #: largest distance from the equation: proved, or seen where the evidence is no better
    deviation: float
    samples: int
    #: the largest distance seen, and the parameters (of the patch) where no bound could be had
    sampled: float = 0.0
    open: tuple[tuple[float, float], ...] = ()
    #: where it was seen, in the spline's parameters
    place: tuple[float, ...] = ()

    @property
    def name(self) -> str:
        """What the side is called."""
        return self.key.label

    def corner(self, side: int) -> Segment | None:
        """Return the way round a pole of the carrier at which a side begins, or None."""
        return corner_at(self.pcurves, self.uses, side)

    @property
    def border(self) -> set[int]:
        """Edges on which the face ends: those it uses once."""
        edges = [use.edge for use in self.uses if use.edge is not None]
        if self.wires:
            edges = [edge for wire in self.wires for edge, _ in wire]
        return {edge for edge, times in Counter(edges).items() if times == 1}


def corner_at(
    pcurves: Sequence[PCurve | None], uses: Sequence[EdgeUse], side: int
) -> Segment | None:
    """Return the way round a pole of the surface where a side begins, along the walk; or None.

    There two sides meet in one vertex and at two places of the surface's parameters.
    """
    before, after = pcurves[side - 1], pcurves[side]
    if before is None or after is None:
        return None
    walked = [use.forward or use.edge is None for use in (uses[side - 1], uses[side])]
    first = ends_of(before)[int(walked[0])].tolist()
    second = ends_of(after)[int(not walked[1])].tolist()
    if first == second:
        return None
    extent = np.ptp(np.concatenate([ends_of(curve) for curve in pcurves if curve]), axis=0)
    apart = np.abs(np.subtract(first, second)) > ONE_PLACE * extent
    return Segment(tuple(first), tuple(second)) if apart.any() else None


@dataclass(frozen=True, eq=False)
class Layer:
    """One of several solids of a part, which share the faces between them."""

    name: str
    #: the faces of each shell, the outer one first: index, and whether the face is turned round
    shells: tuple[tuple[tuple[int, bool], ...], ...]
    euler: int

    @property
    def faces(self) -> tuple[int, ...]:
        """All its faces."""
        return tuple(index for shell in self.shells for index, _ in shell)


@dataclass(frozen=True, eq=False)
class BoundaryModel:
    """The boundary of the solid with coordinates: what the kernel is asked to build."""

    complex: BoundaryComplex
    vertices: Array
    edges: tuple[ModelEdge, ...]
    faces: tuple[ModelFace, ...]
    #: faces of each shell, the outer one first; the others are voids
    shells: tuple[tuple[int, ...], ...]
    tolerance: float
    size: float
    #: the solids that the part consists of, from w = 0 up; none where it is one
    layers: tuple[Layer, ...] = ()

    @property
    def outer(self) -> tuple[int, ...]:
        """The faces of the outer boundary: all but those between layers."""
        return tuple(sorted(face for shell in self.shells for face in shell))

    @cached_property
    def creases(self) -> frozenset[int]:
        """The edges between two different faces (seams are left out)."""
        return frozenset().union(*[face.border for face in self.faces])

    def crease_vertices(self) -> set[int]:
        """Return the vertices at which edges between different faces begin or end."""
        return {v for e in self.creases for v in (self.edges[e].start, self.edges[e].end)}
