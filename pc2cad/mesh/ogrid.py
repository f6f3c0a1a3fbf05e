"""O-grids: hexahedra about an axis or a centre without wedges, pyramids and tetrahedra.

The grid of a closed direction about a collapsed side is polar, and its cells at the axis are thin
and lose corners. Here a square takes the place of the innermost cells of a disc, and a cube that of
a ball; round caps of a shell get a square each. Every node is still a value of the equation: the
blocks are laid out in a unit disc or ball, whose polar coordinates are the equation's parameters.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import pi
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pc2cad.analysis import Analysis
from pc2cad.mesh.elements import HEXAHEDRON, gradients
from pc2cad.mesh.grid import Grid, UnsuitableGridError, closed_directions
from pc2cad.mesh.hexahedra import FACE_AT
from pc2cad.mesh.volume_mesh import Facets, VolumeMesh
from pc2cad.topology.cells import normal_direction

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

#: radius of the core in the unit disc or ball
_CORE = 0.55
#: how much of the core is a cube and how much a ball: its corners have to be neither flat nor sharp
_CUBE = 0.6
#: half edge of that cube where the ball has radius 1
_HALF_EDGE = {2: 0.8, 3: 0.68}


@dataclass(frozen=True)
class _Polar:
    """What the directions are: (round, radial) polar about the axis, which runs along the third."""

    round: int
    radial: int
    along: int
    #: collapsed ends of the radial direction, 0 or 1
    axes: tuple[int, ...]
    #: end of the third direction that is a point, if one is
    point: int | None
    #: the third direction closes
    closed: bool


@dataclass
class _Lattice:
    """A block: node numbers (i, j, k) of the fine grid, and the sides that its faces lie on."""

    nodes: Ints
    #: (axis, upper) -> (direction, end) of the box
    sides: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)


@dataclass
class _Layout:
    """Blocks and the place of their nodes in the box: shares of round, radial and along."""

    blocks: list[_Lattice]
    round: Array
    radial: Array
    along: Array


def o_grid(analysis: Analysis, grid: Grid, order: Literal[1, 2] = 1) -> VolumeMesh:
    """Return hexahedra of order 1 or 2 about the axis of a solid, as many as a grid has cells.

    A quarter of the cells round is the core's side. Raises UnsuitableGridError where there is no
    axis, or where something else is drawn together, too.
    """
    polar = _polar(analysis)
    across = max(1, round(grid.cells[polar.round] / 4))
    radial = max(1, grid.cells[polar.radial] - across // 2 * len(polar.axes))
    if polar.point is not None:
        along = max(1, grid.cells[polar.along] - across // 2)
        layout = _ball(polar, across * order, radial * order, along * order)
    else:
        lines = (grid.halved() if order == 2 else grid).lines[polar.along]
        make = _sphere if len(polar.axes) == 2 else _disc
        layout = _stacked(polar, *make(polar, across * order, radial * order), lines)
    return _mesh(analysis, polar, layout, order)


def _polar(analysis: Analysis) -> _Polar:
    """Return the directions of the axis; raise UnsuitableGridError where there is none."""
    boundary = analysis.boundary
    closed = closed_directions(analysis)
    if any(len(bounds) > 2 for bounds in analysis.bounds):
        raise UnsuitableGridError("an O-grid has no lines for the creases of this solid")
    if any(side.symmetry is not None and str(side.symmetry) != "(s, t)" for side in boundary.sides):
        raise UnsuitableGridError("an O-grid does not close with a turn, as this solid does")
    curves = [side for side in boundary.sides if side.fate == "curve"]
    points = [side for side in boundary.sides if side.fate == "point"]
    about = {(normal_direction(side.patch), side.along) for side in curves}
    if len(about) == 1:
        ((radial, along),) = about
        assert along is not None
        turning = 3 - radial - along
        ends = {normal_direction(side.patch) for side in points}
        if turning in closed and len(points) <= 1 and ends <= {along}:
            point = points[0].patch[along] // 2 if points else None
            axes = tuple(sorted(side.patch[radial] // 2 for side in curves))
            return _Polar(turning, radial, along, axes, point, along in closed)
    names = ", ".join(boundary.name(side.patch) for side in (*curves, *points)) or "none"
    raise UnsuitableGridError(
        "an O-grid needs one axis inside the solid, a side drawn together in a direction that "
        f"closes; the sides that are drawn together here: {names}"
    )


# -- layouts ---------------------------------------------------------------------------------------


def _rounded(p: Array) -> Array:
    """Move points of the cube or square [-1, 1]^n to a core between a cube and a ball."""
    level = np.abs(p).max(axis=-1, keepdims=True)
    ball = level * _directions(p)
    return np.asarray(_CORE * ((1 - _CUBE) * ball + _CUBE * _HALF_EDGE[p.shape[-1]] * p))


def _directions(p: Array) -> Array:
    """Return unit vectors to points of a cube, at even angles along its edges; 0 at the middle."""
    q = np.tan(pi / 4 * p)
    length = np.sqrt((q * q).sum(axis=-1, keepdims=True))
    return np.asarray(np.divide(q, length, out=np.zeros_like(q), where=length > 0))


def _loop(nodes: Ints) -> Ints:
    """Return the border of a square of nodes, anti-clockwise, its first node also at the end."""
    return np.concatenate((nodes[:-1, 0], nodes[-1, :-1], nodes[:0:-1, -1], nodes[0, ::-1]))


def _disc(polar: _Polar, across: int, rings: int) -> tuple[list[_Lattice], Array, Array]:
    """Return flat blocks of a disc, with the shares of round and radial of their nodes."""
    lines = np.linspace(-1, 1, across + 1)
    square = np.stack(np.meshgrid(lines, lines, indexing="ij"), axis=-1)
    core = np.arange((across + 1) ** 2).reshape(across + 1, across + 1)
    loop = _loop(core)
    inner = _rounded(square).reshape(-1, 2)
    border = _directions(square).reshape(-1, 2)[loop[:-1]]
    steps = np.linspace(0, 1, rings + 1)[1:, None, None]
    ring = (1 - steps) * inner[loop[:-1]] + steps * border
    outside = core.size + np.arange(rings * len(border)).reshape(rings, -1)
    outside = np.concatenate((outside, outside[:, :1]), axis=1)
    plane = np.concatenate((inner, ring.reshape(-1, 2)))
    radial = np.hypot(*plane.T)
    radial[outside[-1]] = 1.0
    outer = (polar.radial, 1 - polar.axes[0])
    blocks = [
        _Lattice(core),
        _Lattice(np.concatenate((loop[None], outside)).T, {(1, 1): outer}),
    ]
    return blocks, np.arctan2(plane[:, 1], plane[:, 0]) / (2 * pi), radial


def _cube(polar: _Polar, across: int, rings: int) -> tuple[Ints, Array]:
    """Return the nodes of a cube, or of half of one about one axis, and their places in it."""
    lines = np.linspace(-1, 1, across + 1)
    heights = np.linspace(1, -1 if len(polar.axes) == 2 else 0, rings + 1)
    cube = np.stack(np.meshgrid(lines, lines, heights, indexing="ij"), axis=-1)
    return np.arange(cube[..., 0].size).reshape(cube.shape[:3]), cube


def _surface(polar: _Polar, nodes: Ints) -> list[_Lattice]:
    """Return the flat blocks round a cube: its caps at axes and the ring between them."""
    ring = np.stack([_loop(nodes[:, :, k]) for k in range(nodes.shape[2])], axis=1)
    if len(polar.axes) == 2:
        return [_Lattice(nodes[:, :, 0]), _Lattice(ring), _Lattice(nodes[:, :, -1])]
    return [_Lattice(nodes[:, :, 0]), _Lattice(ring, {(1, 1): (polar.radial, 1 - polar.axes[0])})]


def _angles(polar: _Polar, place: Array) -> tuple[Array, Array]:
    """Return the shares of round and radial of directions (n, 3)."""
    widest = pi if len(polar.axes) == 2 else pi / 2
    height = np.arctan2(np.hypot(place[:, 0], place[:, 1]), place[:, 2])
    return np.arctan2(place[:, 1], place[:, 0]) / (2 * pi), np.minimum(height / widest, 1.0)


def _sphere(polar: _Polar, across: int, rings: int) -> tuple[list[_Lattice], Array, Array]:
    """Return flat blocks of a sphere, with the shares of round and radial of their nodes."""
    nodes, cube = _cube(polar, across, rings)
    blocks = _surface(polar, nodes)
    used, numbers = np.unique(
        np.concatenate([b.nodes.ravel() for b in blocks]), return_inverse=True
    )
    start = 0
    for block in blocks:
        block.nodes = numbers[start : start + block.nodes.size].reshape(block.nodes.shape)
        start += block.nodes.size
    return blocks, *_angles(polar, _directions(cube).reshape(-1, 3)[used])


def _stacked(
    polar: _Polar, blocks: list[_Lattice], turn: Array, radial: Array, lines: Array
) -> _Layout:
    """Repeat flat blocks along the third direction."""
    size, layers = len(turn), np.arange(len(lines))
    if polar.closed:
        layers[-1] = 0
        lines = lines[:-1]
    ends: dict[tuple[int, int], tuple[int, int]] = {
        (2, end): (polar.along, end) for end in (0, 1) if not polar.closed
    }
    stacked = [
        _Lattice(b.nodes[..., None] + size * layers, {**b.sides, **ends}) for b in blocks
    ]  # fmt: skip
    count = len(lines)
    return _Layout(stacked, np.tile(turn, count), np.tile(radial, count), np.repeat(lines, size))


def _ball(polar: _Polar, across: int, rings: int, layers: int) -> _Layout:
    """Return a core and the layers round it, for an axis that ends in a point."""
    nodes, cube = _cube(polar, across, rings)
    core = _rounded(cube).reshape(-1, 3)
    flat = _surface(polar, nodes)
    skin = np.unique(np.concatenate([block.nodes.ravel() for block in flat]))
    place_in_skin = np.full(nodes.size, -1)
    place_in_skin[skin] = np.arange(len(skin))
    steps = np.linspace(0, 1, layers + 1)[1:]
    outward = _directions(cube).reshape(-1, 3)[skin]
    shells = (1 - steps[:, None, None]) * core[skin] + steps[:, None, None] * outward
    place = np.concatenate((core, shells.reshape(-1, 3)))
    assert polar.point is not None
    # of half a cube the upper face lies on the side that the ring ends at
    ends = [side for block in flat for side in block.sides.values()]
    blocks = [_Lattice(nodes, {(2, 1): ends[0]} if ends else {})]
    for block in flat:
        number = place_in_skin[block.nodes][..., None] + len(skin) * np.arange(layers) + nodes.size
        through = np.concatenate((block.nodes[..., None], number), axis=2)
        blocks.append(_Lattice(through, {**block.sides, (2, 1): (polar.along, 1 - polar.point)}))
    along = np.sqrt((place * place).sum(axis=1))
    along[nodes.size + len(skin) * (layers - 1) :] = 1.0
    return _Layout(blocks, *_angles(polar, place), along)


# -- the mesh --------------------------------------------------------------------------------------


def _mesh(analysis: Analysis, polar: _Polar, layout: _Layout, order: int) -> VolumeMesh:
    """Return the mesh of a layout: nodes that elements have, mapped, in right-handed blocks."""
    local = {
        polar.round: layout.round % 1.0,
        polar.radial: 1 - layout.radial if polar.axes == (1,) else layout.radial,
        polar.along: 1 - layout.along if polar.point == 1 else layout.along,
    }
    rows = [_elements(block, order) for block in layout.blocks]
    used, numbers = np.unique(np.concatenate([row.ravel() for row in rows]), return_inverse=True)
    points = analysis.map.points(*(local[d][used] for d in range(3)))
    start, first = 0, 0
    elements = []
    sides: dict[tuple[int, int], list[Facets]] = {}
    for block, row in zip(layout.blocks, rows, strict=True):
        corners = numbers[start : start + row.size].reshape(row.shape)
        start += row.size
        if _left_handed(points, corners, order):
            block = _Lattice(block.nodes[::-1], {
                (axis, 1 - end if axis == 0 else end): side
                for (axis, end), side in block.sides.items()
            })  # fmt: skip
            corners = np.searchsorted(used, _elements(block, order))
        elements.append(corners)
        for (axis, end), side in block.sides.items():
            here = first + _at_end(block, order, axis, end)
            face = np.full(len(here), FACE_AT[axis][end], np.int8)
            sides.setdefault(side, []).append(Facets(HEXAHEDRON.name, here, face))
        first += len(corners)
    named = {_name(analysis, side): tuple(facets) for side, facets in sides.items()}
    equation, block_of = analysis.equation, {HEXAHEDRON.name: np.concatenate(elements)}
    mesh = VolumeMesh(equation.name, equation.units, order, points, block_of, named, {})
    sets = {side: np.unique(mesh.facet_nodes(side)["quad"]) for side in named}
    return VolumeMesh(equation.name, equation.units, order, points, block_of, named, sets)


def _elements(block: _Lattice, order: int) -> Ints:
    """Return the elements of a block, (n, 8) or (n, 20), in numbers of its nodes."""
    spans = [n - 1 for n in block.nodes.shape]
    columns = []
    for corner in _offsets(order):
        step = tuple(slice(c, n - order + c + 1, order) for c, n in zip(corner, spans, strict=True))
        columns.append(block.nodes[step].ravel())
    return np.stack(columns, axis=1)


def _offsets(order: int) -> Iterable[tuple[int, ...]]:
    """Return where an element's nodes lie in a block, in steps of the fine grid."""
    corners = np.array(HEXAHEDRON.corners, dtype=int) * order
    middles = [(corners[a] + corners[b]) // 2 for a, b in HEXAHEDRON.edges] if order == 2 else []
    return [tuple(int(x) for x in row) for row in (*corners, *middles)]


def _at_end(block: _Lattice, order: int, axis: int, end: int) -> Ints:
    """Return the elements of a block on one of its faces."""
    counts = tuple((n - 1) // order for n in block.nodes.shape)
    numbers = np.moveaxis(np.arange(int(np.prod(counts))).reshape(counts), axis, 0)
    return np.asarray(numbers[-end].ravel())


def _left_handed(points: Array, corners: Ints, order: int) -> bool:
    """Say whether most elements of a block are turned inside out."""
    slopes = gradients(HEXAHEDRON.name, order, np.full((1, 3), 0.5))[0]
    tangents = np.einsum("dk,nkx->ndx", slopes, points[corners])
    return bool(np.median(np.linalg.det(tangents)) < 0)


def _name(analysis: Analysis, side: tuple[int, int]) -> str:
    direction, end = side
    u, v, w = (2 * end if d == direction else 1 for d in range(3))
    return analysis.boundary.name((u, v, w))
