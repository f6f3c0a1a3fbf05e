"""Numbers that trees hold, in double precision, against fifty digits."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from mpmath import mp, mpf

from pc2cad.bounds.fixed_numbers import UNKNOWN, fixed
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import Place
from pc2cad.expression.evaluation import Program
from pc2cad.expression.tree import PI, Expr, call, intern, number, power, symbol

E = intern("constant", (), "e")
THIRD = number(Fraction(1, 3))
TREES = {
    "a sum that cancels": PI - Fraction(22, 7) + THIRD * number(Fraction(1, 1000)),
    "quotients": (PI / E - 1) / (E * E + PI) / (PI * PI * PI - 31),
    "powers": power(PI, number(5)) * power(E - PI, number(-3)) + power(PI / 3, number(40)),
    "roots": call("sqrt", PI * E - 8) / call("sqrt", power(PI, number(4)) + THIRD * PI),
    "waves": call("cos", 100 * PI * E) + call("sin", PI * PI / 7) * 1000,
    "many terms": sum((PI / n for n in range(1, 300)), start=E),
}


def exactly(tree: Expr) -> mpf:
    if tree.op == "number":
        return mpf(tree.payload.numerator) / tree.payload.denominator
    if tree.op == "constant":
        return +mp.pi if tree.payload == "pi" else +mp.e
    args = [exactly(arg) for arg in tree.args]
    work = {
        "add": lambda a, b: a + b, "neg": lambda a: -a, "mul": lambda a, b: a * b,
        "div": lambda a, b: a / b, "pow": lambda a, b: a**b,
        "sqrt": mp.sqrt, "sin": mp.sin, "cos": mp.cos,
    }  # fmt: skip
    return work[tree.op](*args)


@pytest.mark.parametrize("name", TREES)
def test_values_are_off_by_no_more_than_is_said(name: str) -> None:
    tree = TREES[name]
    value, off = fixed(tree)
    computed = float(Program((tree,))({})[0])
    with mp.workdps(50):
        true = exactly(tree)
        assert abs(value - true) <= off
        assert abs(computed - true) <= off
    assert off <= 1e-11 * max(1.0, abs(value))


@pytest.mark.parametrize(
    "tree",
    [
        call("sqrt", PI * E - E * PI), 1 / (PI * E - E * PI), call("exp", PI),
        power(PI, number(Fraction(1, 3))), power(power(PI, number(60)), number(60)),
    ],
)  # fmt: skip
def test_what_is_not_told_is_left_to_models(tree: Expr) -> None:
    assert fixed(tree) is UNKNOWN
    assert fixed(1 + tree) is UNKNOWN


def test_models_take_numbers_as_they_are() -> None:
    tree = TREES["quotients"]
    places = [Place(np.array([0.5, 0.7]), np.array([0.1, 0.1]), np.array([0.2, 0.2]))]
    (whole,) = enclose((tree * symbol("u") ** 2,), ("u",), places, 4)
    value, off = fixed(tree)
    np.testing.assert_allclose(whole.terms[:, 0, :, 0][0], value * np.array([0.25, 0.49]))
    assert whole.radius.max() < off + 1e-14
