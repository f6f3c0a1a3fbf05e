"""What is read again is what it was, and counts again."""

from __future__ import annotations

import pytest

from pc2cad.equation.language import read_expression
from pc2cad.equation.points import Combination, point
from pc2cad.equation.syntax import ExpressionSyntaxError
from pc2cad.expression.budget import bounded, left
from pc2cad.expression.tree import number, symbol

TEXT = "length(A - B)*p + det(A - B, A - C, B - C)"


def _names(p: float) -> dict[str, object]:
    return {
        "A": point(1, 2, 3), "B": point(4, 6, symbol("u")), "C": point(0, 0, 1), "p": number(p),
    }  # fmt: skip


def test_values_of_other_names_give_other_values() -> None:
    first = read_expression(TEXT, _names(2))  # type: ignore[arg-type]
    second = read_expression(TEXT, _names(3))  # type: ignore[arg-type]
    again = read_expression(TEXT, _names(2))  # type: ignore[arg-type]
    assert first is again
    assert first is not second


def test_what_is_recalled_counts_as_what_is_made() -> None:
    spent = []
    for _ in range(2):
        with bounded():
            before = left()
            read_expression("cross(A - B, [7*u, 1, 5] - C)", {**_names(2), "u": symbol("u")})  # type: ignore[arg-type]
            spent.append(before - left())
    assert spent[0] == spent[1] > 10


def test_what_is_refused_is_refused_again() -> None:
    for _ in range(2):
        with pytest.raises(ExpressionSyntaxError, match="weights"):
            read_expression("A + B", _names(2))  # type: ignore[arg-type]


def test_a_function_of_the_template_is_asked_each_time() -> None:
    found = []
    for k in (1, 2):
        curves = {"f": lambda t, k=k: t * k}
        found.append(read_expression("f(p) + 1", {"p": number(5)}, curves))
    assert found == [number(6), number(11)]


def test_a_function_that_bears_a_name_of_the_language_is_asked() -> None:
    plain = read_expression("rotx([0, 1, 0], 0)", {})
    own = read_expression("rotx(2)", {}, {"rotx": lambda t: t * 10})
    assert isinstance(plain, Combination)
    assert own == number(20)
