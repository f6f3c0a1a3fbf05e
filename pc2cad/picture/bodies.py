"""Scenes of a solid made of several bodies: the kernel's faces and edges, named and coloured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pc2cad.arrays import Array
from pc2cad.brep.triangles import Triangles
from pc2cad.errors import InputError
from pc2cad.export.model import Exportable, ExportOptions
from pc2cad.export.surface import faces_in_order, smooth_normals, surface
from pc2cad.part import Part
from pc2cad.picture.colours import limits_of, paint, viridis
from pc2cad.picture.fields import check_scalar, on_faces
from pc2cad.picture.scene import Bar, Colour, Label, Lines, Scene, Surface
from pc2cad.picture.style import STEEL, Style


def shown_mesh(part: Part, turn: float) -> Triangles:
    """Return closed triangles of a part, chords turned by `turn` radians at most."""
    return surface(part.exportable(), ExportOptions(angular_deflection=turn))


def shown_faces(part: Part, mesh: Triangles, colour: Colour | None = None) -> Iterator[Surface]:
    """Yield the faces in the report's order, in one colour or each in its own or its body's.

    Triangles count faces in the kernel's order, which has the outer shell first.
    """
    painted = part.exportable(colours=True)
    for face, number in zip(painted.faces, _numbers(painted), strict=True):
        own = mesh.triangles[mesh.faces == number]
        used, triangles = np.unique(own, return_inverse=True)
        triangles, points = triangles.reshape(own.shape), mesh.vertices[used]
        yield Surface(
            face.name, points, triangles, smooth_normals(points, triangles),
            colour or face.colour or STEEL,
        )  # fmt: skip


def shown_edges(part: Part, mesh: Triangles) -> Iterator[tuple[tuple[int, int], Array]]:
    """Yield the polylines, (n, 3), along which the triangles of two faces meet, with these faces.

    Faces are counted in the report's order. Lines on the triangles' own sides are hidden by none.
    """
    order = {number: i for i, number in enumerate(_numbers(part.exportable()))}
    sides = mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    owners = np.repeat(mesh.faces, 3)
    rows = np.lexsort(np.sort(sides, axis=1).T)
    ends, owners = np.sort(sides[rows], axis=1), owners[rows]
    twin = (ends[1:] == ends[:-1]).all(axis=1) & (owners[1:] != owners[:-1])
    pairs: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for (a, b), first, second in zip(
        ends[1:][twin].tolist(), owners[1:][twin].tolist(), owners[:-1][twin].tolist(), strict=True
    ):
        low, high = sorted((order[first], order[second]))
        pairs.setdefault((low, high), []).append((a, b))
    for faces, segments in sorted(pairs.items()):
        for chain in _chains(segments):
            yield faces, mesh.vertices[chain]


def _numbers(solid: Exportable) -> list[int]:
    """Return the kernel's number of each face, in the report's order."""
    numbers = {id(face): number for number, face in enumerate(faces_in_order(solid))}
    return [numbers[id(face)] for face in solid.faces]


def _chains(segments: list[tuple[int, int]]) -> Iterator[list[int]]:
    """Yield the nodes along lines that the segments make, from an end where there is one."""
    beside: dict[int, list[int]] = {}
    for a, b in segments:
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    for start in sorted(beside, key=lambda node: len(beside[node]) != 1):
        while beside[start]:
            chain = [start]
            while beside[chain[-1]]:
                following = beside[chain[-1]].pop()
                beside[following].remove(chain[-1])
                chain.append(following)
            yield chain


def bodies_drawing(part: Part, style: Style, turn: float) -> Scene:
    """Return the scene of a part of several bodies; raise InputError for what it has not."""
    if style.isolines or style.points or style.map is not None:
        raise InputError(
            "parameter lines, point sets and maps belong to one equation; draw a body by itself "
            f"(--body: {', '.join(part.bodies)})"
        )
    mesh = shown_mesh(part, turn)
    faces = list(shown_faces(part, mesh, None if style.colours else STEEL))
    bar = None
    if style.field is not None:
        check_scalar(part, style.field)
        faces, bar = _painted(part, faces, style.field)
    offsets = [_offset(part, face, style.explode) for face in faces]
    moved = tuple(
        Surface(f.name, f.points + o, f.triangles, f.normals, f.colour)
        for f, o in zip(faces, offsets, strict=True)
    )
    labels = tuple(
        Label(f.name, f.points[f.triangles].mean(axis=1), whole=f.name.rpartition(":")[0])
        for f in moved
        if style.labels
    )
    lines: tuple[Lines, ...] = ()
    if style.edges:
        ways = [
            points + offsets[face]
            for pair, points in shown_edges(part, mesh)
            for face in pair[: None if style.explode else 1]
        ]
        lines = (Lines(tuple(ways)),)
    return Scene(moved, lines, labels=labels, bar=bar)


def _painted(part: Part, faces: list[Surface], name: str) -> tuple[list[Surface], Bar]:
    """Return the faces in the colours of a field, and its scale."""
    shown = list(on_faces(part, faces, [name]))
    numbers = np.concatenate([values[name] for _, values in shown])
    low, high = limits_of(numbers)
    painted = [replace(face, colour=paint(values[name], low, high)) for face, values in shown]
    return painted, Bar(f"{name} (sampled)", low, high, viridis(np.linspace(0.0, 1.0, 256)))


def _offset(part: Part, face: Surface, explode: float) -> Array:
    """Return how far a face is moved: away from the middle of the solid."""
    away: Array = face.points[face.triangles].mean(axis=(0, 1)) - np.asarray(
        part.report.solid.centroid
    )
    distance = float(np.linalg.norm(away))
    size = part.report.size
    return explode * size * away / distance if distance > 1e-9 * size else np.zeros(3)
