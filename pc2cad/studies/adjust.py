"""Parameters for which a solid has a wanted volume, area, mass, centroid or inertia.

Figures and their exact derivatives come from the equation (`studies.figures`), or from the joined
solid of several bodies. Goals alone are met by damped Newton steps within the ranges, the least or
most of a figure under goals as `studies.least` says.

*Source:* J. Nocedal, S. Wright, Numerical Optimization (2006), chapters 10 and 18.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.checked import Progress, Stages, check_map
from pc2cad.domain.velocity import NotDifferentiableError
from pc2cad.equation.point_equation import PointEquation
from pc2cad.errors import InputError, KernelError, NotASolidError
from pc2cad.integrals.weighing import Density
from pc2cad.studies.figures import FIGURES, figures_of, figures_of_map
from pc2cad.studies.least import FINE, Logarithms, descended, find_least, size_of
from pc2cad.studies.over_ranges import ProvedLater
from pc2cad.templates.bodies import Bodies, BodiesTemplate
from pc2cad.templates.file import read_template
from pc2cad.templates.ranges import RangeError, read_axis, read_number, split_setting
from pc2cad.templates.template import Template

#: relative miss of a goal that is none
MET: Final = 1e-10
#: relative miss at which Newton's steps end, and the shortest share of one that is tried
SOLVED: Final = 1e-13
SHORTEST: Final = 1e-4
#: what SciPy wants limits to be apart
TINY: Final = 1e-12
#: maps that are looked at before it is given up
MOST_EVALUATIONS: Final = 200
_GOAL: Final = re.compile(r"\s*(\w+)\s*(<=|>=|=)(.*)\Z", re.S)


class GoalsNotMetError(InputError):
    """No values within the ranges give the solid what is asked of it."""


@dataclass(frozen=True)
class Goal:
    """A figure that is to be equal to, at most or at least some value."""

    figure: str
    relation: str
    value: float

    def __str__(self) -> str:
        return f"{self.figure} {self.relation} {self.value:.12g}"

    def miss(self, found: float) -> float:
        """Return by how much a figure misses the goal: found - value, 0 where it is met."""
        gap = found - self.value
        if self.relation == "<=":
            return max(gap, 0.0)
        return min(gap, 0.0) if self.relation == ">=" else gap

    def missed(self, found: float) -> str:
        """Return in words that a figure misses the goal, with the digits that tell them apart."""
        digits = next((n for n in (6, 9, 12) if float(f"{found:.{n}g}") != self.value), 17)
        return f"{self} is not met, {self.figure} is {found:.{digits}g}"


@dataclass(frozen=True)
class Adjusted:
    """Values of the parameters that meet the goals, and what the solid is then."""

    parameters: Mapping[str, float]
    figures: Mapping[str, float]
    goals: tuple[Goal, ...]
    #: parameters that end at a limit of their range
    at_limits: tuple[str, ...]
    #: maps that were looked at on the way
    evaluations: int
    #: with these values
    equation: PointEquation | Bodies


def read_goal(text: str) -> Goal:
    """Return the goal that ``volume=200``, ``mass<=3`` or ``z>=1/2`` states; raise InputError."""
    found = _GOAL.match(text)
    if not found:
        raise InputError(
            f"--until '{text[:80]}': write FIGURE=VALUE, FIGURE<=VALUE or FIGURE>=VALUE"
        )
    figure, relation, value = found.groups()
    return Goal(_figure("--until", figure), relation, read_number(f"--until {figure}", value))


def _figure(option: str, name: str) -> str:
    if name not in FIGURES:
        raise InputError(f"{option}: '{name[:80]}' is none of {', '.join(FIGURES)}")
    return name


def read_ranges(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return the ranges that ``r=0.2:3`` states by parameter; raise RangeError."""
    ranges: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, given = split_setting("--vary", text)
        axis = read_axis(name, given)
        if axis.range is None:
            raise RangeError(f"--vary '{text[:80]}': write NAME=LOW:HIGH")
        if name in ranges:
            raise RangeError(f"--vary {name[:80]}: the parameter is varied twice")
        ranges[name] = axis.range
    return ranges


def adjust(
    template: Template | BodiesTemplate | str | os.PathLike[str],
    vary: Mapping[str, tuple[float, float]],
    until: Sequence[Goal | str] = (),
    *,
    minimise: str | None = None,
    maximise: str | None = None,
    values: Mapping[str, Any] | None = None,
    density: float | str | Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> Adjusted:
    """Return values of some parameters within ranges that meet goals, from the present ones on.

        pc.adjust("ball", {"R": (0.2, 5)}, ["volume=200"]).parameters["R"]

    Without `minimise` or `maximise`, of many such values those that a few Newton steps reach.
    Local methods: a better place elsewhere in the ranges is not excluded. Raises GoalsNotMetError
    with the nearest values, InputError, and NotASolidError where the result is no solid.
    """
    if minimise and maximise:
        raise InputError("what is to be least and what is to be most cannot be asked for at once")
    if not (until or minimise or maximise):
        raise InputError("say what is wanted: a goal (--until), or what is to be least or most")
    if not vary:
        raise InputError("say which parameters may change, and from where to where (--vary)")
    wanted, sign = minimise or maximise, -1.0 if maximise else 1.0
    goals = tuple(read_goal(goal) if isinstance(goal, str) else goal for goal in until)
    whole = (
        template if isinstance(template, (Template, BodiesTemplate)) else read_template(template)
    )
    problem = _Problem(whole, dict(vary), goals, dict(values or {}), density, progress, wanted)
    best: Array | None = None
    for start in problem.starts():
        found = (
            _least(problem, _figure("--minimise", wanted), sign, start) if wanted
            else _root(problem, start)
        )  # fmt: skip
        if found is not None and (best is None or problem.misses(found) < problem.misses(best)):
            best = found
        if best is not None and problem.misses(best) <= problem.near:
            return problem.result(best)
    raise problem.unmet(best)


class _Problem:
    """Figures and derivatives at places of the ranges, each worked out once."""

    def __init__(
        self,
        template: Template | BodiesTemplate,
        vary: Mapping[str, tuple[float, float]],
        goals: tuple[Goal, ...],
        values: Mapping[str, Any],
        density: Density,
        progress: Progress | None,
        wanted: str | None,
    ) -> None:
        self.template, self.vary, self.goals = template, vary, goals
        self.asked = frozenset({goal.figure for goal in goals} | ({wanted} if wanted else set()))
        self.fixed, self.density, self.progress = values, density, progress
        both = [name for name in vary if name in values]
        if both:
            raise InputError(f"{both[0]} is set (-s) and varied (--vary)")
        bound = template.bind(values).parameters
        for name in vary:
            if name not in bound:
                raise InputError(
                    f"--vary: {template.name} has no parameter '{name[:80]}' "
                    f"(it has: {', '.join(bound) or 'none'})"
                )
            for limit in vary[name]:
                template.values({**values, name: limit})  # within min and max
        self.names = tuple(vary)
        self.low, self.high = (np.array([vary[n][k] for n in self.names]) for k in (0, 1))
        self.now = np.array([bound[name] for name in self.names])
        self._known: dict[tuple[float, ...], tuple[dict[str, float], dict[str, Array]] | None] = {}
        self._proved = ProvedLater(template, vary, values)
        self.refused = ""
        #: relative miss of a goal that is none: several bodies are known no better
        self.near = MET

    @property
    def evaluations(self) -> int:
        """Maps that were looked at."""
        return len(self._known)

    def starts(self) -> list[Array]:
        """Return where to begin, as shares of the ranges: the present values, then others."""
        share = (self.now - self.low) / (self.high - self.low)
        return [np.clip(share, 0.02, 0.98), np.full(len(share), 0.5),
                np.full(len(share), 0.1), np.full(len(share), 0.9)]  # fmt: skip

    def settings(self, share: Array) -> dict[str, float]:
        """Return the parameters at a place of the ranges."""
        places = self.low + (self.high - self.low) * share
        rows = zip(self.names, np.clip(places, self.low, self.high).tolist(), strict=True)
        return dict(rows)

    def figures(self, share: Array) -> tuple[dict[str, float], dict[str, Array]] | None:
        """Return figures and gradients (by shares) at a place; None where there is no solid."""
        key = tuple(np.asarray(share).tolist())
        if key not in self._known:
            if len(self._known) >= MOST_EVALUATIONS:
                return None
            if self.progress is not None:
                self.progress(f"evaluation {len(self._known) + 1}")
            self._known[key] = self._worked_out(share)
        return self._known[key]

    def _worked_out(self, share: Array) -> tuple[dict[str, float], dict[str, Array]] | None:
        settings = self.settings(share)
        equation = self.template.bind({**self.fixed, **settings})
        try:
            known = self._proved.at(settings)
            found = figures_of(equation, self.density, self.names, self.asked, known)
        except (NotASolidError, KernelError, NotDifferentiableError) as error:
            self.refused = str(error)
            return None
        self.near = max(self.near, found.error)
        width = self.high - self.low
        slopes = {f: np.array([row[f] for row in found.slopes]) * width for f in FIGURES}
        return dict(found.values), slopes

    def scale(self, goal: Goal) -> float:
        """Return what a miss of a goal is held against."""
        places = [known[0] for known in self._known.values() if known is not None]
        seen = [size_of(goal.figure, figures) for figures in places]
        return abs(goal.value) or max(seen, default=1.0) or 1.0

    def misses(self, share: Array) -> float:
        """Return the largest relative miss of a goal."""
        found = self.figures(share)
        if found is None:
            return float("inf")
        return max((abs(g.miss(found[0][g.figure])) / self.scale(g) for g in self.goals), default=0)

    def linear(self, share: Array) -> tuple[Array, Array] | None:
        """Return relative misses of the goals and their slopes by shares; None: no solid there."""
        found = self.figures(share)
        if found is None:
            return None
        gaps, rows = [], []
        for goal in self.goals:
            gap, size = goal.miss(found[0][goal.figure]), self.scale(goal)
            gaps.append(gap / size)
            rows.append(found[1][goal.figure] / size * (gap != 0.0))
        return np.array(gaps), np.array(rows)

    def result(self, share: Array) -> Adjusted:
        settings = self.settings(share)
        equation = self.template.bind({**self.fixed, **settings})
        if isinstance(equation, Bodies):
            found = self.figures(share)
            assert found is not None
            figures = found[0]
        else:
            checked = check_map(equation, stages=Stages(self.progress))
            figures = figures_of_map(checked, self.density)
        ends = np.minimum(np.abs(share), np.abs(1 - share)) <= 1e-9
        at_limits = tuple(name for name, end in zip(self.names, ends, strict=True) if end)
        return Adjusted(settings, figures, self.goals, at_limits, self.evaluations, equation)

    def unmet(self, share: Array | None) -> GoalsNotMetError:
        """Return the error that says what is not reached, and the nearest that was seen."""
        ranges = ", ".join(f"{n} from {a:.6g} to {b:.6g}" for n, (a, b) in self.vary.items())
        found = None if share is None else self.figures(share)
        if found is None or share is None:
            why = f" ({self.refused})" if self.refused else ""
            return GoalsNotMetError(f"no solid was found with {ranges} that has derivatives{why}")
        missed = [
            g for g in self.goals if abs(g.miss(found[0][g.figure])) > self.near * self.scale(g)
        ]
        settings = ", ".join(f"{n} = {x:.6g}" for n, x in self.settings(share).items())
        told = "; ".join(g.missed(found[0][g.figure]) for g in missed)
        return GoalsNotMetError(f"with {ranges} the nearest solid found has {settings}: {told}")


def _root(problem: _Problem, start: Array) -> Array | None:
    """Return the place that Newton steps from a start reach, or None: no solid there.

    A step solves the linear problem within the ranges, and is halved until the misses shrink.
    """
    from scipy.optimize import lsq_linear

    here = problem.linear(start)
    share = start
    while here is not None:
        gaps, slopes = here
        if np.abs(gaps).max() <= SOLVED:
            break
        inside = np.stack((-share - TINY, 1 - share + TINY))
        step = lsq_linear(slopes, -gaps, tuple(inside), method="bvls", tol=1e-15).x
        length, better = 1.0, None
        while better is None and length > SHORTEST:
            there = np.clip(share + length * step, 0.0, 1.0)
            found = problem.linear(there)
            hoped = gaps @ gaps - np.sum((gaps + slopes @ (there - share)) ** 2)
            if found is not None and gaps @ gaps - found[0] @ found[0] > max(hoped, 0.0) / 8:
                better = there, found
            length /= 2
        if better is None:
            break
        share, here = better
    return None if here is None else share


def _least(problem: _Problem, wanted: str, sign: float, start: Array) -> Array | None:
    """Return the place with the least figure that meets the goals, or None: no solid at first."""
    share = find_least(problem, wanted, sign, start)
    if share is not None and problem.misses(share) <= problem.near:
        return share
    # from a place that meets the goals, and as far as it goes
    near = _root(problem, start) if problem.goals else start
    if near is None:
        return None
    space = Logarithms.of(problem, wanted, sign, near)
    place = descended(space, near, FINE)
    return None if place is None else space.share(place)
