"""Roots of functions that vanish at ends of their parameters, with the zeros taken out."""

from __future__ import annotations

from fractions import Fraction
from math import gamma, pi

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.domain.map import local_map
from pc2cad.equation.point_equation import point_equation
from pc2cad.expression.end_roots import take_out_ends
from pc2cad.expression.end_zeros import take_out_zeros
from pc2cad.expression.evaluation import Program
from pc2cad.expression.power_series import series_at_zero
from pc2cad.expression.tree import Expr, number, pieces, substitute

u, v, w = pc.parameters()
TURN = 2 * pc.pi
NODES, WEIGHTS = (np.polynomial.legendre.leggauss(60)[k] / 2 + (0.5, 0)[k] for k in (0, 1))
Map = tuple[Expr, Expr, Expr]

#: function, its value near 0, coefficients at 0
SERIES = {
    "sine": (pc.sin(2 * u), [0, 2, 0, -8 / 6, 0, 32 / 120]),
    "tangent": (pc.tan(u), [0, 1, 0, 1 / 3, 0, 2 / 15]),
    "hyperbolic": (pc.tanh(u) + pc.cosh(u) - pc.sinh(u),
                   [1, 0, 0.5, -0.5, 1 / 24, 2 / 15 - 1 / 120]),
    "exponential": (pc.exp(u), [1, 1, 1 / 2, 1 / 6, 1 / 24, 1 / 120]),
    "logarithm": (pc.log(1 + u), [0, 1, -1 / 2, 1 / 3, -1 / 4, 1 / 5]),
    "arcs": (pc.asin(u) - pc.atan(u), [0, 0, 0, 1 / 6 + 1 / 3, 0, 3 / 40 - 1 / 5]),
    "arc of a cosine": (pc.acos(u), [pi / 2, -1, 0, -1 / 6, 0, -3 / 40]),
    "areas": (pc.asinh(u) + pc.atanh(u), [0, 2, 0, 1 / 6, 0, 3 / 40 + 1 / 5]),
    "root": (pc.sqrt(1 + u), [1, 1 / 2, -1 / 8, 1 / 16, -5 / 128, 7 / 256]),
    "quotient of powers": ((1 + u) ** 3 / (2 - u**2), [0.5, 1.5, 1.75, 1.25, 0.875, 0.625]),
}  # fmt: skip


@pytest.mark.parametrize("name", SERIES)
def test_coefficients_are_enclosed_and_what_is_left_bounded(name: str) -> None:
    tree, coefficients = SERIES[name]
    found = series_at_zero(tree, "u", len(coefficients), (0.25,))
    assert found is not None
    assert np.all(found.lower <= np.array(coefficients) + 1e-15)
    assert np.all(found.upper >= np.array(coefficients) - 1e-15)
    assert np.abs(found.upper - found.lower).max() < 1e-12
    x = np.linspace(0, 0.25, 9)
    (values,) = Program((tree,))({"u": x})
    off = np.abs(values - np.polynomial.polynomial.polyval(x, coefficients[:-1]))
    assert np.all(off <= found.largest[-1, 0] * x ** (len(coefficients) - 1) + 1e-15)


@pytest.mark.parametrize("flip", [False, True])
def test_sums_that_vanish_at_a_corner_keep_their_digits(flip: bool) -> None:
    slow_u, slow_v = (t * t * (3 - 2 * t) for t in (u, v))
    radicand = 2 - slow_u - slow_v if flip else slow_u * (1 - slow_u) + slow_v * (1 - slow_v)
    (found,) = take_out_ends((pc.sqrt(radicand),))
    h = 2.0 ** -np.arange(10, 50)
    (values,) = Program((found,))({"u": 1 - h, "v": 1 - 2 * h})
    # 1 - t²(3-2t) is (1-t)²(1+2t)
    first, second = h**2 * (3 - 2 * h), 4 * h**2 * (3 - 4 * h)
    wanted = first + second if flip else first * (1 - first) + second * (1 - second)
    assert values == pytest.approx(np.sqrt(wanted), rel=1e-14)
    (other,) = take_out_ends((pc.sqrt(radicand + 1),))
    assert other is pc.sqrt(radicand + 1)


#: radicand, and its orders at 0 and 1
RADICANDS = {
    "half a wave": (pc.sin(pc.pi * u), 1, 1),
    "a whole wave": (1 - pc.cos(TURN * u), 2, 2),
    "falling": (pc.cos(pc.pi * u / 2), 0, 1),
    "von Karman": (pc.pi * u - pc.sin(TURN * u) / 2, 3, 0),
    "logarithm": (pc.log(1 + u), 1, 0),
    "exponential": (pc.exp(u) - 1 - u, 2, 0),
    "hyperbolic": (pc.tanh(3 * u), 1, 0),
    "steep": (pc.exp(20 * u) - 1, 1, 0),
    "product": (pc.sin(pc.pi * u) * pc.log(2 - u), 1, 2),
    "quotient": (pc.sin(pc.pi * u) / (2 + pc.cos(3 * u)), 1, 1),
}


@pytest.mark.parametrize("name", RADICANDS)
@pytest.mark.parametrize("exponent", [Fraction(1, 2), Fraction(2, 3), Fraction(5, 4)])
def test_zeros_go_out_of_roots_and_values_stay(name: str, exponent: Fraction) -> None:
    tree, start, end = RADICANDS[name]
    root = tree ** number(exponent)
    (found,) = take_out_zeros((root,))
    x = np.concatenate((np.linspace(0.02, 0.98, 200), [1e-3, 1 - 1e-3]))
    (values,), (wanted,) = (Program((t,))({"u": x}) for t in (found, root))
    assert values == pytest.approx(wanted, rel=1e-11)
    # what is left has a value other than 0 at both ends
    rest = found / (u ** number(start * exponent) * (1 - u) ** number(end * exponent))
    (near,) = Program((rest,))({"u": np.array([1e-9, 1e-6, 1 - 1e-6, 1 - 1e-9])})
    assert near[0] == pytest.approx(near[1], rel=1e-4)
    assert near[2] == pytest.approx(near[3], rel=1e-4)
    assert np.all(near > 0)


def test_what_is_not_exactly_zero_or_changes_its_sign_stays() -> None:
    for tree in (
        pc.sin(3.14159 * u - 1e-9) + 1e-8, pc.sin(4 * u), pc.sin(u - 0.3), pc.log(u), u * (1 - u),
        pc.sin(pc.pi * u) + v * u, 1 + pc.sin(u),
    ):  # fmt: skip
        root = pc.sqrt(tree)
        assert take_out_zeros((root,)) == (root,)


def test_a_piece_that_is_not_met_may_end_in_a_division_by_zero() -> None:
    halves = tuple(map(Fraction, (0, "1/2", 1)))
    tree = pieces(u, halves, ((1 / (1 - u),), (1 / u,)), 0, closed=False)
    for place, value in ((0, 1), (1, 1), (Fraction(1, 4), Fraction(4, 3))):
        (found,) = substitute((tree,), {"u": number(place)})
        assert found is number(value)


def test_a_blunt_tip_gets_a_parameter_of_its_own() -> None:
    # r goes with u^(3/2) and z with u^2
    r, z = pc.sin(pc.pi * u) ** 1.5, (1 - pc.cos(pc.pi * u)) / 2
    mapping = local_map(point_equation((w * r * pc.cos(v), w * r * pc.sin(v), z), name="tip"))
    assert mapping.parameters[0] is 3 * u**2 - 2 * u**3
    # an edge of such a power, beside other points that move, does not
    mapping = local_map(point_equation((u, v, w * (1 + u**1.5)), name="edge"))
    assert mapping.parameters[0] is u


def square(tree: Expr) -> float:
    """Return the integral of a tree of u over [0, 1], with roots at both ends."""
    (values,) = Program((tree,))({"u": NODES**2 * (3 - 2 * NODES)})
    return float((WEIGHTS * 6 * NODES * (1 - NODES) * values).sum())


@pytest.mark.parametrize("radicand", ["half a wave", "logarithm", "hyperbolic"])
def test_blocks_under_such_roots_are_bounded(radicand: str) -> None:
    height = 1 + pc.sqrt(RADICANDS[radicand][0])
    report = pc.compile_part((u, v, w * height)).report
    assert report.solid.volume == pytest.approx(square(height), rel=1e-8)
    assert report.evidence == "bounded"
    assert max(face.poles[0] for face in report.faces if face.poles) < 20


def turned(r: Expr, z: Expr) -> Map:
    return w * r * pc.cos(TURN * v), w * r * pc.sin(TURN * v), z


Q = pc.pi * u
BODIES = {
    "von Karman's nose": (
        turned(pc.sqrt(Q - pc.sin(2 * Q) / 2) / pc.sqrt(pc.pi), 3 * (1 - pc.cos(Q)) / 2),
        pi * 3 / 2,
    ),
    "thin rim": ((w * pc.cos(TURN * u), w * pc.sin(TURN * u), v * pc.sqrt(pc.cos(pc.pi * w / 2))),
                 None),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", BODIES)
def test_bodies_with_such_roots_are_bounded(name: str) -> None:
    equation, volume = BODIES[name]
    report = pc.compile_part(equation).report
    if volume is None:
        volume = 2 * pi * square(u * pc.sqrt(pc.cos(pc.pi * u / 2)))
    assert report.solid.volume == pytest.approx(volume, rel=5e-8)
    assert report.evidence == "bounded"


@pytest.mark.slow
def test_the_body_of_sears_and_haack() -> None:
    report = pc.compile_part(turned(pc.sin(Q) ** 1.5, 5 * (1 - pc.cos(Q)) / 2)).report
    assert report.solid.volume == pytest.approx(3 * pi**2 / 16 * 5, rel=5e-8)
    assert report.evidence == "bounded"


@pytest.mark.slow
def test_an_octant_of_a_superquadric() -> None:
    a, b, e = pc.pi * u / 2, pc.pi * v / 2, number(Fraction(1, 2))
    x, y = w * pc.cos(a) ** e * pc.cos(b) ** e, w * pc.sin(a) ** e * pc.cos(b) ** e
    report = pc.compile_part((x, y, w * pc.sin(b) ** e)).report
    # of |x|^n + |y|^n + |z|^n = 1 with n = 4
    assert report.solid.volume == pytest.approx(gamma(5 / 4) ** 3 / gamma(7 / 4), rel=5e-8)
    assert report.evidence == "bounded"
