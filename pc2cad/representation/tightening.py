"""The loop of everything that is approximated: fit, see how far it is off, aim better, again.

A fit that is a little off aims at less. A first one that is off by several times what is allowed is
looked at in more sections, and aims at the same. One that is off by far more than it aimed at has
not seen something, a needle or a slanting front; then the place where it is worst is looked at
closely, and sections are taken nearer to one another, while the aim stays what it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from pc2cad.domain.restrictions import Piece
from pc2cad.errors import ToleranceNotReachedError

Result = TypeVar("Result")

#: fits that are tried, and what each may use of what the one before would have needed
TRIES, EASE = 8, 0.8
#: a first fit that is off by more than so many times what is allowed has seen too few sections
SELDOM = 2.0
#: a fit that is off by more than so many times its aim has not seen what it is off by
UNSEEN = 16.0
#: how many times nearer sections come to one another, in one step and in the end
DENSER, DENSEST = 4, 16
#: places that are nearer to one another (of a direction of length 1) are looked at together
NEAR = 1e-6


@dataclass(frozen=True)
class Aim:
    """What a fit aims at."""

    #: the distance (model units) that one direction may be off by
    target: float
    #: how many times as many sections as at first
    density: int = 1
    #: places that are looked at closely, by pieces of directions, ascending, in their parameters
    focus: Mapping[Piece, tuple[float, ...]] = field(default_factory=dict)

    def after(self, deviation: float, allowed: float, worst: Mapping[Piece, float]) -> Aim:
        """Return what to aim at after a fit that was off by more than is allowed."""
        share = EASE * min(1.0, allowed / deviation)
        new = {
            piece: place
            for piece, place in worst.items()
            if all(abs(place - known) > NEAR for known in self.focus.get(piece, ()))
        }
        seen = deviation <= UNSEEN * self.target or not worst
        first = self.density == 1 and not self.focus
        if seen and worst and first and deviation > SELDOM * allowed:
            return Aim(self.target, DENSER)
        if seen or not (new or self.density < DENSEST):
            return Aim(max(share, 1 / UNSEEN) * self.target, self.density, self.focus)
        focus = {
            piece: tuple(
                sorted({*self.focus.get(piece, ()), *([new[piece]] if piece in new else [])})
            )
            for piece in {*self.focus, *new}
        }
        # one look at the place itself, before all others are looked at more closely too
        return Aim(self.target, min(DENSER * self.density, DENSEST) if self.focus else 1, focus)


@dataclass(frozen=True)
class Attempt(Generic[Result]):
    """What came of a fit; lengths in model units."""

    result: Result
    #: largest deviation from the equation, and the largest that is allowed
    deviation: float
    allowed: float
    #: where it was seen to be largest, by pieces of directions, and in words when it is asked for
    worst: Mapping[Piece, float] = field(default_factory=dict)
    where: Callable[[], str] = str


def tighten(
    attempt: Callable[[Aim], Attempt[Result]], target: float, what: str, tolerance: float
) -> Result:
    """Return the first result whose deviation is allowed, from fits that aim ever better.

    `target` is what the first fit aims at; `what` deviates, in the words of a message. Raises
    ToleranceNotReachedError.
    """
    aim = Aim(target)
    for _ in range(TRIES):
        found = attempt(aim)
        if found.deviation <= found.allowed:
            return found.result
        aim = aim.after(found.deviation, found.allowed, found.worst)
    where = found.where()
    place = f", most {where}" if where else ""
    raise ToleranceNotReachedError(
        f"{what} by {found.deviation:.3g} from the equation where {tolerance:.3g} was asked{place}"
        "; allow a larger --tolerance"
    )
