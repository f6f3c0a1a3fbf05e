"""Triangles upon the kernel's solid for whoever displays it, as fine as the finest viewers ask for.

Viewers of CadQuery have the kernel mesh a solid at first sight: half a minute for two walls of a
thousand poles. They take the triangles that are there if those are as fine as what they ask for.
Triangles are beside the geometry: no file is made from them but by programs that want triangles.
"""

from __future__ import annotations

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepBndLib import BRepBndLib
from OCP.Geom import Geom_ElementarySurface
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Shape

from pc2cad.brep.face_patches import shapes_of
from pc2cad.brep.kernel import as_face
from pc2cad.brep.triangle_grids import attach

#: deflection as a share of the largest extent: CQ-editor's coefficient, four times as the kernel
#: takes it; and the angle in radians that CQ-editor and CadQuery ask for
FINEST, ANGLE = 4e-5, 0.1
#: triangles that a part may have for this; beyond it they are coarser
MOST_TRIANGLES = 400_000


def attach_for_display(solid: TopoDS_Shape) -> float | None:
    """Put triangles upon the curved faces of a solid, and return their deflection in model units.

    None, and nothing is done, where there are some already, where the kernel is as fast (planes,
    cylinders, cones, spheres and tori) and where no face can have a grid.
    """
    faces = [as_face(face) for face in shapes_of(solid, TopAbs_ShapeEnum.TopAbs_FACE)]
    place = TopLoc_Location()
    if any(BRep_Tool.Triangulation_s(face, place) is not None for face in faces) or all(
        isinstance(BRep_Tool.Surface_s(face), Geom_ElementarySurface) for face in faces
    ):
        return None
    box = Bnd_Box()
    BRepBndLib.Add_s(solid, box, False)
    if box.IsVoid():
        return None
    low, high = box.CornerMin(), box.CornerMax()
    deflection = FINEST * float(np.max(np.subtract(high.Coord(), low.Coord())))
    for _ in range(6):
        if attach(solid, deflection, ANGLE, MOST_TRIANGLES):
            return deflection
        deflection *= 4
    return None
