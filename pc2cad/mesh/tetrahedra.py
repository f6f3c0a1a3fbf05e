"""Conforming tetrahedra of the B-rep by gmsh, with the names of the sides."""

from __future__ import annotations

import signal
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from OCP.BRepGProp import BRepGProp
from OCP.BRepTools import BRepTools
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_FACE
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape
from OCP.TopTools import TopTools_FormatVersion

from pc2cad.arrays import Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.brep.kernel import IndexedMapOfShape, compound
from pc2cad.errors import KernelError
from pc2cad.mesh.elements import TETRAHEDRON
from pc2cad.mesh.volume_mesh import Facets, VolumeMesh, by_layer

#: how gmsh's complaints begin that it could not place middles of edges as well as it wishes
_MIDDLES = ("Failed to reach critical value", "Optimization failed")
#: gmsh numbers the last two middles of a tetrahedron the other way round
_FROM_GMSH = {1: [0, 1, 2, 3], 2: [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]}


@dataclass(frozen=True, eq=False)
class NamedSurface:
    """A face of the solid, and the sets that its triangles belong to."""

    face: TopoDS_Face
    #: the side, and its own piece of one where that is in several
    sets: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class KernelSolid:
    """A part as far as tetrahedra need it: its solid, and what is known of it (model units)."""

    shape: TopoDS_Shape
    name: str
    units: str
    volume: float
    surfaces: tuple[NamedSurface, ...]
    #: names of sets that are pieces of a side
    pieces: frozenset[str]
    #: set -> its area
    areas: Mapping[str, float]
    #: the solids that it consists of, which share the faces between them: the layer (or region)
    #: that each belongs to, and its volume
    solids: tuple[tuple[str, TopoDS_Shape, float], ...] = ()
    #: faces between solids by name: their nodes are a set
    interfaces: tuple[NamedSurface, ...] = ()

    @property
    def layers(self) -> dict[str, float]:
        """The volume of each layer by name."""
        found: dict[str, float] = {}
        for name, _, volume in self.solids:
            found[name] = found.get(name, 0.0) + volume
        return found


class MeshingFailedError(KernelError):
    """Gmsh made no mesh of the solid, or not of all its faces."""


def tetrahedra(part: KernelSolid, size: float, order: int = 1) -> VolumeMesh:
    """Return tetrahedra with edges of about `size` (model units) that fill a solid.

    Needs gmsh (``pc2cad[fea]``). Raises MeshingFailedError.
    """
    layers = list(part.layers)
    solid = compound(solid for _, solid, _ in part.solids) if layers else part.shape
    faces = _in_order(solid, (*part.surfaces, *part.interfaces))
    with _model(solid) as gmsh:
        surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
        _check_order(gmsh, surfaces, faces)
        gmsh.option.setNumber("Mesh.MeshSizeMin", size / 2)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 12)
        gmsh.option.setNumber("Mesh.ElementOrder", order)
        gmsh.option.setNumber("Mesh.HighOrderOptimize", 2 if order == 2 else 0)
        _generate(gmsh)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        parts, triangles = _elements(gmsh, surfaces, order)
    block = np.concatenate(parts) if parts else np.empty((0, TETRAHEDRON.size(order)), np.int64)
    if not len(block) or len(parts) != max(1, len(part.solids)):
        raise MeshingFailedError("gmsh made no tetrahedra of the solid; another --size may help")
    between = {id(surface) for surface in part.interfaces}
    on_sides: dict[str, list[Integers]] = {}
    inside: dict[str, list[Integers]] = {}
    for surface, rows in zip(faces, triangles, strict=True):
        for name in surface.sets if surface is not None else ():
            found = inside if id(surface) in between else on_sides
            found.setdefault(name, []).append(rows)
    mesh = _mesh(part, tags, coordinates, block, on_sides, inside, order)
    own = [layers.index(name) for name, _, _ in part.solids] or [0]
    number = np.repeat(own, [len(rows) for rows in parts])
    return replace(mesh, layers=by_layer(layers, {TETRAHEDRON.name: number}))


def _in_order(solid: TopoDS_Shape, surfaces: Iterable[NamedSurface]) -> list[NamedSurface | None]:
    """Return faces in the order in which gmsh numbers them; None for those without a name."""
    found = IndexedMapOfShape()
    TopExp.MapShapes_s(solid, TopAbs_FACE, found)
    named = {found.FindIndex(surface.face): surface for surface in surfaces}
    return [named.get(index) for index in range(1, found.Extent() + 1)]


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


def _generate(gmsh: Any) -> None:
    """Let gmsh make the mesh; raise MeshingFailedError with its reason.

    What is wrong within its threads would end the process if it were raised there. Middles of edges
    that could not be placed as well as it wishes are no failure: the mesh is measured by us.
    """
    raises = gmsh.option.getNumber("General.AbortOnError")
    gmsh.option.setNumber("General.AbortOnError", 0)
    gmsh.logger.start()
    try:
        gmsh.model.mesh.generate(3)
        said = gmsh.logger.get()
    except Exception as failure:  # gmsh raises the base class
        said = [f"Error: {failure}"]
    finally:
        gmsh.logger.stop()
        gmsh.option.setNumber("General.AbortOnError", raises)
    errors = [line.removeprefix("Error: ") for line in said if line.startswith("Error: ")]
    errors = [error for error in errors if not error.startswith(_MIDDLES)]
    if errors:
        raise MeshingFailedError(
            f"gmsh made no mesh of the solid ({errors[0]}); another --size may help"
        )


def _let_closed_pipes_raise() -> None:
    """Put back what Python does when who reads from us has gone: gmsh lets it end the process."""
    with suppress(ValueError, AttributeError):  # not in the main thread; no such signal
        signal.signal(signal.SIGPIPE, signal.getsignal(signal.SIGPIPE))


def _check_order(
    gmsh: Any,
    surfaces: list[int],
    faces: list[NamedSurface | None],
) -> None:
    """Hold the area of each surface in gmsh against that of the face it is taken for."""
    if len(surfaces) != len(faces):
        raise MeshingFailedError(
            f"gmsh read {len(surfaces)} faces of a solid that has {len(faces)}"
        )
    for tag, surface in zip(surfaces, faces, strict=True):
        if surface is None:
            continue
        found = GProp_GProps()
        BRepGProp.SurfaceProperties_s(surface.face, found)
        here, there = found.Mass(), gmsh.model.occ.getMass(2, tag)
        if abs(here - there) > 1e-3 * here:
            raise MeshingFailedError(
                f"gmsh's surface {tag} has the area {there:.6g}, the face {surface.sets[-1]} "
                f"{here:.6g}"
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
    part: KernelSolid,
    tags: Any,
    coordinates: Any,
    block: Integers,
    triangles: Mapping[str, list[Integers]],
    inside: Mapping[str, list[Integers]],
    order: int,
) -> VolumeMesh:
    """Return the mesh of tetrahedra in gmsh's numbers of nodes, and of triangles by set."""
    used = distinct(block)
    place = np.empty(int(np.max(tags)) + 1, dtype=np.int64)
    place[np.asarray(tags, dtype=np.int64)] = np.arange(len(tags))
    points = np.asarray(coordinates).reshape(-1, 3)[place[used]]
    block = np.searchsorted(used, block)
    kind = TETRAHEDRON.name
    found = {
        name: Facets(kind, *_facets(block, np.searchsorted(used, np.concatenate(rows))))
        for name, rows in {**triangles, **inside}.items()
    }
    sides = {name: (found[name],) for name in triangles}
    mesh = VolumeMesh(
        part.name, part.units, order, points, {kind: block}, sides, {}, pieces=part.pieces
    )
    # between solids there are nodes only: facets of the mesh bound it
    every = replace(mesh, sides={name: (facets,) for name, facets in found.items()})
    sets = {name: distinct(every.facet_nodes(name)["triangle"]) for name in found}
    return replace(mesh, node_sets=sets)


def _facets(block: Integers, triangles: Integers) -> tuple[Integers, Integers]:
    """Return the tetrahedra and the faces of theirs that some triangles are.

    Of two that share a triangle between solids it is one.
    """
    rings = [np.sort(block[:, list(ring)], axis=1) for ring in TETRAHEDRON.faces]
    rows = np.concatenate([np.sort(triangles, axis=1), *rings])
    _, key = np.unique(rows, axis=0, return_inverse=True)
    wanted, of_faces = key.ravel()[: len(triangles)], key.ravel()[len(triangles) :]
    found = np.flatnonzero(np.isin(of_faces, wanted))
    found = found[np.unique(of_faces[found], return_index=True)[1]]
    if len(found) != len(triangles):
        raise MeshingFailedError("gmsh's triangles are not the faces of its tetrahedra")
    return found % len(block), (found // len(block)).astype(np.int8)
