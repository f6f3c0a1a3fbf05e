"""Whether two shapes are one and the same by their numbers: topology, carriers and ranges.

What a file reads back as is nearly always the very numbers that were written. To compare them is
exact and costs little, where the kernel's integrals are neither: those are asked only of shapes
that are told here to differ, or that are of kinds not known here.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.Geom import (
    Geom_BSplineCurve,
    Geom_BSplineSurface,
    Geom_ConicalSurface,
    Geom_CylindricalSurface,
    Geom_ElementarySurface,
    Geom_Line,
    Geom_SphericalSurface,
    Geom_Surface,
    Geom_SurfaceOfRevolution,
    Geom_SweptSurface,
    Geom_ToroidalSurface,
)
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp, TopExp_Explorer
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Shape

from pc2cad.arrays import Array
from pc2cad.brep.from_kernel import conic_terms, vector
from pc2cad.brep.kernel import IndexedMapOfShape, as_edge, as_face, as_vertex
from pc2cad.brep.plane_solids import PlaneSolid, plane_solid
from pc2cad.brep.spline_integrals import read_curve, read_patch
from pc2cad.errors import KernelError

#: rounding of numbers that are written with 15 digits, or pass through another unit and back, in
#: units of the last place
LAST_PLACES = 64
_ORIGIN = np.zeros(3)
_KINDS = (
    TopAbs_ShapeEnum.TopAbs_SHELL, TopAbs_ShapeEnum.TopAbs_FACE, TopAbs_ShapeEnum.TopAbs_EDGE,
    TopAbs_ShapeEnum.TopAbs_VERTEX,
)  # fmt: skip

#: what a shape is made of: words that must be equal, and numbers that may be rounded
Numbers = tuple[tuple[Any, ...], Array | tuple[float, ...]]


def same_numbers(
    one: TopoDS_Shape,
    other: TopoDS_Shape,
    plain: tuple[PlaneSolid | None, PlaneSolid | None] = (None, None),
) -> bool:
    """Return whether both have the same faces, edges and vertices in the same order and places.

    Curves in the parameter planes of faces are not compared. False also where a curve or a surface
    is of a kind whose numbers are not known here. `plain` are the numbers of solids with plane
    faces where they have been read.
    """
    both = plain[0] or plane_solid(one), plain[1] or plane_solid(other)
    if both[0] and both[1] and both[0].topology == both[1].topology:
        return _agree_in_rows(both[0], both[1])
    try:
        pairs = zip(_numbers(one), _numbers(other), strict=True)
        return all(_agree(*pair) for pair in pairs)
    except (KernelError, ValueError):  # an unknown kind; one of them has more parts
        return False


def _agree(one: Numbers, other: Numbers) -> bool:
    (words, few), (others, there) = one, other
    if words != others:
        return False
    # nearly always they are equal, which is sooner told
    if isinstance(few, tuple) and few == there:
        return True
    numbers, found = np.asarray(few), np.asarray(there)
    if numbers.shape != found.shape:
        return False
    if (numbers == found).all():
        return True
    size = np.abs(numbers).max(initial=0.0)
    allowed = LAST_PLACES * sys.float_info.epsilon * size
    return bool(np.all(np.abs(numbers - found) <= allowed))


def _agree_in_rows(one: PlaneSolid, other: PlaneSolid) -> bool:
    """Return whether all numbers of solids of one topology agree, each row by its own size."""
    for few, there in zip(one.rows, other.rows, strict=True):
        if (few == there).all():
            continue
        allowed = LAST_PLACES * sys.float_info.epsilon * np.abs(few).max(axis=1, initial=0.0)
        if not (np.abs(few - there) <= allowed[:, None]).all():
            return False
    return True


def _numbers(shape: TopoDS_Shape) -> Iterator[Numbers]:
    maps = []
    for kind in _KINDS:
        found = IndexedMapOfShape()
        TopExp.MapShapes_s(shape, kind, found)
        maps.append(found)
    _, faces, edges, vertices = maps
    yield tuple(found.Extent() for found in maps), ()
    for i in range(1, vertices.Extent() + 1):
        yield (), BRep_Tool.Pnt_s(as_vertex(vertices.FindKey(i))).Coord()
    for i in range(1, edges.Extent() + 1):
        yield from _of_edge(as_edge(edges.FindKey(i)), vertices)
    for i in range(1, faces.Extent() + 1):
        yield from _of_face(as_face(faces.FindKey(i)), edges)


def _of_edge(edge: TopoDS_Edge, vertices: IndexedMapOfShape) -> Iterator[Numbers]:
    edge = as_edge(edge.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
    ends = tuple(
        vertices.FindIndex(vertex)
        for vertex in (TopExp.FirstVertex_s(edge), TopExp.LastVertex_s(edge))
    )
    if BRep_Tool.Degenerated_s(edge):
        yield (ends, "degenerated"), ()
        return
    first, last = BRep_Tool.Range_s(edge)
    yield (ends,), (first, last)
    yield from _of_curve(BRep_Tool.Curve_s(edge, first, last))


def _of_face(face: TopoDS_Face, edges: IndexedMapOfShape) -> Iterator[Numbers]:
    uses, walk = [], TopExp_Explorer(face, TopAbs_ShapeEnum.TopAbs_EDGE)
    while walk.More():
        uses.append((edges.FindIndex(walk.Current()), walk.Current().Orientation()))
        walk.Next()
    yield (face.Orientation(), tuple(uses)), ()
    yield from _of_surface(BRep_Tool.Surface_s(face))


def _of_curve(curve: Any) -> Iterator[Numbers]:
    if isinstance(curve, Geom_BSplineCurve):
        spline = read_curve(curve, _ORIGIN)
        yield (spline.degree,), spline.knots
        yield ("spline",), spline.poles
        return
    if isinstance(curve, Geom_Line):
        along = curve.Position()
        yield ("line",), along.Location().Coord() + along.Direction().Coord()
        return
    place, terms = conic_terms(curve)
    yield tuple(terms), np.array([place, *terms.values()])


def _of_surface(surface: Geom_Surface) -> Iterator[Numbers]:
    kind = type(surface).__name__
    if isinstance(surface, Geom_BSplineSurface):
        patch = read_patch(surface, _ORIGIN)
        yield (kind, patch.degrees), np.concatenate(patch.knots)
        yield (tuple(map(len, patch.knots)),), patch.poles
    elif isinstance(surface, Geom_ElementarySurface):
        place = surface.Position()
        yield (kind,), place.Location().Coord()
        x, y, z = place.XDirection(), place.YDirection(), place.Direction()
        yield (), x.Coord() + y.Coord() + z.Coord()
        yield (), _sizes(surface)
    elif isinstance(surface, Geom_SweptSurface):
        yield (kind,), vector(surface.Direction())
        if isinstance(surface, Geom_SurfaceOfRevolution):
            yield (), vector(surface.Axis().Location())
        yield from _of_curve(surface.BasisCurve())
    else:
        raise KernelError(f"the numbers of a {kind} are not known")


def _sizes(surface: Geom_ElementarySurface) -> tuple[float, ...]:
    if isinstance(surface, Geom_CylindricalSurface | Geom_SphericalSurface):
        return (surface.Radius(),)
    if isinstance(surface, Geom_ConicalSurface):
        return surface.RefRadius(), surface.SemiAngle()
    if isinstance(surface, Geom_ToroidalSurface):
        return surface.MajorRadius(), surface.MinorRadius()
    return ()
