"""What is read again is what it was, and counts again."""

from __future__ import annotations

import pytest

from pc2cad.equation.language import read_expression
from pc2cad.equation.points import Combination, point
from pc2cad.equation.syntax import ExpressionSyntaxError
from pc2cad.errors import InputError
from pc2cad.expression.budget import bounded, left
from pc2cad.expression.tree import number, symbol
from pc2cad.templates.file import parse_template

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


def test_figures_of_variants_are_those_of_a_template_that_is_written_so() -> None:
    text = (
        'title = "box"\n[parameters]\na = {{ default = {a} }}\nn = {{ default = 6 }}\n'
        '[solid]\nx = "a*u"\ny = "v"\nz = "w"\n'
        '[expect]\nvolume = "a"\narea = "2 + 4*sqrt(a^2)"\ncentroid = ["a/2", 0.5, "1/2"]\n'
        'faces = "{faces}"\n'
    )
    template = parse_template(text.format(a=1, faces="6"), "box")
    other = parse_template(text.format(a='"7/3"', faces="6"), "box").bind({})
    found = template.bind({"a": "7/3"}).expectations
    assert found.centroid == pytest.approx(other.expectations.centroid, rel=1e-15)
    for name in ("volume", "area", "faces"):
        assert getattr(found, name) == pytest.approx(getattr(other.expectations, name), rel=1e-15)
    # counts that depend on parameters are exact, and figures without a value are refused
    counted = parse_template(text.format(a=1, faces="n"), "box")
    assert counted.bind({"n": 5}).expectations.faces == 5
    with pytest.raises(InputError, match="whole number"):
        counted.bind({"n": "11/2"})
    rooted = parse_template(text.format(a=1, faces="6").replace("a^2", "a - 1"), "box")
    with pytest.raises(InputError, match="not a real number"):
        rooted.bind({"a": "1/2"})
