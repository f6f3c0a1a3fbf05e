"""What carries each face, and which parameter each edge has to keep: decided before any fit.

Each face may lie in a plane, on an analytic surface, or on a spline, which its neighbours have a
say in: it stays on an analytic surface only if no edge of it has to be approximated. A plan is what
all faces lie on; `settle` takes faces off their surfaces until that holds everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np

from pc2cad.checked import CheckedMap
from pc2cad.domain.direction_classes import DirectionClasses
from pc2cad.domain.looks import look_along, look_on_grids, tell_sides_points
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.geometry.carriers import AnalyticSurface, CurveCarrier, spline_traits
from pc2cad.geometry.recognition.from_points import Fitted
from pc2cad.geometry.recognition.placement import SurfacePlacement
from pc2cad.geometry.splines.rational import Parametrisation
from pc2cad.geometry.splines.spline_profile import SplineProfile
from pc2cad.representation.between_faces import between_others
from pc2cad.representation.face_carriers import (
    look_at,
    on_line,
    placements_of,
    planes_of,
    simple_curve,
)
from pc2cad.representation.parametrisation import (
    FaceDirection,
    Parametrisations,
    exact_course,
)
from pc2cad.representation.plane_sides import tell_sides
from pc2cad.representation.tips import places_near, rest_at
from pc2cad.representation.trimming import axis_of
from pc2cad.topology.cells import Cell, outward_sign
from pc2cad.topology.complex import BoundaryComplex


class Cells:
    """The faces and edges of a map, and what each of them is by itself."""

    def __init__(self, checked: CheckedMap, profile: SplineProfile) -> None:
        self.analysis = analysis = checked.analysis
        self.boundary: BoundaryComplex = analysis.complex
        self.profile = profile
        self.classes = DirectionClasses(analysis, profile.degrees)
        self.faces = [
            RestrictedMap(analysis, face.patch, profile.exact) for face in self.boundary.faces
        ]
        self.edges = [
            RestrictedMap(analysis, edge.cell, profile.exact) for edge in self.boundary.edges
        ]
        self._sign = checked.orientation.sign
        self._slack = analysis.scale.carrier_noise
        self._simple: dict[int, CurveCarrier | None] = {}
        corners = [RestrictedMap(analysis, vertex.corners[0]) for vertex in self.boundary.vertices]
        look_at(self.faces, self.edges, corners)
        #: points of the vertices (n, 3)
        self.vertices = np.array([corner() for corner in corners])
        signs = [self.sign(function.cell) for function in self.faces]
        self.planes = planes_of(self.faces, signs, self._slack)
        flat = [f for f, p in zip(self.faces, self.planes, strict=True) if p is not None]
        tell_sides([f for f in flat if f.polynomial is None], self.edges)

    @cached_property
    def between(self) -> dict[int, tuple[int, int]]:
        """The faces that are no further from their fits than two others are, and which two."""
        return between_others(self.faces)

    def sign(self, patch: Cell) -> int:
        """Return +1 where M_s × M_t points out of the solid on a side, -1 where it points in."""
        return outward_sign(patch) * self._sign

    def simple(self, edge: int) -> CurveCarrier | None:
        """Return the line or conic that an edge is, whatever its parameter, or None."""
        if edge not in self._simple:
            found = simple_curve(self.edges[edge], self._slack)
            self._simple[edge] = found if found is not None and self._allows(found) else None
        return self._simple[edge]

    def places(self) -> list[SurfacePlacement | Fitted | None]:
        """Return the surfaces that faces are on, where the receiver takes them; None for others."""
        curved = [i for i, plane in enumerate(self.planes) if plane is None]
        found = placements_of([self.faces[i] for i in curved], self._slack)
        placed = dict(zip(curved, found, strict=True))
        return [self._allowed(i, placed.get(i)) for i in range(len(self.faces))]

    def _allowed(
        self, face: int, placement: SurfacePlacement | Fitted | None
    ) -> SurfacePlacement | Fitted | None:
        """Return the placement of a face, None for one that the receiver does not take."""
        if placement is None:
            return None
        if isinstance(placement, Fitted):
            return placement if self._allows(placement.carrier) else None
        bases = [axis for axis in (0, 1) if placement.follows(axis)]
        allowed = all(self._takes(FaceDirection(self.faces[face], axis)) for axis in bases)
        return placement if allowed else None

    def _allows(self, carrier: CurveCarrier | AnalyticSurface) -> bool:
        degree, rational = spline_traits(carrier)
        return degree <= self.profile.exact and (self.profile.rational or not rational)

    def _takes(self, direction: FaceDirection) -> bool:
        """Say whether the profile allows the exact form of a direction."""
        if direction.wave is not None:
            return self.profile.allows(direction.wave)
        form = direction.function.form
        if form is not None and form.axes[direction.axis].kind == "other":
            # where it has no exact form a meridian is approximated, and the kernel turns none that
            # comes to rest at its tips
            return (
                self._is_exact(direction)
                or max(rest_at(direction.function, direction.axis, end) for end in (0, 1)) == 1
            )
        return form is not None and form.order(direction.axis) <= self.profile.exact

    def _is_exact(self, direction: FaceDirection) -> bool:
        breaks = self.classes.breaks(direction.piece)
        course = exact_course(direction.function, direction.axis, breaks, None, self.profile)
        return course is not None


@dataclass(frozen=True, eq=False)
class Plan:
    """Which faces lie on analytic surfaces, and what follows from that."""

    cells: Cells
    #: of each face: on what analytic surface it lies; None in a plane or on a spline
    placements: tuple[SurfacePlacement | Fitted | None, ...] = field(repr=False)

    def without(self, faces: frozenset[int]) -> Plan:
        """Return the plan with some faces on no analytic surface any more."""
        left = (None if i in faces else placement for i, placement in enumerate(self.placements))
        return Plan(self.cells, tuple(left))

    @cached_property
    def bound(self) -> tuple[bool, ...]:
        """Of each edge: whether a face at it asks for the equation's parameter along it."""
        boundary = self.cells.boundary
        uses = boundary.edge_uses()
        return tuple(
            any(
                self._is_parametric(face, axis_of(boundary.faces[face].uses.index(use)))
                for face, use in uses[edge]
            )
            for edge in range(len(self.cells.edges))
        )

    @cached_property
    def fitted_edges(self) -> tuple[int, ...]:
        """The edges that keep the equation's parameter, or are no simple curves."""
        edges = range(len(self.cells.edges))
        return tuple(i for i in edges if self.bound[i] or self.cells.simple(i) is None)

    def edge_direction(self, edge: int) -> FaceDirection:
        """Return an edge along its direction."""
        return FaceDirection(self.cells.edges[edge], 0, self.bound[edge])

    def look_at_edges(self, parametrisations: Parametrisations) -> None:
        """Evaluate those edges together that fits ask for, where no face has told their points."""
        asked = []
        for i in self.fitted_edges:
            edge, run = (
                self.cells.edges[i],
                parametrisations.parametrisation(self.edge_direction(i)),
            )
            arrays = (run.sites, run.checks, *(places_near(end) for end in (0, 1)))
            new = tuple([places for places in arrays if not edge.knows(places)])
            if new:
                asked.append((edge, new))
        look_along(asked)

    def look_at_faces(self, faces: Sequence[int], parametrisations: Parametrisations) -> None:
        """Evaluate those of some faces together that are fitted alike, and so their sides."""
        sides = {self.cells.edges[i].cell: self.cells.edges[i] for i in self.fitted_edges}
        alike: dict[tuple[Parametrisation, ...], list[RestrictedMap]] = {}
        for i in faces:
            if self.cells.planes[i] is None and self.placements[i] is None:
                function = self.cells.faces[i]
                runs = [
                    parametrisations.parametrisation(FaceDirection(function, a)) for a in (0, 1)
                ]
                if not all(run.exact for run in runs):
                    alike.setdefault(tuple(runs), []).append(function)
        for (s, t), functions in alike.items():
            grids = (s.sites, t.sites), (s.checks, t.checks)
            look_on_grids(functions, *grids)
            for function, local in product(functions, grids):
                tell_sides_points(function, local, sides)

    @cached_property
    def parametrisations(self) -> Parametrisations:
        """The parametrisations of all that runs along the directions, without spaces of fits."""
        return Parametrisations(self.cells.classes, self._face_directions(), self.cells.profile)

    @cached_property
    def rough(self) -> frozenset[int]:
        """The faces on analytic surfaces that have an edge which must be approximated."""
        found: set[int] = set()
        for edge, uses in self.cells.boundary.edge_uses().items():
            placed = {face for face, _ in uses if self.placements[face] is not None}
            if placed and not self._holds(edge):
                found |= placed
        return frozenset(found)

    def _is_parametric(self, face: int, axis: int) -> bool:
        """Say whether a face's own parameter along an axis is that of its carrier."""
        if self.cells.planes[face] is not None:
            return False
        placement = self.placements[face]
        return placement is None or placement.follows(axis)

    def _holds(self, edge: int) -> bool:
        """Say whether an edge is exact, or straight, or on a conic and free in its parameter."""
        function, bound = self.cells.edges[edge], self.bound[edge]
        return (
            on_line(function)
            or (not bound and self.cells.simple(edge) is not None)
            or self.parametrisations.exact(FaceDirection(function, 0, bound)) is not None
            or self._is_meridian(edge)
        )

    def _is_meridian(self, edge: int) -> bool:
        """Say whether an edge is approximated as the meridians of all revolutions at it are.

        Whatever else is there is a plane, or a spline in the same parameter.
        """
        boundary = self.cells.boundary
        for face, use in boundary.edge_uses()[edge]:
            placement = self.placements[face]
            axis = axis_of(boundary.faces[face].uses.index(use))
            if placement is not None and not placement.follows(axis):
                return False
        return self.bound[edge]

    def _face_directions(self) -> list[FaceDirection]:
        cells, uses = self.cells, self.cells.boundary.edge_uses()
        edges = [
            FaceDirection(
                function, 0, self.bound[i], any(self.placements[face] for face, _ in uses[i])
            )
            for i, function in enumerate(cells.edges)
            if self.bound[i] or cells.simple(i) is None
        ]
        return edges + [
            FaceDirection(
                function,
                axis,
                on_surface=self.placements[face] is not None,
                between=tuple(cells.faces[i] for i in cells.between.get(face, ())),
            )
            for face, function in enumerate(cells.faces)
            for axis in (0, 1)
            if self._is_parametric(face, axis)
        ]


def plan_of(cells: Cells) -> Plan:
    """Return the plan with as many faces as can be on analytic surfaces."""
    return settle(Plan(cells, tuple(cells.places())))


def settle(plan: Plan) -> Plan:
    """Return the plan with as few faces less on analytic surfaces as its edges ask for."""
    while plan.rough:
        plan = plan.without(plan.rough)
    return plan
