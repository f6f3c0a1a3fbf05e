"""The report: what was derived, what is exact, how far the rest deviates, what was checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class SideReport:
    """The fate of one side of the parameter box."""

    name: str
    #: face, curve, point or interface
    fate: str
    #: proved or sampled
    verdict: str
    #: for a curve the parameter along it; for an interface the partner and how it is turned
    detail: str = ""


@dataclass(frozen=True)
class FaceReport:
    """One face: its carrier and how it compares with the equation (lengths in model units)."""

    name: str
    carrier: str
    #: exact, bounded or sampled
    evidence: str
    #: largest distance to the equation at equal parameters: a proved bound where the evidence says
    #: so, else the largest seen
    deviation: float
    #: the largest distance seen, over `samples` places
    sampled: float
    samples: int
    #: where no bound could be had, in the patch's own parameters; empty for the other evidence
    open: str
    degrees: tuple[int, ...]
    poles: tuple[int, ...]
    area: float
    #: what a drawing would show of the carrier: radii in model units, angles in degrees
    figures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class LimitReport:
    """One limit of a channel: what was found and what would break it (lengths in model units)."""

    name: str
    value: float
    breaks_at: float
    #: what it means, with the place
    sentence: str


@dataclass(frozen=True)
class LayerReport:
    """One layer: a solid of its own within the part (model units)."""

    name: str
    #: of the equation, and of the kernel's solid
    volume: float
    solid_volume: float
    centroid: tuple[float, float, float]
    #: the area of its whole boundary, that which it shares with other layers included
    area: float


@dataclass(frozen=True)
class EdgeReport:
    """One edge between different faces: as `FaceReport`."""

    name: str
    carrier: str
    evidence: str
    deviation: float
    sampled: float
    open: str
    degree: int
    poles: int
    #: where bodies meet: a bound of its distance from the surfaces of its two faces at equal
    #: parameters (the largest seen, where the edge is sampled)
    surface_distance: float = 0.0


_WORDS = {
    "exact": "exact",
    "bounded": "proved to deviate from the equation by at most {length}",
    "sampled": "sampled to deviate from the equation by at most {length}",
}


@dataclass(frozen=True)
class Integrals:
    """Volume, area and centroid in model units, and where they come from."""

    source: str
    volume: float
    area: float
    centroid: tuple[float, float, float]
    #: estimate of the relative error; None where the source gives none
    relative_error: float | None = None


class Evidence:
    """What a report says of how its faces and edges are known."""

    faces: tuple[FaceReport, ...]
    curves: tuple[EdgeReport, ...]
    units: str

    @property
    def parts(self) -> tuple[FaceReport | EdgeReport, ...]:
        """The faces and the edges."""
        return (*self.faces, *self.curves)

    @property
    def deviation(self) -> float:
        """Largest deviation of any face or edge from the equation: bounds and samples alike."""
        return max(part.deviation for part in self.parts)

    @property
    def evidence(self) -> str:
        """The weakest evidence of any face or edge: ``exact``, ``bounded`` or ``sampled``."""
        found = {part.evidence for part in self.parts}
        return next(e for e in ("sampled", "bounded", "exact") if e in found)

    def statements(self) -> tuple[str, ...]:
        """Return in sentences which faces and edges are exact, and what is known of the others."""
        sentences = []
        for evidence, words in _WORDS.items():
            found = [part for part in self.parts if part.evidence == evidence]
            if found:
                names = [
                    f"({part.name})" if isinstance(part, EdgeReport) else part.name
                    for part in found
                ]
                largest = max(part.deviation for part in found)
                what = words.format(length=f"{largest:.3g} {self.units}")
                sentences.append(f"{what}: {', '.join(names)}")
        return tuple(sentences)


@dataclass(frozen=True)
class Report(Evidence):
    """Everything that is known of a compiled part; lengths are in `units`."""

    name: str
    title: str
    units: str
    parameters: Mapping[str, float]
    size: float
    tolerance: float
    sides: tuple[SideReport, ...]
    faces: tuple[FaceReport, ...]
    #: the edges between different faces
    curves: tuple[EdgeReport, ...]
    #: edges between different faces, and their ends
    edges: int
    vertices: int
    #: genus of each shell, the outer one first
    genus: tuple[int, ...]
    euler: int
    #: of a channel: what frame carries its section along which guide; otherwise nothing
    frame: str
    #: of a channel: how far it is from breaking, by search (sampled)
    limits: tuple[LimitReport, ...]
    #: det J keeps its sign: proved or sampled
    determinant: str
    #: inner images with winding number 1, and how near parts of the boundary may come to one
    #: another before they count as touching: an overlap deeper than that would have been seen
    images: int
    contact_clearance: float
    equation: Integrals
    solid: Integrals
    #: those of the solid's triangles, where they were asked for (`Part.triangle_integrals`)
    triangles: Integrals | None = field(default=None, kw_only=True)
    #: largest tolerance of a vertex, edge or face of the kernel's solid
    kernel_tolerance: float
    #: the solids of a part in layers, from w = 0 up
    layers: tuple[LayerReport, ...] = ()
    #: what is unusual about the map but does not hinder, in sentences
    warnings: tuple[str, ...] = ()
    #: seconds per stage
    times: Mapping[str, float] = field(default_factory=dict)

    @property
    def shells(self) -> int:
        """Number of shells: 1, and 1 more for each void."""
        return len(self.genus)

    @property
    def integrals(self) -> Integrals:
        """The best figures of the solid: those of the equation."""
        return self.equation

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain data for JSON."""
        data = asdict(self)
        data["shells"] = self.shells
        data["deviation"] = self.deviation
        data["evidence"] = self.evidence
        return data


@dataclass(frozen=True)
class StepReport:
    """One Boolean of two shapes: which volumes add up (model units)."""

    #: as in the template: ``cut(block, bore)``
    name: str
    #: union, cut or intersect
    operation: str
    #: volumes of the two, of what they have in common, and of the result
    first: float
    second: float
    common: float
    result: float
    #: what is missing in the sum of the volumes, each integrated for itself
    gap: float
    #: which volumes add up, in words
    sentence: str


@dataclass(frozen=True)
class BodiesReport(Evidence):
    """What is known of a solid made of several bodies; lengths are in `units`.

    A face is known as its body's face is that it is a part of; its deviation is that of the whole
    side. `curves` are the edges where bodies meet, found by the kernel; their deviation bounds the
    distance from places common to both equations' faces, and what was seen of it is that from
    where the carriers meet. Sampled, it is the largest distance seen from the surface of either.
    """

    name: str
    title: str
    units: str
    parameters: Mapping[str, float]
    size: float
    tolerance: float
    #: how the bodies join
    result: str
    #: body -> its own report
    bodies: Mapping[str, Report]
    steps: tuple[StepReport, ...]
    faces: tuple[FaceReport, ...]
    curves: tuple[EdgeReport, ...]
    #: edges between differently named faces, and their ends
    edges: int
    vertices: int
    shells: int
    euler: int
    solid: Integrals
    #: those of the solid's triangles, where they were asked for
    triangles: Integrals | None = field(default=None, kw_only=True)
    kernel_tolerance: float
    warnings: tuple[str, ...] = ()
    times: Mapping[str, float] = field(default_factory=dict)

    @property
    def integrals(self) -> Integrals:
        """The best figures of the solid: those of its B-rep."""
        return self.solid

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain data for JSON."""
        data = asdict(self)
        data["bodies"] = {name: report.to_dict() for name, report in self.bodies.items()}
        data["deviation"] = self.deviation
        data["evidence"] = self.evidence
        return data
