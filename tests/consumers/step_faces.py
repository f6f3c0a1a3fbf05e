"""Faces of a STEP file: each is held against the theorem of Stokes along its own edges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .step_bsplines import BSplineSurface
from .step_edges import EdgeReader, Wire
from .step_parse import StepDefect, StepGraph, StepUnsupported, Vector, is_true
from .step_patch import (
    Askew,
    Moments,
    patch_moments,
    rectangles,
    trace_edge,
    trimmed_moments,
    winding,
)
from .step_surfaces import Spun, Surface, read_surface


@dataclass(frozen=True)
class Limits:
    """What is tolerated: gaps as lengths, Stokes residuals relative to area and extent."""

    gap: float
    stokes: float


@dataclass(frozen=True)
class Face:
    """A face as it stands in the file, before its geometry is judged."""

    ref: str
    name: str
    carrier: str
    surface: str
    same_sense: bool
    wires: tuple[Wire, ...]


@dataclass(frozen=True)
class FaceResult:
    """Integrals of a face along its normal, and how well its edges agree with it."""

    moments: Moments
    stokes: float
    edge_gap: float


def read_face(graph: StepGraph, edges: EdgeReader, ref: Any) -> Face:
    """The topology of an ADVANCED_FACE."""
    name, bounds, surface, same_sense = graph.get(ref, "ADVANCED_FACE", "FACE_SURFACE").values
    carrier = graph.get(surface).keyword
    if "B_SPLINE_SURFACE" in carrier:
        carrier = "B_SPLINE_SURFACE"
    wires = tuple(edges.wire(bound) for bound in bounds)
    return Face(ref, str(name), carrier, surface, is_true(same_sense), wires)


def judge_face(
    graph: StepGraph, face: Face, radian: float, origin: Vector, limits: Limits
) -> FaceResult:
    """Integrals of one face; raises StepDefect if its edges contradict its surface."""
    if face.carrier == "PLANE":
        place, axes = graph.frame(graph.get(face.surface).values[1])
        return _judge_plane(face, place, axes, origin, limits)
    surface = read_surface(graph, face.surface, radian)
    try:
        return _judge_patch(surface, face, origin, limits)
    except Askew:
        return _judge_trimmed(surface, face, origin, limits)
    except StepUnsupported:
        frame = surface.flat_frame() if isinstance(surface, BSplineSurface) else None
        if frame is None:
            raise
        return _judge_plane(face, *frame, origin, limits)


def _corner(face: Face) -> Vector:
    wire = face.wires[0]
    return wire.edges[0][0].samples[0] if wire.edges else np.asarray(wire.vertex)


def _circulation(face: Face, corner: Vector) -> tuple[Vector, Vector]:
    """Area vector and traceless first moments of any surface with these edges as its border."""
    flows = [wire.flow for wire in face.wires]
    places = np.concatenate([flow[0] for flow in flows]) - corner
    swept = np.cross(places, np.concatenate([flow[1] for flow in flows]))
    return 0.5 * swept.sum(axis=0), swept.T @ places / 3.0


def _residual(face: Face, moments: Moments, corner: Vector, extent: float) -> float:
    vector, first = _circulation(face, corner)
    traceless = moments.first - np.eye(3) * (np.trace(moments.first) / 3.0)
    return max(
        float(np.linalg.norm(vector - moments.vector) / moments.area),
        float(np.linalg.norm(first - traceless) / (moments.area * extent)),
    )


def _require_stokes(face: Face, moments: Moments, residual: float, limit: float) -> None:
    if residual <= limit:
        return
    vector = _circulation(face, _corner(face))[0]
    against = np.linalg.norm(vector + moments.vector) < np.linalg.norm(vector - moments.vector)
    hint = "is flipped: its edges run against its normal" if against else "does not fit its edges"
    raise StepDefect(
        f"Face {face.ref} ({face.carrier}) {hint}; "
        f"the theorem of Stokes fails by {residual:.2g} (limit {limit:.0e})."
    )


def _judge_patch(surface: Surface, face: Face, origin: Vector, limits: Limits) -> FaceResult:
    if isinstance(surface, Spun) and surface.crosses_axis():
        raise StepUnsupported(
            f"The swept curve of face {face.ref} crosses its axis: "
            "which of the two coinciding parts is meant is not said."
        )
    edges = {edge.ref: edge for wire in face.wires for edge, _ in wire.edges}
    traced = {ref: trace_edge(surface, edge, limits.gap, face.ref) for ref, edge in edges.items()}
    gaps = [gap for _, gap in traced.values()]
    for wire in face.wires:
        if wire.vertex is not None:
            u, v = surface.locate(wire.vertex[None])
            gaps.append(float(np.linalg.norm(surface.at(u, v)[0] - wire.vertex)))
    if max(gaps) > limits.gap:
        raise StepDefect(f"The vertex of face {face.ref} is {max(gaps):.2g} off its surface.")
    corner, best = _corner(face), None
    sign = 1.0 if face.same_sense else -1.0
    for rectangle in rectangles(surface, [trace for trace, _ in traced.values()]):
        plain = patch_moments(surface, rectangle, origin, corner)
        moments = Moments(
            plain.area,
            sign * plain.vector,
            sign * plain.first,
            sign * plain.volume,
            sign * plain.moment,
        )
        residual = _residual(face, moments, corner, plain.area**0.5)
        if best is None or residual < best.stokes:
            best = FaceResult(moments, residual, max(gaps))
    if best is None:
        raise StepUnsupported(
            f"The edges of face {face.ref} ({face.carrier}) do not bound a parameter rectangle "
            "of its surface: trimmed face not supported."
        )
    _require_stokes(face, best.moments, best.stokes, limits.stokes)
    for wire in face.wires:
        around = winding([(traced[edge.ref][0], forward) for edge, forward in wire.edges])
        if sign * around < 0.0:
            raise StepDefect(
                f"A wire of face {face.ref} ({face.carrier}) is flipped: it runs clockwise "
                "around the normal in the parameter plane."
            )
    return best


def _judge_trimmed(surface: Surface, face: Face, origin: Vector, limits: Limits) -> FaceResult:
    """A face whose edges run along no parameter: integrals along its edges."""
    flow = tuple(np.concatenate([wire.flow[k] for wire in face.wires]) for k in (0, 1))
    samples = np.concatenate([edge.samples for wire in face.wires for edge, _ in wire.edges])
    u, v = surface.locate(samples)
    gap = float(np.linalg.norm(surface.at(u, v)[0] - samples, axis=1).max())
    if not gap <= limits.gap:
        raise StepDefect(f"An edge leaves the surface of face {face.ref} by {gap:.2g}.")
    corner, best = _corner(face), None
    sign = 1.0 if face.same_sense else -1.0
    for level in (float(np.mean(v)), *(x for x in surface.limits[1] if np.isfinite(x))):
        moments = trimmed_moments(surface, (flow[0], flow[1]), level, origin, corner)
        moments = replace(moments, area=sign * moments.area)
        if moments.area <= 0.0:
            continue
        residual = _residual(face, moments, corner, moments.area**0.5)
        if best is None or residual < best.stokes:
            best = FaceResult(moments, residual, gap)
    if best is None:
        raise StepDefect(f"Face {face.ref} ({face.carrier}) is flipped: it has no area.")
    _require_stokes(face, best.moments, best.stokes, limits.stokes)
    return best


def _judge_plane(
    face: Face, place: Vector, axes: Vector, origin: Vector, limits: Limits
) -> FaceResult:
    if not face.same_sense:
        axes = axes[[1, 0, 2]] * np.array([[1.0], [1.0], [-1.0]])
    gap = 0.0
    for wire in face.wires:
        if not wire.edges:
            raise StepDefect(f"Plane face {face.ref} has a wire without edges.")
        for edge, _ in wire.edges:
            off = max(
                np.abs((part - place) @ axes[2]).max() for part in (edge.samples, edge.places)
            )
            gap = max(gap, float(off))
            if off > limits.gap:
                raise StepDefect(
                    f"Edge {edge.ref} leaves the plane of face {face.ref} by {off:.2g}."
                )
    corner = _corner(face)
    sums = [_plane_sums(wire, corner, axes) for wire in face.wires]
    _require_wires(face, [part[0] for part in sums])
    moments = _plane_moments(np.sum(sums, axis=0), corner, origin, place, axes)
    residual = _residual(face, moments, corner, moments.area**0.5)
    _require_stokes(face, moments, residual, limits.stokes)
    return FaceResult(moments, residual, gap)


def _require_wires(face: Face, areas: list[float]) -> None:
    outer = [area for area in areas if area > 0.0]
    if sum(areas) <= 0.0 or not outer:
        raise StepDefect(
            f"Face {face.ref} (PLANE) is flipped: its wires run against its normal "
            f"(area {sum(areas):.6g} along it)."
        )
    if len(outer) > 1:
        raise StepDefect(f"Face {face.ref} (PLANE) has {len(outer)} outer wires; one is needed.")


def _plane_sums(wire: Wire, corner: Vector, axes: Vector) -> Vector:
    """Integrals of 1, a, b, a^2, ab, b^2 over what the wire encloses in plane coordinates."""
    places, steps = wire.flow
    a, b, _ = ((places - corner) @ axes.T).T
    db = steps @ axes[1]
    powers = [a, a**2 / 2.0, a * b, a**3 / 3.0, a**2 * b / 2.0, a * b**2]
    return np.array(powers) @ db


def _plane_moments(
    sums: Vector, corner: Vector, origin: Vector, place: Vector, axes: Vector
) -> Moments:
    area, a, b, aa, ab, bb = sums
    x, y, z = axes
    centre = a * x + b * y
    offset = corner + ((place - corner) @ z) * z - origin
    squares = offset**2 * area + 2.0 * offset * centre + aa * x**2 + 2.0 * ab * x * y + bb * y**2
    volume = (offset @ z) * area / 3.0
    return Moments(area, area * z, np.outer(z, centre), volume, z * squares / 2.0)
