"""The acceptance suite A1 to A20: every shipped template against the reference table.

The expected figures are closed forms of the table, or its own digits where it has no closed form.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import asinh, atan, cos, pi, sin, sqrt
from pathlib import Path

import pytest
from consumers.fresh_kernel import read_in_fresh_process
from consumers.step_file import check_step
from scipy.special import ellipeinc, ellipkinc
from shipped import LONG, part_of

import pc2cad as pc
from pc2cad.compiler import compile_equation
from pc2cad.errors import NotASolidError
from pc2cad.part import Part
from pc2cad.templates.file import parse_template
from pc2cad.templates.shipped import template_paths

# -- the table -------------------------------------------------------------------------------------

POINT = "point"
SEAM_U = {"u=0": "interface, glued to u=1", "u=1": "interface, glued to u=0"}
SEAM_V = {"v=0": "interface, glued to v=1", "v=1": "interface, glued to v=0"}
AXIS = {"v=0": "curve, along w", "v=1": "curve, along w"}


def end(turn: float) -> tuple[float, float]:
    """Means of the cosine and the sine over a share of the turn."""
    angle = 2 * pi * turn
    return sin(angle) / angle, (1 - cos(angle)) / angle


def saddle(q: float) -> float:
    """Integral of sqrt(q² + u² + v²) over the unit square."""
    r = sqrt(q**2 + 2)
    return (r + (3 * q**2 + 1) * asinh(1 / sqrt(q**2 + 1)) - q**3 * atan(1 / (q * r))) / 3


def ellipsoid_area(a: float, b: float, c: float) -> float:
    """Legendre's form, a > b > c."""
    phi, m = math.acos(c / a), a**2 * (b**2 - c**2) / (b**2 * (a**2 - c**2))
    rest = ellipeinc(phi, m) * sin(phi) ** 2 + ellipkinc(phi, m) * cos(phi) ** 2
    return float(2 * pi * (c**2 + a * b * rest / sin(phi)))


@dataclass(frozen=True)
class Solid:
    """One row of the table."""

    template: str
    volume: float
    area: float
    centroid: tuple[float, float, float]
    faces: str
    #: sides that are no faces -> fate and detail
    others: Mapping[str, str]
    #: between two faces, and their ends; None: the table does not count them
    edges: int | None = None
    vertices: int | None = None
    #: of each shell
    genus: tuple[int, ...] = (0,)
    #: every face lies on a plane or a polynomial surface
    polynomial: bool = False

    @property
    def euler(self) -> int:
        return sum(2 - 2 * genus for genus in self.genus)


BOX = "u=0 u=1 v=0 v=1 w=0 w=1"
COS, SIN = end(1 / 4)
HELIX = 4 * pi * sqrt(16 + (3 / (2 * pi)) ** 2)
CUT_BALL = 3 * pi * 2 / 16

SUITE = {
    "A1": Solid(
        "oblique_prism", 30, 12 + sqrt(254) + sqrt(416) + sqrt(486), (13 / 6, 3 / 2, 5 / 2),
        "u=0 u=1 v=1 w=0 w=1", {"v=0": "curve, along w"}, 9, 6, polynomial=True,
    ),
    "A2": Solid(
        "parallelepiped", 24, 2 * (15 + sqrt(153)), (5 / 2, 3 / 2, 2), BOX, {}, 12, 8,
        polynomial=True,
    ),
    "A3": Solid(
        "bilinear_top", 9, 22 + 2 * saddle(2), (28 / 27, 28 / 27, 92 / 81), BOX, {}, 12, 8,
        polynomial=True,
    ),
    "A4": Solid("ball", 32 * pi / 3, 16 * pi, (0, 0, 0), "w=1", SEAM_U | AXIS | {"w=0": POINT},
                0, 0),
    "A5": Solid(
        "half_ball", 16 * pi / 3, 12 * pi, (0, 0, 3 / 4), "v=0.5 w=1",
        SEAM_U | {"v=0": "curve, along w", "w=0": POINT}, 1, 1,
    ),
    "A6": Solid(
        "ball_wedge", 16 * pi / 9, 20 * pi / 3,
        (CUT_BALL * end(1 / 6)[0], CUT_BALL * end(1 / 6)[1], 0),
        "u=0 u=1/6 w=1", AXIS | {"w=0": POINT}, 3, 2,
    ),
    "A7": Solid("hollow_ball", 28 * pi / 3, 20 * pi, (0, 0, 0), "w=0 w=1", SEAM_U | AXIS, 0, 0,
                (0, 0)),
    "A8": Solid("ellipsoid", 8 * pi, ellipsoid_area(3, 2, 1), (0, 0, 0), "w=1",
                SEAM_U | AXIS | {"w=0": POINT}, 0, 0),
    "A9": Solid("torus", 40 * pi**2, 40 * pi**2, (0, 0, 0), "w=1",
                SEAM_U | SEAM_V | {"w=0": "curve, along u"}, 0, 0, (1,)),
    "A10": Solid(
        "torus_wedge", 10 * pi**2, 10 * pi**2 + 8 * pi, (COS * 26 / 5, SIN * 26 / 5, 0),
        "u=0 u=0.25 w=1", SEAM_V | {"w=0": "curve, along u"}, 2, 2,
    ),
    "A11": Solid("torus_tube", 30 * pi**2, 60 * pi**2, (0, 0, 0), "w=0 w=1", SEAM_U | SEAM_V,
                 0, 0, (1, 1)),
    "A12": Solid("cone", 12 * pi, 24 * pi, (0, 0, 1), "v=1 w=0",
                 SEAM_U | {"v=0": "curve, along w", "w=1": POINT}, 1, 1),
    "A13": Solid("cone_frustum", 52 * pi / 3, pi * (10 + 8 * sqrt(5)), (0, 0, 18 / 13),
                 "v=1 w=0 w=1", SEAM_U | {"v=0": "curve, along w"}, 2, 2),
    "A14": Solid("hollow_cylinder", 25 * pi, 60 * pi, (0, 0, 5 / 2), "v=0 v=1 w=0 w=1", SEAM_U,
                 4, 4, (1,)),
    # the crease winds round the ring 4 times, in 4 arcs; 4 more edges part the strip into 4 faces
    "A15": Solid(
        "turned_ring", 40 * pi, 251.435609608249, (0, 0, 0), "v=0 v=1 w=0 w=1",
        {"u=0": "interface, glued to u=1, (s, t) to (t, 1-s)",
         "u=1": "interface, glued to u=0, (s, t) to (1-t, s)"}, 8, 4, (1,),
    ),
    "A16": Solid("helical_channel", 3 / 4 * pi * HELIX, 3 * pi * HELIX + 1.5 * pi, (0, 0, 3),
                 "u=0 u=1 w=0 w=1", SEAM_V, 4, 4, (1,)),
    "A17": Solid(
        "paraboloid_cap", 6 * pi, pi / 27 * (40**1.5 - 8) + 4 * pi, (0, 0, 1), "v=0 v=1",
        SEAM_U | {"w=0": "curve, along v", "w=1": "curve, along u"}, 1, 1,
    ),
    "A18": Solid("hypar_slab", 1 / 2, 2 + 2 * saddle(1), (1 / 2, 1 / 2, 1 / 2), BOX, {}, 12, 8,
                 polynomial=True),
    "A19": Solid(
        "triquadratic_cube", 58759 / 56250, 6.02823092024112,
        (0.4999744719958, 0.5004283842232, 0.5227180829615), BOX, {}, 12, 8, polynomial=True,
    ),
    "A20": Solid(
        "elbow_pipe", 9 / 8 * pi**2, 4.5 * pi**2 + 1.5 * pi,
        (COS * (3 + 5 / 48), SIN * (3 + 5 / 48), 0), "u=0 u=0.25 w=0 w=1", SEAM_V, 4, 4, (1,),
    ),
}  # fmt: skip
every_solid = pytest.mark.parametrize("solid", SUITE.values(), ids=SUITE)

#: figures that the table prints
PRINTED = {
    "A3": ("area", 26.3161480657661),
    "A8": ("area", 48.8821463025821),
    "A16": ("volume", 119.276018536915),
    "A17": ("area", 41.0713454304692),
    "A18": ("area", 4.56157855054681),
}


def read(template: str) -> pc.Template:
    return pc.read_template(template_paths()[template])


@pytest.mark.parametrize("row", PRINTED)
def test_closed_forms_have_the_printed_figures(row):
    name, printed = PRINTED[row]
    assert getattr(SUITE[row], name) == pytest.approx(printed, rel=1e-14)


def test_printed_centroids():
    assert SUITE["A6"].centroid[:2] == pytest.approx((0.974278579257, 9 / 16), rel=1e-12)
    assert SUITE["A10"].centroid[:2] == pytest.approx((3.310422816311,) * 2, rel=1e-12)
    assert SUITE["A20"].centroid[:2] == pytest.approx((1.976173876724,) * 2, rel=1e-12)


def test_printed_area_of_the_helical_channel():
    assert SUITE["A16"].area == pytest.approx(481.816463128043, rel=2e-15)


# -- the report ------------------------------------------------------------------------------------


@every_solid
def test_volume_area_and_centroid(solid):
    report = part_of(solid.template).report
    true = 1e-9 if report.evidence == "exact" else 1e-7
    for found, relative in ((report.equation, 1e-11), (report.solid, true)):
        assert found.volume == pytest.approx(solid.volume, rel=relative, abs=0)
        assert found.area == pytest.approx(solid.area, rel=relative, abs=0)
        # relative to the part: a coordinate may be 0
        assert found.centroid == pytest.approx(solid.centroid, rel=0, abs=relative * report.size)


@every_solid
def test_deviation_stays_below_the_tolerance(solid):
    report = part_of(solid.template).report
    assert report.deviation <= report.tolerance
    assert report.kernel_tolerance <= max(1e-7, report.tolerance) * (1 + 1e-9)
    if solid.polynomial:
        assert report.evidence == "exact"
        assert report.deviation == 0.0


@every_solid
def test_the_map_is_proved_to_cover_nothing_twice(solid):
    report = part_of(solid.template).report
    assert report.own.determinant == "proved"
    assert report.injectivity == "proved", report.own.overlap_open
    # but for what is nearer to the boundary than faces deviate
    assert report.overlap_depth <= report.deviation + 1e-9 * report.size


@every_solid
def test_sides(solid):
    part = part_of(solid.template)
    fates = {
        side.name: f"{side.fate}, {side.detail}" if side.detail else side.fate
        for side in part.report.sides
    }
    assert fates == dict.fromkeys(solid.faces.split(), "face") | dict(solid.others)
    assert len(fates) == 6
    assert set(part.faces) == set(solid.faces.split())
    assert {face.name for face in part.report.faces} == set(part.faces)


@every_solid
def test_topology(solid):
    report = part_of(solid.template).report
    assert report.genus == solid.genus
    assert report.shells == len(solid.genus)
    assert report.euler == solid.euler
    if solid.edges is not None:
        assert (report.edges, report.vertices) == (solid.edges, solid.vertices)


@pytest.mark.parametrize("turn", ["1/6", "0.3", "0.5"])
def test_edges_of_the_ball_wedge(turn):
    # two arcs and the axis, between the poles: two sides collapse to halves of one edge
    part = compile_equation(read("ball_wedge").bind({"turn": turn}))
    assert (part.report.edges, part.report.vertices) == (3, 2)
    assert (len(part.report.faces), part.report.euler) == (3, 2)


@every_solid
def test_expectations_state_what_the_table_does(solid):
    stated = read(solid.template).bind().expectations
    assert stated.volume == pytest.approx(solid.volume, rel=1e-14)
    if solid.template in ("ellipsoid", "turned_ring", "triquadratic_cube"):  # no closed form
        assert stated.area is None
    else:
        assert stated.area == pytest.approx(solid.area, rel=1e-14)
    assert stated.centroid == pytest.approx(solid.centroid, rel=1e-12, abs=1e-14)
    assert stated.faces == len(solid.faces.split())
    assert (stated.edges, stated.vertices) == (solid.edges, solid.vertices)
    assert (stated.shells, stated.euler) == (len(solid.genus), solid.euler)


# -- other parameters ------------------------------------------------------------------------------

OTHERS = {
    "bilinear_top": "a=3 h=1/2 k=2",
    "ball": "R=7",
    "half_ball": "R=1/2",
    "ball_wedge": "R=3 turn=0.4",
    "hollow_ball": "r=3 wall=0.1",
    "ellipsoid": "a=1 b=5 c=2",
    "torus": "R=10 r=3",
    "torus_wedge": "R=4 r=1 turn=0.7",
    "torus_tube": "R=20 r=2 wall=1/4",
    "cone": "r=1 h=10",
    "cone_frustum": "r0=1 r1=2 h=1/2",
    "hollow_cylinder": "r=10 wall=1/2 h=40",
    "turned_ring": "R=8 a=1 quarters=3",
    "helical_channel": "R=10 pitch=6 turns=5/4 r=1 wall=1/4",
    "paraboloid_cap": "r=5 h=1",
    "hypar_slab": "a=10 h=1 k=4",
    "triquadratic_cube": "a=-0.4 b=1/2 c=-2",
    "elbow_pipe": "R=50 r=10 wall=2 turn=3/8",
}
MOVED = {
    "oblique_prism": {"A": "1, 7, -2", "B": "2, 2, 5", "C": "-1, 0, 3", "D": "4, 1, 1"},
    "parallelepiped": {"A": "1, 7, -2", "B": "2, 2, 5", "C": "-1, 0, 3", "D": "4, 1, 1"},
}


def assert_expected(part: Part) -> None:
    """Compare with what the template states; compiling has done so with its own slack."""
    stated, report = part.equation.expectations, part.report
    assert report.equation.volume == pytest.approx(stated.volume, rel=1e-11)
    if stated.area is not None:
        assert report.equation.area == pytest.approx(stated.area, rel=1e-11)
    assert report.equation.centroid == pytest.approx(stated.centroid, abs=1e-11 * report.size)
    assert (len(report.faces), report.shells, report.euler) == (
        stated.faces, stated.shells, stated.euler,
    )  # fmt: skip
    if stated.edges is not None:
        assert (report.edges, report.vertices) == (stated.edges, stated.vertices)


def test_every_template_is_built_with_other_parameters():
    assert OTHERS.keys() | MOVED.keys() == {solid.template for solid in SUITE.values()}


@pytest.mark.parametrize("template", OTHERS)
def test_other_parameters(template):
    values = dict(pair.split("=") for pair in OTHERS[template].split())
    assert values.keys() == {parameter.name for parameter in read(template).parameters}
    assert_expected(compile_equation(read(template).bind(values)))


@pytest.mark.parametrize("template", MOVED)
def test_other_points(template):
    text = template_paths()[template].read_text(encoding="utf-8")
    for name, point in MOVED[template].items():
        text, count = re.subn(rf"(?m)^{name} = \[.*\]$", f"{name} = [{point}]", text)
        assert count == 1
    assert_expected(compile_equation(parse_template(text, template).bind()))


def test_a_torus_thicker_than_its_radius_is_refused():
    with pytest.raises(NotASolidError, match="the map folds"):
        compile_equation(read("torus").bind({"r": 6}))


def test_a_ring_whose_ends_meet_askew_is_refused():
    text = template_paths()["turned_ring"].read_text(encoding="utf-8").partition("[expect]")[0]
    with pytest.raises(NotASolidError):
        compile_equation(parse_template(text, "ring").bind({"quarters": "3/2"}))


# -- files -----------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("suite")


def step_of(solid: Solid, folder: Path) -> Path:
    path = folder / f"{solid.template}.step"
    if not path.exists():
        part_of(solid.template).write(path)
    return path


@every_solid
def test_step_without_a_kernel(solid, folder):
    report, found = part_of(solid.template).report, check_step(step_of(solid, folder))
    own, true = (1e-12, 1e-11) if solid.polynomial else (1e-9, 1e-7)
    assert found.volume == pytest.approx(report.solid.volume, rel=own)
    assert found.area == pytest.approx(report.solid.area, rel=own)
    assert found.volume == pytest.approx(solid.volume, rel=true)
    assert found.area == pytest.approx(solid.area, rel=true)
    assert found.centroid == pytest.approx(solid.centroid, abs=true * report.size)
    assert found.shells == len(solid.genus)
    assert {face.name for face in found.faces} == set(solid.faces.split())
    assert len(found.faces) == len(solid.faces.split())
    assert found.properties.volume == pytest.approx(solid.volume, rel=1e-11)
    assert found.properties.area == pytest.approx(solid.area, rel=1e-11)


@every_solid
def test_step_in_a_fresh_process(solid, folder):
    report, found = part_of(solid.template).report, read_in_fresh_process(step_of(solid, folder))
    assert (found["shape_type"], found["valid"], found["free_edges"]) == ("SOLID", True, 0)
    counts = [found[name] for name in ("solids", "shells", "faces")]
    assert counts == [1, len(solid.genus), len(solid.faces.split())]
    for kind in ("vertex", "edge", "face"):
        allowed = 0.0 if solid.polynomial else report.tolerance
        assert found[f"max_{kind}_tolerance"] <= max(1e-7 * 1.001, allowed)
    # the kernel's own integrals are good to 2e-8: of volume with spline faces, of area on any
    # that are curved
    own, true = (1e-11, 1e-11) if solid.polynomial else (2e-8, 1e-7)
    assert found["volume"] == pytest.approx(report.solid.volume, rel=own)
    assert found["volume"] == pytest.approx(solid.volume, rel=true)
    assert found["area"] == pytest.approx(report.solid.area, rel=2e-8)
    assert found["area"] == pytest.approx(solid.area, rel=1e-7)


# -- all shipped templates -------------------------------------------------------------------------

SUITE_TEMPLATES = {solid.template for solid in SUITE.values()}


@pytest.mark.parametrize("template", template_paths())
def test_every_shipped_template_binds(template):
    found = read(template)
    assert found.title
    assert found.source
    assert found.bind().name == template


@pytest.mark.parametrize(
    "template",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in LONG else [])
        for name in template_paths()
    ],
)
def test_every_shipped_template_compiles_and_is_proved_to_cover_nothing_twice(template):
    report = part_of(template).report
    assert report.deviation <= report.tolerance
    reports = [report] if report.own else list(report.bodies.values())
    assert len(reports) >= 1
    for one in reports:
        assert one.injectivity == "proved", one.one.overlap_open
        assert one.overlap_depth <= one.deviation
