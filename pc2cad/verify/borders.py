"""How far the edges of a side are from those of its face: proved where that can be had."""

from __future__ import annotations

from collections import Counter

import numpy as np

from pc2cad.arrays import Array
from pc2cad.bounds.deviation import bound_curve
from pc2cad.bounds.known import Known
from pc2cad.bounds.rational_deviation import bound_spline
from pc2cad.expression.breaks import BreaksNotAlignedError
from pc2cad.expression.tree import ZERO, Expr, number
from pc2cad.geometry import carriers
from pc2cad.geometry.recognition.implicit import holds
from pc2cad.geometry.splines.bernstein import bezier_knots
from pc2cad.topology.cells import Cell
from pc2cad.verify.arc_courses import arc_course
from pc2cad.verify.curves import Conic, Curve, Line, Reversed
from pc2cad.verify.edges import Edge
from pc2cad.verify.nearness import SEEN, Nearness
from pc2cad.verify.sides import Match, Sides
from pc2cad.verify.splines import SplineCurve

#: places at which the edge of the file is found that an edge of the equation lies on
_PLACES = np.array([0.0, 0.137, 0.413, 0.741, 1.0])
#: degree in which the distance from a line is looked at
_FLAT = 7


class Borders:
    """Proofs for the edges of an equation, each made once for both of its faces."""

    def __init__(self, sides: Sides, tolerance: float, models: Known) -> None:
        self._sides, self._tolerance, self._models = sides, tolerance, models
        self._known: dict[tuple[Cell, int], Nearness] = {}

    def nearness(self, match: Match) -> Nearness:
        """Return how near the border of a side is to that of its face, and what that rests on.

        Every edge of the side lies on the curve of an edge of the face, within the distance, and
        each edge of the face has one; ends are compared as places.
        """
        loops = match.face.face.loops
        uses = Counter(edge.ref for loop in loops for edge, _ in loop.edges)
        own = {e.ref: e for loop in loops for e, _ in loop.edges if uses[e.ref] == 1}
        cells = self._sides.rim(match.patches)
        if not own or not cells:
            return Nearness("exact", 0.0) if not own and not cells else SEEN
        found, used = [], set()
        for cell in cells:
            places = self._sides.points(cell, _PLACES)
            edge = next((e for e in own.values() if self._is_on(e, places)), None)
            if edge is None:
                return SEEN
            used.add(edge.ref)
            key = cell, int(edge.ref)
            if key not in self._known:
                self._known[key] = self._prove(cell, edge, places)
            found.append(self._known[key])
        if used != set(own) or any(proof.rests_on == "sampled" for proof in found):
            return SEEN
        exact = all(proof.rests_on == "exact" for proof in found)
        return Nearness("exact" if exact else "bounded", max(proof.distance for proof in found))

    def _is_on(self, edge: Edge, places: Array) -> bool:
        curve = edge.curve.curve if isinstance(edge.curve, Reversed) else edge.curve
        if isinstance(curve, SplineCurve) and not curve.may_hold(places, self._tolerance):
            return False
        on = edge.curve.at(edge.curve.locate(places))[0]
        return bool(np.linalg.norm(on - places, axis=1).max() <= self._tolerance)

    def _prove(self, cell: Cell, edge: Edge, places: Array) -> Nearness:
        trees, names = self._sides.trees(cell)
        curve = edge.curve.curve if isinstance(edge.curve, Reversed) else edge.curve
        carrier = _carrier(curve)
        if carrier is not None and holds(carrier, trees):
            return Nearness("exact", 0.0)
        try:
            if isinstance(curve, Line):
                largest = _off_line(trees, names[0], curve, self._models)
            elif isinstance(curve, SplineCurve) and curve.rational:
                largest = self._off_arc(cell, curve, edge)
            elif isinstance(curve, SplineCurve):
                spline = _turned(curve, edge, places, self._tolerance)
                if spline is None:
                    return SEEN
                largest = bound_curve(trees, names[0], spline, self._models).largest
            else:
                return SEEN
        except BreaksNotAlignedError:
            return SEEN
        return Nearness("bounded", largest) if largest <= self._tolerance else SEEN

    def _off_arc(self, cell: Cell, curve: SplineCurve, edge: Edge) -> float:
        """Return a bound of the distance from a rational spline in one arc, infinite without it."""
        trees, names = self._sides.trees(cell)
        low, high = curve.domain
        course = arc_course(trees, names[0], (curve.knots - low) / (high - low), curve.poles[:, 3])
        if course is None:
            return np.inf
        places = self._sides.points(cell, course.places(_PLACES))
        spline = _turned(curve, edge, places, self._tolerance)
        if spline is None:
            return np.inf
        return bound_spline(trees, names, spline, [course], self._models).largest


def _carrier(curve: Curve) -> carriers.Line | carriers.Arc | None:
    if isinstance(curve, Line):
        return carriers.Line(curve.origin, curve.origin + curve.vector)
    if not isinstance(curve, Conic):
        return None
    radii = [float(np.linalg.norm(half)) for half in (curve.first, curve.second)]
    x, y = curve.first / radii[0], curve.second / radii[1]
    if radii[0] < radii[1]:
        x, y, radii = y, -x, radii[::-1]
    frame = carriers.Frame(curve.centre, np.array([x, y, np.cross(x, y)]))
    return carriers.Arc(frame, (radii[0], radii[1]), 0.0, 2.0 * np.pi)


def _off_line(trees: tuple[Expr, ...], name: str, line: Line, models: Known) -> float:
    """Return a bound of the distance from a line: of both coordinates across it from nought."""
    z = line.vector / np.linalg.norm(line.vector)
    x = np.eye(3)[np.argmin(np.abs(z))]
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    across = []
    for axis in (x, np.cross(z, x)):
        height = ZERO
        for tree, o, n in zip(trees, line.origin, axis, strict=True):
            height = height + number(float(n)) * (tree - number(float(o)))
        across.append(height)
    flat = carriers.SplineCurve(_FLAT, bezier_knots(_FLAT), np.zeros((_FLAT + 1, 3)))
    return bound_curve((*across, ZERO), name, flat, models).largest


def _turned(
    curve: SplineCurve, edge: Edge, places: Array, tolerance: float
) -> carriers.SplineCurve | None:
    """Return a spline on [0, 1] that runs as the places do; None where it is more than the edge."""
    low, high = curve.domain
    whole = np.linalg.norm(
        curve.at(np.array([low, high]))[0][:, None] - edge.samples[[0, -1]], axis=2
    )
    if whole.min(axis=0).max() > tolerance:
        return None
    for backwards in (False, True):
        shares = 1.0 - _PLACES if backwards else _PLACES
        off = np.linalg.norm(curve.at(low + (high - low) * shares)[0] - places, axis=1)
        if off.max() <= 10.0 * tolerance:
            knots, poles = (curve.knots - low) / (high - low), curve.poles
            if backwards:
                knots, poles = 1.0 - knots[::-1], poles[::-1]
            if not curve.rational:
                return carriers.SplineCurve(curve.degree, knots, poles)
            weights = poles[:, 3]
            points = poles[:, :3] / weights[:, None]
            return carriers.SplineCurve(curve.degree, knots, points, weights / weights[0])
    return None
