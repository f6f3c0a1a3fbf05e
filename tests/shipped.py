"""The shipped templates as parameters of tests."""

from __future__ import annotations

import pytest

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
