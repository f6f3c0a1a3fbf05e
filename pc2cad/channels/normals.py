"""Normal and binormal of a guide's part: from a reference, turned, and across a mitre.

The normal NR comes from a reference by the metric operator, the binormal NQ by exit from the plane
(the paper, Fig. 6).
"""

from __future__ import annotations

from math import hypot
from typing import Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.channels import guide_functions
from pc2cad.channels.guides import Guide, Part
from pc2cad.equation.points import Combination, cross, dot, unit
from pc2cad.errors import InputError, NotASolidError
from pc2cad.expression.tree import ZERO, Expr, call, number

#: normal and binormal
Pair = tuple[Combination, Combination]

#: smallest sine of the angle between reference and tangent
LEAST_SINE: Final = 1e-3


class ReferenceAlongTangentError(NotASolidError):
    """The reference of a normal lies along the tangent: there is no normal plane direction."""


class FrameError(InputError):
    """A frame is asked for that does not exist."""


def from_reference(part: Part, towards: Combination) -> Pair:
    """Return normal and binormal: the metric operator takes the tangent out of the reference."""
    tangent = part.speed
    foot = towards - tangent * (dot(towards, tangent) / dot(tangent, tangent))
    normal = unit(foot)
    return normal, unit(cross(tangent, foot))


def turned(pair: Pair, angle: Expr) -> Pair:
    """Return the frame turned by an angle about the tangent."""
    if angle is ZERO:
        return pair
    c, s = call("cos", angle), call("sin", angle)
    e1, e2 = pair
    return e1 * c + e2 * s, e2 * c - e1 * s


def across(normal: Array, guide: Guide, index: int) -> Array:
    """Return the normal behind the mitre at the end of a part: mirrored and turned about."""
    plane = guide.parts[index].mitres[1]
    assert plane is not None
    following = guide.parts[(index + 1) % len(guide.parts)]
    before = guide_functions.at(guide.parts[index].tangent.coordinates, guide.limits(index)[1])
    after = guide_functions.at(
        following.tangent.coordinates, guide.limits((index + 1) % len(guide.parts))[0]
    )
    axis = np.cross(before, after)
    sine = float(np.linalg.norm(axis))
    axis = axis / sine
    cosine = float(before @ after)
    turned = normal * cosine + np.cross(axis, normal) * sine + axis * (axis @ normal) * (1 - cosine)
    return np.asarray(turned / hypot(*turned))


def mitred(guide: Guide, index: int, pair: Pair) -> Pair:
    """Return normal and binormal drawn along the tangent into the planes that cut the part."""
    part = guide.parts[index]
    low, high = guide.breaks[index], guide.breaks[index + 1]
    share = (guide_functions.U - number(low)) / number(high - low)
    ends = zip(part.mitres, guide.limits(index), (1 - share, share), strict=True)
    normal, binormal = pair
    for plane, place, weight in ends:
        if plane is None:
            continue
        # of the end alone: farther along a bent part the tangent may lie in the plane
        e1, e2, tangent = (
            float(guide_functions.at(e.coordinates, place) @ plane) for e in (*pair, part.tangent)
        )
        normal = normal - part.tangent * (weight * number(e1 / tangent))
        binormal = binormal - part.tangent * (weight * number(e2 / tangent))
    return normal, binormal
