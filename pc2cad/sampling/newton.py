"""M inverted as a formula: Newton's steps, written out, from the nearest of some seeds.

Other programs know neither M nor how to search. What they can do is to take the nearest of some
seeds, and then so many of Newton's steps. Seeds are put where the steps do not arrive yet, until
they do from everywhere that is looked at. Round a collapsed side, where steps do not find what M
ignores, places all round it are tried first.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pc2cad.arrays import Array, Booleans
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.formulas import Formula, NoFormulaError, Writer
from pc2cad.equation.fields import COORDINATES
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.simplification import simplified
from pc2cad.sampling.inversion import closed_directions
from pc2cad.topology.cells import directions_of, normal_direction

#: places that are looked at at once, and so many times in a row without a miss
LOOKED_AT, CLEAN = 2000, 8
#: seeds at most, those in one formula, and the share of misses below which they are put singly
MOST_SEEDS, TOGETHER, FEW = 600, 32, 0.001
#: steps within which a point is met
MOST_STEPS = 16
#: and after that, at least
AFTER = 4
#: the longest step, as a share of the box
FARTHEST = 0.5
#: of a step, those that are tried
SHARES = (1.0, 0.5, 0.125)
#: how near to sides it is looked; nearer to poles parameters are what rounding makes of them
NEAREST = 1e-4
#: det J vanishes at a pole with some power of the distance from it: with less than this one
STEEPEST = 6
#: how far seeds stay from a collapsed side, as a share of the box
RING = 0.1
#: what one step leaves of that distance at least
NEARER = 0.0625
#: places that are tried round a pole and on the way to it, how often, and the steps before each
ROUND, ACROSS, ROUNDS, ROUGH = 6, 4, 2, 4
#: digits of the seeds
_DIGITS = 6


class Inversion:
    """M inverted as a formula of x, y and z; raises NoFormulaError where that is not had."""

    def __init__(self, analysis: Analysis) -> None:
        self._analysis = analysis
        self._random = np.random.default_rng(0)
        #: distance within which a point is met
        self.near = analysis.scale.search_noise
        middle = analysis.map.points(*np.full(3, 0.5))
        self._centre = np.array([_short(x) for x in middle])
        self._closed = closed_directions(analysis)
        #: which limits (2, 3) are sides that collapse
        self._poles = np.zeros((2, 3), dtype=bool)
        #: the parameters that M ignores there: round a pole they are not found by steps
        self._turns: set[int] = set()
        for side in analysis.boundary.sides:
            if side.fate in ("curve", "point"):
                d = normal_direction(side.patch)
                self._poles[int(side.patch[d] > 0), d] = True
                self._turns |= {*directions_of(side.patch)} - {side.along}
        # seeds round a pole stand on one ring: the nearest one is the right one then
        self._room = np.where(self._poles, [[RING], [1 - RING]], [[0.0], [1.0]])
        self._careful, self._bold = (self._step(shares) for shares in (SHARES, SHARES[:1]))
        self._seeds, self._on_poles = self._grids()
        self.formula = self._whole(*self._arriving())

    def learn(self, places: Array) -> None:
        """Put seeds where the formula misses places, and look for more; raise NoFormulaError."""
        square = self.formula(*self._analysis.map.points(*places.T).T)[3]
        far = ~(square <= self.near**2)
        if far.any():
            self._add(places[far])
        self.formula = self._whole(*self._arriving())

    def _step(self, shares: Sequence[float]) -> Formula:
        """Return one of Newton's steps, from a place of the box to the next, for a point.

        Of some shares of the step, the one that ends nearest to the point.
        """
        mapping = self._analysis.map
        writer = Writer("newton", (*COORDINATES, *PARAMETERS))
        trees = simplified((*mapping.coordinates, *(t for row in mapping.derivatives for t in row)))
        made = writer.trees(trees, dict(zip(PARAMETERS, (3, 4, 5), strict=True)))
        gap = [writer.add("subtract", k, made[k]) for k in range(3)]
        a, b, c = made[3:6], made[6:9], made[9:12]
        rows = [_cross(writer, b, c), _cross(writer, c, a), _cross(writer, a, b)]
        det, tiny = _dot(writer, rows[0], a), writer.constant(_short(self._tiny()))
        det = writer.add("select", writer.add("abs", det), tiny, tiny, det)
        far, back = writer.constant(FARTHEST), writer.constant(-FARTHEST)
        steps = []
        for row in rows:
            step = writer.add("divide", _dot(writer, row, gap), det)
            steps.append(writer.add("min", writer.add("max", step, back), far))
        places = (
            [self._moved(writer, d, step, share) for d, step in enumerate(steps)]
            for share in shares
        )
        least, best = self._best(writer, places)
        return writer.made(**dict(zip(PARAMETERS, best, strict=True)), gap=least)

    def _moved(self, writer: Writer, d: int, step: int, share: float) -> int:
        """Return where a share of a step along a direction ends: in the box, and on no pole."""
        taken = step if share == 1 else writer.add("multiply", step, writer.constant(share))
        there = writer.add("add", 3 + d, taken)
        if self._closed[d]:
            return writer.add("subtract", there, writer.add("floor", there))
        least, most = writer.constant(0.0), writer.constant(1.0)
        left = writer.constant(NEARER)
        if self._poles[1, d]:
            rest = writer.add("subtract", most, 3 + d)
            most = writer.add("subtract", most, writer.add("multiply", left, rest))
        if self._poles[0, d]:
            least = writer.add("multiply", left, 3 + d)
        return writer.add("min", writer.add("max", there, least), most)

    @cached_property
    def _trial(self) -> Formula:
        """Return the better of two places of the box for a point, and how far it is, squared."""
        known = ("least", *(f"best_{name}" for name in PARAMETERS))
        writer = Writer("trial", (*COORDINATES, *PARAMETERS, *known))
        image = writer.call(self._images, 3, 4, 5)
        gap = [writer.add("subtract", k, x) for k, x in enumerate(image)]
        least, best = lesser(writer, _dot(writer, gap, gap), (3, 4, 5), 6, (7, 8, 9))
        return writer.made(**dict(zip(PARAMETERS, best, strict=True)), gap=least)

    def _best(self, writer: Writer, places: Iterable[Sequence[int]]) -> tuple[int, list[int]]:
        """Return how near to the point the best of some places is, squared, and that one."""
        least, best = writer.constant(_short(1e9 * self._analysis.size**2)), [3, 4, 5]
        for place in places:
            *best, least = writer.call(self._trial, 0, 1, 2, *place, least, *best)
        return least, best

    @cached_property
    def _images(self) -> Formula:
        """Return M over the unit box."""
        writer, trees = Writer("map", PARAMETERS), simplified(self._analysis.map.coordinates)
        made = writer.trees(trees, dict(zip(PARAMETERS, range(3), strict=True)))
        return writer.made(**dict(zip(COORDINATES, made, strict=True)))

    def _tiny(self) -> float:
        """Return what det J is taken for where it is less: steps are cut to length anyway."""
        a, b, c = self._analysis.map.frame(*self.places().T)[1:]
        det = np.abs((a * np.cross(b, c)).sum(axis=-1))
        return NEAREST**STEEPEST * float(np.nanmax(det))

    def places(self) -> Array:
        """Return places of the box, many of them near its sides."""
        u = self._random.random((LOOKED_AT, 3))
        near = NEAREST ** self._random.random(u.shape)
        kind = self._random.integers(0, 8, u.shape)
        found = np.where(kind == 0, near, np.where(kind == 1, 1 - near, u))
        return np.clip(found, *np.where(self._poles, [[NEAREST], [1 - NEAREST]], [[0.0], [1.0]]))

    def _arriving(self) -> tuple[Formula, int]:
        """Return what finds a seed, and how many steps arrive from there wherever it is looked.

        Seeds stand in ever finer grids, until few places are missed; then where these are.
        """
        clean, count, seek = 0, 1, self._seek(self._seeds)
        while clean < CLEAN:
            places = self.places()
            taken, missed = self._descents(places, seek)
            count, clean = max(count, taken), clean + 1
            if missed.any():
                self._add(places[missed])
                clean, seek = 0, self._seek(self._seeds)
        return seek, count

    def _add(self, missed: Array) -> None:
        """Add those of some places to the seeds that are far from them."""
        more, seeds = np.clip(missed, *self._room), self._seeds
        for d in range(3) if self._on_poles else ():
            if d in self._turns or self._poles[:, d].any():
                more[:, d] = seeds[0, d]
        near, far = (self._analysis.map.points(*x.T) for x in (more, seeds))
        more = more[_apart(near, far, max(4, len(seeds) // 8))]
        self._seeds = np.concatenate((seeds, more))
        if len(self._seeds) > MOST_SEEDS:
            shown = self._analysis.map.shown(missed[0])
            raise NoFormulaError(
                f"the steps of Newton from {len(self._seeds)} seeds do not arrive at {shown}"
            )

    def _grids(self) -> tuple[Array, bool]:
        """Return the first grid of places (n, 3) that misses few, or the best; is it on poles.

        Round poles they stand all round, or on the pole: the middle of what lies round it.
        """
        best, least, finer = (1, False), np.inf, 1
        while least > FEW and finer <= MOST_SEEDS:
            for on_poles in (True, False) if self._turns else (False,):
                seeds = self._grid(finer, on_poles)
                if len(seeds) > MOST_SEEDS // 2:
                    continue
                places = self.places()[:: LOOKED_AT // 400]
                share = float(self._descents(places, self._seek(seeds))[1].mean())
                if share < least:
                    best, least = (finer, on_poles), share
            finer *= 2
        if not np.isfinite(least):
            raise NoFormulaError(f"even a coarse grid has more than {MOST_SEEDS // 2} seeds")
        # what few places miss, fewer miss from seeds twice as near
        finer, on_poles = best
        grids = [self._grid(x, on_poles) for x in (2 * finer, finer)]
        return next(grid for grid in grids if len(grid) <= MOST_SEEDS // 2), on_poles

    def _grid(self, finer: int, on_poles: bool) -> Array:
        """Return places (n, 3) of the box, so many along each direction as it is long."""
        rows = []
        for d, length in enumerate(self._lengths):
            count = max(1, round(finer * length / self._analysis.size))
            row = (np.arange(count) + 0.5) / count
            if on_poles and d in self._turns:
                row = row[count // 2 :][:1]
            elif on_poles and self._poles[:, d].any():
                row = np.flatnonzero(self._poles[:, d])[:1].astype(float)
            rows.append(row)
        return np.stack(np.meshgrid(*rows, indexing="ij"), axis=-1).reshape(-1, 3)

    @cached_property
    def _lengths(self) -> list[float]:
        """The lengths of lines through the middle along u, v and w."""
        found = []
        for d in range(3):
            line = np.full((201, 3), 0.53)
            line[:, d] = np.linspace(0, 1, len(line))
            steps = np.diff(self._analysis.map.points(*line.T), axis=0)
            found.append(float(np.sqrt((steps**2).sum(axis=1)).sum()))
        return found

    def _descents(self, places: Array, seek: Formula) -> tuple[int, Booleans]:
        """Return after how many steps all places are found that are, and which are not."""
        points = self._analysis.map.points(*places.T)
        missed, most = np.ones(len(points), dtype=bool), 0
        for place, step in self._starts(self._call, seek(*points.T), *points.T):
            active = np.flatnonzero(missed)
            place = [x[active] for x in place]
            for k in range(MOST_STEPS):
                *place, square = step(*points[active].T, *place)
                far = ~(square <= self.near**2)
                if not far.all():
                    most = max(most, k + 1)
                    missed[active[~far]] = False
                    active, place = active[far], [x[far] for x in place]
                if not len(active):
                    break
        # each step squares the errors; others may need more
        return most + max(AFTER, most), missed

    def _starts(self, call: Any, place: Any, *point: Any) -> Iterator[tuple[Any, Formula]]:
        """Yield places from which steps begin: as it is, and where there are poles round these.

        And the steps from there. The nearest place is no way to the point where M leaves a pole
        with a parameter's square along one line and at once along another: steps are whole there.
        """
        yield place, self._careful
        if self._turns:
            place = call(self._scan, *point, *place)
            for _ in range(ROUNDS):
                for _ in range(ROUGH):
                    *place, _ = call(self._careful, *point, *place)
                place = call(self._scan, *point, *place)
            yield place, self._careful
            yield place, self._bold

    @staticmethod
    def _call(formula: Formula, *given: Array) -> list[Array]:
        return formula(*given)

    @cached_property
    def _scan(self) -> Formula:
        """Return the best of places all round the poles, as near to these as now or less near."""
        writer = Writer("round", (*COORDINATES, *PARAMETERS))
        rows = []
        for d in range(3):
            count = ROUND if d in self._turns else ACROSS if self._poles[:, d].any() else 0
            tried = [writer.constant((k + 0.5) / count) for k in range(count)]
            rows.append(tried if d in self._turns else [*tried, 3 + d])
        _, best = self._best(writer, product(*rows))
        return writer.made(**dict(zip(PARAMETERS, best, strict=True)))

    def _seek(self, seeds: Array) -> Formula:
        """Return the place of the box of the seed that is nearest to a point."""
        writer = Writer("seek", COORDINATES)
        images = self._analysis.map.points(*seeds.T) - self._centre
        # of all |p - c|² / 2 the least where p c - c² / 2 is largest
        rows = np.column_stack((images, -(images**2).sum(axis=1) / 2, seeds))
        rows = np.array([[_short(x) for x in row] for row in rows])
        point = [writer.total([(1.0, k)], -x) for k, x in enumerate(self._centre.tolist())]
        best = writer.constant(_short(-1e9 * self._analysis.size**2))
        state = [best, *(writer.constant(x) for x in rows[0, 4:].tolist())]
        for start in range(0, len(rows), TOGETHER) if len(rows) > 1 else ():
            part = _nearer(rows[start : start + TOGETHER])
            state = list(writer.call(part, *point, *state))
        return writer.made(**dict(zip(PARAMETERS, state[1:], strict=True)))

    def _whole(self, seek: Formula, count: int) -> Formula:
        """Return u, v and w, local, of a point, and the square of how far it is from M there."""
        writer = Writer("inverse", COORDINATES)
        best, least = list[int](), -1
        descents = {step: self._descent(step, count) for step in (self._careful, self._bold)}
        for place, step in self._starts(writer.call, writer.call(seek, 0, 1, 2), 0, 1, 2):
            *found, gap = writer.call(descents[step], 0, 1, 2, *place)
            least, best = lesser(writer, gap, found, least, best) if best else (gap, found)
        return writer.made(**dict(zip(PARAMETERS, best, strict=True)), gap=least)

    @staticmethod
    def _descent(step: Formula, count: int) -> Formula:
        """Return so many steps."""
        writer = Writer("descent", (*COORDINATES, *PARAMETERS))
        place, gap = [3, 4, 5], 0
        for _ in range(count):
            *place, gap = writer.call(step, 0, 1, 2, *place)
        return writer.made(**dict(zip(PARAMETERS, place, strict=True)), gap=gap)


def lesser(
    writer: Writer, square: int, place: Sequence[int], least: int, best: Sequence[int]
) -> tuple[int, list[int]]:
    """Return the lesser distance (squared), and whose place it is."""
    chosen = [
        writer.add("select", square, least, new, old) for new, old in zip(place, best, strict=True)
    ]
    return writer.add("min", least, square), chosen


def _nearer(rows: Array) -> Formula:
    """Return the largest score, and whose it is, of what came before and some more seeds."""
    writer = Writer("nearer", (*COORDINATES, "best", *PARAMETERS))
    best, place = 3, [4, 5, 6]
    for a, b, c, start, *own in rows.tolist():
        score = writer.total([(a, 0), (b, 1), (c, 2)], start)
        place = [
            writer.add("select", best, score, writer.constant(x), old)
            for x, old in zip(own, place, strict=True)
        ]
        best = writer.add("max", best, score)
    return writer.made(best=best, **dict(zip(PARAMETERS, place, strict=True)))


def _apart(points: Array, others: Array, count: int) -> list[int]:
    """Return the numbers of some points, each as far from others and those before as can be."""
    distance, found = cKDTree(others).query(points)[0] ** 2, list[int]()
    while len(found) < min(count, len(points)):
        found.append(int(distance.argmax()))
        distance = np.minimum(distance, ((points - points[found[-1]]) ** 2).sum(axis=1))
    return found


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _cross(writer: Writer, a: Sequence[int], b: Sequence[int]) -> list[int]:
    def less(i: int, j: int) -> int:
        first, second = writer.add("multiply", a[i], b[j]), writer.add("multiply", a[j], b[i])
        return writer.add("subtract", first, second)

    return [less(1, 2), less(2, 0), less(0, 1)]


def _dot(writer: Writer, a: Sequence[int], b: Sequence[int]) -> int:
    x, y, z = (writer.add("multiply", *pair) for pair in zip(a, b, strict=True))
    return writer.add("add", writer.add("add", x, y), z)
