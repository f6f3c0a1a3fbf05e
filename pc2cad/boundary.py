"""The represent stage: every face and edge of the boundary complex gets one carrier.

Input: CheckedMap. Output: BoundaryModel. This is the
one place where topology meets geometry: an edge is carried once, and every face that uses it takes
its poles, so that there is nothing to sew.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pc2cad.checked import CheckedMap, resolve_tolerance
from pc2cad.courses import Courses, Strand
from pc2cad.directions import SAFE_DEGREE, CellFunction, DirectionClasses
from pc2cad.enclosure.evaluate import Known
from pc2cad.errors import ToleranceNotReachedError
from pc2cad.geometry.bernstein import bernstein, bezier_knots
from pc2cad.geometry.carriers import (
    AnalyticSurface,
    CurveCarrier,
    Evidence,
    Line,
    PCurve,
    SplineCurve,
    SplineSurface,
    spline_traits,
)
from pc2cad.geometry.fitting import Fitted, irrational
from pc2cad.geometry.profile import SplineProfile, spline_profile
from pc2cad.geometry.rational import Course, edge_deviation, face_deviation, fit_edge, fit_face
from pc2cad.geometry.recognition import Laid
from pc2cad.laying import axis_of, sides_of_fitted, sides_on, whole_square
from pc2cad.model import BoundaryModel, Layer, ModelEdge, ModelFace
from pc2cad.options import DEFAULTS, CompileOptions
from pc2cad.planar import coplanar_groups, join_straight_edges, plane_face
from pc2cad.point_sets import laid_of, on_line, plane_of, simple_curve
from pc2cad.proof import Side, prove_edge, prove_face
from pc2cad.topology.cells import outward_sign
from pc2cad.topology.complex import EdgeUse, Shell

Array = NDArray[np.float64]

#: share of the tolerance that one direction's fit aims at: half of what a face may deviate by
DIRECTION_SHARE = 0.24
#: what sampled deviations may use of the tolerance
SAMPLED_SHARE = 0.5
TRIES = 6


def represent(
    checked: CheckedMap, options: CompileOptions = DEFAULTS, *, prove: bool = True
) -> BoundaryModel:
    """Return the boundary model within the options' tolerance of the equation.

    Without `prove` deviations stay sampled, which shows what the proofs cost. Raises
    ToleranceNotReachedError.
    """
    analysis, tolerance = checked.analysis, resolve_tolerance(checked, options)
    work = _Representation(checked, tolerance, spline_profile(options))
    edges, faces = work.carriers(prove)
    boundary = analysis.complex
    shells = [_faces_of(shell, faces) for shell in boundary.shells]
    shells.insert(0, shells.pop(checked.solidity.outer_shell))
    layers = tuple(
        _layer(name, index, boundary.layers[index], work, faces)
        for index, name in enumerate(analysis.equation.layers)
    )
    return BoundaryModel(
        boundary, work.vertices, tuple(edges), tuple(faces), tuple(shells), tolerance,
        analysis.size, layers,
    )  # fmt: skip


def _faces_of(shell: Shell, faces: list[ModelFace]) -> tuple[int, ...]:
    return tuple(i for i, face in enumerate(faces) if face.cells[0] in shell.faces)


def _layer(
    name: str, index: int, shells: tuple[Shell, ...], work: _Representation, faces: list[ModelFace]
) -> Layer:
    """Return a layer: the widest of its shells is the outer one."""
    ordered = sorted(shells, key=lambda shell: -max(work.extent(f) for f in shell.faces))
    cells = work.boundary.faces
    enclosed = work.boundary.enclosed
    # a face between two layers is made as the upper side of the lower one
    upside_down = [
        face.cells[0] in enclosed and cells[face.cells[0]].patch[2] == 2 * index for face in faces
    ]
    members = tuple(
        tuple((i, upside_down[i]) for i in _faces_of(shell, faces)) for shell in ordered
    )
    return Layer(name, members, sum(shell.euler for shell in shells))


class _NotLaidError(Exception):
    """A side of a face is no smooth curve on the surface that the face was laid on."""

    def __init__(self, face: int) -> None:
        super().__init__(face)
        self.face = face


class _Representation:
    """Works out one model; lives for one call of `represent`."""

    def __init__(self, checked: CheckedMap, tolerance: float, profile: SplineProfile) -> None:
        analysis = checked.analysis
        self._orientation = checked.orientation.sign
        self._tolerance = tolerance
        self._rounding = analysis.scale.evaluation_noise
        self._slack = analysis.scale.carrier_noise
        self.boundary = analysis.complex
        self._profile = profile
        self._faces = [
            CellFunction(analysis, face.patch, profile.exact) for face in self.boundary.faces
        ]
        self._edges = [
            CellFunction(analysis, edge.cell, profile.exact) for edge in self.boundary.edges
        ]
        self._simple: dict[int, CurveCarrier | None] = {}
        self._planes = [
            plane_of(function, self._sign(function.cell), self._slack) for function in self._faces
        ]
        self._laid = [
            None if flat else self._lay(function)
            for function, flat in zip(self._faces, self._planes, strict=True)
        ]
        self._known = Known()
        self._classes = DirectionClasses(analysis, profile.degrees)
        self._bound, self._courses = self._settle()
        self.vertices = np.array([
            CellFunction(analysis, vertex.corners[0])() for vertex in self.boundary.vertices
        ])  # fmt: skip

    def carriers(self, prove: bool) -> tuple[list[ModelEdge], list[ModelFace]]:
        """Return all edges and faces; raise ToleranceNotReachedError."""
        while True:
            try:
                return self._carriers(prove)
            except _NotLaidError as error:
                self._laid[error.face] = None
                self._bound, self._courses = self._settle()

    def _carriers(self, prove: bool) -> tuple[list[ModelEdge], list[ModelFace]]:
        target = DIRECTION_SHARE * self._tolerance
        for _ in range(TRIES):
            self._courses.resolve(target, self._rounding)
            edges = [self._edge(i) for i in range(len(self._edges))]
            groups = coplanar_groups(self.boundary, [p and p[0] for p in self._planes])
            faces = [self._face(group, edges) for group in groups]
            worst = max([e.deviation for e in edges] + [f.deviation for f in faces])
            if worst <= SAMPLED_SHARE * self._tolerance:
                if prove:
                    edges, faces = self._proved(edges, faces)
                    worst = max([e.deviation for e in edges] + [f.deviation for f in faces])
                if worst <= self._tolerance:
                    return join_straight_edges(self.boundary, edges, faces)
            target *= 0.8 * min(1.0, SAMPLED_SHARE * self._tolerance / worst)
        raise ToleranceNotReachedError(
            f"the faces deviate by {worst:.3g} from the equation where {self._tolerance:.3g} was "
            "asked; allow a larger --tolerance"
        )

    def _proved(
        self, edges: list[ModelEdge], faces: list[ModelFace]
    ) -> tuple[list[ModelEdge], list[ModelFace]]:
        """Return edges and faces with proved deviations where those can be had."""
        proved_faces, sides = [], []
        for face in faces:
            proved, own = self._proved_face(face) if face.evidence == "sampled" else (face, [])
            proved_faces.append(proved)
            sides += own
        return [
            prove_edge(edge, f, self._courses.course(Strand(f, 0, bound)), sides, self._known)
            if edge.evidence == "sampled"
            else edge
            for edge, f, bound in zip(edges, self._edges, self._bound, strict=True)
        ], proved_faces

    def _proved_face(self, face: ModelFace) -> tuple[ModelFace, list[Side]]:
        functions = [self._faces[i] for i in face.cells]
        courses = []
        if isinstance(face.carrier, SplineSurface):
            courses = [self._courses.course(Strand(functions[0], axis)) for axis in (0, 1)]
        return prove_face(face, functions, courses, self._rounding, self._known)

    def extent(self, face: int) -> float:
        """Return the diagonal of the box round samples of a face."""
        nodes = irrational(9)
        return float(np.linalg.norm(np.ptp(self._faces[face](nodes, nodes), axis=(0, 1))))

    # -- what a face lies on -------------------------------------------------------------------

    def _sign(self, patch: tuple[int, int, int]) -> int:
        return outward_sign(patch) * self._orientation

    def _lay(self, function: CellFunction) -> Laid | Fitted | None:
        """Return a face laid on a surface that the receiver takes, or None."""
        laid = laid_of(function, self._slack)
        if laid is None:
            return None
        if isinstance(laid, Fitted):
            return laid if self._allows(laid.carrier) else None
        bases = [axis for axis in (0, 1) if laid.follows(axis)]
        allowed = all(self._takes(Strand(function, axis)) for axis in bases)
        return laid if allowed else None

    def _allows(self, carrier: CurveCarrier | AnalyticSurface) -> bool:
        degree, rational = spline_traits(carrier)
        return degree <= self._profile.exact and (self._profile.rational or not rational)

    def _takes(self, strand: Strand) -> bool:
        """Say whether the profile allows the exact form of a strand."""
        if strand.wave is not None:
            return self._profile.rational and 2 * strand.wave[1] <= self._profile.exact
        form = strand.function.form
        return form is not None and form.order(strand.axis) <= self._profile.exact

    # -- which parameters matter ---------------------------------------------------------------

    def _is_parametric(self, face: int, axis: int) -> bool:
        """Say whether a face's own parameter along an axis is that of its carrier."""
        if self._planes[face] is not None:
            return False
        laid = self._laid[face]
        return laid is None or laid.follows(axis)

    def _is_bound(self, edge: int) -> bool:
        """Say whether a face at the edge asks for the equation's parameter along it."""
        return any(
            self._is_parametric(face, axis_of(self.boundary.faces[face].uses.index(use)))
            for face, use in self.boundary.edge_uses()[edge]
        )

    def _settle(self) -> tuple[list[bool], Courses]:
        """Return which edges are bound to a parameter, and the courses.

        A face stays on its analytic surface only if no edge of it has to be approximated.
        """
        while True:
            bound = [self._is_bound(edge) for edge in range(len(self._edges))]
            courses = Courses(self._classes, self._strands(bound), self._profile)
            rough: set[int] = set()
            for edge, uses in self.boundary.edge_uses().items():
                laid = {face for face, _ in uses if self._laid[face] is not None}
                if laid and not self._holds(edge, courses, bound[edge]):
                    rough |= laid
            if not rough:
                return bound, courses
            self._laid = [None if i in rough else laid for i, laid in enumerate(self._laid)]

    def _holds(self, edge: int, courses: Courses, bound: bool) -> bool:
        """Say whether an edge is exact, or straight, or on a conic and free in its parameter."""
        function = self._edges[edge]
        return (
            on_line(function)
            or (not bound and self._simple_edge(edge) is not None)
            or courses.exact(Strand(function, 0, bound)) is not None
        )

    def _strands(self, bound: list[bool]) -> list[Strand]:
        uses = self.boundary.edge_uses()
        edges = [
            Strand(function, 0, bound[i], any(self._laid[face] for face, _ in uses[i]))
            for i, function in enumerate(self._edges)
            if bound[i] or self._simple_edge(i) is None
        ]
        return edges + [
            Strand(function, axis, laid=self._laid[face] is not None)
            for face, function in enumerate(self._faces)
            for axis in (0, 1)
            if self._is_parametric(face, axis)
        ]

    # -- edges ---------------------------------------------------------------------------------

    def _edge(self, index: int) -> ModelEdge:
        function, edge = self._edges[index], self.boundary.edges[index]
        ends = self.vertices[edge.start], self.vertices[edge.end]
        if not self._bound[index]:
            simple = self._simple_edge(index)
            if simple is not None:
                carrier = Line(*ends) if isinstance(simple, Line) else simple
                return ModelEdge(carrier, edge.start, edge.end, "exact", 0.0)
        course = self._courses.course(Strand(function, 0, self._bound[index]))
        exact = None if course.arcs else bernstein(*function.trees)
        if exact is not None and len(exact) <= 1 + self._highest(course):
            exact[0], exact[-1] = ends
            bezier = Line(*ends) if len(exact) == 2 else _bezier(exact)
            return ModelEdge(bezier, edge.start, edge.end, "exact", 0.0)
        poles, weights = fit_edge(function(course.places(course.space.sites)), course)
        poles[0], poles[-1] = ends
        seen = edge_deviation(function, course, poles, weights).largest
        curve = SplineCurve(course.space.degree, course.space.knots, poles, weights)
        evidence: Evidence = "exact" if course.exact else "sampled"
        return ModelEdge(curve, edge.start, edge.end, evidence, seen)

    def _simple_edge(self, index: int) -> CurveCarrier | None:
        """Return the line or conic that an edge is, whatever its parameter, or None."""
        if index not in self._simple:
            found = simple_curve(self._edges[index], self._slack)
            self._simple[index] = found if found is not None and self._allows(found) else None
        return self._simple[index]

    # -- faces ---------------------------------------------------------------------------------

    def _face(self, group: tuple[int, ...], edges: list[ModelEdge]) -> ModelFace:
        index = group[0]
        function, cell = self._faces[index], self.boundary.faces[index]
        name = self.boundary.name(cell.patch)
        inward = self._sign(cell.patch) < 0
        flat, laid = self._planes[index], self._laid[index]
        if flat is not None:
            return plane_face(group, flat, self.boundary, inward, edges)
        if laid is not None:
            surface, sides = self._on_surface(laid, index, edges)
            return ModelFace(name, (index,), surface, cell.uses, (), sides, laid.turned,
                             inward != laid.turned, "exact", 0.0, 0)  # fmt: skip
        square = whole_square(cell.uses)
        s, t = (self._courses.course(Strand(function, axis)) for axis in (0, 1))
        exact = None if s.arcs or t.arcs else bernstein(*function.trees)
        if exact is not None and all(
            n <= 1 + self._highest(course) for n, course in zip(exact.shape, (s, t), strict=False)
        ):
            degrees = (exact.shape[0] - 1, exact.shape[1] - 1)
            knots = (bezier_knots(degrees[0]), bezier_knots(degrees[1]))
            return ModelFace(name, (index,), SplineSurface(degrees, knots, exact), cell.uses, (),
                             square, False, inward, "exact", 0.0, 0)  # fmt: skip
        poles, weights = fit_face(function, s, t)
        self._take_edges(poles, cell.uses, edges)
        seen = face_deviation(function, s, t, poles, weights)
        carrier = SplineSurface(
            (s.space.degree, t.space.degree), (s.space.knots, t.space.knots), poles, weights
        )
        evidence: Evidence = "exact" if s.exact and t.exact else "sampled"
        return ModelFace(name, (index,), carrier, cell.uses, (), square, False, inward, evidence,
                         seen.largest, seen.samples)  # fmt: skip

    def _on_surface(
        self, laid: Laid | Fitted, index: int, edges: list[ModelEdge]
    ) -> tuple[AnalyticSurface, tuple[PCurve | None, ...]]:
        """Return the surface of a laid face, and the face's four sides there."""
        function, uses = self._faces[index], self.boundary.faces[index].uses
        if isinstance(laid, Fitted):
            try:
                return laid.carrier, sides_of_fitted(laid, uses, edges, self.vertices)
            except ToleranceNotReachedError:
                raise _NotLaidError(index) from None
        arcs = [self._courses.arcs(piece) for piece in function.pieces]
        surface = laid.carrier(lambda axis, level: self._iso_curve(function, axis, level))
        return surface, sides_on(laid, uses, edges, arcs)

    def _highest(self, course: Course) -> int:
        """Return the highest degree of an exact form that runs as a course does."""
        return self._profile.exact if course.exact else min(self._profile.exact, SAFE_DEGREE)

    def _iso_curve(self, function: CellFunction, axis: int, level: float) -> SplineCurve:
        """Return the curve along one axis of a face, the other parameter fixed."""
        course = self._courses.course(Strand(function, axis))
        along, across = course.places(course.space.sites), np.array([level])
        values = function(along, across)[:, 0] if axis == 0 else function(across, along)[0]
        poles, weights = fit_edge(values, course)
        return SplineCurve(course.space.degree, course.space.knots, poles, weights)

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


def _bezier(poles: Array) -> SplineCurve:
    return SplineCurve(len(poles) - 1, bezier_knots(len(poles) - 1), poles)
