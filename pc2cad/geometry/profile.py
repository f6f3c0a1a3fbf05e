"""Which splines a part may contain."""

from __future__ import annotations

from dataclasses import dataclass

from pc2cad.errors import InputError

#: the kernel's largest degree of a Bézier or B-spline
LARGEST_DEGREE = 25
#: what the receiver of a part takes: compact, the fewest poles; cubic, no degree above 3
PROFILES = ("compact", "cubic")
#: the degrees that fits choose from unless told otherwise: from one to the next, poles fall by a
#: third at first and by a tenth at last
_USUAL_DEGREES = (3, 5, 7)
#: beyond this, the kernel's adaptors, which go by powers within a span, lose what a fit has gained:
#: of a part of size 20 they leave 3e-13 at degree 13, 1e-10 at 16, 4e-3 at 25
LARGEST_FIT = 13


@dataclass(frozen=True)
class SplineProfile:
    """The degrees of splines, and whether they may be rational."""

    #: ascending degrees that a fit may choose from: that which needs the fewest poles
    degrees: tuple[int, ...] = _USUAL_DEGREES
    #: polynomials up to this degree keep their exact form
    exact: int = LARGEST_DEGREE
    rational: bool = True


COMPACT = SplineProfile()


def spline_profile(
    degree: int | None = None, max_degree: int | None = None, profile: str = "compact"
) -> SplineProfile:
    """Return the profile of the options; raise InputError for a combination that has no meaning.

    `degree` fixes the degree of fits, `max_degree` lets them choose among the odd degrees from 3
    up to it. Both leave exact forms as they are; the profile "cubic" does not.
    """
    if profile not in PROFILES:
        raise InputError(f"--profile {profile}: choose one of {', '.join(PROFILES)}")
    if degree is not None and max_degree is not None:
        raise InputError("--degree fixes the degree that --max-degree lets fits choose: give one")
    largest = 3 if profile == "cubic" else LARGEST_FIT
    for option, least, value in (("--degree", 2, degree), ("--max-degree", 3, max_degree)):
        if value is not None and not least <= value <= largest:
            raise InputError(
                f"{option} {value}: from {least} to {largest}"
                + (" in the cubic profile" if profile == "cubic" else "")
            )
    if degree is not None:
        degrees: tuple[int, ...] = (degree,)
    elif max_degree is not None:
        degrees = tuple(range(3, max_degree + 1, 2))
    else:
        degrees = tuple(d for d in _USUAL_DEGREES if d <= largest)
    if profile == "cubic":
        return SplineProfile(degrees, 3, rational=False)
    return SplineProfile(degrees)
