"""Structured hexahedra: conforming, upright, convergent, and with the equation's own sides."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shipped import checked_of, every_template

import pc2cad as pc
from pc2cad.checked import CheckedMap, check_map
from pc2cad.compiler import mesh_equation
from pc2cad.equation.point_equation import point_equation
from pc2cad.mesh.cutting import Cuts
from pc2cad.mesh.degenerate_cells import is_flat
from pc2cad.mesh.elements import TYPES, gradients, rule, shapes
from pc2cad.mesh.grid import Grading, UnsuitableGridError, make_grid
from pc2cad.mesh.hexahedra import hexahedra
from pc2cad.mesh.meshing import MeshOptions
from pc2cad.mesh.ogrid import o_grid
from pc2cad.mesh.quality import InvertedElementError, measure
from pc2cad.mesh.volume_mesh import VolumeMesh

TEMPLATES = sorted(Path(__file__).parent.parent.glob("templates/*.toml"))
u, v, w = pc.parameters()


def mesh_of(checked: CheckedMap, cells: tuple[int, int, int], order: int = 1) -> VolumeMesh:
    return hexahedra(checked, make_grid(checked, cells), order)


def faces_of(mesh: VolumeMesh) -> Counter[frozenset[int]]:
    """Count how many elements have each face (as the set of its nodes)."""
    found: Counter[frozenset[int]] = Counter()
    for name, block in mesh.blocks.items():
        for face in range(len(TYPES[name].faces)):
            local = TYPES[name].face_nodes(face, mesh.order)
            found.update(frozenset(row) for row in block[:, local].tolist())
    return found


def facets_of(mesh: VolumeMesh) -> Counter[frozenset[int]]:
    whole = [side for side in mesh.sides if " (" not in side]
    rows = [nodes for side in whole for nodes in mesh.facet_nodes(side).values()]
    return Counter(frozenset(row) for nodes in rows for row in nodes.tolist())


def check_conforming(mesh: VolumeMesh) -> None:
    faces, facets = faces_of(mesh), facets_of(mesh)
    assert set(faces.values()) <= {1, 2}
    assert {face for face, count in faces.items() if count == 1} == set(facets)
    assert set(facets.values()) == {1}
    used = np.unique(np.concatenate([block.ravel() for block in mesh.blocks.values()]))
    assert np.array_equal(used, np.arange(len(mesh.points)))


# -- every template ------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2])
@every_template
def test_templates_mesh_conforming_and_upright(path: Path, order: int) -> None:
    checked = checked_of(path.stem)
    properties = checked.mass
    # of long parts the volume says little, and nothing of lobes
    fine = {"spring": 16, "gerotor": 12}.get(path.stem, 4)
    size = properties.volume ** (1 / 3) / fine
    mesh = hexahedra(checked, make_grid(checked, size=size), order)
    check_conforming(mesh)
    quality = measure(mesh)
    assert quality.scaled_jacobian > 0
    assert quality.volume == pytest.approx(mesh.volume(), rel=1e-12 if order == 1 else 2e-5)
    assert mesh.volume() == pytest.approx(properties.volume, rel=0.3 if order == 1 else 0.03)
    names = {checked.analysis.boundary.name(face.patch) for face in checked.analysis.boundary.faces}
    assert names <= set(mesh.sides)
    # what is left of hexahedra alone is tested with O-grids
    assert (set(mesh.blocks) == {"hexahedron"}) == (path.stem not in COLLAPSED)


@pytest.mark.parametrize("name", ["pyramid", "pyramid_cut", "oblique_prism", "hypar_slab"])
def test_what_is_linear_between_nodes_has_the_equations_volume(name: str) -> None:
    checked = checked_of(name)
    properties = checked.mass
    mesh = mesh_of(checked, (5, 4, 3))
    assert mesh.volume() == pytest.approx(properties.volume, rel=1e-13)
    for face, area in zip(checked.analysis.boundary.faces, properties.face_areas, strict=True):
        assert mesh.area(checked.analysis.boundary.name(face.patch)) == pytest.approx(
            area, rel=1e-13
        )


@pytest.mark.parametrize(
    ("name", "cells"),
    [("ball", (16, 8, 3)), ("hollow_ball", (16, 8, 2)), ("torus_tube", (24, 12, 1)),
     ("channel_sine", (10, 56, 1)), ("turned_ring", (16, 2, 2)), ("paraboloid_cap", (16, 4, 4))],
)  # fmt: skip
def test_order_two_converges_at_fourth_order(name: str, cells: tuple[int, int, int]) -> None:
    checked = checked_of(name)
    exact = checked.mass.volume
    finer = tuple(2 * n for n in cells)
    errors = [abs(mesh_of(checked, n, 2).volume() / exact - 1) for n in (cells, finer)]
    assert np.log2(errors[0] / errors[1]) > 3.8
    assert errors[1] < 5e-4


# -- O-grids ---------------------------------------------------------------------------------------


def check_o_grid(checked: CheckedMap, mesh: VolumeMesh) -> None:
    check_conforming(mesh)
    assert set(mesh.blocks) == {"hexahedron"}
    assert measure(mesh).volume == pytest.approx(mesh.volume(), rel=1e-13)
    names = {checked.analysis.boundary.name(face.patch) for face in checked.analysis.boundary.faces}
    assert set(mesh.sides) == names | {name.partition(" (")[0] for name in names}
    for side in mesh.sides:
        nodes = np.unique(np.concatenate(list(mesh.facet_nodes(side).values())))
        assert np.array_equal(mesh.node_sets[side], nodes)


#: the sides that are collapsed: about an axis inside or on the boundary, to a point, to a rim
COLLAPSED = {
    "ball": 0.6, "ball_wedge": 0.6, "cone": 0.3, "cone_frustum": 0.7, "ellipsoid": 0.3,
    "half_ball": 0.6, "hollow_ball": 0.65, "oblique_prism": 0.6, "paraboloid_cap": 0.4,
    "pyramid": 0.6, "pyramid_cut": 0.15, "pyramid_cut_off": 0.15, "pyramid_sum": 0.15,
    "pyramid_truncated": 0.6, "quad_pyramid": 0.2, "simplex_ball": 0.3, "simplex_cone": 0.4,
    "simplex_hyperboloid": 0.4, "simplex_paraboloid": 0.25, "simplex_torus": 0.14,
    "spring": 0.05, "torus": 0.6, "torus_wedge": 0.7, "aspheric_lens": 0.7, "disc_cam": 0.7,
    "dished_end": 0.8,
    # sharp: the trailing edge, and the keel, where stems and keel meet at no angle at all
    "naca_wing": 0.1, "wigley_hull": 0.01,
}  # fmt: skip


@pytest.mark.parametrize("name", COLLAPSED)
def test_what_is_drawn_together_has_a_mesh_of_hexahedra_alone(name: str) -> None:
    checked = checked_of(name)
    cells = (200, 8, 3) if name == "spring" else (8, 8, 4)
    mesh = o_grid(checked, make_grid(checked, cells))
    check_o_grid(checked, mesh)
    assert measure(mesh).scaled_jacobian > COLLAPSED[name]


@pytest.mark.parametrize(
    ("name", "cells"),
    [("ball", 16), ("half_ball", 8), ("hollow_ball", 16), ("cone_frustum", 8), ("ball_wedge", 8),
     ("torus_wedge", 16), ("simplex_paraboloid", 8), ("paraboloid_cap", 8)],
)  # fmt: skip
def test_o_grids_converge_at_fourth_order(name: str, cells: int) -> None:
    checked = checked_of(name)
    properties = checked.mass
    errors = []
    for n in (cells, 2 * cells):
        mesh = o_grid(checked, make_grid(checked, (n, n // 2, n // 2)), 2)
        errors.append(abs(mesh.volume() / properties.volume - 1))
    check_o_grid(checked, mesh)
    assert np.log2(errors[0] / errors[1]) > 3.9
    for face, area in zip(checked.analysis.boundary.faces, properties.face_areas, strict=True):
        assert mesh.area(checked.analysis.boundary.name(face.patch)) == pytest.approx(
            area, rel=1e-3
        )


@pytest.mark.parametrize("name", ["oblique_prism", "pyramid", "quad_pyramid", "pyramid_cut_off"])
def test_o_grids_of_polyhedra_are_exact(name: str) -> None:
    checked = checked_of(name)
    properties = checked.mass
    mesh = o_grid(checked, make_grid(checked, (5, 4, 3)))
    assert mesh.volume() == pytest.approx(properties.volume, rel=1e-13)
    for face, area in zip(checked.analysis.boundary.faces, properties.face_areas, strict=True):
        assert mesh.area(checked.analysis.boundary.name(face.patch)) == pytest.approx(
            area, rel=1e-13
        )


def test_nodes_of_an_o_grid_are_counted_exactly() -> None:
    checked = checked_of("torus")
    mesh = o_grid(checked, make_grid(checked, (7, 16, 4)))
    # a square of 4 x 4 cells, and 2 rings round it
    assert mesh.elements == 7 * (16 + 2 * 16)
    assert len(mesh.points) == 7 * (25 + 2 * 16)


@pytest.mark.parametrize("turn", ["1/8", "1/4", "1/2", "3/4"])
def test_a_sector_has_a_block_at_its_axis_for_every_right_angle(turn: str) -> None:
    angle = 2 * pc.pi * u * Fraction(turn)
    sector = (w * pc.cos(angle), w * pc.sin(angle), v)
    checked = check_map(point_equation(sector, name="sector"))
    mesh = o_grid(checked, make_grid(checked, (6, 1, 6)), 2)
    check_o_grid(checked, mesh)
    (axis,) = np.flatnonzero(np.abs(mesh.points[:, :2]).max(axis=1) + mesh.points[:, 2] < 1e-12)
    assert (mesh.blocks["hexahedron"] == axis).sum() == max(1, 4 * Fraction(turn))
    assert measure(mesh).scaled_jacobian > 0.65


@pytest.mark.parametrize("turns", [0, 1, 2])
def test_a_polygon_round_an_axis_has_its_corners_at_blocks_and_closes_with_a_turn(
    turns: int,
) -> None:
    corners = [(np.cos(k * np.pi / 3), np.sin(k * np.pi / 3)) for k in range(6)]
    x, y = pc.polygon(corners, v)
    beta, theta = turns * 2 * pc.pi * u / 6, 2 * pc.pi * u
    out = 5 + w * (x * pc.cos(beta) - y * pc.sin(beta))
    up = w * (x * pc.sin(beta) + y * pc.cos(beta))
    ring = point_equation((out * pc.cos(theta), out * pc.sin(theta), up), name="ring")
    checked = check_map(ring)
    mesh = o_grid(checked, make_grid(checked, (24, 12, 2)), 2)
    check_o_grid(checked, mesh)
    assert measure(mesh).scaled_jacobian > 0.8
    assert mesh.volume() == pytest.approx(2 * np.pi * 5 * 1.5 * 3**0.5, rel=2e-5)
    areas = [mesh.area(f"w=1 (piece {k} of v)") for k in range(1, 7)]
    assert sum(areas) == pytest.approx(mesh.area("w=1"), rel=1e-13)


def test_layers_about_an_axis_have_sets_of_their_own() -> None:
    line = pc.point(0, 0, 5 * u)
    rod = pc.channel(line, pc.ellipse(2, 2, v), {"core": None, "skin": 0.5}, side="outside")
    options = MeshOptions(cells=(4, 16, 8), order=2, core="ogrid")
    mesh, report = mesh_equation(rod, options)
    check_conforming(mesh)
    assert list(report.layers) == ["core", "skin"]
    assert report.layers["core"].volume == pytest.approx(np.pi * 4 * 5, rel=1e-4)
    assert report.layers["skin"].volume == pytest.approx(np.pi * 2.25 * 5, rel=1e-4)
    assert abs(report.volume_difference) < 1e-4


@pytest.mark.parametrize("end", [0, 1])
def test_an_o_grid_takes_its_axis_and_its_point_from_either_end(end: int) -> None:
    turned = v if end == 0 else 1 - v
    out = w if end == 0 else 1 - w
    angle, height = 2 * pc.pi * u, pc.pi / 2 * turned
    radius = out * pc.sin(height)
    half_ball = (radius * pc.cos(angle), radius * pc.sin(angle), out * pc.cos(height))
    options = MeshOptions(cells=(16, 8, 8), order=2, core="ogrid")
    mesh, report = mesh_equation(point_equation(half_ball, name="half ball"), options)
    assert set(mesh.sides) == {f"v={1 - end}", f"w={1 - end}"}
    assert report.volume == pytest.approx(2 * np.pi / 3, rel=3e-4)
    assert report.quality.scaled_jacobian > 0.7


def test_where_nothing_is_drawn_together_the_grid_is_the_o_grid() -> None:
    checked = checked_of("turned_ring")
    grid = make_grid(checked, size=1.0)
    assert np.array_equal(o_grid(checked, grid).points, hexahedra(checked, grid).points)


def test_an_edge_that_is_drawn_together_alone_has_no_o_grid() -> None:
    checked = check_map(point_equation((u, (v + v**2 / 4) * (u + w), w), name="gore"))
    with pytest.raises(UnsuitableGridError, match="whole sides are collapsed"):
        o_grid(checked, make_grid(checked, (3, 4, 3)))


# -- merging by index ------------------------------------------------------------------------------


def test_nodes_of_a_torus_are_counted_exactly() -> None:
    mesh = mesh_of(checked_of("torus"), (7, 5, 3))
    # 7 x 5 columns that share the axis: 3 nodes each, and 7 on the axis
    assert len(mesh.points) == 7 * 5 * 3 + 7
    assert {kind: len(block) for kind, block in mesh.blocks.items()} == {
        "hexahedron": 7 * 5 * 2,
        "wedge": 7 * 5,
    }


def test_nodes_of_a_ball_are_counted_exactly() -> None:
    mesh = mesh_of(checked_of("ball"), (6, 4, 2))
    # two spheres of 3 rings and 2 poles each, and the centre
    assert len(mesh.points) == 2 * (3 * 6 + 2) + 1
    assert {kind: len(block) for kind, block in mesh.blocks.items()} == {
        "hexahedron": 6 * 2, "wedge": 6 * 2, "pyramid": 6 * 2, "tetra": 6 * 2,
    }  # fmt: skip


def test_a_quarter_turn_gluing_joins_rows_with_columns() -> None:
    mesh = mesh_of(checked_of("turned_ring"), (9, 2, 2), 2)
    assert len(mesh.points) == 9 * (21 + 9)
    assert set(mesh.sides) == {"v=0", "v=1", "w=0", "w=1"}


def test_a_single_edge_that_collapses_is_cut_alike_by_its_neighbours() -> None:
    equation = point_equation((u, (v + v**2 / 4) * (u + w), w), name="gore")
    for order in (1, 2):
        mesh, report = mesh_equation(equation, MeshOptions(cells=(3, 4, 3), order=order))
        check_conforming(mesh)
        assert report.elements == {"hexahedron": 3 * 4 * 3 - 4, "pyramid": 2 * 4}
        assert abs(report.volume_difference) < (0.02 if order == 1 else 1e-12)


def test_creases_are_grid_lines_and_their_patches_have_sets() -> None:
    corners = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)]
    x, y = pc.polygon(corners, v)
    centre = (0.5, 0.5)
    shape = tuple(c + (a - c) * u for a, c in zip((x, y), centre, strict=True))
    equation = point_equation((*shape, 2 * w), name="angle")
    mesh, report = mesh_equation(equation, MeshOptions(cells=(2, 13, 2)))
    check_conforming(mesh)
    assert report.cells == (2, 12, 2)  # two per piece: 13 do not divide
    assert report.volume == pytest.approx(8.0, rel=1e-13)
    lengths = [3, 1, 2, 1, 1, 2]
    areas = [report.sides[f"u=1 (piece {k} of v)"].area for k in range(1, 7)]
    assert areas == pytest.approx([2 * x for x in lengths], rel=1e-13)
    assert report.sides["u=1"].area == pytest.approx(20.0, rel=1e-13)


@pytest.mark.parametrize("factor", [1e-5, 1e5])
def test_scale_does_not_matter(factor: float) -> None:
    angle, height = 2 * pc.pi * u, v
    radius = 1 + w / 2
    coordinates = (radius * pc.cos(angle), radius * pc.sin(angle), height)
    scaled = tuple(factor * x for x in coordinates)
    options = MeshOptions(cells=(8, 2, 2), order=2)
    one = mesh_equation(point_equation(coordinates, name="tube"), options)[1]
    other = mesh_equation(point_equation(scaled, name="tube"), options)[1]
    assert other.quality.scaled_jacobian == pytest.approx(one.quality.scaled_jacobian, rel=1e-9)
    assert other.volume == pytest.approx(one.volume * factor**3, rel=1e-12)


# -- the grid --------------------------------------------------------------------------------------


@given(st.floats(1e-4, 1e4), st.booleans(), st.lists(st.floats(0, 1), min_size=1, max_size=5))
def test_share_is_the_inverse_of_position(ratio: float, both: bool, places: list[float]) -> None:
    grading = Grading(ratio, both)
    share = np.array(places)
    assert grading.share(grading.position(share)) == pytest.approx(share, abs=1e-9)


def test_grading_sets_the_ratio_of_cells() -> None:
    checked = checked_of("parallelepiped")
    gradings = (Grading(4.0), Grading(1 / 4), Grading(9.0, both_ends=True))
    grid = make_grid(checked, (8, 8, 8), grading=gradings)
    first, second, third = (np.diff(lines) for lines in grid.lines)
    growth = 4 ** (1 / 8)  # between neighbours; from the first cell to the last in 8 steps less one
    assert first[1:] / first[:-1] == pytest.approx(growth)
    assert second[::-1] == pytest.approx(first)
    assert third == pytest.approx(third[::-1])
    assert third[3] / third[0] == pytest.approx(9 ** (3 / 4))


def test_directions_that_a_gluing_exchanges_need_the_same_cells() -> None:
    checked = checked_of("turned_ring")
    with pytest.raises(UnsuitableGridError, match="v and w"):
        make_grid(checked, (9, 2, 3))
    with pytest.raises(UnsuitableGridError, match="from both ends"):
        make_grid(checked, (9, 2, 2), grading=(Grading(), Grading(2.0), Grading(2.0)))
    grid = make_grid(checked, size=0.7)
    assert grid.cells[1] == grid.cells[2]


def test_closed_directions_need_three_cells() -> None:
    with pytest.raises(UnsuitableGridError, match="at least 3"):
        make_grid(checked_of("torus"), (2, 4, 1))


def test_pieces_of_a_closed_direction_have_three_cells_between_them() -> None:
    """Half a turn over a turn of the ring cuts v in two: of 3 cells each piece got one."""
    turn, bend = 2 * pc.pi * v + pc.pi * u, 2 * pc.pi * u
    reach = 6 + w * pc.cos(turn)
    ring = point_equation(
        (reach * pc.cos(bend), reach * pc.sin(bend), w * pc.sin(turn)), name="ring"
    )
    for order in (1, 2):
        mesh, report = mesh_equation(ring, MeshOptions(cells=(3, 3, 1), order=order))
        assert report.cells == (3, 4, 1)
        check_conforming(mesh)


def test_size_bounds_the_cells() -> None:
    checked = checked_of("parallelepiped")
    mesh = hexahedra(checked, make_grid(checked, size=0.4))
    corners = mesh.points[mesh.blocks["hexahedron"]]
    edges = TYPES["hexahedron"].edges
    longest = max(np.linalg.norm(corners[:, a] - corners[:, b], axis=1).max() for a, b in edges)
    assert 0.3 < longest <= 0.4


def test_cells_too_coarse_for_the_curvature_are_refused() -> None:
    angle = 5 * pc.pi / 3 * u
    bent = point_equation(((2 + v) * pc.cos(angle), (2 + v) * pc.sin(angle), w), name="bent")
    mesh_equation(bent, MeshOptions(cells=(6, 1, 1)))
    with pytest.raises(InvertedElementError, match=r"inverted or flat.*; take more, or order 2$"):
        mesh_equation(bent, MeshOptions(cells=(1, 1, 1)))
    turn = 2 * pc.pi * v
    r = w * (1 - 0.7 * pc.sin(turn) ** 8)
    drill = point_equation((r * pc.cos(turn), r * pc.sin(turn), u), name="drill")
    with pytest.raises(InvertedElementError, match=r"; take more$"):
        mesh_equation(drill, MeshOptions(cells=(1, 22, 4), core="ogrid", order=2))


# -- tables ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", ["hexahedron", "wedge", "tetra", "quad", "triangle"])
def test_shape_functions_are_one_at_their_node_and_sum_to_one(name: str, order: int) -> None:
    places, weights = rule(name, 3)
    assert shapes(name, order, places).sum(axis=1) == pytest.approx(1.0)
    assert gradients(name, order, places).sum(axis=2) == pytest.approx(0.0, abs=1e-12)
    sizes = {"hexahedron": 1, "wedge": 1 / 2, "tetra": 1 / 6, "quad": 1, "triangle": 1 / 2}
    assert weights.sum() == pytest.approx(sizes[name])


@pytest.mark.parametrize("name", TYPES)
def test_faces_of_an_element_close_and_point_outwards(name: str) -> None:
    kind = TYPES[name]
    points = np.array(kind.corners, dtype=float)
    middle = points.mean(axis=0)
    total = np.zeros(3)
    for ring in kind.faces:
        corners = points[list(ring)]
        following = np.roll(corners, -1, axis=0)
        normal = np.cross(corners - middle, following - middle).sum(axis=0)
        assert normal @ (corners.mean(axis=0) - middle) > 0
        total = total + normal
    assert total == pytest.approx(np.zeros(3), abs=1e-12)


def test_patterns_of_collapse_have_their_types() -> None:
    def kinds(pattern: tuple[int, ...]) -> list[str]:
        return sorted(piece.kind.name for piece in Cuts().pieces(pattern))

    assert kinds((0, 1, 2, 3, 0, 1, 6, 7)) == ["wedge"]
    assert kinds((0, 1, 2, 3, 4, 4, 4, 4)) == ["pyramid"]
    assert kinds((0, 1, 2, 0, 4, 4, 4, 4)) == ["tetra"]
    assert kinds((0, 0, 2, 3, 4, 5, 6, 7)) == ["pyramid"] * 2
    assert kinds((0, 1, 2, 3, 0, 5, 2, 3)) == ["tetra"] * 2
    assert is_flat((0, 0, 0, 0, 4, 4, 4, 4))
