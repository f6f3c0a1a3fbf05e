"""Areas of plane faces that are polynomials, against what they are by hand."""

from __future__ import annotations

import numpy as np
import pytest
from shipped import checked_of

import pc2cad as pc
from pc2cad.domain.analysis import analyse
from pc2cad.equation.point_equation import point_equation
from pc2cad.integrals.flat_faces import flat_areas

U, V, W = pc.parameters()


def areas(x: object, y: object, z: object) -> list[float]:
    analysis = analyse(point_equation((x, y, z)))
    return sorted(flat_areas(analysis, [face.patch for face in analysis.complex.faces]).values())


def test_a_block_has_six() -> None:
    assert areas(2 * U, 3 * V, 5 * W) == pytest.approx([6, 6, 10, 10, 15, 15], rel=1e-15)


def test_a_face_that_bends_or_is_no_polynomial_has_none() -> None:
    # the top is a saddle, and its area is not the length of its vector area
    assert len(areas(U, V, W * (1 + U * V))) == 5
    # the sides of a ring bend, and its ends are no polynomials: two walls are left
    turned = areas((1 + U) * pc.cos(V), (1 + U) * pc.sin(V), W)
    assert turned == pytest.approx([1, 1], rel=1e-15)


def test_speeds_along_a_face_do_not_matter() -> None:
    uneven = areas(2 * U * (1 + U) / 2, 3 * V**2 * (1 + V) / 2 + V, 5 * W)
    assert uneven == pytest.approx(sorted([8, 8, 10, 10, 20, 20]), rel=1e-14)


def test_all_straight_walls_of_a_duct_have_one() -> None:
    checked = checked_of("duct")
    analysis = checked.analysis
    patches = [face.patch for face in analysis.complex.faces]
    found = flat_areas(analysis, patches)
    # eleven straight pieces with eight walls each, and the two ends of four
    assert len(patches) == 176
    assert len(found) == 96
    every = np.array([checked.mass.face_areas[patches.index(patch)] for patch in found])
    assert np.array(list(found.values())) == pytest.approx(every, rel=1e-15)
    # lengths 16, 12 (nine times) and 16, and perimeters of 12 outside and 8.8 inside
    assert every.sum() == pytest.approx((16 * 2 + 12 * 9) * (12 + 8.8) + 2 * (8 - 3.2 * 1.2))
