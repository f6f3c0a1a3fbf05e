"""Layers: several walls one on another, as pieces of w.

Each layer has the same share of w. Between two of them M has a crease, so that the box falls into
cells there, and the part into solids that share those cells' faces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction

from pc2cad.equation.point_equation import LayersError
from pc2cad.expression.tree import ZERO, Expr, number, pieces


def depth(thicknesses: Sequence[Expr]) -> Callable[[Expr], Expr]:
    """Return the thickness of all that lies below w, as a function of w in [0, 1].

    Layer i takes w from i/n to (i+1)/n. A thickness may depend on u and v. Raises LayersError.
    """
    count = len(thicknesses)
    if count < 2:
        raise LayersError(f"layers are two or more, and here are {count}")
    for thickness in thicknesses:
        if "w" in thickness.symbols:
            raise LayersError("the thickness of a layer may depend on u and v, not on w")
    below = [ZERO]
    for thickness in thicknesses:
        below.append(below[-1] + thickness)
    breaks = tuple(number(Fraction(i, count)).payload for i in range(count + 1))
    rows = tuple(
        (low, thickness * count) for low, thickness in zip(below, thicknesses, strict=False)
    )
    return lambda w: pieces(w, breaks, rows, smoothness=0, closed=False)
