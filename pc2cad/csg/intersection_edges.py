"""What is known of the edges where bodies meet: curves that the kernel's Booleans have made.

Such an edge is *exact* where it is a line or a conic that lies on both sides by
algebra, and *bounded* where its distance from where the equations' faces meet is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite

from pc2cad.arrays import Array
from pc2cad.bounds.edge_bounds import EdgeBound, bound_edge
from pc2cad.brep.booleans import NamedEdge, NamedShape, edge_functions
from pc2cad.brep.tolerance import KERNEL_TOLERANCE
from pc2cad.geometry.carriers import AnalyticSurface, Arc, Evidence, Line, Plane, SplineSurface
from pc2cad.geometry.recognition.implicit import ROUNDING, holds, point_along
from pc2cad.report import EdgeReport
from pc2cad.representation.boundary_model import BoundaryModel
from pc2cad.topology.cells import SideKey


@dataclass(frozen=True, eq=False)
class Side:
    """A face of a body, as far as its equation's side is known."""

    evidence: Evidence
    deviation: float
    #: surfaces and edges that the side lies on, or that lie on it, exactly
    exact: tuple[Plane | AnalyticSurface | Line | Arc, ...]
    #: where the body was moved to, a turn and an offset; None for one that stands as it is
    placed: tuple[Array, Array] | None = None

    def holds(self, edge: NamedEdge) -> bool:
        """Say whether a line or a conic lies on the side by algebra."""
        if edge.conic is None:
            return False
        start, terms = edge.conic
        if self.placed is not None:  # looked at where the body was
            turn, offset = self.placed
            start = (start - offset) @ turn
            terms = {name: along @ turn for name, along in terms.items()}
        point = point_along(start, terms, edge.range)
        return any(holds(carrier, point) for carrier in self.exact)


def sides_of(name: str, model: BoundaryModel) -> dict[SideKey, Side]:
    """Return the faces of a body by the keys that they have in a shape."""
    found = {}
    for face in model.faces:
        exact: list[Plane | AnalyticSurface | Line | Arc] = []
        if face.evidence == "exact" and not isinstance(face.carrier, SplineSurface):
            exact.append(face.carrier)
        for edge in (model.edges[index] for index in face.border):
            if edge.evidence == "exact" and isinstance(edge.carrier, Line | Arc):
                exact.append(edge.carrier)
        found[replace(face.key, body=name)] = Side(face.evidence, face.deviation, tuple(exact))
    return found


def prove_intersection_edges(
    shape: NamedShape, edges: Sequence[NamedEdge], faces: Mapping[SideKey, Side], size: float
) -> Iterator[EdgeReport]:
    """Yield what is known of edges between faces of different bodies.

    `faces` are the bodies' own, by the keys that the shape's faces have, `size` is that of the
    part.
    """
    for edge, function in zip(edges, edge_functions(shape, edges), strict=True):
        sides = [max((faces[name] for name in names), key=_weakness) for names in edge.names]
        found = bound_edge(function, (sides[0].deviation, sides[1].deviation))
        off = max(found.off)
        evidence, deviation, where = _judged(edge, sides, found, size)
        yield EdgeReport(
            edge.label, edge.curve, evidence, deviation,
            0.0 if evidence == "exact" else found.seen if evidence == "bounded" else deviation,
            where, *edge.spline,
            off if isfinite(off) else found.off_seen,
        )  # fmt: skip


def edge_warnings(curves: Sequence[EdgeReport], loosest: float) -> Iterator[str]:
    """Yield what is unusual about edges, where the kernel may be off by `loosest`."""
    for curve in curves:
        if curve.evidence == "bounded" and curve.deviation > loosest:
            yield (
                f"edge {curve.name} is proved to within {curve.deviation:.2g} only, which is more "
                "than the tolerance: its faces meet at a shallow angle"
            )
        if curve.evidence == "sampled" and curve.sampled > KERNEL_TOLERANCE:
            yield (
                f"edge {curve.name} is {curve.sampled:.2g} off its faces, which strict checks of "
                "other programs may find"
                + (f"; try --tolerance {KERNEL_TOLERANCE:g}" if loosest > KERNEL_TOLERANCE else "")
            )


def _weakness(side: Side) -> tuple[int, float]:
    """Return what sorts sides: where two coincide, the shape has the surface of either."""
    return ("exact", "bounded", "sampled").index(side.evidence), side.deviation


def _judged(
    edge: NamedEdge, sides: Sequence[Side], found: EdgeBound, size: float
) -> tuple[Evidence, float, str]:
    """Return the evidence, the deviation and where no bound could be had."""
    for side, names in zip(sides, edge.names, strict=True):
        if side.evidence == "sampled":
            return "sampled", found.off_seen, f"all of it, as {names[0].label} is"
    fine = isfinite(max(found.off)) and found.across_seen <= ROUNDING * size
    if fine and _lies_on(edge, sides):
        return "exact", 0.0, ""
    if isfinite(max(*found.off, found.largest)):
        return "bounded", found.largest, ""
    where = []
    for ends in found.open:
        places = ["({:.6g}, {:.6g}, {:.6g})".format(*edge.place(t)) for t in ends]
        where.append(" to ".join(places))
    return "sampled", found.off_seen, ", ".join(where)


def _lies_on(edge: NamedEdge, sides: Sequence[Side]) -> bool:
    """Say whether an edge is a conic that lies on both equations' faces by algebra."""
    return all(side.holds(edge) for side in sides)
