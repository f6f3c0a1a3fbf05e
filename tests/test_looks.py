"""Cells that are evaluated together have the points that each has alone, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from pc2cad.domain.analysis import analyse
from pc2cad.domain.restrictions import ENDS, MOST_CELLS, RestrictedMap, look_along
from pc2cad.domain.sections import SECTIONS
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import template_paths


@pytest.mark.parametrize("name", ["channel_ellipse", "pyramid_cut", "stellarator_wall"])
@pytest.mark.parametrize("times", [1, MOST_CELLS])
def test_edges_and_corners_in_one_row(name: str, times: int) -> None:
    analysis = analyse(read_template(template_paths()[name]).bind({}))
    complex_ = analysis.complex
    edges = [edge.cell for edge in complex_.edges] * times
    corners = [vertex.corners[0] for vertex in complex_.vertices]
    inside = SECTIONS[::2]
    asked = [
        (RestrictedMap(analysis, cell), (ENDS,) if i % 3 == 0 else (inside, ENDS))
        for i, cell in enumerate(edges)
    ]
    ends = [(RestrictedMap(analysis, corner), ()) for corner in corners]
    look_along([*asked, *ends])
    assert len(asked) > 0
    assert len(ends) > 0
    for cell, arrays in [*asked, *ends]:
        alone = RestrictedMap(analysis, cell.cell)
        for local in [(places,) for places in arrays] or [()]:
            seen = cell(*local)
            assert seen.shape == (*(len(x) for x in local), 3)
            if analysis.map.is_alike_together:
                assert np.array_equal(seen, alone(*local))
            else:
                assert np.allclose(seen, alone(*local), rtol=1e-13, atol=1e-13)
