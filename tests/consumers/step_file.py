"""A check of a STEP file that no geometry kernel takes part in.

It reads one solid (MANIFOLD_SOLID_BREP or BREP_WITH_VOIDS) with numpy and a Part 21 parser only,
and raises StepDefect with a sentence if edges, wires, faces or shells contradict each other.

For every face two consequences of the theorem of Stokes are held against its edges: the area
vector, and the first moments of the normal (nine numbers less their trace), which also see a
flipped face whose area vector is zero, such as the side of a full cylinder. Both depend on the
border of the face only: a control point moved in the INNER of a face changes the volume but no
border, so it is found by comparing the volume, here with the validation properties of the file.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .step_edges import EdgeReader
from .step_faces import Face, FaceResult, Limits, judge_face, read_face
from .step_parse import Record, StepDefect, StepGraph, StepUnsupported, Vector, is_true, read_graph
from .step_units import ValidationProperties, unit_scale, validation_properties

__all__ = [
    "StepDefect", "StepFace", "StepSolid", "StepUnsupported", "check_solids", "check_step",
]  # fmt: skip


@dataclass(frozen=True)
class StepFace:
    """A face's name, the keyword of its surface, and its area."""

    name: str
    carrier: str
    area: float


@dataclass(frozen=True)
class StepSolid:
    """A sound solid; all lengths in the file's own unit, which unit_m gives in metres."""

    volume: float
    area: float
    centroid: tuple[float, float, float]
    shells: int
    faces: tuple[StepFace, ...]
    edges: int
    vertices: int
    unit_m: float
    properties: ValidationProperties
    max_stokes_residual: float
    max_vertex_gap: float
    max_edge_gap: float

    @property
    def volume_mm3(self) -> float:
        """The volume in cubic millimetres, as the other readers of this package report it."""
        return self.volume * (self.unit_m * 1e3) ** 3

    @property
    def area_mm2(self) -> float:
        """The area in square millimetres."""
        return self.area * (self.unit_m * 1e3) ** 2

    @property
    def centroid_mm(self) -> tuple[float, float, float]:
        """The centroid in millimetres."""
        x, y, z = (part * self.unit_m * 1e3 for part in self.centroid)
        return x, y, z


@dataclass(frozen=True)
class _Shell:
    ref: str
    sign: float
    faces: tuple[Face, ...]


def check_step(
    path: str | Path,
    *,
    stokes_limit: float = 1e-9,
    gap_limit: float = 1e-9,
    properties_limit: float = 1e-6,
) -> StepSolid:
    """Check the one solid of a STEP file; gap_limit is relative to the solid's size."""
    graph = read_graph(path)
    solids, context = _solids(graph)
    if len(solids) != 1:
        raise StepDefect(f"The file holds {len(solids)} solids; one is needed.")
    found, size = _check(graph, solids[0], context, stokes_limit, gap_limit)
    stated = found.properties
    for name, figure, own in (
        ("volume", stated.volume, found.volume), ("area", stated.area, found.area)
    ):  # fmt: skip
        _require_property(name, figure, own, properties_limit)
    _require_centroid(stated, np.array(found.centroid), size, properties_limit)
    return found


def check_solids(path: str | Path, *, limit: float = 1e-9) -> dict[str, StepSolid]:
    """Check each solid of a part of several, by name, and volume and centroid of them together."""
    graph = read_graph(path)
    solids, context = _solids(graph)
    checked = {str(solid.values[0]): _check(graph, solid, context, limit, limit)
               for solid in solids}  # fmt: skip
    if len(checked) != len(solids):
        raise StepDefect("Two solids of the file have one name.")
    found = {name: solid for name, (solid, _) in checked.items()}
    volume = sum(solid.volume for solid in found.values())
    centroid = sum(solid.volume * np.array(solid.centroid) for solid in found.values()) / volume
    (*_, stated) = (solid.properties for solid in found.values())
    _require_property("volume", stated.volume, volume, 1e-6)
    _require_centroid(stated, centroid, max(size for _, size in checked.values()), 1e-6)
    return found


def _check(
    graph: StepGraph, solid: Record, context: Any, stokes_limit: float, gap_limit: float
) -> tuple[StepSolid, float]:
    """Return one sound solid and its size."""
    metres = unit_scale(graph, context, "LENGTH_UNIT")
    radian = unit_scale(graph, context, "PLANE_ANGLE_UNIT")
    edges = EdgeReader(graph)
    shells = _read_shells(graph, edges, solid)
    for shell in shells:
        _require_closed(shell)
    _require_separate(shells)
    origin, size = _extent(graph, edges)
    _require_vertices(edges, gap_limit * size)
    limits = Limits(gap_limit * size, stokes_limit)
    judged = [
        [judge_face(graph, face, radian, origin, limits) for face in shell.faces]
        for shell in shells
    ]
    _require_shell_signs(shells, judged)
    volume, area, centroid = _sum_up(shells, judged, origin)
    properties = validation_properties(graph, metres)
    results = [result for results in judged for result in results]
    found = StepSolid(
        volume=volume,
        area=area,
        centroid=(float(centroid[0]), float(centroid[1]), float(centroid[2])),
        shells=len(shells),
        faces=tuple(_step_faces(shells, judged)),
        edges=len(edges.edges),
        vertices=len(edges.vertices),
        unit_m=metres,
        properties=properties,
        max_stokes_residual=float(max(result.stokes for result in results)),
        max_vertex_gap=max([edge.gap for edge in edges.edges.values()], default=0.0),
        max_edge_gap=float(max(result.edge_gap for result in results)),
    )
    return found, size


def _solids(graph: StepGraph) -> tuple[list[Record], Any]:
    """The solids of the file's one product, and the context of the representation they are in."""
    kinds = ("MANIFOLD_SOLID_BREP", "BREP_WITH_VOIDS", "FACETED_BREP")
    solids = [record for kind in kinds for record in graph.all_of(kind)]
    products = graph.all_of("PRODUCT")
    if not solids or len(products) != 1:
        raise StepDefect(
            f"The file holds {len(products)} products and {len(solids)} solids; one each is needed."
        )
    for holder in graph.all_of("ADVANCED_BREP_SHAPE_REPRESENTATION"):
        _, items, context = holder.values
        if all(solid.ref in items for solid in solids):
            return solids, context
    raise StepDefect(f"No ADVANCED_BREP_SHAPE_REPRESENTATION holds the solid {solids[0].ref}.")


def _read_shells(graph: StepGraph, edges: EdgeReader, solid: Record) -> list[_Shell]:
    outer, *voids = solid.values[1:]
    shells = [_read_shell(graph, edges, outer, 1.0)]
    for void in voids[0] if voids else ():
        *_, element, flag = graph.get(void, "ORIENTED_CLOSED_SHELL").values
        shells.append(_read_shell(graph, edges, element, 1.0 if is_true(flag) else -1.0))
    return shells


def _read_shell(graph: StepGraph, edges: EdgeReader, ref: Any, sign: float) -> _Shell:
    _, refs = graph.get(ref, "CLOSED_SHELL").values
    if len(set(refs)) != len(refs) or not refs:
        raise StepDefect(f"Shell {ref} is empty or lists a face twice.")
    return _Shell(str(ref), sign, tuple(read_face(graph, edges, face) for face in refs))


def _require_closed(shell: _Shell) -> None:
    """Each edge once forward and once reversed, and the faces in one connected piece."""
    uses = Counter(
        (edge.ref, forward)
        for face in shell.faces
        for wire in face.wires
        for edge, forward in wire.edges
    )
    for edge in {edge for edge, _ in uses}:
        forward, reverse = uses[edge, True], uses[edge, False]
        if (forward, reverse) != (1, 1):
            state = "open" if forward + reverse < 2 else "not consistently oriented"
            raise StepDefect(
                f"Shell {shell.ref} is {state}: edge {edge} is used {forward} times forward and "
                f"{reverse} times reversed; once each is needed."
            )
    groups: list[set[str]] = []
    for face in shell.faces:
        own = {edge.ref for wire in face.wires for edge, _ in wire.edges} or {face.ref}
        touching = [group for group in groups if group & own]
        groups = [group for group in groups if not group & own] + [own.union(*touching)]
    if len(groups) > 1:
        raise StepDefect(f"Shell {shell.ref} falls into {len(groups)} unconnected pieces.")


def _require_separate(shells: list[_Shell]) -> None:
    seen: set[str] = set()
    for shell in shells:
        own = {edge.ref for face in shell.faces for wire in face.wires for edge, _ in wire.edges}
        own |= {face.ref for face in shell.faces}
        if seen & own:
            raise StepDefect(f"Shell {shell.ref} shares {min(seen & own)} with another shell.")
        seen |= own


def _extent(graph: StepGraph, edges: EdgeReader) -> tuple[Vector, float]:
    """A reference point near the solid, and the solid's size."""
    places = [edge.samples for edge in edges.edges.values()]
    if not places:
        every = [record.values[1] for record in graph.all_of("CARTESIAN_POINT")]
        places = [np.array([point for point in every if len(point) == 3], dtype=float)]
    cloud = np.concatenate(places)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    return 0.5 * (low + high), float(np.linalg.norm(high - low))


def _require_vertices(edges: EdgeReader, limit: float) -> None:
    for edge in edges.edges.values():
        if not edge.gap <= limit:
            raise StepDefect(
                f"The curve of edge {edge.ref} misses its vertex {edge.start} or {edge.end} "
                f"by {edge.gap:.2g}."
            )


def _require_shell_signs(shells: list[_Shell], judged: list[list[FaceResult]]) -> None:
    """The outer shell encloses its volume; a void's normals point into the void."""
    for number, (shell, results) in enumerate(zip(shells, judged, strict=True)):
        volume = shell.sign * sum(result.moments.volume for result in results)
        if number == 0 and volume <= 0.0:
            raise StepDefect(f"The outer shell {shell.ref} is inside out (volume {volume:.6g}).")
        if number > 0 and volume >= 0.0:
            raise StepDefect(
                f"The void shell {shell.ref} with its orientation flag adds {volume:.6g} to the "
                "volume: its normals point out of the void."
            )


def _sum_up(
    shells: list[_Shell], judged: list[list[FaceResult]], origin: Vector
) -> tuple[float, float, Vector]:
    signed = [
        (shell.sign, result.moments)
        for shell, results in zip(shells, judged, strict=True)
        for result in results
    ]
    volume = float(sum(sign * moments.volume for sign, moments in signed))
    area = float(sum(moments.area for _, moments in signed))
    if volume <= 0.0:
        raise StepDefect(f"The voids are larger than the outer shell (volume {volume:.6g}).")
    moment = np.sum([sign * moments.moment for sign, moments in signed], axis=0)
    return volume, area, origin + moment / volume


def _require_property(name: str, stated: float | None, own: float, limit: float) -> None:
    if stated is not None and not abs(stated - own) <= limit * own:
        raise StepDefect(f"The file states the {name} {stated:.12g}, its faces give {own:.12g}.")


def _require_centroid(
    found: ValidationProperties, centroid: Vector, size: float, limit: float
) -> None:
    if found.centroid is not None:
        off = float(np.linalg.norm(np.array(found.centroid) - centroid))
        if not off <= limit * size:
            raise StepDefect(f"The centroid stated in the file is {off:.2g} off that of its faces.")


def _step_faces(shells: list[_Shell], judged: list[list[FaceResult]]) -> list[StepFace]:
    return [
        StepFace(face.name, face.carrier, float(result.moments.area))
        for shell, results in zip(shells, judged, strict=True)
        for face, result in zip(shell.faces, results, strict=True)
    ]
