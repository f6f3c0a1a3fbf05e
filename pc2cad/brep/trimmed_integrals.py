"""Integrals over faces that are bounded by their curves in the parameter plane.

By Green's theorem ∬ f da db = -∮ (∫ f db) da along the pcurves that the kernel holds, poles and
seams included: the orientation of the wires, the pcurves and the surface are all put to the test.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface, Geom_Curve, Geom_Surface
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FORWARD, TopAbs_REVERSED
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Face

from pc2cad.arrays import Array
from pc2cad.brep.from_kernel import curve_function, path_function, surface_function
from pc2cad.brep.spline_integrals import cross, flux, gauss_on, legendre
from pc2cad.geometry.jets import (
    CurveFunction,
    Jet,
    SurfaceFunction,
    crossings,
    cuts_between,
)

#: pieces of an angle are not longer than this
STEP = np.pi / 3
#: relative accuracy of the area on analytic surfaces
ACCURACY = 1e-13
#: the same on splines, whose trimming curves are the kernel's and no better
TRIMMED_ACCURACY = 1e-9
FEWEST_NODES, MOST_NODES = 8, 200


def trimmed_flux(surface: Geom_Surface, face: TopoDS_Face, sign: float, origin: Array) -> Array:
    """Return the flux integrals over a face of any surface, relative to `origin`."""
    data = surface_function(surface, origin)
    accuracy = TRIMMED_ACCURACY if isinstance(surface, Geom_BSplineSurface) else ACCURACY
    paths = [(path, _cuts(data.breaks, path)) for path in _paths(face)]
    level = float(np.mean([path.ends[:, 1].mean() for path, _ in paths]))
    count, total = FEWEST_NODES, np.full(5, np.nan)
    while count <= MOST_NODES:
        before = total
        total = np.sum([_along(data, *path, level, count, sign) for path in paths], axis=0)
        if abs(total[1] - before[1]) <= accuracy * abs(total[1]):
            break
        count *= 2
    return total


def is_whole(surface: Geom_BSplineSurface, face: TopoDS_Face) -> bool:
    """Say whether a face is all of its surface: every edge runs along the border of its domain."""
    limits = np.array(surface.Bounds()).reshape(2, 2)
    reach = 1e-9 * np.ptp(limits, axis=1)
    for path in _paths(face):
        places = path.curve.jet(np.linspace(*path.span, 5))[0]
        near = np.abs(places[:, :, None] - limits) <= reach[:, None]
        if not near.all(axis=0).any():
            return False
    return True


# -- the boundary in the parameter plane -----------------------------------------------------------


@dataclass(frozen=True)
class _Path:
    """One edge in the parameter plane, from its first to its last parameter."""

    curve: CurveFunction
    span: tuple[float, float]
    forward: bool

    @property
    def ends(self) -> Array:
        return self.curve.jet(np.array(self.span))[0]


def _paths(face: TopoDS_Face) -> Iterator[_Path]:
    plain = TopoDS.Face_s(face.Oriented(TopAbs_FORWARD))
    explorer = TopExp_Explorer(plain, TopAbs_EDGE)
    while explorer.More():
        edge = TopoDS.Edge_s(explorer.Current())
        span = BRep_Tool.Range_s(edge, plain)
        curve = path_function(BRep_Tool.CurveOnSurface_s(edge, plain, *span))
        yield _Path(curve, span, edge.Orientation() != TopAbs_REVERSED)
        explorer.Next()


def _along(
    data: SurfaceFunction, path: _Path, cuts: Array, level: float, count: int, sign: float
) -> Array:
    """Return -∮ (∫ f db) da over one edge, the inner integral from `level`."""
    total = np.zeros(5)
    if np.ptp(path.curve.jet(np.linspace(*path.span, 5))[0][:, 0]) == 0.0:
        return total
    t, weights = gauss_on(cuts, count)
    place, slope = path.curve.jet(t)
    outer = -weights * slope[:, 0] * (1.0 if path.forward else -1.0)
    nodes, inner = _inner(data.breaks[1], level, place[:, 1], count)
    both = inner * outer[:, None]
    used = both != 0.0
    if not used.any():
        return total
    a = np.broadcast_to(place[:, :1], nodes.shape)[used]
    point, along_a, along_b = data.jet(a, nodes[used])
    normal = sign * cross(along_a, along_b)
    return flux(point, normal, both[used])


def _cuts(breaks: tuple[Array | None, Array | None], path: _Path) -> Array:
    """Return where an edge is cut: at its knots, those of the surface, and into short angles."""
    own = cuts = cuts_between(path.span, path.curve.breaks)
    for axis in (0, 1):
        smooth = breaks[axis]
        if smooth is not None and len(smooth):
            cuts = np.union1d(cuts, crossings(path.curve, own, axis, smooth))
    run = float(np.ptp(path.ends[:, 0]))
    pieces = max(1, int(np.ceil(run / STEP))) if breaks[0] is None else 1
    return np.concatenate([np.linspace(x, y, pieces + 1) for x, y in pairwise(cuts)])


def _inner(breaks: Array | None, level: float, to: Array, count: int) -> tuple[Array, Array]:
    """Return nodes and signed weights of ∫ from `level` to each of `to`: shape (len(to), n)."""
    reach = max(float(np.abs(to - level).max()), 1e-300)
    pieces = max(1, int(np.ceil(reach / STEP))) if breaks is None else 1
    shares = np.linspace(0.0, 1.0, pieces + 1)
    low, high = (level + (to[:, None] - level) * part for part in (shares[:-1], shares[1:]))
    if breaks is not None and len(breaks) > 2:
        # span by span of the surface: what lies outside a span has no length in it
        starts, ends = np.append(-np.inf, breaks[1:-1]), np.append(breaks[1:-1], np.inf)
        low, high = np.clip(level, starts, ends)[None], np.clip(to[:, None], starts, ends)
    x, weight = legendre(count)
    half = ((high - low) / 2)[..., None]
    nodes = ((high + low) / 2)[..., None] + half * x
    return nodes.reshape(len(to), -1), (half * weight).reshape(len(to), -1)


def curve_jet(curve: Geom_Curve, first: float, last: float, origin: Array) -> Jet:
    """Return points, derivatives and weights of a Gauss rule along a curve, for moments of it."""
    basis = curve_function(curve, origin)
    if basis.breaks is None:
        cuts = np.linspace(first, last, 1 + max(1, int(np.ceil((last - first) / STEP))))
        count = 16
    else:
        cuts = cuts_between((first, last), basis.breaks)
        count = 4
        if isinstance(curve, Geom_BSplineCurve):
            count = 2 * curve.Degree() if not curve.IsRational() else 24 + 2 * curve.Degree()
    t, weights = gauss_on(cuts, count)
    return *basis.jet(t), weights
