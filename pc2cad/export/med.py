"""MED meshes (.med) for Salome and code_aster: HDF5 with the sides as groups of faces and nodes."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pc2cad.arrays import AnyArray, Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.export.mesh_files import cell_blocks, cell_values, column_names
from pc2cad.mesh.elements import TYPES
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.trust.names import percent, told_apart

_CODES = {
    ("hexahedron", 1): "HE8", ("hexahedron", 2): "H20", ("wedge", 1): "PE6", ("wedge", 2): "P15",
    ("pyramid", 1): "PY5", ("pyramid", 2): "P13", ("tetra", 1): "TE4", ("tetra", 2): "T10",
    ("quad", 1): "QU4", ("quad", 2): "QU8", ("triangle", 1): "TR3", ("triangle", 2): "TR6",
}  # fmt: skip
#: MED numbers the base of a volume the other way round
_CORNERS = {
    "hexahedron": (0, 3, 2, 1, 4, 7, 6, 5), "wedge": (0, 2, 1, 3, 5, 4),
    "pyramid": (0, 3, 2, 1, 4), "tetra": (0, 2, 1, 3),
}  # fmt: skip
_STEP = "-0000000000000000001-0000000000000000001"
#: characters of a group's name
_LONGEST = 80
_NO_PROFILE = np.bytes_("MED_NO_PROFILE_INTERNAL")


def write(mesh: VolumeMesh, path: Path) -> None:
    """Write the mesh, version 3.0 of the format, which all readers in use take."""
    import h5py

    # in memory: where the disk is full the library prints, or ends the process
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        _put(mesh, file)
    path.write_bytes(stream.getbuffer())


def _put(mesh: VolumeMesh, file: Any) -> None:
    sides = mesh.whole_sides
    _attributes(file.create_group("INFOS_GENERALES"), MAJ=3, MIN=0, REL=0)
    body = file.create_group("ENS_MAA").create_group("mesh")
    _attributes(
        body, DIM=3, ESP=3, REP=0, UNT=np.bytes_(" " * 16), SRT=1, TYP=0,
        UNI=np.bytes_(f"{mesh.units:<16}" * 3),
        NOM=np.bytes_("".join(f"{axis:<16}" for axis in "XYZ")),
        DES=np.bytes_(percent(mesh.name, "", limit=200)),
    )  # fmt: skip
    step = body.create_group(_STEP)
    _attributes(step, CGT=1, NDT=-1, NOR=-1, PDT=-1.0)
    family, groups = _node_families(mesh)
    nodes = step.create_group("NOE")
    _attributes(nodes, CGT=1, CGS=1, PFL=_NO_PROFILE)
    _column(nodes, "COO", mesh.points.T.ravel(), len(mesh.points))
    _column(nodes, "FAM", family, len(family))
    cells = step.create_group("MAI")
    _attributes(cells, CGT=1)
    groups_of_cells = [*sides, *mesh.layers]
    for code, rows, groups_of_rows in _sections(mesh, len(sides)):
        section = cells.create_group(code)
        _attributes(section, CGT=1, CGS=1, PFL=_NO_PROFILE)
        _column(section, "NOD", rows.T.ravel() + 1, len(rows))
        _column(section, "FAM", -groups_of_rows, len(rows))
    families = file.create_group("FAS").create_group("mesh")
    _attributes(families.create_group("FAMILLE_ZERO"), NUM=0)
    # nodes and faces of a side have groups of one name
    written = told_apart([*groups_of_cells, *mesh.node_sets], _LONGEST)
    _families(families.create_group("NOEUD"), groups, written)
    cells_by = {-k: [name] for k, name in enumerate(groups_of_cells, start=1)}
    _families(families.create_group("ELEME"), cells_by, written)
    if column_names(mesh):
        fields = file.create_group("CHA")
        for name, size in column_names(mesh).items():
            _field(fields, mesh, name, size)


def _field(parent: Any, mesh: VolumeMesh, name: str, size: int) -> None:
    """Write a column at the nodes and in the cells, both of one field at one time."""
    assert mesh.columns is not None
    labels = [name] if size == 1 else ["x", "y", "z"]
    field, none = parent.create_group(name), np.bytes_("")
    _attributes(
        field, MAI=np.bytes_("mesh"), TYP=6, UNI=np.bytes_(" " * 16 * size), UNT=none, NCO=size,
        NOM=np.bytes_("".join(f"{label[:16]:<16}" for label in labels)),
    )  # fmt: skip
    step = field.create_group(_STEP)
    _attributes(step, NDT=-1, NOR=-1, PDT=0.0, RDT=-1, ROR=-1)
    sections: dict[str, list[Array]] = {"NOE": [mesh.columns.at_nodes(name)]}
    for block, values in zip(cell_blocks(mesh), cell_values(mesh, name), strict=True):
        sections.setdefault(f"MAI.{_CODES[block.kind, mesh.order]}", []).append(values)
    for section, parts in sections.items():
        values, where = np.concatenate(parts), step.create_group(section)
        _attributes(where, GAU=none, PFL=_NO_PROFILE)
        profile = where.create_group(_NO_PROFILE.decode())
        _attributes(profile, NBR=len(values), NGA=1, GAU=none)
        profile.create_dataset("CO", data=values.T.ravel())


def _sections(mesh: VolumeMesh, sides: int) -> list[tuple[str, Integers, Integers]]:
    """Return code, nodes and numbers of groups, layers after sides: one for each type of cell."""
    merged: dict[str, list[tuple[Integers, int]]] = {}
    for block in cell_blocks(mesh):
        group = block.side or (sides + block.layer if block.layer else 0)
        nodes = _turned(block.kind, block.nodes, mesh.order)
        merged.setdefault(block.kind, []).append((nodes, group))
    return [
        (
            _CODES[kind, mesh.order],
            np.concatenate([nodes for nodes, _ in rows]),
            np.concatenate([np.full(len(nodes), group) for nodes, group in rows]),
        )
        for kind, rows in merged.items()
    ]


def _turned(kind: str, nodes: Integers, order: int) -> Integers:
    if kind not in _CORNERS:
        return nodes
    columns = list(_CORNERS[kind])
    if order == 2:
        corners, edges = len(columns), TYPES[kind].edges
        place = {frozenset(edge): corners + k for k, edge in enumerate(edges)}
        columns += [place[frozenset((columns[a], columns[b]))] for a, b in edges]
    return nodes[:, columns]


def _node_families(mesh: VolumeMesh) -> tuple[Integers, dict[int, list[str]]]:
    """Return the family of each node and the groups of each family: a node may be in many sets."""
    names = [name for name in mesh.node_sets if name not in mesh.pieces]
    family = np.zeros(len(mesh.points), dtype=np.int64)
    if not names:
        return family, {}
    some = distinct(np.concatenate([mesh.node_sets[name] for name in names]))
    held = np.zeros((len(some), len(names)), dtype=bool)
    for column, name in enumerate(names):
        held[np.searchsorted(some, mesh.node_sets[name]), column] = True
    # the last set decides first how families are numbered, and those of no set are number 1
    kinds, which = np.unique(held[:, ::-1], axis=0, return_inverse=True)
    first = 1 if len(some) == len(family) else 2
    family[some] = which.ravel() + first
    groups = {
        number: [name for name, has in zip(names, kind[::-1], strict=True) if has]
        for number, kind in enumerate(kinds, start=first)
    }
    return family, groups


def _families(
    parent: Any, families: Mapping[int, Sequence[str]], written: Mapping[str, str]
) -> None:
    for number, names in families.items():
        family = parent.create_group(f"FAM_{number}_" + percent("_".join(names), "/", limit=48))
        _attributes(family, NUM=number)
        group = family.create_group("GRO")
        _attributes(group, NBR=len(names))
        rows = np.zeros((len(names), _LONGEST), dtype=np.int8)
        for row, name in zip(rows, names, strict=True):
            text = written[name].encode("ascii")
            row[: len(text)] = np.frombuffer(text, dtype=np.int8)
        # an array type of 80 characters per name
        data = group.create_dataset("NOM", (len(names),), dtype="80int8")
        data[...] = rows


def _column(parent: Any, name: str, values: AnyArray, count: int) -> None:
    _attributes(parent.create_dataset(name, data=values), CGT=1, NBR=count)


def _attributes(target: Any, **values: Any) -> None:
    for name, value in values.items():
        target.attrs.create(name, value)
