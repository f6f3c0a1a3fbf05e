"""Integrals in closed form, and those of triangles, against exact values."""

from __future__ import annotations

import json
from fractions import Fraction
from math import sqrt

import numpy as np
import pytest

from pc2cad.brep.triangle_integrals import triangle_integrals
from pc2cad.cli.main import main
from pc2cad.compiler import compile_equation
from pc2cad.domain.analysis import analyse
from pc2cad.integrals.exact import ExactIntegrals, exact_integrals
from pc2cad.integrals.mass_properties import (
    CLOSED_FORM,
    CLOSED_FORM_BUT_AREA,
    QUADRATURE,
    integrate,
)
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import find_template


def _exact(name: str, **settings: object) -> ExactIntegrals | None:
    return exact_integrals(analyse(read_template(find_template(name)).bind(settings)))


@pytest.mark.parametrize(
    ("name", "volume", "centroid"),
    [
        ("oblique_prism", "30", ("13/6", "3/2", "5/2")),
        ("parallelepiped", "24", ("5/2", "3/2", "2")),
        ("bilinear_top", "9", ("28/27", "28/27", "92/81")),
        ("hypar_slab", "1/2", ("1/2", "1/2", "1/2")),
        ("pyramid", "63/2", ("1", "5/4", "7/4")),
        ("pyramid_cut", "1827/64", ("473/464", "151/116", "713/464")),
        ("pyramid_truncated", "441/16", ("1", "71/56", "81/56")),
        ("pyramid_cut_off", "189/64", ("13/16", "3/4", "61/16")),
    ],
)
def test_volume_and_centroid_are_the_fractions(
    name: str, volume: str, centroid: tuple[str, str, str]
) -> None:
    found = _exact(name)
    assert found is not None
    assert found.volume == Fraction(volume)
    assert found.centroid == tuple(Fraction(c) for c in centroid)


def test_triquadratic_volume_is_the_fraction() -> None:
    found = _exact("triquadratic_cube")
    assert found is not None
    assert found.volume == Fraction(58759, 56250)
    # five plane sides, although their parameters run unevenly; the one that bulges has none
    assert sorted(a is None for a in found.face_areas) == [False] * 5 + [True]


def test_plane_areas_are_roots_of_fractions() -> None:
    found = _exact("pyramid")
    assert found is not None
    areas = sorted(a for a in found.face_areas if a is not None)
    truth = (5 * sqrt(61) / 2, 11 * sqrt(10) / 2, 3 * sqrt(157) / 2, sqrt(1126) / 2)
    assert areas == pytest.approx(sorted(truth), rel=2e-16)


def test_the_properties_say_where_they_come_from() -> None:
    for name, source in (
        ("pyramid", CLOSED_FORM), ("bilinear_top", CLOSED_FORM_BUT_AREA), ("ball", QUADRATURE),
    ):  # fmt: skip
        properties = integrate(analyse(read_template(find_template(name)).bind({})))
        assert properties.source == source
        assert (properties.relative_error == 0) == (source == CLOSED_FORM)
    assert properties.volume == pytest.approx(32 * np.pi / 3, rel=1e-13)


def test_what_is_not_rational_is_left_to_quadrature() -> None:
    assert _exact("channel_ellipse") is None
    assert _exact("cone") is None


def test_triangles_of_a_tetrahedron() -> None:
    shift = np.array([1000.0, -2000.0, 500.0])
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]]) + shift
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    found = triangle_integrals(points, faces)
    assert found.volume == pytest.approx(1, rel=1e-12)
    assert found.area == pytest.approx(1 + 1.5 + 3 + 3.5, rel=1e-12)
    assert found.centroid == pytest.approx(shift + np.array([0.25, 0.5, 0.75]), rel=1e-14)


def test_triangles_of_a_part_come_near_and_follow_the_deflection() -> None:
    part = compile_equation(read_template(find_template("ball")).bind({}))
    truth = part.report.equation
    coarse, fine = (part.triangle_integrals(d) for d in (0.1, 0.002))
    for found in (coarse, fine):
        assert found.volume < truth.volume
        assert found.area < truth.area
    gap = 1 - fine.volume / truth.volume
    assert gap < 2e-3
    assert gap < 0.2 * (1 - coarse.volume / truth.volume)
    assert part.report.triangles is None


def test_check_shows_equation_brep_and_triangles(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "pyramid", "--triangles"]) == 0
    out = capsys.readouterr().out
    (volume,) = (line for line in out.splitlines() if line.strip().startswith("volume"))
    assert volume.split()[1:3] == ["31.5", "31.5"]
    assert volume.split()[4] == "31.5"
    assert "closed form over the rationals" in out
    assert main(["check", "pyramid", "--triangles", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["triangles"]["volume"] == pytest.approx(31.5, rel=1e-12)
    assert main(["check", "pyramid", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["triangles"] is None
