"""Meshes of several bodies: a set per region and side, and what bodies share is one."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from shipped import CUBES

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.mesh.joined import SidesNotSharedError
from pc2cad.part import Part
from pc2cad.templates.file import parse_template

#: a quarter of a pipe's wall and a block at its end, turned round: v and w exchanged
BENT = """
title = "bent"
result = "union(pipe, block)"
[[bodies]]
name = "pipe"
[bodies.solid]
M = "[(2 + w)*cos(pi/2*u), (2 + w)*sin(pi/2*u), 3*v]"
[[bodies]]
name = "block"
[bodies.solid]
M = "[3 - v, -4*w, 3*u]"
"""


def cubes(result: str, d: float) -> Part:
    return pc.compile_equation(parse_template(CUBES.format(result=result), "c").bind({"d": d}))


def bent() -> Part:
    return pc.compile_equation(parse_template(BENT, "bent").bind())


@pytest.mark.interop
@pytest.mark.parametrize("order", [1, 2])
def test_regions_share_their_faces(order):
    mesh = cubes("union(big, small)", 1.5).mesh(shape="tetrahedra", size=0.5, order=order)
    assert mesh.volume() == pytest.approx(8.5, rel=1e-12)
    assert list(mesh.layers) == ["big", "big & small", "small"]
    assert {n for n in mesh.node_sets if n not in mesh.sides} == {
        "big | big & small", "big & small | small"
    }  # fmt: skip
    held = {n: set(np.unique(mesh.blocks["tetra"][rows["tetra"]])) for n, rows in
            mesh.layers.items()}  # fmt: skip
    # what two regions have in common is what lies on the faces between them, node by node
    assert held["big"] & held["big & small"] == set(mesh.node_sets["big | big & small"])
    assert held["small"] & held["big & small"] == set(mesh.node_sets["big & small | small"])
    assert np.allclose(mesh.points[list(mesh.node_sets["big & small | small"])][:, 0], 2)
    assert mesh.area("big:u=1") == pytest.approx(3)
    assert mesh.area("small:v=0") == pytest.approx(0.5)


@pytest.mark.interop
def test_what_is_cut_away_has_no_elements():
    mesh = cubes("cut(big, small)", 1.5).mesh(shape="tetrahedra", size=0.5)
    assert list(mesh.layers) == ["big"]
    assert mesh.volume() == pytest.approx(7.5, rel=1e-12)
    assert mesh.area("small:u=0") == pytest.approx(1)


@pytest.mark.interop
def test_copies_are_regions_of_their_own():
    text = CUBES.format(result="union(big, linear(small, 2, vector(-3, 0, 0)))")
    part = pc.compile_equation(parse_template(text, "c").bind({"d": 2}))
    mesh = part.mesh(shape="tetrahedra", size=0.7)
    assert set(mesh.layers) == {"big", "small[0]", "small[1]"}
    assert mesh.volume() == pytest.approx(10, rel=1e-12)
    assert mesh.area("small[1]:u=0") == pytest.approx(1)


@pytest.mark.parametrize("order", [1, 2])
def test_hexahedra_of_bodies_that_share_a_side_are_one_mesh(order):
    part = bent()
    mesh = part.mesh(size=0.5, order=order)
    assert set(mesh.blocks) == {"hexahedron"}
    assert list(mesh.layers) == ["pipe", "block"]
    # the arc is a polygon, or of parabolas: the wall's outer side has as many chords as w = 1
    rows = len(np.unique(np.round(mesh.points[mesh.node_sets["pipe:w=1"]][:, 2], 9)))
    step = pi / 2 / (len(mesh.node_sets["pipe:w=1"]) / rows - 1)
    short = np.sin(step) / step if order == 1 else 1
    assert mesh.volume() == pytest.approx(12 + 15 / 4 * pi * short, rel=(0, 1e-12, 1e-5)[order])
    between = mesh.node_sets["pipe | block"]
    corners = mesh.points[between]
    assert np.allclose(corners[:, 1], 0, atol=1e-12)
    steps = [len(np.unique(np.round(corners[:, d], 9))) for d in (0, 2)]
    assert len(between) >= 9
    assert order == 2 or len(between) == steps[0] * steps[1]
    held = [set(np.unique(mesh.blocks["hexahedron"][rows["hexahedron"]])) for rows in
            mesh.layers.values()]  # fmt: skip
    assert held[0] & held[1] == set(between)
    assert "pipe:u=0" not in mesh.sides
    assert "block:w=0" not in mesh.sides
    assert mesh.area("block:w=1") == pytest.approx(3)
    assert len(mesh.sides) == 10


def test_bodies_that_share_no_whole_side_have_no_hexahedra(tmp_path, capsys):
    with pytest.raises(SidesNotSharedError, match=r"shares none.*take tetrahedra"):
        cubes("union(big, small)", 2).mesh(size=0.5)
    path = tmp_path / "bent.toml"
    path.write_text(BENT)
    assert main(["mesh", str(path), "--size", "1", "-o", str(tmp_path / "b.inp")]) == 0
    said = capsys.readouterr().out
    assert "pipe" in said
    assert "block:w=1" in said
    text = (tmp_path / "b.inp").read_text()
    assert text.upper().count("*ELSET") >= 2
