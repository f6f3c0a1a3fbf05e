"""Sound files of the kernel are measured exactly by a reader that shares nothing with it."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import cos, pi, radians, sqrt
from pathlib import Path

import cadquery as cq
import numpy as np
import pytest
from consumers.samples import AP214, AP242, SplineSolid, as_nurbs, write_step, write_with_properties
from consumers.step_file import StepSolid, check_step
from plain_step import cut_ball

from pc2cad.verify.curves import gauss_rule
from pc2cad.verify.defects import StepDefectError
from pc2cad.verify.following import follow, trimmed_moments
from pc2cad.verify.receipt import describe, parse_step
from pc2cad.verify.splines import make_surface

# STEP text of this kernel carries 13 significant digits. Where only lengths and whole numbers
# enter, 1e-12 is left; a weight like sqrt(1/2) or the tangent of a half angle costs ten times it.
DIGITS, ROUNDED = 1e-12, 1e-11

Case = tuple[Callable[[], cq.Shape], float, float, tuple[float, float, float], float]


def _on_axis(z: float) -> tuple[float, float, float]:
    return (0.0, 0.0, z)


def _full_sphere(turn: float = 360.0) -> cq.Shape:
    return cq.Solid.makeSphere(5.0, angleDegrees1=-90.0, angleDegrees2=90.0, angleDegrees3=turn)


def _hollow_sphere() -> cq.Shape:
    return cq.Workplane().sphere(5.0).cut(cq.Workplane().sphere(3.0)).val()


def _elliptic_ring(turn: float, distance: float = 10.0) -> cq.Shape:
    section = cq.Workplane("XZ").center(distance, 0.0).ellipse(3.0, 2.0)
    return section.revolve(turn, (-distance, 0.0, 0.0), (-distance, 1.0, 0.0)).val()


def _ellipsoid() -> cq.Shape:
    half = cq.Workplane().ellipseArc(3.0, 5.0, -90.0, 90.0, startAtCurrent=False).close()
    return half.revolve(360.0, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)).val()


def _prism() -> cq.Shape:
    corners = [(0.0, 0.0), (10.0, 0.0), (13.0, 7.0), (4.0, 9.0)]
    return cq.Workplane().polyline(corners).close().extrude(8.0).val()


def _ring() -> cq.Shape:
    """A square ring, by revolving a square: planes and cylinders."""
    square = cq.Workplane("XZ").center(6.0, 0.0).rect(2.0, 2.0)
    return square.revolve(360.0, (-6.0, 0.0, 0.0), (-6.0, 1.0, 0.0)).val()


def _octant() -> cq.Shape:
    return cq.Solid.makeSphere(5.0, angleDegrees1=0.0, angleDegrees2=90.0, angleDegrees3=90.0)


def _box() -> cq.Shape:
    return cq.Solid.makeBox(10.0, 20.0, 30.0)


def _rounded_volume(a: float, r: float) -> float:
    """A cube with every edge rounded: core, slabs, quarter cylinders and eighths of a sphere."""
    b = a - 2.0 * r
    return b**3 + 6.0 * b**2 * r + 3.0 * b * pi * r**2 + 4.0 / 3.0 * pi * r**3


PRISM_BASE = 79.5
SLANT = sqrt(153.0)

CASES: dict[str, Case] = {
    "box": (_box, 6000.0, 2200.0, (5.0, 10.0, 15.0), DIGITS),
    "box_nurbs": (lambda: as_nurbs(_box()), 6000.0, 2200.0, (5.0, 10.0, 15.0), DIGITS),
    "cylinder": (
        lambda: cq.Solid.makeCylinder(5.0, 12.0),
        300.0 * pi,
        170.0 * pi,
        _on_axis(6.0),
        DIGITS,
    ),
    "cylinder_nurbs": (
        lambda: as_nurbs(cq.Solid.makeCylinder(5.0, 12.0)),
        300.0 * pi,
        170.0 * pi,
        _on_axis(6.0),
        DIGITS,
    ),
    "frustum": (
        lambda: cq.Solid.makeCone(5.0, 2.0, 12.0),
        156.0 * pi,
        (29.0 + 7.0 * SLANT) * pi,
        _on_axis(57.0 / 13.0),
        ROUNDED,
    ),
    "cone": (
        lambda: cq.Solid.makeCone(5.0, 0.0, 12.0),
        100.0 * pi,
        90.0 * pi,
        _on_axis(3.0),
        ROUNDED,
    ),
    "cone_nurbs": (
        lambda: as_nurbs(cq.Solid.makeCone(0.0, 5.0, 12.0)),
        100.0 * pi,
        90.0 * pi,
        _on_axis(9.0),
        ROUNDED,
    ),
    "sphere": (_full_sphere, 500.0 / 3.0 * pi, 100.0 * pi, _on_axis(0.0), DIGITS),
    "sphere_nurbs": (
        lambda: as_nurbs(_full_sphere()),
        500.0 / 3.0 * pi,
        100.0 * pi,
        _on_axis(0.0),
        ROUNDED,
    ),
    "half_sphere": (
        lambda: cq.Solid.makeSphere(5.0, angleDegrees1=0.0, angleDegrees2=90.0),
        250.0 / 3.0 * pi,
        75.0 * pi,
        _on_axis(1.875),
        DIGITS,
    ),
    "octant": (_octant, 125.0 / 6.0 * pi, 31.25 * pi, (1.875, 1.875, 1.875), DIGITS),
    "octant_nurbs": (
        lambda: as_nurbs(_octant()),
        125.0 / 6.0 * pi,
        31.25 * pi,
        (1.875, 1.875, 1.875),
        ROUNDED,
    ),
    "wide_wedge_of_sphere": (
        lambda: _full_sphere(270.0),
        125.0 * pi,
        100.0 * pi,
        (-0.625 * (0.75 + 0.25), 0.625, 0.0),
        DIGITS,
    ),
    "torus": (
        lambda: cq.Solid.makeTorus(10.0, 3.0),
        180.0 * pi**2,
        120.0 * pi**2,
        _on_axis(0.0),
        DIGITS,
    ),
    "torus_nurbs": (
        lambda: as_nurbs(cq.Solid.makeTorus(10.0, 3.0)),
        180.0 * pi**2,
        120.0 * pi**2,
        _on_axis(0.0),
        ROUNDED,
    ),
    "hollow_sphere": (_hollow_sphere, 392.0 / 3.0 * pi, 136.0 * pi, _on_axis(0.0), DIGITS),
    "tube": (
        lambda: cq.Workplane().circle(5.0).circle(3.0).extrude(9.0).val(),
        144.0 * pi,
        176.0 * pi,
        _on_axis(4.5),
        DIGITS,
    ),
    "ring": (_ring, 48.0 * pi, 96.0 * pi, _on_axis(0.0), DIGITS),
    "rounded_cube": (
        lambda: cq.Workplane().box(10.0, 10.0, 10.0).edges().fillet(2.0).val(),
        _rounded_volume(10.0, 2.0),
        6.0 * 36.0 + 12.0 * 6.0 * pi + 16.0 * pi,
        _on_axis(0.0),
        DIGITS,
    ),
}


def _measure(tmp_path: Path, shape: cq.Shape, **options: object) -> StepSolid:
    return check_step(write_step(shape, tmp_path / "solid.step", **options))


@pytest.mark.parametrize("name", list(CASES))
def test_sound_files_are_measured_exactly(name: str, tmp_path: Path) -> None:
    make, volume, area, centroid, accuracy = CASES[name]
    found = _measure(tmp_path, make())
    assert found.volume == pytest.approx(volume, rel=accuracy)
    assert found.area == pytest.approx(area, rel=accuracy)
    assert found.centroid == pytest.approx(centroid, rel=accuracy, abs=10.0 * accuracy)
    assert found.unit_m == 0.001
    assert found.max_stokes_residual < 2e-12
    assert found.max_vertex_gap < 1e-11
    # a bound, of no more than twice what is seen
    assert found.max_edge_gap < 2e-11


def test_prism(tmp_path: Path) -> None:
    found = _measure(tmp_path, _prism())
    assert found.volume == pytest.approx(8.0 * PRISM_BASE, rel=DIGITS)
    assert (found.shells, len(found.faces), found.edges, found.vertices) == (1, 6, 12, 8)
    assert {face.carrier for face in found.faces} == {"PLANE"}


def test_surfaces_of_revolution_and_extrusion(tmp_path: Path) -> None:
    for turn in (270.0, 360.0):
        turned = _measure(tmp_path, _elliptic_ring(turn))
        assert turned.volume == pytest.approx(turn / 3.0 * pi**2, rel=DIGITS)
        assert "SURFACE_OF_REVOLUTION" in {face.carrier for face in turned.faces}
    pushed = _measure(tmp_path, cq.Workplane().ellipse(5.0, 3.0).extrude(9.0).val())
    assert pushed.volume == pytest.approx(135.0 * pi, rel=DIGITS)
    assert "SURFACE_OF_LINEAR_EXTRUSION" in {face.carrier for face in pushed.faces}


def test_void_counts_as_second_shell(tmp_path: Path) -> None:
    inner = cq.Workplane().cylinder(4.0, 3.0)
    found = _measure(tmp_path, cq.Workplane().box(20.0, 20.0, 20.0).cut(inner).val())
    assert found.shells == 2
    assert found.volume == pytest.approx(8000.0 - 36.0 * pi, rel=DIGITS)


@pytest.mark.parametrize(("unit", "metres"), [("MM", 1e-3), ("INCH", 0.0254), ("M", 1.0)])
@pytest.mark.parametrize("schema", [AP214, AP242])
def test_units(unit: str, metres: float, schema: int, tmp_path: Path) -> None:
    found = _measure(tmp_path, _box(), unit=unit, schema=schema)
    assert found.unit_m == pytest.approx(metres, rel=1e-15)
    assert found.volume_mm3 == pytest.approx(6000.0, rel=2e-12)  # 10/25.4 in 13 digits
    assert found.area_mm2 == pytest.approx(2200.0, rel=2e-12)
    assert found.centroid_mm == pytest.approx((5.0, 10.0, 15.0), rel=2e-12)


def test_b_spline_solid_has_the_volume_of_its_map(tmp_path: Path) -> None:
    sample = SplineSolid()
    found = _measure(tmp_path, sample.solid())
    assert found.volume == pytest.approx(sample.volume(), rel=DIGITS)
    assert [face.carrier for face in found.faces] == ["B_SPLINE_SURFACE"] * 6
    assert (found.edges, found.vertices) == (12, 8)
    assert found.max_stokes_residual < 1e-12


def test_part_of_a_b_spline_surface_between_its_parameter_lines(tmp_path: Path) -> None:
    sample = SplineSolid(top=0.6)
    found = _measure(tmp_path, sample.solid())
    assert found.volume == pytest.approx(sample.volume(), rel=DIGITS)


def test_a_cylinder_cut_obliquely(tmp_path: Path) -> None:
    slab = cq.Workplane().box(30.0, 30.0, 6.0).val().rotate((0, 0, 0), (1, 0, 0), 20.0)
    shape = cq.Workplane().cylinder(40.0, 5.0).intersect(cq.Workplane(slab))
    found = _measure(tmp_path, shape.val())
    assert found.volume == pytest.approx(25 * pi * 6 / cos(radians(20)), rel=DIGITS)
    assert found.max_stokes_residual < 1e-12


def test_a_closed_curve_swept_across_its_axis_is_said_to_be_unsupported(tmp_path: Path) -> None:
    with pytest.raises(StepDefectError, match="crosses its axis"):
        _measure(tmp_path, _ellipsoid())


@pytest.mark.slow
def test_b_spline_solid_of_many_spans(tmp_path: Path) -> None:
    sample = SplineSolid(16)
    found = _measure(tmp_path, sample.solid())
    assert found.volume == pytest.approx(sample.volume(), rel=DIGITS)


def test_properties_stated_in_the_file_are_read(tmp_path: Path) -> None:
    found = check_step(write_with_properties(_box(), tmp_path / "stated.step", 6000.0))
    assert found.properties.volume == pytest.approx(6000.0)
    assert found.properties.area == pytest.approx(2200.0)
    assert found.properties.centroid == pytest.approx((5.0, 10.0, 15.0))


def test_an_edge_may_run_round_what_is_missing_of_a_ball() -> None:
    """As FreeCAD writes it: no seam, and the edge is no circle of latitude."""
    found = describe(parse_step(cut_ball().encode()))
    assert found["sound"] is True, found
    (solid,) = found["solids"]
    assert solid["volume"] == pytest.approx(9.0 * pi, rel=1e-9)
    assert solid["area"] == pytest.approx(15.0 * pi, rel=1e-9)
    assert solid["centroid"] == pytest.approx([-0.25, 0.0, 0.0], abs=1e-9)


def test_the_seams_of_a_torus_come_in_any_order(tmp_path: Path) -> None:
    """All of them begin and end at one vertex: FreeCAD writes the other order."""
    path = write_step(cq.Solid.makeTorus(10.0, 2.0), tmp_path / "torus.step")
    text = path.read_text()
    (uses,) = re.findall(r"EDGE_LOOP\('',\((#\d+,#\d+,#\d+,#\d+)\)", text)
    a, b, c, d = uses.split(",")
    found = describe(parse_step(text.replace(uses, ",".join((d, c, b, a))).encode()))
    assert found["sound"] is True, found
    assert found["solids"][0]["volume"] == pytest.approx(80.0 * pi**2, rel=1e-12)


def test_what_edges_leave_beside_a_side_without_speed() -> None:
    """A parameter that begins without speed, as the flank of a tooth does at its base circle."""
    # x = u², y = v, with a border that begins on u = 0
    poles = np.array([[[x, y, 0.0] for y in (0.0, 1.0)] for x in (0.0, 0.0, 1.0)])
    knots = (np.repeat([0.0, 1.0], 3), np.repeat([0.0, 1.0], 2))
    surface = make_surface(knots, (2, 1), poles, False)
    corners = np.array([[0.0, 0.2, 0.0], [0.6, 0.2, 0.0], [0.6, 0.5, 0.0], [0.0, 0.9, 0.0]])
    t, weights = gauss_rule(np.array([0.0, 1.0]), 16)
    ways = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    flows = [(a + t[:, None] * (b - a), weights[:, None] * (b - a)) for a, b in ways]
    edges = follow(surface, flows)
    places = surface.at(*edges.places)[0]
    assert np.allclose(places, np.concatenate([flow[0] for flow in flows]), atol=1e-12)
    for level in (0.0, 1.0):
        moments = trimmed_moments(edges, (0, level), np.zeros(3), np.zeros(3))
        assert moments.area == pytest.approx(0.3, abs=1e-12)  # 0.6 (0.3 + 0.7)/2
