"""Carriers of faces and edges as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: exact: same point set, coefficients rounded once; sampled: deviation measured, not proved
Evidence = Literal["exact", "sampled"]


@dataclass(frozen=True, eq=False)
class Line:
    """A straight segment; its parameter runs from 0 at `start` to 1 at `end`."""

    start: Array
    end: Array


@dataclass(frozen=True, eq=False)
class SplineCurve:
    """A clamped B-spline curve on [0, 1]: poles (n, 3), flat knots (n + degree + 1)."""

    degree: int
    knots: Array
    poles: Array


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane through `origin`; `normal` has length 1."""

    origin: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class SplineSurface:
    """A clamped tensor-product B-spline on [0, 1]²: poles (n, m, 3), first index along s."""

    degrees: tuple[int, int]
    knots: tuple[Array, Array]
    poles: Array


CurveCarrier = Line | SplineCurve
SurfaceCarrier = Plane | SplineSurface


def surface_kind(carrier: SurfaceCarrier) -> str:
    """Return what a report calls the carrier."""
    if isinstance(carrier, Plane):
        return "plane"
    single = all(len(k) == 2 * (p + 1) for k, p in zip(carrier.knots, carrier.degrees, strict=True))
    return "Bézier surface" if single else "B-spline surface"


def fit_plane(points: Array, rounding: float) -> Plane | None:
    """Return the plane that holds all points (n, 3) to `rounding` (a length), or None.

    Points on one line have no plane of their own: None.
    """
    centre = points.mean(axis=0)
    _, values, axes = np.linalg.svd(points - centre, full_matrices=False)
    if values[1] <= rounding:
        return None
    if float(np.abs((points - centre) @ axes[2]).max()) > rounding:
        return None
    return Plane(centre, axes[2])
