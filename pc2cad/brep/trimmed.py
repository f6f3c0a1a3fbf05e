"""Integrals over faces that are bounded by their curves in the parameter plane.

By Green's theorem ∬ f da db = -∮ (∫ f db) da along the pcurves that the kernel holds, poles and
seams included: the orientation of the wires, the pcurves and the surface are all put to the test.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.Geom import (
    Geom_BSplineCurve,
    Geom_BSplineSurface,
    Geom_Circle,
    Geom_ConicalSurface,
    Geom_Curve,
    Geom_CylindricalSurface,
    Geom_ElementarySurface,
    Geom_Ellipse,
    Geom_Line,
    Geom_SphericalSurface,
    Geom_Surface,
    Geom_SurfaceOfLinearExtrusion,
    Geom_SurfaceOfRevolution,
    Geom_ToroidalSurface,
    Geom_TrimmedCurve,
)
from OCP.Geom2d import Geom2d_BSplineCurve, Geom2d_Curve, Geom2d_Line, Geom2d_TrimmedCurve
from OCP.gp import gp_Ax2, gp_Ax3, gp_Dir, gp_Pnt
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FORWARD, TopAbs_REVERSED
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Face

from pc2cad.brep.patches import (
    Array,
    SplineCurveData,
    cross,
    flux,
    gauss_on,
    legendre,
    read_curve,
    read_patch,
    spline_jet,
)
from pc2cad.errors import KernelError

#: pieces of an angle are not longer than this
STEP = np.pi / 3
#: relative accuracy of the area on analytic surfaces
ACCURACY = 1e-13
#: the same on splines, whose trimming curves are the kernel's and no better
TRIMMED_ACCURACY = 1e-9
FEWEST_NODES, MOST_NODES = 8, 200

Jet = tuple[Array, Array, Array]


@dataclass(frozen=True)
class _Surface:
    """A surface as functions of arrays a and b: point and both derivatives, shape (n, 3) each."""

    jet: Callable[[Array, Array], Jet]
    #: places where it is not smooth, ascending, None along an angle
    breaks: tuple[Array | None, Array | None]
    #: relative accuracy of the area, reached by doubling the nodes
    accuracy: float = ACCURACY


def trimmed_flux(surface: Geom_Surface, face: TopoDS_Face, sign: float, origin: Array) -> Array:
    """Return the flux integrals over a face of any surface, relative to `origin`."""
    data = _read_surface(surface, origin)
    paths = [(path, _cuts(data.breaks, path)) for path in _paths(face)]
    level = float(np.mean([path.ends[:, 1].mean() for path, _ in paths]))
    count, total = FEWEST_NODES, np.full(5, np.nan)
    while count <= MOST_NODES:
        before = total
        total = np.sum([_along(data, *path, level, count, sign) for path in paths], axis=0)
        if abs(total[1] - before[1]) <= data.accuracy * abs(total[1]):
            break
        count *= 2
    return total


def is_whole(surface: Geom_BSplineSurface, face: TopoDS_Face) -> bool:
    """Say whether a face is all of its surface: every edge runs along the border of its domain."""
    limits = np.array(surface.Bounds()).reshape(2, 2)
    reach = 1e-9 * np.ptp(limits, axis=1)
    for path in _paths(face):
        places = path.at(np.linspace(*path.span, 5))[0]
        near = np.abs(places[:, :, None] - limits) <= reach[:, None]
        if not near.all(axis=0).any():
            return False
    return True


# -- the boundary in the parameter plane -----------------------------------------------------------


@dataclass(frozen=True)
class _Path:
    """One edge in the parameter plane, from its first to its last parameter."""

    at: Callable[[Array], tuple[Array, Array]]
    span: tuple[float, float]
    breaks: Array
    forward: bool

    @property
    def ends(self) -> Array:
        return self.at(np.array(self.span))[0]


def _paths(face: TopoDS_Face) -> Iterator[_Path]:
    plain = TopoDS.Face_s(face.Oriented(TopAbs_FORWARD))
    explorer = TopExp_Explorer(plain, TopAbs_EDGE)
    while explorer.More():
        edge = TopoDS.Edge_s(explorer.Current())
        first, last = BRep_Tool.Range_s(edge, plain)
        curve = BRep_Tool.CurveOnSurface_s(edge, plain, first, last)
        at, breaks = _plane_curve(curve)
        inner = breaks[(breaks > first) & (breaks < last)]
        forward = edge.Orientation() != TopAbs_REVERSED
        yield _Path(at, (first, last), np.array([first, *inner, last]), forward)
        explorer.Next()


def _plane_curve(curve: Geom2d_Curve) -> tuple[Callable[[Array], tuple[Array, Array]], Array]:
    if isinstance(curve, Geom2d_TrimmedCurve):
        return _plane_curve(curve.BasisCurve())
    if isinstance(curve, Geom2d_Line):
        place, along = curve.Location(), curve.Direction()
        start, slope = np.array([place.X(), place.Y()]), np.array([along.X(), along.Y()])

        def line(t: Array) -> tuple[Array, Array]:
            return start + t[:, None] * slope, np.broadcast_to(slope, (len(t), 2))

        return line, np.empty(0)
    if not isinstance(curve, Geom2d_BSplineCurve) or curve.IsRational():
        raise KernelError(f"no integral is known along a {type(curve).__name__}")
    poles = np.array([(p.X(), p.Y()) for p in map(curve.Pole, range(1, curve.NbPoles() + 1))])
    knots = np.repeat([curve.Knot(i + 1) for i in range(curve.NbKnots())],
                      [curve.Multiplicity(i + 1) for i in range(curve.NbKnots())])  # fmt: skip
    return spline_jet(knots, poles, curve.Degree()), np.unique(knots)


def _along(
    data: _Surface, path: _Path, cuts: Array, level: float, count: int, sign: float
) -> Array:
    """Return -∮ (∫ f db) da over one edge, the inner integral from `level`."""
    total = np.zeros(5)
    if np.ptp(path.at(np.linspace(*path.span, 5))[0][:, 0]) == 0.0:
        return total
    t, weights = gauss_on(cuts, count)
    place, slope = path.at(t)
    outer = -weights * slope[:, 0] * (1.0 if path.forward else -1.0)
    nodes, inner = _inner(data.breaks[1], level, place[:, 1], count)
    both = inner * outer[:, None]
    used = both != 0.0
    a = np.broadcast_to(place[:, :1], nodes.shape)[used]
    point, along_a, along_b = data.jet(a, nodes[used])
    normal = sign * cross(along_a, along_b)
    return flux(point, normal, both[used])


def _cuts(breaks: tuple[Array | None, Array | None], path: _Path) -> Array:
    """Return where an edge is cut: at its knots, those of the surface, and into short angles."""
    cuts = path.breaks
    for axis in (0, 1):
        smooth = breaks[axis]
        if smooth is not None and len(smooth):
            cuts = np.union1d(cuts, _crossings(path, axis, smooth))
    run = float(np.ptp(path.ends[:, 0]))
    pieces = max(1, int(np.ceil(run / STEP))) if breaks[0] is None else 1
    return np.concatenate([np.linspace(x, y, pieces + 1) for x, y in pairwise(cuts)])


def _crossings(path: _Path, axis: int, values: Array) -> Array:
    """Return the parameters, between the ends, at which a coordinate of an edge takes values."""
    t = np.unique(np.concatenate([np.linspace(a, b, 17) for a, b in pairwise(path.breaks)]))
    at = path.at(t)[0][:, axis]
    lowest, highest = float(at.min()), float(at.max())
    inner = values[(values > lowest) & (values < highest)]
    side = at[None, :] > inner[:, None]
    rows, columns = np.nonzero(side[:, 1:] != side[:, :-1])
    low, high, rising = t[columns], t[columns + 1], side[rows, columns + 1]
    for _ in range(52):
        middle = (low + high) / 2
        beyond = (path.at(middle)[0][:, axis] > inner[rows]) == rising if len(rows) else rising
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return np.asarray((low + high) / 2)


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


# -- the kernel's surfaces on arrays ---------------------------------------------------------------


def _vector(data: gp_Pnt | gp_Dir) -> Array:
    return np.array([data.X(), data.Y(), data.Z()])


def _frame(place: gp_Ax3 | gp_Ax2, origin: Array) -> tuple[Array, Array]:
    axes = np.array([_vector(place.XDirection()), _vector(place.YDirection()),
                     _vector(place.Direction())])  # fmt: skip
    return _vector(place.Location()) - origin, axes


def _read_surface(surface: Geom_Surface, origin: Array) -> _Surface:
    if isinstance(surface, Geom_SurfaceOfLinearExtrusion):
        return _extrusion(surface, origin)
    if isinstance(surface, Geom_SurfaceOfRevolution):
        return _revolution(surface, origin)
    if isinstance(surface, Geom_BSplineSurface):
        patch = read_patch(surface, origin)
        u, v = (np.unique(knots) for knots in patch.knots)
        return _Surface(patch.scattered, (u, v), TRIMMED_ACCURACY)
    if not isinstance(surface, Geom_ElementarySurface):
        raise KernelError(f"no integral is known for a {type(surface).__name__}")
    centre, axes = _frame(surface.Position(), origin)
    profile, straight = _profile(surface)

    def jet(a: Array, b: Array) -> Jet:
        radius, height, radius_b, height_b = (x[:, None] for x in profile(b))
        out = np.cos(a)[:, None] * axes[0] + np.sin(a)[:, None] * axes[1]
        round_ = np.cos(a)[:, None] * axes[1] - np.sin(a)[:, None] * axes[0]
        return (centre + radius * out + height * axes[2], radius * round_,
                radius_b * out + height_b * axes[2])  # fmt: skip

    return _Surface(jet, (None, np.empty(0) if straight else None))


_Profile = Callable[[Array], tuple[Array, Array, Array, Array]]


def _profile(surface: Geom_ElementarySurface) -> tuple[_Profile, bool]:
    """Return radius and height along b with their derivatives, and whether b is a length."""
    if isinstance(surface, Geom_CylindricalSurface):
        r = surface.Radius()
        return lambda b: (np.full_like(b, r), b, np.zeros_like(b), np.ones_like(b)), True
    if isinstance(surface, Geom_ConicalSurface):
        r, angle = surface.RefRadius(), surface.SemiAngle()
        s, c = np.sin(angle), np.cos(angle)
        return lambda b: (r + s * b, c * b, np.full_like(b, s), np.full_like(b, c)), True
    if isinstance(surface, Geom_SphericalSurface):
        major, minor = 0.0, surface.Radius()
    elif isinstance(surface, Geom_ToroidalSurface):
        major, minor = surface.MajorRadius(), surface.MinorRadius()
    else:
        raise KernelError(f"no integral is known for a {type(surface).__name__}")

    def meridian(b: Array) -> tuple[Array, Array, Array, Array]:
        cos, sin = minor * np.cos(b), minor * np.sin(b)
        return major + cos, sin, -sin, cos

    return meridian, False


@dataclass(frozen=True)
class _Basis:
    jet: Callable[[Array], tuple[Array, Array]]
    breaks: Array | None


def _extrusion(surface: Geom_SurfaceOfLinearExtrusion, origin: Array) -> _Surface:
    basis, along = _basis(surface.BasisCurve(), origin), _vector(surface.Direction())

    def jet(a: Array, b: Array) -> Jet:
        point, slope = basis.jet(a)
        return point + b[:, None] * along, slope, np.broadcast_to(along, point.shape)

    return _Surface(jet, (basis.breaks, np.empty(0)))


def _revolution(surface: Geom_SurfaceOfRevolution, origin: Array) -> _Surface:
    basis, centre = _basis(surface.BasisCurve(), origin), _vector(surface.Location()) - origin
    axis = _vector(surface.Direction())
    quarter = np.cross(axis, np.eye(3))  # v @ quarter is axis × v

    def jet(a: Array, b: Array) -> Jet:
        cos, sin = np.cos(a)[:, None], np.sin(a)[:, None]

        def turned(vectors: Array) -> tuple[Array, Array]:
            height = (vectors @ axis)[:, None] * axis
            out, side = vectors - height, vectors @ quarter
            return height + cos * out + sin * side, cos * side - sin * out

        point, slope = basis.jet(b)
        place, swept = turned(point - centre)
        return centre + place, swept, turned(slope)[0]

    return _Surface(jet, (None, basis.breaks))


def _basis(curve: Geom_Curve, origin: Array) -> _Basis:
    if isinstance(curve, Geom_TrimmedCurve):
        return _basis(curve.BasisCurve(), origin)
    if isinstance(curve, Geom_BSplineCurve):
        data: SplineCurveData = read_curve(curve, origin)
        return _Basis(data.jet, np.unique(data.knots))
    if isinstance(curve, Geom_Line):
        start = _vector(curve.Position().Location()) - origin
        along = _vector(curve.Position().Direction())
        return _Basis(
            lambda t: (start + t[:, None] * along, np.broadcast_to(along, (len(t), 3))), np.empty(0)
        )
    if isinstance(curve, Geom_Circle):
        radii = (curve.Radius(), curve.Radius())
    elif isinstance(curve, Geom_Ellipse):
        radii = (curve.MajorRadius(), curve.MinorRadius())
    else:
        raise KernelError(f"no integral is known along a {type(curve).__name__}")
    centre, axes = _frame(curve.Position(), origin)
    x, y = radii[0] * axes[0], radii[1] * axes[1]

    def conic(t: Array) -> tuple[Array, Array]:
        cos, sin = np.cos(t)[:, None], np.sin(t)[:, None]
        return centre + cos * x + sin * y, cos * y - sin * x

    return _Basis(conic, None)


def curve_jet(curve: Geom_Curve, first: float, last: float, origin: Array) -> Jet:
    """Return points, derivatives and weights of a Gauss rule along a curve, for moments of it."""
    basis = _basis(curve, origin)
    if basis.breaks is None:
        cuts = np.linspace(first, last, 1 + max(1, int(np.ceil((last - first) / STEP))))
        count = 16
    else:
        cuts = np.array(
            [first, *basis.breaks[(basis.breaks > first) & (basis.breaks < last)], last]
        )
        count = 4
        if isinstance(curve, Geom_BSplineCurve):
            count = 2 * curve.Degree() if not curve.IsRational() else 24 + 2 * curve.Degree()
    t, weights = gauss_on(cuts, count)
    return *basis.jet(t), weights
