"""Point equations that differ in the values of some parameters: one tree for all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pc2cad.expression.tree import Expr


@dataclass(frozen=True, eq=False)
class Family:
    """A point equation with some of its parameters left free."""

    name: str
    #: the free parameters, and the values of the others
    names: tuple[str, ...]
    fixed: Mapping[str, Expr]
    #: x, y and z over the unit box: trees of u, v, w and the free parameters
    coordinates: tuple[Expr, Expr, Expr]
    #: limits of u, v and w, trees of the free parameters
    domain: tuple[tuple[Expr, Expr], ...]
