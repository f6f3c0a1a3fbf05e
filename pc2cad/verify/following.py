"""Integrals over what edges run around on a surface, by Green's theorem in its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.verify.curves import gauss_rule
from pc2cad.verify.patches import Moments, moments_of, sums
from pc2cad.verify.splines import SplineSurface
from pc2cad.verify.surfaces import Surface

#: places of an integral from a level to an edge, per span at least: the area has a root
_FEWEST = 10


@dataclass(frozen=True, eq=False)
class Followed:
    """Edges in the parameters of a surface: places (n,), and the steps that belong to them."""

    surface: Surface
    places: tuple[Array, Array]
    steps: tuple[Array, Array]


def follow(surface: Surface, flows: Sequence[tuple[Array, Array]]) -> Followed:
    """Return places and steps along edges, (n, 3) each, in the parameters of a surface.

    Each edge is located by itself: one that runs along a side of the parameters is known to do so,
    and has no step across it, even where the other parameter has no speed there.
    """
    rows = []
    for points, along in flows:
        u, v = (np.asarray(part) for part in surface.locate(points))
        _, a, b = surface.at(u, v)
        aa, ab, bb = ((x * y).sum(axis=1) for x, y in ((a, a), (a, b), (b, b)))
        on_a, on_b = (a * along).sum(axis=1), (b * along).sum(axis=1)
        area = np.maximum(aa * bb - ab**2, 1e-300)
        if np.ptp(u) == 0.0:
            run = np.zeros(len(u)), on_b / np.maximum(bb, 1e-300)
        elif np.ptp(v) == 0.0:
            run = on_a / np.maximum(aa, 1e-300), np.zeros(len(v))
        else:
            run = (bb * on_a - ab * on_b) / area, (aa * on_b - ab * on_a) / area
        rows.append((u, v, *run))
    u, v, du, dv = (np.concatenate(part) for part in zip(*rows, strict=True))
    return Followed(surface, (u, v), (du, dv))


def trimmed_moments(
    edges: Followed, inner: tuple[int, float], origin: Array, corner: Array
) -> Moments:
    """Return integrals over what edges run around, by Green's theorem: -∮ (∫ f dv) du.

    `inner` is the parameter of the inner integral, 0 or 1, and the level that it begins at: with u
    inside it is ∮ (∫ f du) dv. The edges' orientation counts. What closes the loops in the
    parameter plane but is no edge of the file, a pole, has to be at the level, or run along it.
    """
    (axis, level), surface = inner, edges.surface
    ends, period = edges.places[axis], surface.periods[axis]
    if period is not None:
        ends = np.unwrap(ends, period=period)
    at, weights, row = _inward(surface, axis, level, ends)
    run = edges.steps[1 - axis][row]
    weight = run * weights if axis == 0 else -run * weights
    outer = edges.places[1 - axis][row]
    jet = surface.at(*((at, outer) if axis == 0 else (outer, at)))
    return moments_of(sums(jet, weight, origin, corner), 1e-9)


def _inward(
    surface: Surface, axis: int, level: float, ends: Array
) -> tuple[Array, Array, Integers]:
    """Return places and weights of integrals from a level to each end, and the end's number.

    None goes over a place where the surface is not smooth.
    """
    low, high = min(level, float(ends.min())), max(level, float(ends.max()))
    cuts = distinct(surface.breaks(axis, low, high)) if high > low else np.array([low, high])
    # of polynomials as many as are exact; what is rational has no breaks of its own
    parts, points = (2, 20) if _is_rational(surface) else (1, max(surface.points[axis], _FEWEST))
    nodes, gauss = gauss_rule(np.linspace(0.0, 1.0, parts + 1), points)
    below, above = np.minimum(ends, level)[:, None], np.maximum(ends, level)[:, None]
    first, last = np.maximum(cuts[:-1], below), np.minimum(cuts[1:], above)
    row, span = np.nonzero(last > first)
    first, width = first[row, span], (last - first)[row, span]
    weights = np.where(ends[row] > level, width, -width)[:, None] * gauss
    at = first[:, None] + width[:, None] * nodes
    return at.ravel(), weights.ravel(), np.repeat(row, len(nodes))


def _is_rational(surface: Surface) -> bool:
    return isinstance(surface, SplineSurface) and surface.rational
