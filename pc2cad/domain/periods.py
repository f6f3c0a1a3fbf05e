"""Directions in which M goes on beyond the end as it began: splines along them have no ends."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.domain.sections import SECTIONS
from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import PI, Expr, symbol, walk

#: angles of more terms are not looked at
LARGEST_ANGLE = 24


def is_periodic(analysis: Analysis, direction: int) -> bool:
    """Say whether M continues beyond the end of a direction as it began, by algebra or as seen."""
    if len(analysis.bounds[direction]) > 2 or _has_faces(analysis, direction):
        return False
    if turns_whole(analysis.map.coordinates, PARAMETERS[direction]):
        return True
    # most directions do not even end where they begin
    return all(_comes_round(analysis, direction, nodes) for nodes in (SECTIONS[:1], SECTIONS))


def _has_faces(analysis: Analysis, direction: int) -> bool:
    """Say whether faces lie at the limits of a direction: where M came round they would be none."""
    return any(face.patch[direction] % 2 == 0 for face in analysis.complex.faces)


def turns_whole(trees: tuple[Expr, ...], name: str) -> bool:
    """Say whether a symbol is met by sines and cosines of whole turns of it alone: 2πk·name + ….

    What such trees are has the period 1 in it.
    """

    def below(node: Expr) -> tuple[Expr, ...]:
        waves = node.op in ("sin", "cos")
        return () if waves else tuple([arg for arg in node.args if name in arg.symbols])

    nodes = walk(tuple([root for root in trees if name in root.symbols]), below)
    return all(node.op != "symbol" and _is_whole(node, name) for node in nodes)


@lru_cache(maxsize=256)
def _is_whole(node: Expr, name: str) -> bool:
    if node.op not in ("sin", "cos"):
        return True
    form = normal_form(node.args[0], LARGEST_ANGLE)
    if form is None:
        return False
    own = {m: c for m, c in form.items() if any(name in atom.symbols for atom, _ in m)}
    turn = {(PI, 1), (symbol(name), 1)}
    return all(set(m) == turn and _is_even(c) for m, c in own.items())


def _is_even(number: Fraction) -> bool:
    return number.denominator == 1 and number.numerator % 2 == 0


def _comes_round(analysis: Analysis, direction: int, nodes: Array) -> bool:
    """Say whether M is the same at some places of a direction and one length further on."""
    grid = [SECTIONS] * 3
    grid[direction] = np.concatenate((nodes, nodes + 1))
    values = np.moveaxis(analysis.map.points(*open_grid(*grid)), direction, 0)
    gap = np.abs(values[len(nodes) :] - values[: len(nodes)]).max()
    return bool(gap <= 10 * analysis.scale.same_point)
