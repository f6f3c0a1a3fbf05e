"""What bounds a face in the parameters of its surface: pieces of curves between places."""

from __future__ import annotations

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FORWARD, TopAbs_REVERSED
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Face

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.brep.from_kernel import conic_terms, path_function, surface_function
from pc2cad.brep.kernel import as_edge, as_face
from pc2cad.geometry.jets import SurfaceFunction

#: pieces of an edge that is not straight in the parameters
PIECES = 64


def border_of(face: TopoDS_Face, count: int = PIECES) -> tuple[Array, Array, Array]:
    """Return where the pieces begin and end, (n, 2) each, and how far they are off their chords.

    The face is on their left; an edge that is not straight is cut in `count` pieces at least.
    """
    plain = as_face(face.Oriented(TopAbs_FORWARD))
    explorer = TopExp_Explorer(plain, TopAbs_EDGE)
    starts, ends, bows = [], [], []
    while explorer.More():
        edge = as_edge(explorer.Current())
        explorer.Next()
        if edge.Orientation() not in (TopAbs_FORWARD, TopAbs_REVERSED):
            continue
        first, last = BRep_Tool.Range_s(edge)
        curve = BRep_Tool.CurveOnSurface_s(edge, plain, first, last)
        path = path_function(curve)
        bend = path.sizes().second[0]
        if not np.isfinite(bend):  # a hyperbola
            terms = conic_terms(curve)[1].values()
            furthest = float(np.cosh(max(abs(first), abs(last))))
            bend = furthest * sum(float(np.linalg.norm(along)) for along in terms)
        t = np.linspace(first, last, count + 1 if bend else 2)
        if path.breaks is not None:
            inner = path.breaks[(path.breaks > first) & (path.breaks < last)]
            t = distinct(np.concatenate((t, inner)))
        places = path.jet(t)[0]
        if edge.Orientation() == TopAbs_REVERSED:
            places, t = places[::-1], t[::-1]
        starts.append(places[:-1])
        ends.append(places[1:])
        bows.append(bend * np.diff(t) ** 2 / 8)
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(bows)


def surface_of(face: TopoDS_Face) -> SurfaceFunction:
    """Return a face's surface."""
    return surface_function(BRep_Tool.Surface_s(face), np.zeros(3))
