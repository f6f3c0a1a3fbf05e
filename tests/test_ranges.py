"""One grammar for the values of a parameter: ``--vary`` and ``--slider`` read the same texts."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pc2cad.cli.study import _vary
from pc2cad.cli.view import _axis
from pc2cad.errors import InputError
from pc2cad.studies.plan import read_axes
from pc2cad.templates.ranges import Axis, RangeError, read_axis

PIECES = st.sampled_from(
    ["0", "1", "1/5", "3/5", "0.1", "-2", "pi/3", "1e999", "nan", "²", "x", "", " "]
)
MARKS = st.sampled_from([":", ":", ",", "=", ";"])


@st.composite
def texts(draw: st.DrawFn) -> str:
    pieces = draw(st.lists(PIECES, min_size=1, max_size=4))
    marks = [draw(MARKS) for _ in pieces[1:]]
    return (
        draw(st.sampled_from(["p=", "q =", "p", ""]))
        + pieces[0]
        + "".join(mark + piece for mark, piece in zip(marks, pieces[1:], strict=True))
    )


def varied(text: str) -> Axis | str:
    try:
        return read_axes(_vary([text]))[0]
    except InputError as error:
        return str(error).removeprefix("--vary")


def slid(text: str) -> Axis | str:
    # whether a template has the parameter is another question
    parameter = SimpleNamespace(name=text.partition("=")[0].strip())
    maker = SimpleNamespace(template=SimpleNamespace(parameters=[parameter]))
    try:
        return _axis(text, maker)[1]  # type: ignore[arg-type]
    except InputError as error:
        return str(error).removeprefix("--slider")


@given(texts())
@settings(max_examples=300, deadline=None)
def test_both_options_accept_and_refuse_the_same_texts_with_the_same_words(text: str) -> None:
    assert varied(text) == slid(text)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("p=1/5:3/5:2", Axis("p", (0.2, 0.6))),
        ("p=0.1,pi-pi", Axis("p", (0.1, 0.0))),
        ("p=1/3:1", Axis("p", range=(1 / 3, 1.0))),
        ("p=1:1:1", Axis("p", (1.0,))),
    ],
)
def test_constant_expressions_stand_everywhere(text: str, found: Axis) -> None:
    assert varied(text) == slid(text) == found


@pytest.mark.parametrize("text", ["", "p", "=1", "p=", "p=0:1:2:3", "p=1:0", "p=0:1:x", "p=1;2"])
def test_what_is_refused_is_refused_by_both(text: str) -> None:
    assert isinstance(varied(text), str)
    assert varied(text) == slid(text)


def test_steps_are_exact_and_rounded_once() -> None:
    values = read_axis("p", "0.1:0.7:7").values
    assert [Fraction(repr(value)) for value in values] == [Fraction(k, 10) for k in range(1, 8)]
    with pytest.raises(RangeError, match="has more than LOW:HIGH:COUNT"):
        read_axis("p", "0:1:2:3")
