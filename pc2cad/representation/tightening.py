"""The loop of everything that is approximated: fit, see how far it is off, ask for less, again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from pc2cad.errors import ToleranceNotReachedError

Result = TypeVar("Result")

#: fits that are tried, and what each may use of what the one before would have needed
TRIES, EASE = 6, 0.8


@dataclass(frozen=True)
class Attempt(Generic[Result]):
    """What came of a fit; lengths in model units."""

    result: Result
    #: largest deviation from the equation, and the largest that is allowed
    deviation: float
    allowed: float


def tighten(
    attempt: Callable[[float], Attempt[Result]], target: float, what: str, tolerance: float
) -> Result:
    """Return the first result whose deviation is allowed, from fits that aim at ever less.

    `target` is what the first fit aims at; `what` deviates, in the words of a message. Raises
    ToleranceNotReachedError.
    """
    for _ in range(TRIES):
        found = attempt(target)
        if found.deviation <= found.allowed:
            return found.result
        target *= EASE * min(1.0, found.allowed / found.deviation)
    raise ToleranceNotReachedError(
        f"{what} by {found.deviation:.3g} from the equation where {tolerance:.3g} was asked; "
        "allow a larger --tolerance"
    )
