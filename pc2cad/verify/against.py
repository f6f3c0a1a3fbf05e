"""A STEP file held against the point equation that it is said to be made from.

Every face is held against the side of its name and every side needs its face; border, area, unit,
stated properties, volume, area and centroid follow. Distances of surfaces are proved where that
can be had (`nearness`, `borders`), else *sampled*: the largest seen.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pc2cad.domain.analysis import Analysis, analyse
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.equation.point_equation import UNITS, PointEquation
from pc2cad.errors import InputError
from pc2cad.geometry.carriers import Evidence
from pc2cad.integrals.mass_properties import MassProperties, integrate
from pc2cad.templates.bodies import BodiesTemplate
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import find_template
from pc2cad.templates.template import Template
from pc2cad.topology.cells import Cell
from pc2cad.verify.balls import ReplayError
from pc2cad.verify.borders import Borders
from pc2cad.verify.faces import JudgedFace
from pc2cad.verify.nearness import nearness
from pc2cad.verify.receipt import StepFile, describe, read_step
from pc2cad.verify.replay import Quadric, Spline, StepText, surface_of
from pc2cad.verify.sides import Match, Sides, Turn, coarse, compare, goes_on, weakest
from pc2cad.verify.splines import SplineSurface
from pc2cad.verify.surfaces import Round

#: of the part's size and of its thickness 2V/A: the tolerance where none is given
OF_SIZE, OF_THICKNESS = 1e-7, 1e-6
#: relative differences that quadrature leaves open
_INTEGRALS = 1e-9
#: faces that are off their side for which another side is looked for
_SEARCHES = 4


@dataclass(frozen=True, eq=False)
class Verification:
    """What became of every face, and all that differs, in words; the worst one has its own."""

    file: StepFile
    equation: PointEquation
    tolerance: float
    matches: tuple[Match, ...]
    mass: MassProperties
    differences: tuple[str, ...]
    worst: str

    @property
    def units(self) -> str:
        """The equation's unit of length."""
        return self.equation.units

    @property
    def verified(self) -> bool:
        """Whether nothing differs."""
        return not self.differences

    @property
    def deviation(self) -> float:
        """The largest distance between a face and its side: bounds, and what was seen."""
        return max((match.distance for match in self.matches), default=0.0)

    @property
    def evidence(self) -> Evidence:
        """What the distances of all faces and edges rest on: the weakest of them."""
        return weakest(match.evidence for match in self.matches)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data for JSON."""
        return {
            "verified": self.verified,
            "tolerance": self.tolerance,
            "deviation": _finite(self.deviation),
            "evidence": self.evidence,
            "units": self.units,
            "faces": [
                {
                    "side": match.name,
                    "face": str(match.face.face.ref),
                    "carrier": match.face.face.carrier,
                    "rests_on": match.nearness.rests_on,
                    "bound": _bound_of(match),
                    "deviation": _finite(match.surface.distance),
                    "border": _finite(match.border_reach),
                    "border_rests_on": match.edges.rests_on,
                    "place": match.surface.place,
                    "equal_parameters": match.equal_parameters,
                }
                for match in self.matches
            ],
            "equation": {
                "volume": self.mass.volume,
                "area": self.mass.area,
                "centroid": list(self.mass.centroid),
                "relative_error": self.mass.relative_error,
                "source": self.mass.source,
            },
            "differences": list(self.differences),
            "worst": self.worst,
            "receipt": describe(self.file),
        }


def _bound_of(match: Match) -> float | None:
    return None if match.nearness.rests_on == "sampled" else match.reach


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def verify_file(
    file: str | os.PathLike[str],
    template: str | os.PathLike[str] | Template | PointEquation,
    values: Mapping[str, Any] | None = None,
    *,
    tolerance: float | None = None,
) -> dict[str, Any]:
    """Hold a STEP file against a template or a point equation; return plain data for JSON.

    ``verified`` says whether every face is within ``tolerance`` of its side (a length in the
    equation's unit; by default 1e-7 of the size, or 1e-6 of the thickness where that is less), and
    volume, area, centroid, unit and names agree; ``differences`` says in sentences what does not.
    No kernel and no CAD library is loaded.

    Raises:
        StepUnreadableError: the text is no exchange structure, or too large.
        InputError: the template, or a value of it, is not well formed.
        NotASolidError: the equation has no closed boundary.

    """
    return verification(read_step(file), equation_of(template, values), tolerance).to_dict()


def equation_of(
    template: str | os.PathLike[str] | Template | PointEquation,
    values: Mapping[str, Any] | None = None,
) -> PointEquation:
    """Return the equation of a template, by its name or file, with values of its parameters."""
    if isinstance(template, PointEquation):
        return template
    read: Template | BodiesTemplate
    if isinstance(template, Template):
        read = template
    else:
        read = read_template(find_template(os.fspath(template)))
    if isinstance(read, BodiesTemplate):
        raise InputError(
            f"{read.name} has several bodies and no equation of its own to be held against; "
            "without a template the file is held against itself"
        )
    return read.bind(values)


def verification(
    file: StepFile,
    equation: PointEquation,
    tolerance: float | None = None,
    *,
    claims: bool = False,
) -> Verification:
    """Hold a file that was read against an equation; with `claims` as a certificate needs it."""
    with np.errstate(all="ignore"):
        analysis = analyse(equation)
        mass = integrate(analysis)
        return _Judge(file, analysis, mass, tolerance, claims).verdict()


class _Judge:
    """Collects what differs, with its size in lengths."""

    def __init__(
        self, file: StepFile, analysis: Analysis, mass: MassProperties, tolerance: float | None,
        claims: bool,
    ) -> None:  # fmt: skip
        self._file, self._analysis, self._mass = file, analysis, mass
        self._found: list[tuple[float, str]] = []
        least = analysis.scale.least_tolerance
        usual = OF_SIZE * analysis.size
        own = max(min(usual, least), min(usual, OF_THICKNESS * mass.thickness))
        self._tolerance = own if tolerance is None else tolerance
        self._units = analysis.equation.units
        self._searched, self._claims = 0, claims
        self._sides = Sides(analysis, [*mass.face_areas, *mass.interface_areas])

    def verdict(self) -> Verification:
        findings = self._file.findings
        for sentence in (*findings.defects, *findings.unknown, *findings.loose):
            self._add(0.0, sentence)
        for size, sentence in findings.stated:
            # what a file states is the equation's: its faces may be off by the tolerance
            if size > self._tolerance:
                self._add(size, sentence)
        matches: list[Match] = []
        if self._file.solids and self._same_unit():
            matches = self._faces()
            self._integrals()
        differences = tuple(sentence for _, sentence in self._found)
        worst = max(self._found, key=lambda found: found[0])[1] if self._found else ""
        return Verification(
            self._file,
            self._analysis.equation,
            self._tolerance,
            tuple(matches),
            self._mass,
            differences,
            worst,
        )

    def _add(self, size: float, sentence: str) -> None:
        self._found.append((size, sentence))

    def _same_unit(self) -> bool:
        metres = UNITS[self._units]
        for solid in self._file.solids:
            if abs(solid.units.metres - metres) > 1e-9 * metres:
                self._add(
                    self._analysis.size,
                    f"the file's unit of length is {solid.units.metres:g} m, the equation's is "
                    f"{self._units} ({metres:g} m)",
                )
                return False
        return True

    def _faces(self) -> list[Match]:
        """Hold every face against its side, and ask for the face of every side."""
        faces = [face for solid in self._file.solids for face in solid.faces]
        groups = self._sides.groups()
        covered: dict[Cell, int] = {}
        matches = []
        names = [self._name(face, groups) for face in faces]
        shares = [list(groups[name]) for name in names]
        self._share_out(faces, shares)
        for face, name, patches in zip(faces, names, shares, strict=True):
            match = self._proved(compare(self._sides, name, patches, face, self._tolerance))
            matches.append(match)
            self._judge(match, groups)
            for patch in patches:
                covered[patch] = covered.get(patch, 0) + 1
        self._coverage(covered)
        return matches

    @cached_property
    def _text(self) -> StepText:
        return StepText(self._file.data)

    @cached_property
    def _borders(self) -> Borders:
        return Borders(self._sides, self._tolerance)

    def _proved(self, match: Match) -> Match:
        """Return a match with a bound of its distance, where one can be had."""
        seen = match.surface.distance
        if not seen <= self._tolerance:
            return match
        turn = match.turn or (False, False, False)
        try:
            surface = self._surface(match.face, turn)
        except (ReplayError, ValueError, KeyError, IndexError):
            return match
        if surface is None or (isinstance(surface, Spline) and match.turn is None):
            return match
        patches = [RestrictedMap(self._analysis, patch) for patch in match.patches]
        found = nearness(patches, surface, match.turn, seen, self._tolerance, claims=self._claims)
        return replace(match, nearness=found, edges=self._borders.nearness(match))

    def _surface(self, judged: JudgedFace, turn: Turn) -> Spline | Quadric | None:
        """Return a face's surface for proofs; for a certificate it is read as a replay reads it."""
        own = judged.surface
        if self._claims:
            return surface_of(self._text, judged.face.ref, turn)
        if isinstance(own, SplineSurface) and not own.rational:
            return Spline(own.degrees, own.knots, own.poles, turn)
        if isinstance(own, Round):
            return Quadric(own.kind, (own.origin, own.axes), own.lengths)
        if judged.face.carrier == "PLANE" and judged.frame is not None:
            return Quadric("PLANE", judged.frame, ())
        return None

    def _name(self, face: JudgedFace, groups: Mapping[str, Sequence[Cell]]) -> str:
        """Return the side that a face is named after, or is nearest to."""
        name = face.face.name
        if name in groups:
            return name
        if name:
            self._add(0.0, f"the face {face.face.label} has the name of no side")
        return self._nearest(face, groups)

    def _share_out(self, faces: Sequence[JudgedFace], shares: Sequence[list[Cell]]) -> None:
        """Give patches without a face to the faces that go on over them, on one surface."""
        cells = self._analysis.complex.faces
        edges = {f.patch: {u.edge for u in f.uses if u.edge is not None} for f in cells}
        free = {f.patch for f in cells} - {patch for share in shares for patch in share}
        while True:
            before = len(free)
            for face, share in zip(faces, shares, strict=True):
                own = set().union(*(edges[patch] for patch in share))
                for patch in sorted(p for p in free if edges[p] & own):
                    if goes_on(self._sides, patch, face, self._tolerance):
                        share.append(patch)
                        free.discard(patch)
                        own |= edges[patch]
            if len(free) == before:
                return

    def _nearest(self, face: JudgedFace, groups: Mapping[str, Sequence[Cell]]) -> str:
        return min(groups, key=lambda name: coarse(self._sides, groups[name], face))

    def _judge(self, match: Match, groups: Mapping[str, Sequence[Cell]]) -> None:
        label, units = match.face.face.label, self._units
        for part in (match.surface, match.border):
            if part.distance <= self._tolerance:
                continue
            hint = ""
            self._searched += 1
            if self._searched <= _SEARCHES:
                other = self._nearest(match.face, groups)
                near = coarse(self._sides, groups[other], match.face) <= 10 * self._tolerance
                hint = f"; it lies on {other}" if near and other != match.name else ""
            self._add(
                part.distance,
                f"{part.what} of the face {label} is {part.distance:.3g} {units} from that of "
                f"the side {match.name} ({part.place}){hint}",
            )
        if match.excess > 0.0:
            own = match.face.moments.area
            self._add(
                match.excess / max(own, 1e-300) ** 0.5,
                f"the face {label} has the area {own:.10g} {units}^2, {match.area:.3g} off that of "
                f"the side {match.name}",
            )

    def _coverage(self, covered: Mapping[Cell, int]) -> None:
        complex_ = self._analysis.complex
        for index, face in enumerate(complex_.faces):
            wanted = 2 if index in complex_.enclosed else 1
            count = covered.get(face.patch, 0)
            if count != wanted:
                self._add(
                    self._analysis.size,
                    f"the side {complex_.name(face.patch)} is covered by {count} faces instead of "
                    f"{wanted}",
                )

    def _integrals(self) -> None:
        solids, mass, units = self._file.solids, self._mass, self._units
        volumes = [solid.volume for solid in solids if solid.volume is not None]
        if len(volumes) != len(solids) or any(solid.centroid is None for solid in solids):
            return
        wanted = max(1, len(self._analysis.complex.layers))
        if len(solids) != wanted:
            self._add(self._analysis.size, f"the file holds {len(solids)} solids, not {wanted}")
        volume = sum(volumes)
        rough = _INTEGRALS + mass.relative_error + 1e-12
        # a face that is nowhere further than this from its side moves the volume by no more
        slack = mass.area * self._tolerance + rough * mass.volume
        if abs(volume - mass.volume) > slack:
            self._add(
                abs(volume - mass.volume) / mass.area,
                f"the file's volume is {volume:.12g} {units}^3, the equation's {mass.volume:.12g}",
            )
        parts = [
            v * s.centroid for v, s in zip(volumes, solids, strict=True) if s.centroid is not None
        ]
        centre = np.sum(parts, axis=0) / volume
        off = float(np.linalg.norm(centre - np.array(mass.centroid)))
        size = self._analysis.size
        if off > size * (2.0 * slack / mass.volume + _INTEGRALS):
            self._add(off, f"the file's centroid is {off:.3g} {units} off the equation's")
