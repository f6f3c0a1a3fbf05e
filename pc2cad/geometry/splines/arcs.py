"""Trigonometric polynomials of one angle, and the arcs in which they are rational.

With s = tan(θ/2), cos θ = (1-s²)/(1+s²) and sin θ = 2s/(1+s²): a trigonometric polynomial of order
k is a polynomial of degree 2k in s over (1+s²)^k. A direction is cut into equal arcs, on each of
which tan((θ - θ_m)/2) is linear in its parameter. The point set is exact, the speed along it is
that of s.

Or it is one arc, over which tan((θ - θ_m)/2n) is linear: exp(iθ) is the n-th power of exp(iθ/n), so
degrees are n times as high, and nowhere is there a knot. A whole circle is one of degree 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.angle_multiples import common_unit, ratio
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, walk
from pc2cad.geometry.recognition.separable_form import LARGEST_ORDER

#: arcs are no longer than this: a quarter turn, and half of it where weights would spread too far
LONGEST_ARC = np.pi / 2
MODEST_ORDER = 5
#: nor are the parts of a single one: there a weight is half of what it is at the ends
LONGEST_PART = 2 * np.pi / 3
#: angles that differ by less than this share are one, but for rounding
SAME_ANGLE = 1e-13


@dataclass(frozen=True)
class Arcs:
    """A direction run through in equal arcs of an angle that grows by `extent` radians over it."""

    extent: float
    count: int
    #: n, where the tangent of the 2n-th part of an arc's angle is linear in its parameter
    parts: int = 1

    @property
    def quarter(self) -> float:
        """A quarter of the n-th part of one arc's angle (radians)."""
        return self.extent / self.count / self.parts / 4

    @property
    def tangent(self) -> float:
        """Tangent of that: how far an arc's own parameter runs either way."""
        return float(np.tan(self.quarter))

    def _split(self, x: Array) -> tuple[Array, Array]:
        """Return the arc that each x lies on and its place there, from -1 to 1."""
        arc = np.clip(np.floor(np.asarray(x) * self.count), 0, self.count - 1)
        return arc, 2 * (x * self.count - arc) - 1

    def places(self, x: Array) -> Array:
        """Return the equation's own local parameter at x."""
        arc, y = self._split(x)
        turned = np.arctan(self.tangent * y) / (2 * self.quarter)
        return np.asarray((arc + 0.5 + turned) / self.count)

    def weight(self, x: Array) -> Array:
        """Return the denominator of order 1 at x: 1 at the ends of each arc."""
        _, y = self._split(x)
        square = self.tangent**2
        return np.asarray(((1 + square * y * y) / (1 + square)) ** self.parts)

    def degree(self, order: int) -> int:
        """Return the degree of numerators and denominators of trigonometric polynomials."""
        return 2 * order * self.parts

    @cached_property
    def points(self) -> Array:
        """The ends of the arcs."""
        return np.arange(self.count + 1) / self.count


@dataclass(frozen=True)
class Wave:
    """Trigonometric polynomials of an order in one angle that runs through `extent` radians."""

    extent: float
    order: int

    @property
    def arcs(self) -> Arcs:
        """The arcs in which these are rational with weights that are not spread too far."""
        longest = LONGEST_ARC if self.order <= MODEST_ORDER else LONGEST_ARC / 2
        return Arcs(self.extent, _count(self.extent, longest))

    @property
    def single_arc(self) -> Arcs:
        """The one arc over which these are rational without a knot."""
        return Arcs(self.extent, 1, _count(self.extent, LONGEST_PART))


def _count(extent: float, longest: float) -> int:
    return max(1, int(np.ceil(extent / longest - 1e-9)))


def wave_in(roots: Sequence[Expr], name: str) -> Wave | None:
    """Return the wave of trees that are trigonometric polynomials in one symbol on [0, 1].

    Their coefficients may be any functions of the other symbols. None where they are not, or of a
    larger order than `LARGEST_ORDER`.
    """
    waves = [n for n in walk(tuple(roots)) if n.op in ("sin", "cos") and name in n.symbols]
    slopes = [derivatives((node.args[0],), name)[0] for node in waves]
    if not slopes or any(slope.symbols for slope in slopes):
        return None
    unit = common_unit(slopes, LARGEST_ORDER)
    multiples = [None if unit is None else ratio(slope, unit) for slope in slopes]
    if unit is None or None in multiples:
        return None
    known = {node: abs(int(m)) for node, m in zip(waves, multiples, strict=True) if m is not None}
    orders: dict[Expr, int | None] = {}
    for node in walk(tuple(roots)):
        if name not in node.symbols:
            orders[node] = 0
        elif node in known:
            orders[node] = known[node]
        else:
            orders[node] = _order(node, [orders[arg] for arg in node.args])
    found = [orders[root] for root in roots]
    order = max((k for k in found if k is not None), default=0)
    if None in found or not 0 < order <= LARGEST_ORDER:
        return None
    return Wave(abs(evaluate(unit, {})), order)


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
