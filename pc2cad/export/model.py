"""What every writer takes: the solid with its names and figures, and the options of the export.

No kernel is imported here; kernel handles are typed `Any`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Literal

from pc2cad.errors import InputError
from pc2cad.export.epoch import stated_time

if TYPE_CHECKING:
    from pc2cad.sampling.formulas import FieldFormula
    from pc2cad.sampling.voxels import Voxels

#: Length units of a model, each with its length in millimetres.
UNITS_IN_MM: dict[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}

StepSchema = Literal["AP242", "AP214"]
STEP_SCHEMAS: tuple[StepSchema, ...] = ("AP242", "AP214")

#: Angular deflections that make sense: finer floods the memory, coarser is no surface any more.
ANGULAR_DEFLECTION_LIMITS = (0.01, 1.6)


@dataclass(frozen=True, eq=False)
class NamedFace:
    """One face of the solid with the name and colour it carries into the file."""

    #: name as the file shows it, for example ``u=0``
    name: str
    #: TopoDS_Face, a face of the solid
    face: Any
    #: red, green, blue in 0..1 (sRGB), or None for the reader's default
    colour: tuple[float, float, float] | None = None
    #: the whole side that it is a piece of, where it is one
    side: str = ""

    def __post_init__(self) -> None:
        if self.colour is not None and not all(0.0 <= part <= 1.0 for part in self.colour):
            raise InputError(
                f"the colour {self.colour} of face {self.name!r} has a part outside 0..1"
            )


@dataclass(frozen=True)
class GeometricProperties:
    """Volume, area and centroid of the solid, in the model's unit and its powers."""

    volume: float
    area: float
    centroid: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class NamedSolid:
    """One of several solids of a part, with the name it carries into the file."""

    name: str
    #: TopoDS_Solid
    solid: Any


@dataclass(frozen=True, eq=False)
class Exportable:
    """A solid ready to be written, in its own length unit."""

    #: TopoDS_Solid; its coordinates are in `units`
    solid: Any
    #: product name
    name: str
    #: free text, may have several lines
    description: str
    #: "mm", "cm", "m" or "in"
    units: str
    #: the named faces; faces that are not listed stay without a name
    faces: tuple[NamedFace, ...]
    #: figures from the equation (not from the kernel); they become validation properties
    properties: GeometricProperties
    #: distance within which the solid represents its equation, in `units`; 0 where it is exact
    tolerance: float
    #: what is known of faces and edges: exact, proved or sampled, in sentences
    evidence: tuple[str, ...] = ()
    #: the solids in the place of `solid` where the part comes in layers, for formats that hold
    #: several, and the faces between them
    layers: tuple[NamedSolid, ...] = ()
    interfaces: tuple[NamedFace, ...] = ()
    #: fields on voxels, and fields that are formulas of the place, for formats that hold them
    voxels: Voxels | None = None
    formulas: Mapping[str, FieldFormula] = field(default_factory=dict)
    #: why fields that could be formulas are on voxels
    pictured: Mapping[str, str] = field(default_factory=dict)

    @property
    def bodies(self) -> tuple[Any, ...]:
        """The solids to be written: the layers, or the one solid."""
        return tuple(layer.solid for layer in self.layers) or (self.solid,)

    @property
    def fields_said(self) -> tuple[str, ...]:
        """What is known of each field that is no plain formula of x, y and z, in words."""
        steps = (
            f"{name}: by Newton's steps, at most {known.deviation:.2g} off beyond rounding at "
            f"{known.places} places (sampled)"
            for name, known in self.formulas.items()
            if known.places
        )
        pictures = (
            f"{name}: as pictures, which lib3mf refuses in strict mode, since {why}"
            for name, why in self.pictured.items()
        )
        return (*steps, *pictures)

    def whole(self) -> Exportable:
        """Return the part as one solid, for formats that hold no more."""
        return replace(self, layers=(), interfaces=())

    def __post_init__(self) -> None:
        if self.units not in UNITS_IN_MM:
            raise InputError(
                f"unknown length unit {self.units!r}; choose one of {', '.join(UNITS_IN_MM)}"
            )
        figures = (self.properties.volume, self.properties.area, *self.properties.centroid)
        if not all(math.isfinite(figure) for figure in (*figures, self.tolerance)):
            raise InputError(f"the figures of {self.name!r} (volume, area, …) are not all finite")
        if self.properties.volume <= 0.0:
            raise InputError(
                f"the volume of {self.name!r} is {self.properties.volume:g}; it must be positive"
            )


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export; every format takes those that concern it."""

    #: application protocol of a STEP file
    step_schema: StepSchema = "AP242"
    #: triangles: largest distance of a chord from its surface, in model units; None chooses it
    deflection: float | None = None
    #: triangles: largest angle between neighbouring chords, in radians
    angular_deflection: float = 0.3
    #: ISO 8601 time for the file's header; None takes SOURCE_DATE_EPOCH, else the present time
    timestamp: str | None = None

    def __post_init__(self) -> None:
        if self.step_schema not in STEP_SCHEMAS:
            raise InputError(
                f"unknown STEP schema {self.step_schema!r}; choose one of {', '.join(STEP_SCHEMAS)}"
            )
        if self.deflection is not None and not 0.0 < self.deflection < math.inf:
            raise InputError(f"the deflection is {self.deflection}; it must be a positive length")
        low, high = ANGULAR_DEFLECTION_LIMITS
        if not low <= self.angular_deflection <= high:
            raise InputError(
                f"the angular deflection is {self.angular_deflection} rad; it must lie in "
                f"{low:g}..{high:g}"
            )

    def time_stamp(self) -> str:
        """Time for the file's header, ISO 8601 in whole seconds.

        Raises:
            InputError: the given time or SOURCE_DATE_EPOCH cannot be read.

        """
        if self.timestamp is not None:
            return _checked_time(self.timestamp)
        return _iso(stated_time() or datetime.now(UTC))


def _iso(moment: datetime) -> str:
    return moment.strftime("%Y-%m-%dT%H:%M:%S") + "Z"


def _checked_time(text: str) -> str:
    try:
        datetime.fromisoformat(text)
    except ValueError:
        raise InputError(
            f"the time stamp {text[:40]!r} is not an ISO 8601 time such as 2026-01-31T12:00:00Z"
        ) from None
    return text
