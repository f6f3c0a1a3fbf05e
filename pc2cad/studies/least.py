"""The least of a figure under goals, in logarithms: sizes and figures are products of powers.

Volumes, areas and masses are nearly powers of the lengths of a part: in logarithms of both goals
are nearly linear, and few steps of sequential quadratic programming (SciPy's SLSQP) come near the
least place. From there Newton's steps on the conditions of Karush, Kuhn and Tucker follow, with
second derivatives from differences of the exact first ones, one more map a parameter.

*Source:* J. Nocedal, S. Wright, Numerical Optimization (2006), chapters 12 and 18.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np

from pc2cad.arrays import Array, Booleans

#: figures that are never negative
POSITIVE: Final = frozenset(("volume", "area", "mass"))
#: relative change of the figure at which Newton's steps begin, and at which others end
ROUGH: Final = 1e-5
FINE: Final = 1e-14
#: share of the ranges that the first step takes at most
FIRST: Final = 0.3
#: a goal or limit that is so near is taken to hold with equality
TOUCHED: Final = 1e-3
#: Newton's steps at most
MOST_STEPS: Final = 6


#: of what a figure may be for a part of its size: less is rounding where it should be nothing
NOTHING: Final = 1e-4


def size_of(figure: str, figures: Mapping[str, float]) -> float:
    """Return what a figure is held against that has no size of its own, such as a centroid at 0."""
    length = float(abs(figures["volume"]) ** (1 / 3))
    whole = {"x": length, "y": length, "z": length}
    if figure not in POSITIVE and figure not in whole:
        whole[figure] = abs(figures["mass"]) * length**2
    return max(abs(figures[figure]), NOTHING * whole.get(figure, 0.0))


class Goal(Protocol):
    """A figure that is to be equal to, at most or at least some value."""

    @property
    def figure(self) -> str:
        """Its name."""

    @property
    def relation(self) -> str:
        """One of =, <= and >=."""

    @property
    def value(self) -> float:
        """What it is held against."""


class Problem(Protocol):
    """Figures and their gradients at places of the ranges, given as shares of these (n,)."""

    low: Array
    high: Array
    #: relative accuracy of the figures
    near: float

    @property
    def goals(self) -> Sequence[Goal]:
        """What is asked for."""

    def figures(self, share: Array) -> tuple[dict[str, float], dict[str, Array]] | None:
        """Return figures and gradients by shares; None where there is no solid."""


@dataclass(frozen=True, eq=False)
class Logarithms:
    """Places whose parameters are taken by their logarithms, where ranges are positive."""

    problem: Problem
    #: the figure that is to be least, and -1 where it is to be most
    wanted: str
    sign: float
    #: what figures that may be negative are held against, at the place where it begins
    sizes: dict[str, float]

    @classmethod
    def of(cls, problem: Problem, wanted: str, sign: float, start: Array) -> Logarithms:
        """Return the space for what begins at shares of the ranges."""
        space = cls(problem, wanted, sign, {})
        found = problem.figures(space.share(space.place(start)))
        if found is None:
            return space
        return replace(space, sizes={figure: size_of(figure, found[0]) for figure in found[0]})

    @property
    def positive(self) -> Booleans:
        """Which parameters have positive ranges."""
        return np.asarray(self.problem.low > 0)

    @property
    def span(self) -> Array:
        """The logarithms of the ranges' ratios, 1 where there is none."""
        low, high = (np.where(self.positive, x, 1.0) for x in (self.problem.low, self.problem.high))
        return np.where(self.positive, np.log(high / low), 1.0)

    def place(self, share: Array) -> Array:
        """Return the place at shares of the ranges."""
        low, high = self.problem.low, self.problem.high
        value = np.where(self.positive, low + (high - low) * share, 1.0)
        return np.where(self.positive, np.log(value / np.where(self.positive, low, 1.0)), share) / (
            self.span
        )

    def share(self, place: Array) -> Array:
        """Return the shares of the ranges at a place."""
        return np.clip((self._value(place) - self.problem.low) / self._width, 0.0, 1.0)

    @property
    def _width(self) -> Array:
        return self.problem.high - self.problem.low

    def _value(self, place: Array) -> Array:
        grown = self.problem.low * np.exp(np.where(self.positive, self.span * place, 0.0))
        return np.where(self.positive, grown, self.problem.low + self._width * place)

    def look(self, place: Array, figure: str, aim: float | None) -> tuple[float, Array] | None:
        """Return a figure beside its aim and the gradient, in logarithms where it is positive."""
        found = self.problem.figures(self.share(place))
        if found is None:
            return None
        rate = np.where(self.positive, self._value(place) * self.span / self._width, 1.0)
        value, slope = found[0][figure], found[1][figure] * rate
        if figure in POSITIVE and value > 0 and (aim is None or aim > 0):
            return float(np.log(value / (aim or 1.0))), slope / value
        size = abs(aim or self.sizes.get(figure, 1.0)) or 1.0
        return (value - (aim or 0.0)) / size, slope / size

    def least(self, place: Array) -> tuple[float, Array] | None:
        """Return what is to be least, and its gradient."""
        found = self.look(place, self.wanted, None)
        return None if found is None else (self.sign * found[0], self.sign * found[1])


def find_least(problem: Problem, wanted: str, sign: float, start: Array) -> Array | None:
    """Return shares of the ranges at which a figure is least under the goals, or None.

    Begins anywhere; None where there is no solid, or where Newton's steps do not arrive at a
    place that meets the conditions for a least one.
    """
    space = Logarithms.of(problem, wanted, sign, start)
    rough = descended(space, start, ROUGH)
    fine = None if rough is None else _polished(space, rough)
    return None if fine is None else space.share(fine)


def descended(space: Logarithms, start: Array, enough: float) -> Array | None:
    """Return the place that sequential quadratic programming comes to from shares of the ranges.

    None where there is no solid.
    """
    from scipy.optimize import minimize

    place = space.place(start)
    first = space.least(place)
    if first is None:
        return None
    # SLSQP begins with a step as long as the slope: a part of the ranges, and no more
    size = max(1.0, float(np.abs(first[1]).max()) / FIRST)

    def part(k: int, look: Callable[[Array], Any], none: Any, turn: float) -> Callable[..., Any]:
        def of(x: Array) -> Any:
            found = look(x)
            return none if found is None else turn * found[k]

        return of

    still = np.zeros(len(place))
    conditions = []
    for goal in space.problem.goals:
        look, turn = _looking(space, goal), -1.0 if goal.relation == "<=" else 1.0
        conditions.append({
            "type": "eq" if goal.relation == "=" else "ineq",
            "fun": part(0, look, -1.0, turn), "jac": part(1, look, still, turn),
        })  # fmt: skip
    done = minimize(
        part(0, space.least, np.inf, 1 / size), place, jac=part(1, space.least, still, 1 / size),
        method="SLSQP", bounds=[(0.0, 1.0)] * len(place), constraints=conditions,
        options={"ftol": enough, "maxiter": 60},
    )  # fmt: skip
    return np.asarray(np.clip(done.x, 0.0, 1.0))


def _looking(space: Logarithms, goal: Goal) -> Callable[[Array], tuple[float, Array] | None]:
    return lambda place: space.look(place, goal.figure, goal.value)


@dataclass(frozen=True, eq=False)
class _Seen:
    """Values and gradients at a place: of what is to be least, and of the goals that are met."""

    figure: float
    slope: Array
    gaps: Array
    rows: Array


def _polished(space: Logarithms, place: Array) -> Array | None:
    """Return the place at which Newton's steps arrive, or None where it is not a least one."""
    place = np.where(place <= TOUCHED, 0.0, np.where(place >= 1 - TOUCHED, 1.0, place))
    free = np.asarray((place > 0) & (place < 1))
    goals = [goal for goal in space.problem.goals if _is_met(space, place, goal)]
    first = here = _seen(space, place, goals)
    if first is None or here is None:
        return None
    weights = _weights(first, free)
    bend = _bend(space, place, goals, free, first, weights)
    if bend is None:
        return None
    for _ in range(MOST_STEPS):
        step = _step(here, bend, free)
        if np.abs(step).max(initial=0.0) <= 0.1 * space.problem.near:
            lost = float(np.abs(weights) @ np.abs(first.gaps))
            better = here.figure - first.figure <= 2 * lost + space.problem.near
            return place if better and _is_least(space, place, goals, here, free) else None
        place = place + step
        free = np.asarray(free & (place > 0) & (place < 1))
        place = np.clip(place, 0.0, 1.0)
        here = _seen(space, place, goals)
        if here is None:
            return None
    return None


def _is_met(space: Logarithms, place: Array, goal: Goal) -> bool:
    """Say whether a goal is to hold with equality."""
    found = space.look(place, goal.figure, goal.value)
    return found is not None and (goal.relation == "=" or abs(found[0]) <= TOUCHED)


def _weights(here: _Seen, free: Booleans) -> Array:
    """Return how much of each goal's slope makes up the figure's."""
    return np.asarray(np.linalg.lstsq(here.rows[:, free].T, here.slope[free], rcond=None)[0])


def _step(here: _Seen, bend: Array, free: Booleans) -> Array:
    """Return Newton's step, 0 for what is not free."""
    rows, count = here.rows[:, free], len(here.gaps)
    both = np.block([[bend[np.ix_(free, free)], rows.T], [rows, np.zeros((count, count))]])
    right = -np.concatenate((here.slope[free], here.gaps))
    step = np.zeros(len(free))
    step[free] = np.linalg.lstsq(both, right, rcond=None)[0][: int(free.sum())]
    return step


def _seen(space: Logarithms, place: Array, goals: Sequence[Goal]) -> _Seen | None:
    figure = space.least(place)
    rows = [space.look(place, goal.figure, goal.value) for goal in goals]
    if figure is None:
        return None
    known = [row for row in rows if row is not None]
    slopes = np.array([slope for _, slope in known]).reshape(len(goals), len(place))
    return _Seen(*figure, np.array([gap for gap, _ in known]), slopes)


def _bend(
    space: Logarithms, place: Array, goals: Sequence[Goal], free: Booleans, here: _Seen,
    weights: Array,
) -> Array | None:  # fmt: skip
    """Return second derivatives of the figure less the weighted goals, of what is free (n, n)."""
    bend = np.zeros((len(place), len(place)))
    if free.sum() <= len(goals):
        return bend  # goals alone say where
    length = space.problem.near**0.5
    for k in np.flatnonzero(free):
        beside = place.copy()
        beside[k] += length if place[k] < 0.5 else -length
        there = _seen(space, beside, goals)
        if there is None:
            return None
        change = there.slope - here.slope - (there.rows - here.rows).T @ weights
        bend[k] = change / (beside[k] - place[k])
    return np.asarray((bend + bend.T) / 2)


def _is_least(
    space: Logarithms, place: Array, goals: Sequence[Goal], here: _Seen, free: Booleans
) -> bool:
    """Say whether limits and goals hold the figure up, and goals that are not met with equality."""
    weights = _weights(here, free)
    slack = 1e-6 * max(1.0, float(np.abs(here.slope).max()))
    turns = np.array([{"<=": -1.0, ">=": 1.0, "=": 0.0}[goal.relation] for goal in goals])
    rest = here.slope - here.rows.T @ weights
    held = np.where(place < 0.5, rest, -rest)[~free]
    others = [g for g in space.problem.goals if g not in goals]
    looks = [(g, space.look(place, g.figure, g.value)) for g in others]
    open_ = all(
        found is not None and (found[0] <= 0) == (goal.relation == "<=") for goal, found in looks
    )
    return open_ and bool((turns * weights >= -slack).all()) and bool((held >= -slack).all())
