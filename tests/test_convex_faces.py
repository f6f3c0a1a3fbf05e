"""Solids of convex polygons: nothing is proved of them that the kernel's checker refuses."""

from __future__ import annotations

import io
from collections import Counter

import numpy as np
import pytest
from OCP.BinTools import BinTools
from OCP.BRep import BRep_Builder
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
from OCP.Geom import Geom_Line, Geom_Plane
from OCP.gp import gp_Ax3, gp_Dir, gp_Pnt
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopoDS import (
    TopoDS_Edge,
    TopoDS_Face,
    TopoDS_Shell,
    TopoDS_Solid,
    TopoDS_Vertex,
    TopoDS_Wire,
)

from pc2cad.brep import checker
from pc2cad.brep.checker import is_valid
from pc2cad.brep.convex_faces import is_convex, is_convex_body
from pc2cad.brep.inside_out import inside_out
from pc2cad.brep.plane_solids import plane_solid
from pc2cad.export import step
from pc2cad.export.model import Exportable, ExportOptions, GeometricProperties
from tests.test_plane_solids import bracket, frame, placed

WAYS = (TopAbs_Orientation.TopAbs_FORWARD, TopAbs_Orientation.TopAbs_REVERSED)


def prism(count, size=1.0, height=1.0):
    """Return the corners of a prism, and of each face the corners as seen from outside."""
    angle = 2 * np.pi * np.arange(count) / count
    ring = size * np.stack((np.cos(angle), np.sin(angle), 0 * angle), axis=1)
    after = [(i + 1) % count for i in range(count)]
    sides = [[i, j, count + j, count + i] for i, j in enumerate(after)]
    ends = [[*range(count)][::-1], [*range(count, 2 * count)]]
    return np.concatenate((ring, ring + np.array([0, 0, height]))), [*sides, *ends]


class Broken:
    """A polyhedron of the kernel, of which some numbers, turns and parts may be others."""

    def __init__(self, points, faces):
        self.points, self.faces = np.asarray(points, float), [list(face) for face in faces]
        #: what vertices, lines and planes are moved by, ranges grow by, and tolerances are
        self.moved, self.shifted, self.lifted, self.longer, self.tolerance = {}, {}, {}, {}, 1e-7
        self.turned, self.leaning, self.wires, self.left_handed, self.own = (
            set() for _ in range(5)
        )

    def solid(self):
        builder = BRep_Builder()
        self.vertices, self.edges = [], {}
        for i, point in enumerate(self.points):
            vertex = TopoDS_Vertex()
            place = point + self.moved.get(i, 0.0)
            builder.MakeVertex(vertex, gp_Pnt(*place.tolist()), self.tolerance)
            self.vertices.append(vertex)
        shell, solid = TopoDS_Shell(), TopoDS_Solid()
        builder.MakeShell(shell)
        for number, corners in enumerate(self.faces):
            face = self.face(builder, number, corners)
            builder.Add(shell, face.Reversed() if number in self.turned else face)
        shell.Closed(True)
        builder.MakeSolid(solid)
        builder.Add(solid, shell)
        return solid

    def face(self, builder, number, corners):
        at = self.points[corners]
        x = (at[1] - at[0]) / np.linalg.norm(at[1] - at[0])
        normal = np.cross(at[1] - at[0], at[-1] - at[0])
        place = at[0] + np.asarray(self.lifted.get(number, 0.0)) * normal / np.linalg.norm(normal)
        if number in self.leaning:
            normal = normal + 0.01 * np.linalg.norm(normal) * x
        back = number in self.left_handed
        axes = gp_Ax3(gp_Pnt(*place.tolist()), gp_Dir(*normal.tolist()), gp_Dir(*x.tolist()))
        if back:  # the plane is run through the other way round, and so is the face
            axes.YReverse()
        face, wire = TopoDS_Face(), TopoDS_Wire()
        builder.MakeFace(face, Geom_Plane(axes), self.tolerance)
        builder.MakeWire(wire)
        pairs = list(zip(corners, corners[1:] + corners[:1], strict=True))
        if number in self.own:
            self.edges = {}
        for pair in pairs:
            builder.Add(wire, self.edge(builder, pair))
        wire.Closed(True)
        builder.Add(face, wire.Reversed() if (number in self.wires) != back else wire)
        return face.Reversed() if back else face

    def edge(self, builder, pair):
        low, high = sorted(pair)
        if (low, high) not in self.edges:
            edge, one, other = TopoDS_Edge(), self.points[low], self.points[high]
            start = one + self.shifted.get((low, high), 0.0)
            length = float(np.linalg.norm(other - one))
            line = Geom_Line(gp_Pnt(*start.tolist()), gp_Dir(*(other - one).tolist()))
            builder.MakeEdge(edge, line, self.tolerance)
            builder.Add(edge, self.vertices[low].Oriented(WAYS[0]))
            builder.Add(edge, self.vertices[high].Oriented(WAYS[1]))
            builder.Range(edge, 0.0, length + self.longer.get((low, high), 0.0))
            self.edges[low, high] = edge
        return self.edges[low, high].Oriented(WAYS[int(pair[0] != low)])


def both(solid):
    """Return what is proved and what the kernel's checker finds; the proof says no more."""
    plain = plane_solid(solid)
    proved, found = plain is not None and is_convex(plain), BRepCheck_Analyzer(solid).IsValid()
    assert found or not proved
    assert is_valid(solid, plain) == found
    return proved, bool(found)


@pytest.mark.parametrize("size", [1e-2, 1.0, 1e4])
@pytest.mark.parametrize("count", [3, 4, 7, 12])
def test_convex_solids_are_proved_without_the_kernel(count, size, monkeypatch):
    solid = placed(Broken(*prism(count, size, size)).solid())
    turned, plain = solid.Reversed(), plane_solid(solid)
    assert both(solid) == both(turned) == (True, True)
    monkeypatch.setattr(checker, "BRepCheck_Analyzer", None)
    assert is_valid(solid, plain)


@pytest.mark.parametrize("build", [bracket, frame])
def test_what_is_not_convex_is_left_to_the_kernel(build):
    assert both(placed(build())) == (False, True)


def test_planes_may_be_run_through_either_way():
    made = Broken(*prism(5))
    made.left_handed = {0, 2, 6}
    assert both(made.solid()) == (True, True)


def test_the_kernels_own_box_with_curves_on_its_planes():
    assert both(BRepPrimAPI_MakeBox(1.0, 2.0, 3.0).Solid())[1]


def star(made):
    # five corners that are joined as a star: it turns left everywhere, but twice around
    made.faces = [[corners[2 * i % 5] for i in range(5)] if len(corners) == 5 else corners
                  for corners in made.faces]  # fmt: skip


#: a word, and what is done to a prism of five sides
FAULTS = {
    "a vertex moved": lambda made: made.moved.update({1: 1e-6}),
    "a line moved": lambda made: made.shifted.update({(0, 1): np.array([0, 0, 1e-5])}),
    "a line moved along": lambda made: made.shifted.update({(0, 5): np.array([0, 0, 1e-6])}),
    "an edge too long": lambda made: made.longer.update({(0, 1): 1e-5}),
    "an edge backward": lambda made: made.longer.update({(0, 1): -3.0}),
    "a plane moved": lambda made: made.lifted.update({2: 1e-6}),
    "a plane that leans": lambda made: made.leaning.add(3),
    "a face turned": lambda made: made.turned.add(1),
    "a wire turned": lambda made: made.wires.add(1),
    "a face and its wire turned": lambda made: (made.turned.add(1), made.wires.add(1)),
    "a face too few": lambda made: made.faces.pop(),
    "no face at all": lambda made: made.faces.clear(),
    "a face twice": lambda made: made.faces.append(made.faces[0]),
    "edges of its own": lambda made: made.own.add(3),
    "a star": star,
    "corners out of order": lambda made: made.faces.__setitem__(0, [0, 6, 1, 5]),
    "an edge left out": lambda made: made.faces.__setitem__(6, [5, 6, 7, 8]),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_never_proved(fault):
    made = Broken(*prism(5))
    FAULTS[fault](made)
    assert both(made.solid()) == (False, False)


def test_two_solids_in_one_shell_do_not_hang_together():
    points, faces = prism(4)
    more = [[corner + len(points) for corner in face] for face in faces]
    made = Broken(np.concatenate((points, points + 5.0)), faces + more)
    assert both(made.solid()) == (False, False)


@pytest.mark.parametrize("height", 3.0 * 10.0 ** np.arange(-9.0, 0.0))
def test_slivers_are_left_to_the_kernel(height):
    proved, _ = both(Broken(*prism(4, 1.0, height)).solid())
    assert proved == (height > 1e-5)


def test_corners_that_hardly_turn_are_left_to_the_kernel():
    points, faces = prism(4)
    middle = points[[0, 1]].mean(axis=0) * (1 + 1e-9)
    faces = [[*face[:1], 8, *face[1:]] if face == [0, 1, 5, 4] else face for face in faces]
    bottom = faces[4].index(1)
    faces[4] = [*faces[4][: bottom + 1], 8, *faces[4][bottom + 1 :]]
    assert not both(Broken(np.vstack((points, middle)), faces).solid())[0]


def test_random_faults_are_never_proved():
    random, seen = np.random.default_rng(3), Counter()
    for _ in range(200):
        made = Broken(*prism(random.integers(3, 7), 1.0, 10.0 ** random.uniform(-4, 0)))
        edges = [(0, 1), (1, 2), (0, len(made.points) // 2)]
        step = random.normal(size=3) * 10.0 ** random.uniform(-11, -5)
        match random.integers(5):
            case 0:
                made.moved[random.integers(len(made.points))] = step
            case 1:
                made.shifted[edges[random.integers(3)]] = step
            case 2:
                made.longer[edges[random.integers(3)]] = step[0]
            case 3:
                made.lifted[random.integers(len(made.faces))] = step[0]
            case 4:
                face = made.faces[random.integers(len(made.faces))]
                face[:] = [int(corner) for corner in random.permutation(face)]
        seen[both(placed(made.solid()) if random.integers(2) else made.solid())] += 1
    assert min(seen[True, True], seen[False, True], seen[False, False]) > 10


def dented():
    """Return a roof over a square whose tip is below its middle, and the faces of its cube."""
    points, faces = prism(4)
    middle = points[4:].mean(axis=0) - np.array([0, 0, 0.3])
    roof = [[4 + i, 4 + (i + 1) % 4, 8] for i in range(4)]
    return np.vstack((points, middle)), faces[:5] + roof


def bare(solid):
    """Return the shape as the kernel writes it in its binary form, but whether it was checked."""
    stream = io.BytesIO()
    BinTools.Write_s(solid, stream)
    plain = plane_solid(solid)
    return plain.topology, [row.tobytes() for row in plain.rows], len(stream.getvalue())


@pytest.mark.parametrize("size", [1e-2, 1.0, 1e4])
@pytest.mark.parametrize("count", [3, 4, 7, 12])
def test_nothing_of_solids_of_convex_polygons_is_mended(count, size, monkeypatch):
    solid = placed(Broken(*prism(count, size, 2 * size)).solid())
    assert is_convex_body(plane_solid(solid))
    figures = GeometricProperties(1.0, 1.0, (0.0, 0.0, 0.0))
    item = Exportable(solid, "prism", "", "mm", (), figures, 0.0)
    text, read, asked = step.encode(item, ExportOptions()), step._read, []
    monkeypatch.setattr(step, "_read", lambda *given: asked.append(given) or read(*given))
    assert step.encode(item, ExportOptions(timestamp="2026-01-01")).partition(b"DATA;")[2] in text
    ((_, unit, steps),) = asked
    assert steps == step.ALL_MENDING
    mended, left = (read(text, unit, steps) for steps in (step.SEARCHES, step.ALL_MENDING))
    assert bare(mended) == bare(left)
    assert not inside_out(left)


def test_what_is_inside_out_is_told_of_convex_bodies_alone():
    for made, convex in ((prism(5), True), (dented(), False)):
        solid = Broken(*made).solid()
        for shape, turned in ((solid, False), (solid.Reversed(), True)):
            plain = plane_solid(shape)
            assert is_convex(plain)
            assert is_convex_body(plain) == (convex and not turned)
            assert inside_out(shape) == turned
    assert not is_convex_body(plane_solid(placed(bracket())))
