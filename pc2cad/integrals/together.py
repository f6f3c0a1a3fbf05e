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
from math import ceil, prod

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import areas, cross, lengths, product, vectors
from pc2cad.arrays.scatter import scattered
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.jacobian_watch import determinants
from pc2cad.domain.pieces import has_pieces
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import Expr
from pc2cad.geometry.splines.bernstein import degree_in
from pc2cad.integrals.densities import Look, with_moments
from pc2cad.integrals.features import SCATTER, explained, scatter, tops
from pc2cad.integrals.flat_faces import flat_lengths
from pc2cad.integrals.quadrature import EPSILON
from pc2cad.integrals.rules import DOUBTFUL, EXACT, LINES, SLAB_POINTS
from pc2cad.integrals.spectral import (
    HIGHEST,
    LEAST,
    Rule,
    even,
    lobatto,
    spread,
)
from pc2cad.topology.cells import IDENTITY, Cell, directions_of, normal_direction

#: terms of a series that are taken for resolved, and what a point's way along a line may miss of
#: the integral of its tangent (of the largest way)
_RESOLVED, _MISSED = 1e-14, 1e-12
#: the share of what stands out that the functions through the nodes may leave
_LEFT = 1e-4
#: a degree of M up to which it says the nodes of a direction
_MOST_DEGREE = 4


@dataclass(frozen=True, eq=False)
class Together:
    """Integrals (4,) of det J and moments with their relative error; areas of faces with theirs."""

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
    analysis: Analysis, limits: list[list[float]], look: Look, centre: Array
) -> Together | None:
    """Return integrals over the whole box, and areas; None where that is not enough.

    The integrands are det J and (M - centre) det J. Of faces on which it is not enough there is no
    area.
    """
    if any(len(row) > 2 for row in (*limits, *analysis.bounds)) or analysis.equation.layers:
        return None
    with np.errstate(all="ignore"):
        directions = _directions(analysis, look, centre)
        if directions is None:
            return None
        coarse, fine = (_Grid.of(look, directions, grow) for grow in (1.0, 1.5))
        if coarse is None or fine is None:
            return None
        before, values = coarse.integrals(centre), fine.integrals(centre)
        error = float(np.abs(values - before).max() / max(np.abs(values).max(), 1e-300))
        if not error < DOUBTFUL:
            return None
        seen = _Scatter.of(analysis)
        if not seen.is_shown(fine, centre, analysis.size):
            return None
        return Together(values, max(error, EXACT), _areas(seen, directions, coarse, fine))


# -- how many nodes --------------------------------------------------------------------------------


def _directions(analysis: Analysis, look: Look, centre: Array) -> list[_Direction] | None:
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
        direction = _along_lines(look, centre, d, others, _comes_round(analysis, d))
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
    look: Look, centre: Array, d: int, across: Sequence[int], comes_round: bool
) -> _Direction | None:
    """Return what resolves det J and moments on a few lines along a direction.

    None where too much would. Areas across some other directions count as well, unless they would
    need too much.
    """
    rule = spread(comes_round)
    # one line after the other in memory
    places = [x[:, None] for x in LINES.T]
    places.insert(d, rule.nodes)
    values, points, tangents = look(*places)
    if not _is_whole(points, tangents[d], rule):
        return None
    highest = HIGHEST // 2 if comes_round else HIGHEST
    u, v, w = map(lengths, tangents)
    last = _last_term(with_moments(values, points, centre), u * v * w, rule)
    if last is None or last > highest:
        return None
    for e in across:
        s, t = (tangent for axis, tangent in enumerate(tangents) if axis != e)
        terms = lengths(s) * lengths(t)
        more = _last_term(areas(s, t)[None], terms, rule)
        last = last if more is None or more > highest else max(last, more)
    return _Direction(max(LEAST, last + 2 if comes_round else last // 2 + 3), comes_round)


def _last_term(rows: Array, terms: Array, rule: Rule) -> int | None:
    """Return the last term of series over lines, of integrands (k, L, n), that is not rounding.

    `terms` (L, n) are the sizes of what the first integrand is a sum of. None where a value is not
    finite.
    """
    sizes = vectors(np.abs(rows), rule.weights)
    first, largest = float(sizes[0].max()), float(sizes.max())
    if not largest < np.inf:
        return None
    noise = 64 * EPSILON * float(vectors(terms, rule.weights).max()) / max(first, 1e-300)
    return rule.last_term(rows, max(_RESOLVED, noise) * largest)


def _is_whole(points: Array, tangent: Array, rule: Rule) -> bool:
    """Say whether the way of points (L, n, 3) along each line is the integral of their tangent.

    It is not where a step lies between two places.
    """
    x, along = points.transpose(2, 0, 1), tangent.transpose(2, 0, 1)
    least, most = x.min(axis=2), x.max(axis=2)
    reach = 64 * EPSILON * float(max(most.max(), -least.min()))
    longest = max(float((most - least).max()), reach, 1e-300)
    gap = vectors(along, rule.weights)
    if not rule.round:
        gap -= x[..., -1] - x[..., 0]
    return bool(np.abs(gap).max() - reach <= _MISSED * longest)


# -- grids of nodes --------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Grid:
    """What is seen at the nodes of a product rule."""

    rules: list[Rule]
    #: the directions along the axes of arrays: most nodes lie one after the other in memory
    axes: tuple[int, ...]
    determinant: Array
    points: Array
    tangents: list[Array]

    @classmethod
    def of(cls, look: Look, directions: Sequence[_Direction], grow: float) -> _Grid | None:
        """Return what is seen, None where there are too many nodes."""
        rules = [direction.rule(grow) for direction in directions]
        counts = [len(rule.nodes) for rule in rules]
        if prod(counts) > SLAB_POINTS:
            return None
        axes = tuple(sorted(range(3), key=counts.__getitem__))
        places = [
            rule.nodes.reshape([-1 if axis == d else 1 for axis in axes])
            for d, rule in enumerate(rules)
        ]
        return cls(rules, axes, *look(*places))

    def integrals(self, centre: Array) -> Array:
        """Return the integrals (4,) of det J and (M - centre) det J, finite where values are."""
        u, v, w = (rule.weights for rule in self.rules)
        back = [self.axes.index(d) for d in range(3)]
        in_order = np.ascontiguousarray(self.determinant.transpose(back))
        volume = vectors(vectors(vectors(in_order, w), v), u)
        first, second, last = (self.rules[d].weights for d in self.axes)
        weights = first[:, None, None] * (second[:, None] * last) * self.determinant
        from_centre = np.empty((3, *weights.shape))
        for axis in range(3):
            np.subtract(self.points[..., axis], centre[axis], out=from_centre[axis])
        # sums of sums: one of all would lose digits
        moments = np.einsum("kabc,abc->kab", from_centre, weights).reshape(3, -1).sum(axis=1)
        return np.array([float(volume), *moments.tolist()])

    def through(self, values: Sequence[Array], places: Array) -> Array:
        """Return what functions through values at the nodes are at places (m, 3), (m, k)."""
        first, second, last = (self.rules[d].basis(places[:, d]) for d in self.axes)
        n, m = first.shape[1], second.shape[1]
        rows = [product(x.reshape(n * m, -1), last.T).reshape(n, m, -1) for x in values]
        return np.asarray(np.einsum("pi,pj,kijp->pk", first, second, np.array(rows)))

    def areas(self, patches: Sequence[Cell], flat: bool) -> list[float]:
        """Return the areas of faces at one or both ends of a direction, the first end first.

        Those to be flat that are not have 0.
        """
        d, (i, j) = normal_direction(patches[0]), directions_of(patches[0])
        ends, count = [patch[d] // 2 for patch in patches], len(self.rules[d].nodes)
        part = slice(ends[0] * (count - 1), None if ends[-1] else 1, count - 1)
        keep = tuple([part if axis == d else slice(None) for axis in self.axes])
        order = [*map(self.axes.index, (d, i, j)), 3]
        s, t = (self.tangents[e][keep].transpose(order) for e in (i, j))
        weights = self.rules[i].weights[:, None] * self.rules[j].weights
        if flat:
            normals = cross(s, t).reshape(len(ends), -1, 3)
            return list(map(float, flat_lengths(normals, weights.ravel())))
        return [float(area.sum()) for area in np.multiply(areas(s, t), weights, order="C")]


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
        found: dict[Cell, Array] = {}
        for d in range(last + 1):
            places, ends = list(scatter().T), [[patch[d] / 2] for patch in faces[d]]
            along = tuple([axis for axis in range(3) if axis != d])
            if d == last:
                places[d] = np.vstack((places[d], *(np.full(SCATTER, end) for end in ends)))
                points, *tangents = analysis.map.frame(*places)
                s, t = (tangents[axis][-len(ends) :] for axis in along)
            elif ends:
                places[d] = np.array(ends)
                s, t = analysis.map.tangents(along, *places)
            else:
                continue
            found |= dict(zip(faces[d], areas(s, t), strict=True))
        inside = determinants(*(tangent[0] for tangent in tangents))
        return cls(points[0], inside, found)

    def is_shown(self, grid: _Grid, centre: Array, size: float) -> bool:
        """Say whether all that stands out in the box is shown by the functions through the nodes.

        These are taken through det J and through M, of whose products the integrands are made.
        """
        values = with_moments(self.determinant, self.points, centre)
        sizes = np.abs(values).max(axis=1)
        if not sizes.max() < np.inf:
            return False
        factors = (0.5 + scattered(len(sizes), 1)[:, 0]) / np.where(sizes > 0, sizes, np.inf)
        _, (rest,) = explained(vectors(factors, values)[None], (0, 1, 2))
        found = [] if rest is None else tops(rest, (0, 1, 2))
        if rest is None or not found:
            return rest is not None
        x, y, z = (grid.points[..., axis] for axis in range(3))
        table = grid.through((grid.determinant, x, y, z), scatter()[found])
        there = np.column_stack((self.determinant[found], self.points[found]))
        off = np.abs(table - there).max(axis=0) / np.array([sizes[0], size, size, size])
        return bool(off.max() <= _LEFT * rest[found].min())

    def plain(self, d: int) -> list[Cell]:
        """Return the faces at ends of a direction on which nothing stands out, first end first."""
        faces = sorted([patch for patch in self.areas if normal_direction(patch) == d])
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
    for patches in filter(None, map(seen.plain, range(3))):
        flat = any([directions[axis].exact for axis in directions_of(patches[0])])
        rows = (grid.areas(patches, flat) for grid in (coarse, fine))
        for patch, before, area in zip(patches, *rows, strict=True):
            error = abs(area - before) / max(abs(area), 1e-300)
            if area > 0 and error < DOUBTFUL:
                found[patch] = area, max(error, EXACT)
    return found
