"""Trees that are trigonometric polynomials in one parameter: exact rational splines.

With s = tan(θ/2), cos θ = (1-s²)/(1+s²) and sin θ = 2s/(1+s²): a trigonometric polynomial of order
k is a polynomial of degree 2k in s over (1+s²)^k. The point set is exact, the speed along it is
that of s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil

import numpy as np
from numpy.typing import NDArray

from pc2cad.equation.calculus import derivatives
from pc2cad.equation.scalar import evaluate
from pc2cad.equation.tree import Expr, walk

Array = NDArray[np.float64]

LARGEST_ORDER = 6
#: no arc is longer: a quarter of a turn of the base angle
LONGEST_ARC = np.pi / 2


@dataclass(frozen=True)
class Wave:
    """Trigonometric polynomials of an order in one angle, which runs through `turn` radians."""

    turn: float
    order: int

    @property
    def arcs(self) -> int:
        """Number of rational pieces."""
        return max(1, ceil(abs(self.turn) / LONGEST_ARC - 1e-9))

    def local(self, x: Array) -> Array:
        """Return the parameter in [0, 1] at a spline parameter in [0, 1]."""
        arc, s = self._half_tangent(x)
        angle = (arc + 0.5) * abs(self.turn) / self.arcs + 2 * np.arctan(s)
        exact = (x * self.arcs == np.rint(x * self.arcs)) * 1.0
        return np.asarray(exact * x + (1 - exact) * angle / abs(self.turn))

    def weight(self, x: Array) -> Array:
        """Return the common denominator there, 1 at the ends of the arcs."""
        _, s = self._half_tangent(x)
        return np.asarray(((1 + s * s) / (1 + self._limit**2)) ** self.order)

    @property
    def _limit(self) -> float:
        return float(np.tan(abs(self.turn) / self.arcs / 4))

    def _half_tangent(self, x: Array) -> tuple[Array, Array]:
        arc = np.clip(np.floor(x * self.arcs), 0, self.arcs - 1)
        return arc, self._limit * (2 * (x * self.arcs - arc) - 1)


def wave_in(roots: Sequence[Expr], name: str) -> Wave | None:
    """Return the wave of trees that are trigonometric polynomials in one symbol on [0, 1].

    None where they are not, or of a larger order than `LARGEST_ORDER`.
    """
    slopes: dict[Expr, float] = {}
    for node in walk(tuple(roots)):
        if node.op in ("sin", "cos") and name in node.symbols:
            slope = _slope(node.args[0], name)
            if slope is None:
                return None
            slopes[node] = abs(slope)
    if not slopes:
        return None
    base = _common(list(slopes.values()))
    if base is None:
        return None
    orders: dict[Expr, int | None] = {}
    for node in walk(tuple(roots)):
        if name not in node.symbols:
            orders[node] = 0
        elif node in slopes:
            orders[node] = round(slopes[node] / base)
        else:
            orders[node] = _order(node, [orders[arg] for arg in node.args])
    found = [orders[root] for root in roots]
    known = [order for order in found if order is not None]
    if len(known) < len(found) or not 0 < max(known) <= LARGEST_ORDER:
        return None
    return Wave(base, max(known))


def _slope(argument: Expr, name: str) -> float | None:
    """Return the constant derivative of an angle, None where it is not constant."""
    (slope,) = derivatives((argument,), name)
    return None if slope.symbols else evaluate(slope, {})


def _common(slopes: list[float]) -> float | None:
    """Return the largest number of which all slopes are whole multiples (up to LARGEST_ORDER)."""
    least = min(slopes)
    if not least > 0:
        return None
    ratios = [Fraction(slope / least).limit_denominator(LARGEST_ORDER) for slope in slopes]
    if any(abs(float(r) * least - s) > 1e-12 * s for r, s in zip(ratios, slopes, strict=True)):
        return None
    return least / float(np.lcm.reduce([r.denominator for r in ratios]))


def _order(node: Expr, orders: list[int | None]) -> int | None:
    known = [order for order in orders if order is not None]
    if len(known) < len(orders):
        return None
    if node.op in ("add", "neg"):
        return max(known)
    if node.op == "mul":
        return sum(known)
    if node.op == "div" and known[1] == 0:
        return known[0]
    if node.op == "pow" and node.args[1].op == "number":
        exponent = node.args[1].payload
        whole = exponent.denominator == 1 and 0 < exponent <= LARGEST_ORDER
        return known[0] * int(exponent) if whole else None
    return None
