"""Walks over trees: what is remembered of nodes, and what is not looked at."""

from __future__ import annotations

import pytest

from pc2cad.expression.plain_functions import of_powers_or_waves
from pc2cad.expression.recent import Recent
from pc2cad.expression.rewriting import has_more, rewrite
from pc2cad.expression.tree import ONE, Expr, call, number, symbol, walk
from pc2cad.geometry.splines.bernstein import degree_in

U, V, W = (symbol(name) for name in "uvw")


def test_operands_come_first_and_once() -> None:
    root = (U + V) * (U + V) + call("sin", U * V)
    nodes = walk((root, U + V))
    assert len(nodes) == len(set(nodes))
    for k, node in enumerate(nodes):
        assert set(node.args) <= set(nodes[:k])
    assert nodes[-1] is root


def test_nothing_more_is_looked_at_after_the_worst() -> None:
    looked: list[Expr] = []

    def find(node: Expr, _: dict[Expr, bool]) -> bool:
        looked.append(node)
        return node.op != "sin"

    bad = call("sin", U)
    above = bad + V
    root = above * (V + W)
    known: Recent[bool] = Recent()
    found = known.of((root,), find, lambda node: None, worst=False)
    assert found[root] is found[above] is found[bad] is False
    assert looked == [U, bad]
    # it is remembered of all above, and found below others
    looked.clear()
    assert False in known.of((above + W,), find, lambda node: None, worst=False).values()
    assert looked == []


@pytest.mark.parametrize("leaves", [True, False])
def test_how_many_nodes_a_tree_has(leaves: bool) -> None:
    root = (U + V) * (U + V) + call("sin", U * V)
    count = sum(1 for node in walk((root,)) if leaves or node.args)
    assert has_more(root, count - 1, leaves)
    assert not has_more(root, count, leaves)
    assert has_more(U, 0)
    assert not has_more(U, 0, leaves=False)


def _without_root(node: Expr) -> Expr:
    return node.args[0]


def test_what_becomes_of_a_tree_is_the_same_again() -> None:
    inner = call("sqrt", U + V)
    root = call("sin", inner) + call("sqrt", 2 + inner) * W
    plain = call("sin", U + V) + (2 + (U + V)) * W
    for keep in (False, True, True):
        assert rewrite((root, W), "sqrt", _without_root, keep) == (plain, W)
    # with another change it is another tree
    assert rewrite((root,), "sqrt", lambda node: ONE) == (call("sin", ONE) + W,)


def test_degrees_of_trees_that_are_no_polynomials() -> None:
    wave = call("sin", U)
    for _ in range(2):
        assert degree_in((V * V, wave + V), "u") is None
        assert degree_in((V * V, wave + V), "v") == 2
        assert degree_in((wave * V,), "v") == 1
        assert degree_in((number(3),), "u") == 0
        assert not of_powers_or_waves((U, call("exp", U) * V), "u")
        assert of_powers_or_waves((U, call("exp", U) * V), "v")
        assert of_powers_or_waves((call("cos", call("exp", U)),), "u")
