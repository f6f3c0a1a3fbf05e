"""Which rectangle of its surface's own parameters a face is.

Input: a face on a surface that is no plane. Output: the rectangle, and which side of the face is
which of it. Where two sides of a face are joined to one another, it goes round, and where the seam
runs is of no account: the rectangle's own seam stands for it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.geometry.carriers import Plane, Segment, Torus, ends_of
from pc2cad.representation.boundary_model import ModelFace
from pc2cad.topology.complex import EdgeUse

#: sides of a rectangle of parameters are at its limits to this share of it
AT_LIMIT = 1e-9
TURN: Final = 2 * np.pi

Range = tuple[float, float]
#: the ranges of both parameters; per side (t low, s high, t high, s low) its use, and whether its
#: edge runs upwards along it
Rectangle = tuple[tuple[Range, Range], list[tuple[EdgeUse, bool]]]


def rectangle_of(face: ModelFace) -> Rectangle | None:
    """Return the rectangle of parameters that a face is; None for others."""
    return _bounded(face) or _round(face)


def _bounded(face: ModelFace) -> Rectangle | None:
    """Return the rectangle whose sides are the face's."""
    curves = [(use, c) for use, c in zip(face.uses, face.pcurves, strict=True) if c is not None]
    segments = [(use, curve) for use, curve in curves if isinstance(curve, Segment)]
    if len(segments) < len(curves):
        return None
    ends = np.array([(curve.start, curve.end) for _, curve in segments])
    low, high = ends.min(axis=(0, 1)), ends.max(axis=(0, 1))
    found: dict[int, tuple[EdgeUse, bool]] = {}
    for (use, _), (start, end) in zip(segments, ends, strict=True):
        for k, (axis, limit) in enumerate(((1, low), (0, high), (1, high), (0, low))):
            slack = AT_LIMIT * (high - low)
            on = np.abs(np.array([start, end])[:, axis] - limit[axis]).max() <= slack[axis]
            along = 1 - axis
            reach = abs(abs(end[along] - start[along]) - (high - low)[along]) <= slack[along]
            if on and reach and k not in found:
                found[k] = use, bool(end[along] > start[along])
                break
        else:
            return None
    if sorted(found) != [0, 1, 2, 3]:
        return None
    a, b = ((float(x), float(y)) for x, y in zip(low, high, strict=True))
    return (a, b), [found[k] for k in range(4)]


def _round(face: ModelFace) -> Rectangle | None:
    """Return the rectangle of a face two opposite sides of which are joined to one another."""
    seams = [k for k in (0, 1) if _joined(face.uses[k], face.uses[k + 2])]
    if isinstance(face.carrier, Plane) or any(curve is None for curve in face.pcurves):
        return None
    if len(seams) == 2 and isinstance(face.carrier, Torus):
        once = abs(_turns(face) - 1) < 0.5
        return (((0.0, TURN), (0.0, TURN)), [(use, True) for use in face.uses]) if once else None
    return _band(face, seams[0]) if len(seams) == 1 else None


def _joined(one: EdgeUse, other: EdgeUse) -> bool:
    return one.edge is not None and one.edge == other.edge and one.forward != other.forward


def _turns(face: ModelFace) -> float:
    """Return how often the region of a face covers a surface that closes in both parameters.

    It is a whole number: parameters beside the sides are those of the other side, turns apart.
    """
    corners = np.array([_walked(face, k)[0] for k in range(4)])
    # what opposite sides bulge cancels: they are one curve, a step apart
    first, second = corners[1] - corners[0], corners[3] - corners[0]
    return abs(float(first[0] * second[1] - first[1] * second[0])) / TURN**2


def _walked(face: ModelFace, k: int) -> Array:
    """Return start and end of a side in parameters, (2, 2), in the direction of the walk."""
    curve = face.pcurves[k]
    assert curve is not None
    ends = ends_of(curve)
    return ends if face.uses[k].forward else ends[::-1]


def _band(face: ModelFace, seam: int) -> Rectangle | None:
    """Return the rectangle of a face that goes round once between two lines of its parameters."""
    across = (1 - seam, 3 - seam)
    lines = [face.pcurves[k] for k in across]
    if not all(isinstance(line, Segment) for line in lines):
        return None
    ends = np.array([ends_of(line) for line in lines if line is not None])
    lengths = np.abs(ends[:, 1] - ends[:, 0])
    for fixed in (0, 1):
        along = 1 - fixed
        if along == 1 and not isinstance(face.carrier, Torus):
            continue
        starts = ends[..., along].min(axis=1)
        turns = (starts[1] - starts[0]) / TURN
        gaps = [*lengths[:, fixed], *(lengths[:, along] - TURN), (turns - round(turns)) * TURN]
        places = ends[:, 0, fixed]
        apart = abs(places[1] - places[0])
        if np.abs(gaps).max() > AT_LIMIT * TURN or not apart > AT_LIMIT:
            continue
        order = np.argsort(places)
        slope = _walked(face, seam)
        (low, high), start = np.sort(places).tolist(), float(starts[order[0]])
        rises = bool((slope[1] - slope[0])[fixed] > 0) == face.uses[seam].forward
        lower, upper = (
            (face.uses[across[i]], bool(ends[i, 1, along] > ends[i, 0, along])) for i in order
        )
        seams = [(face.uses[k], rises) for k in (seam, seam + 2)]
        ring = (start, start + TURN)
        if fixed == 1:
            return (ring, (low, high)), [lower, seams[0], upper, seams[1]]
        return ((low, high), ring), [seams[0], upper, seams[1], lower]
    return None
