"""Solids of a STEP file: their shells, and what of them contradicts itself.

All that is wrong is collected, not the first of it alone. Nothing is repaired.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np

from pc2cad.arrays import Array
from pc2cad.geometry.carriers import Evidence
from pc2cad.verify.accuracy import slack_of
from pc2cad.verify.defects import StepDefectError, StepUnknownError
from pc2cad.verify.edges import EdgeReader
from pc2cad.verify.exchange import Ref
from pc2cad.verify.faces import Face, JudgedFace, judge_face, read_face
from pc2cad.verify.pcurves import check_pcurves
from pc2cad.verify.records import Record, Records, is_true, sequence
from pc2cad.verify.units import Units, read_units

SOLIDS = ("MANIFOLD_SOLID_BREP", "BREP_WITH_VOIDS")
#: of the size: gaps that rounding explains
ROUNDING = 1e-12
#: of the size, and times the stated uncertainty: a larger gap is a defect of anybody's file
LOOSE, TIMES = 1e-6, 10.0
#: uncertainty where none is stated, of the size
UNSTATED = 1e-7

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Shell:
    """A closed shell: +1 for the outer one of a solid, the flag's sign for a void."""

    ref: Ref
    sign: float
    void: bool
    faces: tuple[Face, ...]

    def edge_refs(self) -> set[Ref]:
        """Return the edges of its faces."""
        return {e.ref for face in self.faces for loop in face.loops for e, _ in loop.edges}


@dataclass(eq=False)
class Findings:
    """What was found wrong, and what could not be judged; both in words."""

    defects: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)
    #: gaps beyond the stated uncertainty, which receivers heal; and what is worth knowing
    loose: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def attempt(self, work: Callable[[], T]) -> T | None:
        """Return the work's result, or None and a finding where it fails."""
        try:
            with np.errstate(all="ignore"):
                return work()
        except StepUnknownError as error:
            self.unknown.append(str(error))
        except StepDefectError as error:
            self.defects.append(str(error))
        return None


@dataclass(frozen=True, eq=False)
class Solid:
    """One solid and its integrals, in the file's own unit."""

    name: str
    ref: Ref
    units: Units
    size: float
    shells: tuple[Shell, ...]
    faces: tuple[JudgedFace, ...]
    edges: int
    vertices: int
    #: largest distances of edges from vertices (at ends), and of edges from surfaces
    vertex_gap: float
    edge_gap: float
    #: whether the latter is a bound of all, or the largest that was seen
    gaps_rest_on: Evidence
    #: None where a face could not be judged
    volume: float | None
    area: float | None
    centroid: Array | None
    #: relative: of the volume by the theorem of Stokes, of the area by two rules
    volume_error: float
    area_error: float
    #: a place about which integrals over faces are taken
    origin: Array
    #: what volume and area, and the place of the centroid, may be off by; infinite if not bounded
    volume_bound: float
    area_bound: float
    centroid_bound: float

    @property
    def uncertainty(self) -> float:
        """The stated uncertainty, or a share of the size where none is stated."""
        stated = self.units.uncertainty
        return UNSTATED * self.size if stated is None else stated


def solid_records(records: Records) -> list[Record]:
    """Return the solids of a file that are shells of faces."""
    return records.all_of(*SOLIDS)


def context_of(records: Records, solid: Ref) -> Any:
    """Return the context of the representation that holds a solid."""
    kinds = ("ADVANCED_BREP_SHAPE_REPRESENTATION", "SHAPE_REPRESENTATION",
             "FACETED_BREP_SHAPE_REPRESENTATION",
             "MANIFOLD_SURFACE_SHAPE_REPRESENTATION")  # fmt: skip
    for representation in records.all_of(*kinds):
        values = next(iter(representation.parts.values()))
        if len(values) > 2 and isinstance(values[1], tuple) and solid in values[1]:
            return values[2]
    raise StepDefectError(f"no shape representation of the file holds the solid {solid}")


def read_solid(records: Records, record: Record, findings: Findings) -> Solid | None:
    """Return one solid; None where there is nothing to be judged."""
    units = findings.attempt(lambda: read_units(records, context_of(records, record.ref)))
    edges = EdgeReader(records)
    shells = _read_shells(records, edges, record, findings)
    if units is None or not shells or not any(shell.faces for shell in shells):
        return None
    for shell in shells:
        _check_closed(shell, findings)
    _check_separate(shells, findings)
    origin, size = _extent(records, edges)
    allowed = _allowed(units, size)
    for edge in edges.edges.values():
        if not edge.gap <= allowed:
            findings.defects.append(
                f"the curve of the edge {edge.ref} misses its vertex {edge.start} or {edge.end} "
                f"by {edge.gap:.2g}"
            )
    judged: list[tuple[Shell, JudgedFace]] = []
    for shell in shells:
        for face in shell.faces:
            found = findings.attempt(_judging(records, face, units.radian, origin, allowed))
            if found is not None:
                judged.append((shell, found))
                findings.attempt(partial(check_pcurves, records, found, units.radian, allowed))
    complete = len(judged) == sum(len(shell.faces) for shell in shells)
    solid = _sum_up(record, units, size, shells, judged, origin, edges, complete)
    _check_shells(shells, judged, complete, findings)
    _remark_gaps(solid, findings)
    return solid


def _judging(
    records: Records, face: Face, radian: float, origin: Array, allowed: float
) -> Callable[[], JudgedFace]:
    def judge() -> JudgedFace:
        found = judge_face(records, face, radian, origin, allowed)
        if not np.isfinite([found.moments.area, found.moments.volume]).all():
            raise StepDefectError(f"the face {face.label} has no finite area")
        return found

    return judge


def _allowed(units: Units, size: float) -> float:
    stated = UNSTATED * size if units.uncertainty is None else units.uncertainty
    # an uncertainty of the part's own size is no licence
    return max(min(TIMES * stated, 1e-3 * size), LOOSE * size)


def _edge_gap(faces: list[JudgedFace], units: Units, size: float) -> tuple[float, Evidence]:
    """Return the largest distance of edges from surfaces: a bound, if it says no more than that."""
    seen = max((face.gap for face in faces), default=0.0)
    bound = max((face.gap_bound for face in faces), default=0.0)
    stated = UNSTATED * size if units.uncertainty is None else units.uncertainty
    sharp = bound <= max(stated, 2.0 * seen + ROUNDING * size)
    return (bound, "bounded") if sharp else (seen, "sampled")


def _remark_gaps(solid: Solid, findings: Findings) -> None:
    stated = solid.units.uncertainty
    if stated is not None and stated > 1e-4 * solid.size:
        findings.loose.append(
            f"the file states an uncertainty of {stated:.3g}, which says nothing of a part of size "
            f"{solid.size:.3g}"
        )
    for what, gap in (("its vertex", solid.vertex_gap), ("its surface", solid.edge_gap)):
        if gap > solid.uncertainty + ROUNDING * solid.size:
            findings.loose.append(
                f"an edge is {gap:.2g} off {what}; the stated uncertainty is "
                f"{solid.uncertainty:.2g}"
            )


def _read_shells(
    records: Records, edges: EdgeReader, solid: Record, findings: Findings
) -> list[Shell]:
    shells: list[Shell] = []

    def read() -> None:
        keyword = solid.keyword
        values = solid.values(3 if keyword == "BREP_WITH_VOIDS" else 2)
        shells.append(_read_shell(records, edges, values[1], 1.0, findings))
        for void in sequence(values[2]) if keyword == "BREP_WITH_VOIDS" else ():
            oriented = records.get(void, "ORIENTED_CLOSED_SHELL").values(4)
            sign = 1.0 if is_true(oriented[3]) else -1.0
            shells.append(_read_shell(records, edges, oriented[2], sign, findings, void=True))

    findings.attempt(read)
    return shells


def _read_shell(
    records: Records, edges: EdgeReader, ref: Any, sign: float, findings: Findings, *,
    void: bool = False,
) -> Shell:  # fmt: skip
    _, refs = records.get(ref, "CLOSED_SHELL").values(2)[:2]
    refs = sequence(refs)
    if not refs:
        raise StepDefectError(f"the shell {ref} has no face")
    if len(set(refs)) != len(refs):
        twice = Counter(refs).most_common(1)[0][0]
        raise StepDefectError(f"the shell {ref} lists the face {twice} twice")
    read = [findings.attempt(partial(read_face, records, edges, face)) for face in refs]
    return Shell(ref, sign, void, tuple(face for face in read if face is not None))


def _check_closed(shell: Shell, findings: Findings) -> None:
    """Ask for each edge once forward and once reversed, and for one connected piece."""
    uses = Counter(
        (edge.ref, forward)
        for face in shell.faces
        for loop in face.loops
        for edge, forward in loop.edges
    )
    wrong = []
    for edge in sorted({edge for edge, _ in uses}):
        forward, reverse = uses[edge, True], uses[edge, False]
        if (forward, reverse) != (1, 1):
            state = "open" if forward + reverse < 2 else "not consistently oriented"
            wrong.append(
                f"the shell {shell.ref} is {state}: the edge {edge} is used {forward} times "
                f"forward and {reverse} times reversed; once each is needed"
            )
    findings.defects += wrong[:5]
    if len(wrong) > 5:
        findings.defects.append(f"{len(wrong) - 5} more edges of {shell.ref} are not used so")
    groups: list[set[Ref]] = []
    for face in shell.faces:
        own = {edge.ref for loop in face.loops for edge, _ in loop.edges} or {face.ref}
        touching = [group for group in groups if group & own]
        groups = [group for group in groups if not group & own] + [own.union(*touching)]
    if len(groups) > 1:
        findings.defects.append(
            f"the shell {shell.ref} falls into {len(groups)} unconnected pieces"
        )


def _check_separate(shells: list[Shell], findings: Findings) -> None:
    seen: set[Ref] = set()
    for shell in shells:
        own = shell.edge_refs() | {face.ref for face in shell.faces}
        if seen & own:
            findings.defects.append(
                f"the shell {shell.ref} shares {min(seen & own)} with another shell of its solid"
            )
        seen |= own


def _extent(records: Records, edges: EdgeReader) -> tuple[Array, float]:
    """Return a reference point near the solid, and the solid's size."""
    places = [edge.samples for edge in edges.edges.values()]
    if not places:
        points = [r.part("CARTESIAN_POINT", 2)[1] for r in records.all_of("CARTESIAN_POINT")]
        places = [np.array([point for point in points if len(point) == 3], dtype=float)]
    cloud = np.concatenate(places)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    return 0.5 * (low + high), float(np.linalg.norm(high - low))


def _check_shells(
    shells: list[Shell], judged: list[tuple[Shell, JudgedFace]], complete: bool, findings: Findings
) -> None:
    """Hold shells against what they enclose: an outer one its volume, a void nothing outside."""
    if not complete:
        return
    boxes = {}
    for shell in shells:
        volume = shell.sign * sum(face.moments.volume for s, face in judged if s is shell)
        if not shell.void and volume <= 0.0:
            findings.defects.append(
                f"the outer shell {shell.ref} is inside out (volume {volume:.6g})"
            )
        if shell.void and volume >= 0.0:
            findings.defects.append(
                f"the void {shell.ref} with its orientation adds {volume:.6g} to the volume: its "
                "normals point out of the void"
            )
        samples = [e.samples for face in shell.faces for loop in face.loops for e, _ in loop.edges]
        if samples:
            cloud = np.concatenate(samples)
            boxes[shell.ref] = shell.void, cloud.min(axis=0), cloud.max(axis=0)
    outer = [box for box in boxes.values() if not box[0]]
    for ref, (void, low, high) in boxes.items():
        slack = 1e-6 * float(np.linalg.norm(high - low))
        if void and outer and len(judged) and _polyhedral(shells[0], judged) and (
            np.any(low < outer[0][1] - slack) or np.any(high > outer[0][2] + slack)
        ):  # fmt: skip
            findings.defects.append(f"the void {ref} reaches out of the outer shell")


def _polyhedral(shell: Shell, judged: list[tuple[Shell, JudgedFace]]) -> bool:
    """Say whether a shell is in the box of its edges: all its faces are plane."""
    return all(face.frame is not None for s, face in judged if s is shell)


def _sum_up(
    record: Record, units: Units, size: float, shells: list[Shell],
    judged: list[tuple[Shell, JudgedFace]], origin: Array, edges: EdgeReader, complete: bool,
) -> Solid:  # fmt: skip
    volume = float(sum(shell.sign * face.moments.volume for shell, face in judged))
    area = float(sum(face.moments.area for _, face in judged))
    stokes = sum(face.stokes * face.moments.area for _, face in judged)
    area_error = sum(face.moments.error * face.moments.area for _, face in judged)
    centroid = None
    if complete and volume > 0.0:
        moment = np.sum([shell.sign * face.moments.moment for shell, face in judged], axis=0)
        centroid = origin + moment / volume
    edge_gap, rests_on = _edge_gap([face for _, face in judged], units, size)
    slacks = [slack_of(face, origin) for _, face in judged]
    volume_bound = sum(slack.volume for slack in slacks)
    centroid_bound = np.inf
    if centroid is not None and volume > volume_bound:
        lever = float(np.linalg.norm(centroid - origin)) * volume_bound
        moments = 3.0**0.5 * sum(slack.moment for slack in slacks)
        centroid_bound = (moments + lever) / (volume - volume_bound)
    return Solid(
        name=str(record.values(1)[0] or ""),
        ref=record.ref,
        units=units,
        size=size,
        shells=tuple(shells),
        faces=tuple(face for _, face in judged),
        edges=len(edges.edges),
        vertices=len(edges.vertices),
        vertex_gap=max((edge.gap for edge in edges.edges.values()), default=0.0),
        edge_gap=edge_gap,
        gaps_rest_on=rests_on,
        volume=volume if complete else None,
        area=area if complete else None,
        centroid=centroid,
        volume_error=float(stokes * size / max(abs(volume), 1e-300)),
        area_error=float(area_error / max(area, 1e-300)),
        origin=origin,
        volume_bound=volume_bound,
        area_bound=sum(slack.area for slack in slacks),
        centroid_bound=centroid_bound,
    )
