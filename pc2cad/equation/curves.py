"""Plane generator curves that a template defines by a short table of its own.

Each curve NAME gives two scalar functions, NAME_x(t) and NAME_y(t): coordinates in the section
plane, once round for t from 0 to 1, periodic. Formulas: spec section 2.5; the paper names the
curves (its references 30 and 31) without formulas.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction

from pc2cad.equation.tree import PI, Expr, call, number, pieces
from pc2cad.errors import InputError

Curve = tuple[Callable[[Expr], Expr], Callable[[Expr], Expr]]


def polygon(corners: Sequence[tuple[Expr, Expr]]) -> Curve:
    """Return the closed polygon through `corners`, each side with the same share of t.

    Only its value is continuous at a corner: faces that it sweeps meet there in edges.
    """
    k = len(corners)
    if k < 3:
        raise InputError(f"a closed polygon needs at least 3 points, here are {k}")
    breaks = tuple(Fraction(i, k) for i in range(k + 1))
    axes = [
        tuple(
            (corners[i][axis], k * (corners[(i + 1) % k][axis] - corners[i][axis]))
            for i in range(k)
        )
        for axis in (0, 1)
    ]
    return (
        lambda t: pieces(t, breaks, axes[0], smoothness=0),
        lambda t: pieces(t, breaks, axes[1], smoothness=0),
    )


def contour(nodes: Sequence[tuple[Expr, Expr]], handle: Expr) -> Curve:
    """Return the closed contour of first order of smoothness through `nodes`.

    Arc i is the cubic Bézier P_i, P_i + λ(P_{i+1} - P_{i-1}), P_{i+1} - λ(P_{i+2} - P_i), P_{i+1}:
    the tangent at each node is parallel to the chord of its neighbours, and all arcs take the
    same share of t, so that the contour is C¹ for every λ (`handle`; 1/6 is Catmull-Rom).
    """
    k = len(nodes)
    if k < 3:
        raise InputError(f"a closed contour needs at least 3 points, here are {k}")
    breaks = tuple(Fraction(i, k) for i in range(k + 1))
    axes = []
    for axis in (0, 1):
        p = [node[axis] for node in nodes]
        rows = tuple(_arc_row([p[(i + j) % k] for j in (-1, 0, 1, 2)], handle, k) for i in range(k))
        axes.append(rows)
    return (
        lambda t: pieces(t, breaks, axes[0], smoothness=1),
        lambda t: pieces(t, breaks, axes[1], smoothness=1),
    )


def _arc_row(p: list[Expr], handle: Expr, k: int) -> tuple[Expr, ...]:
    """Return ascending coefficients in t - i/k of one arc's coordinate."""
    before, start, end, after = p
    b0, b1 = start, start + handle * (end - before)
    b2, b3 = end - handle * (after - start), end
    local = (b0, 3 * (b1 - b0), 3 * (b0 - 2 * b1 + b2), b3 - 3 * b2 + 3 * b1 - b0)
    return tuple(c * number(k**power) for power, c in enumerate(local))


def sine_wave(radius: Expr, amplitude: Expr, waves: Expr) -> Curve:
    """Return the sine wave round a circle, r = R + h sin(nφ), φ = 2πt.

    It closes (and is then C∞) exactly when the number of waves is whole.
    """

    def r(t: Expr) -> Expr:
        return radius + amplitude * call("sin", 2 * waves * PI * t)

    return (
        lambda t: r(t) * call("cos", 2 * PI * t),
        lambda t: r(t) * call("sin", 2 * PI * t),
    )
