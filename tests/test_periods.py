"""Directions that come round: told by their trees where these turn by whole turns alone."""

from __future__ import annotations

import pytest

from pc2cad.checked import check_map
from pc2cad.domain.periods import is_periodic, turns_whole
from pc2cad.expression.tree import PI, Expr, call, number, symbol
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import template_paths

U, V = symbol("u"), symbol("v")
TURN = number(2) * PI


@pytest.mark.parametrize(
    ("tree", "whole"),
    [
        (call("cos", TURN * V) * U, True),
        (call("sqrt", number(2) + call("sin", number(3) * TURN * V + U)), True),
        (U, True),
        (call("cos", PI * V), False),
        (call("cos", PI * V) ** 2, False),  # though it has that period
        (call("cos", TURN * V) + V, False),
        (call("cos", TURN * V * U), False),
        (call("cos", number(6.283185307179586) * V), False),
    ],
)
def test_what_turns_by_whole_turns_alone(tree: Expr, whole: bool) -> None:
    assert turns_whole((tree, U), "v") is whole


@pytest.mark.parametrize(
    ("name", "periodic"),
    [
        ("torus", [True, True, False]),
        ("channel_ellipse", [False, True, False]),
        ("pyramid_cut", [False, False, False]),
    ],
)
def test_directions_of_solids(name: str, periodic: list[bool]) -> None:
    analysis = check_map(read_template(template_paths()[name]).bind({})).analysis
    assert [is_periodic(analysis, d) for d in range(3)] == periodic
