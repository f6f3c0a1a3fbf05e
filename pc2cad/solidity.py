"""The solidity stage: whether the image is one solid, and how surely that is known.

Input: Analysis. Output: Solidity. Both questions of spec section 4 are asked:
does det J keep its sign (proved where the map is polynomial), and does the solid nowhere cover
itself (no contact of its boundary, winding numbers).
"""

from __future__ import annotations

from dataclasses import dataclass

from pc2cad.analysis import Analysis
from pc2cad.equation.identity import Verdict
from pc2cad.injectivity import check_injective


@dataclass(frozen=True)
class Solidity:
    """The evidence that the map is injective inside its box."""

    #: det J keeps its sign: PROVED, or UNDECIDED where it only did at every quadrature node
    determinant: Verdict
    #: inner images at which the boundary's winding number is 1
    images: int
    #: parts of the boundary that are further apart than this were told from touching (model units)
    apart: float
    #: index of the outer shell in the boundary complex; the others are voids
    outer_shell: int


def check_solidity(analysis: Analysis) -> Solidity:
    """Return the evidence; raise NotASolidError (a subclass) where the image is no solid."""
    injective = check_injective(analysis)
    return Solidity(analysis.determinant, injective.images, injective.apart, injective.outer_shell)
