"""Plane faces that all others are on one side of: the answer of the long way, sooner."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pc2cad import compile_equation, read_template
from pc2cad.representation.embedding import _compared, _convex

CONVEX = ["oblique_prism", "parallelepiped", "pyramid_cut", "pyramid_cut_off", "quad_pyramid"]


def model_of(name):
    body = compile_equation(read_template(name).bind({})).body
    return body.checked.analysis, body.model


@pytest.mark.parametrize("name", CONVEX)
def test_it_is_the_answer_of_the_comparison_of_all_with_all(name):
    analysis, model = model_of(name)
    asked = []
    found = _convex(analysis, model)
    assert found is not None
    assert found == _compared(analysis, model, lambda: asked.append(1))
    assert not asked


@pytest.mark.parametrize("share", [1.0, 1.0 - 1e-11, 1.5])
def test_no_answer_where_a_corner_is_on_the_plane_of_another_face_or_beyond(share):
    analysis, model = model_of("parallelepiped")
    plane, start = model.faces[0].carrier, model.vertices
    heights = (start - plane.origin) @ plane.normal
    moved = start.copy()
    far = int(np.abs(heights).argmax())
    moved[far] -= share * heights[far] * plane.normal
    assert _convex(analysis, model) is not None
    assert _convex(analysis, replace(model, vertices=moved)) is None


def test_no_answer_where_two_corners_are_shared_that_no_common_edge_joins():
    analysis, model = model_of("parallelepiped")
    face = model.faces[0]
    ((first, *others),) = face.wires
    cut = replace(face, wires=((*others,),))
    assert _convex(analysis, replace(model, faces=(cut, *model.faces[1:]))) is None
    assert first not in cut.wires[0]


def test_no_answer_for_curved_faces():
    for name in ("cone_frustum", "layered_pipe"):
        assert _convex(*model_of(name)) is None
