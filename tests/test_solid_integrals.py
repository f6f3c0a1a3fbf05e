"""The solid's own integrals, taken from the kernel's surfaces, where rules of even spans miss."""

from __future__ import annotations

from math import exp, log, sqrt

import numpy as np
import pytest

import pc2cad as pc

U, V, W = pc.parameters()


def turning_bar(speed: float, turn: float):
    """A square bar of 5 that turns `turn` radians while its rise grows exp(speed)-fold."""
    rise = 5 * (pc.exp(speed * U) - 1) / (pc.e**speed - 1)
    c, s = pc.cos(turn * U), pc.sin(turn * U)
    a, b = V - 0.5, W - 0.5
    return a * c - b * s, a * s + b * c, rise


def turning_bar_area(speed: float, turn: float) -> float:
    """Four faces ∬ sqrt(rise'² + turn² a²) da du, in closed form over a, and the two ends."""
    x, weight = np.polynomial.legendre.leggauss(200)
    total = 0.0
    for u, w in zip((x + 1) / 2, weight / 2, strict=True):
        rise = 5 * speed * exp(speed * u) / (exp(speed) - 1)
        r, h = rise / turn, 0.5
        root = sqrt(r * r + h * h)
        total += w * turn * (h * root + r * r * log((h + root) / r))
    return 2 + 4 * total


@pytest.mark.parametrize(("speed", "turn"), [(6, 6), (8, 12), (10, 12)])
def test_faces_that_are_nearly_creased(speed, turn):
    """Along its middle line a face turns over within 2e-4 of its width: a rule of one span sees
    an area that is off by 6e-6 there."""
    report = pc.compile_part(turning_bar(speed, turn)).report
    area = turning_bar_area(speed, turn)
    assert report.equation.area == pytest.approx(area, rel=1e-10)
    assert report.solid.area == pytest.approx(area, rel=1e-7)
    assert report.solid.volume == pytest.approx(5, rel=1e-7)
