"""Shipped parts that people bring, held against closed forms at more than their own values."""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.special import ellipe
from shipped import part_of

import pc2cad as pc
from pc2cad.templates.shipped import template_paths

#: template -> values, and the volume found elsewhere
VOLUMES = {
    "dished_end of DIN 28011, its end alone": (
        "dished_end", {"D": 1000, "R": 1, "a": 0.1, "s": 0.01, "h": 0.035},
        10163234.5313691 + 3.141592653589793 * (510**2 - 500**2) * 35,
    ),
    "wigley_hull": ("wigley_hull", {}, 4 / 9 * 10 * 1 * 0.625),
    "naca_wing": ("naca_wing", {}, 4588608.96),
    "naca_wing without camber": ("naca_wing", {"m": 0, "sweep": 0}, 4588608.96),
}  # fmt: skip
#: Steiner: 12 (π (20² + 7·1.9²) - 5 · length + π 5²) less the bore; the trochoid's length is
#: 4 (a + b) E(m), a = 20, b = 7 · 1.9, m = 4ab/(a + b)²
GEROTOR = 12 * (
    math.pi * (20**2 + 7 * 1.9**2) - 5 * 4 * 33.3 * ellipe(4 * 20 * 13.3 / 33.3**2)
)  # its pins' and its bore's circles are equal
#: bounded, and so to 1e-7
FITTED = {
    "aspheric_lens": 1324.54724515318,
    "coil": 3015.928947447201,  # Pappus: 2π 3 turns, 4 × 2.5, mean radius 16
    "disc_cam": 16883.522122463994,
    "gear_tooth": 132.174175234791,
    "gerotor": GEROTOR,
}


@pytest.mark.parametrize("name", VOLUMES)
def test_exact_parts_have_the_volume_of_their_closed_form(name: str) -> None:
    template, values, volume = VOLUMES[name]
    equation = pc.read_template(template_paths()[template]).bind(values)
    part = pc.compile_equation(equation) if values else part_of(template)
    assert part.report.solid.volume == pytest.approx(volume, rel=1e-9)
    assert all(face.evidence == "exact" for face in part.report.faces)


@pytest.mark.parametrize("name", FITTED)
def test_fitted_parts_have_it_to_their_bound(name: str) -> None:
    part = part_of(name)
    assert part.report.solid.volume == pytest.approx(FITTED[name], rel=1e-7)
    assert all(face.evidence in ("exact", "bounded") for face in part.report.faces)


def test_the_lens_is_known_to_below_a_twentieth_of_a_wavelength() -> None:
    part = part_of("aspheric_lens")
    assert 0 < part.report.deviation < 30e-6


def test_a_helical_tooth_has_the_volume_of_a_spur_one() -> None:
    template = pc.read_template(template_paths()["gear_tooth"])
    part = pc.compile_equation(template.bind({"beta": 0.2617993877991494}))
    assert part.report.solid.volume == pytest.approx(FITTED["gear_tooth"], rel=1e-7)
    assert [face.evidence for face in part.report.faces].count("bounded") == 4


def test_the_ridge_of_a_metric_thread_has_its_volume() -> None:
    """ISO 68-1, M10 x 1.5, four turns: 5/8 of the triangle's height, rounded as tables have it."""
    u, v, w = pc.parameters()
    pitch, outer, turns = 1.5, 5, 4
    root = outer - 0.541266 * pitch
    r = root + (outer - root) * w
    half = pitch / 16 + (outer - r) / math.sqrt(3)
    angle = 2 * math.pi * turns * u
    along = turns * pitch * u + (2 * v - 1) * half
    part = pc.compile_part((r * pc.cos(angle), r * pc.sin(angle), along))
    assert part.report.solid.volume == pytest.approx(60.224384169784, rel=1e-7)
    assert all(face.evidence in ("exact", "bounded") for face in part.report.faces)


def tokamak() -> float:
    """2π R dR dZ over a D of elongation 1.7 and triangularity 0.35, by a rule that is exact."""
    t = np.arange(64) * math.pi / 32
    r, slope = 3 + np.cos(t + 0.35 * np.sin(t)), 1.7 * np.cos(t)
    return float(math.pi * (r * r * slope).mean() * 2 * math.pi)


def tower() -> float:
    """A wall of 0.3 outside a hyperbola, 120 high."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    throat = np.sqrt(25**2 + (0.4 * (60 * nodes - 25)) ** 2)
    return float(math.pi * 60 * weights @ ((throat + 0.3) ** 2 - throat**2))


def round_(r: pc.Expr, angle: pc.Expr, z: pc.Expr) -> tuple[pc.Expr, ...]:
    return r * pc.cos(angle), r * pc.sin(angle), z


def other_parts() -> dict[str, tuple[tuple[pc.Expr, ...], float]]:
    u, v, w = pc.parameters()
    turn, height = 2 * pc.pi * v, 120 * u - 85
    throat = pc.sqrt(25**2 + (0.4 * height) ** 2)
    around = turn + 0.35 * pc.sin(turn)
    chord, s = 300 * (1 - 0.6 * v), u * u
    half = 0.6 * (0.2969 * u - 0.126 * s - 0.3516 * s**2 + 0.2843 * s**3 - 0.1036 * s**4)
    wing = pc.point(chord * (s - 0.25), 1200 * v, chord * half * (2 * w - 1))
    return {
        "Archimedes' flight": (
            round_(10 + 40 * v, 6 * pc.pi * u, 90 * u + 3 * w), 3 * 3 * math.pi * (50**2 - 10**2),
        ),
        "cooling tower": (
            round_(throat + 0.3 * w, turn, height),
            tower(),
        ),
        "horn": (
            round_(5 * w * pc.exp(2 * u), turn, 80 * u), math.pi * 25 * 80 * (math.exp(4) - 1) / 4,
        ),
        "tokamak": (
            round_(3 + w * pc.cos(around), -2 * pc.pi * u, 1.7 * w * pc.sin(turn)), tokamak(),
        ),
        "wing with a twist": (
            tuple(pc.rotate(wing, pc.point(0, 0, 0), pc.vector(0, 1, 0), -0.1 * v).coordinates),
            4588608.96,
        ),
    }  # fmt: skip


@pytest.mark.parametrize("name", other_parts())
def test_other_parts_have_the_volume_of_their_closed_form(name: str) -> None:
    equation, volume = other_parts()[name]
    report = pc.compile_part(equation).report
    assert report.solid.volume == pytest.approx(volume, rel=1e-7)
    assert report.equation.volume == pytest.approx(volume, rel=1e-9)
    assert report.determinant == "proved"
    assert all(face.evidence in ("exact", "bounded") for face in report.faces)


BLADE = template_paths()["propeller_blade"]


def blade_volume(D: float, Z: int, EAR: float, edge: float) -> float:
    """Wrapping keeps areas: the integral of the sections' areas, of the tables' own splines."""
    tables = tomllib.loads(BLADE.read_text(encoding="utf-8"))["tables"]

    def number(value: str | float) -> float:
        a, _, b = str(value).partition(" - ")
        return float(a) - Z * float(b.partition("*")[0] or 0)

    def spline(name: str) -> CubicSpline:
        row = tables[name]
        return CubicSpline(row["at"], list(map(number, row["values"])), bc_type="natural")

    at, across = tables["back"]["at"]
    back = CubicSpline(across, tables["back"]["values"], axis=1, bc_type="natural")
    fore, aft = (
        CubicSpline(at, back.integrate(*ends), bc_type="natural") for ends in ((-1, 0), (0, 1))
    )
    joints = np.unique([r for r in (*at, *tables["long"]["at"], 0.95) if r <= 0.95])
    nodes, weights = np.polynomial.legendre.leggauss(9)
    r = (joints[:-1, None] + np.diff(joints)[:, None] * (nodes + 1) / 2).ravel()
    share = (np.diff(joints)[:, None] * weights / 2).ravel()
    front = spline("thickest")(r)
    full = (1 - edge) * (front * fore(r) + (1 - front) * aft(r)) + edge
    return float(D**3 * EAR / (2 * Z) * share @ (spline("long")(r) * spline("thick")(r) * full))


@pytest.mark.slow
def test_a_propeller_blade_of_tables_has_the_volume_of_its_sections() -> None:
    values = {"D": 1, "Z": 5, "EAR": 0.7, "edge": 0.2, "pitch": 1.2}
    part = pc.compile_equation(pc.read_template(BLADE).bind(values))
    assert part.report.solid.volume == pytest.approx(blade_volume(1, 5, 0.7, 0.2), rel=1e-9)
    assert all(face.evidence == "bounded" for face in part.report.faces)
    # det J, of hundreds of pieces, is a product by algebra
    assert part.report.determinant == "proved"
