"""Deviations of faces that lie between two others: of the walls between layers of even thickness.

Where M_k = (1 - λ) M_a + λ M_b, by algebra, and the faces' splines have the same space and so the
poles P_k = (1 - λ) P_a + λ P_b but for rounding, what is proved of a and b holds for k:
|M_k - S_k| ≤ (1 - λ) |M_a - S_a| + λ |M_b - S_b| + |P_k - (1 - λ) P_a - λ P_b|.
As fits are linear, k is no further off than a or b is at the same place: spaces are chosen, and
first fits are judged, by the outermost alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.restrictions import Piece, RestrictedMap
from pc2cad.expression.normal_form import normal_form
from pc2cad.geometry.carriers import SplineSurface
from pc2cad.representation.boundary_model import ModelFace

#: roundings of values and poles, in units of the last place of the coordinates
ROUNDINGS = 32

#: a face and the function that it carries
Carried = tuple[ModelFace, RestrictedMap]


def between_others(faces: Sequence[RestrictedMap]) -> dict[int, tuple[int, int]]:
    """Return the faces that lie between two others, as equations, and which two."""
    rows: dict[tuple[Piece, ...], list[int]] = {}
    for i, function in enumerate(faces):
        if len(function.pieces) == 2:
            rows.setdefault(function.pieces, []).append(i)
    found = {}
    for row in (row for row in rows.values() if len(row) > 2):
        first, *inner, last = sorted(row, key=lambda i: faces[i].cell)
        for i in inner:
            if _share(faces[i], faces[first], faces[last]) is not None:
                found[i] = first, last
    return found


def extremes_first(faces: Sequence[Carried]) -> list[list[int]]:
    """Return places of the faces in rows: those that may lie between the first two of their row.

    The two are the outermost along the direction across.
    """
    rows: dict[tuple[object, ...], list[int]] = {}
    for i, (face, function) in enumerate(faces):
        key = _space(face, function)
        rows.setdefault(key if key is not None else (i,), []).append(i)
    ordered = []
    for row in rows.values():
        along = sorted(row, key=lambda i: faces[i][1].cell)
        ordered.append(along[:1] + along[:0:-1])
    return ordered


def _space(face: ModelFace, function: RestrictedMap) -> tuple[object, ...] | None:
    """Return what faces in a row have in common: the spline's space, and the cell but for w."""
    surface = face.carrier
    if not isinstance(surface, SplineSurface) or len(function.pieces) != 2:
        return None
    weights = None if surface.weights is None else surface.weights.tobytes()
    knots = tuple(k.tobytes() for k in surface.knots)
    return surface.degrees, knots, weights, surface.poles.shape, function.pieces


def lies_between(face: Carried, first: Carried, last: Carried) -> ModelFace | None:
    """Return a face with the deviation that follows from those of two proved ones; None if none."""
    ends = (first[0].carrier, last[0].carrier)
    if any(end.evidence != "bounded" for end, _ in (first, last)):
        return None
    share = _share(face[1], first[1], last[1])
    surface = face[0].carrier
    if share is None or not all(isinstance(s, SplineSurface) for s in (surface, *ends)):
        return None
    a, b = 1 - float(share), float(share)
    p, q, r = (s.poles for s in (surface, *ends))  # type: ignore[union-attr]
    off = float(_lengths(p - (a * q + b * r)).max())
    size = float(_lengths(p).max())
    bound = a * first[0].deviation + b * last[0].deviation + off
    bound = bound * (1 + 1e-12) + ROUNDINGS * 2.0**-53 * size
    seen = face[0].deviation
    return replace(face[0], evidence="bounded", deviation=max(bound, seen), sampled=seen)


def _share(face: RestrictedMap, first: RestrictedMap, last: RestrictedMap) -> Fraction | None:
    """Return the λ of M = (1 - λ) M_a + λ M_b where that holds identically, 0 < λ < 1."""
    if not face.trees[1] == first.trees[1] == last.trees[1]:
        return None
    shares: set[Fraction] = set()
    for a, m, b in zip(first.trees[0], face.trees[0], last.trees[0], strict=True):
        own, way = normal_form(m - a), normal_form(b - a)
        if own is None or way is None or set(own) != set(way):
            return None
        shares |= {own[monomial] / way[monomial] for monomial in way}
        if len(shares) > 1:
            return None
    share = shares.pop() if shares else None
    return share if share is not None and 0 < share < 1 else None


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))
