"""Roots of functions that vanish inside the box: M is taken in parts there."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import asin, pi

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.expression.inner_roots import inner_roots
from pc2cad.expression.tree import Expr

u, v, w = pc.parameters()
THIRD = Fraction(1, 3)

#: what holds roots, and the places along u, v and w at which they vanish inside
PLACES: dict[str, tuple[Expr, tuple[list[float], ...]]] = {
    "one place": (pc.sqrt(abs(u - THIRD)), ([1 / 3], [], [])),
    "a factor of others": (pc.sqrt(w * (1 - w) * abs(u - THIRD) * v), ([1 / 3], [], [])),
    "two directions": (pc.sqrt(abs(u - THIRD)) + abs(v - Fraction(1, 4)) ** THIRD,
                       ([1 / 3], [1 / 4], [])),
    "no fraction": (pc.sqrt(abs(pc.sin(3 * u) - THIRD)),
                    ([asin(1 / 3) / 3, (pi - asin(1 / 3)) / 3], [], [])),
    "a double zero": (pc.sqrt(1 - pc.cos(4 * pc.pi * v)), ([], [0.5], [])),
    "an arc": (pc.acos(1 - (u - Fraction(3, 10)) ** 2), ([0.3], [], [])),
    "on a side alone": (pc.sqrt(1 - w * pc.sin(pc.pi * u)), ([0.5], [], [])),
    "from there on": (pc.sqrt(pc.maximum(0, u - Fraction(1, 2))), ([0.5], [], [])),
    "nearly": (pc.sqrt(Fraction(1, 10**9) + (u - THIRD) ** 2), ([], [], [])),
    "at the ends": (pc.sqrt(u * (1 - u)) + pc.sqrt(pc.sin(pc.pi * v)), ([], [], [])),
    "along a curve": (pc.sqrt((u - v) ** 2 + w), ([], [], [])),
}  # fmt: skip


@pytest.mark.parametrize("name", PLACES)
def test_places_at_which_roots_vanish(name: str) -> None:
    tree, expected = PLACES[name]
    found = inner_roots((tree,))
    assert [len(row) for row in found] == [len(row) for row in expected]
    for row, places in zip(found, expected, strict=True):
        np.testing.assert_allclose(np.array(row, dtype=float), places, atol=1e-15)


def power(exponent: float, at: float) -> float:
    """Return the integral of |t - at|^exponent over [0, 1]."""
    return (at ** (exponent + 1) + (1 - at) ** (exponent + 1)) / (exponent + 1)


def signed(exponent: float, at: float) -> float:
    return ((1 - at) ** (exponent + 1) - at ** (exponent + 1)) / (exponent + 1)


SOLIDS = {
    "root": ((u, v, w * (1 + pc.sqrt(abs(u - THIRD)))), 1 + power(0.5, 1 / 3)),
    "cube root": ((u, v, w * (2 + pc.sign(u - THIRD) * abs(u - THIRD) ** THIRD)),
                  2 + signed(1 / 3, 1 / 3)),
    "from there on": ((u, v, w * (1 + pc.sqrt(pc.maximum(0, u - Fraction(1, 2))))),
                      1 + 0.5**1.5 / 1.5),
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [n if n == "cube root" else pytest.param(n, marks=pytest.mark.slow) for n in SOLIDS]
)
def test_blocks_with_such_roots_are_exact(name: str) -> None:
    equation, volume = SOLIDS[name]
    report = pc.compile_part(equation).report
    assert report.evidence == "exact"
    # faces that meet in a cusp are compared with one another by samples
    assert name == "root" or report.injectivity == "proved"
    assert report.solid.volume == pytest.approx(volume, rel=1e-12)


@pytest.mark.slow
def test_a_root_at_places_that_are_no_fractions_is_bounded() -> None:
    height = 1 + pc.sqrt(abs(pc.sin(3 * u) - THIRD))
    report = pc.compile_part((u, v, w * height)).report
    assert report.evidence == "bounded"
    ends = [0.0, asin(1 / 3) / 3, (pi - asin(1 / 3)) / 3, 1.0]
    nodes, weights = np.polynomial.legendre.leggauss(80)
    volume = 1.0
    for low, high in pairwise(ends):
        # slow at both ends
        share = (1 + np.sin(nodes * pi / 2)) / 2
        at = low + (high - low) * share
        slow = weights * np.cos(nodes * pi / 2) * pi / 4 * (high - low)
        volume += float(slow @ np.sqrt(np.abs(np.sin(3 * at) - 1 / 3)))
    assert report.solid.volume == pytest.approx(volume, rel=2e-8)
