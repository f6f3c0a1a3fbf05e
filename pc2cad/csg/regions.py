"""The regions of a part of several bodies: pieces that lie in the same bodies, for its mesh.

The bodies are cut along one another, so that neighbours share their faces, and the Boolean
expression is asked of each piece: a piece that lies in block and bore is none of cut(block, bore).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pc2cad.brep.booleans import NamedShape, label, moved
from pc2cad.brep.fragments import Fragment, Fragments, fragments
from pc2cad.brep.integrals import faces_of, solid_integrals
from pc2cad.errors import KernelError
from pc2cad.mesh.tetrahedra import KernelSolid, NamedSurface
from pc2cad.part import Body
from pc2cad.templates.bodies import Pattern, Tree
from pc2cad.templates.patterns import Placement
from pc2cad.topology.cells import SideKey

if TYPE_CHECKING:
    from OCP.TopoDS import TopoDS_Face, TopoDS_Solid

#: what the regions' volume may be off the part's, of that: the kernel cuts along its own edges
AGREE = 1e-5
_none: frozenset[str] = frozenset()
#: says of which bodies a piece that lies in some is made, in the result; of none: it is not of it
_Made = Callable[[frozenset[str]], frozenset[str]]


class RegionsDisagreeError(KernelError):
    """The pieces of the bodies are not what the part holds."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of a part."""

    #: of the region that it is in
    name: str
    solid: TopoDS_Solid
    #: the bodies that it is made of: what is cut from others is none of these any more
    bodies: frozenset[str]
    #: as they are turned, and the sides that each is a part of
    faces: tuple[tuple[TopoDS_Face, tuple[SideKey, ...]], ...]


@dataclass(frozen=True)
class Told:
    """What the report of a part says of it, to hold the regions against."""

    name: str
    units: str
    volume: float
    #: what is one place
    one: float


def regions(result: Tree, parts: Mapping[str, Body], told: Told) -> KernelSolid:
    """Return a part's regions as what tetrahedra are made of: a layer for each set of bodies.

    Raises KernelError, RegionsDisagreeError where volumes do not agree.
    """
    found, pieces, names, _ = _cut(result, parts, told)
    volumes = {id(piece): solid_integrals(piece.solid).volume for piece in pieces}
    total = sum(volumes.values())
    if not abs(total - told.volume) <= AGREE * told.volume:
        raise RegionsDisagreeError(
            f"cut along one another the bodies have {total:.10g} {told.units}^3 in the result, and "
            f"the part has {told.volume:.10g}: no mesh is made of them"
        )
    outer, between = _surfaces(found, pieces, names)
    areas: dict[str, float] = {}
    for surface, area in outer:
        for name in surface.sets:
            areas[name] = areas.get(name, 0.0) + area
    pieces = sorted(pieces, key=lambda piece: names[id(piece)])
    return KernelSolid(
        pieces[0].solid, told.name, told.units, told.volume,
        tuple(surface for surface, _ in outer),
        frozenset(s.sets[-1] for s, _ in outer if len(s.sets) > 1), areas,
        tuple((names[id(piece)], piece.solid, volumes[id(piece)]) for piece in pieces), between,
    )  # fmt: skip


def pieces_of(result: Tree, parts: Mapping[str, Body], told: Told) -> list[Piece]:
    """Return the pieces of a part; raise KernelError."""
    found, pieces, names, made = _cut(result, parts, told)
    rows = []
    for piece in pieces:
        keys = (found.faces[index][1] for index in piece.faces)
        faces = tuple(zip(faces_of(piece.solid), keys, strict=True))
        rows.append(Piece(names[id(piece)], piece.solid, made(piece.bodies), faces))
    return rows


def _cut(
    result: Tree, parts: Mapping[str, Body], told: Told
) -> tuple[Fragments, list[Fragment], dict[int, str], _Made]:
    """Return the bodies cut along one another, the pieces of the result, and their names."""
    bodies: dict[str, NamedShape] = {}
    made = _placed(result, parts, Placement(np.eye(3), np.zeros(3)), "", bodies)
    found = fragments(bodies, told.one)
    pieces = [piece for piece in found.pieces if made(piece.bodies)]
    order = list(bodies)
    return found, pieces, {id(piece): _name(piece.bodies, order) for piece in pieces}, made


def _placed(
    tree: Tree, parts: Mapping[str, Body], place: Placement, mark: str, into: dict[str, NamedShape]
) -> _Made:
    """Put the bodies of a tree where they lie; return what says which pieces are of the result."""
    if isinstance(tree, str):
        name = f"{tree}{mark}"
        shape = NamedShape(
            parts[tree].shape,
            tuple(
                (face, (replace(key, body=tree),)) for key, face in parts[tree].kernel_sides.items()
            ),
        )
        into[name] = moved(shape, place.turn, place.offset, mark) if mark else shape
        return lambda bodies: bodies & {name}
    if isinstance(tree, Pattern):
        inner = [
            _placed(tree.operand, parts, place.after(copy), f"[{k}]{mark}", into)
            for k, copy in enumerate(tree.copies)
        ]
        return lambda bodies: _none.union(*(made(bodies) for made in inner))
    first, *others = (_placed(operand, parts, place, mark, into) for operand in tree.operands)
    if tree.kind == "union":
        return lambda bodies: first(bodies).union(*(made(bodies) for made in others))
    if tree.kind == "intersect":
        return lambda bodies: _all([first(bodies), *(made(bodies) for made in others)])
    return lambda bodies: _none if any(made(bodies) for made in others) else first(bodies)


def _all(made: list[frozenset[str]]) -> frozenset[str]:
    return _none.union(*made) if all(made) else _none


def _name(bodies: frozenset[str], order: list[str]) -> str:
    return " & ".join(sorted(bodies, key=order.index))


def _surfaces(
    found: Fragments, pieces: list[Fragment], names: Mapping[int, str]
) -> tuple[list[tuple[NamedSurface, float]], tuple[NamedSurface, ...]]:
    """Return the faces that bound the part, with their areas, and those between its regions."""
    beside: dict[int, list[Fragment]] = {}
    area: dict[int, float] = {}
    for piece in pieces:
        measured = solid_integrals(piece.solid).face_areas
        for face, size in zip(piece.faces, measured, strict=True):
            beside.setdefault(face, []).append(piece)
            area[face] = size
    outer, between = [], []
    for index, around in beside.items():
        face, sides = found.faces[index]
        if len(around) == 1:
            outer.append((NamedSurface(face, _sets(sides)), area[index]))
        else:
            of = " | ".join(sorted({names[id(piece)] for piece in around}))
            between.append(NamedSurface(face, (of,)))
    return outer, tuple(between)


def _sets(sides: tuple[SideKey, ...]) -> tuple[str, ...]:
    """Return the sets of a face: its side, and its own piece of one."""
    return tuple(dict.fromkeys((label(tuple(side.whole for side in sides)), label(sides))))
