"""The report: what was derived, what is exact, how far the rest deviates, what was checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

from pc2cad.errors import InputError

if TYPE_CHECKING:
    from pc2cad.integrals.inertia import Mass


class SeveralBodiesError(InputError):
    """One equation is asked for, and there are several bodies."""

    def __init__(self, name: str, bodies: Mapping[str, Any]) -> None:
        what = "several bodies" if len(bodies) > 1 else "copies of a body"
        super().__init__(f"{name} is made of {what} ({', '.join(bodies)}), and what was asked for "
                         "belongs to one equation; ask one of its bodies")  # fmt: skip


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
    #: largest distance to the equation at equal parameters: proved, or else the largest seen
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


def count(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural but for one."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


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

    @property
    def precision(self) -> str:
        """The evidence in a few words: ``exact``, or the deviation and how it is known."""
        if self.evidence == "exact":
            return "exact"
        return f"deviation {self.deviation:.2g} {self.units} ({self.evidence})"

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
class TopologyReport:
    """Whether no edge is missing where built faces meet: proved, or `open` says what is not."""

    evidence: str
    open: str
    #: pairs of cells looked at, and how far from an edge the equations' faces may meet at most
    cells: int
    within: float


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
    topology: TopologyReport | None = None


@dataclass(frozen=True)
class EquationReport:
    """What is known of a part from its one point equation; lengths in the part's units."""

    sides: tuple[SideReport, ...]
    #: genus of each shell, the outer one first
    genus: tuple[int, ...]
    #: of a channel: what frame carries its section along which guide; otherwise nothing
    frame: str
    #: det J keeps its sign: proved or sampled
    determinant: str
    #: inner images seen to have winding number 1; 0 where that is proved of all
    images: int
    contact_clearance: float  #: how near parts of the boundary may come, untouched
    #: that M covers no place twice: proved, but for places as near to the boundary as
    #: `overlap_depth`; or sampled, and `overlap_open` says what is not proved and where
    injectivity: str
    overlap_depth: float
    overlap_open: str
    #: parts of faces that the proof has looked at
    overlap_cells: int
    #: integrated over the box
    integrals: Integrals
    #: the solids of a part in layers, from w = 0 up
    layers: tuple[LayerReport, ...] = ()
    #: finds how far a channel is from breaking, by search (sampled)
    limits: Callable[[], tuple[LimitReport, ...]] = field(default=tuple, repr=False, compare=False)


@dataclass(frozen=True, repr=False)
class Report(Evidence):
    """Everything that is known of a compiled part; lengths are in `units`.

    A part is made of one point equation, and `own` says what is known of that, or of several
    `bodies`, each with a report as it would have alone, joined in `steps`. Then a face is known as
    its body's face is that it is a part of; its deviation is that of the whole side. `curves` are
    the edges where bodies meet, found by the kernel; their deviation bounds the distance from
    places common to both equations' faces, and what was seen of it is that from where the carriers
    meet. Sampled, it is the largest distance seen from the surface of either.

    What belongs to one equation raises SeveralBodiesError where there are several.
    """

    name: str
    title: str
    units: str
    parameters: Mapping[str, float]
    size: float
    tolerance: float
    faces: tuple[FaceReport, ...]
    #: the edges between different faces, or where bodies meet
    curves: tuple[EdgeReport, ...]
    #: edges between different faces, and their ends
    edges: int
    vertices: int
    #: 1, and 1 more for each void
    shells: int
    euler: int
    solid: Integrals
    #: those of the solid's triangles, where they were asked for (`Part.triangle_integrals`)
    triangles: Integrals | None = field(default=None, kw_only=True)
    #: mass, centre of mass and inertia, where a density was given (`Part.mass_properties`)
    mass: Mass | None = field(default=None, kw_only=True)
    #: integral, mean and extremes of each field, where they were asked for, as plain data
    fields: Mapping[str, Any] = field(default_factory=dict, kw_only=True)
    #: least and largest distance between the wall's faces, where asked for (sampled)
    thickness: Mapping[str, tuple[float, float]] = field(default_factory=dict, kw_only=True)
    #: where M is written as a sum of points: which Boolean that is, proved, or what is missing
    arithmetic: tuple[str, ...] = field(default=(), kw_only=True)
    #: which of several bodies were turned, or cut in halves, before they were joined, and why
    seams: tuple[str, ...] = field(default=(), kw_only=True)
    #: largest tolerance of a vertex, edge or face of the kernel's solid
    kernel_tolerance: float
    #: what is known of the one equation; None where there are several bodies
    own: EquationReport | None = None
    #: how several bodies join, as in the template, and which volumes add up
    result: str = ""
    bodies: Mapping[str, Report] = field(default_factory=dict)
    steps: tuple[StepReport, ...] = ()
    #: what is unusual about the map but does not hinder, in sentences
    warnings: tuple[str, ...] = ()
    times: Mapping[str, float] = field(default_factory=dict)  #: seconds per stage

    def __repr__(self) -> str:
        """Return one line: the name, the figures and the evidence."""
        return f"<Report {self.name}: {self.summary}>"

    @property
    def summary(self) -> str:
        """Volume, area, number of faces and evidence on one line."""
        best, units = self.integrals, self.units
        return (
            f"volume {best.volume:.10g} {units}^3, area {best.area:.10g} {units}^2, "
            f"{count(len(self.faces), 'face')}, {self.precision}"
        )

    @property
    def verdict(self) -> str:
        """What was found, in a phrase: ``valid solid, exact, 6 faces``; nothing else is built."""
        warned = f", {count(len(self.warnings), 'warning')}" if self.warnings else ""
        voids = f", {count(self.shells - 1, 'void')}" if self.shells > 1 else ""
        faces = count(len(self.faces), "face")
        return f"valid solid, {self.precision}, {faces}{voids}{warned}"

    @property
    def one(self) -> EquationReport:
        """What is known of the one equation; SeveralBodiesError where there are several."""
        if self.own is None:
            raise SeveralBodiesError(self.name, self.bodies)
        return self.own

    @property
    def integrals(self) -> Integrals:
        """The best figures of the solid: of its one equation, or of the B-rep of several bodies."""
        return self.solid if self.own is None else self.own.integrals

    @property
    def equation(self) -> Integrals:
        """Volume, area and centroid of the one equation."""
        return self.one.integrals

    @property
    def sides(self) -> tuple[SideReport, ...]:
        """The fate of every side of the one equation's box."""
        return self.one.sides

    @property
    def genus(self) -> tuple[int, ...]:
        """Genus of each shell, the outer one first."""
        return self.one.genus

    @property
    def frame(self) -> str:
        """Of a channel: what frame carries its section along which guide; otherwise nothing."""
        return self.one.frame

    @property
    def limits(self) -> tuple[LimitReport, ...]:
        """Of a channel: how far it is from breaking, by search (sampled)."""
        return self.one.limits()

    @property
    def determinant(self) -> str:
        """Whether it is proved or sampled that det J keeps its sign."""
        return self.one.determinant

    @property
    def images(self) -> int:
        """Number of inner images seen to have winding number 1; 0 where that is proved of all."""
        return self.one.images

    @property
    def contact_clearance(self) -> float:
        """How near parts of the boundary may come to one another before they count as touching."""
        return self.one.contact_clearance

    @property
    def injectivity(self) -> str:
        """Whether it is proved or sampled that M covers no place twice."""
        return self.one.injectivity

    @property
    def overlap_depth(self) -> float:
        """How deep an overlap may be that is not excluded."""
        return self.one.overlap_depth

    @property
    def layers(self) -> tuple[LayerReport, ...]:
        """The solids of a part in layers, from w = 0 up."""
        return self.one.layers

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain data for JSON."""
        if self.own is None:
            bodies = {name: body.to_dict() for name, body in self.bodies.items()}
            known = asdict(replace(self, bodies={})) | {"bodies": bodies}
            order: tuple[str, ...] = _OF_BODIES
        else:
            known, order = asdict(self), _OF_EQUATION
            known |= known["own"] | {"equation": known["own"]["integrals"]}
            known["limits"] = [asdict(limit) for limit in self.limits]
        known |= {"deviation": self.deviation, "evidence": self.evidence}
        return {key: known[key] for key in order}


#: what plain data hold, in the order that they have always had
_OF_EQUATION = (
    "name", "title", "units", "parameters", "size", "tolerance", "sides", "faces", "curves",
    "edges", "vertices", "genus", "euler", "frame", "limits", "determinant", "images",
    "contact_clearance", "injectivity", "overlap_depth", "overlap_open", "overlap_cells",
    "equation", "solid", "triangles", "mass", "fields", "thickness", "arithmetic",
    "kernel_tolerance", "layers", "warnings", "times", "shells", "deviation", "evidence",
)  # fmt: skip
_OF_BODIES = (
    "name", "title", "units", "parameters", "size", "tolerance", "result", "bodies", "steps",
    "faces", "curves", "edges", "vertices", "shells", "euler", "solid", "triangles", "mass",
    "fields", "thickness", "arithmetic", "seams", "kernel_tolerance", "warnings", "times",
    "deviation", "evidence",
)  # fmt: skip
