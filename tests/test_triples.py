"""Triple products of vectors with lengths taken out are those of the vectors as they are."""

import pytest

from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import ONE, ZERO, call, number, symbol
from pc2cad.solidity.jacobian_proof.determinant import determinant
from pc2cad.solidity.jacobian_proof.triples import minor, scaled, triple

u, v = symbol("u"), symbol("v")
SINE, COSINE = call("sin", u), call("cos", u)
LENGTH = 1 / call("sqrt", 1 + u * u)
VECTORS = [
    (COSINE, SINE, 3 * u),
    (2 * LENGTH * COSINE, -LENGTH * (SINE * 2), ZERO),
    (-(u * LENGTH) * SINE / 5, u * LENGTH, LENGTH * u),
]


@pytest.mark.parametrize("k", range(3))
@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (1, 2)])
def test_triple_products_are_those_of_whole_vectors(k, pair):
    i, j = pair
    rows = scaled([(vector, v ** (n + 1)) for n, vector in enumerate(VECTORS)], "u")
    slope = derivatives(VECTORS[k], "u")
    whole = determinant((slope, VECTORS[i], VECTORS[j]))
    # what is constant went to the factors
    shares = [row.factor / v ** (n + 1) for n, row in enumerate(rows)]
    found = triple(rows, k, i, j, "u") * shares[k] * shares[i] * shares[j]
    for place in (0.2, 0.7):
        values = {"u": place, "v": 0.9}
        assert evaluate(found, values) == pytest.approx(evaluate(whole, values), abs=1e-14)


def test_multiples_of_one_vector_share_a_term():
    one = (COSINE, -SINE, ZERO)
    other = tuple(-3 * call("sqrt", 1 + v * v) * ZERO + 7 * x for x in one)
    rows = scaled([(one, v), (other, v * v), ((ZERO, ZERO, u), ONE)], "u")
    assert len(rows) == 2
    assert evaluate(rows[0].factor, {"v": 2.0}) == 2 + 7 * 4
    assert rows[1].length is u
    assert rows[1].vector == (ZERO, ZERO, ONE)


def test_what_cancels_is_no_term():
    rows = scaled([((COSINE, SINE, ZERO), ONE), ((SINE, -COSINE, ZERO), v)], "u")
    rows += scaled([((ZERO, ZERO, ONE), v * v)], "u")
    assert triple(rows, 0, 0, 2, "u") is not ZERO
    assert triple(rows, 0, 1, 2, "u") is ZERO  # the derivative is along the other vector


W = symbol("w")
WALL = 1 + (W - number(0.5)) / call("sqrt", 2 + call("cos", v))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (3 * call("cos", v) * WALL, -call("sin", v) * WALL),
        (3 * call("cos", v) + 3 * (W - number(0.5)) * call("cos", v), v * (W + number(0.5))),
        (WALL * W, WALL * W * W),
        (WALL * W * v, WALL * call("exp", v)),
        (v * W + W, v + W * W),
        (number(3), WALL),
        (v * v, call("sin", v)),
    ],
)
def test_minors_of_factors_are_those_of_their_derivatives(first, second):
    found = minor(first, second, ("v", "w"))
    (f_v, g_v), (f_w, g_w) = (derivatives((first, second), name) for name in ("v", "w"))
    for values in ({"v": 0.3, "w": 0.9}, {"v": 0.8, "w": 0.2}):
        expected = evaluate(f_v * g_w - f_w * g_v, values)
        assert evaluate(found, values) == pytest.approx(expected, rel=1e-13, abs=1e-13)


def test_what_factors_share_is_not_derived_along_the_section():
    first = 3 * call("cos", v) + 6 * ((W - number(0.5)) * call("cos", v) * v)
    second = call("sin", v) + 2 * ((W - number(0.5)) * call("sin", v) * v)
    found = minor(first, second, ("v", "w"))
    assert "sin" not in found.ops
    assert "cos" not in found.ops
