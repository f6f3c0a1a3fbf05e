"""Areas of faces that are polynomials and lie in planes: exact but for rounding.

Faces of one degree are looked at together: of a part in many pieces there may be hundreds.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.looks import look_across
from pc2cad.domain.pieces import piece_at
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.integrals.quadrature import gauss
from pc2cad.topology.cells import Cell, directions_of

#: polynomials of a higher degree are integrated as other functions are
MOST_DEGREE = 16
#: normals (of the largest one) across the direction of all, and against it, that are rounding
ROUNDING = 1e-13


def flat_areas(analysis: Analysis, patches: Iterable[Cell]) -> dict[Cell, float]:
    """Return the areas of those patches that are polynomials, and whose normals all point one way.

    Where M is of degree n in a parameter, the normals M_s × M_t are of degree 2n - 1: 2n nodes
    determine them. The length of their integral is the area.
    """
    alike: dict[tuple[tuple[int, ...], tuple[int, ...]], list[Cell]] = defaultdict(list)
    for patch in patches:
        degrees = _degrees(analysis, patch)
        if degrees is not None:
            alike[directions_of(patch), degrees].append(patch)
    found: dict[Cell, float] = {}
    for (_, (m, n)), several in alike.items():
        (s, along), (t, across) = (gauss(2 * max(1, degree)) for degree in (m, n))
        functions = [RestrictedMap(analysis, patch) for patch in several]
        nodes = (1 + s) / 2, (1 + t) / 2
        look_across(functions, *nodes)
        normals = np.array([f.normals(*nodes).reshape(-1, 3) for f in functions])
        areas = flat_lengths(normals, np.multiply.outer(along, across).ravel() / 4)
        spans = np.array([[analysis.span(d, p[d]) for d in directions_of(p)] for p in several])
        areas *= np.prod(np.diff(spans)[..., 0], axis=1)
        found |= {p: area for p, area in zip(several, areas.tolist(), strict=True) if area > 0}
    return found


def _degrees(analysis: Analysis, patch: Cell) -> tuple[int, ...] | None:
    """Return the degrees of a patch along its directions, None where it is no polynomial."""
    spans, _ = piece_at(patch, analysis.bounds)
    degrees = []
    for d in directions_of(patch):
        degree = analysis.map.pieces.degree(spans, PARAMETERS[d])
        if degree is None or degree > MOST_DEGREE:
            return None
        degrees.append(degree)
    return tuple(degrees)


def flat_lengths(normals: Array, weights: Array) -> Array:
    """Return the length of the integral of normals (k, n, 3); 0 where they point several ways."""
    whole = (normals * weights[:, None]).sum(axis=1)
    length = np.sqrt((whole * whole).sum(axis=1))
    unit = whole / np.where(length > 0, length, 1.0)[:, None]
    along = (normals * unit[:, None]).sum(axis=2)
    off = np.abs(normals - along[..., None] * unit[:, None]).max(axis=(1, 2))
    least = ROUNDING * np.abs(normals).max(axis=(1, 2))
    flat = (length > 0) & (off <= least) & (along.min(axis=1) >= -least)
    return np.where(flat, length, 0.0)
