"""From a part to a scene: which faces, lines, points, names and colours a picture shows."""

from __future__ import annotations

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.fields import LocalField
from pc2cad.export.colours import side_colour
from pc2cad.part import Part
from pc2cad.picture.bodies import bodies_drawing
from pc2cad.picture.colours import limits_of, paint, viridis
from pc2cad.picture.maps import deviations, numbers_of, thicknesses, wall_direction
from pc2cad.picture.scene import GREY, Bar, Cloud, Colour, Label, Lines, Scene, Surface
from pc2cad.picture.sides import TURN, Patch, Sides
from pc2cad.picture.style import STEEL, Style

#: points along each direction of a patch that carries a map
MAP_NODES = 72
#: points along each direction of a patch that a label may point between
PLACES = 21


def drawing(part: Part, style: Style | None = None) -> Scene:
    """Return the scene of a part.

    Raises InputError for a thickness where there is no wall, a field that is no scalar or is not
    there, and for what several bodies have not.
    """
    style = style or Style()
    if part.several is not None:
        return bodies_drawing(part, style, TURN)
    sides = Sides(part)
    patches = list(sides.patches(MAP_NODES if style.mapped else None))
    offsets = _offsets(part, patches, style.explode)
    lines = _lines(sides, style, offsets)
    labels = _labels(part, list(sides.patches(PLACES)), offsets) if style.labels else []
    if style.labels or style.explode:
        for side, path in sides.collapsed():
            whole = path if len(path) > 1 else np.repeat(path, 2, axis=0)
            lines.append(Lines((whole,), side_colour(side.patch), 4.0))
            if style.labels:
                name = part.model.complex.name(side.patch)
                labels.append(Label(f"{name} is a {side.fate}", path))
    if style.points is not None:
        return Scene((), tuple(lines), (_cloud(sides, style.points),), tuple(labels))
    if style.mapped:
        surfaces, bar = _mapped(part, sides, patches, style)
        return Scene(surfaces, tuple(lines), labels=tuple(labels), bar=bar)
    faces = tuple(
        _surface(p, offsets[p.index], side_colour(p.cell) if style.colours else STEEL)
        for p in patches
    )
    return Scene(faces, tuple(lines), labels=tuple(labels))


def _surface(patch: Patch, offset: Array, colour: Colour | Array) -> Surface:
    points, normals = patch.points.reshape(-1, 3), patch.normals.reshape(-1, 3)
    return Surface(patch.name, points + offset, patch.triangles, normals, colour)


def _lines(sides: Sides, style: Style, offsets: Array) -> list[Lines]:
    """Return creases and parameter lines; a crease goes with each of its faces."""
    result = []
    if style.edges:
        paths = [
            path + offsets[owner]
            for owners, path in sides.creases()
            for owner in sorted(owners)[: None if style.explode else 1]
        ]
        result.append(Lines(tuple(paths)))
    if style.isolines:
        paths = [path + offsets[owner] for owner, path in sides.lines(style.isolines)]
        result.append(Lines(tuple(paths), GREY, 1.0))
    return result


def _labels(part: Part, patches: list[Patch], offsets: Array) -> list[Label]:
    """Return a label for each face; it may point to the middle of any mesh of its grids."""
    labels = []
    for index, face in enumerate(part.model.faces):
        points = np.concatenate([_meshes(p) for p in patches if p.index == index])
        labels.append(Label(face.name, points + offsets[index], whole=face.key.whole.label))
    return labels


def _meshes(patch: Patch) -> Array:
    p = patch.points
    middles: Array = (p[1:, 1:] + p[:-1, 1:] + p[1:, :-1] + p[:-1, :-1]) / 4
    return middles.reshape(-1, 3)


def _offsets(part: Part, patches: list[Patch], explode: float) -> Array:
    """Return how far each face is moved, (faces, 3).

    A face goes away from the middle of the solid. Faces that lie round the middle, as walls of a
    tube do, would stay: the first of them does, the others go along the part's thinnest extent.
    """
    count = len(part.model.faces)
    offsets = np.zeros((count, 3))
    if explode == 0.0:
        return offsets
    size = part.report.size
    middle = np.asarray(part.report.equation.centroid)
    extent = np.ptp(np.concatenate([p.points.reshape(-1, 3) for p in patches]), axis=0)
    aside = np.eye(3)[int(np.argmin(extent))] * (float(extent.min()) / size + explode)
    round_middle = 0
    for index in range(count):
        away = _middle([p for p in patches if p.index == index]) - middle
        distance = float(np.linalg.norm(away))
        if distance > 0.02 * size:
            offsets[index] = explode * size * away / distance
        else:
            offsets[index] = round_middle * size * aside
            round_middle += 1
    return offsets


def _middle(patches: list[Patch]) -> Array:
    """Return the centroid of some patches' area, from their triangles."""
    corners = np.concatenate([p.points.reshape(-1, 3)[p.triangles] for p in patches])
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    middle: Array = np.average(corners.mean(axis=1), axis=0, weights=areas)
    return middle


def _cloud(sides: Sides, counts: tuple[int, int, int]) -> Cloud:
    """Return the points of the box's grid, coloured along w."""
    points = sides.inside(counts)
    along = np.broadcast_to(viridis(np.linspace(0.0, 0.9, counts[2])), points.shape)
    width = 3.0 if np.prod(counts) < 50_000 else 2.0 if np.prod(counts) < 500_000 else 1.5
    return Cloud(points.reshape(-1, 3), along.reshape(-1, 3), width)


def _mapped(
    part: Part, sides: Sides, patches: list[Patch], style: Style
) -> tuple[tuple[Surface, ...], Bar]:
    """Return the faces with a map as colours, and its scale."""
    report = part.report
    if style.field is not None:
        field = LocalField(sides.map, part.equation.field(style.field))
        values = numbers_of(patches, field)
        title = f"{style.field} (sampled)"
    elif style.map == "deviation":
        values = [deviations(patch, report.size) for patch in patches]
        title = f"deviation, {report.units} (sampled)"
    else:
        direction = wall_direction(sides, style.across)
        values = thicknesses(patches, direction)
        title = f"thickness across {'uvw'[direction]}, {report.units} (sampled)"
    numbers = np.concatenate([v.ravel() for v in values])
    if style.map == "deviation":
        low, high = 0.0, float(np.nanmax(numbers))
    else:
        # what is constant up to rounding has one colour, not the pattern of its rounding
        low, high = limits_of(numbers, report.size if style.map == "thickness" else None)
    surfaces = tuple(
        _surface(patch, np.zeros(3), paint(value.ravel(), low, high))
        for patch, value in zip(patches, values, strict=True)
    )
    return surfaces, Bar(title, low, high, viridis(np.linspace(0.0, 1.0, 256)))
