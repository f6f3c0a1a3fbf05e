"""Wires and edges of the kernel as guides and sections: the same curves, as trees.

Lines, circles and ellipses keep their form. Every other curve that the kernel can write as a
B-spline exactly (Bézier curves, parabolas, hyperbolas, their trimmed pieces) becomes piecewise
polynomials, divided by another where it is rational: exact but for rounding. Input: a CadQuery or
build123d wire or edge, or the kernel's own. Output: Guide, or the curve of a section.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from math import comb, cos, sin
from typing import Any, Final

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.BRepTools import BRepTools_WireExplorer
from OCP.Geom import Geom_BSplineCurve, Geom_TrimmedCurve
from OCP.GeomAbs import GeomAbs_CurveType as CurveType
from OCP.GeomConvert import GeomConvert, GeomConvert_BSplineCurveToBezierCurve
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from OCP.Standard import Standard_Failure
from OCP.TopAbs import TopAbs_EDGE, TopAbs_REVERSED, TopAbs_WIRE
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Edge, TopoDS_Shape

from pc2cad.arrays import Array
from pc2cad.brep.kernel import IndexedMapOfShape, as_edge, as_wire
from pc2cad.channels import curves, guide_functions
from pc2cad.channels.guides import JOINED, Guide, GuideError, Part, U, Vector, composite
from pc2cad.channels.polylines import Stretch, arc, in_turn, line
from pc2cad.equation.points import Combination, point, vector
from pc2cad.expression.tree import Expr, call, number, pieces, substitute

#: curves that become B-splines without loss
_CONVERTED: Final = (
    CurveType.GeomAbs_BSplineCurve, CurveType.GeomAbs_BezierCurve, CurveType.GeomAbs_Parabola,
    CurveType.GeomAbs_Hyperbola,
)  # fmt: skip
#: beyond, powers of the parameter lose more digits than a tolerance allows
LARGEST_DEGREE: Final = 15


class WireError(GuideError):
    """A wire cannot be taken as a guide or a section."""


def guide_from_wire(wire: Any, corners: str = "refuse") -> Guide:
    """Return a wire or an edge as a guide, from its beginning to its end.

    Edges that meet in a corner are refused, unless `corners` is ``mitre``: then the section is cut
    in the plane that halves the corner. u goes with the length from edge to edge. Raises
    WireError, or GuideError with the place that does not fit.
    """
    found = [guide for edge in _edges(wire) for guide in _guides(edge)]
    count = "1 edge" if len(found) == 1 else f"{len(found)} edges"
    joined = composite(found, corners)
    words = joined.words.replace(f"{len(found)} guides joined", f"a wire of {count}")
    return Guide(joined.parts, joined.breaks, joined.joined, words)


def section_from_wire(wire: Any) -> curves.Curve:
    """Return a closed wire in a plane z = constant as the curve of a section: its x and y.

    Each edge becomes a face of its own, so that corners stay corners; t runs from 0 to 1 with the
    length (a polygon gives each side the same share). The guide runs through the origin. Raises
    WireError.
    """
    found = [guide for edge in _edges(wire) for guide in _guides(edge)]
    try:
        # corners do no harm in a section
        whole = composite(found, "mitre")
    except GuideError as error:
        raise WireError(f"the wire is no section: {error}") from None
    if not whole.closed:
        raise WireError("a section is a closed wire, and the ends of this one are two places")
    places = _places(whole)
    if np.ptp(places[:, 2]) > JOINED * np.ptp(places, axis=0).max():
        raise WireError(
            "a section lies in a plane z = constant, and this wire does not; bring it there, in "
            "CadQuery with plane.toLocalCoords(wire)"
        )
    if all(part.unit_tangent is not None and not _varies(part) for part in whole.parts):
        corners = [guide_functions.at(p.point.coordinates[:2], whole.limits(i)[0])
                   for i, p in enumerate(whole.parts)]  # fmt: skip
        return curves.polygon([(number(float(x)), number(float(y))) for x, y in corners])
    x, y, _ = whole.N.coordinates
    return (lambda t: substitute((x,), {"u": t})[0], lambda t: substitute((y,), {"u": t})[0])


def _places(guide: Guide) -> Array:
    """Return places along a guide, (n, 3)."""
    rows = [
        guide_functions.values(part.point.coordinates, np.linspace(*guide.limits(i), 17))
        for i, part in enumerate(guide.parts)
    ]
    return np.concatenate(rows, axis=1).T


def _varies(part: Part) -> bool:
    return any(c.symbols for c in part.tangent.coordinates)


# -- reading the kernel ----------------------------------------------------------------------------


def _edges(wire: Any) -> list[TopoDS_Edge]:
    """Return the edges of a wire one after another, each in the direction of the walk."""
    shape = getattr(wire, "wrapped", wire)
    if not isinstance(shape, TopoDS_Shape) or shape.IsNull():
        raise WireError(
            f"a wire or an edge is needed, and {type(wire).__name__} was given; of a CadQuery "
            "Workplane take .val()"
        )
    if shape.ShapeType() == TopAbs_EDGE:
        return [as_edge(shape)]
    if shape.ShapeType() != TopAbs_WIRE:
        kind = shape.ShapeType().name.removeprefix("TopAbs_").lower()
        raise WireError(f"a wire or an edge is needed, and a {kind} was given")
    explorer, found = BRepTools_WireExplorer(as_wire(shape)), []
    while explorer.More():
        found.append(explorer.Current())
        explorer.Next()
    there = IndexedMapOfShape()
    TopExp.MapShapes_s(shape, TopAbs_EDGE, there)
    if len(found) != there.Extent():
        raise WireError(
            f"the wire has {there.Extent()} edges, and only {len(found)} of them follow one another"
        )
    return found


def _guides(edge: TopoDS_Edge) -> list[Guide]:
    """Return the smooth stretches of one edge, in its own direction."""
    adaptor = BRepAdaptor_Curve(edge)
    low, high = adaptor.FirstParameter(), adaptor.LastParameter()
    backwards = edge.Orientation() == TopAbs_REVERSED
    start, end = (high, low) if backwards else (low, high)
    kind = adaptor.GetType()
    if kind == CurveType.GeomAbs_Line:
        return [_one(line(_numbers(adaptor.Value(start)), _numbers(adaptor.Value(end))))]
    if kind == CurveType.GeomAbs_Circle:
        circle = adaptor.Circle()
        first, second = _axes(circle.Position(), start, backwards)
        centre, radius = _numbers(circle.Location()), circle.Radius()
        return [_one(arc(centre, first, second, radius, high - low))]
    if kind == CurveType.GeomAbs_Ellipse:
        ellipse = adaptor.Ellipse()
        axes = ellipse.Position()
        turn = number(start) + number(end - start) * U
        N = (
            point(*_numbers(ellipse.Location()))
            + vector(*_numbers(axes.XDirection())) * (ellipse.MajorRadius() * call("cos", turn))
            + vector(*_numbers(axes.YDirection())) * (ellipse.MinorRadius() * call("sin", turn))
        )
        return [_of(N)]
    if kind not in _CONVERTED:
        name = kind.name.removeprefix("GeomAbs_")
        raise WireError(
            f"the wire has an edge of the kind {name}, whose curve is no line, conic or spline; "
            "make a spline of it first"
        )
    curve = BRep_Tool.Curve_s(edge, 0.0, 1.0)
    try:
        spline = GeomConvert.CurveToBSplineCurve_s(Geom_TrimmedCurve(curve, low, high))
    except Standard_Failure as failure:
        raise WireError(f"the kernel makes no spline of an edge: {failure}") from None
    if backwards:
        spline.Reverse()
    return [_of(N) for N in _splines(spline)]


def _one(stretch: Stretch) -> Guide:
    return in_turn([stretch], False, "")


def _of(N: Combination) -> Guide:
    return Guide((Part(N),), (Fraction(0), Fraction(1)), None, "")


def _numbers(place: gp_Pnt | gp_Dir) -> Vector:
    return place.X(), place.Y(), place.Z()


def _axes(position: gp_Ax2, start: float, backwards: bool) -> tuple[Vector, Vector]:
    """Return the directions from the centre to an arc's beginning, and of its beginning."""
    x, y = (np.array(_numbers(d)) for d in (position.XDirection(), position.YDirection()))
    first, second = x * cos(start) + y * sin(start), y * cos(start) - x * sin(start)
    a, b, c = first.tolist()
    d, e, f = (-second if backwards else second).tolist()
    return (a, b, c), (d, e, f)


# -- splines ---------------------------------------------------------------------------------------


def _splines(spline: Geom_BSplineCurve) -> list[Combination]:
    """Return a spline as points N(u) for u in [0, 1], cut where it may have corners."""
    degree = spline.Degree()
    if degree > LARGEST_DEGREE:
        raise WireError(f"the wire has a spline of degree {degree}; at most {LARGEST_DEGREE} is "
                        "taken")  # fmt: skip
    bezier = GeomConvert_BSplineCurveToBezierCurve(spline)
    count = bezier.NbArcs()
    knots = [spline.Knot(spline.FirstUKnotIndex() + i) for i in range(count + 1)]
    orders = [degree - spline.Multiplicity(spline.FirstUKnotIndex() + i) for i in range(1, count)]
    cuts = [0, *(i + 1 for i, order in enumerate(orders) if order < 1), count]
    result = []
    for first, last in pairwise(cuts):
        low, span = knots[first], knots[last] - knots[first]
        shares = [(knot - low) / span for knot in knots[first : last + 1]]
        rows = [
            _powers(bezier.Arc(i), shares[i - first] - shares[i - first - 1])
            for i in range(first + 1, last + 1)
        ]
        result.append(_pieced(shares, np.array(rows), min(orders[first : last - 1], default=0)))
    return result


def _powers(bezier: Any, width: float) -> Array:
    """Return a Bézier arc's homogeneous coefficients (degree + 1, 4) by powers of the distance."""
    degree = bezier.Degree()
    poles = np.array([(*_numbers(bezier.Pole(i + 1)), 1.0) for i in range(degree + 1)])
    poles *= np.array([[bezier.Weight(i + 1)] for i in range(degree + 1)])
    differences, rows = poles, []
    for k in range(degree + 1):
        rows.append(comb(degree, k) * differences[0] / width**k)
        differences = np.diff(differences, axis=0)
    return np.array(rows)


def _pieced(shares: Sequence[float], rows: Array, smoothness: int) -> Combination:
    """Return the point with coefficients (pieces, degree + 1, 4) over the shares of [0, 1]."""
    breaks = tuple(Fraction(x) for x in shares)

    def tree(axis: int) -> Expr:
        trees = tuple(tuple(number(float(c)) for c in row[:, axis]) for row in rows)
        return pieces(U, breaks, trees, smoothness, closed=False)

    x, y, z = (tree(axis) for axis in range(3))
    first = rows[0, 0, 3]
    if np.abs(rows[:, 0, 3] - first).max() <= 1e-15 * first and not rows[:, 1:, 3].any():
        first = number(float(first))
        return point(x / first, y / first, z / first)
    weight = tree(3)
    return point(x / weight, y / weight, z / weight)
