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
LONG = ("duct", "figure_of_eight", "layered_pipe", "spring", "square_to_round", "trefoil")

every_template = pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=name, marks=[pytest.mark.slow] if name in LONG else [])
        for name, path in template_paths().items()
    ],
)


@cache
def checked_of(name: str) -> CheckedMap:
    """Return what is known of a shipped template's map, at its default values."""
    return check_map(pc.read_template(template_paths()[name]).bind())


@cache
def part_of(name: str) -> Part:
    """Compile a shipped template with its own values, once for all tests of a process."""
    path = (template_paths() | bodies_paths())[name]
    return pc.compile_equation(pc.read_template(path).bind())
