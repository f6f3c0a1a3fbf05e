"""How far a side of the equation is from the surface of its face: proved where that can be had.

The side's trees become a program, which `replay` runs over cells with balls; cells are halved here
until the bound is sharp enough. What has no program there is bounded by Taylor models instead, and
is not replayed. Faces of analytic surfaces may be exact besides, by algebra.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.arrays.distinct import distinct
from pc2cad.bounds.deviation import bound_surface
from pc2cad.bounds.known import Known
from pc2cad.bounds.rational_deviation import bound_spline
from pc2cad.expression.breaks import BreaksNotAlignedError
from pc2cad.expression.tree import ZERO, Expr, number, walk
from pc2cad.geometry import carriers
from pc2cad.geometry.carriers import Evidence
from pc2cad.geometry.recognition.implicit import holds
from pc2cad.geometry.splines.bernstein import bezier_knots
from pc2cad.verify.arc_courses import arc_course, own_course
from pc2cad.verify.replay import OPERATIONS, Difference, Quadric, ReplayError, Spline

#: share of the tolerance that may be left open between the places
_SHARE = 0.01
#: rounds in which cells are halved, and those of them in which all are
_ROUNDS, _SHARPER = 16, 2
#: degree in which the distance from a plane is looked at by Taylor models
_FLAT = 7
#: cells to begin with where a surface has no knots
_CELLS = 8


@dataclass(frozen=True, eq=False)
class Nearness:
    """How far the patches of a side are from a face's surface, and what that rests on."""

    rests_on: Evidence
    #: a bound where it is one, else the largest distance seen
    distance: float
    #: what `replay` needs to find the bound again, one per patch; empty where it cannot
    claims: tuple[dict[str, Any], ...] = ()


#: a surface that runs as its side does: axes swapped, first and second of its own reversed
STRAIGHT: Final = (False, False, False)
#: before anything is proved
SEEN: Final = Nearness("sampled", 0.0)


def nearness(
    patches: Sequence[tuple[tuple[Expr, ...], tuple[str, ...]]],
    surface: Spline | Quadric,
    turn: Sequence[bool] | None,
    seen: float,
    tolerance: float,
    *,
    claims: bool = False,
    known: Known | None = None,
) -> Nearness:
    """Return how near all patches of a side, as trees and names, are to the surface of their face.

    The surface is as `replay` reads it; `turn` says how it runs over the patch, None where places
    are not compared at equal parameters. `seen` is the largest distance that was. With `claims`
    there comes what a replay needs, where it has a way. Models that are `known` are used, and added
    to.
    """
    evidence: list[Evidence] = []
    kept, largest = [], seen
    for trees, names in patches:
        exact = isinstance(surface, Quadric) and holds(_carrier(surface), trees)
        found = None
        if claims or not (exact or isinstance(surface, Spline)):
            found = _replayable(trees, names, surface, turn or STRAIGHT, tolerance)
        if found is not None and found[1] <= tolerance:
            kept.append(found[0])
            largest = max(largest, found[1])
        elif not exact:
            distance = _by_taylor_models(trees, names, surface, turn or STRAIGHT, known)
            if not distance <= tolerance:
                return Nearness("sampled", seen)
            largest = max(largest, distance)
        evidence.append("exact" if exact else "bounded")
    whole = tuple(kept) if len(kept) == len(patches) else ()
    return Nearness("bounded" if "bounded" in evidence else "exact", largest, whole)


def _replayable(
    trees: Sequence[Expr], names: Sequence[str], surface: Spline | Quadric,
    turn: Sequence[bool], tolerance: float,
) -> tuple[dict[str, Any], float] | None:  # fmt: skip
    """Return what a replay needs, and the bound that it finds; None where it has no way."""
    try:
        program, outputs = program_of(trees, names, turn)
        if isinstance(surface, Spline):
            cells = [distinct(row) for row in surface.knots]
        else:
            cells = [np.linspace(0.0, 1.0, _CELLS + 1)] * 2
        claim = {"program": program, "outputs": outputs}
        sharper = 0
        for _ in range(_ROUNDS):
            claim["cells"] = [row.tolist() for row in cells]
            difference = Difference(claim, surface)
            halved = _halved(difference, tolerance)
            if halved is None:
                distance = difference.bound()
                if distance <= tolerance or sharper == _SHARPER:
                    return claim, distance
                # coefficients are nearer to the values on smaller cells
                sharper += 1
                halved = [_split(row, np.ones(len(row) - 1, dtype=bool)) for row in cells]
            cells = halved
    except ReplayError:
        return None
    return None


def _halved(difference: Difference, tolerance: float) -> list[Array] | None:
    """Return the cells with those halved in which too much is left open; None where none is."""
    cells = difference.cells
    with np.errstate(all="ignore"):
        rests = [difference.distances(difference.remainder(axis)) for axis in (0, 1)]
    open_ = [np.isfinite(rest) & (rest > _SHARE * tolerance) for rest in rests]
    # a quotient or a root of a ball that is too wide: along the axis of which there are fewer
    coarser = int(len(cells[0]) > len(cells[1]))
    open_[coarser] = open_[coarser] | ~(np.isfinite(rests[0]) & np.isfinite(rests[1]))
    if not any(part.any() for part in open_):
        return None
    return [
        _split(row, np.asarray(part.any(axis=1 - axis)))
        for axis, (row, part) in enumerate(zip(cells, open_, strict=True))
    ]


def _split(points: Array, which: Booleans) -> Array:
    # what is the same in all cells of a direction has one
    which = np.broadcast_to(which, len(points) - 1)
    return np.sort(np.concatenate((points, 0.5 * (points[:-1] + points[1:])[which])))


class _Rows:
    """The rows of a program that `replay` can run: a few operations on earlier ones."""

    def __init__(self) -> None:
        self.rows: list[list[Any]] = []

    def add(self, op: str, *operands: Any) -> int:
        """Add a row; return its place."""
        self.rows.append([op, *operands])
        return len(self.rows) - 1

    def number(self, value: Fraction | float) -> int:
        """Add a number: it stands for all that are rounded to it."""
        return self.add("number", float(value))

    def quotient(self, a: int, b: int) -> int:
        return self.add("mul", a, self.add("inverse", b))

    def power(self, x: int, exponent: Fraction) -> int:
        """Add a power: products where it is whole, else of what is positive."""
        if exponent.denominator > 1:
            return self.add("exp", self.add("mul", self.number(exponent), self.add("log", x)))
        if exponent < 0:
            return self.power(self.add("inverse", x), -exponent)
        if exponent == 1:
            return x
        half = self.power(x, Fraction(exponent.numerator // 2))
        square = self.add("mul", half, half)
        return self.add("mul", square, x) if exponent % 2 else square

    def hyperbola(self, x: int, sign: float) -> int:
        """Add (exp(x) + sign exp(-x)) / 2."""
        up, down = self.add("exp", x), self.add("exp", self.add("neg", x))
        both = self.add("add", up, down if sign > 0.0 else self.add("neg", down))
        return self.add("mul", self.number(0.5), both)

    def beside(self, x: int, sign: float, exponent: Fraction) -> int:
        """Add a power of 1 + sign x²."""
        square = self.add("mul", x, x)
        return self.power(
            self.add("add", self.number(1.0), square if sign > 0.0 else self.add("neg", square)),
            exponent,
        )

    def arc(self, x: int) -> int:
        """Add the arc of a sine, x, as that of its tangent."""
        return self.add("atan", self.add("mul", x, self.beside(x, -1.0, Fraction(-1, 2))))


def program_of(
    trees: Sequence[Expr], names: Sequence[str], turn: Sequence[bool] = STRAIGHT
) -> tuple[list[list[Any]], list[int]]:
    """Return trees in two parameters as rows of a program, and the rows of their values.

    The program is in the surface's own parameters: the side's are swapped and reversed by `turn`.
    """
    program, places = _Rows(), dict[Expr, int]()
    swap, *back = turn
    for node in walk(tuple(trees)):
        operands = [places[arg] for arg in node.args]
        if node.op == "number":
            place = program.number(node.payload)
        elif node.op == "constant":
            place = program.number({"pi": math.pi, "e": math.e}[node.payload])
        elif node.op == "symbol":
            axis = list(names).index(node.payload) ^ swap
            place = program.add("symbol", axis)
            if back[axis]:
                place = program.add("add", program.number(1.0), program.add("neg", place))
        elif node.op == "pow" and node.args[1].op == "number":
            place = program.power(operands[0], node.args[1].payload)
        elif node.op == "div":
            place = program.quotient(*operands)
        elif node.op in _LOWERED:
            place = _LOWERED[node.op](program, operands[0])
        elif node.op in OPERATIONS:
            place = program.add(node.op, *operands)
        else:
            raise ReplayError(f"the operation {node.op!r}, which is not known there")
        places[node] = place
    return program.rows, [places[tree] for tree in trees]


#: what a replay has no operation for, by those that it has
_LOWERED: Final[dict[str, Callable[[_Rows, int], int]]] = {
    "sqrt": lambda r, x: r.power(x, Fraction(1, 2)),
    "tan": lambda r, x: r.quotient(r.add("sin", x), r.add("cos", x)),
    "sinh": lambda r, x: r.hyperbola(x, -1.0),
    "cosh": lambda r, x: r.hyperbola(x, 1.0),
    "tanh": lambda r, x: r.quotient(r.hyperbola(x, -1.0), r.hyperbola(x, 1.0)),
    "asin": lambda r, x: r.arc(x),
    "acos": lambda r, x: r.add("add", r.number(math.pi / 2), r.add("neg", r.arc(x))),
    "asinh": lambda r, x: r.add("log", r.add("add", x, r.beside(x, 1.0, Fraction(1, 2)))),
}


def _by_taylor_models(
    trees: tuple[Expr, ...], names: Sequence[str], surface: Spline | Quadric,
    turn: Sequence[bool], known: Known | None,
) -> float:  # fmt: skip
    """Return a bound for splines and planes; infinite where there is none."""
    if isinstance(surface, Spline):
        degrees, knots, poles = _turned(surface, turn)
    elif surface.kind == "PLANE":
        height = ZERO
        for tree, o, n in zip(trees, surface.origin, surface.axes[2], strict=True):
            height = height + number(float(n)) * (tree - number(float(o)))
        trees, degrees = (height, ZERO, ZERO), (_FLAT, _FLAT)
        knots = bezier_knots(_FLAT), bezier_knots(_FLAT)
        poles = np.zeros((_FLAT + 1, _FLAT + 1, 3))
    else:
        return np.inf
    try:
        if poles.shape[2] == 4:
            return _by_arcs(trees, names, degrees, knots, poles, known or Known())
        spline = carriers.SplineSurface(degrees, knots, poles)
        return bound_surface(trees, names, spline, known=known).largest
    except BreaksNotAlignedError:
        return np.inf


def _by_arcs(
    trees: tuple[Expr, ...], names: Sequence[str], degrees: tuple[int, int],
    knots: tuple[Array, Array], poles: Array, known: Known,
) -> float:  # fmt: skip
    """Return a bound for a rational spline that runs through single arcs, else infinity."""
    weights = poles[..., 3] / poles[0, 0, 3]
    courses = [
        arc_course(trees, names[k], knots[k], weights[0] if k else weights[:, 0]) for k in (0, 1)
    ]
    if not any(courses):
        return np.inf
    own = [c or own_course(p, row) for c, p, row in zip(courses, degrees, knots, strict=True)]
    carrier = carriers.SplineSurface(degrees, knots, poles[..., :3] / poles[..., 3:], weights)
    return bound_spline(trees, names, carrier, own, known).largest


def _turned(
    surface: Spline, turn: Sequence[bool]
) -> tuple[tuple[int, int], tuple[Array, Array], Array]:
    """Return degrees, knots and poles of a spline, turned so that it runs as its side does."""
    (p, q), (u, v), poles = surface.degrees, surface.knots, surface.poles
    swap, back_u, back_v = turn
    if back_u:
        poles, u = poles[::-1], 1.0 - u[::-1]
    if back_v:
        poles, v = poles[:, ::-1], 1.0 - v[::-1]
    return ((q, p), (v, u), poles.transpose(1, 0, 2)) if swap else ((p, q), (u, v), poles)


def _carrier(surface: Quadric) -> carriers.Plane | carriers.AnalyticSurface:
    frame, lengths = carriers.Frame(surface.origin, surface.axes), surface.lengths
    match surface.kind:
        case "PLANE":
            return carriers.Plane(surface.origin, surface.axes[2])
        case "CYLINDRICAL_SURFACE":
            return carriers.Cylinder(frame, lengths[0])
        case "CONICAL_SURFACE":
            return carriers.Cone(frame, lengths[0], lengths[1])
        case "SPHERICAL_SURFACE":
            return carriers.Sphere(frame, lengths[0])
    return carriers.Torus(frame, lengths[0], lengths[1])
