"""Channels: a section carried along a guide, with a wall, as one point equation M(u, v, w).

K = N + x·(R-N) + y·(Q-N) runs round the section; the wall is laid along NK, as the paper does, or
along the section's true normal (the paper, Fig. 7).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from math import hypot
from typing import Final

from pc2cad.channels.frames import Frame
from pc2cad.channels.layers import depth
from pc2cad.equation.point_equation import Domain, PointEquation, point_equation
from pc2cad.errors import InputError
from pc2cad.expression.breaks import find_breaks
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import (
    ONE,
    ZERO,
    Expr,
    Layout,
    Number,
    as_expr,
    call,
    number,
    piece_rows,
    pieces,
    symbol,
)

V: Final = symbol("v")
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
    factor = core + out / _length(x, y)
    return x * factor, y * factor


def _normal(x: Expr, y: Expr, core: Expr, out: Expr) -> tuple[Expr, Expr]:
    along, across = derivatives((x, y), "v")
    turning = _turning(x, y, along, across)
    if _is_polygon(x, y):
        nx, ny = _offsets(x, y, turning)
        return x * core + nx * out, y * core + ny * out
    _check_corners((x, y), along, across)
    factor = turning * out / _length(along, across)
    return x * core + across * factor, y * core - along * factor


def _is_polygon(x: Expr, y: Expr) -> bool:
    """Say whether both are piecewise linear in v, with corners at the same places."""
    return all(
        n.op == "pieces"
        and n.args[0] is V
        and n.payload == Layout(x.payload.breaks, 2, 0, True)
        and not any(c.symbols for c in n.args[1:])
        for n in (x, y)
    )


def _offsets(x: Expr, y: Expr, turning: int) -> tuple[Expr, Expr]:
    """Return the piecewise linear field that moves every side of a polygon out by 1."""
    breaks = x.payload.breaks
    speeds = [
        (evaluate(a[1], {}), evaluate(b[1], {}))
        for a, b in zip(piece_rows(x), piece_rows(y), strict=True)
    ]
    normals = [(turning * b / hypot(a, b), -turning * a / hypot(a, b)) for a, b in speeds]
    corners = []
    for (a, b), (c, d) in zip([normals[-1], *normals[:-1]], normals, strict=True):
        size = 1 + a * c + b * d
        if size < 1e-6:
            raise ChannelError("the polygon turns back on itself: its walls have no common corner")
        corners.append(((a + c) / size, (b + d) / size))
    following = [*corners[1:], corners[0]]
    widths = [float(q - p) for p, q in pairwise(breaks)]
    nx, ny = (
        pieces(
            V,
            breaks,
            tuple(
                (number(p[axis]), number((q[axis] - p[axis]) / h))
                for p, q, h in zip(corners, following, widths, strict=True)
            ),
            smoothness=0,
        )
        for axis in (0, 1)
    )
    return nx, ny


def _check_corners(section: tuple[Expr, Expr], along: Expr, across: Expr) -> None:
    """Raise ChannelError where the tangent of the section jumps."""
    for b in find_breaks(section)[1]:
        before, after = b.position * (1 - 1e-14) if b.position else 1.0, b.position % 1
        directions = []
        for v in (before, after):
            a, c = (evaluate(t, {"u": 0.381966, "v": v}) for t in (along, across))
            directions.append((a / hypot(a, c), c / hypot(a, c)))
        (a, c), (d, e) = directions
        if abs(a * e - c * d) > 1e-6 or a * d + c * e < 0:
            raise ChannelError(
                f"the section has a corner at v = {b.position:.6g}, where its normal jumps: round "
                "it, measure the wall radially, or take a polygon (whose walls meet in a mitre)"
            )


def _turning(x: Expr, y: Expr, along: Expr, across: Expr) -> int:
    """Return 1 where the section runs counter-clockwise about the guide, else -1."""
    place = {"u": 0.381966, "v": 0.618034}
    a, b, c, d = (evaluate(t, place) for t in (x, y, along, across))
    return 1 if a * d - b * c > 0 else -1


def _length(x: Expr, y: Expr) -> Expr:
    """Return √(x² + y²), a number where the normal form shows that it is one."""
    square = x**2 + y**2
    form = normal_form(square, largest=200)
    if form is not None and set(form) == {()}:
        square = number(form[()])
    return call("sqrt", square)
