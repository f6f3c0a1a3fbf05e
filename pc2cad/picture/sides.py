"""The sides of the box as the equation has them: faces, creases, parameter lines, point sets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.domain.map import Mapping3, open_grid
from pc2cad.part import Part
from pc2cad.topology.cells import Cell, directions_of, normal_direction, outward_sign
from pc2cad.topology.complex import SideFate

#: angle in radians between neighbouring tangents of a picture's grid
TURN = 0.05
#: fewest and most points along a direction of a patch
NODES = (2, 640)
#: places along a direction, and lines across, from which its turning is told
PROBES = (257, 9)
#: how far beside a singular place of a patch its normal is taken, in shares of the patch
BESIDE = 1e-3

Place = dict[int, Array | float]


@dataclass(frozen=True, eq=False)
class Patch:
    """A grid on one face patch of the box: points and unit normals out of the solid, (n, m, 3)."""

    name: str
    #: where it is in the box
    cell: Cell
    points: Array
    normals: Array
    #: local parameters u, v, w of the grid's lines, one of which is fixed
    axes: tuple[Array, Array, Array]
    #: number of the part's face, and the kernel's
    index: int
    face: Any

    @property
    def direction(self) -> int:
        """Direction that is fixed on the patch: 0, 1 or 2."""
        return normal_direction(self.cell)

    @property
    def limit(self) -> int:
        """At which limit it is fixed: 0 or 1."""
        return 1 if self.cell[self.direction] else 0

    @property
    def triangles(self) -> Integers:
        """Triangles (k, 3) on the flattened points, anti-clockwise from outside."""
        n, m = self.points.shape[:2]
        corner = (np.arange(n - 1)[:, None] * m + np.arange(m - 1)).ravel()
        lower = np.column_stack((corner, corner + m, corner + m + 1))
        upper = np.column_stack((corner, corner + m + 1, corner + 1))
        triangles = np.concatenate((lower, upper)).astype(np.int64)
        corners = self.points.reshape(-1, 3)[triangles]
        flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        inwards = float((flat * self.normals.reshape(-1, 3)[triangles[:, 0]]).sum()) < 0.0
        return triangles[:, ::-1].copy() if inwards else triangles


@dataclass(frozen=True, eq=False)
class Sides:
    """The equation of a part on the sides of its box."""

    part: Part
    #: angle in radians between neighbouring tangents of a grid
    turn: float = TURN

    @property
    def map(self) -> Mapping3:
        """M over the unit box."""
        return self.part.checked.map

    @property
    def _bounds(self) -> tuple[tuple[float, ...], ...]:
        """Limits of the pieces per direction, in local coordinates: 0, creases and cuts, 1."""
        return self.part.checked.analysis.bounds

    @cached_property
    def _handed(self) -> float:
        """+1 where det J > 0, else -1; a part has one sign throughout."""
        inner = np.array([0.2113, 0.4431, 0.7267])
        _, *tangents = self.map.frame(*open_grid(inner, inner, inner))
        return float(np.sign(np.sum(np.linalg.det(np.stack(tangents, axis=-1)))))

    def patches(self, count: int | None = None) -> Iterator[Patch]:
        """Yield every patch that bounds the solid, with count × count points or as it turns."""
        model = self.part.model
        owners = {cell: i for i, face in enumerate(model.faces) for cell in face.cells}
        for number, cell in enumerate(model.complex.faces):
            patch, index = cell.patch, owners[number]
            place: Place = {}
            for d in directions_of(patch):
                nodes = self._count(patch, d) if count is None else count
                place[d] = np.linspace(0.0, 1.0, nodes)
            yield Patch(
                model.complex.name(patch),
                patch,
                self._points(patch, place),
                self._normals(patch, place),
                self._axes(patch, place),
                index,
                self.part.built.faces[index],
            )

    def creases(self, fineness: int = 240) -> Iterator[tuple[set[int], Array]]:
        """Yield for every edge between different faces their numbers and a polyline, (k, 3)."""
        model = self.part.model
        along = np.linspace(0.0, 1.0, fineness)
        for edge in sorted(model.creases):
            owners = {i for i, face in enumerate(model.faces) if edge in face.border}
            cell = model.complex.edges[edge].cell
            yield owners, self._points(cell, dict.fromkeys(directions_of(cell), along))

    def lines(self, count: int, fineness: int = 240) -> Iterator[tuple[int, Array]]:
        """Yield parameter lines, (k, 3), with the number of their face.

        There are `count` inner ones along each direction of every patch.
        """
        inner = np.linspace(0.0, 1.0, count + 2)[1:-1]
        along = np.linspace(0.0, 1.0, fineness)
        model = self.part.model
        for index, face in enumerate(model.faces):
            for patch in (model.complex.faces[cell].patch for cell in face.cells):
                first, second = directions_of(patch)
                for d, other in ((first, second), (second, first)):
                    for value in inner:
                        points = self._points(patch, {d: along, other: float(value)})
                        yield index, points.reshape(-1, 3)

    def collapsed(self, fineness: int = 240) -> Iterator[tuple[SideFate, Array]]:
        """Yield fate and image, (k, 3), of every side that is a curve or a point."""
        along = np.linspace(0.0, 1.0, fineness)
        for side in self.part.model.complex.sides:
            if side.fate in ("curve", "point"):
                place: Place = dict.fromkeys(directions_of(side.patch), 0.5)
                if side.along is not None:
                    place[side.along] = along
                yield side, self._points(side.patch, place).reshape(-1, 3)

    def inside(self, counts: tuple[int, int, int]) -> Array:
        """Return M on an even grid of the whole box, (n, m, k, 3): the paper's point set."""
        return self.map.points(*open_grid(*(np.linspace(0.0, 1.0, n) for n in counts)))

    def _count(self, patch: Cell, direction: int) -> int:
        """Return how many points along a direction of a patch make its turns small."""
        along, across = (np.linspace(0.0, 1.0, n) for n in PROBES)
        place: Place = dict.fromkeys(directions_of(patch), across)
        place[direction] = along
        axis = directions_of(patch).index(direction)
        steps = np.diff(np.moveaxis(self._points(patch, place), axis, 0), axis=0)
        normals = np.moveaxis(self._normals(patch, place), axis, 0)
        # even spacing has to serve the place that turns most; a flat patch of lines has two points
        needed = max(_turn(steps), _turn(normals)) * len(steps) / self.turn
        return int(np.clip(np.ceil(needed) + 1, NODES[0] if needed < 0.01 else 8, NODES[1]))

    def _normals(self, patch: Cell, place: Place) -> Array:
        """Return unit normals out of the solid; where there is none, that of a place beside."""
        normals = self._across(patch, place)
        # nodes of a coarse grid may all be singular, and their normals rounding: ask the middle
        middle = self._across(patch, dict.fromkeys(directions_of(patch), 0.5))
        largest = max(np.linalg.norm(n, axis=-1).max() for n in (normals, middle))
        bad = np.linalg.norm(normals, axis=-1) <= 1e-7 * largest
        if bad.any():
            beside: Place = {d: _beside(np.asarray(at, dtype=float)) for d, at in place.items()}
            normals[bad] = self._across(patch, beside)[bad]
        lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
        unit: Array = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
        return unit

    def _across(self, patch: Cell, place: Place) -> Array:
        """Return normals out of the solid, as long as the patch is stretched there."""
        tangents = self.map.tangents(directions_of(patch), *open_grid(*self._axes(patch, place)))
        shape = self._shape(patch, place)
        s, t = (np.nan_to_num(tangent.reshape(*shape, 3)) for tangent in tangents)
        across: Array = np.cross(s, t) * (self._handed * outward_sign(patch))
        return across

    def _points(self, cell: Cell, place: Place) -> Array:
        """Return M on a cell at places in 0…1 of its pieces; directions ascend."""
        points = self.map.points(*open_grid(*self._axes(cell, place)))
        return points.reshape(*self._shape(cell, place), 3)

    def _axes(self, cell: Cell, place: Place) -> tuple[Array, Array, Array]:
        def axis(d: int) -> Array:
            row = self._bounds[d]
            low, high = row[cell[d] // 2], row[(cell[d] + 1) // 2]
            return np.asarray(low + (high - low) * np.asarray(place.get(d, 0.0), dtype=float))

        return axis(0), axis(1), axis(2)

    def _shape(self, cell: Cell, place: Place) -> list[int]:
        return [np.asarray(place[d]).size for d in directions_of(cell)]


def _beside(at: Array) -> Array:
    """Return places of a patch, 0…1, moved a little towards its middle."""
    moved: Array = at + np.where(at <= 0.5, BESIDE, -BESIDE)
    return moved


def _turn(vectors: Array) -> float:
    """Return the largest angle between neighbours along the first axis of vectors (n, m, 3)."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    there = lengths > 1e-9 * lengths.max()  # a line may be a point at the end of a patch
    unit = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=there)
    cosines = (unit[1:] * unit[:-1]).sum(axis=-1)[(there[1:] & there[:-1])[..., 0]]
    return float(np.arccos(np.clip(cosines, -1.0, 1.0)).max()) if cosines.size else 0.0
