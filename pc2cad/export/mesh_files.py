"""The table of mesh formats, and writing a volume mesh to a file of any of them."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from pc2cad.arrays import Array, Integers
from pc2cad.errors import require
from pc2cad.export.files import by_ending, check_target, replacing
from pc2cad.mesh.elements import TYPES
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.trust.names import words


class MeshModule(Protocol):
    """What a module of a mesh format has."""

    def write(self, mesh: VolumeMesh, path: Path, /) -> None:
        """Write a mesh to an empty file."""
        ...


@dataclass(frozen=True)
class MeshFormat:
    """One mesh format: how it is recognised and specified, and what it keeps of the sets."""

    extension: str
    title: str
    #: address of the format's specification
    specification: str
    #: how the named sides are found in the file
    sets: str
    #: a `MeshModule`
    module: str
    #: packages beyond those that pc2cad always has; they come with ``pc2cad[fea]``
    packages: tuple[str, ...] = ()


MESH_FORMATS: tuple[MeshFormat, ...] = (
    MeshFormat(
        ".vtu",
        "VTK unstructured grid (XML, raw binary)",
        "https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html",
        "cell data 'side' and 'layer'; the number of each is the field data of its name",
        "pc2cad.export.vtu",
    ),
    MeshFormat(
        ".inp",
        "Abaqus and CalculiX input",
        "http://www.dhondt.de/ccx_2.20.pdf",
        "node sets, element sets (of layers too) and surfaces; u=0 is written u_0",
        "pc2cad.export.inp",
    ),
    MeshFormat(
        ".msh",
        "gmsh mesh 2.2 (binary)",
        "https://gmsh.info/doc/texinfo/gmsh.html#MSH-file-format-version-2-_0028Legacy_0029",
        "physical surfaces, and a physical volume for each layer",
        "pc2cad.export.gmsh_mesh",
    ),
    MeshFormat(
        ".vtk",
        "VTK legacy (binary)",
        "https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html",
        "cell data 'side' and 'layer', numbered in the order of the report",
        "pc2cad.export.vtk_legacy",
    ),
    MeshFormat(
        ".med",
        "MED (Salome, code_aster)",
        "https://docs.salome-platform.org/latest/dev/MEDCoupling/developer/med-file.html",
        "groups of faces, of nodes and of the elements of each layer",
        "pc2cad.export.med",
        ("h5py",),
    ),
)


def mesh_format(path: str | os.PathLike[str]) -> MeshFormat:
    """Return the format of a file name's ending; raise InputError where there is none.

    Raises PackageMissingError where a package that the format needs is not installed.
    """
    entry = by_ending(path, {entry.extension: entry for entry in MESH_FORMATS}, "mesh file")
    for package in entry.packages:
        require(package, f"{entry.extension} files")
    return entry


def check_mesh_writable(path: str | os.PathLike[str]) -> None:
    """Find out before a long computation whether a mesh can be written to `path`."""
    mesh_format(path)
    check_target(path)


def write_mesh(mesh: VolumeMesh, path: str | os.PathLike[str]) -> None:
    """Write a mesh in the format of the name's ending, whole or not at all.

    Raises InputError for an unknown ending, FileNotWrittenError.
    """
    module: MeshModule = importlib.import_module(mesh_format(path).module)
    with replacing(path) as temporary:
        module.write(mesh, temporary)


@dataclass(frozen=True)
class CellBlock:
    """Cells of one type and one set: volumes, or facets of a side."""

    kind: str
    #: (cells, nodes of each)
    nodes: Integers
    #: number of the whole side, from 1 on; 0 for volumes
    side: int = 0
    #: number of the layer, from 1 on; 0 for facets and where the solid is one
    layer: int = 0


def cell_blocks(mesh: VolumeMesh) -> list[CellBlock]:
    """Return all cells: volumes first, by layers where there are any, then the sides' facets."""
    layers = list(mesh.layers.values())
    blocks = [
        CellBlock(kind, mesh.blocks[kind][numbers], layer=k)
        for k, layer in enumerate(layers, start=1)
        for kind, numbers in layer.items()
    ] or [CellBlock(kind, block) for kind, block in mesh.blocks.items()]
    for number, side in enumerate(mesh.whole_sides, start=1):
        blocks += [
            CellBlock(shape, nodes, number) for shape, nodes in mesh.facet_nodes(side).items()
        ]
    return blocks


def column_names(mesh: VolumeMesh) -> Mapping[str, int]:
    """Return the columns that files have beside sides and layers, and their components."""
    return {} if mesh.columns is None else mesh.columns.sizes


def cell_values(mesh: VolumeMesh, name: str) -> Iterator[Array]:
    """Give a column within the cells, (cells, components), block by block as `cell_blocks`."""
    assert mesh.columns is not None
    for layer in mesh.layers.values():
        for kind, numbers in layer.items():
            yield mesh.columns.in_elements(name, kind)[numbers]
    for kind in () if mesh.layers else mesh.blocks:
        yield mesh.columns.in_elements(name, kind)
    for side in mesh.whole_sides:
        yield from mesh.columns.in_facets(name, side).values()


def reordered(
    kind: str, nodes: Integers, order: int, edges: tuple[tuple[int, int], ...]
) -> Integers:
    """Return the nodes of volume elements with the middles in another order of the edges."""
    if order == 1:
        return nodes
    own = {frozenset(edge): k for k, edge in enumerate(TYPES[kind].edges)}
    corners = len(TYPES[kind].corners)
    middles = [corners + own[frozenset(edge)] for edge in edges]
    return nodes[:, [*range(corners), *middles]]


def plain_names(names: Iterable[str]) -> dict[str, str]:
    """Return names of letters, digits and underscores: ``u=-1`` becomes ``u_m1``."""
    return words(names, taken=("solid",))
