"""A receipt for a STEP file of anybody's: what is closed and true in it, from its text alone."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pc2cad.verify.defects import StepDefectError
from pc2cad.verify.exchange import parse_exchange, read_bytes
from pc2cad.verify.records import Records
from pc2cad.verify.solids import Findings, Solid, read_solid, solid_records
from pc2cad.verify.units import Stated, stated_properties

#: relative difference at which a stated volume, area or centroid is false
FALSE = 1e-6
#: shapes that are no shells of faces round a solid, or are placed by others
_OTHERS = (
    "FACETED_BREP", "SHELL_BASED_SURFACE_MODEL", "FACE_BASED_SURFACE_MODEL", "GEOMETRIC_SET",
    "GEOMETRIC_CURVE_SET", "TESSELLATED_SOLID", "TESSELLATED_SHELL", "CSG_SOLID", "BOOLEAN_RESULT",
    "EXTRUDED_AREA_SOLID", "REVOLVED_AREA_SOLID", "BLOCK", "SPHERE", "TORUS", "RIGHT_CIRCULAR_CONE",
    "RIGHT_CIRCULAR_CYLINDER", "RIGHT_ANGULAR_WEDGE",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class StepFile:
    """A file that was read: its solids, what it states, and what was found."""

    sha256: str
    schema: str
    products: tuple[str, ...]
    instances: int
    solids: tuple[Solid, ...]
    stated: Stated
    findings: Findings
    #: the bytes that were read
    data: bytes = field(repr=False)

    @property
    def sound(self) -> bool | None:
        """Whether nothing contradicts itself; None where something could not be judged."""
        if self.findings.defects:
            return False
        return None if self.findings.unknown else True


def receipt(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what a STEP file holds and whether it is sound, as plain data for JSON.

    ``sound`` is True, False, or None where something in it is not known here; ``defects`` and
    ``unknown`` say what and where in sentences. Lengths are in the file's unit, which ``unit_m``
    gives in metres. No kernel and no CAD library is loaded.

    Raises:
        StepUnreadableError: the text is no exchange structure, or too large.

    """
    return describe(read_step(path))


def read_step(path: str | os.PathLike[str]) -> StepFile:
    """Read and judge a file; raise StepUnreadableError where it is none."""
    return parse_step(read_bytes(path))


def parse_step(data: bytes) -> StepFile:
    """Judge the bytes of a file; raise StepUnreadableError where they are none."""
    records = Records(parse_exchange(data))
    findings = Findings()
    findings.defects += [
        f"{ref} has coordinates that are no numbers" for ref in records.without_numbers()[:5]
    ]
    solids = []
    found = solid_records(records)
    if not found:
        findings.defects.append("the file holds no solid")
    for record in found:
        solid = read_solid(records, record, findings)
        if solid is not None:
            solids.append(solid)
    for word in _OTHERS:
        count = len(records.all_of(word))
        if count:
            findings.unknown.append(f"{count} of {word}, which is not judged")
    stated = Stated()
    if solids:
        metres = solids[0].units.metres
        stated = findings.attempt(lambda: stated_properties(records, metres)) or Stated()
        _check_stated(solids, stated, findings)
    names = [str((r.values(2)[1] or r.values(2)[0]) or "") for r in records.all_of("PRODUCT")
             if len(r.parts) == 1 and len(r.values()) > 1]  # fmt: skip
    if len(names) > 1:
        findings.remarks.append(
            f"the file holds {len(names)} products: each solid is judged by itself, where it stands"
        )
    return StepFile(
        hashlib.sha256(data).hexdigest(), _schema(records), tuple(names), len(records),
        tuple(solids), stated, findings, data,
    )  # fmt: skip


def _schema(records: Records) -> str:
    values = records.header["FILE_SCHEMA"]
    names = values[0] if values and isinstance(values[0], tuple) else ()
    return ", ".join(str(name) for name in names)


def _check_stated(solids: list[Solid], stated: Stated, findings: Findings) -> None:
    """Hold what the file states against its own faces, all solids together."""
    volumes = [s.volume for s in solids if s.volume is not None]
    areas = [s.area for s in solids if s.area is not None]
    if len(volumes) != len(solids):
        return
    volume, area = sum(volumes), sum(areas)
    size = max(s.size for s in solids)
    for name, figure, own, error in (
        ("volume", stated.volume, volume, max(s.volume_error for s in solids)),
        # of solids that touch, the area between them may be left out
        ("area", stated.area if len(solids) == 1 else None, area, solids[0].area_error),
    ):
        if figure is not None and not abs(figure - own) <= (FALSE + min(error, 1e-3)) * abs(own):
            findings.defects.append(
                f"the file states the {name} {figure:.10g}, its faces give {own:.10g}"
            )
    centres = [s.centroid for s in solids]
    if stated.centroid is None or volume <= 0.0 or any(centre is None for centre in centres):
        return
    own_centre = sum(
        (v * c for v, c in zip(volumes, centres, strict=True) if c is not None), np.zeros(3)
    )
    off = float(np.linalg.norm(np.array(stated.centroid) - own_centre / volume))
    if not off <= FALSE * size:
        findings.defects.append(
            f"the file states a centroid that is {off:.3g} off that of its faces"
        )


def describe(file: StepFile) -> dict[str, Any]:
    """Return a file that was read as plain data."""
    findings = file.findings
    return {
        "sound": file.sound,
        "sha256": file.sha256,
        "schema": file.schema,
        "products": list(file.products),
        "instances": file.instances,
        "solids": [_described(solid) for solid in file.solids],
        "stated": {
            "volume": file.stated.volume,
            "area": file.stated.area,
            "centroid": None if file.stated.centroid is None else list(file.stated.centroid),
        },
        "defects": list(findings.defects),
        "unknown": list(findings.unknown),
        "remarks": [*findings.loose, *findings.remarks],
    }


def _described(solid: Solid) -> dict[str, Any]:
    return {
        "name": solid.name,
        "unit_m": solid.units.metres,
        "uncertainty": solid.units.uncertainty,
        "size": solid.size,
        "shells": len(solid.shells),
        "faces": sum(len(shell.faces) for shell in solid.shells),
        "carriers": dict(Counter(f.carrier for s in solid.shells for f in s.faces)),
        "edges": solid.edges,
        "vertices": solid.vertices,
        "largest_vertex_gap": solid.vertex_gap,
        "largest_edge_gap": solid.edge_gap,
        "gaps_are": solid.gaps_rest_on,
        "volume": solid.volume,
        **_off("volume", solid.volume_bound, solid.volume, solid.volume_error),
        "area": solid.area,
        **_off("area", solid.area_bound, solid.area, solid.area_error),
        "centroid": None if solid.centroid is None else solid.centroid.tolist(),
        **_off("centroid", solid.centroid_bound, 1.0, solid.volume_error * solid.size),
    }


def _off(name: str, bound: float, of: float | None, seen: float) -> dict[str, Any]:
    """Return what a figure may be off by, as a share: a bound where it is one, else an estimate."""
    if of and np.isfinite(bound):
        return {f"{name}_error": bound / abs(of), f"{name}_is": "bounded"}
    return {f"{name}_error": seen, f"{name}_is": "sampled"}


def require_sound(file: StepFile) -> None:
    """Raise StepDefectError where a file is not sound, or could not be judged."""
    for sentence in (*describe(file)["defects"], *file.findings.unknown):
        raise StepDefectError(sentence)
