"""Which carriers faces and edges get, and that they are the equation's own point sets."""

from __future__ import annotations

import itertools
from collections import Counter
from math import atan, degrees, pi, sqrt

import numpy as np
import pytest
from consumers.step_file import check_step
from hypothesis import given, settings
from hypothesis import strategies as st
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_FORWARD
from OCP.TopExp import TopExp_Explorer

import pc2cad as pc
from pc2cad.brep.kernel import as_edge, as_face
from pc2cad.compiler import compile_equation
from pc2cad.errors import InputError
from pc2cad.expression.derivatives import derivatives
from pc2cad.geometry.carriers import Cone, Cylinder, Sphere, Torus, curve_kind, figures
from pc2cad.part import Part
from pc2cad.templates.shipped import template_paths
from pc2cad.validation import ExpectationNotMetError

U, V, W = pc.parameters()
THETA, PHI = 2 * pc.pi * U, 2 * pc.pi * V
COS, SIN = pc.cos, pc.sin


def template(name: str, **values) -> Part:
    return compile_equation(pc.read_template(template_paths()[name]).bind(values))


def carriers(part: Part) -> Counter:
    return Counter(face.carrier for face in part.report.faces)


def curves(part: Part) -> Counter:
    return Counter(curve_kind(edge.carrier) for edge in part.model.edges)


def explored(shape, kind):
    explorer = TopExp_Explorer(shape, kind)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def largest_gap(part: Part) -> float:
    """How far edges are from their curves in the faces' parameters, at equal parameters."""
    gap = 0.0
    for face in (as_face(f) for f in explored(part.shape, TopAbs_FACE)):
        plain = as_face(face.Oriented(TopAbs_FORWARD))
        surface = BRep_Tool.Surface_s(plain)
        for edge in (as_edge(e) for e in explored(plain, TopAbs_EDGE)):
            first, last = BRep_Tool.Range_s(edge)
            pcurve = BRep_Tool.CurveOnSurface_s(edge, plain, first, last)
            if BRep_Tool.Degenerated_s(edge):
                continue
            curve = BRep_Tool.Curve_s(edge, first, last)
            for t in np.linspace(first, last, 23):
                place = pcurve.Value(float(t))
                on_face = surface.Value(place.X(), place.Y())
                gap = max(gap, on_face.Distance(curve.Value(float(t))))
    return gap


def assert_exact(part: Part, gap: float = 1e-13) -> None:
    report = part.report
    assert {face.evidence for face in report.faces} == {"exact"}
    assert {edge.evidence for edge in part.model.edges} == {"exact"}
    assert report.solid.volume == pytest.approx(report.equation.volume, rel=1e-12, abs=0)
    assert report.solid.area == pytest.approx(report.equation.area, rel=1e-12, abs=0)
    shift = np.subtract(report.solid.centroid, report.equation.centroid)
    assert np.abs(shift).max() <= 1e-12 * report.size
    assert largest_gap(part) <= gap * report.size


# -- the acceptance suite --------------------------------------------------------------------------

SUITE = {
    "oblique_prism": {"plane": 5},
    "parallelepiped": {"plane": 6},
    "ball": {"sphere": 1},
    "half_ball": {"sphere": 1, "plane": 1},
    "ball_wedge": {"sphere": 1, "plane": 2},
    "hollow_ball": {"sphere": 2},
    "torus": {"torus": 1},
    "torus_wedge": {"torus": 1, "plane": 2},
    "torus_tube": {"torus": 2},
    "cone": {"cone": 1, "plane": 1},
    "cone_frustum": {"cone": 1, "plane": 2},
    "hollow_cylinder": {"cylinder": 2, "plane": 2},
    "paraboloid_cap": {"revolution": 1, "plane": 1},
    "elbow_pipe": {"torus": 2, "plane": 2},
    "bilinear_top": {"Bézier surface": 1, "plane": 5},
    "hypar_slab": {"Bézier surface": 2, "plane": 4},
    "ellipsoid": {"rational B-spline surface": 1},
    "turned_ring": {"rational Bézier surface": 4},
    "triquadratic_cube": {"Bézier surface": 1, "plane": 5},
    "pyramid": {"plane": 4},
    "pyramid_truncated": {"plane": 5},
    "pyramid_cut": {"plane": 5},
    "pyramid_cut_off": {"plane": 4},
    "pyramid_sum": {"plane": 5},
}
ENTITIES = {
    "plane": "PLANE(",
    "cylinder": "CYLINDRICAL_SURFACE(",
    "cone": "CONICAL_SURFACE(",
    "sphere": "SPHERICAL_SURFACE(",
    "torus": "TOROIDAL_SURFACE(",
    "revolution": "SURFACE_OF_REVOLUTION(",
}


@pytest.mark.parametrize("name", SUITE)
def test_suite_is_exact_on_the_named_carriers(name, tmp_path):
    part = template(name)
    assert carriers(part) == SUITE[name]
    assert_exact(part)
    part.write(tmp_path / "part.step")
    text = (tmp_path / "part.step").read_text()
    for kind, entity in ENTITIES.items():
        assert text.count(entity) == SUITE[name].get(kind, 0)
    found = check_step(tmp_path / "part.step")
    assert found.volume == pytest.approx(part.report.equation.volume, rel=1e-12)


def test_the_degrees_of_rational_faces():
    (face,) = template("ellipsoid").report.faces
    assert (face.degrees, face.poles) == ((2, 2), (9, 5))
    assert {f.degrees for f in template("turned_ring").report.faces} == {(10, 1)}


def test_radii_and_angles():
    assert figures(template("half_ball").model.faces[0].carrier) == {"radius": 2.0}
    walls = [figures(f.carrier) for f in template("hollow_cylinder").model.faces]
    assert [w["radius"] for w in walls if w] == [2.0, 3.0]
    pipe = [figures(f.carrier) for f in template("elbow_pipe").model.faces]
    assert {"major radius": 3.0, "minor radius": 0.5} in pipe
    assert {"major radius": 3.0, "minor radius": 1.0} in pipe
    cone = next(f.carrier for f in template("cone").model.faces if isinstance(f.carrier, Cone))
    assert figures(cone)["half angle"] == pytest.approx(degrees(atan(3 / 4)), rel=1e-15)


def test_step_files_hold_circles_and_lines(tmp_path):
    template("hollow_cylinder").write(tmp_path / "part.step")
    text = (tmp_path / "part.step").read_text()
    # four rims, each with its curve in the plane beside it; no spline anywhere
    assert text.count("= CIRCLE(") == 8
    assert "B_SPLINE" not in text


def test_equal_radii_turn_a_cone_into_a_cylinder():
    assert carriers(template("cone_frustum", r1=3)) == {"cylinder": 1, "plane": 2}


@pytest.mark.parametrize("axes", [dict(a=2, b=2, c=2), dict(a=2, b=2, c=1)])
def test_ellipsoids_with_equal_axes(axes):
    part = template("ellipsoid", **axes)
    assert carriers(part) == {"sphere" if axes["c"] == 2 else "revolution": 1}
    assert_exact(part)


# -- parametrisations ------------------------------------------------------------------------------


def annular(u, v, w) -> tuple:
    """A piece of pipe, whose parameters may run any way."""
    angle, radius = pc.pi * u, 2 + v
    return radius * COS(angle), radius * SIN(angle), 5 * w


@pytest.mark.parametrize("order", list(itertools.permutations("uvw")))
@pytest.mark.parametrize("flips", [0, 1, 2, 4, 7])
def test_every_order_and_direction_of_the_parameters(order, flips):
    names = dict(u=U, v=V, w=W)
    given_ = [names[n] for n in order]
    given_ = [1 - x if flips >> i & 1 else x for i, x in enumerate(given_)]
    part = pc.compile_part(annular(*given_))
    assert carriers(part) == {"cylinder": 2, "plane": 4}
    assert curves(part) == {"circle": 4, "line": 8}
    assert_exact(part)


@pytest.mark.parametrize("mirror", [1, -1])
@pytest.mark.parametrize("start", [0, 0.3, -2.1])
def test_wedges_of_a_torus_and_a_ball_from_any_angle(mirror, start):
    theta, phi = 2 * U + start, 3 * V + start
    ring = ((5 + (1 + W) * COS(phi)) * COS(theta), mirror * (5 + (1 + W) * COS(phi)) * SIN(theta),
            (1 + W) * SIN(phi))  # fmt: skip
    part = pc.compile_part(ring)
    assert carriers(part)["torus"] == 2
    assert_exact(part)
    latitude = V - 0.4
    shell = ((1 + W) * COS(latitude) * COS(theta), (1 + W) * COS(latitude) * SIN(theta),
             mirror * (1 + W) * SIN(latitude))  # fmt: skip
    part = pc.compile_part(shell)
    assert carriers(part) == {"sphere": 2, "cone": 2, "plane": 2}
    assert_exact(part)


def test_an_angle_that_is_no_linear_function_of_its_parameter():
    part = pc.compile_part(annular(U**2 * (2 - U), V, W))
    assert carriers(part) == {"cylinder": 2, "plane": 4}
    assert_exact(part)


def test_part_of_a_spindle_is_a_revolution_of_an_arc():
    angle = pc.pi * (V - 0.5) / 3
    spindle = (2 * W * COS(angle) - 1, 2 * W * SIN(angle))
    part = pc.compile_part(
        (spindle[0] * COS(THETA), spindle[0] * SIN(THETA), spindle[1]), {"w": (0.9, 1)}
    )
    assert carriers(part) == {"revolution": 2, "cone": 2}
    assert_exact(part)


def rotation(seed: int) -> np.ndarray:
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return turn


TURNED = {
    Sphere: ((1 + W) * SIN(pc.pi * V) * COS(THETA), (1 + W) * SIN(pc.pi * V) * SIN(THETA),
             (1 + W) * COS(pc.pi * V)),
    Cylinder: ((1 + W) * COS(THETA), (1 + W) * SIN(THETA), 3 * V),
    Cone: (W * (3 - 2 * V) * COS(THETA), W * (3 - 2 * V) * SIN(THETA), 3 * V),
    Torus: ((5 + 2 * W * COS(PHI)) * COS(THETA), (5 + 2 * W * COS(PHI)) * SIN(THETA),
            2 * W * SIN(PHI)),
}  # fmt: skip


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    st.sampled_from(list(TURNED)),
    st.integers(0, 10**6),
    st.sampled_from([1e-2, 1.0, 1e5]),
    st.integers(-50, 50),
)
def test_any_place_direction_and_size(kind, seed, size, shift):
    """Turned or mirrored, scaled and moved: still the same kinds of carriers."""
    turn, point = rotation(seed), TURNED[kind]
    moved = tuple(
        size * (sum(float(turn[i, j]) * point[j] for j in range(3)) + shift) for i in range(3)
    )
    part = pc.compile_part(moved)
    assert any(isinstance(f.carrier, kind) for f in part.model.faces)
    assert {f.evidence for f in part.report.faces} == {"exact"}
    assert part.report.solid.volume == pytest.approx(part.report.equation.volume, rel=1e-11, abs=0)
    # a place 50 sizes away costs two digits
    assert largest_gap(part) <= 1e-11 * part.report.size


# -- extrusions and rational walls -----------------------------------------------------------------


def test_elliptic_and_parabolic_walls_are_extrusions(tmp_path):
    ellipse = pc.compile_part((3 * W * COS(THETA), 2 * W * SIN(THETA), 4 * V))
    assert carriers(ellipse) == {"extrusion": 1, "plane": 2}
    assert curves(ellipse) == {"ellipse": 2, "line": 3}
    assert_exact(ellipse)
    parabola = pc.compile_part((U, V, W * (1 + U * (1 - U))))
    assert carriers(parabola) == {"extrusion": 1, "plane": 5}
    assert_exact(parabola)
    ellipse.write(tmp_path / "part.step")
    text = (tmp_path / "part.step").read_text()
    assert text.count("SURFACE_OF_LINEAR_EXTRUSION(") == 1
    assert "= ELLIPSE(" in text
    assert check_step(tmp_path / "part.step").volume == pytest.approx(24 * pi, rel=1e-12)


def test_an_oblique_cylinder_keeps_its_circles():
    part = pc.compile_part((2 * W * COS(THETA) + V, 2 * W * SIN(THETA), 4 * V))
    assert carriers(part) == {"extrusion": 1, "plane": 2}
    assert curves(part) == {"circle": 2, "line": 3}
    assert_exact(part)


def test_a_wave_of_seven_on_a_straight_guide_is_rational():
    wave = 2 + 0.3 * SIN(7 * PHI) + 0.4 * W
    part = pc.compile_part((wave * COS(PHI), wave * SIN(PHI), 5 * U))
    assert carriers(part) == {"extrusion": 2, "plane": 2}
    assert curves(part)["rational B-spline curve"] == 4
    assert_exact(part)
    assert part.report.solid.volume == pytest.approx(5 * pi * (2 * 2 * 0.4 + 0.4**2), rel=1e-12)


def test_rational_and_approximated_faces_agree_on_their_edges():
    """One face is rational along u, its neighbours have to be approximated in its parameter."""
    angle = pc.pi * U
    lift = V * (1 + U * SIN(angle) / 3)
    part = pc.compile_part(
        (
            (3 + W + V / 2) * COS(angle),
            (2 + W) * SIN(angle) * (1 + V * V / 8),
            lift + W * SIN(angle),
        )
    )
    kinds = carriers(part)
    assert kinds["rational B-spline surface"] >= 2
    assert {f.evidence for f in part.report.faces} > {"exact"}
    assert part.report.deviation <= part.report.tolerance
    assert largest_gap(part) <= 1e-11 * part.report.size


# -- roots that cancel -----------------------------------------------------------------------------


def wall(guide, section, thickness, share=0.5) -> tuple:
    """M = K + (K - N) δ/|KN| (w - s)."""
    length = pc.sqrt(sum((k - n) ** 2 for k, n in zip(section, guide, strict=True)))
    return tuple(
        k + (k - n) * thickness / length * (W - share) for k, n in zip(section, guide, strict=True)
    )


def test_a_circle_along_a_straight_guide():
    guide = (0 * U, 0 * U, 5 * U)
    section = (2 * COS(PHI), 2 * SIN(PHI), 5 * U)
    part = pc.compile_part(wall(guide, section, 0.4))
    assert carriers(part) == {"cylinder": 2, "plane": 2}
    assert_exact(part)


def test_a_circle_along_a_circular_guide():
    turn = pc.pi * U / 2
    guide = (6 * COS(turn), 6 * SIN(turn), 0 * U)
    out = (COS(turn), SIN(turn), 0 * U)
    section = tuple(
        n + 1.5 * COS(PHI) * e + 1.5 * SIN(PHI) * b
        for n, e, b in zip(guide, out, (0, 0, 1), strict=True)
    )
    part = pc.compile_part(wall(guide, section, 0.4))
    assert carriers(part) == {"torus": 2, "plane": 2}
    assert_exact(part)


def test_offset_of_a_torus_along_its_unit_normal():
    torus = ((5 + 2 * COS(PHI)) * COS(THETA), (5 + 2 * COS(PHI)) * SIN(THETA), 2 * SIN(PHI))
    a, b = derivatives(torus, "u"), derivatives(torus, "v")
    normal = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    length = pc.sqrt(sum(n * n for n in normal))
    part = pc.compile_part(
        tuple(p + n / length * (W - 1) / 2 for p, n in zip(torus, normal, strict=True))
    )
    assert carriers(part) == {"torus": 2}
    assert {figures(f.carrier)["minor radius"] for f in part.model.faces} == {1.5, 2.0}
    assert_exact(part)


def test_what_does_not_cancel_stays_approximated():
    """8a on a straight guide: the walls are conchoids of an ellipse, no rational surfaces."""
    part = pc.compile_part(
        wall((0 * U, 0 * U, 5 * U), (2 * COS(PHI), 1.2 * SIN(PHI), 5 * U), 0.4), tolerance=1e-5
    )
    walls = [f for f in part.report.faces if f.name in ("w=0", "w=1")]
    assert all(f.evidence != "exact" for f in walls)
    assert [f.evidence for f in part.report.faces if f.carrier == "plane"] == ["exact"] * 2


@pytest.mark.slow
def test_a_wave_is_no_plane_because_its_zeros_are_sampled():
    part = pc.compile_part((U, V, W * (2 + SIN(400 * pc.pi * U) / 10)), tolerance=1e-2)
    assert carriers(part)["plane"] == 5
    assert part.report.solid.volume == pytest.approx(2, rel=1e-2)


def test_the_cubic_profile_knows_no_rational_faces():
    part = compile_equation(
        pc.read_template(template_paths()["ellipsoid"]).bind(), 1e-4, profile="cubic"
    )
    (face,) = part.report.faces
    assert (face.carrier, face.degrees) == ("B-spline surface", (3, 3))
    assert sqrt(part.report.solid.volume) == pytest.approx(sqrt(8 * pi), rel=1e-4)


# -- analytic faces beside others ------------------------------------------------------------------

BULGE = W * (1 - W) / 3
BESIDE = {
    # a top that needs a spline, one that is rational, and one all round
    "spline": ((2 + W) * COS(pc.pi * U), (2 + W) * SIN(pc.pi * U), V * (3 + BULGE * pc.exp(U))),
    "rational": ((2 + W) * COS(pc.pi * U), (2 + W) * SIN(pc.pi * U),
                 V * (3 + BULGE * SIN(pc.pi * U))),
    "round": ((2 + W) * COS(THETA), (2 + W) * SIN(THETA), V * (3 + BULGE * pc.exp(SIN(THETA)))),
    # straight edges at uneven speed
    "straight": ((2 + W) * COS(pc.pi * U / 2) + BULGE * U**2 * SIN(3 * V),
                 (2 + W) * SIN(pc.pi * U / 2), pc.exp(V)),
}  # fmt: skip


@pytest.mark.parametrize("name", BESIDE)
def test_cylinders_beside_other_faces(name, tmp_path):
    # so rough that an edge of the other face's accuracy would leave the cylinder
    part = pc.compile_part(BESIDE[name], tolerance=1e-3)
    assert carriers(part)["cylinder"] == 2
    assert largest_gap(part) <= 1e-12 * part.report.size
    assert part.report.deviation <= 1e-3
    path = tmp_path / "part.step"
    part.write(path)
    slack = 1e-12 if part.report.evidence == "exact" else 1e-5
    assert check_step(path).volume == pytest.approx(part.report.equation.volume, rel=slack)


def test_a_face_whose_edge_has_to_be_approximated_is_no_cylinder():
    angle = pc.pi * U**2
    point = ((2 + W) * COS(angle), (2 + W) * SIN(angle), V * (3 + BULGE * pc.exp(U)))
    part = pc.compile_part(point, tolerance=1e-4)
    assert "cylinder" not in carriers(part)
    assert largest_gap(part) <= 1e-12 * part.report.size


# -- templates -------------------------------------------------------------------------------------


def test_a_template_states_its_carriers(tmp_path):
    path = tmp_path / "wrong.toml"
    text = template_paths()["half_ball"].read_text()
    assert "carriers = { sphere = 1, plane = 1 }" in text
    path.write_text(text.replace("{ sphere = 1, plane = 1 }", "{ sphere = 2 }"))
    with pytest.raises(ExpectationNotMetError, match=r"sphere = 2; but there are sphere = 1"):
        compile_equation(pc.read_template(path).bind())
    path.write_text(text.replace("{ sphere = 1, plane = 1 }", "{ spheer = 1 }"))
    with pytest.raises(InputError, match="sphere"):
        pc.read_template(path)
    path.write_text(text.replace("{ sphere = 1, plane = 1 }", "2"))
    with pytest.raises(InputError, match="is a table"):
        pc.read_template(path)


def test_the_report_holds_radii():
    faces = template("elbow_pipe").report.to_dict()["faces"]
    assert faces[1]["figures"] == {"major radius": 3.0, "minor radius": 0.5}


def chebyshev(degree, x):
    before, last = 1, x
    for _ in range(degree - 1):
        before, last = last, 2 * x * last - before
    return last


@pytest.mark.parametrize(("degree", "evidence"), [(9, "exact"), (15, "bounded"), (20, "bounded")])
def test_polynomials_that_the_kernel_cannot_evaluate_are_approximated(degree, evidence):
    """T_15(2u - 1) by powers of u has coefficients of 1e11; what is off is seen on the kernel's."""
    part = pc.compile_part((3 * U, V, W * (2 + chebyshev(degree, 2 * U - 1) * V / 20)))
    (face,) = (f for f in part.report.faces if f.name == "w=1")
    assert face.evidence == evidence
    surface = BRepAdaptor_Surface(part.faces["w=1"])
    for a in np.linspace(0.01, 0.99, 41):
        p = surface.Value(float(a), 0.71)
        u, v = p.X() / 3, p.Y()
        height = 2 + np.cos(degree * np.arccos(2 * u - 1)) * v / 20
        assert abs(p.Z() - height) <= max(face.deviation, 1e-11)


def test_high_powers_stay_exact():
    part = pc.compile_part((3 * U, V, W * (2 + U**25 * V)))
    assert {face.evidence for face in part.report.faces} == {"exact"}
    assert part.report.solid.volume == pytest.approx(6 + 3 / 52, rel=1e-13)
