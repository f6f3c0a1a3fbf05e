"""Rules over whole directions, and volumes and areas from evaluations that they share."""

from __future__ import annotations

from math import asinh, pi, sqrt

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.arrays.linear import areas, cross, lengths
from pc2cad.domain.analysis import analyse
from pc2cad.domain.jacobian_watch import JacobianWatch
from pc2cad.equation.point_equation import point_equation
from pc2cad.integrals.densities import Densities
from pc2cad.integrals.mass_properties import integrate
from pc2cad.integrals.rules import limits_of, narrowed
from pc2cad.integrals.spectral import even, lobatto, spread
from pc2cad.integrals.together import integrate_together

U, V, W = pc.parameters()
PI = pc.pi


def together(map_):
    analysis = analyse(point_equation(map_))
    centre = np.array([0.1, 0.2, 0.3])
    densities = Densities(analysis, centre, JacobianWatch(analysis.map))
    limits = narrowed(analysis, limits_of(analysis))
    return integrate_together(analysis, limits, densities.look, centre)


# -- rules -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [2, 3, 4, 7, 24, 96])
def test_a_rule_between_ends_is_exact_up_to_its_degree(count):
    rule = lobatto(count)
    assert (rule.nodes[0], rule.nodes[-1]) == (0.0, 1.0)
    assert (np.diff(rule.nodes) > 0).all()
    assert (rule.weights > 0).all()
    for degree in (0, 1, count - 1, 2 * count - 3):
        assert rule.nodes**degree @ rule.weights == pytest.approx(1 / (degree + 1), rel=2e-15)
    beyond = rule.nodes ** (2 * count - 2) @ rule.weights * (2 * count - 1) - 1
    assert count > 20 or abs(beyond) > 1e-12


@pytest.mark.parametrize("count", [7, 8])
def test_even_places_are_exact_for_fewer_waves_than_these(count):
    rule = even(count)
    waves = np.arange(1, count)[:, None]
    found = np.cos(2 * np.pi * waves * rule.nodes + 0.3) @ rule.weights
    assert found == pytest.approx(np.zeros(count - 1), abs=1e-15)


@pytest.mark.parametrize("rule", [lobatto(7), even(7), even(8)])
def test_functions_through_the_nodes_are_what_rules_are_made_for(rule):
    places = np.array([0.0, 0.137, float(rule.nodes[3]), 0.71, 1.0])
    table = rule.basis(places)

    def function(x):
        return 2 + np.cos(6 * np.pi * x + 0.4) if rule.round else 2 + x**6

    assert table @ function(rule.nodes) == pytest.approx(function(places), abs=1e-13)


def test_the_last_term_of_a_series_is_seen():
    line = spread(False)
    assert line.nodes @ line.weights == pytest.approx(0.5, rel=1e-15)
    chebyshev = np.cos(57 * np.arccos(2 * line.nodes - 1))
    assert line.last_term(1 + 1e-10 * chebyshev[None, None], 1e-13) == 57
    assert line.last_term(np.exp(line.nodes)[None], 1e-14) in range(10, 14)
    ring = spread(True)
    waves = 3 + 1e-10 * np.sin(2 * np.pi * 41 * ring.nodes)
    assert ring.last_term(waves[None], 1e-13) == 41
    assert ring.last_term(np.ones((2, len(ring.nodes))), 1e-13) == 0


# -- solids ----------------------------------------------------------------------------------------


def test_a_solid_without_ends_has_its_volume_centroid_and_areas():
    outward = 2 + W
    r = 5 + outward * pc.cos(2 * PI * V)
    found = together((r * pc.cos(2 * PI * U), r * pc.sin(2 * PI * U), outward * pc.sin(2 * PI * V)))
    volume, *moments = found.values
    assert abs(volume) == pytest.approx(2 * pi**2 * 5 * (9 - 4), rel=1e-14)
    # about the centre that was given
    assert np.divide(moments, volume) == pytest.approx([-0.1, -0.2, -0.3], rel=1e-13)
    areas = sorted(area for area, _ in found.areas.values())
    assert areas == pytest.approx([4 * pi**2 * 5 * r for r in (2, 3)], rel=1e-14)
    assert max(found.error, *(error for _, error in found.areas.values())) < 1e-13


def test_faces_that_are_not_flat_along_a_polynomial_are_left_to_panels():
    # a screw's thread: its sides are helicoids, no lengths of whose normals are polynomials
    turn, rise = 2, 0.7
    angle = 2 * PI * turn * U
    screw = ((1 + W) * pc.cos(angle), (1 + W) * pc.sin(angle), rise * U * 2 * turn + V / 2)
    found, whole = together(screw), integrate(analyse(point_equation(screw)))
    assert {patch for patch in found.areas if patch[1] != 1} == set()
    # ∫ sqrt(r² + c²) dr over the turns, c the rise per radian
    c = 2 * turn * rise / (2 * pi * turn)
    side = 2 * pi * turn * sum(
        s * (r * sqrt(r * r + c * c) + c * c * asinh(r / c)) / 2 for s, r in ((1, 2), (-1, 1))
    )  # fmt: skip
    volume = pi * turn * 3 / 2
    assert whole.volume == pytest.approx(volume, rel=1e-13)
    assert sorted(whole.face_areas)[-1] == pytest.approx(side, rel=1e-12)


BEYOND = {
    "a needle in a corner": (U, V, W * (1 + (U * V) ** 500)),
    "a bell": (U, V, W * (1 + pc.exp(-1000 * ((1 - U) ** 2 + (1 - V) ** 2)))),
    "a crease across both": (U, V, W * (1 + pc.sqrt((U - V) ** 2))),
    "many waves": (U, V, W * (2 + 0.1 * pc.sin(200 * PI * U))),
    "a root in a corner": (U, V, W * (1 + pc.sqrt(U + V))),
    "breaks": (U, V, W * (1 + pc.sqrt((U - 0.3) ** 2))),
}


@pytest.mark.parametrize("name", BEYOND)
def test_what_is_not_smooth_all_over_is_left_to_panels(name):
    assert together(BEYOND[name]) is None


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 1, 0)])
def test_a_solid_has_the_same_figures_whichever_direction_is_the_longest(order):
    # the longest direction is the last of arrays in memory
    parameters = [(U, V, W)[k] for k in order]
    u, v, w = parameters
    r, turn = 5 + (2 + w) * pc.cos(2 * PI * v), PI * u / 2
    found = together((r * pc.cos(turn), r * pc.sin(turn), (2 + w) * pc.sin(2 * PI * v)))
    volume, *moments = found.values
    assert abs(volume) == pytest.approx(pi**2 / 2 * 5 * (9 - 4), rel=1e-14)
    # the centroid of a quarter of a ring: ∬ r² over the section's area times 5, times 2/π
    section = 25 + (3**4 - 2**4) / (4 * (3**2 - 2**2))
    wanted = [section / 5 * 2 / pi - 0.1, section / 5 * 2 / pi - 0.2, -0.3]
    assert np.divide(moments, volume) == pytest.approx(wanted, rel=1e-13)
    areas = sorted(area for area, _ in found.areas.values())
    ends = [pi * (9 - 4)] * 2
    assert areas == pytest.approx(sorted([*ends, pi**2 * 5 * 2, pi**2 * 5 * 3]), rel=1e-13)


def test_areas_are_the_lengths_of_normals_to_the_last_bit():
    a, b = np.random.default_rng(7).normal(size=(2, 3, 50, 4)).transpose(0, 2, 3, 1)
    assert (areas(a, b) == lengths(cross(a, b))).all()
