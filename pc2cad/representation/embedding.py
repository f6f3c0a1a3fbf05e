"""Whether what is to be built meets itself: the boundary model's faces, compared as sheets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pc2cad.arrays.linear import product
from pc2cad.bounds.deviation import bound_surface
from pc2cad.checked import CheckedMap
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.expression.breaks import BreaksNotAlignedError
from pc2cad.expression.identity import Verdict
from pc2cad.expression.scalar import evaluate
from pc2cad.geometry.carriers import Line, Plane, SplineSurface
from pc2cad.geometry.sheets import OUTSIDE
from pc2cad.geometry.splines.bernstein import bezier_knots
from pc2cad.representation.boundary_model import BoundaryModel
from pc2cad.representation.face_sheets import edge_lines, sheets_of
from pc2cad.representation.plane_faces import coplanar_groups
from pc2cad.solidity.embedding.proof import TOUCHING
from pc2cad.solidity.embedding.verdict import Embedding, asked_about, check_embedded
from pc2cad.topology.cells import IDENTITY
from pc2cad.topology.complex import SideFate

#: degree in which the distance of two sides, which is zero, is looked at
_DEGREE = 7


def embed(
    checked: CheckedMap, model: BoundaryModel, doubt: Callable[[], object] = lambda: None
) -> Embedding:
    """Return what is known of whether the model's faces meet but where they are joined.

    `doubt` is called where that is not clear soon: it may know why and raise. Raises
    OverlappingMapError where the equation's do, BuiltFacesMeetError where only the model's.
    """
    found = _convex(checked.analysis, model) or _compared(checked.analysis, model, doubt)
    gap, names = _glued(checked.analysis)
    return replace(found, depth=max(found.depth, gap), sides=names)


def _convex(analysis: Analysis, model: BoundaryModel) -> Embedding | None:
    """Return that faces meet nowhere else, of plane faces that all others are on one side of.

    All corners that such a face has not are above its plane, by more than what is asked about. So
    another face, which is in the hull of its own corners, meets it in the hull of those that they
    have in common: none, one, or the ends of an edge that both have. None where this is not so.
    """
    if model.layers or any(analysis.apart):
        return None
    planes = [face.carrier for face in model.faces if isinstance(face.carrier, Plane)]
    straight = all(isinstance(edge.carrier, Line) for edge in model.edges)
    if len(planes) < len(model.faces) or not straight:
        return None
    if any(len(face.cells) > 1 or face.evidence == "sampled" for face in model.faces):
        return None
    uses = np.zeros((len(planes), len(model.edges)), dtype=bool)
    for index, face in enumerate(model.faces):
        uses[index, [edge for wire in face.wires for edge, _ in wire]] = True
    corners = np.zeros((len(planes), len(model.vertices)), dtype=bool)
    for ends in zip(*((edge.start, edge.end) for edge in model.edges), strict=True):
        for index, edges in enumerate(uses):
            corners[index, np.array(ends)[edges]] = True
    origins, normals = (
        np.array([getattr(plane, name) for plane in planes]) for name in ("origin", "normal")
    )
    heights = product(normals, model.vertices.T) - (normals * origins).sum(axis=1)[:, None]
    near = asked_about(analysis, [face.deviation for face in model.faces])
    beyond = [(corners | (sign * heights > near)).all(axis=1) for sign in (1, -1)]
    common, edges = (x.astype(int) @ x.T.astype(int) for x in (corners, uses))
    joined = (common <= 1) | ((common == 2) & (edges == 1))
    if not (beyond[0] | beyond[1]).all() or not (joined | np.eye(len(planes), dtype=bool)).all():
        return None
    return Embedding(True, len(planes), 0.0)


def _compared(analysis: Analysis, model: BoundaryModel, doubt: Callable[[], object]) -> Embedding:
    """Return what is found where all faces are compared as sheets."""
    sheets, left = sheets_of(model)
    regions, beside = _regions(analysis, model), _beside(model)
    sheets = [
        replace(sheet, region=regions.get(sheet.cell, -1), beside=beside[sheet.face])
        for sheet in sheets
    ]
    if left or any(face.evidence == "sampled" for face in model.faces):
        doubt()
    return check_embedded(
        analysis, sheets, edge_lines(model.edges, model.complex, model.vertices),
        [face.deviation for face in model.faces], [model.faces[i].name for i in left], doubt,
    )  # fmt: skip


def not_proved(checked: CheckedMap, model: BoundaryModel, embedding: Embedding) -> list[str]:
    """Return what keeps it from being proved that M covers no place twice."""
    found = []
    if not embedding.proved:
        found.append(f"nothing has separated {embedding.open}")
    if checked.orientation.verdict is not Verdict.PROVED:
        found.append("the sign of det J is sampled")
    if not checked.question.continuous:
        found.append("that M does not jump is sampled")
    sampled = [face.name for face in model.faces if face.evidence == "sampled"]
    if sampled:
        found.append(f"deviations from the equation are sampled: {', '.join(sampled)}")
    if embedding.sides:
        found.append(f"that sides collapse or coincide is sampled: {', '.join(embedding.sides)}")
    return found


def _beside(model: BoundaryModel) -> list[tuple[int, int]]:
    """Return what is on the two sides of each face."""
    found: list[list[int]] = [[] for _ in model.faces]
    for number, faces in enumerate([layer.faces for layer in model.layers] or [model.outer]):
        for face in faces:
            found[face].append(number)
    for face in model.outer:
        found[face].append(OUTSIDE)
    return [(one, other) for one, other in found]


def _regions(analysis: Analysis, model: BoundaryModel) -> dict[int, int]:
    """Return, for the cells of plane faces that were cut apart, what they were cut from.

    Between layers, too: each has its own face, and together they are one region.
    """
    if not any(analysis.apart) and not model.layers:
        return {}
    outward: list[Plane | None] = [None] * len(analysis.complex.faces)
    for face in model.faces:
        if isinstance(face.carrier, Plane):
            normal = -face.carrier.normal if face.reversed else face.carrier.normal
            for cell in face.cells:
                outward[cell] = Plane(face.carrier.origin, normal)
    groups = coplanar_groups(analysis, outward, across=True)
    return {cell: k for k, group in enumerate(groups) for cell in group if outward[cell]}


def _glued(analysis: Analysis) -> tuple[float, tuple[str, ...]]:
    """Return how far sides that algebra does not show to coincide are apart, proved.

    With it come the names of those of which it is only sampled that they coincide, or collapse.
    """
    largest, names = 0.0, []
    seen = set()
    for side in analysis.boundary.sides:
        if side.verdict is Verdict.PROVED or side.partner in seen:
            continue
        seen.add(side.patch)
        gap = _gap(analysis, side)
        if gap <= TOUCHING * analysis.size:
            largest = max(largest, gap)
        else:
            names += [analysis.boundary.name(p) for p in (side.patch, side.partner) if p]
    return largest, tuple(names)


def _gap(analysis: Analysis, side: SideFate) -> float:
    """Return a bound of the distance of a side from its partner, infinite where there is none."""
    if side.partner is None or side.symmetry != IDENTITY:
        return np.inf
    (first, names), (second, _) = (
        RestrictedMap(analysis, patch).trees for patch in (side.patch, side.partner)
    )
    knots = bezier_knots(_DEGREE)
    zero = SplineSurface((_DEGREE, _DEGREE), (knots, knots), np.zeros((_DEGREE + 1,) * 2 + (3,)))
    apart = tuple(a - b for a, b in zip(first, second, strict=True))
    if not any(each.symbols for each in apart):
        return float(np.linalg.norm([evaluate(each, {}) for each in apart]))
    try:
        return bound_surface(apart, names, zero, analysis.scale.evaluation_noise).largest
    except BreaksNotAlignedError:
        return np.inf
