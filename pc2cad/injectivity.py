"""The global test: does the map cover any place of space more than once.

det J of one sign does not exclude that distant parts overlap, and no volume shows it (spec 4.2).
The boundary's winding number does: about every image M(u,v,w) of an inner point it has to be 1. It
is taken about images throughout the box and close under every face, from a mesh of the boundary
that is refined where it contradicts. What could still be missed is smaller than the distance
between neighbouring images, and that distance is reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pc2cad.analysis import Analysis
from pc2cad.directions import CellFunction, DirectionClasses, Piece
from pc2cad.equation.normal_form import split_turns
from pc2cad.equation.point_equation import PARAMETERS
from pc2cad.equation.tree import Expr, substitute, symbol, walk
from pc2cad.errors import NotASolidError
from pc2cad.mapping import open_grid
from pc2cad.topology.cells import outward_sign
from pc2cad.topology.complex import Shell
from pc2cad.winding import Integers, winding_numbers

Array = NDArray[np.float64]

#: chord error of the mesh, as a share of the part's size, that its first version keeps within
CHORD = 1e-3
#: and as a share of the depth at which images are taken under a face
DEPTH_SHARE = 0.3
#: share of a direction's length at which images are taken just under a face
UNDER_FACE = 0.02
#: refinements of the mesh before a contradiction is believed
REFINEMENTS = 3
MOST_CHORDS = 4096


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
    parameters = _inner_parameters(analysis, _chords(analysis, coarse))
    chords = _chords(analysis, min(coarse, DEPTH_SHARE * _depth(analysis)))
    images = analysis.map.points(*open_grid(*parameters))
    flat = images.reshape(-1, 3)
    doubtful = np.arange(len(flat))
    for refinement in range(REFINEMENTS + 1):
        grown = {piece: count * 2**refinement for piece, count in chords.items()}
        vertices, triangles, shell_of = _mesh(analysis, grown)
        numbers = winding_numbers(flat[doubtful], vertices, triangles, seed=refinement)
        doubtful = doubtful[numbers != 1]
        if len(doubtful) == 0:
            break
    else:
        where = np.unravel_index(doubtful[0], images.shape[:3])
        place = [float(p[i]) for p, i in zip(parameters, where, strict=True)]
        _refuse(analysis, place, flat[doubtful[0]], int(numbers[numbers != 1][0]))
    outer = _outer_shell(analysis, vertices, triangles, shell_of)
    return Injectivity(len(flat), _spacing(images), outer)


def _refuse(analysis: Analysis, place: list[float], point: Array, number: int) -> None:
    limits = analysis.equation.limits
    shown = ", ".join(
        f"{name} = {low + x * (high - low):.4g}"
        for name, x, (low, high) in zip(PARAMETERS, place, limits, strict=True)
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


def _chords(analysis: Analysis, bound: float) -> dict[Piece, int]:
    """Return how many chords follow M within a bound along each direction piece; glued alike."""
    classes = DirectionClasses(analysis, degree=1)
    counts: dict[Piece, int] = {}
    across = np.array([0.0, 0.27, 0.5, 0.77, 1.0])
    for d in range(3):
        for position in range(1, 2 * len(analysis.bounds[d]) - 1, 2):
            low, high = analysis.span(d, position)
            count = 4
            while count < MOST_CHORDS:
                grid = [across] * 3
                grid[d] = low + (high - low) * np.linspace(0, 1, 2 * count + 1)
                line = np.moveaxis(analysis.map.points(*open_grid(*grid)), d, 0)
                bow = line[1::2] - (line[:-2:2] + line[2::2]) / 2
                if np.sqrt((bow * bow).sum(axis=-1)).max() <= bound:
                    break
                count = count * 4 // 3 + 1
            owner = classes.owner((d, position))
            counts[owner] = max(counts.get(owner, 0), count)
    return {
        (d, p): counts[classes.owner((d, p))]
        for d in range(3)
        for p in range(1, 2 * len(analysis.bounds[d]) - 1, 2)
    }


def _depth(analysis: Analysis) -> float:
    """Return how deep under the faces the images lie (model units): less in a tenth of them only.

    A mean or a minimum would say nothing where faces end in poles.
    """
    nodes = np.linspace(0.07, 0.93, 7)
    depths = []
    for face in analysis.boundary.faces:
        (d,) = (d for d in range(3) if face.patch[d] % 2 == 0)
        limit = analysis.span(d, face.patch[d])[0]
        grid = [nodes] * 3
        grid[d] = np.array([limit, UNDER_FACE if limit == 0 else 1 - UNDER_FACE])
        pair = np.moveaxis(analysis.map.points(*open_grid(*grid)), d, 0)
        depths.append(np.sqrt(((pair[0] - pair[1]) ** 2).sum(axis=-1)).ravel())
    return float(np.quantile(np.concatenate(depths), 0.1))


def _inner_parameters(analysis: Analysis, chords: dict[Piece, int]) -> list[Array]:
    """Return local coordinates of the images per direction: throughout, and close under faces."""
    limits = {2 * (len(b) - 1) for b in analysis.bounds}
    faces = {(d, f.patch[d]) for f in analysis.boundary.faces for d in range(3)}
    result = []
    for d in range(3):
        last = 2 * (len(analysis.bounds[d]) - 1)
        count = sum(n for (e, _), n in chords.items() if e == d)
        count = int(np.clip(3 * count // 4, 5, 400))
        nodes = [*((np.arange(count) + 0.5) / count)]
        nodes += [UNDER_FACE] if (d, 0) in faces else []
        nodes += [1 - UNDER_FACE] if (d, last) in faces and last in limits else []
        result.append(np.array(sorted(nodes)))
    return result


def _mesh(analysis: Analysis, chords: dict[Piece, int]) -> tuple[Array, Integers, Integers]:
    """Return vertices, outward triangles, and the shell of each triangle."""
    points, triangles, shell_of = [], [], []
    offset = 0
    shell_index = {f: i for i, shell in enumerate(analysis.boundary.shells) for f in shell.faces}
    for index, face in enumerate(analysis.boundary.faces):
        function = CellFunction(analysis, face.patch)
        s, t = (np.linspace(0, 1, chords[piece] + 1) for piece in function.pieces)
        grid = function(s, t)
        n, m = len(s), len(t)
        corner = (np.arange(n - 1)[:, None] * m + np.arange(m - 1)).ravel() + offset
        first = np.column_stack((corner, corner + m, corner + m + 1))
        second = np.column_stack((corner, corner + m + 1, corner + 1))
        both = np.concatenate((first, second))
        if outward_sign(face.patch) * analysis.orientation < 0:
            both = both[:, ::-1]
        points.append(grid.reshape(-1, 3))
        triangles.append(both)
        shell_of.append(np.full(len(both), shell_index[index]))
        offset += n * m
    return np.concatenate(points), np.concatenate(triangles), np.concatenate(shell_of)


def _spacing(images: Array) -> float:
    """Return the largest distance between neighbouring images."""
    steps = []
    for axis in range(3):
        gap = np.diff(images, axis=axis)
        if gap.size:
            steps.append(float(np.sqrt((gap * gap).sum(axis=-1)).max()))
    return max(steps)


def _outer_shell(
    analysis: Analysis, vertices: Array, triangles: Integers, shell_of: Integers
) -> int:
    """Return the one shell of positive volume; the others have to be voids inside it."""
    shells: tuple[Shell, ...] = analysis.boundary.shells
    if len(shells) == 1:
        return 0
    corners = vertices[triangles] - vertices.mean(axis=0)
    volumes = np.einsum("ni,ni->n", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    signed = [float(volumes[shell_of == i].sum()) for i in range(len(shells))]
    outer = [i for i, volume in enumerate(signed) if volume > 0]
    if len(outer) != 1:
        raise ShellsNotNestedError(
            f"{len(outer)} of {len(shells)} shells enclose material; one solid has one outer shell "
            "and otherwise voids"
        )
    hull = triangles[shell_of == outer[0]]
    for i in range(len(shells)):
        if i == outer[0]:
            continue
        places = vertices[triangles[shell_of == i][:: max(1, len(triangles) // 200), 0]]
        if (winding_numbers(places, vertices, hull) != 1).any():
            raise ShellsNotNestedError("a void is not inside the outer shell")
    return outer[0]
