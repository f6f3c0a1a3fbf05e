"""MFEM NURBS meshes (.mesh), version 1.0, in the form with patches.

A direction in which the solid closes is divided into three patches at least, because MFEM's
elements need different vertices. MFEM wants the parallel edges of all patches directed alike. Where
the solid closes with a turn, an edge is parallel to its own reverse; there the directions across
are divided in the middle, and the halves run towards it: the turn carries halves onto halves.
Collapsed sides have equal poles.

A field is a GridFunction (.gf) on the same patches: `mfem::GridFunction(&mesh, stream)` reads it
beside the mesh. Where sides are joined MFEM has one value for both.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.errors import InputError
from pc2cad.export.spline_files import numbers, rows
from pc2cad.geometry.splines.trivariate import SplineVolume
from pc2cad.mesh.grid import Grid
from pc2cad.mesh.node_merging import cell_nodes, joined, partner_nodes
from pc2cad.representation.volume import SplineField, VolumeModel
from pc2cad.topology.cells import IDENTITY, Cell, directions_of, normal_direction
from pc2cad.topology.complex import SideFate

#: corners of a hexahedron in MFEM's order, and its sides, outwards
_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
_SIDES = ((3, 0, 4, 7), (1, 2, 6, 5), (0, 1, 5, 4), (2, 3, 7, 6), (3, 2, 1, 0), (4, 5, 6, 7))
#: fewest patches round
_ROUND = 3
#: MFEM's `KnotVector::MaxOrder`: beyond, it writes past the end of its arrays
_HIGHEST_DEGREE = 10
#: u, v or w (0, 1, 2) and the number of a patch along it
_Interval = tuple[int, int]


class DegreeTooHighError(InputError):
    """A spline has a higher degree than the format's reader can hold."""


class FieldJumpsError(InputError):
    """A field has two values where sides are joined, and the format holds one."""


def encode(model: VolumeModel) -> str:
    """Return the text of the file; coordinates are Cartesian, every pole has a weight.

    Boundary attributes are 1 … 6 for the lower and upper side of the first, second, third axis.
    Raises DegreeTooHighError for a volume that MFEM cannot hold.
    """
    degree = max(max(patch.volume.degrees) for patch in model.patches)
    if degree > _HIGHEST_DEGREE:
        raise DegreeTooHighError(
            f"the volume has the degree {degree}, and MFEM holds {_HIGHEST_DEGREE} at most; "
            "--profile cubic approximates it by cubic splines"
        )
    lattice = _lattice(model)
    blocks = list(_blocks(model, lattice, [patch.volume for patch in model.patches]))
    edges: dict[tuple[int, int], int] = {}
    for block in blocks:
        edges |= block.edges
    boundary = [line for block in blocks for line in block.boundary]
    lines = ["MFEM NURBS mesh v1.0", "", "dimension", "3", "", "elements", str(len(blocks))]
    lines += ["1 5 " + " ".join(map(str, block.corners)) for block in blocks]
    lines += ["", "boundary", str(len(boundary)), *boundary]
    lines += ["", "edges", str(len(edges))]
    lines += [f"{knot} {a} {b}" for (a, b), knot in edges.items()]
    lines += ["", "vertices", str(int(lattice.vertices.max()) + 1), "", "patches"]
    for block in blocks:
        lines += ["", "knotvectors", "3"]
        for axis in block.volume.axes:
            space = axis.space
            lines.append(f"{space.degree} {space.size} {numbers(space.knots)}")
        lines += ["", "dimension", "3", "", "controlpoints_cartesian"]
        tail = " 1" if block.volume.weights is None else ""
        lines += [row + tail for row in rows(block.volume, homogeneous=False)]
    return "\n".join(lines) + "\n"


def encode_field(model: VolumeModel, name: str) -> str:
    """Return the text of a field's GridFunction; raise FieldJumpsError, InputError."""
    field = model.field(name)
    _check_joined(model, field)
    blocks = list(_blocks(model, _lattice(model), field.volumes))
    degrees = {degree for block in blocks for degree in block.volume.degrees}
    # MFEM takes the order of a collection without a number from the mesh
    collection = f"NURBS{degrees.pop()}" if len(degrees) == 1 else "NURBS"
    size = blocks[0].volume.poles.shape[-1]
    lines = ["FiniteElementSpace", f"FiniteElementCollection: {collection}", f"VDim: {size}"]
    lines += ["Ordering: 1", "", "NURBS_patches"]
    for number, block in enumerate(blocks):
        lines += ["", f"# patch {number}", *rows(block.volume, homogeneous=False, weight="nowhere")]
    return "\n".join(lines) + "\n"


def _check_joined(model: VolumeModel, field: SplineField) -> None:
    """Raise FieldJumpsError where the field's poles differ on sides that are joined."""
    room = max(10 * field.deviation, 1e-9 * field.largest)
    for side in model.boundary.sides:
        if side.partner is None or side.symmetry is None:
            continue
        here, there = (_poles_on(model, field, patch) for patch in (side.patch, side.partner))
        there = side.symmetry.read(there)
        if here.shape != there.shape or not np.abs(here - there).max() <= room:
            names = " and ".join(model.boundary.name(p) for p in (side.patch, side.partner))
            raise FieldJumpsError(
                f"{names} are one place, and the field {field.name} has two values there: MFEM "
                "holds one; write it for G+Smo (.xml)"
            )


def _poles_on(model: VolumeModel, field: SplineField, patch: Cell) -> Array:
    """Return a field's poles on a side of a patch, along the side's own s and t."""
    d = normal_direction(patch)
    for one, volume in zip(model.patches, field.volumes, strict=True):
        step = patch[d] - one.cell[d]
        if abs(step) == 1 and all(one.cell[k] == patch[k] for k in directions_of(patch)):
            order = [model.directions.index(k) for k in range(3)]
            poles = volume.poles.transpose(*order, 3)
            return np.asarray(np.take(poles, -1 if step > 0 else 0, axis=d))
    raise AssertionError(f"no patch has the side {patch}")


@dataclass(frozen=True, eq=False)
class _Lattice:
    """The patches of the file as cells of the box, along u, v and w."""

    grid: Grid
    #: patches of the file for each piece of u, v and w
    parts: tuple[int, int, int]
    #: number of the vertex at each place
    vertices: np.ndarray[tuple[int, ...], np.dtype[np.int64]]
    #: of each patch along u, v, w: its knot vector, and whether it runs backwards
    knots: dict[_Interval, tuple[int, bool]]
    #: sides of the box that are open
    open: frozenset[tuple[int, int, int]]


def _lattice(model: VolumeModel) -> _Lattice:
    """Return the fewest patches whose edges can be directed alike."""
    sides = [side for side in model.boundary.sides if side.partner is not None]
    closed = {d for side in sides for d in _closing(side)}
    parts = [-(-_ROUND // n) if d in closed else 1 for d, n in enumerate(model.pieces)]
    turning = {
        d
        for side in sides
        if side.symmetry not in (None, IDENTITY)
        for d in directions_of(side.patch)
    }
    halves = [2 * n if d in turning else n for d, n in enumerate(parts)]
    for counts in (parts, halves):
        for side in sides:
            if side.symmetry is not None and side.symmetry.swap and side.partner is not None:
                swapped = {*directions_of(side.patch), *directions_of(side.partner)}
                for d in swapped:
                    counts[d] = max(counts[e] for e in swapped)
        knots = _directed(model, sides, counts)
        if knots is not None:
            break
    else:
        counts, sides = parts, [side for side in sides if side.symmetry == IDENTITY]
        knots = _directed(model, sides, counts)
        assert knots is not None
    sizes = [n * k for n, k in zip(model.pieces, counts, strict=True)]
    u, v, w = (np.arange(n + 1.0) for n in sizes)
    grid = Grid((u, v, w), tuple(tuple(range(0, n + 1, k)) for n, k in
                                 zip(sizes, counts, strict=True)))  # fmt: skip
    pairs = [(cell_nodes(grid, side.patch), partner_nodes(grid, side)) for side in sides]
    moved, stands = joined([(a.ravel(), b.ravel()) for a, b in pairs])
    table = np.arange((sizes[0] + 1) * (sizes[1] + 1) * (sizes[2] + 1))
    table[moved] = stands
    _, numbered = np.unique(table, return_inverse=True)
    glued = {side.patch for side in sides}
    return _Lattice(
        grid, (counts[0], counts[1], counts[2]), numbered.reshape([n + 1 for n in sizes]), knots,
        frozenset(side.patch for side in model.boundary.sides if side.patch not in glued),
    )  # fmt: skip


def _closing(side: SideFate) -> Iterator[int]:
    """Give the direction whose two ends a gluing joins."""
    assert side.partner is not None
    for d, (here, there) in enumerate(zip(side.patch, side.partner, strict=True)):
        if here % 2 == 0 and there % 2 == 0 and here != there:
            yield d


def _directed(
    model: VolumeModel, sides: list[SideFate], parts: list[int]
) -> dict[_Interval, tuple[int, bool]] | None:
    """Return the knot vector of every patch along u, v, w, and whether it runs backwards.

    None where one would have to run both ways.
    """
    links: dict[_Interval, list[tuple[_Interval, bool]]] = {
        (d, i): [] for d in range(3) for i in range(model.pieces[d] * parts[d])
    }
    for side in sides:
        assert side.symmetry is not None
        assert side.partner is not None
        flags = (side.symmetry.reverse_s, side.symmetry.reverse_t)
        there = directions_of(side.partner)
        for axis, d in enumerate(directions_of(side.patch)):
            other = 1 - axis if side.symmetry.swap else axis
            e, count = there[other], parts[d]
            for i in range(count):
                j = count - 1 - i if flags[other] else i
                a = (d, side.patch[d] // 2 * count + i)
                b = (e, side.partner[e] // 2 * count + j)
                links[a].append((b, flags[other]))
                links[b].append((a, flags[other]))
    found: dict[_Interval, tuple[int, bool]] = {}
    count = 0
    for start in links:
        if start in found:
            continue
        found[start] = (count, False)
        stack = [start]
        while stack:
            here = stack.pop()
            for other_end, reverse in links[here]:
                wanted = (count, found[here][1] != reverse)
                if other_end not in found:
                    found[other_end] = wanted
                    stack.append(other_end)
                elif found[other_end] != wanted:
                    return None
        count += 1
    return found


@dataclass(frozen=True, eq=False)
class _Block:
    """A patch of the file: an element with its vertices in MFEM's order."""

    volume: SplineVolume
    corners: list[int]
    #: (from, to) -> knot vector
    edges: dict[tuple[int, int], int]
    boundary: list[str]


def _blocks(
    model: VolumeModel, lattice: _Lattice, volumes: Sequence[SplineVolume]
) -> Iterator[_Block]:
    for patch, whole in zip(model.patches, volumes, strict=True):
        parts = [lattice.parts[d] for d in model.directions]
        for steps, volume in _divided(whole, parts):
            place = [0, 0, 0]
            for d, step in zip(model.directions, steps, strict=True):
                place[d] = patch.cell[d] // 2 * lattice.parts[d] + step
            back = [lattice.knots[d, place[d]][1] for d in model.directions]
            # an odd number of reversals is a reflection: two axes change places
            order = (1, 0, 2) if sum(back) % 2 else (0, 1, 2)
            axes = [model.directions[k] for k in order]
            turned = volume.turned(order, (back[0], back[1], back[2]))
            yield _block(model, lattice, place, axes, turned, patch.cell)


def _block(
    model: VolumeModel,
    lattice: _Lattice,
    place: list[int],
    axes: list[int],
    volume: SplineVolume,
    cell: tuple[int, int, int],
) -> _Block:
    knots = [lattice.knots[d, place[d]] for d in axes]

    def vertex(corner: tuple[int, ...]) -> int:
        at = list(place)
        for d, step, (_, backwards) in zip(axes, corner, knots, strict=True):
            at[d] += 1 - step if backwards else step
        return int(lattice.vertices[tuple(at)])

    corners = [vertex(corner) for corner in _CORNERS]
    edges = {
        (vertex(corner), vertex((*corner[:k], 1, *corner[k + 1 :]))): knots[k][0]
        for corner in _CORNERS
        for k in range(3)
        if not corner[k]
    }
    boundary = []
    for side, ring in enumerate(_SIDES):
        d, (_, backwards) = axes[side // 2], knots[side // 2]
        upper = (side % 2 == 1) != backwards
        patch = list(cell)
        patch[d] += 1 if upper else -1
        last = place[d] == (len(lattice.grid.lines[d]) - 2 if upper else 0)
        if last and (patch[0], patch[1], patch[2]) in lattice.open:
            attribute = 2 * model.directions.index(d) + upper + 1
            boundary.append(f"{attribute} 3 " + " ".join(str(corners[k]) for k in ring))
    return _Block(volume, corners, edges, boundary)


def _divided(volume: SplineVolume, parts: list[int]) -> list[tuple[list[int], SplineVolume]]:
    """Return the parts of a volume, divided along each axis, with their places."""
    blocks = [([0, 0, 0], volume)]
    for axis, count in enumerate(parts):
        if count > 1:
            blocks = [
                ([*place[:axis], k, *place[axis + 1 :]], part)
                for place, whole in blocks
                for k, part in enumerate(whole.split(axis, count))
            ]
    return blocks
