"""Faces and edges get the carriers that their points lie on, whatever the parameters are."""

from __future__ import annotations

from fractions import Fraction
from math import asin, asinh, atan, cos, pi, sin, sqrt

import numpy as np
import pytest
from consumers.fresh_kernel import read_in_fresh_process
from consumers.gmsh_reader import read_all_in_gmsh
from consumers.step_file import check_step
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.IGESControl import IGESControl_Reader
from test_exact_carriers import assert_exact, carriers, curves, rotation

import pc2cad as pc
from pc2cad.compiler import compile_part
from pc2cad.geometry.carriers import Arc, Cylinder, Frame, Plane, Sphere, figures
from pc2cad.geometry.recognition.implicit import holds

U, V, W = pc.parameters()
THETA = 2 * pc.pi * U


def half_tangent(t) -> tuple:
    return (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)


#: a unit circle without a sine: its point, and its angle from where to where
CIRCLES = {
    "half tangent": (half_tangent(U), 0, pi / 2),
    "more than half a turn": (half_tangent(4 * U - 2), -2 * atan(2), 2 * atan(2)),
    "uneven": (half_tangent(U**2), 0, pi / 2),
    "root": ((pc.sqrt(1 - (1.2 * U - 0.6) ** 2), 1.2 * U - 0.6), -asin(0.6), asin(0.6)),
    "root to the end": ((pc.sqrt(1 - U * U), U), 0, pi / 2),
    "direction": ((1 / pc.sqrt(1 + U * U), U / pc.sqrt(1 + U * U)), 0, pi / 4),
    "sine": ((pc.cos(pc.sin(1.5 * U)), pc.sin(pc.sin(1.5 * U))), 0, sin(1.5)),
}
R, T, Z = 1 + W, V - 0.4, 2 * V - 1
#: shells over such a circle (c, s), their carriers, edges, and volume by the angle's ends
SHELLS = {
    "cylinder": (lambda c, s: (R * c, R * s, 3 * V), {"cylinder": 2, "plane": 4},
                 {"circle": 4, "line": 8}, lambda a, b: 4.5 * (b - a)),
    "cone": (lambda c, s: (R * (2 - V) * c, R * (2 - V) * s, 3 * V), {"cone": 2, "plane": 4},
             {"circle": 4, "line": 8}, lambda a, b: 10.5 * (b - a)),
    "sphere": (lambda c, s: (R * pc.cos(T) * c, R * pc.cos(T) * s, R * pc.sin(T)),
               {"sphere": 2, "cone": 2, "plane": 2}, {"circle": 8, "line": 4},
               lambda a, b: 7 / 3 * (sin(0.6) + sin(0.4)) * (b - a)),
    "torus": (lambda c, s: ((5 + R * pc.cos(2 * V)) * c, (5 + R * pc.cos(2 * V)) * s,
                            R * pc.sin(2 * V)),
              {"torus": 2, "cone": 1, "plane": 3}, {"circle": 8, "line": 4},
              lambda a, b: (15 + 7 / 3 * sin(2)) * (b - a)),
    "hyperboloid": (lambda c, s: (R * pc.sqrt(1 + Z * Z) * c, R * pc.sqrt(1 + Z * Z) * s, Z),
                    {"revolution": 2, "plane": 4},
                    {"circle": 4, "line": 4, "rational Bézier curve": 4},
                    lambda a, b: 4 * (b - a)),
    "paraboloid": (lambda c, s: (R * (1 + V) * c, R * (1 + V) * s, V * V + 2 * V),
                   {"revolution": 2, "plane": 4},
                   {"circle": 4, "line": 4, "Bézier curve": 4}, lambda a, b: 11.25 * (b - a)),
    "elliptic": (lambda c, s: (3 * R * c, 2 * R * s, 3 * V), {"extrusion": 2, "plane": 4},
                 {"ellipse": 4, "line": 8}, lambda a, b: 27 * (b - a)),
    "cut obliquely": (lambda c, s: (R * c, R * s, V * (4 + R * c / 2)),
                      {"cylinder": 2, "plane": 4}, {"circle": 2, "ellipse": 2, "line": 8},
                      lambda a, b: 6 * (b - a) + 7 / 6 * (sin(b) - sin(a))),
}  # fmt: skip
PAIRS = [
    ("cylinder", "half tangent", 1), ("cylinder", "direction", 1e5), ("cone", "root", 1e-2),
    ("cone", "more than half a turn", 1), ("sphere", "uneven", 1), ("sphere", "root to the end", 1),
    ("torus", "half tangent", 1e5), ("torus", "root", 1), ("hyperboloid", "sine", 1e-2),
    ("hyperboloid", "half tangent", 1e5), ("paraboloid", "direction", 1e-2),
    ("elliptic", "root to the end", 1e5), ("elliptic", "more than half a turn", 1e-2),
    ("cut obliquely", "uneven", 1e-2), ("cut obliquely", "sine", 1e5),
]  # fmt: skip


@pytest.mark.parametrize(("shell", "circle", "size"), PAIRS)
def test_circles_without_a_sine(shell, circle, size):
    point, expected, edges, volume = SHELLS[shell]
    (c, s), start, end = CIRCLES[circle]
    part = compile_part(tuple(size * x for x in point(c, s)))
    assert (carriers(part), curves(part)) == (expected, edges)
    assert_exact(part, gap=1e-12)
    assert part.report.solid.volume == pytest.approx(volume(start, end) * size**3, rel=1e-11)


#: a cone about z, its apex at height 3, cut by the plane z = x/2: the ellipse where they meet
CENTRE, SQUARE = -6 / 35, 1 + 1 / 35
LENGTH, WIDTH = sqrt(36 / 35 * SQUARE), sqrt(SQUARE)
CUT = (CENTRE + W * LENGTH * pc.cos(THETA), W * WIDTH * pc.sin(THETA))
#: a plane that is mapped to a sphere from one of its points; circles stay circles
PLANE = 0.3 + V / 2 * pc.cos(THETA), V / 2 * pc.sin(THETA)
GNOMON = pc.sqrt(1 + (2 * U - 1) ** 2 + Z * Z)
CORNERS = (1 - U, U * (1 - V), U * V,
           pc.sqrt((1 - U) ** 2 + (U * (1 - V)) ** 2 + (U * V) ** 2))  # fmt: skip
#: faces that end elsewhere than at constant parameters of their carriers, and the volume
ASKEW = {
    "rod between two planes": (
        (2 * W * pc.cos(THETA), 2 * W * pc.sin(THETA),
         (1 - V) * (W * pc.sin(THETA) - 5) + V * (5 + 2 * W * pc.cos(THETA))),
        {"cylinder": 1, "plane": 2}, {"ellipse": 2, "line": 3}, 40 * pi),
    "cone from an ellipse to another": (
        ((1 - V / 2) * CUT[0], (1 - V / 2) * CUT[1], 3 - (1 - V / 2) * (3 - CUT[0] / 2)),
        {"cone": 1, "plane": 2}, {"ellipse": 2, "line": 3},
        7 / 8 * pi * LENGTH * WIDTH),
    "sixth of a sphere": (
        tuple((2 + W) * x / GNOMON for x in (1, 2 * U - 1, Z)),
        {"sphere": 2, "plane": 4}, {"circle": 8, "line": 4}, 4 * pi / 6 * 19 / 3),
    "hyperboloid by its lines": (
        (R * (pc.cos(THETA) - Z * pc.sin(THETA)), R * (pc.sin(THETA) + Z * pc.cos(THETA)), 2 * Z),
        {"revolution": 2, "plane": 2}, {"circle": 4, "line": 4}, 3 * pi * 2 * 8 / 3),
    "octant of a shell by its corners": (
        tuple((2 + W) * x / CORNERS[3] for x in CORNERS[:3]),
        {"sphere": 2, "plane": 3}, {"circle": 6, "line": 3}, 4 * pi / 8 * 19 / 3),
    "torus with a seam round both ways": (
        ((5 + 2 * W * pc.cos(2 * pc.pi * (U + V))) * pc.cos(THETA),
         (5 + 2 * W * pc.cos(2 * pc.pi * (U + V))) * pc.sin(THETA),
         2 * W * pc.sin(2 * pc.pi * (U + V))),
        {"torus": 1}, {"circle": 1, "rational B-spline curve": 1}, 40 * pi**2),
    "cap about another point": (
        tuple((2 + W) * x / (1 + PLANE[0] ** 2 + PLANE[1] ** 2)
              for x in (2 * PLANE[0], 2 * PLANE[1], PLANE[0] ** 2 + PLANE[1] ** 2 - 1)),
        {"sphere": 2, "cone": 1}, {"circle": 4, "line": 1},
        2 * pi * (1 - cos(atan(0.8) - atan(-0.2))) * 19 / 3),
}  # fmt: skip


@pytest.mark.parametrize("name", ASKEW)
def test_faces_that_end_across_their_parameters(name, tmp_path):
    point, expected, edges, volume = ASKEW[name]
    turn, size = rotation(3), 0.7
    turned = (sum(float(turn[i, j]) * size * point[j] for j in range(3)) + 2 for i in range(3))
    part = compile_part(tuple(turned))
    assert (carriers(part), curves(part)) == (expected, edges)
    assert_exact(part, gap=1e-12)
    assert part.report.solid.volume == pytest.approx(volume * size**3, rel=1e-11)
    part.write(tmp_path / "part.step")
    assert check_step(tmp_path / "part.step").volume == pytest.approx(volume * size**3, rel=1e-11)


@pytest.mark.interop
def test_other_programs_find_faces_cut_obliquely_valid(tmp_path):
    paths = [tmp_path / f"{i}.step" for i in range(len(ASKEW))]
    for path, (point, *_) in zip(paths, ASKEW.values(), strict=True):
        compile_part(point).write(path)
    for seen, (_, faces, _, volume) in zip(
        read_all_in_gmsh(list(paths)), ASKEW.values(), strict=True
    ):
        assert (seen["volumes"], seen["surfaces"]) == (1, sum(faces.values()))
        assert seen["volume"] == pytest.approx(volume, rel=1e-11)
    # a seam along straight lines of the hyperboloid is the hardest
    found = read_in_fresh_process(
        paths[list(ASKEW).index("hyperboloid by its lines")], precise=True
    )
    assert (found["valid"], found["free_edges"]) == (True, 0)
    assert max(found[f"max_{kind}_tolerance"] for kind in ("vertex", "edge", "face")) < 2e-7
    assert found["volume"] == pytest.approx(16 * pi, rel=1e-11)


def test_a_hyperboloid_is_no_spline_in_a_file(tmp_path):
    compile_part(SHELLS["hyperboloid"][0](*half_tangent(U))).write(tmp_path / "part.step")
    text = (tmp_path / "part.step").read_text()
    assert text.count("SURFACE_OF_REVOLUTION(") == 2
    assert "B_SPLINE_SURFACE" not in text


# -- what is no carrier ----------------------------------------------------------------------------

C, S = half_tangent(U)
UNIT = Frame(np.zeros(3), np.eye(3))


def test_a_proof_needs_all_digits():
    round_ = (2 * C * pc.cos(V), 2 * S * pc.cos(V), 2 * pc.sin(V))
    assert holds(Sphere(UNIT, 2.0), round_)
    assert holds(Sphere(UNIT, 2.0 + 1e-13), round_)
    assert not holds(Sphere(UNIT, 2.0 + 1e-9), round_)
    assert not holds(Sphere(Frame(np.array([1e-9, 0, 0]), np.eye(3)), 2.0), round_)
    assert holds(Arc(UNIT, (3.0, 1.0), 0, 1), (3 * C, S, 0 * U))
    assert not holds(Arc(UNIT, (3.0, 1.0), 0, 1), (3 * C, S, 1e-8 * U))
    assert not holds(Cylinder(UNIT, 1.0), (C, S + 1e-8 * U, V))
    assert holds(Plane(np.zeros(3), np.array([1, -1, 0]) / sqrt(2)), (C, C, S))


IDENTITIES = {
    "double angle": (pc.cos(2 * U), 2 * pc.sin(U) * pc.cos(U)),
    "treble angle": (pc.cos(3 * U), 3 * pc.sin(U) - 4 * pc.sin(U) ** 3),
    "tangent": (1 / pc.sqrt(1 + pc.tan(U) ** 2), pc.tan(U) * pc.cos(U)),
    "hyperbolic": (1 / pc.cosh(U), pc.tanh(U)),
    "exponential": (2 * pc.exp(U) / (1 + pc.exp(2 * U)), (pc.exp(2 * U) - 1) / (1 + pc.exp(2 * U))),
    "arc sine": (pc.cos(pc.asin(U)), U),
    "arc cosine": (U, pc.sin(pc.acos(U))),
    "arc tangent": (pc.cos(pc.atan(U)), U / (1 + U * U) ** 0.5),
    "two parameters": (pc.cos(U + V), pc.sin(U + V)),
}


@pytest.mark.parametrize("name", IDENTITIES)
def test_proofs_know_what_functions_have_in_common(name):
    c, s = IDENTITIES[name]
    assert holds(Cylinder(UNIT, 3.0), (3 * c, 3 * s, V))
    assert not holds(Cylinder(UNIT, 3.0), (3 * c, 3 * s + 1e-8 * U, V))


def test_a_dome_over_a_square():
    x, y = U - 0.5, V - 0.5
    part = compile_part((x, y, W * pc.sqrt(4 - x * x - y * y)))
    assert carriers(part) == {"sphere": 1, "plane": 5}
    assert curves(part) == {"circle": 4, "line": 8}
    assert_exact(part)


@pytest.mark.parametrize("size", [1, Fraction(1, 100), 10**5])
@pytest.mark.parametrize("thick", [0, 1], ids=["touching at the corner", "thick"])
def test_a_cone_may_have_its_apex_at_a_corner(thick, size, tmp_path):
    part = compile_part((size * U, size * V, size * W * (thick + pc.sqrt(U**2 + V**2))))
    assert carriers(part) == {"cone": 1, "plane": 5}
    assert_exact(part)
    volume = float(size) ** 3 * (thick + (sqrt(2) + asinh(1)) / 3)
    assert part.report.solid.volume == pytest.approx(volume, rel=1e-12)
    part.write(tmp_path / "part.step")
    assert check_step(tmp_path / "part.step").volume == pytest.approx(volume, rel=1e-12)


@pytest.mark.parametrize("thick", [0, 1], ids=["touching at the corner", "thick"])
def test_a_paraboloid_with_its_pole_at_a_corner_is_polynomial(thick):
    """The pole is a place of the surface of revolution's parameters, and none of the solid's."""
    part = compile_part((U, V, W * (thick + U**2 + V**2)))
    assert carriers(part) == {"Bézier surface": 1, "plane": 5}
    assert_exact(part)
    assert part.report.injectivity == "proved"
    assert part.report.solid.volume == pytest.approx(thick + 2 / 3, rel=1e-12)


def test_a_sector_of_a_degree():
    # a hundredth of a radian, where a circle, a parabola and an ellipse are all but one
    c, s = half_tangent(U / 200)
    part = compile_part((R * c, R * s, 3 * V))
    assert carriers(part) == {"cylinder": 2, "plane": 4}
    assert_exact(part)


def test_nearly_a_cylinder_is_what_it_is():
    part = compile_part((R * C, (1 + 1e-9) * R * S, 3 * V))
    assert carriers(part) == {"extrusion": 2, "plane": 4}
    (outer,) = (f.carrier for f in part.model.faces if f.name == "w=1")
    assert np.ptp(outer.basis.radii) == pytest.approx(2e-9, rel=1e-3)
    bent = compile_part((R * C, R * S + 1e-6 * V * V, 3 * V), tolerance=1e-8)
    assert carriers(bent) == {"B-spline surface": 2, "plane": 3, "extrusion": 1}


def test_a_seam_that_winds_about_a_pole_leaves_the_sphere_rational():
    turn, down = THETA + pc.pi * V, pc.pi * V
    ball = (2 * W * pc.sin(down) * pc.cos(turn), 2 * W * pc.sin(down) * pc.sin(turn),
            2 * W * pc.cos(down))  # fmt: skip
    part = compile_part(ball)
    assert carriers(part) == {"rational B-spline surface": 1}
    assert_exact(part)


def test_a_screw_has_no_carrier():
    part = compile_part((R * pc.cos(2 * V), R * pc.sin(2 * V), V + U / 2))
    assert carriers(part)["cylinder"] == 0
    assert part.report.deviation <= part.report.tolerance


def test_figures_of_fitted_carriers_are_short_decimals():
    part = compile_part(tuple(x + 3 for x in SHELLS["torus"][0](*half_tangent(U))))
    found = [figures(f.carrier) for f in part.model.faces if f.carrier is not None]
    assert {"major radius": 5.0, "minor radius": 1.0} in found
    assert {"major radius": 5.0, "minor radius": 2.0} in found


def test_the_cubic_profile_has_no_rational_meridian():
    point = SHELLS["hyperboloid"][0](*half_tangent(U))
    part = compile_part(point, tolerance=1e-4, profile="cubic")
    assert carriers(part) == {"B-spline surface": 2, "plane": 4}
    assert {f.degrees for f in part.report.faces if f.degrees} == {(3, 3)}


@pytest.mark.parametrize(
    ("point", "volume"),
    [
        ((W * pc.cos(THETA), W * pc.sin(THETA), V * (4 + W * pc.cos(THETA) / 2)), 4 * pi),
        ((2 * W * pc.cos(THETA), W * pc.sin(THETA), 3 * V), 6 * pi),
    ],
    ids=["cut obliquely", "elliptic"],
)
def test_ellipses_are_written_as_iges(point, volume, tmp_path):
    cq = pytest.importorskip("cadquery")
    compile_part(point).write(tmp_path / "part.igs")
    reader = IGESControl_Reader()
    reader.ReadFile(str(tmp_path / "part.igs"))
    reader.TransferRoots()
    assert BRepCheck_Analyzer(reader.OneShape()).IsValid()
    # by triangles: the kernel's own integrals ignore the knots between arcs
    places, triangles = cq.Shape.cast(reader.OneShape()).tessellate(1e-3, 0.05)
    x = np.array([place.toTuple() for place in places])[np.array(triangles)]
    assert np.linalg.det(x).sum() / 6 == pytest.approx(volume, rel=1e-3)
