"""What became of a file that was held against its equation, and all that differs, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pc2cad.domain.analysis import Analysis
from pc2cad.equation.point_equation import UNITS, PointEquation
from pc2cad.geometry.carriers import Evidence
from pc2cad.integrals.mass_properties import MassProperties
from pc2cad.templates.bodies import Bodies
from pc2cad.verify.receipt import StepFile, describe
from pc2cad.verify.sides import Match, weakest

#: of the part's size and of its thickness 2V/A: the tolerance where none is given
OF_SIZE, OF_THICKNESS = 1e-7, 1e-6


def usual_tolerance(analysis: Analysis, mass: MassProperties) -> float:
    """Return the tolerance of an equation where none is given: that of a build."""
    usual = OF_SIZE * analysis.size
    return max(
        min(usual, analysis.scale.least_tolerance), min(usual, OF_THICKNESS * mass.thickness)
    )


@dataclass(frozen=True, eq=False)
class Verification:
    """What became of every face, and all that differs, in words; the worst one has its own."""

    file: StepFile
    equation: PointEquation | Bodies
    tolerance: float
    matches: tuple[Match, ...]
    mass: MassProperties
    differences: tuple[str, ...]
    worst: str
    #: of several bodies: how many places were looked at for where the others lie
    places: int | None = None

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
                    "trimmed": match.trimmed,
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
            "places": self.places,
            "receipt": describe(self.file),
        }


def _bound_of(match: Match) -> float | None:
    return None if match.nearness.rests_on == "sampled" else match.reach


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


class Collected:
    """Collects what differs, with its size in lengths."""

    def __init__(self, file: StepFile, equation: PointEquation | Bodies, size: float) -> None:
        self.file, self.equation, self.size = file, equation, size
        self._found: list[tuple[float, str]] = []

    def add(self, size: float, sentence: str) -> None:
        """Take note of a difference."""
        self._found.append((size, sentence))

    def of_itself(self) -> None:
        """Take note of what is wrong with the file by itself."""
        findings = self.file.findings
        for sentence in (*findings.defects, *findings.unknown, *findings.loose):
            self.add(0.0, sentence)

    def same_unit(self) -> bool:
        """Say whether all solids have the equation's unit of length, and take note if not."""
        units = self.equation.units
        metres = UNITS[units]
        for solid in self.file.solids:
            if abs(solid.units.metres - metres) > 1e-9 * metres:
                self.add(
                    self.size,
                    f"the file's unit of length is {solid.units.metres:g} m, the equation's is "
                    f"{units} ({metres:g} m)",
                )
                return False
        return True

    def integrals(self, mass: MassProperties, count: int, slack: float, off: float) -> None:
        """Hold volume and centroid of `count` solids against the equation's.

        They may differ by `slack`, and by `off` times the size besides what that explains.
        """
        solids, units = self.file.solids, self.equation.units
        volumes = [solid.volume for solid in solids if solid.volume is not None]
        if len(volumes) != len(solids) or any(solid.centroid is None for solid in solids):
            return
        if len(solids) != count:
            self.add(self.size, f"the file holds {len(solids)} solids, not {count}")
        volume = sum(volumes)
        if abs(volume - mass.volume) > slack:
            self.add(
                abs(volume - mass.volume) / mass.area,
                f"the file's volume is {volume:.12g} {units}^3, the equation's {mass.volume:.12g}",
            )
        parts = [
            v * s.centroid for v, s in zip(volumes, solids, strict=True) if s.centroid is not None
        ]
        centre = np.sum(parts, axis=0) / volume
        gap = float(np.linalg.norm(centre - np.array(mass.centroid)))
        if gap > self.size * (2.0 * slack / mass.volume + off):
            self.add(gap, f"the file's centroid is {gap:.3g} {units} off the equation's")

    def verdict(
        self, tolerance: float, matches: Sequence[Match], mass: MassProperties,
        places: int | None = None,
    ) -> Verification:  # fmt: skip
        """Return all that was found."""
        differences = tuple(sentence for _, sentence in self._found)
        worst = max(self._found, key=lambda found: found[0])[1] if self._found else ""
        return Verification(
            self.file, self.equation, tolerance, tuple(matches), mass, differences, worst, places
        )
