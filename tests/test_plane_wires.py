"""Wires of plane faces: nothing is proved of them that the kernel's checker refuses."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from OCP.BRep import BRep_Builder
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeVertex
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
from OCP.Geom import Geom_Plane
from OCP.Geom2d import Geom2d_Line
from OCP.gp import gp_Ax3, gp_Dir, gp_Dir2d, gp_Pnt, gp_Pnt2d, gp_Vec
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Shell, TopoDS_Solid, TopoDS_Wire

import pc2cad as pc
from pc2cad.brep import checker
from pc2cad.brep.checker import is_valid
from pc2cad.brep.kernel import as_edge, children
from pc2cad.brep.plane_wires import is_in_order, ordered_wires
from pc2cad.brep.spline_numbers import spline_curve
from pc2cad.geometry.plane_chains import outer_chain, turn_of
from pc2cad.geometry.round_chains import round_chains

#: a plane that is not along the axes
PLANE = gp_Ax3(gp_Pnt(1, 2, 3), gp_Dir(1, 2, 2), gp_Dir(2, 1, -2))
X, Y = (np.array(way) / 3 for way in ((2.0, 1.0, -2.0), (-2.0, 2.0, -1.0)))


def in_space(points):
    return np.array([1.0, 2.0, 3.0]) + points[..., :1] * X + points[..., 1:] * Y


def wire_of(edges):
    wire, builder = TopoDS_Wire(), BRep_Builder()
    builder.MakeWire(wire)
    for edge in edges:
        builder.Add(wire, edge)
    wire.Closed(True)
    return wire


def polygon(points):
    corners = [gp_Pnt(*place) for place in in_space(np.asarray(points, float)).tolist()]
    made = [BRepBuilderAPI_MakeVertex(corner).Vertex() for corner in corners]
    pairs = zip(made, made[1:] + made[:1], strict=True)
    return wire_of([BRepBuilderAPI_MakeEdge(*pair).Edge() for pair in pairs])


def ring(points):
    """Return a closed cubic spline, smooth but where it begins, of a polygon of poles."""
    poles = in_space(np.vstack((points, points[:1])))
    inner = np.linspace(0, 1, len(poles) - 2)
    curve = spline_curve(poles, np.concatenate(([0.0] * 3, inner, [1.0] * 3)), 3)
    vertex = BRepBuilderAPI_MakeVertex(gp_Pnt(*poles[0].tolist())).Vertex()
    edge, builder = TopoDS_Edge(), BRep_Builder()
    builder.MakeEdge(edge, curve, 1e-7)
    builder.Add(edge, vertex.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
    builder.Add(edge, vertex.Oriented(TopAbs_Orientation.TopAbs_REVERSED))
    builder.Range(edge, 0.0, 1.0)
    return wire_of([edge])


def face_of(outer, *holes):
    face, builder = TopoDS_Face(), BRep_Builder()
    builder.MakeFace(face, Geom_Plane(PLANE), 1e-7)
    builder.Add(face, outer)
    for hole in holes:
        builder.Add(face, hole.Reversed())
    return face


def extruded(face):
    return BRepPrimAPI_MakePrism(face, gp_Vec(1, 2, 2)).Shape()


def around(count, radius=1.0, middle=(0.0, 0.0), wave=0.0, waves=5):
    angle = 2 * np.pi * np.arange(count) / count
    r = radius * (1 + wave * np.sin(waves * angle))
    return np.stack((r * np.cos(angle), r * np.sin(angle)), axis=1) + middle


def bow_tie(count):
    """Return an eight: it crosses itself in the middle."""
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    return np.stack((np.sin(angle), np.sin(2 * angle)), axis=1)


KINDS = {"straight": polygon, "curved": ring}
#: wires of a face, whether it is in order, and which wire is proved to be around all others
CASES = {
    "one": ([around(80)], True, 0),
    "star": ([around(80, wave=0.6)], True, 0),
    "hole": ([around(80, 2), around(60)], True, 0),
    "near": ([around(80, 1.1), around(80)], True, 0),
    "holes": ([around(90, 3), around(40, 1, (1.5, 0)), around(40, 1, (-1, 0))], True, 0),
    "crosses itself": ([bow_tie(80)], False, None),
    "wires cross": ([around(80), around(60, 1, (0.7, 0))], False, None),
    "hole outside": ([around(80), around(60, 0.5, (2, 0))], False, None),
    "hole around": ([around(80), around(80, 2)], False, 1),
    "hole in a hole": ([around(80, 3), around(60, 2), around(60, 1)], False, None),
    "twice the same": ([around(26), around(26)], False, None),
    "touching": ([around(80, 2), around(80, 1, (1, 0))], False, None),
}


def outer_wire(face):
    """Return which wire is proved to be around all others, None where none is."""
    found = ordered_wires(face, children(face))
    return None if found is None else found.outer


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("case", CASES)
def test_proved_is_what_the_checker_finds_in_order(case, kind):
    rows, fine, outer = CASES[case]
    wires = [KINDS[kind](row) for row in rows]
    face = face_of(*wires)
    assert bool(BRepCheck_Analyzer(face).IsValid()) == fine
    assert outer_wire(face) == outer


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("case", CASES)
def test_solids_are_valid_where_the_kernel_says_so(case, kind):
    rows, fine, _ = CASES[case]
    solid = extruded(face_of(*(KINDS[kind](row) for row in rows)))
    assert is_valid(solid) == bool(BRepCheck_Analyzer(solid).IsValid()) == fine


@pytest.mark.parametrize("kind", KINDS)
def test_a_hole_that_is_not_turned_is_refused(kind):
    make = KINDS[kind]
    face = face_of(make(around(80, 2)), make(around(80, 1)).Reversed())
    solid = extruded(face)
    assert is_valid(solid) == bool(BRepCheck_Analyzer(solid).IsValid())
    assert not is_valid(solid)


@pytest.mark.parametrize("kind", KINDS)
def test_faces_whose_wires_are_turned_wrong_are_not_in_order(kind):
    make = KINDS[kind]
    ways = [(make(around(80, 2)), make(around(60)))]
    ways += [(outer.Reversed(), hole) for outer, hole in ways]
    ways += [(outer, hole.Reversed()) for outer, hole in ways]
    found = []
    for outer, hole in ways:
        face = face_of(outer, hole)
        assert outer_wire(face) == 0
        found.append(is_in_order(face, children(face)))
        assert found[-1] == bool(BRepCheck_Analyzer(face).IsValid())
    assert found == [True, False, False, False]


def test_edges_that_have_vertices_of_their_own_are_not_joined():
    points = in_space(around(80))
    edges = [
        BRepBuilderAPI_MakeEdge(gp_Pnt(*one), gp_Pnt(*other)).Edge()
        for one, other in zip(points.tolist(), np.roll(points, -1, axis=0).tolist(), strict=True)
    ]
    face = face_of(wire_of(edges))
    assert outer_wire(face) == 0
    assert not is_in_order(face, children(face))
    assert not BRepCheck_Analyzer(face).IsValid()


def test_edges_with_curves_on_the_plane_are_left_to_the_kernel():
    face = face_of(polygon(around(80)))
    assert is_in_order(face, children(face))
    edge, line = as_edge(children(children(face)[0])[7]), Geom2d_Line(gp_Pnt2d(), gp_Dir2d(1, 0))
    BRep_Builder().UpdateEdge(edge, line, face, 1e-7)
    assert not is_in_order(face, children(face))


def test_edges_off_the_plane_are_left_to_the_kernel():
    face, builder = TopoDS_Face(), BRep_Builder()
    away = PLANE.Translated(gp_Vec(1e-6, 2e-6, 2e-6))
    builder.MakeFace(face, Geom_Plane(away), 1e-7)
    builder.Add(face, polygon(around(80)))
    assert outer_wire(face) is None
    assert not BRepCheck_Analyzer(face).IsValid()


def test_walls_as_near_as_polygons_of_splines_are_off_are_left_to_the_kernel():
    proved = []
    for gap in 10.0 ** np.arange(-7, 0, 2):
        face = face_of(ring(around(50, 1 + gap)), ring(around(50)))
        proved.append(outer_wire(face) == 0)
        assert BRepCheck_Analyzer(face).IsValid() or not proved[-1]
    assert proved == sorted(proved)
    assert proved[-1]
    assert not proved[0]


def test_shells_that_are_not_closed_are_refused():
    solid = extruded(face_of(polygon(around(30, 2)), polygon(around(30))))
    (shell,) = children(solid)
    faces = children(shell)
    assert checker._known_valid(solid_of(faces))
    for wrong in (faces[1:], faces[:-1], [faces[0].Reversed(), *faces[1:]], faces + faces[:1]):
        assert not is_valid(solid_of(wrong))
        assert not BRepCheck_Analyzer(solid_of(wrong)).IsValid()


def solid_of(faces):
    shell, solid, builder = TopoDS_Shell(), TopoDS_Solid(), BRep_Builder()
    builder.MakeShell(shell)
    for face in faces:
        builder.Add(shell, face)
    shell.Closed(True)
    builder.MakeSolid(solid)
    builder.Add(solid, shell)
    return solid


def test_hundreds_of_edges_take_no_pairs(monkeypatch):
    monkeypatch.setattr(checker, "BRepCheck_Analyzer", _without_searches)
    assert is_valid(extruded(face_of(polygon(around(500, 2)), polygon(around(500)))))


def _without_searches(shape, searches=True):
    """Stand in for the checker, which must not search plane wires for crossings."""
    if searches:
        kinds = {child.ShapeType().name for child in children(shape)}
        assert kinds == {"TopAbs_FACE"}
        assert len(children(shape)) == 1000
    return BRepCheck_Analyzer(shape, searches)


def test_a_tube_of_many_walls_is_proved():
    u, v, w = pc.parameters()
    x, y = pc.regular_polygon(30, 10, v)
    part = pc.compile_part(pc.point(x * (1 + w / 5), y * (1 + w / 5), 20 * u))
    assert checker._known_valid(part.shape)


# -- the proof itself, held against all pairs of edges ---------------------------------------------


def crossing(chains):
    """Return whether edges of polygons have a point in common that is no common end."""
    edges = []
    for number, points in enumerate(chains):
        count = len(points)
        edges += [(number, i, count, points[i], points[(i + 1) % count]) for i in range(count)]
    for (a, i, n, p, q), (b, j, _, r, s) in combinations(edges, 2):
        if a == b and (i - j) % n in (1, n - 1):
            continue
        turns = [np.linalg.det(np.array([y - x, z - x]))
                 for x, y, z in ((p, q, r), (p, q, s), (r, s, p), (r, s, q))]  # fmt: skip
        if turns[0] * turns[1] <= 0 and turns[2] * turns[3] <= 0:
            return True
    return False


def test_polygons_that_cross_are_never_proved():
    random = np.random.default_rng(7)
    proved = crossed = 0
    for _ in range(60):
        chains = []
        for middle in ((0.0, 0.0), random.uniform(-0.5, 0.5, 2)):
            count = random.integers(3, 9)
            angle = np.sort(random.uniform(0, 2 * np.pi, count)) + random.normal(0, 0.15, count)
            r = random.choice((0.4, 1, 3)) * random.uniform(0.8, 1, count)
            chains.append(np.stack((r * np.cos(angle), r * np.sin(angle)), axis=1) + middle)
        nets = [np.stack((points, np.roll(points, -1, axis=0)), axis=1) for points in chains]
        met = crossing(chains)
        found = outer_chain(nets, 1e-9)
        assert found is None or not met
        proved, crossed = proved + (found is not None), crossed + met
    assert proved > 5
    assert crossed > 10


def test_curves_are_parted_by_their_control_points():
    # quarter circles by their usual cubic, and a square that is just inside or just not
    k = 4 * (np.sqrt(2) - 1) / 3
    quarter = np.array([[1, 0], [1, k], [k, 1], [0, 1]], float)
    turn = np.array([[0, 1], [-1, 0]])
    circle = [quarter @ np.linalg.matrix_power(turn, i) for i in range(4)]
    for size, inside in ((0.9, True), (0.99, True), (1.001, False)):
        corners = np.array([[size, 0], [0, size], [-size, 0], [0, -size]])
        lines = np.linspace(corners, np.roll(corners, -1, axis=0), 4, axis=1)
        assert outer_chain([lines, np.array(circle)], 1e-6) == (1 if inside else None)


@pytest.mark.parametrize("degree", [1, 2, 5])
def test_which_way_a_chain_runs(degree):
    corners = np.array([[0, 0], [3, 0], [3, 1], [1, 2], [0, 1]], float) + 1e3
    nets = np.linspace(corners, np.roll(corners, -1, axis=0), degree + 1, axis=1)
    assert turn_of(nets) == 1
    assert turn_of(nets[::-1, ::-1]) == -1
    flat = np.linspace(corners[:2], corners[1::-1], degree + 1, axis=1)
    assert turn_of(flat) == 0


# -- chains round one place, a sufficient test that comes first ------------------------------------


def crowded(nets, count=12):
    """Return points of each of some pieces (n, d+1, 2), one after the other."""
    share = np.linspace(0, 1, count, endpoint=False)[:, None, None, None]
    rows = np.broadcast_to(nets, (count, *nets.shape))
    while rows.shape[2] > 1:
        rows = (1 - share) * rows[:, :, :-1] + share * rows[:, :, 1:]
    return rows[:, :, 0].swapaxes(0, 1).reshape(-1, 2)


def random_chain(random, degree):
    """Return the pieces of a closed curve: round the origin, or folded, or far off."""
    count = int(random.integers(3, 24))
    angle = 2 * np.pi * np.arange(count * degree) / (count * degree)
    spoilt = random.choice((0.0, 0.02, 0.3))
    r = random.choice((0.5, 0.9, 1.0, 2.0)) * (1 + spoilt * random.normal(size=len(angle)))
    angle = angle + spoilt * random.normal(size=len(angle))
    points = np.stack((random.choice((0.6, 1, 1.8)) * r * np.cos(angle), r * np.sin(angle)), axis=1)
    points = points + random.choice((0.0, 0.3, 2.0)) * random.normal(size=2)
    if random.random() < 0.5:
        points = points[::-1]
    places = degree * np.arange(count)[:, None] + np.arange(degree + 1)
    return points[places % len(points)]


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_chains_round_one_place_do_not_cross(degree):
    random = np.random.default_rng(degree)
    proved = crossed = 0
    for _ in range(150):
        nets = [random_chain(random, degree) for _ in range(random.integers(1, 3))]
        found = round_chains(nets, 1e-3)
        met = crossing([crowded(one, 1 if degree == 1 else 3) for one in nets])
        crossed += met
        if found is None:
            continue
        outer, senses = found
        assert not met
        assert list(senses) == [turn_of(one) for one in nets]
        known = outer_chain(nets, 1e-3)
        assert known in (None, outer)
        if len(nets) == 2:
            one, other = map(crowded, nets)
            assert np.linalg.norm(one[:, None] - other, axis=2).min() > 1e-3
        proved += 1
    assert proved > 10
    assert crossed > 10


def test_what_winds_twice_or_is_near_to_itself_is_not_proved_round():
    quarters = np.linspace(0, 2 * np.pi, 13)[:-1]

    def closed(points):
        return np.stack((points, np.roll(points, -1, axis=0)), axis=1)

    once = np.stack((np.cos(quarters), np.sin(quarters)), axis=1)
    assert round_chains([closed(once)], 1e-3) == (0, (1,))
    assert round_chains([closed(np.concatenate((once, 1.1 * once)))], 1e-3) is None
    assert round_chains([closed(once)], 0.2) is None
    # a half as high, a tenth, and beside a second one: near to it, or not around it
    assert round_chains([closed(once * [1, 0.5])], 1e-3) == (0, (1,))
    assert round_chains([closed(once * [1, 0.1])], 1e-3) is None
    assert round_chains([closed(once), closed(1.2 * once)], 0.05) == (1, (1, 1))
    assert round_chains([closed(once), closed(1.2 * once)], 0.3) is None
    assert round_chains([closed(once), closed(1.2 * once + 0.5)], 1e-3) is None
    assert round_chains([closed(once), closed(1.2 * once + 3.0)], 1e-3) is None
    assert round_chains([closed(once)] * 3, 1e-3) is None
    assert round_chains([np.zeros((3, 2, 2))], 1e-3) is None
