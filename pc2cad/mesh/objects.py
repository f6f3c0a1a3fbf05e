"""A volume mesh as an object of another library, with its sets; each is imported when asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.errors import InputError, require
from pc2cad.mesh.full import full

if TYPE_CHECKING:
    from pc2cad.mesh.volume_mesh import VolumeMesh

#: shape -> names in meshio, of orders 1 and 2
_NAMES = {
    "hexahedron": ("hexahedron", "hexahedron20"), "wedge": ("wedge", "wedge15"),
    "pyramid": ("pyramid", "pyramid13"), "tetra": ("tetra", "tetra10"),
    "quad": ("quad", "quad8"), "triangle": ("triangle", "triangle6"),
}  # fmt: skip


def to_meshio(mesh: VolumeMesh, nodes: Literal[20, 27] = 20) -> Any:
    """Return a `meshio.Mesh`: elements, then the facets of all sides.

    Sides are `cell_sets` (of facets) and `point_sets`, layers `cell_sets` of elements; u, v, w and
    fields are `point_data` and, within elements and facets, `cell_data`. Hexahedra of order 2 may
    have 27 `nodes`, ``hexahedron27`` and ``quad9``; then there are no `point_data`.

    Raises InputError where there are wedges or pyramids of order 2, which meshio reads and has no
    objects of; PackageMissingError.
    """
    require("meshio", "meshes of meshio", "meshio")
    import meshio

    whole = full(mesh) if nodes == 27 else None
    if mesh.order == 2 and mesh.blocks.keys() & {"wedge", "pyramid"}:
        raise InputError(
            "meshio has no objects of wedges and pyramids of order 2: take --core ogrid, order 1, "
            "or a file .vtu"
        )

    cells: list[tuple[str, Integers]] = list(mesh.blocks.items())
    own: dict[str, dict[int, Integers]] = {
        name: {list(mesh.blocks).index(kind): numbers for kind, numbers in layer.items()}
        for name, layer in mesh.layers.items()
    }
    for side in mesh.whole_sides:
        for shape, rows in mesh.facet_nodes(side).items():
            own.setdefault(side, {})[len(cells)] = np.arange(len(rows))
            cells.append((shape, rows))
    none = np.zeros(0, dtype=np.int64)
    sets = {name: [there.get(i, none) for i in range(len(cells))] for name, there in own.items()}
    if whole is not None:
        return meshio.Mesh(
            whole.points,
            [("hexahedron27", whole.elements), *(("quad9", whole.facets(c)) for _, c in cells[1:])],
            cell_data=_in_cells(mesh), cell_sets=sets,
        )  # fmt: skip
    return meshio.Mesh(
        mesh.points, [(_NAMES[shape][mesh.order - 1], nodes) for shape, nodes in cells],
        point_data=_at_nodes(mesh), cell_data=_in_cells(mesh), cell_sets=sets,
        point_sets=dict(mesh.node_sets),
    )  # fmt: skip


def _at_nodes(mesh: VolumeMesh) -> dict[str, Array]:
    if mesh.columns is None:
        return {}
    return {name: _plain(mesh.columns.at_nodes(name)) for name in mesh.columns.sizes}


def _in_cells(mesh: VolumeMesh) -> dict[str, list[Array]]:
    """Return columns within elements by type, then within facets by side and shape."""
    columns = mesh.columns
    if columns is None:
        return {}
    return {
        name: [
            *(_plain(columns.in_elements(name, kind)) for kind in mesh.blocks),
            *(
                _plain(rows)
                for side in mesh.whole_sides
                for rows in columns.in_facets(name, side).values()
            ),
        ]
        for name in columns.sizes
    }


def _plain(rows: Array) -> Array:
    return rows if rows.shape[1] > 1 else rows[:, 0]


def to_skfem(mesh: VolumeMesh) -> Any:
    """Return scikit-fem's mesh, its sides as boundaries, layers as subdomains.

    Its curved hexahedra have 27 nodes: those that order 2 has not are M's own. Raises InputError
    where elements are neither all hexahedra (of order 2, of a grid) nor all tetrahedra of order 1:
    scikit-fem has meshes of one shape; PackageMissingError.
    """
    require("skfem", "meshes of scikit-fem", "scikit-fem")
    import skfem

    (shape, block), *others = mesh.blocks.items()
    kind = {"hexahedron": skfem.MeshHex, "tetra": skfem.MeshTet}.get(shape)
    if others or kind is None or (mesh.order != 1 and shape == "tetra"):
        raise InputError(
            "scikit-fem takes hexahedra, or tetrahedra of order 1, and nothing beside them: the "
            f"mesh has {', '.join(mesh.blocks)} of order {mesh.order}"
        )
    if mesh.order == 2:
        from skfem.io.meshio import INV_HEX_MAPPING

        whole = full(mesh)
        found = skfem.MeshHex2(whole.points.T.copy(), whole.elements[:, INV_HEX_MAPPING].T.copy())
    else:
        # its corners 1, 2 and 3 are the neighbours of the first, the opposite one is the last
        columns = [0, 4, 3, 1, 7, 5, 2, 6] if shape == "hexahedron" else [0, 1, 2, 3]
        found = kind(mesh.points.T.copy(), block[:, columns].T.copy())
    corners = {"quad": 4, "triangle": 3}
    # it numbers corners alone, in the order of their nodes
    kept = np.unique(block[:, : 8 if shape == "hexahedron" else 4])
    numbers = {tuple(facet): i for i, facet in enumerate(np.sort(found.facets, axis=0).T.tolist())}
    sides = {
        side: np.array([
            numbers[tuple(facet)]
            for name, nodes in mesh.facet_nodes(side).items()
            for facet in np.searchsorted(kept, np.sort(nodes[:, : corners[name]], axis=1)).tolist()
        ])
        for side in mesh.whole_sides
    }  # fmt: skip
    found = found.with_boundaries(sides)
    layers = {name: layer[shape] for name, layer in mesh.layers.items()}
    return found.with_subdomains(layers) if layers else found
