"""Scalar fields over the triangles of faces, of one equation or of several bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.fields import LocalField, local_field
from pc2cad.errors import InputError
from pc2cad.part import Body, Part
from pc2cad.picture.scene import Surface
from pc2cad.sampling.on_sides import SidePlaces
from pc2cad.topology.cells import SideKey

#: how far towards the middle of its triangle a corner is looked at, as a share of the way: what
#: jumps across a seam or at a pole is on one side of it
INWARDS = 1e-4
#: share of a field's range by which a corner's values may differ, and be one, or the value in the
#: middle of a side be another than between its ends
ALIKE = 1e-2
#: triangles of a face that are not divided further
MOST = 20_000


def scalar_fields(part: Part) -> list[str]:
    """Return the names of the scalar fields of a part's bodies, each once."""
    fields = (field for body in part.bodies.values() for field in body.equation.fields)
    return list(dict.fromkeys(field.name for field in fields if field.kind == "scalar"))


def check_scalar(part: Part, name: str) -> None:
    """Raise InputError unless some body has a scalar field of this name."""
    if name in scalar_fields(part):
        return
    for body in part.bodies.values():
        for field in body.equation.fields:
            if field.name == name:
                raise InputError(
                    f"colours show one number, and the field {name} is a {field.kind}: make a "
                    "field of its length or of one of its components"
                )
    known = ", ".join(scalar_fields(part)) or "none"
    raise InputError(f"{part.name} has no field '{name:.80}' (scalars are: {known})")


def on_faces(
    part: Part, faces: Sequence[Surface], names: Sequence[str]
) -> Iterator[tuple[Surface, Mapping[str, Array]]]:
    """Give each face, in the report's order, with fields at its points, (n,).

    Triangles in which a field is not linear are divided, and where a value jumps between them, each
    has points of its own. There is no number (NaN) on faces of bodies that have no such field, and
    of copies. Raises FieldNotFiniteError.
    """
    for face, (body, key) in zip(faces, _owners(part), strict=True):
        own = [] if body is None else [f.name for f in body.equation.fields if f.name in names]
        if body is None or key is None or not own:
            yield face, {name: np.full(len(face.points), np.nan) for name in names}
            continue
        analysis = body.checked.analysis
        places = SidePlaces(analysis, body.patches(key))
        fields = {name: local_field(analysis, name) for name in own}

        def values_at(
            points: Array, places: SidePlaces = places, fields: Mapping[str, LocalField] = fields
        ) -> dict[str, Array]:
            local = places(points.reshape(-1, 3))
            return {
                name: field.checked_at(local)[:, 0].reshape(-1, 3) for name, field in fields.items()
            }

        face, values = _divided(face, values_at)
        shown, at_points = _at_points(face, values)
        none = np.full(len(shown.points), np.nan)
        yield shown, {name: at_points.get(name, none) for name in names}


def _divided(
    face: Surface, values_at: Callable[[Array], dict[str, Array]]
) -> tuple[Surface, dict[str, Array]]:
    """Return a face in triangles in which fields are linear, and their values at its corners."""
    while True:
        corners = face.points[face.triangles]
        middle = corners.mean(axis=1, keepdims=True)
        values = values_at(corners + INWARDS * (middle - corners))
        if 4 * len(corners) > MOST:
            return face, values
        halves = (corners + np.roll(corners, -1, axis=1)) / 2
        between = values_at(halves + INWARDS * (middle - halves))
        bent = [
            np.abs(between[name] - (rows + np.roll(rows, -1, axis=1)) / 2).max()
            > ALIKE * np.ptp(rows)
            for name, rows in values.items()
        ]
        if not any(bent):
            return face, values
        face = _quartered(face)


def _quartered(face: Surface) -> Surface:
    """Return a face with each triangle in four."""
    sides = np.sort(face.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    ends, number = np.unique(sides, axis=0, return_inverse=True)
    a, b, c = face.triangles.T
    ab, bc, ca = (number.reshape(-1, 3) + len(face.points)).T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    triangles = np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3)
    points, normals = (
        np.concatenate((rows, rows[ends].mean(axis=1))) for rows in (face.points, face.normals)
    )
    lengths = np.sqrt((normals * normals).sum(axis=1, keepdims=True))
    unit = normals / np.where(lengths > 0, lengths, 1.0)
    return replace(face, points=points, normals=unit, triangles=triangles)


def _at_points(face: Surface, values: Mapping[str, Array]) -> tuple[Surface, dict[str, Array]]:
    count, found = len(face.points), {}
    for name, rows in values.items():
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(low, face.triangles, rows)
        np.maximum.at(high, face.triangles, rows)
        if (high - low).max(initial=0.0) > ALIKE * np.ptp(rows):
            break
        found[name] = (low + high) / 2
    else:
        return face, found
    apart = np.arange(face.triangles.size).reshape(face.triangles.shape)
    order = face.triangles.ravel()
    shown = replace(face, points=face.points[order], normals=face.normals[order], triangles=apart)
    return shown, {name: rows.ravel() for name, rows in values.items()}


def _owners(part: Part) -> Iterator[tuple[Body | None, SideKey | None]]:
    """Give the body and the side that each face is a part of; None for those of copies."""
    if part.several is None:
        for index in part.model.outer:
            yield part.body, part.model.faces[index].key
        return
    for keys in part.several.face_sides():
        yield next(
            ((part.bodies[key.body], key) for key in keys if key.body in part.bodies), (None, None)
        )
