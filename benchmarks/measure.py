"""What a face or a solid is worth, measured the same way for everybody.

The deviation is a geometric distance: from points of the true wall, off all samples, to the nearest
point of the surfaces that the kernel holds, found by Newton's method in NumPy. Volumes are pc2cad's
own integrals over the B-rep (the divergence theorem on its splines); `~` marks the kernel's
integral, where a face is none that they know.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.BRepTools import BRepTools
from OCP.Geom import Geom_BSplineSurface, Geom_Plane, Geom_RectangularTrimmedSurface
from OCP.GeomConvert import GeomConvert
from OCP.GProp import GProp_GProps
from OCP.IFSelect import IFSelect_RetDone
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Reader, STEPControl_Writer
from OCP.TopAbs import TopAbs_FACE, TopAbs_ShapeEnum, TopAbs_SOLID
from OCP.TopExp import TopExp_Explorer
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree

from benchmarks.channels import Channel
from pc2cad.brep.inspect import inspect
from pc2cad.brep.integrals import solid_integrals
from pc2cad.brep.kernel import as_face
from pc2cad.errors import KernelError

#: points of each wall whose distance is measured
PLACES = 3800


def children(shape, kind: TopAbs_ShapeEnum) -> list:
    explorer, found = TopExp_Explorer(shape, kind), []
    while explorer.More():
        found.append(explorer.Current())
        explorer.Next()
    return found


def faces_of(shape) -> list:
    return [as_face(face) for face in children(shape, TopAbs_FACE)]


class Surface:
    """A kernel B-spline surface read into arrays."""

    def __init__(self, surface: Geom_BSplineSurface) -> None:
        surface = surface.Copy()
        if surface.IsUPeriodic():
            surface.SetUNotPeriodic()
        if surface.IsVPeriodic():
            surface.SetVNotPeriodic()
        rows, columns = surface.NbUPoles(), surface.NbVPoles()
        poles = np.empty((rows, columns, 4))
        for i in range(rows):
            for j in range(columns):
                p, weight = surface.Pole(i + 1, j + 1), surface.Weight(i + 1, j + 1)
                poles[i, j] = (p.X() * weight, p.Y() * weight, p.Z() * weight, weight)
        self.poles = poles
        self.degrees = surface.UDegree(), surface.VDegree()
        self.knots = (
            np.repeat([surface.UKnot(i + 1) for i in range(surface.NbUKnots())],
                      [surface.UMultiplicity(i + 1) for i in range(surface.NbUKnots())]),
            np.repeat([surface.VKnot(i + 1) for i in range(surface.NbVKnots())],
                      [surface.VMultiplicity(i + 1) for i in range(surface.NbVKnots())]),
        )  # fmt: skip

    @property
    def size(self) -> tuple[int, int]:
        return self.poles.shape[:2]

    def limits(self, axis: int) -> tuple[float, float]:
        """Return the range of a parameter; knots may reach beyond it."""
        knots, p = self.knots[axis], self.degrees[axis]
        return float(knots[p]), float(knots[-p - 1])

    def _basis(self, t: np.ndarray, axis: int, order: int) -> np.ndarray:
        knots, p = self.knots[axis], self.degrees[axis]
        if order == 0:
            return BSpline.design_matrix(t, knots, p).toarray()
        n = len(knots) - p - 1
        lower = BSpline.design_matrix(t, knots[1:-1], p - 1).toarray()
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = p / (knots[p + 1 : p + n] - knots[1:n])
        scale = np.where(np.isfinite(scale), scale, 0.0)
        matrix = np.zeros((len(t), n))
        matrix[:, :-1] -= lower * scale
        matrix[:, 1:] += lower * scale
        return matrix

    def frame(self, s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return S, S_s and S_t at places (n,)."""
        results = []
        for order_s, order_t in ((0, 0), (1, 0), (0, 1)):
            rows = self._basis(s, 0, order_s) @ self.poles.reshape(len(self.poles), -1)
            rows = rows.reshape(len(s), -1, 4)
            results.append((self._basis(t, 1, order_t)[:, :, None] * rows).sum(axis=1))
        value, along_s, along_t = results
        weight = value[:, 3:]
        point = value[:, :3] / weight
        return (
            point,
            (along_s[:, :3] - point * along_s[:, 3:]) / weight,
            (along_t[:, :3] - point * along_t[:, 3:]) / weight,
        )

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Return the distance of points (n, 3) to the surface."""
        s, t = (self._grid(axis) for axis in (0, 1))
        rows = np.tensordot(self._basis(s, 0, 0), self.poles, axes=1)
        grid = np.einsum("tj,sjx->stx", self._basis(t, 1, 0), rows)
        grid = (grid[..., :3] / grid[..., 3:]).reshape(-1, 3)
        index = cKDTree(grid).query(points)[1]
        a, b = s[index // len(t)], t[index % len(t)]
        best = self._descend(points, a, b)
        # a closed surface may have its foot beyond the seam at which the way down has ended
        for axis, start in ((0, a), (1, b)):
            low, high = self.limits(axis)
            near = np.flatnonzero(np.minimum(start - low, high - start) < 0.1 * (high - low))
            other = [a[near], b[near]]
            other[axis] = np.where(start[near] - low < high - start[near], high, low)
            best[near] = np.minimum(best[near], self._descend(points[near], *other))
        return best

    def _descend(self, points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        parts = range(0, len(points), 500)
        found = [self._newton(*(x[i : i + 500] for x in (points, a, b))) for i in parts]
        return np.concatenate(found) if found else np.empty(0)

    def _newton(self, points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        best = np.full(len(points), np.inf)
        for _ in range(7):
            value, u, v = self.frame(a, b)
            rest = points - value
            best = np.minimum(best, np.linalg.norm(rest, axis=1))
            uu, uv, vv = ((x * y).sum(axis=1) for x, y in ((u, u), (u, v), (v, v)))
            ru, rv = (rest * u).sum(axis=1), (rest * v).sum(axis=1)
            det = np.maximum(uu * vv - uv * uv, 1e-300)
            a = np.clip(a + (vv * ru - uv * rv) / det, *self.limits(0))
            b = np.clip(b + (uu * rv - uv * ru) / det, *self.limits(1))
        return best

    def _grid(self, axis: int) -> np.ndarray:
        low, high = self.limits(axis)
        spans = np.unique(np.clip(self.knots[axis], low, high))
        each = max(3, -(-120 // (len(spans) - 1)))
        shares = np.arange(each) / each
        return np.append((spans[:-1, None] + np.diff(spans)[:, None] * shares).ravel(), spans[-1])


def spline_of(face) -> Surface | None:
    """Return the B-spline that carries a face, None for a plane."""
    surface = BRep_Tool.Surface_s(face)
    if isinstance(surface, Geom_RectangularTrimmedSurface):
        surface = surface.BasisSurface()
    if isinstance(surface, Geom_Plane):
        return None
    if not isinstance(surface, Geom_BSplineSurface):
        bounds = BRepTools.UVBounds_s(face)
        surface = GeomConvert.SurfaceToBSplineSurface_s(
            Geom_RectangularTrimmedSurface(surface, *bounds)
        )
    return Surface(surface)


def true_points(channel: Channel, w: float) -> np.ndarray:
    generator = np.random.default_rng(11)
    u, v = generator.uniform(size=(2, PLACES))
    edge = PLACES // 20
    # the limits belong to the wall
    u[:edge], u[edge : 2 * edge], v[2 * edge : 3 * edge] = 0.0, 1.0, 0.0
    return channel.points(w, u, v)


def deviation(channel: Channel, faces: list, walls: tuple[float, ...]) -> float:
    """Return the largest distance of the true walls to the nearest face."""
    surfaces = [surface for face in faces if (surface := spline_of(face)) is not None]
    worst = 0.0
    for w in walls:
        points = true_points(channel, w)
        nearest = np.min([surface.distances(points) for surface in surfaces], axis=0)
        worst = max(worst, float(nearest.max()))
    return worst


def poles_of(faces: list) -> str:
    """Return degrees and poles of the spline face with the most poles."""
    surfaces = [surface for face in faces if (surface := spline_of(face)) is not None]
    if not surfaces:
        return "-"
    largest = max(surfaces, key=lambda s: s.size[0] * s.size[1])
    degree = "x".join(str(d) for d in largest.degrees)
    return f"{degree}: {largest.size[0]}x{largest.size[1]}"


@dataclass(frozen=True)
class SolidFindings:
    """Whether a shape is one valid closed solid, and its relative volume error."""

    valid: bool
    volume_error: float
    kernel_integral: bool
    trouble: str = ""

    @property
    def text(self) -> str:
        mark = "~" if self.kernel_integral else ""
        return f"{'valid' if self.valid else self.trouble}, {mark}{self.volume_error:+.0e}"


def examine(shape, volume: float) -> SolidFindings:
    """Return what a shape is worth as a solid of a given volume."""
    if shape is None or shape.IsNull():
        return SolidFindings(False, np.nan, False, "no shape")
    solids = children(shape, TopAbs_SOLID)
    findings = inspect(shape)
    if len(solids) != 1:
        trouble = f"{len(solids)} solids"
    elif not findings.valid:
        trouble = "invalid"
    else:
        trouble = f"{findings.free_edges} open edges" if findings.free_edges else ""
    kernel = False
    try:
        found = solid_integrals(shape).volume
        if abs(found / volume - 1) > 1e-3:
            raise KernelError("a face is trimmed")
    except (KernelError, ValueError, ZeroDivisionError):
        kernel = True
        properties = GProp_GProps()
        BRepGProp.VolumeProperties_s(shape, properties, 1e-9)
        found = properties.Mass()
    return SolidFindings(not trouble, found / volume - 1, kernel, trouble)


def read_back(shape, path: str):
    """Write a shape as STEP with the kernel's own writer and return what comes back."""
    writer = STEPControl_Writer()
    writer.Transfer(shape, STEPControl_AsIs)
    if writer.Write(path) != IFSelect_RetDone:
        return None
    reader = STEPControl_Reader()
    if reader.ReadFile(path) != IFSelect_RetDone:
        return None
    reader.TransferRoots()
    return reader.OneShape()


def is_valid(shape) -> bool:
    return bool(BRepCheck_Analyzer(shape).IsValid())
