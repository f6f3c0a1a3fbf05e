"""Residues tell what is no square, and never call one a square's multiple that is."""

from fractions import Fraction

import pytest

from pc2cad.expression.residues import may_be_square
from pc2cad.expression.tree import PI, E, call, number, symbol

u, v = symbol("u"), symbol("v")
SINE, COSINE = call("sin", u), call("cos", u)
ROOT = call("sqrt", 1 + u * u)


@pytest.mark.parametrize(
    "base",
    [
        u + 1,
        3 * u**2 - v / 7,
        SINE * v + COSINE / 3,
        1 / (u + 2) - v,
        ROOT + u,
        v / ROOT + call("exp", u),
        PI * u - E,
        call("sqrt", number(3)) * u + 1,
        call("sqrt", number(15)) / call("sqrt", number(21)) + v * call("sqrt", 2 + u),
        u ** number(Fraction(1, 3)) + call("abs", v),
    ],
)
@pytest.mark.parametrize("factor", [1, 2, Fraction(5, 7)])
def test_multiples_of_squares_may_be_squares(base, factor):
    square = number(factor) * base * base
    assert may_be_square(square)
    assert may_be_square(number(factor) * (base * base + 2 * base * u + u * u))


def test_what_holds_of_sines_roots_and_quotients_holds_of_residues():
    assert may_be_square(1 - SINE * SINE)
    assert may_be_square((1 - COSINE**2) * (1 + u * u) * ROOT**2)
    assert may_be_square(ROOT**2 - 2 * u)  # (u - 1)²
    assert may_be_square(4 * u / u * call("sqrt", v) ** 4)


@pytest.mark.parametrize(
    "tree",
    [
        u,
        u * u + 1,
        1 + SINE,
        2 - SINE * SINE,
        ROOT,
        u * u + v * v,
        (u + 1) ** 2 + SINE**2,
        call("sqrt", number(3)) * u,
        1 / (u + v),
        PI * u * u,
    ],
)
def test_others_are_told_at_once(tree):
    assert not may_be_square(tree)


def test_a_prime_in_a_denominator_tells_nothing_and_others_do():
    prime = (1 << 31) - 1
    share = number(Fraction(1, prime))
    assert may_be_square((u + share) * (u + share))
    assert not may_be_square(u * u + share)
