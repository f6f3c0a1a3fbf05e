"""The shipped templates as parameters of tests."""

from __future__ import annotations

from functools import cache

import pytest

from pc2cad.checked import CheckedMap, check_map
from pc2cad.equation.template_file import read_template
from pc2cad.library import template_paths

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
    return check_map(read_template(template_paths()[name]).bind({}))
