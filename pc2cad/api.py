"""The equation language in Python: points, parameters, functions and operators of the calculus."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, cast

from pc2cad.channels import curves
from pc2cad.channels.guides import Guide, helix, spline
from pc2cad.channels.polylines import polyline
from pc2cad.equation.choices import clamp, floor, hypot, maximum, minimum, mod, sign, where
from pc2cad.equation.point_equation import Domain, PointEquation
from pc2cad.equation.points import (
    Combination,
    Value,
    cross,
    derivative,
    det,
    distance,
    dot,
    exit_from_plane,
    length,
    metric,
    point,
    rotate,
    rotx,
    roty,
    rotz,
    translate,
    unit,
    vector,
)
from pc2cad.equation.tables import net, table
from pc2cad.errors import InputError
from pc2cad.expression.exact import exact
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import PI, E, Expr, Number, as_expr, call, symbol
from pc2cad.expression.waves import Series, series

if TYPE_CHECKING:
    from pc2cad.channels.channel import Wall
    from pc2cad.channels.frames import Frame

__all__ = [
    "abs", "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "channel", "clamp",
    "composite", "contour", "cos", "cosh", "cross", "deg", "det", "diff", "distance", "dot", "e",
    "ellipse", "exit_from_plane", "exp", "floor", "fourier", "frame", "guide", "guide_from_wire",
    "helix", "hypot", "length", "log", "maximum", "metric", "minimum", "mod", "net", "parameters",
    "pi", "point", "points", "polygon", "polyline", "regular_polygon", "rotate", "rotx", "roty",
    "rotz", "section_from_wire", "sign", "sin", "sine_wave", "sinh", "spline", "sqrt",
    "superellipse", "table", "tan", "tanh", "translate", "unit", "vector", "where",
]  # fmt: skip

pi = PI
e = E
deg = PI / 180
abs = abs  # the built-in function takes expressions


def parameters() -> tuple[Expr, Expr, Expr]:
    """Return the three current parameters of a point equation, u, v and w."""
    u, v, w = (symbol(name) for name in PARAMETERS)
    return u, v, w


def points(**coordinates: Sequence[Expr | Number]) -> tuple[Combination, ...]:
    """Return one point per keyword, in order.

    For example ``A, B = points(A=(4, 0, 0), B=(1, 5, 1))``.
    """
    for name, given in coordinates.items():
        if not isinstance(given, Iterable) or isinstance(given, str):
            raise InputError(f"the point {name} is three coordinates (x, y, z)")
        if len(given) != 3:
            raise InputError(f"the point {name} has {len(given)} coordinates instead of 3")
    return tuple(point(*given) for given in coordinates.values())


def diff(value: Value, parameter: Expr, order: int = 1) -> Value:
    """Return the derivative in u, v or w; that of a point is a free vector."""
    if parameter.op != "symbol" or parameter.payload not in PARAMETERS:
        raise InputError("diff takes the derivative in one of the parameters u, v and w")
    return derivative(value, parameter.payload, order)


def sin(x: Expr | Number) -> Expr:
    """Return the sine of x (radians)."""
    return call("sin", as_expr(x))


def cos(x: Expr | Number) -> Expr:
    """Return the cosine of x (radians)."""
    return call("cos", as_expr(x))


def tan(x: Expr | Number) -> Expr:
    """Return the tangent of x (radians)."""
    return call("tan", as_expr(x))


def asin(x: Expr | Number) -> Expr:
    """Return the arc sine of x."""
    return call("asin", as_expr(x))


def acos(x: Expr | Number) -> Expr:
    """Return the arc cosine of x."""
    return call("acos", as_expr(x))


def atan(x: Expr | Number) -> Expr:
    """Return the arc tangent of x."""
    return call("atan", as_expr(x))


def atan2(y: Expr | Number, x: Expr | Number) -> Expr:
    """Return the angle of the point (x, y)."""
    return call("atan2", as_expr(y), as_expr(x))


def sinh(x: Expr | Number) -> Expr:
    """Return the hyperbolic sine of x."""
    return call("sinh", as_expr(x))


def cosh(x: Expr | Number) -> Expr:
    """Return the hyperbolic cosine of x."""
    return call("cosh", as_expr(x))


def tanh(x: Expr | Number) -> Expr:
    """Return the hyperbolic tangent of x."""
    return call("tanh", as_expr(x))


def asinh(x: Expr | Number) -> Expr:
    """Return the inverse hyperbolic sine of x."""
    return call("asinh", as_expr(x))


def acosh(x: Expr | Number) -> Expr:
    """Return the inverse hyperbolic cosine of x."""
    return call("acosh", as_expr(x))


def atanh(x: Expr | Number) -> Expr:
    """Return the inverse hyperbolic tangent of x."""
    return call("atanh", as_expr(x))


def exp(x: Expr | Number) -> Expr:
    """Return e to the power x."""
    return call("exp", as_expr(x))


def log(x: Expr | Number) -> Expr:
    """Return the natural logarithm of x."""
    return call("log", as_expr(x))


def sqrt(x: Expr | Number) -> Expr:
    """Return the square root of x."""
    return call("sqrt", as_expr(x))


PlanePoints = Sequence[tuple[Expr | Number, Expr | Number]]


def _plane(points: PlanePoints) -> list[tuple[Expr, Expr]]:
    return [(as_expr(x), as_expr(y)) for x, y in points]


def ellipse(a: Expr | Number, b: Expr | Number, t: Expr) -> tuple[Expr, Expr]:
    """Return (x, y) at t of the ellipse with semi-axes a and b; once round for t in [0, 1]."""
    x, y = curves.ellipse(as_expr(a), as_expr(b))
    return x(t), y(t)


def superellipse(
    a: Expr | Number, b: Expr | Number, exponent: Expr | Number, t: Expr
) -> tuple[Expr, Expr]:
    """Return (x, y) at t of |x/a|^n + |y/b|^n = 1, n ≥ 2; it is analytic for even n."""
    x, y = curves.superellipse(as_expr(a), as_expr(b), as_expr(exponent))
    return x(t), y(t)


def contour(
    nodes: PlanePoints,
    t: Expr,
    handle: Expr | Number | None = None,
    spacing: str = "uniform",
) -> tuple[Expr, Expr]:
    """Return (x, y) at t of the closed C¹ contour through plane points; once round for t in [0, 1].

    `handle` is the share λ of the neighbours' chord that each Bézier handle takes (default 1/6);
    `spacing` is ``uniform``, ``centripetal`` or ``chord`` (see `curves.contour`).
    """
    share = as_expr(1) / 6 if handle is None else as_expr(handle)
    x, y = curves.contour(_plane(nodes), share, spacing)
    return x(t), y(t)


def polygon(
    corners: PlanePoints, t: Expr, radius: Number | Sequence[Number] = 0
) -> tuple[Expr, Expr]:
    """Return (x, y) at t of the closed polygon through plane points; once round for t in [0, 1].

    Without `radius` each side has the same share of t; with one (or one per corner) the corners are
    rounded by arcs, and t goes with the length.
    """
    plane = _plane(corners)
    if not isinstance(radius, Sequence):
        if radius == 0:
            x, y = curves.polygon(plane)
            return x(t), y(t)
        radius = [radius] * len(plane)
    x, y = curves.rounded_polygon(plane, [as_expr(r) for r in radius])
    return x(t), y(t)


def regular_polygon(
    count: int, circumradius: Expr | Number, t: Expr, radius: Number = 0
) -> tuple[Expr, Expr]:
    """Return (x, y) at t of a regular polygon with its first corner on the x axis."""
    return polygon(curves.regular_polygon(count, as_expr(circumradius)), t, radius)


def sine_wave(
    radius: Expr | Number,
    amplitude: Expr | Number,
    waves: int,
    t: Expr,
    radius_y: Expr | Number | None = None,
) -> tuple[Expr, Expr]:
    """Return (x, y) at t of the sine wave r = R + h sin(nφ) round a circle, φ = 2πt.

    With `radius_y` it goes round an ellipse.
    """
    second = None if radius_y is None else as_expr(radius_y)
    x, y = curves.sine_wave(as_expr(radius), as_expr(amplitude), as_expr(waves), second)
    return x(t), y(t)


def fourier(
    cos: Iterable[tuple[int, int, Number]] = (),
    sin: Iterable[tuple[int, int, Number]] = (),
    periods: int = 1,
) -> Callable[[Expr | Number, Expr | Number], Expr]:
    """Return the function Σ c cos(mθ - n·periods·φ) + Σ c sin(mθ - n·periods·φ) of two angles.

    `cos` and `sin` are rows (m, n, c). The series is one node of the trees, however many waves it
    has. Raises InputError for waves that are no whole numbers, or too many.
    """
    tables = []
    for name, rows in (("cos", cos), ("sin", sin)):
        table = []
        for row in rows:
            if len(row) != 3 or any(int(n) != n for n in row[:2]):
                raise InputError(f"{name}: a wave is (m, n, coefficient), m and n whole: {row!r}")
            table.append((int(row[0]), int(row[1]), exact(row[2])))
        tables.append(table)
    return Series(series(periods, *tables))


# -- channels: what works with numbers along the guide is imported late ----------------------------


def guide(N: Value | Sequence[Expr | Number], interval: Sequence[Expr | Number] = (0, 1)) -> Guide:
    """Return the guide of any point N(u), or of its three coordinates; see `guides.curve`."""
    from pc2cad.channels.guides import GuideError, curve

    if not isinstance(N, (Expr, Combination)):
        coordinates = _three(N)
        if coordinates is None:
            raise GuideError(
                "a guide is a point N(u) or its three coordinates; through points runs "
                "spline(points) or polyline(points, radius), along a wire guide_from_wire(wire)"
            )
        N = point(*coordinates)
    return curve(N, interval)


def _three(given: Any) -> list[Expr | Number] | None:
    """Return three numbers or expressions that were given as a row, and None for all else."""
    row = list(given) if isinstance(given, Iterable) else []
    return row if len(row) == 3 and not any(isinstance(c, Iterable) for c in row) else None


def composite(*parts: Guide, corners: str = "refuse") -> Guide:
    """Return guides joined end to end, corners refused or mitred; see `guides.composite`."""
    from pc2cad.channels.guides import composite

    return composite(parts, corners)


def guide_from_wire(wire: Any, corners: str = "refuse") -> Guide:
    """Return a CadQuery (or OCCT) wire or edge as a guide; see `wires.guide_from_wire`."""
    from pc2cad.channels.wires import guide_from_wire

    return guide_from_wire(wire, corners)


def section_from_wire(wire: Any, t: Expr) -> tuple[Expr, Expr]:
    """Return (x, y) at t of a closed CadQuery wire in the xy plane; see `wires.section_from_wire`.

    Once round for t from 0 to 1.
    """
    from pc2cad.channels.wires import section_from_wire

    x, y = section_from_wire(wire)
    return x(t), y(t)


def frame(
    along: Guide | Value | Sequence[Expr | Number],
    kind: str = "rotation-minimising",
    reference: Value | Sequence[Expr | Number] | None = None,
    twist: Expr | Number = 0,
    symmetry: int = 1,
) -> Frame:
    """Return a frame along a guide (or along a point N(u)); see `frames.frame`.

    Three numbers are the point E of the kind ``point``, and else a direction.
    """
    from pc2cad.channels.frames import frame

    run = along if isinstance(along, Guide) else guide(along)
    row = _three(reference)
    if row is not None:
        reference = (point if kind == "point" else vector)(*row)
    return frame(run, kind, cast("Value | None", reference), twist, symmetry)


def channel(
    along: Frame | Guide | Value | Sequence[Expr | Number],
    section: Sequence[Expr | Number],
    wall: Wall | None = None,
    *,
    side: str | None = None,
    measured: str = "radial",
    domain: Domain | None = None,
    name: str = "channel",
    units: str = "mm",
) -> PointEquation:
    """Return a section carried along a frame as point equation; see `channel.channel`.

    A guide, or a point N(u), takes the rotation-minimising frame.
    """
    from pc2cad.channels.channel import channel
    from pc2cad.channels.frames import Frame

    carrier = along if isinstance(along, Frame) else frame(along)
    return channel(carrier, section, wall, side, measured, domain, name, units)
