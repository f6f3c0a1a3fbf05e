"""Whether the wires of a plane face are simple, apart, and nested: what the kernel looks for."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_BSplineCurve, Geom_Line, Geom_Plane
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Shape, TopoDS_Vertex

from pc2cad.arrays import Array
from pc2cad.brep.from_kernel import frame
from pc2cad.brep.kernel import as_edge, children
from pc2cad.brep.spline_integrals import read_curve
from pc2cad.brep.tolerance import WELL_WITHIN
from pc2cad.geometry.carriers import SplineCurve
from pc2cad.geometry.plane_chains import outer_chain, turn_of
from pc2cad.geometry.round_chains import round_chains
from pc2cad.geometry.sheets import curve_pieces, elevated

#: points that the kernel takes of all edges of a face from which on proving is the faster way
WORTH_WHILE = 120
#: as many of them as an edge that is no spline takes as long as
_STRAIGHT = 4
#: points that the kernel takes of a spline at most (``Geom2dInt_Geom2dCurveTool::NbSamples``)
_MOST_SAMPLES = 300
_ORIGIN = np.zeros(3)
#: how what is oriented is walked; what is internal or external is not
TURNS = {TopAbs_Orientation.TopAbs_FORWARD: 1, TopAbs_Orientation.TopAbs_REVERSED: -1}


def samples(edge: TopoDS_Edge) -> int:
    """Return how many points the kernel compares an edge by with others, or what that is worth."""
    curve = BRep_Tool.Curve_s(edge, 0.0, 1.0)
    if not isinstance(curve, Geom_BSplineCurve):
        return _STRAIGHT
    return int(min(_MOST_SAMPLES, (curve.NbKnots() - 1) * curve.Degree()))


def is_in_order(face: TopoDS_Face, wires: Sequence[TopoDS_Shape]) -> bool:
    """Return whether a plane face is proved to be what the kernel's checker wants of it.

    That is what `ordered_wires` proves, and that edges of a wire are joined by their vertices, that
    the outer wire runs counterclockwise and all others clockwise, and that neither edges nor
    vertices have something on the plane of their own: what is left are wires by themselves.
    """
    found = ordered_wires(face, wires)
    if found is None:
        return False
    for i, (wire, sense) in enumerate(zip(wires, found.senses, strict=True)):
        if sense * TURNS.get(wire.Orientation(), 0) != (1 if i == found.outer else -1):
            return False
    return all(map(_are_joined, found.edges)) and all(
        _is_plain(edge) for row in found.edges for edge in row
    )


class OrderedWires(NamedTuple):
    """Wires of a plane face that are simple, apart and nested, as they are run through forward."""

    #: the wire around all others
    outer: int
    #: whether each runs counterclockwise (1) or not (-1)
    senses: tuple[int, ...]
    edges: list[list[TopoDS_Edge]]


def ordered_wires(face: TopoDS_Face, wires: Sequence[TopoDS_Shape]) -> OrderedWires | None:
    """Return the wires of a plane face, if it is proved that the kernel finds them in order.

    That is: each simple, none nearer to another than the kernel's tolerances and the distance
    between curves and the polygons that it compares, edges on the plane, and all but the outer one
    side by side in that. None where this is not proved, or not worth its while: of surfaces other
    than planes, and curves other than lines and polynomial splines.
    """
    plane = BRep_Tool.Surface_s(face)
    if not isinstance(plane, Geom_Plane):
        return None
    edges = [_edges(wire) for wire in wires]
    if sum(samples(edge) for row in edges for edge in row) < WORTH_WHILE:
        return None
    curves = [[_curve(edge) for edge in row] for row in edges]
    known = [[curve for curve in row if curve is not None] for row in curves]
    if list(map(len, known)) != list(map(len, edges)) or not all(known):
        return None
    tolerances = [BRep_Tool.Tolerance_s(edge) for row in edges for edge in row]
    degree = max(nets.shape[1] for row in known for nets, _ in row) - 1
    place, axes = frame(plane.Position(), _ORIGIN)
    chains = []
    for row in known:
        nets = np.concatenate([elevated(nets, degree, 1) for nets, _ in row]) - place
        flat = nets @ axes.T
        if np.abs(flat[..., 2]).max() > min(tolerances) / 2:
            return None
        chain = np.ascontiguousarray(flat[..., :2])
        if np.abs(chain[:, -1] - np.roll(chain[:, 0], -1, axis=0)).max() > WELL_WITHIN:
            return None
        chains.append(chain)
    margin = 8 * max(tolerances) + 6 * max(off for row in known for _, off in row)
    shapes = tuple(chain.shape for chain in chains)
    outer, senses = _outer_of(tuple(chain.tobytes() for chain in chains), shapes, margin)
    return None if outer is None else OrderedWires(outer, senses, edges)


def _are_joined(edges: Sequence[TopoDS_Edge]) -> bool:
    """Return whether each edge ends at the vertex that the next one begins at."""
    starts = [TopExp.FirstVertex_s(edge, True) for edge in edges]
    ends = [TopExp.LastVertex_s(edge, True) for edge in edges]
    return all(map(TopoDS_Vertex.IsSame, ends, starts[1:] + starts[:1]))


def _is_plain(edge: TopoDS_Edge) -> bool:
    """Return whether the kernel has nothing to ask of an edge of a plane face but of its curve.

    It asks for curves in parameters that run with that, and for none on planes nor for places of
    vertices on surfaces.
    """
    curves = edge.TShape().Curves()
    parts = [curves.First(), curves.Last()] if curves.Size() <= 2 else [*curves]
    vertices = TopExp.FirstVertex_s(edge), TopExp.LastVertex_s(edge)
    return (
        edge.Orientation() in TURNS
        and BRep_Tool.SameParameter_s(edge)
        and BRep_Tool.SameRange_s(edge)
        and not any(
            part.IsCurveOnSurface() and isinstance(part.Surface(), Geom_Plane) for part in parts
        )
        and all(vertex.TShape().Points().Size() == 0 for vertex in vertices)
    )


def _curve(edge: TopoDS_Edge) -> tuple[Array, float] | None:
    """Return an edge's pieces (n, d+1, 3), and how far off the kernel's polygon of it may be.

    In the direction that its wire has it in. None for kinds of curves that are not known here.
    """
    first, last = BRep_Tool.Range_s(edge)
    curve, off = BRep_Tool.Curve_s(edge, first, last), 0.0
    if isinstance(curve, Geom_Line):
        nets = np.array([[curve.Value(first).Coord(), curve.Value(last).Coord()]])
    elif isinstance(curve, Geom_BSplineCurve) and not curve.IsRational():
        spline = read_curve(curve, _ORIGIN)
        ends = np.array([spline.knots[0], spline.knots[-1]])
        if np.abs(ends - (first, last)).max() > 1e-12 * (last - first):
            return None
        pieces, points = curve_pieces(SplineCurve(spline.degree, spline.knots, spline.poles))
        nets = pieces[..., :3]
        off = _off(nets, np.diff(points), (last - first) / max(samples(edge) - 1, 1))
    else:
        return None
    if edge.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
        nets = nets[::-1, ::-1]
    return nets, off


def _off(nets: Array, lengths: Array, step: float) -> float:
    """Return how far a spline is from its chords over steps of its parameter, at most."""
    degree = nets.shape[1] - 1
    bends = np.linalg.norm(np.diff(nets, 2, axis=1), axis=2).max(axis=1, initial=0.0)
    return float((degree * (degree - 1) * bends / lengths**2).max()) * step**2 / 8


@lru_cache(maxsize=16)
def _outer_of(
    data: tuple[bytes, ...], shapes: tuple[tuple[int, ...], ...], margin: float
) -> tuple[int | None, tuple[int, ...]]:
    """Return what `outer_chain` does, and which way each chain runs.

    What is read back is asked for again with the same bytes.
    """
    chains = [np.frombuffer(one).reshape(shape) for one, shape in zip(data, shapes, strict=True)]
    found = round_chains(chains, margin)
    if found is not None:
        return found
    outer = outer_chain(chains, margin)
    return (None, ()) if outer is None else (outer, tuple(map(turn_of, chains)))


def _edges(wire: TopoDS_Shape) -> list[TopoDS_Edge]:
    # which way round does not matter, but that each edge begins where the one before it ends
    return [as_edge(edge) for edge in children(wire.Oriented(TopAbs_Orientation.TopAbs_FORWARD))]
