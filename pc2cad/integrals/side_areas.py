"""Areas of the faces of one side, integrated together: one product rule runs through all of them.

A side in many pieces has as many faces, and lines through each of them would cost as much as the
faces are many. The rule is found along lines through the whole side; the sums over each piece are
taken apart, and held against those of a finer rule, face by face. A face on which that leaves more
than rounding, or on which something stands out, is left to be integrated by itself. Of plane faces
that are polynomials the areas are known beforehand.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.integrals.flat_faces import flat_areas
from pc2cad.integrals.quadrature import Panels, single
from pc2cad.integrals.rules import (
    DOUBTFUL,
    EXACT,
    Density,
    any_features,
    panels_for,
)
from pc2cad.topology.cells import Cell, directions_of

#: faces of a side from which on they are integrated together, and the most nodes of a rule for them
MANY, MOST_NODES = 4, 200_000


def sides_in_pieces(patches: Sequence[Cell]) -> list[list[Cell]]:
    """Return the patches of each side (or break) that is whole and in many pieces."""
    sides: dict[tuple[int, int], list[Cell]] = defaultdict(list)
    for patch in patches:
        (fixed,) = {0, 1, 2} - set(directions_of(patch))
        sides[fixed, patch[fixed]].append(patch)
    return [side for side in sides.values() if len(side) >= MANY and _is_whole(side)]


def _is_whole(side: list[Cell]) -> bool:
    """Say whether patches are all pieces between the first and the last one of each direction."""
    whole = 1
    for d in range(3):
        positions = {patch[d] for patch in side}
        whole *= (max(positions) - min(positions)) // 2 + 1
    return whole == len(side)


def areas_of_side(
    density: Density, analysis: Analysis, side: list[Cell], whole: Sequence[Panels]
) -> dict[Cell, tuple[float, float]]:
    """Return areas and their relative errors of those faces of a side for which that is enough.

    `whole` are the rules of the volume: where it needed panels, areas may well need them.
    """
    first, last = min(side), max(side)
    found = {patch: (area, EXACT) for patch, area in flat_areas(analysis, side).items()}
    rest = [patch for patch in side if patch not in found]
    if len(rest) < MANY:
        return found
    boxes = np.array([[analysis.span(d, p[d]) for d in range(3)] for p in rest])
    plain = [p for p, out in zip(rest, any_features(density, boxes), strict=True) if not out]
    if len(plain) < MANY:
        return found
    limits = []
    for d in range(3):
        low, high = analysis.span(d, first[d])[0], analysis.span(d, last[d])[1]
        breaks = (b.position for b in analysis.breaks[d])
        inner = {x for x in (*breaks, *whole[d].limits.tolist()) if low < x < high}
        limits.append([low, *sorted(inner), high])
    nothing = np.empty((0, 3))
    panels = [
        single(row[0]) if row[0] == row[-1] else panels_for(density, limits, d, nothing)
        for d, row in enumerate(limits)
    ]
    unresolved = max(p.unresolved for p in panels)
    coarse = _sums(density, analysis, plain, panels, 1.0)
    fine = _sums(density, analysis, plain, panels, 1.5)
    if coarse is None or fine is None:
        return found
    for patch, before, area in zip(plain, coarse, fine, strict=True):
        error = abs(area - before) / max(abs(area), 1e-300)
        if error < DOUBTFUL:
            found[patch] = area, max(error, EXACT, unresolved)
    return found


def _sums(
    density: Density, analysis: Analysis, side: list[Cell], panels: list[Panels], grow: float
) -> list[float] | None:
    """Return the integral over each patch by rules with so many times the nodes."""
    rules = [p.rule(grow) for p in panels]
    if np.prod([len(nodes) for nodes, _ in rules], dtype=float) > MOST_NODES:
        return None
    values = density(*open_grid(*(nodes for nodes, _ in rules))).values[..., 0]
    for axis, (_, weights) in enumerate(rules):
        values = values * weights.reshape([-1 if a == axis else 1 for a in range(3)])
    return [
        float(values[tuple(_within(analysis, patch, d, rules[d][0]) for d in range(3))].sum())
        for patch in side
    ]


def _within(analysis: Analysis, patch: Cell, direction: int, nodes: Array) -> slice:
    """Return which ascending nodes lie in a patch."""
    low, high = analysis.span(direction, patch[direction])
    if low == high:
        return slice(None)
    return slice(*np.searchsorted(nodes, (low, high)).tolist())
