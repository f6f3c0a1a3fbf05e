"""Volume and areas of a map that is smooth all over its box, from evaluations that they share.

A sufficient test: what does not pass it is integrated by panels (`settling`). Lines along each
direction say how many nodes it needs; where M is a polynomial of one, its degree does. Two product
rules are taken, of which the second has half as many nodes again, and their difference is the error
estimate. Their nodes hold the ends of directions at which faces lie, so that the areas of these are
sums over parts of the same evaluations. What stands out of its surroundings anywhere has to be
shown by the functions through the nodes as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from math import ceil

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import along, cross, dots, lengths, product, vectors
from pc2cad.arrays.scatter import scattered
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.domain.pieces import has_pieces
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import Expr
from pc2cad.geometry.splines.bernstein import degree_in
from pc2cad.integrals.features import SCATTER, explained, scatter, tops
from pc2cad.integrals.flat_faces import flat_lengths
from pc2cad.integrals.quadrature import EPSILON, Samples
from pc2cad.integrals.rules import DOUBTFUL, EXACT, SLAB_POINTS, Density
from pc2cad.integrals.spectral import (
    HIGHEST,
    LEAST,
    Rule,
    even,
    lobatto,
    spread,
)
from pc2cad.topology.cells import IDENTITY, Cell, directions_of, normal_direction

#: places of the lines in the other two directions
_LINES = scattered(8, 2)
#: terms of a series that are taken for resolved, and what a point's way along a line may miss of
#: the integral of its tangent (of the largest way)
_RESOLVED, _MISSED = 1e-14, 1e-12
#: the share of what stands out that the functions through the nodes may leave
_LEFT = 1e-4
#: a degree of M up to which it says the nodes of a direction
_MOST_DEGREE = 4


@dataclass(frozen=True, eq=False)
class Together:
    """Integrals (k,) of a density and their relative error; areas of faces, and their errors."""

    values: Array
    error: float
    areas: dict[Cell, tuple[float, float]]


@dataclass(frozen=True)
class _Direction:
    """How many nodes a direction needs."""

    count: int
    #: whether M comes round to itself, and whether it is a polynomial
    round: bool = False
    exact: bool = False

    def rule(self, grow: float) -> Rule:
        """Return the rule with so many times the nodes; an exact one stays."""
        if self.exact:
            return lobatto(self.count)
        count = ceil(grow * self.count)
        return even(count) if self.round else lobatto(count)


def integrate_together(
    analysis: Analysis, limits: list[list[float]], density: Density, centre: Array
) -> Together | None:
    """Return integrals of a density over the whole box, and areas; None where that is not enough.

    The density has det J and (M - centre) det J as its integrands, and shows points and all their
    tangents. Of faces on which it is not enough there is no area.
    """
    if any(len(row) > 2 for row in (*limits, *analysis.bounds)) or analysis.equation.layers:
        return None
    with np.errstate(all="ignore"):
        directions = _directions(analysis, density)
        if directions is None:
            return None
        coarse, fine = (_Grid.of(density, directions, grow) for grow in (1.0, 1.5))
        if coarse is None or fine is None:
            return None
        before, values = coarse.integrals(), fine.integrals()
        error = float(np.abs(values - before).max() / max(np.abs(values).max(), 1e-300))
        if not error < DOUBTFUL:
            return None
        seen = _Scatter.of(analysis)
        if not seen.is_shown(fine, centre, analysis.size):
            return None
        return Together(values, max(error, EXACT), _areas(seen, directions, coarse, fine))


# -- how many nodes --------------------------------------------------------------------------------


def _directions(analysis: Analysis, density: Density) -> list[_Direction] | None:
    """Return what each direction needs, None where one needs too much."""
    degrees = [_degree(analysis.map.coordinates, name) for name in PARAMETERS]
    across = {normal_direction(face.patch) for face in analysis.boundary.faces}
    found: list[_Direction] = []
    for d, degree in enumerate(degrees):
        if degree is not None:
            # M det J is of degree 4n - 1 and det J, which is looked at by itself, of 3n - 1
            found.append(_Direction(max(2 * degree + 1, 3 * degree, 2), exact=True))
            continue
        others = [e for e in range(3) if e != d and e in across and degrees[3 - d - e] is None]
        direction = _along_lines(density, d, others, _comes_round(analysis, d))
        if direction is None:
            return None
        found.append(direction)
    return found


def _degree(trees: tuple[Expr, ...], name: str) -> int | None:
    """Return the degree of M in a parameter, None where it is none or high."""
    degree = None if has_pieces(trees, name) else degree_in(trees, name)
    return degree if degree is not None and degree <= _MOST_DEGREE else None


def _comes_round(analysis: Analysis, d: int) -> bool:
    """Say whether both ends of a direction are one side inside of the solid."""
    (low,) = (side for side in analysis.boundary.sides if side.patch[d] == 0)
    partner = low.partner is not None and low.partner[d] == 2
    return partner and low.symmetry == IDENTITY


def _along_lines(
    density: Density, d: int, across: Sequence[int], comes_round: bool
) -> _Direction | None:
    """Return what resolves a density on a few lines along a direction, None where too much would.

    Areas across some other directions count as well, unless they would need too much.
    """
    rule = spread(comes_round)
    places = [x[None, :] for x in _LINES.T]
    places.insert(d, rule.nodes[:, None])
    seen = density(*places)
    if not _is_whole(seen, d, rule):
        return None
    highest = HIGHEST // 2 if comes_round else HIGHEST
    last = _last_term(seen.values, seen.terms, rule)
    if last > highest:
        return None
    for e in across:
        s, t = (tangent for axis, tangent in enumerate(seen.tangents or ()) if axis != e)
        more = _last_term(lengths(cross(s, t))[..., None], lengths(s) * lengths(t), rule)
        last = max(last, more) if more <= highest else last
    return _Direction(max(LEAST, last + 2 if comes_round else last // 2 + 3), comes_round)


def _last_term(values: Array, terms: Array, rule: Rule) -> int:
    """Return the last term of series over lines, of integrands (n, L, k), that is not rounding.

    `terms` (n, L) are the sizes of what the first integrand is a sum of.
    """
    sizes = product(rule.weights, np.abs(values).reshape(len(values), -1)).reshape(values.shape[1:])
    first = max(float(sizes[:, 0].max()), 1e-300)
    noise = 64 * EPSILON * float(vectors(rule.weights, terms).max()) / first
    return rule.last_term(values, max(_RESOLVED, noise) * float(sizes.max()))


def _is_whole(seen: Samples, d: int, rule: Rule) -> bool:
    """Say whether values are finite, and a point's way along each line is the tangent's integral.

    It is not where a step lies between two places.
    """
    if seen.points is None or seen.tangents is None or not np.isfinite(seen.values).all():
        return False
    way = vectors(rule.weights, seen.tangents[d])
    gone = 0.0 if rule.round else seen.points[-1] - seen.points[0]
    reach = 64 * EPSILON * float(np.abs(seen.points).max())
    longest = max(float(np.ptp(seen.points, axis=0).max()), reach, 1e-300)
    return bool(np.abs(way - gone).max() - reach <= _MISSED * longest)


# -- grids of nodes --------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Grid:
    """What is seen at the nodes of a product rule."""

    rules: list[Rule]
    samples: Samples

    @classmethod
    def of(cls, density: Density, directions: Sequence[_Direction], grow: float) -> _Grid | None:
        """Return what is seen, None where there are too many nodes or a value is not finite."""
        rules = [direction.rule(grow) for direction in directions]
        if np.prod([len(rule.nodes) for rule in rules], dtype=float) > SLAB_POINTS:
            return None
        grid = cls(rules, density(*open_grid(*(rule.nodes for rule in rules))))
        return grid if np.isfinite(grid.samples.values).all() else None

    def integrals(self) -> Array:
        """Return the integrals (k,) over the box."""
        u, v, w = (rule.weights for rule in self.rules)
        values = np.moveaxis(self.samples.values, -1, 0)
        return product(product(product(values, w), v), u)

    def normals(self, patch: Cell) -> tuple[Array, Array]:
        """Return M_s × M_t (n, m, 3) on a face, and the weights of its nodes (n, m)."""
        s, t = directions_of(patch)
        keep = tuple(slice(None) if p % 2 else -(p // 2) for p in patch)
        assert self.samples.tangents is not None
        first, second = (self.samples.tangents[d][keep] for d in (s, t))
        return cross(first, second), np.outer(self.rules[s].weights, self.rules[t].weights)


@dataclass(frozen=True, eq=False)
class _Scatter:
    """What is seen at scattered places of the box, and of its sides."""

    points: Array
    #: det J, (n,)
    determinant: Array
    #: areas |M_s × M_t| at places of faces, (n,)
    areas: dict[Cell, Array]

    @classmethod
    def of(cls, analysis: Analysis) -> _Scatter:
        """Look at the map: inside along with the sides across the last direction with faces."""
        faces: list[list[Cell]] = [[], [], []]
        for face in analysis.boundary.faces:
            faces[normal_direction(face.patch)].append(face.patch)
        last = max((d for d in range(3) if faces[d]), default=2)
        areas: dict[Cell, Array] = {}
        for d in range(last + 1):
            places, ends = list(scatter().T), [[patch[d] / 2] for patch in faces[d]]
            if d == last:
                places[d] = np.vstack((places[d], *(np.full(SCATTER, end) for end in ends)))
            elif ends:
                places[d] = np.array(ends)
            else:
                continue
            points, *tangents = analysis.map.frame(*places)
            s, t = (tangents[axis][-len(ends) :] for axis in range(3) if axis != d)
            areas |= dict(zip(faces[d], lengths(cross(s, t)), strict=True))
        u, v, w = (tangent[0] for tangent in tangents)
        return cls(points[0], dots(u, cross(v, w)), areas)

    def is_shown(self, grid: _Grid, centre: Array, size: float) -> bool:
        """Say whether all that stands out in the box is shown by the functions through the nodes.

        These are taken through det J and through M, of whose products the integrands are made.
        """
        values = self.determinant * np.vstack((np.ones(SCATTER), (self.points - centre).T))
        if not np.isfinite(values).all():
            return False
        sizes = np.abs(values).max(axis=1)
        factors = (0.5 + scattered(len(sizes), 1)[:, 0]) / np.where(sizes > 0, sizes, np.inf)
        _, (rest,) = explained(vectors(factors, values)[None], (0, 1, 2))
        found = [] if rest is None else tops(rest, (0, 1, 2))
        if rest is None or not found:
            return rest is not None
        assert grid.samples.points is not None
        table = np.concatenate((grid.samples.values[..., :1], grid.samples.points), axis=-1)
        pairs = zip(grid.rules, scatter()[found].T, strict=True)
        first, *others = (rule.basis(places) for rule, places in pairs)
        table = along(first, table, 0)
        for basis in others:
            table = np.einsum("mi,mi...->m...", basis, table)
        there = np.column_stack((self.determinant[found], self.points[found]))
        off = np.abs(table - there).max(axis=0) / np.array([sizes[0], size, size, size])
        return bool(off.max() <= _LEFT * rest[found].min())

    def plain(self, d: int) -> list[Cell]:
        """Return the faces at ends of a direction on which nothing stands out."""
        faces = [patch for patch in self.areas if normal_direction(patch) == d]
        if not faces:
            return []
        rests = explained(np.array([self.areas[p] for p in faces]), directions_of(faces[0]))[1]
        pairs = zip(faces, rests, strict=True)
        return [p for p, rest in pairs if rest is not None and not rest.any()]


# -- areas -----------------------------------------------------------------------------------------


def _areas(
    seen: _Scatter, directions: Sequence[_Direction], coarse: _Grid, fine: _Grid
) -> dict[Cell, tuple[float, float]]:
    """Return areas of faces on which both rules agree and nothing stands out, and their errors.

    Along a direction in which M is a polynomial, lengths of normals are none, unless all normals
    point one way.
    """
    found: dict[Cell, tuple[float, float]] = {}
    for patch in chain.from_iterable(map(seen.plain, range(3))):
        flat = any(directions[axis].exact for axis in directions_of(patch))
        before, area = (_area(grid, patch, flat) for grid in (coarse, fine))
        error = abs(area - before) / max(abs(area), 1e-300)
        if area > 0 and error < DOUBTFUL:
            found[patch] = area, max(error, EXACT)
    return found


def _area(grid: _Grid, patch: Cell, flat: bool) -> float:
    """Return the area of a face, 0 where it has to be flat and is not."""
    normals, weights = grid.normals(patch)
    if flat:
        return float(flat_lengths(normals.reshape(1, -1, 3), weights.ravel())[0])
    return float((lengths(normals) * weights).sum())
