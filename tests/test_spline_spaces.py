"""Spline spaces, held against SciPy's splines: sites, fits of curves one by one and together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from pc2cad.arrays import Array
from pc2cad.geometry.recognition.kinematic import free_motions, sweep_through
from pc2cad.geometry.splines.spline_basis import local_basis, local_basis_of_two
from pc2cad.geometry.splines.spline_space import SplineSpace

POINTS = np.array([0.0, 0.05, 0.2, 0.3, 0.42, 0.6, 0.61, 0.8, 0.93, 1.0])
SPACES = [
    SplineSpace(3, POINTS),
    SplineSpace(5, POINTS, [1, 1, 3, 1, 1, 5, 1, 1]),
    SplineSpace(7, POINTS, None, 1),
    SplineSpace(4, POINTS, [1, 2, 1, 1, 1, 1, 1, 1], 2),
    SplineSpace(11, POINTS),
    SplineSpace(5, np.linspace(0.0, 1.0, 101)),
    SplineSpace(5, np.linspace(0.0, 1.0, 101), None, 1),
]
each_space = pytest.mark.parametrize(
    "space", SPACES, ids=lambda s: f"{s.degree}-{s.size}-{s.seam or 'open'}"
)


@each_space
def test_curves_fitted_together_are_those_fitted_alone(space: SplineSpace) -> None:
    curves = np.random.default_rng(1).normal(size=(5, len(space.sites), 3))
    together = space.fit_each(curves)
    alone = np.stack([space.fit(curve) for curve in curves])
    assert np.array_equal(together, alone)


@each_space
def test_splines_of_a_space_are_fitted_as_they_are(space: SplineSpace) -> None:
    values = np.random.default_rng(2).normal(size=(len(space.sites), 2))
    spline = BSpline(space.knots, space.fit(values), space.degree)
    again = space.fit(spline(space.sites))
    assert np.abs(again - spline.c).max() < 1e-9 * np.abs(spline.c).max()
    found = space.check_basis @ spline.c
    assert np.abs(found - spline(space.check_places)).max() < 1e-12 * np.abs(spline.c).max()


@each_space
def test_sites_and_checks_are_in_their_intervals(space: SplineSpace) -> None:
    sites, (checks, starts) = space.sites, space.checks
    assert np.all(np.diff(sites) >= 0)
    assert sites[0] == 0
    assert sites[-1] == 1 or space.periodic
    assert np.array_equal(checks[starts], space.points[:-1])
    assert checks[-1] == 1


def test_two_bases_at_once_are_those_of_each() -> None:
    one, other = SPACES[0], SplineSpace(3, POINTS[[0, 2, 5, 9]], [2, 1])
    t, x = np.linspace(0.0, 1.0, 37), np.random.default_rng(3).uniform(size=50)
    found = local_basis_of_two(3, (one.knots, t), (other.knots, x))
    for (first, values), (knots, places) in zip(
        found, ((one.knots, t), (other.knots, x)), strict=True
    ):
        alone = local_basis(knots, 3, places)
        assert np.array_equal(first, alone[0])
        assert np.array_equal(values, alone[1])


@pytest.mark.parametrize(("bump", "count"), [(0.0, 2), (1e-4, None), (1e-7, None)])
def test_motions_that_a_bumpy_cylinder_has_not(bump: float, count: int | None) -> None:
    a, z = (x.ravel() for x in np.meshgrid(np.linspace(0, 2, 9), np.linspace(0, 1, 9)))
    r = 1 + bump * np.sin(5 * a + 3 * z**2)
    slope_a, slope_z = bump * 5 * np.cos(5 * a + 3 * z**2), bump * 6 * z * np.cos(5 * a + 3 * z**2)
    points = np.stack((r * np.cos(a), r * np.sin(a), z), axis=1)
    across = np.stack((np.cos(a), np.sin(a), 0 * a), axis=1)
    along = np.stack((-np.sin(a), np.cos(a), 0 * a), axis=1)
    normals = across - (slope_a / r)[:, None] * along
    normals[:, 2] -= slope_z
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    found = free_motions(points, normals)
    assert (None if found is None else len(found)) == count


def test_what_moves_along_a_helix_is_not_asked_for_its_border() -> None:
    def border() -> Array:
        raise AssertionError

    turning = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.3]])
    points = np.random.default_rng(2).normal(size=(20, 3))
    assert sweep_through(points, turning, border, 1e-9) is None
