"""The channels of the reference table against values and an evaluation that share no code with it.

The expected integrals are the table's own; where it has none, quadrature of `reference`, which the
first tests hold to the table. Points and edges are those of the kernel's geometry.
"""

from __future__ import annotations

import functools
import re
from itertools import pairwise

import numpy as np
import pytest
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_BSplineSurface, Geom_Plane
from OCP.gp import gp_Pnt, gp_Vec
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_SHELL, TopAbs_VERTEX
from OCP.TopExp import TopExp
from reference import GUIDES, Channel, Integrals, channel, gauss, linear

from pc2cad.brep.kernel import IndexedMapOfShape, as_edge
from pc2cad.compiler import compile_equation
from pc2cad.part import Part
from pc2cad.templates.file import parse_template
from pc2cad.templates.shipped import template_paths

TEMPLATES = {"8a": "channel_ellipse", "8b": "channel_sine", "8c": "channel_contour"}
CASES = tuple(TEMPLATES)
SHARES = (0.0, 0.5, 1.0)
SAMPLES = 10_000

#: case, guide -> V, S, S of w=0, S of w=1, S of a cap, centroid; s = 1/2. One digit is corrected:
#: the table has 1.678512900 for y of 8b on G2, which is rounded after 8 decimals
CENTRED = {
    ("8a", "G1"): (77.074041557967, 419.36053163579, 182.0114278606, 229.6871411089,
                   3.830981333116, (2.686809518, 2.798575038, 4.492335425)),
    ("8a", "G2"): (74.649197471521, 406.17319772983, 176.1860665752, 222.3251684884,
                   3.830981333116, (2.551943382, 1.714665554, 6.063750680)),
    ("8b", "G1"): (75.845394697557, 636.3841331629, 298.6535696785, 330.1907411158,
                   1.2 * np.pi, (2.631798934, 2.752696722, 4.508562847)),
    ("8b", "G2"): (73.459205351587, 614.97730523113, 288.5472572196, 318.8902256429,
                   1.2 * np.pi, (2.524782068, 1.678512898, 6.056811770)),
    ("8c", "G1"): (72.7442151959, 496.58218045264, 225.936525163, 263.3812077303,
                   3.632223779653, (2.679120448, 2.819184497, 4.586165312)),
    ("8c", "G2"): (70.560373809854, 481.83857486222, 219.1303933385, 255.4437339644,
                   3.632223779653, (2.524561921, 1.734608937, 6.153690394)),
}  # fmt: skip
#: case, s -> V, S on G1
ONE_SIDED = {
    ("8a", 1.0): (66.961322264959, 371.15387341743),
    ("8a", 0.0): (87.186760850974, 468.28468159446),
    ("8b", 1.0): (70.156990095241, 604.68174967525),
    ("8b", 0.0): (81.533799299874, 668.79391489428),
    ("8c", 1.0): (67.081046255618, 458.60269009119),
    ("8c", 0.0): (78.407384136182, 534.61207554096),
}
#: 8a on G1 with δ(u) = 0.3(1 + u): V, S, the caps
TAPERED = (86.324980059845, 420.43606746939, 2.8732359998372, 5.7464719996744)

ALL = [(case, guide, share) for case in CASES for guide in GUIDES for share in SHARES]
#: walls to one side are as good on one guide as on the other, and with one section as with another
every_channel = pytest.mark.parametrize(
    ("case", "guide", "share"),
    [
        pytest.param(
            *row, marks=[] if row[2] == 0.5 or row[:2] == ("8a", "G1") else [pytest.mark.slow]
        )
        for row in ALL
    ],
)


# -- the reference itself --------------------------------------------------------------------------


@functools.cache
def reference_integrals(case: str, guide: str, share: float) -> Integrals:
    return channel(case, guide, share).integrals()


@pytest.mark.parametrize(("case", "guide"), CENTRED)
def test_reference_has_the_values_of_the_table(case, guide):
    volume, area, inner, outer, cap, centroid = CENTRED[case, guide]
    found = reference_integrals(case, guide, 0.5)
    assert found.volume == pytest.approx(volume, rel=1e-12)
    assert found.area == pytest.approx(area, rel=1e-12)
    assert [found.areas["w=0"], found.areas["w=1"]] == pytest.approx([inner, outer], rel=1e-11)
    assert [found.areas["u=0"], found.areas["u=1"]] == pytest.approx([cap, cap], rel=1e-12)
    assert found.centroid == pytest.approx(centroid, abs=1e-9)


@pytest.mark.parametrize(("case", "share"), ONE_SIDED)
def test_reference_has_the_one_sided_values_of_the_table(case, share):
    found = reference_integrals(case, "G1", share)
    assert (found.volume, found.area) == pytest.approx(ONE_SIDED[case, share], rel=2e-12)


def test_reference_has_the_values_of_a_growing_wall():
    found = channel("8a", "G1", thickness=linear(0.3, 0.3)).integrals()
    volume, area, *caps = TAPERED
    assert (found.volume, found.area) == pytest.approx((volume, area), rel=1e-12)
    assert [found.areas["u=0"], found.areas["u=1"]] == pytest.approx(caps, rel=1e-12)


@pytest.mark.parametrize("case", CASES)
def test_tangents_of_the_reference_are_its_derivatives(case):
    solid = channel(case, "G2", thickness=linear(0.2, 0.1))
    at = np.random.default_rng(1).uniform(0.01, 0.99, (3, 200))
    _, *tangents = solid.point_and_tangents(*at)
    assert len(tangents) == 3
    step = 1e-5
    for axis, tangent in enumerate(tangents):
        shift = np.zeros((3, 1))
        shift[axis] = step
        slope = (solid.point(*(at + shift)) - solid.point(*(at - shift))) / (2 * step)
        # the contour's second derivative jumps at its nodes; none lies within a step of a sample
        assert np.abs(slope - tangent).max() < 1e-6 * np.abs(tangent).max()


# -- building and measuring ------------------------------------------------------------------------


def text_of(case: str, guide: str) -> str:
    text = template_paths()[TEMPLATES[case]].read_text(encoding="utf-8")
    for name, point in zip("ABCD", GUIDES[guide], strict=True):
        text, count = re.subn(rf"(?m)^{name} = \[.*\]$", f"{name} = {list(point)}", text)
        assert count == 1
    return text


@functools.cache
def part_of(case: str, guide: str, share: float = 0.5, relative: float | None = None) -> Part:
    """Compile a template as shipped, but for the points and s; `relative`: tolerance per size."""
    equation = parse_template(text_of(case, guide), case).bind({"s": share})
    tolerance = None if relative is None else relative * size_of(case, guide, share)
    return compile_equation(equation, tolerance)


def size_of(case: str, guide: str, share: float) -> float:
    """Diagonal of the box round the solid, from the reference."""
    u, v = np.linspace(0, 1, 101), np.linspace(0, 1, 301)
    points = channel(case, guide, share).point(u[:, None], v[None, :], np.array(1.0))
    return float(np.linalg.norm(np.ptp(points.reshape(-1, 3), axis=0)))


@functools.cache
def tapered() -> Part:
    text = text_of("8a", "G1").replace("(K-N)*delta/", "(K-N)*0.3*(1+u)/")
    assert "0.3*(1+u)" in text
    return compile_equation(parse_template(text, "tapered").bind())


def shapes(part: Part, kind) -> list:
    found = IndexedMapOfShape()
    TopExp.MapShapes_s(part.shape, kind, found)
    return [found.FindKey(i) for i in range(1, found.Extent() + 1)]


def surface_points(part: Part, face: str, s: np.ndarray, t: np.ndarray) -> np.ndarray:
    surface = BRep_Tool.Surface_s(part.faces[face])
    assert isinstance(surface, Geom_BSplineSurface)
    assert surface.Bounds() == (0.0, 1.0, 0.0, 1.0)
    point, rows = gp_Pnt(), []
    for a, b in zip(s.tolist(), t.tolist(), strict=True):
        surface.D0(a, b, point)
        rows.append((point.X(), point.Y(), point.Z()))
    return np.array(rows)


def edge_curves(part: Part) -> list:
    curves = []
    for shape in shapes(part, TopAbs_EDGE):
        curve = BRep_Tool.Curve_s(as_edge(shape), 0.0, 1.0)
        assert (curve.FirstParameter(), curve.LastParameter()) == (0.0, 1.0)
        curves.append(curve)
    return curves


def curve_points(curve, t: np.ndarray) -> np.ndarray:
    values = (curve.Value(x) for x in t.tolist())
    return np.array([(p.X(), p.Y(), p.Z()) for p in values])


def distance(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b, axis=-1).max())


def largest_face_deviation(part: Part, solid: Channel, count: int = SAMPLES) -> float:
    """Distance at equal parameters over random places of the two spline faces."""
    random = np.random.default_rng(20220613)
    worst = 0.0
    for face, limit in (("w=0", 0.0), ("w=1", 1.0)):
        u, v = random.uniform(size=(2, count))
        found = surface_points(part, face, u, v)
        worst = max(worst, distance(found, solid.point(u, v, np.full(count, limit))))
    return worst


def lines_of(solid: Channel, t: np.ndarray) -> dict[str, np.ndarray]:
    """The six edges of the channel: four ends along v, two seams along u."""
    lines = {
        f"u={u:g}, w={w:g}": solid.point(np.full_like(t, u), t, np.full_like(t, w))
        for u in (0.0, 1.0)
        for w in (0.0, 1.0)
    }
    seams = {f"v=0, w={w:g}": solid.point(t, 0 * t, np.full_like(t, w)) for w in (0.0, 1.0)}
    return lines | seams


def edge_deviations(part: Part, solid: Channel) -> dict[str, float]:
    """Distance of each edge to its line, at equal parameters, run forward or backward."""
    t = np.random.default_rng(7).uniform(size=2000)
    forward, backward = lines_of(solid, t), lines_of(solid, 1 - t)
    found = {}
    for curve in edge_curves(part):
        points = curve_points(curve, t)
        gaps = {
            name: min(distance(points, forward[name]), distance(points, backward[name]))
            for name in forward
        }
        name = min(gaps, key=gaps.__getitem__)
        assert name not in found
        found[name] = gaps[name]
    assert found.keys() == forward.keys()
    return found


def plane_of(part: Part, face: str) -> tuple[np.ndarray, np.ndarray]:
    surface = BRep_Tool.Surface_s(part.faces[face])
    assert isinstance(surface, Geom_Plane)
    plane = surface.Pln()
    origin, axis = plane.Location(), plane.Axis().Direction()
    return np.array([origin.X(), origin.Y(), origin.Z()]), np.array([axis.X(), axis.Y(), axis.Z()])


def cap_area(part: Part, face: str) -> float:
    """Area between the two curves of a cap, each ½|∮ r × dr| of the kernel's curve."""
    _, normal = plane_of(part, face)
    edges = IndexedMapOfShape()
    TopExp.MapShapes_s(part.faces[face], TopAbs_EDGE, edges)
    areas = [
        loop_area(BRep_Tool.Curve_s(as_edge(edges.FindKey(i)), 0.0, 1.0), normal)
        for i in range(1, edges.Extent() + 1)
    ]
    assert len(areas) == 2
    return abs(areas[0] - areas[1])


def loop_area(curve, normal: np.ndarray) -> float:
    nodes, weights = gauss(8)
    knots = [curve.Knot(i) for i in range(1, curve.NbKnots() + 1)]
    centre = curve_points(curve, np.linspace(0, 1, 50)).mean(axis=0)
    point, slope, total = gp_Pnt(), gp_Vec(), 0.0
    for low, high in pairwise(knots):
        for node, weight in zip(nodes.tolist(), weights.tolist(), strict=True):
            curve.D1(low + (high - low) * node, point, slope)
            r = np.array([point.X(), point.Y(), point.Z()]) - centre
            dr = np.array([slope.X(), slope.Y(), slope.Z()])
            total += (high - low) * weight * float(np.cross(r, dr) @ normal)
    return abs(total) / 2


# -- every channel ---------------------------------------------------------------------------------


@every_channel
def test_boundary(case, guide, share):
    part = part_of(case, guide, share)
    report = part.report
    carriers = {face.name: face.carrier for face in report.faces}
    splines = dict.fromkeys(("w=0", "w=1"), "B-spline surface")
    assert carriers == {"u=0": "plane", "u=1": "plane"} | splines
    assert (report.shells, report.genus, report.euler) == (1, (1,), 0)
    assert (report.edges, report.vertices) == (4, 4)
    counts = [len(shapes(part, k)) for k in (TopAbs_SHELL, TopAbs_FACE, TopAbs_VERTEX, TopAbs_EDGE)]
    assert counts == [1, 4, 4, 6]
    fates = {side.name: side.fate for side in report.sides}
    assert fates["v=0"] == fates["v=1"] == "interface"
    assert sorted(fates.values()) == ["face"] * 4 + ["interface"] * 2


@every_channel
def test_volume_area_and_centroid(case, guide, share):
    report = part_of(case, guide, share).report
    expected = reference_integrals(case, guide, share)
    volume, area, centroid = expected.volume, expected.area, expected.centroid
    if share == 0.5:
        volume, area, _, _, _, centroid = CENTRED[case, guide]
    elif guide == "G1":
        volume, area = ONE_SIDED[case, share]
    assert report.solid.volume == pytest.approx(volume, rel=1e-7)
    assert report.solid.area == pytest.approx(area, rel=1e-7)
    assert report.solid.centroid == pytest.approx(centroid, abs=1e-7 * report.size)
    assert report.equation.volume == pytest.approx(volume, rel=2e-12)
    assert report.equation.area == pytest.approx(area, rel=2e-12)
    assert report.equation.centroid == pytest.approx(expected.centroid, abs=1e-12 * report.size)


@every_channel
def test_face_areas(case, guide, share):
    part = part_of(case, guide, share)
    expected = reference_integrals(case, guide, share).areas
    found = {face.name: face.area for face in part.report.faces}
    assert found == pytest.approx(expected, rel=1e-11)
    caps = [cap_area(part, face) for face in ("u=0", "u=1")]
    assert caps == pytest.approx([expected["u=0"], expected["u=1"]], rel=1e-7)


@every_channel
def test_faces_and_edges_are_within_the_tolerance(case, guide, share):
    part, solid = part_of(case, guide, share), channel(case, guide, share)
    tolerance = part.report.tolerance
    # 1e-7 of the size, or 1e-6 of the thickness where a wall is thin
    whole = part.report.equation
    thickness = 2 * whole.volume / whole.area
    stated = min(1e-7 * size_of(case, guide, share), 1e-6 * thickness)
    assert tolerance == pytest.approx(stated, rel=0.05)
    assert largest_face_deviation(part, solid) <= tolerance
    assert max(edge_deviations(part, solid).values()) <= tolerance
    assert part.report.kernel_tolerance <= tolerance


@every_channel
def test_caps_lie_in_the_normal_planes_of_the_guide(case, guide, share):
    part, solid = part_of(case, guide, share), channel(case, guide, share)
    v, w = np.random.default_rng(3).uniform(size=(2, SAMPLES))
    for face, limit in (("u=0", 0.0), ("u=1", 1.0)):
        origin, normal = plane_of(part, face)
        points = solid.point(np.full(SAMPLES, limit), v, w)
        assert np.abs((points - origin) @ normal).max() <= 1e-13 * part.report.size
        (T, _, _), _ = solid.frame(np.array(limit))
        assert np.linalg.norm(np.cross(T, normal)) <= 1e-13
        # the kernel's curves lie in the plane too, and not just near it
        edges = IndexedMapOfShape()
        TopExp.MapShapes_s(part.faces[face], TopAbs_EDGE, edges)
        for i in range(1, edges.Extent() + 1):
            curve = BRep_Tool.Curve_s(as_edge(edges.FindKey(i)), 0.0, 1.0)
            along = curve_points(curve, v[:500])
            assert np.abs((along - origin) @ normal).max() <= 1e-12 * part.report.size


# -- a smaller tolerance ---------------------------------------------------------------------------

FINE = [("8a", "G1", 0.5), ("8b", "G1", 0.5), ("8c", "G2", 0.5)]
FINE_SLOW = [pytest.param(*row, marks=pytest.mark.slow) for row in ALL if row not in FINE]


@pytest.mark.parametrize(("case", "guide", "share"), FINE + FINE_SLOW)
def test_a_smaller_tolerance_is_kept_and_is_better(case, guide, share):
    part = part_of(case, guide, share, 1e-9)
    solid, expected = channel(case, guide, share), reference_integrals(case, guide, share)
    tolerance = part.report.tolerance
    assert tolerance == pytest.approx(1e-9 * part.report.size, rel=0.05)
    assert largest_face_deviation(part, solid) <= tolerance
    assert max(edge_deviations(part, solid).values()) <= tolerance
    assert_better(part, part_of(case, guide, share), expected)


def assert_better(fine: Part, coarse: Part, expected: Integrals) -> None:
    for name in ("volume", "area"):
        value = getattr(expected, name)
        error, before = (abs(getattr(p.report.solid, name) / value - 1) for p in (fine, coarse))
        assert error <= max(before / 10, 1e-10)


# -- a wall that grows -----------------------------------------------------------------------------


def test_wall_that_grows_along_the_guide():
    part, solid = tapered(), channel("8a", "G1", thickness=linear(0.3, 0.3))
    volume, area, *caps = TAPERED
    assert len(part.report.faces) == 4
    assert part.report.solid.volume == pytest.approx(volume, rel=1e-7)
    assert part.report.solid.area == pytest.approx(area, rel=1e-7)
    assert [cap_area(part, face) for face in ("u=0", "u=1")] == pytest.approx(caps, rel=1e-7)
    assert largest_face_deviation(part, solid) <= part.report.tolerance
    assert max(edge_deviations(part, solid).values()) <= part.report.tolerance


@pytest.mark.slow
def test_coarse_and_loose_tolerances_are_kept_as_well():
    for relative in (1e-3, 1e-5):
        part, solid = part_of("8b", "G2", 0.5, relative), channel("8b", "G2")
        assert largest_face_deviation(part, solid) <= part.report.tolerance
        assert max(edge_deviations(part, solid).values()) <= part.report.tolerance
