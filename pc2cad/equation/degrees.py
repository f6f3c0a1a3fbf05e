"""Angles that look like degrees: sines and cosines take radians."""

from __future__ import annotations

from fractions import Fraction
from math import pi

from pc2cad.equation.point_equation import PointEquation
from pc2cad.expression.normal_form import split_turns
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import Expr, substitute, symbol, walk


def degrees_remark(equation: PointEquation) -> str:
    """Return a sentence on the first angle that runs through a number of degrees, or nothing.

    That is one that grows by a multiple of 30 or 45, with no pi in it, over a parameter's range.
    """
    for node in walk(equation.coordinates):
        if node.op not in ("sin", "cos", "tan"):
            continue
        for name, (low, high) in zip(PARAMETERS, equation.limits, strict=True):
            span = _slope(node.args[0], name) * Fraction(high - low)
            if span >= 30 and (span % 30 == 0 or span % 45 == 0):
                text = repr(node.args[0])
                angle = text if len(text) < 60 else "…"
                return (
                    f"angles are in radians: that of {node.op}({angle}) goes through "
                    f"{float(span):g}, which is {float(span) / (2 * pi):.3g} turns, as {name} "
                    f"runs; degrees are written {node.op}(({angle})*deg)"
                )
    return ""


def _slope(argument: Expr, name: str) -> Fraction:
    """Return by what an angle grows per unit of a parameter, 0 where that is no whole number."""
    if name not in argument.symbols:
        return Fraction(0)
    (moved,) = substitute((argument,), {name: symbol(name) + 1})
    turns, rest = split_turns(moved - argument)
    return abs(rest.payload) if turns == 0 and rest.op == "number" else Fraction(0)
