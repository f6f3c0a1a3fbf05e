"""The pyramids of the reference table: planes only, counts, volume, area, centroid, face areas.

Every expected figure is the table's own or follows in exact fractions from the four points: the cut
pyramid is the pyramid ABCD less the pyramid PQRD, in the sense of signed volumes.
"""

from __future__ import annotations

import functools
import math
import re
from dataclasses import dataclass
from fractions import Fraction

import pytest
from OCP.BRep import BRep_Tool
from OCP.BRepGProp import BRepGProp
from OCP.Geom import Geom_Plane
from OCP.GProp import GProp_GProps

import pc2cad as pc
from pc2cad.compiler import compile_equation
from pc2cad.equation.points import Combination
from pc2cad.expression.normal_form import is_identically_zero
from pc2cad.expression.tree import Expr
from pc2cad.part import Part
from pc2cad.templates.file import parse_template
from pc2cad.templates.header import ParameterRangeError
from pc2cad.templates.shipped import template_paths

RELATIVE = 1e-12

POINTS = {
    "P0": {"A": (4, 0, 0), "B": (0, 3, 0), "C": (0, 0, 0), "D": (0, 0, 5)},
    "P1": {"A": (4, 0, 0), "B": (1, 5, 1), "C": (-2, -1, 0), "D": (1, 1, 6)},
}
CUT = {"p": Fraction(1, 2), "q": Fraction(1, 4), "r": Fraction(3, 4)}

Vector = tuple[Fraction, Fraction, Fraction]


def text_with_points(template: str, points: dict[str, tuple[int, int, int]]) -> str:
    text = template_paths()[template].read_text(encoding="utf-8")
    for name, (x, y, z) in points.items():
        text, count = re.subn(rf"(?m)^{name} = \[.*\]$", f"{name} = [{x}, {y}, {z}]", text)
        assert count == 1
    # what a template states about its own points holds for no others
    return re.sub(r"(?m)^centroid = .*$", "", text)


@functools.cache
def from_template(template: str, points: str, **values: Fraction) -> Part:
    read = parse_template(text_with_points(template, POINTS[points]), template)
    return compile_equation(read.bind(values))


def pyramid(points: str) -> Part:
    A, B, C, D = pc.points(**POINTS[points])
    u, v, w = pc.parameters()
    M = A * u * v * (1 - w) + B * (1 - v) * (1 - w) + C * (1 - u) * v * (1 - w) + D * w
    return pc.compile_part(M)


def truncated(points: str) -> Part:
    A, B, C, D = pc.points(**POINTS[points])
    u, v, w = pc.parameters()
    S = (A - D) * u * v + (B - D) * (1 - v) + (C - D) * (1 - u) * v
    return pc.compile_part(D + S * (1 - w), {"w": (0, Fraction(1, 2))})


def cut(points: str, p: Fraction, q: Fraction, r: Fraction) -> Part:
    A, B, C, D = pc.points(**POINTS[points])
    u, v, w = pc.parameters()

    def share(k: Fraction) -> Expr:
        return (1 - w) + k * w

    M = (A - D) * u * v * share(p) + (B - D) * (1 - v) * share(q) + (C - D) * v * (1 - u) * share(r)
    return pc.compile_part(M + D)


def cut_off(points: str, p: Fraction, q: Fraction, r: Fraction) -> Part:
    A, B, C, D = pc.points(**POINTS[points])
    u, v, w = pc.parameters()
    M = (A - D) * p * w * u * v + (B - D) * q * w * (1 - v) + (C - D) * r * w * v * (1 - u) + D
    return pc.compile_part(M)


def sum_of_two(points: str, p: Fraction, q: Fraction, r: Fraction) -> Part:
    A, B, C, D = pc.points(**POINTS[points])
    u, v, w = pc.parameters()
    M1 = A * u * v * (1 - w) + B * (1 - v) * (1 - w) + C * (1 - u) * v * (1 - w) + D * w
    M2 = (A - D) * p * w * u * v + (B - D) * q * w * (1 - v) + (C - D) * r * w * v * (1 - u) + D
    return pc.compile_part(M1 + M2 - D)


# -- exact figures ---------------------------------------------------------------------------------


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _triangle(a: Vector, b: Vector, c: Vector) -> float:
    n = _cross(_minus(b, a), _minus(c, a))
    return math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / 2


@dataclass(frozen=True)
class Figures:
    volume: Fraction
    centroid: Vector
    #: by corner letters; a cut of p, q, r leaves (1 - pq) of ABD and so on
    areas: dict[str, float]


def figures(points: str, p: Fraction, q: Fraction, r: Fraction) -> Figures:
    """Exact figures of ABCD less PQRD."""
    A, B, C, D = (tuple(map(Fraction, x)) for x in POINTS[points].values())
    det = _cross(_minus(A, D), _minus(B, D))
    whole = abs(sum(a * b for a, b in zip(det, _minus(C, D), strict=True))) / 6
    removed = whole * p * q * r
    P, Q, R = (
        tuple(d + k * (x - d) for x, d in zip(X, D, strict=True))
        for X, k in ((A, p), (B, q), (C, r))
    )
    centroid = tuple(
        (whole * (a + b + c + d) - removed * (x + y + z + d)) / (4 * (whole - removed))
        for a, b, c, d, x, y, z in zip(A, B, C, D, P, Q, R, strict=True)
    )
    areas = {
        "u=0": abs(1 - q * r) * _triangle(B, C, D),
        "u=1": abs(1 - p * q) * _triangle(A, B, D),
        "v=1": abs(1 - p * r) * _triangle(A, C, D),
        "w=0": _triangle(A, B, C),
        "w=1": _triangle(P, Q, R),
    }
    return Figures(abs(whole - removed), centroid, {k: x for k, x in areas.items() if x})


def kernel_area(part: Part, face: str) -> float:
    found = GProp_GProps()
    BRepGProp.SurfaceProperties_s(part.faces[face], found)
    return found.Mass()


def assert_figures(part: Part, volume: float, area: float, centroid: tuple) -> None:
    report = part.report
    for source in (report.solid, report.equation):
        assert source.volume == pytest.approx(float(volume), rel=RELATIVE, abs=0)
        assert source.area == pytest.approx(float(area), rel=RELATIVE, abs=0)
        # relative to the part: a coordinate may be 0
        assert source.centroid == pytest.approx(
            [float(x) for x in centroid], rel=0, abs=RELATIVE * report.size
        )


def assert_planes(part: Part, faces: int, edges: int, vertices: int) -> None:
    report = part.report
    assert {face.carrier for face in report.faces} == {"plane"}
    assert all(isinstance(BRep_Tool.Surface_s(face), Geom_Plane) for face in part.faces.values())
    assert report.evidence == "exact"
    assert report.deviation == 0.0
    assert (len(report.faces), report.edges, report.vertices) == (faces, edges, vertices)
    assert (report.shells, report.genus, report.euler) == (1, (0,), 2)
    assert report.kernel_tolerance <= 1e-7 * (1 + 1e-9)


def assert_face_areas(part: Part, expected: dict[str, float]) -> None:
    found = {face.name: face.area for face in part.report.faces}
    assert found == pytest.approx(expected, rel=RELATIVE, abs=0)
    kernel = {name: kernel_area(part, name) for name in part.faces}
    assert kernel == pytest.approx(expected, rel=RELATIVE, abs=0)


def fates(part: Part) -> dict[str, str]:
    return {side.name: side.fate for side in part.report.sides}


# -- the table -------------------------------------------------------------------------------------

S1 = (math.sqrt(1126) + 11 * math.sqrt(10) + 5 * math.sqrt(61) + 3 * math.sqrt(157)) / 2


def exact(figures: str) -> tuple[Fraction, ...]:
    return tuple(map(Fraction, figures.split()))


#: how it is built, points, volume, area, centroid, (faces, edges, vertices)
TABLE = {
    f"{build} {points}": (build, points, *figures)
    for build, points, *figures in (
        ("pyramid", "P0", "10", 23.5 + math.sqrt(769) / 2, "1 3/4 5/4", (4, 6, 4)),
        ("half", "P0", "35/4", 31.0240684678965, "15/14 45/56 55/56", (5, 9, 6)),
        ("cut", "P0", "145/16", 33.1278311113264, "61/58 375/464 245/232", (5, 9, 6)),
        ("cut off", "P0", "15/16", 9.54126264342985, "1/2 3/16 25/8", (4, 6, 4)),
        ("pyramid", "P1", "63/2", S1, "1 5/4 7/4", (4, 6, 4)),
        ("half", "P1", "441/16", 62.7572752568821, "1 71/56 81/56", (5, 9, 6)),
        ("cut", "P1", "1827/64", 65.2796013488524, "473/464 151/116 713/464", (5, 9, 6)),
        ("cut off", "P1", "189/64", 18.5549926141880, "13/16 3/4 61/16", (4, 6, 4)),
    )
}

WITH_PYTHON = {
    "pyramid": pyramid,
    "half": truncated,
    "cut": lambda points: cut(points, **CUT),
    "cut off": lambda points: cut_off(points, **CUT),
}
WITH_TEMPLATE = {
    "pyramid": lambda points: from_template("pyramid", points),
    "half": lambda points: from_template("pyramid_truncated", points, t=Fraction(1, 2)),
    "cut": lambda points: from_template("pyramid_cut", points, **CUT),
    "cut off": lambda points: from_template("pyramid_cut_off", points, **CUT),
}


@pytest.mark.parametrize("way", [WITH_PYTHON, WITH_TEMPLATE], ids=["python", "template"])
@pytest.mark.parametrize("row", TABLE)
def test_row_of_the_table(row, way):
    build, points, volume, area, centroid, counts = TABLE[row]
    part = way[build](points)
    assert_planes(part, *counts)
    assert_figures(part, Fraction(volume), area, exact(centroid))


#: p, q, r -> (faces, edges, vertices), sides that are no face
DEGENERATE = {
    "1 1/2 0": ((5, 8, 5), {"v=0": "curve"}),
    "0 0 0": ((4, 6, 4), {"v=0": "curve", "w=1": "point"}),
    "1 1 1/2": ((4, 6, 4), {"u=1": "curve", "v=0": "point"}),
    "1 1/2 1/2": ((5, 8, 5), {"v=0": "curve"}),
}
#: of P1: volume, area, centroid
DEGENERATE_P1 = {
    "1 1/2 0": ("63/2", S1, "1 5/4 7/4"),
    "0 0 0": ("63/2", S1, "1 5/4 7/4"),
    "1 1 1/2": ("63/4", 49.6449970569248, "5/8 1 1"),
    "1 1/2 1/2": ("189/8", 58.3024473933518, "7/8 4/3 31/24"),
}
CUTS = {
    "template": lambda points, p, q, r: from_template("pyramid_cut", points, p=p, q=q, r=r),
    "sum template": lambda points, p, q, r: from_template("pyramid_sum", points, p=p, q=q, r=r),
    "python": cut,
    "python sum": sum_of_two,
}


@pytest.mark.parametrize("way", CUTS)
@pytest.mark.parametrize("points", POINTS)
@pytest.mark.parametrize("case", DEGENERATE)
def test_degenerate_cut(case, points, way):
    counts, lost = DEGENERATE[case]
    p, q, r = exact(case)
    part = CUTS[way](points, p, q, r)
    expected = figures(points, p, q, r)
    assert_planes(part, *counts)
    assert_figures(part, expected.volume, sum(expected.areas.values()), expected.centroid)
    assert_face_areas(part, expected.areas)
    assert {name: fate for name, fate in fates(part).items() if fate != "face"} == lost
    if points == "P1":
        volume, area, centroid = DEGENERATE_P1[case]
        assert_figures(part, Fraction(volume), area, exact(centroid))


def test_cut_beyond_the_base_has_the_opposite_orientation():
    part = cut("P1", Fraction(2), Fraction(2), Fraction(2))
    expected = figures("P1", Fraction(2), Fraction(2), Fraction(2))
    assert expected.volume == Fraction(441, 2)
    assert_planes(part, 5, 9, 6)
    assert_figures(part, Fraction(441, 2), sum(expected.areas.values()), expected.centroid)
    assert_face_areas(part, expected.areas)


@pytest.mark.parametrize("template", ["pyramid_cut", "pyramid_sum"])
def test_templates_keep_their_range(template):
    read = pc.read_template(template_paths()[template])
    with pytest.raises(ParameterRangeError, match=r"p = 2 is outside its range: from 0 to 1"):
        read.bind({"p": 2, "q": 2, "r": 2})


# -- faces -----------------------------------------------------------------------------------------

FACE_AREAS = {
    ("cut", "P0"): {
        "u=0": 6.09375, "u=1": 12.1322465458793, "v=1": 6.25, "w=0": 6.0, "w=1": 2.6518345654471,
    },
    ("pyramid", "P0"): {"u=0": 7.5, "u=1": math.sqrt(769) / 2, "v=1": 10.0, "w=0": 6.0},
    ("pyramid", "P1"): {
        "u=0": 5 * math.sqrt(61) / 2, "u=1": 11 * math.sqrt(10) / 2, "v=1": 3 * math.sqrt(157) / 2,
        "w=0": math.sqrt(1126) / 2,
    },
    ("half", "P1"): {
        "u=0": 15 * math.sqrt(61) / 8, "u=1": 33 * math.sqrt(10) / 8,
        "v=1": 9 * math.sqrt(157) / 8, "w=0": math.sqrt(1126) / 2, "w=0.5": math.sqrt(1126) / 8,
    },
    ("cut", "P1"): {
        "u=0": 15.8645696541854, "u=1": 15.2184612395603, "v=1": 11.7468413307578,
        "w=0": 16.7779617355625, "w=1": 5.67176738878632,
    },
}  # fmt: skip


@pytest.mark.parametrize(("build", "points"), FACE_AREAS)
def test_face_areas(build, points):
    assert_face_areas(WITH_TEMPLATE[build](points), FACE_AREAS[build, points])


#: side -> fate and, for a curve, the parameter along it
SIDES = {
    "pyramid": {"u=0": "face", "u=1": "face", "v=0": "curve", "v=1": "face", "w=0": "face",
                "w=1": "point"},
    "half": {"u=0": "face", "u=1": "face", "v=0": "curve", "v=1": "face", "w=0": "face",
             "w=0.5": "face"},
    "cut": {"u=0": "face", "u=1": "face", "v=0": "curve", "v=1": "face", "w=0": "face",
            "w=1": "face"},
    "cut off": {"u=0": "face", "u=1": "face", "v=0": "curve", "v=1": "face", "w=0": "point",
                "w=1": "face"},
}  # fmt: skip


@pytest.mark.parametrize("points", POINTS)
@pytest.mark.parametrize("build", SIDES)
def test_sides(build, points):
    part = WITH_TEMPLATE[build](points)
    assert fates(part) == SIDES[build]
    collapsed = next(side for side in part.report.sides if side.name == "v=0")
    assert (collapsed.verdict, collapsed.detail) == ("proved", "along w")


@pytest.mark.parametrize("points", POINTS)
def test_corners_are_the_given_points(points):
    part = WITH_PYTHON["pyramid"](points)
    found = sorted(tuple(row) for row in part.model.vertices.tolist())
    assert found == sorted(tuple(map(float, x)) for x in POINTS[points].values())


# -- identities ------------------------------------------------------------------------------------


def with_free_points(template: str) -> Combination:
    """Return M with p, q, r and all twelve coordinates left free."""
    text = template_paths()[template].read_text(encoding="utf-8")
    names = [point + axis for point in "ABCD" for axis in "xyz"]
    free = "".join(f"{name} = {{ default = 0 }}\n" for name in names)
    text = text.replace("[parameters]\n", f"[parameters]\n{free}")
    for name in "ABCD":
        row = ", ".join(f'"{name}{axis}"' for axis in "xyz")
        text = re.sub(rf"(?m)^{name} = \[.*\]$", f"{name} = [{row}]", text)
    return parse_template(text, template).M


def test_the_sum_is_the_cut_pyramid_for_all_points_and_cuts():
    cut_pyramid, total = (with_free_points(name) for name in ("pyramid_cut", "pyramid_sum"))
    for axis, a, b in zip("xyz", cut_pyramid.coordinates, total.coordinates, strict=True):
        assert a.symbols == {"p", "q", "r", "u", "v", "w", *(point + axis for point in "ABCD")}
        assert is_identically_zero(a - b)


def test_a_sum_with_other_correspondence_is_not_the_cut_pyramid():
    cut_pyramid = pc.read_template(template_paths()["pyramid_cut"]).M
    text = template_paths()["pyramid_sum"].read_text(encoding="utf-8")
    # the apex at w = 0 in both: the spec says that the identity then fails
    flipped = text.replace(
        "A*u*v*(1-w) + B*(1-v)*(1-w) + C*(1-u)*v*(1-w) + D*w",
        "A*u*v*w + B*(1-v)*w + C*(1-u)*v*w + D*(1-w)",
    )
    assert flipped != text
    total = parse_template(flipped, "flipped").M
    assert not any(
        is_identically_zero(a - b)
        for a, b in zip(cut_pyramid.coordinates, total.coordinates, strict=True)
    )


def test_w_up_to_t_is_the_cut_at_equal_shares():
    t = Fraction(1, 2)
    one = from_template("pyramid_truncated", "P1", t=t)
    two = from_template("pyramid_cut", "P1", p=1 - t, q=1 - t, r=1 - t)
    expected = figures("P1", 1 - t, 1 - t, 1 - t)
    for part in (one, two):
        assert_figures(part, expected.volume, sum(expected.areas.values()), expected.centroid)


def test_signed_volumes_add_up():
    whole, rest, off = (
        from_template(name, "P1", **values).report.solid.volume
        for name, values in (("pyramid", {}), ("pyramid_cut", CUT), ("pyramid_cut_off", CUT))
    )
    assert whole == pytest.approx(rest + off, rel=RELATIVE)
