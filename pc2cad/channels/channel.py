"""Channels: a section carried along a guide, with a wall, as one point equation M(u, v, w).

K = N + x·(R-N) + y·(Q-N) runs round the section; the wall is laid along NK, as the paper does, or
along the section's true normal (the paper, Fig. 7).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Final

from pc2cad.channels.frames import Frame
from pc2cad.channels.layers import depth
from pc2cad.channels.outward import length, outward
from pc2cad.equation.point_equation import Domain, PointEquation, point_equation
from pc2cad.errors import InputError
from pc2cad.expression.tree import (
    ONE,
    ZERO,
    Expr,
    Number,
    as_expr,
    number,
    pieces,
    symbol,
)

W: Final = symbol("w")
#: side of the wall -> the w at which it is the section K itself
SIDES: Final = {"inside": ONE, "centred": number(Fraction(1, 2)), "outside": ZERO}
MEASURES: Final = ("radial", "normal")
#: a thickness, or the thicknesses of named layers from the inside out
Wall = Expr | Number | Mapping[str, Expr | Number | None]


class ChannelError(InputError):
    """A channel is asked for that has no wall or no section."""


def channel(
    frame: Frame,
    section: Sequence[Expr | Number],
    wall: Wall | None = None,
    side: str | None = None,
    measured: str = "radial",
    domain: Domain | None = None,
    name: str = "channel",
    units: str = "mm",
) -> PointEquation:
    """Return the point equation of a channel.

    `section` is (x, y) along the frame's normal and binormal, functions of v (once round for v
    from 0 to 1) that may change with u. `wall` is the thickness, a number or a function of u and
    v; None fills the section (w = 0 is the guide then). Named thicknesses, from the inside out,
    are layers: one part of several solids; where the first one is None it fills the section, and
    the others lie on it. A wall is laid ``inside``, ``outside`` or ``centred`` (the default) on
    the section, and measured ``radial`` from the guide (the paper) or along the true ``normal`` of
    the section. Raises ChannelError.
    """
    x, y = (as_expr(c) for c in section)
    if not (x.symbols | y.symbols) <= {"u", "v"} or "v" not in x.symbols | y.symbols:
        raise ChannelError("the section of a channel is a function of v, and of u if it changes")
    if side is not None and side not in SIDES:
        raise ChannelError(f"the side of the wall is one of {', '.join(SIDES)}, not '{side}'")
    if measured not in MEASURES:
        raise ChannelError(f"a wall is measured {' or '.join(MEASURES)}, not '{measured}'")
    core, out = _laid(wall, side)
    if out is ZERO:
        p, q = x * core, y * core
    else:
        p, q = (_radial if measured == "radial" else _normal)(x, y, core, out)
    M = frame.N + frame.normal * p + frame.binormal * q
    words = f"{frame.words}; guide: {frame.guide.words}"
    equation = point_equation(frame.shifted(M), domain, name=name, units=units)
    equation = replace(equation, guide=frame.N.coordinates, frame=words)
    return equation.layered(tuple(wall)) if isinstance(wall, Mapping) else equation


def _laid(wall: Wall | None, side: str | None) -> tuple[Expr, Expr]:
    """Return how much of the section is filled at w, and how far beyond it M lies there."""
    if wall is None:
        return W, ZERO
    if not isinstance(wall, Mapping):
        thickness = as_expr(wall)
        if not thickness.symbols <= {"u", "v"}:
            raise ChannelError("the thickness of a wall depends on u and v alone")
        return ONE, thickness * (W - SIDES[side or "centred"])
    first, *others = wall.values()
    if any(thickness is None for thickness in others):
        raise ChannelError("only the first layer can fill the section, the others need a thickness")
    filled = first is None
    if filled and side not in (None, "outside"):
        raise ChannelError("layers on a filled section lie outside it")
    given = [ZERO if thickness is None else as_expr(thickness) for thickness in wall.values()]
    below = depth(given)
    if not filled:
        return ONE, below(W) - SIDES[side or "centred"] * below(ONE)
    count = len(given)
    breaks = (Fraction(0), Fraction(1, count), Fraction(1))
    core = pieces(W, breaks, ((ZERO, number(count)), (ONE, ZERO)), smoothness=0, closed=False)
    return core, below(W)


def _radial(x: Expr, y: Expr, core: Expr, out: Expr) -> tuple[Expr, Expr]:
    factor = core + out / length(x, y)
    return x * factor, y * factor


def _normal(x: Expr, y: Expr, core: Expr, out: Expr) -> tuple[Expr, Expr]:
    nx, ny = outward((x, y))
    return x * core + nx * out, y * core + ny * out
