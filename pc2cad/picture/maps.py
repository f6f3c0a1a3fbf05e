"""Numbers over the faces: deviation from the equation, thickness of the wall, fields."""

from __future__ import annotations

from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.gp import gp_Pnt, gp_Vec
from OCP.ShapeAnalysis import ShapeAnalysis_Surface

from pc2cad.arrays import Array
from pc2cad.domain.fields import LocalField
from pc2cad.domain.map import open_grid
from pc2cad.errors import InputError
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.picture.sides import Patch, Sides


class NoWallError(InputError):
    """No two opposite sides are both faces, so that there is no wall between them."""


def deviations(patch: Patch, size: float) -> Array:
    """Return the distance from each point of the equation to the kernel's surface, (n, m).

    It is the part across the surface of the vector to a point that is nearest up to rounding,
    sampled; where the surface has no normal it is the whole of it. `size` is that of the part.
    """
    surface = BRep_Tool.Surface_s(patch.face)
    projector = ShapeAnalysis_Surface(surface)
    result = np.empty(patch.points.shape[:2])
    for i, row in enumerate(patch.points):
        place = None
        for j, point in enumerate(row):
            target = gp_Pnt(*map(float, point))
            place = (
                projector.ValueOfUV(target, 1e-9 * size)
                if place is None
                else projector.NextValueOfUV(place, target, 1e-9 * size, -1.0)
            )
            result[i, j] = _across(surface, place, target)
    return result


def _across(surface: Any, place: Any, target: gp_Pnt) -> float:
    foot, first, second = gp_Pnt(), gp_Vec(), gp_Vec()
    surface.D1(place.X(), place.Y(), foot, first, second)
    normal = first.Crossed(second)
    gap = gp_Vec(foot, target)
    scale = first.Magnitude() * second.Magnitude()
    if not normal.Magnitude() > 1e-6 * scale:
        return float(gap.Magnitude())
    return abs(float(gap.Dot(normal))) / float(normal.Magnitude())


def numbers_of(patches: list[Patch], field: LocalField) -> list[Array]:
    """Return a field's values for each patch, (n, m); raise InputError unless it is a scalar.

    Raises FieldNotFiniteError at a place where it has none.
    """
    kind = field.field.kind
    if kind != "scalar":
        raise InputError(
            f"colours show one number, and the field {field.field.name} is a {kind}: make a "
            "field of its length or of one of its components"
        )
    result = []
    for patch in patches:
        places = np.stack(np.broadcast_arrays(*open_grid(*patch.axes)), axis=-1)
        values = field.checked_at(places.reshape(-1, 3), patch.points.reshape(-1, 3))
        result.append(values.reshape(patch.points.shape[:2]))
    return result


def wall_direction(sides: Sides, asked: str | None) -> int:
    """Return the direction across the wall: the one asked for, or the thinnest.

    Raises NoWallError where its two sides are not both faces.
    """
    limits: dict[int, set[int]] = {}
    for patch in sides.patches(2):
        limits.setdefault(patch.direction, set()).add(patch.limit)
    walls = [d for d, found in sorted(limits.items()) if len(found) == 2]
    if asked is not None:
        if asked not in PARAMETERS or PARAMETERS.index(asked) not in walls:
            known = ", ".join(PARAMETERS[d] for d in walls) or "none"
            raise NoWallError(
                f"there is no wall along {asked}: it takes two opposite sides that are faces "
                f"(here: {known})"
            )
        return PARAMETERS.index(asked)
    if not walls:
        raise NoWallError("no two opposite sides of the box are both faces: there is no wall")
    cloud = sides.inside((9, 9, 9))

    def thickness(direction: int) -> float:
        ends = np.take(cloud, -1, axis=direction) - np.take(cloud, 0, axis=direction)
        return float(np.median(np.linalg.norm(ends, axis=-1)))

    return min(walls, key=thickness)


def thicknesses(patches: list[Patch], direction: int) -> list[Array]:
    """Return for each patch the shortest distance from its points to the opposite side, (n, m).

    The opposite side is taken as triangles between its own points: sampled. Patches that do not
    belong to the wall get no number.
    """
    result = []
    for patch in patches:
        if patch.direction != direction:
            result.append(np.full(patch.points.shape[:2], np.nan))
            continue
        others = [p for p in patches if p.direction == direction and p.limit != patch.limit]
        rows = [_distances(patch, other) for other in others]
        result.append(np.min(rows, axis=0))
    return result


def _distances(patch: Patch, other: Patch) -> Array:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkDoubleArray
    from vtkmodules.vtkFiltersCore import vtkImplicitPolyDataDistance

    from pc2cad.picture.raster import array, polydata

    distance = vtkImplicitPolyDataDistance()
    distance.SetInput(polydata(other.points.reshape(-1, 3), other.triangles))
    values = vtkDoubleArray()
    distance.FunctionValue(array(patch.points.reshape(-1, 3)), values)
    result: Array = np.abs(vtk_to_numpy(values)).reshape(patch.points.shape[:2])
    return result
