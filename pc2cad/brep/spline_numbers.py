"""The numbers of the kernel's splines, and splines of numbers, all at once.

One by one they take twenty to forty times longer. The kernel writes a curve or a surface into
memory, and reads it from there, as its binary files have it (``BinTools``,
https://dev.opencascade.org/doc/refman/html/class_bin_tools.html): doubles as they are.
"""

from __future__ import annotations

import io
import math
import struct
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate
from typing import Any

import numpy as np
from OCP.BinTools import BinTools_CurveSet, BinTools_SurfaceSet
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface

from pc2cad.arrays import Array, Integers
from pc2cad.errors import KernelError

_KNOT = np.dtype([("value", "<f8"), ("times", "<i4")])
#: kind, flags (rational and periodic along u and v), degrees and counts of poles and knots
_SURFACE = struct.Struct("<B4?2H4i")
_CURVE = struct.Struct("<B2?H2i")
_SPLINE_SURFACE, _SPLINE_CURVE = 9, 7


@dataclass(frozen=True, eq=False)
class Knots:
    """A knot vector as the kernel has it: distinct knots (n,), ascending, how often each comes."""

    values: Array
    counts: Integers

    @cached_property
    def are_apart(self) -> bool:
        """Whether all are finite, and apart by more than the kernel's own limit."""
        gaps = self.values[1:] - self.values[:-1]
        whole = float(self.values[-1] - self.values[0])
        return math.isfinite(whole) and (len(gaps) == 0 or float(gaps.min()) >= 1e-10 * whole)

    @cached_property
    def written(self) -> bytes:
        """What the kernel writes of them."""
        table = np.empty(len(self.values), _KNOT)
        table["value"], table["times"] = self.values, self.counts
        return table.tobytes()


def spline_surface(
    poles: Array, knots: tuple[Array, Array], degrees: tuple[int, int]
) -> Geom_BSplineSurface:
    """Return the kernel's surface of poles (n, m, 3), or (n, m, 4) with weights, and flat knots."""
    rational, (u, v) = poles.shape[-1] == 4, map(counted, knots)
    flags = (rational, rational, False, False)
    counts = (*poles.shape[:2], len(u.values), len(v.values))
    head = b"Surfaces 1\n" + _SURFACE.pack(_SPLINE_SURFACE, *flags, *degrees, *counts)
    return _read(BinTools_SurfaceSet(), head, poles, u, v).Surface(1)


def spline_curve(poles: Array, knots: Array, degree: int) -> Geom_BSplineCurve:
    """Return the kernel's curve of poles (n, 3), or (n, 4) with weights, and flat knots."""
    rational, t = poles.shape[-1] == 4, counted(knots)
    kind = _CURVE.pack(_SPLINE_CURVE, rational, False, degree, len(poles), len(t.values))
    return _read(BinTools_CurveSet(), b"Curves 1\n" + kind, poles, t).Curve(1)


def counted(flat: Array) -> Knots:
    """Return a flat knot vector as the kernel has it."""
    return _counted(np.asarray(flat, dtype=float).tobytes())


@lru_cache(maxsize=64)  # faces and edges that meet have theirs in common
def _counted(flat: bytes) -> Knots:
    values, counts = np.unique(np.frombuffer(flat), return_counts=True)
    values.flags.writeable = counts.flags.writeable = False
    return Knots(values, counts)


def _read(one: Any, head: bytes, poles: Array, *knots: Knots) -> Any:
    parts = (head, np.asarray(poles, "<f8").tobytes(), *(row.written for row in knots))
    one.Read(io.BytesIO(b"".join(parts)))
    return one


def surface_numbers(surface: Geom_BSplineSurface) -> tuple[Array, Array, Array]:
    """Return poles (n, m, 3), or (n, m, 4) with weights, and flat knots along u and v.

    Raises KernelError where the kernel writes a surface in another form than is known.
    """
    counts = (surface.NbUPoles(), surface.NbVPoles(), surface.NbUKnots(), surface.NbVKnots())
    rational = surface.IsURational() or surface.IsVRational()
    # "Surfaces 1", kind, four flags, two degrees, four counts
    data = _written(BinTools_SurfaceSet(), surface, 36)
    rows, columns, *knots = counts
    poles, (u, v) = _split(data, (rows, columns, 4 if rational else 3), knots)
    return poles, u, v


def curve_numbers(curve: Geom_BSplineCurve) -> tuple[Array, Array]:
    """Return poles (n, 3), or (n, 4) with weights, and flat knots; raise as `surface_numbers`."""
    # "Curves 1", kind, two flags, degree, two counts
    data = _written(BinTools_CurveSet(), curve, 22)
    shape = (curve.NbPoles(), 4 if curve.IsRational() else 3)
    poles, (knots,) = _split(data, shape, [curve.NbKnots()])
    return poles, knots


def _written(one: BinTools_CurveSet | BinTools_SurfaceSet, geometry: Any, head: int) -> bytes:
    stream = io.BytesIO()
    one.Add(geometry)
    one.Write(stream)
    return stream.getvalue()[head:]


def _split(data: bytes, shape: tuple[int, ...], knots: list[int]) -> tuple[Array, list[Array]]:
    size = math.prod(shape)
    if len(data) != 8 * size + _KNOT.itemsize * sum(knots):
        raise KernelError("the kernel writes a spline in a form that is not known")
    poles = np.frombuffer(data, "<f8", size).reshape(shape)
    rows = np.frombuffer(data, _KNOT, offset=8 * size)
    ends = list(accumulate(knots))
    parts = (rows[end - count : end] for count, end in zip(knots, ends, strict=True))
    return poles, [part["value"].repeat(part["times"]) for part in parts]
