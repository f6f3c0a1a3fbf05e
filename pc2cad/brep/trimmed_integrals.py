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
from OCP.Geom import (
    Geom_BSplineSurface,
    Geom_ElementarySurface,
    Geom_Surface,
)
from OCP.Geom2d import Geom2d_Curve, Geom2d_Line
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FORWARD, TopAbs_REVERSED
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Face

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import cross
from pc2cad.brep.forms import FLUX, Form
from pc2cad.brep.from_kernel import path_function, surface_function
from pc2cad.brep.gauss_rules import nodes_between
from pc2cad.brep.kernel import as_edge, as_face
from pc2cad.brep.settling import settled
from pc2cad.geometry.jets import (
    CurveFunction,
    SurfaceFunction,
    crossings,
    cuts_between,
)

#: pieces of an angle are not longer than this
STEP = np.pi / 3
#: relative accuracy of the integrals on analytic surfaces
ACCURACY = 1e-13
#: the same on splines, whose trimming curves are the kernel's and no better
TRIMMED_ACCURACY = 1e-9
#: nodes with which a Gauss rule on a piece of an angle leaves less than rounding of waves of up to
#: six times the angle: a^2n (n!)^4 2^(2n+1) / ((2n+1) (2n)!^3) is 1e-18 for n = 12, a = 6 STEP/2
ENOUGH = 12
#: places that are evaluated at once
CHUNK = 200_000


def trimmed_flux(
    surface: Geom_Surface, face: TopoDS_Face, sign: float, origin: Array, form: Form = FLUX
) -> Array:
    """Return the integrals of a form over a face of any surface, relative to `origin`.

    Raises KernelError where they do not settle.
    """
    data = surface_function(surface, origin)
    accuracy = TRIMMED_ACCURACY if isinstance(surface, Geom_BSplineSurface) else ACCURACY
    paths = list(_paths(face))
    level = float(np.mean([path.ends[:, 1].mean() for path in paths]))
    strips = [_Strip(data, path, level, sign, form) for path in paths if not path.is_upright]
    width = len(form.worth(1.0, 1.0))
    if not strips:
        return np.zeros(width)
    cells = np.concatenate([strip.cells(float(i)) for i, strip in enumerate(strips)])

    def rule(cells: Array, orders: tuple[int, ...]) -> Array:
        result = np.empty((len(cells), width))
        for i, strip in enumerate(strips):
            own = cells[:, -1] == i
            result[own] = strip.sums(cells[own], *orders)
        return result

    if isinstance(surface, Geom_ElementarySurface) and all(s.path.is_level for s in strips):
        # waves and powers of low degree in a and in b
        return np.asarray(rule(cells, (ENOUGH, ENOUGH)).sum(axis=0))
    reach = max(strip.reach for strip in strips)

    def scale(sizes: Array) -> Array:
        return form.worth(sizes[1] + np.finfo(float).tiny, reach)

    return settled(rule, cells, 2, accuracy, scale)


def is_whole(surface: Geom_BSplineSurface, face: TopoDS_Face) -> bool:
    """Say whether a face is all of its surface: every edge runs along the border of its domain."""
    u, last_u, v, last_v = surface.Bounds()
    sides = [(0, u), (0, last_u), (1, v), (1, last_v)]
    reach = 1e-9 * (last_u - u), 1e-9 * (last_v - v)
    for curve, (first, last), _ in _pcurves(face):
        # of a line its ends tell all
        count = 1 if isinstance(curve, Geom2d_Line) else 4
        step = (last - first) / count
        places = [curve.Value(first + k * step).Coord() for k in range(count + 1)]
        if not any(all(abs(p[d] - at) <= reach[d] for p in places) for d, at in sides):
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

    @property
    def is_level(self) -> bool:
        """Whether it is a line along a."""
        breaks, (slope, *_) = self.curve.breaks, self.curve.jet(np.zeros(1))[1]
        return self.curve.degree == 1 and breaks is not None and not len(breaks) and slope[1] == 0.0

    @property
    def is_upright(self) -> bool:
        """Whether it runs along b, so that nothing lies beside it."""
        return bool(np.ptp(self.curve.jet(np.linspace(*self.span, 5))[0][:, 0]) == 0.0)


def _pcurves(face: TopoDS_Face) -> Iterator[tuple[Geom2d_Curve, tuple[float, float], bool]]:
    """Yield edges' curves in the parameter plane, their ranges, and whether they run forward."""
    plain = as_face(face.Oriented(TopAbs_FORWARD))
    explorer = TopExp_Explorer(plain, TopAbs_EDGE)
    while explorer.More():
        edge = as_edge(explorer.Current())
        span = BRep_Tool.Range_s(edge, plain)
        curve = BRep_Tool.CurveOnSurface_s(edge, plain, *span)
        yield curve, span, edge.Orientation() != TopAbs_REVERSED
        explorer.Next()


def _paths(face: TopoDS_Face) -> Iterator[_Path]:
    for curve, span, forward in _pcurves(face):
        yield _Path(path_function(curve), span, forward)


@dataclass(frozen=True)
class _Strip:
    """What lies between one edge and a level of b: -∮ (∫ f db) da, cell by cell.

    The columns of a cell are its limits along the edge's parameter and as shares of the way from
    the level to the edge within a span of the surface, the limits of that span, and its owner.
    """

    data: SurfaceFunction
    path: _Path
    level: float
    sign: float
    form: Form

    def cells(self, owner: float) -> Array:
        """Return the cells to begin with, (k, 7): one for each piece of the edge and each span."""
        cuts = _cuts(self.data.breaks, self.path)
        breaks = self.data.breaks[1]
        to = self.path.curve.jet(cuts)[0][:, 1]
        pieces, spans = 1, np.array([[-np.inf, np.inf]])
        if breaks is None:
            pieces = max(1, int(np.ceil(float(np.abs(to - self.level).max()) / STEP)))
        elif len(breaks) > 2:
            # span by span of the surface: what lies outside a span has no length in it
            inner = np.concatenate(([-np.inf], breaks[1:-1], [np.inf]))
            spans = np.stack((inner[:-1], inner[1:]), axis=1)
        shares = np.linspace(0.0, 1.0, pieces + 1)
        parts = np.stack((shares[:-1], shares[1:]), axis=1)
        panels = np.stack((cuts[:-1], cuts[1:]), axis=1)
        every = np.hstack((
            np.repeat(panels, len(parts) * len(spans), axis=0),
            np.tile(np.repeat(parts, len(spans), axis=0), (len(panels), 1)),
            np.tile(spans, (len(panels) * len(parts), 1)),
            np.full((len(panels) * len(parts) * len(spans), 1), owner),
        ))  # fmt: skip
        t, _ = nodes_between(every[:, :2], 4)
        low, high = self._inside(every, self.path.curve.jet(t.ravel())[0][:, 1].reshape(t.shape))
        return np.asarray(every[(low != high).any(axis=1)])

    @property
    def reach(self) -> float:
        """How far the edge and the level beside it are from the origin."""
        place = self.path.curve.jet(np.linspace(*self.path.span, 9))[0]
        flat = np.full(len(place), self.level)
        points = [self.data.jet(place[:, 0], b)[0] for b in (place[:, 1], flat)]
        far = np.sqrt((np.array(points) ** 2).sum(axis=-1)).max()
        return float(far) + float(np.finfo(float).tiny)

    def _inside(self, cells: Array, to: Array) -> tuple[Array, Array]:
        """Return the part of the way from the level to `to`, (k, n), that is in each span."""
        start, end = cells[:, 4:5], cells[:, 5:6]
        return np.clip(self.level, start, end) + 0 * to, np.clip(to, start, end)

    def sums(self, cells: Array, along: int, across: int) -> Array:
        """Return the integrals over each cell, (k, columns), by rules of some orders."""
        step = max(1, CHUNK // (along * across))
        rows = [self._sums(cells[i : i + step], along, across)
                for i in range(0, len(cells), step)]  # fmt: skip
        return np.concatenate(rows) if rows else np.empty((0, len(self.form.worth(1.0, 1.0))))

    def _sums(self, cells: Array, along: int, across: int) -> Array:
        t, weights = nodes_between(cells[:, :2], along)
        place, slope = (x.reshape(*t.shape, 2) for x in self.path.curve.jet(t.ravel()))
        outer = -weights * slope[..., 0] * (1.0 if self.path.forward else -1.0)
        low, high = self._inside(cells, place[..., 1])
        shares, parts = nodes_between(cells[:, 2:4], across)
        b = low[..., None] + (high - low)[..., None] * shares[:, None]
        both = (outer * (high - low))[..., None] * parts[:, None]
        a = np.broadcast_to(place[..., :1], b.shape)
        point, along_a, along_b = self.data.jet(a.ravel(), b.ravel())
        normal = self.sign * cross(along_a, along_b)
        values = self.form.rows(point.T, normal.T) * both.ravel()
        return np.asarray(values.reshape(len(values), len(cells), -1).sum(axis=2).T)


def _cuts(breaks: tuple[Array | None, Array | None], path: _Path) -> Array:
    """Return where an edge is cut: at its knots, those of the surface, and into short angles."""
    own = cuts = cuts_between(path.span, path.curve.breaks)
    for axis in (0, 1):
        smooth = breaks[axis]
        if smooth is not None and len(smooth):
            cuts = distinct(np.concatenate((cuts, crossings(path.curve, own, axis, smooth))))
    run = float(np.ptp(path.ends[:, 0]))
    pieces = max(1, int(np.ceil(run / STEP))) if breaks[0] is None else 1
    return np.concatenate([np.linspace(x, y, pieces + 1) for x, y in pairwise(cuts)])
