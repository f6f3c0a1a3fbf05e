"""Numbers of plane solids, read at once: what the kernel says of each one by one."""

from __future__ import annotations

import numpy as np
import pytest
from OCP.BRep import BRep_Builder
from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder, BRepPrimAPI_MakeWedge
from OCP.gp import gp_Ax1, gp_Dir, gp_Pnt, gp_Trsf, gp_Vec
from OCP.ShapeAnalysis import ShapeAnalysis_ShapeTolerance
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Shell, TopoDS_Solid

from pc2cad import compile_equation, read_template
from pc2cad.brep import plane_solids
from pc2cad.brep.inspect import inspect
from pc2cad.brep.integrals import KnownFaces, faces_of, solid_integrals
from pc2cad.brep.kernel import as_edge, as_solid, children, compound
from pc2cad.brep.plane_solids import plane_solid
from pc2cad.brep.same_numbers import same_numbers


def placed(shape):
    turn, step = gp_Trsf(), gp_Trsf()
    turn.SetRotation(gp_Ax1(gp_Pnt(1, 2, 3), gp_Dir(3, -1, 2)), 0.7)
    step.SetTranslation(gp_Vec(11.0, -7.0, 5.0))
    return as_solid(BRepBuilderAPI_Transform(shape, step.Multiplied(turn), True).Shape())


def frame():
    """A block with a square hole through it: faces with two wires."""
    block = BRepPrimAPI_MakeBox(gp_Pnt(0, 0, 0), 4.0, 4.0, 1.0).Solid()
    hole = BRepPrimAPI_MakeBox(gp_Pnt(1, 1, -1), 2.0, 2.0, 3.0).Solid()
    return cut(block, hole)


def bracket():
    """A block without a corner: faces that are not convex."""
    block = BRepPrimAPI_MakeBox(gp_Pnt(0, 0, 0), 4.0, 4.0, 1.0).Solid()
    return cut(block, BRepPrimAPI_MakeBox(gp_Pnt(1, 1, -1), 5.0, 5.0, 3.0).Solid())


def cut(block, hole):
    walk = TopExp_Explorer(BRepAlgoAPI_Cut(block, hole).Shape(), TopAbs_ShapeEnum.TopAbs_SOLID)
    return as_solid(walk.Current())


SOLIDS = {
    "box": (lambda: BRepPrimAPI_MakeBox(2.0, 3.0, 4.0).Solid(), 24.0),
    "wedge": (lambda: as_solid(BRepPrimAPI_MakeWedge(2.0, 3.0, 4.0, 1.0).Shape()), 18.0),
    "frame": (frame, 12.0),
    "bracket": (bracket, 7.0),
}


def one_by_one(solid):
    known = KnownFaces()
    known.origin = np.array([2.0, 1.0, 3.0])
    return solid_integrals(solid, known)


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("turned", [False, True])
def test_integrals_are_those_of_the_faces_one_by_one(name, turned):
    build, volume = SOLIDS[name]
    solid = placed(build())
    if turned:
        solid = as_solid(solid.Reversed())
    known = plane_solid(solid)
    assert known is not None
    assert known.walks is not None
    together, alone = solid_integrals(solid), one_by_one(solid)
    assert together.volume == pytest.approx(-volume if turned else volume, rel=1e-13)
    assert together.volume == pytest.approx(alone.volume, rel=1e-13)
    assert together.face_areas == pytest.approx(alone.face_areas, rel=1e-13)
    assert together.centroid == pytest.approx(alone.centroid, rel=1e-13)


@pytest.mark.parametrize("name", SOLIDS)
def test_the_numbers_tell_what_the_kernel_counts(name):
    solid = placed(SOLIDS[name][0]())
    edge = as_edge(TopExp_Explorer(solid, TopAbs_ShapeEnum.TopAbs_EDGE).Current())
    BRep_Builder().UpdateEdge(edge, 3e-5)
    plain = plane_solid(solid)
    assert plain.tolerance == ShapeAnalysis_ShapeTolerance().Tolerance(solid, 1) == 3e-5
    assert inspect(solid, plain) == inspect(solid)


def test_open_solids_are_counted_alike():
    solid, builder = BRepPrimAPI_MakeBox(2.0, 3.0, 4.0).Solid(), BRep_Builder()
    shell, body = TopoDS_Shell(), TopoDS_Solid()
    builder.MakeShell(shell)
    builder.MakeSolid(body)
    for face in children(children(solid)[0])[1:]:
        builder.Add(shell, face)
    builder.Add(body, shell)
    body = placed(body)
    found = inspect(body, plane_solid(body))
    assert found == inspect(body)
    assert (found.valid, found.faces, found.free_edges) == (False, 5, 4)
    both = compound([solid, body])
    assert plane_solid(both) is None or inspect(both, plane_solid(both)) == inspect(both)


def test_a_face_that_is_turned_counts_as_it_is_turned():
    solid = compile_equation(read_template("pyramid_cut").bind({})).exportable().solid
    together, alone = solid_integrals(solid), one_by_one(solid)
    assert together.volume == pytest.approx(28.546875, rel=1e-14)
    assert together.face_areas == pytest.approx(alone.face_areas, rel=1e-13)
    assert len(plane_solid(solid).planes) == len(faces_of(solid))


def test_solids_with_a_curved_face_are_not_taken():
    assert plane_solid(BRepPrimAPI_MakeCylinder(1.0, 2.0).Solid()) is None


@pytest.mark.parametrize("name", SOLIDS)
def test_the_same_numbers_and_others(name):
    # the kernel's own solids have curves in planes, copies of them have not
    solid, other = placed(SOLIDS[name][0]()), placed(SOLIDS[name][0]())
    assert plane_solid(solid) is not None
    assert same_numbers(solid, other)
    assert not same_numbers(solid, placed(other))
    assert not same_numbers(solid, as_solid(other.Reversed()))
    for far, same in ((1e-16, True), (1e-11, False)):
        step = gp_Trsf()
        step.SetTranslation(gp_Vec(far, 0.0, 0.0))
        assert same_numbers(solid, BRepBuilderAPI_Transform(other, step, True).Shape()) == same


@pytest.mark.parametrize("name", SOLIDS)
def test_where_numbers_stand_is_told_by_the_form_alone(name):
    first = placed(SOLIDS[name][0]())
    others = [first.Reversed(), placed(first), placed(placed(first)).Reversed(), placed(bracket())]
    plane_solids._forms.clear()
    plane_solid(first)
    known = [plane_solid(other) for other in others]
    assert 2 <= len(plane_solids._forms) <= 4
    for other, remembered in zip(others, known, strict=True):
        plane_solids._forms.clear()
        plane_solids._read.cache_clear()
        anew = plane_solid(other)
        assert remembered.topology == anew.topology
        assert remembered.tolerance == anew.tolerance
        for few, there in zip(remembered.rows, anew.rows, strict=True):
            assert np.array_equal(few, there)
