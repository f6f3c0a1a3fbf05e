"""Fourier series of two angles as one node: Σ c cos(mθ - kφ) + s sin(mθ - kφ), m and k whole.

Hundreds of terms written out are slow in every respect. One node holds them all: its derivatives
are such nodes again, with the coefficients times m and k; that it repeats, or what is left of it
where an angle is a quarter turn, follows from the whole numbers alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any, Final
from weakref import WeakValueDictionary

from pc2cad.expression.budget import spend
from pc2cad.expression.normal_form import split_turns
from pc2cad.expression.tree import (
    PI,
    ZERO,
    Expr,
    Number,
    ValueDomainError,
    as_expr,
    call,
    intern,
    number,
)

#: whole number m, whole number k, coefficient of the cosine, of the sine
Wave = tuple[int, int, Fraction, Fraction]
#: a series of no more waves than this, a constant apart, is written out: it may be exact
FEWEST: Final = 3
#: the largest m, and the largest k over their common factor
LARGEST_WAVE: Final = 200
#: waves of one series
MOST_WAVES: Final = 4000


_interned: WeakValueDictionary[tuple[Wave, ...], Waves] = WeakValueDictionary()


@dataclass(frozen=True, eq=False, repr=False)
class Waves:
    """The payload of a ``fourier`` node: its waves, ascending, each (m, k) once.

    m ≥ 0, and k > 0 where m = 0; no wave has two zeros for coefficients. Equal ones are one object
    (see `waves`).
    """

    rows: tuple[Wave, ...]

    def __repr__(self) -> str:
        # what nodes are ranked by
        return ";".join(f"{m},{k}:{c},{s}" for m, k, c, s in self.rows)

    def __reduce__(self) -> tuple[Callable[..., Waves], tuple[Any, ...]]:
        return waves, (self.rows,)

    def rebuilt(self, args: tuple[Expr, ...]) -> Expr:
        """Return the series at two angles (see `fourier`)."""
        return fourier(self, *args)

    def value(self, theta: float, phi: float) -> float:
        """Return the value at two angles."""
        angles = ((m * theta - k * phi, c, s) for m, k, c, s in self.rows)
        return math.fsum(float(c) * math.cos(x) + float(s) * math.sin(x) for x, c, s in angles)

    def partial(self, axis: int) -> Waves:
        """Return the derivative in θ (0) or φ (1)."""
        rows = []
        for m, k, c, s in self.rows:
            factor = -k if axis else m
            rows.append((m, k, factor * s, -factor * c))
        return waves(rows)

    def moved(self, axis: int, quarters: Fraction) -> Waves | None:
        """Return the same with so many quarter turns added to an angle; None if not by algebra."""
        rows = []
        for m, k, c, s in self.rows:
            turned = (-k if axis else m) * quarters
            if turned.denominator != 1:
                return None
            for _ in range(int(turned) % 4):
                # cos(x + π/2) = -sin x, sin(x + π/2) = cos x
                c, s = s, -c
            rows.append((m, k, c, s))
        return waves(rows)

    def mirrored(self, axis: int) -> Waves:
        """Return the same with an angle's sign changed."""
        return waves((-m, k, c, s) if axis == 0 else (m, -k, c, s) for m, k, c, s in self.rows)

    def fixed(self, axis: int) -> Waves:
        """Return the same with an angle at 0."""
        return waves((0, k, c, s) if axis == 0 else (m, 0, c, s) for m, k, c, s in self.rows)


def waves(rows: Iterable[Wave]) -> Waves:
    """Return waves in their order, those of one angle added up and none of them zero."""
    found: dict[tuple[int, int], tuple[Fraction, Fraction]] = {}
    for m, k, c, s in rows:
        if m < 0 or (m == 0 and k < 0):
            m, k, s = -m, -k, -s  # cos(-x) = cos x, sin(-x) = -sin x
        before = found.get((m, k), (Fraction(0), Fraction(0)))
        found[m, k] = before[0] + c, before[1] + s
    if (0, 0) in found:
        found[0, 0] = found[0, 0][0], Fraction(0)
    key = tuple((m, k, c, s) for (m, k), (c, s) in sorted(found.items()) if c or s)
    return _interned.setdefault(key, Waves(key))


def series(
    periods: int,
    cos: Iterable[tuple[int, int, Fraction]],
    sin: Iterable[tuple[int, int, Fraction]],
) -> Waves:
    """Return Σ c cos(mθ - n·periods·φ) + Σ s sin(mθ - n·periods·φ) of rows (m, n, c), (m, n, s).

    Raises ValueDomainError for waves or periods beyond what is ever worked with.
    """
    if not 1 <= periods <= LARGEST_WAVE:
        raise ValueDomainError(f"periods are 1 to {LARGEST_WAVE}, and {periods} were given")
    rows: list[Wave] = []
    for table, of_cosine in ((cos, True), (sin, False)):
        for m, n, c in table:
            if max(abs(m), abs(n)) > LARGEST_WAVE:
                raise ValueDomainError(
                    f"the wave m = {m}, n = {n} is beyond {LARGEST_WAVE}: no wave is that short"
                )
            value = number(c).payload
            rows.append((m, n * periods, value * of_cosine, value * (not of_cosine)))
            if len(rows) > MOST_WAVES:
                raise ValueDomainError(f"a series has at most {MOST_WAVES} waves")
    return waves(rows)


@dataclass(frozen=True, eq=False)
class Series:
    """A function of two angles θ and φ (radians); see `fourier`."""

    waves: Waves
    #: scalars that it takes
    arity = 2

    def __call__(self, theta: Expr | Number, phi: Expr | Number) -> Expr:
        """Return the series at two angles."""
        return fourier(self.waves, as_expr(theta), as_expr(phi))


def fourier(payload: Waves, theta: Expr, phi: Expr) -> Expr:
    """Return the series at two angles (radians), in as few waves and angles as it needs.

    Quarter turns that all waves take whole are left out, an angle that no wave depends on is 0,
    and a series of up to `FEWEST` waves is written out.
    """
    angles = [theta, phi]
    for axis in (0, 1):
        payload, angles[axis] = _folded(payload, axis, angles[axis])
    frequencies = [{row[axis] for row in payload.rows} - {0} for axis in (0, 1)]
    angles = [angle if used else ZERO for angle, used in zip(angles, frequencies, strict=True)]
    if sum(1 for m, k, _, _ in payload.rows if m or k) <= FEWEST:
        return written_out(payload, angles[0], angles[1])
    spend(4 * len(payload.rows))
    return intern("fourier", tuple(angles), payload)


def _folded(payload: Waves, axis: int, angle: Expr) -> tuple[Waves, Expr]:
    """Return the waves and what is left of an angle: quarter turns and its sign are taken out."""
    turns, angle = split_turns(angle)
    moved = payload.moved(axis, 2 * turns) if turns else payload
    if moved is None:
        return payload, angle + number(turns % 2) * PI
    payload = moved
    if angle.op == "neg":
        payload, angle = payload.mirrored(axis), angle.args[0]
    return (payload.fixed(axis), ZERO) if angle is ZERO else (payload, angle)


def written_out(payload: Waves, theta: Expr, phi: Expr) -> Expr:
    """Return the sum as a tree of sines and cosines."""
    total = ZERO
    for m, k, c, s in payload.rows:
        angle = m * theta - k * phi
        for coefficient, name in ((c, "cos"), (s, "sin")):
            if coefficient:
                total = total + number(coefficient) * call(name, angle)
    return total


@lru_cache(maxsize=512)
def partials(payload: Waves, theta: Expr, phi: Expr) -> tuple[Expr, Expr]:
    """Return the derivatives of the series in its two angles."""
    return fourier(payload.partial(0), theta, phi), fourier(payload.partial(1), theta, phi)
