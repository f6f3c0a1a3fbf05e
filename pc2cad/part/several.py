"""What several bodies know of themselves as a whole, beside the solid that they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from pc2cad.integrals.inertia import Mass, Vector
    from pc2cad.mesh.tetrahedra import KernelSolid
    from pc2cad.sampling.formulas import FieldFormula
    from pc2cad.topology.cells import SideKey


@dataclass(frozen=True)
class BodiesSensitivity:
    """d/dp of the figures of a solid of several bodies, in their units per unit of the parameter.

    From the flux of ∂M/∂p of each body through what is left of its sides; that of the area from
    how these spread, and how the edges where bodies meet move.
    """

    parameter: str
    value: float
    volume: float
    #: None: bodies touch along an edge without an angle, and part there
    area: float | None
    centroid: Vector
    mass: float
    inertia: tuple[Vector, Vector, Vector]
    volume_by_flux: float
    #: estimate: what the solid's own volume may be off
    relative_error: float
    how: str
    #: why there is no derivative of the area, if there is none
    open: str = ""
    parting: tuple[str, ...] = ()


class Several(Protocol):
    """Several bodies joined to one solid."""

    def regions(self) -> KernelSolid:
        """Return the bodies cut along one another, for tetrahedra."""

    def face_sides(self) -> tuple[tuple[SideKey, ...], ...]:
        """Return for each face of the solid the bodies' sides that it is a part of."""

    def formulas(self, fields: Sequence[str]) -> dict[str, FieldFormula]:
        """Return scalar fields as formulas of the place: those of the body that it is in."""

    def mass(self, density: float | str | Mapping[str, float] | None) -> Mass:
        """Return mass, centre of mass and inertia for one density, or one for each body."""

    def sensitivity(
        self, name: str, density: float | str | Mapping[str, float] | None
    ) -> BodiesSensitivity:
        """Return how figures change with one parameter; raise NotDifferentiableError."""
