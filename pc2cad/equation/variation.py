"""How a point equation changes with one of its parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr

if TYPE_CHECKING:
    from pc2cad.equation.point_equation import PointEquation


@dataclass(frozen=True, eq=False)
class Variation:
    """One parameter of a point equation, left free; u, v and w run from 0 to 1 whatever it is."""

    name: str
    bound: Expr
    #: x, y and z over the unit box with the parameter free; None where the way to them asks for its
    #: value, as a guide does that is given by numbers
    coordinates: tuple[Expr, Expr, Expr] | None
    #: the equation at another value, inside of the parameter's range or not
    at: Callable[[Expr], PointEquation]

    @property
    def value(self) -> float:
        """The parameter's value."""
        return evaluate(self.bound, {})
