"""Needles, ridges and fronts far narrower than the places that anything is first looked at."""

from __future__ import annotations

from fractions import Fraction
from math import atan, erf, pi, sqrt

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.errors import ToleranceNotReachedError
from pc2cad.expression.narrow import narrow_limits
from pc2cad.expression.tree import symbol
from pc2cad.representation.tightening import DENSER, DENSEST, TRIES, UNSEEN, Aim, Attempt, tighten

U, V, W = pc.parameters()


def ridge(sharp):
    return pc.exp(-sharp * (U - 0.3711) ** 2), sqrt(pi / sharp) * (
        erf(0.3711 * sqrt(sharp)) + erf(0.6289 * sqrt(sharp))
    ) / 2


def lorentzian(sharp):
    slope = sqrt(sharp)
    return 1 / (1 + sharp * (U - 0.3711) ** 2), (
        atan(0.3711 * slope) + atan(0.6289 * slope)
    ) / slope


def front(sharp):
    return 0.3 * pc.tanh(sharp * (U - 0.3)), 0.3 * 0.4


def needle(sharp):
    return pc.exp(-sharp * ((U - 0.3711) ** 2 + (V - 0.6289) ** 2)), pi / sharp


def ridge_that_ends(sharp):
    return pc.exp(-sharp * (U - 0.3711) ** 2) * pc.sin(pc.pi * V), sqrt(pi / sharp) * 2 / pi


CASES = [(ridge, 1e4), (ridge, 1e6), (ridge, 1e8), (lorentzian, 1e6), (front, 1e3),
         (needle, 1e4), (ridge_that_ends, 1e6)]  # fmt: skip


@pytest.mark.parametrize(("feature", "sharp"), CASES)
def test_it_is_built_with_all_its_volume(feature, sharp):
    height, volume = feature(sharp)
    report = pc.compile_part((U, V, W * (1 + height))).report
    assert report.solid.volume == pytest.approx(1 + volume, rel=1e-9)
    assert report.equation.volume == pytest.approx(1 + volume, rel=1e-11)
    (spline,) = (face for face in report.faces if face.carrier == "B-spline surface")
    assert max(spline.deviation, spline.sampled) <= report.tolerance


def slanting_front(sharp):
    """A front that no line of the box follows: (u, v, w (1 + 0.3 tanh(k (u - 0.4 v - 0.3))))."""
    part = pc.compile_part((U, V, W * (1 + 0.3 * pc.tanh(sharp * (U - 0.4 * V - 0.3)))))
    # u - 0.4 v - 0.3 is spread evenly about 0 but for what is further away than 0.3
    assert part.report.solid.volume == pytest.approx(1, rel=1e-9)
    assert part.report.equation.volume == pytest.approx(1, rel=1e-9)
    return part.report


@pytest.mark.slow
def test_a_slanting_front():
    report = slanting_front(40)
    assert max(face.deviation for face in report.faces) <= report.tolerance
    # by quadrature elsewhere
    assert report.solid.area == pytest.approx(6.541894412014186, rel=1e-9)


def test_what_no_knots_can_hold_is_named_with_what_was_asked():
    with pytest.raises(ToleranceNotReachedError, match=r"4\.16e-08 .* near 0\.3711"):
        pc.compile_part((U, V, W * (1 + ridge(1e18)[0])))


# -- where functions change at short length --------------------------------------------------------

S = symbol("u")


def test_limits_come_close_to_a_needle_however_narrow():
    for sharp in (1e6, 1e10, 1e14):
        tree = pc.exp(-sharp * (S - 0.3711) ** 2)
        limits = narrow_limits((tree,), "u")
        assert 4 < len(limits) < 200
        assert np.abs(limits - 0.3711).min() < 2 / sqrt(sharp)
        assert narrow_limits((tree,), "v").size == 0


@pytest.mark.parametrize("tree", [pc.sin(300 * S), S**5, pc.exp(-3 * S), pc.sqrt(1 + S)])
def test_what_changes_everywhere_or_slowly_has_none(tree):
    assert narrow_limits((tree,), "u").size == 0


# -- the loop --------------------------------------------------------------------------------------


def test_what_a_fit_did_not_see_never_lowers_its_aim():
    aim, worst = Aim(1e-8), {(0, 1): 0.3711}
    first = aim.after(0.9, 1e-7, worst)
    assert (first.target, first.focus, first.density) == (1e-8, {(0, 1): (0.3711,)}, 1)
    second = first.after(0.9, 1e-7, {(0, 1): 0.8})
    assert (second.target, second.focus) == (1e-8, {(0, 1): (0.3711, 0.8)})
    assert 1 < second.density <= DENSEST
    little = aim.after(1.1e-7, 1e-7, worst)
    assert (little.target, little.focus) == (pytest.approx(0.8e-8 / 1.1), {})


def test_what_a_fit_saw_in_too_few_sections_lowers_its_aim_only_after_more():
    worst = {(0, 1): 0.3711}
    first = Aim(1e-8).after(1.6e-7, 4e-8, worst)
    assert (first.target, first.focus, first.density) == (1e-8, {}, DENSER)
    second = first.after(1.6e-7, 4e-8, worst)
    assert (second.target, second.density) == (pytest.approx(0.2e-8), DENSER)


def test_no_aim_is_ever_far_below_what_was_asked():
    aims = []

    def attempt(aim):
        aims.append(aim.target)
        return Attempt(None, 1.0, 1e-7, {(0, 1): 0.5}, lambda: "near u = 0.5")

    with pytest.raises(ToleranceNotReachedError, match=r"by 1 .* 1e-07 was asked, most near u"):
        tighten(attempt, 1e-8, "the faces deviate", 1e-7)
    assert len(aims) == TRIES
    assert min(np.divide(aims[1:], aims[:-1])) >= 1 / UNSEEN
    assert aims[:3] == [1e-8] * 3


def test_a_ridge_at_the_place_of_an_image_is_no_overlap():
    """Images at v = 0.3 lie outside of a mesh whose corners do not show the ridge."""
    sharp, place = 10**5, 0.3
    r = 1 + Fraction(96, 100) * pc.exp(-sharp * (V - Fraction(3, 10)) ** 2)
    report = pc.compile_part(
        (r * W * pc.cos(2 * pc.pi * U), r * W * pc.sin(2 * pc.pi * U), V)
    ).report
    assert report.injectivity == "proved"
    once, twice = (
        sqrt(pi / k) / 2 * (erf(sqrt(k) * place) + erf(sqrt(k) * (1 - place)))
        for k in (sharp, 2 * sharp)
    )
    volume = pi * (1 + 2 * 0.96 * once + 0.96**2 * twice)
    assert report.solid.volume == pytest.approx(volume, rel=1e-9)
