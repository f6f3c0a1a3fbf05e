"""Whether the kernel takes a solid for inside out, as its readers ask before they turn one over.

Asked as `BRepClass3d_SClassifier::PerformInfinitePoint` does (OCCT 7.9 and 8.0), with its points,
lines and intersections: a line through a point of a face, along the normal into the solid, and
whether it enters or leaves where it first meets a face. The kernel prepares all faces to be met,
2 ms for a spline; here only those that may be met first.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepClass3d import BRepClass3d_SolidExplorer
from OCP.Geom import Geom_BSplineSurface
from OCP.gp import gp_Ax2, gp_Dir, gp_Lin, gp_Pnt, gp_Vec
from OCP.IntCurvesFace import IntCurvesFace_Intersector
from OCP.IntCurveSurface import IntCurveSurface_TransitionOnCurve
from OCP.math import math_BullardGenerator
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum, TopAbs_State
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape

from pc2cad.brep.from_kernel import vector
from pc2cad.brep.kernel import IndexedMapOfShape, as_face
from pc2cad.brep.spline_numbers import surface_numbers
from pc2cad.brep.tolerance import KERNEL_TOLERANCE

_FAR = sys.float_info.max
_POINTS_PER_FACE = 10
_OUT, _IN = (
    IntCurveSurface_TransitionOnCurve.IntCurveSurface_Out,
    IntCurveSurface_TransitionOnCurve.IntCurveSurface_In,
)


def inside_out(solid: TopoDS_Shape) -> bool:
    """Return whether the kernel finds that the space at infinity is within the solid.

    Its own answer, unless two faces come closer to each other than its resolution, 1e-7. False
    also where it finds no answer: it turns nothing over then.
    """
    found = IndexedMapOfShape()
    TopExp.MapShapes_s(solid, TopAbs_ShapeEnum.TopAbs_FACE, found)
    faces = [as_face(found.FindKey(i)) for i in range(1, found.Extent() + 1)]
    random = math_BullardGenerator()
    for _ in range(_POINTS_PER_FACE):
        for i, face in enumerate(faces):
            line = _inwards(face, 0.1 + 0.8 * random.NextReal())
            if line is None:
                continue
            # first the face that is met for certain: it tells of most others that they are not
            state, transition = _first([face, *faces[:i], *faces[i + 1 :]], line)
            if state == TopAbs_State.TopAbs_IN and transition in (_OUT, _IN):
                return bool(transition == _OUT)
    return False


def _inwards(face: TopoDS_Face, share: float) -> gp_Lin | None:
    """Return the line through a point of a face against its normal, if the kernel finds a point."""
    point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
    find = BRepClass3d_SolidExplorer.FindAPointInTheFace_s
    if not find(face, point, 0.0, 0.0, share, along_u, along_v):
        return None
    normal = along_u.Crossed(along_v)  # not zero, or the point would not have been found
    if face.Orientation() != TopAbs_Orientation.TopAbs_REVERSED:
        normal.Reverse()
    return gp_Lin(point, gp_Dir(normal))


def _first(faces: list[TopoDS_Face], line: gp_Lin) -> tuple[Any, Any]:
    """Return where in its face, and how, a line first meets one of the faces."""
    nearest, state, transition = _FAR, TopAbs_State.TopAbs_OUT, None
    for face in faces:
        if not _may_meet(face, line, nearest - KERNEL_TOLERANCE):
            continue
        meeting = IntCurvesFace_Intersector(face, KERNEL_TOLERANCE, True, False)
        meeting.Perform(line, -_FAR, nearest)
        if not meeting.IsDone() or meeting.NbPnt() == 0:
            continue
        one = min(range(1, meeting.NbPnt() + 1), key=meeting.WParameter)
        nearest = meeting.WParameter(one)
        state, transition = meeting.State(one), meeting.Transition(one)
    return state, transition


def _may_meet(face: TopoDS_Face, line: gp_Lin, last: float) -> bool:
    """Return false where a line is known not to meet a face before its parameter `last`.

    Known only of splines, which lie within any box around their poles; others are quickly met.
    """
    surface = BRep_Tool.Surface_s(face)
    if not isinstance(surface, Geom_BSplineSurface):
        return True
    poles = surface_numbers(surface)[0][..., :3].reshape(-1, 3) - vector(line.Location())
    if (poles @ vector(line.Direction())).min() >= last:
        return False
    across = gp_Ax2(line.Location(), line.Direction())
    beside = poles @ np.array([vector(across.XDirection()), vector(across.YDirection())]).T
    return bool(
        (beside.min(axis=0) <= KERNEL_TOLERANCE).all()
        and (beside.max(axis=0) >= -KERNEL_TOLERANCE).all()
    )
