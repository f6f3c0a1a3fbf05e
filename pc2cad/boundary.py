"""The represent stage: every face and edge of the boundary complex gets one carrier.

Input: Analysis (map, orientation and boundary complex). Output: BoundaryModel. This is the
one place where topology meets geometry: an edge is carried once, and every face that uses it takes
its poles, so that there is nothing to sew.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pc2cad.analysis import Analysis
from pc2cad.directions import (
    CellFunction,
    DirectionClasses,
    Piece,
    is_exact,
    polynomial_space,
    resolve,
    sections,
)
from pc2cad.errors import InputError, ToleranceNotReachedError
from pc2cad.geometry.bernstein import bernstein, bezier_knots, linear_span
from pc2cad.geometry.carriers import (
    CurveCarrier,
    Evidence,
    Line,
    Plane,
    Segment,
    SplineCurve,
    SplineSurface,
    SurfaceCarrier,
    fit_plane,
    spline_traits,
)
from pc2cad.geometry.profile import COMPACT, SplineProfile
from pc2cad.geometry.refinement import Sampler, check_places
from pc2cad.geometry.spline_space import SplineSpace
from pc2cad.geometry.tensor import curve_deviation, fit_surface, surface_deviation
from pc2cad.model import BoundaryModel, ModelEdge, ModelFace
from pc2cad.planar import coplanar_groups, plane_face
from pc2cad.topology.cells import directions_of, outward_sign
from pc2cad.topology.complex import EdgeUse

Array = NDArray[np.float64]

#: share of the tolerance that one direction's fit aims at: half of what a face may deviate by
DIRECTION_SHARE = 0.24
#: what sampled deviations may use of the tolerance
SAMPLED_SHARE = 0.5
TRIES = 6


def represent(
    analysis: Analysis,
    outer_shell: int = 0,
    tolerance: float | None = None,
    profile: SplineProfile = COMPACT,
) -> BoundaryModel:
    """Return the boundary model within `tolerance` of the equation (a length, model units).

    The default is 1e-7 of the part's size. Raises ToleranceNotReachedError.
    """
    tolerance = check_tolerance(analysis, tolerance)
    work = _Representation(analysis, tolerance, _rounding(analysis), profile)
    edges, faces = work.carriers()
    shells = [
        tuple(i for i, face in enumerate(faces) if face.cells[0] in shell.faces)
        for shell in analysis.boundary.shells
    ]
    shells.insert(0, shells.pop(outer_shell))
    return BoundaryModel(
        analysis.boundary, work.vertices, tuple(edges), tuple(faces), tuple(shells), tolerance,
        analysis.size,
    )  # fmt: skip


def check_tolerance(analysis: Analysis, tolerance: float | None) -> float:
    """Return the tolerance, or its default; raise where double precision cannot hold it."""
    if tolerance is None:
        tolerance = 1e-7 * analysis.size
    if not (np.isfinite(tolerance) and tolerance > 0):
        raise InputError(f"the tolerance must be a positive length, not {tolerance}")
    rounding = _rounding(analysis)
    if tolerance < 4 * rounding:
        raise ToleranceNotReachedError(
            f"a tolerance of {tolerance:.3g} is below what double precision holds for this part "
            f"({4 * rounding:.3g}); move it nearer to the origin or allow more"
        )
    return tolerance


def _rounding(analysis: Analysis) -> float:
    return 64 * float(np.finfo(float).eps) * (analysis.size + analysis.magnitude)


class _Representation:
    """Works out one model; lives for one call of `represent`."""

    def __init__(
        self, analysis: Analysis, tolerance: float, rounding: float, profile: SplineProfile
    ) -> None:
        self._analysis = analysis
        self._tolerance = tolerance
        self._rounding = rounding
        self._classes = DirectionClasses(analysis, profile.degrees)
        self._boundary = analysis.boundary
        self._profile = profile
        self._faces = [
            CellFunction(analysis, face.patch, profile.exact) for face in self._boundary.faces
        ]
        self._edges = [
            CellFunction(analysis, edge.cell, profile.exact) for edge in self._boundary.edges
        ]
        self._planes = [self._plane(function) for function in self._faces]
        self._face_exact = [
            None if plane else self._exact_surface(function)
            for function, plane in zip(self._faces, self._planes, strict=True)
        ]
        self._spaces: dict[Piece, SplineSpace] = {}
        self.vertices = np.array([
            CellFunction(analysis, vertex.corners[0])() for vertex in self._boundary.vertices
        ])  # fmt: skip

    def carriers(self) -> tuple[list[ModelEdge], list[ModelFace]]:
        target = DIRECTION_SHARE * self._tolerance
        for _ in range(TRIES):
            self._resolve_directions(target)
            edges = [self._edge(i) for i in range(len(self._edges))]
            groups = coplanar_groups(self._boundary, [p and p[0] for p in self._planes])
            faces = [self._face(group, edges) for group in groups]
            worst = max([e.deviation for e in edges] + [f.deviation for f in faces])
            if worst <= SAMPLED_SHARE * self._tolerance:
                return edges, faces
            target *= 0.8 * min(1.0, SAMPLED_SHARE * self._tolerance / worst)
        raise ToleranceNotReachedError(
            f"the faces deviate by {worst:.3g} from the equation where {self._tolerance:.3g} was "
            "asked; allow a larger --tolerance"
        )

    # -- what needs no spline ------------------------------------------------------------------

    def _plane(self, function: CellFunction) -> tuple[Plane, Evidence] | None:
        """Return the plane that carries a face, if one does, its normal pointing outwards."""
        nodes = np.linspace(0.03, 0.97, 9)
        points = function(nodes, nodes).reshape(-1, 3)
        plane = fit_plane(points, 1e-12 * self._analysis.size + self._rounding)
        if plane is None:
            return None
        span = linear_span(function.trees[0])
        proved = span is not None and _rank(span) <= 2
        s, t = directions_of(function.cell)
        places = [0.0, 0.0, 0.0]
        for d in range(3):
            low, high = self._analysis.span(d, function.cell[d])
            places[d] = 0.45 * low + 0.55 * high
        along_s, along_t = self._analysis.map.tangents((s, t), *places)
        outward = self._sign(function.cell) * np.cross(along_s, along_t)
        normal = plane.normal if plane.normal @ outward > 0 else -plane.normal
        return Plane(plane.origin, normal), "exact" if proved else "sampled"

    def _sign(self, patch: tuple[int, int, int]) -> int:
        return outward_sign(patch) * self._analysis.orientation

    def _exact_surface(self, function: CellFunction) -> SplineSurface | None:
        trees, names = function.trees
        poles = bernstein(trees, names)
        if poles is None:
            return None
        degrees = (poles.shape[0] - 1, poles.shape[1] - 1)
        knots = bezier_knots(degrees[0]), bezier_knots(degrees[1])
        surface = SplineSurface(degrees, knots, poles)
        return surface if self._allowed(surface) else None

    def _allowed(self, carrier: CurveCarrier | SurfaceCarrier) -> bool:
        """Say whether the profile takes an exact carrier as it is."""
        degree, rational = spline_traits(carrier)
        return degree <= self._profile.exact and (self._profile.rational or not rational)

    # -- directions ----------------------------------------------------------------------------

    def _space(self, function: CellFunction, axis: int) -> SplineSpace:
        piece = function.pieces[axis]
        exact = polynomial_space(function, axis, self._classes.breaks(piece))
        return exact or self._spaces[self._classes.owner(piece)]

    def _resolve_directions(self, target: float) -> None:
        """Choose the space of every direction class that some face or edge cannot do without."""
        samplers: dict[Piece, list[tuple[CellFunction, int]]] = {}
        splines, seen = [], set()
        for i, (plane, exact) in enumerate(zip(self._planes, self._face_exact, strict=True)):
            if plane is None and exact is None:
                splines.append(self._faces[i])
                # the sections of a face include its edges
                seen |= {use.edge for use in self._boundary.faces[i].uses}
        lonely = [function for i, function in enumerate(self._edges) if i not in seen]
        for function in (*splines, *lonely):
            for axis, piece in enumerate(function.pieces):
                if polynomial_space(function, axis, self._classes.breaks(piece)) is None:
                    samplers.setdefault(self._classes.owner(piece), []).append((function, axis))
        for owner, users in samplers.items():
            columns = [self._column(function, axis) for function, axis in users]
            self._spaces[owner] = resolve(
                columns, self._classes.rules(owner), target, self._rounding
            )

    def _column(self, function: CellFunction, axis: int) -> Sampler:
        """Return the function of one axis alone, the other taken at its sections."""
        if len(function.pieces) == 1:
            return function
        other_piece = function.pieces[1 - axis]
        other = polynomial_space(function, 1 - axis, self._classes.breaks(other_piece))
        across = sections(other or self._spaces.get(self._classes.owner(other_piece)))
        if axis == 0:
            return lambda t: function(t, across)
        return lambda t: function(across, t).transpose(1, 0, 2)

    # -- edges and faces -----------------------------------------------------------------------

    def _edge(self, index: int) -> ModelEdge:
        function, edge = self._edges[index], self._boundary.edges[index]
        ends = self.vertices[edge.start], self.vertices[edge.end]
        trees, names = function.trees
        exact = bernstein(trees, names)
        curve = None if exact is None else self._exact_curve(index, exact)
        if curve is not None and self._allowed(curve):
            return ModelEdge(curve, edge.start, edge.end, "exact", 0.0)
        space = self._space(function, 0)
        poles = space.fit(function(space.sites))
        poles[0], poles[-1] = ends
        deviation = curve_deviation(function(check_places(space)), space, poles)
        carrier = SplineCurve(space.degree, space.knots, poles)
        evidence = self._evidence(function)
        return ModelEdge(carrier, edge.start, edge.end, evidence, deviation.largest)

    def _evidence(self, function: CellFunction) -> Evidence:
        return "exact" if is_exact(function, self._classes) else "sampled"

    def _exact_curve(self, index: int, poles: Array) -> CurveCarrier:
        edge = self._boundary.edges[index]
        poles = poles.copy()
        poles[0], poles[-1] = self.vertices[edge.start], self.vertices[edge.end]
        flat = all(self._planes[face] for face, _ in self._boundary.edge_uses()[index])
        if len(poles) == 2 or (flat and _collinear(poles, self._rounding)):
            return Line(poles[0], poles[-1])
        return SplineCurve(len(poles) - 1, bezier_knots(len(poles) - 1), poles)

    def _face(self, group: tuple[int, ...], edges: list[ModelEdge]) -> ModelFace:
        index = group[0]
        function, cell = self._faces[index], self._boundary.faces[index]
        name = self._boundary.name(cell.patch)
        inward = self._sign(cell.patch) < 0
        plane = self._planes[index]
        if plane is not None:
            return plane_face(group, plane, self._boundary, inward, edges)
        exact = self._face_exact[index]
        if exact is not None:
            return ModelFace(name, (index,), exact, cell.uses, (), _whole(cell.uses), False, inward,
                             "exact", 0.0, 0)  # fmt: skip
        s, t = self._space(function, 0), self._space(function, 1)
        poles = fit_surface(function, s, t)
        self._take_edges(poles, cell.uses, edges)
        deviation = surface_deviation(function, s, t, poles)
        carrier = SplineSurface((s.degree, t.degree), (s.knots, t.knots), poles)
        return ModelFace(name, (index,), carrier, cell.uses, (), _whole(cell.uses), False, inward,
                         self._evidence(function), deviation.largest,
                         deviation.samples)  # fmt: skip

    def _take_edges(self, poles: Array, uses: tuple[EdgeUse, ...], edges: list[ModelEdge]) -> None:
        """Put the poles of the edges (and collapsed vertices) into the rows of a face."""
        rows = (poles[:, 0], poles[-1], poles[:, -1], poles[0])
        for row, use, anticlockwise in zip(rows, uses, (True, True, False, False), strict=True):
            if use.edge is None:
                row[...] = self.vertices[use.vertex]
                continue
            carrier = edges[use.edge].carrier
            if isinstance(carrier, SplineCurve) and len(carrier.poles) == len(row):
                row[...] = carrier.poles if use.forward == anticlockwise else carrier.poles[::-1]


def _whole(uses: tuple[EdgeUse, ...]) -> tuple[Segment, ...]:
    """Return the sides of the unit square, each along its edge's own direction."""
    square = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    sides = [Segment(square[i], square[(i + 1) % 4]) for i in range(4)]
    return tuple(
        side if use.forward or use.edge is None else side.reversed()
        for side, use in zip(sides, uses, strict=True)
    )


def _rank(vectors: Array) -> int:
    if len(vectors) == 0:
        return 0
    values = np.linalg.svd(vectors, compute_uv=False)
    return int((values > 1e-13 * values[0]).sum())


def _collinear(poles: Array, rounding: float) -> bool:
    along = poles[-1] - poles[0]
    across = np.cross(poles - poles[0], along)
    length = np.linalg.norm(along)
    return bool(np.sqrt((across * across).sum(axis=-1)).max() <= rounding * length)
