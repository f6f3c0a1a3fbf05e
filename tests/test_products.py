"""Sums of products, and the parameters on which a tree turns out not to depend."""

from __future__ import annotations

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.evaluation import Program
from pc2cad.expression.separable_sums import product_of, products
from pc2cad.expression.simplification import simplified, without_idle
from pc2cad.expression.tree import ZERO, call, walk
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import template_paths

U, V, W = pc.parameters()
PLACES = {name: np.linspace(0.03, 0.96, 7) for name in "uvw"}


def values(tree):
    return np.broadcast_to(Program((tree,))(PLACES)[0], 7)


@pytest.mark.parametrize("name", "uvw")
def test_products_add_up_to_the_tree(name):
    tree = (U * V + call("sin", V) * (W - U**2)) ** 2 / (2 + call("cos", V)) - 3 * W
    found = products((tree,), name)
    assert all(c.symbols <= {name} for c in found[0].values())
    assert all(name not in product_of(f).symbols for f in found[0])
    total = sum((product_of(f) * c for f, c in found[0].items()), start=ZERO)
    assert values(total) == pytest.approx(values(tree), rel=1e-13)


def test_no_sum_of_products():
    assert products((call("sqrt", U + V),), "u") is None
    assert products((U / (U + V),), "u") is None


@pytest.mark.parametrize("name", ["channel_ellipse", "channel_sine", "channel_contour"])
def test_a_section_is_as_far_from_its_guide_in_any_frame(name):
    M = read_template(template_paths()[name]).bind().coordinates
    short = simplified(M)
    roots = [node.symbols for node in walk(short) if node.op == "sqrt"]
    assert all(len(names) == 1 for names in roots)
    for tree, same in zip(M, short, strict=True):
        assert values(same) == pytest.approx(values(tree), rel=1e-12, abs=1e-12)


def test_a_frame_that_is_not_at_right_angles_stays():
    square = (call("cos", V) + (1 + U**2) * call("sin", V)) ** 2 + (U * V) ** 2
    assert without_idle(square) is square
    assert without_idle(U * V - V * U + W) is W


def test_a_parameter_of_little_weight_is_not_idle():
    tree = V * (1 + call("sin", 1000 * U) / 10**11)
    assert without_idle(tree) is tree


def test_sums_that_are_constant_along_a_helix():
    """N''·N' = 0 and N'·N' is constant: the frame has no quotient by a function, |KN| no u."""
    N = (3 * pc.cos(U), 3 * pc.sin(U), U / 2)
    first = derivatives(N, "u")
    second = derivatives(first, "u")
    square = sum((x * x for x in first), start=ZERO)
    share = sum((x * y for x, y in zip(first, second, strict=True)), start=ZERO) / square
    out = tuple(y - x * share for x, y in zip(first, second, strict=True))
    length = pc.sqrt(sum((x * x for x in out), start=ZERO))
    (x, y, z) = simplified(tuple(x / length for x in out))
    assert not [n for tree in (x, y, z) for n in walk((tree,)) if n.op == "div" and n.symbols]
    assert values(z) == pytest.approx(0, abs=0)
    assert values(x) == pytest.approx(-np.cos(PLACES["u"]), rel=1e-14)
