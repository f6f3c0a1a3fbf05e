"""What must hold for any text: it is read, or refused by an InputError; nothing else, and soon."""

from __future__ import annotations

import warnings

import numpy as np

from pc2cad.equation.language import read_expression
from pc2cad.equation.points import Combination, point
from pc2cad.errors import PointCadError
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.evaluation import Program
from pc2cad.expression.tree import Expr, symbol
from pc2cad.templates.file import parse_template

_AXES = ((4, 0, 0), (1, 5, 0), (-2, -1, 0), (1, 1, 6))
KNOWN = {
    **{name: symbol(name) for name in ("u", "v", "w", "p", "q")},
    **{name: point(*place) for name, place in zip("ABCD", _AXES, strict=True)},
}
_PLACES = {name: np.array([0.0, 0.3, 1.0]) for name in ("u", "v", "w", "p", "q")}


def read(text: str) -> bool:
    """Read an expression and use its trees; return whether it was accepted."""
    try:
        value = read_expression(text, KNOWN)
        trees = value.coordinates if isinstance(value, Combination) else (value,)
        _use([tree for tree in trees if isinstance(tree, Expr)])
    except PointCadError:
        return False
    return True


def read_template(text: str) -> bool:
    """Read a template and bind its defaults; return whether it was accepted."""
    try:
        equation = parse_template(text, "t", "t.toml").bind()
        _use(list(equation.coordinates))
    except PointCadError:
        return False
    return True


def _use(trees: list[Expr]) -> None:
    slopes = derivatives(tuple(trees), "u")
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        Program((*trees, *slopes))(_PLACES)
