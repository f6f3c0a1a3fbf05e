"""Design velocity: how fast every point of the solid moves as one parameter of M changes.

∂M/∂p at a fixed share of the way through the box, whose limits may depend on p, too. The derivative
is that of the trees; where the way to the trees asks for a value of p (a guide given by numbers, a
frame found by integration), it is the central difference of order 8 of M itself, at a fixed share
of the way through each piece where pieces begin elsewhere as p changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike

from pc2cad.arrays import Array
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import Mapping3
from pc2cad.equation.point_equation import PointEquation, over_unit_box
from pc2cad.equation.variation import Variation
from pc2cad.errors import InputError
from pc2cad.expression.breaks import find_breaks
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.end_roots import take_out_ends
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.simplification import simplified
from pc2cad.expression.tree import Expr, number, substitute, symbol

SYMBOLIC: Final = "derivative of the equation"
DIFFERENCES: Final = "difference of order 8 of the equation"
#: weights of the central difference of order 8 at the distances h, 2h, 3h and 4h, and of order 6
_EIGHTH: Final = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
_SIXTH: Final = (3 / 4, -3 / 20, 1 / 60)
#: where a difference is taken, in steps
STEPS: Final = (1, -1, 2, -2, 3, -3, 4, -4)
#: share of the part's size that a step of the difference moves its fastest point by
STEP: Final = 0.01
#: doubt at which no shorter step is tried
SETTLED: Final = 1e-11
#: distance of two places of a break that are one
SAME: Final = 1e-9
#: where the fastest point is looked for
LOOK: Final = np.array([0.03, 0.21, 0.38, 0.55, 0.79, 0.96])


class NotDifferentiableError(InputError):
    """A solid does not change smoothly with a parameter."""


class Velocity(Protocol):
    """∂M/∂p and its derivatives over the unit box, as `Mapping3.frame` gives M's."""

    how: str

    def frame(self, u: ArrayLike, v: ArrayLike, w: ArrayLike) -> list[Array]:
        """Return V, V_u, V_v and V_w, each of shape broadcast(u, v, w) + (3,)."""

    def doubt(self) -> float:
        """Return an estimate of the error of V relative to its largest value; 0: rounding."""


@dataclass(frozen=True)
class SymbolicVelocity:
    """The derivative of the trees."""

    map: Mapping3
    how: str = SYMBOLIC

    def frame(self, u: ArrayLike, v: ArrayLike, w: ArrayLike) -> list[Array]:
        """See Velocity.frame."""
        return self.map.frame(u, v, w)

    def doubt(self) -> float:
        """See Velocity.doubt."""
        return 0.0


@dataclass(frozen=True)
class DifferenceVelocity:
    """The central difference of M at p ± h, … p ± 4h."""

    #: at the places of `STEPS`
    maps: tuple[Mapping3 | _Shifted, ...]
    step: float
    how: str = DIFFERENCES

    def frame(self, u: ArrayLike, v: ArrayLike, w: ArrayLike) -> list[Array]:
        """See Velocity.frame."""
        frames = [mapping.frame(u, v, w) for mapping in self.maps]
        return [difference([frame[k] for frame in frames], self.step)[0] for k in range(4)]

    def doubt(self) -> float:
        """See Velocity.doubt: what the difference of order 6 leaves."""
        at = np.ix_(LOOK, LOOK, LOOK)
        points = [mapping.points(*at) for mapping in self.maps]
        fine, coarse = difference(points, self.step)
        return float(np.abs(fine - coarse).max() / max(np.abs(fine).max(), 1e-300))


def difference(values: Sequence[Array], step: float) -> tuple[Array, Array]:
    """Return the central differences of orders 8 and 6 of values at the places of `STEPS`."""
    found = []
    for weights in (_EIGHTH, _SIXTH):
        pairs = zip(weights, values[::2], values[1::2], strict=False)
        total = sum((c * (ahead - behind) for c, ahead, behind in pairs), np.zeros(1))
        found.append(np.asarray(total / step))
    return found[0], found[1]


def velocity(analysis: Analysis, variation: Variation) -> SymbolicVelocity | DifferenceVelocity:
    """Return the design velocity of a parameter; raise NotDifferentiableError."""
    if variation.coordinates is not None:
        along = derivatives(variation.coordinates, variation.name)
        return SymbolicVelocity(_local(analysis, at_its_value(variation, along)))
    step = _step(analysis, variation)
    found = _differences(analysis, variation, step)
    for shorter in (step / 4, step / 16):
        if found.doubt() <= SETTLED:
            break
        # too long a step leaves higher derivatives in, too short a one rounding
        found = min(found, _differences(analysis, variation, shorter), key=lambda x: x.doubt())
    return found


def at_its_value(variation: Variation, trees: tuple[Expr, ...], name: str = "") -> tuple[Expr, ...]:
    """Return derivatives at the parameter's value; raise NotDifferentiableError without one.

    `name` is that of its symbol, where it is not its own.
    """
    try:
        return substitute(trees, {name or variation.name: variation.bound})
    except InputError as error:
        raise NotDifferentiableError(
            f"there is no derivative with respect to {variation.name} = {variation.value:.6g}: "
            f"{error}"
        ) from error


def _differences(analysis: Analysis, variation: Variation, step: Fraction) -> DifferenceVelocity:
    places = [_at(variation, k * step) for k in STEPS]
    maps = [_local(analysis, _over_the_box(equation)) for equation in places]
    here = _breaks(_local(analysis, _over_the_box(_at(variation, Fraction(0)))))
    if _same(here, _breaks(maps[0])):
        return DifferenceVelocity(tuple(maps), float(step))
    # where pieces begin moves: a point stays at the same share of the way through its piece
    found = []
    for mapping in maps:
        there = _breaks(mapping)
        if [len(row) for row in there] != [len(row) for row in here]:
            raise NotDifferentiableError(
                f"there is no derivative with respect to {variation.name} = {variation.value:.6g}: "
                "M has other pieces beside it"
            )
        found.append(_Shifted(mapping, here, there))
    return DifferenceVelocity(tuple(found), float(step))


def _breaks(mapping: Mapping3) -> tuple[Array, ...]:
    """Return where pieces of M begin and end, per direction, 0 and 1 included."""
    rows = find_breaks(mapping.coordinates)
    return tuple(
        np.array([0.0, *(x.position for x in row if 0 < x.position < 1), 1.0]) for row in rows
    )


def _same(rows: Sequence[Array], others: Sequence[Array]) -> bool:
    return all(
        len(a) == len(b) and bool(np.abs(a - b).max() <= SAME)
        for a, b in zip(rows, others, strict=True)
    )


@dataclass(frozen=True, eq=False)
class _Shifted:
    """M at another value, at places whose breaks are those of the value itself."""

    mapping: Mapping3
    here: tuple[Array, ...]
    there: tuple[Array, ...]

    def points(self, u: ArrayLike, v: ArrayLike, w: ArrayLike) -> Array:
        """See Mapping3.points."""
        return self.mapping.points(*(place for place, _ in self._moved(u, v, w)))

    def frame(self, u: ArrayLike, v: ArrayLike, w: ArrayLike) -> list[Array]:
        """See Mapping3.frame."""
        moved = self._moved(u, v, w)
        points, *tangents = self.mapping.frame(*(place for place, _ in moved))
        pairs = zip(tangents, moved, strict=True)
        return [points, *(along * slope[..., None] for along, (_, slope) in pairs)]

    def _moved(self, *local: ArrayLike) -> list[tuple[Array, Array]]:
        found = []
        for x, here, there in zip(local, self.here, self.there, strict=True):
            at = np.asarray(x, dtype=float)
            piece = np.clip(np.searchsorted(here, at, side="right") - 1, 0, len(here) - 2)
            slopes = np.diff(there) / np.diff(here)
            found.append((np.interp(at, here, there), slopes[piece]))
        return found


def _at(variation: Variation, step: Fraction) -> PointEquation:
    value = Fraction(variation.value) + step
    try:
        return variation.at(number(value))
    except InputError as error:
        raise NotDifferentiableError(
            f"there is no derivative with respect to {variation.name}: at {float(value):.6g}, "
            f"{error}"
        ) from error


def _step(analysis: Analysis, variation: Variation) -> Fraction:
    """Return the step by which the fastest point moves a small share of the part's size."""
    at = np.ix_(LOOK, LOOK, LOOK)
    here = analysis.map.points(*at)
    step = Fraction(abs(variation.value) / 128 or 2.0**-7).limit_denominator(10**9)
    # four steps away, a length has still its sign
    longest = Fraction(abs(variation.value)) / 16 or Fraction(10**9)
    for _ in range(6):
        there = _local(analysis, _over_the_box(_at(variation, step))).points(*at)
        moved = float(np.abs(there - here).max()) / analysis.scale.size
        if moved == 0.0:
            return step
        if STEP / 4 < moved < 4 * STEP or (moved < STEP and step == longest):
            break
        step *= Fraction(min(max(STEP / moved, 1e-3), 10.0)).limit_denominator(1000)
        step = min(step, longest)
    return step


def _over_the_box(equation: PointEquation) -> tuple[Expr, ...]:
    """Return x, y and z with u, v and w from 0 to 1."""
    return substitute(equation.coordinates, over_unit_box(equation.domain))


def _local(analysis: Analysis, trees: tuple[Expr, ...]) -> Mapping3:
    """Return trees over the unit box in the local parameters of the analysed map."""
    own = analysis.map.parameters
    changed: dict[str, Expr] = {}
    for name, (low, high), tree in zip(PARAMETERS, analysis.equation.domain, own, strict=True):
        if tree != low + (high - low) * symbol(name):
            changed[name] = (tree - low) / (high - low)
    x, y, z = take_out_ends(simplified(substitute(trees, changed)))
    return Mapping3((x, y, z), own)
