"""Pairs of patches that boxes do not separate: a hierarchy of blocks, from whole sheets down."""

from __future__ import annotations

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.geometry.sheets import projected
from pc2cad.solidity.embedding.cells import Surfaces
from pc2cad.solidity.embedding.separation import Separation, boxes


def near_pairs(surfaces: Surfaces, tests: Separation) -> Integers:
    """Return pairs of patches, each with itself too, whose boxes meet."""
    flat = projected(surfaces.nets).reshape(len(surfaces.nets), -1, 3)
    low, high = boxes(flat)
    low, high = low - tests.noise, high + tests.noise
    levels: list[_Level] = [(low, high, surfaces.shapes, surfaces.start)]
    while levels[-1][2].max() > 1:
        levels.append(_coarser(*levels[-1]))
    count = len(surfaces.sheets)
    pairs: Integers = np.stack(np.triu_indices(count), axis=1)
    for depth in range(len(levels) - 1, -1, -1):
        low, high, shapes, start = levels[depth]
        if depth + 1 < len(levels):
            pairs = _children(levels[depth + 1][2], levels[depth + 1][3], shapes, start, pairs)
        a, b = pairs[:, 0], pairs[:, 1]
        meet = ((low[a] <= high[b]) & (low[b] <= high[a])).all(axis=1)
        pairs = pairs[meet]
    return pairs


#: limits of blocks in seven directions, and per sheet rows and columns of blocks, and the first
_Level = tuple[Array, Array, Integers, Integers]


def _coarser(
    low: Array, high: Array, shapes: Integers, start: Integers
) -> tuple[Array, Array, Integers, Integers]:
    """Return blocks of two by two."""
    lows, highs = [], []
    for (n, m), first in zip(shapes, start, strict=True):
        grids = []
        for values, reduce in ((low, np.minimum), (high, np.maximum)):
            grid = values[first : first + n * m].reshape(n, m, -1)
            for axis in (0, 1):
                grid = reduce.reduceat(grid, np.arange(0, grid.shape[axis], 2), axis=axis)
            grids.append(grid.reshape(-1, grid.shape[-1]))
        lows.append(grids[0])
        highs.append(grids[1])
    coarser = (shapes + 1) // 2
    sizes = coarser.prod(axis=1)
    return np.concatenate(lows), np.concatenate(highs), coarser, np.cumsum(sizes) - sizes


def _children(
    coarse: Integers, coarse_start: Integers, shapes: Integers, start: Integers, pairs: Integers
) -> Integers:
    sheet = np.repeat(np.arange(len(coarse)), coarse.prod(axis=1))
    options = []
    for side in (0, 1):
        row = pairs[:, side]
        own = sheet[row]
        index = row - coarse_start[own]
        i, j = index // coarse[own, 1], index % coarse[own, 1]
        found = []
        for di in (0, 1):
            for dj in (0, 1):
                x, y = 2 * i + di, 2 * j + dj
                inside = (x < shapes[own, 0]) & (y < shapes[own, 1])
                found.append(np.where(inside, start[own] + x * shapes[own, 1] + y, -1))
        options.append(found)
    alone = pairs[:, 0] == pairs[:, 1]
    blocks = []
    for p, first in enumerate(options[0]):
        for q, second in enumerate(options[1]):
            chosen = (first >= 0) & (second >= 0) & (~alone | (p <= q))
            blocks.append(np.stack((first[chosen], second[chosen]), axis=1))
    return np.concatenate(blocks)
