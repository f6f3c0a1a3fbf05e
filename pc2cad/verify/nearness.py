"""How far a side of the equation is from the surface of its face: proved where that can be had.

The side's trees become a program, which `replay` runs over cells with balls; cells are halved here
until the bound is sharp enough. What has no program there is bounded by Taylor models instead, and
is not replayed. Faces of analytic surfaces may be exact besides, by algebra.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.arrays.distinct import distinct
from pc2cad.bounds.deviation import bound_surface
from pc2cad.expression.breaks import BreaksNotAlignedError
from pc2cad.expression.tree import ZERO, Expr, number, walk
from pc2cad.geometry import carriers
from pc2cad.geometry.carriers import Evidence
from pc2cad.geometry.recognition.implicit import holds
from pc2cad.geometry.splines.bernstein import bezier_knots
from pc2cad.verify.balls import ReplayError
from pc2cad.verify.replay import Difference, Quadric, Spline, lebesgue

#: degrees above the spline's with which differences are interpolated, and that of other surfaces
_MORE, _DEGREE = 3, 10
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
) -> Nearness:
    """Return how near all patches of a side, as trees and names, are to the surface of their face.

    The surface is as `replay` reads it, turned as the patch runs; `turn` is None where places are
    not compared at equal parameters. `seen` is the largest distance that was. With `claims` there
    comes what a replay needs, where it has a way.
    """
    evidence: list[Evidence] = []
    kept, largest = [], seen
    for trees, names in patches:
        exact = isinstance(surface, Quadric) and holds(_carrier(surface), trees)
        found = None
        if claims or not (exact or isinstance(surface, Spline)):
            found = _replayable(trees, names, surface, tolerance)
        if found is not None and found[1] <= tolerance:
            kept.append({**found[0], "turn": list(turn or (False, False, False))})
            largest = max(largest, found[1])
        elif not exact:
            distance = _by_taylor_models(trees, names, surface)
            if not distance <= tolerance:
                return Nearness("sampled", seen)
            largest = max(largest, distance)
        evidence.append("exact" if exact else "bounded")
    whole = tuple(kept) if len(kept) == len(patches) else ()
    return Nearness("bounded" if "bounded" in evidence else "exact", largest, whole)


def _replayable(
    trees: Sequence[Expr], names: Sequence[str], surface: Spline | Quadric, tolerance: float
) -> tuple[dict[str, Any], float] | None:
    """Return what a replay needs, and the bound that it finds; None where it has no way."""
    try:
        program, outputs = program_of(trees, names)
        if isinstance(surface, Spline):
            cells = [distinct(row) for row in surface.knots]
            degrees = [p + _MORE for p in surface.degrees]
        else:
            cells, degrees = [np.linspace(0.0, 1.0, _CELLS + 1)] * 2, [_DEGREE, _DEGREE]
        claim = {"program": program, "outputs": outputs, "degrees": degrees}
        distance, sharper = np.inf, 0
        for _ in range(_ROUNDS):
            claim["cells"] = [row.tolist() for row in cells]
            difference = Difference(claim, surface)
            halved = _halved(difference, cells, tolerance)
            if halved is None:
                distance, seen = difference.bound()
                if distance <= tolerance or not seen <= tolerance or sharper == _SHARPER:
                    return claim, distance
                # coefficients are nearer to the values on smaller cells
                sharper += 1
                halved = [_split(row, np.ones(len(row) - 1, dtype=bool)) for row in cells]
            cells = halved
    except ReplayError:
        return None
    return None


def _halved(difference: Difference, cells: Sequence[Array], tolerance: float) -> list[Array] | None:
    """Return the cells with those halved in which too much is left open; None where none is."""
    with np.errstate(all="ignore"):
        own = difference.surface
        rests = [own.distance(*difference.remainder(axis)) for axis in (0, 1)]
        rests[1] = lebesgue(difference.degrees[0]) * rests[1]
    open_ = [np.isfinite(rest) & (rest > _SHARE * tolerance) for rest in rests]
    # a quotient or a root of a ball that is too wide: along the axis of which there are fewer
    coarser = int(len(cells[0]) > len(cells[1]))
    unknown = ~(np.isfinite(rests[0]) & np.isfinite(rests[1]))
    open_[coarser] = np.asarray(open_[coarser] | unknown)
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


def program_of(trees: Sequence[Expr], names: Sequence[str]) -> tuple[list[list[Any]], list[int]]:
    """Return trees in two parameters as rows of a program, and the rows of their values."""
    rows: list[list[Any]] = []
    places: dict[Expr, int] = {}
    for node in walk(tuple(trees)):
        if node.op == "number":
            row: list[Any] = ["number", str(node.payload)]
        elif node.op == "constant":
            row = ["constant", node.payload]
        elif node.op == "symbol":
            row = ["symbol", list(names).index(node.payload)]
        elif node.op == "pow" and node.args[1].op == "number":
            row = ["power", places[node.args[0]], str(node.args[1].payload)]
        elif node.payload is None:
            row = [node.op, *(places[arg] for arg in node.args)]
        else:
            raise ReplayError(f"the operation {node.op!r}, which is not known there")
        places[node] = len(rows)
        rows.append(row)
    return rows, [places[tree] for tree in trees]


def _by_taylor_models(
    trees: tuple[Expr, ...], names: Sequence[str], surface: Spline | Quadric
) -> float:
    """Return a bound for splines and planes; infinite where there is none."""
    if isinstance(surface, Spline):
        degrees = surface.degrees[0], surface.degrees[1]
        knots, poles = (surface.knots[0], surface.knots[1]), surface.poles
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
        return bound_surface(trees, names, carriers.SplineSurface(degrees, knots, poles)).largest
    except BreaksNotAlignedError:
        return np.inf


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
