"""Vertices, edges and loops of a STEP file, with the line integrals of the edges."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from pc2cad.arrays import Array
from pc2cad.verify.curves import Curve, domain_of, gauss_rule, read_curve
from pc2cad.verify.defects import StepDefectError
from pc2cad.verify.exchange import Ref
from pc2cad.verify.records import Records, is_true, sequence

_SAMPLES = 17
_POINTS = 16


@dataclass(frozen=True, eq=False)
class Edge:
    """An edge from its start vertex to its end vertex."""

    ref: Ref
    start: Ref
    end: Ref
    #: places along it, its ends included, (n, 3)
    samples: Array
    #: Gauss points, and the steps dr that belong to them
    places: Array
    steps: Array
    #: largest distance of an end of the curve from its vertex
    gap: float
    #: what it is cut from, and its parameters at the start and the end vertex
    curve: Curve
    interval: tuple[float, float]

    @property
    def length(self) -> float:
        """The length of the edge."""
        return float(np.linalg.norm(self.steps, axis=1).sum())


@dataclass(frozen=True, eq=False)
class Loop:
    """A closed chain of edges with the sense in which the face uses each; or one vertex."""

    edges: tuple[tuple[Edge, bool], ...]
    vertex: Array | None

    @property
    def is_free(self) -> bool:
        """Whether its uses could come in any order: seams that begin and end at one vertex."""
        uses = Counter(edge.ref for edge, _ in self.edges)
        ends = {vertex for edge, _ in self.edges for vertex in (edge.start, edge.end)}
        return len(ends) == 1 and set(uses.values()) == {2}

    @property
    def flows(self) -> list[tuple[Array, Array]]:
        """Gauss points and signed steps dr along each edge, in the order of the loop."""
        return [
            (edge.places, edge.steps) if forward else (edge.places[::-1], -edge.steps[::-1])
            for edge, forward in self.edges
        ]

    @property
    def flow(self) -> tuple[Array, Array]:
        """Gauss points and signed steps dr along the loop, in its order."""
        none = np.empty((0, 3))
        places, steps = zip((none, none), *self.flows, strict=True)
        return np.concatenate(places), np.concatenate(steps)


class EdgeReader:
    """Reads edges once each and remembers them."""

    def __init__(self, records: Records) -> None:
        self._records = records
        self.edges: dict[Ref, Edge] = {}
        self.vertices: dict[Ref, Array] = {}

    def vertex(self, ref: Any) -> Array:
        """Return the place of a VERTEX_POINT."""
        if ref not in self.vertices:
            _, point = self._records.get(ref, "VERTEX_POINT").values(2)[:2]
            self.vertices[ref] = self._records.point(point)
        return self.vertices[ref]

    def edge(self, ref: Any) -> Edge:
        """Return an EDGE_CURVE with its curve cut to its vertices."""
        if ref not in self.edges:
            self.edges[ref] = self._read(ref)
        return self.edges[ref]

    def _read(self, ref: Any) -> Edge:
        values = self._records.get(ref, "EDGE_CURVE").values(5)
        _, start, end, geometry, same_sense = values[:5]
        curve = read_curve(self._records, geometry)
        ends = np.array([self.vertex(start), self.vertex(end)])
        first, last = _interval(curve, ends, start == end, is_true(same_sense), ref)
        samples = curve.at(np.linspace(first, last, _SAMPLES))[0]
        breaks = curve.breaks(min(first, last), max(first, last))
        # on a line too: what is swept along it on a surface is no polynomial
        nodes, weights = gauss_rule(breaks, max(_POINTS, curve.points))
        places, slopes = curve.at(nodes)
        sign = 1.0 if last > first else -1.0
        if sign < 0.0:
            places, slopes, weights = places[::-1], slopes[::-1], weights[::-1]
        gap = float(np.linalg.norm(samples[[0, -1]] - ends, axis=1).max())
        steps = sign * weights[:, None] * slopes
        if not (np.isfinite(samples).all() and np.isfinite(steps).all()):
            raise StepDefectError(f"the edge {ref} has places that are not finite")
        return Edge(ref, start, end, samples, places, steps, gap, curve, (first, last))

    def loop(self, ref: Any) -> Loop:
        """Return a FACE_BOUND as a loop that runs around the face's normal."""
        _, loop_ref, flag = self._records.get(ref, "FACE_BOUND", "FACE_OUTER_BOUND").values(3)[:3]
        loop = self._records.get(loop_ref, "EDGE_LOOP", "VERTEX_LOOP")
        if loop.keyword == "VERTEX_LOOP":
            return Loop((), self.vertex(loop.values(2)[1]))
        uses = []
        for use in sequence(loop.values(2)[1]):
            values = self._records.get(use, "ORIENTED_EDGE").values(5)
            uses.append((self.edge(values[3]), is_true(values[4])))
        _require_chain(uses, loop_ref)
        if not is_true(flag):
            uses = [(edge, not forward) for edge, forward in reversed(uses)]
        return Loop(tuple(uses), None)


def _require_chain(uses: list[tuple[Edge, bool]], loop: Any) -> None:
    if not uses:
        raise StepDefectError(f"the loop {loop} has no edges")
    ends = [(e.start, e.end) if forward else (e.end, e.start) for e, forward in uses]
    for position, (_, end) in enumerate(ends):
        following = (position + 1) % len(ends)
        if end != ends[following][0]:
            raise StepDefectError(
                f"the loop {loop} is not closed: the edge {uses[position][0].ref} ends at the "
                f"vertex {end}, the edge {uses[following][0].ref} starts at {ends[following][0]}"
            )


def _interval(
    curve: Curve, ends: Array, closed: bool, same_sense: bool, ref: Any
) -> tuple[float, float]:
    """Return the parameters of an edge's start and end, in the order in which the edge runs."""
    sign = 1.0 if same_sense else -1.0
    first, last = (float(t) for t in curve.locate(ends))
    if curve.period is not None:
        span = (sign * (last - first)) % curve.period
        if closed or span < 1e-9 * curve.period:
            span = curve.period
        return first, first + sign * span
    domain = domain_of(curve)
    if closed and np.isfinite(domain).all():
        first, last = domain[:: int(sign)]
    if not sign * (last - first) > 0.0:
        raise StepDefectError(
            f"the curve of the edge {ref} does not run from its start to its end vertex"
        )
    return first, last
