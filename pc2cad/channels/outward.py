"""The outward normal of a section in its plane: the direction in which an even wall is laid.

Of a smooth curve it is (y', -x') over its length, turned outwards (the paper, Fig. 7). Of a polygon
it is the field that moves every side out by 1, so that walls meet in mitres at its corners.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import hypot
from typing import Final

from pc2cad.channels.curves import SectionError
from pc2cad.expression.breaks import find_breaks
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, Layout, call, number, piece_rows, pieces, symbol

V: Final = symbol("v")
Plane = tuple[Expr, Expr]


def outward(
    section: Plane, valued: Callable[[tuple[Expr, ...]], tuple[Expr, ...]] = tuple
) -> Plane:
    """Return the outward normal, of length 1 along the sides, of a section (x, y) in v.

    `valued` gives the section its parameters' values, where it has parameters: which way it runs
    and where its corners are is asked of numbers. Raises SectionError at a corner of a curve that
    is no polygon, where the normal jumps.
    """
    x, y = section
    a, b = valued(section)
    speeds = derivatives((a, b), "v")
    turning = _turning((a, b), (speeds[0], speeds[1]))
    if _is_polygon(a, b):
        return _mitres(a, b, turning)
    _check_corners((a, b), (speeds[0], speeds[1]))
    along, across = derivatives((x, y), "v")
    size = number(turning) / length(along, across)
    return across * size, -along * size


def length(x: Expr, y: Expr) -> Expr:
    """Return √(x² + y²), a number where the normal form shows that it is one."""
    square = x**2 + y**2
    form = normal_form(square, largest=200)
    if form is not None and set(form) == {()}:
        square = number(form[()])
    return call("sqrt", square)


def _is_polygon(x: Expr, y: Expr) -> bool:
    """Say whether both are piecewise linear in v, with corners at the same places."""
    return all(
        n.op == "pieces"
        and n.args[0] is V
        and n.payload == Layout(x.payload.breaks, 2, 0, True)
        and not any(c.symbols for c in n.args[1:])
        for n in (x, y)
    )


def _mitres(x: Expr, y: Expr, turning: int) -> Plane:
    """Return the piecewise linear field that moves every side of a polygon out by 1."""
    breaks = x.payload.breaks
    speeds = [
        (evaluate(a[1], {}), evaluate(b[1], {}))
        for a, b in zip(piece_rows(x), piece_rows(y), strict=True)
    ]
    directions = [_direction(*pair, float(at)) for pair, at in zip(speeds, breaks, strict=False)]
    normals = [(turning * b, -turning * a) for a, b in directions]
    corners = []
    for (a, b), (c, d) in zip([normals[-1], *normals[:-1]], normals, strict=True):
        size = 1 + a * c + b * d
        if size < 1e-6:
            raise SectionError("the polygon turns back on itself: its walls have no common corner")
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


def _check_corners(section: Plane, speeds: Plane) -> None:
    """Raise SectionError where the tangent of the section jumps."""
    for b in find_breaks(section)[1]:
        before, after = b.position * (1 - 1e-14) if b.position else 1.0, b.position % 1
        directions = []
        for place in (before, after):
            a, c = (evaluate(s, {"u": 0.381966, "v": place}) for s in speeds)
            directions.append(_direction(a, c, place))
        (a, c), (d, e) = directions
        if abs(a * e - c * d) > 1e-6 or a * d + c * e < 0:
            raise SectionError(
                f"the section has a corner at v = {b.position:.6g}, where its normal jumps: round "
                "it, measure the wall radially, or take a polygon (whose walls meet in a mitre)"
            )


def _direction(a: float, b: float, place: float) -> tuple[float, float]:
    """Return a velocity over its length."""
    size = hypot(a, b)
    if size == 0:
        raise SectionError(f"the section stands still at v = {place:.6g}, and has no normal there")
    return a / size, b / size


def _turning(section: Plane, speeds: Plane) -> int:
    """Return 1 where the section runs counter-clockwise about the guide, else -1."""
    place = {"u": 0.381966, "v": 0.618034}
    a, b, c, d = (evaluate(n, place) for n in (*section, *speeds))
    return 1 if a * d - b * c > 0 else -1
