"""What would mend an overlap: the period of M, or how far a parameter may run without one."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from math import pi

import numpy as np

from pc2cad.domain.analysis import Analysis, analyse
from pc2cad.domain.map import open_grid
from pc2cad.errors import NotASolidError
from pc2cad.expression.normal_form import split_turns
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, number, substitute, symbol, walk
from pc2cad.solidity.face_mesh import cut
from pc2cad.solidity.self_intersection import Contact, find_contact

#: halvings in the search for the valid part of a domain, and the largest mesh it is tried on
SHORTENINGS, LARGEST_TRIED = 7, 4000
#: what counts as touching in that search, as a share of the part's size
ROUGHLY = 1e-4


def advice(analysis: Analysis, meets: bool = True) -> str:
    """Say what would mend an overlap: the period where a direction runs beyond it.

    How far a parameter may run is told where the boundary `meets` itself: that is what is tried.
    """
    for d, name in enumerate(PARAMETERS):
        low, high = analysis.equation.limits[d]
        period = _period(analysis, d)
        if period is not None and period < 1 - 1e-9:
            length = period * (high - low)
            return (
                f"M repeats itself in {name} with the period {_written(length)}: shorten the "
                f"domain of {name} to [{low:g}, {_written(low + length)}] at most"
            )
    # layers share all of w
    directions = (1, 0) if analysis.equation.layers else (2, 1, 0)
    shorter = [text for d in directions if meets and (text := _shorter(analysis, d))]
    general = "a larger pitch or distance between strands"
    if shorter:
        return f"it does not for {' or for '.join(shorter)}; {general} may do as well"
    return f"a thinner wall or smaller section, {general}, or a shorter domain would part them"


def _shorter(analysis: Analysis, direction: int) -> str:
    """Say how far a parameter can run before the boundary meets itself, where that mends it."""
    if sum(face_mesh.nodes.size for face_mesh in cut(analysis)) > LARGEST_TRIED:
        return ""
    name, (low, high) = PARAMETERS[direction], analysis.equation.domain[direction]
    for upper in (True, False):
        if not _holds(analysis, direction, Fraction(1, 2), upper):
            continue
        reach, step = Fraction(1, 2), Fraction(1, 4)
        for _ in range(SHORTENINGS):
            if _holds(analysis, direction, reach + step, upper):
                reach += step
            step /= 2
        share = float(reach if upper else 1 - reach)
        limit = evaluate(low, {}) + share * (evaluate(high, {}) - evaluate(low, {}))
        return f"{name} {'up to' if upper else 'from'} about {limit:.3g}"
    return ""


def _holds(analysis: Analysis, direction: int, share: Fraction, upper: bool) -> bool:
    """Say whether the boundary of a part of the box, a share of one direction, meets itself not."""
    equation = analysis.equation
    domain = list(equation.domain)
    low, high = domain[direction]
    kept = number(share) * (high - low)
    domain[direction] = (low, low + kept) if upper else (high - kept, high)
    try:
        # a part of the box has not all of the layers
        whole = (domain[0], domain[1], domain[2])
        part = analyse(replace(equation, domain=whole, layers=(), depth=None))
        return not isinstance(find_contact(part, cut(part), ROUGHLY), Contact)
    except NotASolidError:
        return False


def _period(analysis: Analysis, direction: int) -> float | None:
    """Return the period of M in one direction (of length 1), where one is found."""
    name = PARAMETERS[direction]
    found: list[float] = []
    for node in walk(analysis.map.coordinates):
        if node.op in ("sin", "cos") and name in node.symbols:
            step = _turn_rate(node.args[0], name)
            if step:
                found.append(2 / step)
    for period in sorted(found, reverse=True):
        grid = [np.linspace(0.05, 0.95, 5)] * 3
        here = analysis.map.points(*open_grid(*grid))
        grid[direction] = grid[direction] + period
        if np.abs(analysis.map.points(*open_grid(*grid)) - here).max() <= 1e-9 * analysis.size:
            return period
    return None


def _turn_rate(argument: Expr, name: str) -> float:
    """Return r where the argument grows by r·pi per unit of the symbol (0 where it does not)."""
    (shifted,) = substitute((argument,), {name: symbol(name) + 1})
    turns, rest = split_turns(shifted - argument)
    return abs(float(turns) + evaluate(rest, {}) / pi) if not rest.symbols else 0.0


def _written(value: float) -> str:
    """Return a number as it may be written: six digits of 2*pi are more than that."""
    short = f"{value:.6g}"
    for unit, name in ((1.0, ""), (pi, "*pi")):
        share = Fraction(value / unit).limit_denominator(60)
        if float(short) != value and abs(float(share) * unit - value) <= 1e-12 * abs(value):
            return f"{share}{name}".removeprefix("1*")
    return short
