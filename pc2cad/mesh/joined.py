"""Hexahedra of several bodies that share whole sides: one mesh, a set per body and side.

Which sides are one, point by point, is algebra. Directions that such sides have in common get the
same number of cells, and so each node of the one side is a node of the other, to rounding: they
become one. What the bodies' areas leave over is held against the part's area: bodies that touch
elsewhere are no such part.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.checked import CheckedMap, Stages
from pc2cad.equation.unit_box import at_end, common_sides, minus, over_unit_box, size_of, turned
from pc2cad.errors import InputError
from pc2cad.expression.identity import Verdict, is_zero
from pc2cad.mesh.closure import check_whole
from pc2cad.mesh.elements import TYPES
from pc2cad.mesh.grid import UnsuitableGridError, make_grid
from pc2cad.mesh.hexahedra import hexahedra
from pc2cad.mesh.meshing import MeshOptions
from pc2cad.mesh.ogrid import o_grid
from pc2cad.mesh.quality import measure
from pc2cad.mesh.report import MeshReport, report_on, side_areas
from pc2cad.mesh.volume_mesh import Facets, VolumeMesh

#: of the size: nodes of one place, and of volumes and areas: sums that agree
NEAR, AGREE = 1e-9, 1e-9
#: rounds of giving directions in common the same number of cells
ROUNDS = 8


class SidesNotSharedError(InputError):
    """Bodies touch, or overlap, elsewhere than along whole sides of both."""


@dataclass(frozen=True)
class Whole:
    """What is known of the part that bodies make together (model units)."""

    name: str
    units: str
    volume: float
    area: float


@dataclass(frozen=True)
class _Shared:
    """A side of one body that is a side of another, point by point."""

    bodies: tuple[str, str]
    sides: tuple[str, str]
    #: directions that run along it, of the one and of the other
    along: tuple[tuple[int, int], ...]


def mesh_joined(
    bodies: Mapping[str, CheckedMap], whole: Whole, options: MeshOptions, stages: Stages
) -> tuple[VolumeMesh, MeshReport]:
    """Return the hexahedra of bodies that share whole sides, and the report on them.

    Raises SidesNotSharedError, UnsuitableGridError, NotASolidError where an element is inverted.
    """
    if options.cells is not None:
        raise InputError(
            f"several bodies ({', '.join(bodies)}) have a size of cells, not numbers of them along "
            "u, v and w; those belong to one of them (--body)"
        )
    shared = stages("sides", lambda: tuple(_shared(bodies)))
    _check(bodies, shared, whole)
    mesh = stages("mesh", lambda: _joined(bodies, shared, whole, options))
    quality = stages("quality", lambda: measure(mesh))
    check_whole(mesh, quality.volume)
    areas = {
        f"{body}:{name}": area
        for body, checked in bodies.items()
        for name, area in side_areas(checked).items()
    }
    volumes = (whole.volume, [checked.mass.volume for checked in bodies.values()])
    return mesh, report_on(mesh, quality, volumes, areas, None, stages.times)


def _shared(bodies: Mapping[str, CheckedMap]) -> Iterator[_Shared]:
    """Give the sides that are one, point by point."""
    for a, b in combinations(bodies, 2):
        one, other = (over_unit_box(bodies[name].equation) for name in (a, b))
        size = size_of(one)
        for (p, end), name in _sides(bodies[a]).items():
            for turn, far in common_sides(one, other, p, end, opposite=False):
                here, there = at_end(one, p, end), at_end(turned(other, turn), p, far)
                own = turn[0].index(p)
                second = _sides(bodies[b]).get((own, far ^ turn[1][own]))
                gaps = (is_zero(gap, size) for gap in minus(here, there))
                if second is not None and all(gap is Verdict.PROVED for gap in gaps):
                    along = tuple((d, turn[0].index(d)) for d in range(3) if d != p)
                    yield _Shared((a, b), (name, second), along)
                    break


def _sides(checked: CheckedMap) -> dict[tuple[int, int], str]:
    """Return the names of the sides that are faces, by direction and end."""
    boundary = checked.analysis.boundary
    found = {}
    for face in boundary.faces:
        (p,) = (d for d in range(3) if face.patch[d] % 2 == 0)
        if face.patch[p] in (0, 2 * (len(boundary.labels[p]) - 1)):
            found[p, int(face.patch[p] > 0)] = boundary.key(face.patch).whole.label
    return found


def _check(bodies: Mapping[str, CheckedMap], shared: tuple[_Shared, ...], whole: Whole) -> None:
    """Raise SidesNotSharedError unless the bodies' volumes and what is left of areas add up."""
    volume = sum(checked.mass.volume for checked in bodies.values())
    inner = sum(side_areas(bodies[pair.bodies[0]])[pair.sides[0]] for pair in shared)
    area = sum(sum(checked.mass.face_areas) for checked in bodies.values()) - 2 * inner
    if abs(volume - whole.volume) > AGREE * volume or abs(area - whole.area) > AGREE * area:
        pairs = "; ".join(
            f"{a}:{s} = {b}:{t}" for (a, b), (s, t) in ((x.bodies, x.sides) for x in shared)
        )
        raise SidesNotSharedError(
            f"hexahedra of several bodies need bodies that share whole sides, point by point, and "
            f"have nothing else in common; {whole.name} shares {pairs or 'none'}, which leaves the "
            f"volume {volume:.10g} and the area {area:.10g} where it has {whole.volume:.10g} and "
            f"{whole.area:.10g}: take tetrahedra, or one of its bodies"
        )


def _joined(
    bodies: Mapping[str, CheckedMap],
    shared: tuple[_Shared, ...],
    whole: Whole,
    options: MeshOptions,
) -> VolumeMesh:
    """Return the meshes of the bodies as one."""
    meshes = _meshes(bodies, shared, options, (whole.volume / len(bodies)) ** (1 / 3) / 10)
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes.values())])
    first = dict(zip(meshes, starts[:-1].tolist(), strict=True))
    points = np.concatenate([mesh.points for mesh in meshes.values()])
    pairs: list[Integers] = []
    between: dict[str, list[Integers]] = {}
    for pair in shared:
        here, there = (
            first[body] + meshes[body].node_sets[side]
            for body, side in zip(pair.bodies, pair.sides, strict=True)
        )
        far, near = cKDTree(points[here]).query(points[there])
        size = np.ptp(points[here], axis=0).max()
        if len(here) != len(there) or far.max() > NEAR * size or len(set(near)) != len(here):
            raise UnsuitableGridError(
                f"the grids of {pair.bodies[0]} and {pair.bodies[1]} do not meet on "
                f"{pair.bodies[0]}:{pair.sides[0]}: both need the same breaks and grading along it"
            )
        pairs.append(np.stack([here[near], there]))
        between.setdefault(" | ".join(pair.bodies), []).append(here)
    sets = {name: np.concatenate(rows) for name, rows in between.items()}
    return _one(meshes, shared, whole, points, _stands(len(points), pairs), sets)


def _stands(count: int, pairs: list[Integers]) -> Integers:
    """Return the number of the place that each node is at, where pairs of nodes are one."""
    a, b = np.concatenate(pairs, axis=1) if pairs else np.empty((2, 0), np.int64)
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _meshes(
    bodies: Mapping[str, CheckedMap],
    shared: tuple[_Shared, ...],
    options: MeshOptions,
    size: float,
) -> dict[str, VolumeMesh]:
    """Return a mesh of each body, with as many cells along what sides have in common."""
    grids = {
        name: make_grid(checked, None, options.size or size, options.grading)
        for name, checked in bodies.items()
    }
    for _ in range(ROUNDS):
        counts = {name: list(grid.cells) for name, grid in grids.items()}
        for pair in shared:
            a, b = pair.bodies
            for d, e in pair.along:
                counts[a][d] = counts[b][e] = max(counts[a][d], counts[b][e])
        changed = [name for name, grid in grids.items() if tuple(counts[name]) != grid.cells]
        for name in changed:
            u, v, w = counts[name]
            grids[name] = make_grid(bodies[name], (u, v, w), None, options.grading)
        if not changed:
            break
    fill = o_grid if options.core == "ogrid" else hexahedra
    return {name: fill(checked, grids[name], options.order) for name, checked in bodies.items()}


def _one(
    meshes: Mapping[str, VolumeMesh],
    shared: tuple[_Shared, ...],
    whole: Whole,
    points: Array,
    stands: Integers,
    between: Mapping[str, Integers],
) -> VolumeMesh:
    """Return meshes as one, each node at the place that it stands at."""
    _, kept, numbers = np.unique(stands, return_index=True, return_inverse=True)
    numbers = numbers.ravel()
    blocks: dict[str, list[Integers]] = {}
    sides: dict[str, tuple[Facets, ...]] = {}
    sets: dict[str, Integers] = {}
    layers: dict[str, dict[str, Integers]] = {}
    start, done = 0, dict.fromkeys(TYPES, 0)
    for body, mesh in meshes.items():
        gone = _inner(body, mesh, shared)
        for side, facets in mesh.sides.items():
            if side not in gone:
                sides[f"{body}:{side}"] = tuple(
                    replace(f, elements=f.elements + done[f.kind]) for f in facets
                )
        for side, nodes in mesh.node_sets.items():
            sets[f"{body}:{side}"] = distinct(numbers[start + nodes])
        layers[body] = {}
        for kind, block in mesh.blocks.items():
            blocks.setdefault(kind, []).append(numbers[start + block])
            layers[body][kind] = np.arange(done[kind], done[kind] + len(block))
            done[kind] += len(block)
        start += len(mesh.points)
    sets |= {name: distinct(numbers[nodes]) for name, nodes in between.items()}
    pieces = {f"{body}:{side}" for body, mesh in meshes.items() for side in mesh.pieces}
    order = next(iter(meshes.values())).order
    return VolumeMesh(
        whole.name, whole.units, order, points[kept],
        {kind: np.concatenate(blocks[kind]) for kind in TYPES if kind in blocks}, sides, sets,
        layers, frozenset(pieces & sides.keys()),
    )  # fmt: skip


def _inner(body: str, mesh: VolumeMesh, shared: tuple[_Shared, ...]) -> set[str]:
    """Return the sets of a body's sides that lie within the part."""
    sides = {
        side for pair in shared for name, side in zip(pair.bodies, pair.sides, strict=True)
        if name == body
    }  # fmt: skip
    return sides | {piece for piece in mesh.pieces if piece.partition(" (")[0] in sides}
