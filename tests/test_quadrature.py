"""Panels: as many as the integrand asks for, and an error that is not understated."""

from __future__ import annotations

from itertools import pairwise
from math import atan, cosh, erf, hypot, pi, sqrt

import numpy as np
import pytest
from scipy.integrate import quad

import pc2cad as pc
from pc2cad.domain.analysis import analyse
from pc2cad.equation.point_equation import point_equation
from pc2cad.integrals.mass_properties import MassProperties, integrate
from pc2cad.integrals.quadrature import CONVERGED, Samples, resolve

U, V, W = pc.parameters()
PI = pc.pi


def integrated(map_) -> MassProperties:
    return integrate(analyse(point_equation(map_)))


def check(found: MassProperties, volume: float, area: float | None = None, claim: float = 1e-11):
    assert found.relative_error < claim
    slack = max(1e-14, 4 * found.relative_error)
    assert found.volume == pytest.approx(volume, rel=slack, abs=0)
    if area is not None:
        assert found.area == pytest.approx(area, rel=slack, abs=0)


def test_smooth_integrands_take_one_panel_and_few_nodes():
    def sample(t):
        return Samples(
            np.exp(t)[:, None, None] * np.ones((1, 3, 1)), np.exp(t)[:, None] * [1, 1, 1]
        )

    panels = resolve(sample, [0.0, 1.0], look=True)
    assert len(panels.orders) == 1
    assert panels.count <= 16
    nodes, weights = panels.rule()
    assert np.exp(nodes) @ weights == pytest.approx(np.e - 1, rel=10 * CONVERGED)


def step_length(k: float, height: float) -> float:
    """The length of y = height·tanh(k x) from -2 to 2."""

    def speed(x: float) -> float:
        return hypot(1, height * k / cosh(min(k * x, 300)) ** 2)

    corners = [0.0, *(c / k for c in (1, 3, 8, 20) if c / k < 2), 2.0]
    parts = (quad(speed, a, b, epsabs=1e-14, epsrel=1e-13)[0] for a, b in pairwise(corners))
    return 2 * sum(parts)


@pytest.mark.parametrize("k", [5, 50, 1000, 10**5])
def test_a_step_of_any_sharpness_is_integrated(k):
    x = 4 * U - 2
    found = integrated((x, pc.tanh(k * x) + V, W))
    check(found, 4.0, 10 + 2 * step_length(k, 1.0), claim=1e-10)


@pytest.mark.parametrize("k", [20, 1000])
def test_a_bend_of_any_sharpness_is_integrated(k):
    X = 4 * U - 2
    slope = 1 - pc.tanh(k * X) ** 2
    speed = pc.sqrt(1 + slope**2)
    r = 0.2 / k
    x, y = r * W * pc.cos(2 * PI * V), r * W * pc.sin(2 * PI * V)
    found = integrated((X - slope / speed * x, pc.tanh(k * X) / k + x / speed, y))
    length = step_length(k, 1 / k)
    check(found, pi * r * r * length, 2 * pi * r * length + 2 * pi * r * r)


@pytest.mark.parametrize("width", [0.1, 0.01, 1e-3, 1e-4])
@pytest.mark.parametrize("place", [0.5, 0.3141])
def test_a_narrow_bump_is_integrated(width, place):
    bump = 1 / (1 + ((U - place) / width) ** 2)
    exact = 2 + width / 2 * (atan((1 - place) / width) + atan(place / width))
    check(integrated((U, V, W * (2 + 0.5 * bump))), exact)


@pytest.mark.parametrize("waves", [7, 50, 150])
def test_waves_of_any_number_are_integrated(waves):
    def speed(t: float) -> float:
        return hypot(1, 0.2 * pi * waves * np.cos(2 * pi * waves * t))

    quarter = quad(speed, 0, 0.25 / waves, epsabs=1e-15, epsrel=1e-13)[0]
    found = integrated((U, V, W * (2 + 0.1 * pc.sin(2 * waves * PI * U))))
    check(found, 2.0, 1 + 4 + 4 + 4 * waves * quarter, claim=1e-8)


def test_values_that_vanish_are_no_reason_to_refuse():
    # exp(-2500) at the ends is 0 in double precision and no error
    bump = pc.exp(-(((U - 0.5) / 0.01) ** 2))
    check(integrated((U, V, W * (2 + 0.5 * bump))), 2 + 0.005 * sqrt(pi))


def test_what_is_not_resolved_is_not_claimed():
    # a corner singularity: no product rule is exact there, and the estimate says so
    found = integrated((U, V, W * (1 + pc.sqrt(U + V))))
    exact = 1 + 8 / 15 * (2 * sqrt(2) - 1)
    assert abs(found.volume / exact - 1) <= found.relative_error < 1e-5


def peak(a: float) -> float:
    """The integral of exp(-a (1-x)²) over [0, 1]."""
    return sqrt(pi / a) / 2 * erf(sqrt(a))


CORNERS = {
    "(uv)^50": ((U * V) ** 50, 1 / 51**2),
    "(uv)^500": ((U * V) ** 500, 1 / 501**2),
    "(uv)^900": ((U * V) ** 900, 1 / 901**2),
    "other corner": ((1 - U) ** 300 * V**200, 1 / 301 / 201),
    "bell in a corner": (pc.exp(-1000 * ((1 - U) ** 2 + (1 - V) ** 2)), peak(1000) ** 2),
    "sharp bell in a corner": (pc.exp(-1e5 * ((1 - U) ** 2 + (1 - V) ** 2)), peak(1e5) ** 2),
    "on an edge": (pc.exp(-1e4 * ((1 - U) ** 2 + (V - 0.5) ** 2)), peak(1e4) * sqrt(pi / 1e4)),
    "along an edge": (pc.exp(-1e4 * (1 - U) ** 2), peak(1e4)),
    "inside": (pc.exp(-1e4 * ((U - 0.31) ** 2 + (V - 0.62) ** 2)), pi / 1e4),
    "a corner of the box": ((U * V * W) ** 300, 1 / 301**2),
    "two corners": ((U * V) ** 400 + ((1 - U) * (1 - V)) ** 400, 2 / 401**2),
}


@pytest.mark.parametrize("name", CORNERS)
def test_what_stands_out_in_a_corner_is_integrated(name):
    bump, more = CORNERS[name]
    check(integrated((U, V, W * (1 + bump))), 1 + more, claim=1e-6)


@pytest.mark.parametrize("sharp", [300, 3000, 10**5])
def test_a_needle_that_stands_out_of_nothing_but_its_surroundings_is_integrated(sharp):
    # the waves are ten times as high: only where two rules differ is the needle seen
    needle = pc.exp(-sharp * ((U - 0.3711) ** 2 + (V - 0.6289) ** 2))
    waves = pc.cos(2 * PI * U) * pc.cos(2 * PI * V)
    k = sqrt(sharp)
    ways = [sqrt(pi) / (2 * k) * (erf(k * x) + erf(k * (1 - x))) for x in (0.3711, 0.6289)]
    check(integrated((U, V, W * (4 + waves + 0.1 * needle))), 4 + 0.1 * ways[0] * ways[1])


@pytest.mark.parametrize("sharp", [1000, 10**5])
def test_a_needle_that_moves_the_centroid_alone_is_integrated(sharp):
    # both ends of w rise by as much: det J is 1 all over
    needle = pc.exp(-sharp * ((U - 0.3711) ** 2 + (V - 0.6289) ** 2))
    found = integrated((U, V, W + needle))
    assert found.volume == pytest.approx(1, rel=1e-13)
    rise = pi / sharp
    assert found.centroid == pytest.approx((0.5, 0.5, 0.5 + rise), rel=1e-11)
