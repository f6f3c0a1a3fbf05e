"""Solids that overlap or touch, cut along one another: the pieces share the faces between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from OCP.BRepAlgoAPI import BRepAlgoAPI_BuilderAlgo
from OCP.Standard import Standard_Failure
from OCP.TopAbs import TopAbs_FACE, TopAbs_SOLID
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Face, TopoDS_Solid

from pc2cad.brep.booleans import NamedShape, images, listed, named_faces
from pc2cad.brep.kernel import IndexedMapOfShape, as_solid
from pc2cad.errors import KernelError
from pc2cad.topology.cells import SideKey


@dataclass(frozen=True, eq=False)
class Fragment:
    """A piece, the bodies that it belongs to, and its faces by their numbers among all."""

    solid: TopoDS_Solid
    bodies: frozenset[str]
    faces: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Fragments:
    """The pieces of several bodies, and all faces with the sides that they are parts of."""

    pieces: tuple[Fragment, ...]
    faces: tuple[tuple[TopoDS_Face, tuple[SideKey, ...]], ...]


def fragments(bodies: Mapping[str, NamedShape], one: float) -> Fragments:
    """Return bodies cut along one another; what is nearer than the length `one` is one place.

    Raises KernelError where the kernel fails, or loses track of a piece.
    """
    algorithm = BRepAlgoAPI_BuilderAlgo()
    algorithm.SetArguments(listed([body.shape for body in bodies.values()]))
    algorithm.SetRunParallel(False)
    algorithm.SetNonDestructive(True)
    algorithm.SetFuzzyValue(one)
    try:
        algorithm.Build()
    except Standard_Failure as failure:
        raise KernelError(f"the CAD kernel refused to cut the bodies apart: {failure}") from failure
    if not algorithm.IsDone():
        raise KernelError("the CAD kernel could not cut the bodies apart")
    solids, faces = IndexedMapOfShape(), IndexedMapOfShape()
    TopExp.MapShapes_s(algorithm.Shape(), TopAbs_SOLID, solids)
    TopExp.MapShapes_s(algorithm.Shape(), TopAbs_FACE, faces)
    owners: dict[int, set[str]] = {i: set() for i in range(1, solids.Extent() + 1)}
    for name, body in bodies.items():
        for solid in body.solids:
            for index in images(algorithm, solid, solids):
                owners[index].add(name)
    if not all(owners.values()):
        raise KernelError("the CAD kernel made a piece that belongs to no body")
    pieces = []
    for index, held in owners.items():
        found = IndexedMapOfShape()
        TopExp.MapShapes_s(solids.FindKey(index), TopAbs_FACE, found)
        mine = (faces.FindIndex(found.FindKey(k)) - 1 for k in range(1, found.Extent() + 1))
        pieces.append(Fragment(as_solid(solids.FindKey(index)), frozenset(held), tuple(mine)))
    return Fragments(tuple(pieces), tuple(named_faces(algorithm, tuple(bodies.values()))))
