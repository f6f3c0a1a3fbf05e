"""CadQuery wires and edges as guides and sections: the same curves, exact where they are exact."""

from __future__ import annotations

from collections import Counter
from math import atan2, pi, sqrt, tan

import cadquery as cq
import numpy as np
import pytest
from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
from OCP.BRepGProp import BRepGProp
from OCP.GCPnts import GCPnts_AbscissaPoint
from OCP.Geom import Geom_BSplineCurve, Geom_OffsetCurve
from OCP.gp import gp_Dir, gp_Pnt
from OCP.GProp import GProp_GProps

import pc2cad as pc
from pc2cad.brep.kernel import Array1OfInteger, Array1OfPnt, Array1OfReal
from pc2cad.channels import guide_functions
from pc2cad.channels.guides import Guide, GuideError
from pc2cad.channels.normals import FrameError
from pc2cad.channels.wires import WireError
from pc2cad.compiler import compile_equation
from pc2cad.domain.analysis import analyse
from pc2cad.domain.map import local_map, open_grid
from pc2cad.expression.breaks import find_breaks
from pc2cad.integrals.mass_properties import integrate

u, v, w = pc.parameters()
LINE = pc.polyline([(0, 0, 0), (0, 0, 1)])
POLES = [(0, 0, 0), (4, 0, 1), (6, 3, 2), (9, 3, 0), (12, 6, 3), (14, 6, 5)]


def edge_of(curve, *limits: float) -> cq.Edge:
    return cq.Edge(BRepBuilderAPI_MakeEdge(curve, *limits).Edge())


def spline(weights=None, multiplicities=(4, 1, 1, 4)) -> cq.Edge:
    count = sum(multiplicities) - 4
    poles, ws = Array1OfPnt(1, count), Array1OfReal(1, count)
    for i in range(count):
        poles.SetValue(i + 1, gp_Pnt(*POLES[i]))
        ws.SetValue(i + 1, 1.0 if weights is None else weights[i])
    knots = Array1OfReal(1, len(multiplicities))
    mults = Array1OfInteger(1, len(multiplicities))
    for i, m in enumerate(multiplicities):
        knots.SetValue(i + 1, 3.0 + 2 * i + (i > 1))
        mults.SetValue(i + 1, m)
    return edge_of(Geom_BSplineCurve(poles, ws, knots, mults, 3))


def ellipse() -> cq.Edge:
    return cq.Edge.makeEllipse(
        5, 2, (1, 2, 3), (0, 1, 1), (1, 0, 0), angle1=20, angle2=200, sense=1
    )


def flat_wire() -> cq.Wire:
    """A line, a quarter of a circle and a line, joined with common tangents."""
    path = cq.Workplane("XZ").lineTo(10, 0).tangentArcPoint((13, 3), relative=False)
    return path.lineTo(13, 9).wire().val()


EDGES = {
    "line": lambda: cq.Edge.makeLine((1, 2, 3), (4, 6, 3)),
    "arc": lambda: cq.Edge.makeCircle(4, (1, 2, 3), (1, 1, 1), 30, 250),
    "circle": lambda: cq.Edge.makeCircle(4, (1, 2, 3), (1, 1, 1)),
    "ellipse": ellipse,
    "spline": spline,
    "rational spline": lambda: spline((1, 2, 0.5, 1.5, 1, 1)),
    "double knot": lambda: spline(multiplicities=(4, 2, 4)),
    "Bézier": lambda: cq.Edge.makeBezier([cq.Vector(*p) for p in POLES]),
    "moved": lambda: spline().moved(cq.Location((1, 2, 3), (1, 1, 0), 40)),
    "wire": flat_wire,
    "closed spline": lambda: cq.Edge.makeSpline(
        [cq.Vector(10, 0, 0), cq.Vector(0, 8, 1), cq.Vector(-9, 0, 0), cq.Vector(0, -7, 2)],
        periodic=True,
    ),
}


def reversed_edge(edge: cq.Shape) -> cq.Shape:
    return type(edge)(edge.wrapped.Reversed())


def places(guide: Guide, count: int = 400) -> np.ndarray:
    return guide_functions.values(guide.N.coordinates, np.linspace(0, 1, count)).T


@pytest.mark.parametrize("name", EDGES)
def test_guide_is_the_edge_itself(name):
    edge = EDGES[name]()
    guide = pc.guide_from_wire(edge)
    found = places(guide)
    # the kernel's own distance from the curve, and its length
    assert max(cq.Vertex.makeVertex(*p).distance(edge) for p in found[::7].tolist()) < 1e-12
    ends = [edge.startPoint().toTuple(), edge.endPoint().toTuple()]
    assert np.abs(found[[0, -1]] - ends).max() < 1e-13
    speed = pc.diff(guide.N, u)
    limits = guide_functions.knots(speed.coordinates, 0.0, 1.0)
    length = GCPnts_AbscissaPoint.Length_s(edge._geomAdaptor(), 1e-12)
    total = guide_functions.antiderivative(guide_functions.function(pc.length(speed)), limits).total
    assert total == pytest.approx(length, rel=1e-11)
    assert guide.closed == edge.IsClosed()
    backwards = places(pc.guide_from_wire(type(edge)(edge.wrapped.Reversed())))
    assert np.abs(backwards - found[::-1]).max() < 1e-12


def test_pipe_along_lines_and_arcs_is_cylinders_and_tori():
    guide = pc.guide_from_wire(flat_wire())
    assert guide.words == "a wire of 3 edges (G1)"
    report = compile_equation(pc.channel(guide, pc.ellipse(1, 1, v), 0.2)).report
    assert report.evidence == "exact"
    assert Counter(f.carrier for f in report.faces) == {"cylinder": 4, "torus": 2, "plane": 2}
    assert report.solid.volume == pytest.approx(0.4 * pi * (16 + 1.5 * pi), rel=1e-13)
    assert report.frame == "rotation-minimising; guide: a wire of 3 edges (G1)"


def test_torus_round_a_circle():
    guide = pc.guide_from_wire(cq.Wire.makeCircle(5, cq.Vector(1, 2, 3), cq.Vector(1, 1, 1)))
    report = compile_equation(pc.channel(guide, pc.ellipse(2, 2, v))).report
    assert [f.carrier for f in report.faces] == ["torus"]
    assert report.solid.volume == pytest.approx(40 * pi**2, rel=1e-13)


def test_corners_are_refused_or_mitred():
    wire = cq.Wire.makePolygon([(0, 0, 0), (10, 0, 0), (10, 8, 0), (10, 8, 6)])
    with pytest.raises(GuideError, match=r"parts 1 and 2 .* a corner of 90 degrees; put an arc"):
        pc.guide_from_wire(wire)
    guide = pc.guide_from_wire(wire, corners="mitre")
    assert guide.words == "a wire of 3 edges (G1, 2 corners mitred)"
    duct = pc.channel(guide, pc.polygon([(2, 1), (-2, 1), (-2, -1), (2, -1)], v), 0.4)
    same = pc.channel(pc.polyline([(0, 0, 0), (10, 0, 0), (10, 8, 0), (10, 8, 6)], corners="mitre"),
                      pc.polygon([(2, 1), (-2, 1), (-2, -1), (2, -1)], v), 0.4)  # fmt: skip
    grid = open_grid(*[np.linspace(0, 1, 9)] * 3)
    assert np.abs(local_map(duct).points(*grid) - local_map(same).points(*grid)).max() < 1e-14


def test_mitre_between_an_arc_and_a_line():
    arc = cq.Edge.makeThreePointArc((0, 0, 0), (5 / sqrt(2), 5 - 5 / sqrt(2), 0), (5, 5, 0))
    wire = cq.Wire.assembleEdges([arc, cq.Edge.makeLine((5, 5, 0), (9, 8, 0))])
    part = compile_equation(pc.channel(pc.guide_from_wire(wire, "mitre"), pc.ellipse(1, 1, v)))
    assert part.report.genus == (0,)
    (joint,) = find_breaks(part.equation.coordinates)[0]
    sides = [joint.position - 1e-14, joint.position]
    rim = local_map(part.equation).points(*open_grid(sides, np.linspace(0, 1, 9), np.ones(1)))
    assert np.abs(rim[0] - rim[1]).max() < 1e-12
    # the plane of the cut halves the corner
    assert np.abs((rim[1] - [5, 5, 0]) @ [0.8, 1.6, 0]).max() < 1e-12
    assert np.linalg.norm(rim[1] - [5, 5, 0], axis=-1).max() == pytest.approx(sqrt(1.25), rel=1e-3)


def test_closed_wire_with_mitred_corners():
    square = cq.Wire.makePolygon([(0, 0, 0), (10, 0, 0), (10, 10, 0), (0, 10, 0)], close=True)
    guide = pc.guide_from_wire(square, corners="mitre")
    assert guide.closed
    report = compile_equation(pc.channel(guide, pc.regular_polygon(4, 1, v))).report
    assert report.genus == (1,)
    assert report.solid.volume == pytest.approx(2 * 40, rel=1e-12)


def test_frames_that_jump_at_a_joint_are_refused():
    wire = cq.Wire.makePolygon([(0, 0, 0), (10, 0, 0), (10, 8, 0), (10, 8, 6)])
    with pytest.raises(FrameError, match="does not go on from part 1 of the guide to"):
        pc.frame(pc.guide_from_wire(wire, "mitre"), "direction", pc.vector(1, 2, 3))


# -- sections --------------------------------------------------------------------------------------


def slot() -> cq.Wire:
    return cq.Workplane().slot2D(6, 2).wires().val()


def kite() -> cq.Wire:
    return cq.Workplane().polyline([(2, 0), (0, 1), (-3, 0), (0, -1)]).close().wire().val()


def leaf() -> cq.Wire:
    """A spline and a line: two corners."""
    path = cq.Workplane().moveTo(2, -1)
    path = path.spline([(2, 1), (0, 2), (-2, 1), (-2, -1)], includeCurrent=True)
    return path.close().wire().val()


def closed_spline() -> cq.Wire:
    points = [cq.Vector(2, 0), cq.Vector(0, 1.5), cq.Vector(-2, 0), cq.Vector(0, -1)]
    return cq.Wire.assembleEdges([cq.Edge.makeSpline(points, periodic=True)])


SECTIONS = {
    "slot": (slot, {"cylinder": 2, "plane": 4}),
    "kite": (kite, {"plane": 6}),
    "leaf": (leaf, {"B-spline surface": 1, "plane": 3}),
    "circle": (
        lambda: cq.Wire.makeCircle(2, cq.Vector(1, 0, 5), cq.Vector(0, 0, -1)),
        {"cylinder": 1, "plane": 2},
    ),
    "closed spline": (closed_spline, {"B-spline surface": 1, "plane": 2}),
}
ORIGIN, UPWARDS = pc.point(0, 0, 0), pc.vector(0, 0, 1)
ARC = pc.guide(pc.point(10 * pc.cos(u), 10 * pc.sin(u), 0))


@pytest.mark.parametrize("name", SECTIONS)
def test_section_is_the_wire(name):
    make, carriers = SECTIONS[name]
    section, properties = pc.section_from_wire(make(), v), GProp_GProps()
    BRepGProp.SurfaceProperties_s(cq.Face.makeFromWires(make()).wrapped, properties, 1e-12)
    area, centre = properties.Mass(), properties.CentreOfMass()
    report = compile_equation(pc.channel(LINE, section)).report
    assert Counter(f.carrier for f in report.faces) == carriers
    assert report.evidence == "exact"
    assert report.equation.volume == pytest.approx(area, rel=1e-10)
    # on an arc, moments count: x runs towards its centre, y away from it
    inwards, along_axis = (
        integrate(analyse(pc.channel(frame, section))).volume
        for frame in (pc.frame(ARC, "point", ORIGIN), pc.frame(ARC, "direction", UPWARDS))
    )
    assert inwards == pytest.approx(area * (10 - centre.X()), rel=1e-10)
    assert along_axis == pytest.approx(area * (10 + centre.Y()), rel=1e-10)


def test_walls_of_a_section_from_a_wire():
    wall = pc.channel(LINE, pc.section_from_wire(kite(), v), 0.2, measured="normal", side="inside")
    perimeter = 2 * sqrt(5) + 2 * sqrt(10)
    half_angles = [atan2(1, 2), atan2(1, 3), (pi - atan2(1, 2) - atan2(1, 3)) / 2]
    corners = sum(times / tan(a) for a, times in zip(half_angles, (1, 1, 2), strict=True))
    area = 0.2 * perimeter - 0.04 * corners
    assert integrate(analyse(wall)).volume == pytest.approx(area, rel=1e-12)
    thick = pc.channel(LINE, pc.section_from_wire(slot(), v), 0.2, measured="normal")
    assert integrate(analyse(thick)).volume == pytest.approx(0.2 * (8 + 2 * pi), rel=1e-12)


# -- refusals --------------------------------------------------------------------------------------


def offset() -> cq.Edge:
    curve = BRep_Tool.Curve_s(spline().wrapped, 0.0, 1.0)
    return edge_of(Geom_OffsetCurve(curve, 0.5, gp_Dir(0, 0, 1)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: pc.guide_from_wire(cq.Workplane().lineTo(1, 0)), "of a CadQuery Workplane take"),
        (lambda: pc.guide_from_wire(cq.Workplane().box(1, 1, 1).val()), "and a solid was given"),
        (lambda: pc.guide_from_wire(offset()), "of the kind OffsetCurve"),
        (lambda: pc.guide_from_wire(flat_wire(), "round"), "the corners are refuse or mitre"),
        (lambda: pc.section_from_wire(flat_wire(), v), "a section is a closed wire"),
        (lambda: pc.section_from_wire(cq.Wire.makeCircle(1, cq.Vector(), cq.Vector(1, 0, 0)), v),
         "lies in a plane z = constant"),
    ],
)  # fmt: skip
def test_what_is_no_guide_or_section_is_refused(make, message):
    with pytest.raises((WireError, GuideError), match=message):
        make()
