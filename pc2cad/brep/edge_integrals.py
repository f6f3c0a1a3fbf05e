"""Integrals along the edges of a kernel solid."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FORWARD, TopAbs_REVERSED
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.brep.gauss_rules import legendre
from pc2cad.brep.kernel import as_face
from pc2cad.brep.settling import settled
from pc2cad.brep.trimmed_integrals import STEP, TRIMMED_ACCURACY
from pc2cad.errors import KernelError
from pc2cad.geometry.jets import EdgeFunction, cuts_between


def turns_forward(edge: TopoDS_Edge, face: TopoDS_Face) -> bool:
    """Say whether a face lies to the left of an edge's curve, seen against its surface's normal.

    Raises KernelError where it is none of the face's edges.
    """
    explorer = TopExp_Explorer(as_face(face.Oriented(TopAbs_FORWARD)), TopAbs_EDGE)
    while explorer.More():
        if explorer.Current().IsSame(edge):
            return bool(explorer.Current().Orientation() != TopAbs_REVERSED)
        explorer.Next()
    raise KernelError("an edge of the CAD kernel's is none of its face's")


def edge_integral(values: Callable[[Array], Array], edge: EdgeFunction, worth: float) -> float:
    """Return ∫ f dt over an edge's parameter, to within a share of what it may be worth at most.

    Raises KernelError where it does not settle.
    """
    cuts = cuts_between(edge.span, edge.curve.breaks)
    if edge.curve.breaks is None:
        pieces = max(1, int(np.ceil((edge.span[1] - edge.span[0]) / STEP)))
        parts = [np.linspace(a, b, pieces + 1) for a, b in pairwise(cuts)]
        cuts = distinct(np.concatenate(parts))

    def rule(cells: Array, orders: tuple[int, ...]) -> Array:
        x, weights = legendre(orders[0])
        half = np.ptp(cells, axis=1)[:, None] / 2
        t = cells.mean(axis=1, keepdims=True) + half * x
        return np.asarray(
            (values(t.ravel()).reshape(t.shape) * half * weights).sum(axis=1)[:, None]
        )

    cells = np.stack((cuts[:-1], cuts[1:]), axis=1)
    scale = np.array([max(worth, float(np.finfo(float).tiny))])
    return float(settled(rule, cells, 1, TRIMMED_ACCURACY, lambda _: scale)[0])
