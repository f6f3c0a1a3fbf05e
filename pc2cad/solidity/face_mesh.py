"""The faces cut into cells: what the global test looks at.

Glued directions get equal numbers of cells, so that the cells of all faces make one closed mesh;
nodes that edges, seams or poles join carry one number. The numbers of cells follow from second
differences at uneven places, which see a wave of any length, and bound how far a face leaves the
chords of its cells and how far it turns within one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import groupby, islice

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.linear import cross
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.direction_classes import DirectionClasses
from pc2cad.domain.looks import sampled
from pc2cad.domain.pieces import piece_at
from pc2cad.domain.restrictions import Piece, RestrictedMap
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import Expr, walk
from pc2cad.geometry.carriers import fit_plane
from pc2cad.topology.cells import outward_sign

#: largest distance of a face from the chords of its cells, as a share of the part's size
CHORD = 2e-3
#: how far a face may turn along one cell (radians), where this many cells of a face do for it
TURN, MOST_FOR_TURN = 0.5, 65536
FEWEST, MOST = 4, 2048
#: a step for second differences, and how many places they are taken at along a direction: of any
#: map, and of a polynomial of low degree, which has no waves
_STEP, _PLACES, _FEW_PLACES = 1e-3, 24, 7
_LOW_DEGREE = 8
#: faces that are looked at together
TOGETHER = 8


@dataclass(frozen=True, eq=False)
class FaceMesh:
    """A face cut into n × m cells at equal steps of its own parameters."""

    function: RestrictedMap
    #: points at the corners, at the middles of the edges and amid the cells, (2n+1, 2m+1, 3)
    samples: Array
    #: numbers of the corners, (n+1, m+1): one number, one place of the boundary
    nodes: Integers
    shell: int
    #: it lies in a plane
    flat: bool

    @property
    def shape(self) -> tuple[int, int]:
        """Number of cells along s and t."""
        return self.nodes.shape[0] - 1, self.nodes.shape[1] - 1

    def cells(self) -> Array:
        """Return the corners of all cells, (cells, 2, 2, 3)."""
        return corners_of(self.samples)

    def halves(self, cells: Array, sign: int) -> Array:
        """Return two outward triangles per cell, (2·cells, 3, 3); `sign` is that of det J."""
        both = halves(cells)
        return both[:, ::-1] if outward_sign(self.function.cell) * sign < 0 else both

    @cached_property
    def error(self) -> float:
        """The largest distance of the middles of cells and edges from their chords."""
        g = self.samples
        corners = g[::2, ::2]
        along = g[1::2, ::2] - (corners[:-1] + corners[1:]) / 2
        across = g[::2, 1::2] - (corners[:, :-1] + corners[:, 1:]) / 2
        amid = g[1::2, 1::2] - (corners[:-1, :-1] + corners[1:, 1:]) / 2
        return max(float(np.sqrt((gap * gap).sum(axis=-1).max())) for gap in (along, across, amid))


def by_shape(face_meshes: Sequence[FaceMesh]) -> list[list[int]]:
    """Return the numbers of faces with as many cells along s and along t, shape by shape."""
    groups: dict[tuple[int, int], list[int]] = {}
    for f, face_mesh in enumerate(face_meshes):
        groups.setdefault(face_mesh.shape, []).append(f)
    return list(groups.values())


def corners_of(samples: Array) -> Array:
    """Return the corners of all cells of samples (..., 2n+1, 2m+1, 3), (cells, 2, 2, 3)."""
    return cells_between(samples[..., ::2, ::2, :])


def cells_between(g: Array) -> Array:
    """Return the corners of all cells of grids (..., n+1, m+1, 3), (cells, 2, 2, 3)."""
    pairs = np.stack((np.stack((g[..., :-1, :-1, :], g[..., :-1, 1:, :]), -2),
                      np.stack((g[..., 1:, :-1, :], g[..., 1:, 1:, :]), -2)), -3)  # fmt: skip
    return pairs.reshape(-1, 2, 2, 3)


def halves(cells: Array) -> Array:
    """Return two triangles per cell, (2·cells, 3, 3), the first ones of all cells first."""
    a, b, c, d = cells[:, 0, 0], cells[:, 1, 0], cells[:, 1, 1], cells[:, 0, 1]
    return np.concatenate((np.stack((a, b, c), 1), np.stack((a, c, d), 1)))


def cut(analysis: Analysis) -> tuple[FaceMesh, ...]:
    """Cut all faces into cells."""
    functions = [RestrictedMap(analysis, face.patch) for face in analysis.boundary.faces]
    counts = _counts(analysis, functions)
    numbers = _numbers(analysis, counts)
    shell_of = {f: i for i, shell in enumerate(analysis.boundary.shells) for f in shell.faces}
    face_meshes = []
    for index, (function, samples) in enumerate(
        zip(functions, _cells(functions, counts), strict=True)
    ):
        flat = fit_plane(samples.reshape(-1, 3), analysis.scale.same_point) is not None
        face_meshes.append(FaceMesh(function, samples, numbers[index], shell_of[index], flat))
    return tuple(face_meshes)


def _cells(functions: list[RestrictedMap], counts: dict[Piece, int]) -> Iterator[Array]:
    """Yield the corners and middles of each face's cells."""
    for (n, m), same in groupby(functions, lambda f: tuple(counts[p] for p in f.pieces)):
        s, t = (np.linspace(0, 1, 2 * count + 1) for count in (n, m))
        yield from sampled(list(same), s, t)


def _counts(analysis: Analysis, functions: list[RestrictedMap]) -> dict[Piece, int]:
    """Return the number of cells along each piece of a direction."""
    classes = DirectionClasses(analysis, degrees=(1,))
    pieces = [(d, p) for d in range(3) for p in range(1, 2 * len(analysis.bounds[d]) - 1, 2)]
    wanted = dict.fromkeys(pieces, float(FEWEST))
    twists = []
    for function, (along_s, along_t, twist) in zip(functions, _all_wanted(functions), strict=True):
        s, t = (classes.owner(piece) for piece in function.pieces)
        wanted[s], wanted[t] = max(wanted[s], along_s), max(wanted[t], along_t)
        twists.append((s, t, twist))
    for s, t, twist in twists:
        # a twisted face, whose parameter lines may be straight, needs more along both directions
        short = max(1.0, twist / (wanted[s] * wanted[t]))
        wanted[s], wanted[t] = (wanted[x] * short**0.5 for x in (s, t))
    return {p: int(np.ceil(min(wanted[classes.owner(p)], MOST))) for p in pieces}


def _all_wanted(functions: Sequence[RestrictedMap]) -> list[list[float]]:
    """Return what `_wanted` does of each face: places are few where it has no waves."""
    groups: dict[tuple[int, int], list[int]] = {}
    for k, function in enumerate(functions):
        few = [_is_plain(function, axis) for axis in (0, 1)]
        n, m = (_FEW_PLACES if one else _PLACES for one in few)
        groups.setdefault((n, m), []).append(k)
    rows: list[list[float]] = [[]] * len(functions)
    for (n, m), group in groups.items():
        points = sampled([functions[k] for k in group], _uneven(n), _uneven(m))
        left = iter(group)
        while several := [*islice(points, TOGETHER)]:
            bound = CHORD * functions[0].analysis.size
            for row in _wanted(np.array(several), bound).tolist():
                rows[next(left)] = row
    return rows


def _is_plain(function: RestrictedMap, axis: int) -> bool:
    """Say whether a face is a polynomial of low degree along an axis, or M of few operations."""
    analysis = function.analysis
    spans, _ = piece_at(function.cell, analysis.bounds)
    direction = function.pieces[axis][0]
    degree = analysis.map.pieces.degree(spans, PARAMETERS[direction])
    return (degree is not None and degree <= _LOW_DEGREE) or _has_no_waves(analysis.map.coordinates)


@lru_cache(maxsize=8)
def _has_no_waves(coordinates: tuple[Expr, ...]) -> bool:
    """Say whether M is made of sums, products, quotients and low powers only."""
    return all(
        node.op in ("number", "constant", "symbol", "add", "mul", "neg", "div")
        or (
            node.op == "pow" and node.args[1].op == "number" and node.args[1].payload <= _LOW_DEGREE
        )
        for node in walk(coordinates)
    )


def _uneven(count: int) -> Array:
    """Return parameters for second differences at some places, a step before and behind each."""
    k = np.arange(count)
    # as far from even as places can be, and close to both ends
    places = (k + 0.05 + 0.9 * np.modf((k + 1) * 0.6180339887498949)[0]) / count
    places[[0, -1]] = _STEP, 1 - _STEP
    return np.asarray((places[:, None] + _STEP * np.array([-1.0, 0.0, 1.0])).ravel())


def _wanted(points: Array, bound: float) -> Array:
    """Return how many cells faces want along s, along t, and as the product of both, (n, 3).

    `points` are (n, 3k, 3l, 3). Only the offset across a face counts: uneven speed moves points
    within it.
    """
    g = points.reshape(-1, points.shape[1] // 3, 3, points.shape[2] // 3, 3, 3)
    along_s = (g[:, :, 2, :, 1] - g[:, :, 0, :, 1]) / (2 * _STEP)
    along_t = (g[:, :, 1, :, 2] - g[:, :, 1, :, 0]) / (2 * _STEP)
    normal = cross(along_s, along_t)
    length = np.sqrt(_dot(normal, normal))
    normal /= np.where(length > 0, length, 1.0)[..., None]
    middle = g[:, :, 1, :, 1]
    # what rounding leaves of second differences is no bow
    noise = 8 * np.finfo(float).eps * np.abs(points).max(axis=(1, 2, 3))
    noise = noise[:, None, None, None]
    ss, tt, st = (
        np.where(np.abs(second) > noise, second, 0.0) / _STEP**2
        for second in (
            (g[:, :, 0, :, 1] - 2 * middle + g[:, :, 2, :, 1]),
            (g[:, :, 1, :, 0] - 2 * middle + g[:, :, 1, :, 2]),
            (g[:, :, 0, :, 0] - g[:, :, 0, :, 2] - g[:, :, 2, :, 0] + g[:, :, 2, :, 2]) / 4,
        )
    )
    bows = np.array([np.abs(_dot(x, normal)).max(axis=(1, 2)) for x in (ss, tt, st)])
    turns = np.array([
        np.maximum(_turns(ss, along_s), _turns(st, along_t)),
        np.maximum(_turns(tt, along_t), _turns(st, along_s)),
    ])  # fmt: skip
    cells = np.maximum(turns, FEWEST).prod(axis=0)
    turns *= np.minimum(1.0, np.sqrt(MOST_FOR_TURN / cells)) * (bows.max(axis=0) > 0)
    along = np.maximum(np.sqrt(bows[:2] / (8 * bound)), turns)
    return np.column_stack((*along, bows[2] / (4 * bound)))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _turns(second: Array, tangents: Array) -> Array:
    """Return how many cells it takes so that tangents of faces (n, k, l, 3) turn by TURN in one."""
    speed = _dot(tangents, tangents)
    along = _dot(second, tangents)
    # |a × b|² = |a|²|b|² - (a·b)²
    square = _dot(second, second) * speed - along * along
    turn = np.sqrt(np.maximum(square, 0.0))
    moving = speed > 1e-18 * speed.max(axis=(1, 2), keepdims=True)
    return np.asarray(
        (np.where(moving, turn, 0.0) / np.where(moving, speed, 1.0)).max(axis=(1, 2)) / TURN
    )


def _numbers(analysis: Analysis, counts: dict[Piece, int]) -> list[Integers]:
    """Return the numbers of each face's corners of cells, (n+1, m+1)."""
    boundary = analysis.boundary
    start = len(boundary.vertices)
    rows = []
    for edge in boundary.edges:
        ((d, position),) = [(d, p) for d, p in enumerate(edge.cell) if p % 2]
        inner = counts[d, position] - 1
        rows.append(np.array([edge.start, *range(start, start + inner), edge.end]))
        start += inner
    result: list[Integers] = []
    for face in boundary.faces:
        n, m = (counts[d, p] for d, p in enumerate(face.patch) if p % 2)
        numbers = np.arange(start, start + (n + 1) * (m + 1)).reshape(n + 1, m + 1)
        start += numbers.size
        sides = (numbers[:, 0], numbers[-1], numbers[:, -1], numbers[0])
        for row, use, anticlockwise in zip(
            sides, face.uses, (True, True, False, False), strict=True
        ):
            if use.edge is None:
                row[...] = use.vertex
            else:
                row[...] = rows[use.edge] if use.forward == anticlockwise else rows[use.edge][::-1]
        result.append(numbers)
    return result
