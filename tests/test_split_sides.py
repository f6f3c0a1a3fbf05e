"""Sides that coincide after a shift, or are folded onto themselves: cut so that whole cells do."""

from __future__ import annotations

from math import cosh, pi, sinh
from pathlib import Path

import pytest
from consumers.step_file import check_step
from test_hexahedra import check_conforming

import pc2cad as pc
from pc2cad.checked import check_map
from pc2cad.domain.analysis import analyse, sample_sides
from pc2cad.domain.closed_sides import closes, few_points
from pc2cad.domain.splits import _told
from pc2cad.equation.point_equation import point_equation
from pc2cad.errors import NotASolidError
from pc2cad.expression.tree import Expr, number, substitute
from pc2cad.mesh.grid import make_grid
from pc2cad.mesh.hexahedra import hexahedra
from pc2cad.topology.quotient import derive_boundary

u, v, w = pc.parameters()
Map = tuple[Expr, Expr, Expr]
TURN = 2 * pc.pi


def ring(k: int, parts: int, inner: float = 0, amplitude: float = 0.2, start: float = 0) -> Map:
    """Return a ring of radius 4 whose k-fold section turns by parts/k on its way round."""
    t, f = TURN * u, TURN * (v + start)
    r = (inner + (1 - inner) * w) * (1 + amplitude * pc.cos(k * f))
    return swept(r * pc.cos(f), r * pc.sin(f), t, t * parts / k)


def swept(x: Expr, y: Expr, t: Expr, turn: Expr, radius: float = 4) -> Map:
    """Return a plane section, turned and then carried round the z-axis."""
    p = x * pc.cos(turn) - y * pc.sin(turn)
    q = x * pc.sin(turn) + y * pc.cos(turn)
    return (radius + p) * pc.cos(t), (radius + p) * pc.sin(t), q


@pytest.mark.parametrize(
    ("k", "parts", "inner", "start"),
    [(2, 1, 0, 0), (3, 1, 0, 0), (3, 2, 0, 0.1), (3, 1, 0.5, 0), (5, -2, 0, 0), (7, 3, 0, 0.03),
     (24, 5, 0.2, 0), (4, 2, 0, 0), (6, 0, 0, 0)],
)  # fmt: skip
def test_a_ring_whose_section_comes_round_to_itself(
    k: int, parts: int, inner: float, start: float
) -> None:
    amplitude = 0.2 if k < 8 else 0.02
    analysis = analyse(point_equation(ring(k, parts, inner, amplitude, start), name="ring"))
    assert [side.fate for side in analysis.boundary.sides if side.patch[0] in (0, 2)] == (
        ["interface"] * 2 * len(analysis.bounds[1][1:])
    )
    cut = {(4, 2): 2, (6, 0): 1}.get((k, parts), k)
    assert len(analysis.bounds[1]) == cut + 1
    assert len(analysis.boundary.faces) == cut * (2 if inner else 1)
    assert [shell.genus for shell in analysis.boundary.shells] == [1, 1][: 2 if inner else 1]


@pytest.mark.parametrize(
    ("k", "parts", "inner"), [(2, 1, 0), pytest.param(3, 2, 0.5, marks=pytest.mark.slow)]
)
def test_such_rings_are_built(k: int, parts: int, inner: float, tmp_path: Path) -> None:
    part = pc.compile_part(ring(k, parts, inner))
    # Pappus: the section's area is pi (1 + a²/2) (1 - inner²)
    volume = 2 * pi * 4 * pi * 1.02 * (1 - inner**2)
    assert part.report.solid.volume == pytest.approx(volume, rel=1e-9)
    assert part.report.evidence == "exact"
    part.write(tmp_path / "ring.step")
    step = check_step(tmp_path / "ring.step")
    assert step.volume == pytest.approx(volume, rel=1e-9)


def test_an_elliptic_section_with_half_a_turn() -> None:
    x, y = w * pc.cos(TURN * v), 0.4 * w * pc.sin(TURN * v)
    part = pc.compile_part(swept(x, y, TURN * u, pc.pi * u, 3))
    assert part.report.solid.volume == pytest.approx(23.68705056261446, rel=1e-9)
    assert part.report.genus == (1,)


@pytest.mark.parametrize("order", ["uvw", "vwu", "wuv"])
def test_shifts_along_any_parameter(order: str) -> None:
    renamed = {name: pc.expression.tree.symbol(to) for name, to in zip("uvw", order, strict=True)}
    report = pc.compile_part(substitute(ring(3, 1), renamed)).report
    assert report.solid.volume == pytest.approx(8 * pi**2 * 1.02, rel=1e-9)
    assert len(report.faces) == 3


def test_a_mesh_of_such_a_ring_is_conforming() -> None:
    checked = check_map(point_equation(ring(3, 1, 0.4), name="ring"))
    mesh = hexahedra(checked, make_grid(checked, (12, 12, 2)), 2)
    check_conforming(mesh)
    assert mesh.volume() == pytest.approx(checked.mass.volume, rel=5e-3)


def test_a_band_on_both_sides_of_its_middle_is_glued_to_itself() -> None:
    # twice round a Möbius band of thickness 0.4: w = 0 is its middle, met from both sides
    t = 2 * TURN * u
    part = pc.compile_part(swept(2 * v - 1, 0.2 * w, t, t / 2, 3))
    whole = pc.compile_part(swept(2 * v - 1, 0.2 * (2 * w - 1), TURN * u, pc.pi * u, 3))
    assert part.report.solid.volume == pytest.approx(whole.report.solid.volume, rel=1e-12)
    assert part.report.solid.area == pytest.approx(whole.report.solid.area, rel=1e-9)
    assert part.report.genus == whole.report.genus == (1,)
    sides = [side for side in analyse(part.checked.analysis.equation).boundary.sides]
    assert {side.fate for side in sides if side.patch[2] == 0} == {"interface"}


def test_a_shift_by_no_fraction_is_refused() -> None:
    x, y = w * pc.cos(TURN * v), w * pc.sin(TURN * v)
    with pytest.raises(NotASolidError):
        pc.compile_part(swept(x, y, TURN * u, u))


AREA = pi * cosh(1) * sinh(1)


def ellipse(angle: Expr, turn: Expr) -> tuple[Expr, Expr]:
    """Return points between two foci and an ellipse round them, v from the slit outwards."""
    x, y = pc.cosh(v) * pc.cos(angle), pc.sinh(v) * pc.sin(angle)
    return x * pc.cos(turn) - y * pc.sin(turn), x * pc.sin(turn) + y * pc.cos(turn)


ZERO = number(0)
#: map, volume, faces
FOLDED = {
    "rod": ((*ellipse(TURN * u, ZERO), w), AREA, 4),
    "twisted": ((*ellipse(TURN * u, w), w), AREA, 4),
    "begun elsewhere": ((*ellipse(TURN * (u + 0.15), ZERO), w), AREA, 6),
    "begun anywhere": ((*ellipse(TURN * u + 0.7, ZERO), w), AREA, 6),
    "begun at a quarter": ((*ellipse(TURN * (u + 0.25), ZERO), w), AREA, 6),
    "tapered": ((*(c * (1 - w / 2) for c in ellipse(TURN * u, ZERO)), w), AREA * 7 / 12, 4),
    "bent to a ring": (swept(*ellipse(TURN * u, ZERO), TURN * w, ZERO), 8 * pi * AREA, 1),
    "parabolas": (((2 * u - 1) * v, (v**2 - (2 * u - 1) ** 2) / 2, w), 4 / 3, 6),
    "focal disc": ((pc.cosh(v) * pc.sin(pc.pi * u) * pc.cos(TURN * w),
                    pc.cosh(v) * pc.sin(pc.pi * u) * pc.sin(TURN * w),
                    pc.sinh(v) * pc.cos(pc.pi * u)), 4 / 3 * AREA * cosh(1), 1),
}  # fmt: skip


@pytest.mark.parametrize("name", FOLDED)
def test_a_side_folded_onto_a_slit_lies_inside(name: str) -> None:
    equation, volume, faces = FOLDED[name]
    report = pc.compile_part(equation).report
    assert report.solid.volume == pytest.approx(volume, rel=1e-8)
    assert report.equation.area == pytest.approx(report.solid.area, rel=1e-6)
    assert len(report.faces) == faces


def test_the_rod_between_two_foci_is_written_and_meshed(tmp_path: Path) -> None:
    b = 1.5 * v
    equation = (pc.cosh(b) * pc.cos(TURN * u), pc.sinh(b) * pc.sin(TURN * u), w)
    part = pc.compile_part(equation)
    assert part.report.solid.volume == pytest.approx(15.736041138266161, rel=1e-12)
    part.write(tmp_path / "rod.step")
    assert check_step(tmp_path / "rod.step").volume == pytest.approx(15.736041138266161, rel=1e-9)
    mesh = hexahedra(part.checked, make_grid(part.checked, (8, 3, 2)), 2)
    check_conforming(mesh)
    assert mesh.volume() == pytest.approx(15.736041138266161, rel=1e-2)


@pytest.mark.slow
def test_a_side_that_is_folded_in_part_is_still_refused() -> None:
    # the slit is met from both sides between the focus and a place beyond it only
    with pytest.raises(NotASolidError):
        pc.compile_part((*ellipse(4 * u, ZERO), w))


@pytest.mark.interop
def test_gmsh_reads_a_ring_without_healing(tmp_path: Path) -> None:
    from consumers.gmsh_reader import read_in_gmsh

    pc.compile_part(ring(3, 1)).write(tmp_path / "part.step")
    found = read_in_gmsh(tmp_path / "part.step")
    assert (found["volumes"], found["surfaces"]) == (1, 3)
    # its own integrals of rational faces are no better
    assert found["volume"] == pytest.approx(8 * pi**2 * 1.02, rel=1e-3)


@pytest.mark.interop
def test_gmsh_reads_and_meshes_a_folded_side_without_healing(tmp_path: Path) -> None:
    from consumers.gmsh_reader import mesh

    pc.compile_part(FOLDED["twisted"][0]).write(tmp_path / "part.step")
    found = mesh(tmp_path / "part.step", 1.0)
    assert (found["volumes"], found["surfaces"]) == (1, 4)
    assert found["volume"] == pytest.approx(AREA, rel=1e-6)
    assert found["mesh_volume"] == pytest.approx(AREA, rel=3e-2)


@pytest.mark.parametrize(
    ("name", "count", "closed"),
    [("pyramid_cut", 10, 0), ("channel_ellipse", 4, 4), ("torus", 0, 2), ("cone", 2, 2),
     ("ball", 1, 1)],
)  # fmt: skip
def test_edges_tell_which_sides_close(name, count, closed):
    sides = sample_sides(pc.read_template(name).bind({}))
    boundary = derive_boundary(sides.questions, sides.questions.labels)
    few, said = few_points(sides.map), _told(boundary)
    closing = {
        (*side, along)
        for along, rows in enumerate(few)
        for side, points in rows.items()
        if closes(points, sides.questions.scale)
    }
    assert {way for way, is_closed in said.items() if is_closed} <= closing
    assert {way for way, is_closed in said.items() if not is_closed}.isdisjoint(closing)
    assert len(said) == count + closed
