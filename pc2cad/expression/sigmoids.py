"""Logistic functions written as tanh: 1/(1 + exp(x)) = (1 - tanh(x/2))/2.

The exponential of a wide disc comes near to every number, -1 too, so that nothing would be known
of the quotient; of tanh it is known that it is level far from 0.
"""

from __future__ import annotations

from fractions import Fraction

from pc2cad.expression.rewriting import rewrite
from pc2cad.expression.tree import Expr, call, number, ops_of

HALF = Fraction(1, 2)


def as_tanh(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return equal trees without quotients by p + q exp(x), p and q positive numbers."""
    return rewrite(roots, "div", _rewritten, keep=True) if "exp" in ops_of(roots) else roots


def _rewritten(node: Expr) -> Expr:
    above, below = node.args
    if below.op != "add":
        return node
    for constant, other in (below.args, below.args[::-1]):
        factor, exponential = _scaled(other)
        if constant.op != "number" or exponential.op != "exp" or not exponential.symbols:
            continue
        p: Fraction = constant.payload
        q = factor
        if not (p > 0 and q > 0):
            continue
        half = exponential.args[0] * HALF
        if p != q:
            half = half + call("log", number(q / p)) * HALF
        share, same = _scaled(above)
        if same is exponential:
            return (1 + call("tanh", half)) * (share / (2 * q))
        return above * ((1 - call("tanh", half)) * (1 / (2 * p)))
    return node


def _scaled(tree: Expr) -> tuple[Fraction, Expr]:
    """Return a tree as a number times a tree."""
    if tree.op == "mul":
        for factor, other in (tree.args, tree.args[::-1]):
            if factor.op == "number":
                return factor.payload, other
    return Fraction(1), tree
