"""Shipped parts that people bring, held against closed forms at more than their own values."""

from __future__ import annotations

import pytest

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
#: bounded, and so to 1e-7
FITTED = {"aspheric_lens": 1324.54724515318, "disc_cam": 16883.522122463994}


@pytest.mark.parametrize("name", VOLUMES)
def test_exact_parts_have_the_volume_of_their_closed_form(name: str) -> None:
    template, values, volume = VOLUMES[name]
    part = pc.compile_equation(pc.read_template(template_paths()[template]).bind(values))
    assert part.report.solid.volume == pytest.approx(volume, rel=1e-9)
    assert all(face.evidence == "exact" for face in part.report.faces)


@pytest.mark.parametrize("name", FITTED)
def test_fitted_parts_have_it_to_their_bound(name: str) -> None:
    part = pc.compile_equation(pc.read_template(template_paths()[name]).bind())
    assert part.report.solid.volume == pytest.approx(FITTED[name], rel=1e-7)
    assert all(face.evidence in ("exact", "bounded") for face in part.report.faces)


def test_the_lens_is_known_to_below_a_twentieth_of_a_wavelength() -> None:
    part = pc.compile_equation(pc.read_template(template_paths()["aspheric_lens"]).bind())
    assert 0 < part.report.deviation < 30e-6
