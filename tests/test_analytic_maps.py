"""Which maps are known to be analytic up to their limits, and which are only looked at."""

import pytest

from pc2cad.expression.end_roots import is_analytic
from pc2cad.expression.tree import PI, call, number, symbol
from pc2cad.topology.cells import SYMMETRIES, Symmetry

u, v = symbol("u"), symbol("v")
COSINE = call("cos", 2 * PI * v)


@pytest.mark.parametrize(
    "tree",
    [
        u**3 * v - 2,
        call("sin", u * v) * call("exp", u) / 3,
        1 / (1 + u),
        call("sqrt", 2 + COSINE) * u,
        call("sqrt", 4 * COSINE**2 + call("sin", 2 * PI * v) ** 2),
        (1 + v) ** number(1.5) / (u - 2),
        (u + 1) ** -2,
    ],
)
def test_what_vanishes_nowhere_leaves_functions_analytic(tree):
    assert is_analytic((tree, u))


@pytest.mark.parametrize(
    "tree",
    [
        call("sqrt", u),
        call("sqrt", 1 - v * v),
        call("sqrt", call("sin", PI * v)),
        u ** number(1.5),
        1 / u,
        u**-1,
        call("sqrt", u - 2),  # it has no values at all
        call("sqrt", u + v + 1),  # of two parameters: left to samples
        call("abs", u),
        call("asin", u),
        2**u,
    ],
)
def test_others_are_left_to_samples(tree):
    assert not is_analytic((u, tree))


@pytest.mark.parametrize("symmetry", SYMMETRIES)
def test_symmetries_are_undone_by_their_inverses(symmetry: Symmetry):
    table = [[1, 2, 3], [4, 5, 6], [7, 8, 9]]

    def read(one, values):
        rows = values[:: -1 if one.reverse_s else 1]
        rows = [row[:: -1 if one.reverse_t else 1] for row in rows]
        return [list(row) for row in zip(*rows, strict=True)] if one.swap else rows

    assert read(symmetry.inverse, read(symmetry, table)) == table
    assert read(symmetry, read(symmetry.inverse, table)) == table
    assert symmetry.inverse.determinant == symmetry.determinant
    # at (0, 0), (1, 0), (0, 1) and (1, 1)
    (a, _, b), _, (c, _, d) = read(symmetry, table)
    assert symmetry.corners((1, 7, 3, 9)) == (a, c, b, d)
