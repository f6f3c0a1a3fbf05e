"""Curves in the parameters of a surface, where a file has them: each lies on its edge in space."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any, Protocol

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import product
from pc2cad.verify.curves import WRAPPERS, Curve, OpenConic, domain_of, read_curve
from pc2cad.verify.defects import StepDefectError
from pc2cad.verify.edges import Edge
from pc2cad.verify.faces import JudgedFace
from pc2cad.verify.records import Records, sequence
from pc2cad.verify.surfaces import Pushed, Round, Spun, Surface, read_surface

_SHARES = np.linspace(0.0, 1.0, 17)


class _Carrier(Protocol):
    def place(self, uv: Array) -> Array: ...

    def parameters(self, points: Array) -> Array: ...


class _Plane:
    def __init__(self, frame: tuple[Array, Array]) -> None:
        self._origin, self._axes = frame

    def place(self, uv: Array) -> Array:
        return self._origin + product(uv, self._axes[:2])

    def parameters(self, points: Array) -> Array:
        return product(points - self._origin, self._axes[:2].T)


class _Curved:
    """A surface, whose angles a file gives in its own unit."""

    def __init__(self, surface: Surface, radian: float, unit: float = 1.0) -> None:
        self._surface, self._scale = surface, np.ones(2)
        self._scale[0 if isinstance(surface, Pushed) else 1] = unit
        if isinstance(surface, Round | Spun):
            self._scale[0] = radian
        if isinstance(surface, Round) and np.isfinite(surface.limits[1]).all():
            self._scale[1] = radian
        if isinstance(surface, Round) and surface.periods[1] is not None:
            self._scale[1] = radian

    def place(self, uv: Array) -> Array:
        u, v = (uv * self._scale).T
        return self._surface.at(u, v)[0]

    def parameters(self, points: Array) -> Array:
        return np.stack(self._surface.locate(points), axis=1) / self._scale


def check_pcurves(records: Records, judged: JudgedFace, radian: float, limit: float) -> None:
    """Ask every curve in the parameters of a face's surface to lie on its edge in space.

    Raises:
        StepDefectError: one is further than `limit` from its edge, or does not run along all of it.
        StepUnknownError: its kind is not known.

    """
    face = judged.face
    found = [
        (edge, ref) for edge in face.edges.values() for ref in _pcurves(records, edge, face.surface)
    ]
    if not found:
        return
    flat = records.flat()
    carriers: list[_Carrier]
    if face.carrier == "PLANE":
        carriers = [_Plane(records.frame(records.get(face.surface).values(2)[1]))]
    else:
        surface = judged.surface or read_surface(records, face.surface, radian)
        swept = surface.curve if isinstance(surface, Spun | Pushed) else None
        # of swept parabolas OCCT writes its own parameter, a length, where the standard has another
        units = {1.0, swept.unit} if isinstance(swept, OpenConic) else {1.0}
        carriers = [_Curved(surface, radian, unit) for unit in sorted(units)]
    for edge, ref in found:
        (line,) = sequence(records.get(ref, "DEFINITIONAL_REPRESENTATION").values(2)[1])
        drawn = read_curve(flat, line)
        off = np.inf
        for way in chain.from_iterable(_distances(each, edge, drawn, limit) for each in carriers):
            off = min(off, way)
            if off <= limit:
                break
        else:
            raise StepDefectError(
                f"the curve {line} in the parameters of the face {face.label} is {off:.2g} off "
                f"its edge {edge.ref}"
            )


def _pcurves(records: Records, edge: Edge, surface: Any) -> Iterator[Any]:
    """Yield the representations of an edge's curves in the parameters of a surface."""
    curve = records.get(records.get(edge.ref, "EDGE_CURVE").values(5)[3])
    if curve.keyword in WRAPPERS and len(curve.values()) > 2:
        for ref in sequence(curve.values()[2]):
            record = records.get(ref)
            if record.keyword == "PCURVE" and record.values(3)[1] == surface:
                yield record.values()[2]


def _distances(carrier: _Carrier, edge: Edge, curve: Curve, limit: float) -> Iterator[float]:
    """Yield how far the curve is from the edge, by each way to tell which part of it is meant.

    Its parameters are those of the curve in space, as most programs have it, or a turn away; or the
    ends are where the edge's are, or those of the curve itself.
    """
    for begin, end in _intervals(carrier, edge, curve):
        if not np.isfinite([begin, end]).all() or begin == end:
            continue
        t = begin + (end - begin) * _SHARES
        places = carrier.place(curve.at(t)[0][:, :2])
        off = np.inf
        if (begin, end) == edge.interval:  # as most files have it: no place has to be looked for
            off = _apart(edge.curve.at(t)[0], places)
        if not off <= limit:
            off = _apart(edge.curve.at(edge.curve.locate(places))[0], places)
        gaps = np.linalg.norm(places[[0, -1]] - edge.samples[[[0, -1], [-1, 0]]], axis=2).max(
            axis=1
        )
        whole = max(off, float(gaps.min()))
        if np.isfinite(whole):
            yield whole


def _apart(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other, axis=1).max())


def _intervals(carrier: _Carrier, edge: Edge, curve: Curve) -> Iterator[tuple[float, float]]:
    first, last = edge.interval
    yield first, last
    if edge.curve.period is not None:
        for turn in (edge.curve.period, -edge.curve.period):
            yield first + turn, last + turn
    ends = carrier.parameters(edge.samples[[0, -1]])
    first, last = (float(t) for t in curve.locate(np.pad(ends, ((0, 0), (0, 1)))))
    yield first, last
    yield domain_of(curve)
