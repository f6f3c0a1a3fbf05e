"""Cells that are evaluated together have the points that each has alone, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from pc2cad.domain.analysis import analyse
from pc2cad.domain.looks import (
    MOST_CELLS,
    look_across_each,
    look_along,
    look_at_all,
    look_on_grids,
    tell_sides_points,
)
from pc2cad.domain.restrictions import ENDS, RestrictedMap
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


@pytest.mark.parametrize("name", ["channel_ellipse", "pyramid_cut", "stellarator_wall"])
@pytest.mark.parametrize("times", [1, MOST_CELLS])
def test_faces_in_one_row_or_on_grids(name: str, times: int) -> None:
    analysis = analyse(read_template(template_paths()[name]).bind({}))
    faces = [RestrictedMap(analysis, face.patch) for face in analysis.complex.faces] * times
    few, inside = np.array([0.1, 0.6, 0.7]), SECTIONS[::2]
    look_at_all(faces, (few, inside), [(RestrictedMap(analysis, (0, 0, 0)), ())])
    flat, curved = faces[:1], faces[1:]
    look_across_each((flat, few[:1]), (curved, few))
    alike = [face for face in faces if face.pieces == faces[0].pieces]
    look_on_grids(alike, (few, inside))
    assert len(faces) > 3
    for i, face in enumerate(faces):
        alone = RestrictedMap(analysis, face.cell)
        places = few[:1] if i == 0 else few
        rows = [(face(*local), alone(*local)) for local in ((few, few), (inside, inside))]
        rows += [
            (face(few, inside), alone(few, inside)),
            (face.normals(places, places), alone.normals(places, places)),
        ]
        for seen, own in rows:
            assert seen.shape == own.shape
            if analysis.map.is_alike_together:
                assert np.array_equal(seen, own)
            else:
                assert np.allclose(seen, own, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["channel_ellipse", "pyramid_cut", "stellarator_wall"])
def test_sides_have_the_points_of_their_faces(name: str) -> None:
    analysis = analyse(read_template(template_paths()[name]).bind({}))
    faces = [RestrictedMap(analysis, face.patch) for face in analysis.complex.faces]
    cells = [member.cell for edge in analysis.complex.edges for member in edge.members]
    sides = {cell: RestrictedMap(analysis, cell) for cell in cells}
    # edges follow from products of places that reach both limits
    whole, inner = np.array([0.0, 0.3, 0.7, 1.0]), np.array([0.2, 0.4])
    for face in faces:
        look_on_grids([face, face], (whole, SECTIONS), (inner, inner))
        for local in ((whole, SECTIONS), (inner, inner)):
            tell_sides_points(face, local, sides)
    told = [side for side in sides.values() if side.knows(whole) or side.knows(SECTIONS)]
    assert bool(told) is analysis.map.is_alike_together
    for cell, side in sides.items():
        assert not side.knows(inner)
        for places in (whole, SECTIONS):
            assert np.array_equal(side(places), RestrictedMap(analysis, cell)(places))
