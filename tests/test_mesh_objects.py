"""Volume meshes as objects of meshio and scikit-fem: the same nodes, elements and sets."""

from __future__ import annotations

import numpy as np
import pytest
from shipped import checked_of

import pc2cad as pc
from pc2cad.errors import InputError
from pc2cad.export.mesh_files import write_mesh
from pc2cad.mesh.grid import make_grid
from pc2cad.mesh.hexahedra import hexahedra
from pc2cad.mesh.meshing import MeshOptions, mesh_volume
from pc2cad.mesh.volume_mesh import VolumeMesh


def made(name: str, cells: tuple[int, int, int], order: int) -> VolumeMesh:
    checked = checked_of(name)
    return hexahedra(checked, make_grid(checked, cells), order)


@pytest.mark.parametrize(
    ("name", "order"), [("half_ball", 1), ("layered_pipe", 1), ("layered_pipe", 2)]
)
def test_meshio_has_every_element_and_set(name: str, order: int) -> None:
    mesh = made(name, (9, 4, 3), order)
    found = mesh.to_meshio()
    assert found.points is mesh.points or np.array_equal(found.points, mesh.points)
    assert sum(len(block.data) for block in found.cells[: len(mesh.blocks)]) == mesh.elements
    assert {*mesh.whole_sides, *mesh.layers} == set(found.cell_sets)
    assert set(found.point_sets) == set(mesh.node_sets)
    assert len(mesh.whole_sides) >= 2
    for side in mesh.whole_sides:
        rows = [
            block.data[numbers].ravel()
            for block, numbers in zip(found.cells, found.cell_sets[side], strict=True)
        ]
        assert np.array_equal(np.unique(np.concatenate(rows)), mesh.node_sets[side])


def test_meshio_writes_what_pc2cad_writes(tmp_path) -> None:
    meshio = pytest.importorskip("meshio")
    mesh = made("hollow_cylinder", (8, 2, 2), 2)
    write_mesh(mesh, tmp_path / "ours.vtu")
    mesh.to_meshio().write(tmp_path / "theirs.vtu")
    ours, theirs = meshio.read(tmp_path / "ours.vtu"), meshio.read(tmp_path / "theirs.vtu")
    assert np.array_equal(ours.points, theirs.points)
    for kind, data in theirs.cells_dict.items():
        assert np.array_equal(np.sort(data, axis=0), np.sort(ours.cells_dict[kind], axis=0))


def test_what_meshio_has_not_is_refused() -> None:
    with pytest.raises(InputError, match="no objects of wedges"):
        made("half_ball", (9, 4, 3), 2).to_meshio()


def test_scikit_fem_integrates_volume_and_sides() -> None:
    skfem = pytest.importorskip("skfem")
    u, v, w = pc.parameters()
    mesh = pc.mesh_part((2 * u, 3 * v + u * v / 2, w), cells=(3, 2, 2))
    found = mesh.to_skfem()
    inside = skfem.Basis(found, skfem.ElementHex1())
    assert skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(inside) == pytest.approx(
        mesh.volume(), rel=1e-12
    )
    assert set(found.boundaries) == set(mesh.whole_sides)
    for side in mesh.whole_sides:
        basis = skfem.FacetBasis(found, skfem.ElementHex1(), facets=side)
        area = skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(basis)
        assert area == pytest.approx(mesh.area(side), rel=1e-12)


def test_layers_are_subdomains_of_scikit_fem() -> None:
    pytest.importorskip("skfem")
    found = made("layered_pipe", (3, 8, 3), 1).to_skfem()
    assert set(found.subdomains) == {"inner", "pipe", "outer"}
    assert sum(map(len, found.subdomains.values())) == found.nelements


def test_scikit_fem_refuses_wedges() -> None:
    pytest.importorskip("skfem")
    with pytest.raises(InputError, match="order 1, and nothing beside them"):
        made("half_ball", (6, 3, 2), 1).to_skfem()


def test_hexahedra_of_27_nodes_lie_on_the_equation() -> None:
    """A pipe of radii 1 and 2, 8 cells round: order 4 in the volume, and every node on the map."""
    skfem = pytest.importorskip("skfem")
    mesh = mesh_volume(checked_of("elbow_pipe"), MeshOptions(cells=(6, 8, 2), order=2))[0]
    found = mesh.to_meshio(nodes=27)
    block, *facets = found.cells
    assert (block.type, block.data.shape) == ("hexahedron27", (96, 27))
    assert {cell.type for cell in facets} == {"quad9"}
    # each middle of a face is one node, of two cells or on a side
    assert len(found.points) == len(mesh.points) + 96 + (96 * 6 + 2 * 48 + 2 * 16) // 2
    x, y, z = found.points.T
    radius = np.hypot(np.hypot(x, y) - 3, z)
    assert np.abs(radius * 8 - np.round(radius * 8)).max() < 1e-12
    for side, value in (("w=0", 0.5), ("w=1", 1.0)):
        (rows,) = (c.data[s] for c, s in zip(found.cells, found.cell_sets[side], strict=True)
                   if len(s))  # fmt: skip
        np.testing.assert_allclose(radius[rows], value, rtol=1e-12)
    basis = skfem.Basis(mesh.to_skfem(), skfem.ElementHex1(), intorder=8)
    volume = skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(basis)
    exact = 2 * np.pi * 3 / 4 * np.pi * (1 - 0.25)
    assert volume == pytest.approx(exact, rel=1e-3)
    assert {*mesh.to_skfem().boundaries} == {*mesh.whole_sides}


@pytest.mark.parametrize(("name", "order"), [("half_ball", 2), ("hollow_cylinder", 1)])
def test_what_has_no_27_nodes_is_refused(name: str, order: int) -> None:
    with pytest.raises(InputError, match="hexahedra of order 2 of a"):
        made(name, (6, 3, 2), order).to_meshio(nodes=27)
