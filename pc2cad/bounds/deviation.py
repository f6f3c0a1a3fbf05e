"""A proved upper bound of the distance between a function and a spline at equal parameters.

On every cell (a knot interval or a part of one) the difference is interpolated at Chebyshev-Lobatto
nodes; the spline's own polynomial is reproduced by that. The bound is the largest Bernstein
coefficient of the interpolant, plus what the function can be off its interpolant (`remainder`),
plus rounding of the sampled values times the Lebesgue constant. Cells whose coefficients are much
larger than the largest sampled distance are halved, which makes the coefficients sharp.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product
from pc2cad.bounds.cells import Cells, Direction, halving
from pc2cad.bounds.differences import difference, difference_at
from pc2cad.bounds.homogeneous_spline import HomogeneousSpline, homogeneous
from pc2cad.bounds.known import Known
from pc2cad.bounds.remainder import Remainders
from pc2cad.bounds.separable import Products, Whole, function_of
from pc2cad.expression.breaks import SAME_POSITION, find_breaks
from pc2cad.expression.end_roots import take_out_ends
from pc2cad.expression.linear_terms import cancel_terms
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.sigmoids import as_tanh
from pc2cad.expression.tree import Expr
from pc2cad.geometry.carriers import SplineCurve, SplineSurface
from pc2cad.geometry.splines.bernstein import degree_in
from pc2cad.geometry.splines.spline_space import SplineSpace

#: a bound within this factor of the largest sample is sharp enough
SHARP = 1.25
#: share of the largest sample that the remainder may have before cells are made smaller
REMAINDER_SHARE = 0.2
#: degrees more than the spline's to begin with; `remainder` raises them where they are too few
EXTRA = 2
#: polynomials of a higher degree are interpolated: their own coefficients are ill-conditioned
HIGHEST_EXACT = 13
#: halvings of cells for the coefficients' sake
SHARPEST = 6
#: coefficients of cells that are held until it is known which of them are large
MOST_BLUNT = 1 << 18
#: cells of another face serve again where they are at most so many times the knot intervals
MOST_REUSED = 4


@dataclass(frozen=True)
class Bound:
    """What is known of the distance between a function and its carrier (lengths)."""

    #: no place is further away than this; inf where no bound could be had
    largest: float
    #: the largest distance seen, at `samples` places
    sampled: float
    samples: int
    #: where no bound could be had: the range of each parameter, else empty
    open: tuple[tuple[float, float], ...] = ()
    #: where the largest distance was seen
    place: tuple[float, ...] = ()
    #: of a surface without open places: returns the bounds on the two sides along an axis (0 or 1);
    #: they are worked out when they are asked for
    pairs: Callable[[int], tuple[Bound, Bound]] | None = field(
        default=None, compare=False, repr=False
    )

    def side(self, index: int) -> Bound:
        """Return the bound on a side of a surface: where s = 0, s = 1, t = 0, t = 1 (0 to 3)."""
        assert self.pairs is not None
        return self.pairs(1 - index // 2)[index % 2]


def bound_surface(
    trees: Sequence[Expr],
    names: Sequence[str],
    carrier: SplineSurface,
    rounding: float = 0.0,
    known: Known | None = None,
    spaces: Sequence[SplineSpace] = (),
    seen: float = 0.0,
) -> Bound:
    """Bound |M - S| over [0, 1]² at equal parameters; M's trees are in the two named symbols.

    Of a rational S = N/ω, where ω is 1 at most, the trees are those of ωM, and what is bounded is
    |ωM - N|/ω. Bounds need not be sharper than `rounding` (a length). What was `known` is used, and
    added to. `spaces` are those in which S was fitted to M, if it was, and `seen` is the largest
    distance that is known already, if any is.
    """
    spline = HomogeneousSpline(carrier.degrees, carrier.knots, homogeneous(carrier))
    # what overflows is infinite or nan: nothing is known there
    with np.errstate(all="ignore"):
        return _bound(tuple(trees), tuple(names), spline, known or Known(), rounding, spaces, seen)


def bound_curve(
    trees: Sequence[Expr], name: str, carrier: SplineCurve, known: Known | None = None
) -> Bound:
    """Bound |M - C| over [0, 1] at equal parameters; of a rational C as `bound_surface` does."""
    spline = HomogeneousSpline((carrier.degree,), (carrier.knots,), homogeneous(carrier)[:, None])
    with np.errstate(all="ignore"):
        return _bound(tuple(trees), (name,), spline, known or Known())


def _bound(
    trees: tuple[Expr, ...],
    names: tuple[str, ...],
    spline: HomogeneousSpline,
    known: Known,
    floor: float = 0.0,
    spaces: Sequence[SplineSpace] = (),
    seen: float = 0.0,
) -> Bound:
    trees = _plain(trees)
    coarse = [
        direction_along(trees, *along)
        for along in zip(names, spline.knots, spline.degrees, strict=True)
    ]
    directions = [_reused(d, known.finer.get(d.key)) for d in coarse]
    function = function_of(trees, names, known)
    expected = seen or _first_look(function, spline, directions)
    least = spline.least_weight
    allowed = max(REMAINDER_SHARE * expected * least, floor)
    if not 4 * spline.most_rounding <= allowed:
        allowed = max(allowed, 4 * spline.rounding)
    size = float(np.ptp(spline.poles[..., :3].reshape(-1, 3), axis=0).max())
    reach = [
        _reach(d, expected / size if size else 1.0, p)
        for d, p in zip(directions, spline.degrees, strict=True)
    ]
    found = function.remainders(directions, reach, size or 1.0, allowed)
    if found is None:
        function = Whole(trees, names, known)
        found = function.remainders(directions, reach, size or 1.0, allowed)
    directions, rest = found
    known.finer |= {d.key: x.cells for d, x in zip(coarse, directions, strict=True)}
    expected = max(expected, floor / SHARP)
    return _Survey(function, spline, directions, rest, expected, spaces).bound()


def expect_surface(trees: tuple[Expr, ...], names: Sequence[str], known: Known) -> None:
    """Let what will be asked of a surface's trees be worked out with what others ask for.

    It is to be bounded later, over the same cells as these.
    """
    function = function_of(_plain(trees), tuple(names), known)
    if isinstance(function, Products):
        function.expect()


def _plain(trees: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return the trees in the form in which they are bounded."""
    return as_tanh(take_out_ends(cancel_terms(trees)))


def _reused(direction: Direction, finer: Cells | None) -> Direction:
    """Return the direction with the cells that another face asked for, where they are not many."""
    if finer is None or finer.count > MOST_REUSED * direction.cells.count:
        return direction
    return direction.on(finer)


def direction_along(trees: tuple[Expr, ...], name: str, knots: Array, degree: int) -> Direction:
    """Return the cells on which trees are compared with a spline of some knots and degree."""
    known = degree_in(trees, name)
    if known is not None and known > max(degree, HIGHEST_EXACT):
        known = None
    nodes = degree + EXTRA if known is None else max(degree, known)
    points = distinct(knots)
    breaks = []
    for position in (b.position for b in find_breaks(trees, analytic=True)[PARAMETERS.index(name)]):
        nearest = points[np.argmin(np.abs(points - position))]
        breaks.append(float(nearest) if abs(nearest - position) < SAME_POSITION else position)
    points = distinct(np.concatenate((points, breaks)))
    cells = Cells(points, nodes)
    return Direction(name, cells, known is not None, cells, tuple(breaks))


def _first_look(
    function: Whole | Products, spline: HomogeneousSpline, directions: Sequence[Direction]
) -> float:
    """Return the largest of a few deviations in each cell: about what will be found."""
    places = []
    for d in directions:
        a, b = d.cells.points[:-1, None], d.cells.points[1:, None]
        places.append((a + (b - a) * np.array([0.27, 0.52])).ravel())
    gap = difference_at(function, spline, places[0], (*places, np.zeros(1))[1])(slice(None))
    return float(np.sqrt(_squares(gap).max()))


def _squares(vectors: Array, axis: int = -2) -> Array:
    """Return the squared lengths of vectors whose coordinates are along one axis.

    A fourth coordinate divides the others.
    """
    axis %= vectors.ndim
    row = vectors[(*(slice(None),) * axis, slice(3))]
    # without arrays for each coordinate: to make those takes longer than the work on them
    axes = "abcde"[: vectors.ndim]
    squares = np.einsum(f"{axes},{axes}->{axes.replace(axes[axis], '')}", row, row)
    if vectors.shape[axis] > 3:
        squares = squares / np.take(vectors, 3, axis) ** 2
    return np.asarray(squares)


def _reach(direction: Direction, deviation: float, degree: int) -> float:
    """Return over how many cells the function can be expected to be analytic.

    A spline of degree p that deviates by e, relative to a function's size, has intervals of about
    e^(1/(p+1)) of the length over which the function changes.
    """
    if direction.exact or not 0 < deviation < 1:
        return 1.0
    return float((1 / deviation) ** (1 / (degree + 1)))


class _Survey:
    """Samples of the difference on all cells, and the coefficients of its interpolants."""

    def __init__(
        self,
        function: Whole | Products,
        spline: HomogeneousSpline,
        directions: Sequence[Direction],
        rest: Remainders,
        expected: float,
        spaces: Sequence[SplineSpace],
    ) -> None:
        """Look at all cells; coefficients need not be sharper than about `expected` allows."""
        self._directions = directions
        point = Cells(np.array([0.0, 1.0]), 0)
        self._s = directions[0].cells
        self._t = directions[1].cells if len(directions) > 1 else point
        found = difference(function, spline, (self._s, self._t), spaces, expected)
        self._along = [part / spline.least_weight for part in rest.along]
        lebesgue = self._s.lebesgue * self._t.lebesgue / spline.least_weight
        self._interpolation = rest.interpolation / spline.least_weight
        self._data = (rest.rounding * found.worse + found.rounding) * lebesgue
        self._by_values = rest.by_values * found.worse / spline.least_weight
        self._by_values += found.rounding * lebesgue
        known = self._data[np.isfinite(self._data)]
        self._goal = max(SHARP * expected, float(known.max(initial=0.0)))
        self._sizes = np.zeros((self._s.count, self._t.count))
        self.sampled, self.samples = 0.0, 0
        self._at = 0.0, 0.0
        #: of the sides along t, in parts: coefficients (cells, nodes, 3, two sides) and differences
        #: (places, 3, two sides); and of each one along s: (cells, nodes, 3), (places, 3)
        self._along_t: list[tuple[Array, Array]] = []
        self._along_s: list[tuple[Array, Array]] = []
        #: cells with large coefficients, by number along s and t, and these: (cells, 3, i, j)
        self._blunt: list[tuple[Integers, Integers, Array]] = []
        along, across = self._s.nodes(0, self._s.count), self._t.nodes(0, self._t.count)
        nodes = max(self._t.degree, 1)
        for first in range(0, self._t.count, found.rows):
            last = min(first + found.rows, self._t.count)
            rows = slice(first * nodes, last * nodes + 1)
            gap = found.values(rows)
            squares = _squares(gap)
            row, column = np.unravel_index(int(squares.argmax()), squares.shape)
            # written so that what is not a number is not overlooked
            if not squares[row, column] <= self.sampled**2:
                self.sampled = float(np.sqrt(squares[row, column]))
                self._at = float(along[column]), float(across[rows][row])
            self._take(first, last, gap, found.coefficients(first, last, gap))
        self._sharpen()
        self._loss = found.loss(self.sampled)
        # what is much wider than the samples would refuse what they show to be good
        wide = self._by_values > REMAINDER_SHARE * max(self.sampled, self._goal / SHARP)
        self._by_values[wide] = np.inf

    def _take(self, first: int, last: int, gap: Array, coefficients: Array) -> None:
        """Take the differences in some rows of cells, and their coefficients, into account."""
        self.samples += gap[:, 0].size
        if len(self._directions) == 2:
            # copies: views would keep the coefficients of all cells
            ends = [0, -1]
            self._along_t.append((coefficients[..., ends, ends], gap[..., ends]))
            for end, is_there in ((0, first == 0), (-1, last == self._t.count)):
                if is_there:
                    part = coefficients[end, end].transpose(1, 2, 0).copy(), gap[end].T.copy()
                    self._along_s.append(part)
        t, nodes_t, k, *flat = coefficients.shape
        squares = _squares(coefficients.reshape(t, nodes_t, k, -1)).max(axis=1)
        sizes = np.sqrt(squares.reshape(t, *flat).max(axis=2))
        self._sizes[:, first:last] = sizes.T
        i, j = np.nonzero(sizes > max(self._goal, SHARP * self.sampled))
        if len(i):
            self._blunt.append((j, i + first, coefficients[i, :, :, j].transpose(0, 2, 3, 1)))
            if sum(part.size for _, _, part in self._blunt) > MOST_BLUNT:
                self._sharpen()

    def _sharpen(self) -> None:
        """Look closer at the cells whose coefficients are large beside what was seen by now."""
        if not self._blunt:
            return
        i, j, parts = (np.concatenate(rows) for rows in zip(*self._blunt, strict=True))
        self._blunt.clear()
        goal = max(self._goal, SHARP * self.sampled)
        blunt = self._sizes[i, j] > goal
        i, j = i[blunt], j[blunt]
        self._sizes[i, j] = _sharpened(parts[blunt], np.full(len(i), goal))

    def bound(self) -> Bound:
        """Return the bound."""
        rest = np.minimum(self._interpolation + self._data, self._by_values)
        bound = (self._sizes + self._loss + rest) * (1 + 1e-9)
        largest = float(bound.max())
        if np.isfinite(largest):
            pairs = lru_cache(self._pair) if len(self._directions) == 2 else None
            return Bound(
                max(largest, self.sampled), self.sampled, self.samples, place=self._place,
                pairs=pairs,
            )  # fmt: skip
        open_ = self._ranges(~np.isfinite(bound))
        return Bound(np.inf, self.sampled, self.samples, open_, place=self._place)

    @property
    def _place(self) -> tuple[float, ...]:
        return self._at[: len(self._directions)]

    @np.errstate(all="ignore")
    def _pair(self, axis: int) -> tuple[Bound, Bound]:
        """Return the bounds on the two sides along an axis.

        Nodes lie there: interpolation across is off by nothing, and the first or last coefficients
        across, (2, cells, 3, nodes), are the side's own; differences are (2, places, 3).
        """
        if axis:
            forms, gaps = (np.concatenate(rows) for rows in zip(*self._along_t, strict=True))
            forms, gaps = forms.transpose(3, 0, 2, 1), gaps.transpose(2, 0, 1)
        else:
            forms, gaps = (np.stack(rows) for rows in zip(*self._along_s, strict=True))
            forms = forms.transpose(0, 1, 3, 2)
        known = self._along[axis], self._data, self._by_values
        along, data, by_values = (np.moveaxis(x, axis, 1)[[0, -1]] for x in known)
        sampled = np.sqrt(_squares(gaps, 2).max(axis=1))
        goal = np.maximum(SHARP * sampled, np.where(np.isfinite(data), data, 0.0).max(axis=1))
        work = forms.reshape(-1, *forms.shape[2:])[..., None]
        sizes = _sharpened(work, np.repeat(goal, forms.shape[1])).reshape(2, -1)
        rest = np.minimum(along + data, by_values)
        largest = ((sizes + self._loss + rest) * (1 + 1e-9)).max(axis=1).tolist()
        first, last = [
            Bound(max(bound, seen), seen, gaps.shape[1])
            for bound, seen in zip(largest, sampled.tolist(), strict=True)
        ]
        return first, last

    def _ranges(self, bad: Booleans) -> tuple[tuple[float, float], ...]:
        ranges = []
        for axis, direction in enumerate(self._directions):
            which = np.flatnonzero(bad.any(axis=1 - axis))
            points = direction.cells.points
            ranges.append((float(points[which[0]]), float(points[which[-1] + 1])))
        return tuple(ranges)


def _sharpened(work: Array, goals: Array) -> Array:
    """Return the sizes of cells (n, 3, i, j) from the coefficients of their parts.

    Parts above their goals (n) are halved, along one axis after the other: the coefficients of the
    halves are nearer to the values.
    """
    cells = np.arange(len(work))
    result = np.zeros(len(work))
    for depth in range(2 * SHARPEST + 1):
        sizes = np.sqrt(_squares(work, 1).max(axis=(1, 2)))
        keep = sizes > goals[cells]
        if depth == 0 and not keep.any():
            return np.asarray(sizes)
        if depth == 2 * SHARPEST:
            keep[:] = False
        np.maximum.at(result, cells[~keep], sizes[~keep])
        cells, work = cells[keep], work[keep]
        if not len(cells):
            break
        n, k, i, j = work.shape
        halves = halving(j - 1)
        both = product(work.reshape(-1, j), halves.reshape(-1, j).T)
        # the other axis is halved next
        work = both.reshape(n, k, i, len(halves), j).transpose(0, 3, 1, 4, 2).reshape(-1, k, j, i)
        cells = np.repeat(cells, len(halves))
    return result
