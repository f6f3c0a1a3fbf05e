"""The shipped templates as parameters of tests."""

from __future__ import annotations

from functools import cache

import pytest

import pc2cad as pc
from pc2cad.checked import CheckedMap, check_map
from pc2cad.part import Part
from pc2cad.templates.shipped import bodies_paths, template_paths

#: with many faces or many poles, a second or more each: tests of every template leave them to the
#: slow ones
LONG = (
    "bellows", "duct", "figure_of_eight", "layered_pipe", "propeller_blade", "spring",
    "square_to_round", "stellarator_wall", "trefoil",
)  # fmt: skip

every_template = pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=name, marks=[pytest.mark.slow] if name in LONG else [])
        for name, path in template_paths().items()
    ],
)

#: a cube of edge 2 and one of edge 1, moved by d along x; t is the place of its lower face
CUBES = """
title = "Two cubes"
result = "{result}"
[parameters]
d = {{ default = 1, min = -10, max = 10 }}
[[bodies]]
name = "big"
[bodies.solid]
x = "2*u"
y = "2*v"
z = "2*w"
[[bodies]]
name = "small"
[bodies.solid]
x = "u + d"
y = "v + 1/2"
z = "w + 1/2"
"""


@cache
def checked_of(name: str) -> CheckedMap:
    """Return what is known of a shipped template's map, at its default values."""
    return check_map(pc.read_template(template_paths()[name]).bind())


@cache
def part_of(name: str) -> Part:
    """Compile a shipped template with its own values, once for all tests of a process."""
    path = (template_paths() | bodies_paths())[name]
    return pc.compile_equation(pc.read_template(path).bind())
