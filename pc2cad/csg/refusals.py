"""What a refusal says of Booleans that do not hold: the two faces, the place, and what to try."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from pc2cad.arrays import Array
from pc2cad.brep.booleans import NamedEdge, NamedShape
from pc2cad.brep.pieces import cross
from pc2cad.csg.contacts import MissedCrossingError
from pc2cad.csg.own_edges import distances_between
from pc2cad.errors import KernelError, PointCadError, ToleranceNotReachedError

TRY = "move one of the bodies a little, or turn its seam away"


@contextmanager
def placed(
    last: Callable[[], NamedShape | None], also: type[PointCadError], units: str
) -> Iterator[None]:
    """Note at a KernelError, or at one of `also`, where the Boolean is worst, and what to try.

    `last` gives the shape that the last Boolean made. It is worst at the edge between two bodies
    that is farthest off its faces. Errors that name a place themselves are left as they are.
    """
    try:
        yield
    except (KernelError, also) as error:
        shape = last()
        if shape is not None and not isinstance(error, MissedCrossingError):
            error.add_note(f"{_worst(shape, units)}{TRY}")
        raise


def check_apart(name: str, first: NamedShape, second: NamedShape, depth: float) -> None:
    """Raise KernelError where shapes that have nothing in common reach so deep into one another.

    Where the kernel fails it may find nothing, and all volumes add up.
    """
    if cross(first, second, depth):
        raise KernelError(
            f"{name}: the CAD kernel finds nothing that the bodies have in common, and they reach "
            "into one another"
        )


def off_its_faces(
    edge: NamedEdge, off: float, place: Array, units: str, tolerance: float
) -> ToleranceNotReachedError:
    """Return what is said of an edge that is `off` (a length) its faces, most at a place (3,)."""
    where = ", ".join(f"{x:.6g}" for x in place.tolist())
    return ToleranceNotReachedError(
        f"the kernel's edge {edge.label} is {off:.2g} {units} off its faces near ({where}), and "
        f"the tolerance is {tolerance:.2g}; move one of the bodies a little, or choose a larger "
        "tolerance"
    )


def with_notes(error: Exception) -> str:
    """Return the message of an error and what has been noted at it."""
    return "; ".join([str(error), *getattr(error, "__notes__", ())])


def _worst(shape: NamedShape, units: str) -> str:
    """Return in words which edge between bodies is farthest off its faces; nothing without any."""
    found = max(distances_between(shape), key=lambda row: row[1], default=None)
    if found is None:
        return ""
    edge, off, point = found
    place = ", ".join(f"{x:.6g}" for x in np.asarray(point).tolist())
    return (
        f"the edge {edge.label} is the farthest off its faces, {off:.2g} {units} near ({place}): "
    )
