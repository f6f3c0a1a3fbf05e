"""Edges where bodies meet: bounds against dense samples; exact, tangent, displaced ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.Geom import (
    Geom_BSplineCurve,
    Geom_ConicalSurface,
    Geom_CylindricalSurface,
    Geom_Line,
    Geom_Plane,
    Geom_SphericalSurface,
    Geom_SurfaceOfLinearExtrusion,
    Geom_SurfaceOfRevolution,
    Geom_ToroidalSurface,
)
from OCP.Geom2d import Geom2d_Line
from OCP.gp import gp_Ax3, gp_Dir, gp_Dir2d, gp_Pnt, gp_Pnt2d
from scipy.interpolate import BSpline
from shipped import part_of

import pc2cad as pc
from pc2cad.bounds.edge_bounds import bound_edge
from pc2cad.brep import to_kernel
from pc2cad.brep.booleans import NamedEdge, edge_functions, label
from pc2cad.brep.from_kernel import curve_function, path_function, surface_function
from pc2cad.csg.seams import MET
from pc2cad.errors import ToleranceNotReachedError
from pc2cad.geometry.carriers import SplineCurve, SplinePath, SplineSurface
from pc2cad.geometry.jets import EdgeFunction, SurfaceFunction, Trace
from pc2cad.part import Part
from pc2cad.report import EdgeReport
from pc2cad.templates.file import parse_template
from pc2cad.templates.shipped import bodies_paths

Array = NDArray[np.float64]


def compiled(result: str, tolerance: float | None = None, **bodies: tuple[str, ...]) -> Part:
    tables = "".join(
        f'[[bodies]]\nname = "{name}"\n'
        + (f"domain = {{ {domain[0]} }}\n" if domain else "")
        + f'solid = {{ x = "{x}", y = "{y}", z = "{z}" }}\n'
        for name, (x, y, z, *domain) in bodies.items()
    )
    template = parse_template(f'title = "t"\nresult = "{result}"\n{tables}', "t")
    return pc.compile_equation(template.bind(), tolerance)


def meetings(part: Part) -> list[tuple[NamedEdge, EdgeReport]]:
    """Return the edges where bodies meet, each with what is reported of it."""
    names = [" / ".join(label(side) for side in edge.names) for edge in part.edges]
    met = [edge for edge, name in zip(part.edges, names, strict=True)
           if name in {curve.name for curve in part.report.curves}]  # fmt: skip
    return list(zip(met, part.report.curves, strict=True))


def places(edge: NamedEdge, count: int) -> Array:
    """Return points of the kernel's curve."""
    first, last = BRep_Tool.Range_s(edge.edge)
    curve, t = BRep_Tool.Curve_s(edge.edge, first, last), np.linspace(first, last, count)
    if not isinstance(curve, Geom_BSplineCurve):
        return np.array([curve.Value(x).Coord() for x in t])
    knots = [curve.Knot(i + 1) for i in range(curve.NbKnots())]
    counts = [curve.Multiplicity(i + 1) for i in range(curve.NbKnots())]
    poles = [curve.Pole(i + 1).Coord() for i in range(curve.NbPoles())]
    return np.asarray(BSpline(np.repeat(knots, counts), poles, curve.Degree())(t))


def off_faces(edge: NamedEdge, part: Part, count: int) -> float:
    """Return the largest distance from the surfaces of the faces, as the kernel evaluates them."""
    first, last = BRep_Tool.Range_s(edge.edge)
    curve, largest = BRep_Tool.Curve_s(edge.edge, first, last), 0.0
    for index in edge.faces:
        face = part.surface[index].face
        surface = BRep_Tool.Surface_s(face)
        path = BRep_Tool.CurveOnSurface_s(edge.edge, face, first, last)
        for t in np.linspace(first, last, count).tolist():
            foot = path.Value(t)
            largest = max(largest, curve.Value(t).Distance(surface.Value(foot.X(), foot.Y())))
    return largest


#: how many edges of each shipped template lie where bodies meet
MEETINGS = {"common_of_pipes": 6, "cooled_block": 2, "pipe_cross": 16}


@pytest.fixture(scope="module")
def shipped() -> dict[str, Part]:
    return {name: part_of(name) for name in MEETINGS}


@pytest.mark.slow
def test_nothing_that_the_templates_contain_is_sampled(shipped):
    found = {name: meetings(part) for name, part in shipped.items()}
    assert {name: len(edges) for name, edges in found.items()} == MEETINGS
    for name, part in shipped.items():
        for edge, report in found[name]:
            assert report.evidence == ("bounded" if "duct" in report.name else "exact")
            assert (report.deviation == 0.0) == (report.evidence == "exact")
            seen = off_faces(edge, part, 200)
            assert seen <= report.surface_distance <= 1.2 * seen + 1e-13 * part.report.size
            assert report.surface_distance <= BRep_Tool.Tolerance_s(edge.edge)
        assert part.report.evidence == ("bounded" if name == "cooled_block" else "exact")
        assert not any("sampled" in words for words in part.report.statements())


@pytest.mark.slow
def test_the_duct_meets_the_block_within_its_bound(shipped):
    """On both ends the wavy duct's equation is a circle about (3, 2)."""
    part = shipped["cooled_block"]
    found = meetings(part)
    assert len(found) == 2
    for (edge, report), x in zip(found, (0.0, 8.0), strict=True):
        points = places(edge, 20_000)
        radial = np.hypot(points[:, 1] - 3, points[:, 2] - 2) - 0.8
        distance = float(np.hypot(points[:, 0] - x, radial).max())
        # the bound holds what the duct's face is off anywhere, which is most of it
        assert distance <= report.deviation <= min(4 * distance, part.report.tolerance)
        curve = BRep_Tool.Curve_s(edge.edge, 0.0, 1.0)
        assert (report.degree, report.poles) == (curve.Degree(), curve.NbPoles())


def to_meeting(points: Array, *surfaces: Callable[[Array], tuple[Array, Array]]) -> Array:
    """Return distances from where two surfaces meet, by Newton's steps across it (n,).

    Each surface gives distances (n,) from it and their gradients (n, 3).
    """
    start = points
    for _ in range(4):
        (f, n), (g, m) = (surface(points) for surface in surfaces)
        cosine = (n * m).sum(axis=1)
        square = 1 - cosine**2
        a, b = (f - cosine * g) / square, (g - cosine * f) / square
        points = points - a[:, None] * n - b[:, None] * m
    return np.asarray(np.linalg.norm(points - start, axis=1))


def about(axis: Array, origin: Array, radius: float) -> Callable[[Array], tuple[Array, Array]]:
    def cylinder(points: Array) -> tuple[Array, Array]:
        away = points - origin
        away = away - (away @ axis)[:, None] * axis
        distance = np.linalg.norm(away, axis=1)
        return distance - radius, away / distance[:, None]

    return cylinder


def tenths(first: int, last: int) -> st.SearchStrategy[float]:
    return st.integers(first, last).map(lambda n: n / 10)


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(
    turn=tenths(-9, 9), rise=tenths(-5, 5), radius=tenths(2, 8),
    scale=st.sampled_from([1e-2, 1.0, 1e5]), moved=st.sampled_from([0.0, 100.0]),
)  # fmt: skip
def test_pipes_at_any_angle_and_of_any_size(turn, rise, radius, scale, moved):
    """A bore of another width through a bar, obliquely and not through its axis."""
    c, s, origin = np.cos(turn), np.sin(turn), scale * np.array([moved, 0.1, rise * (1 - radius)])
    bar = (f"{scale}*(w*cos(2*pi*v) + {moved})", f"{scale}*w*sin(2*pi*v)", f"{scale}*6*(u - 1/2)")
    across, along = f"{radius}*w*cos(2*pi*v)", "8*(u - 1/2)"
    bore = (
        f"{scale}*({c}*{along} - {s}*{radius}*w*sin(2*pi*v)) + {origin[0]}",
        f"{scale}*{across} + {origin[1]}",
        f"{scale}*({s}*{along} + {c}*{radius}*w*sin(2*pi*v)) + {origin[2]}",
    )
    part = compiled("cut(bar, bore)", 1e-6 * scale, bar=bar, bore=bore)
    found = meetings(part)
    assert found
    surfaces = (
        about(np.array([0.0, 0.0, 1.0]), scale * np.array([moved, 0, 0]), scale),
        about(np.array([c, 0.0, s]), origin, radius * scale),
    )
    rounding = 1e-15 * scale * (1 + moved)
    for edge, report in found:
        distance = float(to_meeting(places(edge, 2_000), *surfaces).max())
        assert report.evidence == "bounded"
        assert distance <= report.deviation + rounding
        assert report.deviation <= 4 * distance + 2e-11 * scale
        assert report.surface_distance <= BRep_Tool.Tolerance_s(edge.edge)


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(
    turn=tenths(-10, 10), rise=tenths(-6, 6), radius=tenths(2, 8), wave=tenths(1, 4),
    scale=st.sampled_from([1.0, 30.0, 1e4]),
)  # fmt: skip
def test_wavy_tubes_through_a_block(turn, rise, radius, wave, scale):
    """The tube is a spline; its equation says where it meets the block's planes."""
    (c, s), (k, h) = ((np.cos(x), np.sin(x)) for x in (turn, rise))
    y, z = f"({wave}*sin(u) + {radius}*w*cos(2*pi*v))", f"({radius}*w*sin(2*pi*v))"
    tube = (
        f"{scale}*({c}*({k}*u - {h}*{z}) - {s}*{y})", f"{scale}*({s}*({k}*u - {h}*{z}) + {c}*{y})",
        f"{scale}*({h}*u + {k}*{z})", "u = [-8, 8]",
    )  # fmt: skip
    block = (f"{scale}*8*(u-1/2)", f"{scale}*6*(v-1/2)", f"{scale}*4*(w-1/2)")
    part = compiled("cut(block, tube)", block=block, tube=tube)
    axes = np.array([[c * k, s * k, h], [-s, c, 0.0], [-c * h, -s * h, k]])

    def wall(points: Array) -> tuple[Array, Array]:
        x, y, z = (points / scale @ axes.T).T
        across = np.stack((y - wave * np.sin(x), z), axis=1)
        width = np.linalg.norm(across, axis=1)
        e, f = across.T / width
        gradient = np.stack((-wave * np.cos(x) * e, e, f), axis=1) @ axes
        steep = np.linalg.norm(gradient, axis=1)
        return scale * (width - radius) / steep, gradient / steep[:, None]

    found = meetings(part)
    assert len(found) >= 2  # where it goes in and where it comes out
    for edge, report in found:
        points = places(edge, 20_000)
        middle = np.abs(points - points.mean(axis=0)).max(axis=0).argmin()
        normal, level = np.eye(3)[middle], points[:, middle].mean()
        distance = to_meeting(
            points, wall, lambda p, n=normal, x=level: (p @ n - x, np.tile(n, (len(p), 1)))
        )
        assert report.evidence == "bounded"
        assert distance.max() <= report.deviation
        assert report.deviation <= max(2.5 * distance.max(), 1.5 * part.report.tolerance)


@pytest.mark.parametrize(
    ("carrier", "slope", "place"),
    [("ellipse", -0.2, 3.0), ("parabola", 1.0, 0.5), ("hyperbola", 9.0, 1.2)],
)
def test_a_cone_cut_by_a_plane_has_exact_edges(carrier, slope, place):
    """The cone x² + y² = (2 - z)² and what lies beyond the plane z = slope (x - place)."""
    cone = ("2*(1 - w)*v*cos(2*pi*u)", "2*(1 - w)*v*sin(2*pi*u)", "2*w")
    if carrier == "ellipse":
        block = ("8*(u - 1/2)", "8*(v - 1/2)", f"{slope}*(8*(u - 1/2) - {place}) + 4*w")
    else:
        block = (f"{place} + 4*w/{slope} + 6*u", "8*(v - 1/2)", "4*w")
    part = compiled("cut(cone, block)", cone=cone, block=block)
    found = {report.carrier: edge for edge, report in meetings(part)}
    assert {report.evidence for report in part.report.curves} == {"exact"}
    x, y, z = places(found[carrier], 1000).T
    assert np.abs(z - slope * (x - place)).max() < 1e-14 * max(abs(slope), 1) * 8
    assert np.abs(x**2 + y**2 - (2 - z) ** 2).max() < 1e-14 * 8
    # slices across z, each of a disc less what lies beyond a chord
    node, weight = np.polynomial.legendre.leggauss(400)
    height = 1 + node
    radius, chord = 2 - height, place + height / slope
    share = np.clip(chord / radius, -1, 1)
    inside = radius**2 * (np.pi - np.arccos(share) + share * np.sqrt(1 - share**2))
    assert part.report.solid.volume == pytest.approx(float(weight @ inside), rel=2e-4)


@pytest.mark.slow
def test_edges_at_a_shallow_angle_are_within_the_tolerance():
    """Two pipes, one turned by a twentieth: where they are nearly parallel d/sin α counts."""
    c, s = np.cos(0.05), np.sin(0.05)
    one = ("8*(u - 1/2)", "w*cos(2*pi*v)", "w*sin(2*pi*v)")
    y, z = "0.9*w*cos(2*pi*v)", "0.3 + 0.9*w*sin(2*pi*v)"
    two = (f"8*(u - 1/2)*{c} - {s}*{y}", f"8*(u - 1/2)*{s} + {c}*{y}", z)
    report = compiled("union(one, two)", 1.5e-7, one=one, two=two).report
    wide = [curve.name for curve in report.curves if curve.deviation > report.tolerance]
    assert len(report.curves) > 4
    assert wide == []
    assert report.evidence == "bounded"
    assert report.warnings == ()


def test_a_cut_along_a_line_of_knots():
    """Where the face has no width beside the edge there is nothing to integrate."""
    slab = ("4*(u - 1/2)", "4*(v - 1/2)", "3*(u - 1/2)*(v - 1/2) + w")
    block = ("4*u + v/10", "8*(v - 1/2)", "u/5 + 8*(w - 1/2)")
    report = compiled("cut(slab, block)", slab=slab, block=block).report
    assert {curve.evidence for curve in report.curves} == {"exact", "bounded"}


@pytest.mark.slow
def test_a_bore_beside_the_seam_of_an_egg():
    """As it stands the kernel takes tolerances of the egg's size: the egg is halved before."""
    radius = "w*cos(pi*(u - 1/2))"
    egg = (f"3*{radius}*cos(2*pi*v)", f"2*{radius}*sin(2*pi*v)", "4*w*sin(pi*(u - 1/2))")
    bore = ("u", "0.3 + 0.5*w*cos(2*pi*v)", "0.2 + 0.5*w*sin(2*pi*v)", "u = [-6, 6]")
    report = compiled("cut(egg, bore)", egg=egg, bore=bore).report
    nodes, weights = np.polynomial.legendre.leggauss(40)
    r, turn = (nodes + 1) / 4, np.arange(80) * (2 * np.pi / 80)
    y = 0.3 + r[:, None] * np.cos(turn)
    z = 0.2 + r[:, None] * np.sin(turn)
    chords = 6 * np.sqrt(1 - (y / 2) ** 2 - (z / 4) ** 2).mean(axis=1)
    removed = 2 * np.pi * (weights / 4 * r) @ chords
    assert report.solid.volume == pytest.approx(32 * np.pi - removed, rel=1e-11)
    assert report.seams == (f"egg is cut in halves where it closes: {MET}",)
    assert report.warnings == ()


def test_arcs_of_a_rational_face_make_no_crease():
    """An elliptic funnel, four arcs round, which is no cone: its second derivatives jump."""
    funnel = ("(2 + u)*w*cos(2*pi*v)", "(3 - u/2)*w*sin(2*pi*v)", "4*u - 2")
    block = ("1 + 4*u", "8*(v - 1/2) + 0.3*u", "9*(w - 1/2)")
    part = compiled("cut(funnel, block)", 1e-5, funnel=funnel, block=block)

    def wall(points: Array) -> tuple[Array, Array]:
        x, y, z = points.T
        a, b = 2 + (z + 2) / 4, 3 - (z + 2) / 8
        slopes = 2 * x / a**2, 2 * y / b**2, -(x**2) / a**3 / 2 + y**2 / b**3 / 4
        gradient, steep = np.stack(slopes, axis=1), np.linalg.norm(slopes, axis=0)
        return ((x / a) ** 2 + (y / b) ** 2 - 1) / steep, gradient / steep[:, None]

    found = [pair for pair in meetings(part) if pair[1].carrier == "B-spline curve"]
    assert len(found) == 2
    for edge, report in found:
        assert report.evidence == "bounded"
        distance = to_meeting(
            places(edge, 2_000), wall, lambda p: (p[:, 0] - 1, np.tile([1.0, 0, 0], (len(p), 1)))
        ).max()
        assert distance <= report.deviation <= 3 * distance


@pytest.mark.slow
def test_a_wavy_tube_through_a_wavy_slab():
    """Both are splines, and both equations are known without their parameters."""
    slab = ("4*(u - 1/2)", "4*(v - 1/2)", "0.3*sin(3*u)*cos(4*v) + w")
    bore = ("0.3 + 0.5*w*cos(2*pi*v) + 0.2*sin(u)", "0.5*w*sin(2*pi*v)", "u", "u = [-3, 3]")
    part = compiled("cut(slab, bore)", slab=slab, bore=bore)

    def height(points: Array, level: float) -> tuple[Array, Array]:
        x, y, z = points.T
        u, v = 3 * (x / 4 + 0.5), 4 * (y / 4 + 0.5)
        slopes = -0.225 * np.cos(u) * np.cos(v), 0.3 * np.sin(u) * np.sin(v), np.ones_like(z)
        gradient, steep = np.stack(slopes, axis=1), np.linalg.norm(slopes, axis=0)
        return (z - 0.3 * np.sin(u) * np.cos(v) - level) / steep, gradient / steep[:, None]

    def wall(points: Array) -> tuple[Array, Array]:
        x, y, z = points.T
        across = x - 0.3 - 0.2 * np.sin(z)
        width = np.hypot(across, y)
        slopes = across / width, y / width, -0.2 * np.cos(z) * across / width
        gradient, steep = np.stack(slopes, axis=1), np.linalg.norm(slopes, axis=0)
        return (width - 0.5) / steep, gradient / steep[:, None]

    assert len(meetings(part)) == 2
    for edge, report in meetings(part):
        level = 0.0 if "w=0" in report.name else 1.0
        distance = to_meeting(places(edge, 20_000), lambda p, w=level: height(p, w), wall).max()
        assert distance <= report.deviation <= 3 * distance


def test_edges_of_a_body_that_lie_on_another_are_known_with_it():
    """A rib whose sides are tangent to the block: no angle says where they meet, its edges do."""
    rib = ("1 + 2*u", "v", "w*(1 + cos(pi*v))/2", "v = [-1, 1]")
    block = ("4*u", "6*(v - 1/2)", "-w")
    report = compiled("union(block, rib)", block=block, rib=rib).report
    assert {(curve.carrier, curve.evidence) for curve in report.curves} == {("line", "exact")}


@pytest.mark.slow
def test_tangent_faces_leave_edges_sampled_and_say_where():
    rib = ("1 + 2*u + sin(v)/4", "v + sin(2*u)/3", "w*(1 + cos(pi*v))/2", "v = [-1, 1]")
    block = ("6*u - 1", "6*(v - 1/2)", "-w")
    part = compiled("union(block, rib)", block=block, rib=rib)
    tangent = [curve for curve in part.report.curves if "rib:w=1" in curve.name]
    assert [curve.evidence for curve in tangent] == ["sampled", "sampled"]
    assert all(curve.open.startswith("(") and ") to (" in curve.open for curve in tangent)
    assert part.report.evidence == "sampled"


def tangent_pair() -> EdgeFunction:
    """The line along which a cylinder of radius 1 touches a plane."""
    place = gp_Ax3(gp_Pnt(0, 0, 1), gp_Dir(1, 0, 0), gp_Dir(0, 0, -1))
    origin = np.zeros(3)
    traces = [
        Trace(path_function(Geom2d_Line(gp_Pnt2d(0, 0), gp_Dir2d(*along))),
              surface_function(surface, origin))
        for surface, along in (
            (Geom_Plane(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)), (1, 0)),
            (Geom_CylindricalSurface(place, 1.0), (0, 1)),
        )
    ]  # fmt: skip
    line = curve_function(Geom_Line(gp_Pnt(0, 0, 0), gp_Dir(1, 0, 0)), origin)
    return EdgeFunction(line, (0.0, 2.0), (traces[0], traces[1]))


def test_no_bound_is_had_along_a_line_of_contact():
    found = bound_edge(tangent_pair(), (0.0, 0.0))
    assert max(found.off) < 1e-13
    assert found.largest == np.inf
    assert found.open == ((0.0, 2.0),)


def test_an_edge_beside_its_surface_has_no_bound_after_some_effort():
    """A path outside the surface's parameters: no halving of cells brings it in."""
    rng = np.random.default_rng(1)
    plane = a_surface("spline", rng)
    path = SplinePath(1, np.array([0.0, 0, 1, 1]), np.array([[0.2, 1.3], [0.9, 1.3]]))
    traced = path_function(to_kernel.pcurve(path, 0.0, 1.0))
    line = curve_function(Geom_Line(gp_Pnt(0, 0, 0), gp_Dir(1, 0, 0)), np.zeros(3))
    found = bound_edge(
        EdgeFunction(line, (0.0, 1.0), (Trace(traced, plane), Trace(traced, plane))), (0.0, 0.0)
    )
    assert found.off == (np.inf, np.inf)
    assert found.open == ((0.0, 1.0),)


def displaced(by: float):
    """Return `edge_functions` with the kernel's curves moved by a length."""

    def moved(shape, edges):
        for function in edge_functions(shape, edges):
            jet = function.curve.jet
            curve = replace(function.curve, jet=lambda t, jet=jet: (jet(t)[0] + by, jet(t)[1]))
            yield replace(function, curve=curve)

    return moved


def test_a_displaced_edge_is_found_out(monkeypatch):
    """Moved by less than the tolerance it is no longer exact, moved ten times as far refused."""
    block, bore = (
        ("4*u - 2", "4*v - 2", "w"),
        ("w*cos(2*pi*v)", "w*sin(2*pi*v)", "u", "u = [-1, 2]"),
    )
    exact = compiled("cut(block, bore)", 1e-6, block=block, bore=bore).report
    assert {curve.evidence for curve in exact.curves} == {"exact"}
    monkeypatch.setattr("pc2cad.csg.intersection_edges.edge_functions", displaced(4e-7))
    report = compiled("cut(block, bore)", 1e-6, block=block, bore=bore).report
    assert {curve.evidence for curve in report.curves} == {"bounded"}
    assert 4e-7 * np.sqrt(3) <= report.deviation <= 1.6 * 4e-7 * np.sqrt(3)
    monkeypatch.setattr("pc2cad.csg.intersection_edges.edge_functions", displaced(4e-6))
    with pytest.raises(ToleranceNotReachedError, match="off its faces"):
        compiled("cut(block, bore)", 1e-6, block=block, bore=bore)


def test_bodies_that_are_sampled_make_no_proof(monkeypatch):
    from pc2cad.csg import intersection_edges as module

    right = module.sides_of

    def unsure(name, model):
        return {key: replace(side, evidence="sampled") for key, side in right(name, model).items()}

    monkeypatch.setattr("pc2cad.csg.bodies.sides_of", unsure)
    report = pc.compile_equation(pc.read_template(bodies_paths()["common_of_pipes"]).bind()).report
    assert {curve.evidence for curve in report.curves} == {"sampled"}
    assert all("all of it" in curve.open for curve in report.curves)


def spline_knots(degree: int, breaks: int, rng: np.random.Generator, multiplicity: int) -> Array:
    inner = np.repeat(np.sort(rng.uniform(0.05, 0.95, breaks)), multiplicity)
    return np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])


def a_surface(kind: str, rng: np.random.Generator) -> SurfaceFunction:
    """A surface of some kind over a part of its domain that holds [0, 1]²."""
    place = gp_Ax3(gp_Pnt(*rng.normal(size=3)), gp_Dir(*rng.normal(size=3)))
    origin = np.zeros(3)
    if kind == "spline" or kind == "rational":
        degrees = [int(d) for d in rng.integers(1, 6, 2)]
        knots = [spline_knots(d, 3, rng, int(rng.integers(1, d + 1))) for d in degrees]
        shape = tuple(len(k) - d - 1 for k, d in zip(knots, degrees, strict=True))
        weights = rng.uniform(0.5, 2, shape) if kind == "rational" else None
        carrier = SplineSurface((degrees[0], degrees[1]), (knots[0], knots[1]),
                                rng.normal(size=(*shape, 3)), weights)  # fmt: skip
        return surface_function(to_kernel.surface(carrier), origin)
    basis = to_kernel.curve(SplineCurve(3, spline_knots(3, 2, rng, 1), rng.normal(size=(6, 3))))[0]
    return surface_function({
        "plane": lambda: Geom_Plane(place),
        "cylinder": lambda: Geom_CylindricalSurface(place, 1.3),
        "cone": lambda: Geom_ConicalSurface(place, 0.4, 1.1),
        "sphere": lambda: Geom_SphericalSurface(place, 0.7),
        "torus": lambda: Geom_ToroidalSurface(place, 2.0, 0.6),
        "extrusion": lambda: Geom_SurfaceOfLinearExtrusion(basis, gp_Dir(*rng.normal(size=3))),
        "revolution": lambda: Geom_SurfaceOfRevolution(basis, place.Ax2().Axis()),
    }[kind](), origin)  # fmt: skip


KINDS = ("plane", "cylinder", "cone", "sphere", "torus", "extrusion", "revolution", "spline",
         "rational")  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=2, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_curves_that_fit_nothing_are_as_far_off_as_they_are_seen_to_be(kind, seed):
    """Any curve and any path over any surface, knots of all multiplicities: an edge far off."""
    rng = np.random.default_rng(seed)
    knots = spline_knots(3, 4, rng, 2)
    path = rng.uniform(0, 1, (len(knots) - 4, 2))
    curve = SplineCurve(4, spline_knots(4, 2, rng, 1), rng.normal(size=(7, 3)))
    surface = a_surface(kind, rng)
    traced = path_function(to_kernel.pcurve(SplinePath(3, knots, path), 0.0, 1.0))
    function = curve_function(to_kernel.curve(curve)[0], np.zeros(3))
    trace = Trace(traced, surface)
    found = bound_edge(EdgeFunction(function, (0.0, 1.0), (trace, trace)), (0.0, 0.0))
    t = np.linspace(0, 1, 20_000)
    place = traced.jet(t)[0]
    gap = function.jet(t)[0] - surface.jet(place[:, 0], place[:, 1])[0]
    seen = float(np.sqrt((gap * gap).sum(axis=1)).max())
    assert found.off[0] == found.off[1]
    # weights of random splines change fourfold within a cell
    assert seen <= found.off[0] <= (4 if kind == "rational" else 1.2) * seen
    assert found.largest == np.inf  # a surface does not cross itself
