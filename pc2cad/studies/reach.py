"""How far one parameter may go from its value until the map is no solid any more.

Each value that is looked at is checked as a part is: limits of channels, the sign of det J, sides
that close, and injectivity. Steps grow until one fails; the end is then found by halving. Where
det J has the other sign it has vanished on the way, so that no step leads beyond that. Else nothing
is looked at between values that hold: what is found is sampled. Over what part of it det J keeps
its sign is proved at last.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from pc2cad.checked import Progress, check_map
from pc2cad.equation.family import Family
from pc2cad.equation.point_equation import PointEquation
from pc2cad.equation.variation import Variation
from pc2cad.errors import InputError, NotASolidError
from pc2cad.expression.tree import number
from pc2cad.solidity.over_ranges.boxes import around
from pc2cad.studies.over_ranges import MANY, attempted

#: first step as a share of the value (of 1 where it is 0), and how often it is doubled
FIRST: Final = Fraction(1, 16)
DOUBLINGS: Final = 10
#: share of the way to the end within which the end is known
WITHIN: Final = 1e-3
#: how much of what was found is to be proved; less of it where nothing was round the value
NEARER: Final = (Fraction(1), Fraction(1, 2), Fraction(1, 4), Fraction(1, 8))


@dataclass(frozen=True)
class End:
    """Where a parameter's range ends on one side."""

    #: the farthest value that holds, and the nearest beyond it that does not; None: none was found
    holds: float
    breaks: float | None
    #: why the latter is no solid
    why: str = ""


@dataclass(frozen=True)
class Reach:
    """The range of one parameter, the others as they are: found by search (sampled)."""

    parameter: str
    value: float
    low: End
    high: End
    #: values that were looked at
    evaluations: int
    #: from where to where, round the value, det J is proved to keep its sign; None: that is open
    proved: tuple[float, float] | None


def reach(equation: PointEquation, name: str, progress: Progress | None = None) -> Reach:
    """Return how far a parameter may go down and up until M is no solid.

        pc.reach(pc.read_template("torus").bind(), "r").high.breaks

    A template's own limits of the parameter are not asked. Raises InputError for a name of no
    parameter, and NotASolidError where the present value is none already.
    """
    variation = equation.variation(name)
    search = _Search(variation, check_map(equation).orientation.sign, progress)
    low, high = (search.end(direction) for direction in (-1, 1))
    proved = _proved(variation, low.holds, high.holds)
    return Reach(name, variation.value, low, high, search.evaluations, proved)


def _proved(variation: Variation, low: float, high: float) -> tuple[float, float] | None:
    """Return how much of a range round the value is proved; None where that stays open."""
    name, coordinates, domain = variation.name, variation.coordinates, variation.domain
    if coordinates is None:
        return None
    family, value = Family(name, (name,), {}, coordinates, domain), Fraction(variation.value)
    for share in NEARER:
        first, last = (float(value + (Fraction(end) - value) * share) for end in (low, high))
        proof = attempted(lambda: family, {name: (first, last)}, MANY)
        found = around(proof.proved, value) if proof is not None else None
        if found is not None:
            return found
    return None


class _Search:
    def __init__(self, variation: Variation, sign: int, progress: Progress | None) -> None:
        self._variation, self._sign, self._progress = variation, sign, progress
        self.evaluations = 0

    def end(self, direction: int) -> End:
        """Return the end on one side: the first that steps from the value run into."""
        start = Fraction(self._variation.value)
        step = direction * (abs(start) or Fraction(1)) * FIRST
        holds, why = start, None
        for _ in range(DOUBLINGS):
            breaks = start + step
            why = self._why_not(breaks)
            if why is not None:
                break
            holds, step = breaks, 2 * step
        if why is None:
            return End(float(holds), None)
        while abs(breaks - holds) > WITHIN * abs(breaks - start):
            # short fractions: they go into formulas
            middle = ((holds + breaks) / 2).limit_denominator(10**9)
            if middle in (holds, breaks):
                break
            reason = self._why_not(middle)
            if reason is None:
                holds = middle
            else:
                breaks, why = middle, reason
        return End(float(holds), float(breaks), why)

    def _why_not(self, value: Fraction) -> str | None:
        """Return why M is no solid at a value, None where it is one."""
        self.evaluations += 1
        if self._progress is not None:
            self._progress(f"{self._variation.name} = {float(value):.6g}")
        try:
            found = check_map(self._variation.at(number(value)))
        except (NotASolidError, InputError) as error:
            return str(error)
        if found.orientation.sign != self._sign:
            return "det J has the other sign: on the way it vanishes"
        return None
