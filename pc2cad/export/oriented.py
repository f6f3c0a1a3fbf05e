"""Axes of materials that turn with the solid, as solvers have them: a system for each element."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pc2cad.arrays import Array
from pc2cad.errors import InputError
from pc2cad.mesh.volume_mesh import VolumeMesh

#: what the program calls the systems; sets and materials have other names
DISTRIBUTION, ORIENTATION = "turned", "along"
#: sine of the least angle between the two directions of a system
LEAST_ANGLE = 1e-6


def check_orientation(mesh: VolumeMesh, names: tuple[str, str]) -> None:
    """Raise InputError unless both directions are known, and not one."""
    known = () if mesh.columns is None else mesh.columns.directions
    for name in names:
        if name not in known:
            raise InputError(
                f"no direction is called '{name[:40]}': there are {', '.join(known) or 'none'}"
            )
    if names[0] == names[1]:
        raise InputError(f"an orientation takes two directions, and not {names[0]} twice")


def orientation(mesh: VolumeMesh, first: str, second: str) -> Iterator[str]:
    """Give the lines of a rectangular system for every element: axis 1, and one in plane 1-2.

    An element is in one distribution, and a distribution belongs to one orientation: there is one
    of each. Raises InputError where the directions of an element are parallel, or vanish.
    """
    assert mesh.columns is not None
    yield f"*DISTRIBUTION, NAME={DISTRIBUTION}"
    yield ", 1., 0., 0., 0., 1., 0."
    for kind in mesh.blocks:
        a, b = (_unit(mesh.columns.directed(name, kind)) for name in (first, second))
        sine = np.sqrt((np.cross(a, b) ** 2).sum(axis=1))
        if not (sine > LEAST_ANGLE).all():
            raise InputError(
                f"{first} and {second} have no two directions in the element "
                f"{mesh.first_element(kind) + int(np.argmin(np.nan_to_num(sine))) + 1}: axes are "
                "not known there"
            )
        start = mesh.first_element(kind) + 1
        for number, row in enumerate(np.hstack((a, b)).tolist(), start=start):
            yield f"{number}, " + ", ".join(f"{x:.14g}" for x in row)
    yield f"*ORIENTATION, NAME={ORIENTATION}, SYSTEM=RECTANGULAR"
    yield DISTRIBUTION


def _unit(rows: Array) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(rows / np.sqrt((rows * rows).sum(axis=1))[:, None])
