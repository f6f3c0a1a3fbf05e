"""The solidity stage: whether the image nowhere covers itself, and how surely that is known.

Input: Analysis and the sign of det J (`orientation`). Output: Solidity. That det J keeps its sign
was the first question of docs/rooms/solidity.md; the second is whether the boundary meets itself
and winds once about every image.
"""

from __future__ import annotations

from dataclasses import dataclass

from pc2cad.domain.analysis import Analysis
from pc2cad.solidity.injectivity import check_injective
from pc2cad.solidity.self_intersection import FEW_PAIRS, MOST_PAIRS


@dataclass(frozen=True)
class Solidity:
    """The evidence that the map is injective inside its box."""

    #: inner images at which the boundary's winding number is 1
    images: int
    #: an overlap would be no deeper than this (model units)
    apart: float
    #: index of the outer shell in the boundary complex; the others are voids
    outer_shell: int
    #: a sentence where an overlap deeper than rounding is not excluded, or nothing
    warning: str = ""


def check_solidity(analysis: Analysis, sign: int, faces: bool = False) -> Solidity:
    """Return the evidence; raise NotASolidError (a subclass) where the image is no solid.

    Where `faces` are made of the map and compared themselves, what is no quick refusal is left to
    them (`embedding`).
    """
    injective = check_injective(analysis, sign, FEW_PAIRS if faces else MOST_PAIRS)
    return Solidity(injective.images, injective.apart, injective.outer_shell, injective.warning)
