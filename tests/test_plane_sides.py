"""Edges that are told by the plane faces they bound are what their own trees say."""

from __future__ import annotations

import pytest
from shipped import checked_of

import pc2cad as pc
from pc2cad.checked import CheckedMap, check_map
from pc2cad.equation.point_equation import point_equation
from pc2cad.geometry.splines.bernstein import degree_in
from pc2cad.geometry.splines.spline_profile import SplineProfile
from pc2cad.representation.parametrisation import FaceDirection
from pc2cad.representation.plan import Cells

U, V, W = pc.parameters()


def told(checked: CheckedMap) -> int:
    """Return how many edges are told, each of which is compared with its trees."""
    edges = [edge for edge in Cells(checked, SplineProfile()).edges if edge.degrees]
    for edge in edges:
        assert edge.degrees == {0: None}
        trees, (name,) = edge.trees
        assert degree_in(trees, name) is None
        wave = edge.waves.pop(0)
        assert FaceDirection(edge, 0).wave == wave
    return len(edges)


@pytest.mark.parametrize(
    ("name", "count"),
    [("channel_ellipse", 4), ("helical_channel", 4), ("naca_wing", 0), ("pyramid_cut", 0)],
)
def test_edges_of_templates(name: str, count: int) -> None:
    assert told(checked_of(name)) == count


def test_a_side_where_a_term_vanishes_is_asked_itself() -> None:
    """Both ends have three straight sides, and one that is no polynomial."""
    assert told(check_map(point_equation((V, W * (1 + 1 / (1 + V)) + V, 3 * U + U**3)))) == 2


def test_waves_that_cancel_at_a_limit_are_told_without_them() -> None:
    x = pc.cos(pc.pi * V) + W * pc.cos(pc.pi * V), 2 * W * pc.sin(pc.pi * V)
    assert told(check_map(point_equation((*x, U**2 + 3 * U)))) == 4
