"""Which splines a part may contain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from pc2cad.options import DEFAULTS, CompileOptions

if TYPE_CHECKING:
    from pc2cad.geometry.splines.arcs import Wave

#: the kernel's largest degree of a Bézier or B-spline
LARGEST_DEGREE = 25
#: the degrees that fits choose from unless told otherwise: from one to the next, poles fall by a
#: third at first and by a tenth at last
_USUAL_DEGREES = (3, 5, 7)


@dataclass(frozen=True)
class SplineProfile:
    """The degrees of splines, and whether they may be rational."""

    #: ascending degrees that a fit may choose from: that which needs the fewest poles
    degrees: tuple[int, ...] = _USUAL_DEGREES
    #: polynomials up to this degree keep their exact form
    exact: int = LARGEST_DEGREE
    rational: bool = True
    #: fits may run along a wave in a whole turn at once, which is rational
    turns: bool = True

    def allows(self, wave: Wave) -> bool:
        """Say whether waves may keep their exact form, of twice their order."""
        return self.rational and 2 * wave.order <= self.exact


COMPACT = SplineProfile()


def spline_profile(options: CompileOptions = DEFAULTS) -> SplineProfile:
    """Return the profile that options ask for."""
    cubic = options.profile == "cubic"
    if options.degree is not None:
        degrees: tuple[int, ...] = (options.degree,)
    elif options.max_degree is not None:
        degrees = tuple(range(3, options.max_degree + 1, 2))
    else:
        degrees = tuple(d for d in _USUAL_DEGREES if d <= 3 or not cubic)
    if cubic:
        return SplineProfile(degrees, 3, rational=False)
    return SplineProfile(degrees, turns=options.profile != "polynomial")
