"""Cusps inside a face: the section's tangent turns back there, and faces end."""

from __future__ import annotations

from math import pi

import pytest
from consumers.freecad_reader import freecad, read_in_freecad
from consumers.fresh_kernel import read_in_fresh_process
from consumers.gmsh_reader import read_all_in_gmsh

import pc2cad as pc
from pc2cad.domain.cusps import with_cusps
from pc2cad.domain.map import local_map
from pc2cad.equation.point_equation import point_equation
from pc2cad.errors import PointCadError

U, V, W = pc.parameters()
T = 2 * pc.pi * U


def astroid(turn=0):
    a = T + turn
    return pc.cos(a) ** 3, pc.sin(a) ** 3


def deltoid():
    """Three cusps; none of the turning parameters is at a quarter."""
    return 2 * pc.cos(T) + pc.cos(2 * T), 2 * pc.sin(T) - pc.sin(2 * T)


#: section -> area, length, cusps in ]0, 1[
SECTIONS = {
    "astroid": (astroid(), 3 * pi / 8, 6, (0.25, 0.5, 0.75)),
    "turned astroid": (astroid(1), 3 * pi / 8, 6,
                       tuple(k / 4 - 1 / (2 * pi) for k in (1, 2, 3, 4))),
    "deltoid": (deltoid(), 2 * pi, 16, (1 / 3, 2 / 3)),
}  # fmt: skip


def rod(section):
    x, y = section
    return W * x, W * y, 2 * V


def cusps(equation):
    return tuple(
        tuple(b.position for b in row)
        for row in with_cusps(((), (), ()), local_map(point_equation(equation)))
    )


@pytest.mark.parametrize("name", SECTIONS)
def test_cusps_are_found_where_they_are(name):
    section, _, _, places = SECTIONS[name]
    found = cusps(rod(section))
    assert found[0] == pytest.approx(places, abs=1e-12)
    assert found[1:] == ((), ())


def test_an_astroid_rod_is_exact():
    report = pc.compile_part(rod(astroid())).report
    assert report.solid.volume == pytest.approx(3 * pi / 4, rel=1e-12)
    assert report.solid.area == pytest.approx(3 * pi / 4 + 12, rel=1e-12)
    assert {face.evidence for face in report.faces} == {"exact"}
    assert len(report.faces) == 6
    assert report.injectivity == "proved"


@pytest.mark.slow
@pytest.mark.parametrize("name", SECTIONS)
def test_rods_are_cut_there_and_exact(name, tmp_path):
    section, area, length, _ = SECTIONS[name]
    part = pc.compile_part(rod(section))
    whole = part.report.solid
    assert whole.volume == pytest.approx(2 * area, rel=1e-11)
    assert whole.area == pytest.approx(2 * area + 2 * length, rel=1e-11)
    assert {face.evidence for face in part.report.faces} == {"exact"}
    part.write(tmp_path / "rod.step")
    again = read_in_fresh_process(tmp_path / "rod.step", precise=True)
    assert (again["valid"], again["faces"]) == (True, len(part.report.faces))
    assert again["volume"] == pytest.approx(2 * area, rel=1e-9)


@pytest.mark.slow
def test_a_twisted_bar_has_them_along_its_length():
    x, y = astroid()
    turn = pc.pi / 3 * V
    c, s = pc.cos(turn), pc.sin(turn)
    bar = (W * (x * c - y * s), W * (x * s + y * c), 2 * V)
    part = pc.compile_part(bar, tolerance=2e-5)
    assert part.report.solid.volume == pytest.approx(3 * pi / 4, rel=1e-6)
    assert len(part.report.faces) == 6


@pytest.mark.parametrize(
    "equation",
    [
        (U, V, W),
        ((1 + W) * pc.cos(T), (1 + W) * pc.sin(T), V),
        # slows down to nothing and goes on
        ((2 * U - 1) ** 3, V, W),
        # a fold, not a cusp: the other side has the other sign of det J
        ((2 * U - 1) ** 2, V, W),
    ],
)
def test_what_has_none_is_not_cut(equation):
    assert cusps(equation) == ((), (), ())


def test_a_fold_is_refused_as_one():
    with pytest.raises(PointCadError, match=r"folds|det J"):
        pc.compile_part(((2 * U - 1) ** 2, V, W))


@pytest.mark.interop
def test_other_programs_read_them(tmp_path):
    parts = [pc.compile_part(rod(section)) for section, *_ in SECTIONS.values()]
    paths = [tmp_path / f"{i}.step" for i in range(len(parts))]
    for part, path in zip(parts, paths, strict=True):
        part.write(path)
    found = read_all_in_gmsh(list(paths))
    assert [one["volumes"] for one in found] == [1] * 3
    if freecad():
        strict = read_in_freecad(paths, tmp_path)
        assert [one["valid"] for one in strict] == [True] * 3
        found += strict
    for one, part in zip(found, parts * 2, strict=False):
        # their rule is coarse on rational edges
        assert one["volume"] == pytest.approx(part.report.solid.volume, rel=2e-3)
