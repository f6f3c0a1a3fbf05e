"""Meshes of hulls, cushions and lenses: sides that are collapsed and meet there."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from test_hexahedra import check_conforming

import pc2cad as pc
from pc2cad.checked import CheckedMap, check_map
from pc2cad.compiler import mesh_equation
from pc2cad.equation.point_equation import point_equation
from pc2cad.export.mesh_files import write_mesh
from pc2cad.expression.tree import Expr, pieces
from pc2cad.mesh.closure import MeshNotWholeError, check_whole
from pc2cad.mesh.cutting import CellsNotCutAlikeError, Cuts
from pc2cad.mesh.elements import TYPES
from pc2cad.mesh.grid import Grid, UnsuitableGridError, make_grid
from pc2cad.mesh.hexahedra import CellCollapsesError, hexahedra
from pc2cad.mesh.meshing import MeshOptions
from pc2cad.mesh.ogrid import o_grid
from pc2cad.mesh.quality import measure
from pc2cad.mesh.volume_mesh import VolumeMesh

u, v, w = pc.parameters()
ACROSS = 2 * w - 1
TURN = 2 * pc.pi * u
BUMP = u * v * (1 - u) * (1 - v)
LENGTH, BREADTH, DRAUGHT = 10.0, 1.0, 0.625


def stacked(low: Expr, high: Expr) -> Expr:
    """Return what is `low` for w up to a half and `high` from there."""
    half = (Fraction(0), Fraction(1, 2), Fraction(1))
    return pieces(w, half, ((low,), (high,)), smoothness=0, closed=False)


SHAPES = {
    "cushion": (2 * u, 2 * v, 8 * BUMP * ACROSS),
    "left-handed cushion": (2 * v, 2 * u, 8 * BUMP * ACROSS),
    "cushion on end": (8 * w * (1 - w) * v * (1 - v) * (2 * u - 1), 2 * v, 2 * w),
    "cushion on a floor": (u, v, BUMP * w),
    "bent cushion": (u + v**2 / 10, v + u**2 / 10, BUMP * ACROSS + 3 * u**2 / 10),
    "hull": (LENGTH * (u - 0.5), BREADTH * 2 * u * (1 - u) * (1 - v**2) * ACROSS, -DRAUGHT * v),
    "one corner": (u, v, u * v * ACROSS),
    "two and one opposite": (u, v, u * v * (1 - u) * ACROSS),
    "lens": (v * pc.cos(TURN), v * pc.sin(TURN), (1 - v**2) * ACROSS),
    "simplex": (u, u * v, u * v * w),
    "wedge of two edges": ((1 - u) * w, u * v, u),
    "cushion on a plate": (u, v, stacked(2 * w, 1 + 4 * BUMP * ACROSS)),
    "plate on a cushion": (u, v, stacked(1 + 4 * BUMP * ACROSS, 2 * w)),
}
#: where two sides that meet are collapsed to one curve a cell has no inside
SECTORS = {
    "sector": (u * v * pc.cos(u - v), u * v * pc.sin(u - v), w),
    "cone over a sector": (u * v * w * pc.cos(v - w), u * v * w * pc.sin(v - w), u),
}


@cache
def checked(name: str) -> CheckedMap:
    return check_map(point_equation({**SHAPES, **SECTORS}[name], name=name))


@cache
def exact_volume(name: str) -> float:
    return checked(name).mass.volume


def check_whole_and_upright(mesh: VolumeMesh, exact: float, off: float) -> None:
    check_conforming(mesh)
    quality = measure(mesh)
    assert quality.scaled_jacobian > 0
    check_whole(mesh, quality.volume)
    assert quality.volume == pytest.approx(exact, rel=off)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", SHAPES)
def test_sides_that_meet_where_they_collapse_have_conforming_meshes(name: str, order: int) -> None:
    grid = make_grid(checked(name), (4, 5, 3))
    mesh = hexahedra(checked(name), grid, order)
    check_whole_and_upright(mesh, exact_volume(name), 0.4 if order == 1 else 0.02)
    core = o_grid(checked(name), grid, order)
    assert set(core.blocks) == {"hexahedron"}
    check_whole_and_upright(core, exact_volume(name), 0.2 if order == 1 else 0.02)


@pytest.mark.parametrize("name", SECTORS)
@pytest.mark.parametrize("order", [1, 2])
def test_a_cell_without_inside_is_left_out_and_closed_over(name: str, order: int) -> None:
    found = checked(name)
    mesh = hexahedra(found, make_grid(found, (4, 5, 3)), order)
    check_whole_and_upright(mesh, exact_volume(name), 0.1 if order == 1 else 1e-3)
    with pytest.raises(UnsuitableGridError, match="no inside"):
        o_grid(found, make_grid(found, (4, 5, 3)), order)


def test_the_corners_of_a_cushion_are_cut_through_both_sides_alike() -> None:
    found = checked("cushion")
    mesh = hexahedra(found, make_grid(found, (6, 6, 1)))
    assert {kind: len(block) for kind, block in mesh.blocks.items()} == {
        "hexahedron": 16, "wedge": 16, "tetra": 8,
    }  # fmt: skip
    for side in ("w=0", "w=1"):
        nodes = mesh.facet_nodes(side)
        assert {shape: len(rows) for shape, rows in nodes.items()} == {"quad": 32, "triangle": 8}
    # one cell per corner is the coarsest there is
    assert hexahedra(found, make_grid(found, (2, 2, 1))).elements == 8


def test_a_cut_goes_on_through_the_cells_beside_it() -> None:
    found = checked("cushion on a plate")
    mesh = hexahedra(found, make_grid(found, (4, 4, 8)))
    # four columns of four cells below the corners, each cell two wedges; 8 x 4 at the rim
    assert len(mesh.blocks["wedge"]) == 2 * 16 + 8 * 4
    assert len(mesh.blocks["tetra"]) == 2 * 16


@pytest.mark.parametrize("make", [hexahedra, o_grid])
@pytest.mark.parametrize("name", ["cushion", "hull", "bent cushion"])
def test_order_two_converges_at_fourth_order(
    name: str, make: Callable[[CheckedMap, Grid, int], VolumeMesh]
) -> None:
    exact = exact_volume(name)
    errors = [
        abs(make(checked(name), make_grid(checked(name), (n, n, n // 2)), 2).volume() / exact - 1)
        for n in (4, 8)
    ]
    assert np.log2(errors[0] / errors[1]) > 3.4


def test_an_o_grid_of_a_long_hull_has_about_as_many_cells_as_its_grid() -> None:
    grid = make_grid(checked("hull"), (40, 4, 4))
    assert 320 < o_grid(checked("hull"), grid).elements < 1280


@pytest.mark.parametrize(
    ("name", "cells", "direction"),
    [("cushion", (1, 4, 1), "u"), ("hull", (1, 4, 1), "u"), ("cushion on end", (1, 1, 4), "v"),
     ("two and one opposite", (1, 4, 3), "u")],
)  # fmt: skip
def test_one_cell_between_two_sides_that_collapse_is_too_few(
    name: str, cells: tuple[int, int, int], direction: str
) -> None:
    with pytest.raises(UnsuitableGridError, match=f"1 cell along {direction}: at least 2"):
        make_grid(checked(name), cells)


def test_a_size_as_large_as_the_part_still_has_two_cells_there() -> None:
    found = checked("cushion")
    assert make_grid(found, size=100.0).cells == (2, 2, 1)


def test_a_cell_that_loses_a_face_of_the_solid_is_refused() -> None:
    found = checked("cone over a sector")
    with pytest.raises(CellCollapsesError, match="no inside"):
        hexahedra(found, make_grid(found, (4, 4, 1)))


def test_cuts_that_do_not_fit_are_refused() -> None:
    cuts = Cuts()
    corners = list(range(8))
    # opposite faces of a brick cut crosswise, and so that no corner is on every cut
    for face, diagonal in (
        ((0, 1, 2, 3), (0, 2)),
        ((4, 5, 6, 7), (5, 7)),
        ((0, 1, 4, 5), (1, 4)),
        ((2, 3, 6, 7), (3, 6)),
        ((1, 2, 5, 6), (2, 5)),
        ((0, 3, 4, 7), (0, 7)),
    ):
        cuts.diagonals[frozenset(face)] = frozenset(diagonal)
    with pytest.raises(CellsNotCutAlikeError, match="do not fit"):
        cuts.pieces(corners)


# -- what is not whole is refused ------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", ["cushion", "simplex", "cone over a sector"])
def test_a_mesh_with_a_facet_too_few_is_refused(name: str, order: int) -> None:
    found = checked(name)
    mesh = hexahedra(found, make_grid(found, (4, 4, 3)), order)
    filled = measure(mesh).volume
    check_whole(mesh, filled)
    for side, parts in mesh.sides.items():
        first = parts[0]
        short = replace(first, elements=first.elements[1:], faces=first.faces[1:])
        torn = replace(mesh, sides={**mesh.sides, side: (short, *parts[1:])})
        with pytest.raises(MeshNotWholeError, match="facets"):
            check_whole(torn, filled)


def test_a_mesh_that_fills_more_than_its_facets_hold_is_refused() -> None:
    mesh, report = mesh_equation(
        point_equation(SHAPES["hull"], name="hull"), MeshOptions(cells=(6, 4, 2))
    )
    with pytest.raises(MeshNotWholeError, match="of it apart"):
        check_whole(mesh, report.quality.volume * (1 + 1e-10))


@pytest.mark.parametrize("shift", [1e3, 1e6])
@pytest.mark.parametrize("factor", [1e-3, 1e5])
def test_what_is_whole_stays_so_far_away_and_at_any_size(shift: float, factor: float) -> None:
    x, y, z = SHAPES["lens"]
    moved = (factor * (x + shift), factor * (y - shift), factor * z)
    options = MeshOptions(cells=(8, 6, 2), order=2)
    mesh, _ = mesh_equation(point_equation(moved, name="far"), options)
    assert set(mesh.blocks) == {"hexahedron", "wedge"}


# -- hydrostatics of a hull ------------------------------------------------------------------------


def pressure_force(mesh: VolumeMesh, side: str) -> tuple[np.ndarray, float]:
    """Return the force of water on the facets of a side, ∫ z n dA, and that of its size."""
    centre = mesh.centre
    force, size = np.zeros(3), 0.0
    for normals, weights, places in mesh.facet_integrands(side):
        depth = -(places[..., 2] + centre[2])
        force -= np.einsum("nq,nqx,q->x", depth, normals, weights)
        size += float((depth * np.sqrt((normals**2).sum(axis=-1)) @ weights).sum())
    return force, size


@pytest.mark.parametrize("core", ["grid", "ogrid"])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cells", [(6, 4, 1), (8, 5, 2), (7, 4, 3)])
def test_water_lifts_a_wigley_hull_and_does_not_push_it_aside(
    cells: tuple[int, int, int], order: int, core: str
) -> None:
    options = MeshOptions(cells=cells, order=order, core=core)
    mesh, report = mesh_equation(point_equation(SHAPES["hull"], name="hull"), options)
    forces = [pressure_force(mesh, side) for side in ("w=0", "w=1")]
    size = sum(size for _, size in forces)
    (_, across, lift) = sum(force for force, _ in forces)
    assert size > 1
    assert abs(across) < 1e-12 * size
    # Archimedes: the deck is at the water's level
    assert lift == pytest.approx(report.volume, rel=1e-12)


@pytest.mark.interop
@pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX is not installed (apt-get install calculix-ccx)"
)
@pytest.mark.parametrize("core", ["grid", "ogrid"])
@pytest.mark.parametrize("order", [1, 2])
def test_calculix_finds_no_side_force_on_a_wigley_hull(
    tmp_path: Path, order: int, core: str
) -> None:
    options = MeshOptions(cells=(8, 4, 2), order=order, core=core)
    mesh, _ = mesh_equation(point_equation(SHAPES["hull"], name="hull"), options)
    write_mesh(mesh, tmp_path / "part.inp")
    loads, pushed = [], 0.0
    for side in ("w=0", "w=1"):
        for facets in mesh.sides[side]:
            first = mesh.first_element(facets.kind) + 1
            for element, face in zip(facets.elements, facets.faces, strict=True):
                ring = list(TYPES[facets.kind].faces[face])
                corners = mesh.points[mesh.blocks[facets.kind][element][ring]]
                depth = -float(corners[:, 2].mean())
                spans = corners[2] - corners[0], corners[-1] - corners[1]
                pushed += depth * float(np.linalg.norm(np.cross(*spans))) / 2
                loads.append(f"{first + element}, P{face + 1}, {depth!r}")
    (tmp_path / "job.inp").write_text(
        "*INCLUDE, INPUT=part.inp\n*MATERIAL, NAME=m\n*ELASTIC\n1000., 0.3\n"
        "*SOLID SECTION, ELSET=solid, MATERIAL=m\n*BOUNDARY\nv_0, 1, 3\n*STEP\n*STATIC\n*DLOAD\n"
        + "\n".join(loads)
        + "\n*NODE PRINT, NSET=v_0, TOTALS=ONLY\nRF\n*END STEP\n"
    )
    done = subprocess.run(
        ["ccx", "-i", "job"], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert "ERROR" not in done.stdout, done.stdout[-2000:]
    text = (tmp_path / "job.dat").read_text()
    found = re.search(r"total force.*\n+\s*(\S+)\s+(\S+)\s+(\S+)", text)
    assert found is not None, text
    along, across, lift = map(float, found.groups())
    assert pushed > 1
    assert abs(across) < 1e-6 * pushed
    assert abs(along) < 1e-6 * pushed
    # as much as the water that it displaces, with one pressure on each facet
    assert -lift == pytest.approx(mesh.volume(), rel=0.05)
