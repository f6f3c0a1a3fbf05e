"""Does the map jump.

A step between two samples that is much larger than those beside it is either steep or a jump. Which
of them shows by halving: where the map is continuous the step becomes small with its interval, and
at a jump it stays, down to neighbouring numbers. Jumps inside the box reach its sides, unless they
close in themselves; those of the sides are found.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.domain.analysis import Analysis
from pc2cad.errors import NotASolidError
from pc2cad.solidity.face_mesh import FaceMesh, by_shape

#: a step is looked into where it exceeds both steps beside it by this factor; so many per direction
STEEP, MOST = 4.0, 4
#: halvings, down to neighbouring numbers, and the share of the step that they leave at a jump
HALVINGS, LEFT = 52, 0.25
#: faces that are looked at together
TOGETHER = 16
#: steps below this share of the part's size are left to the comparison with the tolerance
SMALLEST = 1e-6


class DiscontinuousMapError(NotASolidError):
    """The map jumps inside its box: the image falls into parts."""


def check_continuous(analysis: Analysis, face_meshes: Sequence[FaceMesh]) -> None:
    """Raise DiscontinuousMapError where the map jumps on a side."""
    for faces in by_shape(face_meshes):
        for start in range(0, len(faces), TOGETHER):
            several = [face_meshes[f] for f in faces[start : start + TOGETHER]]
            samples = np.array([face_mesh.samples for face_mesh in several])
            for axis in (0, 1):
                found = _steep(samples, axis, SMALLEST * analysis.size)
                for face_mesh, places in zip(several, found, strict=True):
                    if len(places):
                        _check(face_mesh, axis, places)


def _steep(samples: Array, axis: int, smallest: float) -> list[Integers]:
    """Return indices (k, 2) of the steps along an axis that exceed their neighbours by far.

    There is a row of them for each of several faces (n, …).
    """
    gap = np.diff(samples, axis=1 + axis)
    steps = np.moveaxis(_lengths(gap), 1 + axis, 1)
    beside = np.zeros_like(steps)
    beside[:, 1:] = steps[:, :-1]
    beside[:, :-1] = np.maximum(beside[:, :-1], steps[:, 1:])
    steep = steps > STEEP * beside + smallest
    if not steep.any():
        return [np.empty((0, 2), dtype=np.int64)] * len(samples)
    rows: list[Integers] = []
    for row, of_row in zip(steps, steep, strict=True):
        found = np.argwhere(of_row)
        found = found[np.argsort(-row[tuple(found.T)])[:MOST]]
        rows.append(found if axis == 0 else found[:, ::-1])
    return rows


def _check(face_mesh: FaceMesh, axis: int, places: Integers) -> None:
    low = places / (np.array(face_mesh.samples.shape[:2]) - 1)
    high = low.copy()
    high[:, axis] += 1 / (face_mesh.samples.shape[axis] - 1)
    ends = [face_mesh.function.at(*place.T) for place in (low, high)]
    first = _lengths(ends[1] - ends[0])
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        amid = face_mesh.function.at(*middle.T)
        known = np.isfinite(amid).all(axis=1)  # right at a jump there may be no value
        left = known & (_lengths(amid - ends[0]) > _lengths(ends[1] - amid))
        right = known & ~left
        low[right], ends[0][right] = middle[right], amid[right]
        high[left], ends[1][left] = middle[left], amid[left]
        jumps = np.flatnonzero(_lengths(ends[1] - ends[0]) > LEFT * first)
        if len(jumps) == 0:
            return
    worst = jumps[first[jumps].argmax()]
    before, after = (", ".join(f"{x:.6g}" for x in end[worst]) for end in ends)
    raise DiscontinuousMapError(
        f"the map jumps near {face_mesh.function.shown(*high[worst])}, "
        f"from ({before}) to ({after}): a solid's points follow its parameters without a gap; end "
        "the domain there, or write the equation so that it goes on (a branch cut of atan2 can be "
        "turned away)"
    )


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))
