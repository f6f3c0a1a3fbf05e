"""The names of the equation language, and what they stand for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Final

from pc2cad.equation import points
from pc2cad.equation.points import Value
from pc2cad.equation.syntax import WORDS
from pc2cad.expression.functions import PUBLIC_FUNCTIONS
from pc2cad.expression.tree import PI, E, Expr, call

PARAMETER_NAMES: Final = ("u", "v", "w")
CONSTANTS: Final[dict[str, Expr]] = {"pi": PI, "e": E, "deg": PI / 180}

POINT_FUNCTIONS: Final[dict[str, tuple[Callable[..., Value], tuple[str, ...]]]] = {
    "dot": (points.dot, ("a", "b")),
    "cross": (points.cross, ("a", "b")),
    "length": (points.length, ("a",)),
    "unit": (points.unit, ("a",)),
    "distance": (points.distance, ("A", "B")),
    "det": (points.det, ("a", "b", "c")),
    "metric": (points.metric, ("A", "B", "C")),
    "translate": (points.translate, ("A", "B", "C")),
    "exit_from_plane": (points.exit_from_plane, ("N", "P", "Q")),
    "rotate": (points.rotate, ("P", "O", "a", "angle")),
    "rotx": (points.rotx, ("P", "angle")),
    "roty": (points.roty, ("P", "angle")),
    "rotz": (points.rotz, ("P", "angle")),
}
COORDINATE_FUNCTIONS: Final = {"point": points.point, "vector": points.vector}

#: made of other functions as soon as they are read
SHORTHANDS: Final[dict[str, tuple[Callable[..., Expr], tuple[str, ...]]]] = {
    "clamp": (lambda x, a, b: call("min", call("max", x, a), b), ("x", "a", "b")),
    "hypot": (lambda x, y: call("sqrt", x**2 + y**2), ("x", "y")),
}

FUNCTION_NAMES: Final = (
    *PUBLIC_FUNCTIONS, *SHORTHANDS, *POINT_FUNCTIONS, *COORDINATE_FUNCTIONS, "diff", "if", "sum",
)  # fmt: skip
#: functions and constants that came when templates had values of these names: they may keep them
SHADOWED_NAMES: Final = frozenset((
    "min", "max", "clamp", "sign", "floor", "mod", "hypot", "rotate", "rotx", "roty", "rotz", "deg",
))  # fmt: skip
RESERVED_NAMES: Final = (
    frozenset((*PARAMETER_NAMES, *CONSTANTS, *FUNCTION_NAMES, *WORDS)) - SHADOWED_NAMES
)


@dataclass(frozen=True)
class Listed:
    """A list of [data]: rows of numbers or expressions; one row where it is a plain list."""

    rows: tuple[tuple[Expr, ...], ...]
    plain: bool


#: what a name stands for
Named = Value | Listed
#: functions that a template defines for itself, such as a contour's x(t); they take as many
#: scalars as their `arity` says, one if it says nothing
Curves = Mapping[str, Callable[..., Value]]


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a hint that lists the nearest known names (empty when nothing is near)."""
    known = list(known)
    close = get_close_matches(name, known, n=3, cutoff=0.5)
    # of what is far, that which begins alike
    near = [k for k in close if k[:1] == name[:1] or k in get_close_matches(name, [k], cutoff=0.61)]
    close = near or close
    close += [k for k in known if k.lower() == name.lower() and k not in close]
    return f"; did you mean {' or '.join(close)}?" if close else ""
