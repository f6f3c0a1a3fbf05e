"""How a point equation changes with one of its parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
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
    #: limits of u, v and w with the parameter free
    domain: tuple[tuple[Expr, Expr], ...] = ()
    #: components of fields that may depend on it, by name, in u, v, w, x, y, z and the parameter
    fields: Mapping[str, tuple[Expr, ...]] = field(default_factory=dict)

    @property
    def value(self) -> float:
        """The parameter's value."""
        return evaluate(self.bound, {})
