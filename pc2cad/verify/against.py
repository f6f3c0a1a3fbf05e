"""A STEP file held against the point equation that it is said to be made from.

Every face is held against the side of its name and every side needs its face; border, area, unit,
stated properties, volume, area and centroid follow. Distances of surfaces are proved where that
can be had (`nearness`, `borders`), else *sampled*: the largest seen.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Mapping, Sequence
from functools import cache, partial
from typing import Any

import numpy as np

from pc2cad.domain.analysis import Analysis, analyse
from pc2cad.domain.cuts import parted
from pc2cad.equation.point_equation import PointEquation
from pc2cad.integrals.mass_properties import MassProperties, integrate
from pc2cad.templates.bodies import Bodies, BodiesTemplate
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import find_template
from pc2cad.templates.template import Template
from pc2cad.topology.cells import Cell
from pc2cad.verify.faces import JudgedFace
from pc2cad.verify.proofs import Proofs
from pc2cad.verify.receipt import StepFile, read_step
from pc2cad.verify.replay import StepText
from pc2cad.verify.sides import Match, Sides, coarse, compare, goes_on
from pc2cad.verify.verdict import Collected, Verification, usual_tolerance

#: relative differences that quadrature leaves open
_INTEGRALS = 1e-9
#: how often a build cuts all pieces of a direction in their middles
_MOST_CUTS = 4
#: faces that are off their side for which another side is looked for
_SEARCHES = 4


def verify_file(
    file: str | os.PathLike[str],
    template: str | os.PathLike[str] | Template | BodiesTemplate | PointEquation | Bodies,
    values: Mapping[str, Any] | None = None,
    *,
    tolerance: float | None = None,
) -> dict[str, Any]:
    """Hold a STEP file against a template, or point equations; return plain data for JSON.

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
    template: str | os.PathLike[str] | Template | BodiesTemplate | PointEquation | Bodies,
    values: Mapping[str, Any] | None = None,
) -> PointEquation | Bodies:
    """Return the equation, or the bodies, of a template with values of its parameters."""
    if isinstance(template, PointEquation | Bodies):
        return template
    if not isinstance(template, Template | BodiesTemplate):
        template = read_template(find_template(os.fspath(template)))
    return template.bind(values)


def verification(
    file: StepFile,
    equation: PointEquation | Bodies,
    tolerance: float | None = None,
    *,
    claims: bool = False,
) -> Verification:
    """Hold a file that was read against equations; with `claims` as a certificate needs it."""
    with np.errstate(all="ignore"):
        if isinstance(equation, Bodies):
            from pc2cad.verify.joined import joined_verification

            return joined_verification(file, equation, tolerance, claims=claims)
        names = {face.face.name for solid in file.solids for face in solid.faces}
        analysis = _as_named(analyse(equation), names)
        mass = integrate(analysis)
        return _Judge(file, analysis, mass, tolerance, claims).judged()


def _as_named(analysis: Analysis, names: Collection[str]) -> Analysis:
    """Return the analysis with directions cut as the names of a file's faces say, if they are it.

    A build may cut pieces in their middles (`parted`), and again; faces are named after pieces.
    """
    cut, left = analysis, _MOST_CUTS
    for direction, parameter in enumerate("uvw"):
        found = re.findall(rf"\bpiece (\d+) of {parameter}\b", "\n".join(names))
        while left and len(cut.bounds[direction]) <= max(map(int, found), default=0):
            cut, left = parted(cut, direction), left - 1
    known = Sides(cut, [0.0] * len(cut.complex.faces)).groups()
    return cut if set(names) <= known.keys() else analysis


class _Judge(Collected):
    """Holds faces against the sides of one equation."""

    def __init__(
        self, file: StepFile, analysis: Analysis, mass: MassProperties, tolerance: float | None,
        claims: bool,
    ) -> None:  # fmt: skip
        super().__init__(file, analysis.equation, analysis.size)
        self._analysis, self._mass = analysis, mass
        self._tolerance = usual_tolerance(analysis, mass) if tolerance is None else tolerance
        self._units = analysis.equation.units
        self._searched = 0
        self._sides = Sides(analysis, [*mass.face_areas, *mass.interface_areas])
        text = cache(partial(StepText, file.data)) if claims else None
        self._proofs = Proofs(self._sides, self._tolerance, text)

    def judged(self) -> Verification:
        """Return what became of the file."""
        self.of_itself()
        matches: list[Match] = []
        if self.file.solids and self.same_unit():
            matches = self._faces()
            mass = self._mass
            rough = _INTEGRALS + mass.relative_error + 1e-12
            # a face that is nowhere further than this from its side moves the volume by no more
            slack = mass.area * self._tolerance + rough * mass.volume
            count = max(1, len(self._analysis.complex.layers))
            self.integrals(mass, count, slack, _INTEGRALS)
        return self.verdict(self._tolerance, matches, self._mass)

    def _faces(self) -> list[Match]:
        """Hold every face against its side, and ask for the face of every side."""
        faces = [face for solid in self.file.solids for face in solid.faces]
        groups = self._sides.groups()
        covered: dict[Cell, int] = {}
        matches = []
        names = [self._name(face, groups) for face in faces]
        shares = [list(groups[name]) for name in names]
        self._share_out(faces, shares)
        for face, name, patches in zip(faces, names, shares, strict=True):
            match = self._proofs.of(compare(self._sides, name, patches, face, self._tolerance))
            matches.append(match)
            self._judge(match, groups)
            for patch in patches:
                covered[patch] = covered.get(patch, 0) + 1
        self._coverage(covered)
        return matches

    def _name(self, face: JudgedFace, groups: Mapping[str, Sequence[Cell]]) -> str:
        """Return the side that a face is named after, or is nearest to."""
        name = face.face.name
        if name in groups:
            return name
        if name:
            self.add(0.0, f"the face {face.face.label} has the name of no side")
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
            self.add(
                part.distance,
                f"{part.what} of the face {label} is {part.distance:.3g} {units} from that of "
                f"the side {match.name} ({part.place}){hint}",
            )
        if match.excess > 0.0:
            own = match.face.moments.area
            self.add(
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
                self.add(
                    self._analysis.size,
                    f"the side {complex_.name(face.patch)} is covered by {count} faces instead of "
                    f"{wanted}",
                )
