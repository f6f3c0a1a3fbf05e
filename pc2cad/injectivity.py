"""The global test: does the map cover any place of space more than once.

det J of one sign does not exclude that distant parts overlap, and no volume shows it (spec 4.2).
The boundary's winding number does: about every image M(u,v,w) of an inner point it has to be 1. It
is taken about images throughout the box and close under every face, and just outside plane faces,
where it has to be 0 (ends that meet askew). The boundary is meshed coarsely; where that
contradicts, the few cells that the ray meets are refined before it is believed. What could still be
missed is smaller than the distance between neighbouring images, and that distance is reported.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pc2cad.analysis import Analysis
from pc2cad.directions import CellFunction, DirectionClasses, Piece
from pc2cad.equation.normal_form import split_turns
from pc2cad.equation.point_equation import PARAMETERS
from pc2cad.equation.tree import Expr, substitute, symbol, walk
from pc2cad.errors import NotASolidError
from pc2cad.geometry.carriers import fit_plane
from pc2cad.mapping import open_grid
from pc2cad.topology.cells import normal_direction, outward_sign
from pc2cad.winding import Integers, ray_frame, winding_numbers

Array = NDArray[np.float64]

#: chord error of the mesh, as a share of the part's size and of the depth of images under a face
CHORD, DEPTH_SHARE = 1e-3, 4.0
#: where walls are thin or directions start slowly, contradicting cells are refined instead
FINEST_CHORD = 5e-5
#: share of a direction's length at which images are taken just under a face
UNDER_FACE = 0.02
#: how far outside a plane face the winding number has to be 0, as a share of the part's size
OUTSIDE = 1e-6
#: subdivisions of a contradicting cell before the contradiction is believed, and points at a time
REFINEMENTS = ((4, 60), (16, 12), (64, 2))
#: contradicting images that are looked into
MOST_DOUBTS = 480
MOST_CHORDS = 2048


class OverlappingMapError(NotASolidError):
    """Different parameters give the same inner point: the solid covers itself."""


class ShellsNotNestedError(NotASolidError):
    """The shells are not one outer shell with voids inside it."""


@dataclass(frozen=True)
class Injectivity:
    """How the global test was done: number of images, and how far apart neighbours are."""

    images: int
    #: an overlap that holds a ball of this diameter would have been seen (model units)
    spacing: float
    #: index of the outer shell in the boundary complex
    outer_shell: int


def check_injective(analysis: Analysis) -> Injectivity:
    """Return how injectivity was checked; raise OverlappingMapError or ShellsNotNestedError."""
    coarse = CHORD * analysis.size
    chords, error = _chords(analysis, coarse)
    parameters = _inner_parameters(analysis, chords)
    fine = max(FINEST_CHORD * analysis.size, DEPTH_SHARE * _depth(analysis))
    if fine < coarse:
        chords, error = _chords(analysis, fine)
    mesh = _Mesh.of(analysis, chords, error)
    images = analysis.map.points(*open_grid(*parameters))
    flat = images.reshape(-1, 3)
    doubtful = np.flatnonzero(winding_numbers(flat, mesh.triangles) != 1)
    # a wall thinner than the mesh is good for makes every image doubtful: look into some
    stride = -(-len(doubtful) // MOST_DOUBTS) or 1
    wrong = mesh.first_contradiction(flat[doubtful[::stride]], 1)
    if wrong is not None:
        where = np.unravel_index(doubtful[::stride][wrong[0]], images.shape[:3])
        place = [float(p[i]) for p, i in zip(parameters, where, strict=True)]
        _refuse(analysis, place, flat[doubtful[::stride][wrong[0]]], wrong[1])
    _check_outside(analysis, mesh)
    outer = _outer_shell(analysis, mesh)
    checked = len(flat) - len(doubtful) + len(doubtful[::stride])
    return Injectivity(checked, _spacing(images) * stride, outer)


@dataclass(frozen=True, eq=False)
class _Patch:
    """A face cut into cells: its function, the cell limits along s and t, and its own turn."""

    function: CellFunction
    s: Array
    t: Array
    shell: int
    #: M_s × M_t points into the solid
    inward: bool

    @cached_property
    def grid(self) -> Array:
        return self.function(self.s, self.t)

    @cached_property
    def boxes(self) -> tuple[Array, Array]:
        """Lower and upper limits of each cell across the rays, (cells, 2) each."""
        corners = (self.cells().reshape(-1, 4, 3) @ ray_frame())[..., :2]
        return corners.min(axis=1), corners.max(axis=1)

    def cells(self) -> Array:
        """Return the corners of all cells, (cells, 2, 2, 3)."""
        g = self.grid
        pairs = np.stack((np.stack((g[:-1, :-1], g[:-1, 1:]), 2),
                          np.stack((g[1:, :-1], g[1:, 1:]), 2)), 2)  # fmt: skip
        return pairs.reshape(-1, 2, 2, 3)

    def refined(self, chosen: Integers, count: int) -> Array:
        """Return the corners of the count² parts of some cells, (cells·count², 2, 2, 3)."""
        columns = len(self.t) - 1
        i, j = chosen // columns, chosen % columns
        inner = np.linspace(0.0, 1.0, count + 1)
        s = self.s[i, None, None] + (self.s[i + 1] - self.s[i])[:, None, None] * inner[:, None]
        t = self.t[j, None, None] + (self.t[j + 1] - self.t[j])[:, None, None] * inner
        g = self.function.at(s, t)
        pairs = np.stack((np.stack((g[:, :-1, :-1], g[:, :-1, 1:]), 3),
                          np.stack((g[:, 1:, :-1], g[:, 1:, 1:]), 3)), 3)  # fmt: skip
        return pairs.reshape(-1, 2, 2, 3)

    def halves(self, cells: Array) -> Array:
        """Return two outward triangles per cell, (2·cells, 3, 3)."""
        a, b, c, d = cells[:, 0, 0], cells[:, 1, 0], cells[:, 1, 1], cells[:, 0, 1]
        both = np.concatenate((np.stack((a, b, c), 1), np.stack((a, c, d), 1)))
        return both[:, ::-1] if self.inward else both


@dataclass(frozen=True, eq=False)
class _Mesh:
    """A closed mesh of the boundary that can be refined where a ray meets it."""

    patches: tuple[_Patch, ...]
    #: largest distance seen between the mesh and the faces
    error: float

    @staticmethod
    def of(analysis: Analysis, chords: dict[Piece, int], error: float) -> _Mesh:
        patches = []
        for index, face in enumerate(analysis.boundary.faces):
            function = CellFunction(analysis, face.patch)
            s, t = (np.linspace(0, 1, chords[piece] + 1) for piece in function.pieces)
            shell = next(
                i for i, shell in enumerate(analysis.boundary.shells) if index in shell.faces
            )
            inward = outward_sign(face.patch) * analysis.orientation < 0
            patches.append(_Patch(function, s, t, shell, inward))
        return _Mesh(tuple(patches), error)

    @cached_property
    def triangles(self) -> Array:
        return np.concatenate([patch.halves(patch.cells()) for patch in self.patches])

    def first_contradiction(
        self, points: Array, expected: int, level: int = 0
    ) -> tuple[int, int] | None:
        """Return the first point whose winding number is not as expected, and that number.

        The cells that its ray may meet are refined, level by level, before that is believed; the
        finer the level, the fewer points at a time.
        """
        count, batch = REFINEMENTS[level]
        for start in range(0, len(points), batch):
            part = points[start : start + batch]
            numbers = winding_numbers(part, self._local(part, count))
            left = np.flatnonzero(numbers != expected)
            if len(left) == 0:
                continue
            if level + 1 == len(REFINEMENTS):
                return start + int(left[0]), int(numbers[left[0]])
            deeper = self.first_contradiction(part[left], expected, level + 1)
            if deeper is not None:
                return start + int(left[deeper[0]]), deeper[1]
        return None

    def _local(self, points: Array, count: int) -> Array:
        """Return triangles of the refined cells that lie near the points' rays."""
        places = (points @ ray_frame())[:, :2]
        result = []
        for patch in self.patches:
            low, high = patch.boxes
            # a face may leave the box of its corners: by the mesh's error, or within itself
            pad = 2 * self.error + 0.25 * (high - low)
            low, high = low - pad, high + pad
            met = np.zeros(len(low), dtype=bool)
            for x, y in places:
                met |= (low[:, 0] <= x) & (x <= high[:, 0]) & (low[:, 1] <= y) & (y <= high[:, 1])
            chosen = np.flatnonzero(met)
            if len(chosen):
                result.append(patch.halves(patch.refined(chosen, count)))
        return np.concatenate(result) if result else np.empty((0, 3, 3))


def _check_outside(analysis: Analysis, mesh: _Mesh) -> None:
    """Refuse a solid that has material just outside one of its plane faces."""
    nodes = np.array([0.06, 0.21, 0.37, 0.5, 0.64, 0.81, 0.93])
    beyond, names = [], []
    for patch, face in zip(mesh.patches, analysis.boundary.faces, strict=True):
        points = patch.function(nodes, nodes).reshape(-1, 3)
        if fit_plane(points, 1e-12 * analysis.size + 1e-14 * analysis.magnitude) is None:
            continue
        a, b, c = np.moveaxis(patch.halves(patch.cells()), 1, 0)
        outward = np.cross(b - a, c - a).sum(axis=0)
        beyond.append(points + OUTSIDE * analysis.size * outward / np.linalg.norm(outward))
        names += [analysis.boundary.name(face.patch)] * len(points)
    if not beyond:
        return
    places = np.concatenate(beyond)
    doubtful = np.flatnonzero(winding_numbers(places, mesh.triangles) != 0)
    wrong = mesh.first_contradiction(places[doubtful], 0)
    if wrong is not None:
        index = doubtful[wrong[0]]
        raise OverlappingMapError(
            f"the solid touches itself: just outside its face {names[index]}, at "
            f"({', '.join(f'{x:.6g}' for x in places[index])}), there is material again; "
            f"{_advice(analysis)}"
        )


def _refuse(analysis: Analysis, place: list[float], point: Array, number: int) -> None:
    shown = ", ".join(
        f"{name} = {analysis.map.value(d, place[d]):.4g}" for d, name in enumerate(PARAMETERS)
    )
    kind = "lies outside its own boundary" if number == 0 else f"is covered {abs(number)} times"
    raise OverlappingMapError(
        f"the map covers itself: the image ({', '.join(f'{x:.6g}' for x in point)}) of {shown} "
        f"{kind} (winding number {number}); {_advice(analysis)}"
    )


def _advice(analysis: Analysis) -> str:
    """Say what would mend an overlap: the period where a direction runs beyond it."""
    for d, name in enumerate(PARAMETERS):
        low, high = analysis.equation.limits[d]
        period = _period(analysis, d)
        if period is not None and period < 1 - 1e-9:
            return (
                f"M repeats itself in {name} with the period {period * (high - low):.6g}: shorten "
                f"the domain of {name} to [{low:g}, {low + period * (high - low):.6g}] at most"
            )
    return (
        "a thinner wall or smaller section, a larger pitch or distance between strands, or a "
        "shorter domain would part them"
    )


def _period(analysis: Analysis, direction: int) -> float | None:
    """Return the period of M in one direction (of length 1), where one is found."""
    name = PARAMETERS[direction]
    found: list[float] = []
    for node in walk(analysis.map.coordinates):
        if node.op in ("sin", "cos") and name in node.symbols:
            step = _turn_rate(node.args[0], name)
            if step:
                found.append(2 / step)
    for period in sorted(found, reverse=True):
        grid = [np.linspace(0.05, 0.95, 5)] * 3
        here = analysis.map.points(*open_grid(*grid))
        grid[direction] = grid[direction] + period
        if np.abs(analysis.map.points(*open_grid(*grid)) - here).max() <= 1e-9 * analysis.size:
            return period
    return None


def _turn_rate(argument: Expr, name: str) -> float:
    """Return r where the argument grows by r·pi per unit of the symbol (0 where it does not)."""
    (shifted,) = substitute((argument,), {name: symbol(name) + 1})
    turns, rest = split_turns(shifted - argument)
    return abs(float(turns)) if not rest.symbols and rest.op == "number" else 0.0


def _chords(analysis: Analysis, bound: float) -> tuple[dict[Piece, int], float]:
    """Return how many chords per direction piece keep a mesh within a bound of all faces.

    Also returns the largest distance that is left. Glued directions get equal numbers; a twisted
    face, whose parameter lines may be straight, needs more along both of its directions.
    """
    classes = DirectionClasses(analysis, degrees=(1,))
    pieces = [(d, p) for d in range(3) for p in range(1, 2 * len(analysis.bounds[d]) - 1, 2)]
    counts = {piece: 4 for piece in pieces}
    functions = [CellFunction(analysis, face.patch) for face in analysis.boundary.faces]
    settled: dict[CellFunction, tuple[tuple[int, int], float]] = {}
    while True:
        grown = dict(counts)
        for function in functions:
            s, t = function.pieces
            numbers = counts[s], counts[t]
            if settled.get(function, (None,))[0] == numbers:
                continue
            bows = _bows(function, *numbers)
            settled[function] = numbers, max(bows)
            twisted = bows[2] > bound and max(bows[:2]) <= bound
            for piece, bow in ((s, bows[0]), (t, bows[1])):
                if (bow > bound or twisted) and counts[piece] < MOST_CHORDS:
                    grown[piece] = max(grown[piece], counts[piece] * 4 // 3 + 1)
        for piece in pieces:
            owner = classes.owner(piece)
            grown[piece] = max(grown[p] for p in pieces if classes.owner(p) == owner)
        if grown == counts:
            return counts, max(error for _, error in settled.values())
        counts = grown


def _bows(function: CellFunction, n: int, m: int) -> tuple[float, float, float]:
    """Return how far a face is from the mesh's edges along s, along t and along the diagonals.

    Only the offset across the cells counts: uneven speed moves points within the face.
    """
    s, t = np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1)
    corner = function(s, t)
    normal = np.cross(corner[1:, 1:] - corner[:-1, :-1], corner[:-1, 1:] - corner[1:, :-1])
    length = np.sqrt(np.einsum("...i,...i->...", normal, normal))
    normal = normal / np.where(length > 0, length, 1.0)[..., None]
    # an uneven place, where no wave has its zeros in all cells at once
    share = 0.43
    along = function(s[:-1] + share / n, t) - ((1 - share) * corner[:-1] + share * corner[1:])
    across = function(s, t[:-1] + share / m) - (
        (1 - share) * corner[:, :-1] + share * corner[:, 1:]
    )
    middle = function(s[:-1] + 0.5 / n, t[:-1] + 0.5 / m)
    diagonal = middle - (corner[:-1, :-1] + corner[1:, 1:]) / 2

    def offset(*gaps: Array) -> float:
        return max(float(np.abs(np.einsum("...i,...i->...", gap, normal)).max()) for gap in gaps)

    return (
        offset(along[:, :-1], along[:, 1:]),
        offset(across[:-1], across[1:]),
        offset(diagonal),
    )


def _depth(analysis: Analysis) -> float:
    """Return how deep under the faces the images lie (model units): less in a tenth of them only.

    A mean or a minimum would say nothing where faces end in poles.
    """
    nodes = np.linspace(0.07, 0.93, 7)
    depths = []
    for face in analysis.boundary.faces:
        d = normal_direction(face.patch)
        limit = analysis.span(d, face.patch[d])[0]
        grid = [nodes] * 3
        grid[d] = np.array([limit, UNDER_FACE if limit == 0 else 1 - UNDER_FACE])
        pair = np.moveaxis(analysis.map.points(*open_grid(*grid)), d, 0)
        depths.append(np.sqrt(((pair[0] - pair[1]) ** 2).sum(axis=-1)).ravel())
    return float(np.quantile(np.concatenate(depths), 0.1))


def _inner_parameters(analysis: Analysis, chords: dict[Piece, int]) -> list[Array]:
    """Return local coordinates of the images per direction: throughout, and close under faces."""
    faces = {(d, f.patch[d]) for f in analysis.boundary.faces for d in range(3)}
    result = []
    for d in range(3):
        count = sum(n for (e, _), n in chords.items() if e == d)
        count = int(np.clip(count // 2, 5, 400))
        nodes = [*((np.arange(count) + 0.5) / count)]
        nodes += [UNDER_FACE] if (d, 0) in faces else []
        nodes += [1 - UNDER_FACE] if (d, 2 * (len(analysis.bounds[d]) - 1)) in faces else []
        result.append(np.array(sorted(nodes)))
    return result


def _spacing(images: Array) -> float:
    """Return the largest distance between neighbouring images."""
    steps = []
    for axis in range(3):
        gap = np.diff(images, axis=axis)
        if gap.size:
            steps.append(float(np.sqrt(np.einsum("...i,...i->...", gap, gap).max())))
    return max(steps)


def _outer_shell(analysis: Analysis, mesh: _Mesh) -> int:
    """Return the one shell of positive volume; the others have to be voids inside it."""
    count = len(analysis.boundary.shells)
    if count == 1:
        return 0
    parts = [
        np.concatenate([p.halves(p.cells()) for p in mesh.patches if p.shell == i])
        for i in range(count)
    ]
    centre = mesh.triangles.mean(axis=(0, 1))
    volumes = [float(np.linalg.det(part - centre).sum()) for part in parts]
    outer = [i for i, volume in enumerate(volumes) if volume > 0]
    if len(outer) != 1:
        raise ShellsNotNestedError(
            f"{len(outer)} of {count} shells enclose material; one solid has one outer shell and "
            "otherwise voids"
        )
    hull = _Mesh(tuple(p for p in mesh.patches if p.shell == outer[0]), mesh.error)
    for i, part in enumerate(parts):
        places = part[:: max(1, len(part) // 50), 0]
        if i != outer[0]:
            doubtful = places[winding_numbers(places, hull.triangles) != 1]
            if hull.first_contradiction(doubtful, 1) is not None:
                raise ShellsNotNestedError("a void is not inside the outer shell")
    return outer[0]
