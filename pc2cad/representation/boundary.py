"""The represent stage: every face and edge of the boundary complex gets one carrier.

Input: CheckedMap. Output: BoundaryModel. This is the
one place where topology meets geometry: an edge is carried once, and every face that uses it takes
its poles, so that there is nothing to sew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from pc2cad.arrays import Array
from pc2cad.bounds.known import Known
from pc2cad.bounds.rational_deviation import expect_spline
from pc2cad.checked import CheckedMap, resolve_tolerance
from pc2cad.domain.restrictions import SAFE_DEGREE, RestrictedMap
from pc2cad.errors import ToleranceNotReachedError
from pc2cad.geometry.carriers import (
    AnalyticSurface,
    Arc,
    CurveCarrier,
    Evidence,
    Line,
    PCurve,
    SplineCurve,
    SplineSurface,
)
from pc2cad.geometry.recognition.from_points import Fitted
from pc2cad.geometry.recognition.meridians import along_meridian
from pc2cad.geometry.recognition.placement import SurfacePlacement
from pc2cad.geometry.splines.bernstein import bernstein, bezier_knots
from pc2cad.geometry.splines.rational import (
    Parametrisation,
    face_deviation,
    fit_edges,
    fit_face,
)
from pc2cad.geometry.splines.spline_profile import spline_profile
from pc2cad.geometry.splines.tensor import Deviation
from pc2cad.options import DEFAULTS, CompileOptions
from pc2cad.representation.between_faces import Carried, extremes_first, lies_between
from pc2cad.representation.boundary_model import BoundaryModel, ModelEdge, ModelFace
from pc2cad.representation.deviation_proof import (
    Side,
    prove_edge,
    prove_face,
    prove_meridian,
)
from pc2cad.representation.fitted_edges import Wanted, fitted
from pc2cad.representation.meridian_faces import approximated_meridian
from pc2cad.representation.model_layers import faces_of, layer
from pc2cad.representation.parametrisation import FaceDirection, Parametrisations
from pc2cad.representation.plan import Cells, Plan, plan_of, settle
from pc2cad.representation.plane_faces import coplanar_groups, join_straight_edges, plane_face
from pc2cad.representation.tightening import Aim, Attempt, tighten
from pc2cad.representation.tips import hold, rest_at, rest_at_ends
from pc2cad.representation.trimming import sides_of_fitted, sides_on, whole_square
from pc2cad.topology.complex import EdgeUse

#: share of the tolerance that one direction's fit aims at: half of what a face may deviate by
DIRECTION_SHARE = 0.24
#: what sampled deviations may use of the tolerance
SAMPLED_SHARE = 0.5


def represent(
    checked: CheckedMap, options: CompileOptions = DEFAULTS, *, prove: bool = True
) -> BoundaryModel:
    """Return the boundary model within the options' tolerance of the equation.

    Without `prove` deviations stay sampled, which shows what the proofs cost. Raises
    ToleranceNotReachedError.
    """
    analysis, tolerance = checked.analysis, resolve_tolerance(checked, options)
    cells = Cells(checked, spline_profile(options))
    edges, faces = _carriers(
        _Work(cells, tolerance, analysis.scale.evaluation_noise, Known(), prove)
    )
    shells = [faces_of(shell, faces) for shell in cells.boundary.shells]
    shells.insert(0, shells.pop(checked.question.outer_shell))
    layers = tuple(
        layer(name, index, cells, faces) for index, name in enumerate(analysis.equation.layers)
    )
    return BoundaryModel(
        cells.boundary, cells.vertices, tuple(edges), tuple(faces), tuple(shells), tolerance,
        analysis.size, layers,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Work:
    """What one call of `represent` is given."""

    cells: Cells
    #: lengths (model units): the tolerance, and what rounding leaves open of a value of M
    tolerance: float
    rounding: float
    known: Known
    prove: bool


_Carriers = tuple[list[ModelEdge], list[ModelFace]]


def _carriers(work: _Work) -> _Carriers:
    """Return all edges and faces; raise ToleranceNotReachedError."""
    plan = plan_of(work.cells)
    while True:
        found = tighten(
            partial(_attempt, work, plan), DIRECTION_SHARE * work.tolerance,
            "the faces deviate", work.tolerance,
        )  # fmt: skip
        if not isinstance(found, int):
            return join_straight_edges(work.cells.boundary, *found)
        plan = settle(plan.without(frozenset([found])))


def _attempt(work: _Work, plan: Plan, aim: Aim) -> Attempt[_Carriers | int]:
    """Return edges and faces from fits with an aim, or a face that has to be a spline.

    Deviations are proved only where the seen ones leave room for that.
    """
    fits = _Fits(work, plan, plan.parametrisations.resolved(aim, work.rounding))
    planes = work.cells.planes
    groups = coplanar_groups(work.cells.analysis, [p and p[0] for p in planes])
    rows = [[g for g in groups if (g[0] in work.cells.between) is late] for late in (False, True)]
    plan.look_at_faces([group[0] for group in rows[0]], fits.parametrisations)
    plan.look_at_edges(fits.parametrisations)
    edges = fits.edges()
    made: dict[tuple[int, ...], ModelFace] = {}
    share = SAMPLED_SHARE * work.tolerance
    for row in rows:
        for group in row:
            face = fits.face(group, edges)
            if face is None:
                return Attempt(group[0], 0.0, 0.0)
            made[group] = face
        seen = _judged(work, edges, list(made.values()), share)
        if seen.deviation > share:
            return seen
    faces = [made[group] for group in groups]
    if not work.prove:
        return replace(seen, result=(edges, faces))
    edges, faces = fits.proved(edges, faces)
    proved = _judged(work, edges, faces, share)
    return replace(proved, allowed=work.tolerance) if proved.deviation <= work.tolerance else proved


def _judged(
    work: _Work, edges: list[ModelEdge], faces: list[ModelFace], allowed: float
) -> Attempt[_Carriers | int]:
    """Return edges and faces with the largest deviation of them, and where it was seen."""
    cells, worst = work.cells, {}
    rows: list[tuple[ModelEdge | ModelFace, RestrictedMap]] = [
        *((face, cells.faces[face.cells[0]]) for face in faces),
        *zip(edges, cells.edges, strict=True),
    ]
    off, function = max(rows, key=lambda row: row[0].deviation)
    if off.place:
        worst = {
            cells.classes.owner(piece): place
            for piece, place in zip(function.pieces, off.place, strict=True)
        }

    def where() -> str:
        name = cells.boundary.name(function.cell)
        return f"on {name} near {function.shown(*off.place)}" if off.place else ""

    return Attempt((edges, faces), off.deviation, allowed, worst, where)


@dataclass(frozen=True, eq=False)
class _Fits:
    """Makes the edges and faces of one attempt."""

    work: _Work
    plan: Plan
    parametrisations: Parametrisations

    def proved(self, edges: list[ModelEdge], faces: list[ModelFace]) -> _Carriers:
        """Return edges and faces with proved deviations where those can be had."""
        proved_faces, sides = list(faces), []
        carried = [(face, self.work.cells.faces[face.cells[0]]) for face in faces]
        for row in extremes_first(carried):
            self._expect([carried[place] for place in row[1:2]])
            for place in row:
                face, function = carried[place]
                if face.evidence != "sampled":
                    continue
                ends = [(proved_faces[i], carried[i][1]) for i in row[:2]]
                found = lies_between((face, function), *ends) if place not in row[:2] else None
                if found is None:
                    found, own = self._proved_face(face)
                    sides += own
                proved_faces[place] = found
        return [
            prove_edge(edge, f, self._run(i), sides, self.work.known)
            if edge.evidence == "sampled"
            else edge
            for i, (edge, f) in enumerate(zip(edges, self.work.cells.edges, strict=True))
        ], proved_faces

    def _expect(self, faces: Sequence[Carried]) -> None:
        """Let what is asked for of faces be worked out with what those before them ask for."""
        self.work.known.expected.clear()
        for face, function in faces:
            if face.evidence == "sampled" and isinstance(face.carrier, SplineSurface):
                expect_spline(*function.trees, self._runs(function), self.work.known)

    def _runs(self, function: RestrictedMap) -> list[Parametrisation]:
        """Return how a face runs along both its directions."""
        return [
            self.parametrisations.parametrisation(FaceDirection(function, axis)) for axis in (0, 1)
        ]

    def _proved_face(self, face: ModelFace) -> tuple[ModelFace, list[Side]]:
        functions = [self.work.cells.faces[i] for i in face.cells]
        placement = self.plan.placements[face.cells[0]]
        meridian = approximated_meridian(functions[0], placement, self.parametrisations)
        if meridian is not None:
            return prove_meridian(face, meridian, self.work.known), []
        runs = self._runs(functions[0]) if isinstance(face.carrier, SplineSurface) else []
        return prove_face(face, functions, runs, self.work.rounding, self.work.known)

    # -- edges ---------------------------------------------------------------------------------

    def edges(self) -> list[ModelEdge]:
        """Return the carriers of all edges."""
        count = range(len(self.work.cells.edges))
        exact = [self._exact(i) for i in count]
        wanted = {
            i: Wanted(self.work.cells.edges[i], self._run(i), self._ends(i), self._rests[i])
            for i in count
            if exact[i] is None
        }
        curves = dict(zip(wanted, fitted(list(wanted.values())), strict=True))
        made = []
        for i, carrier in enumerate(exact):
            edge = self.work.cells.boundary.edges[i]
            key, seen = self.work.cells.boundary.key(edge.cell), Deviation(0.0, 0)
            evidence: Evidence = "exact"
            if carrier is None:
                carrier, seen = curves[i]
                evidence = "exact" if wanted[i].parametrisation.exact else "sampled"
            ends = edge.start, edge.end
            made.append(ModelEdge(key, carrier, *ends, evidence, seen.largest, place=seen.place))
        return made

    def _ends(self, index: int) -> tuple[Array, Array]:
        edge = self.work.cells.boundary.edges[index]
        return self.work.cells.vertices[edge.start], self.work.cells.vertices[edge.end]

    def _run(self, index: int) -> Parametrisation:
        """Return how an edge runs along its direction."""
        return self.parametrisations.parametrisation(self.plan.edge_direction(index))

    def _exact(self, index: int) -> CurveCarrier | None:
        """Return the line, conic or polynomial that an edge is, None for one to be fitted."""
        ends = self._ends(index)
        simple = None if self.plan.bound[index] else self.work.cells.simple(index)
        if isinstance(simple, Arc):
            return self._meridian(index, simple) or simple
        if simple is not None:
            return Line(*ends) if isinstance(simple, Line) else simple
        run = self._run(index)
        function = self.work.cells.edges[index]
        is_curved = run.arcs or function.degrees.get(0, 0) is None
        exact = None if is_curved else bernstein(*function.trees)
        if exact is None or len(exact) > 1 + self._highest(run):
            return None
        exact[0], exact[-1] = ends
        return Line(*ends) if len(exact) == 2 else _bezier(exact)

    @cached_property
    def _rests(self) -> dict[int, tuple[int, int]]:
        """The powers with which M leaves both ends of the edges that may be fitted."""
        fitted = self.plan.fitted_edges
        return dict(
            zip(fitted, rest_at_ends([self.work.cells.edges[i] for i in fitted]), strict=True)
        )

    def _meridian(self, index: int, arc: Arc) -> SplineCurve | None:
        """Return an arc in the parameter of a surface whose meridian it is, if that is a spline."""
        for face, _ in self.work.cells.boundary.edge_uses()[index]:
            placement = self.plan.placements[face]
            if isinstance(placement, Fitted):
                found = along_meridian(placement.carrier, arc)
                if found is not None:
                    return found
        return None

    # -- faces ---------------------------------------------------------------------------------

    def face(self, group: tuple[int, ...], edges: list[ModelEdge]) -> ModelFace | None:
        """Return the carrier of faces in one plane, or of a single one.

        None for a face with a side that is no smooth curve on the surface that it is planned on.
        """
        index, cells = group[0], self.work.cells
        function, cell = cells.faces[index], cells.boundary.faces[index]
        key = cells.boundary.key(cell.patch)
        inward = cells.sign(cell.patch) < 0
        flat, placement = cells.planes[index], self.plan.placements[index]
        if flat is not None:
            return plane_face(group, flat, cells.boundary, inward, edges)
        if placement is not None:
            on_surface = self._on_surface(placement, index, edges)
            if on_surface is None:
                return None
            surface, sides = on_surface
            meridian = approximated_meridian(function, placement, self.parametrisations)
            seen = meridian.seen(surface) if meridian else Deviation(0.0, 0)
            return ModelFace(key, (index,), surface, cell.uses, (), sides, placement.turned,
                             inward != placement.turned, "sampled" if meridian else "exact",
                             seen.largest, seen.samples, place=seen.place)  # fmt: skip
        square = whole_square(cell.uses)
        s, t = self._runs(function)
        exact = None if s.arcs or t.arcs else bernstein(*function.trees)
        if exact is not None and all(
            n <= 1 + self._highest(parametrisation)
            for n, parametrisation in zip(exact.shape, (s, t), strict=False)
        ):
            degrees = (exact.shape[0] - 1, exact.shape[1] - 1)
            knots = (bezier_knots(degrees[0]), bezier_knots(degrees[1]))
            return ModelFace(key, (index,), SplineSurface(degrees, knots, exact), cell.uses, (),
                             square, False, inward, "exact", 0.0, 0)  # fmt: skip
        poles, weights = fit_face(function, s, t)
        self._take_edges(poles, cell.uses, edges)
        self._hold_tips(function, poles, cell.uses)
        seen = face_deviation(function, s, t, poles, weights)
        carrier = SplineSurface(
            (s.space.degree, t.space.degree), (s.space.knots, t.space.knots), poles, weights
        )
        evidence: Evidence = "exact" if s.exact and t.exact else "sampled"
        return ModelFace(key, (index,), carrier, cell.uses, (), square, False, inward, evidence,
                         seen.largest, seen.samples, place=seen.place)  # fmt: skip

    def _on_surface(
        self, placement: SurfacePlacement | Fitted, index: int, edges: list[ModelEdge]
    ) -> tuple[AnalyticSurface, tuple[PCurve | None, ...]] | None:
        """Return the surface of a face that lies on one, and its four sides there, or None."""
        cells = self.work.cells
        function, uses = cells.faces[index], cells.boundary.faces[index].uses
        if isinstance(placement, Fitted):
            try:
                return placement.carrier, sides_of_fitted(
                    placement, uses, edges, self.work.cells.vertices
                )
            except ToleranceNotReachedError:
                return None
        arcs = [self.parametrisations.arcs(piece) for piece in function.pieces]
        surface = placement.carrier(lambda axis, level: self._iso_curve(function, axis, level))
        return surface, sides_on(placement, uses, edges, arcs)

    def _highest(self, parametrisation: Parametrisation) -> int:
        """Return the highest degree of an exact form that runs as a parametrisation does."""
        exact = self.work.cells.profile.exact
        return exact if parametrisation.exact else min(exact, SAFE_DEGREE)

    def _iso_curve(self, function: RestrictedMap, axis: int, level: float) -> SplineCurve:
        """Return the curve along one axis of a face, the other parameter fixed."""
        parametrisation = self.parametrisations.parametrisation(FaceDirection(function, axis))
        along, across = parametrisation.sites, np.array([level])
        values = function(along, across)[:, 0] if axis == 0 else function(across, along)[0]
        (poles,), weights = fit_edges(values[None], parametrisation)
        return SplineCurve(
            parametrisation.space.degree, parametrisation.space.knots, poles, weights
        )

    def _take_edges(self, poles: Array, uses: tuple[EdgeUse, ...], edges: list[ModelEdge]) -> None:
        """Put the poles of the edges (and collapsed vertices) into the rows of a face."""
        rows = (poles[:, 0], poles[-1], poles[:, -1], poles[0])
        for row, use, anticlockwise in zip(rows, uses, (True, True, False, False), strict=True):
            if use.edge is None:
                row[...] = self.work.cells.vertices[use.vertex]
                continue
            carrier = edges[use.edge].carrier
            if isinstance(carrier, SplineCurve) and len(carrier.poles) == len(row):
                row[...] = carrier.poles if use.forward == anticlockwise else carrier.poles[::-1]

    def _hold_tips(self, function: RestrictedMap, poles: Array, uses: tuple[EdgeUse, ...]) -> None:
        """Let a face come to sides that are points as the equation does."""
        across = poles.transpose(1, 0, 2)
        nets = (across, poles[::-1], across[::-1], poles)
        for net, use, axis, end in zip(nets, uses, (1, 0, 1, 0), (0, 1, 1, 0), strict=True):
            if use.edge is None:
                hold(net, rest_at(function, axis, end))


def _bezier(poles: Array) -> SplineCurve:
    return SplineCurve(len(poles) - 1, bezier_knots(len(poles) - 1), poles)
