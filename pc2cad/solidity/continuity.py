"""Does the map jump.

It does not where it is made of continuous functions, and nothing that is divided by vanishes: that
is proved by enclosures over boxes that fill the box. Where it is not, samples are looked at: a step
between two samples that is much larger than those beside it is either steep or a jump. Which
of them shows by halving: where the map is continuous the step becomes small with its interval, and
at a jump it stays, down to neighbouring numbers. The sides are looked at, and where M may jump some
lines through the box: jumps inside need not reach its sides. Pieces of M hold their ends. So where
the equation takes a step at an end or a break alone, as floor(u) does at u = 1, none of these
samples shows it, and the equation as it is written is asked for its values there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import groupby
from typing import Final

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.bounds.known import Models
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import Mapping3, open_grid
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.errors import NotASolidError
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.evaluation import Program
from pc2cad.expression.intervals import ULP, Interval
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.rewriting import among
from pc2cad.expression.tree import Expr, ValueDomainError, number, ops_of, substitute, walk
from pc2cad.solidity.face_mesh import FaceMesh, by_shape

#: a step is looked into where it exceeds both steps beside it by this factor; so many per direction
STEEP, MOST = 4.0, 4
#: halvings, down to neighbouring numbers, and the share of the step that they leave at a jump
HALVINGS, LEFT = 52, 0.25
#: the last halvings, in which no jump falls
LAST: Final = 20
#: faces that are looked at together
TOGETHER = 16
#: steps below this share of the part's size are left to the comparison with the tolerance
SMALLEST = 1e-6

#: lines through the box along each parameter, so many by so many, and places on each of them
ACROSS = 6
LINES: Final = (97, ACROSS**2)

#: what is continuous wherever its operands are
_CONTINUOUS: Final = frozenset((
    "number", "constant", "symbol", "add", "mul", "neg", "sin", "cos", "atan", "sinh", "cosh",
    "tanh", "asinh", "exp", "abs", "min", "max", "fourier",
))  # fmt: skip
#: of what is continuous for some operands only: where these have to stay
_Range = Callable[[Interval], bool]
_RANGES: Final[dict[str, _Range]] = {
    "div": lambda x: bool(((x.lower > 0) | (x.upper < 0)).all()),
    "sqrt": lambda x: bool((x.lower >= 0).all()),
    "log": lambda x: bool((x.lower > 0).all()),
    "asin": lambda x: bool(((x.lower >= -1) & (x.upper <= 1)).all()),
    "acos": lambda x: bool(((x.lower >= -1) & (x.upper <= 1)).all()),
    "acosh": lambda x: bool((x.lower >= 1).all()),
    "atanh": lambda x: bool(((x.lower > -1) & (x.upper < 1)).all()),
}
#: what may have another value at a place than on both sides of it
_STEPS: Final = frozenset(("sign", "floor", "mod", "where"))
#: where the other parameters are on the way along an end or a break, besides at their own ends
_INSIDE: Final = (0.1371, 0.3719, 0.6131, 0.8473)
#: places that are kept as floats are these fractions
_LARGEST_DENOMINATOR: Final = 10**6

#: boxes along each parameter, by the number of parameters that something depends on
_BOXES: Final = {1: 64, 2: 32, 3: 12}


class DiscontinuousMapError(NotASolidError):
    """The map jumps inside its box: the image falls into parts."""


def is_continuous(roots: tuple[Expr, ...], models: Sequence[Models] = ()) -> bool:
    """Say whether trees are proved to be finite and continuous over the unit box.

    What models that are known on boxes that fill it say of trees is not asked again.
    """
    if ops_of(roots) <= _CONTINUOUS:
        return True
    asked: list[tuple[tuple[str, ...], str, Expr]] = []
    for node in walk(roots):
        if node.op in _CONTINUOUS or not node.symbols:
            continue
        found = _asked(node)
        if found is None:
            return False
        asked += [
            (tuple(sorted(tree.symbols)), op, tree)
            for op, tree in found
            if tree.symbols and not any(_is_known(op, tree, of) for of in models)
        ]
    # by parameters: variants of a template have some trees in common
    asked.sort(key=lambda row: row[0])
    return all(
        _stay(names, tuple(dict.fromkeys((op, tree) for _, op, tree in rows)))
        for names, rows in groupby(asked, lambda row: row[0])
    )


def _asked(node: Expr) -> list[tuple[str, Expr]] | None:
    """Return which operands of an operation have to stay in a range, None: it may jump anyway."""
    if node.op == "pieces":
        return [] if node.payload.smoothness >= 0 else None
    if node.op == "pow":
        base, exponent = node.args
        if exponent.op != "number":
            return [("log", base)]
        whole, positive = exponent.payload.denominator == 1, exponent.payload > 0
        if whole:
            return [] if positive else [("div", base)]
        return [("sqrt" if positive else "log", base)]
    if node.op not in _RANGES:
        return None
    if node.op == "div" and node.args[1].op == "sqrt":
        # a root is above 0 where what it is of is
        return [("log", node.args[1].args[0])]
    return [(node.op, node.args[-1])]


def _is_known(op: str, tree: Expr, models: Models) -> bool:
    """Say whether models, on boxes that fill the box, show that an operand stays in its range."""
    model = models.stored(tree)
    if model is None:
        return False
    middle, reach = model.centre, model.reach * (1 + 4 * ULP)
    low, high = middle - reach, middle + reach
    return _RANGES[op](Interval(low - np.abs(low) * ULP, high + np.abs(high) * ULP))


@lru_cache(maxsize=64)
def _stay(names: tuple[str, ...], asked: tuple[tuple[str, Expr], ...]) -> bool:
    """Say whether operands that depend on some parameters are proved to stay in their ranges."""
    ends = np.linspace(0.0, 1.0, _BOXES[len(names)] + 1)
    boxes = {}
    for name in names:
        shape = [-1 if name == other else 1 for other in PARAMETERS]
        boxes[name] = Interval(ends[:-1].reshape(shape), ends[1:].reshape(shape))
    trees = tuple(dict.fromkeys(tree for _, tree in asked))
    found = dict(zip(trees, IntervalProgram(trees)(boxes), strict=True))
    return all(_RANGES[op](found[tree]) for op, tree in asked)


def check_continuous(
    analysis: Analysis, face_meshes: Sequence[FaceMesh], proved: bool = False
) -> None:
    """Raise DiscontinuousMapError where the map jumps on a side, or on a line through the box.

    Lines are looked at where it is not `proved` that it jumps nowhere (see `is_continuous`).
    """
    for faces in by_shape(face_meshes):
        for start in range(0, len(faces), TOGETHER):
            several = [face_meshes[f] for f in faces[start : start + TOGETHER]]
            samples = np.array([face_mesh.samples for face_mesh in several])
            for axis in (0, 1):
                found = _steep(samples, axis, SMALLEST * analysis.size)
                for face_mesh, places in zip(several, found, strict=True):
                    if len(places):
                        _check(face_mesh.function, face_mesh.samples.shape, axis, places)
    if not proved:
        for direction in range(3):
            lines = _Lines(analysis.map, direction)
            samples = lines.at(*np.meshgrid(*(np.linspace(0, 1, n) for n in LINES), indexing="ij"))
            places = _uneven(samples, SMALLEST * analysis.size)
            if len(places):
                _check(lines, samples.shape, 0, places, SMALLEST * analysis.size)


def check_written(analysis: Analysis) -> None:
    """Raise DiscontinuousMapError where the equation jumps at an end or a break alone.

    M comes to one place there, from inside, and the equation as it is written has another one.
    """
    stepped = among(analysis.equation.coordinates, lambda node: not _STEPS.isdisjoint(node.ops))
    # a condition is the first operand of a choice
    deciding = [
        node.args[:1] if node.op == "where" else node.args for node in stepped if node.op in _STEPS
    ]
    names = {name for operands in deciding for each in operands for name in each.symbols}
    for direction, name in enumerate(PARAMETERS):
        if name in names:
            _check_written(analysis, direction)


def _check_written(analysis: Analysis, direction: int) -> None:
    mapping = analysis.map
    local = [np.array((0.0, *_INSIDE, 1.0))] * 3
    breaks = {b.position for b in analysis.breaks[direction]}
    local[direction] = np.array(sorted(breaks | {0.0, 1.0}))
    comes = mapping.points(*open_grid(*local))
    written = np.concatenate(
        [_written(analysis, direction, place, local) for place in local[direction].tolist()],
        axis=direction,
    )
    with np.errstate(all="ignore"):
        off = np.nan_to_num(_lengths(written - comes), posinf=0.0)
    smallest = SMALLEST * analysis.size
    inside = np.zeros_like(off)
    within = tuple(slice(None) if d == direction else slice(1, -1) for d in range(3))
    inside[within] = off[within]
    worst = np.unravel_index((inside if inside.max() > smallest else off).argmax(), off.shape)
    if off[worst] <= smallest:
        return
    where = mapping.shown(row[k] for row, k in zip(local, worst, strict=True))
    before, there = (", ".join(f"{x:.6g}" for x in points[worst]) for points in (comes, written))
    raise DiscontinuousMapError(
        f"the map jumps at {where}: beside that place it comes to ({before}), and there it is "
        f"({there}); a solid's points follow its parameters without a gap: write the equation so "
        "that it goes on to there, with <= for < in a condition, say"
    )


def _written(analysis: Analysis, direction: int, place: float, local: Sequence[Array]) -> Array:
    """Return points of the equation as it is written where a direction has one value; or nan."""
    mapping, name = analysis.map, PARAMETERS[direction]
    near = Fraction(place).limit_denominator(_LARGEST_DENOMINATOR)
    at = number(near if abs(near - Fraction(place)) < ULP else Fraction(place))
    axes = [np.array([place]) if d == direction else row for d, row in enumerate(local)]
    grid = open_grid(*axes)
    try:
        own = substitute((mapping.parameters[direction],), {name: at})
        trees = substitute(analysis.equation.coordinates, {name: own[0]})
    except ValueDomainError:
        return np.full((*np.broadcast_shapes(*(x.shape for x in grid)), 3), np.nan)
    values = {n: mapping.values(d, grid[d]) for d, n in enumerate(PARAMETERS) if n != name}
    with np.errstate(all="ignore"):
        return np.stack(np.broadcast_arrays(*grid, *Program(trees)(values))[3:], axis=-1)


def _uneven(samples: Array, smallest: float) -> Integers:
    """Return indices (k, 2) of the steps along lines that differ most from those beside them."""
    gap = np.diff(samples, axis=0)
    off = np.zeros(gap.shape[:2])
    off[1:-1] = _lengths(gap[1:-1] - (gap[:-2] + gap[2:]) / 2)
    most = np.argsort(-off, axis=None)[:MOST]
    places = np.stack(np.unravel_index(most, off.shape), axis=1)
    return np.asarray(places[off.ravel()[most] > smallest])


@dataclass(frozen=True)
class _Lines:
    """Lines through the box along one parameter: the first coordinate; the second tells which."""

    map: Mapping3
    direction: int

    def at(self, s: Array, t: Array) -> Array:
        """Return points of the lines."""
        return self.map.points(*self._place(s, t))

    def shown(self, s: float, t: float) -> str:
        """Return a place in the equation's own parameters."""
        return self.map.shown(float(x) for x in self._place(np.array(s), np.array(t)))

    def _place(self, s: Array, t: Array) -> list[Array]:
        row, column = np.divmod(np.rint(t * (LINES[1] - 1)), ACROSS)
        place = [(row + 0.5) / ACROSS, (column + 0.5) / ACROSS]
        place.insert(self.direction, s)
        return place


def _steep(samples: Array, axis: int, smallest: float) -> list[Integers]:
    """Return indices (k, 2) of the steps along an axis that exceed their neighbours by far.

    There is a row of them for each of several faces (n, …).
    """
    gap = np.diff(samples, axis=1 + axis)
    steps = np.moveaxis(_lengths(gap), 1 + axis, 1)
    beside = np.zeros_like(steps)
    beside[:, 1:] = steps[:, :-1]
    beside[:, :-1] = np.maximum(beside[:, :-1], steps[:, 1:])
    steep = steps > STEEP * beside + smallest
    if not steep.any():
        return [np.empty((0, 2), dtype=np.int64)] * len(samples)
    rows: list[Integers] = []
    for row, of_row in zip(steps, steep, strict=True):
        found = np.argwhere(of_row)
        found = found[np.argsort(-row[tuple(found.T)])[:MOST]]
        rows.append(found if axis == 0 else found[:, ::-1])
    return rows


def _check(
    function: RestrictedMap | _Lines,
    shape: tuple[int, ...],
    axis: int,
    places: Integers,
    smallest: float = 0.0,
) -> None:
    """Raise where halving leaves a share of a step; or more than is told, where that is given."""
    low = places / (np.array(shape[:2]) - 1)
    high = low.copy()
    high[:, axis] += 1 / (shape[axis] - 1)
    ends = [function.at(*place.T) for place in (low, high)]
    first = _lengths(ends[1] - ends[0])
    most = np.full(len(first), smallest) if smallest else LEFT * first
    for turn in range(HALVINGS):
        if smallest and turn == HALVINGS - LAST:
            # steep roots leave more than is told, too, but go on falling
            most = np.maximum(most, LEFT * _lengths(ends[1] - ends[0]))
        middle = (low + high) / 2
        amid = function.at(*middle.T)
        known = np.isfinite(amid).all(axis=1)  # right at a jump there may be no value
        left = known & (_lengths(amid - ends[0]) > _lengths(ends[1] - amid))
        right = known & ~left
        low[right], ends[0][right] = middle[right], amid[right]
        high[left], ends[1][left] = middle[left], amid[left]
        jumps = np.flatnonzero(_lengths(ends[1] - ends[0]) > most)
        if len(jumps) == 0:
            return
    worst = jumps[first[jumps].argmax()]
    before, after = (", ".join(f"{x:.6g}" for x in end[worst]) for end in ends)
    raise DiscontinuousMapError(
        f"the map jumps near {function.shown(*high[worst])}, "
        f"from ({before}) to ({after}): a solid's points follow its parameters without a gap; end "
        "the domain there, or write the equation so that it goes on (a branch cut of atan2 can be "
        "turned away)"
    )


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))
