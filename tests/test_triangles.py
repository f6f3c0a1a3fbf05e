"""Triangles that cover every face, with the volume and the area that their chords leave them."""

from __future__ import annotations

import math
import struct
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import pc2cad.brep.triangles as meshing
from pc2cad.brep.triangle_integrals import triangle_integrals
from pc2cad.compiler import compile_equation
from pc2cad.errors import KernelError
from pc2cad.export.model import ExportOptions
from pc2cad.export.surface import surface
from pc2cad.part import Part
from pc2cad.templates.file import parse_template, read_template
from pc2cad.templates.shipped import find_template

#: a ring between two tori (Hopf coordinates, projected) whose section turns on the way round
HOPF = """
title = "Hopf"
[let]
a = "2*pi*u"
f = "2*pi*v + {turns}*2*pi*u"
k = "0.15 + {wall}*w"
x = "cos(k)*cos(a)"
y = "cos(k)*sin(a)"
z = "sin(k)*cos(f)"
q = "sin(k)*sin(f)"
[solid]
x = "{size}*x/(1 - q)"
y = "{size}*y/(1 - q)"
z = "{size}*z/(1 - q)"
"""


@cache
def hopf(turns: int = 1, wall: float = 0.3, size: float = 1.0) -> Part:
    text = HOPF.format(turns=turns, wall=wall, size=f"{size:.10f}")
    return compile_equation(parse_template(text, "hopf").bind({}))


def agrees(part: Part, deflection: float | None) -> None:
    """Hold the triangles of all formats against the equation's volume and area."""
    mesh = surface(part.exportable(), ExportOptions(deflection=deflection))
    found = triangle_integrals(mesh.vertices, mesh.triangles)
    true = part.report.equation
    distance = min(mesh.deflection, part.report.equation.area**0.5 / 10)
    assert abs(found.volume - true.volume) <= distance * true.area
    assert found.volume == pytest.approx(true.volume, rel=0.04)
    assert found.area == pytest.approx(true.area, rel=0.02)


@pytest.mark.parametrize("deflection", [None, 0.005, 0.05, 1000.0])
def test_faces_that_wind_round_a_torus_keep_all_of_themselves(deflection: float | None) -> None:
    agrees(hopf(), deflection)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("turns", "wall", "size"),
    [(2, 0.3, 1.0), (-1, 0.3, 1.0), (1, 0.05, 1.0), (1, 0.3, 0.005), (1, 0.3, 1e5)],
)
def test_so_do_those_of_other_twists_walls_and_sizes(turns: int, wall: float, size: float) -> None:
    part = hopf(turns, wall, size)
    for deflection in (None, 0.02 * size):
        mesh = surface(part.exportable(), ExportOptions(deflection=deflection))
        found = triangle_integrals(mesh.vertices, mesh.triangles)
        true = part.report.equation
        assert abs(found.volume - true.volume) <= mesh.deflection * true.area
        assert found.area == pytest.approx(true.area, rel=0.02)


def test_every_format_holds_these_triangles(tmp_path: Path) -> None:
    part = hopf()
    options = ExportOptions(deflection=0.02)
    count = len(surface(part.exportable(), options).triangles)
    for ending in ("stl", "ast", "3mf", "glb", "vtp"):
        part.write(tmp_path / f"a.{ending}", options=options)
    raw = (tmp_path / "a.stl").read_bytes()
    assert struct.unpack_from("<I", raw, 80)[0] == count
    assert (tmp_path / "a.ast").read_text().count("outer loop") == count
    rows = np.frombuffer(raw[84:], dtype=[("n", "<f4", 3), ("p", "<f4", (3, 3)), ("x", "<u2")])
    a, b, c = (rows["p"][:, k].astype(float) for k in range(3))
    volume = float((a * np.cross(b, c)).sum()) / 6
    assert volume == pytest.approx(part.report.equation.volume, rel=0.02)


def test_without_a_grid_the_loss_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshing, "attach", lambda *_: {})
    with pytest.raises(KernelError, match=r"do not cover|than the .* that their chords can be off"):
        agrees(hopf(), 0.005)


@pytest.mark.parametrize("deflection", [0.005, 0.05, 1.0])
def test_the_bounds_are_those_of_a_ball(deflection: float) -> None:
    part = compile_equation(read_template(find_template("ball")).bind({}))
    mesh, slack = meshing._mesh(part.shape, deflection, 0.3)
    found = triangle_integrals(mesh.vertices, mesh.triangles)
    volume, area = 32 * math.pi / 3, 16 * math.pi
    assert not slack.lost
    assert 0.4 * slack.volume < volume - found.volume < slack.volume
    assert 0.2 * slack.area < area - found.area < slack.area
