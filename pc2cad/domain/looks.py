"""Cells that are evaluated together: each knows its points when it is asked for them.

An operation on few places costs as much as one on many, so places of several cells are put into one
call. No value depends on what is evaluated with it, but where series are (`is_alike_together`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import accumulate, groupby, islice, pairwise
from math import prod

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import cross
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.topology.cells import Cell, directions_of

#: cells that are evaluated together: places, and cells, whose pieces are all met
MOST_PLACES, MOST_CELLS = 100_000, 32
#: places on grids of several faces up to which these are evaluated sooner together, and places up
#: to which they are in one row, though what depends on one parameter is worked out at all of them
MOST_TOGETHER, FEW_PLACES = 20_000, 1_000

#: an edge, and the arrays of places that it is asked for; a corner, and none; a face, and those
#: whose square grids it is asked for
_Asked = tuple[RestrictedMap, tuple[Array, ...]]


def sampled(functions: Sequence[RestrictedMap], *local: Array) -> Iterator[Array]:
    """Yield what each of several cells is at the product of local parameters, (len, …, 3).

    Cells that follow one another, and extend along the same directions, are evaluated together.
    """
    for several, grid in _together(functions, local):
        yield from several[0].analysis.map.points(*grid)


def look(functions: Sequence[RestrictedMap], *asked: Array) -> None:
    """Evaluate several faces together: each knows its points when it is asked for them.

    That is on the square grid of each of several arrays of places.
    """
    if not (functions and functions[0].analysis.map.is_alike_together):
        return
    functions = sorted(functions, key=_directions)
    every = np.concatenate(asked)
    ends = np.cumsum([0, *(len(places) for places in asked)]).tolist()
    for function, points in zip(functions, sampled(functions, every, every), strict=True):
        for places, low, high in zip(asked, ends, ends[1:], strict=False):
            own = points[low:high, low:high].transpose(2, 0, 1)
            # one coordinate after the other in memory, as all points of maps are
            function.keep((places, places), own.copy().transpose(1, 2, 0))


def look_on_grids(functions: Sequence[RestrictedMap], *grids: tuple[Array, Array]) -> None:
    """Evaluate faces that extend alike together, on several products of places of moderate size.

    What depends on one parameter alone, they have in common.
    """
    if not (len(functions) > 1 and functions[0].analysis.map.is_alike_together):
        return
    for local in grids:
        if len(functions) * len(local[0]) * len(local[1]) <= MOST_TOGETHER:
            for function, points in zip(functions, sampled(functions, *local), strict=True):
                function.keep(local, points)


def tell_sides_points(
    face: RestrictedMap, local: tuple[Array, Array], sides: Mapping[Cell, RestrictedMap]
) -> None:
    """Let the sides of a face know its points there, where these are known on a product.

    `sides` are edges by their cells.
    """
    if not face.knows(*local):
        return
    points = face(*local)
    for axis, (direction, position) in enumerate(face.pieces):
        low, high = face.analysis.span(direction, position)
        for end, at in ((0, 0.0), (-1, 1.0)):
            # the last bits of the place have to be the same
            if local[axis][end] != at or low + (high - low) * at != (high if at else low):
                continue
            cell = list(face.cell)
            cell[direction] = position + (1 if at else -1)
            side = sides.get((cell[0], cell[1], cell[2]))
            if side is not None:
                side.keep((local[1 - axis],), points[:, end] if axis else points[end])


def look_along(asked: Sequence[_Asked]) -> None:
    """Evaluate edges, each asked for several arrays of places, and corners, for none, together.

    All are in one row, whatever ways they go.
    """
    if not (asked and asked[0][0].analysis.map.is_alike_together):
        for cell, arrays in asked:
            (points,) = sampled([cell], *_joined(cell, arrays))
            _remember(cell, arrays, points)
        return
    row, count = list[_Asked](), 0
    for cell, arrays in asked:
        count += max(1, sum(map(len, arrays)))
        if row and (count > MOST_PLACES or len(row) == MOST_CELLS):
            _look_in_row(row)
            row, count = [], 0
        row.append((cell, arrays))
    _look_in_row(row)


def look_at_all(
    faces: Sequence[RestrictedMap], squares: tuple[Array, ...], asked: Sequence[_Asked]
) -> None:
    """Evaluate faces on square grids, edges and corners: few faces in one row with the others."""
    count = len(faces) * sum(len(places) ** 2 for places in squares)
    alike = bool(faces) and faces[0].analysis.map.is_alike_together
    if alike and count <= FEW_PLACES and len(faces) + len(asked) <= MOST_CELLS:
        _look_in_row([*((face, squares) for face in faces), *asked])
    else:
        look(faces, *squares)
        look_along(asked)


def _look_in_row(asked: Sequence[_Asked]) -> None:
    table, rows = _in_row(asked)
    points = asked[0][0].analysis.map.points(*table)
    for (cell, arrays), row in zip(asked, rows, strict=True):
        _remember(cell, arrays, points[row] if arrays else points[row.start])


def _in_row(asked: Sequence[_Asked]) -> tuple[Array, list[slice]]:
    """Return u, v and w of all places of cells, one cell after the other, (3, n).

    With them comes the part of the row that is each cell's.
    """
    lines = [_joined(cell, arrays) for cell, arrays in asked]
    ends = [*accumulate((len(line[0]) if line else 1 for line in lines), initial=0)]
    rows = [slice(*pair) for pair in pairwise(ends)]
    table = np.empty((len(PARAMETERS), ends[-1]))
    for (cell, _), line, row in zip(asked, lines, rows, strict=True):
        for values, place in zip(table, cell.places(*line), strict=True):
            values[row] = place
    return table, rows


def _joined(cell: RestrictedMap, arrays: tuple[Array, ...]) -> list[Array]:
    """Return the places of a cell, one array after the other, per parameter."""
    if len(cell.pieces) == 2:
        grids = [np.repeat(x, len(x)) for x in arrays], [np.tile(x, len(x)) for x in arrays]
        return [np.concatenate(grid) for grid in grids]
    return [np.concatenate(arrays)] if arrays else []


def _remember(cell: RestrictedMap, arrays: tuple[Array, ...], points: Array) -> None:
    """Let a cell know its points at several arrays of places, one after the other."""
    if not arrays:
        cell.keep((), points)
    start = 0
    for places in arrays:
        n = len(places)
        if len(cell.pieces) == 1:
            cell.keep((places,), points[start : start + n])
            start += n
            continue
        # one coordinate after the other in memory, as all points of maps are
        square = points[start : start + n * n].T.copy().reshape(3, n, n)
        cell.keep((places, places), square.transpose(1, 2, 0))
        start += n * n


def look_across(functions: Sequence[RestrictedMap], *local: Array) -> None:
    """Evaluate normals of faces together, on a product of places."""
    for several, grid in _together(sorted(functions, key=_directions), local):
        s, t = directions_of(several[0].cell)
        _, *tangents = several[0].analysis.map.frame(*grid)
        along_s, along_t = tangents[s], tangents[t]
        for function, normals in zip(several, cross(along_s, along_t), strict=True):
            function.keep_normals(local, normals)


def look_across_each(*asked: tuple[Sequence[RestrictedMap], Array]) -> None:
    """Evaluate normals of faces together, on square grids, some faces on those of other places."""
    first = next((functions[0] for functions, _ in asked if functions), None)
    if first is None:
        return
    count = sum(len(functions) * len(places) ** 2 for functions, places in asked)
    if count <= FEW_PLACES and first.analysis.map.is_alike_together:
        _look_across_in_row([(f, (places,)) for functions, places in asked for f in functions])
        return
    for functions, places in asked:
        look_across(functions, places, places)


def _look_across_in_row(asked: Sequence[_Asked]) -> None:
    """Evaluate all in one row, whatever ways they go: few places cost less than operations do."""
    table, rows = _in_row(asked)
    _, *tangents = asked[0][0].analysis.map.frame(*table)
    for (face, (places,)), row in zip(asked, rows, strict=True):
        s, t = directions_of(face.cell)
        normals = cross(tangents[s][row], tangents[t][row])
        square = len(places), len(places), 3
        face.keep_normals((places, places), normals.reshape(square))


def _directions(function: RestrictedMap) -> tuple[int, ...]:
    return tuple(directions_of(function.cell))


def _together(
    functions: Sequence[RestrictedMap], local: tuple[Array, ...]
) -> Iterator[tuple[list[RestrictedMap], list[Array]]]:
    """Yield cells that extend along the same directions, and u, v and w of all their places.

    Each of these has one row per cell, and an axis per direction along which the cells extend.
    """
    alike = bool(functions) and functions[0].analysis.map.is_alike_together
    most = min(MOST_CELLS, MOST_PLACES // prod(len(x) for x in local)) if alike else 1
    for directions, same in groupby(functions, _directions):
        while several := list(islice(same, max(1, most))):
            columns = zip(*(function.places(*local) for function in several), strict=True)
            shapes = [
                [-1 if axis == d else 1 for axis in directions] for d in range(len(PARAMETERS))
            ]
            yield (
                several,
                [
                    np.array(column).reshape(len(several), *shape)
                    for column, shape in zip(columns, shapes, strict=True)
                ],
            )
