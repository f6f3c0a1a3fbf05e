"""Faces of a STEP file: each is held against the theorem of Stokes along its own edges.

For every face two consequences of the theorem are asked of its edges: the area vector, and the
first moments of the normal (nine numbers less their trace), which also see a face that is turned
over although its area vector is zero, such as the side of a full cylinder. Both depend on the
border of the face only: what is wrong inside it changes the volume.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import product
from pc2cad.verify.defects import StepDefectError, StepOrientationError, StepUnknownError
from pc2cad.verify.edges import Edge, EdgeReader, Loop
from pc2cad.verify.exchange import Ref
from pc2cad.verify.following import follow, trimmed_moments
from pc2cad.verify.gaps import Frame, gap_bound, line_bound
from pc2cad.verify.patches import (
    AskewError,
    Moments,
    Rectangle,
    closed_moments,
    on_border,
    patch_moments,
    rectangles,
    trace_edge,
    winding,
)
from pc2cad.verify.records import Records, is_true
from pc2cad.verify.splines import SplineSurface
from pc2cad.verify.surfaces import Round, Spun, Surface, read_surface

#: relative residual of the theorem of Stokes that rounding and quadrature explain
STOKES = 1e-9
#: how often all of a closed surface may be missing from what edges run round
MOST_WHOLE = 2


@dataclass(frozen=True, eq=False)
class Face:
    """A face as it stands in the file, before its geometry is judged."""

    ref: Ref
    name: str
    #: keyword of its surface
    carrier: str
    surface: Ref
    same_sense: bool
    loops: tuple[Loop, ...]

    @property
    def label(self) -> str:
        """What it is called in a sentence."""
        return f"'{self.name}' ({self.ref})" if self.name else str(self.ref)

    @property
    def edges(self) -> dict[Ref, Edge]:
        """Its edges, each once, in the order of its loops."""
        return {edge.ref: edge for loop in self.loops for edge, _ in loop.edges}


@dataclass(frozen=True, eq=False)
class JudgedFace:
    """A face that agrees with its edges."""

    face: Face
    #: integrals along its normal
    moments: Moments
    #: None for a plane, whose origin and axes (normal last) are in `frame`
    surface: Surface | None
    #: the parameters that it covers; None where it is trimmed by its edges
    rectangle: Rectangle | None
    frame: tuple[Array, Array] | None
    stokes: float
    #: the largest distance of its edges from its surface that was seen, and a bound of all
    gap: float
    gap_bound: float = np.inf
    #: a bound of the distance of its edges from the border of the rectangle
    border: float = np.inf


def read_face(records: Records, edges: EdgeReader, ref: Any) -> Face:
    """Return the topology of an ADVANCED_FACE or FACE_SURFACE."""
    values = records.get(ref, "ADVANCED_FACE", "FACE_SURFACE").values(4)
    name, bounds, surface, same_sense = values[:4]
    carrier = records.get(surface).keyword
    if "B_SPLINE_SURFACE" in carrier:
        carrier = "B_SPLINE_SURFACE"
    if not isinstance(bounds, tuple) or not bounds:
        raise StepDefectError(f"the face {ref} has no bound")
    loops = tuple(edges.loop(bound) for bound in bounds)
    return Face(ref, str(name or ""), carrier, surface, is_true(same_sense), loops)


def judge_face(
    records: Records, face: Face, radian: float, origin: Array, limit: float
) -> JudgedFace:
    """Return a face with its integrals; raise StepDefectError if its edges contradict it.

    `limit` is the largest distance of its edges from its surface.
    """
    if face.carrier == "PLANE":
        frame = records.frame(records.get(face.surface).values(2)[1])
        return _judge_plane(face, frame, origin, limit)
    surface = read_surface(records, face.surface, radian)
    parts = surface.parts() if isinstance(surface, Spun) else [surface]
    if len(parts) == 1:
        return _judge_curved(surface, face, origin, limit)
    found: list[JudgedFace] = []
    refused: StepDefectError = StepUnknownError("")
    for part in parts:  # halves that coincide have opposite normals: one of them fits at most
        try:
            found.append(_judge_curved(part, face, origin, limit))
        except StepDefectError as error:
            refused = error
    if len(found) > 1:
        raise StepUnknownError(
            f"the swept curve of the face {face.label} crosses its axis: which of the parts is "
            "meant is not said"
        )
    if not found:
        raise refused
    return found[0]


def _judge_curved(surface: Surface, face: Face, origin: Array, limit: float) -> JudgedFace:
    try:
        return _judge_patch(surface, face, origin, limit)
    except AskewError:
        if not isinstance(surface, SplineSurface):
            return judge_trimmed(surface, face, origin, limit)
        flat = surface.flat_frame()
        if flat is not None:
            return _judge_plane(face, flat, origin, limit)
        return judge_trimmed(surface, face, origin, limit)
    except StepUnknownError:
        flat = surface.flat_frame() if isinstance(surface, SplineSurface) else None
        if flat is not None:
            return _judge_plane(face, flat, origin, limit)
        if not any(loop.edges for loop in face.loops):
            raise
        return judge_trimmed(surface, face, origin, limit)


def _corner(face: Face) -> Array:
    loop = face.loops[0]
    return loop.edges[0][0].samples[0] if loop.edges else np.asarray(loop.vertex)


def _circulation(face: Face, corner: Array) -> tuple[Array, Array]:
    """Return area vector and traceless first moments of any surface with these edges as border."""
    flows = [loop.flow for loop in face.loops]
    places = np.concatenate([flow[0] for flow in flows]) - corner
    swept = np.cross(places, np.concatenate([flow[1] for flow in flows]))
    return 0.5 * swept.sum(axis=0), product(swept.T, places) / 3.0


def _residual(face: Face, moments: Moments, corner: Array, extent: float) -> float:
    vector, first = _circulation(face, corner)
    traceless = moments.first - np.eye(3) * (np.trace(moments.first) / 3.0)
    return max(
        float(np.linalg.norm(vector - moments.vector) / moments.area),
        float(np.linalg.norm(first - traceless) / (moments.area * extent)),
    )


def _explained(face: Face, moments: Moments, gap: float) -> float:
    """Return the residual that gaps between edges, vertices and surface explain, and rounding.

    A border that is moved by δ changes the area vector by at most its length times δ.
    """
    edges = [edge for loop in face.loops for edge, _ in loop.edges]
    border = sum(edge.length for edge in edges)
    gaps = 2.0 * max([gap, *(edge.gap for edge in edges)])
    reach = max(1.0, border / moments.area**0.5)
    return float(STOKES + min(moments.error, 1e-6) + gaps * border * reach / moments.area)


def _require_stokes(face: Face, judged: JudgedFace) -> JudgedFace:
    limit = _explained(face, judged.moments, judged.gap)
    if judged.stokes <= limit:
        return judged
    vector = _circulation(face, _corner(face))[0]
    own = judged.moments.vector
    size = float(np.linalg.norm(own))
    against = np.linalg.norm(vector + own) < 0.5 * np.linalg.norm(vector - own)
    if against and size > 1e-6 * judged.moments.area:
        raise StepOrientationError(
            f"the face {face.label} is turned over: its edges run against its normal"
        )
    raise StepDefectError(
        f"the face {face.label} ({face.carrier}) does not fit its edges, or is turned over: the "
        f"theorem of Stokes fails by {judged.stokes:.2g} of its area (its gaps explain {limit:.1g})"
    )


def _judge_patch(surface: Surface, face: Face, origin: Array, limit: float) -> JudgedFace:
    edges = face.edges
    traced = {r: trace_edge(surface, edge, limit, face.label) for r, edge in edges.items()}
    gaps = [gap for _, gap in traced.values()]
    gaps += [_vertex_gap(surface, loop.vertex) for loop in face.loops if loop.vertex is not None]
    if max(gaps) > limit:
        raise StepDefectError(
            f"a vertex of the face {face.label} is {max(gaps):.2g} off its surface"
        )
    corner, best = _corner(face), None
    sign = 1.0 if face.same_sense else -1.0
    for rectangle in rectangles(surface, [trace for trace, _ in traced.values()]):
        moments = patch_moments(surface, rectangle, origin, corner).times(sign)
        residual = _residual(face, moments, corner, moments.area**0.5)
        if best is None or residual < best.stokes:
            best = JudgedFace(face, moments, surface, rectangle, None, residual, max(gaps))
    if best is not None:
        # a loop that is one vertex has no more places than that
        along = {r: on_border(surface, best.rectangle, t) for r, (t, _) in traced.items()}
        proved = [gap_bound(surface, e, along[r], traced[r][1]) for r, e in edges.items()]
        borders = proved
        if isinstance(surface, Round):
            borders = [line_bound(surface, e, along[r], traced[r][1]) for r, e in edges.items()]
        best = replace(best, gap_bound=max(max(gaps), *proved, 0.0), border=max(0.0, *borders, 0.0))
    if best is None:
        raise AskewError(
            f"the edges of the face {face.label} ({face.carrier}) do not bound a rectangle of its "
            "parameters"
        )
    _require_stokes(face, best)
    for loop in face.loops:
        around = winding([(traced[edge.ref][0], forward) for edge, forward in loop.edges])
        if sign * around < 0.0 and not loop.is_free:
            raise StepOrientationError(
                f"the loop of the face {face.label} ({face.carrier}) is turned over: it runs "
                "clockwise around the normal in the parameter plane"
            )
    return best


def _vertex_gap(surface: Surface, vertex: Array) -> float:
    u, v = surface.locate(vertex[None])
    return float(np.linalg.norm(surface.at(u, v)[0] - vertex))


def judge_trimmed(surface: Surface, face: Face, origin: Array, limit: float) -> JudgedFace:
    """Judge a face whose edges run along no parameter: integrals along its edges."""
    flows = [flow for loop in face.loops for flow in loop.flows]
    if not flows:
        raise StepUnknownError(f"the face {face.label} ({face.carrier}) has no edges")
    samples = np.concatenate([edge.samples for loop in face.loops for edge, _ in loop.edges])
    u, v = surface.locate(samples)
    gap = float(np.linalg.norm(surface.at(u, v)[0] - samples, axis=1).max())
    if not gap <= limit:
        raise StepDefectError(f"an edge leaves the surface of the face {face.label} by {gap:.2g}")
    corner, best, edges = _corner(face), None, follow(surface, flows)
    sign = 1.0 if face.same_sense else -1.0
    whole = closed_moments(surface, origin, corner)
    levels = [(1, float(np.mean(v))), *((1, x) for x in surface.limits[1] if np.isfinite(x))]
    for inner in (*levels, (0, float(np.mean(u)))):
        moments = trimmed_moments(edges, inner, origin, corner)
        moments = replace(moments, area=sign * moments.area)
        for _ in range(MOST_WHOLE):
            if moments.area <= 0.0 and whole is not None:
                # the edges run round what the face leaves of a closed surface, and its seams
                # round the whole of it once more where they are followed to the other side
                moments = moments.plus(whole.times(sign))
        if moments.area <= 0.0:
            continue
        residual = _residual(face, moments, corner, moments.area**0.5)
        if best is None or residual < best.stokes:
            best = JudgedFace(face, moments, surface, None, None, residual, gap)
    if best is None:
        raise StepOrientationError(
            f"the face {face.label} ({face.carrier}) is turned over: it has no area"
        )
    if best.stokes > _explained(face, best.moments, gap):
        raise StepUnknownError(
            f"what the edges of the face {face.label} ({face.carrier}) leave of its surface could "
            f"not be found (the theorem of Stokes fails by {best.stokes:.2g})"
        )
    return replace(best, gap_bound=_gaps(surface, face, gap))


def _gaps(carrier: Surface | Frame, face: Face, seen: float) -> float:
    return max(gap_bound(carrier, edge, None, seen) for edge in face.edges.values())


def _judge_plane(face: Face, frame: Frame, origin: Array, limit: float) -> JudgedFace:
    place, axes = frame
    if not face.same_sense:
        axes = axes[[1, 0, 2]] * np.array([[1.0], [1.0], [-1.0]])
    gap = 0.0
    for loop in face.loops:
        if not loop.edges:
            raise StepDefectError(f"the plane face {face.label} has a loop without edges")
        for edge, _ in loop.edges:
            off = max(
                np.abs(product(part - place, axes[2])).max() for part in (edge.samples, edge.places)
            )
            gap = max(gap, float(off))
            if not off <= limit:
                raise StepDefectError(
                    f"the edge {edge.ref} leaves the plane of the face {face.label} by {off:.2g}"
                )
    corner = _corner(face)
    sums = [_plane_sums(loop, corner, axes) for loop in face.loops]
    _require_loops(face, [float(part[0]) for part in sums])
    moments = _plane_moments(np.sum(sums, axis=0), corner, origin, place, axes)
    residual = _residual(face, moments, corner, moments.area**0.5)
    judged = JudgedFace(face, moments, None, None, (place, axes), residual, gap)
    return _require_stokes(face, replace(judged, gap_bound=_gaps((place, axes), face, gap)))


def _require_loops(face: Face, areas: list[float]) -> None:
    outer = [area for area in areas if area > 0.0]
    if sum(areas) <= 0.0 or not outer:
        raise StepOrientationError(
            f"the plane face {face.label} is turned over: its loops run against its normal (area "
            f"{sum(areas):.6g} along it)"
        )
    if len(outer) > 1:
        raise StepOrientationError(
            f"the plane face {face.label} has {len(outer)} outer loops; one is needed"
        )


def _plane_sums(loop: Loop, corner: Array, axes: Array) -> Array:
    """Return integrals of 1, a, b, a², ab, b² over what a loop encloses in plane coordinates."""
    places, steps = loop.flow
    a, b, _ = product(places - corner, axes.T).T
    db = product(steps, axes[1])
    powers = [a, a**2 / 2.0, a * b, a**3 / 3.0, a**2 * b / 2.0, a * b**2]
    return product(np.array(powers), db)


def _plane_moments(sums: Array, corner: Array, origin: Array, place: Array, axes: Array) -> Moments:
    area, a, b, aa, ab, bb = sums
    x, y, z = axes
    centre = a * x + b * y
    offset = corner + ((place - corner) @ z) * z - origin
    squares = offset**2 * area + 2.0 * offset * centre + aa * x**2 + 2.0 * ab * x * y + bb * y**2
    volume = float(offset @ z * area / 3.0)
    return Moments(float(area), area * z, np.outer(z, centre), volume, z * squares / 2.0, 1e-15)
