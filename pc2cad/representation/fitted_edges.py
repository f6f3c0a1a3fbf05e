"""Edges that are approximated: those that run alike are fitted, and compared, together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.geometry.carriers import SplineCurve
from pc2cad.geometry.splines.rational import Parametrisation, edge_deviations, fit_edges
from pc2cad.geometry.splines.tensor import Deviation
from pc2cad.representation.tips import hold


@dataclass(frozen=True, eq=False)
class Wanted:
    """An edge to be fitted."""

    function: RestrictedMap
    parametrisation: Parametrisation
    #: the points of its two vertices, and the powers with which M leaves them
    ends: tuple[Array, Array]
    rests: tuple[int, int]


def fitted(edges: Sequence[Wanted]) -> list[tuple[SplineCurve, Deviation]]:
    """Return the curve of each edge, and how far it was seen to be off."""
    alike: dict[Parametrisation, list[int]] = {}
    for i, edge in enumerate(edges):
        alike.setdefault(edge.parametrisation, []).append(i)
    found: dict[int, tuple[SplineCurve, Deviation]] = {}
    for run, places in alike.items():
        same = [edges[i] for i in places]
        poles, weights = fit_edges(_values(same, run.sites), run)
        for row, edge in zip(poles, same, strict=True):
            row[0], row[-1] = edge.ends
            for rest, end in zip(edge.rests, (row, row[::-1]), strict=True):
                hold(end, rest)
        seen = edge_deviations(_values(same, run.checks), run, poles, weights)
        space = run.space
        for i, row, off in zip(places, poles, seen, strict=True):
            found[i] = SplineCurve(space.degree, space.knots, row, weights), off
    return [found[i] for i in range(len(edges))]


def _values(edges: Sequence[Wanted], places: Array) -> Array:
    return np.stack([edge.function(places) for edge in edges])
