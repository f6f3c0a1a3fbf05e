"""Vertices, edges and wires of a STEP file, with the line integrals of the edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .step_curves import Curve, closest, gauss_rule, read_curve
from .step_parse import StepDefect, StepGraph, Vector, is_true

_SAMPLES = 17
_POINTS = 16


@dataclass(frozen=True)
class Edge:
    """An edge from its start vertex to its end vertex."""

    ref: str
    start: str
    end: str
    samples: Vector
    places: Vector
    steps: Vector
    gap: float


@dataclass(frozen=True)
class Wire:
    """A closed chain of edges with the sense in which the face uses each; or one vertex."""

    edges: tuple[tuple[Edge, bool], ...]
    vertex: Vector | None

    @property
    def flow(self) -> tuple[Vector, Vector]:
        """Quadrature points and signed steps dr along the wire, in its order."""
        places = [edge.places[:: 1 if forward else -1] for edge, forward in self.edges]
        steps = [edge.steps if forward else -edge.steps[::-1] for edge, forward in self.edges]
        none = np.empty((0, 3))
        return np.concatenate([none, *places]), np.concatenate([none, *steps])


class EdgeReader:
    """Reads edges once each and remembers them."""

    def __init__(self, graph: StepGraph) -> None:
        self._graph = graph
        self.edges: dict[str, Edge] = {}
        self.vertices: dict[str, Vector] = {}

    def vertex(self, ref: Any) -> Vector:
        """The point of a VERTEX_POINT."""
        if ref not in self.vertices:
            _, point = self._graph.get(ref, "VERTEX_POINT").values
            self.vertices[ref] = self._graph.point(point)
        return self.vertices[ref]

    def edge(self, ref: Any) -> Edge:
        """An EDGE_CURVE with its curve cut to its vertices."""
        if ref not in self.edges:
            self.edges[ref] = self._read(ref)
        return self.edges[ref]

    def _read(self, ref: Any) -> Edge:
        _, start, end, geometry, same_sense = self._graph.get(ref, "EDGE_CURVE").values
        curve = read_curve(self._graph, geometry)
        ends = np.array([self.vertex(start), self.vertex(end)])
        first, last = _interval(curve, ends, start == end, is_true(same_sense), ref)
        samples = curve.at(np.linspace(first, last, _SAMPLES))[0]
        breaks = curve.breaks(min(first, last), max(first, last))
        # on a line too: what is swept along it on a surface is no polynomial
        nodes, weights = gauss_rule(breaks, max(_POINTS, curve.points))
        places, slopes = curve.at(nodes)
        sign = 1.0 if last > first else -1.0
        gap = float(np.linalg.norm(samples[[0, -1]] - ends, axis=1).max())
        return Edge(ref, start, end, samples, places, sign * weights[:, None] * slopes, gap)

    def wire(self, ref: Any) -> Wire:
        """A FACE_BOUND as a wire that runs around the face's normal."""
        bound = self._graph.get(ref, "FACE_BOUND", "FACE_OUTER_BOUND")
        _, loop_ref, flag = bound.values
        loop = self._graph.get(loop_ref, "EDGE_LOOP", "VERTEX_LOOP")
        if loop.keyword == "VERTEX_LOOP":
            return Wire((), self.vertex(loop.values[1]))
        uses = []
        for use in loop.values[1]:
            *_, edge, forward = self._graph.get(use, "ORIENTED_EDGE").values
            uses.append((self.edge(edge), is_true(forward)))
        _require_chain(uses, loop_ref)
        if not is_true(flag):
            uses = [(edge, not forward) for edge, forward in reversed(uses)]
        return Wire(tuple(uses), None)


def _require_chain(uses: list[tuple[Edge, bool]], loop: Any) -> None:
    if not uses:
        raise StepDefect(f"Wire {loop} has no edges.")
    ends = [(e.start, e.end) if forward else (e.end, e.start) for e, forward in uses]
    for position, (_, end) in enumerate(ends):
        following = (position + 1) % len(ends)
        if end != ends[following][0]:
            raise StepDefect(
                f"Wire {loop} is not closed: edge {uses[position][0].ref} ends at vertex {end}, "
                f"edge {uses[following][0].ref} starts at vertex {ends[following][0]}."
            )


def _interval(
    curve: Curve, ends: Vector, closed: bool, same_sense: bool, ref: Any
) -> tuple[float, float]:
    """The parameters of an edge's start and end, in the order the edge runs."""
    first, last = (float(t) for t in closest(curve.at, curve.sampling(ends), ends))
    sign = 1.0 if same_sense else -1.0
    if curve.period is not None:
        length = (sign * (last - first)) % curve.period
        if closed or length < 1e-9 * curve.period:
            length = curve.period
        return first, first + sign * length
    if sign * (last - first) <= 0.0:
        raise StepDefect(f"The curve of edge {ref} does not run from its start to its end vertex.")
    return first, last
