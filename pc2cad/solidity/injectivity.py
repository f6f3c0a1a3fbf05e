"""The global test: does the map cover any place of space more than once.

det J of one sign does not exclude that distant parts overlap, and no volume shows it. Two things
together do: the boundary nowhere meets itself (`self_intersection`), and it winds exactly once
about images M(u,v,w) of inner points, once outside for each void. Where the first holds, the
winding number can change only from shell to shell, so that images throughout the box and the
nesting of the shells decide the second. The boundary is meshed coarsely; where that contradicts,
the few cells that the ray meets are refined before it is believed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import areas
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.jacobian_watch import check_thickness
from pc2cad.domain.map import open_grid
from pc2cad.domain.pinch import pinch_of
from pc2cad.errors import NotASolidError
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.solidity.cell_table import CellTable
from pc2cad.solidity.continuity import check_continuous
from pc2cad.solidity.face_mesh import FaceMesh
from pc2cad.solidity.near_parts import told_number
from pc2cad.solidity.overlap_advice import advice
from pc2cad.solidity.overlap_depth import overlap_depth, told_depth
from pc2cad.solidity.self_intersection import MOST_PAIRS, Clearance, Contact, find_contact
from pc2cad.solidity.winding_number import winding_numbers

#: subdivisions of a contradicting cell before the contradiction is believed, and points at a time
REFINEMENTS = ((4, 60), (16, 12), (64, 2))
#: contradicting images that are looked into
MOST_DOUBTS = 12
#: a place this near to an end of a parameter (of a range of length 1) is at that end
END = 1e-6


class OverlappingMapError(NotASolidError):
    """Different parameters give the same inner point: the solid covers itself."""


class ShellsNotNestedError(NotASolidError):
    """The shells are not one outer shell with voids inside it."""


@dataclass(frozen=True)
class Injectivity:
    """How the global test was done."""

    #: inner images about which the boundary winds once
    images: int
    #: an overlap would be no deeper than this (model units)
    apart: float
    #: index of the outer shell in the boundary complex
    outer_shell: int
    #: a sentence where the effort ended before parts of the boundary were told from touching
    warning: str = ""


def check_injective(
    analysis: Analysis,
    sign: int,
    face_meshes: Sequence[FaceMesh],
    most_pairs: int = MOST_PAIRS,
    continuous: bool = False,
) -> Injectivity:
    """Return how injectivity was checked; raise a NotASolidError where it fails.

    `sign` is that of det J: it says on which side of the boundary the image is. `most_pairs` of
    cells are followed at once. Whether M jumps is looked at on the sides, and inside as well where
    it is not proved to be `continuous`.
    """
    check_continuous(analysis, face_meshes, continuous)
    found = find_contact(analysis, face_meshes, most_pairs=most_pairs)
    if isinstance(found, Contact):
        raise OverlappingMapError(_met(analysis, face_meshes, found))
    mesh = _Mesh(face_meshes, sign)
    images = _check_images(analysis, mesh)
    warning = _undecided(analysis, face_meshes, found)
    return Injectivity(images, found.apart, _outer_shell(analysis, mesh), warning)


def _check_images(analysis: Analysis, mesh: _Mesh) -> int:
    """Return the number of images about which the boundary winds once; raise at any other."""
    nodes = [_inner_nodes(mesh.face_meshes, d) for d in range(3)]
    images = analysis.map.points(*open_grid(*nodes))
    flat = images.reshape(-1, 3)
    doubtful = np.flatnonzero(winding_numbers(flat, mesh.table.triangles) != 1)
    # a wall thinner than the mesh is good for makes every image doubtful: look into some
    some = doubtful[:: -(-len(doubtful) // MOST_DOUBTS) or 1]
    where = np.unravel_index(some, images.shape[:3])
    places = np.stack([row[i] for row, i in zip(nodes, where, strict=True)], axis=-1)
    wrong = mesh.first_contradiction(flat[some], 1, places)
    if wrong is not None:
        index = int(wrong[0])
        _refuse(analysis, places[index].tolist(), flat[some[index]], wrong[1])
    return len(flat) - len(doubtful) + len(some)


def _inner_nodes(face_meshes: Sequence[FaceMesh], direction: int) -> Array:
    """Return local coordinates of images: as many as the faces' cells ask for."""
    cells = [
        face_mesh.shape[axis]
        for face_mesh in face_meshes
        for axis, piece in enumerate(face_mesh.function.pieces)
        if piece[0] == direction
    ]
    count = int(np.clip(max(cells, default=0) // 4, 5, 24))
    return (np.arange(count) + 0.5) / count


@dataclass(frozen=True, eq=False)
class _Mesh:
    """A closed mesh of the boundary that can be refined where a ray meets it."""

    face_meshes: Sequence[FaceMesh]
    #: of det J
    sign: int

    @cached_property
    def table(self) -> CellTable:
        return CellTable(self.face_meshes, self.sign)

    def first_contradiction(
        self, points: Array, expected: int, places: Array | None = None
    ) -> tuple[int, int] | None:
        """Return the first point whose winding number is not as expected, and that number.

        A ray that runs along an edge of the mesh crosses neither of its triangles, so that rays of
        a second direction have to agree. `places` (n, 3) are the box's own of the points, if known.
        """
        places = np.full((len(points), 3), np.nan) if places is None else places
        first = self._contradiction(points, places, expected, seed=0)
        if first is None:
            return None
        rest = slice(first[0], None)
        again = self._contradiction(points[rest], places[rest], expected, seed=1)
        return None if again is None else (first[0] + again[0], again[1])

    def _contradiction(
        self, points: Array, places: Array, expected: int, seed: int, level: int = 0
    ) -> tuple[int, int] | None:
        """Return the first contradiction of rays of one direction.

        The cells that its ray may meet are refined, level by level, before that is believed; the
        finer the level, the fewer points at a time, at last until it is beyond their bows.
        """
        count, batch = REFINEMENTS[level]
        for start in range(0, len(points), batch):
            rows = slice(start, start + batch)
            part = points[rows]
            near = self.table.near(part, places[rows], seed)
            numbers = winding_numbers(part, self.table.refined(near, count), seed)
            left = np.flatnonzero(numbers != expected)
            if len(left) == 0:
                continue
            if level + 1 == len(REFINEMENTS):
                for k in left.tolist():
                    number = told_number(self.table, part[k], near, seed)
                    if number != expected:
                        return start + k, number
                continue
            deeper = self._contradiction(part[left], places[rows][left], expected, seed, level + 1)
            if deeper is not None:
                return start + int(left[deeper[0]]), deeper[1]
        return None


def _met(analysis: Analysis, face_meshes: Sequence[FaceMesh], contact: Contact) -> str:
    """Say where the boundary meets itself, and what would mend it."""
    places, point = _shown(face_meshes, contact)
    first, second = (
        face_meshes[face].function.place(*local)
        for face, local in zip(contact.faces, contact.places, strict=True)
    )
    # the ends of one parameter: what was found may lie on an edge that one side has with a third
    apart = [d for d in range(3) if abs(first[d] - second[d]) > 1 - END]
    ends = [
        mesh
        for d in apart[:1]
        for cell in (0, 2 * len(analysis.bounds[d]) - 2)
        for mesh in [m for m in face_meshes if m.function.cell[d] == cell][:1]
    ]
    seam = _missed_seam(analysis, *ends) if len(ends) == 2 else ""
    functions = [face_meshes[face].function for face in contact.faces]
    depth = overlap_depth(analysis, functions, contact.places)
    return (
        f"{told_depth(depth, analysis)}: {places[0]} and {places[1]} both lie at ({point}); "
        f"{seam or advice(analysis)}"
    )


def _shown(face_meshes: Sequence[FaceMesh], contact: Contact) -> tuple[list[str], str]:
    """Return the two places of a contact and its point, for a message."""
    places = [
        face_meshes[face].function.shown(*local)
        for face, local in zip(contact.faces, contact.places, strict=True)
    ]
    return places, ", ".join(f"{x:.6g}" for x in contact.point)


def _undecided(analysis: Analysis, face_meshes: Sequence[FaceMesh], found: Clearance) -> str:
    """Say where parts of the boundary are too near one another to be told from touching."""
    if found.undecided is None:
        return ""
    places, point = _shown(face_meshes, found.undecided)
    units = analysis.equation.units
    return (
        f"parts of the boundary run so near one another, as {places[0]} and {places[1]} do at "
        f"({point}), that an overlap of up to {found.apart:.2g} {units} is not excluded there; a "
        "wider gap would be told from one"
    )


def _missed_seam(analysis: Analysis, one: FaceMesh, other: FaceMesh) -> str:
    """Say what two ends of one parameter lack to be a seam, where they nearly are one."""
    first, second = one.function, other.function
    apart = [d for d in range(3) if first.cell[d] != second.cell[d]]
    if len(apart) != 1 or {first.cell[apart[0]], second.cell[apart[0]]} != {
        0, 2 * len(analysis.bounds[apart[0]]) - 2,
    }:  # fmt: skip
        return ""
    nodes = np.linspace(0.0, 1.0, 17)
    gap = np.linalg.norm(first(nodes, nodes) - second(nodes, nodes), axis=-1)
    # lines that lead away and back come near where they began; straight ones do not
    axes: list[Array] = [nodes] * 3
    lines = analysis.map.points(*open_grid(*axes))
    steps = np.linalg.norm(np.diff(lines, axis=apart[0]), axis=-1)
    if gap.max() > 0.25 * steps.sum(axis=apart[0]).max():
        return ""
    names = [analysis.boundary.name(function.cell) for function in (first, second)]
    return (
        f"the sides {' and '.join(names)} nearly close, {gap.min():.3g} to {gap.max():.3g} apart "
        f"at equal parameters: if they are to be one seam, {PARAMETERS[apart[0]]} has to end where "
        "it began, after a whole period (of a wave: a whole number of them)"
    )


def _refuse(analysis: Analysis, place: list[float], point: Array, number: int) -> None:
    check_thickness(analysis.map, place)
    shown = analysis.map.shown(place)
    kind = "lies outside its own boundary" if number == 0 else f"is covered {abs(number)} times"
    raise OverlappingMapError(
        f"the map covers itself: the image ({', '.join(f'{x:.6g}' for x in point)}) of {shown} "
        f"{kind} (winding number {number}); {advice(analysis, meets=False)}"
    )


def material_shell(analysis: Analysis, sign: int, face_meshes: Sequence[FaceMesh]) -> int | None:
    """Return the one shell of positive volume; None where there are more, or that is not clear."""
    volumes, errors = zip(*_volumes(analysis, sign, face_meshes), strict=True)
    outer = [i for i, volume in enumerate(volumes) if volume > 0]
    clear = all(abs(v) > 2 * error for v, error in zip(volumes, errors, strict=True))
    return outer[0] if clear and len(outer) == 1 else None


def _volumes(
    analysis: Analysis, sign: int, face_meshes: Sequence[FaceMesh]
) -> list[tuple[float, float]]:
    """Return the signed volume of each shell's mesh, and how far it may be off."""
    parts = _triangles(analysis, sign, face_meshes)
    centre = np.concatenate(parts).mean(axis=(0, 1))
    found = []
    for i, part in enumerate(parts):
        error = max(face_mesh.error for face_mesh in face_meshes if face_mesh.shell == i)
        area = float(areas(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]).sum()) / 2
        found.append((float(np.linalg.det(part - centre).sum()) / 6, area * error))
    return found


def _triangles(analysis: Analysis, sign: int, face_meshes: Sequence[FaceMesh]) -> list[Array]:
    """Return the outward triangles of each shell."""
    return [
        np.concatenate([s.halves(s.cells(), sign) for s in face_meshes if s.shell == i])
        for i in range(len(analysis.boundary.shells))
    ]


def _outer_shell(analysis: Analysis, mesh: _Mesh) -> int:
    """Return the one shell of positive volume; the others have to be voids inside it."""
    count = len(analysis.boundary.shells)
    if count == 1:
        return 0
    volumes = _volumes(analysis, mesh.sign, mesh.face_meshes)
    outer = [i for i, (volume, _) in enumerate(volumes) if volume > 0]
    if len(outer) != 1:
        raise ShellsNotNestedError(
            f"{len(outer)} of {count} shells enclose material; one solid has one outer shell and "
            "otherwise voids"
        )
    hull = _Mesh([s for s in mesh.face_meshes if s.shell == outer[0]], mesh.sign)
    for i, part in enumerate(_triangles(analysis, mesh.sign, mesh.face_meshes)):
        places = part[:: max(1, len(part) // 50), 0]
        if i != outer[0]:
            doubtful = places[winding_numbers(places, hull.table.triangles) != 1]
            if hull.first_contradiction(doubtful, 1) is not None:
                outside = ShellsNotNestedError("a void is not inside the outer shell")
                raise pinch_of(analysis) or outside
    return outer[0]
