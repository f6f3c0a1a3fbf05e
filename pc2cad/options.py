"""What a user asks of a compilation, checked in one place."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pc2cad.errors import InputError

#: what the receiver of a part takes: compact, the fewest poles; polynomial, rational splines only
#: where they are exact; cubic, no degree above 3
PROFILES = ("compact", "polynomial", "cubic")
#: beyond this, the kernel's adaptors, which go by powers within a span, lose what a fit has gained:
#: of a part of size 20 they leave 3e-13 at degree 13, 1e-10 at 16, 4e-3 at 25
LARGEST_FIT = 13


@dataclass(frozen=True)
class CompileOptions:
    """How close a part has to come to its equation, and in which splines.

    `degree` fixes the degree of fits, `max_degree` lets them choose among the odd degrees from 3
    up to it. Both leave exact forms as they are; the profile "cubic" does not. Raises InputError
    for a value, or a combination, that has no meaning.
    """

    #: largest distance of a face from the equation (model units); None: see `resolve_tolerance`
    tolerance: float | None = None
    degree: int | None = None
    max_degree: int | None = None
    profile: str = "compact"

    def __post_init__(self) -> None:
        if self.tolerance is not None:
            self._check_tolerance(self.tolerance)
        if self.profile not in PROFILES:
            raise InputError(f"--profile {self.profile}: choose one of {', '.join(PROFILES)}")
        if self.degree is not None and self.max_degree is not None:
            raise InputError(
                "--degree fixes the degree that --max-degree lets fits choose: give one"
            )
        self._check_degree("--degree", 2, self.degree)
        self._check_degree("--max-degree", 3, self.max_degree)

    def _check_tolerance(self, tolerance: float) -> None:
        try:
            positive = math.isfinite(tolerance) and tolerance > 0
        except (TypeError, OverflowError):
            positive = False
        if not positive:
            raise InputError(f"the tolerance must be a positive length, not {tolerance}")

    def _check_degree(self, option: str, least: int, value: int | None) -> None:
        largest = 3 if self.profile == "cubic" else LARGEST_FIT
        if value is not None and not least <= value <= largest:
            raise InputError(
                f"{option} {value}: from {least} to {largest}"
                + (" in the cubic profile" if self.profile == "cubic" else "")
            )


#: fits of the fewest poles, within the default tolerance
DEFAULTS = CompileOptions()
