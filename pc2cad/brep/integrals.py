"""Volume, area and centroid of a kernel solid, integrated over the geometry it really holds.

The kernel's own integrals are too coarse to judge a solid by (1e-3 by default, and wrong by more
where a wavy edge bounds a plane). Here the divergence theorem is applied to the surfaces, curves
and orientations read back from the kernel: Gauss per knot span on splines, Green's theorem along
the edges of planes. Both are exact for what they integrate, but for the square root in the area.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepTools import BRepTools_WireExplorer
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface, Geom_Line, Geom_Plane
from OCP.TopAbs import TopAbs_FACE, TopAbs_REVERSED, TopAbs_WIRE
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Edge, TopoDS_Face, TopoDS_Shape
from scipy.interpolate import BSpline
from scipy.sparse import csr_array, diags_array

from pc2cad.errors import KernelError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SolidIntegrals:
    """Integrals of a solid in model units."""

    volume: float
    area: float
    centroid: tuple[float, float, float]


def solid_integrals(solid: TopoDS_Shape) -> SolidIntegrals:
    """Return the integrals of a solid whose faces are planes and whole B-spline rectangles."""
    faces = list(_faces(solid))
    origin = _reference(faces)
    total = np.zeros(5)
    for face in faces:
        surface = BRep_Tool.Surface_s(face)
        sign = -1.0 if face.Orientation() == TopAbs_REVERSED else 1.0
        if isinstance(surface, Geom_Plane):
            total += _plane(surface, face, sign, origin)
        elif isinstance(surface, Geom_BSplineSurface):
            total += _spline(surface, sign, origin)
        else:
            raise KernelError(f"no integral is known for a {type(surface).__name__}")
    volume, area = total[0] / 3, total[1]
    centre = total[2:] / (2 * volume) + origin if volume else origin
    return SolidIntegrals(
        float(volume), float(area), (float(centre[0]), float(centre[1]), float(centre[2]))
    )


def _faces(solid: TopoDS_Shape) -> list[TopoDS_Face]:
    explorer, faces = TopExp_Explorer(solid, TopAbs_FACE), []
    while explorer.More():
        faces.append(TopoDS.Face_s(explorer.Current()))
        explorer.Next()
    return faces


def _reference(faces: list[TopoDS_Face]) -> Array:
    """Return a point amid the part, so that nothing cancels for a part far from the origin."""
    points = []
    for face in faces:
        surface = BRep_Tool.Surface_s(face)
        p = surface.Location() if isinstance(surface, Geom_Plane) else surface.Pole(1, 1)
        points.append((p.X(), p.Y(), p.Z()))
    return np.asarray(np.mean(points, axis=0))


def _flux(points: Array, normals: Array, weights: Array) -> Array:
    """Return ∬ r·n, ∬ |n| and ∬ r_i² n_i: points and normals (n, 3), weights (n,)."""
    result = np.empty(5)
    result[0] = weights @ (points * normals).sum(axis=1)
    result[1] = weights @ np.sqrt((normals * normals).sum(axis=1))
    result[2:] = weights @ (points * points * normals)
    return result


def _gauss_on(knots: Array, count: int) -> tuple[Array, Array]:
    spans = np.unique(knots)
    x, weight = np.polynomial.legendre.leggauss(count)
    half = np.diff(spans)[:, None] / 2
    nodes = (spans[:-1, None] + spans[1:, None]) / 2 + half * x
    return nodes.ravel(), (half * weight).ravel()


def _flat_knots(values: list[float], counts: list[int]) -> Array:
    return np.repeat(values, counts)


def _design(t: Array, knots: Array, degree: int, order: int) -> csr_array:
    """Return values (order 0) or first derivatives of the basis at t, (len(t), n)."""
    if order == 0:
        return csr_array(BSpline.design_matrix(t, knots, degree))
    # the derivative's control points are p (P_i+1 - P_i) / (t_i+p+1 - t_i+1)
    n = len(knots) - degree - 1
    scale = degree / (knots[degree + 1 : degree + n] - knots[1:n])
    difference = diags_array([-scale, scale], offsets=[0, 1], shape=(n - 1, n))
    return csr_array(BSpline.design_matrix(t, knots[1:-1], degree - 1) @ difference)


def _spline(surface: Geom_BSplineSurface, sign: float, origin: Array) -> Array:
    if surface.IsURational() or surface.IsVRational():
        raise KernelError("no integral is known for a rational B-spline surface")
    rows, columns = surface.NbUPoles(), surface.NbVPoles()
    poles = np.empty((rows, columns, 3))
    for i in range(rows):
        for j in range(columns):
            p = surface.Pole(i + 1, j + 1)
            poles[i, j] = (p.X(), p.Y(), p.Z())
    poles -= origin
    u = _flat_knots([surface.UKnot(i + 1) for i in range(surface.NbUKnots())],
                    [surface.UMultiplicity(i + 1) for i in range(surface.NbUKnots())])  # fmt: skip
    v = _flat_knots([surface.VKnot(i + 1) for i in range(surface.NbVKnots())],
                    [surface.VMultiplicity(i + 1) for i in range(surface.NbVKnots())])  # fmt: skip
    patch = _Patch(poles, (u, v), (surface.UDegree(), surface.VDegree()), sign)
    return patch.integrate()


@dataclass(frozen=True)
class _Patch:
    """A tensor-product spline: poles (n, m, 3), flat knots and degrees along s and t."""

    poles: Array
    knots: tuple[Array, Array]
    degrees: tuple[int, int]
    sign: float

    @property
    def _accuracy(self) -> float:
        """What the area is worth: all digits on a Bézier piece, its fit's own on a spline."""
        pieces = max(len(k) // (p + 1) for k, p in zip(self.knots, self.degrees, strict=True))
        return 1e-13 if pieces == 2 else 1e-10

    def integrate(self) -> Array:
        """Return the flux integrals with as many Gauss nodes per span as they need."""
        counts = [self._count(d) for d in (0, 1)]
        total = self._sum(counts)
        # a Bézier piece has to be right to all digits, also where it is nearly flat in a corner
        while self._accuracy < 1e-12 and max(counts) < 100:
            counts = [count + count // 2 for count in counts]
            before, total = total, self._sum(counts)
            if abs(total[1] - before[1]) <= 1e-12 * total[1]:
                break
        return total

    def _sum(self, counts: list[int]) -> Array:
        rules = [_gauss_on(self.knots[d], counts[d]) for d in (0, 1)]
        total = np.zeros(5)
        step = max(1, 200_000 // len(rules[1][0]))
        for i in range(0, len(rules[0][0]), step):
            part = (rules[0][0][i : i + step], rules[0][1][i : i + step])
            total += self._flux((part, rules[1]))
        return total

    def _count(self, direction: int) -> int:
        """Return the nodes per span along one direction, found on a few lines across it.

        Only the area needs a search: its square root is no polynomial.
        """
        ends = self.knots[1 - direction][0], self.knots[1 - direction][-1]
        shares = np.array([0.004, 0.083, 0.311, 0.547, 0.719, 0.934, 0.996])
        lines = ends[0] + (ends[1] - ends[0]) * shares
        known = None
        count = 3
        while True:
            along = _gauss_on(self.knots[direction], count)
            across = (lines, np.ones_like(lines))
            values = self._flux((along, across) if direction == 0 else (across, along))
            if known is not None and abs(values[1] - known) <= self._accuracy * abs(values[1]):
                return count
            if count > 40:
                return count
            known, count = values[1], count + 3

    def _flux(self, rules: tuple[tuple[Array, Array], tuple[Array, Array]]) -> Array:
        along, across = (
            [_design(rule[0], knots, degree, order) for order in (0, 1)]
            for rule, knots, degree in zip(rules, self.knots, self.degrees, strict=True)
        )
        point, ds, dt = (
            _tensor(a, self.poles, b)
            for a, b in ((along[0], across[0]), (along[1], across[0]), (along[0], across[1]))
        )
        weights = (rules[0][1][:, None] * rules[1][1]).ravel()
        normal = np.empty_like(ds)
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            normal[:, i] = self.sign * (ds[:, j] * dt[:, k] - ds[:, k] * dt[:, j])
        return _flux(point, normal, weights)


def _tensor(a: csr_array, poles: Array, b: csr_array) -> Array:
    """Return the values (len(a)·len(b), 3) of Σ a_i b_j P_ij."""
    n, m, _ = poles.shape
    rows = (a @ poles.reshape(n, -1)).reshape(-1, m, 3).transpose(1, 0, 2)
    values = (b @ rows.reshape(m, -1)).reshape(b.shape[0], -1, 3)
    return np.ascontiguousarray(values.transpose(1, 0, 2)).reshape(-1, 3)


def _plane(surface: Geom_Plane, face: TopoDS_Face, sign: float, origin: Array) -> Array:
    """Integrate over a plane region by Green's theorem along its edges."""
    place, frame = surface.Location(), surface.Position()
    base = np.array([place.X(), place.Y(), place.Z()]) - origin
    axes = np.array([[d.X(), d.Y(), d.Z()] for d in (frame.XDirection(), frame.YDirection())])
    normal = sign * np.cross(axes[0], axes[1])
    if not frame.Direct():
        raise KernelError("a plane is left-handed")
    moments = np.zeros(6)
    explorer = TopExp_Explorer(face, TopAbs_WIRE)
    while explorer.More():
        wire = BRepTools_WireExplorer(TopoDS.Wire_s(explorer.Current()), face)
        while wire.More():
            moments += _edge_moments(wire.Current(), base, axes, origin)
            wire.Next()
        explorer.Next()
    # the walk runs round the face's own orientation: take it back to the plane's
    area, p, q, pp, pq, qq = sign * moments
    result = np.empty(5)
    result[0] = area * (base @ normal)
    result[1] = abs(area)
    x, y = axes
    second = (
        base * base * area + 2 * base * (x * p + y * q) + x * x * pp + 2 * x * y * pq + y * y * qq
    )
    result[2:] = second * normal
    return result


def _edge_moments(edge: TopoDS_Edge, base: Array, axes: Array, origin: Array) -> Array:
    """Return ∮ of 1, p, q, p², pq, q² as line integrals over one edge: ∮ (∫ f dp) dq."""
    curve, first, last = _curve(edge)
    position, speed, weights = curve(first, last)
    local = (position - origin - base) @ axes.T
    dq = speed @ axes[1] * weights
    if edge.Orientation() == TopAbs_REVERSED:
        dq = -dq
    p, q = local[:, 0], local[:, 1]
    primitives = np.array([p, p * p / 2, p * q, p**3 / 3, p * p * q / 2, p * q * q])
    return np.asarray(primitives @ dq)


def _curve(edge: TopoDS_Edge):  # type: ignore[no-untyped-def]
    first, last = BRep_Tool.Range_s(edge)
    curve = BRep_Tool.Curve_s(edge, first, last)
    if isinstance(curve, Geom_Line):
        origin, direction = curve.Position().Location(), curve.Position().Direction()
        start = np.array([origin.X(), origin.Y(), origin.Z()])
        along = np.array([direction.X(), direction.Y(), direction.Z()])

        def line(a: float, b: float) -> tuple[Array, Array, Array]:
            t, weights = _gauss_on(np.array([a, b]), 4)
            return start + t[:, None] * along, np.broadcast_to(along, (len(t), 3)), weights

        return line, first, last
    if not isinstance(curve, Geom_BSplineCurve) or curve.IsRational():
        raise KernelError(f"no integral is known along a {type(curve).__name__}")
    poles = np.array([
        (p.X(), p.Y(), p.Z()) for p in (curve.Pole(i + 1) for i in range(curve.NbPoles()))
    ])  # fmt: skip
    knots = _flat_knots([curve.Knot(i + 1) for i in range(curve.NbKnots())],
                        [curve.Multiplicity(i + 1) for i in range(curve.NbKnots())])  # fmt: skip
    degree = curve.Degree()

    def spline(a: float, b: float) -> tuple[Array, Array, Array]:
        t, weights = _gauss_on(knots, 2 * degree)
        return (
            _design(t, knots, degree, 0) @ poles,
            _design(t, knots, degree, 1) @ poles,
            weights,
        )

    return spline, first, last
