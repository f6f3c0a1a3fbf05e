"""Edges between bodies, found from both surfaces: near both, wherever the kernel's edge was."""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from pathlib import Path

import numpy as np
import pytest
from consumers.freecad_reader import freecad, read_in_freecad
from numpy.polynomial.legendre import leggauss

import pc2cad as pc
from pc2cad.arrays import Array
from pc2cad.brep.tolerance import KERNEL_TOLERANCE
from pc2cad.csg.edge_curves import DEGREE, common_curve, path_along
from pc2cad.csg.seams import MET
from pc2cad.geometry.jets import CurveFunction, EdgeFunction, Jet, Sizes, SurfaceFunction, Trace
from pc2cad.geometry.splines.spline_basis import spline_values
from pc2cad.templates.file import parse_template


def no_sizes() -> Sizes:
    raise NotImplementedError


def upright(a: Array, b: Array) -> Jet:
    """A cylinder of radius 1 about the z-axis."""
    zero, one = np.zeros_like(a), np.ones_like(a)
    return (
        np.stack((np.cos(a), np.sin(a), b), axis=1),
        np.stack((-np.sin(a), np.cos(a), zero), axis=1),
        np.stack((zero, zero, one), axis=1),
    )


def lying(a: Array, b: Array) -> Jet:
    """A cylinder of radius 2 about the x-axis."""
    zero, one = np.zeros_like(a), np.ones_like(a)
    return (
        np.stack((b, 2 * np.sin(a), 2 * np.cos(a)), axis=1),
        np.stack((zero, 2 * np.cos(a), -2 * np.sin(a)), axis=1),
        np.stack((one, zero, zero), axis=1),
    )


def crooked(size: float, off: float) -> EdgeFunction:
    """Return an edge of those, times a size, that wavers about where they meet, as its paths do."""

    def curve(t: Array) -> tuple[Array, Array]:
        x, y = np.cos(t), np.sin(t)
        z = np.sqrt(4 - y**2)
        waver = off * np.sin(9 * t)
        point = np.stack((x + waver, y, z - waver), axis=1)
        along = np.stack((-y + 9 * off * np.cos(9 * t), x, -y * x / z), axis=1)
        return size * point, size * along

    def above(t: Array) -> tuple[Array, Array]:
        height = np.sqrt(4 - np.sin(t) ** 2) + off * np.cos(5 * t)
        return np.stack((t, size * height), axis=1), np.zeros((len(t), 2))

    def beside(t: Array) -> tuple[Array, Array]:
        turn = np.arcsin(np.sin(t) / 2)
        return np.stack((turn, size * np.cos(t)), axis=1), np.zeros((len(t), 2))

    def scaled(jet) -> SurfaceFunction:
        def at(a: Array, b: Array) -> Jet:
            point, along_a, along_b = jet(a, b / size)
            return size * point, size * along_a, along_b

        return SurfaceFunction(at, (None, np.zeros(0)), (1, 1), no_sizes)

    paths = [CurveFunction(path, None, 1, no_sizes) for path in (above, beside)]
    traces = tuple(map(Trace, paths, (scaled(upright), scaled(lying))))
    return EdgeFunction(CurveFunction(curve, None, 1, no_sizes), (0.2, 2.9), traces)


@pytest.mark.parametrize(("size", "off"), [(1, 0), (0.01, 1e-2), (1e5, 1e-5)])
def test_the_curve_is_on_both_surfaces_wherever_the_edge_was(size: float, off: float) -> None:
    ends = [
        size * np.array([np.cos(t), np.sin(t), np.sqrt(4 - np.sin(t) ** 2)]) for t in (0.2, 2.9)
    ]
    found = common_curve(crooked(size, off), (ends[0], ends[1]), 1e-11 * size)
    assert found is not None
    assert found.seen <= 1e-11 * size
    t = np.linspace(0, 1, 501)
    x, y, z = spline_values(found.knots, found.poles, DEGREE, t).T / size
    assert np.abs(np.hypot(x, y) - 1).max() < 2e-11
    assert np.abs(np.hypot(y, z) - 2).max() < 2e-11
    assert np.linalg.norm(found.poles[[0, -1]] - ends, axis=1).max() < 1e-11 * size
    # between its pieces the tangent goes on
    inner = np.unique(found.knots)[1:-1]
    assert len(inner) > 2
    at = spline_values(found.knots, found.poles, DEGREE, inner)
    before, behind = (
        (spline_values(found.knots, found.poles, DEGREE, inner + step) - at) / step
        for step in (-1e-7, 1e-7)
    )
    assert np.abs(behind - before).max() < 1e-4 * size


def from_pole(size: float, off: float) -> EdgeFunction:
    """Viviani's curve from the pole of a sphere, by longitude and latitude, on to its equator."""

    def sphere(a: Array, b: Array) -> Jet:
        x, y, z = np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)
        above = np.stack((-z * np.cos(a), -z * np.sin(a), np.cos(b)), axis=1)
        return (
            size * np.stack((x, y, z), axis=1),
            size * np.stack((-y, x, 0 * z), axis=1), size * above,
        )  # fmt: skip

    def cylinder(a: Array, b: Array) -> Jet:
        x, y, zero = np.cos(a) / 2, np.sin(a) / 2, np.zeros_like(a)
        return (
            np.stack((size * (x + 0.5), size * y, b), axis=1),
            size * np.stack((-y, x, zero), axis=1), np.stack((zero, zero, zero + 1), axis=1),
        )  # fmt: skip

    def curve(s: Array) -> tuple[Array, Array]:
        x, y, z = np.cos(s) ** 2, np.cos(s) * np.sin(s), np.sin(s)
        along = np.stack((-np.sin(2 * s), np.cos(2 * s), np.cos(s)), axis=1)
        return size * np.stack((x, y, z + off * np.sin(7 * s)), axis=1), size * along

    def angles(s: Array) -> tuple[Array, Array]:
        return np.stack((s + off * np.sin(5 * s), s), axis=1), s

    def beside(s: Array) -> tuple[Array, Array]:
        return np.stack((2 * s, size * (np.sin(s) + off)), axis=1), s

    traces = (
        Trace(CurveFunction(angles, None, 1, no_sizes),
              SurfaceFunction(sphere, (None, None), (1, 1), no_sizes)),
        Trace(CurveFunction(beside, None, 1, no_sizes),
              SurfaceFunction(cylinder, (None, np.zeros(0)), (1, 1), no_sizes)),
    )  # fmt: skip
    return EdgeFunction(CurveFunction(curve, None, 1, no_sizes), (pi / 2, 0.3), traces)


@pytest.mark.parametrize(("size", "off"), [(1, 1e-5), (0.01, 1e-5), (1e5, 1e-6)])
def test_a_curve_through_a_pole_turns_evenly_round_it(size: float, off: float) -> None:
    ends = np.array([[np.cos(s) ** 2, np.cos(s) * np.sin(s), np.sin(s)] for s in (pi / 2, 0.3)])
    found = common_curve(from_pole(size, off), (size * ends[0], size * ends[1]), 1e-10 * size)
    assert found is not None
    assert found.seen <= 1e-10 * size
    t = np.append(0.0, np.geomspace(1e-6, 1, 200))
    longitude, latitude = spline_values(found.knots, found.paths[0], DEGREE, t).T
    # both are one angle on this curve; at the pole any longitude is as near
    assert np.abs((longitude - latitude) * np.cos(latitude)).max() < 1e-9
    assert np.abs(longitude - latitude).max() < 10 * off
    assert np.all(np.diff(latitude) < 0)


def test_surfaces_that_are_tangent_have_no_such_curve() -> None:
    edge = crooked(1, 1e-3)
    same = EdgeFunction(edge.curve, edge.span, (edge.traces[0], edge.traces[0]))
    assert common_curve(same, (np.array([1.0, 0, 2]), np.array([-1.0, 0, 2])), 1e-9) is None


def cone(a: Array, b: Array) -> Jet:
    """A cone about the z-axis, as wide as it is high, by the angle and the radius."""
    x, y, one = np.cos(a), np.sin(a), np.ones_like(a)
    return (
        np.stack((b * x, b * y, b), axis=1),
        np.stack((-b * y, b * x, 0 * a), axis=1),
        np.stack((x, y, one), axis=1),
    )


def on_cone(size: float, out: float, off: float) -> tuple[CurveFunction, Trace]:
    """Return the hyperbola at x = size, `out` of the cone across it, and a path that wavers."""

    def curve(t: Array) -> tuple[Array, Array]:
        x, y, z = np.ones_like(t), np.sinh(t), np.cosh(t)
        normal = np.stack((x, y, -z), axis=1) / (np.sqrt(2) * z[:, None])
        point = size * np.stack((x, y, z), axis=1)
        return point + out * normal, size * np.stack((0 * x, z, y), axis=1)

    def path(t: Array) -> tuple[Array, Array]:
        waver = off * np.sin(9 * t)
        return np.stack((np.arctan(np.sinh(t)) + waver, size * (np.cosh(t) - waver)), axis=1), t

    surface = SurfaceFunction(cone, (None, np.zeros(0)), (1, 1), no_sizes)
    return CurveFunction(curve, None, 1, no_sizes), Trace(
        CurveFunction(path, None, 1, no_sizes), surface
    )


@pytest.mark.parametrize(("size", "off"), [(1, 1e-7), (0.01, 1e-3), (1e5, 1e-5)])
def test_a_conic_gets_its_places_on_a_cone(size: float, off: float) -> None:
    curve, trace = on_cone(size, 0, off)
    found = path_along(curve, (-0.6, 0.5), trace, 1e-11 * size)
    assert found is not None
    path, far = found
    assert far <= 2e-11 * size
    t = np.linspace(0, 1, 501)
    angle, radius = spline_values(path.knots, path.poles, DEGREE, t).T
    tau = -0.6 + 1.1 * t
    assert np.abs(angle - np.arctan(np.sinh(tau))).max() < 3e-11
    assert np.abs(radius / size - np.cosh(tau)).max() < 3e-11


def test_a_curve_beside_a_cone_gets_the_nearest_places_and_no_worse_path() -> None:
    curve, trace = on_cone(1, 1e-4, 1e-2)
    path, far = path_along(curve, (-0.6, 0.5), trace, 1e-9) or pytest.fail("there is a path")
    assert far == pytest.approx(1e-4, abs=2e-9)
    t = np.linspace(0, 1, 101)
    place = cone(*spline_values(path.knots, path.poles, DEGREE, t).T)[0]
    assert np.abs(place[:, 0] - 1).max() < 1e-4
    curve, trace = on_cone(1, 1e-4, 0)
    assert path_along(curve, (-0.6, 0.5), trace, 1e-9) is None


BORED = """
title = "Bored"
result = "cut(body, hole)"
[[bodies]]
name = "body"
[bodies.solid]
x = "{body[0]}"
y = "{body[1]}"
z = "{body[2]}"
[[bodies]]
name = "hole"
[bodies.solid]
x = "{x} + {r}*w*cos(2*pi*u)"
y = "{r}*w*sin(2*pi*u)"
z = "{low} + {high}*v"
"""


def through_a_bar(radius: float, hole: float) -> float:
    """Return what a hole across a round bar takes: ∫∫ 2 sqrt(radius² - y²) over its disc."""
    nodes, weights = leggauss(60)
    angle = (nodes + 1) * pi / 4
    y = hole * np.sin(angle)
    return float(
        pi / 4 * weights @ (4 * np.sqrt(radius**2 - y**2) * 2 * (hole * np.cos(angle)) ** 2)
    )


@pytest.mark.slow
def test_edges_of_a_small_bored_bar_are_near_their_faces() -> None:
    size = 0.05
    bar = (f"{4 * size}*(u - 1/2)", f"{size}*w*cos(2*pi*v)", f"{size}*w*sin(2*pi*v)")
    text = BORED.format(body=bar, x=0.3 * size, r=0.6 * size, low=-2 * size, high=4 * size)
    report = pc.compile_equation(parse_template(text, "bar").bind()).report
    assert report.solid.volume == pytest.approx(
        4 * pi * size**3 - through_a_bar(size, 0.6 * size), rel=1e-12
    )
    assert len(report.curves) >= 2
    for curve in report.curves:
        assert curve.evidence == "bounded"
        assert curve.surface_distance < 1e-9
        assert curve.deviation < 1e-9


@pytest.mark.slow
def test_a_hole_across_the_seam_of_an_ellipsoid(tmp_path: Path) -> None:
    """As it is built the kernel reads back another solid: it is cut in halves before."""
    body = (
        "500*w*cos(pi*(v - 1/2))*cos(2*pi*u)", "300*w*cos(pi*(v - 1/2))*sin(2*pi*u)",
        "300*w*sin(pi*(v - 1/2))",
    )  # fmt: skip
    text = BORED.format(body=body, x=100, r=40, low=100, high=400)
    part = pc.compile_equation(parse_template(text, "ellipsoid").bind())
    part.write(tmp_path / "ellipsoid.step")
    found = pc.receipt(tmp_path / "ellipsoid.step")
    assert found["sound"]
    nodes, weights = leggauss(30)
    r, turn = 20 * (nodes + 1), np.arange(60) * (pi / 30)
    x, y = 100 + r[:, None] * np.cos(turn), r[:, None] * np.sin(turn)
    depth = (300 * np.sqrt(1 - (x / 500) ** 2 - (y / 300) ** 2) - 100).mean(axis=1)
    exact = 4 / 3 * pi * 500 * 300**2 - 2 * pi * (20 * weights * r) @ depth
    assert part.volume == pytest.approx(exact, rel=1e-12)
    assert found["solids"][0]["volume"] == pytest.approx(exact, rel=1e-12)
    report = part.report
    assert len(report.curves) >= 2
    assert max(curve.surface_distance for curve in report.curves) < 1e-7
    assert report.seams == (f"body is cut in halves where it closes: {MET}",)
    assert report.warnings == ()


def over_a_disc(height: Callable[[Array, Array], Array], x: float, radius: float) -> float:
    """Return the integral of a polynomial over the disc about (x, 0)."""
    nodes, weights = leggauss(12)
    r, turn = radius / 2 * (nodes + 1), np.arange(24) * (pi / 12)
    at = height(x + r[:, None] * np.cos(turn), r[:, None] * np.sin(turn))
    return float(radius / 2 * (weights * r) @ at.mean(axis=1)) * 2 * pi


def test_edges_are_found_anew_whether_the_first_of_them_is_or_not() -> None:
    """The kernel's first edge is a circle, and right; those of the curved top are 1e-7 off."""
    slab = ("4*(u - 1/2)", "4*(v - 1/2)", "w*(1 + u^2*v^3/3)")
    text = BORED.format(body=slab, x="3/10", r="7/10", low=-2, high=4)
    report = pc.compile_equation(parse_template(text, "slab").bind()).report
    taken = over_a_disc(lambda x, y: 1 + (x / 4 + 0.5) ** 2 * (y / 4 + 0.5) ** 3 / 3, 0.3, 0.7)
    assert report.solid.volume == pytest.approx(16 * (1 + 1 / 36) - taken, rel=1e-9)
    circle, *others = report.curves
    assert circle.evidence == "exact"
    assert len(others) == 2
    assert all(edge.evidence == "bounded" for edge in others)
    assert max(edge.surface_distance for edge in others) < 1e-8


@pytest.mark.slow
def test_a_bored_ring_whose_sides_run_into_one_another_reads_back(tmp_path: Path) -> None:
    """Its sides are of degree 10, fast at their ends, where each closes with a turn."""
    along = "(5 + 2*(v - 1/2)*cos(pi*u/2) - 2*(w - 1/2)*sin(pi*u/2))"
    ring = (
        f"{along}*cos(2*pi*u)", f"{along}*sin(2*pi*u)",
        "2*(v - 1/2)*sin(pi*u/2) + 2*(w - 1/2)*cos(pi*u/2)",
    )  # fmt: skip
    text = BORED.format(body=ring, x="27/5", r="3/2", low=-2, high=4)
    part = pc.compile_equation(parse_template(text, "ring").bind())
    part.write(tmp_path / "ring.step")
    found = pc.receipt(tmp_path / "ring.step")
    assert found["sound"]
    assert found["solids"][0]["volume"] == pytest.approx(part.volume, rel=1e-9)


VOLUTE = """
title = "Volute and diffuser"
result = "union(volute, diffuser)"
[let]
rho = "8 + 30*u"
end = "3*pi/2"
[[bodies]]
name = "volute"
[bodies.solid]
x = "(110 + rho + (rho + 6)*w*cos(2*pi*v))*cos(end*u)"
y = "(110 + rho + (rho + 6)*w*cos(2*pi*v))*sin(end*u)"
z = "(rho + 6)*w*sin(2*pi*v)"
[[bodies]]
name = "diffuser"
[bodies.solid]
x = "(148 + (38*(1 + 2/5*u) + 6)*w*cos(2*pi*v))*cos(end) - 220*u*sin(end)"
y = "(148 + (38*(1 + 2/5*u) + 6)*w*cos(2*pi*v))*sin(end) + 220*u*cos(end)"
z = "(38*(1 + 2/5*u) + 6)*w*sin(2*pi*v)"
"""


@pytest.mark.slow
def test_where_a_spline_ends_on_another_face_it_is_fitted_closer(tmp_path: Path) -> None:
    """Within the default tolerance the edge is 5e-6 off: strict checks find that."""
    part = pc.compile_equation(parse_template(VOLUTE, "volute").bind())
    nodes, weights = leggauss(5)
    u, share = (nodes + 1) / 2, weights / 2
    rho = 8 + 30 * u
    turned = 3 * pi / 2 * share @ (pi * (rho + 6) ** 2 * (110 + rho))
    straight = 220 * share @ (pi * (44 + 15.2 * u) ** 2)
    assert part.volume == pytest.approx(turned + straight, rel=1e-10)
    (edge,) = part.report.curves
    assert edge.surface_distance < KERNEL_TOLERANCE
    (told,) = part.report.warnings
    assert "volute within 1e-07 mm" in told
    part.write(tmp_path / "volute.step")
    if freecad():
        (found,) = read_in_freecad([tmp_path / "volute.step"], tmp_path)
        assert found["valid"], found["complaint"]
        assert found["volume"] == pytest.approx(part.volume, rel=1e-10)
