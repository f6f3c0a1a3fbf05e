"""Numbers as short as they can be: as Python prints each double, in any company."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pc2cad.export import shortest

COUNT = 20_000
SEED = np.random.default_rng(7)

#: doubles of all kinds that files hold, and those beside them: with six decimals or an exponent
KINDS = {
    "of any size": SEED.uniform(-1, 1, COUNT) * 10.0 ** SEED.uniform(-6, 10, COUNT),
    "of a part": SEED.uniform(-30, 30, COUNT),
    "of few digits": np.round(SEED.uniform(-100, 100, COUNT), 4) + 0.0,  # no -0
    "beside few digits": np.nextafter(np.round(SEED.uniform(-100, 100, COUNT), 4), math.inf),
    "beside powers of two": np.nextafter(2.0 ** np.arange(-20, 32), np.tile([-99, 999], 26)),
    "powers of two": 2.0 ** np.arange(-20, 32),
    "beside powers of ten": np.nextafter(10.0 ** np.arange(-6, 10), 0.0),
    "of exponents": SEED.uniform(1, 10, 99) * 10.0 ** np.tile([-80, -9, 18], 33),
}


def printed(value: float) -> bytes:
    """As Python prints it, with STEP's point and exponent."""
    mantissa, _, exponent = repr(value).partition("e")
    mantissa = mantissa.removesuffix("0") if mantissa.endswith(".0") else mantissa
    if exponent:
        return f"{mantissa}{'' if '.' in mantissa else '.'}E{exponent}".encode()
    return mantissa.encode()


@pytest.fixture(autouse=True, params=[0, 10**9], ids=["all at once", "one by one"])
def both_ways(request, monkeypatch):
    monkeypatch.setattr(shortest, "FEW", request.param)
    monkeypatch.setattr(shortest, "SHORT", request.param)


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_are_those_that_python_prints(kind):
    values = KINDS[kind].tolist()
    text = b"#1=A('1.5',(%s));" % b",\n".join(b"%#.17G" % value for value in values)
    wanted = b"#1=A('1.5',(%s));" % b",\n".join(map(printed, values))
    assert shortest.shorten(text) == wanted


def test_few_numbers_of_a_part_are_printed_one_by_one(monkeypatch):
    monkeypatch.setattr(shortest, "FEW", 0)
    left = []
    known = shortest.shortest
    monkeypatch.setattr(shortest, "shortest", lambda texts: known(left.extend(texts) or left))
    text = b",".join(b"%#.17G" % value for value in KINDS["of a part"].tolist())
    assert b"\0" not in shortest.shorten(b"(" + text + b");  ")
    assert len(left) < 0.03 * COUNT


@pytest.mark.parametrize(
    "text", [b"", b"1", b"a.b;", b"12.34567", b"#10=A(1.,2.5,'x.y',.T.,$);", b"(1.E-07,3.5E+20);"]
)
def test_what_is_short_already_stays(text):
    assert shortest.shorten(text) == text


def test_zeros_lose_their_sign_and_other_numbers_keep_it():
    text = b"(-0.,-0.00000000,-0.5,-0.0000000000000000E+00,-0.25000000,-1.,-0.)  -0."
    assert shortest.shorten(text) == b"(0.,0.,-0.5,0.,-0.25,-1.,0.)  -0."


@pytest.mark.parametrize("rare", range(3))
def test_a_word_is_found_wherever_it_is(rare):
    for text in (b"INF", b"(INF", b"INF,NI", b"IN(-INF)", b"INFINF"):
        assert shortest.holds(text, b"INF", rare)
    for text in (b"", b"IN", b"NF", b"I.NF,IN", b"F,N,I,FIN"):
        assert not shortest.holds(text, b"INF", rare)
