"""Fields as colours: over triangles of one equation and of several bodies, on the page too."""

from __future__ import annotations

import gzip
import json
from functools import cache

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.errors import InputError
from pc2cad.part import Part
from pc2cad.picture.bodies import shown_faces, shown_mesh
from pc2cad.picture.drawing import drawing
from pc2cad.picture.fields import on_faces, scalar_fields
from pc2cad.picture.style import Style
from pc2cad.templates.file import parse_template
from pc2cad.viewer.payload import payload

BODIES = """
title = "Two blocks"
result = "union(a, b)"
[[bodies]]
name = "a"
[bodies.solid]
x = "2*u"
y = "2*v"
z = "2*w"
[bodies.fields]
heat = "x*y"
[[bodies]]
name = "b"
[bodies.solid]
x = "u + 3/2"
y = "v + 1/2"
z = "w + 1/2"
[bodies.fields]
heat = "8 + z"
way = "vector(1, 0, 0)"
"""


@cache
def blocks() -> Part:
    return pc.compile_equation(parse_template(BODIES, "blocks").bind())


@cache
def tube() -> Part:
    equation = pc.read_template("hollow_cylinder").bind()
    return pc.compile_equation(equation.with_fields(heat="x*y + z", turn="u", flat="3"))


def test_fields_of_bodies_are_those_of_the_body_whose_face_it_is() -> None:
    part = blocks()
    faces = list(shown_faces(part, shown_mesh(part, 0.2)))
    seen = 0
    for face, values in on_faces(part, faces, ["heat"]):
        x, y, z = face.points.T
        exact = x * y if face.name.startswith("a:") else 8 + z
        np.testing.assert_allclose(values["heat"], exact, atol=2e-3)
        # between corners it is linear, as it is shown
        middles, corners = face.points[face.triangles].mean(axis=1), values["heat"][face.triangles]
        if face.name.startswith("a:"):
            gap = middles[:, 0] * middles[:, 1] - corners.mean(axis=1)
            assert np.abs(gap).max() < 0.02 * 4
        seen += 1
    assert seen == len(part.report.faces) > 10


def test_a_field_that_jumps_at_a_seam_is_on_one_side_in_each_triangle() -> None:
    part = tube()
    faces = list(shown_faces(part, shown_mesh(part, 0.2)))
    found = list(on_faces(part, faces, ["turn", "heat"]))
    spans = [np.ptp(values["turn"][face.triangles], axis=1).max() for face, values in found]
    assert len(spans) == 4
    assert max(spans) < 0.2
    for face, values in found:
        x, y, z = face.points.T
        np.testing.assert_allclose(values["heat"], x * y + z, atol=0.02 * np.abs(x * y).max())


def test_a_picture_of_bodies_has_the_scale_of_the_field() -> None:
    scene = drawing(blocks(), Style(field="heat"))
    assert scene.bar is not None
    assert (scene.bar.low, scene.bar.high) == pytest.approx((0, 9.5), abs=1e-2)
    assert all(len(surface.colour) == len(surface.points) for surface in scene.surfaces)
    with pytest.raises(InputError, match="the field way is a vector"):
        drawing(blocks(), Style(field="way"))
    with pytest.raises(InputError, match=r"no field 'cold' \(scalars are: heat\)"):
        drawing(blocks(), Style(field="cold"))


def test_the_page_offers_scalar_fields() -> None:
    raw = gzip.decompress(payload(tube()))
    length = int.from_bytes(raw[:4], "little")
    header = json.loads(raw[4 : 4 + length])
    assert scalar_fields(tube()) == ["heat", "turn", "flat"]
    heat, turn, flat = header["fields"]
    assert (turn["low"], turn["high"]) == pytest.approx((0, 1), abs=1e-3)
    assert flat["low"] == flat["high"] == 3
    assert heat["low"] < 0 < heat["high"]
    assert len(header["scale"]) == 256
    assert len(header["faces"]) == 4
    for face in header["faces"]:
        place = face["fields"]["turn"]
        start = 4 + length + place["at"]
        steps = np.frombuffer(raw[start : start + place["count"]], dtype=np.uint8)
        assert 3 * len(steps) == face["positions"]["count"]
        assert np.ptp(steps) > 200


def test_the_page_of_a_part_in_layers_has_its_outer_faces() -> None:
    template = parse_template(
        'title = "Block"\n[layers]\nlow = "1"\nhigh = "1/2"\n'
        '[solid]\nx = "2*u"\ny = "3*v"\nz = "depth(w)"\n',
        "block",
    )
    part = pc.compile_equation(template.bind())
    raw = gzip.decompress(payload(part))
    header = json.loads(raw[4 : 4 + int.from_bytes(raw[:4], "little")])
    names = [face["name"] for face in header["faces"]]
    assert names == [face.name for face in part.surface]
    assert len(part.report.faces) == len(names) + 1
