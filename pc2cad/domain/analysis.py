"""The analyse stage: a point equation in, its boundary complex out.

Input: PointEquation. Output: Analysis (the map in local coordinates, the breaks of its directions
and the boundary complex). Answers about the map are taken from samples first, because a sample
refutes at once; what the samples leave standing is then proved from the trees where that is
possible, and stays "sampled" where it is not.

It has two steps, `sample_sides` and then `derive`: a map without finite values is refused before
anything is asked of it, one without an orientation (`solidity.orientation`) before its boundary.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache, partial
from itertools import product

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.boxes import Near
from pc2cad.domain.cusps import with_cusps, with_joints
from pc2cad.domain.map import Mapping3, local_map, open_grid
from pc2cad.domain.pieces import piece_at
from pc2cad.domain.splits import folds, shifts
from pc2cad.equation.point_equation import LayersError, PointEquation
from pc2cad.errors import NotASolidError
from pc2cad.expression.breaks import SAME_POSITION, Break, find_breaks
from pc2cad.expression.identity import Verdict
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.plain_constants import are_identical
from pc2cad.expression.polynomials import polynomials
from pc2cad.expression.tree import Expr, number, substitute, symbol
from pc2cad.geometry.scale import Scale
from pc2cad.topology.cells import (
    IDENTITY,
    Cell,
    Labels,
    SideKey,
    Symmetry,
    boundary_patches,
    cell_name,
    directions_of,
)
from pc2cad.topology.complex import BoundaryComplex
from pc2cad.topology.quotient import derive_boundary, derive_layers


class MapNotFiniteError(NotASolidError):
    """The point equation has no finite value somewhere in its box."""


class TooCloseToDecideError(NotASolidError):
    """Two places are neither clearly one nor clearly two."""


@dataclass(frozen=True, eq=False)
class SampledSides:
    """M over the unit box, where it breaks, and samples of its six sides, all of them finite."""

    equation: PointEquation
    map: Mapping3
    #: all breaks of u, v and w in local coordinates, creases and smoother ones alike
    breaks: tuple[tuple[Break, ...], ...]
    #: ascending limits of the pieces of each direction: 0, creases, 1
    bounds: tuple[tuple[float, ...], ...]
    questions: MapQuestions


@dataclass(frozen=True)
class Analysis:
    """What the later stages know of the map: its trees, its pieces and its boundary."""

    equation: PointEquation
    map: Mapping3
    #: all breaks of u, v and w in local coordinates, creases and smoother ones alike
    breaks: tuple[tuple[Break, ...], ...]
    #: ascending limits of the pieces of each direction: 0, creases, 1
    bounds: tuple[tuple[float, ...], ...]
    boundary: BoundaryComplex
    #: the same with the faces between layers; the boundary itself where there are none
    complex: BoundaryComplex
    #: of the samples of the boundary
    scale: Scale
    #: limits between pieces across which plane faces are not joined to one, per direction
    apart: tuple[tuple[float, ...], ...] = ((), (), ())

    @property
    def size(self) -> float:
        """Diagonal of the box round the boundary's samples, model units."""
        return self.scale.size

    def span(self, direction: int, position: int) -> tuple[float, float]:
        """Return the local interval of a cell position (of no length for a limit)."""
        return _span(self.bounds, direction, position)


def _span(bounds: Sequence[Sequence[float]], direction: int, position: int) -> tuple[float, float]:
    return bounds[direction][position // 2], bounds[direction][(position + 1) // 2]


def analyse(equation: PointEquation) -> Analysis:
    """Derive the boundary of a point equation's image; raise NotASolidError where it has none.

    Nothing is said of det J here; see `checked.check_map` for all that a solid needs.
    """
    return derive(sample_sides(equation))


def sample_sides(equation: PointEquation) -> SampledSides:
    """Return the map over the unit box, looked at on its sides; raise MapNotFiniteError."""
    mapping = local_map(equation)
    breaks = with_cusps(with_joints(find_breaks(mapping.coordinates), mapping), mapping)
    bounds = tuple(
        (0.0, *(b.position for b in row if b.smoothness == 0 and 0 < b.position < 1), 1.0)
        for row in breaks
    )
    questions = MapQuestions(mapping, bounds, _labels(equation, bounds))
    return SampledSides(equation, mapping, breaks, bounds, questions)


def derive(sides: SampledSides, known: BoundaryComplex | None = None) -> Analysis:
    """Return the boundary of sampled sides; raise NotASolidError where they do not close.

    It may be `known` (`family_sides`). Where sides coincide after a shift or fold, they are cut.
    """
    try:
        boundary = known or derive_boundary(sides.questions, sides.questions.labels)
        faces = [face.patch for face in boundary.faces]
        cut = _cut(sides, shifts(sides.map, faces, sides.questions.scale, boundary))
    except NotASolidError:
        cut = _cut(sides, _all_cuts(sides))
        if cut is sides:
            raise
    if cut is not sides:
        sides = cut
        boundary = derive_boundary(sides.questions, sides.questions.labels)
    layers = _layered(sides.equation, boundary, sides.questions)
    return Analysis(
        sides.equation, sides.map, sides.breaks, sides.bounds, boundary, layers,
        sides.questions.scale,
    )  # fmt: skip


def recut(analysis: Analysis, places: tuple[set[Fraction], ...]) -> Analysis:
    """Return the same solid with directions cut at some more places, or as it is."""
    equation, bounds = analysis.equation, analysis.bounds
    questions = MapQuestions(analysis.map, bounds, _labels(equation, bounds))
    whole = SampledSides(equation, analysis.map, analysis.breaks, bounds, questions)
    sides = _cut(whole, places)
    if sides is whole:
        return analysis
    boundary = derive_boundary(sides.questions, sides.questions.labels)
    layers = _layered(equation, boundary, sides.questions)
    return replace(analysis, bounds=sides.bounds, boundary=boundary, complex=layers)


def _all_cuts(sides: SampledSides) -> tuple[set[Fraction], ...]:
    """Return where directions may have to be cut, if the boundary does not close without."""
    (u, v, w), span = (len(row) - 1 for row in sides.bounds), partial(_span, sides.bounds)
    patches, scale = boundary_patches((u, v, w)), sides.questions.scale
    found = shifts(sides.map, patches, scale), folds(sides.map, patches, span, scale)
    return tuple(a | b for a, b in zip(*found, strict=True))


def _cut(sides: SampledSides, places: tuple[set[Fraction], ...]) -> SampledSides:
    """Return the sides with directions cut at some more places, or as they are."""
    bounds = []
    for row, more in zip(sides.bounds, places, strict=True):
        new = {float(x) for x in more if min(abs(float(x) - y) for y in row) > SAME_POSITION}
        bounds.append(tuple(sorted({*row, *new})))
    if tuple(bounds) == sides.bounds:
        return sides
    labels = _labels(sides.equation, tuple(bounds))
    questions = MapQuestions(sides.map, tuple(bounds), labels)
    return replace(sides, bounds=tuple(bounds), questions=questions)


def _layered(
    equation: PointEquation, boundary: BoundaryComplex, questions: MapQuestions
) -> BoundaryComplex:
    """Return the boundary with the faces between the layers; raise LayersError."""
    count, found = len(equation.layers), len(boundary.labels[2]) - 1
    if not count:
        return boundary
    if found != count:
        raise LayersError(
            f"there are {count} layers ({', '.join(equation.layers)}), and M has {found - 1} "
            "creases in w between them; layers lie at depth(w)"
        )
    along_u, along_v = (range(1, 2 * len(names) - 2, 2) for names in boundary.labels[:2])
    for i, j, k in product(along_u, along_v, range(count)):
        below, above = (i, j, 2 * k), (i, j, 2 * k + 2)
        if questions.coincide(below, above, IDENTITY):
            where = SideKey.of(below, boundary.labels, shown=(0, 1)).label
            raise LayersError(
                f"the layer {equation.layers[k]}{where} has no thickness: M is the same on both "
                "its sides; leave it out, or give it a thickness above 0"
            )
    return derive_layers(boundary, questions)


def _labels(equation: PointEquation, bounds: tuple[tuple[float, ...], ...]) -> Labels:
    labels = []
    for (low, high), (a, b), row in zip(equation.domain, equation.limits, bounds, strict=True):
        inner = (f"{a + (b - a) * position:.6g}" for position in row[1:-1])
        labels.append((_label(low, a), *inner, _label(high, b)))
    return tuple(labels)


@lru_cache(maxsize=64)
def _label(limit: Expr, value: float) -> str:
    text = repr(limit)
    return text if len(text) <= 8 else f"{value:.6g}"


#: symmetric under reversal, with the ends, and at no simple fraction of the period of anything
NODES = np.concatenate(([0.0], (np.polynomial.legendre.leggauss(11)[0] + 1) / 2, [1.0]))
NODES = (NODES + 1 - NODES[::-1]) / 2

#: pieces of a direction whose samples are taken together
_TOGETHER = 16


class MapQuestions:
    """Answers the topology room's questions from samples of the sides and from the trees."""

    def __init__(
        self, mapping: Mapping3, bounds: tuple[tuple[float, ...], ...], labels: Labels
    ) -> None:
        self.labels = labels
        self._map = mapping
        self._bounds = bounds
        self._samples: dict[Cell, Array] = {}
        sides = self._side_samples()
        extent = sides.max(axis=0) - sides.min(axis=0)
        self.scale = Scale(float(np.linalg.norm(extent)), float(np.abs(sides).max()))
        self._one = self.scale.same_point

    def _side_samples(self) -> Array:
        """Return samples of all six sides, (n, 3), after a check that every one is finite."""
        cells = list[Cell]()
        single = self._map.is_alike_together and all([len(row) == 2 for row in self._bounds])
        if single:  # one call takes less than three, though the inside is met as well
            points, keep = self._map.points(*open_grid(NODES, NODES, NODES)), (0, slice(None), -1)
            for i, j, k in product(range(3), repeat=3):
                self._samples[i, j, k] = points[keep[i], keep[j], keep[k]]
        for d in range(3):
            ranges: list[Sequence[int]] = [range(1, 2 * len(b) - 1, 2) for b in self._bounds]
            limits = ranges[d] = 0, 2 * (len(self._bounds[d]) - 1)
            if not single:
                self._look(ranges)
            for limit in limits:
                ranges[d] = (limit,)
                cells += product(ranges[0], ranges[1], ranges[2])
        samples = np.concatenate([self._at(cell).reshape(-1, 3) for cell in cells])
        if not np.isfinite(samples).all():
            for cell in cells:
                self._check_finite(cell, self._at(cell))
        return samples

    def _look(self, ranges: Sequence[Sequence[int]]) -> None:
        """Evaluate the patches of two sides, some of them together."""
        step = _TOGETHER if self._map.is_alike_together else 1
        parts = [[row[k : k + step] for k in range(0, len(row), step)] for row in ranges]
        for block in product(*parts):
            places = [[self._positions(d, p) for p in row] for d, row in enumerate(block)]
            points = self._map.points(*open_grid(*(np.concatenate(row) for row in places)))
            within = [
                [slice(k * len(own), (k + 1) * len(own)) if p % 2 else k for k, p in enumerate(row)]
                for row, (own, *_) in zip(block, places, strict=True)
            ]
            for (i, j, k), keep in zip(product(*block), product(*within), strict=True):
                self._samples[i, j, k] = points[keep]

    def _at(self, cell: Cell) -> Array:
        """Return samples of a cell: one axis of nodes per direction in which it extends."""
        if cell not in self._samples:
            points = self._limit_of_known(cell)
            if points is None:
                grid = open_grid(*(self._positions(d, cell[d]) for d in range(3)))
                keep = tuple(slice(None) if cell[d] % 2 else 0 for d in range(3))
                points = self._map.points(*grid)[keep]
            self._samples[cell] = points
        return self._samples[cell]

    def _limit_of_known(self, cell: Cell) -> Array | None:
        """Return samples of an edge from those of a known patch, of a corner from an edge's."""
        fixed = [d for d in range(3) if cell[d] % 2 == 0]
        for d in fixed if len(fixed) > 1 else ():
            for step, end in ((1, 0), (-1, -1)):
                i, j, k = (p + step if axis == d else p for axis, p in enumerate(cell))
                wider = i, j, k
                inside = 0 < wider[d] < 2 * len(self._bounds[d]) - 2
                if inside and (len(fixed) == 3 or wider in self._samples):
                    return self._at(wider)[(slice(None),) * directions_of(wider).index(d) + (end,)]
        return None

    def _positions(self, direction: int, position: int) -> Array:
        bounds = self._bounds[direction]
        low, high = bounds[position // 2], bounds[(position + 1) // 2]
        return low + (high - low) * NODES if position % 2 else np.array([low])

    def _check_finite(self, cell: Cell, points: Array) -> None:
        bad = np.argwhere(~np.isfinite(points).all(axis=-1))
        if len(bad) == 0:
            return
        places = zip(directions_of(cell), bad[0], strict=True)
        where = [(PARAMETERS[d], float(self._positions(d, cell[d])[k])) for d, k in places]
        shown = ", ".join(f"{name} = {value:.3g}" for name, value in where)
        raise MapNotFiniteError(
            f"M has no finite value on the side {cell_name(cell, self.labels)}, first at local "
            f"{shown}: a division by zero, a root or logarithm of a negative number, or a normal "
            "that is undefined there; another reference point or a shorter domain may help"
        )

    def _equal(self, first: Array, second: Array, what: str, *cells: Cell) -> bool:
        # one sample refutes most; what is asked about is only named where it is undecided
        last = (-1,) * (first.ndim - 1)
        if max(map(abs, (first[last] - second[last]).tolist())) >= 1000 * self._one:
            return False
        away = (first - second) ** 2
        gap = float(np.sqrt((away[..., 0] + away[..., 1] + away[..., 2]).max()))
        if gap <= self._one:
            return True
        if gap < 1000 * self._one:
            named = what.format(*(cell_name(cell, self.labels) for cell in cells))
            raise TooCloseToDecideError(
                f"{named} are {gap:.3g} apart on a part of size {self.scale.size:.3g}: too far for "
                "one place and too near for two in double precision; separate or join them"
            )
        return False

    def ignores(self, patch: Cell, direction: int) -> Verdict:
        """See Questions.ignores."""
        points = self._at(patch)
        axis = directions_of(patch).index(direction)
        what = f"the two ends of {PARAMETERS[direction]} on {{}}"
        if not self._equal(points, points[:, :1] if axis else points[:1], what, patch):
            return Verdict.REFUTED
        name, known = PARAMETERS[direction], polynomials(self._map.coordinates)
        if known is not None and all(len(row) == 2 for row in self._bounds):
            return Verdict.UNDECIDED if any(p[axis] for p in known.on(patch)) else Verdict.PROVED
        trees = self._restrict(patch)
        if all(name not in tree.symbols for tree in trees):
            return Verdict.PROVED
        return _prove(trees, substitute(trees, {name: number(0)}))

    def coincide(self, first: Cell, second: Cell, symmetry: Symmetry) -> Verdict:
        """See Questions.coincide."""
        image = symmetry.read(self._at(second))
        if not self._equal(self._at(first), image, "the sides {} and {}", first, second):
            return Verdict.REFUTED
        # in the first one's own parameters, most of its trees are as they are
        own = [symbol(PARAMETERS[d]) for d in directions_of(first)]
        s, t = reversed(own) if symmetry.swap else own
        there = 1 - s if symmetry.reverse_s else s, 1 - t if symmetry.reverse_t else t
        return _prove(self._restrict(first), self._restrict(second, there))

    def is_point(self, edge: Cell) -> bool:
        """See Questions.is_point."""
        return self._equal(self._at(edge), self._at(edge)[:1], "the points of the edge {}", edge)

    def same_edge(self, first: Cell, second: Cell, reverse: bool) -> bool:
        """See Questions.same_edge."""
        there = self._at(second)[:: -1 if reverse else 1]
        return self._equal(self._at(first), there, "the edges {} and {}", first, second)

    def places(self, corners: Sequence[Cell]) -> list[list[Cell]]:
        """See Questions.places."""
        points = np.array([self._at(corner) for corner in corners]).reshape(-1, 3)
        near, first, groups = Near(1000 * self._one), list[Array](), list[list[Cell]]()
        for corner, point in zip(corners, points, strict=True):
            for k in near.of(point.tolist()):
                of = groups[k][0]
                if self._equal(first[k][None], point[None], "the corners {} and {}", of, corner):
                    groups[k].append(corner)
                    break
            else:
                near.add(point.tolist())
                first.append(point)
                groups.append([corner])
        return groups

    def _restrict(self, patch: Cell, local: tuple[Expr, ...] | None = None) -> tuple[Expr, ...]:
        """Return the trees on a patch in its own [0,1]² (`local`: what to put for s and t)."""
        spans, values = piece_at(patch, self._bounds)
        names = [PARAMETERS[d] for d in directions_of(patch)]
        values |= zip(names, local or map(symbol, names), strict=True)
        return substitute(self._map.pieces.trees(spans)[0], values)


def _prove(first: tuple[Expr, ...], second: tuple[Expr, ...]) -> Verdict:
    return Verdict.PROVED if are_identical(first, second) else Verdict.UNDECIDED
