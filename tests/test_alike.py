"""Pieces of one form are worked out as one function of tables, with the same values."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pc2cad as pc
from pc2cad.expression.alike import with_tables
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.evaluation import Program
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import pieces, walk

U, V, W = pc.parameters()
#: of each form: a function of v (and w) with three numbers in it
FORMS = (
    lambda a, b, c: a + b * V - c * V**2,
    lambda a, b, c: a * pc.cos(b * V + c),
    lambda a, b, c: c - pc.sin(a * V) * b + W,
    lambda a, b, c: pc.sqrt(a**2 + (V - b) ** 2) / (3 + c**2),
    lambda a, b, c: a - (b - pc.cos(V)) * (c - W),
)
NUMBERS = st.integers(-40, 40).map(lambda n: Fraction(n, 8))
PIECES = st.lists(st.tuples(st.integers(0, 4), NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=40)


def function(rows, closed=False):
    breaks = tuple(Fraction(i, len(rows)) for i in range(len(rows) + 1))
    return pieces(V, breaks, tuple((FORMS[f](*abc),) for f, *abc in rows), -1, closed)


@given(PIECES, st.booleans())
@settings(max_examples=60, deadline=None)
def test_values_and_slopes_are_those_of_each_piece(rows, closed):
    tree = function(rows, closed)
    if tree.op != "pieces":
        return  # one piece is no function in pieces
    roots = (tree, *derivatives((tree,), "v"))
    at = np.concatenate((np.arange(len(rows)) / len(rows), np.linspace(0.001, 0.999, 57)))
    found = Program(roots)({"v": at, "w": 0.25})
    for root, values in zip(roots, found, strict=True):
        wanted = [evaluate(root, {"v": x, "w": 0.25}) for x in at.tolist()]
        assert np.broadcast_to(values, at.shape) == pytest.approx(
            np.array(wanted), rel=1e-13, abs=1e-13
        )


def test_an_even_grid_of_two_parameters_has_the_same_values():
    rows = [(i % 5, Fraction(i, 3), Fraction(7 - i, 5), Fraction(i, 9)) for i in range(30)]
    tree = function(rows) * U
    u, v, w = np.ix_(np.linspace(0, 1, 4), np.linspace(0, 1, 61), np.linspace(0, 1, 3))
    (found,) = Program((tree,))({"u": u, "v": v, "w": w})
    wanted = [
        evaluate(tree, {"u": a, "v": b, "w": c})
        for a in u.ravel().tolist() for b in v.ravel().tolist() for c in w.ravel().tolist()
    ]  # fmt: skip
    assert found.ravel() == pytest.approx(np.array(wanted), rel=1e-13, abs=1e-13)


def test_the_work_for_many_arcs_does_not_grow_with_their_number():
    sizes = []
    for count in (20, 400):
        arcs = [(1, Fraction(3), Fraction(i, 2) + 1, Fraction(i, 7)) for i in range(1, count + 1)]
        (tree,) = with_tables((function(arcs),))
        sizes.append(sum(1 for node in walk((tree,)) if node.symbols))
    assert sizes[0] == sizes[1] < 12


def test_few_pieces_stay_as_they_are():
    tree = function([(1, 1, 2, 3), (1, 2, 3, 4), (1, 5, 4, 3)])
    assert with_tables((tree,)) == (tree,)
