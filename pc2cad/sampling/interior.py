"""Points of the interior: samples of the solid, and M inverted at given points.

Input: CheckedMap. Output: PointSet (samples) or Location (where points lie). Everything works in
the local parameters of the box and is vectorised.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.checked import CheckedMap
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.errors import InputError
from pc2cad.sampling.inversion import Inverse, seed_points

#: cells per smooth piece of a direction in which samples are drawn with one bound each
_STRATA = 12
#: share that a cell's bound lies above the largest |det J| of its nodes
_MARGIN = 1.25
#: candidates per point of blue noise
_CANDIDATES = 8
_CHUNK = 100_000
MOST_POINTS = 100_000_000


@dataclass(frozen=True, eq=False)
class PointSet:
    """Points inside the solid (n, 3) in model units, and their u, v, w (n, 3)."""

    name: str
    units: str
    points: Array
    parameters: Array
    #: no two points are nearer than this (0: nothing is known)
    spacing: float = 0.0


@dataclass(frozen=True, eq=False)
class Location:
    """Where points lie with respect to a solid."""

    #: True where M takes the point's value in the box
    inside: Booleans
    #: u, v, w of the nearest point found, (n, 3)
    parameters: Array
    #: that nearest point, (n, 3)
    nearest: Array
    #: how far it is; within rounding of 0 for inner points
    distance: Array
    #: by how much another place may be nearer, at most, as samples of the boundary say
    gap: Array


def sample_uniform(checked: CheckedMap, count: int, seed: int = 0) -> PointSet:
    """Return random points of equal density in space: (u,v,w) are drawn with density |det J|."""
    _check(count)
    analysis = checked.analysis
    return _point_set(analysis, _draw(analysis, count, np.random.default_rng(seed)))


def sample_blue(checked: CheckedMap, count: int, seed: int = 0) -> PointSet:
    """Return random points that keep a distance (Poisson discs); `spacing` says which.

    Of eight times as many uniform points those are kept, in random order, that are no nearer than
    the spacing to one kept already; the spacing is the largest for which enough are left.
    """
    _check(count)
    analysis = checked.analysis
    local = _draw(analysis, _CANDIDATES * count, np.random.default_rng(seed))
    points = analysis.map.points(*local.T)
    tree = cKDTree(points)
    low, high = 0.0, 2.0 * float(np.cbrt(checked.mass.volume / count))
    kept: Integers = np.arange(count)
    for _ in range(12):
        middle = (low + high) / 2
        found = _apart(tree, len(points), middle)
        if len(found) >= count:
            low, kept = middle, found[:count]
        else:
            high = middle
    return _point_set(analysis, local[kept], low)


def sample_grid(checked: CheckedMap, spacing: float) -> PointSet:
    """Return the points of a cubic lattice of a spacing (model units) that lie in the solid."""
    if not 0 < spacing < np.inf:
        raise InputError(f"the spacing of a lattice must be a positive length, not {spacing}")
    shell = seed_points(checked.analysis)[1]
    low, high = shell.min(axis=0) - spacing, shell.max(axis=0) + spacing
    counts = np.ceil((high - low) / spacing)
    if np.prod(counts) > MOST_POINTS:
        raise InputError(f"a lattice of {spacing:.3g} has more than {MOST_POINTS:.0e} points here")
    axes = [
        np.arange(np.ceil(a / spacing), np.floor(b / spacing) + 1) * spacing
        for a, b in zip(low, high, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    found = locate(checked, points)
    equation = checked.equation
    return PointSet(equation.name, equation.units, points[found.inside],
                    found.parameters[found.inside], spacing)  # fmt: skip


def locate(checked: CheckedMap, points: ArrayLike) -> Location:
    """Return for each point (n, 3) whether it is inside, and the nearest place of the solid.

    M is inverted by damped Newton steps that stay in the box, from the nearest of many images. A
    point is inside where that ends within 1e-10 of the part's size of it. For the others all cells
    of the boundary are searched that may hold a nearer place; `gap` says what that leaves open.
    """
    targets = np.atleast_2d(np.asarray(points, dtype=float))
    if targets.ndim != 2 or targets.shape[1] != 3 or not np.isfinite(targets).all():
        raise InputError("points to locate are rows of three finite coordinates")
    analysis = checked.analysis
    inverse = Inverse(analysis)
    local, gap = np.empty_like(targets), np.zeros(len(targets))
    for start in range(0, len(targets), _CHUNK):
        part = slice(start, start + _CHUNK)
        local[part], gap[part] = inverse(targets[part])
    nearest = analysis.map.points(*local.T)
    distance = np.sqrt(((nearest - targets) ** 2).sum(axis=1))
    return Location(distance <= inverse.tolerance, _own(analysis, local), nearest, distance, gap)


def _check(count: int) -> None:
    if not 1 <= count <= MOST_POINTS:
        raise InputError(f"the number of points must be from 1 to {MOST_POINTS:.0e}, not {count}")


def _point_set(analysis: Analysis, local: Array, spacing: float = 0.0) -> PointSet:
    equation = analysis.equation
    return PointSet(equation.name, equation.units, analysis.map.points(*local.T),
                    _own(analysis, local), spacing)  # fmt: skip


def _own(analysis: Analysis, local: Array) -> Array:
    """Return the equation's own u, v, w at local parameters."""
    return np.stack([analysis.map.values(d, local[:, d]) for d in range(3)], axis=1)


# -- drawing with density |det J| ------------------------------------------------------------------


def _jacobian(analysis: Analysis, u: Array, v: Array, w: Array) -> Array:
    a, b, c = analysis.map.tangents((0, 1, 2), u, v, w)
    return np.asarray(np.abs((np.cross(a, b) * c).sum(axis=-1)))


def _strata(analysis: Analysis) -> list[Array]:
    rows = []
    for d in range(3):
        inner = [b.position for b in analysis.breaks[d] if 0 < b.position < 1]
        limits = [0.0, *inner, 1.0]
        each = max(1, -(-_STRATA // (len(limits) - 1)))
        rows.append(np.concatenate(
            [np.linspace(a, b, each + 1)[:-1] for a, b in pairwise(limits)] + [[1.0]]
        ))  # fmt: skip
    return rows


def _draw(analysis: Analysis, count: int, random: np.random.Generator) -> Array:
    """Return local parameters with density |det J|, by rejection with a bound for each cell.

    A bound that a drawn place exceeds is raised and everything is drawn again, so that every place
    returned was drawn under bounds that held.
    """
    edges = _strata(analysis)
    fine = [np.sort(np.concatenate((e, (e[1:] + e[:-1]) / 2))) for e in edges]
    values = _jacobian(analysis, *open_grid(*fine))
    for axis in range(3):
        values = np.moveaxis(values, axis, 0)
        values = np.maximum(np.maximum(values[:-1:2], values[1::2]), values[2::2])
        values = np.moveaxis(values, 0, axis)
    bounds = _MARGIN * values.ravel() + 1e-3 * float(values.max())
    shape = values.shape
    lengths = np.ix_(*(np.diff(e) for e in edges))
    sizes = np.asarray(lengths[0] * lengths[1] * lengths[2]).ravel()
    while True:
        drawn = _try(analysis, count, random, edges, shape, bounds, sizes)
        if drawn is not None:
            return drawn


def _try(
    analysis: Analysis,
    count: int,
    random: np.random.Generator,
    edges: list[Array],
    shape: tuple[int, ...],
    bounds: Array,
    sizes: Array,
) -> Array | None:
    chances = bounds * sizes
    chances /= chances.sum()
    rows: list[Array] = []
    missing = count
    while missing > 0:
        cells = random.choice(len(chances), size=min(2 * missing + 64, _CHUNK), p=chances)
        place = np.empty((len(cells), 3))
        for d, index in enumerate(np.unravel_index(cells, shape)):
            low, high = edges[d][index], edges[d][index + 1]
            place[:, d] = low + (high - low) * random.random(len(cells))
        density = _jacobian(analysis, *place.T)
        above = density > bounds[cells]
        if above.any():
            np.maximum.at(bounds, cells[above], _MARGIN * density[above])
            return None
        kept = place[random.random(len(cells)) * bounds[cells] < density]
        rows.append(kept[:missing])
        missing -= len(rows[-1])
    return np.concatenate(rows)


def _apart(tree: cKDTree, count: int, distance: float) -> Integers:
    """Return indices, ascending, of points that are no nearer to each other than a distance.

    Lower indices go first: a point is kept when none of its lower neighbours is.
    """
    pairs = tree.query_pairs(distance, output_type="ndarray")
    low, high = pairs.min(axis=1), pairs.max(axis=1)
    kept, undecided = np.zeros(count, dtype=bool), np.ones(count, dtype=bool)
    while undecided.any():
        blocked = np.zeros(count, dtype=bool)
        live = undecided[low]
        blocked[high[live]] = True
        chosen = undecided & ~blocked
        kept |= chosen
        undecided &= ~chosen
        undecided[high[chosen[low]]] = False
    return np.flatnonzero(kept)
