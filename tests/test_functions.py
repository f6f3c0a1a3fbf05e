"""A function of the language is known in every place that asks for it: one table of them all."""

from __future__ import annotations

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import Place
from pc2cad.equation.language import read_expression
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.evaluation import Program
from pc2cad.expression.functions import FUNCTIONS, PUBLIC_FUNCTIONS, REPEATED
from pc2cad.expression.intervals import interval
from pc2cad.expression.printing import as_latex, as_text
from pc2cad.expression.tree import Expr, call, number, symbol

X = symbol("u")
LOW, HIGH = 0.2, 0.4
PLACES = np.linspace(LOW, HIGH, 9)


def tree_of(name: str) -> Expr:
    """The function at u, where that is in its domain, and 2 besides."""
    first = X + 2 if name == "acosh" else X
    return call(name, *([first] + [number(2)] * (FUNCTIONS[name].arity - 1)))


def values(*roots: Expr) -> list[np.ndarray]:
    return [np.broadcast_to(row, PLACES.shape) for row in Program(roots)({"u": PLACES})]


def test_there_are_functions_to_ask() -> None:
    assert len(PUBLIC_FUNCTIONS) >= 17


@pytest.mark.parametrize("name", PUBLIC_FUNCTIONS)
def test_the_derivative_is_the_slope(name: str) -> None:
    tree, step = tree_of(name), 1e-6
    slope = values(*derivatives((tree,), "u"))[0]
    above, below = (Program((tree,))({"u": PLACES + d})[0] for d in (step, -step))
    np.testing.assert_allclose(slope, (above - below) / (2 * step), rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("name", PUBLIC_FUNCTIONS)
def test_the_enclosure_holds_the_values_and_little_else(name: str) -> None:
    tree = tree_of(name)
    (row,) = values(tree)
    (found,) = IntervalProgram((tree,))({"u": interval(LOW, HIGH)})
    spread = np.ptp(row)
    assert found.lower <= row.min() <= found.lower + spread + 1e-12
    assert found.upper >= row.max() >= found.upper - spread - 1e-12


@pytest.mark.parametrize("name", PUBLIC_FUNCTIONS)
def test_the_taylor_model_holds_the_values_and_little_else(name: str) -> None:
    tree = tree_of(name)
    middle, half = (LOW + HIGH) / 2, (HIGH - LOW) / 2
    place = Place(np.array([middle]), np.array([half]), np.array([1.5 * half]))
    (model,) = enclose((tree,), ("u",), (place,), 6)
    (row,) = values(tree)
    local = (PLACES - middle) / (1.5 * half)
    series = np.polynomial.polynomial.polyval(local, model.terms[:, 0, 0, 0])
    radius = float(model.radius.max())
    assert np.abs(series - row).max() <= radius + 1e-15
    assert radius <= 0.05 * np.abs(row).max()


@pytest.mark.parametrize("name", PUBLIC_FUNCTIONS)
def test_it_is_written_read_and_exchanged_as_itself(name: str) -> None:
    tree = tree_of(name)
    assert read_expression(as_text(tree), {"u": X}) is tree
    assert as_latex(tree)
    both = values(tree, pc.from_sympy(pc.to_sympy(tree)))  # SymPy has an order of its own
    np.testing.assert_allclose(both[1], both[0], rtol=1e-14)
    arguments = tree.args if tree.op == name else (X,) * FUNCTIONS[name].arity
    named = f"{name}imum" if name in REPEATED else name  # as NumPy has it, not Python
    assert getattr(pc, named)(*arguments) is call(name, *arguments)
