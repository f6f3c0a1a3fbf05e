"""Conforming tetrahedra of the B-rep by gmsh, with the names of the sides."""

from __future__ import annotations

import signal
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from OCP.BRep import BRep_Builder
from OCP.BRepGProp import BRepGProp
from OCP.BRepTools import BRepTools
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_FACE
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Compound, TopoDS_Face, TopoDS_Shape
from OCP.TopTools import TopTools_FormatVersion

from pc2cad.arrays import Integers
from pc2cad.brep.kernel import IndexedMapOfShape
from pc2cad.errors import KernelError
from pc2cad.mesh.elements import TETRAHEDRON
from pc2cad.mesh.volume_mesh import Facets, VolumeMesh, by_layer, by_whole_side
from pc2cad.topology.cells import SideKey

#: gmsh numbers the last two middles of a tetrahedron the other way round
_FROM_GMSH = {1: [0, 1, 2, 3], 2: [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]}


class MeshingFailedError(KernelError):
    """Gmsh made no mesh of the solid, or not of all its faces."""


def tetrahedra(
    solid: TopoDS_Shape,
    faces: Mapping[SideKey, TopoDS_Face],
    size: float,
    order: int = 1,
    *,
    name: str = "part",
    units: str = "mm",
    layers: Mapping[str, TopoDS_Shape] | None = None,
) -> VolumeMesh:
    """Return tetrahedra with edges of about `size` (model units) that fill a solid.

    `faces` are the solid's faces by their side, `layers` the solids that it consists
    of, which share the faces between them. Needs gmsh (``pc2cad[fea]``). Raises MeshingFailedError.
    """
    layers = layers or {}
    solid = _together(layers.values()) if layers else solid
    names = _in_order(solid, faces)
    with _model(solid) as gmsh:
        surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
        _check_order(gmsh, surfaces, names, faces)
        gmsh.option.setNumber("Mesh.MeshSizeMin", size / 2)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 12)
        gmsh.option.setNumber("Mesh.ElementOrder", order)
        gmsh.option.setNumber("Mesh.HighOrderOptimize", 2 if order == 2 else 0)
        try:
            gmsh.model.mesh.generate(3)
        except Exception as failure:  # gmsh raises the base class
            raise MeshingFailedError(
                f"gmsh made no mesh of the solid ({failure}); another --size may help"
            ) from None
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        parts, triangles = _elements(gmsh, surfaces, order)
    block = np.concatenate(parts) if parts else np.empty((0, TETRAHEDRON.size(order)), np.int64)
    if not len(block) or len(parts) != max(1, len(layers)):
        raise MeshingFailedError("gmsh made no tetrahedra of the solid; another --size may help")
    on_sides = {side: rows for side, rows in zip(names, triangles, strict=True) if side is not None}
    mesh = _mesh(tags, coordinates, block, on_sides, order, name, units)
    number = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return replace(mesh, layers=by_layer(list(layers), {TETRAHEDRON.name: number}))


def _together(solids: Iterable[TopoDS_Shape]) -> TopoDS_Compound:
    """Return solids as one shape, in their order."""
    builder, whole = BRep_Builder(), TopoDS_Compound()
    builder.MakeCompound(whole)
    for solid in solids:
        builder.Add(whole, solid)
    return whole


def _in_order(solid: TopoDS_Shape, faces: Mapping[SideKey, TopoDS_Face]) -> list[SideKey | None]:
    """Return the faces' names in the order in which gmsh numbers them; None between layers."""
    found = IndexedMapOfShape()
    TopExp.MapShapes_s(solid, TopAbs_FACE, found)
    names = {found.FindIndex(face): name for name, face in faces.items()}
    return [names.get(index) for index in range(1, found.Extent() + 1)]


@contextmanager
def _model(solid: TopoDS_Shape) -> Iterator[Any]:
    """Give gmsh with the solid in a model of its own; a running gmsh keeps its models."""
    import gmsh

    running = bool(gmsh.isInitialized())
    if not running:
        # PETSc within gmsh would obey a file .petscrc in the current folder; builds of gmsh without
        # it do not know the option, and say so unless they are silent
        quiet = ["pc2cad", "-v", "0", "-skip_petscrc"]
        gmsh.initialize(quiet, readConfigFiles=False, interruptible=False)
        _let_closed_pipes_raise()
        gmsh.option.setNumber("General.Verbosity", 5)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Geometry.OCCAutoFix", 0)
    try:
        gmsh.model.add("pc2cad")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "solid.brep"
            version = TopTools_FormatVersion.TopTools_FormatVersion_VERSION_1
            BRepTools.Write_s(solid, str(path), False, False, version)
            gmsh.model.occ.importShapes(str(path))
        gmsh.model.occ.synchronize()
        yield gmsh
    finally:
        if running:
            gmsh.model.remove()
        else:
            gmsh.finalize()


def _let_closed_pipes_raise() -> None:
    """Put back what Python does when who reads from us has gone: gmsh lets it end the process."""
    with suppress(ValueError, AttributeError):  # not in the main thread; no such signal
        signal.signal(signal.SIGPIPE, signal.getsignal(signal.SIGPIPE))


def _check_order(
    gmsh: Any,
    surfaces: list[int],
    names: list[SideKey | None],
    faces: Mapping[SideKey, TopoDS_Face],
) -> None:
    """Hold the area of each surface in gmsh against that of the face it is taken for."""
    if len(surfaces) != len(names):
        raise MeshingFailedError(
            f"gmsh read {len(surfaces)} faces of a solid that has {len(names)}"
        )
    for tag, name in zip(surfaces, names, strict=True):
        if name is None:
            continue
        found = GProp_GProps()
        BRepGProp.SurfaceProperties_s(faces[name], found)
        here, there = found.Mass(), gmsh.model.occ.getMass(2, tag)
        if abs(here - there) > 1e-3 * here:
            raise MeshingFailedError(
                f"gmsh's surface {tag} has the area {there:.6g}, the face {name.label} {here:.6g}"
            )


def _elements(gmsh: Any, surfaces: list[int], order: int) -> tuple[list[Integers], list[Integers]]:
    """Return the tetrahedra per volume and the corners of triangles per surface.

    They are in gmsh's numbers of nodes.
    """
    size = TETRAHEDRON.size(order)
    volumes: list[Integers] = []
    for _, tag in gmsh.model.getEntities(3):
        _, _, nodes = gmsh.model.mesh.getElements(3, tag)
        rows = [np.asarray(n, dtype=np.int64).reshape(-1, size) for n in nodes]
        volumes += [row[:, _FROM_GMSH[order]] for row in rows]
    triangles: list[Integers] = []
    for tag in surfaces:
        _, _, nodes = gmsh.model.mesh.getElements(2, tag)
        rows = [np.asarray(n, dtype=np.int64).reshape(-1, 3 * order)[:, :3] for n in nodes]
        triangles.append(np.concatenate(rows) if rows else np.empty((0, 3), dtype=np.int64))
    return volumes, triangles


def _mesh(
    tags: Any,
    coordinates: Any,
    block: Integers,
    triangles: dict[SideKey, Integers],
    order: int,
    name: str,
    units: str,
) -> VolumeMesh:
    used = np.unique(block)
    place = np.empty(int(np.max(tags)) + 1, dtype=np.int64)
    place[np.asarray(tags, dtype=np.int64)] = np.arange(len(tags))
    points = np.asarray(coordinates).reshape(-1, 3)[place[used]]
    block = np.searchsorted(used, block)
    on_side = {
        side: _facets(block, np.searchsorted(used, rows)) for side, rows in triangles.items()
    }
    kind = TETRAHEDRON.name
    sides: dict[str, tuple[Facets, ...]] = {}
    for side, (elements, faces) in on_side.items():
        # a side in pieces is one set as well
        for label in by_whole_side(side):
            sides[label] = (*sides.get(label, ()), Facets(kind, elements, faces))
    pieces = frozenset(side.label for side in triangles if side.is_piece)
    mesh = VolumeMesh(name, units, order, points, {kind: block}, sides, {}, pieces=pieces)
    sets = {side: np.unique(mesh.facet_nodes(side)["triangle"]) for side in sides}
    return replace(mesh, node_sets=sets)


def _facets(block: Integers, triangles: Integers) -> tuple[Integers, Integers]:
    """Return the tetrahedra and the faces of theirs that some triangles are."""
    rings = [np.sort(block[:, list(ring)], axis=1) for ring in TETRAHEDRON.faces]
    rows = np.concatenate([np.sort(triangles, axis=1), *rings])
    _, key = np.unique(rows, axis=0, return_inverse=True)
    found = np.flatnonzero(np.isin(key.ravel()[len(triangles) :], key.ravel()[: len(triangles)]))
    if len(found) != len(triangles):
        raise MeshingFailedError("gmsh's triangles are not the faces of its tetrahedra")
    return found % len(block), (found // len(block)).astype(np.int8)
